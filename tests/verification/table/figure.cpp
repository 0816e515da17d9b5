#include "figure.hpp"
#include "page.hpp"

#include <fmt/format.h>
#include <gtest/gtest.h>
#include <unistd.h>

#include <algorithm>
#include <cmath>
#include <cstdlib>
#include <fstream>
#include <nlohmann/json.hpp>

namespace cleave::test {
namespace {

namespace fs = std::filesystem;

std::string long_test;  // that asked whether it is to run

std::string value(double v) { return fmt::format("{:.4g}", v + 0.0); }  // without the sign of a zero

std::string test_name() {
  const auto* test = testing::UnitTest::GetInstance()->current_test_info();
  return std::string(test->test_suite_name()) + "." + test->name();
}

/// Rounding is not worth its digits.
std::string shown(const Figure& f) {
  return std::isinf(f.scatter) && f.reference == 0 && std::abs(f.measured) < f.tolerance ? "< " + value(f.tolerance)
                                                                                         : value(f.measured);
}

Line line_of(const Figure& f) {
  Line line{.row = f.row, .problem = f.problem, .quantity = f.quantity};
  line.measured = shown(f);
  switch (f.judged) {
    case Judged::at_least:
      line.reference = ">= " + value(f.reference - f.tolerance);
      break;
    case Judged::at_most:
      line.reference = "<= " + value(f.reference + f.tolerance);
      break;
    case Judged::within:
    case Judged::shown:
      line.reference = value(f.reference);
      if (f.reference != 0) {
        const double error = f.measured / f.reference - 1;
        line.error = std::abs(error) < 1e-10 ? "rounding" : fmt::format("{:+.2g} %", 100 * error);
      }
      if (f.judged == Judged::shown)
        line.tolerance = "shown";
      else
        line.tolerance =
            f.reference != 0 ? fmt::format("{:.2g} %", 100 * f.tolerance / std::abs(f.reference)) : value(f.tolerance);
  }
  if (f.order) line.order = fmt::format("{:.1f}", *f.order);
  line.command = fmt::format("{}{} --gtest_filter={}", long_test == test_name() ? "CLEAVE_VERIFY_LONG=1 " : "",
                             fs::read_symlink("/proc/self/exe").filename().string(), test_name());
  return line;
}

void write(const fs::path& directory, const Line& line) {
  fs::create_directories(directory);
  std::string test = test_name();
  std::replace(test.begin(), test.end(), '/', '_');
  std::ofstream out(directory / fmt::format("{}.{}.jsonl", test, getpid()), std::ios::app);
  out << nlohmann::json{{"row", line.row},
                        {"problem", line.problem},
                        {"quantity", line.quantity},
                        {"reference", line.reference},
                        {"measured", line.measured},
                        {"error", line.error},
                        {"tolerance", line.tolerance},
                        {"order", line.order},
                        {"command", line.command}}
             .dump()
      << '\n';
  EXPECT_TRUE(out.flush()) << "writing to " << directory;
}

void compare_with_page(const Figure& f) {
  static const std::vector<Line> page = lines_of(verification_page());
  const auto listed = std::find_if(page.begin(), page.end(), [&](const Line& l) {
    return l.row == f.row && l.problem == f.problem && l.quantity == f.quantity;
  });
  if (listed == page.end()) {
    ADD_FAILURE() << "docs/verification.md has no line \"" << f.problem << "\", \"" << f.quantity << "\" of problem " << f.row
                  << ": ./dev verify writes it";
    return;
  }
  if (std::isinf(f.scatter)) return;
  const double said = std::strtod(listed->measured.c_str(), nullptr);
  EXPECT_NEAR(f.measured, said, (f.scatter + 1e-3) * std::max(std::abs(said), f.tolerance))
      << "docs/verification.md says otherwise of " << f.problem << ", " << f.quantity << ": ./dev verify renews it";
}

}  // namespace

void report(const Figure& f) {
  const std::string what = f.problem + ", " + f.quantity;
  EXPECT_TRUE(std::isfinite(f.measured)) << what;
  switch (f.judged) {
    case Judged::within:
      EXPECT_NEAR(f.measured, f.reference, f.tolerance) << what;
      break;
    case Judged::at_least:
      EXPECT_GE(f.measured, f.reference - f.tolerance) << what;
      break;
    case Judged::at_most:
      EXPECT_LE(f.measured, f.reference + f.tolerance) << what;
      break;
    case Judged::shown:
      break;
  }
  if (const char* directory = std::getenv("CLEAVE_VERIFICATION_DIR"); directory && *directory)
    write(directory, line_of(f));
  else
    compare_with_page(f);
}

bool long_cases() {
  long_test = test_name();
  const char* set = std::getenv("CLEAVE_VERIFY_LONG");
  return set && *set;
}

double order_of(double coarse, double fine) { return std::log2(std::abs(coarse / fine)); }

}  // namespace cleave::test
