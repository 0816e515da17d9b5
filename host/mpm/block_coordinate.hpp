#pragma once

#include <array>
#include <bit>
#include <cstdint>
#include <vector>

namespace cleave::mpm {

/// Integer coordinate of a grid block; in two dimensions the last one is 0.
using BlockCoordinate = std::array<std::int32_t, 3>;

/// a/b rounded down, b > 0.
inline int floor_divide(int a, int b) { return a >= 0 ? a / b : -((b - 1 - a) / b); }

/// Interleaves the bits of the coordinates (21 bits each, centred at zero): neighbours in space are near in memory.
inline std::uint64_t morton_key(const BlockCoordinate& c) {
  const auto spread = [](std::int32_t signed_value) {
    std::uint64_t x = std::uint64_t(std::uint32_t(signed_value + (1 << 20))) & 0x1fffff;
    x = (x | x << 32) & 0x1f00000000ffffull;
    x = (x | x << 16) & 0x1f0000ff0000ffull;
    x = (x | x << 8) & 0x100f00f00f00f00full;
    x = (x | x << 4) & 0x10c30c30c30c30c3ull;
    return (x | x << 2) & 0x1249249249249249ull;
  };
  return spread(c[0]) << 2 | spread(c[1]) << 1 | spread(c[2]);
}

/// Blocks reach this far from the origin along each axis: about four million cells.
inline constexpr std::int32_t farthest_block = (1 << 20) - 2;

/// From Morton key to a small index: open addressing, filled once, read by all threads.
class BlockDirectory {
 public:
  static constexpr std::uint32_t none = ~0u;

  void reset(std::size_t expected) {
    const std::size_t size = std::bit_ceil(expected * 2 + 16);
    keys_.assign(size, ~0ull);
    values_.resize(size);
    mask_ = size - 1;
    count_ = 0;
  }
  /// Inserts if absent; returns the stored value.
  std::uint32_t insert(std::uint64_t key, std::uint32_t value) {
    if (2 * (count_ + 1) > keys_.size()) grow();
    std::size_t i = hash(key) & mask_;
    for (; keys_[i] != ~0ull; i = (i + 1) & mask_)
      if (keys_[i] == key) return values_[i];
    keys_[i] = key;
    values_[i] = value;
    count_++;
    return value;
  }
  std::uint32_t find(std::uint64_t key) const {
    if (keys_.empty()) return none;
    for (std::size_t i = hash(key) & mask_; keys_[i] != ~0ull; i = (i + 1) & mask_)
      if (keys_[i] == key) return values_[i];
    return none;
  }

 private:
  static std::size_t hash(std::uint64_t k) {
    k ^= k >> 31;
    k *= 0x9e3779b97f4a7c15ull;
    return std::size_t(k ^ (k >> 29));
  }
  void grow() {
    BlockDirectory larger;
    larger.reset(keys_.size());
    for (std::size_t i = 0; i < keys_.size(); i++)
      if (keys_[i] != ~0ull) larger.insert(keys_[i], values_[i]);
    *this = std::move(larger);
  }
  std::vector<std::uint64_t> keys_;
  std::vector<std::uint32_t> values_;
  std::size_t mask_ = 0, count_ = 0;
};

}  // namespace cleave::mpm
