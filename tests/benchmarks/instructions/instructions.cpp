// Counts of instructions against the record, and that what a material does not declare costs it nothing.

#include "count.hpp"

#include <fmt/format.h>
#include <gtest/gtest.h>

#include <cstdio>
#include <ostream>

namespace cleave::instructions {

void PrintTo(const Workload& w, std::ostream* out) { *out << w.name; }

namespace {

constexpr double tolerance = 0.05;

class Guard : public testing::TestWithParam<Workload> {};

TEST_P(Guard, KeepsToTheRecord) {
  if (const std::string reason = obstacle(); !reason.empty()) GTEST_SKIP() << reason;
  const Record record = read_record();
  if (record.compiler != compiler())
    GTEST_SKIP() << "the record is of " << record.compiler << ", this was compiled by " << compiler();
  const auto recorded = record.workloads.find(GetParam().name);
  ASSERT_NE(recorded, record.workloads.end()) << "there is no record of it: ./dev count --record";

  const Count now = count(GetParam());
  const double ratio = now.per_particle() / recorded->second.instructions;
  const std::string said = fmt::format("{:.1f} instructions per particle and step, {:+.2f} % against the record of {:.1f}",
                                       now.per_particle(), 100 * (ratio - 1), recorded->second.instructions);
  fmt::print("{}\n", said);
  EXPECT_LE(ratio, 1 + tolerance) << said << "\n"
                                  << comparison(now, recorded->second)
                                  << "if it has to be so: ./dev count --record, with the reason in the commit";
  if (ratio < 1 - tolerance) fmt::print("the record should be renewed: ./dev count --record\n");
}

INSTANTIATE_TEST_SUITE_P(Instructions, Guard, testing::ValuesIn(guarded()), [](const auto& info) { return info.param.name; });

constexpr const char* both = "elastic_beside_everything.toml";
constexpr const char* cube =
    R"({ name = "cube", material = "elastic", shape = { type = "box", size = [0.09375, 0.09375, 0.09375] }, )"
    R"(velocity = [1.0, 0.3, 0.2], spin = { angular_velocity = [0, 90, 0] } })";
constexpr const char* crumb = R"({ name = "crumb", material = "everything", shape = { type = "box", center = [1, 0, 0], )"
                              R"(size = [0.0078125, 0.0078125, 0.0078125] }, spin = { angular_velocity = [0, 1500, 0] }, )"
                              R"(toughness = { pattern = "noise", size = 0.01, minimum = 0.5, maximum = 2 } })";

/// What the crumb costs is its own: the cube costs what it costs alone.
TEST(FreeWhenAbsent, AnElasticBodyBesideOneThatHasEverything) {
  if (const std::string reason = obstacle(); !reason.empty()) GTEST_SKIP() << reason;
  const Count together = count({"together", both});
  const Count alone = count({"alone", both, {fmt::format("body=[{}]", cube)}});
  const Count other = count({"other", both, {fmt::format("body=[{}]", crumb)}});
  ASSERT_EQ(together.particles, alone.particles + other.particles);
  const double beside = (together.per_step - other.per_step) / alone.particles;
  const std::string said =
      fmt::format("{:.2f} instructions per particle and step alone, {:.2f} beside the other", alone.per_particle(), beside);
  fmt::print("{}; {:.0f} per step of the other alone\n", said, other.per_step);
  EXPECT_NEAR(beside / alone.per_particle(), 1, 0.001) << said;

  // Names of parts have their material's before them where there are two.
  std::map<std::string, double> of_elastic;
  for (const auto& [part, bytes] : together.bytes_per_particle)
    if (const std::string prefix = "elastic: "; part.starts_with(prefix)) of_elastic[part.substr(prefix.size())] = bytes;
  for (const char* part : {"fibre", "damage", "toughness factor", "state variables"})
    EXPECT_TRUE(together.bytes_per_particle.contains(std::string("everything: ") + part)) << part;
  const std::map<std::string, double> expected = {
      {"position", 12}, {"velocity", 12}, {"velocity gradient", 36}, {"rest volume", 4}, {"left Cauchy-Green tensor b", 24}};
  EXPECT_EQ(of_elastic, expected);
  for (const auto& [part, bytes] : expected) EXPECT_EQ(alone.bytes_per_particle.at(part), bytes) << part;
  EXPECT_EQ(alone.bytes_per_particle.at("total"), 92);
}

TEST(ShortName, LeavesArgumentsAndTypesOut) {
  EXPECT_EQ(short_name("v3.so", "void cleave::mpm::(anonymous namespace)::gather<float, 3>(View const&, void*)"),
            "v3.so: cleave::mpm::gather");
  EXPECT_EQ(short_name("p.so", "Batch<(anonymous namespace)::Law, float>::stress(int const*) const"), "p.so: Batch::stress");
  EXPECT_EQ(short_name("p.so", "auto Batch<Law>::pass<true>(int const*) const::{lambda(auto:1)#1}::operator()<int>(int) const"),
            "p.so: Batch::pass::{lambda#1}::operator");
  EXPECT_EQ(short_name("libc.so.6", "__memset_avx2_unaligned_erms"), "libc.so.6: __memset_avx2_unaligned_erms");
}

}  // namespace
}  // namespace cleave::instructions
