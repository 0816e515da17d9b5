#include <cleave/testkit/batch.hpp>

#include <cleave/damage.h>
#include <cleave/elasticity.h>
#include <cleave/plasticity.h>
#include <cleave/testkit/check.hpp>

#include <sys/mman.h>
#include <unistd.h>

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <cstring>
#include <exception>
#include <limits>

namespace cleave::testkit {
namespace {

using Function = cleave_result (*)(const cleave_instance*, const cleave_batch*);

Function function_of(const Plugin& plugin, Precision precision) {
  const bool single_precision = precision == Precision::single_precision;
  switch (plugin.kind()) {
    case elasticity_kind: {
      const auto& t = *static_cast<const cleave_elasticity*>(plugin.kind_table());
      return single_precision ? t.evaluate_f32 : t.evaluate_f64;
    }
    case plasticity_kind: {
      const auto& t = *static_cast<const cleave_plasticity*>(plugin.kind_table());
      return single_precision ? t.return_map_f32 : t.return_map_f64;
    }
    default: {
      const auto& t = *static_cast<const cleave_damage*>(plugin.kind_table());
      return single_precision ? t.drive_f32 : t.drive_f64;
    }
  }
}

/// Whole pages between two that cannot be accessed. What is placed in them ends where they end.
class Pages {
 public:
  explicit Pages(std::size_t bytes) {
    const auto page = std::size_t(sysconf(_SC_PAGESIZE));
    size_ = (bytes + page - 1) / page * page;
    all_ = size_ + 2 * page;
    base_ = static_cast<char*>(mmap(nullptr, all_, PROT_NONE, MAP_PRIVATE | MAP_ANONYMOUS, -1, 0));
    if (base_ == MAP_FAILED) throw Failed{"no memory for the batch"};
    begin_ = base_ + page;
    if (size_) mprotect(begin_, size_, PROT_READ | PROT_WRITE);
    used_ = bytes;
  }
  Pages(Pages&& other) noexcept
      : base_(other.base_), begin_(other.begin_), size_(other.size_), all_(other.all_), used_(other.used_) {
    other.base_ = nullptr;
  }
  Pages& operator=(Pages&&) = delete;
  ~Pages() {
    if (base_) munmap(base_, all_);
  }
  char* begin() const { return begin_; }
  char* data() const { return begin_ + size_ - used_; }
  std::size_t size() const { return size_; }
  void make_read_only() {
    if (size_) mprotect(begin_, size_, PROT_READ);
  }

 private:
  char *base_, *begin_;
  std::size_t size_, all_, used_;
};

}  // namespace

const char* name(Precision precision) { return precision == Precision::single_precision ? "f32" : "f64"; }

const char* name(cleave_field_id field) {
  static constexpr const char* names[CLEAVE_FIELD_COUNT] = {"B",
                                                            "F",
                                                            "DEGRADATION",
                                                            "FIBER",
                                                            "SECOND_FIBER",
                                                            "TAU",
                                                            "ENERGY",
                                                            "TENSILE_ENERGY",
                                                            "EFFECTIVE_STRESS",
                                                            "WAVE_MODULUS",
                                                            "DELTA_F",
                                                            "DELTA_P",
                                                            "B_OUT",
                                                            "F_OUT",
                                                            "STATE",
                                                            "STATE_OUT",
                                                            "YIELDED",
                                                            "DAMAGE",
                                                            "DAMAGE_OUT",
                                                            "DRIVING_FORCE",
                                                            "TENSILE_ENERGY_IN",
                                                            "EFFECTIVE_STRESS_IN",
                                                            "TOUGHNESS",
                                                            "PIOLA"};
  return names[field];
}

Request Request::points(const std::vector<std::uint32_t>& which) const {
  Request some = *this;
  some.count = std::uint32_t(which.size());
  for (auto& [field, values] : some.inputs) {
    Field chosen;
    for (std::uint32_t k : which) chosen.push_back(values.at(k));
    values = chosen;
  }
  return some;
}
Request Request::points(std::uint32_t first, std::uint32_t number) const {
  std::vector<std::uint32_t> which(number);
  for (std::uint32_t k = 0; k < number; ++k) which[k] = first + k;
  return points(which);
}

struct PreparedCall::Memory {
  const Instance& instance;
  Function function;
  bool single_precision;
  std::uint32_t lanes, count, tiles;
  unsigned char fill;
  std::map<cleave_field_id, int> wanted;
  cleave_layout layout{};
  std::vector<Pages> streams, tables;
  std::vector<std::vector<char>> before;
  std::vector<cleave_component> components;
  cleave_field fields[CLEAVE_FIELD_COUNT] = {};
  std::vector<std::uint8_t> status;
  Words words;
  cleave_batch batch{};

  Memory(const Instance& the_instance, Precision precision, const Request& request, const Placement& placement)
      : instance(the_instance),
        function(function_of(the_instance.plugin(), precision)),
        single_precision(precision == Precision::single_precision),
        lanes(single_precision ? 16 : 8),
        count(request.count),
        tiles((count + lanes - 1) / lanes),
        fill(placement.fill),
        wanted(request.outputs) {
    place(request, placement);
    fill_in(request);
    if (placement.read_only) streams[0].make_read_only();
    for (auto& stream : streams) before.emplace_back(stream.begin(), stream.begin() + stream.size());

    batch.struct_size = sizeof batch;
    batch.count = count;
    batch.layout = &layout;
    for (unsigned s = 0; s < CLEAVE_MAX_STREAMS; ++s) batch.streams[s] = layout.stride[s] ? streams[s].data() : nullptr;
    batch.time_step = request.time_step;
    batch.message = &words.message;
  }

  void place(const Request& request, const Placement& placement) {
    const bool spread = placement.order != Placement::dense;
    std::uint32_t bytes[CLEAVE_MAX_STREAMS] = {};
    const auto add = [&](cleave_field_id field, int number, unsigned stream_of_dense) {
      fields[field] = {std::uint16_t(components.size()), std::uint16_t(number)};
      for (int i = 0; i < number; ++i) {
        const auto stream = placement.order == Placement::scattered ? std::uint32_t(components.size() % 3) : stream_of_dense;
        components.push_back({stream, bytes[stream]});
        bytes[stream] += CLEAVE_TILE_BYTES * (spread ? 2 : 1);
      }
    };
    for (const auto& [field, values] : request.inputs)
      add(field, values.empty() ? components_of(field) : int(values[0].size()), 0);
    for (const auto& [field, number] : request.outputs) add(field, number, 1);
    if (placement.order == Placement::scattered)
      for (auto& c : components) c.offset = bytes[c.stream] - 2 * CLEAVE_TILE_BYTES - c.offset;

    layout.struct_size = sizeof layout;
    layout.field_count = CLEAVE_FIELD_COUNT;
    for (unsigned s = 0; s < CLEAVE_MAX_STREAMS; ++s) {
      layout.stride[s] = bytes[s];
      streams.emplace_back(std::size_t(bytes[s]) * tiles);
      std::memset(streams[s].begin(), fill, streams[s].size());
    }
    if (placement.short_field_table)
      while (layout.field_count > 0 && fields[layout.field_count - 1].count == 0) --layout.field_count;
    tables.emplace_back(sizeof(cleave_field) * layout.field_count);
    std::memcpy(tables[0].data(), fields, sizeof(cleave_field) * layout.field_count);
    layout.fields = reinterpret_cast<const cleave_field*>(tables[0].data());
    layout.components = components.data();
  }

  int components_of(cleave_field_id field) const {
    switch (field) {
      case CLEAVE_FIELD_B:
      case CLEAVE_FIELD_EFFECTIVE_STRESS_IN:
        return 6;
      case CLEAVE_FIELD_F:
      case CLEAVE_FIELD_DELTA_F:
        return 9;
      case CLEAVE_FIELD_FIBER:
      case CLEAVE_FIELD_SECOND_FIBER:
        return 3;
      case CLEAVE_FIELD_STATE:
        return state_components(instance.plugin().schema());
      default:
        return 1;
    }
  }

  char* address(const cleave_component& c, std::uint32_t point) const {
    return streams[c.stream].data() + std::size_t(point / lanes) * layout.stride[c.stream] + c.offset +
           point % lanes * (single_precision ? 4 : 8);
  }
  void set(const cleave_component& c, std::uint32_t point, double value) const {
    const float narrow = float(value);
    if (single_precision)
      std::memcpy(address(c, point), &narrow, sizeof narrow);
    else
      std::memcpy(address(c, point), &value, sizeof value);
  }
  double get(const cleave_component& c, std::uint32_t point) const {
    float narrow;
    double value;
    if (!single_precision) return std::memcpy(&value, address(c, point), sizeof value), value;
    std::memcpy(&narrow, address(c, point), sizeof narrow);
    return narrow;
  }

  /// The lanes beyond the count hold what the first point holds.
  void fill_in(const Request& request) const {
    for (std::uint32_t point = 0; point < tiles * lanes; ++point)
      for (const auto& [field, values] : request.inputs) {
        const auto& source = values.at(point < count ? point : 0);
        for (std::size_t i = 0; i < source.size(); ++i) set(components[fields[field].first + i], point, source[i]);
      }
  }

  /// Only lines of outputs may have changed.
  std::string touched() const {
    if (status[count] != fill) return "the status beyond the count was written";
    for (unsigned s = 0; s < CLEAVE_MAX_STREAMS; ++s) {
      if (!streams[s].size() || std::memcmp(streams[s].begin(), before[s].data(), streams[s].size()) == 0) continue;
      const auto skipped = std::size_t(streams[s].data() - streams[s].begin());
      std::vector<bool> allowed(streams[s].size() / CLEAVE_TILE_BYTES, false);
      for (const auto& [field, number] : wanted)
        for (int i = 0; i < number; ++i) {
          const auto& c = components[std::size_t(fields[field].first + i)];
          if (c.stream == s)
            for (std::uint32_t tile = 0; tile < tiles; ++tile)
              allowed[(skipped + std::size_t(tile) * layout.stride[s] + c.offset) / CLEAVE_TILE_BYTES] = true;
        }
      for (std::size_t line = 0; line < allowed.size(); ++line)
        if (!allowed[line] && std::memcmp(streams[s].begin() + line * CLEAVE_TILE_BYTES,
                                          before[s].data() + line * CLEAVE_TILE_BYTES, CLEAVE_TILE_BYTES) != 0)
          return "memory outside of the requested outputs was written: stream " + std::to_string(s) + ", " +
                 std::to_string((std::ptrdiff_t(line * CLEAVE_TILE_BYTES) - std::ptrdiff_t(skipped))) + " bytes from its start";
    }
    return {};
  }
};

PreparedCall::PreparedCall(const Instance& instance, Precision precision, const Request& request, const Placement& placement)
    : memory_(new Memory(instance, precision, request, placement)) {
  memory_->status.assign(memory_->count + 1, placement.fill);
  memory_->batch.status = memory_->status.data();
}
PreparedCall::~PreparedCall() { delete memory_; }

cleave_batch& PreparedCall::batch() { return memory_->batch; }

cleave_result PreparedCall::call() noexcept {
  std::memset(memory_->status.data(), CLEAVE_STATUS_OK, memory_->count);
  const auto thrown = [&](const char* what) {
    std::snprintf(memory_->words.text, sizeof memory_->words.text, "an exception left the plugin: %s", what);
    return CLEAVE_ERROR_INTERNAL;
  };
  try {
    return memory_->function(memory_->instance.handle(), &memory_->batch);
  } catch (const std::exception& error) {
    return thrown(error.what());
  } catch (...) {
    return thrown("no std::exception");
  }
}

Answer PreparedCall::answer() const {
  const Memory& m = *memory_;
  Answer answer;
  answer.words = m.words.said();
  answer.touched = m.touched();
  answer.status.assign(m.status.begin(), m.status.begin() + m.count);
  for (const auto& [field, number] : m.wanted) {
    Field& values = answer.outputs[field];
    values.resize(m.count);
    for (std::uint32_t point = 0; point < m.count; ++point)
      for (int i = 0; i < number; ++i)
        values[point].push_back(m.get(m.components[std::size_t(m.fields[field].first + i)], point));
  }
  return answer;
}

Answer evaluate(const Instance& instance, Precision precision, const Request& request, const Placement& placement) {
  PreparedCall call(instance, precision, request, placement);
  const cleave_result result = call.call();
  Answer answer = call.answer();
  answer.result = result;
  return answer;
}

Answer evaluated(const Instance& instance, Precision precision, const Request& request, const Placement& placement) {
  Answer answer = evaluate(instance, precision, request, placement);
  if (answer.result != CLEAVE_OK)
    throw Failed{std::string(name(precision)) + ", " + std::to_string(request.count) + " points: the call failed with result " +
                 std::to_string(answer.result) + ": " + answer.words};
  return answer;
}

Answer evaluated_alone(const Instance& instance, Precision precision, const Request& request, const Placement& placement) {
  Answer answer = evaluated(instance, precision, request, placement);
  if (!answer.touched.empty()) throw Failed{answer.touched};
  return answer;
}

std::vector<Precision> precisions(const Plugin& plugin) {
  std::vector<Precision> all;
  if (plugin.can(CLEAVE_DOUBLE)) all.push_back(Precision::double_precision);
  if (plugin.can(CLEAVE_SINGLE)) all.push_back(Precision::single_precision);
  return all;
}

std::vector<std::string> measures(const Instance& instance) {
  std::vector<std::string> all;
  if (instance.plugin().kind() == damage_kind)
    return {instance.can(CLEAVE_ACCEPTS_F) ? "F" : instance.can(CLEAVE_ACCEPTS_B) ? "b" : ""};
  if (instance.can(CLEAVE_ACCEPTS_B)) all.push_back("b");
  if (instance.can(CLEAVE_ACCEPTS_F)) all.push_back("F");
  return all;
}

Request random_request(const Instance& instance, Random& random, std::uint32_t count, const std::string& measure,
                       double spread) {
  const Plugin& plugin = instance.plugin();
  const std::uint32_t kind = plugin.kind();
  // A batch without points has the layout of one with points.
  if (count == 0) return random_request(instance, random, 1, measure, spread).points(0, 0);
  Request request;
  request.count = count;
  request.time_step = 1e-4;
  const std::vector<double> state = instance.initial_state();
  const bool needs_fiber = instance.can(CLEAVE_NEEDS_FIBER | CLEAVE_NEEDS_SECOND_FIBER);
  const bool piola = kind == elasticity_kind && measure == "F" && instance.can(CLEAVE_HAS_PIOLA);
  const bool tangent = kind == elasticity_kind && measure == "F" && instance.can(CLEAVE_HAS_TANGENT);
  auto& in = request.inputs;
  for (std::uint32_t point = 0; point < count; ++point) {
    const auto left = random.rotation(), right = random.rotation(), frame = random.rotation();
    double stretch[3], F[9], b[6], stress[6];
    for (double& s : stretch) s = std::exp(spread * random.uniform(-0.22, 0.22));
    for (int i = 0; i < 3; ++i)
      for (int j = 0; j < 3; ++j) {
        F[3 * i + j] = 0;
        for (int k = 0; k < 3; ++k) F[3 * i + j] += left[3 * i + k] * stretch[k] * right[3 * j + k];
      }
    constexpr int rows[6][2] = {{0, 0}, {1, 1}, {2, 2}, {0, 1}, {0, 2}, {1, 2}};
    for (int c = 0; c < 6; ++c) {
      b[c] = 0;
      for (int k = 0; k < 3; ++k) b[c] += F[3 * rows[c][0] + k] * F[3 * rows[c][1] + k];
    }
    Material::effective_stress(F, stress);
    if (measure == "b") in[CLEAVE_FIELD_B].push_back(std::vector<double>(b, b + 6));
    if (measure == "F") in[CLEAVE_FIELD_F].push_back(std::vector<double>(F, F + 9));
    if (needs_fiber) in[CLEAVE_FIELD_FIBER].push_back({frame[0], frame[3], frame[6]});
    if (instance.can(CLEAVE_NEEDS_SECOND_FIBER)) in[CLEAVE_FIELD_SECOND_FIBER].push_back({frame[1], frame[4], frame[7]});
    if (kind == elasticity_kind) in[CLEAVE_FIELD_DEGRADATION].push_back({random.uniform()});
    if (tangent) {
      std::vector<double> direction(9);
      for (double& x : direction) x = random.uniform(-1, 1);
      in[CLEAVE_FIELD_DELTA_F].push_back(direction);
    }
    if (kind != elasticity_kind && !state.empty()) in[CLEAVE_FIELD_STATE].push_back(state);
    if (kind == damage_kind) {
      if (instance.can(CLEAVE_NEEDS_TENSILE_ENERGY))
        in[CLEAVE_FIELD_TENSILE_ENERGY_IN].push_back({Material::tensile_energy(F)});
      if (instance.can(CLEAVE_NEEDS_EFFECTIVE_STRESS))
        in[CLEAVE_FIELD_EFFECTIVE_STRESS_IN].push_back(std::vector<double>(stress, stress + 6));
      in[CLEAVE_FIELD_DAMAGE].push_back({random.uniform()});
      in[CLEAVE_FIELD_TOUGHNESS].push_back({random.uniform(0.5, 2)});
    }
  }
  if (kind == elasticity_kind) {
    request.outputs[CLEAVE_FIELD_TAU] = 6;
    if (instance.can(CLEAVE_HAS_ENERGY))
      request.outputs[CLEAVE_FIELD_ENERGY] = request.outputs[CLEAVE_FIELD_TENSILE_ENERGY] = 1;
    if (instance.can(CLEAVE_HAS_EFFECTIVE_STRESS)) request.outputs[CLEAVE_FIELD_EFFECTIVE_STRESS] = 6;
    if (instance.can(CLEAVE_HAS_WAVE_MODULUS)) request.outputs[CLEAVE_FIELD_WAVE_MODULUS] = 1;
    if (piola) request.outputs[CLEAVE_FIELD_PIOLA] = 9;
    if (tangent) request.outputs[CLEAVE_FIELD_DELTA_P] = 9;
  } else {
    if (!state.empty()) request.outputs[CLEAVE_FIELD_STATE_OUT] = int(state.size());
    if (kind == plasticity_kind) {
      request.outputs[measure == "b" ? CLEAVE_FIELD_B_OUT : CLEAVE_FIELD_F_OUT] = measure == "b" ? 6 : 9;
      request.outputs[CLEAVE_FIELD_YIELDED] = 1;
    } else {
      request.outputs[instance.can(CLEAVE_DAMAGE_IS_LOCAL) ? CLEAVE_FIELD_DAMAGE_OUT : CLEAVE_FIELD_DRIVING_FORCE] = 1;
    }
  }
  return request;
}

double difference(const Answer& a, const Answer& b, cleave_field_id field) {
  const Field &x = a.outputs.at(field), &y = b.outputs.at(field);
  double largest = 0, scale = 0;
  for (std::size_t k = 0; k < x.size(); ++k) {
    if (a.status[k] >= CLEAVE_STATUS_RETRY && b.status[k] >= CLEAVE_STATUS_RETRY) continue;
    for (std::size_t i = 0; i < x[k].size(); ++i) {
      const double apart = std::abs(x[k][i] - y[k][i]);
      if (std::isnan(apart)) return std::numeric_limits<double>::infinity();
      largest = std::max(largest, apart);
      scale = std::max(scale, std::abs(x[k][i]));
    }
  }
  return largest == 0 ? 0 : largest / scale;
}

std::string first_difference(const Answer& a, const Answer& b, int skip) {
  for (std::size_t k = 0; k < a.status.size(); ++k) {
    if (int(k) == skip) continue;
    if (a.status[k] != b.status[k])
      return "the status of point " + std::to_string(k) + ": " + std::to_string(a.status[k]) + " and " +
             std::to_string(b.status[k]);
    if (a.status[k] >= CLEAVE_STATUS_RETRY) continue;
    for (const auto& [field, values] : a.outputs)
      if (std::memcmp(values[k].data(), b.outputs.at(field)[k].data(), values[k].size() * sizeof(double)) != 0)
        return std::string(name(field)) + " of point " + std::to_string(k);
  }
  return {};
}

}  // namespace cleave::testkit
