/// Return mappings as functions of points, for checks of plasticity laws.
///
/// Yield functions are not part of the ABI. What is admissible is found by asking the law: elastic is what is not returned.
#ifndef CLEAVE_TESTKIT_RETURN_MAPPING_HPP
#define CLEAVE_TESTKIT_RETURN_MAPPING_HPP

#include <cleave/plasticity.h>
#include <cleave/testkit/batch.hpp>
#include <cleave/testkit/context.hpp>
#include <cleave/testkit/tensor3.hpp>

#include <functional>
#include <optional>
#include <string>
#include <utility>
#include <vector>

namespace cleave::testkit::plasticity {

// ---------------------------------------------------------------- tensors

/// sum f(lambda_i) n_i n_i^T
Symmetric3 function_of(const Symmetric3&, double (*f)(double));
/// e = ln(b)/2
Symmetric3 logarithmic_strain(const Symmetric3& b);
/// Largest over smallest eigenvalue: what the rounding of b is multiplied with in its determinant.
double condition(const Symmetric3& b);
/// Kirchhoff stress of the elastic law of Material.
Symmetric3 stress(const Symmetric3& b);

/// Largest difference of two lists of numbers, relative to the largest number if that is above 1.
double largest_change(const std::vector<double>& a, const std::vector<double>& b);

/// "1.23e-05"
std::string short_text(double);
/// "[1, 0.98999999999999999]"
std::string digits(const std::vector<double>&);

// ---------------------------------------------------------------- the law as a function

/// Strains in one measure with their states.
struct Points {
  Field strain, state;
  std::uint32_t size() const { return std::uint32_t(strain.size()); }
};

struct Returned {
  Points points;
  std::vector<bool> yielded;
  std::vector<std::uint8_t> status;
  bool valid(std::uint32_t k) const { return status[k] < CLEAVE_STATUS_RETRY; }
  bool elastic(std::uint32_t k) const { return valid(k) && !yielded[k]; }
};

/// One instance, asked in one precision and strain measure.
class Mapping {
 public:
  Mapping(const Instance& instance, Precision precision, std::string measure)
      : instance_(instance), precision_(precision), measure_(std::move(measure)), initial_(instance.initial_state()) {}

  bool of_b() const { return measure_ == "b"; }
  bool is_single() const { return precision_ == Precision::single_precision; }
  /// Unit of rounding.
  double rounding() const { return is_single() ? 0x1p-23 : 0x1p-52; }
  std::string form() const { return std::string(name(precision_)) + " of " + measure_; }

  Returned operator()(const Points& points, double time_step = 1e-4) const;

  /// As the law sees it.
  std::vector<double> seen(std::vector<double> values) const {
    if (is_single())
      for (double& value : values) value = double(float(value));
    return values;
  }
  std::vector<double> strain(const Matrix3& F) const { return seen(of_b() ? numbers(left_cauchy_green(F)) : numbers(F)); }
  Symmetric3 b(const std::vector<double>& strain) const {
    return of_b() ? read<6>(strain) : left_cauchy_green(read<9>(strain));
  }

  /// F = left diag(exp(e)) right^T, at the initial state.
  void add(Points& points, const Vector3& e, const Matrix3& left, const Matrix3& right) const;
  /// The strain after a further stretch of `step` times the logarithmic strain `way`.
  std::vector<double> moved(const std::vector<double>& strain, const Symmetric3& way, double step) const;

  std::string words(const Points& points, std::uint32_t k) const;

 private:
  const Instance& instance_;
  Precision precision_;
  std::string measure_;
  std::vector<double> initial_;
};

/// Trials of the initial state with principal logarithmic strains up to 0.22 `spread`, many of them smaller.
Points random_trials(const Mapping&, Random&, std::uint32_t count, double spread = 1);
/// The same, half of them with the states that the law made of others.
Points further_trials(const Mapping&, Random&, std::uint32_t count, double spread = 1);

/// A logarithmic strain well inside of the elastic domain of the initial state: the mean of elastic ones, the domain being
/// convex. None if every trial yields.
std::optional<Symmetric3> interior(const Mapping&, Random&);
/// The strain a tiny bit nearer to that: by 1e-8 of the way in double precision, and beyond rounding.
std::vector<double> inward(const Mapping&, const std::vector<double>& strain, const Symmetric3& interior);

/// Returned states, returned again with the states before and after the first return: hardening may count from the next step
/// on, so that the yield surface they are on is that of either.
struct SecondReturn {
  Returned with_old, with_new;
  SecondReturn(const Mapping& map, const Points& trial, const Returned& first);
};

/// The stress differences that count at b, which was returned from a trial: a small part of the stress, beyond rounding.
double stress_tolerance(const Mapping&, const Symmetric3& trial, const Symmetric3& b);

// ---------------------------------------------------------------- what to ask, and how

/// Parameters to try: those of the context, and the first of them with every optional number at a typical value, which may
/// switch on what is off by default.
std::vector<Settings> all_settings(Context&);

/// Bits of enum cleave_return_guarantee.
std::uint64_t guarantees(const Instance&);
/// Why returned states need not be admissible; empty if they have to.
std::string excuse(const Instance&, const Mapping&);

enum class Forms {
  all,    ///< every precision and measure
  widest  ///< f64 and b, or what there is
};

/// `body(instance, map, random)` for the parameters to try; it returns why it does not apply to them, or nothing. If it applies
/// to none the check is skipped.
void for_each_mapping(Context&, Forms, const std::function<std::string(const Instance&, const Mapping&, Random&)>& body);

inline const std::string nothing_yields = "no trial with stretches of 0.8 to 1.25 yields";

}  // namespace cleave::testkit::plasticity

#endif
