#include "study/stability.hpp"

#include "common/error.hpp"
#include "study/expression.hpp"
#include "study/run_results.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <limits>

namespace cleave::study {
namespace {

/// An expression of columns of frames.csv, in every row.
std::vector<double> evaluate(const Formula& formula, const Study& study, const std::vector<double>& constants,
                             const FrameTable& frames) {
  auto names = study.names();
  names.insert(names.end(), frame_columns().begin(), frame_columns().end());
  const Expression expression(formula, names);
  frames.require(formula);
  std::vector<double> results;
  for (const auto& row : frames.rows) {
    std::vector<double> values = constants;
    values.insert(values.end(), row.begin(), row.end());
    results.push_back(expression(values));
  }
  return results;
}

Judgement judge_rows(const Study& study, const std::vector<double>& constants, const FrameTable& frames) {
  const StabilityMeasure& map = *study.map;
  const std::vector<double> times = frames.column("time");
  for (const Formula& formula : map.energy) {
    const auto energy = evaluate(formula, study, constants, frames);
    if (energy.empty() || !(energy[0] > 0))
      throw InputError(config::error_at(formula.where) + "the energy at the start must be above 0, is " +
                       (energy.empty() ? "unknown" : fmt::format("{:g}", energy[0])));
    for (std::size_t i = 0; i < energy.size(); ++i) {
      if (!std::isfinite(energy[i])) return {State::degraded, fmt::format("energy is not finite at {:.3g} s", times[i])};
      if (energy[i] <= (1 + map.tolerance) * energy[0]) continue;
      double most = energy[i];
      for (const double e : energy) most = std::isfinite(e) ? std::max(most, e) : most;
      return {State::degraded, fmt::format("energy grows by {:.3g} %, beyond {:g} % at {:.3g} s", 100 * (most / energy[0] - 1),
                                           100 * map.tolerance, times[i])};
    }
  }
  for (const Criterion& criterion : map.degraded) {
    const auto holds = evaluate(criterion.when, study, constants, frames);
    for (std::size_t i = 0; i < holds.size(); ++i)
      if (holds[i] != 0) return {State::degraded, fmt::format("{}, at {:.3g} s", criterion.reason, times[i])};
  }
  return {State::stable, ""};
}

}  // namespace

const char* word_of(State state) {
  constexpr const char* words[] = {"stable", "degraded", "refused", "failed", "timed out", "not run"};
  return words[int(state)];
}

Judgement judge_stability(const Study& study, const std::vector<double>& constants, const Record& record,
                          const std::filesystem::path& run) {
  switch (record.outcome) {
    case Outcome::refused:
      return {State::refused, record.reason};
    case Outcome::failed:
      return {State::failed, record.reason};
    case Outcome::timed_out:
      return {State::timed_out, record.reason};
    case Outcome::done:
      break;
  }
  return judge_rows(study, constants, read_frames(run / "frames.csv"));
}

double reported_bound(const Study& study, const std::vector<double>& constants, const std::filesystem::path& run) {
  const auto values = evaluate(*study.map->bound, study, constants, read_frames(run / "frames.csv"));
  if (values.size() < 2) return std::numeric_limits<double>::quiet_NaN();
  return *std::min_element(values.begin() + 1, values.end());
}

Boundary boundary_of(const std::vector<double>& values, const std::vector<State>& states, std::optional<double> predicted) {
  Boundary boundary;
  boundary.predicted = predicted;
  for (std::size_t i = 0; i < values.size(); ++i) {
    if (states[i] != State::stable) {
      if (states[i] != State::missing) boundary.unstable = values[i];
      break;
    }
    boundary.stable = values[i];
  }
  if (predicted && boundary.stable) boundary.low = *boundary.stable / *predicted;
  if (predicted && boundary.unstable) boundary.high = *boundary.unstable / *predicted;
  if (!predicted)
    boundary.verdict = boundary.unstable ? "measured" : "not reached";
  else if (boundary.low && *boundary.low > 2)
    boundary.verdict = "below half of the boundary";
  else if (!boundary.unstable)
    boundary.verdict = "not reached";
  else if (*boundary.high <= 1)
    boundary.verdict = "above the boundary";
  else
    boundary.verdict = boundary.low ? "holds" : "not resolved";
  return boundary;
}

}  // namespace cleave::study
