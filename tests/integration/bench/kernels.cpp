#include "app/bench_command.hpp"
#include "bench/gnuplot.hpp"
#include "bench/report.hpp"
#include "common/error.hpp"

#include <gtest/gtest.h>

#include <boost/property_tree/json_parser.hpp>
#include <boost/property_tree/ptree.hpp>

#include <cstdlib>
#include <filesystem>
#include <fstream>
#include <sstream>

namespace cleave::testing {
namespace {

namespace fs = std::filesystem;
using bench::Kernel;

class BenchKernels : public ::testing::Test {
 protected:
  BenchKernels() : registry_({fs::path(CLEAVE_BINARY_DIR) / "lib/cleave/plugins", CLEAVE_POINT_PLUGINS}) {
    folder_ = fs::temp_directory_path() / ("cleave-bench-" + std::to_string(getpid()) + "-" +
                                           ::testing::UnitTest::GetInstance()->current_test_info()->name());
    fs::create_directories(folder_);
  }
  ~BenchKernels() override { fs::remove_all(folder_); }

  static bench::KernelOptions brief(std::vector<std::string> plugins) {
    return {.points = 100,
            .repeats = 3,
            .plugins = std::move(plugins),
            .elasticity = "elasticity/split-neo-hookean",
            .parameters = {}};
  }
  bench::KernelResults measure(std::vector<std::string> plugins) {
    return bench::measure_kernels(brief(std::move(plugins)), registry_);
  }

  struct Result {
    int status;
    std::string out, err;
  };
  Result command(const std::function<void(app::BenchOptions&)>& change) {
    app::BenchOptions options{.points = 64,
                              .repeats = 3,
                              .plugins = {"elasticity/qr"},
                              .elasticity = "",
                              .sets = {},
                              .json = std::nullopt,
                              .chart = std::nullopt};
    change(options);
    ::testing::internal::CaptureStdout();
    Result result{2, "", ""};
    try {
      result.status = app::bench_command(options, registry_);
    } catch (const InputError& error) {
      result.err = error.what();
    }
    result.out = ::testing::internal::GetCapturedStdout();
    return result;
  }
  static std::string read(const fs::path& file) {
    std::ostringstream text;
    text << std::ifstream(file, std::ios::binary).rdbuf();
    return text.str();
  }

  plugins::Registry registry_;
  fs::path folder_;
};

TEST_F(BenchKernels, ElasticLawsAreMeasuredInBothPrecisionsAndWithOptionalFibers) {
  const auto results = measure({"elasticity/fixed-corotated", "elasticity/qr"});
  EXPECT_TRUE(results.skipped.empty()) << results.skipped[0].reason;
  ASSERT_EQ(results.kernels.size(), 9u);
  const char* outputs[] = {"stress", "P", "dP"};
  for (std::size_t i = 0; i < 3; ++i) {
    const auto &corotated = results.kernels[i], &qr = results.kernels[3 + i], &fibrous = results.kernels[6 + i];
    EXPECT_EQ(corotated.id, "elasticity/fixed-corotated");
    EXPECT_EQ(corotated.condition, outputs[i]);
    EXPECT_EQ(qr.condition, outputs[i]);
    EXPECT_FALSE(qr.parameters.contains("fiber_scale"));
    EXPECT_EQ(fibrous.condition, outputs[i] + std::string(", with fibres"));
    EXPECT_GT(std::get<double>(fibrous.parameters.at("fiber_scale")), 0);
  }
  for (const Kernel& kernel : results.kernels) {
    ASSERT_TRUE(kernel.single && kernel.doubled);
    for (const auto& timing : {*kernel.single, *kernel.doubled}) {
      EXPECT_GT(timing.fastest, 0);
      EXPECT_GE(timing.median, timing.fastest);
      EXPECT_LT(timing.median, 1e5) << "nanoseconds per point";
    }
  }
}

TEST_F(BenchKernels, ReturnMappingsAreMeasuredWhereTheAnnouncedShareYields) {
  const auto results = measure({"plasticity/point-von-mises"});
  ASSERT_EQ(results.kernels.size(), 3u) << (results.skipped.empty() ? "" : results.skipped[0].reason);
  const double shares[] = {0, 0.3, 1};
  for (int i = 0; i < 3; ++i) {
    EXPECT_DOUBLE_EQ(results.kernels[std::size_t(i)].yielding.value(), shares[i]);
    EXPECT_EQ(results.kernels[std::size_t(i)].elasticity, "elasticity/split-neo-hookean");
  }
  EXPECT_EQ(results.kernels[1].condition, "30 % yielding");
}

TEST_F(BenchKernels, DamageLawsAreDrivenByWhatTheElasticLawGives) {
  const auto results = measure({"damage/point-tensile-energy", "damage/point-local"});
  ASSERT_EQ(results.kernels.size(), 4u) << (results.skipped.empty() ? "" : results.skipped[0].reason);
  EXPECT_EQ(results.kernels[0].condition, "near rest");
  EXPECT_EQ(results.kernels[1].condition, "loaded");
}

TEST_F(BenchKernels, NamedPluginsComeInTheirOrderAndAreComparedWithTheFirst) {
  const auto results = measure({"elasticity/split-neo-hookean", "elasticity/qr", "elasticity/fixed-corotated"});
  ASSERT_EQ(results.kernels.size(), 12u);
  EXPECT_EQ(results.kernels[0].id, "elasticity/split-neo-hookean");
  EXPECT_EQ(results.kernels[3].id, "elasticity/qr");
  EXPECT_EQ(results.kernels[9].id, "elasticity/fixed-corotated");

  const auto kernel = [](const char* id, const char* condition, double single, std::optional<bench::Timing> doubled) {
    return Kernel{.id = id,
                  .condition = condition,
                  .elasticity = "",
                  .isa = "baseline",
                  .parameters = {},
                  .yielding = {},
                  .single = bench::Timing{single, single},
                  .doubled = doubled};
  };
  const bench::KernelResults timed{
      .kernels = {kernel("a/b", "stress", 2, bench::Timing{4, 4}), kernel("a/c", "stress", 5, bench::Timing{3, 3}),
                  kernel("a/d", "stress", 1, std::nullopt), kernel("a/d", "other", 1, {})},
      .skipped = {}};
  const auto table = [&](std::vector<std::string> plugins) {
    const std::string text = bench::table_text(brief(std::move(plugins)), timed);
    return text.substr(text.find("\n\n") + 2);
  };
  EXPECT_EQ(table({"a/b", "a/c", "a/d"}),
            "               single    double     x of the first\n"
            "a/b: stress      2.00      4.00      1.00      1.00  baseline\n"
            "a/c: stress      5.00      3.00      2.50      0.75  baseline\n"
            "a/d: stress      1.00         -      0.50         -  baseline\n"
            "a/d: other       1.00         -         -         -  baseline\n");
  EXPECT_EQ(table({}).find("of the first"), std::string::npos);
  EXPECT_EQ(table({"a/b"}).find("of the first"), std::string::npos);
}

TEST_F(BenchKernels, WhatCannotBeMeasuredIsSaid) {
  auto options = brief({"plasticity/point-von-mises"});
  options.elasticity = "elasticity/fixed-corotated";
  auto results = bench::measure_kernels(options, registry_);
  ASSERT_EQ(results.skipped.size(), 1u);
  EXPECT_EQ(results.skipped[0].reason, "elasticity/fixed-corotated does not offer what it needs");

  options.elasticity = "elasticity/split-neo-hookean";
  options.parameters["plasticity/point-von-mises"] = {{"yield_stress", 1e30}};
  EXPECT_THROW(bench::measure_kernels(options, registry_), InputError) << "the user set what leads nowhere";
}

TEST_F(BenchKernels, GivenParametersAreUsedAndTheOthersChosen) {
  auto options = brief({"elasticity/qr"});
  options.parameters["elasticity/qr"] = {{"poissons_ratio", 0.4}, {"fiber_scale", 7.}};
  const auto results = bench::measure_kernels(options, registry_);
  ASSERT_EQ(results.kernels.size(), 3u) << "fibres are there from the start";
  EXPECT_EQ(std::get<double>(results.kernels[0].parameters.at("poissons_ratio")), 0.4);
  EXPECT_EQ(std::get<double>(results.kernels[0].parameters.at("fiber_scale")), 7);
  EXPECT_GT(std::get<double>(results.kernels[0].parameters.at("youngs_modulus")), 0);
}

TEST_F(BenchKernels, WritesTableJsonAndChart) {
  const bool chart = bench::gnuplot_is_installed();
  const auto result = command([&](app::BenchOptions& options) {
    options.json = folder_ / "kernels.json";
    if (chart) options.chart = folder_ / "kernels.svg";
    options.plugins = {"elasticity/qr", "plasticity/point-von-mises"};
    options.elasticity = "elasticity/split-neo-hookean";
    options.sets = {"elasticity/qr.youngs_modulus=2000", "elasticity/qr.poissons_ratio=0.3"};
  });
  EXPECT_EQ(result.status, 0) << result.err;
  EXPECT_NE(result.out.find("elasticity/qr: stress, with fibres"), std::string::npos) << result.out;

  boost::property_tree::ptree json;
  read_json((folder_ / "kernels.json").string(), json);
  EXPECT_EQ(json.get<int>("points"), 64);
  const auto& kernels = json.get_child("kernels");
  ASSERT_EQ(kernels.size(), 9u);
  const auto& first = kernels.front().second;
  EXPECT_EQ(first.get<std::string>("plugin"), "elasticity/qr");
  EXPECT_EQ(first.get<double>("parameters.youngs_modulus"), 2000);
  EXPECT_GT(first.get<double>("double.median_ns"), 0);
  if (!chart) GTEST_SKIP() << "no gnuplot here to draw the chart";
  const std::string svg = read(folder_ / "kernels.svg");
  EXPECT_NE(svg.find("elasticity/qr: stress, with fibres"), std::string::npos);
  EXPECT_NE(svg.find("plasticity/point-von-mises: 30 % yielding"), std::string::npos);
  EXPECT_NE(svg.find("nanoseconds per point"), std::string::npos);
}

TEST_F(BenchKernels, BadInputIsRefusedBeforeAnythingIsMeasured) {
  const auto error = [&](const std::function<void(app::BenchOptions&)>& change) {
    const auto result = command(change);
    EXPECT_EQ(result.status, 2);
    EXPECT_EQ(result.out, "");
    return result.err;
  };
  EXPECT_EQ(error([](auto& o) { o.chart = "chart.png"; }), "--chart: error: the chart is an .svg file");
  EXPECT_EQ(error([](auto& o) { o.sets = {"youngs_modulus=1"}; }),
            "--set youngs_modulus=1: error: expected ID.PARAMETER=VALUE, for example "
            "elasticity/split-neo-hookean.youngs_modulus=1e6");
  EXPECT_NE(error([](auto& o) { o.plugins = {"elasticity/qq"}; }).find("did you mean"), std::string::npos);
  EXPECT_NE(error([](auto& o) { o.sets = {"elasticity/qr.fibre_scale=1"}; }).find("did you mean \"fiber_scale\"?"),
            std::string::npos);
  EXPECT_NE(error([](auto& o) { o.sets = {"elasticity/qr.fiber_scale=-1"}; }).find("fiber_scale must be at least 0"),
            std::string::npos);
  EXPECT_NE(error([](auto& o) { o.elasticity = "damage/point-local"; }).find("is not an elastic law"), std::string::npos);

  const std::string path = std::getenv("PATH");
  setenv("PATH", folder_.c_str(), 1);
  EXPECT_EQ(error([](auto& o) { o.chart = "chart.svg"; }),
            "--chart: error: gnuplot is not installed; install it (Debian: gnuplot-nox), or leave out --chart");
  setenv("PATH", path.c_str(), 1);
}

}  // namespace
}  // namespace cleave::testing
