#include "solid.hpp"

#include <cmath>

namespace cleave::fem {
namespace {

constexpr std::size_t grain = 256;

}  // namespace

Solid::Solid(const cleave_body& body, const ElasticResponse& law)
    : mesh_({body.vertices, 3 * body.vertex_count}, {body.tetrahedra, 4 * body.tetrahedron_count}, body.density),
      density_(body.density),
      law_(law) {}

void Solid::gradients(std::span<const double> values, std::size_t first, std::size_t last, double* F) const {
  for (std::size_t t = first; t < last; ++t, F += 9) {
    const auto at = [&](int k) {
      const double* value = &values[3 * mesh_.corner[t][std::size_t(k)]];
      return Vector(value[0], value[1], value[2]);
    };
    const Vector origin = at(0);
    const Matrix gradient = Matrix::from_columns(at(1) - origin, at(2) - origin, at(3) - origin) * mesh_.gradient[t];
    for (int k = 0; k < 9; ++k) F[k] = gradient[k];
  }
}

/// f_a = -V P grad N_a
void Solid::element_forces(std::size_t first, std::size_t last, const double* P, double* force) const {
  for (std::size_t t = first; t < last; ++t, P += 9) {
    for (int a = 0; a < 3; ++a)
      for (int i = 0; i < 3; ++i) {
        double sum = 0;
        for (int j = 0; j < 3; ++j) sum += P[3 * i + j] * mesh_.gradient[t](a, j);
        force[9 * t + std::size_t(3 * a + i)] = -mesh_.volume[t] * sum;
      }
  }
}

void Solid::gather(const Threads& threads, const std::vector<double>& element_force, std::vector<double>& force) const {
  force.resize(3 * mesh_.vertices());
  threads.for_ranges(mesh_.vertices(), 4 * grain, [&](std::uint64_t first, std::uint64_t last) {
    for (std::size_t v = first; v < last; ++v)
      for (std::size_t i = 0; i < 3; ++i) {
        double sum = 0;
        for (std::size_t n = mesh_.incident_begin[v]; n < mesh_.incident_begin[v + 1]; ++n) {
          const std::uint32_t corner = mesh_.incident[n] & 3;
          const double* f = &element_force[9 * (mesh_.incident[n] >> 2)];
          sum += corner == 0 ? -(f[i] + f[3 + i] + f[6 + i]) : f[3 * (corner - 1) + i];
        }
        force[3 * v + i] = sum;
      }
  });
}

void Solid::evaluate(const Threads& threads, std::span<const double> x, Response& response) const {
  const std::size_t count = mesh_.tetrahedra();
  response.F.resize(9 * count);
  response.energy.resize(count);
  response.element_force.resize(9 * count);
  threads.for_ranges(count, grain, [&](std::uint64_t first, std::uint64_t last) {
    const std::size_t n = last - first;
    double P[9 * grain];
    gradients(x, first, last, &response.F[9 * first]);
    law_.evaluate(first, {&response.F[9 * first], 9 * n}, {&response.energy[first], n}, {P, 9 * n});
    element_forces(first, last, P, response.element_force.data());
  });
  gather(threads, response.element_force, response.force);
}

void Solid::stiffness_product(const Threads& threads, std::span<const double> F, std::span<const double> u, Response& scratch,
                              std::vector<double>& product) const {
  scratch.element_force.resize(9 * mesh_.tetrahedra());
  threads.for_ranges(mesh_.tetrahedra(), grain, [&](std::uint64_t first, std::uint64_t last) {
    const std::size_t n = last - first;
    double dF[9 * grain], dP[9 * grain];
    gradients(u, first, last, dF);
    law_.differential(first, F.subspan(9 * first, 9 * n), {dF, 9 * n}, {dP, 9 * n});
    element_forces(first, last, dP, scratch.element_force.data());
  });
  gather(threads, scratch.element_force, product);
  for (double& value : product) value = -value;
}

void Solid::positive_tangents(const Threads& threads, std::span<const double> F, std::vector<double>& tangents) const {
  tangents.resize(81 * mesh_.tetrahedra());
  threads.for_ranges(mesh_.tetrahedra(), grain, [&](std::uint64_t first, std::uint64_t last) {
    const std::size_t n = last - first;
    double dF[9 * grain], dP[9 * grain];
    for (std::size_t direction = 0; direction < 9; ++direction) {
      std::fill_n(dF, 9 * n, 0.0);
      for (std::size_t k = 0; k < n; ++k) dF[9 * k + direction] = 1;
      law_.differential(first, F.subspan(9 * first, 9 * n), {dF, 9 * n}, {dP, 9 * n});
      for (std::size_t k = 0; k < n; ++k) std::copy_n(dP + 9 * k, 9, &tangents[81 * (first + k) + 9 * direction]);
    }
    for (std::size_t t = first; t < last; ++t) {
      double* C = &tangents[81 * t];
      for (std::size_t i = 0; i < 9; ++i)
        for (std::size_t j = 0; j < i; ++j) C[9 * i + j] = C[9 * j + i] = 0.5 * (C[9 * i + j] + C[9 * j + i]);
      make_positive(C);
    }
  });
}

double Solid::energy(const Response& response) const {
  double sum = 0;
  for (std::size_t t = 0; t < mesh_.tetrahedra(); ++t) sum += mesh_.volume[t] * response.energy[t];
  return sum;
}

std::vector<double> Solid::force_magnitudes(const Response& response) const {
  std::vector<double> magnitude(mesh_.vertices());
  for (std::size_t t = 0; t < mesh_.tetrahedra(); ++t) {
    const double* f = &response.element_force[9 * t];
    magnitude[mesh_.corner[t][0]] += std::hypot(f[0] + f[3] + f[6], f[1] + f[4] + f[7], f[2] + f[5] + f[8]);
    for (std::size_t a = 0; a < 3; ++a) magnitude[mesh_.corner[t][a + 1]] += std::hypot(f[3 * a], f[3 * a + 1], f[3 * a + 2]);
  }
  return magnitude;
}

Solid::Stiffness Solid::stiffness(const Threads& threads, std::span<const double> F) const {
  std::vector<double> modulus(mesh_.tetrahedra());
  threads.for_ranges(mesh_.tetrahedra(), grain, [&](std::uint64_t first, std::uint64_t last) {
    law_.wave_modulus(first, F.subspan(9 * first, 9 * (last - first)), {&modulus[first], last - first});
  });
  Stiffness highest{0, 0};
  for (std::size_t t = 0; t < mesh_.tetrahedra(); ++t) {
    highest.modulus = std::max(highest.modulus, modulus[t]);
    highest.square_frequency = std::max(highest.square_frequency, 4 * modulus[t] / density_ * mesh_.squared_gradients[t]);
  }
  return highest;
}

void make_positive(double* matrix) {
  constexpr int n = 9;
  // Positive semidefinite but for rounding, as most tangents are: the pivots of elimination say so.
  double largest = 0;
  for (int i = 0; i < n; ++i) largest = std::max(largest, std::abs(matrix[n * i + i]));
  double A[n * n];
  std::copy_n(matrix, n * n, A);
  for (int i = 0; i < n; ++i) A[n * i + i] += 1e-9 * largest;
  bool positive = true;
  for (int p = 0; p < n && positive; ++p) {
    positive = A[n * p + p] > 0;
    for (int i = p + 1; i < n && positive; ++i) {
      const double factor = A[n * i + p] / A[n * p + p];
      for (int j = p + 1; j <= i; ++j) A[n * i + j] -= factor * A[n * j + p];
    }
  }
  if (positive) return;

  // Cyclic Jacobi rotations: matrix = V diag(A) V^T.
  double V[n * n] = {};
  for (int i = 0; i < n; ++i) V[n * i + i] = 1;
  std::copy_n(matrix, n * n, A);
  for (int sweep = 0; sweep < 12; ++sweep) {
    double off_diagonal = 0, diagonal = 0;
    for (int i = 0; i < n; ++i)
      for (int j = 0; j <= i; ++j) (i == j ? diagonal : off_diagonal) += A[n * i + j] * A[n * i + j];
    if (off_diagonal <= 1e-22 * diagonal) break;
    for (int p = 0; p < n; ++p)
      for (int q = p + 1; q < n; ++q) {
        if (A[n * p + q] == 0) continue;
        const double theta = (A[n * q + q] - A[n * p + p]) / (2 * A[n * p + q]);
        const double t = std::copysign(1 / (std::abs(theta) + std::sqrt(theta * theta + 1)), theta);
        const double c = 1 / std::sqrt(t * t + 1), s = t * c;
        for (int k = 0; k < n; ++k) {
          const double a = A[n * k + p], b = A[n * k + q];
          A[n * k + p] = c * a - s * b;
          A[n * k + q] = s * a + c * b;
          const double v = V[n * k + p], w = V[n * k + q];
          V[n * k + p] = c * v - s * w;
          V[n * k + q] = s * v + c * w;
        }
        for (int k = 0; k < n; ++k) {
          const double a = A[n * p + k], b = A[n * q + k];
          A[n * p + k] = c * a - s * b;
          A[n * q + k] = s * a + c * b;
        }
      }
  }
  std::fill_n(matrix, n * n, 0.0);
  for (int k = 0; k < n; ++k)
    if (A[n * k + k] > 0)
      for (int i = 0; i < n; ++i)
        for (int j = 0; j < n; ++j) matrix[n * i + j] += A[n * k + k] * V[n * i + k] * V[n * j + k];
}

}  // namespace cleave::fem
