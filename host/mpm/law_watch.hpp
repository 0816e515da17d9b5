#pragma once

#include "mpm/failed_batch.hpp"

#include <array>
#include <filesystem>
#include <memory>
#include <mutex>
#include <string>
#include <vector>

namespace cleave::mpm {

class LawWatch;

/// The batches that laws failed on, of which one is wanted: the first in memory of each degree of failure. So it does not
/// depend on threads which they are, and the point that a run names is in one of them.
class FailedBatches {
 public:
  struct Kept {
    const LawWatch* law = nullptr;
    const char *first = nullptr, *end = nullptr;  ///< its tiles
    BatchSnapshot batch;
  };
  /// [any-thread]
  void keep(std::size_t degree, const LawWatch&, const cleave_batch&, const void* saved, cleave_result,
            std::uint32_t not_finite);
  /// Forgets them: what failed was tried only.
  void clear() { kept_ = {}; }
  /// The batch that has this tile, null if no law failed there.
  const Kept* find(const char* tile) const;

 private:
  std::mutex mutex_;
  std::array<std::unique_ptr<Kept>, 3> kept_;
};

/// Stands between the kernels and a law: keeps what went in where the law fails, gives numbers that are not finite, or crashes.
/// Costs a copy of the rows the law overwrites and a look at its results.
class LawWatch {
 public:
  /// `header` is what batch_header says of the law.
  LawWatch(const BoundLaw&, bool single, std::string header, FailedBatches&);
  /// Keeps nothing but what a crash leaves: who calls reads what the law failed on.
  LawWatch(const BoundLaw&, bool single, std::string header);
  LawWatch(const LawWatch&) = delete;
  LawWatch& operator=(const LawWatch&) = delete;

  /// To be called in place of the law; nothing if there is none. Valid while this object lives.
  BoundLaw watched() const;
  const std::string& header() const { return header_; }
  bool single() const { return single_; }

  /// Reads inputs (those overwritten from `saved`), and outputs if the law has returned. Async-signal-safe.
  void read(BatchSnapshot&, const cleave_batch&, const void* saved) const;

  /// The output fields of a call.
  static std::vector<cleave_field_id> outputs_of(const BoundLaw&);

 private:
  struct Place {
    cleave_field_id field;
    cleave_component at;
    int saved;  ///< row of the copy made before the call, -1 if the law does not write here
  };
  template <class T>
  static cleave_result call(const cleave_instance*, const cleave_batch*);
  template <class T>
  void read_as(BatchSnapshot&, const cleave_batch&, const void* saved) const;

  static constexpr int most_saved = 10 + int(CLEAVE_MAX_STATE);  ///< strain, damage and state variables

  BoundLaw law_;
  bool single_;
  std::string header_;
  FailedBatches* failed_;  // may be null
  std::vector<Place> inputs_, outputs_;
  std::vector<cleave_component> overwritten_, results_;
};

/// While it lives, a plugin that crashes in a watched law leaves the batch in `file` before the program ends by the signal.
class CrashDump {
 public:
  explicit CrashDump(const std::filesystem::path& file);
  ~CrashDump();
  CrashDump(const CrashDump&) = delete;
  CrashDump& operator=(const CrashDump&) = delete;
};

}  // namespace cleave::mpm
