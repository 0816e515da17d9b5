/// Elastic laws. The author writes formulas for one material point; this header makes the plugin of them.
///
/// A law is a struct with `about`, `accepts` and, where it has any, `parameters` (<cleave/parameters.hpp>). In every formula
/// `strain` is `const Symmetric3<T>& b` or `const Matrix3<T>& F`, as `accepts` says, and T any Number; a law with fibers takes
/// one more argument `const Fibers<T>&`, last.
///
///   EnergySplit<T> energy(strain) const               psi_plus, psi_minus, psi_fiber [J/m^3]
///   Symmetric3<T> kirchhoff(strain, const T& g) const tau, degraded by g [Pa]
///   Matrix3<T> piola(F, const T& g) const             P, degraded by g [Pa]
///   Matrix3<T> delta_piola(F, dF, const T& g) const   derivative of P along dF [Pa]
///   T wave_modulus(strain, const T& g) const          upper bound of rho_0 c^2 through the current configuration [Pa]
///   Symmetric3<T> effective_cauchy(strain) const      undegraded Cauchy stress of the isotropic part [Pa]
///   IsochoricResponse isochoric_response() const      what return mappings rely on
///   mask_of<T> valid(strain) const                    false where the law is undefined: the point becomes FATAL
///
/// energy() or kirchhoff() or, of a law of F, piola() is enough. What is left out is derived: stress from the energy by dual
/// numbers, dP from P by dual numbers, the wave modulus from the spatial tangent. piola() and delta_piola() take F also in a
/// law of b. Further members:
///
///   static constexpr bool inversion_safe = true;      finite, restoring stress for J <= 0; else J <= 0 is FATAL
///   static constexpr bool isotropic = true;           laws of b always are
///   static constexpr int fibers = 1;                  or 2: directions per point the formulas read
///   static constexpr bool optional_fibers = true;     read only where a parameter's `needs` says so
///
/// A result that is not finite makes its point FATAL, whatever the law says.
#ifndef CLEAVE_ELASTICITY_HPP
#define CLEAVE_ELASTICITY_HPP

#include <cleave/elasticity.h>
#include <cleave/detail/acoustic.hpp>
#include <cleave/detail/batch.hpp>
#include <cleave/detail/law.hpp>
#include <cleave/dual.hpp>
#include <cleave/isochoric_response.hpp>
#include <cleave/math.hpp>
#include <cleave/plugin.hpp>
#include <cleave/tensor.hpp>

namespace cleave {

/// Part of the volume stiffness that counts for waves: g in tension, all of it in compression and up to J = 1.1, from where
/// material can be compressed again before its waves are measured anew.
template <class T>
T volume_degradation(const T& J, const T& g) {
  return select(J >= 1.1, g, T(1));
}

/// psi = g tension + compression + fiber.
template <class T>
struct EnergySplit {
  T tension;
  T compression;
  T fiber = T(0);
};

namespace detail {

/// The formulas of a law, given and derived, with one signature each: fibers are passed always and dropped where not wanted.
template <class Law>
struct Elastic {
  template <class T>
  using Strain = StrainOf<Law, T>;
  using Probe = Lanes<double>;

#define CLEAVE_HAS_FORMULA(call, call_with_fibers)                                                                           \
  (fiber_count<Law> == 0                                                                                                     \
       ? requires(const Law& law, const Strain<Probe>& e, const Matrix3<Probe>& F, const Probe& g) { law.call; }             \
       : requires(const Law& law, const Strain<Probe>& e, const Matrix3<Probe>& F, const Probe& g, const Fibers<Probe>& a) { \
           law.call_with_fibers;                                                                                             \
         })
  static constexpr bool has_energy = CLEAVE_HAS_FORMULA(energy(e), energy(e, a));
  static constexpr bool has_kirchhoff = CLEAVE_HAS_FORMULA(kirchhoff(e, g), kirchhoff(e, g, a));
  static constexpr bool has_piola = CLEAVE_HAS_FORMULA(piola(F, g), piola(F, g, a));
  static constexpr bool has_delta_piola = CLEAVE_HAS_FORMULA(delta_piola(F, F, g), delta_piola(F, F, g, a));
  static constexpr bool has_wave_modulus = CLEAVE_HAS_FORMULA(wave_modulus(e, g), wave_modulus(e, g, a));
  static constexpr bool has_effective_cauchy = CLEAVE_HAS_FORMULA(effective_cauchy(e), effective_cauchy(e, a));
  static constexpr bool has_valid = CLEAVE_HAS_FORMULA(valid(e), valid(e, a));
#undef CLEAVE_HAS_FORMULA
  static constexpr bool has_isochoric_response = requires(const Law& law) { law.isochoric_response(); };
  /// Without an energy the stress of the isotropic part cannot be told from the fibers'.
  static constexpr bool offers_effective_cauchy = has_effective_cauchy || has_energy || fiber_count<Law> == 0;
  /// tau F^-T has no limit at J = 0, which a law may be defined at.
  static constexpr bool offers_piola = has_piola || (!is_law_of_b<Law> && has_energy) || !is_inversion_safe<Law>;
  static_assert(has_energy || has_kirchhoff || (has_piola && !is_law_of_b<Law>),
                "an elastic law has energy() or kirchhoff() or, of F, piola()");

  template <class T>
  static CLEAVE_INLINE EnergySplit<T> energy(const Law& law, const Strain<T>& e, const Fibers<T>& a) {
    if constexpr (fiber_count < Law >> 0)
      return law.energy(e, a);
    else
      return law.energy(e);
  }

  /// Derivative of a function of psi's parts by the strain, `whole(EnergySplit)` telling which: d/db (as a symmetric tensor)
  /// or d/dF.
  template <class T, class Whole>
  static CLEAVE_INLINE Strain<T> energy_derivative(const Law& law, const Strain<T>& e, const Fibers<T>& a, Whole whole) {
    constexpr int n = is_law_of_b<Law> ? 6 : 9;
    using D = Dual<T, n>;
    Strain<D> strain;
    for (int i = 0; i < n; ++i) strain[i] = D::variable(e[i], i);
    const D psi = whole(energy<D>(law, strain, lift<D>(a)));
    Strain<T> derivative;
    // A shear component of b stands for two entries of the tensor.
    for (int i = 0; i < n; ++i) derivative[i] = is_law_of_b<Law> && i >= 3 ? T(0.5) * psi.derivative[i] : psi.derivative[i];
    return derivative;
  }

  /// tau = 2 b dpsi/db or (dpsi/dF) F^T.
  template <class T>
  static CLEAVE_INLINE Symmetric3<T> stress_of(const Strain<T>& e, const Strain<T>& derivative) {
    if constexpr (is_law_of_b<Law>)
      return T(2) * symmetric_part(e * derivative);
    else
      return symmetric_part(derivative * transpose(e));
  }

  template <class T>
  static CLEAVE_INLINE Symmetric3<T> kirchhoff(const Law& law, const Strain<T>& e, const T& g, const Fibers<T>& a) {
    if constexpr (has_kirchhoff && fiber_count < Law >> 0)
      return law.kirchhoff(e, g, a);
    else if constexpr (has_kirchhoff)
      return law.kirchhoff(e, g);
    else if constexpr (has_piola && !is_law_of_b<Law>)
      return symmetric_part(piola(law, e, g, a) * transpose(e));
    else
      return stress_of<T>(e, degraded_energy_derivative(law, e, g, a));
  }

  template <class T>
  static CLEAVE_INLINE Strain<T> degraded_energy_derivative(const Law& law, const Strain<T>& e, const T& g,
                                                            const Fibers<T>& a) {
    return energy_derivative(law, e, a, [&](const auto& psi) { return psi.tension * g + psi.compression + psi.fiber; });
  }

  /// P of a law of F, and of a law of b at the F its strain was formed from. Where only the Kirchhoff stress is known,
  /// P = tau F^-T, which inversion-safe laws of F avoid by offering piola() or energy().
  template <class T>
  static CLEAVE_INLINE Matrix3<T> piola(const Law& law, const Matrix3<T>& F, const T& g, const Fibers<T>& a) {
    if constexpr (has_piola && fiber_count < Law >> 0) {
      return law.piola(F, g, a);
    } else if constexpr (has_piola) {
      return law.piola(F, g);
    } else if constexpr (!is_law_of_b<Law> && has_energy) {
      return degraded_energy_derivative(law, F, g, a);
    } else {
      const Matrix3<T> cofactor_F = cofactor(F);
      return Matrix3<T>(kirchhoff(law, strain_of<Law>(F), g, a)) * cofactor_F / determinant(F);
    }
  }

  /// J. Laws that go through inversion get a Cauchy stress that stays finite: |J| at least 1e-3, with the sign of J.
  template <class T>
  static CLEAVE_INLINE T jacobian(const Strain<T>& e) {
    const T J = [&] {
      if constexpr (is_law_of_b<Law>)
        return sqrt(determinant(e));
      else
        return determinant(e);
    }();
    if constexpr (is_inversion_safe<Law>)
      return copysign(max(abs(J), T(1e-3)), J);
    else
      return J;
  }

  /// dP along dF.
  template <class T>
  static CLEAVE_INLINE Matrix3<T> delta_piola(const Law& law, const Matrix3<T>& F, const Matrix3<T>& dF, const T& g,
                                              const Fibers<T>& a) {
    if constexpr (has_delta_piola && fiber_count < Law >> 0) {
      return law.delta_piola(F, dF, g, a);
    } else if constexpr (has_delta_piola) {
      return law.delta_piola(F, dF, g);
    } else {
      using D = Dual<T, 1>;
      Matrix3<D> moving;
      for (int i = 0; i < 9; ++i) {
        moving[i] = D(F[i]);
        moving[i].derivative[0] = dF[i];
      }
      const Matrix3<D> P = piola<D>(law, moving, D(g), lift<D>(a));
      Matrix3<T> dP;
      for (int i = 0; i < 9; ++i) dP[i] = P[i].derivative[0];
      return dP;
    }
  }

  template <class T>
  static CLEAVE_INLINE Symmetric3<T> effective_cauchy(const Law& law, const Strain<T>& e, const Fibers<T>& a) {
    if constexpr (has_effective_cauchy && fiber_count < Law >> 0) {
      return law.effective_cauchy(e, a);
    } else if constexpr (has_effective_cauchy) {
      return law.effective_cauchy(e);
    } else if constexpr (fiber_count<Law> == 0) {
      return kirchhoff(law, e, T(1), a) / jacobian<T>(e);
    } else {
      const auto matrix_only = [](const auto& psi) { return psi.tension + psi.compression; };
      return stress_of<T>(e, energy_derivative(law, e, a, matrix_only)) / jacobian<T>(e);
    }
  }

  template <class T>
  static T wave_modulus(const Law& law, const Strain<T>& e, const T& g, const Fibers<T>& a) {
    if constexpr (has_wave_modulus && fiber_count < Law >> 0)
      return law.wave_modulus(e, g, a);
    else if constexpr (has_wave_modulus)
      return law.wave_modulus(e, g);
    else  // what damage leaves is never stiffer
      return acoustic_bound(spatial_tangent(law, e, a));
  }

  /// a_ijkl = F_jJ F_lL dP_iJ/dF_kL = (d tau_ij along dF = (e_k e_l^T) F) - tau_il delta_jk, undegraded.
  template <class T>
  static SpatialTangent<T> spatial_tangent(const Law& law, const Strain<T>& e, const Fibers<T>& a) {
    using D = Dual<T, 1>;
    SpatialTangent<T> tangent;
    for (int k = 0; k < 3; ++k)
      for (int l = 0; l < 3; ++l) {
        Strain<D> moving;
        for (int i = 0; i < int(sizeof(Strain<T>) / sizeof(T)); ++i) moving[i] = D(e[i]);
        if constexpr (is_law_of_b<Law>) {
          // db = (e_k e_l^T) b + b (e_l e_k^T): row and column k grow by row l.
          for (int j = 0; j < 3; ++j) moving(k, j).derivative[0] = e(l, j);
          moving(k, k).derivative[0] = T(2) * e(l, k);
        } else {
          for (int j = 0; j < 3; ++j) moving(k, j).derivative[0] = e(l, j);
        }
        const Symmetric3<D> tau = kirchhoff<D>(law, moving, D(T(1)), lift<D>(a));
        for (int i = 0; i < 3; ++i)
          for (int j = 0; j < 3; ++j)
            tangent(i, j, k, l) = j == k ? tau(i, j).derivative[0] - tau(i, l).value : tau(i, j).derivative[0];
      }
    return tangent;
  }

  /// Where the law's domain ends: J > 0 unless it is inversion safe, and what valid() says.
  template <class T>
  static CLEAVE_INLINE mask_of<T> valid(const Law& law, const Strain<T>& e, const Fibers<T>& a) {
    mask_of<T> inside(true);
    if constexpr (!is_inversion_safe<Law>) inside = determinant(e) > T(0);
    if constexpr (has_valid && fiber_count < Law >> 0)
      inside = inside & law.valid(e, a);
    else if constexpr (has_valid)
      inside = inside & law.valid(e);
    return inside;
  }

  template <class D, class T>
  static CLEAVE_INLINE Fibers<D> lift(const Fibers<T>& a) {
    Fibers<D> lifted;
    if constexpr (fiber_count < Law >> 0)
      for (int i = 0; i < 3; ++i) {
        lifted.first[i] = D(a.first[i]);
        lifted.second[i] = D(a.second[i]);
      }
    return lifted;
  }
};

/// Batches of one precision. Each output is computed in a pass of its own: stress, the common one, stays small, and inputs
/// of later passes are in the first-level cache. The author's formulas are inlined whatever their size (flatten): as calls,
/// their tensors would travel through memory.
template <class Law, class S>
struct ElasticBatch {
  using T = Lanes<S>;
  using Formulas = Elastic<Law>;
  using Strain = StrainOf<Law, T>;

  const Law& law;
  Batch<S> batch;
  const cleave_component* b;
  const cleave_component* F;
  const cleave_component* g;
  const cleave_component* first_fiber;
  const cleave_component* second_fiber;

  ElasticBatch(const Law& the_law, const cleave_batch& raw)
      : law(the_law),
        batch(raw),
        b(batch.field(CLEAVE_FIELD_B)),
        F(batch.field(CLEAVE_FIELD_F)),
        g(batch.field(CLEAVE_FIELD_DEGRADATION)),
        first_fiber(nullptr),
        second_fiber(nullptr) {
    if constexpr (fiber_count < Law >> 0) {
      first_fiber = batch.field(CLEAVE_FIELD_FIBER);
      second_fiber = batch.field(CLEAVE_FIELD_SECOND_FIBER);
    }
  }

  struct Point {
    Strain strain;
    Fibers<T> fibers;
    LaneMask<S> valid;
  };

  template <bool from_b>
  CLEAVE_INLINE Point load(const Chunk<S>& chunk) const {
    Point point;
    point.fibers = load_fibers<Law>(chunk, first_fiber, second_fiber);
    if constexpr (from_b) {
      point.strain = chunk.load_symmetric(b);
      point.valid = Formulas::template valid<T>(law, point.strain, point.fibers);
    } else {
      const Matrix3<T> deformation = chunk.load_matrix(F);
      point.strain = strain_of<Law>(deformation);
      point.valid = Formulas::template valid<T>(law, point.strain, point.fibers);
      if constexpr (is_law_of_b<Law> && !is_inversion_safe<Law>) point.valid = point.valid & (determinant(deformation) > T(0));
    }
    return point;
  }

  template <class Tensor>
  CLEAVE_INLINE void finish(const Chunk<S>& chunk, const LaneMask<S>& valid, const Tensor& value,
                            const cleave_component* output) const {
    if constexpr (std::is_same_v<Tensor, T>)
      chunk.store(output, value);
    else
      chunk.store_tensor(output, value);
    chunk.raise(!(valid & all_finite(value)), CLEAVE_STATUS_FATAL);
  }

  /// One pass over the batch: `formula(point, g)` into the output field. Compiled for b and F, with and without degradation.
  template <bool from_b, bool degraded, class Formula>
  CLEAVE_INLINE void pass(const cleave_component* output, Formula formula) const {
    batch.for_each_chunk([&](const Chunk<S>& chunk) {
      const Point point = load<from_b>(chunk);
      if constexpr (degraded)
        finish(chunk, point.valid, formula(point, chunk.load(g)), output);
      else
        finish(chunk, point.valid, formula(point, T(1)), output);
    });
  }
  template <bool depends_on_g, class Formula>
  CLEAVE_INLINE void pass(const cleave_component* output, Formula formula) const {
    const auto with_strain = [&](auto degraded) {
      if constexpr (is_law_of_b<Law>)
        if (b) return pass<true, decltype(degraded)::value>(output, formula);
      pass<false, decltype(degraded)::value>(output, formula);
    };
    if (depends_on_g && g)
      with_strain(std::bool_constant<depends_on_g>{});
    else
      with_strain(std::false_type{});
  }

  [[gnu::noinline]] CLEAVE_FLATTEN void stress(const cleave_component* output) const {
    pass<true>(output,
               [this](const Point& p, const T& g) { return Formulas::template kirchhoff<T>(law, p.strain, g, p.fibers); });
  }
  [[gnu::noinline]] CLEAVE_FLATTEN void energy(const cleave_component* output) const {
    pass<true>(output, [this](const Point& p, const T& g) {
      const EnergySplit<T> psi = Formulas::template energy<T>(law, p.strain, p.fibers);
      return g * psi.tension + psi.compression + psi.fiber;
    });
  }
  [[gnu::noinline]] CLEAVE_FLATTEN void tensile_energy(const cleave_component* output) const {
    pass<false>(output,
                [this](const Point& p, const T&) { return Formulas::template energy<T>(law, p.strain, p.fibers).tension; });
  }
  [[gnu::noinline]] CLEAVE_FLATTEN void effective_stress(const cleave_component* output) const {
    pass<false>(output,
                [this](const Point& p, const T&) { return Formulas::template effective_cauchy<T>(law, p.strain, p.fibers); });
  }
  [[gnu::noinline]] void wave_modulus(const cleave_component* output) const {
    pass<true>(output,
               [this](const Point& p, const T& g) { return Formulas::template wave_modulus<T>(law, p.strain, g, p.fibers); });
  }

  /// One pass over the batch: `formula(chunk, point, F, g)` into the output field.
  template <class Formula>
  CLEAVE_INLINE void pass_of_F(const cleave_component* output, Formula formula) const {
    batch.for_each_chunk([&](const Chunk<S>& chunk) {
      const Point point = load<false>(chunk);
      finish(chunk, point.valid, formula(chunk, point, chunk.load_matrix(F), g ? chunk.load(g) : T(1)), output);
    });
  }
  [[gnu::noinline]] CLEAVE_FLATTEN void piola(const cleave_component* output) const {
    pass_of_F(output, [this](const Chunk<S>&, const Point& p, const Matrix3<T>& deformation, const T& degradation) {
      return Formulas::template piola<T>(law, deformation, degradation, p.fibers);
    });
  }
  [[gnu::noinline]] CLEAVE_FLATTEN void delta_piola(const cleave_component* dF, const cleave_component* output) const {
    pass_of_F(output, [this, dF](const Chunk<S>& chunk, const Point& p, const Matrix3<T>& deformation, const T& degradation) {
      return Formulas::template delta_piola<T>(law, deformation, chunk.load_matrix(dF), degradation, p.fibers);
    });
  }

  cleave_result run() const {
    if (!F && !(b && is_law_of_b<Law>)) {
      write_message(batch.message(), "", is_law_of_b<Law> ? "needs b or F" : "needs F");
      return CLEAVE_ERROR_UNSUPPORTED;
    }
    if (const auto* output = batch.field(CLEAVE_FIELD_TAU)) stress(output);
    if constexpr (Formulas::has_energy) {
      if (const auto* output = batch.field(CLEAVE_FIELD_ENERGY)) energy(output);
      if (const auto* output = batch.field(CLEAVE_FIELD_TENSILE_ENERGY)) tensile_energy(output);
    }
    if constexpr (Formulas::offers_effective_cauchy)
      if (const auto* output = batch.field(CLEAVE_FIELD_EFFECTIVE_STRESS)) effective_stress(output);
    if (const auto* output = batch.field(CLEAVE_FIELD_WAVE_MODULUS)) wave_modulus(output);
    if constexpr (Formulas::offers_piola)
      if (const auto* output = batch.field(CLEAVE_FIELD_PIOLA)) {
        if (!F) {
          write_message(batch.message(), "", "PIOLA needs F");
          return CLEAVE_ERROR_UNSUPPORTED;
        }
        piola(output);
      }
    if (const auto* output = batch.field(CLEAVE_FIELD_DELTA_P)) {
      const auto* dF = batch.field(CLEAVE_FIELD_DELTA_F);
      if (!dF || !F) {
        write_message(batch.message(), "", "DELTA_P needs F and DELTA_F");
        return CLEAVE_ERROR_UNSUPPORTED;
      }
      delta_piola(dF, output);
    }
    return CLEAVE_OK;
  }
};

template <class Law>
struct KindOf<Kind::elasticity, Law> {
  using Formulas = Elastic<Law>;
  struct Instance {
    Law law;
  };
  static void prepare(Instance&, const cleave_context*) {}

  static constexpr std::uint64_t capabilities = common_capabilities<Law> | (Formulas::has_energy ? CLEAVE_HAS_ENERGY : 0) |
                                                (Formulas::offers_effective_cauchy ? CLEAVE_HAS_EFFECTIVE_STRESS : 0) |
                                                (Formulas::has_isochoric_response ? CLEAVE_HAS_ISOCHORIC_RESPONSE : 0) |
                                                (Formulas::offers_piola ? CLEAVE_HAS_PIOLA : 0) | CLEAVE_HAS_TANGENT |
                                                CLEAVE_HAS_WAVE_MODULUS;

  template <class S>
  static cleave_result evaluate(const cleave_instance* instance, const cleave_batch* batch) noexcept {
    return ElasticBatch<Law, S>(reinterpret_cast<const Instance*>(instance)->law, *batch).run();
  }

  static const char* id() { return CLEAVE_KIND_ELASTICITY; }
  static const void* table() {
    static constexpr cleave_elasticity table{sizeof(cleave_elasticity), 0, &evaluate<float>, &evaluate<double>};
    return &table;
  }

  static void response(const cleave_instance* instance, cleave_isochoric_response* response) noexcept {
    if constexpr (Formulas::has_isochoric_response) {
      const IsochoricResponse r = reinterpret_cast<const Instance*>(instance)->law.isochoric_response();
      if (!CLEAVE_HAS(cleave_isochoric_response, response, bulk_modulus)) return;
      response->pressure_law = std::uint32_t(r.pressure_law);
      response->deviatoric_modulus = r.deviatoric_modulus;
      response->bulk_modulus = r.bulk_modulus;
    }
  }
  static const void* extension(const char* id) {
    static constexpr cleave_isochoric_response_extension table{sizeof(cleave_isochoric_response_extension), 0, &response};
    if (Formulas::has_isochoric_response && std::strcmp(id, CLEAVE_EXTENSION_ISOCHORIC_RESPONSE) == 0) return &table;
    return nullptr;
  }
};

}  // namespace detail
}  // namespace cleave

#endif
