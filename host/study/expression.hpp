#pragma once

#include "study/study.hpp"

#include <memory>
#include <span>
#include <string>
#include <vector>

namespace cleave::study {

/// A formula of named numbers: + - * / ^, comparisons, && || ?:, sin cos tan asin acos atan sinh cosh tanh exp ln log10 sqrt
/// abs min max floor erf, pi.
class Expression {
 public:
  /// Throws InputError with the place in the study and what is wrong: the syntax, or a name that is not one of `names`,
  /// or is there twice.
  Expression(const Formula&, std::vector<std::string> names);
  ~Expression();
  Expression(Expression&&) noexcept;
  Expression& operator=(Expression&&) noexcept;

  /// `values` in the order of the names.
  double operator()(std::span<const double> values) const;

  /// Names that a formula uses. Throws InputError if it cannot be read.
  static std::vector<std::string> names_in(const Formula&);

 private:
  struct Parser;
  std::unique_ptr<Parser> parser_;
};

/// Values of Study::names() for a point: `numbers` of its numeric axes, then its constants.
std::vector<double> constants_of(const Study&, std::vector<double> numbers);

}  // namespace cleave::study
