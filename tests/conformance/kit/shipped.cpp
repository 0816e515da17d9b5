// The plugins that come with the program conform.
#include <cleave/testkit/gtest.hpp>

#include <filesystem>

namespace cleave::testkit {
namespace {

class ShippedPlugin : public testing::TestWithParam<std::filesystem::path> {};

TEST_P(ShippedPlugin, Conforms) {
  Options options;
  options.library = GetParam();
  const Report report = run_checks(options);
  EXPECT_TRUE(report.passed()) << to_table(report);
}

std::vector<std::filesystem::path> libraries() {
  std::vector<std::filesystem::path> all;
  for (const auto& entry : std::filesystem::directory_iterator(CLEAVE_BINARY_DIR "/lib/cleave/plugins"))
    if (entry.path().extension() == ".so") all.push_back(entry.path());
  return all;
}

INSTANTIATE_TEST_SUITE_P(Conformance, ShippedPlugin, testing::ValuesIn(libraries()),
                         [](const auto& info) { return info.param.stem().string(); });

// What the header for GoogleTest makes of a library: one test of every check.
CLEAVE_CONFORMANCE_TESTS(SplitNeoHookean, CLEAVE_BINARY_DIR "/lib/cleave/plugins/split_neo_hookean.so");

}  // namespace
}  // namespace cleave::testkit
