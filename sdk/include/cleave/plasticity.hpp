/// Return mappings. The author writes the mapping of one material point; this header makes the plugin of it.
///
/// A law is a struct with `about`, `accepts` and, where it has any, `parameters`, `states` (<cleave/parameters.hpp>) and
/// std::array<double, N> initial_state() const where the initial values depend on parameters. N is the number of state
/// components, all of them scalars to the formula, and T any Number:
///
///   template <class T>
///   Returned<Symmetric3<T>, N> return_map(const YieldContext& elastic, const Symmetric3<T>& b,
///                                         const std::array<T, N>& state) const;
///
/// with Matrix3<T>& F for laws of F. `b` is the elastic trial state. Only lanes in `yielded` are changed: what is returned for
/// the others is ignored, and they keep their strain and state to the bit. So a mapping may end early where `none(outside)`.
///
///   static constexpr bool isochoric_flow = true;   the return keeps det b
///   static constexpr bool inversion_safe = true;   a trial with J <= 0 is mapped too; else it is FATAL
///
/// and, where parameters decide on them,
///
///   bool keeps_volume() const;        the return keeps det b
///   bool consistent_return() const;   returned states lie on the yield surface also at large elastic strain
///
/// A law of b is isotropic and returns b coaxial with its trial. Given F it therefore also maps F = V_new V_trial^-1 F_trial.
#ifndef CLEAVE_PLASTICITY_HPP
#define CLEAVE_PLASTICITY_HPP

#include <cleave/plasticity.h>
#include <cleave/decompositions.hpp>
#include <cleave/detail/law.hpp>
#include <cleave/isochoric_response.hpp>
#include <cleave/plugin.hpp>

namespace cleave {

/// The elastic law whose stress is returned: p(J), J(p), s(b), mu_d and kappa.
struct YieldContext : IsochoricResponse {
  double time_step = 0;  ///< s, for rate-dependent flow
};

/// Strain is Symmetric3<T> (b) or Matrix3<T> (F).
template <class Strain, std::size_t N = 0>
struct Returned {
  using T = std::remove_cvref_t<decltype(std::declval<Strain>()[0])>;
  Strain strain;
  std::array<T, N> state;
  mask_of<T> yielded;
  mask_of<T> retry = mask_of<T>(false);       ///< no return exists for this step; a smaller one may have one
  mask_of<T> unreliable = mask_of<T>(false);  ///< the return is outside what the law is meant for: the host says so once
};

namespace detail {

/// F = sqrt(b_new b_trial^-1) F_trial for coaxial b_new and b_trial. The stretches of the trial are taken from F_trial, which
/// knows the small ones better than b_trial does.
template <class T>
CLEAVE_INLINE Matrix3<T> follow(const Matrix3<T>& F_trial, const Symmetric3<T>& b_trial, const Symmetric3<T>& b_new) {
  const auto [values, vectors] = symmetric_eigen(b_trial);
  Vector3<T> stretch;
  for (int i = 0; i < 3; ++i) {
    const Vector3<T> n(vectors(0, i), vectors(1, i), vectors(2, i));
    stretch[i] = sqrt(max(dot(n, b_new * n), T(0)) / squared_norm(transpose(F_trial) * n));
  }
  return Matrix3<T>(symmetric_product(vectors, diagonal(stretch))) * F_trial;
}

template <class Law, class S>
struct PlasticBatch {
  using T = Lanes<S>;
  static constexpr std::size_t n = state_count<Law>();
  using Strain = StrainOf<Law, T>;

  const Law& law;
  YieldContext elastic;
  Batch<S> batch;
  const cleave_component* state;
  const cleave_component* state_out;
  const cleave_component* yielded;

  PlasticBatch(const Law& the_law, const IsochoricResponse& response, const cleave_batch& raw)
      : law(the_law),
        elastic{response, raw.time_step},
        batch(raw),
        state(batch.field(CLEAVE_FIELD_STATE)),
        state_out(batch.field(CLEAVE_FIELD_STATE_OUT)),
        yielded(batch.field(CLEAVE_FIELD_YIELDED)) {}

  template <bool from_b>
  [[gnu::noinline]] CLEAVE_FLATTEN void map(const cleave_component* in, const cleave_component* out) const {
    batch.for_each_chunk([&](const Chunk<S>& chunk) {
      // Everything is read before anything is written: outputs may lie on the inputs they replace.
      std::conditional_t<from_b, Symmetric3<T>, Matrix3<T>> given;
      Strain trial;
      if constexpr (from_b)
        trial = given = chunk.load_symmetric(in);
      else
        trial = strain_of<Law>(given = chunk.load_matrix(in));
      const std::array<T, n> before = load_state<T, n>(chunk, state);

      LaneMask<S> valid = all_finite(given);
      if constexpr (!is_inversion_safe<Law>) {
        valid = valid & (determinant(given) > T(0));
        // F may be regular where b is not, to rounding.
        if constexpr (!std::is_same_v<Strain, decltype(given)>) valid = valid & (determinant(trial) > T(0));
      }
      const Returned<Strain, n> result = law.return_map(elastic, trial, before);
      valid = valid & ((!result.yielded) | all_finite(result.strain));

      if (out) {
        auto after = given;
        if constexpr (std::is_same_v<Strain, decltype(given)>)
          after = result.strain;
        else if (any(result.yielded)) {
          after = follow(given, trial, result.strain);
          valid = valid & ((!result.yielded) | all_finite(after));
        }
        chunk.store_tensor(out, select(result.yielded, after, given));
      }
      if (state_out)
        for (std::size_t i = 0; i < n; ++i) {
          valid = valid & ((!result.yielded) | all_finite(result.state[i]));
          chunk.store(state_out + i, select(result.yielded, result.state[i], before[i]));
        }
      if (yielded) chunk.store(yielded, select(result.yielded, T(1), T(0)));
      chunk.raise(result.unreliable, CLEAVE_STATUS_UNRELIABLE);
      chunk.raise(result.retry, CLEAVE_STATUS_RETRY);
      chunk.raise(!valid, CLEAVE_STATUS_FATAL);
    });
  }

  cleave_result run() const {
    const auto* b = batch.field(CLEAVE_FIELD_B);
    const auto* F = batch.field(CLEAVE_FIELD_F);
    if (n > 0 && !state) {
      write_message(batch.message(), "", "needs its state variables");
      return CLEAVE_ERROR_UNSUPPORTED;
    }
    if constexpr (is_law_of_b<Law>)
      if (b) {
        map<true>(b, batch.field(CLEAVE_FIELD_B_OUT));
        return CLEAVE_OK;
      }
    if (!F) {
      write_message(batch.message(), "", is_law_of_b<Law> ? "needs b or F" : "needs F");
      return CLEAVE_ERROR_UNSUPPORTED;
    }
    map<false>(F, batch.field(CLEAVE_FIELD_F_OUT));
    return CLEAVE_OK;
  }
};

template <class Law>
struct KindOf<Kind::plasticity, Law> {
  struct Instance {
    Law law;
    IsochoricResponse elastic;
  };
  static void prepare(Instance& instance, const cleave_context* context) {
    const cleave_isochoric_response* response = context ? context->isochoric : nullptr;
    if (!response || !CLEAVE_HAS(cleave_isochoric_response, response, bulk_modulus))
      throw UnsupportedError{"needs an elastic law that offers the isochoric response"};
    if (response->pressure_law > CLEAVE_PRESSURE_LOGARITHMIC)
      throw UnsupportedError{"does not know the pressure law of the elastic law"};
    instance.elastic = {response->deviatoric_modulus, response->bulk_modulus, PressureLaw(response->pressure_law)};
  }

  static constexpr bool isochoric_flow = [] {
    if constexpr (requires { Law::isochoric_flow; })
      return bool(Law::isochoric_flow);
    else
      return false;
  }();
  static constexpr std::uint64_t capabilities =
      common_capabilities<Law> | CLEAVE_NEEDS_ISOCHORIC_RESPONSE | (isochoric_flow ? CLEAVE_FLOW_IS_ISOCHORIC : 0);

  template <class S>
  static cleave_result return_map(const cleave_instance* handle, const cleave_batch* batch) noexcept {
    const auto& instance = *reinterpret_cast<const Instance*>(handle);
    return PlasticBatch<Law, S>(instance.law, instance.elastic, *batch).run();
  }
  static const char* id() { return CLEAVE_KIND_PLASTICITY; }
  static const void* table() {
    static constexpr cleave_plasticity table{sizeof(cleave_plasticity), 0, &return_map<float>, &return_map<double>};
    return &table;
  }
  /// What isochoric_flow says for all parameters, keeps_volume() says for these.
  static std::uint64_t guarantees(const cleave_instance* handle) noexcept {
    [[maybe_unused]] const Law& law = reinterpret_cast<const Instance*>(handle)->law;
    bool consistent = true, volume = isochoric_flow;
    if constexpr (requires { law.consistent_return(); }) consistent = law.consistent_return();
    if constexpr (requires { law.keeps_volume(); }) volume = law.keeps_volume();
    return (consistent ? CLEAVE_RETURN_IS_CONSISTENT : 0) | (volume ? CLEAVE_RETURN_KEEPS_VOLUME : 0);
  }
  static const void* extension(const char* id) {
    static constexpr cleave_return_guarantees table{sizeof(cleave_return_guarantees), 0, &guarantees};
    return std::strcmp(id, CLEAVE_EXTENSION_RETURN_GUARANTEES) == 0 ? &table : nullptr;
  }
};

}  // namespace detail
}  // namespace cleave

#endif
