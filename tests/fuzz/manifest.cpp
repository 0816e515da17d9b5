#include "plugins/manifest.hpp"

#include "fuzzing.hpp"
#include "plugins/description.hpp"

using namespace cleave;

/// Bytes as the manifest of a library of one byte.
extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  static const fuzz::Directory directory;
  static const auto library = directory.write("law.so", "x");
  directory.write(plugins::manifest_path(library).filename().string(), fuzz::view(data, size));
  try {
    plugins::read_manifest(library);
  } catch (const plugins::Refusal&) {
  }
  return 0;
}
