// Stress of QR elasticity against that of the fixed corotated solid, each computed in several ways: the claim of AnisoMPM that
// the first is more than 3.4 times faster than the second with a singular value decomposition per point. Laws are called as a
// simulation calls them, 256 points at a time; Eigen's JacobiSVD works on one point after the other, as published codes do.

#include "return_mappings.hpp"

#include "bench/law_batch.hpp"

#include <benchmark/benchmark.h>
#include <Eigen/Dense>

#include <cmath>
#include <cstdio>
#include <random>
#include <string>
#include <vector>

namespace {

using namespace cleave;
constexpr std::size_t points = 256;
constexpr double youngs_modulus = 1000, poissons_ratio = 0.3, mu = youngs_modulus / (2 * (1 + poissons_ratio)),
                 lambda = youngs_modulus * poissons_ratio / ((1 + poissons_ratio) * (1 - 2 * poissons_ratio));

const std::vector<Eigen::Matrix3d>& deformations() {
  static const auto all = [] {
    std::mt19937 random(1);
    std::uniform_real_distribution<double> uniform(-1, 1);
    std::vector<Eigen::Matrix3d> made;
    for (std::size_t k = 0; k < points; ++k) {
      const Eigen::Matrix3d strain = 0.1 * Eigen::Matrix3d::NullaryExpr([&] { return uniform(random); });
      const Eigen::AngleAxisd turn(3 * uniform(random), Eigen::Vector3d(uniform(random), uniform(random), 1.1).normalized());
      made.push_back(turn * (Eigen::Matrix3d::Identity() + strain));
    }
    return made;
  }();
  return all;
}

plugins::Registry& registry() {
  static plugins::Registry all({CLEAVE_PLUGINS, CLEAVE_BENCHMARK_PLUGINS});
  return all;
}

struct Measured {
  const char* name;
  const char* id;
  double fiber_scale;  ///< below 0: the law has none
};
constexpr Measured measured[] = {
    {"qr/closed_form", "elasticity/qr", 0},
    {"qr/closed_form_with_fibre", "elasticity/qr", 10},
    {"qr/factorized", "elasticity/qr-factorized", 10},
    {"fixed_corotated/polar", "elasticity/fixed-corotated", -1},
    {"fixed_corotated/svd", "elasticity/corotated-svd", -1},
};

plugins::Instance make(const Measured& law) {
  plugins::GivenParameters given{{"youngs_modulus", youngs_modulus}, {"poissons_ratio", poissons_ratio}};
  if (law.fiber_scale >= 0) given["fiber_scale"] = law.fiber_scale;
  return plugins::Instance(registry().load(law.id), given, {});
}

template <class T>
bench::LawBatch<T> batch_of(const Measured& law) {
  bench::LawBatch<T> batch(points);
  batch.add_input(CLEAVE_FIELD_F, 9);
  if (law.fiber_scale > 0) {
    batch.add_input(CLEAVE_FIELD_FIBER, 3);
    batch.add_input(CLEAVE_FIELD_SECOND_FIBER, 3);
  }
  batch.add_output(CLEAVE_FIELD_TAU, 6);
  batch.allocate();
  for (std::size_t k = 0; k < points; ++k) {
    for (int i = 0; i < 9; ++i) batch.set(CLEAVE_FIELD_F, i, k, deformations()[k](i / 3, i % 3));
    if (law.fiber_scale > 0)
      for (int i = 0; i < 3; ++i) {
        batch.set(CLEAVE_FIELD_FIBER, i, k, i == 0);
        batch.set(CLEAVE_FIELD_SECOND_FIBER, i, k, i == 1);
      }
  }
  return batch;
}

template <class T>
auto function_of(const plugins::Instance& law) {
  return sizeof(T) == 4 ? law.elasticity().evaluate_f32 : law.elasticity().evaluate_f64;
}

template <class T>
void stress(benchmark::State& state, const Measured& measured_law) {
  const auto law = make(measured_law);
  auto batch = batch_of<T>(measured_law);
  for (auto _ : state) batch.call(function_of<T>(law), law);
  state.SetItemsProcessed(state.iterations() * std::int64_t(points));
}

/// tau = 2 mu (F - R) F^T + lambda J (J - 1) I
template <class T>
Eigen::Matrix<T, 3, 3> corotated_stress(const Eigen::Matrix<T, 3, 3>& F) {
  using Matrix = Eigen::Matrix<T, 3, 3>;
  const Eigen::JacobiSVD<Matrix> svd(F, Eigen::ComputeFullU | Eigen::ComputeFullV);
  Matrix U = svd.matrixU();
  if (U.determinant() * svd.matrixV().determinant() < 0) U.col(2) *= -1;
  const Matrix R = U * svd.matrixV().transpose();
  const T J = F.determinant();
  return T(2 * mu) * (F - R) * F.transpose() + T(lambda) * J * (J - 1) * Matrix::Identity();
}
template <class T>
void jacobi_svd(benchmark::State& state) {
  std::vector<Eigen::Matrix<T, 3, 3>> F, tau(points);
  for (const auto& deformation : deformations()) F.push_back(deformation.cast<T>());
  for (auto _ : state) {
    for (std::size_t k = 0; k < points; ++k) tau[k] = corotated_stress<T>(F[k]);
    benchmark::DoNotOptimize(tau.data());
    benchmark::ClobberMemory();
  }
  state.SetItemsProcessed(state.iterations() * std::int64_t(points));
}

/// What is compared computes the same.
bool same_stresses() {
  double largest = 0;
  const auto stresses = [](const Measured& law) {
    const auto instance = make(law);
    auto batch = batch_of<double>(law);
    batch.call(function_of<double>(instance), instance);
    return batch;
  };
  const auto closed = stresses(measured[1]), factorized = stresses(measured[2]), polar = stresses(measured[3]),
             svd = stresses(measured[4]);
  constexpr int row[6] = {0, 1, 2, 0, 0, 1}, column[6] = {0, 1, 2, 1, 2, 2};
  for (std::size_t k = 0; k < points; ++k) {
    const Eigen::Matrix3d jacobi = corotated_stress<double>(deformations()[k]);
    for (int i = 0; i < 6; ++i) {
      const double expected = polar.get(CLEAVE_FIELD_TAU, i, k);
      largest =
          std::max({largest, std::abs(closed.get(CLEAVE_FIELD_TAU, i, k) - factorized.get(CLEAVE_FIELD_TAU, i, k)),
                    std::abs(svd.get(CLEAVE_FIELD_TAU, i, k) - expected), std::abs(jacobi(row[i], column[i]) - expected)});
    }
  }
  std::printf("largest difference of stresses that should be the same: %.1e of E\n", largest / youngs_modulus);
  return largest < 1e-11 * youngs_modulus;
}

}  // namespace

int main(int argc, char** argv) {
  for (const auto& law : measured) {
    benchmark::RegisterBenchmark((std::string(law.name) + "/single").c_str(), stress<float>, law);
    benchmark::RegisterBenchmark((std::string(law.name) + "/double").c_str(), stress<double>, law);
  }
  benchmark::RegisterBenchmark("fixed_corotated/jacobi_svd_of_eigen/single", jacobi_svd<float>);
  benchmark::RegisterBenchmark("fixed_corotated/jacobi_svd_of_eigen/double", jacobi_svd<double>);
  benchmarks::register_return_mappings(registry());
  benchmark::Initialize(&argc, argv);
  if (benchmark::ReportUnrecognizedArguments(argc, argv) || !same_stresses() || !benchmarks::same_returns(registry())) return 1;
  benchmark::RunSpecifiedBenchmarks();
}
