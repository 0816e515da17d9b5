#include "checkpoint/run_directory.hpp"
#include "checkpoint/scene_changes.hpp"
#include "fuzzing.hpp"

#include <zlib.h>

#include <cstring>

using namespace cleave;

namespace {

/// Sets the checksums of all sections that are whole, so that what stands behind them is reached, too. The first byte of the
/// input says whether.
void renew_checksums(std::string& bytes) {
  constexpr std::size_t file_header = 16, section_header = 16;
  for (std::size_t at = file_header; at + section_header <= bytes.size();) {
    std::uint32_t name = 0;
    std::uint64_t length = 0;
    std::memcpy(&name, &bytes[at], sizeof name);
    std::memcpy(&length, &bytes[at + 8], sizeof length);
    const std::uint64_t left = bytes.size() - at - section_header;
    if (name > left || length > left - name) return;
    const auto* begin = reinterpret_cast<const Bytef*>(bytes.data() + at);
    std::memset(&bytes[at + 4], 0, 4);
    const auto crc = std::uint32_t(crc32_z(0, begin, section_header + name + length));
    std::memcpy(&bytes[at + 4], &crc, sizeof crc);
    at += section_header + name + length;
  }
}

}  // namespace

/// Bytes as the only checkpoint of a run.
extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  if (size == 0) return 0;
  static const fuzz::Directory directory;
  std::string bytes(fuzz::view(data + 1, size - 1));
  if (data[0] % 2 == 1) renew_checksums(bytes);
  directory.write("checkpoints/step_000000000001.checkpoint", bytes);
  return fuzz::expect_input_error([&] {
    std::vector<std::string> problems;
    auto opened = checkpoint::RunCheckpoints(directory.path()).newest(problems);
    if (!opened) return;
    checkpoint::changed_physics(opened->run, opened->run);
    for (const auto& section : opened->state().sections()) {
      checkpoint::Unpacker unpacker(opened->state(), section);
      std::vector<double> numbers;
      std::map<std::string, std::uint64_t> entries;
      std::string text;
      unpacker(numbers, entries, text);
    }
  });
}
