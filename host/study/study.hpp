#pragma once

#include "config/catalog.hpp"

#include <filesystem>
#include <map>
#include <optional>
#include <string>
#include <vector>

namespace cleave::study {

/// One value of an axis: what it changes in the scene, and what it is called.
struct AxisValue {
  std::string label;
  std::optional<double> number;  ///< where the axis is a number
  std::vector<config::Override> overrides;
};

struct Axis {
  std::string name, unit;
  std::vector<AxisValue> values;
  std::vector<std::string> paths;  ///< what each value changes, in the scene
  config::Location where;

  bool numeric() const;      ///< every value has a number
  bool logarithmic() const;  ///< numeric, positive, and spread over more than a factor of three
};

/// An expression and where the study has it.
struct Formula {
  std::string text;
  config::Location where;
};

enum class Norm { l2, maximum, last };
enum class Cost { wall, particle_steps, memory, instructions };

/// Particles put together by a coordinate, so that bodies of different particles can be compared.
struct Profile {
  Formula along;
  double from = 0, to = 0;
  int bins = 0;
};

/// What of a run is compared with what.
struct ErrorMeasure {
  std::string title = "error";                      ///< of the vertical axis
  std::string unit;                                 ///< of what is compared; a relative error has none
  bool particles = false;                           ///< of the last frame, in place of the rows of frames.csv
  std::vector<Formula> value;                       ///< components, of columns of frames.csv or of fields of particles
  std::vector<Formula> expected;                    ///< closed form, one for each component; empty: see below
  std::map<std::string, std::string> reference_at;  ///< axes whose value another point of the study has: axis, label
  std::vector<config::Override> reference_set;      ///< and what else that run changes
  bool has_reference = false;
  std::optional<std::filesystem::path> file;  ///< CSV with the column `file_at` (time, or what the profile is along)
  std::string file_at;
  std::vector<std::string> file_columns;  ///< one for each component
  Norm norm = Norm::l2;
  bool relative = true;
  std::optional<Formula> scale;  ///< what a relative error is relative to; empty: the same norm of what is expected
  std::optional<Profile> profile;
};

struct Criterion {
  Formula when;
  std::string reason;
};

/// How runs of a stability map are judged.
struct StabilityMeasure {
  std::vector<Formula> energy;      ///< one expression of columns of frames.csv
  double tolerance = 0.01;          ///< growth of the energy, relative, that is not yet called degraded
  std::vector<Criterion> degraded;  ///< expressions that are not 0 in a row of a degraded run
  std::optional<Formula> bound;     ///< predicted largest stable value of the second axis
  std::string bound_title = "predicted bound";
  bool bound_of_runs = false;  ///< `bound` is of the columns of a run with `bound_set`, its smallest over the frames
  std::vector<config::Override> bound_set;
};

/// A study as its file says.
struct Study {
  std::filesystem::path file;
  std::string title, description;
  bool stability = false;  ///< else speed and accuracy
  std::filesystem::path scene;
  std::vector<config::Override> set;
  int threads = 1, repetitions = 1;
  double time_limit = 600;  ///< s of one run
  bool instructions = false;
  Cost cost = Cost::wall;
  std::vector<Axis> axes;
  std::optional<std::size_t> along;                        ///< axis that lines of the chart follow; empty: none is numeric
  std::vector<std::pair<std::string, Formula>> constants;  ///< each after those it is made of
  std::optional<ErrorMeasure> error;
  std::optional<StabilityMeasure> map;

  /// Names that stand for numbers in every expression: numeric axes, then constants.
  std::vector<std::string> names() const;
};

/// The name of an axis as expressions write it: what is no letter or digit is '_'.
std::string identifier(const std::string& name);

/// Reads and checks a study file; `added` are further values of its axes, "axis=value". Throws InputError with everything that
/// is wrong, each as "file:line:column: error: what. what would be right".
Study load_study(const std::filesystem::path&, const std::vector<std::string>& added, const config::PluginCatalog&);

}  // namespace cleave::study
