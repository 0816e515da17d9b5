#pragma once

#include "study/record.hpp"
#include "study/study.hpp"

#include <optional>
#include <string>
#include <vector>

namespace cleave::study {

enum class State { stable, degraded, refused, failed, timed_out, missing };
const char* word_of(State);

struct Judgement {
  State state = State::missing;
  std::string reason;
};

/// Of one run: degraded if its energy has grown beyond the tolerance, is no longer a number, or a criterion holds in a frame.
Judgement judge_stability(const Study&, const std::vector<double>& constants, const Record&, const std::filesystem::path& run);

/// What a run with the study's `bound_set` reports: the smallest of its expression over the frames after the first.
double reported_bound(const Study&, const std::vector<double>& constants, const std::filesystem::path& run);

/// Where one column of a map goes from stable to not, beside what was predicted.
struct Boundary {
  std::optional<double> predicted;
  std::optional<double> stable;    ///< largest value with all smaller ones stable
  std::optional<double> unstable;  ///< the next one
  /// (stable/predicted, unstable/predicted): the measured boundary lies between.
  std::optional<double> low, high;
  /// "holds", "above the boundary", "below half of the boundary"; "not reached" or "not resolved" if the values end before the
  /// boundary or begin beyond it; "measured" without a prediction.
  const char* verdict = "";
};

/// `values` ascending, `states` of each. The prediction holds if it lies at most a factor 2 below the measured boundary and not
/// above it, as far as the values tell.
Boundary boundary_of(const std::vector<double>& values, const std::vector<State>& states, std::optional<double> predicted);

}  // namespace cleave::study
