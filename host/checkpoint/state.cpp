#include "checkpoint/state.hpp"

#include "common/error.hpp"

#include <fmt/format.h>
#include <tbb/parallel_for.h>
#include <zlib.h>

#include <algorithm>
#include <array>
#include <bit>

namespace cleave::checkpoint {

static_assert(std::endian::native == std::endian::little, "checkpoints are little endian, as the machine");

namespace {

constexpr std::array<char, 8> magic = {'C', 'L', 'E', 'A', 'V', 'E', 'C', 'P'};
constexpr std::uint32_t longest_name = 4096;
constexpr std::size_t stretch = std::size_t(1) << 20;
constexpr std::size_t stretches_at_once = 16;
const std::string end_name = "end";

struct FileHeader {
  std::array<char, 8> magic;
  std::uint32_t version, reserved;
};
struct SectionHeader {
  std::uint32_t name_length, crc;
  std::uint64_t bytes;
};
static_assert(sizeof(FileHeader) == 16 && sizeof(SectionHeader) == 16);

/// Of the lengths and the name.
std::uint32_t checksum_of_head(const SectionHeader& header, const std::string& name) {
  SectionHeader lengths = header;
  lengths.crc = 0;
  const std::uint32_t crc = checksum(std::as_bytes(std::span(&lengths, 1)));
  return checksum(std::as_bytes(std::span(name)), crc);
}

}  // namespace

std::uint32_t checksum(std::span<const std::byte> bytes, std::uint32_t before) {
  const auto crc = [](std::uint32_t start, std::span<const std::byte> part) {
    return std::uint32_t(crc32_z(start, reinterpret_cast<const Bytef*>(part.data()), part.size()));
  };
  if (bytes.empty()) return before;
  if (bytes.size() <= stretch) return crc(before, bytes);
  const std::size_t parts = (bytes.size() + stretch - 1) / stretch;
  const auto part = [&](std::size_t i) { return bytes.subspan(i * stretch, std::min(stretch, bytes.size() - i * stretch)); };
  std::vector<std::uint32_t> of_part(parts);
  tbb::parallel_for(std::size_t(0), parts, [&](std::size_t i) { of_part[i] = crc(0, part(i)); });
  uLong joined = before;
  for (std::size_t i = 0; i < parts; i++) joined = crc32_combine(joined, of_part[i], z_off_t(part(i).size()));
  return std::uint32_t(joined);
}

StateWriter::StateWriter(std::ostream& out) : out_(out) {
  const FileHeader header{magic, format_version, 0};
  out_.write(reinterpret_cast<const char*>(&header), sizeof header);
}

void StateWriter::section(const std::string& name, std::span<const std::byte> bytes) {
  SectionHeader header{std::uint32_t(name.size()), 0, bytes.size()};
  header.crc = checksum(bytes, checksum_of_head(header, name));
  out_.write(reinterpret_cast<const char*>(&header), sizeof header);
  out_.write(name.data(), std::streamsize(name.size()));
  out_.write(reinterpret_cast<const char*>(bytes.data()), std::streamsize(bytes.size()));
  sections_++;
}

void StateWriter::end() {
  const std::uint64_t count = sections_;
  section(end_name, &count, 1);
}

StateReader::StateReader(std::istream& in, std::string name) : in_(in), name_(std::move(name)) {
  const auto bad = [&](const std::string& what) { throw InputError(name_ + ": " + what); };
  in_.seekg(0, std::ios_base::end);
  const auto end = in_.tellg();
  if (!in_ || end < 0) bad("cannot be read");
  const std::uint64_t size = std::uint64_t(std::streamoff(end));
  std::uint64_t at = 0;
  const auto get = [&](void* to, std::uint64_t count) {
    in_.read(static_cast<char*>(to), std::streamsize(count));
    if (std::uint64_t(in_.gcount()) != count) bad("cannot be read");
    at += count;
  };
  in_.seekg(0);
  FileHeader file{};
  if (size < sizeof file) bad("is no checkpoint: it has " + std::to_string(size) + " bytes");
  get(&file, sizeof file);
  if (file.magic != magic) bad("is no checkpoint");
  if (file.version != format_version)
    bad(fmt::format("has format {}, this program reads format {}", file.version, format_version));

  std::vector<std::byte> buffer;
  for (std::uint64_t count = 0;; count++) {
    SectionHeader header{};
    if (size - at < sizeof header) bad(fmt::format("is cut off after {} bytes", size));
    get(&header, sizeof header);
    if (header.name_length > longest_name)
      bad(fmt::format("is damaged: a name of {} bytes at byte {}", header.name_length, at));
    if (size - at < header.name_length || size - at - header.name_length < header.bytes)
      bad(fmt::format("is cut off after {} bytes", size));
    std::string section(header.name_length, '\0');
    get(section.data(), section.size());
    const std::uint64_t begin = at;
    std::uint32_t crc = checksum_of_head(header, section);
    for (std::uint64_t left = header.bytes; left > 0;) {
      buffer.resize(std::size_t(std::min<std::uint64_t>(left, stretches_at_once * stretch)));
      get(buffer.data(), buffer.size());
      crc = checksum(buffer, crc);
      left -= buffer.size();
    }
    if (crc != header.crc) bad("is damaged: the checksum of section '" + section + "' does not fit");
    if (section == end_name) {
      std::uint64_t expected = 0;
      if (header.bytes == sizeof expected) std::memcpy(&expected, buffer.data(), sizeof expected);
      if (header.bytes != sizeof expected || expected != count) bad("is damaged: sections are missing");
      if (at != size) bad(fmt::format("is damaged: {} bytes follow its end", size - at));
      return;
    }
    if (!sections_.emplace(section, Section{begin, header.bytes}).second)
      bad("is damaged: section '" + section + "' is there twice");
  }
}

std::vector<std::string> StateReader::sections() const {
  std::vector<std::string> names;
  for (const auto& [name, section] : sections_) names.push_back(name);
  return names;
}

const StateReader::Section& StateReader::find(const std::string& section) const {
  const auto found = sections_.find(section);
  if (found == sections_.end()) throw InputError(name_ + ": there is no section '" + section + "'");
  return found->second;
}

void StateReader::refuse(const std::string& section, const std::string& what) const {
  throw InputError(name_ + ": section '" + section + "' " + what);
}

void StateReader::read(const std::string& section, std::span<std::byte> to) {
  const Section& found = find(section);
  if (found.bytes != to.size()) refuse(section, fmt::format("has {} bytes where {} are expected", found.bytes, to.size()));
  in_.clear();
  in_.seekg(std::streamoff(found.at));
  in_.read(reinterpret_cast<char*>(to.data()), std::streamsize(to.size()));
  if (!in_) refuse(section, "cannot be read");
}

std::vector<std::byte> StateReader::read(const std::string& section) {
  std::vector<std::byte> bytes(std::size_t(find(section).bytes));
  read(section, bytes);
  return bytes;
}

std::string StateReader::text(const std::string& section) {
  std::string text(std::size_t(find(section).bytes), '\0');
  read(section, std::as_writable_bytes(std::span(text)));
  return text;
}

}  // namespace cleave::checkpoint
