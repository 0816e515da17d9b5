// Non-associated Cam-Clay against the iterative, associated return it replaces (CD-MPM reports 47.96 s against 111.61 s for a
// scene): the shipped `cohesive-cam-clay` in lanes, and the same return as published codes do it, one point after the other
// with a singular value decomposition of F and Newton's method for (p, q, dgamma).

// GCC 12 takes members of Eigen's decompositions for uninitialised.
#if defined(__GNUC__) && !defined(__clang__)
#pragma GCC diagnostic ignored "-Wmaybe-uninitialized"
#endif

#include "return_mappings.hpp"

#include "bench/law_batch.hpp"

#include <benchmark/benchmark.h>
#include <Eigen/Dense>

#include <cmath>
#include <cstdio>
#include <random>

namespace cleave::benchmarks {
namespace {

constexpr std::size_t points = 256;
constexpr double youngs_modulus = 1000, poissons_ratio = 0.3, mu = youngs_modulus / (2 * (1 + poissons_ratio)),
                 kappa = youngs_modulus / (3 * (1 - 2 * poissons_ratio));
constexpr double M = 2.36, beta = 0.5, xi = 1, alpha0 = -0.05;

/// All yield: isochoric stretches of 5 to 25 % under little pressure.
const std::vector<Eigen::Matrix3d>& trials() {
  static const auto all = [] {
    std::mt19937 random(2);
    std::uniform_real_distribution<double> uniform(-1, 1);
    std::vector<Eigen::Matrix3d> made;
    for (std::size_t k = 0; k < points; ++k) {
      const double a = 0.15 + 0.1 * uniform(random), b = -0.5 * a + 0.02 * uniform(random), volume = 0.01 * uniform(random);
      const auto turn = [&] {
        return Eigen::AngleAxisd(3 * uniform(random), Eigen::Vector3d(uniform(random), uniform(random), 1.1).normalized())
            .toRotationMatrix();
      };
      const Eigen::Vector3d stretch(std::exp(a + volume), std::exp(b + volume), std::exp(volume - a - b));
      made.push_back(turn() * stretch.asDiagonal() * turn());
    }
    return made;
  }();
  return all;
}

plugins::Instance make(plugins::Registry& registry, const std::string& id, bool hencky) {
  cleave_isochoric_response elastic{};
  elastic.struct_size = sizeof elastic;
  elastic.pressure_law = hencky ? CLEAVE_PRESSURE_LOGARITHMIC : CLEAVE_PRESSURE_QUADRATIC;
  elastic.deviatoric_modulus = mu;
  elastic.bulk_modulus = kappa;
  plugins::Context context;
  context.isochoric = elastic;
  const plugins::GivenParameters given{{"cohesion", beta}, {"hardening_factor", xi}, {"friction_slope", M}, {"alpha0", alpha0}};
  return plugins::Instance(registry.load(id), given, context);
}

template <class T>
bench::LawBatch<T> batch() {
  bench::LawBatch<T> made(points);
  made.add_input(CLEAVE_FIELD_B, 6);
  made.add_input(CLEAVE_FIELD_STATE, 1);
  made.add_output(CLEAVE_FIELD_B_OUT, 6);
  made.add_output(CLEAVE_FIELD_STATE_OUT, 1);
  made.allocate();
  constexpr int row[6] = {0, 1, 2, 0, 0, 1}, column[6] = {0, 1, 2, 1, 2, 2};
  for (std::size_t k = 0; k < points; ++k) {
    const Eigen::Matrix3d b = trials()[k] * trials()[k].transpose();
    for (int c = 0; c < 6; ++c) made.set(CLEAVE_FIELD_B, c, k, b(row[c], column[c]));
    made.set(CLEAVE_FIELD_STATE, 0, k, alpha0);
  }
  return made;
}

template <class T>
void in_lanes(benchmark::State& state, plugins::Registry* registry, const std::string& id, bool hencky) {
  const auto law = make(*registry, id, hencky);
  auto points_of = batch<T>();
  const auto function = sizeof(T) == 4 ? law.plasticity().return_map_f32 : law.plasticity().return_map_f64;
  for (auto _ : state) points_of.call(function, law);
  state.SetItemsProcessed(state.iterations() * std::int64_t(points));
}

template <class T>
struct Point {
  Eigen::Matrix<T, 3, 3> F;
  T alpha;
};

/// Backward Euler of associated flow in principal logarithmic strains; trials within the tips that yield.
template <class T>
Point<T> iterative_return(const Point<T>& trial) {
  using Vector = Eigen::Matrix<T, 3, 1>;
  const Eigen::JacobiSVD<Eigen::Matrix<T, 3, 3>> svd(trial.F, Eigen::ComputeFullU | Eigen::ComputeFullV);
  const Vector e = svd.singularValues().array().log();
  const T trace = e.sum();
  const Vector deviator = e.array() - trace / 3;
  const T p_trial = -T(kappa) * trace, q_trial = std::sqrt(T(6)) * T(mu) * deviator.norm();
  const T p0 = T(kappa) * (T(1e-5) + std::sinh(T(xi) * std::max(-trial.alpha, T(0))));
  const T c = 1 + 2 * T(beta), slope2 = T(M * M);
  if (c * q_trial * q_trial + slope2 * (p_trial + T(beta) * p0) * (p_trial - p0) <= 0) return trial;
  T p = p_trial, q = q_trial, dgamma = 0;
  const T enough = T(1e-10) > 8 * std::numeric_limits<T>::epsilon() ? T(1e-10) : 8 * std::numeric_limits<T>::epsilon();
  for (int step = 0; step < 40; ++step) {
    const T y_p = slope2 * (2 * p + T(beta - 1) * p0), y_q = 2 * c * q;
    const Vector residual((p - p_trial + T(kappa) * dgamma * y_p) / T(kappa),
                          (q - q_trial + 3 * T(mu) * dgamma * y_q) / T(kappa),
                          (c * q * q + slope2 * (p + T(beta) * p0) * (p - p0)) / (T(kappa) * T(kappa)));
    if (residual.cwiseAbs().maxCoeff() < enough) break;
    Eigen::Matrix<T, 3, 3> jacobian;
    jacobian << (1 + T(kappa) * dgamma * 2 * slope2) / T(kappa), 0, y_p, 0, (1 + 6 * T(mu) * dgamma * c) / T(kappa),
        3 * T(mu / kappa) * y_q, y_p / T(kappa * kappa), y_q / T(kappa * kappa), 0;
    const Vector update = jacobian.partialPivLu().solve(residual);
    p -= update[0];
    q -= update[1];
    dgamma -= update[2];
  }
  const Vector returned = deviator * (q / q_trial) + Vector::Constant(-p / (3 * T(kappa)));
  return {svd.matrixU() * Vector(returned.array().exp()).asDiagonal() * svd.matrixV().transpose(),
          trial.alpha + trace + p / T(kappa)};
}

template <class T>
void one_by_one(benchmark::State& state) {
  std::vector<Point<T>> in, out(points);
  for (const auto& F : trials()) in.push_back({F.cast<T>(), T(alpha0)});
  for (auto _ : state) {
    for (std::size_t k = 0; k < points; ++k) out[k] = iterative_return<T>(in[k]);
    benchmark::DoNotOptimize(out.data());
    benchmark::ClobberMemory();
  }
  state.SetItemsProcessed(state.iterations() * std::int64_t(points));
}

}  // namespace

void register_return_mappings(plugins::Registry& registry) {
  const auto add = [&](const char* name, const char* id, bool hencky) {
    benchmark::RegisterBenchmark((std::string(name) + "/single").c_str(), in_lanes<float>, &registry, id, hencky);
    benchmark::RegisterBenchmark((std::string(name) + "/double").c_str(), in_lanes<double>, &registry, id, hencky);
  };
  add("nacc", "plasticity/nacc", false);
  add("cohesive_cam_clay/neo_hookean", "plasticity/cohesive-cam-clay", false);
  add("cohesive_cam_clay/hencky", "plasticity/cohesive-cam-clay", true);
  benchmark::RegisterBenchmark("cohesive_cam_clay/svd_and_newton_one_by_one/single", one_by_one<float>);
  benchmark::RegisterBenchmark("cohesive_cam_clay/svd_and_newton_one_by_one/double", one_by_one<double>);
}

bool same_returns(plugins::Registry& registry) {
  const auto law = make(registry, "plasticity/cohesive-cam-clay", true);
  auto in_batch = batch<double>();
  in_batch.call(law.plasticity().return_map_f64, law);
  double largest = 0;
  for (std::size_t k = 0; k < points; ++k) {
    const auto scalar = iterative_return<double>({trials()[k], alpha0});
    const Eigen::Matrix3d b = scalar.F * scalar.F.transpose();
    constexpr int row[6] = {0, 1, 2, 0, 0, 1}, column[6] = {0, 1, 2, 1, 2, 2};
    for (int c = 0; c < 6; ++c)
      largest = std::max(largest, std::abs(b(row[c], column[c]) - in_batch.get(CLEAVE_FIELD_B_OUT, c, k)));
    largest = std::max(largest, std::abs(scalar.alpha - in_batch.get(CLEAVE_FIELD_STATE_OUT, 0, k)));
  }
  std::printf("largest difference of returns that should be the same: %.1e\n", largest);
  return largest < 1e-8;
}

}  // namespace cleave::benchmarks
