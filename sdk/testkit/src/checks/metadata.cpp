#include <cleave/testkit/batch.hpp>
#include <cleave/testkit/context.hpp>

#include <algorithm>
#include <cmath>
#include <cstring>
#include <limits>
#include <set>

namespace cleave::testkit {
namespace {

bool is_one_line(const char* text) { return text && *text && !std::strchr(text, '\n'); }

bool has_number(const cleave_parameter_schema& p) {
  return p.type == CLEAVE_TYPE_NUMBER || p.type == CLEAVE_TYPE_INTEGER || p.type == CLEAVE_TYPE_NUMBER_LIST;
}

void described(Context& context) {
  const cleave_plugin& table = context.plugin().table();
  const cleave_about& about = *table.about;
  if (!is_one_line(about.version)) context.fail("about.version is not one line of text");
  if (!is_one_line(about.summary)) context.fail("about.summary is not one line of text");
  if (!about.author || !about.source) context.fail("about.author or about.source is null");
  const std::string id = about.id;
  const auto name = id.substr(id.find('/') + 1);
  if (name.empty() || name.find_first_not_of("abcdefghijklmnopqrstuvwxyz0123456789-") != std::string::npos)
    context.fail("about.id \"" + id + "\" is not kind/name of lower case letters, digits and '-'");
  std::set<std::string> names;
  for (std::uint32_t i = 0; i < table.schema->parameter_count; ++i) {
    const cleave_parameter_schema& p = *table.schema->parameters[i];
    if (!is_one_line(p.key)) context.fail("parameter " + std::to_string(i) + " has no key");
    const std::string key = p.key;
    if (key.find_first_not_of("abcdefghijklmnopqrstuvwxyz0123456789_") != std::string::npos)
      context.fail("parameter \"" + key + "\": a key is made of lower case letters, digits and '_'");
    if (!names.insert(key).second) context.fail("parameter \"" + key + "\" is there twice");
    if (!p.unit || (has_number(p) && !*p.unit)) context.fail("parameter \"" + key + "\" has no unit (\"1\" if dimensionless)");
    if (!is_one_line(p.description)) context.fail("parameter \"" + key + "\" has no description of one line");
  }
  names.clear();
  for (std::uint32_t i = 0; i < table.schema->state_count; ++i) {
    const cleave_state_schema& s = *table.schema->states[i];
    if (!is_one_line(s.name)) context.fail("state variable " + std::to_string(i) + " has no name");
    const std::string state = s.name;
    if (!names.insert(state).second) context.fail("state variable \"" + state + "\" is there twice");
    if (!s.unit || !*s.unit) context.fail("state variable \"" + state + "\" has no unit (\"1\" if dimensionless)");
    if (!is_one_line(s.description)) context.fail("state variable \"" + state + "\" has no description of one line");
  }
  context.close();
  if (context.plugin().id() != id) context.fail("the ID changes when the library is loaded again");
}

bool is_inside(const cleave_parameter_schema& p, double value) {
  return std::isfinite(value) && (p.minimum_open ? value > p.minimum : value >= p.minimum) &&
         (p.maximum_open ? value < p.maximum : value <= p.maximum);
}

void defaults(Context& context) {
  const cleave_schema& schema = context.plugin().schema();
  for (std::uint32_t i = 0; i < schema.parameter_count; ++i) {
    const cleave_parameter_schema& p = *schema.parameters[i];
    const std::string what = "parameter \"" + std::string(p.key) + "\": ";
    if (has_number(p)) {
      if (!(p.minimum <= p.maximum)) context.fail(what + "its minimum is above its maximum");
      if (!(p.minimum <= p.physical_minimum && p.physical_maximum <= p.maximum && p.physical_minimum <= p.physical_maximum))
        context.fail(what + "what materials have is not inside the validity bounds");
    }
    if (p.required || p.in_set) continue;
    if (p.type == CLEAVE_TYPE_NUMBER || p.type == CLEAVE_TYPE_INTEGER) {
      if (!is_inside(p, p.default_number)) context.fail(what + "its default is outside of its bounds");
      if (p.type == CLEAVE_TYPE_INTEGER && p.default_number != std::floor(p.default_number))
        context.fail(what + "its default is not an integer");
    } else if (p.type == CLEAVE_TYPE_NUMBER_LIST) {
      if (p.default_count < p.min_count || p.default_count > p.max_count)
        context.fail(what + "its default has too few or too many elements");
      for (std::uint32_t k = 0; k < p.default_count; ++k)
        if (!is_inside(p, p.default_list[k])) context.fail(what + "an element of its default is outside of its bounds");
    } else if (p.type == CLEAVE_TYPE_TEXT) {
      if (!p.default_text) context.fail(what + "its default is null");
      bool known = p.choice_count == 0;
      for (std::uint32_t k = 0; k < p.choice_count; ++k) known = known || std::strcmp(p.choices[k], p.default_text) == 0;
      if (!known) context.fail(what + "its default is none of its choices");
    }
  }
  for (std::uint32_t i = 0; i < schema.state_count; ++i)
    for (std::uint32_t k = 0; k < schema.states[i]->tensor; ++k)
      if (!std::isfinite(schema.states[i]->initial[k]))
        context.fail("state variable \"" + std::string(schema.states[i]->name) + "\": its initial value is not finite");
}

/// Hands create() what a host would have refused, and expects CLEAVE_ERROR_PARAMETER with the key as subject.
class Refusals {
 public:
  Refusals(Context& context, const Settings& settings) : context_(context), settings_(settings), material_(plugin().kind()) {}

  template <class Change>
  void expect(const std::string& key, const std::string& what, Change change) const {
    PackedParameters parameters(plugin().schema(), settings_);
    change(parameters.values());
    parameters.refresh();
    Words words;
    cleave_instance* instance = nullptr;
    context_.doing("given " + key + " " + what);
    const cleave_result result = plugin().table().create(parameters.get(), &material_.context, &instance, &words.message);
    if (result == CLEAVE_OK) context_.fail("accepts " + key + " " + what);
    if (result != CLEAVE_ERROR_PARAMETER)
      context_.fail("refuses " + key + " " + what + " with result " + std::to_string(result) +
                    " in place of CLEAVE_ERROR_PARAMETER");
    if (key != words.subject)
      context_.fail("refuses " + key + " " + what + ", but the message is about \"" + words.subject + "\": " + words.text);
    if (!words.text[0]) context_.fail("refuses " + key + " " + what + " without a word");
  }

 private:
  const Plugin& plugin() const { return context_.plugin(); }
  Context& context_;
  Settings settings_;
  Material material_;
};

void rejects(Context& context) {
  const cleave_schema& schema = context.plugin().schema();
  using Values = std::vector<cleave_parameter>;
  for (const Settings& settings : context.settings()) {
    const Refusals refusals(context, settings);
    refusals.expect("no_such_parameter", "which it does not have", [](Values& values) {
      cleave_parameter unknown{};
      unknown.struct_size = sizeof unknown;
      unknown.key = "no_such_parameter";
      unknown.given = 1;
      unknown.text = "";
      values.push_back(unknown);
    });
    for (std::uint32_t i = 0; i < schema.parameter_count; ++i) {
      const cleave_parameter_schema& p = *schema.parameters[i];
      if (p.in_set && !settings.contains(p.key)) continue;
      const auto number = [&](double value, const char* what) {
        refusals.expect(p.key, what, [&](Values& values) {
          values[i].given = 1;
          values[i].number = value;
          values[i].integer = std::isfinite(value) ? std::int64_t(value) : 0;
          if (p.type == CLEAVE_TYPE_NUMBER_LIST) {
            static double list[9];
            std::fill(std::begin(list), std::end(list), value);
            values[i].list = list;
            values[i].count = std::max(1u, std::min(9u, p.min_count));
          }
        });
      };
      if (has_number(p) && !(p.type == CLEAVE_TYPE_NUMBER_LIST && p.max_count == 0)) {
        const double step = p.type == CLEAVE_TYPE_INTEGER ? 1 : 0;
        const auto beyond = [&](double bound, double by) { return bound + (step > 0 ? by : by * (1 + std::abs(bound))); };
        // Integers at the end of what an int holds have nothing beyond them.
        const bool representable = p.type != CLEAVE_TYPE_INTEGER || std::abs(p.minimum) < 0x1p31;
        if (std::isfinite(p.minimum) && representable)
          number(p.minimum_open ? p.minimum : beyond(p.minimum, -1), "below its minimum");
        if (std::isfinite(p.maximum) && representable)
          number(p.maximum_open ? p.maximum : beyond(p.maximum, 1), "above its maximum");
        if (p.type != CLEAVE_TYPE_INTEGER) {
          number(std::numeric_limits<double>::quiet_NaN(), "that is not a number");
          number(std::numeric_limits<double>::infinity(), "that is infinite");
        }
      }
      if (p.type == CLEAVE_TYPE_NUMBER_LIST)
        refusals.expect(p.key, "with too many elements", [&](Values& values) {
          static const std::vector<double> list(p.max_count + 1, 0.5 * (p.physical_minimum + p.physical_maximum));
          values[i].given = 1;
          values[i].list = list.data();
          values[i].count = p.max_count + 1;
        });
      if (p.type == CLEAVE_TYPE_TEXT && p.choice_count)
        refusals.expect(p.key, "that is none of its choices", [&](Values& values) {
          values[i].given = 1;
          values[i].text = "none of these";
        });
      refusals.expect(p.key, "of the wrong type", [&](Values& values) {
        values[i].given = 1;
        values[i].type = p.type == CLEAVE_TYPE_TEXT ? CLEAVE_TYPE_NUMBER : CLEAVE_TYPE_TEXT;
        values[i].text = "text";
      });
      if (p.required)
        refusals.expect(p.key, "missing", [&](Values& values) { values.erase(values.begin() + std::ptrdiff_t(i)); });
    }
  }
}

/// `a` keeps its bits while `b` is created, called and destroyed.
void expect_independence(Context& context, const Settings& first, const Settings& second) {
  const Precision precision = precisions(context.plugin()).front();
  const Instance a(context.plugin(), first);
  Random random(context.seed());
  const Request request = random_request(a, random, 32, measures(a).front());
  const Answer alone = evaluated(a, precision, request);
  const std::string what = "a second instance with " + text(second) + " changes ";
  {
    const Instance b(context.plugin(), second);
    if (const auto where = first_difference(alone, evaluated(a, precision, request)); !where.empty())
      context.fail(what + where + " of the first");
    evaluated(b, precision, random_request(b, random, 32, measures(b).front()));
    if (const auto where = first_difference(alone, evaluated(a, precision, request)); !where.empty())
      context.fail("a call of " + what + where + " of the first");
  }
  if (const auto where = first_difference(alone, evaluated(a, precision, request)); !where.empty())
    context.fail("destroying a second instance changes " + where + " of the first");
}

void independent_instances(Context& context) {
  const std::vector<Settings>& all = context.settings();
  const auto other = context.settings_at(0.62);
  if (all.size() < 2 && (all.front().empty() || !other)) context.skip("no two sets of parameters");
  if (other) expect_independence(context, all.front(), *other);
  for (std::size_t i = 1; i < all.size(); ++i) {
    expect_independence(context, all.front(), all[i]);
    expect_independence(context, all[i], all.front());
  }
}

/// Every output is finite, or the status says why not.
void finite_or_said(Context& context, const Instance& instance, Random& random, const Settings& settings) {
  for (const auto precision : precisions(instance.plugin()))
    for (const auto& measure : measures(instance)) {
      const std::string where = std::string(", in ") + name(precision) + " with " + text(settings);
      const Answer answer = evaluated(instance, precision, random_request(instance, random, 8, measure));
      for (std::uint32_t k = 0; k < answer.status.size(); ++k) {
        if (answer.status[k] > CLEAVE_STATUS_FATAL)
          context.fail("status " + std::to_string(answer.status[k]) + " does not exist" + where);
        if (answer.status[k] >= CLEAVE_STATUS_RETRY) continue;
        for (const auto& [field, values] : answer.outputs)
          for (double value : values[k])
            if (!std::isfinite(value)) context.fail(std::string(name(field)) + " is not finite and no status says so" + where);
      }
    }
}

/// The last value inside a validity bound, the first or last of what materials have where there is no bound.
Value bound_of(const cleave_parameter_schema& p, bool upper, double stress) {
  const double bound = upper ? p.maximum : p.minimum;
  if (p.type != CLEAVE_TYPE_NUMBER || !std::isfinite(bound)) return typical_value(p, upper, stress);
  const bool open = upper ? p.maximum_open : p.minimum_open;
  return open ? std::nextafter(bound, upper ? p.minimum : p.maximum) : bound;
}

void parameter_space(Context& context) {
  const cleave_schema& schema = context.plugin().schema();
  const double stress = context.plugin().kind() == elasticity_kind ? 0 : 0.01 * Material::youngs_modulus;
  const auto choices = required_keys(schema);
  int accepted = 0, refused = 0;
  std::string refusal;
  context.random_cases(1200, [&](Random& random) {
    const auto& keys = choices[std::size_t(random.below(int(choices.size())))];
    const int sort = random.below(12);  // corners of what is valid, corners of what materials have, or anything between
    Settings settings;
    for (std::uint32_t i = 0; i < schema.parameter_count; ++i) {
      const cleave_parameter_schema& p = *schema.parameters[i];
      const bool chosen = std::find(keys.begin(), keys.end(), p.key) != keys.end();
      // Members of other alternatives stay away, everything else is given half of the time.
      if (!chosen && (p.in_set || random.below(2))) continue;
      settings[p.key] = sort == 0 ? bound_of(p, random.below(2), stress)
                                  : typical_value(p, sort == 1 ? random.below(2) : random.uniform(), stress);
    }
    context.doing("with " + text(settings));
    const PackedParameters parameters(schema, settings);
    const Material material(context.plugin().kind());
    cleave_instance* handle = nullptr;
    Words words;
    const cleave_result result = context.plugin().table().create(parameters.get(), &material.context, &handle, &words.message);
    if (result != CLEAVE_OK) {
      ++refused;
      refusal = words.said();
      // Values that are each inside their bounds may not go together; the law then says so.
      if (result == CLEAVE_ERROR_INTERNAL || !words.text[0])
        context.fail("create() fails with result " + std::to_string(result) + " and " + words.said() + ", with " +
                     text(settings));
      return;
    }
    context.plugin().table().destroy(handle);
    ++accepted;
    if (context.plugin().kind() & batch_kinds) finite_or_said(context, Instance(context.plugin(), settings), random, settings);
  });
  if (accepted == 0) context.fail("refuses all of " + std::to_string(refused) + " sets of parameters: " + refusal);
}

void state_size(Context& context) {
  const Plugin& plugin = context.plugin();
  const int declared = state_components(plugin.schema());
  if (declared > int(CLEAVE_MAX_STATE))
    context.fail("declares " + std::to_string(declared) + " state components, at most " + std::to_string(CLEAVE_MAX_STATE) +
                 " are possible");
  if (!plugin.schema().state_count) context.skip("no state variables");
  for (const Settings& settings : context.settings()) {
    const Instance instance(plugin, settings);
    if (plugin.table().initial_state) {
      for (double pattern : {12345.678, -9.75e11}) {
        std::vector<double> values(std::size_t(declared) + 32, pattern);
        plugin.table().initial_state(instance.handle(), values.data() + 16);
        for (int i = 0; i < int(values.size()); ++i) {
          const bool inside = i >= 16 && i < 16 + declared;
          if (inside == (values[std::size_t(i)] == pattern))
            context.fail("initial_state() " + std::string(inside ? "leaves out component " : "writes component ") +
                         std::to_string(i - 16) + " of " + std::to_string(declared));
          if (inside && !std::isfinite(values[std::size_t(i)]))
            context.fail("initial_state() gives component " + std::to_string(i - 16) + " a value that is not finite");
        }
      }
    }
    if (!(plugin.kind() & (plasticity_kind | damage_kind))) continue;
    Random random(context.seed());
    for (const auto precision : precisions(plugin))
      for (const auto& measure : measures(instance)) {
        const Request request = random_request(instance, random, 20, measure);
        const Answer a = evaluated_alone(instance, precision, request, {.order = Placement::padded});
        const Answer b = evaluated(instance, precision, request, {.order = Placement::padded, .fill = 0x5A});
        if (const auto where = first_difference(a, b); !where.empty()) context.fail(where + " is not written");
      }
  }
}

}  // namespace

std::vector<Check> metadata_checks() {
  return {
      {"metadata.described", 9,
       "The ID is well-formed and stable; every parameter and state variable has a unit and one line of text.", all_kinds,
       described},
      {"metadata.defaults", 10, "Defaults are finite and inside their bounds; physical bounds lie inside the validity bounds.",
       all_kinds, defaults},
      {"metadata.rejects-parameters", 11,
       "Parameters out of bounds, not finite, missing, unknown or of the wrong type are refused by name.", all_kinds, rejects},
      {"metadata.independent-instances", 12, "Two instances with different parameters do not influence each other.",
       batch_kinds, independent_instances},
      {"metadata.parameter-space", 13,
       "Corners of the bounds and random sets of parameters, 1200 in all, give finite results or a status that says otherwise.",
       all_kinds, parameter_space},
      {"metadata.state-size", 14, "As many state components are written as are declared.", all_kinds, state_size},
  };
}

}  // namespace cleave::testkit
