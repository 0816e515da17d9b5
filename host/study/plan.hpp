#pragma once

#include "study/study.hpp"

#include <filesystem>
#include <optional>
#include <string>
#include <vector>

namespace cleave::study {

/// One simulation that a study needs; several points may need the same.
struct Run {
  std::string what;                         ///< "law qr, cell_size 0.1"
  std::vector<config::Override> overrides;  ///< of the study's scene
  std::string scene;                        ///< complete TOML; empty if the scene is refused
  std::string refusal;                      ///< why it is
  std::string key;                          ///< of everything its results depend on
};

/// A place on the axes.
struct Point {
  std::vector<std::size_t> at;           ///< index of the value on each axis
  std::size_t run = 0;                   ///< index into Plan::runs
  std::optional<std::size_t> reference;  ///< run that its error is measured against
};

struct Plan {
  std::vector<Point> points;
  std::vector<Run> runs;
  std::vector<std::size_t> bound_runs;  ///< stability: for each value of the first axis the run that reports the bound
};

/// The product of the axes, the first one outermost, as indices of values.
std::vector<std::vector<std::size_t>> product(const std::vector<Axis>&);

/// "law qr, cell_size 0.1 m".
std::string name_of(const Study&, const std::vector<std::size_t>& at);
/// Numbers of the numeric axes at a place, for constants_of().
std::vector<double> numbers_at(const Study&, const std::vector<std::size_t>& at);

/// All runs of a study. The key of a run is a digest of its complete scene, the files the scene names, the libraries of its
/// plugins, the program with its kernels, the number of threads and the instruction set. A scene that cannot be read is a
/// result, too.
Plan make_plan(const Study&, const plugins::Registry&);

/// FNV-1a, 64 bits, of everything added so far.
class Digest {
 public:
  Digest& add(std::string_view text);  ///< and where it ends
  Digest& add_file(const std::filesystem::path&);
  std::string hex() const;

 private:
  std::uint64_t hash_ = 14695981039346656037u;
};

}  // namespace cleave::study
