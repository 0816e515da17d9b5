/// A checksum of saved states, for plugins that tell apart theirs from what they cannot go on from.
#ifndef CLEAVE_CHECKSUM_HPP
#define CLEAVE_CHECKSUM_HPP

#include <algorithm>
#include <cstddef>
#include <cstdint>
#include <cstring>
#include <span>

namespace cleave {

/// [Fowler, Noll & Vo 1991], by words of eight bytes, the last filled up with zeros.
inline std::uint64_t checksum(std::span<const std::byte> bytes) {
  std::uint64_t sum = 0xcbf29ce484222325;
  for (std::size_t k = 0; k < bytes.size(); k += 8) {
    std::uint64_t word = 0;
    std::memcpy(&word, &bytes[k], std::min<std::size_t>(8, bytes.size() - k));
    sum = (sum ^ word) * 0x100000001b3;
  }
  return sum;
}

}  // namespace cleave

#endif
