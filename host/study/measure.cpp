#include "study/measure.hpp"

#include "common/error.hpp"
#include "study/expression.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>

namespace cleave::study {
namespace {

double length(const std::vector<double>& v) {
  double squares = 0;
  for (const double x : v) squares += x * x;
  return std::sqrt(squares);
}

/// Samples of a run and where they are: times of frames, centres of bins, or numbers of particles.
struct Sampled {
  std::vector<double> at;
  Samples values;
};

std::vector<Expression> parse(const std::vector<Formula>& formulas, const std::vector<std::string>& names) {
  std::vector<Expression> expressions;
  for (const Formula& formula : formulas) expressions.emplace_back(formula, names);
  return expressions;
}

std::vector<double> evaluate(const std::vector<Expression>& expressions, const std::vector<double>& values) {
  std::vector<double> results;
  for (const Expression& expression : expressions) results.push_back(expression(values));
  return results;
}

/// Means over the bins of a profile; bins without particles are left out.
Sampled binned(const Profile& profile, const std::vector<double>& along, const Samples& values) {
  std::vector<int> count(std::size_t(profile.bins), 0);
  Samples sums(std::size_t(profile.bins), std::vector<double>(values.empty() ? 0 : values[0].size(), 0.0));
  const double width = (profile.to - profile.from) / profile.bins;
  for (std::size_t i = 0; i < along.size(); ++i) {
    const double place = std::floor((along[i] - profile.from) / width);
    if (!(place >= 0 && place < profile.bins)) continue;
    const auto bin = std::size_t(place);
    count[bin]++;
    for (std::size_t c = 0; c < values[i].size(); ++c) sums[bin][c] += values[i][c];
  }
  Sampled result;
  for (std::size_t b = 0; b < sums.size(); ++b) {
    if (count[b] == 0) continue;
    for (double& x : sums[b]) x /= count[b];
    result.at.push_back(profile.from + (double(b) + 0.5) * width);
    result.values.push_back(std::move(sums[b]));
  }
  if (result.at.empty())
    throw InputError(
        fmt::format("no particle lies between {:g} and {:g} along {}", profile.from, profile.to, profile.along.text));
  return result;
}

/// What two runs are compared by: values (or what is expected of them) of frames, particles or bins.
class Reader {
 public:
  Reader(const Study& study, const std::vector<double>& constants)
      : study_(study), error_(*study.error), constants_(constants) {}

  Sampled read(const std::filesystem::path& run, const std::vector<Formula>& formulas) const {
    return error_.particles ? of_particles(run, formulas) : of_frames(run, formulas);
  }

 private:
  Sampled of_frames(const std::filesystem::path& run, const std::vector<Formula>& formulas) const {
    auto names = study_.names();
    names.insert(names.end(), frame_columns().begin(), frame_columns().end());
    const auto expressions = parse(formulas, names);
    const FrameTable frames = read_frames(run / "frames.csv");
    for (const Formula& formula : formulas) frames.require(formula);
    Sampled result{frames.column("time"), {}};
    for (const auto& row : frames.rows) {
      std::vector<double> values = constants_;
      values.insert(values.end(), row.begin(), row.end());
      result.values.push_back(evaluate(expressions, values));
    }
    return result;
  }

  Sampled of_particles(const std::filesystem::path& run, const std::vector<Formula>& formulas) const {
    const Particles particles = read_last_particles(run);
    auto names = study_.names();
    names.insert(names.end(), particles.names.begin(), particles.names.end());
    names.push_back("t");
    const auto expressions = parse(formulas, names);
    std::optional<Expression> along;
    if (error_.profile) along.emplace(error_.profile->along, names);
    const double time = read_frames(run / "frames.csv").column("time").back();
    std::vector<double> places;
    Samples samples;
    for (std::size_t i = 0; i < particles.count(); ++i) {
      std::vector<double> values = constants_;
      for (const auto& field : particles.values) values.push_back(field[i]);
      values.push_back(time);
      samples.push_back(evaluate(expressions, values));
      places.push_back(along ? (*along)(values) : double(i));
    }
    if (error_.profile) return binned(*error_.profile, places, samples);
    return {std::move(places), std::move(samples)};
  }

  const Study& study_;
  const ErrorMeasure& error_;
  const std::vector<double>& constants_;
};

}  // namespace

double norm_of(const Samples& samples, Norm norm) {
  if (samples.empty()) return 0;
  if (norm == Norm::last) return length(samples.back());
  double result = 0;
  for (const auto& sample : samples) {
    const double l = length(sample);
    if (std::isnan(l)) return l;
    result = norm == Norm::maximum ? std::max(result, l) : result + l * l;
  }
  return norm == Norm::maximum ? result : std::sqrt(result / double(samples.size()));
}

double error_between(const Samples& actual, const Samples& expected, Norm norm, bool relative, std::optional<double> scale) {
  if (actual.size() != expected.size())
    throw InputError(fmt::format("{} samples cannot be compared with {}", actual.size(), expected.size()));
  Samples differences = actual;
  for (std::size_t i = 0; i < actual.size(); ++i)
    for (std::size_t c = 0; c < actual[i].size(); ++c) differences[i][c] -= expected[i][c];
  const double error = norm_of(differences, norm);
  if (!relative) return error;
  const double size = scale.value_or(norm_of(expected, norm));
  if (!(size > 0)) throw InputError("what is expected is 0: give 'scale', or relative = false");
  return error / size;
}

Samples interpolated(std::span<const double> at, const Samples& values, std::span<const double> wanted) {
  Samples results;
  const double slack = at.empty() ? 0 : 1e-9 * (at.back() - at.front());
  for (const double x : wanted) {
    if (at.empty() || x < at.front() - slack || x > at.back() + slack)
      throw InputError(
          at.empty() ? std::string("there is nothing to compare with")
                     : fmt::format("what is compared with ends at {:g} and {:g}, {:g} is asked for", at.front(), at.back(), x));
    const auto above = std::min(std::size_t(std::lower_bound(at.begin(), at.end(), x) - at.begin()), at.size() - 1);
    const std::size_t below = above > 0 ? above - 1 : 0;
    const double s = above > below ? std::clamp((x - at[below]) / (at[above] - at[below]), 0.0, 1.0) : 0.0;
    std::vector<double> mixed = values[below];
    for (std::size_t c = 0; c < mixed.size(); ++c) mixed[c] += s * (values[above][c] - values[below][c]);
    results.push_back(std::move(mixed));
  }
  return results;
}

double measure_error(const Study& study, const std::vector<double>& constants, const std::filesystem::path& run,
                     const std::optional<std::filesystem::path>& reference) {
  const ErrorMeasure& error = *study.error;
  const Reader reader(study, constants);
  std::optional<double> scale;
  if (error.scale) scale = Expression(*error.scale, study.names())(constants);
  const auto compare = [&](const Samples& actual, const Samples& expected) {
    return error_between(actual, expected, error.norm, error.relative, scale);
  };
  Sampled actual = reader.read(run, error.value);
  if (!error.expected.empty()) return compare(actual.values, reader.read(run, error.expected).values);
  if (error.file) {
    const Table table = read_table(*error.file);
    const std::size_t at_column = table.column(error.file_at, *error.file);
    std::vector<double> at;
    Samples values;
    for (const auto& row : table.rows) {
      at.push_back(row[at_column]);
      values.emplace_back();
      for (const std::string& name : error.file_columns) values.back().push_back(row[table.column(name, *error.file)]);
    }
    return compare(actual.values, interpolated(at, values, actual.at));
  }
  const Sampled expected = reader.read(*reference, error.value);
  if (error.particles && !error.profile) {
    if (actual.values.size() != expected.values.size())
      throw InputError(fmt::format("{} particles cannot be compared with {} of the reference one by one: give [error.profile]",
                                   actual.values.size(), expected.values.size()));
    return compare(actual.values, expected.values);
  }
  if (error.profile) {  // bins that one of them has no particle in are left out
    Sampled common;
    Samples theirs;
    for (std::size_t i = 0; i < actual.at.size(); ++i)
      for (std::size_t k = 0; k < expected.at.size(); ++k)
        if (actual.at[i] == expected.at[k]) {
          common.values.push_back(actual.values[i]);
          theirs.push_back(expected.values[k]);
        }
    if (theirs.empty()) throw InputError("the profiles have no bin in common");
    return compare(common.values, theirs);
  }
  return compare(actual.values, interpolated(expected.at, expected.values, actual.at));
}

}  // namespace cleave::study
