#pragma once

#include "common/error.hpp"
#include "output/frame.hpp"

#include <gtest/gtest.h>
#include <unistd.h>

#include <filesystem>
#include <fstream>
#include <iterator>
#include <random>
#include <set>

namespace cleave::output {

/// What an action throws, or "".
template <class Action>
std::string error_of(const Action& action) {
  try {
    action();
  } catch (const InputError& error) {
    return error.what();
  }
  return "";
}

/// Each test writes into a directory of its own.
class RunDirectory : public testing::Test {
 protected:
  void SetUp() override {
    std::string pattern = (std::filesystem::temp_directory_path() / "cleave_output_XXXXXX").string();
    ASSERT_NE(::mkdtemp(pattern.data()), nullptr);
    directory = pattern;
  }
  void TearDown() override { std::filesystem::remove_all(directory); }

  /// Paths of all files, relative to the run directory.
  std::set<std::string> files() const {
    std::set<std::string> found;
    for (const auto& entry : std::filesystem::recursive_directory_iterator(directory))
      if (entry.is_regular_file()) found.insert(std::filesystem::relative(entry.path(), directory).string());
    return found;
  }

  std::string contents(const std::string& name) const {
    std::ifstream file(directory / name, std::ios::binary);
    EXPECT_TRUE(file) << name;
    return {std::istreambuf_iterator<char>(file), {}};
  }

  std::filesystem::path directory;
};

/// Two bodies, a third of the particles in the second, far enough from the origin to tell single from double precision, and an
/// attribute of each width.
inline ParticleFrame random_frame(std::size_t particles, int dimension = 3, int index = 7) {
  std::mt19937 random(static_cast<unsigned>(particles) + static_cast<unsigned>(dimension));
  std::uniform_real_distribution<double> place(90, 110), value(-1, 1);
  ParticleFrame frame;
  frame.index = index;
  frame.time = 0.125 * index;
  frame.dimension = dimension;
  frame.cell_size = 0.5;
  frame.bodies = {"left half", "right <half> & \"rest\""};
  frame.body_ends = {particles - particles / 3, particles};
  for (const auto& [name, components, unit] :
       {std::tuple{"damage", 1, "1"}, {"fiber", 3, ""}, {"stress", 6, "Pa"}, {"F", 9, "1"}, {"v", 1, ""}})
    frame.attributes.push_back({name, components, unit, {}});
  for (std::size_t i = 0; i < particles; ++i) {
    frame.positions.emplace_back(place(random), place(random), dimension == 3 ? place(random) : 0);
    frame.velocities.push_back(Eigen::Vector3f::NullaryExpr([&] { return static_cast<float>(value(random)); }));
    frame.volumes.push_back(static_cast<float>(0.01 + 0.001 * value(random)));
    for (Attribute& attribute : frame.attributes)
      for (int c = 0; c < attribute.components; ++c) attribute.values.push_back(static_cast<float>(value(random)));
  }
  return frame;
}

}  // namespace cleave::output
