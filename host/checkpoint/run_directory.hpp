#pragma once

#include "checkpoint/state.hpp"

#include <cstdint>
#include <filesystem>
#include <fstream>
#include <functional>
#include <map>
#include <memory>
#include <optional>
#include <string>
#include <vector>

namespace cleave::checkpoint {

/// Where a run is, and what its bits hang on beside the state.
struct Run {
  std::string program;            ///< version
  std::uint32_t program_crc = 0;  ///< of the executable
  std::string isa;                ///< of the kernels
  int threads = 0;
  struct Library {
    std::string id, version, file;
    std::uint32_t crc = 0;  ///< of the file
  };
  std::vector<Library> plugins;
  std::string scene;                           ///< all of it, defaults written out
  std::map<std::string, std::uint32_t> files;  ///< crc of the files that the scene names, by the key that names them

  int frames = 0;     ///< complete ones
  std::string table;  ///< frames.csv with their rows
  std::int64_t steps = 0;
  double time = 0;  ///< s
  double wall_seconds = 0, stepping_seconds = 0, output_seconds = 0;
};

/// A checkpoint that is whole.
struct Opened {
  std::filesystem::path file;
  Run run;
  StateReader& state() { return *reader; }

  std::unique_ptr<std::ifstream> stream;
  std::unique_ptr<StateReader> reader;
};

/// The checkpoints of a run directory: checkpoints/step_000000001234.checkpoint, the newest two. A new one takes its name when
/// it is on the disk; only then the oldest is removed.
class RunCheckpoints {
 public:
  explicit RunCheckpoints(const std::filesystem::path& run_directory) : folder_(run_directory / "checkpoints") {}

  /// `state` writes the state; `run` is asked afterwards. Checkpoints of later steps are removed: they are of what this run has
  /// gone back from. Throws InputError naming the file where it cannot be written; those before are then as they were.
  std::filesystem::path save(std::int64_t steps, const std::function<void(StateWriter&)>& state,
                             const std::function<Run()>& run) const;
  /// The newest that is whole. What is wrong with newer ones is added to `problems`, a sentence each.
  std::optional<Opened> newest(std::vector<std::string>& problems) const;
  /// Removes all of them.
  void clear() const;

 private:
  /// By steps, the newest first.
  std::vector<std::pair<std::int64_t, std::filesystem::path>> files() const;

  std::filesystem::path folder_;
};

/// CRC-32 of a file; continues `before`. Throws InputError if it cannot be read.
std::uint32_t checksum_of_file(const std::filesystem::path&, std::uint32_t before = 0);

}  // namespace cleave::checkpoint
