// An elastic law written against the C header, whole except for the one defect of defects.def it was loaded to have.
//
//   psi_plus  = mu/2 (|F|^2 - 3) - mu (J - 1) + [J >= 1] lambda/2 (J - 1)^2        lambda = kappa + mu
//   psi_minus = [J < 1] lambda/2 (J - 1)^2        psi_fiber = sum_i k_i/2 (|F a_i| - 1)^2
//   P = g mu F + ((J >= 1 ? g : 1) lambda (J - 1) - g mu) cof F + sum_i k_i (1 - 1/|F a_i|) F a_i a_i^T
//
// It goes through inversion; computed in double, whatever the batch holds.
#include <cleave/elasticity.h>

#include <cmath>
#include <cstdint>
#include <cstdio>
#include <cstring>
#include <limits>
#include <stdexcept>

#include "kit/broken.hpp"

struct cleave_instance {
  double shear, bulk, fiber_scale, cross_fiber_scale;
};

namespace {

struct Vector {
  double x[3];
};
struct Matrix {
  double x[9];
  Vector operator*(const Vector& v) const {
    return {{x[0] * v.x[0] + x[1] * v.x[1] + x[2] * v.x[2], x[3] * v.x[0] + x[4] * v.x[1] + x[5] * v.x[2],
             x[6] * v.x[0] + x[7] * v.x[1] + x[8] * v.x[2]}};
  }
};
double dot(const Vector& a, const Vector& b) { return a.x[0] * b.x[0] + a.x[1] * b.x[1] + a.x[2] * b.x[2]; }
void add(Matrix& a, double scale, const Matrix& b) {
  for (int i = 0; i < 9; ++i) a.x[i] += scale * b.x[i];
}
void add_outer(Matrix& a, double scale, const Vector& u, const Vector& v) {
  for (int i = 0; i < 9; ++i) a.x[i] += scale * u.x[i / 3] * v.x[i % 3];
}
/// Bilinear, and symmetric in a and b: cofactors(F, F) = 2 cof F.
Matrix cofactors(const Matrix& a, const Matrix& b) {
  Matrix c;
  for (int i = 0; i < 3; ++i)
    for (int j = 0; j < 3; ++j) {
      const int r = 3 * ((i + 1) % 3), s = 3 * ((i + 2) % 3), k = (j + 1) % 3, l = (j + 2) % 3;
      c.x[3 * i + j] = a.x[r + k] * b.x[s + l] - a.x[r + l] * b.x[s + k] + b.x[r + k] * a.x[s + l] - b.x[r + l] * a.x[s + k];
    }
  return c;
}

struct Point {
  Matrix F, dF;
  double g;
  Vector fibers[3];
  double fiber_stiffness[3];
};

/// One point; the members are the formulas of the heading.
struct Law {
  double mu, lambda;
  const Point& p;
  Matrix cofactor;
  double J, squares;

  Law(const cleave_instance& instance, const Point& point)
      : mu(instance.shear),
        lambda(instance.bulk + instance.shear),
        p(point),
        cofactor(cofactors(point.F, point.F)),
        squares(0) {
    for (double& x : cofactor.x) x /= 2;
    J = 0;
    for (int j = 0; j < 3; ++j) J += p.F.x[j] * cofactor.x[j];
    for (double x : p.F.x) squares += x * x;
  }

  double sign() const { return broken("pushes_away_inverted") && J < 0 ? -1 : 1; }
  /// What psi_plus has of the energies of shape and of expansion, and the factors of shape and volume in psi.
  double shape_share() const { return broken("negative_rest") ? 3 : 1; }
  double expansion_share() const { return broken("negative_tensile_energy") ? -2 : 1; }
  double shape_factor(double g) const { return 1 + shape_share() * (g - 1); }
  double volume_factor(double g) const {
    return J >= 1 || broken("degrades_compression") ? 1 + expansion_share() * (g - 1) : 1;
  }
  double shape() const { return mu * (0.5 * (squares - 3) - (sign() * J - 1)); }
  double volume() const { return 0.5 * lambda * (sign() * J - 1) * (sign() * J - 1); }

  double tensile_energy() const {
    double psi = shape_share() * shape() + (J >= 1 ? expansion_share() * volume() : 0);
    if (broken("energy_jumps") && J > 1 + 1e-12) psi += 1e-3 * mu;
    if (broken("energy_at_rest")) psi += 1e-6 * mu;
    return psi;
  }
  double energy() const {
    double psi = p.g * tensile_energy() + (1 - shape_share()) * shape();
    psi += (J >= 1 ? 1 - expansion_share() : volume_factor(p.g)) * volume();
    for (int i = 0; i < 3; ++i) {
      const Vector f = p.F * p.fibers[i];
      const double extension = std::sqrt(dot(f, f)) - 1;
      psi += 0.5 * p.fiber_stiffness[i] * extension * extension;
    }
    return psi;
  }

  /// P F^T, with the fibres from `first_fiber` on.
  Matrix stress(double g, int first_fiber) const {
    if (broken("stress_ignores_g")) g = 1;
    Matrix tau{};
    for (int i = 0; i < 3; ++i)
      for (int j = 0; j < 3; ++j)
        for (int k = 0; k < 3; ++k) tau.x[3 * i + j] += shape_factor(g) * mu * p.F.x[3 * i + k] * p.F.x[3 * j + k];
    const double slope = sign() * (volume_factor(g) * lambda * (sign() * J - 1) - shape_factor(g) * mu);
    const double dissipation = broken("dissipates") ? 1e-7 * mu * (J - 1) : 0;
    for (int i = 0; i < 9; ++i) tau.x[i] *= 1 + dissipation / mu;
    for (int i = 0; i < 9; i += 4) tau.x[i] += J * slope + (broken("stress_at_rest") ? 1e-10 * mu : 0);
    for (int i = first_fiber; i < 3; ++i) {
      const Vector f = p.F * p.fibers[i];
      const double length = std::fmax(std::sqrt(dot(f, f)), 1e-6);
      add_outer(tau, p.fiber_stiffness[i] * (1 - 1 / length), f, f);
    }
    if (broken("not_objective")) tau.x[0] *= 1 + 1e-7;
    if (broken("stress_off_energy"))
      for (double& x : tau.x) x *= 1.001;
    if (broken("undefined_when_flat") && J == 0) tau.x[0] = std::numeric_limits<double>::quiet_NaN();
    return tau;
  }

  /// P of the heading, for f without length the limit at 1e-6 of its length at rest.
  Matrix piola() const {
    const double g = broken("stress_ignores_g") || broken("piola_ignores_g") ? 1 : p.g;
    const double size = broken("stress_off_energy") ? 1.001 : 1;
    Matrix P{};
    if (broken("piola_divides_by_J")) {
      const Matrix tau = stress(g, 0);
      for (int i = 0; i < 9; ++i)
        for (int k = 0; k < 3; ++k) P.x[i] += tau.x[3 * (i / 3) + k] * cofactor.x[3 * k + i % 3] / J;
      return P;
    }
    add(P, size * shape_factor(g) * mu * (broken("dissipates") ? 1 + 1e-7 * (J - 1) : 1), p.F);
    add(P, size * sign() * (volume_factor(g) * lambda * (sign() * J - 1) - shape_factor(g) * mu), cofactor);
    for (int i = 0; i < 3; ++i) {
      const Vector f = p.F * p.fibers[i];
      const double length = std::fmax(std::sqrt(dot(f, f)), 1e-6);
      add_outer(P, size * p.fiber_stiffness[i] * (1 - 1 / length), f, p.fibers[i]);
    }
    if (broken("piola_off")) add(P, 1e-8, P);
    if (broken("piola_off_when_flat") && std::abs(J) < 1e-12) add(P, 1e-3, P);
    return P;
  }

  Matrix delta_piola() const {
    const double g = broken("stress_ignores_g") ? 1 : p.g;
    double dJ = 0;
    for (int i = 0; i < 9; ++i) dJ += cofactor.x[i] * p.dF.x[i];
    Matrix dP{};
    add(dP, shape_factor(g) * mu, p.dF);
    add(dP, volume_factor(g) * lambda * dJ, cofactor);
    add(dP, sign() * (volume_factor(g) * lambda * (sign() * J - 1) - shape_factor(g) * mu), cofactors(p.F, p.dF));
    for (int i = 0; i < 3; ++i) {
      const Vector f = p.F * p.fibers[i], df = p.dF * p.fibers[i];
      const double length = std::fmax(std::sqrt(dot(f, f)), 1e-6), k = p.fiber_stiffness[i];
      add_outer(dP, k * (1 - 1 / length), df, p.fibers[i]);
      add_outer(dP, k * dot(f, df) / (length * length * length), f, p.fibers[i]);
    }
    if (broken("stress_off_energy")) add(dP, 0.001, dP);
    if (broken("tangent_off")) add(dP, 1e-4, dP);
    if (broken("tangent_off_inverted") && J < 0) add(dP, 1e-3, dP);
    if (broken("tangent_undefined_when_flat") && J == 0) dP.x[0] = std::numeric_limits<double>::quiet_NaN();
    if (broken("tangent_not_symmetric")) dP.x[1] += 1e-7 * mu * p.dF.x[5];
    return dP;
  }

  /// Not degraded: an upper bound all the more.
  double wave_modulus() const {
    if (broken("wave_stands") && J < 0.95) return 0;
    double bound = mu * squares + std::fmax(1, volume_factor(p.g)) * lambda * J * J;
    for (int i = broken("wave_without_fibers") ? 2 : 0; i < 3; ++i) {
      const Vector f = p.F * p.fibers[i];
      bound += p.fiber_stiffness[i] * dot(f, f);
    }
    return bound;
  }
};

/* ------------------------------------------------------------------ batches */

template <class Real>
struct Batch {
  const cleave_batch& batch;
  const cleave_component* field(cleave_field_id id) const {
    const cleave_layout& layout = *batch.layout;
    return std::uint32_t(id) < layout.field_count && layout.fields[id].count ? layout.components + layout.fields[id].first
                                                                             : nullptr;
  }
  char* address(const cleave_component& c, std::uint32_t k) const {
    constexpr std::uint32_t lanes = CLEAVE_TILE_BYTES / sizeof(Real);
    return static_cast<char*>(batch.streams[c.stream]) + std::size_t(k / lanes) * batch.layout->stride[c.stream] + c.offset +
           k % lanes * sizeof(Real);
  }
  void load(cleave_field_id id, std::uint32_t k, double* values, int count) const {
    if (const auto* c = field(id))
      for (int i = 0; i < count; ++i) {
        Real value;
        std::memcpy(&value, address(c[i], k), sizeof value);
        values[i] = double(value);
      }
  }
  void store(cleave_field_id id, std::uint32_t k, const double* values, int count) const {
    const auto* c = field(id);
    for (int i = 0; c && i < count; ++i) {
      const Real value = Real(values[i]);
      std::memcpy(address(c[i], k), &value, sizeof value);
      if (!std::isfinite(value) && !broken("undefined_when_flat")) batch.status[k] = CLEAVE_STATUS_FATAL;
    }
  }
  void store_symmetric(cleave_field_id id, std::uint32_t k, const Matrix& a, double scale) const {
    const double values[6] = {scale * a.x[0], scale * a.x[4], scale * a.x[8], scale * a.x[1], scale * a.x[2], scale * a.x[5]};
    store(id, k, values, 6);
  }

  cleave_result evaluate(const cleave_instance& instance) const {
    if (broken("throws") && batch.count == 100) throw std::runtime_error("a hundred are too many");
    const bool tangent = field(CLEAVE_FIELD_DELTA_P);
    if (!field(CLEAVE_FIELD_F) || (tangent && !field(CLEAVE_FIELD_DELTA_F))) return CLEAVE_ERROR_UNSUPPORTED;
    for (std::uint32_t k = 0; k < batch.count; ++k) {
      Point p{{}, {}, 1, {{{1, 0, 0}}, {{0, 1, 0}}, {{1, 0, 0}}}, {}};
      load(CLEAVE_FIELD_F, k, p.F.x, 9);
      load(CLEAVE_FIELD_DELTA_F, k, p.dF.x, 9);
      load(CLEAVE_FIELD_DEGRADATION, k, &p.g, 1);
      load(CLEAVE_FIELD_FIBER, k, p.fibers[0].x, 3);
      load(CLEAVE_FIELD_SECOND_FIBER, k, p.fibers[1].x, 3);
      p.fiber_stiffness[0] = instance.fiber_scale * instance.shear;
      p.fiber_stiffness[1] = instance.cross_fiber_scale * instance.shear;
      p.fiber_stiffness[2] = broken("not_isotropic") ? 0.01 * instance.shear : 0;
      if (broken("fibers_have_heads")) p.fiber_stiffness[0] *= 1 + 0.1 * p.fibers[0].x[0];
      for (int i = 0; broken("slack_fibers") && i < 2; ++i) {
        const Vector f = p.F * p.fibers[i];
        if (dot(f, f) < 1) p.fiber_stiffness[i] = 0;
      }
      double sum = p.g;
      for (double x : p.F.x) sum += x;
      if (!std::isfinite(sum)) batch.status[k] = CLEAVE_STATUS_FATAL;

      const Law law(instance, p);
      const double energy = law.energy(), tension = law.tensile_energy(), wave = law.wave_modulus();
      store_symmetric(CLEAVE_FIELD_TAU, k, law.stress(p.g, 0), 1);
      store(CLEAVE_FIELD_ENERGY, k, &energy, 1);
      store(CLEAVE_FIELD_TENSILE_ENERGY, k, &tension, 1);
      store_symmetric(CLEAVE_FIELD_EFFECTIVE_STRESS, k, law.stress(broken("effective_stress_degraded") ? p.g : 1, 2),
                      1 / std::copysign(std::fmax(std::abs(law.J), 1e-3), law.J));
      store(CLEAVE_FIELD_WAVE_MODULUS, k, &wave, 1);
      if (field(CLEAVE_FIELD_PIOLA)) store(CLEAVE_FIELD_PIOLA, k, law.piola().x, 9);
      if (tangent) store(CLEAVE_FIELD_DELTA_P, k, law.delta_piola().x, 9);
    }
    return CLEAVE_OK;
  }
};

cleave_result evaluate_f32(const cleave_instance* instance, const cleave_batch* batch) {
  return Batch<float>{*batch}.evaluate(*instance);
}
cleave_result evaluate_f64(const cleave_instance* instance, const cleave_batch* batch) {
  return Batch<double>{*batch}.evaluate(*instance);
}

/* ------------------------------------------------------------------ tables */

constexpr cleave_elasticity elasticity{sizeof(cleave_elasticity), 0, evaluate_f32, evaluate_f64};

constexpr cleave_parameter_schema number(const char* key, const char* unit, const char* description, bool positive,
                                         std::uint64_t needs) {
  cleave_parameter_schema p{};
  p.struct_size = sizeof p;
  p.type = CLEAVE_TYPE_NUMBER;
  p.key = key;
  p.unit = unit;
  p.description = description;
  p.required = positive;
  p.maximum = std::numeric_limits<double>::infinity();
  p.minimum_open = positive;
  p.physical_minimum = positive ? 1 : 0;
  p.physical_maximum = positive ? 1e9 : 1000;
  p.needs[0] = needs;
  return p;
}
constexpr cleave_parameter_schema shear_modulus = number("shear_modulus", "Pa", "mu", true, 0),
                                  bulk_modulus = number("bulk_modulus", "Pa", "kappa", true, 0),
                                  fiber_scale = number("fiber_scale", "1", "k of the first fibre in multiples of mu", false,
                                                       CLEAVE_NEEDS_FIBER),
                                  cross_fiber_scale =
                                      number("cross_fiber_scale", "1", "k of the second fibre in multiples of mu", false,
                                             CLEAVE_NEEDS_FIBER | CLEAVE_NEEDS_SECOND_FIBER);
constexpr const cleave_parameter_schema* parameters[] = {&shear_modulus, &bulk_modulus, &fiber_scale, &cross_fiber_scale};
constexpr cleave_schema schema = [] {
  cleave_schema all{};
  all.struct_size = sizeof all;
  all.parameter_count = 4;
  all.parameters = parameters;
  all.capabilities = CLEAVE_ACCEPTS_F | CLEAVE_ISOTROPIC | CLEAVE_INVERSION_SAFE | CLEAVE_HAS_ENERGY | CLEAVE_HAS_TANGENT |
                     CLEAVE_HAS_WAVE_MODULUS | CLEAVE_HAS_EFFECTIVE_STRESS | CLEAVE_HAS_PIOLA | CLEAVE_SINGLE | CLEAVE_DOUBLE;
  return all;
}();

void write(char* to, std::uint32_t capacity, const char* text) {
  if (to && capacity) std::snprintf(to, capacity, "%s", text);
}
cleave_result refuse(cleave_message* message, const char* subject, const char* text) {
  if (message && CLEAVE_HAS(cleave_message, message, text)) write(message->text, message->text_capacity, text);
  if (message && CLEAVE_HAS(cleave_message, message, subject)) write(message->subject, message->subject_capacity, subject);
  return CLEAVE_ERROR_PARAMETER;
}

cleave_result create(const cleave_parameters* given, const cleave_context*, cleave_instance** instance,
                     cleave_message* message) {
  double values[4] = {std::nan(""), std::nan(""), 0, 0};
  *instance = nullptr;
  for (std::uint32_t i = 0; i < given->count; ++i) {
    const auto* p = reinterpret_cast<const cleave_parameter*>(reinterpret_cast<const char*>(given->values) +
                                                              std::size_t(i) * given->values->struct_size);
    int which = 0;
    while (which < 4 && std::strcmp(p->key, parameters[which]->key) != 0) ++which;
    if (which == 4) return refuse(message, p->key, "is not a parameter of this plugin");
    if (p->type != CLEAVE_TYPE_NUMBER) return refuse(message, p->key, "must be a number");
    values[which] = p->number;
    if (!std::isfinite(p->number) || p->number < 0 || (parameters[which]->minimum_open && p->number == 0))
      return refuse(message, p->key, "is out of bounds");
  }
  for (int i = 0; i < 2; ++i)
    if (std::isnan(values[i])) return refuse(message, parameters[i]->key, "is missing");
  *instance = new cleave_instance{values[0], values[1], values[2], values[3]};
  return CLEAVE_OK;
}
void destroy(cleave_instance* instance) { delete instance; }

const void* kind(const char* id) { return std::strcmp(id, CLEAVE_KIND_ELASTICITY) == 0 ? &elasticity : nullptr; }
const void* extension(const char*) { return nullptr; }

constexpr cleave_about about = [] {
  cleave_about a{};
  a.struct_size = sizeof a;
  a.id = "elasticity/fixture";
  a.version = "1.0.0";
  a.author = "somebody";
  a.summary = "a law to be broken";
  a.source = "no paper";
  return a;
}();
template <std::uint32_t minor>
constexpr cleave_plugin table{
    sizeof(cleave_plugin), {CLEAVE_ABI_MAJOR, minor}, &about, &schema, kind, extension, create, destroy, nullptr};

}  // namespace

extern "C" CLEAVE_EXPORT cleave_result cleave_plugin_entry(const cleave_host* host, const cleave_plugin** plugin) {
  if (!CLEAVE_HAS(cleave_host, host, abi) || host->abi.major != CLEAVE_ABI_MAJOR) return CLEAVE_ERROR_ABI;
  *plugin = host->abi.minor < 1 ? &table<0> : &table<1>;
  return CLEAVE_OK;
}
