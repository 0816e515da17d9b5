#pragma once

#include <cstdint>

namespace cleave::scene {

/// A number in [0, 1) that depends only on its key, so that random placement does not depend on the order of work.
/// The key is absorbed word by word with the finalizer of SplitMix64 (Steele, Lea and Flood 2014).
template <class... Words>
double hashed_uniform(std::uint64_t seed, Words... words) {
  std::uint64_t state = seed;
  const auto absorb = [&state](std::uint64_t word) {
    state += 0x9e3779b97f4a7c15u + word;
    state = (state ^ (state >> 30)) * 0xbf58476d1ce4e5b9u;
    state = (state ^ (state >> 27)) * 0x94d049bb133111ebu;
    state ^= state >> 31;
  };
  absorb(0);
  (absorb(static_cast<std::uint64_t>(words)), ...);
  return static_cast<double>(state >> 11) * 0x1p-53;
}

}  // namespace cleave::scene
