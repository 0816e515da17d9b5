#pragma once

#include <filesystem>
#include <map>
#include <string>
#include <vector>

/// Instructions per particle and step, which a busy machine does not disturb. A scene is run twice under valgrind's callgrind,
/// on one thread, with the AVX2 variants; the difference of the two runs has neither start-up nor output in it.
namespace cleave::instructions {

/// A scene of this folder, and values of it that are changed.
struct Workload {
  std::string name, scene;
  std::vector<std::string> sets = {};
};

/// Steps of the shorter and of the longer run. Both are multiples of the interval at which wave speeds are measured, so that
/// the difference has its share of them.
inline constexpr int first_step = 8, last_step = 24;

struct Count {
  double particles = 0;
  double per_step = 0;                               ///< instructions of all particles in a step
  std::map<std::string, double> functions;           ///< their own instructions in a step
  std::map<std::string, double> bytes_per_particle;  ///< as the program says

  double per_particle() const { return per_step / particles; }
};

/// Why nothing can be counted here; empty if it can.
std::string obstacle();

/// Throws std::runtime_error with what the program said if it fails.
Count count(const Workload&);

/// "library: qualified name" without arguments, template arguments and return type.
std::string short_name(const std::string& library, const std::string& function);

/// The workloads that are guarded.
const std::vector<Workload>& guarded();

/// Figures of a workload per particle and step.
struct Figures {
  double instructions = 0;
  std::map<std::string, double> functions;  ///< the ten that have most themselves
};
Figures figures_of(const Count&);

struct Record {
  std::string compiler;
  std::map<std::string, Figures> workloads;
};

/// What this was compiled with.
std::string compiler();
std::filesystem::path record_file();
Record read_record();
void write_record(const Record&);

/// The ten functions with most instructions, and what the record says of them.
std::string comparison(const Count&, const Figures& recorded);

}  // namespace cleave::instructions
