#include <cleave/constraint.hpp>

#include "kit/broken.hpp"

#include <algorithm>
#include <array>
#include <cmath>
#include <cstdlib>
#include <cstring>
#include <map>
#include <stdexcept>

namespace {

/// Inextensible fibres, to be broken: one row for each cell with fibres,
///   B_(z,i) = sum over its particles of V a (a . grad N_i),  a = F a0/|F a0|,  B v = 0,
/// solved with B P B^T lambda = B v*, v = v* - P B^T lambda, by conjugate gradients with the diagonal as preconditioner.
/// P is the inverse mass on the motions the prescribed nodes leave free.
struct CellFibers {
  static constexpr cleave::About about{.id = "constraint/fixture", .version = "1.0.0", .summary = "A constraint to be broken"};
  static constexpr int fibers = 1;

  struct Entry {
    std::uint64_t node;
    std::array<double, 3> value;
  };
  using Row = std::vector<Entry>;

  static void weights(double x, double* value, double* slope) {
    const double f = x - std::floor(x - 0.5), a = 1.5 - f, b = f - 1, c = f - 0.5;
    value[0] = 0.5 * a * a, value[1] = 0.75 - b * b, value[2] = 0.5 * c * c;
    slope[0] = -a, slope[1] = -2 * b, slope[2] = c;
  }

  static std::vector<Row> assemble(const cleave_constraint_system& s) {
    const std::size_t d = s.dimension, stencil = d == 2 ? 9 : 27;
    std::map<std::array<int, 3>, std::map<std::uint64_t, std::array<double, 3>>> cells;
    for (std::uint64_t p = 0; p < s.particle_count; ++p) {
      std::array<double, 3> a{};
      std::array<double, 3> a0 = {s.fiber[3 * p], s.fiber[3 * p + 1], s.fiber[3 * p + 2]};
      if (broken("acts_without_fibers") && a0 == std::array<double, 3>{}) a0[0] = 1;
      for (std::size_t r = 0; r < 3; ++r)
        for (std::size_t c = 0; c < 3; ++c) a[r] += s.deformation[9 * p + 3 * r + c] * a0[c];
      const double length = std::sqrt(a[0] * a[0] + a[1] * a[1] + a[2] * a[2]);
      if (length == 0) continue;
      for (double& component : a) component /= length;
      std::array<int, 3> cell{};
      double value[3][3] = {{}, {}, {1}}, slope[3][3] = {};
      for (std::size_t k = 0; k < d; ++k) {
        cell[k] = int(std::floor(s.position[d * p + k]));
        weights(s.position[d * p + k], value[k], slope[k]);
      }
      auto& row = cells[cell];
      for (std::size_t n = 0; n < stencil; ++n) {
        const std::size_t z = d == 3 ? n % 3 : 0, y = n / (d == 3 ? 3 : 1) % 3, x = n / (d == 3 ? 9 : 3);
        const double along = a[0] * slope[0][x] * value[1][y] * value[2][z] + a[1] * value[0][x] * slope[1][y] * value[2][z] +
                             a[2] * value[0][x] * value[1][y] * slope[2][z];
        auto& entry = row[s.nodes[p * stencil + n]];
        for (std::size_t k = 0; k < d; ++k) entry[k] += s.volume[p] / s.cell_size * a[k] * along;
      }
    }
    std::vector<Row> rows;
    for (const auto& [cell, entries] : cells) {
      Row row;
      double squares = 0;
      for (const auto& [node, value] : entries)
        for (double component : value) squares += component * component / s.mass[node];
      for (const auto& [node, value] : entries) row.push_back({node, value});
      for (auto& entry : row)
        for (double& component : entry.value) component /= std::sqrt(squares);
      rows.push_back(row);
    }
    return rows;
  }

  static std::vector<double> times(const std::vector<Row>& B, const double* v, std::size_t d) {
    std::vector<double> result;
    for (const Row& row : B) {
      double sum = 0;
      for (const auto& [node, value] : row)
        for (std::size_t k = 0; k < d; ++k) sum += value[k] * v[d * node + k];
      result.push_back(sum);
    }
    return result;
  }

  /// P B^T lambda
  static std::vector<double> push(const cleave_constraint_system& s, const std::vector<Row>& B, const std::vector<double>& x) {
    const std::size_t d = s.dimension;
    std::vector<double> v(d * s.node_count);
    for (std::size_t z = 0; z < B.size(); ++z)
      for (const auto& [node, value] : B[z])
        for (std::size_t k = 0; k < d; ++k) v[d * node + k] += x[z] * value[k];
    for (std::size_t i = 0; i < s.node_count; ++i) {
      double* at = &v[d * i];
      const double* n = s.normal ? s.normal + d * i : nullptr;
      double along = 0;
      if (s.prescribed[i] == 2 && !broken("ignores_normals"))
        for (std::size_t k = 0; k < d; ++k) along += at[k] * n[k];
      const double inverse_mass = broken("ignores_mass") ? 1 / s.mass[0] : 1 / s.mass[i];
      for (std::size_t k = 0; k < d; ++k) {
        if (along != 0) at[k] -= along * n[k];
        at[k] *= s.prescribed[i] == 1 && !broken("moves_prescribed") ? 0 : inverse_mass;
      }
    }
    return v;
  }

  static double dot(const std::vector<double>& a, const std::vector<double>& b) {
    double sum = 0;
    for (std::size_t i = 0; i < a.size(); ++i) sum += a[i] * b[i];
    return sum;
  }

  /// Something to be kept from step to step.
  std::uint64_t projections = 0;
  std::vector<std::byte> save() const {
    std::vector<std::byte> bytes(sizeof projections);
    std::memcpy(bytes.data(), &projections, sizeof projections);
    if (broken("saves_what_changes")) bytes[7] = std::byte(rand());
    return bytes;
  }
  void restore(std::span<const std::byte> bytes) {
    if (bytes.size() != sizeof projections && !broken("takes_any_state")) throw std::invalid_argument("no state of this law");
    if (!broken("forgets_its_state")) std::memcpy(&projections, bytes.data(), std::min(bytes.size(), sizeof projections));
  }

  cleave::ConstraintReport project(const cleave_constraint_system& s) {
    if (broken("reads_beyond_nodes") && s.velocity[s.dimension * s.node_count] == 1) return {};
    if (broken("writes_before_nodes")) s.velocity[-1] = 0;
    if (broken("writes_mass")) const_cast<volatile double*>(s.mass)[0] = s.mass[0];
    const std::size_t d = s.dimension;
    const std::vector<Row> B = assemble(s);
    cleave::ConstraintReport report{.rows = B.size()};
    if (B.empty() || broken("does_nothing")) return report;

    // A row without a motion that is free stays as it is.
    std::vector<double> inverse_diagonal;
    for (std::size_t z = 0; z < B.size(); ++z) {
      std::vector<double> unit(B.size());
      unit[z] = 1;
      const double diagonal = times({B[z]}, push(s, B, unit).data(), d)[0];
      inverse_diagonal.push_back(diagonal > 0 || broken("divides_by_zero") ? 1 / diagonal : 0);
    }
    std::vector<double> lambda(B.size()), r = times(B, s.velocity, d), z(B.size());
    const double first = std::sqrt(dot(r, r));
    if (first == 0 && !broken("rest_is_not_a_number")) return report;
    const auto precondition = [&] {
      for (std::size_t i = 0; i < r.size(); ++i) z[i] = inverse_diagonal[i] * r[i];
      return dot(r, z);
    };
    double rz = precondition();
    std::vector<double> direction = z;
    const std::size_t limit = broken("stops_early") || broken("lies_about_residual") ? 2 : 10 * B.size() + 100;
    while (rz > 0 && std::sqrt(dot(r, r)) > 1e-8 * first && report.iterations < limit) {
      const std::vector<double> change = times(B, push(s, B, direction).data(), d);
      const double step = rz / dot(direction, change);
      for (std::size_t i = 0; i < r.size(); ++i) {
        lambda[i] += step * direction[i];
        r[i] -= step * change[i];
      }
      const double before = rz;
      rz = precondition();
      for (std::size_t i = 0; i < r.size(); ++i) direction[i] = z[i] + rz / before * direction[i];
      ++report.iterations;
    }
    report.residual = broken("lies_about_residual") ? 0 : std::sqrt(dot(r, r)) / first;
    if (report.residual > 0.5 && broken("says_nothing")) throw std::runtime_error("");

    static int calls = 0;
    double scale = 1 + 1e-10 * double(++projections);
    if (broken("counts_calls")) scale += 1e-9 * ++calls;
    if (broken("goes_too_far")) scale = 1.001;
    if (broken("sums_as_threads_come")) {
      double sum = 0;
      cleave::Threads(s.threads).for_ranges(
          s.particle_count, 64, [&](std::uint64_t first, std::uint64_t) { sum = 0.5 * sum + 1e-13 * double(first + 1); });
      scale += sum;
    }
    const std::vector<double> correction = push(s, B, lambda);
    for (std::size_t i = 0; i < correction.size(); ++i) {
      if (correction[i] == 0) continue;
      s.velocity[i] -= scale * correction[i];
      if (broken("loses_momentum") && s.prescribed[i / d] == 0) s.velocity[i] *= 1 - 1e-8;
    }
    return report;
  }
};

/// What the header of the kind would not let an author write.
using Plugin = cleave::detail::PluginOf<CellFibers>;

cleave_result project_and_report_all(cleave_instance* instance, const cleave_constraint_system* system,
                                     cleave_constraint_report* report, cleave_message* message) {
  cleave_constraint_report whole{};
  whole.struct_size = sizeof whole;
  const cleave_result result = Plugin::Table::project(instance, system, &whole, message);
  whole.struct_size = report->struct_size;
  *report = whole;
  return result;
}

const void* kind(const char* id) {
  static constexpr cleave_constraint table{sizeof table, 0, &project_and_report_all, nullptr, nullptr};
  return std::strcmp(id, CLEAVE_KIND_CONSTRAINT) == 0 ? &table : nullptr;
}

}  // namespace

extern "C" CLEAVE_EXPORT cleave_result cleave_plugin_entry(const cleave_host* host, const cleave_plugin** plugin) {
  const cleave_result result = Plugin::entry(host, plugin);
  if (result != CLEAVE_OK || !broken("fills_short_report")) return result;
  static cleave_plugin changed = **plugin;
  changed.kind = &kind;
  *plugin = &changed;
  return result;
}
