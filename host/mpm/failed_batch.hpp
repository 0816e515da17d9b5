#pragma once

#include "mpm/kernels/kernels.hpp"
#include "plugins/schema.hpp"

#include <bit>
#include <cmath>
#include <filesystem>
#include <map>
#include <optional>
#include <string>
#include <type_traits>
#include <utility>
#include <vector>

namespace cleave::mpm {

/// A field of a law's call as files name it.
struct FieldName {
  cleave_field_id id;
  const char* name;
  bool output;
  int components;  ///< 0: as many as the law has state variables
};
inline constexpr FieldName field_names[] = {
    {CLEAVE_FIELD_B, "b", false, 6},
    {CLEAVE_FIELD_F, "F", false, 9},
    {CLEAVE_FIELD_DEGRADATION, "degradation", false, 1},
    {CLEAVE_FIELD_FIBER, "fiber", false, 3},
    {CLEAVE_FIELD_SECOND_FIBER, "second_fiber", false, 3},
    {CLEAVE_FIELD_STATE, "state", false, 0},
    {CLEAVE_FIELD_DAMAGE, "damage", false, 1},
    {CLEAVE_FIELD_TENSILE_ENERGY_IN, "tensile_energy", false, 1},
    {CLEAVE_FIELD_EFFECTIVE_STRESS_IN, "effective_stress", false, 6},
    {CLEAVE_FIELD_TOUGHNESS, "toughness", false, 1},
    {CLEAVE_FIELD_DELTA_F, "delta_F", false, 9},
    {CLEAVE_FIELD_TAU, "tau", true, 6},
    {CLEAVE_FIELD_PIOLA, "P", true, 9},
    {CLEAVE_FIELD_DELTA_P, "delta_P", true, 9},
    {CLEAVE_FIELD_ENERGY, "energy", true, 1},
    {CLEAVE_FIELD_TENSILE_ENERGY, "tensile_energy_out", true, 1},
    {CLEAVE_FIELD_EFFECTIVE_STRESS, "effective_stress_out", true, 6},
    {CLEAVE_FIELD_B_OUT, "b_out", true, 6},
    {CLEAVE_FIELD_F_OUT, "F_out", true, 9},
    {CLEAVE_FIELD_STATE_OUT, "state_out", true, 0},
    {CLEAVE_FIELD_DAMAGE_OUT, "damage_out", true, 1},
    {CLEAVE_FIELD_DRIVING_FORCE, "driving_force", true, 1},
};
/// Inputs and outputs of any of these laws, component by component.
inline constexpr int most_components = 75 + 2 * int(CLEAVE_MAX_STATE);

/// Where value k of a component of a batch is.
template <class T>
T* value_at(const cleave_batch& batch, const cleave_component& c, std::size_t k) {
  constexpr std::size_t lanes = CLEAVE_TILE_BYTES / sizeof(T);
  return reinterpret_cast<T*>(static_cast<char*>(batch.streams[c.stream]) + k / lanes * batch.layout->stride[c.stream] +
                              c.offset) +
         k % lanes;
}

/// Raises the status of points for which a law gave infinite numbers or NaN and says nothing of it. Returns these points.
template <class T>
std::uint32_t refuse_not_finite(const cleave_batch& batch, const cleave_component* outputs, std::size_t count) {
  constexpr std::size_t lanes = CLEAVE_TILE_BYTES / sizeof(T);
  using Bits = std::conditional_t<std::is_same_v<T, float>, std::uint32_t, std::uint64_t>;
  Bits bits[lanes] = {};  // x - x is +0, or NaN, which has bits
  for (std::size_t c = 0; c < count; c++)
    for (std::size_t k = 0; k < batch.count; k += lanes) {
      const T* row = value_at<T>(batch, outputs[c], k);
      for (std::size_t l = 0; l < lanes; l++) bits[l] |= std::bit_cast<Bits>(row[l] - row[l]);
    }
  Bits any = 0;
  for (const Bits b : bits) any |= b;
  if (__builtin_expect(any == 0, 1)) return 0;
  std::uint32_t points = 0;
  for (std::size_t k = 0; k < batch.count; k++) {
    if (batch.status[k] >= CLEAVE_STATUS_RETRY) continue;
    for (std::size_t c = 0; c < count; c++)
      if (!std::isfinite(*value_at<T>(batch, outputs[c], k))) points |= 1u << k;
    if (points >> k & 1) batch.status[k] = CLEAVE_STATUS_FATAL;
  }
  return points;
}
static_assert(chunk_points <= 32);

/// What went into a law and came out of it. Of fixed size, so that a signal handler can fill it.
struct BatchSnapshot {
  struct Row {
    cleave_field_id field;
    double value[chunk_points];
  };
  std::uint32_t count = 0;
  double time_step = 0;
  int rows = 0;
  Row row[most_components];
  bool returned = false;  ///< the rest counts, and rows of outputs are there
  cleave_result result = CLEAVE_OK;
  cleave_status status[chunk_points] = {};
  std::uint32_t not_finite = 0;  ///< bit k: of point k
};

using Put = void (*)(void* sink, const char* text, std::size_t size);

/// Writes a batch as a JSON object. `header` is the object as far as it is known beforehand, without its closing brace;
/// `reason` is written as it is. Numbers have the digits of their precision; those that are not finite are "nan", "inf" and
/// "-inf". Async-signal-safe: neither allocates nor locks.
void write_batch(Put, void* sink, const char* header, const char* reason, const BatchSnapshot&, bool single,
                 const std::int64_t* particles);

/// A file of write_batch, read back.
struct FailedBatch {
  struct Law {
    std::string id, version;
    plugins::GivenParameters parameters;
  };
  using Fields = std::map<cleave_field_id, std::vector<std::vector<double>>>;  ///< [component][point]

  std::string cleave, material, failed, reason;
  bool single = false;
  int dimension = 3;
  double cell_size = 0, density = 0, time_step = 0;
  std::vector<Law> laws;
  std::vector<cleave_field_id> wanted;
  std::size_t count = 0;
  std::vector<std::int64_t> particles;  ///< empty: not known
  Fields inputs;
  bool returned = false;  ///< the rest counts
  cleave_result result = CLEAVE_OK;
  std::vector<cleave_status> status;
  Fields outputs;
};

/// Throws InputError.
FailedBatch read_batch(const std::filesystem::path&);

/// What is known of a law's call before it is made.
struct BatchOrigin {
  std::string material, failed;
  bool single = false;
  int dimension = 3;
  double cell_size = 0, density = 0;
  std::vector<FailedBatch::Law> laws;
  std::vector<cleave_field_id> wanted;
};
std::string batch_header(const BatchOrigin&);

}  // namespace cleave::mpm
