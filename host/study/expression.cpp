#include "study/expression.hpp"

#include "common/error.hpp"
#include "config/table_reader.hpp"

#include <muParser.h>

#include <algorithm>
#include <cmath>
#include <numbers>

namespace cleave::study {
namespace {

void prepare(mu::Parser& parser) {
  parser.DefineFun("floor", [](double x) { return std::floor(x); });
  parser.DefineFun("erf", [](double x) { return std::erf(x); });
  parser.DefineConst("pi", std::numbers::pi);
}

InputError problem(const Formula& formula, const std::string& what) {
  return InputError(config::error_at(formula.where) + "'" + formula.text + "': " + what);
}

InputError problem(const Formula& formula, const mu::ParserError& error) {
  std::string what = error.GetMsg();
  while (!what.empty() && (what.back() == '.' || what.back() == '\n')) what.pop_back();
  return problem(formula, what);
}

}  // namespace

struct Expression::Parser {
  mu::Parser parser;
  std::vector<double> values;
};

std::vector<std::string> Expression::names_in(const Formula& formula) {
  try {
    mu::Parser parser;
    prepare(parser);
    parser.SetExpr(formula.text);
    std::vector<std::string> names;
    for (const auto& [name, unset] : parser.GetUsedVar()) names.push_back(name);
    return names;
  } catch (const mu::ParserError& error) {
    throw problem(formula, error);
  }
}

Expression::Expression(const Formula& formula, std::vector<std::string> names) : parser_(std::make_unique<Parser>()) {
  for (const std::string& used : names_in(formula)) {
    if (std::count(names.begin(), names.end(), used) > 1)
      throw problem(
          formula,
          "'" + used + "' is both an axis or a constant of the study and what a run writes: give the former " + "another name");
    if (std::find(names.begin(), names.end(), used) == names.end()) {
      std::sort(names.begin(), names.end());
      throw problem(formula, "there is no '" + used + "' here" +
                                 config::suggestion(used, names, "; there are: " + config::list_text(names)));
    }
  }
  try {
    prepare(parser_->parser);
    parser_->values.assign(names.size(), 0);
    for (std::size_t i = 0; i < names.size(); ++i) parser_->parser.DefineVar(names[i], &parser_->values[i]);
    parser_->parser.SetExpr(formula.text);
    parser_->parser.Eval();
  } catch (const mu::ParserError& error) {
    throw problem(formula, error);
  }
}

Expression::~Expression() = default;
Expression::Expression(Expression&&) noexcept = default;
Expression& Expression::operator=(Expression&&) noexcept = default;

double Expression::operator()(std::span<const double> values) const {
  std::copy_n(values.begin(), parser_->values.size(), parser_->values.begin());
  return parser_->parser.Eval();
}

std::vector<double> constants_of(const Study& study, std::vector<double> numbers) {
  const std::vector<std::string> names = study.names();
  for (const auto& [name, formula] : study.constants) {
    const std::vector<std::string> known(names.begin(), names.begin() + std::ptrdiff_t(numbers.size()));
    numbers.push_back(Expression(formula, known)(numbers));
  }
  return numbers;
}

}  // namespace cleave::study
