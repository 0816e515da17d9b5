#pragma once

#include "plugins/registry.hpp"

#include <cleave/abi.h>

#include <gtest/gtest.h>

#include <cstdint>
#include <cstdlib>
#include <cstring>
#include <map>
#include <memory>
#include <string>
#include <vector>

namespace cleave::plugins::test {

/// Values of one field, point by point.
using Field = std::vector<std::vector<double>>;

enum class Placement {
  dense,      ///< inputs in one stream, outputs in another, components side by side
  scattered,  ///< components over three streams in falling order, with gaps
};

/// Evaluates a law's batch function on fields given as plain numbers, through buffers of the wanted layout. Everything the
/// layout does not name is filled with a pattern that must survive.
template <class S>
class LawDriver {
 public:
  static constexpr std::uint32_t lanes = CLEAVE_TILE_BYTES / sizeof(S);
  using Function = cleave_result (*)(const cleave_instance*, const cleave_batch*);

  explicit LawDriver(Placement placement = Placement::dense) : placement_(placement) {}

  LawDriver& input(cleave_field_id id, Field values) {
    inputs_[id] = std::move(values);
    return *this;
  }
  /// The same values for all points, in a stream of stride 0.
  LawDriver& constant(cleave_field_id id, std::vector<double> values) {
    constants_[id] = std::move(values);
    return *this;
  }
  LawDriver& output(cleave_field_id id, unsigned components) {
    outputs_[id] = components;
    return *this;
  }
  /// The output takes the memory of an input.
  LawDriver& output_over(cleave_field_id id, cleave_field_id input) {
    over_[id] = input;
    return *this;
  }
  LawDriver& time_step(double dt) {
    time_step_ = dt;
    return *this;
  }

  cleave_result run(Function function, const cleave_instance* instance, std::uint32_t count) {
    place(count);
    status_.assign(count + 1, CLEAVE_STATUS_OK);
    status_[count] = canary;
    cleave_batch batch{};
    batch.struct_size = sizeof batch;
    batch.count = count;
    batch.layout = &layout_;
    for (unsigned s = 0; s < CLEAVE_MAX_STREAMS; ++s) batch.streams[s] = streams_[s] ? streams_[s].get() : nullptr;
    batch.time_step = time_step_;
    batch.status = status_.data();
    const cleave_result result = function(instance, &batch);
    check_untouched(count);
    return result;
  }

  std::vector<double> value(cleave_field_id id, std::uint32_t point) const {
    const cleave_field& field = fields_[id];
    std::vector<double> values;
    for (unsigned c = 0; c < field.count; ++c) values.push_back(double(*address(components_[field.first + c], point)));
    return values;
  }
  std::uint8_t status(std::uint32_t point) const { return status_[point]; }

 private:
  static constexpr unsigned char canary = 0xA5;
  struct Free {
    void operator()(void* p) const { std::free(p); }
  };

  S* address(const cleave_component& c, std::uint32_t point) const {
    return reinterpret_cast<S*>(streams_[c.stream].get() + std::size_t(point / lanes) * layout_.stride[c.stream] + c.offset) +
           point % lanes;
  }

  std::uint32_t add(cleave_field_id id, unsigned components, int stream_of_dense, bool constant) {
    const auto first = std::uint32_t(components_.size());
    fields_[id] = {std::uint16_t(first), std::uint16_t(components)};
    for (unsigned i = 0; i < components; ++i) {
      const std::uint32_t stream = constant                         ? 3
                                   : placement_ == Placement::dense ? std::uint32_t(stream_of_dense)
                                                                    : (first + 2 * i) % 3;
      components_.push_back({stream, bytes_[stream]});
      // Scattered components leave every second line of the tile alone.
      bytes_[stream] += CLEAVE_TILE_BYTES * (placement_ == Placement::dense ? 1 : 2);
    }
    return first;
  }

  void place(std::uint32_t count) {
    fields_.assign(CLEAVE_FIELD_COUNT, {});
    components_.clear();
    std::fill(std::begin(bytes_), std::end(bytes_), 0u);
    for (const auto& [id, values] : inputs_) add(id, unsigned(values.at(0).size()), 0, false);
    for (const auto& [id, values] : constants_) add(id, unsigned(values.size()), 0, true);
    for (const auto& [id, components] : outputs_) add(id, components, 1, false);
    for (const auto& [id, input] : over_) fields_[id] = fields_[input];
    // Rising offsets would look like the dense case; a reader must take them as they come.
    if (placement_ == Placement::scattered)
      for (auto& c : components_)
        if (c.stream != 3) c.offset = bytes_[c.stream] - 2 * CLEAVE_TILE_BYTES - c.offset;

    tiles_ = (count + lanes - 1) / lanes;
    layout_ = {sizeof layout_, CLEAVE_FIELD_COUNT, {bytes_[0], bytes_[1], bytes_[2], 0}, fields_.data(), components_.data()};
    for (unsigned s = 0; s < CLEAVE_MAX_STREAMS; ++s) {
      const std::size_t size = std::size_t(bytes_[s]) * (s == 3 ? 1 : tiles_ + 1);  // one tile of canaries at the end
      streams_[s].reset(size ? static_cast<char*>(std::aligned_alloc(64, size)) : nullptr);
      sizes_[s] = size;
      if (size) std::memset(streams_[s].get(), canary, size);
    }
    for (std::uint32_t point = 0; point < tiles_ * lanes; ++point) {
      for (const auto& [id, values] : inputs_) {
        // The lanes beyond the count hold finite values: those of the first point.
        const auto& source = values.at(point < count ? point % values.size() : 0);
        for (unsigned c = 0; c < source.size(); ++c) *address(components_[fields_[id].first + c], point) = S(source[c]);
      }
    }
    for (const auto& [id, values] : constants_)
      for (unsigned c = 0; c < values.size(); ++c)
        for (std::uint32_t lane = 0; lane < lanes; ++lane) *address(components_[fields_[id].first + c], lane) = S(values[c]);
    for (unsigned s = 0; s < CLEAVE_MAX_STREAMS; ++s)
      before_[s].assign(streams_[s].get(), streams_[s].get() + (streams_[s] ? sizes_[s] : 0));
  }

  /// Only the lines of the output fields may have changed, and no status beyond the count.
  void check_untouched(std::uint32_t count) const {
    EXPECT_EQ(status_[count], canary) << "status written beyond the count";
    std::vector<std::vector<bool>> writable(CLEAVE_MAX_STREAMS);
    for (unsigned s = 0; s < CLEAVE_MAX_STREAMS; ++s) writable[s].assign(sizes_[s] / CLEAVE_TILE_BYTES, false);
    const auto allow = [&](cleave_field_id id) {
      for (unsigned c = 0; c < fields_[id].count; ++c) {
        const auto& component = components_[fields_[id].first + c];
        for (std::uint32_t tile = 0; tile < tiles_; ++tile)
          writable[component.stream][(std::size_t(tile) * bytes_[component.stream] + component.offset) / CLEAVE_TILE_BYTES] =
              true;
      }
    };
    for (const auto& [id, components] : outputs_) allow(id);
    for (const auto& [id, input] : over_) allow(id);
    for (unsigned s = 0; s < CLEAVE_MAX_STREAMS; ++s)
      for (std::size_t line = 0; line < writable[s].size(); ++line)
        if (!writable[s][line]) {
          EXPECT_EQ(std::memcmp(streams_[s].get() + line * CLEAVE_TILE_BYTES, before_[s].data() + line * CLEAVE_TILE_BYTES,
                                CLEAVE_TILE_BYTES),
                    0)
              << "stream " << s << ", line " << line << " was touched";
        }
  }

  Placement placement_;
  std::map<cleave_field_id, Field> inputs_;
  std::map<cleave_field_id, std::vector<double>> constants_;
  std::map<cleave_field_id, unsigned> outputs_;
  std::map<cleave_field_id, cleave_field_id> over_;
  double time_step_ = 0;

  std::uint32_t tiles_ = 0;
  std::uint32_t bytes_[CLEAVE_MAX_STREAMS] = {};
  std::size_t sizes_[CLEAVE_MAX_STREAMS] = {};
  std::vector<cleave_field> fields_;
  std::vector<cleave_component> components_;
  cleave_layout layout_{};
  std::unique_ptr<char, Free> streams_[CLEAVE_MAX_STREAMS];
  std::vector<char> before_[CLEAVE_MAX_STREAMS];
  std::vector<std::uint8_t> status_;
};

template <class S>
auto evaluate(const Instance& law) {
  if constexpr (sizeof(S) == 4)
    return law.elasticity().evaluate_f32;
  else
    return law.elasticity().evaluate_f64;
}
template <class S>
auto return_map(const Instance& law) {
  if constexpr (sizeof(S) == 4)
    return law.plasticity().return_map_f32;
  else
    return law.plasticity().return_map_f64;
}

/// Registries of the build's own plugins and of the fixtures.
inline Registry built_plugins() { return Registry({CLEAVE_BINARY_DIR "/lib/cleave/plugins"}); }
inline Registry sound_fixtures() { return Registry({CLEAVE_FIXTURE_DIR "/sound"}); }

inline GivenParameters stiff(double youngs_modulus = 1000, double poissons_ratio = 0.3) {
  return {{"youngs_modulus", youngs_modulus}, {"poissons_ratio", poissons_ratio}};
}

}  // namespace cleave::plugins::test
