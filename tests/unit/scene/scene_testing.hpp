#pragma once

#include "../../reference_data.hpp"
#include "common/error.hpp"
#include "scene/shape.hpp"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <cstdlib>
#include <filesystem>
#include <fstream>
#include <random>
#include <string>

namespace cleave::scene {

/// A directory for the files of one test, removed with it.
class TemporaryDirectory {
 public:
  TemporaryDirectory() {
    std::string name = (std::filesystem::temp_directory_path() / "cleave-scene-XXXXXX").string();
    path_ = mkdtemp(name.data());
  }
  ~TemporaryDirectory() { std::filesystem::remove_all(path_); }
  TemporaryDirectory(const TemporaryDirectory&) = delete;
  TemporaryDirectory& operator=(const TemporaryDirectory&) = delete;

  std::filesystem::path write(const std::string& name, const std::string& bytes) const {
    std::filesystem::remove(path_ / name);  // some file systems flush a file to disk when it is overwritten
    std::ofstream(path_ / name, std::ios::binary) << bytes;
    return path_ / name;
  }
  const std::filesystem::path& path() const { return path_; }

 private:
  std::filesystem::path path_;
};

/// What an InputError says; empty if there is none.
template <class Action>
std::string input_error(const Action& action) {
  try {
    action();
  } catch (const InputError& error) {
    return error.what();
  }
  return {};
}

/// A mesh that comes with the project's data rather than its source; empty if this machine does not have it.
inline std::filesystem::path shared_mesh(const std::string& name) {
  const std::filesystem::path mesh = reference_data() / "meshes" / name;
  return std::filesystem::exists(mesh) ? mesh : std::filesystem::path();
}

class RandomPoints {
 public:
  explicit RandomPoints(double half_width, unsigned seed = 7) : generator_(seed), component_(-half_width, half_width) {}
  Vector3 next() {
    const double x = component_(generator_), y = component_(generator_), z = component_(generator_);
    return {x, y, z};
  }

 private:
  std::mt19937_64 generator_;
  std::uniform_real_distribution<double> component_;
};

}  // namespace cleave::scene
