/// Constraint solvers: a class with `about`, `parameters` where it has any, and
///
///   ConstraintReport project(const cleave_constraint_system& system);
///
/// which changes system.velocity so that the constraint holds. The arrays are described in <cleave/constraint.h>. The object
/// lives as long as the material and may keep what helps the next step (a warm start); an exception ends the run with its text.
///
/// What is kept takes part in checkpoints, so that a run that is resumed has the bits of one that never ended:
///
///   std::vector<std::byte> save() const;
///   void restore(std::span<const std::byte>);   // throws, with words, where save() has not written that
///
/// Where project() is const nothing is kept, and neither is needed.
#ifndef CLEAVE_CONSTRAINT_HPP
#define CLEAVE_CONSTRAINT_HPP

#include <cleave/constraint.h>
#include <cleave/detail/saved_state.hpp>
#include <cleave/plugin.hpp>
#include <cleave/threads.hpp>

#include <algorithm>
#include <cstddef>
#include <cstring>
#include <span>
#include <stdexcept>
#include <string>
#include <utility>
#include <vector>

namespace cleave {

struct ConstraintReport {
  std::uint32_t iterations = 0;
  double residual = 0;     ///< |B v - c| relative to |B v* - c|
  std::uint64_t rows = 0;  ///< of B
  std::string notice{};    ///< what the user should know, said once
};

/// The threads that the host lends for the time of project().
inline Threads threads_of(const cleave_constraint_system& system) {
  return Threads(CLEAVE_HAS(cleave_constraint_system, &system, threads) ? system.threads : nullptr);
}
/// Damage of a particle; 0 where the host gives none.
inline double damage_of(const cleave_constraint_system& system, std::uint64_t particle) {
  return CLEAVE_HAS(cleave_constraint_system, &system, damage) && system.damage ? system.damage[particle] : 0;
}

namespace detail {

template <class Solver>
struct KindOf<Kind::constraint, Solver> {
  struct Instance {
    Solver law;
  };
  static void prepare(Instance&, const cleave_context*) {}

  static constexpr int fibers = [] {
    if constexpr (requires { Solver::fibers; })
      return int(Solver::fibers);
    else
      return 0;
  }();
  static constexpr std::uint64_t capabilities = (fibers > 0 ? CLEAVE_NEEDS_FIBER : 0) | CLEAVE_DOUBLE;

  static cleave_result project(cleave_instance* instance, const cleave_constraint_system* system,
                               cleave_constraint_report* report, cleave_message* message) noexcept {
    return guarded(message, [&]() -> cleave_result {
      const ConstraintReport done = reinterpret_cast<Instance*>(instance)->law.project(*system);
      if (report && CLEAVE_HAS(cleave_constraint_report, report, rows)) {
        report->iterations = done.iterations;
        report->residual = done.residual;
        report->rows = done.rows;
      }
      if (!done.notice.empty()) write_message(message, "", done.notice);
      return CLEAVE_OK;
    });
  }
  static constexpr bool keeps_nothing = requires(const Solver& solver, const cleave_constraint_system& system) {
    solver.project(system);
  };
  static constexpr bool saves = keeps_nothing || requires(const Solver& solver) { solver.save(); };

  static std::uint64_t save(const cleave_instance* instance, void* buffer, std::uint64_t size) noexcept {
    std::uint64_t written = 0;
    if constexpr (saves && !keeps_nothing)
      guarded(nullptr, [&]() -> cleave_result {
        written = hand_over(reinterpret_cast<const Instance*>(instance)->law.save(), buffer, size);
        return CLEAVE_OK;
      });
    return written;
  }
  static cleave_result restore(cleave_instance* instance, const void* buffer, std::uint64_t size,
                               cleave_message* message) noexcept {
    return guarded(message, [&]() -> cleave_result {
      if constexpr (saves && !keeps_nothing)
        reinterpret_cast<Instance*>(instance)->law.restore(std::span(static_cast<const std::byte*>(buffer), size));
      else if (size > 0)
        throw std::invalid_argument("the constraint keeps nothing from step to step");
      return CLEAVE_OK;
    });
  }

  static const char* id() { return CLEAVE_KIND_CONSTRAINT; }
  static const void* table() {
    static constexpr cleave_constraint table{sizeof(cleave_constraint), 0, &project, saves ? &save : nullptr,
                                             saves ? &restore : nullptr};
    return &table;
  }
  static const void* extension(const char*) { return nullptr; }
};

}  // namespace detail
}  // namespace cleave

#endif
