#include "point_testing.hpp"

#include <gmock/gmock.h>
#include <Eigen/Dense>

#include <random>

namespace cleave::testing {
namespace {

using ::testing::HasSubstr;
using ::testing::Not;

std::string row_of(const Matrix3& F) {
  std::string row;
  char text[40];
  for (int i = 0; i < 9; ++i) {
    std::snprintf(text, sizeof text, "%s%.17g", i ? "," : "", F(i / 3, i % 3));
    row += text;
  }
  return row;
}

std::vector<Matrix3> random_deformations(int count) {
  std::mt19937 generator(42);
  std::uniform_real_distribution<double> spread(-0.2, 0.2);
  std::vector<Matrix3> all;
  for (int i = 0; i < count; ++i)
    all.push_back(Matrix3::Identity() + Matrix3::NullaryExpr([&](int, int) { return spread(generator); }));
  return all;
}

std::string rows_of(const std::vector<Matrix3>& deformations) {
  std::string text = header + "\n";
  for (const Matrix3& F : deformations) text += row_of(F) + "\n";
  return text;
}

/// q = sqrt(3/2) |dev tau|
double von_mises(const Matrix3& tau) { return std::sqrt(1.5) * (tau - tau.trace() / 3 * Matrix3::Identity()).norm(); }

app::PointOptions with_von_mises(app::PointOptions options, double yield_stress) {
  options.laws.plasticity = "point-von-mises";
  options.laws.sets.push_back("plasticity.yield_stress=" + std::to_string(yield_stress));
  return options;
}

app::PointOptions with_damage(app::PointOptions options, const std::string& set) {
  options.laws.damage = "point-tensile-energy";
  options.laws.sets.push_back("damage." + set);
  return options;
}

app::PointOptions fibrous(const std::string& stiffness) {
  app::PointOptions options;
  options.laws.elasticity = "point-fibrous";
  options.laws.sets = {"elasticity.youngs_modulus=1e6", "elasticity.poissons_ratio=0.3",
                       "elasticity.fiber_stiffness=" + stiffness};
  options.laws.fiber = "1,1,0";
  return options;
}

using Tables = PointTest;

TEST_F(Tables, HandsOtherColumnsOnByteForByte) {
  const std::string names = " name ,F00,F01,F02,F10,F11,F12,F20,F21,F22,\"a, b\"";
  const std::string first = "  \xC3\xA9t\xC3\xA9,1.10,0,0,0,+1e0,0,0,0, 1 ,\"say, \"\"yes\"\"\"";
  const std::string second = ",1,0,0,0,1,0,0,0,1.000,0x1F";
  const Result result = evaluate(neo_hookean(), "# a comment\n" + names + "\r\n" + first + "\r\n\n# another\n" + second);
  ASSERT_EQ(result.status, 0) << result.err;
  std::istringstream lines(result.out);
  std::string line;
  for (const auto& expected : {names, first, second}) {
    ASSERT_TRUE(std::getline(lines, line));
    EXPECT_EQ(line.substr(0, expected.size() + 1), expected + ",");
  }
  EXPECT_FALSE(std::getline(lines, line));
}

TEST_F(Tables, OutputColumnsComeInTheDocumentedOrder) {
  const Result result = evaluate(neo_hookean(), header + ",d\n1,0,0,0,1,0,0,0,1,0\n");
  EXPECT_EQ(result.out.substr(0, result.out.find('\n')),
            header +
                ",d,psi,psi_plus,J,P00,P01,P02,P10,P11,P12,P20,P21,P22,tau00,tau01,tau02,tau10,tau11,tau12,tau20,tau21,"
                "tau22,yielded,Fe00,Fe01,Fe02,Fe10,Fe11,Fe12,Fe20,Fe21,Fe22,D,status");
}

TEST_F(Tables, InputColumnsNamedLikeResultsAreRenamed) {
  const Result result = evaluate(neo_hookean(), header + ",psi,psi_in\n1.1,0,0,0,1,0,0,0,1,first,second\n");
  const Table table = result.table();
  EXPECT_EQ(table.text(0, "psi_in_in"), "first");
  EXPECT_EQ(table.text(0, "psi_in"), "second");
  EXPECT_GT(table.number(0, "psi"), 0);
  EXPECT_THAT(result.err, HasSubstr("warning: column psi is also a result; written as ..._in"));
}

TEST_F(Tables, AHeaderWithoutRowsGivesAHeaderWithoutRows) {
  const Result result = evaluate(neo_hookean(), header + "\n");
  EXPECT_EQ(result.status, 0);
  EXPECT_EQ(result.table().rows.size(), 0u);
  EXPECT_EQ(result.err, "");
}

TEST_F(Tables, NumbersReadBackExactly) {
  for (const bool single : {false, true}) {
    app::PointOptions options = neo_hookean();
    options.laws.precision = single ? "single" : "double";
    const Result first = evaluate(options, rows_of(random_deformations(20)));
    // F_e of an elastic point is its F, so feeding it back must change no digit of the results.
    const Table table = first.table();
    std::string again = header + "\n";
    for (std::size_t i = 0; i < table.rows.size(); ++i) {
      for (const char* index : {"00", "01", "02", "10", "11", "12", "20", "21", "22"})
        again += (index == std::string("00") ? "" : ",") + table.text(i, "Fe" + std::string(index));
      again += "\n";
    }
    const Table second = evaluate(options, again).table();
    for (std::size_t i = 0; i < table.rows.size(); ++i)
      for (const char* column : {"psi", "psi_plus", "J", "P01", "P22", "tau00", "tau12", "Fe10"})
        EXPECT_EQ(table.text(i, column), second.text(i, column)) << column << " in row " << i;
  }
}

TEST_F(Tables, FilesHoldWhatTheStandardOutputGets) {
  app::PointOptions options = neo_hookean();
  const std::string input = rows_of(random_deformations(3));
  const Result printed = evaluate(options, input);
  options.output = folder_ / "out.csv";
  const Result written = evaluate(options, input);
  EXPECT_EQ(written.out, "");
  EXPECT_EQ(read(options.output), printed.out);
}

TEST_F(Tables, SingleAgreesWithDouble) {
  app::PointOptions options = with_damage(with_von_mises(neo_hookean(), 2e5), "critical_energy=1e4");
  const std::string input = rows_of(random_deformations(200));
  const Table exact = evaluate(options, input).table();
  options.laws.precision = "single";
  const Table rounded = evaluate(options, input).table();
  ASSERT_EQ(exact.rows.size(), 200u);
  for (std::size_t i = 0; i < 200; ++i) {
    EXPECT_LT((exact.matrix(i, "tau") - rounded.matrix(i, "tau")).norm(), 3e-6 * E);
    EXPECT_LT((exact.matrix(i, "P") - rounded.matrix(i, "P")).norm(), 3e-6 * E);
    EXPECT_LT((exact.matrix(i, "Fe") - rounded.matrix(i, "Fe")).norm(), 3e-6);
    EXPECT_NEAR(exact.number(i, "D"), rounded.number(i, "D"), 1e-4 * (1 + exact.number(i, "D")));
    for (const char* column : {"psi", "J", "tau01"}) {
      const std::string& text = rounded.text(i, column);
      std::string digits;
      for (const char c : text.substr(0, text.find('e')))
        if (std::isdigit(static_cast<unsigned char>(c)) && !(digits.empty() && c == '0')) digits += c;
      EXPECT_LE(digits.size(), 9u) << text;
    }
  }
}

TEST_F(Tables, PointsDoNotInfluenceEachOther) {
  auto deformations = random_deformations(150);
  deformations[3].col(0) *= -1;
  deformations[77].setZero();
  const app::PointOptions options = with_von_mises(neo_hookean(), 2e5);
  const Result together = evaluate(options, rows_of(deformations));
  std::istringstream lines(together.out);
  std::string line;
  std::getline(lines, line);
  for (const Matrix3& F : deformations) {
    const Result alone = evaluate(options, rows_of({F}));
    ASSERT_TRUE(std::getline(lines, line));
    EXPECT_EQ(alone.out.substr(alone.out.find('\n') + 1), line + "\n");
  }
}

TEST_F(Tables, UndefinedPointsAreFatalAndCounted) {
  const Result result = evaluate(neo_hookean(), header + "\n1,0,0,0,1,0,0,0,1\n-1,0,0,0,1,0,0,0,1\n0,0,0,0,1,0,0,0,1\n");
  EXPECT_EQ(result.status, 0);
  const Table table = result.table();
  EXPECT_EQ(table.text(0, "status"), "ok");
  for (const std::size_t i : {std::size_t(1), std::size_t(2)}) {
    EXPECT_EQ(table.text(i, "status"), "fatal");
    for (std::size_t c = 9; c + 2 < table.names.size(); ++c) EXPECT_EQ(table.rows[i][c], "nan") << table.names[c];
    EXPECT_EQ(table.text(i, "D"), "") << "no damage law, no driving force";
  }
  EXPECT_THAT(result.err, HasSubstr("warning: of 3 points: 2 fatal (first at "));
  EXPECT_THAT(result.err, HasSubstr("F.csv:3); the results of fatal and retry points are nan"));
}

TEST_F(Tables, ALawWithoutEnergyLeavesItsCellsEmpty) {
  app::PointOptions options;
  options.laws.elasticity = "point-stress-only";
  options.laws.sets = {"elasticity.modulus=10"};
  const Result result = evaluate(options, header + "\n2,0,0,0,1,0,0,0,1\n0,0,0,0,1,0,0,0,1\n4,0,0,0,1,0,0,0,1\n");
  const Table table = result.table();
  EXPECT_EQ(table.text(0, "psi"), "");
  EXPECT_EQ(table.text(0, "psi_plus"), "");
  EXPECT_EQ(table.text(0, "tau00"), "30");
  EXPECT_EQ(table.text(0, "P00"), "15");
  EXPECT_EQ(table.text(1, "status"), "unreliable") << "P of a singular F does not follow from tau";
  EXPECT_EQ(table.text(1, "tau00"), "-10");
  EXPECT_EQ(table.text(1, "P00"), "nan");
  EXPECT_EQ(table.text(2, "status"), "fatal") << "the law refuses so large a stretch";
  EXPECT_EQ(table.text(2, "tau00"), "nan");
}

TEST_F(Tables, DamageDegradesTensionAndLeavesCompression) {
  const Table table =
      evaluate(neo_hookean(), header + ",d\n1.1,0,0,0,1.1,0,0,0,1.1,0.5\n0.9,0,0,0,0.9,0,0,0,0.9,0.5\n").table();
  EXPECT_NEAR(table.number(0, "psi"), 0.25 * table.number(0, "psi_plus"), 1e-12 * E);
  const double J2 = std::pow(1.1, 6);
  EXPECT_NEAR(table.number(0, "tau00"), 0.25 * kappa / 2 * (J2 - 1), 1e-10 * E);
  EXPECT_NEAR(table.number(1, "tau00"), kappa / 2 * (std::pow(0.9, 6) - 1), 1e-10 * E);
  EXPECT_NEAR(table.number(1, "psi_plus"), 0, 1e-9 * E);
}

TEST_F(Tables, TheResidualOfTheDamageLawBoundsTheDegradation) {
  app::PointOptions options = with_damage(neo_hookean(), "critical_energy=100");
  options.laws.sets.push_back("damage.residual=0.125");
  const Table table = evaluate(options, header + ",d\n1.1,0,0,0,1.1,0,0,0,1.1,1\n1.1,0,0,0,1.1,0,0,0,1.1,0.5\n").table();
  const double tau = kappa / 2 * (std::pow(1.1, 6) - 1);
  EXPECT_NEAR(table.number(0, "tau00"), 0.125 * tau, 1e-10 * E);
  EXPECT_NEAR(table.number(1, "tau00"), (0.875 * 0.25 + 0.125) * tau, 1e-10 * E);
  EXPECT_NEAR(table.number(1, "D"), table.number(1, "psi_plus") / 100, 1e-9 * table.number(1, "D"));
}

TEST_F(Tables, TheReturnedStateLiesOnTheYieldSurface) {
  const auto deformations = random_deformations(100);
  const Table table = evaluate(with_von_mises(neo_hookean(), 1.5e5), rows_of(deformations)).table();
  int yielded = 0;
  for (std::size_t i = 0; i < deformations.size(); ++i) {
    const Matrix3 F = deformations[i], Fe = table.matrix(i, "Fe"), tau = table.matrix(i, "tau");
    EXPECT_NEAR(table.number(i, "J"), F.determinant(), 1e-12) << "flow keeps the volume";
    EXPECT_NEAR(table.number(i, "tau00") + table.number(i, "tau11") + table.number(i, "tau22"),
                1.5 * kappa * (F.determinant() * F.determinant() - 1), 1e-9 * E)
        << "and the pressure";
    EXPECT_LT((table.matrix(i, "P") * Fe.transpose() - tau).norm(), 1e-12 * E);
    if (table.text(i, "yielded") == "0") {
      EXPECT_EQ(Fe, F) << "an elastic point is not touched";
      EXPECT_LE(von_mises(tau), 1.5e5);
      continue;
    }
    ++yielded;
    EXPECT_NEAR(von_mises(tau), 1.5e5, 1e-9 * E);
    const Matrix3 stretch = Fe * F.inverse();
    EXPECT_LT((stretch - stretch.transpose()).norm(), 1e-12) << "F_e and F have the same rotation";
  }
  EXPECT_GT(yielded, 20);
  EXPECT_LT(yielded, 100);
}

TEST_F(Tables, LawsOfFAndLawsOfBGiveTheSameReturn) {
  const std::string input = rows_of(random_deformations(100));
  const Table of_b = evaluate(with_von_mises(neo_hookean(), 1.5e5), input).table();
  const Table of_F = evaluate(with_von_mises(fibrous("0"), 1.5e5), input).table();
  for (std::size_t i = 0; i < 100; ++i) {
    EXPECT_LT((of_b.matrix(i, "Fe") - of_F.matrix(i, "Fe")).norm(), 1e-11);
    EXPECT_LT((of_b.matrix(i, "tau") - of_F.matrix(i, "tau")).norm(), 1e-10 * E);
  }
}

TEST_F(Tables, StateVariablesStartAtTheColumnOrTheInitialValue) {
  const Table table = evaluate(with_von_mises(neo_hookean(), 1e5),
                               header + ",marker1,history\n1.5,0,0,0,1,0,0,0,1,20,7\n1,0,0,0,1,0,0,0,1,20,7\n")
                          .table();
  EXPECT_EQ(table.text(0, "yielded"), "1");
  EXPECT_EQ(table.number(0, "marker0_out"), 2) << "initial value 1, one return";
  EXPECT_EQ(table.number(0, "marker1_out"), 30) << "20 in the input";
  EXPECT_EQ(table.number(0, "marker2_out"), 103);
  EXPECT_GT(table.number(0, "history_out"), 7);
  EXPECT_EQ(table.number(1, "marker1_out"), 20);
  EXPECT_EQ(table.number(1, "history_out"), 7);
  EXPECT_EQ(table.text(0, "marker1"), "20") << "the input stays";
}

TEST_F(Tables, StateNamesOfTwoLawsAreToldApartByKind) {
  const Table table = evaluate(with_damage(with_von_mises(neo_hookean(), 1e5), "critical_energy=100"),
                               header + ",plasticity_history,damage_history,history\n1,0,0,0,1,0,0,0,1,3,500,untouched\n")
                          .table();
  EXPECT_EQ(table.number(0, "plasticity_history_out"), 3);
  EXPECT_EQ(table.number(0, "damage_history_out"), 500);
  EXPECT_EQ(table.number(0, "D"), 5) << "history over critical energy";
  EXPECT_FALSE(table.has("history_out"));
  EXPECT_EQ(table.text(0, "history"), "untouched");
}

TEST_F(Tables, ALocalLawGivesItsOwnDamage) {
  app::PointOptions options = neo_hookean();
  options.laws.damage = "point-local";
  options.laws.sets.push_back("damage.limit=1000");
  const Table table = evaluate(options, header + ",d\n1.1,0,0,0,1,0,0,0,1,0\n1.1,0,0,0,1,0,0,0,1,0.99\n").table();
  EXPECT_EQ(table.text(0, "D"), "");
  const double effective = table.number(0, "tau00") / table.number(0, "J");
  EXPECT_NEAR(table.number(0, "d_out"), 1 - std::sqrt(1000 / effective), 1e-12);
  EXPECT_NEAR(table.number(1, "tau00"), 1e-4 * table.number(0, "tau00"), 1e-9 * E)
      << "the stress is degraded by d of the input";
  EXPECT_EQ(table.number(1, "d_out"), 0.99);
}

TEST_F(Tables, OneFiberIsCompletedToAnOrthonormalFrame) {
  app::PointOptions options = fibrous("1e5");
  options.laws.fiber = "2,0,0";
  const std::string input = rows_of(random_deformations(5));
  const Result completed = evaluate(options, input);
  ASSERT_EQ(completed.status, 0) << completed.err;
  options.laws.second_fiber = "0,1,0";
  EXPECT_EQ(evaluate(options, input).out, completed.out);
  options.laws.second_fiber = "0,0,1";
  EXPECT_NE(evaluate(options, input).out, completed.out);
}

}  // namespace
}  // namespace cleave::testing
