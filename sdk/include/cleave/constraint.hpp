/// Constraint solvers: a class with `about`, `parameters` where it has any, and
///
///   ConstraintReport project(const cleave_constraint_system& system);
///
/// which changes system.velocity so that the constraint holds. The arrays are described in <cleave/constraint.h>. The object
/// lives as long as the material and may keep what helps the next step (a warm start); an exception ends the run with its text.
#ifndef CLEAVE_CONSTRAINT_HPP
#define CLEAVE_CONSTRAINT_HPP

#include <cleave/constraint.h>
#include <cleave/plugin.hpp>
#include <cleave/threads.hpp>

#include <string>

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
  static const char* id() { return CLEAVE_KIND_CONSTRAINT; }
  static const void* table() {
    static constexpr cleave_constraint table{sizeof(cleave_constraint), 0, &project};
    return &table;
  }
  static const void* extension(const char*) { return nullptr; }
};

}  // namespace detail
}  // namespace cleave

#endif
