#include "point_testing.hpp"

#include <gmock/gmock.h>

namespace cleave::testing {
namespace {

using ::testing::StartsWith;

class BadInput : public PointTest {
 protected:
  void expect(const Result& result, const std::string& message) const {
    EXPECT_EQ(result.status, 2);
    EXPECT_EQ(result.out, "") << "nothing is written";
    EXPECT_EQ(result.err, message);
  }
  void expect_table(const std::string& text, const std::string& message) const {
    expect(evaluate(neo_hookean(), text), (folder_ / "F.csv").string() + message);
  }
  Result with(const std::function<void(app::PointOptions&)>& change) const {
    app::PointOptions options = neo_hookean();
    change(options);
    return evaluate(options, header + "\n1,0,0,0,1,0,0,0,1\n");
  }
};

const std::string there_are =
    "there are: fixed-corotated, point-fibrous, point-stress-only, qr, split-neo-hookean, stvk-hencky";

TEST_F(BadInput, MissingColumnsAreNamed) {
  expect_table("F00,F01,F02,F10,F11,F12,F20,name\n",
               ":1: error: columns F21, F22 are missing; a point needs F00 to F22 (row-major). There are: F00, F01, F02, F10, "
               "F11, F12, F20, name");
}
TEST_F(BadInput, AColumnThatIsThereTwice) {
  expect_table("# first\n" + header + ",F11\n", ":2:37: error: column F11 is there twice");
}
TEST_F(BadInput, AWordInPlaceOfANumber) {
  expect_table(header + "\n1,0,0,0,1,0,0,0,1\n1,0,0,0, one,0,0,0,1\n", ":3:9: error: F11 must be a number, is 'one'");
}
TEST_F(BadInput, ANumberWithSomethingBehindIt) {
  expect_table(header + "\n1,0,0,0,1.0f,0,0,0,1\n", ":2:9: error: F11 must be a number, is '1.0f'");
}
TEST_F(BadInput, AnEmptyCell) { expect_table(header + "\n1,0,,0,1,0,0,0,1\n", ":2:5: error: F02 must be a number, is empty"); }
TEST_F(BadInput, ANumberThatIsNotFinite) {
  expect_table(header + "\n1,0,0,0,nan,0,0,0,1\n", ":2:9: error: F11 must be finite, is 'nan'");
  expect_table(header + "\n1,0,0,0,-inf,0,0,0,1\n", ":2:9: error: F11 must be finite, is '-inf'");
}
TEST_F(BadInput, ANumberBeyondDoublePrecision) {
  expect_table(header + "\n1,0,0,0,1,0,0,0,1e999\n", ":2:17: error: F22 is beyond double precision, is '1e999'");
}
TEST_F(BadInput, ARowOfTheWrongLength) {
  expect_table(header + "\n\n1,0,0,0,1,0,0,0\n", ":3: error: has 8 cells, the header has 9");
}
TEST_F(BadInput, AQuoteThatIsNotClosed) {
  expect_table(header + "\n1,0,0,0,1,0,0,0,\"1\n", ":2: error: a quote is not closed; cells may not span lines");
}
TEST_F(BadInput, NothingButComments) { expect_table("# F00\n\n", ": error: has no header line that names the columns"); }
TEST_F(BadInput, DamageOutOfRange) {
  expect_table(header + ",d\n1,0,0,0,1,0,0,0,1,1.5\n", ":2:19: error: d must be in [0, 1], is 1.5");
}
TEST_F(BadInput, AStateVariableThatIsNoNumber) {
  app::PointOptions options = neo_hookean();
  options.laws.plasticity = "point-von-mises";
  options.laws.sets.push_back("plasticity.yield_stress=1e4");
  expect(evaluate(options, "marker2," + header + "\nx,1,0,0,0,1,0,0,0,1\n"),
         (folder_ / "F.csv").string() + ":2:1: error: marker2 must be a number, is 'x'");
}
TEST_F(BadInput, AFileThatIsNotThere) {
  app::PointOptions options = neo_hookean();
  options.input = folder_ / "none.csv";
  expect(run(options), (folder_ / "none.csv").string() + ": error: cannot be read; is there such a file?");
  options.input = folder_;
  expect(run(options), folder_.string() + ": error: is a directory");
}
TEST_F(BadInput, AnOutputThatCannotBeWritten) {
  app::PointOptions options = neo_hookean();
  options.output = folder_ / "nowhere" / "out.csv";
  const Result result = evaluate(options, header + "\n1,0,0,0,1,0,0,0,1\n");
  EXPECT_EQ(result.status, 2);
  EXPECT_THAT(result.err, StartsWith("cannot write " + (folder_ / "nowhere/out.csv").string()));
}

TEST_F(BadInput, AnUnknownPluginWithTheNearest) {
  expect(
      with([](auto& o) { o.laws.elasticity = "split-neohookean"; }),
      "--elasticity: error: there is no elasticity plugin 'split-neohookean', did you mean 'split-neo-hookean'? Of this kind " +
          there_are);
}
TEST_F(BadInput, APluginOfAnotherKind) {
  expect(
      with([](auto& o) { o.laws.damage = "point-von-mises"; }),
      "--damage: error: 'plasticity/point-von-mises' is a plasticity law, here belongs a damage law; there are: anisotropic, "
      "phase-field, point-local, point-tensile-energy, rankine");
}
TEST_F(BadInput, AnUnknownParameterWithTheNearest) {
  expect(with([](auto& o) { o.laws.sets[0] = "elasticity.young_modulus=1e6"; }),
         "--set elasticity.poissons_ratio: error: 'poissons_ratio' is not enough; add 'youngs_modulus'\n"
         "--set elasticity.young_modulus: error: unknown key 'young_modulus' in 'elasticity/split-neo-hookean', did you mean "
         "'youngs_modulus'?");
}
TEST_F(BadInput, AParameterOutOfBounds) {
  expect(with([](auto& o) { o.laws.sets[1] = "elasticity.poissons_ratio=0.5"; }),
         "--set elasticity.poissons_ratio: error: 'poissons_ratio' must be in (-1, 0.5), is 0.5");
}
TEST_F(BadInput, AParameterOfTheWrongType) {
  expect(with([](auto& o) { o.laws.sets[0] = "elasticity.youngs_modulus=stiff"; }),
         "--set elasticity.youngs_modulus: error: 'youngs_modulus' must be a number (Pa), is the text \"stiff\"");
}
TEST_F(BadInput, AMissingParameter) {
  expect(with([](auto& o) { o.laws.plasticity = "point-von-mises"; }),
         "--plasticity: error: 'plasticity/point-von-mises' needs 'yield_stress', a number (Pa): in tension");
}
TEST_F(BadInput, AnIncompleteSetOfParameters) {
  expect(with([](auto& o) { o.laws.sets.pop_back(); }),
         "--set elasticity.youngs_modulus: error: 'youngs_modulus' is not enough; add 'poissons_ratio'");
}
TEST_F(BadInput, AParameterOfALawThatIsNotThere) {
  expect(with([](auto& o) { o.laws.sets.push_back("damage.residual=0"); }),
         "--set damage.residual: error: there is no damage law to set this for; give --damage");
}
TEST_F(BadInput, AParameterOfNoKindOfLaw) {
  expect(
      with([](auto& o) { o.laws.sets.push_back("elastic.modulus=0"); }),
      "--set elastic.modulus: error: unknown key 'elastic' in a material point; it may have: damage, elasticity, plasticity");
}
TEST_F(BadInput, ASetWithoutAValue) {
  for (const char* set : {"elasticity", "elasticity=1", "elasticity.youngs_modulus", ".x=1", "x.=1"})
    expect(with([&](auto& o) { o.laws.sets.push_back(set); }),
           "--set " + std::string(set) + ": error: expected law.parameter=value, for example elasticity.youngs_modulus=1e6");
}
TEST_F(BadInput, LawsThatDoNotGoTogether) {
  expect(with([](auto& o) {
           o.laws.elasticity = "fixed-corotated";
           o.laws.plasticity = "point-von-mises";
           o.laws.sets.push_back("plasticity.yield_stress=1e4");
         }),
         "--plasticity: error: 'plasticity/point-von-mises' needs the isochoric response of the elastic law, which "
         "'elasticity/fixed-corotated' does not offer; these do: point-fibrous, qr, split-neo-hookean, stvk-hencky");
}

TEST_F(BadInput, FibersThatAreNeeded) {
  expect(with([](auto& o) { o.laws.elasticity = "point-fibrous"; }),
         "--elasticity: error: 'elasticity/point-fibrous' needs the direction of the fibers; give --fiber x,y,z (and --fiber2 "
         "x,y,z)");
}
TEST_F(BadInput, AFiberThatIsNoDirection) {
  const auto fiber = [&](const std::string& text) { return with([&](auto& o) { o.laws.fiber = text; }); };
  expect(fiber("1,0"), "--fiber 1,0: error: must be three numbers x,y,z");
  expect(fiber("1,0,0,0"), "--fiber 1,0,0,0: error: must be three numbers x,y,z");
  expect(fiber("1,zero,0"), "--fiber 1,zero,0: error: must be three numbers x,y,z");
  expect(fiber("0,0,0"), "--fiber 0,0,0: error: must be a direction: not all of its numbers may be 0");
}
TEST_F(BadInput, FibersThatAreNotOrthogonal) {
  expect(with([](auto& o) {
           o.laws.fiber = "1,0,0";
           o.laws.second_fiber = "1,1,0";
         }),
         "--fiber2 1,1,0: error: must be orthogonal to --fiber 1,0,0, the cosine of their angle is 0.707107");
  expect(with([](auto& o) { o.laws.second_fiber = "1,1,0"; }), "--fiber2: error: is given without --fiber");
}
TEST_F(BadInput, AFiberNobodyReadsIsWarnedAbout) {
  const Result result = with([](auto& o) { o.laws.fiber = "1,0,0"; });
  EXPECT_EQ(result.status, 0);
  EXPECT_EQ(result.err, "--fiber: warning: no law of material 'point' reads its fibers\n");
}
TEST_F(BadInput, AnUnknownPrecision) {
  expect(with([](auto& o) { o.laws.precision = "half"; }), "--precision half: error: must be single or double");
}

TEST_F(BadInput, PathOptions) {
  const auto on = [&](const std::string& path, const std::function<void(app::PointOptions&)>& change) {
    app::PointOptions options = along(neo_hookean(), path, 0.1, 10);
    change(options);
    return run(options);
  };
  const auto nothing = [](auto&) {};
  expect(
      on("bending", nothing),
      "--path bending: error: no such path; there are: uniaxial-strain, uniaxial-stress, simple-shear, hydrostatic, triaxial");
  expect(on("uniaxial-stres", nothing), "--path uniaxial-stres: error: no such path, did you mean 'uniaxial-stress'?");
  expect(on("hydrostatic", [](auto& o) { o.amplitude.reset(); }),
         "--path hydrostatic: error: needs --amplitude, the engineering strain at its end (gamma in simple shear)");
  expect(on("hydrostatic", [](auto& o) { o.steps = 0; }), "--steps: error: must be at least 1, is 0");
  expect(on("hydrostatic", [](auto& o) { o.confinement = 1; }), "--confinement: error: belongs to --path triaxial");
  expect(on("triaxial", nothing), "--path triaxial: error: needs --confinement, the pressure in Pa");
  expect(on("triaxial", [](auto& o) { o.confinement = -5; }),
         "--confinement: error: must be a pressure of at least 0 Pa, is -5");
  expect(on("triaxial", [](auto& o) { o.input = "F.csv"; }), "--path: error: cannot be given together with --input");
  expect(with([](auto& o) { o.steps = 5; }), "--steps: error: belongs to --path");
  expect(run(neo_hookean()), "error: give --input FILE.csv, --path NAME, --json or --replay FILE");
}

}  // namespace
}  // namespace cleave::testing
