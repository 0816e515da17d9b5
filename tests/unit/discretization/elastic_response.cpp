// The elastic law as a discretization evaluates it: P is the derivative of the energy, dP that of P, and M bounds waves in rest
// coordinates, whatever of b and F the law works on and whether it gives P or tau.

#include "discretization/elastic_response.hpp"

#include "plugins/message.hpp"

#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <Eigen/Eigenvalues>
#include <Eigen/LU>

#include <cmath>
#include <filesystem>
#include <fstream>
#include <random>
#include <vector>

namespace cleave::discretization {
namespace {

using Matrix = Eigen::Matrix<double, 3, 3, Eigen::RowMajor>;
constexpr double shear = 400, bulk = 900;

plugins::Registry& registry() {
  static plugins::Registry found({CLEAVE_BINARY_DIR "/lib/cleave/plugins", CLEAVE_FIXTURE_DIR "/sound", CLEAVE_POINT_PLUGINS});
  return found;
}

plugins::Instance law(const std::string& id) {
  plugins::GivenParameters parameters{{"shear_modulus", shear}, {"bulk_modulus", bulk}};
  if (id == "elasticity/point-stress-only") parameters = {{"modulus", shear}};
  if (id == "elasticity/fibrous") parameters.emplace("fiber_stiffness", 5000.);
  return {registry().load("elasticity/" + id.substr(id.find('/') + 1)), parameters, {}};
}

/// Isotropic laws: of b, of F, and one that goes through inversion.
const std::vector<std::string> isotropic = {"elasticity/split-neo-hookean", "elasticity/stvk-hencky",
                                            "elasticity/fixed-corotated", "elasticity/qr"};

Matrix random_matrix(std::mt19937& random, double size) {
  std::uniform_real_distribution<double> number(-size, size);
  return Matrix::NullaryExpr([&](Eigen::Index, Eigen::Index) { return number(random); });
}
Matrix deformation(std::mt19937& random, double size) { return Matrix::Identity() + random_matrix(random, size); }

struct Lent {
  plugins::Instance law;
  ElasticResponse response;
  const cleave_elastic_response& table = *response.table();
  plugins::Message message;

  explicit Lent(const std::string& id, scene::FiberField fibers = {})
      : law(discretization::law(id)), response(law, "beam", std::move(fibers)) {}

  double energy(const Matrix& F, std::uint64_t point = 0) {
    double psi = 0;
    EXPECT_EQ(table.evaluate(table.user, point, 1, F.data(), &psi, nullptr, message.get()), CLEAVE_OK) << message.text();
    return psi;
  }
  Matrix stress(const Matrix& F, std::uint64_t point = 0) {
    Matrix P;
    EXPECT_EQ(table.evaluate(table.user, point, 1, F.data(), nullptr, P.data(), message.get()), CLEAVE_OK) << message.text();
    return P;
  }
  Matrix change(const Matrix& F, const Matrix& dF, std::uint64_t point = 0) {
    Matrix dP;
    EXPECT_EQ(table.differential(table.user, point, 1, F.data(), dF.data(), dP.data(), message.get()), CLEAVE_OK)
        << message.text();
    return dP;
  }
  double modulus(const Matrix& F) {
    double M = 0;
    EXPECT_EQ(table.wave_modulus(table.user, 0, 1, F.data(), &M, message.get()), CLEAVE_OK) << message.text();
    return M;
  }
};

TEST(ElasticResponse, StressIsTheDerivativeOfTheEnergy) {
  for (const auto& id : isotropic) {
    Lent lent(id);
    std::mt19937 random(1);
    for (int n = 0; n < 20; n++) {
      const Matrix F = deformation(random, 0.3), dF = random_matrix(random, 1);
      const double h = 1e-5, expected = (lent.energy(F + h * dF) - lent.energy(F - h * dF)) / (2 * h);
      EXPECT_NEAR((lent.stress(F).cwiseProduct(dF)).sum(), expected, 1e-5 * shear) << id << "\n" << F;
    }
  }
}

TEST(ElasticResponse, DifferentialIsTheDerivativeOfStress) {
  for (const auto& id : isotropic) {
    Lent lent(id);
    std::mt19937 random(2);
    for (int n = 0; n < 20; n++) {
      const Matrix F = deformation(random, 0.3), dF = random_matrix(random, 1);
      const double h = 1e-5;
      const Matrix expected = (lent.stress(F + h * dF) - lent.stress(F - h * dF)) / (2 * h);
      EXPECT_LT((lent.change(F, dF) - expected).norm(), 1e-5 * expected.norm()) << id << "\n" << F;
    }
  }
}

/// tau = G (b - I), which is all this law gives: P = tau F^-T.
TEST(ElasticResponse, StressOfALawThatGivesOnlyKirchhoffStress) {
  Lent lent("elasticity/point-stress-only");
  ASSERT_FALSE(lent.law.can(CLEAVE_HAS_PIOLA));
  std::mt19937 random(3);
  for (int n = 0; n < 20; n++) {
    Matrix F = deformation(random, 0.3);
    if (n % 2) F.row(0) *= -1;  // inside out, which b does not know
    const Matrix expected = shear * (F - Matrix(F.transpose().inverse()));
    EXPECT_LT((lent.stress(F) - expected).norm(), 1e-12 * shear) << F;
    EXPECT_TRUE(std::isnan(lent.energy(F))) << "it offers none";
  }
}

TEST(ElasticResponse, GivesEnergyAndStressAtOnceAsItGivesThemAlone) {
  for (const auto& id : isotropic) {
    Lent lent(id);
    std::mt19937 random(4);
    const Matrix F = deformation(random, 0.3);
    double psi;
    Matrix P;
    ASSERT_EQ(lent.table.evaluate(lent.table.user, 0, 1, F.data(), &psi, P.data(), nullptr), CLEAVE_OK);
    EXPECT_EQ(P, lent.stress(F)) << id;
    EXPECT_NEAR(psi, lent.energy(F), 1e-12 * shear) << id;
  }
}

/// A field of F over more points than a batch holds, with fibers that differ from point to point.
TEST(ElasticResponse, BitsDoNotDependOnHowPointsAreSplitIntoCalls) {
  constexpr std::uint64_t points = 75;
  std::mt19937 random(5);
  std::vector<double> F, dF;
  scene::FiberField fibers;
  for (std::uint64_t i = 0; i < points; i++) {
    const Matrix f = deformation(random, 0.3), d = random_matrix(random, 1);
    F.insert(F.end(), f.data(), f.data() + 9);
    dF.insert(dF.end(), d.data(), d.data() + 9);
    const Vector3 a = random_matrix(random, 1).row(0).normalized();
    fibers.first.push_back(a);
    fibers.second.push_back(a.unitOrthogonal());
  }
  for (const std::string id : {"elasticity/split-neo-hookean", "elasticity/qr", "elasticity/fibrous"}) {
    Lent lent(id, fibers);
    const auto all = [&](std::uint64_t at_once) {
      std::vector<double> results(20 * points);
      double *psi = results.data(), *P = psi + points, *dP = P + 9 * points, *M = dP + 9 * points;
      for (std::uint64_t i = 0; i < points; i += at_once) {
        const std::uint64_t count = std::min(at_once, points - i);
        const auto& [size, reserved, user, evaluate, differential, wave_modulus] = lent.table;
        EXPECT_EQ(evaluate(user, i, count, &F[9 * i], psi + i, P + 9 * i, nullptr), CLEAVE_OK);
        EXPECT_EQ(differential(user, i, count, &F[9 * i], &dF[9 * i], dP + 9 * i, nullptr), CLEAVE_OK);
        EXPECT_EQ(wave_modulus(user, i, count, &F[9 * i], M + i, nullptr), CLEAVE_OK);
      }
      return results;
    };
    const auto expected = all(points);
    for (const std::uint64_t at_once : {1, 7, 32, 40}) EXPECT_EQ(all(at_once), expected) << id << ", " << at_once << " at once";
  }
}

/// psi_fiber = k/2 (|F a| - 1)^2 adds k (|F a| - 1)/|F a| F a a^T to the stress of the matrix around the fiber.
TEST(ElasticResponse, LooksUpFibersByTheNumberOfThePoint) {
  scene::FiberField fibers;
  for (const Vector3& a : {Vector3(1, 0, 0), Vector3(0, 1, 0), Vector3(0.6, 0, 0.8)}) {
    fibers.first.push_back(a);
    fibers.second.push_back(a.unitOrthogonal());
  }
  Lent lent("elasticity/fibrous", fibers);
  Lent matrix("elasticity/fixed-corotated");
  std::mt19937 random(6);
  const Matrix F = deformation(random, 0.2);
  Matrix first = Matrix::Zero();
  for (std::uint64_t i = 0; i < 3; i++) {
    const Vector3 a = fibers.first[i], Fa = F * a;
    const Matrix spring = 5000 * (Fa.norm() - 1) / Fa.norm() * Fa * a.transpose();
    if (i == 0) first = lent.stress(F, 0) - spring;
    EXPECT_LT((lent.stress(F, i) - spring - first).norm(), 1e-9 * shear) << i;
  }
}

/// Fastest plane wave in rest coordinates: m_i N_J A_iJkL m_k N_L, from many directions.
double stiffest(Lent& lent, const Matrix& F) {
  std::mt19937 random(7);
  double most = 0;
  for (int n = 0; n < 60; n++) {
    const Vector3 N = random_matrix(random, 1).row(0).normalized();
    Matrix3 acoustic;
    for (int k = 0; k < 3; k++) acoustic.col(k) = lent.change(F, Vector3::Unit(k) * N.transpose()) * N;
    most = std::max(most, Eigen::SelfAdjointEigenSolver<Matrix3>(0.5 * (acoustic + acoustic.transpose())).eigenvalues()[2]);
  }
  return most;
}

TEST(ElasticResponse, ModulusBoundsWavesInRestCoordinates) {
  for (const auto& id : isotropic) {
    Lent lent(id);
    EXPECT_NEAR(lent.modulus(Matrix::Identity()), stiffest(lent, Matrix::Identity()), 1e-6 * bulk) << id;
    std::mt19937 random(8);
    for (int n = 0; n < 20; n++) {
      const Matrix F = deformation(random, 0.3);
      const double least = stiffest(lent, F);
      EXPECT_GE(lent.modulus(F), least * (1 - 1e-9)) << id << "\n" << F;
      EXPECT_LE(lent.modulus(F), 12 * least) << id << "\n" << F;
    }
    // Squeezed flat, where waves along the plate are no faster than before.
    Matrix flat = Matrix::Identity();
    flat(0, 0) = 0.1;
    if (lent.law.can(CLEAVE_INVERSION_SAFE)) {
      EXPECT_LE(lent.modulus(flat), 12 * stiffest(lent, flat)) << id;
      EXPECT_TRUE(std::isfinite(lent.modulus(Matrix::Zero()))) << id;
    }
  }
}

TEST(ElasticResponse, NamesThePointWhereTheLawIsNotDefined) {
  std::vector<double> F, out(9 * 50);
  for (int i = 0; i < 50; i++)
    for (const double f : {i == 41 ? -0.5 : 1., 0., 0., 0., 1., 0., 0., 0., 1.}) F.push_back(f);
  for (const std::string id : {"elasticity/split-neo-hookean", "elasticity/fixed-corotated"}) {
    Lent lent(id);
    if (lent.law.can(CLEAVE_INVERSION_SAFE)) continue;
    const auto fails = [&](cleave_result result) {
      EXPECT_EQ(result, CLEAVE_ERROR_INTERNAL) << id;
      EXPECT_EQ(std::string(lent.message.text()), "point 141 of body 'beam': det F = -0.5, where " + id + " is not defined");
    };
    fails(lent.table.evaluate(lent.table.user, 100, 50, F.data(), nullptr, out.data(), lent.message.get()));
    fails(lent.table.differential(lent.table.user, 100, 50, F.data(), F.data(), out.data(), lent.message.get()));
    fails(lent.table.wave_modulus(lent.table.user, 100, 50, F.data(), out.data(), lent.message.get()));
  }
  Lent lent("elasticity/point-stress-only");
  F[0] = 100;  // beyond tr b = 11
  EXPECT_NE(lent.table.evaluate(lent.table.user, 0, 2, F.data(), nullptr, out.data(), lent.message.get()), CLEAVE_OK);
  EXPECT_EQ(std::string(lent.message.text()), "point 0 of body 'beam': elasticity/point-stress-only has no valid result");
  F[0] = 1;
  F[9] = 0;
  EXPECT_NE(lent.table.evaluate(lent.table.user, 0, 2, F.data(), nullptr, out.data(), lent.message.get()), CLEAVE_OK);
  EXPECT_EQ(std::string(lent.message.text()),
            "point 1 of body 'beam': det F = 0, where elasticity/point-stress-only gives no P");
}

TEST(ElasticResponse, KeepsTheBatchThatTheReasonOfAFailureNames) {
  Lent lent("elasticity/split-neo-hookean");
  mpm::BatchOrigin origin;
  origin.material = "rubber";
  origin.laws = {
      {"elasticity/split-neo-hookean", lent.law.description().version, {{"shear_modulus", shear}, {"bulk_modulus", bulk}}}};
  ElasticResponse response(lent.law, "beam", {}, origin, 1000);
  const auto& table = *response.table();
  constexpr std::uint64_t points = 40;
  const auto fail_at = [&](std::uint64_t point) {
    std::vector<double> F, P(9 * points);
    for (std::uint64_t i = 0; i < points; i++)
      for (int k = 0; k < 9; k++) F.push_back(k % 4 ? 0 : i == point && k == 0 ? -0.5 : 1);
    plugins::Message message;
    EXPECT_EQ(table.evaluate(table.user, 0, points, F.data(), nullptr, P.data(), message.get()), CLEAVE_ERROR_INTERNAL);
    return message.reason(CLEAVE_ERROR_INTERNAL);
  };
  const std::string second = fail_at(35), first = fail_at(3);
  EXPECT_THAT(second, testing::StartsWith("point 35 of body 'beam': det F = -0.5"));
  EXPECT_EQ(response.failed_batch("no convergence"), "");
  const auto file = std::filesystem::path(testing::TempDir()) / "failed_batch_of_elements.json";
  std::ofstream(file) << response.failed_batch("step 3: " + second + ", which was too much");
  const auto batch = mpm::read_batch(file);
  EXPECT_EQ(batch.failed, "elasticity/split-neo-hookean");
  EXPECT_EQ(batch.count, 8u) << "of a tile of 32 and the rest";
  EXPECT_EQ(batch.particles.at(3), 1035);
  EXPECT_EQ(batch.inputs.at(CLEAVE_FIELD_F).at(0).at(3), -0.5);
  EXPECT_EQ(batch.inputs.at(CLEAVE_FIELD_F).at(0).at(2), 1);
  response.forget_failures();
  EXPECT_EQ(response.failed_batch(first), "");
}

}  // namespace
}  // namespace cleave::discretization
