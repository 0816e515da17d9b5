#pragma once

#include "mpm/law_layout.hpp"
#include "plugins/registry.hpp"

#include <array>
#include <cstddef>
#include <cstdint>
#include <vector>

namespace cleave::bench {

/// Fields of one batch of points in memory of its own: inputs in one stream, outputs in another, so that every call finds the
/// same inputs. T is float or double.
template <class T>
class LawBatch {
 public:
  using Function = cleave_result (*)(const cleave_instance*, const cleave_batch*);

  explicit LawBatch(std::size_t points);

  /// Fields are added before values are set.
  void add_input(cleave_field_id, int components);
  void add_output(cleave_field_id, int components);
  void allocate();

  void set(cleave_field_id, int component, std::size_t point, double value);
  double get(cleave_field_id, int component, std::size_t point) const;

  cleave_result call(Function, const plugins::Instance&);
  /// After a call: whether the law gave the point a result.
  bool usable(std::size_t point) const { return status_[point] < CLEAVE_STATUS_RETRY; }
  std::size_t points() const { return points_; }

 private:
  static constexpr std::size_t lanes = CLEAVE_TILE_BYTES / sizeof(T);
  struct alignas(CLEAVE_TILE_BYTES) Line {
    std::array<T, lanes> lane{};
  };
  enum Stream : std::uint32_t { input, output };

  void add(cleave_field_id, int components, Stream);
  T& value(cleave_field_id, int component, std::size_t point);

  std::size_t points_, tiles_;
  std::array<std::uint32_t, 2> stride_{};  ///< lines of a tile
  std::array<std::vector<Line>, 2> lines_;
  std::array<std::vector<cleave_component>, CLEAVE_FIELD_COUNT> components_;
  std::vector<mpm::LawLayout> layout_;  ///< one, once allocated
  std::vector<cleave_status> status_;
};

extern template class LawBatch<float>;
extern template class LawBatch<double>;

}  // namespace cleave::bench
