/// Parameters to run a law with, found from its schema.
#ifndef CLEAVE_TESTKIT_PARAMETERS_HPP
#define CLEAVE_TESTKIT_PARAMETERS_HPP

#include <cleave/abi.h>

#include <cstdint>
#include <map>
#include <optional>
#include <string>
#include <utility>
#include <variant>
#include <vector>

namespace cleave::testkit {

using Value = std::variant<double, std::int64_t, bool, std::string, std::vector<double>>;
/// What a scene would give; the rest are defaults.
using Settings = std::map<std::string, Value>;

std::string text(const Settings&);

/// Reads "1e5", "true", "exact", "[1, 2]" as the type of the parameter. Throws Failed for an unknown key or another type.
Settings read_settings(const cleave_schema&, const std::map<std::string, std::string>& texts);

/// For each choice among the alternatives: the keys that then have to be given.
std::vector<std::vector<std::string>> required_keys(const cleave_schema&);

/// Values of single optional parameters that make another law of it: every choice, flag and ability that is not the default.
std::vector<std::pair<std::string, Value>> switches(const cleave_schema&);

/// A value inside the range materials have, `place` in [0, 1] from its lower to its upper end; on a logarithmic scale where
/// the range spans orders of magnitude, and inside the validity bounds. Numbers in "Pa" and "J/m^3" follow `stress` if it is
/// positive: a hundredth to a hundred times of it, and of its hundredth.
Value typical_value(const cleave_parameter_schema&, double place, double stress);

/// Finite ends of the range a value is taken from.
struct Range {
  double low, high;
};
Range range_of(const cleave_parameter_schema&, double stress);

/// The values in the form create() takes, in the order of the schema.
class PackedParameters {
 public:
  PackedParameters(const cleave_schema&, const Settings& given);
  const cleave_parameters* get() const { return &parameters_; }
  /// To be changed before get() is used, for callers that hand over what a host would not.
  std::vector<cleave_parameter>& values() { return values_; }
  /// After values() changed its size.
  void refresh();

 private:
  Settings given_;
  std::vector<cleave_parameter> values_;
  cleave_parameters parameters_{};
};

/// Capabilities with these parameters (cleave_parameter_schema::needs).
std::uint64_t capabilities_with(const cleave_schema&, const Settings&);

const cleave_parameter_schema* find(const cleave_schema&, const std::string& key);

}  // namespace cleave::testkit

#endif
