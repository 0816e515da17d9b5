/// Walks a cleave_batch in chunks of one vector register per component, whatever the layout.
#ifndef CLEAVE_DETAIL_BATCH_HPP
#define CLEAVE_DETAIL_BATCH_HPP

#include <cleave/abi.h>
#include <cleave/tensor.hpp>

namespace cleave::detail {

/// The points of one register: up to Lanes<S>::width neighbours in a tile. Components are addressed through the layout's own
/// table at each access, so that a call has nothing to set up and no pointers to keep in registers.
template <class S>
struct Chunk {
  using L = Lanes<S>;
  const std::uintptr_t* tile;  ///< of every stream
  std::uint32_t inside;        ///< bytes from the tile's component to the chunk
  int live;                    ///< lanes below the batch's count
  cleave_status* status;       ///< of lane 0

  CLEAVE_INLINE S* address(const cleave_component& c) const { return reinterpret_cast<S*>(tile[c.stream] + c.offset + inside); }
  CLEAVE_INLINE L load(const cleave_component* c) const { return L::load(address(*c)); }
  CLEAVE_INLINE void store(const cleave_component* c, const L& value) const { value.store(address(*c)); }

  CLEAVE_INLINE Vector3<L> load_vector(const cleave_component* c) const { return {load(c), load(c + 1), load(c + 2)}; }
  CLEAVE_INLINE Symmetric3<L> load_symmetric(const cleave_component* c) const {
    return {load(c), load(c + 1), load(c + 2), load(c + 3), load(c + 4), load(c + 5)};
  }
  CLEAVE_INLINE Matrix3<L> load_matrix(const cleave_component* c) const {
    return {load(c), load(c + 1), load(c + 2), load(c + 3), load(c + 4), load(c + 5), load(c + 6), load(c + 7), load(c + 8)};
  }
  template <class Tensor>
  CLEAVE_INLINE void store_tensor(const cleave_component* c, const Tensor& value) const {
    for (std::size_t i = 0; i < sizeof(Tensor) / sizeof(L); ++i) store(c + i, value[int(i)]);
  }

  /// Raises the status of the live lanes where the mask holds.
  CLEAVE_INLINE void raise(const LaneMask<S>& where, cleave_status level) const {
    if (any(where)) [[unlikely]]
      raise_lanes(where.bits(), level);
  }
  [[gnu::noinline, gnu::cold]] void raise_lanes(unsigned where, cleave_status level) const {
    for (int lane = 0; lane < live; ++lane)
      if ((where >> lane & 1u) && status[lane] < level) status[lane] = level;
  }
};

template <class S>
class Batch {
 public:
  using L = Lanes<S>;
  explicit Batch(const cleave_batch& batch) : batch_(batch), layout_(*batch.layout) {}

  /// First component of a field; null if the layout does not have it.
  CLEAVE_INLINE const cleave_component* field(cleave_field_id id) const {
    if (std::uint32_t(id) >= layout_.field_count) return nullptr;
    const cleave_field& field = layout_.fields[id];
    return field.count ? layout_.components + field.first : nullptr;
  }
  std::uint32_t count() const { return batch_.count; }
  double time_step() const { return batch_.time_step; }
  cleave_message* message() const { return batch_.message; }

  template <class Body>
  CLEAVE_INLINE void for_each_chunk(Body body) const {
    constexpr std::uint32_t width = L::width, chunks = CLEAVE_TILE_BYTES / CLEAVE_LANE_BYTES;
    std::uintptr_t tile[CLEAVE_MAX_STREAMS];
    for (unsigned s = 0; s < CLEAVE_MAX_STREAMS; ++s) tile[s] = reinterpret_cast<std::uintptr_t>(batch_.streams[s]);
    for (std::uint32_t first = 0; first < batch_.count;) {
      for (std::uint32_t chunk = 0; chunk < chunks && first < batch_.count; ++chunk, first += width) {
        const std::uint32_t left = batch_.count - first;
        body(Chunk<S>{tile, chunk * CLEAVE_LANE_BYTES, int(left < width ? left : width), batch_.status + first});
      }
      for (unsigned s = 0; s < CLEAVE_MAX_STREAMS; ++s) tile[s] += layout_.stride[s];
    }
  }

 private:
  const cleave_batch& batch_;
  const cleave_layout& layout_;
};

/// True where every number is finite: an infinite or undefined one makes the sum so, and x - x is then undefined. A sum that
/// overflows counts as not finite.
template <class Tensor>
CLEAVE_INLINE auto all_finite(const Tensor& a) {
  auto sum = a[0];
  for (std::size_t i = 1; i < sizeof(Tensor) / sizeof(sum); ++i) sum += a[int(i)];
  return sum - sum == decltype(sum)(0);
}
template <class S>
CLEAVE_INLINE LaneMask<S> all_finite(const Lanes<S>& a) {
  return a - a == Lanes<S>(0);
}

}  // namespace cleave::detail

#endif
