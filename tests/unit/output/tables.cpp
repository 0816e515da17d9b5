#include "output/frame.hpp"
#include "run_directory.hpp"

#include <boost/property_tree/json_parser.hpp>
#include <boost/property_tree/ptree.hpp>

#include <cmath>
#include <limits>
#include <sstream>

namespace cleave::output {
namespace {

using Tables = RunDirectory;

std::vector<std::string> cells(const std::string& line) {
  std::vector<std::string> result{""};
  bool quoted = false;
  for (std::size_t i = 0; i < line.size(); ++i) {
    if (line[i] == '"') {
      if (quoted && i + 1 < line.size() && line[i + 1] == '"')
        result.back() += line[++i];
      else
        quoted = !quoted;
    } else if (line[i] == ',' && !quoted) {
      result.emplace_back();
    } else {
      result.back() += line[i];
    }
  }
  return result;
}

FrameRecord record() {
  FrameRecord record;
  record.frame = 3;
  record.time = 0.1;
  record.steps = 123456789012;
  record.time_step = 1e-5;
  record.limited_by = "elastic wave, \"fast\"";
  record.kinetic_energy = 1.0 / 3;
  record.elastic_energy = 2;
  record.gravity_energy = -3;
  record.momentum = {5, 6, 7};
  record.angular_momentum = {8, 9, 10};
  record.center_of_mass = {11, 12, 13};
  record.mass = 14;
  record.volume = 15;
  record.minimum_J = 0.5;
  record.maximum_J = std::numeric_limits<double>::infinity();
  record.maximum_speed = std::nan("");
  record.maximum_damage = 0.75;
  record.damaged_fraction = 0.25;
  record.newton_iterations = 2.5;
  record.linear_iterations = 37.5;
  record.stable_step = 1e-4;
  record.halved_steps = 2;
  record.under_sampled = 0.125;
  record.wall_seconds = 1.5;
  return record;
}

TEST_F(Tables, FramesHaveOneColumnPerFieldUnderAPlainHeader) {
  Writer writer(directory, {}, false);
  writer.record(record());
  std::istringstream table(contents("frames.csv"));
  std::string header, row, more;
  std::getline(table, header);
  std::getline(table, row);
  EXPECT_FALSE(std::getline(table, more));
  EXPECT_EQ(header,
            "frame,time,steps,time_step,limited_by,kinetic_energy,elastic_energy,gravity_energy,"
            "momentum_x,momentum_y,momentum_z,angular_momentum_x,angular_momentum_y,angular_momentum_z,"
            "center_of_mass_x,center_of_mass_y,center_of_mass_z,mass,volume,minimum_J,maximum_J,maximum_speed,"
            "maximum_damage,damaged_fraction,damage_iterations,damage_iterations_most,damage_active,"
            "newton_iterations,linear_iterations,constraint_iterations,constraint_residual,"
            "stable_step,halved_steps,under_sampled,wall_seconds");
  const std::vector<std::string> values = cells(row);
  ASSERT_EQ(values.size(), cells(header).size());
  EXPECT_EQ(values[0], "3");
  EXPECT_EQ(values[2], "123456789012");
  EXPECT_EQ(values[4], "elastic wave, \"fast\"");
  EXPECT_EQ(std::stod(values[5]), 1.0 / 3);
  for (int i = 0; i < 9; ++i) EXPECT_EQ(std::stod(values[static_cast<std::size_t>(8 + i)]), 5 + i);
  EXPECT_EQ(values[20], "inf");
  EXPECT_EQ(values[21], "nan");
  EXPECT_EQ(values[27], "2.5");
  EXPECT_EQ(values[28], "37.5");
  EXPECT_EQ(std::stod(values[31]), 1e-4);
  EXPECT_EQ(values[32], "2");
  EXPECT_EQ(values[33], "0.125");
  EXPECT_EQ(values[34], "1.5");
}

TEST_F(Tables, RowsAreThereAsSoonAsTheyAreRecorded) {
  Writer writer(directory, {}, false);
  for (int rows = 1; rows < 5; ++rows) {
    writer.record(record());
    const std::string table = contents("frames.csv");
    EXPECT_EQ(std::count(table.begin(), table.end(), '\n'), rows + 1);
  }
}

TEST_F(Tables, TheSummaryIsJson) {
  Summary summary;
  summary.status = "done";
  summary.scene = "a \"quoted\"\\path\nwith\tcontrol \x01 and \xc3\xa9 and \xff\xc3";
  summary.particles = 9007199254740993;
  summary.steps = 1234;
  summary.frames = 24;
  summary.simulated_seconds = 1.0 / 3;
  summary.wall_seconds = std::nan("");
  summary.particle_steps_per_second = std::numeric_limits<double>::infinity();
  summary.stage_seconds = {{"particles to grid", 1.5}, {"grid to particles", 2e-20}};
  summary.limits = {{"elastic wave", 1200}, {"frame", 34}};
  summary.integrators = {{"implicit", 34}, {"symplectic", 1200}};
  summary.bytes_per_particle = {{"position", 12}, {"total", 100}};
  summary.plugins = {{"elasticity/split-neo-hookean", "1.0.0", "/lib/a.so", "00ff"}, {"damage/phase-field", "2", "b.so", ""}};
  summary.threads = 2;
  summary.precision = "single";
  summary.isa = "avx2";
  summary.version = "0.1.0";
  Writer(directory, {}, false).summary(summary);

  boost::property_tree::ptree json;
  ASSERT_NO_THROW(boost::property_tree::read_json((directory / "summary.json").string(), json)) << contents("summary.json");
  EXPECT_EQ(json.get<std::string>("status"), "done");
  EXPECT_EQ(json.get<std::string>("scene"), "a \"quoted\"\\path\nwith\tcontrol \x01 and \xc3\xa9 and \xef\xbf\xbd\xef\xbf\xbd");
  EXPECT_EQ(json.get<std::int64_t>("particles"), 9007199254740993);
  EXPECT_EQ(json.get<int>("frames"), 24);
  EXPECT_EQ(json.get<double>("simulated_seconds"), 1.0 / 3);
  EXPECT_EQ(json.get<std::string>("wall_seconds"), "null");
  EXPECT_EQ(json.get<std::string>("particle_steps_per_second"), "null");
  EXPECT_EQ(json.get_child("stage_seconds").get<double>("particles to grid"), 1.5);
  EXPECT_EQ(json.get_child("limits").get<int>("frame"), 34);
  EXPECT_EQ(json.get_child("integrators").get<int>("implicit"), 34);
  EXPECT_EQ(json.get_child("bytes_per_particle").back().first, "total");
  EXPECT_EQ(json.get_child("plugins").size(), 2u);
  EXPECT_EQ(json.get_child("plugins").front().second.get<std::string>("path"), "/lib/a.so");
  EXPECT_EQ(json.get<int>("threads"), 2);
}

TEST_F(Tables, AnEmptySummaryIsJsonToo) {
  Writer(directory, {}, false).summary({});
  boost::property_tree::ptree json;
  EXPECT_NO_THROW(boost::property_tree::read_json((directory / "summary.json").string(), json)) << contents("summary.json");
}

TEST_F(Tables, TextsAreKeptByteForByte) {
  const std::string text("[simulation]\r\n\0end", 18);
  Writer writer(directory, {}, false);
  writer.text("scene.toml", "older and longer than what follows");
  writer.text("scene.toml", text);
  EXPECT_EQ(contents("scene.toml"), text);
}

}  // namespace
}  // namespace cleave::output
