// The example of docs/point.md runs as it stands there.

#include "program.hpp"

#include <cmath>

namespace cleave::test {
namespace {

class JsonExample : public Program {};

TEST_F(JsonExample, ShearsAVonMisesElement) {
  if (std::system("python3 -c 'import json' >/dev/null 2>&1") != 0) GTEST_SKIP() << "there is no python3";
  const std::string manual = contents(fs::path(CLEAVE_SOURCE_DIR) / "docs/point.md"), fence = "```python\n";
  const auto begin = manual.find(fence);
  ASSERT_NE(begin, std::string::npos);
  const auto first = begin + fence.size();
  write("example.py", manual.substr(first, manual.find("```", first) - first));
  const std::string command = "cd '" + directory.string() + "' && PATH=\"$(dirname '" CLEAVE_PROGRAM "'):$PATH\" " +
                              "timeout 60 python3 example.py >out.txt 2>err.txt";
  ASSERT_EQ(std::system(command.c_str()), 0) << contents(directory / "err.txt");

  std::ifstream out(directory / "out.txt");
  double strain = 0, stress = 0, yielded = 0;
  int lines = 0;
  while (out >> strain >> stress >> yielded) {
    lines++;
    // tau_xy = mu gamma in the elastic range of this law, and tau_y/sqrt(3) on the yield surface
    const double mu = 1e6 / 2.6, limit = 1e4 / std::sqrt(3.);
    EXPECT_EQ(yielded, mu * strain > limit) << strain;
    EXPECT_NEAR(stress, std::min(mu * strain, limit), 2e-3 * limit) << strain;
  }
  EXPECT_EQ(lines, 10);
}

}  // namespace
}  // namespace cleave::test
