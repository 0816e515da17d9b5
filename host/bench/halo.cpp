#include "bench/halo.hpp"

#include "common/error.hpp"
#include "mpm/simulation.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <numeric>
#include <set>
#include <unordered_set>

namespace cleave::bench {
namespace {

using Cell = std::array<std::int64_t, 3>;
constexpr std::int64_t offset = std::int64_t(1) << 20;  // cells; coordinates are above zero with it

/// Bits of up to three coordinates, interleaved.
std::uint64_t morton(const Cell& at, int dimension) {
  std::uint64_t code = 0;
  for (int bit = 0; bit < 21; ++bit)
    for (int i = 0; i < dimension; ++i) code |= std::uint64_t((at[std::size_t(i)] >> bit) & 1) << (bit * dimension + i);
  return code;
}

class Division {
 public:
  Division(const config::Scene& scene, const std::vector<mpm::ParticleState>& particles, int parts)
      : dimension_(scene.simulation.dimension), block_(dimension_ == 3 ? 4 : 8), cell_size_(scene.simulation.cell_size) {
    std::vector<std::uint64_t> codes;
    for (const auto& particle : particles) codes.push_back(code_of(particle.position));
    std::vector<std::uint64_t> sorted = codes;
    std::sort(sorted.begin(), sorted.end());
    for (int p = 1; p < parts; ++p) first_.push_back(sorted[sorted.size() * std::size_t(p) / std::size_t(parts)]);
    for (const std::uint64_t code : codes) part_.push_back(part_of(code));
  }

  int part_of(const Vector3& x) const { return part_of(code_of(x)); }
  const std::vector<int>& parts() const { return part_; }

  /// Of the lowest node that a particle reaches. Particles of the same one are of the same part.
  std::uint64_t lowest_node(const Vector3& x) const { return morton(lowest(x), dimension_); }

  /// Visits the nodes that a particle reaches.
  template <class Visit>
  void nodes_of(const Vector3& x, const Visit& visit) const {
    const Cell at = lowest(x);
    const int layers = dimension_ == 3 ? 3 : 1;
    for (int i = 0; i < 3; ++i)
      for (int k = 0; k < 3; ++k)
        for (int l = 0; l < layers; ++l) visit(morton({at[0] + i, at[1] + k, at[2] + l}, dimension_));
  }

 private:
  int part_of(std::uint64_t code) const { return int(std::upper_bound(first_.begin(), first_.end(), code) - first_.begin()); }
  Cell lowest(const Vector3& x) const {
    Cell at{};
    for (int i = 0; i < dimension_; ++i) at[std::size_t(i)] = std::int64_t(std::floor(x[i] / cell_size_ - 0.5)) + offset;
    return at;
  }
  std::uint64_t code_of(const Vector3& x) const {
    Cell block = lowest(x);
    for (auto& coordinate : block) coordinate /= block_;
    return morton(block, dimension_);
  }

  int dimension_, block_;
  double cell_size_;
  std::vector<std::uint64_t> first_;  ///< code of each part but the first
  std::vector<int> part_;             ///< of each particle
};

/// Adds what a division exchanges.
void add_exchange(const config::Scene& scene, const std::vector<mpm::ParticleState>& particles, const Division& division,
                  HaloResult& result) {
  const auto parts = std::size_t(result.parts);
  std::unordered_set<std::uint64_t> seen;
  std::vector<std::pair<std::uint64_t, int>> reached;  // nodes, and the parts of particles that reach them
  for (std::size_t i = 0; i < particles.size(); ++i) {
    const Vector3& x = particles[i].position;
    if (seen.insert(division.lowest_node(x)).second)
      division.nodes_of(x, [&](std::uint64_t node) { reached.emplace_back(node, division.parts()[i]); });
  }
  std::sort(reached.begin(), reached.end());
  reached.erase(std::unique(reached.begin(), reached.end()), reached.end());
  std::vector<double> nodes(parts, 0), halo(parts, 0);
  std::vector<std::set<int>> neighbours(parts);
  for (auto first = reached.begin(); first != reached.end();) {
    const auto last = std::find_if(first, reached.end(), [&](const auto& other) { return other.first != first->first; });
    for (auto one = first; one != last; ++one) {
      nodes[std::size_t(one->second)]++;
      if (last - first == 1) continue;
      halo[std::size_t(one->second)]++;
      for (auto other = first; other != last; ++other)
        if (other != one) neighbours[std::size_t(one->second)].insert(other->second);
    }
    first = last;
  }
  result.nodes += std::accumulate(nodes.begin(), nodes.end(), 0.0) / double(parts);
  result.halo += std::accumulate(halo.begin(), halo.end(), 0.0) / double(parts);
  result.largest_halo = std::max(result.largest_halo, *std::max_element(halo.begin(), halo.end()));
  for (const auto& of : neighbours) result.neighbours = std::max(result.neighbours, double(of.size()));
  const double number = scene.simulation.precision == config::Precision::single_precision ? 4 : 8;
  result.halo_bytes = result.largest_halo * number * (1 + scene.simulation.dimension);
}

std::vector<std::vector<std::string>> cells(const HaloResults& results) {
  std::vector<std::vector<std::string>> rows{{"parts", "particles of each", "nodes", "shared, mean", "shared, most",
                                              "neighbours", "kB sent per step", "leaving per step", "kB leaving per step",
                                              "imbalance"}};
  for (const HaloResult& r : results.results)
    rows.push_back({fmt::format("{}", r.parts), fmt::format("{:.0f}", r.particles), fmt::format("{:.0f}", r.nodes),
                    fmt::format("{:.0f}", r.halo), fmt::format("{:.0f}", r.largest_halo), fmt::format("{:.0f}", r.neighbours),
                    fmt::format("{:.3g}", 1e-3 * r.halo_bytes), fmt::format("{:.2g}", r.migrating),
                    fmt::format("{:.2g}", 1e-3 * r.migration_bytes), fmt::format("{:.3f}", r.imbalance)});
  return rows;
}

std::string heading(const HaloResults& results) {
  return fmt::format("{} particles of {:.0f} bytes, {} steps", results.particles, results.bytes_per_particle, results.steps);
}

}  // namespace

HaloResults measure_halo(const config::Scene& scene, const HaloOptions& options, plugins::Registry& registry) {
  for (const auto& material : scene.materials)
    if (material.discretization)
      throw InputError("material " + material.name + " is stepped by a discretization, which has no grid to divide");
  const auto simulation = mpm::Simulation::create(scene, registry);
  HaloResults results;
  results.particles = simulation->particles();
  results.bytes_per_particle = simulation->bytes_per_particle().back().second;
  for (const int parts : options.parts) {
    if (parts > results.particles)
      throw InputError(fmt::format("--parts {}: error: there are {} particles", parts, results.particles));
    results.results.push_back({.parts = parts, .particles = double(results.particles) / parts});
  }
  const double end = scene.simulation.end_time;
  for (int sample = 0; sample < options.samples; ++sample) {
    const double target = end * (sample + 0.5) / options.samples;
    while (simulation->time() < target) simulation->step(target);
    const auto before = simulation->state();
    for (int i = 0; i < options.steps && simulation->time() < end; ++i) simulation->step(end);
    const auto after = simulation->state();
    for (HaloResult& result : results.results) {
      const Division division(scene, before, result.parts);
      add_exchange(scene, before, division, result);
      double left = 0;
      std::vector<double> count(std::size_t(result.parts), 0);
      for (std::size_t i = 0; i < after.size(); ++i) {
        const int part = division.part_of(after[i].position);
        left += part != division.parts()[i];
        count[std::size_t(part)]++;
      }
      result.migrating += left / double(after.size()) / options.steps;
      result.imbalance = std::max(result.imbalance, *std::max_element(count.begin(), count.end()) / result.particles);
    }
  }
  for (HaloResult& result : results.results) {
    for (double* mean : {&result.nodes, &result.halo, &result.migrating}) *mean /= options.samples;
    result.migration_bytes = result.migrating * result.particles * results.bytes_per_particle;
  }
  results.steps = simulation->steps();
  return results;
}

std::string halo_text(const HaloResults& results) {
  const auto rows = cells(results);
  std::string text = heading(results) + "\n\n";
  for (const auto& row : rows) {
    for (std::size_t i = 0; i < row.size(); ++i) text += fmt::format("{}{:>{}}", i > 0 ? "  " : "", row[i], rows[0][i].size());
    text += '\n';
  }
  return text;
}

std::string halo_markdown(const HaloResults& results) {
  const auto rows = cells(results);
  std::string text = heading(results) + "\n\n";
  for (std::size_t k = 0; k < rows.size(); ++k) {
    text += '|';
    for (const auto& cell : rows[k]) text += ' ' + cell + " |";
    text += '\n';
    if (k == 0) {
      text += '|';
      for (std::size_t i = 0; i < rows[0].size(); ++i) text += "--:|";
      text += '\n';
    }
  }
  return text;
}

}  // namespace cleave::bench
