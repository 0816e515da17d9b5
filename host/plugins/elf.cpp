#include "plugins/elf.hpp"

#include <elf.h>
#include <link.h>

#include <bit>
#include <cstring>
#include <fstream>
#include <vector>

namespace cleave::plugins {
namespace {

#if defined(__x86_64__)
constexpr ElfW(Half) this_machine = EM_X86_64;
#elif defined(__aarch64__)
constexpr ElfW(Half) this_machine = EM_AARCH64;
#else
constexpr ElfW(Half) this_machine = EM_NONE;
#endif

bool read_at(std::ifstream& file, std::uint64_t offset, void* destination, std::size_t bytes) {
  file.seekg(std::streamoff(offset));
  return bool(file.read(static_cast<char*>(destination), std::streamsize(bytes)));
}

}  // namespace

std::optional<std::string> problem_with_library_file(const std::filesystem::path& path) {
  std::error_code error;
  const std::uint64_t size = std::filesystem::file_size(path, error);
  if (error || !std::filesystem::is_regular_file(path, error)) return "cannot be read";  // a pipe would not end
  std::ifstream file(path, std::ios::binary);
  if (!file) return "cannot be read";

  unsigned char ident[EI_NIDENT] = {};
  if (!read_at(file, 0, ident, sizeof ident) || std::memcmp(ident, ELFMAG, SELFMAG) != 0) return "is not a shared library";
  constexpr unsigned char native_class = sizeof(void*) == 8 ? ELFCLASS64 : ELFCLASS32;
  constexpr unsigned char native_order = std::endian::native == std::endian::little ? ELFDATA2LSB : ELFDATA2MSB;
  if (ident[EI_CLASS] != native_class || ident[EI_DATA] != native_order) return "is built for another kind of processor";

  ElfW(Ehdr) header;
  const auto truncated = [&](std::uint64_t needed) {
    return "is truncated: " + std::to_string(size) + " bytes, its headers describe " + std::to_string(needed);
  };
  if (!read_at(file, 0, &header, sizeof header)) return truncated(sizeof header);
  if (header.e_type != ET_DYN) return "is not a shared library";
  if (this_machine != EM_NONE && header.e_machine != this_machine) return "is built for another kind of processor";

  std::uint64_t needed = header.e_phoff + std::uint64_t(header.e_phnum) * header.e_phentsize;
  if (header.e_phentsize != sizeof(ElfW(Phdr))) return "has damaged headers";
  if (needed > size) return truncated(needed);
  std::vector<ElfW(Phdr)> segments(header.e_phnum);
  if (!read_at(file, header.e_phoff, segments.data(), segments.size() * sizeof(ElfW(Phdr)))) return truncated(needed);
  needed = std::max<std::uint64_t>(needed, header.e_shoff + std::uint64_t(header.e_shnum) * header.e_shentsize);
  for (const auto& segment : segments) {
    if (segment.p_type != PT_LOAD) continue;
    if (segment.p_offset + segment.p_filesz < segment.p_offset) return "has damaged headers";
    needed = std::max<std::uint64_t>(needed, segment.p_offset + segment.p_filesz);
  }
  if (needed > size) return truncated(needed);
  return std::nullopt;
}

}  // namespace cleave::plugins
