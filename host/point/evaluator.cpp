#include "point/evaluator.hpp"

#include "common/error.hpp"
#include "mpm/law_layout.hpp"
#include "plugins/message.hpp"

#include <Eigen/Dense>

#include <algorithm>
#include <array>
#include <cmath>
#include <limits>
#include <type_traits>

namespace cleave::point {
namespace {

constexpr std::uint32_t row = CLEAVE_TILE_BYTES;
enum Stream : std::uint32_t { stored = 0, scratch = 1 };

bool reads_strain(const plugins::Instance& law) { return law.can(CLEAVE_ACCEPTS_B) || law.can(CLEAVE_ACCEPTS_F); }

/// Hands out rows of a tile, one component each.
class Rows {
 public:
  explicit Rows(std::uint32_t stream) : stream_(stream) {}
  std::vector<cleave_component> take(int count) {
    std::vector<cleave_component> components;
    for (int i = 0; i < count; ++i) components.push_back({stream_, row * taken_++});
    return components;
  }
  std::uint32_t bytes() const { return row * taken_; }

 private:
  std::uint32_t stream_, taken_ = 0;
};

/// Where each quantity lives in the two streams of a batch.
struct Places {
  std::vector<cleave_component> deformation, left_cauchy_green, degradation, fiber, second_fiber, damage, plasticity_state,
      damage_state;
  std::vector<cleave_component> yielded, tau, energy, tensile_energy, effective_stress, driving_force, damage_out;
  std::uint32_t stored_stride, scratch_stride;

  explicit Places(const Laws& laws) {
    Rows in(stored), out(scratch);
    deformation = in.take(9);
    left_cauchy_green = in.take(6);
    degradation = in.take(1);
    fiber = in.take(3);
    second_fiber = in.take(3);
    damage = in.take(1);
    if (laws.plasticity) plasticity_state = in.take(laws.plasticity.description().state_components());
    if (laws.damage) damage_state = in.take(laws.damage.description().state_components());
    yielded = out.take(1);
    tau = out.take(6);
    energy = out.take(1);
    tensile_energy = out.take(1);
    effective_stress = out.take(6);
    driving_force = out.take(1);
    damage_out = out.take(1);
    stored_stride = in.bytes();
    scratch_stride = out.bytes();
  }
};

/// F of the returned state, where the mapping gave b alone.
Matrix3 returned_deformation(const Matrix3& trial, const Matrix3& returned_b) {
  const Eigen::JacobiSVD<Matrix3> svd(trial, Eigen::ComputeFullU | Eigen::ComputeFullV);
  const Matrix3 rotation = svd.matrixU() * svd.matrixV().transpose();
  const Eigen::SelfAdjointEigenSolver<Matrix3> eigen(returned_b);
  const Vector3 stretches = eigen.eigenvalues().cwiseMax(0).cwiseSqrt();
  return eigen.eigenvectors() * stretches.asDiagonal() * eigen.eigenvectors().transpose() * rotation;
}

Matrix3 cofactor(const Matrix3& a) {
  Matrix3 c;
  c.col(0) = a.col(1).cross(a.col(2));
  c.col(1) = a.col(2).cross(a.col(0));
  c.col(2) = a.col(0).cross(a.col(1));
  return c;
}

bool all_finite(const Response& r) {
  return r.kirchhoff.allFinite() && r.deformation.allFinite() && std::isfinite(r.energy) && std::isfinite(r.tensile_energy) &&
         std::isfinite(r.driving_force) && std::isfinite(r.damage) &&
         std::all_of(r.variables.begin(), r.variables.end(), [](double v) { return std::isfinite(v); });
}

template <class T>
class BatchEvaluator final : public Evaluator {
 public:
  explicit BatchEvaluator(const Laws& laws)
      : laws_(laws),
        places_(laws),
        common_b_(reads_b(laws.elasticity) && (!laws.plasticity || reads_b(laws.plasticity)) &&
                  (!laws.damage || !reads_strain(laws.damage) || reads_b(laws.damage))),
        return_mapping_{places_.stored_stride, places_.scratch_stride},
        elasticity_{places_.stored_stride, places_.scratch_stride},
        damage_{places_.stored_stride, places_.scratch_stride},
        stored_(tiles * places_.stored_stride / row),
        scratch_(tiles * places_.scratch_stride / row) {
    lay_out_return_mapping();
    lay_out_elasticity();
    lay_out_damage();
  }

  double epsilon() const override { return std::numeric_limits<T>::epsilon(); }

  void evaluate(std::span<const State> states, std::span<Response> responses) override {
    for (std::size_t start = 0; start < states.size(); start += batch_size) {
      const std::size_t count = std::min(batch_size, states.size() - start);
      evaluate_batch(states.subspan(start, count), responses.subspan(start, count));
    }
  }

 private:
  static constexpr std::size_t lanes = CLEAVE_TILE_BYTES / sizeof(T);
  static constexpr std::size_t tiles = batch_size / lanes;
  struct alignas(CLEAVE_TILE_BYTES) Row {
    T lane[lanes]{};
  };
  using Call = cleave_result (*)(const cleave_instance*, const cleave_batch*);

  static bool reads_b(const plugins::Instance& law) { return law.can(CLEAVE_ACCEPTS_B); }
  /// Whether this law is given b rather than F.
  bool given_b(const plugins::Instance& law) const { return common_b_ || !law.can(CLEAVE_ACCEPTS_F); }

  void add_inputs(mpm::LawLayout& layout, const plugins::Instance& law) const {
    if (reads_strain(law)) {
      if (given_b(law))
        layout.add(CLEAVE_FIELD_B, places_.left_cauchy_green);
      else
        layout.add(CLEAVE_FIELD_F, places_.deformation);
    }
    if (law.can(CLEAVE_NEEDS_FIBER) || law.can(CLEAVE_NEEDS_SECOND_FIBER)) layout.add(CLEAVE_FIELD_FIBER, places_.fiber);
    if (law.can(CLEAVE_NEEDS_SECOND_FIBER)) layout.add(CLEAVE_FIELD_SECOND_FIBER, places_.second_fiber);
  }

  void lay_out_return_mapping() {
    if (!laws_.plasticity) return;
    add_inputs(return_mapping_, laws_.plasticity);
    if (given_b(laws_.plasticity))
      return_mapping_.add(CLEAVE_FIELD_B_OUT, places_.left_cauchy_green);
    else
      return_mapping_.add(CLEAVE_FIELD_F_OUT, places_.deformation);
    return_mapping_.add(CLEAVE_FIELD_YIELDED, places_.yielded);
    if (!places_.plasticity_state.empty()) {
      return_mapping_.add(CLEAVE_FIELD_STATE, places_.plasticity_state);
      return_mapping_.add(CLEAVE_FIELD_STATE_OUT, places_.plasticity_state);
    }
  }

  void lay_out_elasticity() {
    const auto& law = laws_.elasticity.description();
    add_inputs(elasticity_, laws_.elasticity);
    elasticity_.add(CLEAVE_FIELD_DEGRADATION, places_.degradation);
    elasticity_.add(CLEAVE_FIELD_TAU, places_.tau);
    if (law.can(CLEAVE_HAS_ENERGY)) {
      elasticity_.add(CLEAVE_FIELD_ENERGY, places_.energy);
      elasticity_.add(CLEAVE_FIELD_TENSILE_ENERGY, places_.tensile_energy);
    }
    if (laws_.damage && laws_.damage.description().can(CLEAVE_NEEDS_EFFECTIVE_STRESS))
      elasticity_.add(CLEAVE_FIELD_EFFECTIVE_STRESS, places_.effective_stress);
  }

  void lay_out_damage() {
    if (!laws_.damage) return;
    const auto& law = laws_.damage.description();
    add_inputs(damage_, laws_.damage);
    damage_.add(CLEAVE_FIELD_DAMAGE, places_.damage);
    if (law.can(CLEAVE_NEEDS_TENSILE_ENERGY)) damage_.add(CLEAVE_FIELD_TENSILE_ENERGY_IN, places_.tensile_energy);
    if (law.can(CLEAVE_NEEDS_EFFECTIVE_STRESS)) damage_.add(CLEAVE_FIELD_EFFECTIVE_STRESS_IN, places_.effective_stress);
    if (!places_.damage_state.empty()) {
      damage_.add(CLEAVE_FIELD_STATE, places_.damage_state);
      damage_.add(CLEAVE_FIELD_STATE_OUT, places_.damage_state);
    }
    if (laws_.damage_is_local)
      damage_.add(CLEAVE_FIELD_DAMAGE_OUT, places_.damage_out);
    else
      damage_.add(CLEAVE_FIELD_DRIVING_FORCE, places_.driving_force);
  }

  T& value(const cleave_component& c, std::size_t k) {
    auto& rows = c.stream == stored ? stored_ : scratch_;
    const std::size_t stride = (c.stream == stored ? places_.stored_stride : places_.scratch_stride) / row;
    return rows[(k / lanes) * stride + c.offset / row].lane[k % lanes];
  }
  T& value(const std::vector<cleave_component>& place, std::size_t component, std::size_t k) {
    return value(place[component], k);
  }

  void put_matrix(std::size_t k, const Matrix3& a) {
    for (int i = 0; i < 9; ++i) value(places_.deformation, std::size_t(i), k) = T(a(i / 3, i % 3));
  }
  Matrix3 matrix(std::size_t k) {
    Matrix3 a;
    for (int i = 0; i < 9; ++i) a(i / 3, i % 3) = double(value(places_.deformation, std::size_t(i), k));
    return a;
  }
  void put_symmetric(const std::vector<cleave_component>& place, std::size_t k, const Matrix3& a) {
    const double components[6] = {a(0, 0), a(1, 1), a(2, 2), a(0, 1), a(0, 2), a(1, 2)};
    for (std::size_t i = 0; i < 6; ++i) value(place, i, k) = T(components[i]);
  }
  Matrix3 symmetric(const std::vector<cleave_component>& place, std::size_t k) {
    const auto at = [&](std::size_t i) { return double(value(place, i, k)); };
    Matrix3 a;
    a << at(0), at(3), at(4), at(3), at(1), at(5), at(4), at(5), at(2);
    return a;
  }
  void put_strain(std::size_t k, const Matrix3& deformation) {
    put_matrix(k, deformation);
    const Matrix3 stored_deformation = matrix(k);
    put_symmetric(places_.left_cauchy_green, k, stored_deformation * stored_deformation.transpose());
  }

  void put(std::size_t k, const State& state) {
    put_strain(k, state.deformation);
    value(places_.degradation, 0, k) = T(laws_.degradation(state.degrading_damage));
    value(places_.damage, 0, k) = T(state.damage);
    for (std::size_t i = 0; laws_.fibers && i < 3; ++i) {
      value(places_.fiber, i, k) = T(laws_.fibers->direction[Eigen::Index(i)]);
      value(places_.second_fiber, i, k) = T((*laws_.fibers->second)[Eigen::Index(i)]);
    }
    const std::size_t first = places_.plasticity_state.size();
    for (std::size_t i = 0; i < state.variables.size(); ++i)
      (i < first ? value(places_.plasticity_state, i, k) : value(places_.damage_state, i - first, k)) = T(state.variables[i]);
  }

  void call(const plugins::Instance& law, Call function, const mpm::LawLayout& layout, std::size_t count) {
    std::array<cleave_status, batch_size> status{};
    plugins::Message message;
    cleave_batch batch{};
    batch.struct_size = sizeof batch;
    batch.count = std::uint32_t(count);
    batch.layout = layout.get();
    batch.streams[stored] = stored_.data();
    batch.streams[scratch] = scratch_.data();
    batch.status = status.data();
    batch.message = message.get();
    const cleave_result result = function(law.handle(), &batch);
    if (result != CLEAVE_OK) throw SimulationError(law.description().id + " cannot go on: " + message.reason(result));
    for (std::size_t k = 0; k < count; ++k) worst_[k] = std::max(worst_[k], status[k]);
  }

  void return_to_yield_surface(std::size_t count) {
    std::array<Matrix3, batch_size> trial_b;
    for (std::size_t k = 0; k < count; ++k) trial_b[k] = symmetric(places_.left_cauchy_green, k);
    const auto& table = laws_.plasticity.plasticity();
    call(laws_.plasticity, std::is_same_v<T, float> ? table.return_map_f32 : table.return_map_f64, return_mapping_, count);
    for (std::size_t k = 0; k < count; ++k) {
      if (worst_[k] >= CLEAVE_STATUS_RETRY) {
        put_strain(k, Matrix3::Identity());
        continue;
      }
      if (!given_b(laws_.plasticity)) {
        deformation_[k] = matrix(k);
        const Matrix3 b = deformation_[k] * deformation_[k].transpose();
        put_symmetric(places_.left_cauchy_green, k, b);
        continue;
      }
      const Matrix3 b = symmetric(places_.left_cauchy_green, k);
      if (b == trial_b[k] || !b.allFinite()) continue;
      deformation_[k] = returned_deformation(deformation_[k], b);
      put_matrix(k, deformation_[k]);
    }
  }

  void evaluate_batch(std::span<const State> states, std::span<Response> responses) {
    const std::size_t count = states.size();
    const bool safe = laws_.elasticity.description().can(CLEAVE_INVERSION_SAFE);
    worst_.fill(CLEAVE_STATUS_OK);
    // The lanes that fill up the last tile are computed too, and have to hold something harmless.
    State harmless;
    harmless.variables = states.front().variables;
    for (std::size_t k = 0; k < batch_size; ++k) {
      if (k >= count) {
        put(k, harmless);
        continue;
      }
      put(k, states[k]);
      deformation_[k] = matrix(k);
      if (deformation_[k].allFinite() && (safe || deformation_[k].determinant() > 0)) continue;
      worst_[k] = CLEAVE_STATUS_FATAL;
      put_strain(k, Matrix3::Identity());
    }
    std::fill(scratch_.begin(), scratch_.end(), Row{});

    if (laws_.plasticity) return_to_yield_surface(count);
    const auto& elasticity = laws_.elasticity.elasticity();
    call(laws_.elasticity, std::is_same_v<T, float> ? elasticity.evaluate_f32 : elasticity.evaluate_f64, elasticity_, count);
    if (laws_.damage) {
      const auto& damage = laws_.damage.damage();
      call(laws_.damage, std::is_same_v<T, float> ? damage.drive_f32 : damage.drive_f64, damage_, count);
    }
    for (std::size_t k = 0; k < count; ++k) take(k, responses[k]);
  }

  void take(std::size_t k, Response& r) {
    r = Response{};
    r.status = worst_[k];
    if (!r.usable()) return;
    r.deformation = deformation_[k];
    r.volume_ratio = r.deformation.determinant();
    r.kirchhoff = symmetric(places_.tau, k);
    r.energy = double(value(places_.energy, 0, k));
    r.tensile_energy = double(value(places_.tensile_energy, 0, k));
    r.yielded = value(places_.yielded, 0, k) != 0;
    r.driving_force = double(value(places_.driving_force, 0, k));
    r.damage = double(value(places_.damage_out, 0, k));
    for (const auto* state : {&places_.plasticity_state, &places_.damage_state})
      for (const auto& component : *state) r.variables.push_back(double(value(component, k)));
    if (!all_finite(r)) {
      r.status = CLEAVE_STATUS_FATAL;
      return;
    }
    r.first_piola = r.kirchhoff * cofactor(r.deformation) / r.volume_ratio;
    if (r.first_piola.allFinite()) return;
    r.first_piola.setConstant(std::numeric_limits<double>::quiet_NaN());
    r.status = CLEAVE_STATUS_UNRELIABLE;
  }

  const Laws& laws_;
  Places places_;
  bool common_b_;
  mpm::LawLayout return_mapping_, elasticity_, damage_;
  std::vector<Row> stored_, scratch_;
  std::array<Matrix3, batch_size> deformation_;  ///< trial, then returned
  std::array<cleave_status, batch_size> worst_{};
};

}  // namespace

std::unique_ptr<Evaluator> make_evaluator(const Laws& laws) {
  if (laws.precision == config::Precision::single_precision) return std::make_unique<BatchEvaluator<float>>(laws);
  return std::make_unique<BatchEvaluator<double>>(laws);
}

std::vector<double> initial_variables(const Laws& laws) {
  std::vector<double> variables;
  for (const auto* law : {&laws.plasticity, &laws.damage}) {
    if (!*law) continue;
    const auto initial = law->initial_state();
    variables.insert(variables.end(), initial.begin(), initial.end());
  }
  return variables;
}

}  // namespace cleave::point
