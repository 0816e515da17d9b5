#include "fuzzing.hpp"
#include "scene/sampling.hpp"

using namespace cleave;

/// The first byte chooses 2D or 3D, the others are a particle file.
extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  if (size == 0) return 0;
  static const fuzz::Directory directory;
  const auto file = directory.write("particles.csv", fuzz::view(data + 1, size - 1));
  return fuzz::expect_input_error([&] { scene::read_particles(file, 2 + data[0] % 2, 1e-3); });
}
