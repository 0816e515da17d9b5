/// How what a plugin saves crosses the boundary.
#ifndef CLEAVE_DETAIL_SAVED_STATE_HPP
#define CLEAVE_DETAIL_SAVED_STATE_HPP

#include <algorithm>
#include <cstddef>
#include <cstdint>
#include <cstring>
#include <vector>

namespace cleave::detail {

/// As the ABI's save(): without a buffer the size of the state, else what was written of it.
inline std::uint64_t hand_over(const std::vector<std::byte>& state, void* buffer, std::uint64_t size) {
  if (!buffer) return state.size();
  const auto written = std::min<std::uint64_t>(size, state.size());
  if (written > 0) std::memcpy(buffer, state.data(), written);
  return written;
}

}  // namespace cleave::detail

#endif
