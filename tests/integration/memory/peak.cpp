// The memory a whole run takes, measured from outside: per particle what docs/performance.md says.

#include <gtest/gtest.h>

#include <boost/property_tree/json_parser.hpp>
#include <boost/property_tree/ptree.hpp>
#include <cstdlib>
#include <filesystem>
#include <fstream>
#include <string>

#include "../../sanitized.hpp"

namespace cleave::test {
namespace {

namespace fs = std::filesystem;

/// What a frame holds of a particle: positions 24, velocities 12, volumes 4, J 4.
constexpr double frame_bytes = 44;
/// What sorting needs beside the particles: where each comes from, and three of its stored numbers.
constexpr double sort_bytes = 4 + 12;
/// Grid, blocks, and places at the end of tiles that no particle fills.
constexpr double grid_bytes = 12;
/// The program itself, its libraries, scratch of threads.
constexpr double program_bytes = 80e6;

class PeakMemory : public testing::Test {
 protected:
  PeakMemory() {
    std::string name = (fs::temp_directory_path() / "cleave-memory-XXXXXX").string();
    directory = mkdtemp(name.data());
  }
  ~PeakMemory() override { fs::remove_all(directory); }

  /// Runs a cube of a million particles that falls two cells, so that it is sorted. Gives summary.json.
  boost::property_tree::ptree run(const std::string& precision) const {
    std::ofstream(directory / "cube.toml")
        << "[simulation]\ncell_size = 0.008\nend_time = 0.05\nframe_rate = 20\nprecision = \"" << precision
        << "\"\n"
           "[[material]]\nname = \"m\"\ndensity = 1000\n"
           "elasticity = { plugin = \"split-neo-hookean\", youngs_modulus = 1e4, "
           "poissons_ratio = 0.3 }\n"
           "[[body]]\nname = \"cube\"\nmaterial = \"m\"\nvelocity = [0, -1, 0]\n"
           "shape = { type = \"box\", size = [0.4, 0.4, 0.4] }\n"
           "[output]\nformats = [\"ply\"]\n";
    const std::string command =
        "cd '" + directory.string() + "' && '" CLEAVE_PROGRAM "' run cube.toml --threads 2 --out out >log 2>&1";
    EXPECT_EQ(std::system(command.c_str()), 0);
    boost::property_tree::ptree summary;
    boost::property_tree::read_json((directory / "out/summary.json").string(), summary);
    return summary;
  }

  fs::path directory;
};

TEST_F(PeakMemory, IsThatOfParticlesAFrameAndTheScratchOfSorting) {
  if (sanitized) GTEST_SKIP() << "sanitizers keep memory that is given back";
  const auto summary = run("single");
  const auto n = summary.get<double>("particles"), peak = summary.get<double>("peak_memory_bytes");
  ASSERT_GT(n, 9e5);
  EXPECT_GT(summary.get_child("stage_seconds").get<double>("sort"), 1e-3);  // it was sorted
  const auto stored = summary.get_child("bytes_per_particle").get<double>("total");
  EXPECT_EQ(stored, 92);
  EXPECT_GT(peak, n * stored);
  EXPECT_LT(peak, n * (stored + frame_bytes + sort_bytes + grid_bytes) + program_bytes);
}

}  // namespace
}  // namespace cleave::test
