#include "../../sanitized.hpp"
#include "program.hpp"
#include "render/image.hpp"
#include "render/movie.hpp"

#include <gmock/gmock.h>

namespace cleave::test {
namespace {

using render::Image;
using testing::HasSubstr;

constexpr const char* falling_ball = R"(
[simulation]
cell_size = 0.1
end_time = 0.1
frame_rate = 40
gravity = [0, -9.81, 0]

[[material]]
name = "jelly"
density = 1000
elasticity = { plugin = "split-neo-hookean", youngs_modulus = 1e4, poissons_ratio = 0.3 }

[[body]]
name = "ball"
material = "jelly"
shape = { type = "sphere", center = [0, 1, 0], radius = 0.5 }

[[collider]]
shape = { type = "half-space", normal = [0, 1, 0] }

[output]
attributes = ["J", "b"]
)";

class Render : public Program {
 protected:
  Outcome run(const std::string& more = "") { return cleave("run ball.toml --out run --quiet " + more); }
  Image picture(const std::string& name) { return render::read_png(directory / name); }

  const fs::path scene = write("ball.toml", falling_ball);
};

TEST_F(Render, DrawsEveryFrameWhateverTheFormat) {
  std::vector<Image> first;
  for (const std::string format : {"vdb", "vtp", "ply"}) {
    ASSERT_EQ(run("--set 'output.formats=[\"" + format + "\"]'").status, 0);
    const Outcome o = cleave("render run --size 160x120 --sheet --out " + format);
    ASSERT_EQ(o.status, 0) << o.err;
    EXPECT_EQ(o.err, "");
    EXPECT_THAT(o.out, HasSubstr("5 pictures of run"));
    for (int n = 0; n < 5; n++) ASSERT_TRUE(fs::exists(directory / format / ("frame_000" + std::to_string(n) + ".png"))) << n;
    const Image sheet = picture(format + "/sheet.png");
    EXPECT_EQ(sheet.width, 3 * 162 - 2);
    EXPECT_EQ(sheet.height, 2 * 122 - 2);
    first.push_back(picture(format + "/frame_0000.png"));
    // The ball, in the colour of the first body, is where it is.
    const auto middle = first.back().at(80, 40);
    EXPECT_GT(middle[2], middle[0] + 60) << format;
    fs::remove_all(directory / "run");
  }
  // Positions of ply are in single precision.
  EXPECT_EQ(first[0].pixels, first[1].pixels);
}

TEST_F(Render, GivesTheSameBitsOnAnyNumberOfThreads) {
  ASSERT_EQ(run().status, 0);
  for (const std::string threads : {"1", "2"})
    ASSERT_EQ(
        cleave("render run --frames 3 --size 160x120 --color velocity --view 60:10 --out t" + threads + " --threads " + threads)
            .status,
        0);
  EXPECT_EQ(contents(directory / "t1/frame_0003.png"), contents(directory / "t2/frame_0003.png"));
  EXPECT_NE(contents(directory / "t1/frame_0003.png"), "");
  EXPECT_FALSE(fs::exists(directory / "t1/frame_0002.png"));
}

TEST_F(Render, ColoursByAnyAttributeInAnyStyle) {
  ASSERT_EQ(run().status, 0);
  std::vector<std::string> pictures;
  for (const std::string options :
       {"--color J", "--color b", "--color body", "--color velocity", "--points", "--zoom 2", "--view top", "--no-labels",
        "--no-colliders", "--palette heat --color J", "--material-space", "--range 0:1 --color J"}) {
    const Outcome o = cleave("render run --frames 4 --size 96x96 --samples 1 --quiet --out p " + options);
    EXPECT_EQ(o.status, 0) << options << o.err;
    EXPECT_EQ(o.out, "");
    pictures.push_back(contents(directory / "p/frame_0004.png"));
  }
  for (std::size_t i = 0; i < pictures.size(); i++)
    for (std::size_t j = 0; j < i; j++) EXPECT_NE(pictures[i], pictures[j]) << i << " and " << j;
}

TEST_F(Render, SaysWhatIsWrong) {
  ASSERT_EQ(run().status, 0);
  fs::create_directory(directory / "empty");
  write("file", "");
  for (const auto& [arguments, message] :
       std::vector<std::pair<std::string, std::string>>{{"nowhere", "there is no directory nowhere"},
                                                        {"empty", "no frames that can be drawn"},
                                                        {"run --color damage", "there are J, b, body, velocity"},
                                                        {"run --color stress", "output.attributes=[\"damage\", \"stress\"]"},
                                                        {"run --color velocty", "Did you mean velocity?"},
                                                        {"run --frames 9", "there are frames 0 to 4"},
                                                        {"run --frames 3:1", "the first and the last"},
                                                        {"run --frames x", "the first and the last"},
                                                        {"run --size 10x10", "1280x720"},
                                                        {"run --size big", "1280x720"},
                                                        {"run --range 3:1", "0:2.5"},
                                                        {"run --view above", "three-quarter"},
                                                        {"run --palette rainbow", "viridis"},
                                                        {"run --points --surface", "--surface"},
                                                        {"run --size 64x64 --frames 0 --out file", "file"}}) {
    const Outcome o = cleave("render " + arguments);
    EXPECT_EQ(o.status, 2) << arguments;
    EXPECT_THAT(o.err, HasSubstr(message)) << arguments;
  }
  if (sanitized) return;  // OpenVDB asks for more memory than there is, which AddressSanitizer takes for an error
  fs::resize_file(directory / "run/points/frame_0002.vdb", 1000);
  const Outcome damaged = cleave("render run --size 64x64 --samples 1");
  EXPECT_EQ(damaged.status, 2);
  EXPECT_THAT(damaged.err, HasSubstr("frame_0002.vdb"));
}

TEST_F(Render, DrawsWithoutTheScene) {
  ASSERT_EQ(run().status, 0);
  fs::remove(directory / "run/scene.toml");
  const Outcome o = cleave("render run --size 64x64 --samples 1 --frames 1:2");
  EXPECT_EQ(o.status, 0);
  EXPECT_THAT(o.err, HasSubstr("warning: colliders are not drawn"));
  EXPECT_TRUE(fs::exists(directory / "run/pictures/frame_0002.png"));
}

TEST_F(Render, MakesFilms) {
  ASSERT_EQ(run().status, 0);
  const Outcome without = cleave("render run --size 64x64 --gif", "PATH=/nonexistent");
  EXPECT_EQ(without.status, 2);
  EXPECT_THAT(without.err, HasSubstr("ffmpeg"));
  EXPECT_FALSE(fs::exists(directory / "run/pictures"));
  if (!render::ffmpeg_is_installed()) GTEST_SKIP() << "ffmpeg is not installed";
  const Outcome o = cleave("render run --size 65x64 --samples 1 --gif --mp4");
  ASSERT_EQ(o.status, 0) << o.err;
  EXPECT_TRUE(contents(directory / "run/pictures/movie.gif").starts_with("GIF8"));
  EXPECT_EQ(contents(directory / "run/pictures/movie.mp4").substr(4, 4), "ftyp");
}

TEST_F(Render, DrawsWhileTheRunGoesOnWithoutChangingIt) {
  ASSERT_EQ(run("--threads 2").status, 0);
  ASSERT_EQ(cleave("run ball.toml --out seen --quiet --threads 2 --preview=2").status, 0);
  for (const std::string name : {"preview/frame_0000.png", "preview/frame_0002.png", "preview/frame_0004.png"})
    EXPECT_EQ(picture("seen/" + name).width, 640) << name;
  EXPECT_FALSE(fs::exists(directory / "seen/preview/frame_0001.png"));
  for (int n = 0; n < 5; n++) {
    const std::string file = "points/frame_000" + std::to_string(n) + ".vdb";
    EXPECT_EQ(contents(directory / "run" / file).substr(64), contents(directory / "seen" / file).substr(64)) << file;
  }
}

}  // namespace
}  // namespace cleave::test
