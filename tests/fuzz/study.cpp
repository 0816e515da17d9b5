#include "study/study.hpp"
#include "fake_catalog.hpp"
#include "fuzzing.hpp"

using namespace cleave;

/// Bytes as a study file.
extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  static const fuzz::Directory directory;
  static const config::testing::FakeCatalog catalog;
  const auto file = directory.write("study.toml", fuzz::view(data, size));
  return fuzz::expect_input_error([&] { study::load_study(file, {}, catalog); });
}
