#include "output/color.hpp"
#include "output/frame.hpp"
#include "run_directory.hpp"

#include <cstdlib>
#include <cstring>
#include <map>
#include <stdexcept>

namespace cleave::output {
namespace {

/// What a layer says of one property.
struct Property {
  std::string type, metadata;
  std::map<double, std::vector<double>> samples;  ///< all numbers of the array, by time code
  std::size_t width = 1;                          ///< numbers of a tuple
};

/// Reads the part of the USDA grammar that layers of points and meshes are made of, and nothing else.
class Usda {
 public:
  explicit Usda(std::string text) : text_(std::move(text)) {
    expect("#usda 1.0");
    metadata = parentheses();
    while (peek()) prim("");
  }
  std::string metadata;
  std::map<std::string, std::string> prims, prim_metadata;  ///< types by path
  std::map<std::string, Property> properties;               ///< by path.name

  const Property& at(const std::string& name) const { return properties.at(name); }

 private:
  void prim(const std::string& parent) {
    expect("def");
    const std::string type = word(), path = parent + '/' + quoted();
    if (!prims.emplace(path, type).second) fail("a prim twice: " + path);
    if (peek() == '(') prim_metadata[path] = parentheses();
    expect("{");
    while (peek() != '}') {
      if (text_.compare(at_, 4, "def ") == 0)
        prim(path);
      else
        property(path);
    }
    expect("}");
  }
  void property(const std::string& path) {
    std::string type = word();
    const bool uniform = type == "uniform";
    if (uniform) type = word();
    std::string name = word();
    const std::string suffix = ".timeSamples";
    const bool sampled = name.ends_with(suffix);
    if (sampled) name.resize(name.size() - suffix.size());
    Property& property = properties[path + '.' + name];
    if (!property.type.empty() && property.type != type) fail("two types: " + name);
    property.type = type;
    if (uniform) {
      expect("=");
      quoted();
    } else if (sampled) {
      expect("=");
      expect("{");
      while (peek() != '}') {
        const double code = number();
        expect(":");
        property.samples[code] = array(property.width);
        expect(",");
      }
      expect("}");
    } else {
      property.metadata = parentheses();
    }
  }
  std::vector<double> array(std::size_t& width) {
    std::vector<double> numbers;
    expect("[");
    while (peek() != ']') {
      if (peek() == '(') {
        expect("(");
        std::size_t count = 1;
        for (numbers.push_back(number()); peek() == ','; count++) {
          expect(",");
          numbers.push_back(number());
        }
        expect(")");
        width = count;
      } else {
        numbers.push_back(number());
      }
      if (peek() == ',') expect(",");
    }
    expect("]");
    return numbers;
  }
  double number() {
    peek();
    char* end = nullptr;
    const double value = std::strtod(text_.c_str() + at_, &end);
    if (end == text_.c_str() + at_) fail("a number is missing");
    at_ = std::size_t(end - text_.c_str());
    return value;
  }
  char peek() {
    while (at_ < text_.size() && std::isspace(static_cast<unsigned char>(text_[at_]))) at_++;
    return at_ < text_.size() ? text_[at_] : '\0';
  }
  void expect(const std::string& what) {
    peek();
    if (text_.compare(at_, what.size(), what) != 0) fail("expected " + what);
    at_ += what.size();
  }
  std::string word() {
    peek();
    const std::size_t begin = at_;
    while (at_ < text_.size() && (std::isalnum(static_cast<unsigned char>(text_[at_])) || std::strchr("_:.[]", text_[at_])))
      at_++;
    if (at_ == begin) fail("a word is missing");
    return text_.substr(begin, at_ - begin);
  }
  std::string quoted() {
    expect("\"");
    const std::size_t begin = at_;
    at_ = text_.find('"', at_) + 1;
    return text_.substr(begin, at_ - 1 - begin);
  }
  std::string parentheses() {
    expect("(");
    const std::size_t begin = at_;
    for (int depth = 1; depth > 0; at_++) {
      if (at_ >= text_.size()) fail("unbalanced parentheses");
      depth += text_[at_] == '(' ? 1 : text_[at_] == ')' ? -1 : 0;
    }
    return text_.substr(begin, at_ - 1 - begin);
  }
  [[noreturn]] void fail(const std::string& what) const { throw std::runtime_error(what + " at: " + text_.substr(at_, 60)); }

  std::string text_;
  std::size_t at_ = 0;
};

struct Usd : RunDirectory {
  Usda layer(const std::string& name) const { return Usda(contents(name)); }
};

ParticleFrame with_mesh(ParticleFrame frame) {
  BodyMesh mesh;
  mesh.body = 1;
  mesh.vertices = {0, 0, 0, 1, 0, 0, 0, 1, 0, 0, 0, 1};
  mesh.velocity.assign(12, 0.5f);
  mesh.damage = {0, 0.25f, 0.5f, 1};
  mesh.piece = {0, 0, 0, -1};
  mesh.pieces = 1;
  mesh.triangles = {0, 1, 2};
  frame.meshes.push_back(mesh);
  return frame;
}

TEST_F(Usd, PointsHoldIdsVelocitiesWidthsColorsAndAttributes) {
  ParticleFrame frame = random_frame(60, 3, 6);
  frame.playback = {48, 2};  // 0.75 s
  Writer writer(directory, {"usd"}, false, nullptr, std::nullopt, false, frame.playback);
  frame.time = 6 / 48.;
  writer.frame(frame);
  const Usda usd = layer("usd/frame_0006.usda");
  for (const char* fact : {"metersPerUnit = 1\n", "upAxis = \"Z\"", "timeCodesPerSecond = 48\n", "defaultPrim = \"cleave\""})
    EXPECT_NE(usd.metadata.find(fact), std::string::npos) << fact;
  EXPECT_EQ(usd.prims.at("/cleave"), "Xform");
  const std::string second = "/cleave/right__half_____rest_";
  for (const auto& [path, begin, end] : {std::tuple(std::string("/cleave/left_half"), 0, 40), std::tuple(second, 40, 60)}) {
    EXPECT_EQ(usd.prims.at(path), "Points");
    const auto values = [&, p = path](const std::string& name, const std::string& type, std::size_t width) {
      const Property& property = usd.at(p + '.' + name);
      EXPECT_EQ(property.type, type) << name;
      EXPECT_EQ(property.width, width) << name;
      EXPECT_EQ(property.samples.size(), 1u) << name;
      return property.samples.at(6);
    };
    const auto ids = values("ids", "int64[]", 1), points = values("points", "point3f[]", 3),
               velocities = values("velocities", "vector3f[]", 3), widths = values("widths", "float[]", 1),
               damage = values("primvars:damage", "float[]", 1), fiber = values("primvars:fiber", "float3[]", 3),
               F = values("primvars:F", "float[]", 1), extent = values("extent", "float3[]", 3);
    ASSERT_EQ(ids.size(), std::size_t(end - begin));
    ASSERT_EQ(F.size(), 9 * ids.size());
    EXPECT_NE(usd.at(path + ".primvars:F").metadata.find("elementSize = 9"), std::string::npos);
    EXPECT_NE(usd.at(path + ".widths").metadata.find("interpolation = \"vertex\""), std::string::npos);
    EXPECT_NE(usd.at(path + ".primvars:displayColor").metadata.find("\"constant\""), std::string::npos);
    for (std::size_t k = 0; k < ids.size(); k++) {
      const auto i = std::size_t(begin) + k;
      EXPECT_EQ(ids[k], double(i));
      EXPECT_NEAR(widths[k], 2 * std::cbrt(3 * frame.volumes[i] / (4 * float(M_PI))), 1e-7);
      EXPECT_EQ(float(damage[k]), frame.attributes[0].values[i]);
      for (std::size_t c = 0; c < 3; c++) {
        EXPECT_EQ(float(points[3 * k + c]), float(frame.positions[i][Eigen::Index(c)]));
        EXPECT_EQ(float(velocities[3 * k + c]), frame.velocities[i][Eigen::Index(c)]);
        EXPECT_EQ(float(fiber[3 * k + c]), frame.attributes[1].values[3 * i + c]);
        EXPECT_LE(extent[c], points[3 * k + c]);
        EXPECT_GE(extent[3 + c], points[3 * k + c]);
      }
      for (std::size_t c = 0; c < 9; c++) EXPECT_EQ(float(F[9 * k + c]), frame.attributes[3].values[9 * i + c]);
    }
  }
}

TEST_F(Usd, SurfacesAreMeshesOfTheirOwnTopology) {
  Writer writer(directory, {"usd"}, false);
  writer.frame(with_mesh(random_frame(30)));
  const Usda usd = layer("usd/frame_0007.usda");
  const std::string path = "/cleave/right__half_____rest__surface";
  EXPECT_EQ(usd.prims.at(path), "Mesh");
  const auto only = [&](const char* name) { return usd.at(path + '.' + name).samples.begin()->second; };
  EXPECT_EQ(only("faceVertexCounts"), std::vector<double>{3});
  EXPECT_EQ(only("faceVertexIndices"), (std::vector<double>{0, 1, 2}));
  EXPECT_EQ(only("points"), (std::vector<double>{0, 0, 0, 1, 0, 0, 0, 1, 0, 0, 0, 1}));
  EXPECT_EQ(only("velocities"), std::vector<double>(12, 0.5));
  EXPECT_EQ(only("primvars:piece"), (std::vector<double>{0, 0, 0, -1}));
  EXPECT_EQ(only("primvars:damage"), (std::vector<double>{0, 0.25, 0.5, 1}));
}

TEST_F(Usd, NumbersThatAreNotFiniteAreUsdsOwn) {
  ParticleFrame frame = random_frame(3);
  const float inf = std::numeric_limits<float>::infinity(), nan = std::numeric_limits<float>::quiet_NaN();
  frame.attributes[0].values = {inf, -inf, std::copysign(nan, -1.f)};
  frame.body_ends = {3, 3};
  Writer(directory, {"usd"}, false).frame(frame);
  EXPECT_NE(contents("usd/frame_0007.usda").find("[inf, -inf, nan]"), std::string::npos);
}

TEST_F(Usd, TheStageBringsEveryFrameAtItsTimeCode) {
  const Playback playback{10, 1};
  Writer writer(directory, {"usd"}, false, nullptr, std::nullopt, false, playback);
  for (const auto& [index, time] : {std::pair(0, 0.), std::pair(1, 0.1), std::pair(2, 0.13)}) {
    ParticleFrame frame = random_frame(12, 3, index);
    frame.playback = playback;
    frame.time = time;
    writer.frame(frame);
    EXPECT_TRUE(layer(std::string("usd/frame_000") + char('0' + index) + ".usda")
                    .at("/cleave/left_half.points")
                    .samples.contains(time * 10));
  }
  const Usda stage = layer("particles.usda");
  for (const char* fact : {"startTimeCode = 0\n", "endTimeCode = 1.3\n", "timeCodesPerSecond = 10\n"})
    EXPECT_NE(stage.metadata.find(fact), std::string::npos) << fact;
  const std::string& clips = stage.prim_metadata.at("/cleave");
  for (const char* fact : {"prepend references = @./usd/frame_0000.usda@</cleave>",
                           "double2[] active = [(0, 0), (1, 1), (1.3, 2)]", "double2[] times = [(0, 0), (1, 1), (1.3, 1.3)]",
                           "asset[] assetPaths = [@./usd/frame_0000.usda@, @./usd/frame_0001.usda@, @./usd/frame_0002.usda@]",
                           "asset manifestAssetPath = @./usd/frame_0000.usda@", "string primPath = \"/cleave\""})
    EXPECT_NE(clips.find(fact), std::string::npos) << fact;
}

TEST_F(Usd, AResumedRunGoesOnWithTheFramesThatAreThere) {
  const auto frame = [](int index) {
    ParticleFrame f = random_frame(12, 3, index);
    f.time = index / 24.;
    return f;
  };
  std::string table;
  {
    Writer writer(directory, {"usd"}, false);
    for (int index = 0; index < 4; index++) {
      writer.frame(frame(index));
      FrameRecord record;
      record.frame = index;
      record.time = index / 24.;
      if (index < 2) writer.record(record);
    }
    table = writer.table();
  }
  const EarlierPart earlier{2, table};
  Writer writer(directory, {"usd"}, false, &earlier);
  const auto clips = [&] { return layer("particles.usda").prim_metadata.at("/cleave"); };
  EXPECT_NE(clips().find("[@./usd/frame_0000.usda@, @./usd/frame_0001.usda@]"), std::string::npos);
  writer.frame(frame(2));
  EXPECT_NE(clips().find("frame_0002.usda@]"), std::string::npos);
}

TEST_F(Usd, ColorsAreTheSameInEveryFormat) {
  ParticleFrame frame = with_mesh(random_frame(30));
  auto& damage = frame.attributes[0].values;
  damage[0] = 0, damage[1] = 1, damage[2] = 2;
  color(frame, {"damage", {}});
  EXPECT_EQ(frame.colors[0], (Color{0x44, 0x01, 0x54}));
  EXPECT_EQ(frame.colors[1], (Color{0xfd, 0xe7, 0x25}));
  EXPECT_EQ(frame.colors[2], frame.colors[1]);
  EXPECT_EQ(frame.meshes[0].colors[3], frame.colors[1]);
  Writer(directory, {"usd", "ply", "vtp"}, false).frame(frame);
  const Usda usd = layer("usd/frame_0007.usda");
  const Property& shown = usd.at("/cleave/left_half.primvars:displayColor");
  EXPECT_NE(shown.metadata.find("vertex"), std::string::npos);
  const auto& linear = shown.samples.begin()->second;
  ASSERT_EQ(linear.size(), 60u);
  EXPECT_NEAR(linear[0], std::pow((0x44 / 255. + 0.055) / 1.055, 2.4), 1e-6);
  EXPECT_NEAR(linear[1], 1 / 255. / 12.92, 1e-8);
  const std::string ply = contents("ply/frame_0007.ply"), vtp = contents("vtp/frame_0007.vtp");
  EXPECT_NE(ply.find("property uchar red\nproperty uchar green\nproperty uchar blue\n"), std::string::npos);
  EXPECT_NE(ply.find(std::string("\x44\x01\x54", 3)), std::string::npos);
  EXPECT_NE(vtp.find("Name=\"Color\" NumberOfComponents=\"3\""), std::string::npos);
}

TEST_F(Usd, ColorsSayWhatTheyLack) {
  ParticleFrame frame = random_frame(30);
  EXPECT_NE(error_of([&] { color(frame, {"demage", {}}); }).find("body, speed, damage, fiber"), std::string::npos);
  EXPECT_NE(error_of([&] { color(frame, {"stress", {}}); }).find("range = [least, most]"), std::string::npos);
  // a symmetric tensor is as large as the matrix it stands for
  frame.attributes[2].values[0] = 3, frame.attributes[2].values[3] = 2;
  for (const std::size_t c : {1, 2, 4, 5}) frame.attributes[2].values[c] = 0;
  color(frame, {"stress", {{0, std::sqrt(9. + 2 * 4.)}}});
  EXPECT_EQ(frame.colors[0], viridis(1));
}

}  // namespace
}  // namespace cleave::output
