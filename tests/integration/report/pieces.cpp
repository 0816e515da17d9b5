// The pieces that a run finds: columns, attribute, and numbers that outlive an interruption.

#include "heart.hpp"

namespace cleave::test {
namespace {

class PiecesOfARun : public Program {};

TEST_F(PiecesOfARun, AreCountedAndKeepTheirNumbersWhenItIsResumed) {
  ASSERT_EQ(cleave(heart("--out whole")).status, 0);
  const auto frames = table(directory / "whole/frames.csv");
  const auto counts = numbers(frames.at("pieces"));
  EXPECT_EQ(counts.front(), 1);
  EXPECT_EQ(counts.back(), 2) << "of the heart there are two halves";
  EXPECT_EQ(frames.count("debris"), 1u);
  ASSERT_EQ(cleave(heart("--out parts --steps 450")).status, 0);
  ASSERT_LT(table(directory / "parts/frames.csv").at("frame").size(), frames.at("frame").size());
  const Outcome resumed = cleave("run parts --resume --quiet --threads 2");
  ASSERT_EQ(resumed.status, 0) << resumed.err;
  EXPECT_EQ(table(directory / "parts/frames.csv").at("pieces"), frames.at("pieces"));
  for (const auto& entry : fs::directory_iterator(directory / "whole/ply")) {
    const fs::path other = directory / "parts/ply" / entry.path().filename();
    EXPECT_TRUE(contents(entry.path()) == contents(other)) << other;
  }
  EXPECT_NE(contents(directory / "whole/ply/frame_0000.ply").find("property float piece\n"), std::string::npos);
}

TEST_F(PiecesOfARun, AreFoundByDamageThatFramesNeedNotHold) {
  ASSERT_EQ(cleave(heart("--out with --frames 22")).status, 0);
  ASSERT_EQ(cleave(heart("--out without --frames 22 --set 'output.attributes=[\"J\"]'")).status, 0);
  EXPECT_EQ(table(directory / "with/frames.csv").at("pieces"), table(directory / "without/frames.csv").at("pieces"));
  const std::string ply = contents(directory / "without/ply/frame_0022.ply");
  EXPECT_EQ(ply.find("property float damage"), std::string::npos);
  EXPECT_EQ(ply.find("property float piece"), std::string::npos);
}

TEST_F(PiecesOfARun, AreThereWithoutDamageOnlyWhereTheyAreAskedFor) {
  const std::string drop =
      "run '" CLEAVE_SOURCE_DIR "/configs/scenes/block_drop_2d.toml' --quiet --frames 1 --set 'output.formats=[\"ply\"]' ";
  ASSERT_EQ(cleave(drop + "--out plain").status, 0);
  EXPECT_EQ(table(directory / "plain/frames.csv").count("pieces"), 0u);
  EXPECT_EQ(contents(directory / "plain/ply/frame_0001.ply").find("piece"), std::string::npos);
  const Outcome asked = cleave(drop + "--out asked --set 'output.attributes=[\"piece\"]'");
  ASSERT_EQ(asked.status, 0) << asked.err;
  EXPECT_EQ(table(directory / "asked/frames.csv").at("pieces").back(), "1");
  EXPECT_NE(contents(directory / "asked/ply/frame_0001.ply").find("property float piece\n"), std::string::npos);
}

TEST_F(PiecesOfARun, ColorWhatTheSceneSays) {
  const Outcome run = cleave(heart("--out run --frames 1 --set 'output.color={ by = \"piece\" }'"));
  ASSERT_EQ(run.status, 0) << run.err;
  EXPECT_NE(contents(directory / "run/ply/frame_0001.ply").find("property uchar red"), std::string::npos);
  EXPECT_EQ(cleave("validate run/scene.toml").status, 0) << "the scene that is written back is one";
  for (const auto& [color, reason] :
       {std::pair("{ by = \"piece\", range = [0, 1] }", "has no effect"), std::pair("{ by = \"pieces\" }", "did you mean"),
        std::pair("{ by = \"J\" }", "range"), std::pair("{ by = \"J\", range = [2, 1] }", "from a smaller value")}) {
    const Outcome refused = cleave(heart(std::string("--out run --set 'output.color=") + color + "'"));
    EXPECT_EQ(refused.status, 2) << color;
    EXPECT_NE(refused.err.find(reason), std::string::npos) << refused.err;
  }
}

}  // namespace
}  // namespace cleave::test
