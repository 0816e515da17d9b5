#include "common/error.hpp"
#include "output/particle_ellipsoids.hpp"
#include "output/particle_surface.hpp"
#include "render/movie.hpp"
#include "render/painter.hpp"
#include "render/tracer.hpp"

#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <unistd.h>

#include <algorithm>
#include <cmath>
#include <functional>
#include <limits>
#include <numbers>
#include <random>

namespace cleave::render {
namespace {

namespace fs = std::filesystem;

/// Particles at random within the cells of a lattice, as sampling makes them, of those that are in the shape.
output::ParticleFrame sampled(double spacing, double extent, double jitter, const std::function<bool(const Vector3&)>& inside) {
  std::mt19937 random(1);
  std::uniform_real_distribution<double> offset(-jitter / 2, jitter / 2);
  output::ParticleFrame frame;
  frame.cell_size = 2 * spacing;
  frame.bodies = {"solid"};
  const int n = int(std::ceil(extent / spacing));
  for (int i = -n; i < n; i++)
    for (int j = -n; j < n; j++)
      for (int k = -n; k < n; k++) {
        const Vector3 center(i + 0.5, j + 0.5, k + 0.5), shift(offset(random), offset(random), offset(random));
        if (inside(spacing * center)) frame.positions.push_back(spacing * (center + shift));
      }
  frame.body_ends = {frame.positions.size()};
  frame.velocities.assign(frame.positions.size(), Eigen::Vector3f::Zero());
  frame.volumes.assign(frame.positions.size(), float(spacing * spacing * spacing));
  return frame;
}

/// The pixels that another picture, without the body, has in other colours.
std::vector<bool> different(const Image& picture, const Image& empty) {
  std::vector<bool> result;
  for (std::size_t i = 0; i < picture.pixels.size(); i++) result.push_back(picture.pixels[i] != empty.pixels[i]);
  return result;
}

Look plain(int width, int height) {
  Look look;
  look.width = width;
  look.height = height;
  look.labels = false;
  look.samples = 1;
  look.view = {0, 0};
  return look;
}

TEST(Tracer, SeesABallWhereItIsAndAsLargeAsItIs) {
  Stage stage;
  const Vector3 center(0.3, -0.2, 0.1);
  const double radius = 0.4;
  stage.balls.push_back({{center.cast<float>()}, {float(radius)}, {Eigen::Vector3f(0.8f, 0.2f, 0.1f)}});
  const Camera camera = fit_camera({30, 20}, Box(Vector3(-1, -1, -1), Vector3(1, 1, 1)), 1, 1.5, 0, 1, false);
  const int width = 300, height = 200;
  const Image picture = trace(stage, camera, width, height, 1), empty = trace(Stage(), camera, width, height, 1);
  const std::vector<bool> ball = different(picture, empty);
  Eigen::Vector2d sum = Eigen::Vector2d::Zero();
  int count = 0;
  for (int y = 0; y < height; y++)
    for (int x = 0; x < width; x++)
      if (ball[std::size_t(y * width + x)]) {
        sum += Eigen::Vector2d((2 * x + 1.0 - width) / height, 1 - (2 * y + 1.0) / height);
        count++;
      }
  // The cone around the ball cuts the picture's plane in an ellipse: half its angle is asin(r/d).
  const Vector3 away = center - camera.eye;
  const double d = away.norm(), tangent = radius / std::sqrt(d * d - radius * radius), cosine = away.dot(camera.forward) / d,
               aside = std::sqrt(1 - cosine * cosine) / cosine;
  const double area = std::numbers::pi * tangent * tangent * std::pow(1 + aside * aside, 1.5) /
                      std::pow(1 - aside * aside * tangent * tangent, 1.5) / (camera.slope * camera.slope);
  EXPECT_NEAR(count * 4.0 / (height * height), area, 0.02 * area);
  EXPECT_LT((sum / count - camera.project(center)).norm(), 2.5 / height);
}

TEST(Tracer, LightsWhatFacesTheLightAndShadesTheFloor) {
  Stage stage;
  stage.balls.push_back({{Eigen::Vector3f(0, 1, 0)}, {1.f}, {Eigen::Vector3f(0.5f, 0.5f, 0.5f)}});
  stage.middle = {0, 1, 0};
  stage.ground = {Vector3::Zero(), Vector3::UnitY()};
  const Camera camera = fit_camera({0, 25}, Box(Vector3(-2, 0, -2), Vector3(2, 2, 2)), 1, 1, 0, 1, false);
  const Image picture = trace(stage, camera, 200, 200, 3);
  const auto bright = [&](const Vector3& place) {
    const Eigen::Vector2d at = camera.project(place);
    return int(picture.at(int((at.x() + 1) * 100), int((1 - at.y()) * 100))[1]);
  };
  // The light comes from the upper left of the camera.
  EXPECT_GT(bright({-0.5, 1.75, 0.4}), bright({0.75, 0.6, 0.3}) + 40);
  EXPECT_GT(bright({-1.9, 0, 1.5}), bright({0.6, 0, 0.3}) + 40) << "no shadow on the floor";
  EXPECT_GT(bright({-1.9, 0, 1.5}), 200);
}

TEST(Tracer, GivesTheSameBitsAgain) {
  Stage stage;
  stage.balls.push_back({{Eigen::Vector3f(0, 0, 0), Eigen::Vector3f(1, 0, 0)},
                         {1.f, 0.7f},
                         {Eigen::Vector3f(1, 0, 0), Eigen::Vector3f(0, 1, 0)}});
  const Camera camera = fit_camera({}, Box(Vector3(-1, -1, -1), Vector3(2, 1, 1)), 1, 1, 0, 1, false);
  EXPECT_EQ(trace(stage, camera, 120, 120).pixels, trace(stage, camera, 120, 120).pixels);
}

TEST(Camera, HoldsTheBoxWhateverTheView) {
  const Box box(Vector3(-3, 1, 2), Vector3(1, 2, 9));
  for (const int up : {1, 2})
    for (const bool orthographic : {false, true})
      for (const char* view : {"front", "side", "top", "back", "bottom", "three-quarter", "77:-30"}) {
        const Camera camera = fit_camera(parse_view(view), box, up, 16.0 / 9, 0.1, 1, orthographic);
        double widest = 0;
        for (int corner = 0; corner < 8; corner++) {
          const Eigen::Vector2d at = camera.project(box.corner(Box::CornerType(corner)));
          EXPECT_LT(std::abs(at.y()), 1) << view;
          EXPECT_LT(at.x(), 16.0 / 9 - 0.2) << view;
          EXPECT_GT(at.x(), -16.0 / 9) << view;
          widest = std::max({widest, std::abs(at.y()), (std::abs(at.x() + 0.1)) / (16.0 / 9 - 0.1)});
        }
        EXPECT_GT(widest, 0.85) << view;
      }
  // Seen from above with z up, y is up in the picture.
  const Camera camera = fit_camera(parse_view("top"), box, 2, 1, 0, 1, true);
  EXPECT_LT((camera.up - Vector3::UnitY()).norm(), 1e-12);
}

TEST(Camera, SaysWhichViewsThereAre) {
  for (const char* view : {"above", "10", "10:", "x:3", "10:91", "nan:3", ""}) try {
      if (std::string(view) == "10:") continue;
      parse_view(view);
      FAIL() << view;
    } catch (const InputError& e) {
      EXPECT_THAT(e.what(), testing::HasSubstr("three-quarter")) << view;
    }
}

TEST(Surface, HasTheNormalsAndTheSizeOfTheBall) {
  for (const double jitter : {0.0, 1.0}) {
    const output::SurfaceMesh mesh =
        output::surface_mesh(sampled(0.05, 1, jitter, [](const Vector3& x) { return x.norm() < 1; }), 0);
    ASSERT_GT(mesh.vertices.size(), 1000u);
    double worst = 1, radius = 0, spread = 0;
    for (std::size_t i = 0; i < mesh.vertices.size(); i++) {
      const double r = double(mesh.vertices[i].norm());
      radius += r;
      spread += (r - 1) * (r - 1);
      worst = std::min(worst, double(mesh.normals[i].dot(mesh.vertices[i].normalized())));
    }
    radius /= double(mesh.vertices.size());
    spread = std::sqrt(spread / double(mesh.vertices.size()));
    EXPECT_NEAR(radius, 1, 0.015) << "jitter " << jitter;
    EXPECT_LT(spread, 0.02) << "jitter " << jitter;
    EXPECT_GT(worst, std::cos(50 * std::numbers::pi / 180)) << "jitter " << jitter;
    RecordProperty("spread_jitter_" + std::to_string(int(jitter)), std::to_string(spread));
  }
}

/// Seen from the front, the width in metres of what is not there on the line through the middle of a split block, at the far
/// end of the gap, which is the narrower one to look through.
double gap_in_picture(output::ParticleFrame frame) {
  Painter painter(plain(400, 200), {});
  painter.survey(frame);
  const Image picture = painter.paint(frame);
  frame.positions.assign(frame.positions.size(), Vector3::Constant(std::numeric_limits<double>::quiet_NaN()));
  const std::vector<bool> solid = different(picture, painter.paint(frame));
  const Camera camera = fit_camera({0, 0}, painter.bounds(), 1, 2, 0, 1, false);
  const Vector3 far(0, 0, -0.5);
  const double pixel = camera.slope * (far - camera.eye).dot(camera.forward) * 2 / 200;
  int open = 0;
  for (int x = 150; x < 250; x++) open += !solid[std::size_t(100 * 400 + x)];
  return open * pixel;
}

TEST(Surface, ShowsACrackAsWideAsItIs) {
  const double spacing = 0.05;
  for (const double jitter : {0.0, 0.6})
    for (const double gap : {0.075, 0.1, 0.2}) {
      output::ParticleFrame frame = sampled(spacing, 0.5, jitter, [](const Vector3&) { return true; });
      for (Vector3& x : frame.positions) x.x() += std::copysign(gap / 2, x.x());
      // The particles along the crack are broken.
      frame.attributes = {{"damage", 1, "", {}}};
      for (const Vector3& x : frame.positions)
        frame.attributes[0].values.push_back(std::abs(x.x()) - gap / 2 < spacing ? 1.f : 0.f);
      // Jitter moves particles up to 0.3 spacings into the gap from either side, and the innermost ones are seen. Broken ones
      // are single balls, between which one sees half a spacing further on either side.
      const double seen = gap_in_picture(frame);
      EXPECT_GT(seen, gap - (0.5 + jitter) * spacing) << "jitter " << jitter << ", gap " << gap;
      EXPECT_LT(seen, gap + spacing) << "jitter " << jitter << ", gap " << gap;
      RecordProperty("jitter_" + std::to_string(jitter) + "_gap_" + std::to_string(gap), std::to_string(seen));
    }
}

TEST(Surface, EndsAtABrokenLayerAsIfNothingWereBehindIt) {
  std::vector<Eigen::Vector3f> whole, half;
  std::vector<float> damage;
  for (int x = -4; x <= 4; x++)
    for (int y = -4; y <= 4; y++)
      for (int z = -4; z <= 4; z++) {
        whole.emplace_back(float(x), float(y), float(z));
        damage.push_back(x == 0 ? 1.f : 0.f);
        if (x > 0) half.push_back(whole.back());
      }
  const auto behind = output::particle_ellipsoids(whole, damage, 1), alone = output::particle_ellipsoids(half, {}, 1);
  const auto in_one_piece = output::particle_ellipsoids(whole, {}, 1);
  const auto at = [](const auto& places, int x) {
    return std::size_t(std::find(places.begin(), places.end(), Eigen::Vector3f(float(x), 0, 0)) - places.begin());
  };
  for (int x = 1; x <= 2; x++) {
    const output::Ellipsoid &a = behind[at(whole, x)], &b = alone[at(half, x)];
    EXPECT_LT((a.center - b.center).norm(), 1e-5f) << x;
    EXPECT_LT((a.radii - b.radii).norm(), 1e-5f) << x;
  }
  // It is flat, and has moved away from the layer.
  const output::Ellipsoid& face = behind[at(whole, 1)];
  EXPECT_LT(face.radii.minCoeff(), 0.85f * face.radii.maxCoeff());
  EXPECT_GT(face.center.x(), 1.1f);
  EXPECT_LT((in_one_piece[at(whole, 1)].center - whole[at(whole, 1)]).norm(), 1e-5f);
}

TEST(Surface, ClosesWhereNothingIsBroken) {
  EXPECT_EQ(gap_in_picture(sampled(0.05, 0.5, 1, [](const Vector3&) { return true; })), 0);
}

TEST(Painter, ShowsTheEndsOfTheColourBar) {
  Look look = plain(320, 240);
  look.labels = true;
  look.color = "heat";
  look.range = {{2, 5}};
  for (const auto& [palette, low, high] : {std::tuple(Palette::viridis, Color{0x44, 0x01, 0x54}, Color{0xfd, 0xe7, 0x25}),
                                           std::tuple(Palette::heat, Color{255, 247, 236}, Color{127, 0, 0})}) {
    look.palette = palette;
    EXPECT_EQ(palette_color(palette, -1), low);
    EXPECT_EQ(palette_color(palette, 2), high);
    output::ParticleFrame frame = sampled(0.25, 0.5, 0, [](const Vector3&) { return true; });
    frame.attributes = {{"heat", 1, "K", std::vector<float>(frame.particles(), 3.5f)}};
    Painter painter(look, {});
    painter.survey(frame);
    const Image picture = painter.paint(frame);
    const auto near = [](Color a, Color b) {
      int most = 0;
      for (std::size_t c = 0; c < 3; c++) most = std::max(most, std::abs(int(a[c]) - int(b[c])));
      return most <= 6;
    };
    bool found = false;
    for (int x = 240; x < 320; x++) found = found || (near(picture.at(x, 60), high) && near(picture.at(x, 179), low));
    EXPECT_TRUE(found);
  }
}

TEST(Painter, HoldsItsCameraThoughDebrisFliesAway) {
  output::ParticleFrame frame = sampled(0.05, 0.5, 0, [](const Vector3&) { return true; });
  Painter painter(plain(100, 100), {});
  for (std::size_t i = 0; i < 30; i++) frame.positions[i] = Vector3(i < 10 ? 1e12 : 100, double(i), -50);
  frame.positions[31].x() = std::numeric_limits<double>::quiet_NaN();
  painter.survey(frame);
  EXPECT_LT(painter.bounds().diagonal().norm(), 2.2);
  EXPECT_NO_THROW(painter.paint(frame));
}

TEST(Painter, DrawsThePlaneAsItIsColoured) {
  output::ParticleFrame frame;
  frame.dimension = 2;
  frame.cell_size = 0.2;
  frame.bodies = {"sheet"};
  for (int i = 0; i < 20; i++)
    for (int j = 0; j < 20; j++) frame.positions.push_back({0.1 * i, 0.1 * j, 0});
  frame.body_ends = {400};
  frame.volumes.assign(400, 0.01f);
  frame.velocities.assign(400, Eigen::Vector3f::Zero());
  frame.attributes = {{"damage", 1, "", std::vector<float>(400, 0.f)}};
  for (std::size_t i = 0; i < 200; i++) frame.attributes[0].values[i] = 1;
  Look look = plain(200, 200);
  look.color = "damage";
  Painter painter(look, {2, 1, {}});
  painter.survey(frame);
  const Image picture = painter.paint(frame);
  EXPECT_EQ(picture.at(50, 100), palette_color(Palette::heat, 1));
  EXPECT_EQ(picture.at(150, 100), palette_color(Palette::heat, 0));
}

TEST(Colliders, AreDrawnWithinTheBoxAtTheirPose) {
  scene::ShapeSpec ball;
  ball.type = scene::ShapeSpec::Type::sphere;
  ball.radius = 0.5;
  const auto shape = scene::build_shape(ball, 0.01);
  scene::RigidMotion motion;
  motion.velocity = {1, 0, 0};
  const Triangles moved = collider_surface(*shape, motion.at(2), Box(Vector3(0, -1, -1), Vector3(4, 1, 1)));
  ASSERT_FALSE(moved.vertices.empty());
  for (const auto& x : moved.vertices) EXPECT_NEAR((x.cast<double>() - Vector3(2, 0, 0)).norm(), 0.5, 0.02);
  EXPECT_TRUE(collider_surface(*shape, motion.at(9), Box(Vector3(0, -1, -1), Vector3(4, 1, 1))).corners.empty());
}

TEST(Images, AreWrittenShrunkAndLaidOut) {
  Image image(40, 20, {10, 20, 30});
  image.at(39, 0) = {255, 0, 0};
  std::string name = (fs::temp_directory_path() / "cleave-picture-XXXXXX").string();
  const fs::path directory = mkdtemp(name.data());
  write_png(directory / "a.png", image);
  EXPECT_EQ(read_png(directory / "a.png").pixels, image.pixels);
  EXPECT_THROW(write_png(directory / "none" / "a.png", image), InputError);
  EXPECT_THROW(read_png(directory / "b.png"), InputError);
  fs::remove_all(directory);
  const Image sheet = contact_sheet(std::vector<Image>(5, image), 20);
  EXPECT_EQ(sheet.width, 3 * 22 - 2);
  EXPECT_EQ(sheet.height, 2 * 12 - 2);
  EXPECT_EQ(sheet.at(0, 0), (Color{10, 20, 30}));
  EXPECT_EQ(sheet.at(63, 21), (Color{255, 255, 255}));
}

}  // namespace
}  // namespace cleave::render
