#include "../../reference_data.hpp"
#include "../../reference_table.hpp"
#include "qr_testing.hpp"

#include <cmath>

namespace cleave::plugins::test {
namespace {

/// tau = Q A Q^T as the paper computes it: F D = Q R with r11, r22 >= 0, S = (dpsi/dR) R^T, A the symmetric matrix that has the
/// upper triangle of S. `kx`, `ky`, `lambda` in Pa.
Tensor stress_by_factorization(const Tensor& F, const Tensor& D, double g, double kx, double ky) {
  const Tensor FD = F * D;
  const Eigen::HouseholderQR<Eigen::Matrix3d> factors(FD);
  Eigen::Matrix3d Q = factors.householderQ(), R = factors.matrixQR().triangularView<Eigen::Upper>();
  for (int i = 0; i < 2; ++i)
    if (R(i, i) < 0) {
      R.row(i) *= -1;
      Q.col(i) *= -1;
    }
  if (Q.determinant() < 0) {
    R.row(2) *= -1;
    Q.col(2) *= -1;
  }
  const double J = R(0, 0) * R(1, 1) * R(2, 2);
  Eigen::Matrix3d slope = g * mu * R;
  const double by_J = (J >= 1 ? g : 1) * lambda * (J - 1) - g * mu;
  slope(0, 0) += by_J * R(1, 1) * R(2, 2);
  slope(1, 1) += by_J * R(0, 0) * R(2, 2);
  slope(2, 2) += by_J * R(0, 0) * R(1, 1);
  slope(0, 0) += kx * (R(0, 0) - 1);
  const double length = std::hypot(R(0, 1), R(1, 1));
  for (int i = 0; i < 2 && length > 0; ++i) slope(i, 1) += ky * (length - 1) * R(i, 1) / length;
  const Eigen::Matrix3d S = slope * R.transpose();
  const Eigen::Matrix3d A = S.selfadjointView<Eigen::Upper>();
  return Q * A * Q.transpose();
}

TEST(QrStress, IsThatOfTheFactorizationAtEveryDeformation) {
  double most = 0;
  for (const auto& [kx, ky] : {std::pair(0., 0.), {10., 0.}, {0., 3.}, {5., 2.}})
    for (double g : {1., 0.3, 0.}) {
      const Tensor D = frame(unsigned(3 + kx + ky));
      const auto all = every_kind_of_deformation();
      const Field tau = evaluate_all(qr(kx, ky), CLEAVE_FIELD_TAU, 6, all, g, D);
      for (std::size_t k = 0; k < all.size(); ++k) {
        const Tensor expected = stress_by_factorization(all[k], D, g, kx * mu, ky * mu);
        const double error =
            (tensor(tau[k]) - expected).cwiseAbs().maxCoeff() / std::max(expected.cwiseAbs().maxCoeff(), 0.1 * mu);
        EXPECT_LT(error, 1e-12) << "kx " << kx << " ky " << ky << " g " << g << "\nF\n" << all[k];
        most = std::max(most, error);
      }
    }
  RecordProperty("largest_relative_error", std::to_string(most));
}

TEST(QrStress, IsTheDerivativeOfTheEnergyAtEveryDeformation) {
  const Tensor D = frame(5);
  const Instance law = qr(5, 2);
  for (double g : {1., 0.3}) {
    const auto all = every_kind_of_deformation();
    const auto gradients = energy_gradients(law, all, g, D);
    const Field tau = evaluate_all(law, CLEAVE_FIELD_TAU, 6, all, g, D);
    for (std::size_t k = 0; k < all.size(); ++k)
      EXPECT_LT((tensor(tau[k]) - gradients[k] * all[k].transpose()).cwiseAbs().maxCoeff(), 1e-5 * mu) << "F\n" << all[k];
  }
}

TEST(QrStress, DifferentialIsTheSlopeOfTheEnergyGradient) {
  const Tensor D = frame(6);
  const Instance law = qr(5, 2);
  auto all = every_kind_of_deformation();
  all.resize(18);  // where no fibre has vanished the second derivative exists
  const auto directions = deformations(18, 1, 99);
  LawDriver<double> driver;
  Field F, dF;
  for (std::size_t k = 0; k < all.size(); ++k) {
    F.push_back(row_major(all[k]));
    dF.push_back(row_major(directions[k]));
  }
  driver.input(CLEAVE_FIELD_F, F).input(CLEAVE_FIELD_DELTA_F, dF).output(CLEAVE_FIELD_DELTA_P, 9);
  driver.constant(CLEAVE_FIELD_FIBER, column(D, 0)).constant(CLEAVE_FIELD_SECOND_FIBER, column(D, 1));
  driver.constant(CLEAVE_FIELD_DEGRADATION, {0.5});
  ASSERT_EQ(driver.run(evaluate<double>(law), law.handle(), std::uint32_t(all.size())), CLEAVE_OK);
  const double h = 1e-4;
  std::vector<Tensor> ahead, behind;
  for (std::size_t k = 0; k < all.size(); ++k) {
    ahead.push_back(all[k] + h * directions[k]);
    behind.push_back(all[k] - h * directions[k]);
  }
  const auto plus = energy_gradients(law, ahead, 0.5, D, 1e-4), minus = energy_gradients(law, behind, 0.5, D, 1e-4);
  for (std::uint32_t k = 0; k < all.size(); ++k) {
    const Tensor slope = (plus[k] - minus[k]) / (2 * h);
    EXPECT_LT((tensor(driver.value(CLEAVE_FIELD_DELTA_P, k)) - slope).cwiseAbs().maxCoeff(),
              2e-5 * std::max(slope.cwiseAbs().maxCoeff(), mu))
        << "F\n"
        << all[k];
  }
}

TEST(QrStress, SinglePrecisionKeepsItsDigits) {
  const Tensor D = frame(7);
  const Instance law = qr(5, 2);
  const auto all = every_kind_of_deformation();
  const Field single = evaluate_all<float>(law, CLEAVE_FIELD_TAU, 6, all, 0.4, D),
              twice = evaluate_all<double>(law, CLEAVE_FIELD_TAU, 6, all, 0.4, D);
  for (std::size_t k = 0; k < all.size(); ++k)
    EXPECT_LT((tensor(single[k]) - tensor(twice[k])).cwiseAbs().maxCoeff(),
              3e-6 * std::max(tensor(twice[k]).cwiseAbs().maxCoeff(), mu))
        << "F\n"
        << all[k];
}

// ---------------------------------------------------------------- published values

using Row = std::map<std::string, std::string>;

std::vector<Row> read(const std::string& name) { return read_reference_table(reference_data() / "golden" / name); }

Tensor matrix(const Row& row, const std::string& name) {
  Tensor a;
  for (int i = 0; i < 9; ++i) a.data()[i] = std::stod(row.at(name + std::to_string(i / 3) + std::to_string(i % 3)));
  return a;
}
double number_after(const std::string& text, const std::string& key) {
  const auto at = text.find(key);
  return at == std::string::npos ? 0 : std::stod(text.substr(at + key.size()));
}

TEST(QrGolden, EnergyAndStress) {
  const auto rows = read("qr_stable_neohookean.csv");
  if (rows.empty()) GTEST_SKIP() << "no reference values in " << reference_data() << "; set CLEAVE_DATA_DIR";
  ASSERT_GE(rows.size(), 60u);
  double most = 0;
  const auto expect_near = [&](const Tensor& actual, const Tensor& expected, double scale, const std::string& what) {
    const double error = (actual - expected).cwiseAbs().maxCoeff() / std::max(expected.cwiseAbs().maxCoeff(), scale);
    EXPECT_LT(error, 1e-9) << what;
    most = std::max(most, error);
  };
  for (const Row& row : rows) {
    const std::string &variant = row.at("variant"), what = row.at("case") + " " + variant;
    const Instance law = qr(number_after(variant, "kx="), number_after(variant, "ky="));
    const double g = number_after(variant, "g="), psi = std::stod(row.at("psi"));
    const Tensor F = matrix(row, "F"), tau = stress(law, F, g);
    EXPECT_NEAR(evaluate_all(law, CLEAVE_FIELD_ENERGY, 1, {F}, g)[0][0], psi, 1e-9 * std::max(std::abs(psi), 1e-3 * mu))
        << what;
    expect_near(tau, matrix(row, "tau"), 1e-3 * mu, what + ": tau");
    expect_near(tau * F.transpose().inverse(), matrix(row, "P"), 1e-3 * mu, what + ": P");
  }
  std::ostringstream text;
  text << most;
  RecordProperty("largest_relative_error", text.str());
}

TEST(QrGolden, TensileEnergyOfACriticalStretch) {
  const Instance law = qr();
  const auto psi_plus = [&](double p) {
    return evaluate_all(law, CLEAVE_FIELD_TENSILE_ENERGY, 1, {Tensor((1 + p) * Tensor::Identity())})[0][0];
  };
  // psi((1+p) I) with J = (1+p)^3
  const auto closed_form = [](double p) {
    const double stretch = 1 + p, J = stretch * stretch * stretch;
    return 1.5 * mu * (stretch * stretch - 1) - mu * (J - 1) + 0.5 * lambda * (J - 1) * (J - 1);
  };
  for (double p : {0.01, 0.1, 0.5, 2.}) EXPECT_NEAR(psi_plus(p), closed_form(p), 1e-12 * closed_form(p) + 1e-12) << p;
  for (const Row& row : read("sigma_crit.csv"))
    if (row.at("kind") == "sigma_crit") {
      const double p = std::stod(row.at("p_or_case")), expected = std::stod(row.at("qrsnh"));
      EXPECT_NEAR(psi_plus(p), expected, 1e-9 * std::abs(expected)) << p;
    }
}

}  // namespace
}  // namespace cleave::plugins::test
