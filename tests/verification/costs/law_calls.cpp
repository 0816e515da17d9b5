// law_calls LAW CALLS: evaluates a law on 256 points as often as asked, for its instructions to be counted.

#include "bench/law_batch.hpp"

#include <Eigen/Geometry>

#include <cmath>
#include <cstdio>
#include <cstdlib>
#include <random>
#include <string>

namespace {

using namespace cleave;
constexpr std::size_t points = 256;
constexpr double youngs_modulus = 1000, poissons_ratio = 0.3, mu = youngs_modulus / (2 * (1 + poissons_ratio)),
                 kappa = youngs_modulus / (3 * (1 - 2 * poissons_ratio)), alpha0 = -0.05;

struct Random {
  std::mt19937 engine{1};
  double operator()() { return std::uniform_real_distribution<double>(-1, 1)(engine); }
  Eigen::Matrix3d turn() {
    Random& r = *this;
    return Eigen::AngleAxisd(3 * r(), Eigen::Vector3d(r(), r(), 1.1).normalized()).toRotationMatrix();
  }
};

/// Stress from strains of a tenth and any rotation.
void stress(plugins::Registry& registry, const std::string& id, int calls) {
  plugins::GivenParameters given{{"youngs_modulus", youngs_modulus}, {"poissons_ratio", poissons_ratio}};
  const bool fibers = id == "elasticity/qr";
  if (fibers) given["fiber_scale"] = 10.0;
  const plugins::Instance law(registry.load(id), given, {});
  bench::LawBatch<double> batch(points);
  batch.add_input(CLEAVE_FIELD_F, 9);
  if (fibers) {
    batch.add_input(CLEAVE_FIELD_FIBER, 3);
    batch.add_input(CLEAVE_FIELD_SECOND_FIBER, 3);
  }
  batch.add_output(CLEAVE_FIELD_TAU, 6);
  batch.allocate();
  Random random;
  for (std::size_t k = 0; k < points; ++k) {
    const Eigen::Matrix3d strain = 0.1 * Eigen::Matrix3d::NullaryExpr([&] { return random(); });
    const Eigen::Matrix3d F = random.turn() * (Eigen::Matrix3d::Identity() + strain);
    for (int i = 0; i < 9; ++i) batch.set(CLEAVE_FIELD_F, i, k, F(i / 3, i % 3));
    for (int i = 0; fibers && i < 3; ++i) {
      batch.set(CLEAVE_FIELD_FIBER, i, k, i == 0);
      batch.set(CLEAVE_FIELD_SECOND_FIBER, i, k, i == 1);
    }
  }
  for (int n = 0; n < calls; ++n) batch.call(law.elasticity().evaluate_f64, law);
}

/// Returns of trials that all yield: isochoric stretches of 5 to 25 % under little pressure.
void return_map(plugins::Registry& registry, const std::string& id, int calls) {
  plugins::Context context;
  context.isochoric = {sizeof(cleave_isochoric_response), CLEAVE_PRESSURE_QUADRATIC, mu, kappa};
  const plugins::Instance law(
      registry.load(id), {{"cohesion", 0.5}, {"hardening_factor", 1.0}, {"friction_slope", 2.36}, {"alpha0", alpha0}}, context);
  bench::LawBatch<double> batch(points);
  batch.add_input(CLEAVE_FIELD_B, 6);
  batch.add_input(CLEAVE_FIELD_STATE, 1);
  batch.add_output(CLEAVE_FIELD_B_OUT, 6);
  batch.add_output(CLEAVE_FIELD_STATE_OUT, 1);
  batch.allocate();
  Random random;
  constexpr int row[6] = {0, 1, 2, 0, 0, 1}, column[6] = {0, 1, 2, 1, 2, 2};
  for (std::size_t k = 0; k < points; ++k) {
    const double a = 0.15 + 0.1 * random(), b = -0.5 * a + 0.02 * random(), volume = 0.01 * random();
    const Eigen::Vector3d stretch(std::exp(a + volume), std::exp(b + volume), std::exp(volume - a - b));
    const Eigen::Matrix3d F = random.turn() * stretch.asDiagonal() * random.turn(), trial = F * F.transpose();
    for (int c = 0; c < 6; ++c) batch.set(CLEAVE_FIELD_B, c, k, trial(row[c], column[c]));
    batch.set(CLEAVE_FIELD_STATE, 0, k, alpha0);
  }
  for (int n = 0; n < calls; ++n) batch.call(law.plasticity().return_map_f64, law);
}

}  // namespace

int main(int argc, char** argv) {
  if (argc != 3) return 2;
  plugins::Registry registry({CLEAVE_PLUGINS, CLEAVE_COST_PLUGINS});
  const std::string id = argv[1];
  (id.starts_with("elasticity/") ? stress : return_map)(registry, id, std::atoi(argv[2]));
}
