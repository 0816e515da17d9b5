#include "bench/law_batch.hpp"

#include <algorithm>

namespace cleave::bench {

template <class T>
LawBatch<T>::LawBatch(std::size_t points) : points_(points), tiles_((points + lanes - 1) / lanes), status_(points) {}

template <class T>
void LawBatch<T>::add(cleave_field_id field, int components, Stream stream) {
  for (int i = 0; i < components; ++i) components_[field].push_back({stream, stride_[stream]++ * CLEAVE_TILE_BYTES});
}
template <class T>
void LawBatch<T>::add_input(cleave_field_id field, int components) {
  add(field, components, input);
}
template <class T>
void LawBatch<T>::add_output(cleave_field_id field, int components) {
  add(field, components, output);
}

template <class T>
void LawBatch<T>::allocate() {
  layout_.push_back(mpm::LawLayout{stride_[input] * CLEAVE_TILE_BYTES, stride_[output] * CLEAVE_TILE_BYTES});
  for (std::uint32_t field = 0; field < CLEAVE_FIELD_COUNT; ++field)
    if (!components_[field].empty()) layout_[0].add(cleave_field_id(field), components_[field]);
  for (const Stream stream : {input, output}) lines_[stream].assign(tiles_ * stride_[stream], Line{});
}

template <class T>
T& LawBatch<T>::value(cleave_field_id field, int component, std::size_t point) {
  const cleave_component& c = components_[field].at(std::size_t(component));
  return lines_[c.stream][point / lanes * stride_[c.stream] + c.offset / CLEAVE_TILE_BYTES].lane[point % lanes];
}

template <class T>
void LawBatch<T>::set(cleave_field_id field, int component, std::size_t point, double number) {
  value(field, component, point) = T(number);
  // The lanes beyond the last point are computed too and hold what that point holds.
  if (point + 1 == points_)
    for (std::size_t k = points_; k < tiles_ * lanes; ++k) value(field, component, k) = T(number);
}
template <class T>
double LawBatch<T>::get(cleave_field_id field, int component, std::size_t point) const {
  return double(const_cast<LawBatch*>(this)->value(field, component, point));
}

template <class T>
cleave_result LawBatch<T>::call(Function function, const plugins::Instance& law) {
  std::fill(status_.begin(), status_.end(), cleave_status(CLEAVE_STATUS_OK));
  cleave_batch batch{};
  batch.struct_size = sizeof batch;
  batch.count = std::uint32_t(points_);
  batch.layout = layout_[0].get();
  batch.streams[input] = lines_[input].data();
  batch.streams[output] = lines_[output].data();
  batch.status = status_.data();
  return function(law.handle(), &batch);
}

template class LawBatch<float>;
template class LawBatch<double>;

}  // namespace cleave::bench
