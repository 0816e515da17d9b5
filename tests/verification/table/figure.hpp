#pragma once

#include <limits>
#include <optional>
#include <string>

/// Measured figures of the reference problems, which docs/verification.md lists.
namespace cleave::test {

/// How a measured value is held against its reference.
enum class Judged {
  within,    ///< the tolerance of it
  at_least,  ///< it, less the tolerance
  at_most,   ///< it, and the tolerance
  shown      ///< not at all: reported beside it
};

/// Two figures that differ by no more than this are the same one, whatever rounding made of them: only their bound counts.
constexpr double any = std::numeric_limits<double>::infinity();

struct Figure {
  int row = 0;           ///< number of the problem in docs/verification.md
  std::string problem;   ///< which case of it: "P L^2/(E I) = 1, dx = h/8"
  std::string quantity;  ///< with its unit: "period error", "run-out, m"
  double reference = 0;
  double measured = 0;
  double tolerance = 0;  ///< in the unit of the value
  Judged judged = Judged::within;
  std::optional<double> order = {};  ///< of convergence
  /// Between machines, as a fraction of the value, or of the tolerance if that is larger; `any` where it is rounding.
  double scatter = 0.01;
};

/// Expects the figure to be as good as it says, and that docs/verification.md says the same. Where CLEAVE_VERIFICATION_DIR is
/// set the page is being written: the figure is left there, and not compared.
void report(const Figure&);

/// Whether cases of more than half a minute are run: CLEAVE_VERIFY_LONG is set. A case that asks is listed as such.
bool long_cases();

/// log2 of the ratio of the errors at a spacing and at half of it.
double order_of(double coarse, double fine);

}  // namespace cleave::test
