#include "common/error.hpp"
#include "fake_catalog.hpp"

#include <gtest/gtest.h>

#include <algorithm>
#include <filesystem>
#include <fstream>
#include <sstream>

namespace cleave::config {
namespace {

const std::filesystem::path folder = std::filesystem::path(CLEAVE_SOURCE_DIR) / "tests/fixtures/configs/bad";

/// What a fixture says of itself: "# expect: LINE" (a message, {file} and {directory} filled in; one that starts with a number
/// stands in the file itself) and "# set: path=value".
struct Fixture {
  std::vector<std::string> expected;
  std::vector<Override> overrides;
};

std::string filled_in(std::string text, const std::filesystem::path& file) {
  if (!text.empty() && text[0] >= '0' && text[0] <= '9') text = "{file}:" + text;
  for (const auto& [mark, value] :
       {std::pair<std::string, std::string>{"{file}", file.string()}, {"{directory}", file.parent_path().string()}})
    for (auto at = text.find(mark); at != std::string::npos; at = text.find(mark, at + value.size()))
      text.replace(at, mark.size(), value);
  return text;
}

Fixture read_fixture(const std::filesystem::path& file) {
  Fixture fixture;
  std::ifstream in(file);
  for (std::string line; std::getline(in, line);) {
    const std::string expect = "# expect: ", set = "# set: ";
    if (line.rfind(expect, 0) == 0) fixture.expected.push_back(filled_in(line.substr(expect.size()), file));
    if (line.rfind(set, 0) == 0) fixture.overrides.push_back(parse_override(line.substr(set.size())));
  }
  return fixture;
}

std::vector<std::string> fixture_names() {
  std::vector<std::string> names;
  for (const auto& entry : std::filesystem::directory_iterator(folder))
    if (entry.path().extension() == ".toml") names.push_back(entry.path().stem().string());
  std::sort(names.begin(), names.end());
  return names;
}

std::vector<std::string> errors_of(const std::filesystem::path& file, const std::vector<Override>& overrides) {
  std::vector<std::string> lines;
  try {
    load_scene(file, overrides, testing::FakeCatalog());
  } catch (const InputError& error) {
    std::istringstream text(error.what());
    for (std::string line; std::getline(text, line);) lines.push_back(line);
  }
  return lines;
}

class BadScene : public ::testing::TestWithParam<std::string> {};

TEST_P(BadScene, IsRefusedWithExactlyTheseMessages) {
  const std::filesystem::path file = folder / (GetParam() + ".toml");
  const Fixture fixture = read_fixture(file);
  ASSERT_FALSE(fixture.expected.empty()) << "the fixture expects nothing";
  EXPECT_EQ(errors_of(file, fixture.overrides), fixture.expected);
}

INSTANTIATE_TEST_SUITE_P(Fixture, BadScene, ::testing::ValuesIn(fixture_names()), [](const auto& info) {
  std::string name = info.param;
  std::replace_if(
      name.begin(), name.end(), [](char c) { return !std::isalnum(static_cast<unsigned char>(c)); }, '_');
  return name;
});

TEST(BadSceneSuite, HasAtLeastFortyFixtures) { EXPECT_GE(fixture_names().size(), 40u); }

TEST(BadSceneFile, ThatIsNotThereIsNamed) {
  EXPECT_EQ(errors_of("nowhere/scene.toml", {}), std::vector<std::string>{"nowhere/scene.toml: error: there is no such file"});
}

TEST(BadSceneFile, ThatIsADirectoryIsNamed) {
  EXPECT_EQ(errors_of(folder, {}), std::vector<std::string>{folder.string() + ": error: is a directory, not a scene file"});
}

TEST(BadSceneFile, LargerThanAnySceneIsRefusedUnread) {
  const auto file = std::filesystem::temp_directory_path() / ("cleave-large-" + std::to_string(getpid()) + ".toml");
  std::ofstream(file).put('\n');
  std::filesystem::resize_file(file, (64u << 20) + 1);
  const auto errors = errors_of(file, {});
  std::filesystem::remove(file);
  EXPECT_EQ(errors, std::vector<std::string>{
                        file.string() +
                        ": error: the file is larger than 64 MiB, which no scene needs; put particles into a CSV file"});
}

TEST(BadSceneFile, WithInvalidUtf8SaysWhere) {
  const auto file = std::filesystem::temp_directory_path() / ("cleave-utf8-" + std::to_string(getpid()) + ".toml");
  std::ofstream(file) << "[simulation]\nname = \"\xff\xfe\"\n";
  const auto errors = errors_of(file, {});
  std::filesystem::remove(file);
  ASSERT_EQ(errors.size(), 1u);
  EXPECT_EQ(errors[0].rfind(file.string() + ":2:", 0), 0u) << errors[0];
}

class EmptyCatalog : public PluginCatalog {
 public:
  const plugins::Description* find(std::string_view) const override { return nullptr; }
  std::vector<std::string> ids(plugins::Kind) const override { return {}; }
  std::vector<std::filesystem::path> search_path() const override { return {"/opt/laws"}; }
};

TEST(BadScene, WithoutAnyPluginSaysWherePluginsWereLookedFor) {
  const auto file = std::filesystem::path(CLEAVE_SOURCE_DIR) / "tests/fixtures/configs/good/minimal.toml";
  try {
    load_scene(file, {}, EmptyCatalog());
    FAIL() << "was accepted";
  } catch (const InputError& error) {
    EXPECT_EQ(std::string(error.what()),
              file.string() +
                  ":8:25: error: there is no elasticity plugin 'neo-hookean': no plugin was found at all "
                  "(looked in /opt/laws; CLEAVE_PLUGIN_PATH adds directories)");
  }
}

}  // namespace
}  // namespace cleave::config
