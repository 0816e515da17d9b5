// docs/plugins.md is what the program prints of its own plugins; CLEAVE_UPDATE_DOCS=1 writes it.
#include <gtest/gtest.h>

#include <cstdio>
#include <cstdlib>
#include <fstream>
#include <sstream>
#include <string>

namespace cleave::test {
namespace {

TEST(PluginReference, IsWhatThePluginsDeclare) {
  FILE* pipe = popen("env -u CLEAVE_PLUGIN_PATH '" CLEAVE_PROGRAM "' plugins --markdown", "r");
  ASSERT_NE(pipe, nullptr);
  std::string printed;
  char buffer[4096];
  while (const std::size_t n = std::fread(buffer, 1, sizeof buffer, pipe)) printed.append(buffer, n);
  ASSERT_EQ(pclose(pipe), 0);
  const std::string page = CLEAVE_SOURCE_DIR "/docs/plugins.md";
  if (std::getenv("CLEAVE_UPDATE_DOCS")) std::ofstream(page) << printed;
  std::ostringstream there;
  there << std::ifstream(page).rdbuf();
  EXPECT_EQ(there.str(), printed) << "docs/plugins.md is out of date: run with CLEAVE_UPDATE_DOCS=1";
}

}  // namespace
}  // namespace cleave::test
