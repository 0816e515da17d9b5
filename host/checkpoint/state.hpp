#pragma once

#include <concepts>
#include <cstddef>
#include <cstdint>
#include <cstring>
#include <istream>
#include <map>
#include <ostream>
#include <span>
#include <string>
#include <type_traits>
#include <utility>
#include <vector>

namespace cleave::checkpoint {

/// The state of a simulation as named sections of bytes, in the machine's byte order:
///
///   "CLEAVECP", uint32 version, uint32 0
///   sections: uint32 length of the name, uint32 crc, uint64 bytes, name, bytes
///   a last one of the name "end", whose 8 bytes are the number of sections before it
///
/// A crc is the CRC-32 of zlib, of the two lengths, the name and the bytes.
inline constexpr std::uint32_t format_version = 1;

class StateWriter {
 public:
  explicit StateWriter(std::ostream&);
  /// Names are written once each.
  void section(const std::string& name, std::span<const std::byte>);
  template <class T>
  requires std::is_trivially_copyable_v<T>
  void section(const std::string& name, const T* values, std::size_t count) {
    section(name, std::as_bytes(std::span(values, count)));
  }
  void text(const std::string& name, const std::string& text) { section(name, text.data(), text.size()); }
  /// The last section: without it a state is not complete.
  void end();

 private:
  std::ostream& out_;
  std::uint64_t sections_ = 0;
};

/// Reads sections in any order. All of them are checked before the constructor returns.
class StateReader {
 public:
  /// `name` of the source, for messages. Throws InputError that says what is wrong with the bytes; so do the others.
  StateReader(std::istream&, std::string name);

  /// Names of all, in alphabetical order.
  std::vector<std::string> sections() const;
  bool has(const std::string& section) const { return sections_.contains(section); }
  std::uint64_t bytes(const std::string& section) const { return find(section).bytes; }
  /// Fills all of `to`, which has to be as long as the section.
  void read(const std::string& section, std::span<std::byte> to);
  std::vector<std::byte> read(const std::string& section);
  std::string text(const std::string& section);
  /// Says that a section does not hold what it should.
  [[noreturn]] void refuse(const std::string& section, const std::string& what) const;

 private:
  struct Section {
    std::uint64_t at, bytes;
  };
  const Section& find(const std::string& section) const;

  std::istream& in_;
  std::string name_;
  std::map<std::string, Section> sections_;
};

/// Every bit of it is part of its value: no padding, whose bits may be any.
template <class T>
concept Plain = std::is_trivially_copyable_v<T> && !std::is_pointer_v<T> &&
                (std::has_unique_object_representations_v<T> || std::is_floating_point_v<T>);

/// Values one after another, as the bytes of a section. A class lists its values once, in a template
///
///   template <class Self, class Archive>
///   static void list(Self& self, Archive& archive) { archive(self.a, self.b); }
///
/// that takes a Packer or an Unpacker: then both have the same order.
class Packer {
 public:
  template <class... Values>
  void operator()(const Values&... values) {
    (add(values), ...);
  }
  std::span<const std::byte> bytes() const { return bytes_; }

 private:
  void raw(const void* from, std::size_t size) {
    const auto* begin = static_cast<const std::byte*>(from);
    bytes_.insert(bytes_.end(), begin, begin + size);
  }
  template <Plain T>
  void add(const T& value) {
    raw(&value, sizeof value);
  }
  template <class T>
  requires requires(const T& value, Packer& packer) { T::list(value, packer); }
  void add(const T& value) { T::list(value, *this); }
  template <Plain T>
  void add(const std::vector<T>& values) {
    add(std::uint64_t(values.size()));
    raw(values.data(), values.size() * sizeof(T));
  }
  void add(const std::string& text) {
    add(std::uint64_t(text.size()));
    raw(text.data(), text.size());
  }
  template <class V>
  void add(const std::map<std::string, V>& entries) {
    add(std::uint64_t(entries.size()));
    for (const auto& [key, value] : entries) (*this)(key, value);
  }

  std::vector<std::byte> bytes_;
};

/// Throws InputError where the bytes end too early.
class Unpacker {
 public:
  Unpacker(StateReader& reader, std::string section)
      : reader_(reader), section_(std::move(section)), bytes_(reader.read(section_)) {}

  template <class... Values>
  void operator()(Values&... values) {
    (take(values), ...);
  }
  /// Throws InputError if there are bytes that nobody took.
  void finish() const {
    if (at_ != bytes_.size()) reader_.refuse(section_, "is longer than what it should hold");
  }

 private:
  const std::byte* raw(std::uint64_t count, std::size_t size) {
    if (count > (bytes_.size() - at_) / size) reader_.refuse(section_, "is shorter than what it should hold");
    return bytes_.data() + std::exchange(at_, at_ + count * size);
  }
  std::uint64_t count() {
    std::uint64_t n = 0;
    take(n);
    return n;
  }
  template <Plain T>
  void take(T& value) {
    std::memcpy(static_cast<void*>(&value), raw(1, sizeof value), sizeof value);
  }
  template <class T>
  requires requires(T& value, Unpacker& unpacker) { T::list(value, unpacker); }
  void take(T& value) { T::list(value, *this); }
  template <Plain T>
  void take(std::vector<T>& values) {
    const std::uint64_t n = count();
    const std::byte* from = raw(n, sizeof(T));
    values.resize(n);
    if (n) std::memcpy(values.data(), from, n * sizeof(T));
  }
  void take(std::string& text) {
    const std::uint64_t n = count();
    const std::byte* from = raw(n, 1);
    text.assign(reinterpret_cast<const char*>(from), n);
  }
  template <class V>
  void take(std::map<std::string, V>& entries) {
    entries.clear();
    for (std::uint64_t n = count(); n > 0; n--) {
      std::string key;
      take(key);
      take(entries[key]);
    }
  }

  StateReader& reader_;
  std::string section_;
  std::vector<std::byte> bytes_;
  std::size_t at_ = 0;
};

/// list(archive) hands all values to the archive.
template <class List>
void pack(StateWriter& writer, const std::string& section, const List& list) {
  Packer packer;
  list(packer);
  writer.section(section, packer.bytes());
}
template <class List>
void unpack(StateReader& reader, const std::string& section, const List& list) {
  Unpacker unpacker(reader, section);
  list(unpacker);
  unpacker.finish();
}

/// CRC-32 of zlib, by several threads; continues `before`.
std::uint32_t checksum(std::span<const std::byte>, std::uint32_t before = 0);

}  // namespace cleave::checkpoint
