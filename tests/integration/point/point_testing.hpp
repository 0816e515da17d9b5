#pragma once

#include "app/point_command.hpp"
#include "common/error.hpp"
#include "common/types.hpp"

#include <gtest/gtest.h>

#include <filesystem>
#include <fstream>
#include <sstream>
#include <string>
#include <vector>

namespace cleave::testing {

/// A table as text, read independently of the code under test.
struct Table {
  std::vector<std::string> names;
  std::vector<std::vector<std::string>> rows;

  static std::vector<std::string> cells(const std::string& line) {
    std::vector<std::string> cells(1);
    for (const char c : line)
      if (c == ',')
        cells.emplace_back();
      else
        cells.back() += c;
    return cells;
  }
  static Table parse(const std::string& text) {
    Table table;
    std::istringstream lines(text);
    for (std::string line; std::getline(lines, line);) {
      if (line.empty() || line[0] == '#') continue;
      (table.names.empty() ? table.names : table.rows.emplace_back()) = cells(line);
    }
    return table;
  }
  bool has(const std::string& name) const { return std::find(names.begin(), names.end(), name) != names.end(); }
  const std::string& text(std::size_t row, const std::string& name) const {
    const auto at = std::find(names.begin(), names.end(), name);
    if (at == names.end()) throw std::runtime_error("no column " + name);
    return rows.at(row).at(std::size_t(at - names.begin()));
  }
  double number(std::size_t row, const std::string& name) const { return std::strtod(text(row, name).c_str(), nullptr); }
  /// Column of the last row.
  double last(const std::string& name) const { return number(rows.size() - 1, name); }
  Matrix3 matrix(std::size_t row, const std::string& letter) const {
    Matrix3 a;
    for (int i = 0; i < 9; ++i) a(i / 3, i % 3) = number(row, letter + std::to_string(i / 3) + std::to_string(i % 3));
    return a;
  }
};

struct Result {
  int status = 0;
  std::string out, err;
  Table table() const { return Table::parse(out); }
};

class PointTest : public ::testing::Test {
 protected:
  void SetUp() override {
    folder_ = std::filesystem::temp_directory_path() / ("cleave-point-" + std::to_string(getpid()) + "-" +
                                                        ::testing::UnitTest::GetInstance()->current_test_info()->name());
    std::filesystem::create_directories(folder_);
  }
  void TearDown() override { std::filesystem::remove_all(folder_); }

  std::filesystem::path write(const std::string& name, const std::string& text) const {
    std::ofstream(folder_ / name, std::ios::binary) << text;
    return folder_ / name;
  }
  static std::string read(const std::filesystem::path& path) {
    std::ostringstream text;
    text << std::ifstream(path, std::ios::binary).rdbuf();
    return text.str();
  }

  static Result run(const app::PointOptions& options) {
    plugins::Registry registry({std::filesystem::path(CLEAVE_BINARY_DIR) / "lib/cleave/plugins", CLEAVE_POINT_PLUGINS});
    ::testing::internal::CaptureStdout();
    ::testing::internal::CaptureStderr();
    Result result;
    try {
      result.status = app::point_command(options, registry);
    } catch (const InputError& e) {
      result.status = 2;
      result.err = e.what();
    }
    result.out = ::testing::internal::GetCapturedStdout();
    result.err += ::testing::internal::GetCapturedStderr();
    return result;
  }
  /// With the text as input file.
  Result evaluate(app::PointOptions options, const std::string& text) const {
    options.input = write("F.csv", text);
    return run(options);
  }

  /// E = 1e6 Pa, nu = 0.3.
  static app::PointOptions neo_hookean() {
    app::PointOptions options;
    options.laws.elasticity = "split-neo-hookean";
    options.laws.sets = {"elasticity.youngs_modulus=1e6", "elasticity.poissons_ratio=0.3"};
    return options;
  }
  static app::PointOptions along(app::PointOptions options, const std::string& path, double amplitude, int steps) {
    options.path = path;
    options.amplitude = amplitude;
    options.steps = steps;
    return options;
  }

  static constexpr double E = 1e6, nu = 0.3, mu = E / (2 * (1 + nu)), kappa = E / (3 * (1 - 2 * nu));

  std::filesystem::path folder_;
};

inline const std::string header = "F00,F01,F02,F10,F11,F12,F20,F21,F22";

}  // namespace cleave::testing
