#include "discretization/elastic_response.hpp"

#include "plugins/message.hpp"

#include <fmt/format.h>
#include <spdlog/spdlog.h>

#include <Eigen/Eigenvalues>
#include <algorithm>
#include <cmath>
#include <cstring>
#include <limits>

namespace cleave::discretization {
namespace {

constexpr std::uint32_t lanes = CLEAVE_TILE_BYTES / sizeof(double);
constexpr std::uint32_t batch_tiles = 4, batch_points = batch_tiles * lanes;

/// Rows of a tile: F, dF, P (or dP, or tau), the energy (or M), fibers and b.
enum : std::uint32_t {
  deformation_row = 0,
  delta_row = 9,
  stress_row = 18,
  scalar_row = 27,
  fiber_row = 28,
  second_fiber_row = 31,
  b_row = 34,
  row_count = 40
};

std::vector<cleave_component> rows(std::uint32_t first, std::uint32_t count) {
  std::vector<cleave_component> components;
  for (std::uint32_t i = first; i < first + count; i++) components.push_back({0, i * CLEAVE_TILE_BYTES});
  return components;
}

double determinant(const double* F) {
  return F[0] * (F[4] * F[8] - F[5] * F[7]) - F[1] * (F[3] * F[8] - F[5] * F[6]) + F[2] * (F[3] * F[7] - F[4] * F[6]);
}

cleave_field_id stress_of(const plugins::Instance& law) {
  return law.can(CLEAVE_HAS_PIOLA) ? CLEAVE_FIELD_PIOLA : CLEAVE_FIELD_TAU;
}

void write(const std::string& text, cleave_message* message) {
  if (!message || !message->text || message->text_capacity == 0) return;
  const std::size_t length = std::min<std::size_t>(text.size(), message->text_capacity - 1);
  std::memcpy(message->text, text.data(), length);
  message->text[length] = 0;
}

}  // namespace

struct ElasticResponse::Tiles {
  alignas(CLEAVE_TILE_BYTES) double at[batch_tiles][row_count][lanes];
  double& value(std::uint64_t point, std::uint32_t row) { return at[point / lanes][row][point % lanes]; }
};

ElasticResponse::Watched::Watched(const plugins::Instance& law, mpm::LawLayout layout, mpm::BatchOrigin origin)
    : layout_(std::move(layout)),
      watch_({law.handle(), law.elasticity().evaluate_f64, layout_.get()}, false,
             [&] {
               origin.failed = law.description().id;
               origin.wanted = mpm::LawWatch::outputs_of({law.handle(), law.elasticity().evaluate_f64, layout_.get()});
               return mpm::batch_header(origin);
             }()),
      call_(watch_.watched()) {}

ElasticResponse::ElasticResponse(const plugins::Instance& law, std::string body, scene::FiberField fibers,
                                 mpm::BatchOrigin origin, std::int64_t first_particle)
    : law_(law),
      body_(std::move(body)),
      fibers_(std::move(fibers)),
      first_particle_(first_particle),
      takes_b_(!law.can(CLEAVE_ACCEPTS_F)),
      stress_(bind(origin, law.can(CLEAVE_HAS_PIOLA) || !takes_b_, false, {stress_of(law)})),
      energy_(bind(origin, !takes_b_, false, {CLEAVE_FIELD_ENERGY})),
      stress_and_energy_(bind(origin, law.can(CLEAVE_HAS_PIOLA) || !takes_b_, false, {stress_of(law), CLEAVE_FIELD_ENERGY})),
      differential_(bind(origin, true, true, {CLEAVE_FIELD_DELTA_P})),
      wave_modulus_(bind(origin, !takes_b_, false, {CLEAVE_FIELD_WAVE_MODULUS})) {
  table_ = {sizeof table_, 0, this, &evaluate, &differential, &wave_modulus};
}

auto ElasticResponse::bind(const mpm::BatchOrigin& origin, bool deformation, bool delta,
                           std::initializer_list<cleave_field_id> outputs) const -> Watched {
  mpm::LawLayout layout{row_count * CLEAVE_TILE_BYTES};
  if (deformation)
    layout.add(CLEAVE_FIELD_F, rows(deformation_row, 9));
  else
    layout.add(CLEAVE_FIELD_B, rows(b_row, 6));
  if (delta) layout.add(CLEAVE_FIELD_DELTA_F, rows(delta_row, 9));
  if (law_.can(CLEAVE_NEEDS_FIBER) || law_.can(CLEAVE_NEEDS_SECOND_FIBER)) layout.add(CLEAVE_FIELD_FIBER, rows(fiber_row, 3));
  if (law_.can(CLEAVE_NEEDS_SECOND_FIBER)) layout.add(CLEAVE_FIELD_SECOND_FIBER, rows(second_fiber_row, 3));
  for (const auto output : outputs) {
    const bool scalar = output == CLEAVE_FIELD_ENERGY || output == CLEAVE_FIELD_WAVE_MODULUS;
    layout.add(output, scalar ? rows(scalar_row, 1) : rows(stress_row, output == CLEAVE_FIELD_TAU ? 6 : 9));
  }
  return {law_, std::move(layout), origin};
}

/// Lanes beyond the last point repeat it, so that a point's neighbours never are what an earlier call has left.
void ElasticResponse::gather(const Call& call, std::uint64_t begin, std::uint64_t points, Tiles& tiles) const {
  const bool fibers = law_.can(CLEAVE_NEEDS_FIBER) || law_.can(CLEAVE_NEEDS_SECOND_FIBER);
  const std::uint64_t filled = (points + lanes - 1) / lanes * lanes;
  for (std::uint64_t i = 0; i < filled; i++) {
    const std::uint64_t n = begin + std::min(i, points - 1), k = call.same_point ? 0 : n;
    const auto set = [&](std::uint32_t row, const double* values, std::uint32_t count) {
      for (std::uint32_t c = 0; c < count; c++) tiles.value(i, row + c) = values[c];
    };
    const double* F = call.F + 9 * k;
    set(deformation_row, F, 9);
    if (call.dF) set(delta_row, call.dF + 9 * n, 9);
    if (fibers) set(fiber_row, fibers_.first[call.first + k].data(), 3);
    if (law_.can(CLEAVE_NEEDS_SECOND_FIBER)) set(second_fiber_row, fibers_.second[call.first + k].data(), 3);
    if (!takes_b_) continue;
    constexpr std::uint32_t pairs[6][2] = {{0, 0}, {1, 1}, {2, 2}, {0, 1}, {0, 2}, {1, 2}};
    for (std::uint32_t c = 0; c < 6; c++) {
      const double *row = F + 3 * pairs[c][0], *other = F + 3 * pairs[c][1];
      tiles.value(i, b_row + c) = row[0] * other[0] + row[1] * other[1] + row[2] * other[2];
    }
  }
}

template <class Each>
cleave_result ElasticResponse::for_batches(const Call& call, cleave_message* message, const Each& each) const {
  Tiles tiles;
  plugins::Message said;
  for (std::uint64_t begin = 0; begin < call.count; begin += batch_points) {
    const std::uint64_t points = std::min<std::uint64_t>(batch_points, call.count - begin);
    const auto point_of = [&](std::uint64_t i) { return call.first + (call.same_point ? 0 : begin + i); };
    gather(call, begin, points, tiles);
    cleave_status status[mpm::chunk_points] = {};
    static_assert(batch_points <= mpm::chunk_points);
    cleave_batch batch{};
    batch.struct_size = sizeof batch;
    batch.count = std::uint32_t(points);
    batch.layout = call.law.layout();
    batch.streams[0] = &tiles;
    batch.status = status;
    batch.message = said.get();
    const cleave_result result = call.law(batch);
    const auto fail = [&](std::uint64_t point, const std::string& what) {
      const std::string text = words(point, what);
      keep(text, call, begin, batch, result);
      write(text, message);
      return CLEAVE_ERROR_INTERNAL;
    };
    if (!law_.can(CLEAVE_INVERSION_SAFE))
      for (std::uint64_t i = 0; i < (call.same_point ? 1 : points); i++)
        if (const double J = determinant(call.F + 9 * (point_of(i) - call.first)); !(J > 0))
          return fail(point_of(i), fmt::format("det F = {:.4g}, where {} is not defined", J, law_.description().id));
    const auto worst = std::max_element(status, status + points);
    const std::uint64_t point = point_of(std::uint64_t(worst - status));
    if (*worst >= CLEAVE_STATUS_RETRY) return fail(point, law_.description().id + " has no valid result");
    if (result != CLEAVE_OK) return fail(point, law_.description().id + " failed: " + said.reason(result));
    if (*worst == CLEAVE_STATUS_UNRELIABLE && !warned_.exchange(true))
      spdlog::warn("point {} of body '{}': what {} gives is outside of its validity; said once", point, body_,
                   law_.description().id);
    each(tiles, begin, points);
  }
  return CLEAVE_OK;
}

std::string ElasticResponse::words(std::uint64_t point, const std::string& what) const {
  return fmt::format("point {} of body '{}': {}", point, body_, what);
}

void ElasticResponse::keep(const std::string& words, const Call& call, std::uint64_t begin, const cleave_batch& batch,
                           cleave_result result) const {
  Failure failure{words, &call.law.watch(), {}, {}};
  if (mpm::LawWatch::outputs_of({law_.handle(), law_.elasticity().evaluate_f64, call.law.layout()}).empty()) return;
  failure.batch.returned = true;
  failure.batch.result = result;
  failure.law->read(failure.batch, batch, nullptr);  // nothing is written where something is read
  for (std::uint64_t i = 0; i < batch.count; i++)
    failure.particles.push_back(first_particle_ + std::int64_t(call.first + (call.same_point ? 0 : begin + i)));
  const std::lock_guard lock(failures_mutex_);
  if (failures_.size() == most_failures) failures_.pop_front();
  failures_.push_back(std::move(failure));
}

std::string ElasticResponse::failed_batch(const std::string& reason) const {
  const std::lock_guard lock(failures_mutex_);
  const auto named = [&](const Failure& failure) { return reason.find(failure.words) != std::string::npos; };
  const auto failure = std::find_if(failures_.rbegin(), failures_.rend(), named);
  if (failure == failures_.rend()) return {};
  std::string text;
  const mpm::Put append = [](void* sink, const char* part, std::size_t size) {
    static_cast<std::string*>(sink)->append(part, size);
  };
  mpm::write_batch(append, &text, failure->law->header().c_str(), failure->batch.result == CLEAVE_OK ? "status" : "error",
                   failure->batch, false, failure->particles.data());
  return text;
}

void ElasticResponse::forget_failures() {
  const std::lock_guard lock(failures_mutex_);
  failures_.clear();
}

cleave_result ElasticResponse::evaluate(void* self, std::uint64_t first, std::uint64_t count, const double* F, double* energy,
                                        double* P, cleave_message* message) {
  const auto& s = *static_cast<const ElasticResponse*>(self);
  const bool offers_energy = s.law_.can(CLEAVE_HAS_ENERGY);
  if (energy && !offers_energy) std::fill_n(energy, count, std::numeric_limits<double>::quiet_NaN());
  if (!offers_energy) energy = nullptr;
  if (!energy && !P) return CLEAVE_OK;
  const auto& law = !P ? s.energy_ : energy ? s.stress_and_energy_ : s.stress_;
  const bool piola = s.law_.can(CLEAVE_HAS_PIOLA);
  if (P && !piola)
    for (std::uint64_t i = 0; i < count; i++)
      if (determinant(F + 9 * i) == 0) {
        write(s.words(first + i, "det F = 0, where " + s.law_.description().id + " gives no P"), message);
        return CLEAVE_ERROR_INTERNAL;
      }
  return s.for_batches({law, first, count, F}, message, [&](Tiles& tiles, std::uint64_t begin, std::uint64_t points) {
    for (std::uint64_t i = 0; i < points; i++) {
      if (energy) energy[begin + i] = tiles.value(i, scalar_row);
      if (!P) continue;
      double* out = P + 9 * (begin + i);
      if (piola) {
        for (std::uint32_t c = 0; c < 9; c++) out[c] = tiles.value(i, stress_row + c);
        continue;
      }
      // P = tau F^-T = tau cof(F)/det F
      constexpr std::uint32_t symmetric[3][3] = {{0, 3, 4}, {3, 1, 5}, {4, 5, 2}};
      const double *f = F + 9 * (begin + i), scale = 1 / determinant(f);
      double cofactor[3][3];
      for (int a = 0; a < 3; a++)
        for (int b = 0; b < 3; b++) {
          const int a1 = 3 * ((a + 1) % 3), a2 = 3 * ((a + 2) % 3), b1 = (b + 1) % 3, b2 = (b + 2) % 3;
          cofactor[a][b] = f[a1 + b1] * f[a2 + b2] - f[a1 + b2] * f[a2 + b1];
        }
      for (int a = 0; a < 3; a++)
        for (int b = 0; b < 3; b++) {
          double sum = 0;
          for (int c = 0; c < 3; c++) sum += tiles.value(i, stress_row + symmetric[a][c]) * cofactor[c][b];
          out[3 * a + b] = scale * sum;
        }
    }
  });
}

cleave_result ElasticResponse::differential(void* self, std::uint64_t first, std::uint64_t count, const double* F,
                                            const double* dF, double* dP, cleave_message* message) {
  const auto& s = *static_cast<const ElasticResponse*>(self);
  if (!s.law_.can(CLEAVE_HAS_TANGENT)) {
    write(s.law_.description().id + " declares no tangent, which implicit steps and static equilibrium need", message);
    return CLEAVE_ERROR_UNSUPPORTED;
  }
  return s.for_batches({s.differential_, first, count, F, dF}, message,
                       [&](Tiles& tiles, std::uint64_t begin, std::uint64_t points) {
                         for (std::uint64_t i = 0; i < points; i++)
                           for (std::uint32_t c = 0; c < 9; c++) dP[9 * (begin + i) + c] = tiles.value(i, stress_row + c);
                       });
}

cleave_result ElasticResponse::wave_modulus(void* self, std::uint64_t first, std::uint64_t count, const double* F,
                                            double* modulus, cleave_message* message) {
  const auto& s = *static_cast<const ElasticResponse*>(self);
  if (!s.law_.can(CLEAVE_HAS_WAVE_MODULUS)) {
    write(s.law_.description().id + " declares no wave modulus, from which the stable step is chosen", message);
    return CLEAVE_ERROR_UNSUPPORTED;
  }
  return s.for_batches(
      {s.wave_modulus_, first, count, F}, message, [&](Tiles& tiles, std::uint64_t begin, std::uint64_t points) {
        for (std::uint64_t i = 0; i < points; i++)
          modulus[begin + i] = s.rest_modulus(first + begin + i, F + 9 * (begin + i), tiles.value(i, scalar_row));
      });
}

/// A front of rest normal N that moves at c_0 is seen to move at c = c_0/|F^-T N| in the present configuration, so that
/// c_0 <= c/sigma, sigma the least stretch. Where that is small the stiffness itself is the closer bound.
double ElasticResponse::rest_modulus(std::uint64_t point, const double* F, double present) const {
  const Eigen::Map<const Eigen::Matrix<double, 3, 3, Eigen::RowMajor>> f(F);
  const Matrix3 C = f.transpose() * f;
  const double least = Eigen::SelfAdjointEigenSolver<Matrix3>().computeDirect(C, Eigen::EigenvaluesOnly).eigenvalues()[0];
  const double bound = least > 0 ? present / least : std::numeric_limits<double>::infinity();
  if (least > 0.5 || !law_.can(CLEAVE_HAS_TANGENT)) return bound;
  // Norms of A = dP/dF: a wave sees m_i N_J A_iJkL m_k N_L with unit m and N.
  double dF[81] = {}, A[81];
  for (int c = 0; c < 9; c++) dF[10 * c] = 1;
  const auto copy = [&](Tiles& tiles, std::uint64_t begin, std::uint64_t points) {
    for (std::uint64_t i = 0; i < points; i++)
      for (std::uint32_t c = 0; c < 9; c++) A[9 * (begin + i) + c] = tiles.value(i, stress_row + c);
  };
  if (for_batches({differential_, point, 9, F, dF, true}, nullptr, copy) != CLEAVE_OK) return bound;
  const Eigen::Map<const Eigen::Matrix<double, 9, 9, Eigen::RowMajor>> tangent(A);
  return std::min({bound, tangent.norm(), tangent.cwiseAbs().rowwise().sum().maxCoeff()});
}

}  // namespace cleave::discretization
