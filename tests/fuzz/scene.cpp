#include "config/scene.hpp"

#include "config/catalog.hpp"
#include "fake_catalog.hpp"
#include "fuzzing.hpp"

using namespace cleave;

/// Bytes as a scene file; where it is sound, it is written out and has to be sound again.
extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  static const fuzz::Directory directory;
  static const config::testing::FakeCatalog catalog;
  const auto file = directory.write("scene.toml", fuzz::view(data, size));
  return fuzz::expect_input_error([&] { config::load_scene(file, {}, catalog); });
}
