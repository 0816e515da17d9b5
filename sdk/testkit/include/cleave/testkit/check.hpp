/// What a conformance check is. A check is one requirement on plugins; it runs in a child process of its own.
#ifndef CLEAVE_TESTKIT_CHECK_HPP
#define CLEAVE_TESTKIT_CHECK_HPP

#include <cstdint>
#include <exception>
#include <string>
#include <utility>
#include <vector>

namespace cleave::testkit {

/// Bits, for the kinds a check applies to.
enum Kinds : std::uint32_t {
  elasticity_kind = 1,
  plasticity_kind = 2,
  damage_kind = 4,
  constraint_kind = 8,
  discretization_kind = 16,
  batch_kinds = elasticity_kind | plasticity_kind | damage_kind,  ///< called with batches of material points
  all_kinds = batch_kinds | constraint_kind | discretization_kind
};
/// "elasticity, plasticity", or "all".
std::string kinds_text(std::uint32_t kinds);

class Context;

struct Check {
  const char* id;        ///< stable for ever, "group.what-is-asked"
  int number;            ///< order in the table
  const char* sentence;  ///< the requirement in one sentence
  std::uint32_t kinds;
  /// Returns if the plugin meets the requirement; throws Failed or Skipped if it does not, or if it does not apply.
  void (*run)(Context&);
};

/// Why a check ended. An exception, so that it also tells a test that uses the kit by itself.
struct Ended : std::exception {
  explicit Ended(std::string why) : reason(std::move(why)) {}
  const char* what() const noexcept override { return reason.c_str(); }
  std::string reason;
};
struct Failed : Ended {
  using Ended::Ended;
};
struct Skipped : Ended {
  using Ended::Ended;
};

/// All checks, in the order of their numbers.
const std::vector<Check>& all_checks();

}  // namespace cleave::testkit

#endif
