// `cleave report`: the page holds what the run left, by itself, and a browser shows it.

#include "heart.hpp"

#include <nlohmann/json.hpp>

#include <boost/beast/core/detail/base64.hpp>
#include <cmath>
#include <set>

namespace cleave::test {
namespace {

using Json = nlohmann::json;

class Report : public Program {
 protected:
  Json data_of(const std::string& page) const {
    const std::string text = contents(directory / page), begin = "<script type=\"application/json\" id=\"run\">";
    const std::size_t at = text.find(begin) + begin.size();
    return Json::parse(text.substr(at, text.find("</script>", at) - at));
  }
  Json report(const std::string& arguments, const std::string& page) const {
    const Outcome outcome = cleave("report " + arguments);
    EXPECT_EQ(outcome.status, 0) << outcome.err;
    return data_of(page);
  }
  static std::string bytes_of(const std::string& base64) {
    namespace codec = boost::beast::detail::base64;
    std::string bytes(codec::decoded_size(base64.size()), '\0');
    bytes.resize(codec::decode(bytes.data(), base64.data(), base64.size()).first);
    return bytes;
  }
  /// The page as a browser leaves it, "" without one.
  std::string in_browser(const std::string& page) const {
    if (std::system("command -v chromium >/dev/null") != 0) return "";
    const std::string command =
        "cd '" + directory.string() +
        "' && timeout 120 chromium --headless --no-sandbox --use-gl=angle --use-angle=swiftshader "
        "--enable-unsafe-swiftshader --window-size=1200,1600 --virtual-time-budget=10000 --user-data-dir=profile "
        "--host-resolver-rules='MAP * ~NOTFOUND' --dump-dom file://" +
        (directory / page).string() + " >dom.html 2>chromium.txt";
    EXPECT_EQ(std::system(command.c_str()), 0) << contents(directory / "chromium.txt");
    return contents(directory / "dom.html");
  }
  static double number_in(const std::string& dom, const std::string& attribute) {
    const std::size_t at = dom.find(attribute + "=\"");
    return at == std::string::npos ? NAN : std::strtod(dom.c_str() + at + attribute.size() + 2, nullptr);
  }
  static std::size_t count(const std::string& text, const std::string& what) {
    std::size_t n = 0;
    for (std::size_t at = text.find(what); at != std::string::npos; at = text.find(what, at + 1)) n++;
    return n;
  }
};

TEST_F(Report, HoldsWhatTheRunLeftAndABrowserShowsIt) {
  ASSERT_EQ(cleave(heart("--out run")).status, 0);
  const Json data = report("run --points 3000 --frames 5", "run/report.html");
  const auto frames = table(directory / "run/frames.csv");
  const auto summary = Json::parse(contents(directory / "run/summary.json"));
  EXPECT_EQ(data["state"], "done");
  EXPECT_EQ(data["title"], "broken_heart");
  EXPECT_EQ(data["summary"], summary);
  EXPECT_EQ(data["scene"], contents(directory / "run/scene.toml"));
  for (const char* column : {"time", "kinetic_energy", "momentum_x", "damaged_fraction", "pieces"})
    EXPECT_EQ(data["table"][column].get<std::vector<double>>(), numbers(frames.at(column))) << column;
  EXPECT_EQ(data["table"]["limited_by"].get<std::vector<std::string>>(), frames.at("limited_by"));

  const Json& points = data["points"];
  EXPECT_EQ(points["total"], summary["particles"]);
  EXPECT_EQ(points["shown"], 3000);
  ASSERT_EQ(points["frames"].size(), 5u);
  EXPECT_EQ(points["frames"].front()["index"], 0);
  EXPECT_EQ(points["frames"].back()["index"], std::stoi(frames.at("frame").back()));
  EXPECT_EQ(points["attributes"][0]["name"], "damage");
  EXPECT_EQ(points["attributes"][1]["name"], "piece");
  const std::string last = bytes_of(points["frames"].back()["data"]);
  ASSERT_EQ(last.size(), 3000 * (6 + points["attributes"].size()));
  double mean = 0, damaged = 0;
  std::set<int> pieces;
  for (std::size_t i = 0; i < 3000; i++) {
    const auto at = [&](std::size_t byte) { return double(static_cast<unsigned char>(last[byte])); };
    mean += (at(6000 + 2 * i) + 256 * at(6000 + 2 * i + 1)) / 65535 / 3000;
    damaged += (at(18000 + i) > 127.5) / 3000.;
    pieces.insert(int(at(21000 + i)));
  }
  // the sample is the body, but for what chance makes of 3000 of its particles
  const double y = points["low"][1].get<double>() + mean * (points["high"][1].get<double>() - points["low"][1].get<double>());
  EXPECT_NEAR(y, numbers(frames.at("center_of_mass_y")).back(),
              0.05 * (points["high"][1].get<double>() - points["low"][1].get<double>()));
  EXPECT_NEAR(damaged, numbers(frames.at("damaged_fraction")).back(), 0.03);
  EXPECT_GE(pieces.size(), 2u);
  EXPECT_LE(pieces.size(), 3u) << "two halves, and debris";

  const std::string page = contents(directory / "run/report.html");
  EXPECT_EQ(count(page, "http"), 1u) << "the name of SVG is the only address";
  EXPECT_EQ(count(page, "src=\""), 0u);
  ASSERT_EQ(cleave("report run --points 3000 --frames 5 --out again.html").status, 0);
  EXPECT_TRUE(contents(directory / "again.html") == page);

  const std::string dom = in_browser("run/report.html");
  if (dom.empty()) GTEST_SKIP() << "there is no chromium to show the page";
  EXPECT_NE(dom.find("data-state=\"drawn\""), std::string::npos);
  EXPECT_EQ(number_in(dom, "data-points"), 3000);
  EXPECT_GT(number_in(dom, "data-covered"), 0.01) << "part of the view that is not background";
  EXPECT_LT(number_in(dom, "data-covered"), 0.8);
  EXPECT_GE(count(dom, "<svg"), 9u);
  EXPECT_EQ(count(dom, "NaN"), 0u);
  EXPECT_NE(dom.find("elasticity/qr"), std::string::npos);
}

constexpr const char* block = R"(
[simulation]
dimension = 2
cell_size = 0.1
end_time = 0.5
frame_rate = 20
gravity = [0, -200]
[[material]]
name = "rubber"
density = 1000
elasticity = { plugin = "split-neo-hookean", youngs_modulus = 1e5, poissons_ratio = 0.3 }
[[body]]
name = "block"
material = "rubber"
shape = { type = "box", center = [0, 0.5], size = [0.6, 0.6] }
[output]
formats = ["vtp"]
)";

TEST_F(Report, ShowsWhyARunFailed) {
  write("scene.toml", block + std::string("[[collider]]\nshape = { type = \"half-space\", normal = [0, 1] }\n"));
  ASSERT_EQ(cleave("run scene.toml --out run --set simulation.time_step=2e-3 --set 'body.block.velocity=[0,-50]' "
                   "--set material.rubber.elasticity.youngs_modulus=1e9")
                .status,
            3);
  const Json data = report("run", "run/report.html");
  EXPECT_EQ(data["state"], "failed");
  EXPECT_EQ(data["failure"], contents(directory / "run/failure.txt"));
  const std::string dom = in_browser("run/report.html");
  if (dom.empty()) GTEST_SKIP() << "there is no chromium to show the page";
  const std::size_t shown = dom.find("<section id=\"failure\">");
  ASSERT_NE(shown, std::string::npos);
  EXPECT_NE(dom.find("block", shown), std::string::npos);
}

TEST_F(Report, IsOfARunThatGoesOnToo) {
  write("scene.toml", block);
  ASSERT_EQ(cleave("run scene.toml --out run --frames 3").status, 0);
  fs::remove(directory / "run/summary.json");
  std::string rows = contents(directory / "run/frames.csv");
  rows.resize(rows.size() - 5);  // the last one is being written
  write("run/frames.csv", rows);
  write("run/scene.toml", "# </script><b>\n");  // text of others does not become markup
  const Json data = report("run --out page.html", "page.html");
  EXPECT_EQ(data["state"], "running");
  EXPECT_TRUE(data["summary"].is_null());
  EXPECT_EQ(data["table"]["frame"], (std::vector<int>{0, 1, 2}));
  EXPECT_EQ(data["scene"], "# </script><b>\n");
  EXPECT_EQ(data["points"]["frames"].size(), 4u);
}

TEST_F(Report, IsOfDiscretizedBodiesAndOfRunsWithoutFrames) {
  const Outcome run = cleave("run '" CLEAVE_SOURCE_DIR "/configs/scenes/fem_bar_swing.toml' --out fem --steps 20 --quiet");
  ASSERT_EQ(run.status, 0) << run.err;
  EXPECT_GT(report("fem", "fem/report.html")["points"]["shown"], 100);
  write("scene.toml", block);
  ASSERT_EQ(cleave("run scene.toml --out none --frames 1 --set 'output.formats=[]'").status, 0);
  EXPECT_TRUE(report("none", "none/report.html")["points"].is_null());
}

TEST_F(Report, RefusesWhatIsNoRun) {
  const Outcome outcome = cleave("report .");
  EXPECT_EQ(outcome.status, 2);
  EXPECT_NE(outcome.err.find("frames.csv"), std::string::npos) << outcome.err;
  EXPECT_FALSE(fs::exists(directory / "report.html"));
}

}  // namespace
}  // namespace cleave::test
