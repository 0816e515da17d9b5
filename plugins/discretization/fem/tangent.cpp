#include "tangent.hpp"

#include <algorithm>

namespace cleave::fem {

void project(std::span<const Constraint> constraints, std::span<double> values) {
  for (std::size_t v = 0; v < constraints.size(); ++v) {
    const Constraint& constraint = constraints[v];
    if (constraint.kind == Constraint::free) continue;
    double* value = &values[3 * v];
    if (constraint.kind == Constraint::fixed) {
      std::fill_n(value, 3, 0.0);
      continue;
    }
    const Vector& n = constraint.normal;
    const double along = n[0] * value[0] + n[1] * value[1] + n[2] * value[2];
    for (int a = 0; a < 3; ++a) value[a] -= along * n[a];
  }
}

Tangent::Tangent(const Mesh& mesh) {
  const std::size_t count = mesh.vertices();
  neighbours_begin_.assign(count + 1, 0);
  for (std::size_t v = 0; v < count; ++v) {
    const std::size_t first = neighbours_.size();
    for (std::size_t n = mesh.incident_begin[v]; n < mesh.incident_begin[v + 1]; ++n)
      for (const std::uint32_t u : mesh.corner[mesh.incident[n] >> 2])
        if (u < v) neighbours_.push_back(u);
    const auto begin = neighbours_.begin() + std::ptrdiff_t(first);
    std::sort(begin, neighbours_.end());
    neighbours_.erase(std::unique(begin, neighbours_.end()), neighbours_.end());
    neighbours_begin_[v + 1] = neighbours_.size();
  }
  matrix_.begin.push_back(0);
  std::vector<std::array<float, 3>> place;
  for (std::uint32_t v = 0; v < count; ++v)
    for (std::uint32_t row = 0; row < 3; ++row) {
      for (std::size_t n = neighbours_begin_[v]; n < neighbours_begin_[v + 1]; ++n)
        for (std::uint32_t a = 0; a < 3; ++a) matrix_.column.push_back(3 * neighbours_[n] + a);
      for (std::uint32_t a = 0; a <= row; ++a) matrix_.column.push_back(3 * v + a);
      matrix_.begin.push_back(matrix_.column.size());
      place.push_back({float(mesh.rest[3 * v]), float(mesh.rest[3 * v + 1]), float(mesh.rest[3 * v + 2])});
    }
  matrix_.value.resize(matrix_.column.size());
  cholesky_.analyze(matrix_, place);
}

void Tangent::factor(const Threads& threads, const Mesh& mesh, std::span<const double> C, std::span<const double> inertia,
                     std::span<const Constraint> constraints) {
  std::fill(matrix_.value.begin(), matrix_.value.end(), 0.0);
  const auto place_of = [&](std::uint32_t row, std::uint32_t column) {
    const auto begin = neighbours_.begin() + std::ptrdiff_t(neighbours_begin_[row]);
    const auto end = neighbours_.begin() + std::ptrdiff_t(neighbours_begin_[row + 1]);
    return std::size_t(std::lower_bound(begin, end, column) - begin);  // the diagonal block is behind all others
  };
  for (std::size_t t = 0; t < mesh.tetrahedra(); ++t) {
    const double* tangent = &C[81 * t];
    Vector gradient[4] = {{}, mesh.gradient[t].row(0), mesh.gradient[t].row(1), mesh.gradient[t].row(2)};
    gradient[0] = -(gradient[1] + gradient[2] + gradient[3]);
    for (std::size_t b = 0; b < 4; ++b) {
      double stress[9][3];  // V C_ijkl grad N_b,l
      for (int ij = 0; ij < 9; ++ij)
        for (int k = 0; k < 3; ++k) {
          const double* row = tangent + 9 * ij + 3 * k;
          stress[ij][k] = mesh.volume[t] * (row[0] * gradient[b][0] + row[1] * gradient[b][1] + row[2] * gradient[b][2]);
        }
      const std::uint32_t column = mesh.corner[t][b];
      for (std::size_t a = 0; a < 4; ++a) {
        const std::uint32_t row = mesh.corner[t][a];
        if (row < column) continue;
        const std::size_t place = place_of(row, column);
        for (int i = 0; i < 3; ++i) {
          double* values = block(row, place, i);
          for (int k = 0; k < (row == column ? i + 1 : 3); ++k)
            values[k] += stress[3 * i][k] * gradient[a][0] + stress[3 * i + 1][k] * gradient[a][1] +
                         stress[3 * i + 2][k] * gradient[a][2];
        }
      }
    }
  }

  double largest = 0;
  for (std::uint32_t v = 0; v < mesh.vertices(); ++v) {
    const std::size_t diagonal = neighbours_begin_[v + 1] - neighbours_begin_[v];
    double stiffness = 0;
    for (int i = 0; i < 3; ++i) {
      block(v, diagonal, i)[i] += inertia[v];
      stiffness += block(v, diagonal, i)[i] / 3;
    }
    largest = std::max(largest, stiffness);
    // Q_v K_vu Q_u, Q the projectors of the constraints, and something of the size of K in what they take.
    for (std::size_t n = 0; n <= diagonal; ++n) {
      const std::uint32_t u = n < diagonal ? neighbours_[neighbours_begin_[v] + n] : v;
      if (constraints[v].kind == Constraint::free && constraints[u].kind == Constraint::free) continue;
      double full[3][3];
      for (int i = 0; i < 3; ++i)
        for (int k = 0; k < 3; ++k) full[i][k] = u == v && k > i ? block(v, n, k)[i] : block(v, n, i)[k];
      for (int i = 0; i < 3; ++i) project({&constraints[u], 1}, full[i]);
      for (int k = 0; k < 3; ++k) {
        double column[3] = {full[0][k], full[1][k], full[2][k]};
        project({&constraints[v], 1}, column);
        for (int i = 0; i < 3; ++i) full[i][k] = column[i];
      }
      if (u == v)
        for (int i = 0; i < 3; ++i) {
          double taken[3] = {i == 0 ? stiffness : 0, i == 1 ? stiffness : 0, i == 2 ? stiffness : 0};
          for (int k = 0; k < 3; ++k) full[i][k] += taken[k];
          project({&constraints[v], 1}, taken);
          for (int k = 0; k < 3; ++k) full[i][k] -= taken[k];
        }
      for (int i = 0; i < 3; ++i)
        for (int k = 0; k < (u == v ? i + 1 : 3); ++k) block(v, n, i)[k] = full[i][k];
    }
  }
  cholesky_.factor(matrix_, 1e-13 * largest, [&](std::size_t count, const auto& task) { threads.for_each(count, task); });
}

void Tangent::solve(const Threads& threads, std::span<const Constraint> constraints, std::vector<double>& x) const {
  project(constraints, x);
  cholesky_.solve(x, [&](std::size_t count, const auto& task) { threads.for_each(count, task); });
  project(constraints, x);
}

}  // namespace cleave::fem
