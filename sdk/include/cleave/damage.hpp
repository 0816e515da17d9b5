/// Damage laws: what drives the damage field that the host integrates. The author writes the driving force of one material
/// point; this header makes the plugin of it.
///
/// A law is a struct with `about` and, where it has any, `parameters`, `states` (<cleave/parameters.hpp>), and
///
///   static constexpr DamageInputs inputs{.tensile_energy = true};   what `point` brings from the elastic law
///   static constexpr Accepts accepts = ...;                         only if the formula reads point.strain()
///   static constexpr int fibers = 1;                                or 2: only if it reads point.fibers()
///   static constexpr bool optional_fibers = true;   F and fibers are given only where a parameter's `needs` says so, and
///                                                   are the identity and the axes x, y elsewhere
///
///   template <class T, class Point>
///   Driven<T, N> drive(const Point& point, const std::array<T, N>& state) const;    D >= 0 and the state after the step
///   DamageModel model() const;                                                      eta, l, r
///
/// A law that needs no gradient term sets `static constexpr bool local = true` and has, in place of drive(),
///
///   template <class T, class Point>
///   Damaged<T, N> damage(const Point& point, const std::array<T, N>& state) const;  the new d and state
///
/// Point is a DamagePoint. With lanes a costly formula may be skipped where it cannot matter: `if (none(mask)) return`.
#ifndef CLEAVE_DAMAGE_HPP
#define CLEAVE_DAMAGE_HPP

#include <cleave/damage.h>
#include <cleave/detail/law.hpp>
#include <cleave/math.hpp>
#include <cleave/plugin.hpp>

namespace cleave {

struct DamageInputs {
  bool tensile_energy = false;    ///< psi_plus, undegraded
  bool effective_stress = false;  ///< Cauchy stress of the isotropic part, undegraded
};

/// strain() and fibers() are read when they are asked for: a law that can tell from the rest that nothing drives damage does
/// not pay for them.
template <class T, class Strain, class Source>
struct DamagePoint {
  T tensile_energy;                ///< [J/m^3], as `inputs` says
  Symmetric3<T> effective_stress;  ///< [Pa], as `inputs` says
  T damage;                        ///< d in [0,1] at the start of the step
  T toughness;                     ///< factor on the toughness of this point
  double time_step;                ///< s
  Source source;

  Strain strain() const { return source.strain(); }     ///< b or F, as `accepts` says
  Fibers<T> fibers() const { return source.fibers(); }  ///< as `fibers` says
};

template <class T, std::size_t N = 0>
struct Driven {
  T driving_force;
  std::array<T, N> state;
};

template <class T, std::size_t N = 0>
struct Damaged {
  T damage;
  std::array<T, N> state;
};

enum class Integration { implicit = CLEAVE_INTEGRATION_IMPLICIT, explicitly = CLEAVE_INTEGRATION_EXPLICIT };

/// eta dd/dt = < (1 - d) D - (d - l^2 lap d) >,   g = (1-r)(1-d)^2 + r
struct DamageModel {
  double viscosity = 0;  ///< eta [s]
  double length = 0;     ///< l [m]
  double residual = 0;   ///< r
  Integration integration = Integration::implicit;
};

namespace detail {

template <class Law>
inline constexpr DamageInputs damage_inputs = [] {
  if constexpr (requires { Law::inputs; })
    return DamageInputs(Law::inputs);
  else
    return DamageInputs{};
}();
template <class Law>
inline constexpr bool is_local_damage = [] {
  if constexpr (requires { Law::local; })
    return bool(Law::local);
  else
    return false;
}();
template <class Law>
inline constexpr bool reads_strain = is_law_of_b<Law> || is_law_of_F<Law>;

template <class Law, class S>
struct DamageBatch {
  using T = Lanes<S>;
  static constexpr std::size_t n = state_count<Law>();
  struct Source {
    const DamageBatch& batch;
    const Chunk<S>& chunk;
    CLEAVE_INLINE StrainOf<Law, T> strain() const {
      if constexpr (is_law_of_b<Law>)
        return batch.b ? chunk.load_symmetric(batch.b) : left_cauchy_green(chunk.load_matrix(batch.F));
      else if constexpr (has_optional_fibers<Law>)
        return batch.F ? chunk.load_matrix(batch.F) : diagonal(Vector3<T>(T(1), T(1), T(1)));
      else
        return chunk.load_matrix(batch.F);
    }
    CLEAVE_INLINE Fibers<T> fibers() const { return load_fibers<Law>(chunk, batch.first_fiber, batch.second_fiber); }
  };
  using Point = DamagePoint<T, StrainOf<Law, T>, Source>;
  static constexpr DamageInputs inputs = damage_inputs<Law>;

  const Law& law;
  Batch<S> batch;
  const cleave_component *b, *F, *first_fiber, *second_fiber, *energy, *stress, *damage, *toughness, *state, *state_out,
      *output;

  DamageBatch(const Law& the_law, const cleave_batch& raw)
      : law(the_law),
        batch(raw),
        b(batch.field(CLEAVE_FIELD_B)),
        F(batch.field(CLEAVE_FIELD_F)),
        first_fiber(batch.field(CLEAVE_FIELD_FIBER)),
        second_fiber(batch.field(CLEAVE_FIELD_SECOND_FIBER)),
        energy(batch.field(CLEAVE_FIELD_TENSILE_ENERGY_IN)),
        stress(batch.field(CLEAVE_FIELD_EFFECTIVE_STRESS_IN)),
        damage(batch.field(CLEAVE_FIELD_DAMAGE)),
        toughness(batch.field(CLEAVE_FIELD_TOUGHNESS)),
        state(batch.field(CLEAVE_FIELD_STATE)),
        state_out(batch.field(CLEAVE_FIELD_STATE_OUT)),
        output(batch.field(is_local_damage<Law> ? CLEAVE_FIELD_DAMAGE_OUT : CLEAVE_FIELD_DRIVING_FORCE)) {}

  CLEAVE_INLINE Point load(const Chunk<S>& chunk) const {
    return {.tensile_energy = inputs.tensile_energy ? chunk.load(energy) : T(0),
            .effective_stress = inputs.effective_stress ? chunk.load_symmetric(stress) : Symmetric3<T>(),
            .damage = damage ? chunk.load(damage) : T(0),
            .toughness = toughness ? chunk.load(toughness) : T(1),
            .time_step = batch.time_step(),
            .source = {*this, chunk}};
  }

  [[gnu::noinline]] CLEAVE_FLATTEN void drive() const {
    batch.for_each_chunk([&](const Chunk<S>& chunk) {
      const Point point = load(chunk);
      const std::array<T, n> before = load_state<T, n>(chunk, state);
      T value;
      std::array<T, n> after;
      if constexpr (is_local_damage<Law>) {
        const Damaged<T, n> result = law.template damage<T>(point, before);
        value = result.damage;
        after = result.state;
      } else {
        const Driven<T, n> result = law.template drive<T>(point, before);
        value = result.driving_force;
        after = result.state;
      }
      LaneMask<S> valid = all_finite(value);
      if (output) chunk.store(output, value);
      for (std::size_t i = 0; i < n; ++i) {
        valid = valid & all_finite(after[i]);
        if (state_out) chunk.store(state_out + i, after[i]);
      }
      chunk.raise(!valid, CLEAVE_STATUS_FATAL);
    });
  }

  cleave_result run() const {
    const char* missing = nullptr;
    if (reads_strain<Law> && !has_optional_fibers<Law> && !F && !(is_law_of_b<Law> && b))
      missing = is_law_of_b<Law> ? "needs b or F" : "needs F";
    if (inputs.tensile_energy && !energy) missing = "needs the tensile energy";
    if (inputs.effective_stress && !stress) missing = "needs the effective stress";
    if (n > 0 && !state) missing = "needs its state variables";
    if (missing) {
      write_message(batch.message(), "", missing);
      return CLEAVE_ERROR_UNSUPPORTED;
    }
    drive();
    return CLEAVE_OK;
  }
};

template <class Law>
struct KindOf<Kind::damage, Law> {
  struct Instance {
    Law law;
  };
  static void prepare(Instance&, const cleave_context*) {}

  static constexpr std::uint64_t strain_on_demand =
      has_optional_fibers<Law> ? std::uint64_t(CLEAVE_ACCEPTS_B | CLEAVE_ACCEPTS_F) : 0;
  static constexpr std::uint64_t capabilities = (common_capabilities<Law> & ~strain_on_demand) |
                                                (damage_inputs<Law>.tensile_energy ? CLEAVE_NEEDS_TENSILE_ENERGY : 0) |
                                                (damage_inputs<Law>.effective_stress ? CLEAVE_NEEDS_EFFECTIVE_STRESS : 0) |
                                                (is_local_damage<Law> ? CLEAVE_DAMAGE_IS_LOCAL : 0);

  static void model(const cleave_instance* instance, cleave_damage_model* model) noexcept {
    if (!CLEAVE_HAS(cleave_damage_model, model, residual)) return;
    const DamageModel m = reinterpret_cast<const Instance*>(instance)->law.model();
    model->integration = std::uint32_t(m.integration);
    model->viscosity = m.viscosity;
    model->length = m.length;
    model->residual = m.residual;
  }
  template <class S>
  static cleave_result drive(const cleave_instance* instance, const cleave_batch* batch) noexcept {
    return DamageBatch<Law, S>(reinterpret_cast<const Instance*>(instance)->law, *batch).run();
  }
  static const char* id() { return CLEAVE_KIND_DAMAGE; }
  static const void* table() {
    static constexpr cleave_damage table{sizeof(cleave_damage), 0, &model, &drive<float>, &drive<double>};
    return &table;
  }
  static const void* extension(const char*) { return nullptr; }
};

}  // namespace detail
}  // namespace cleave

#endif
