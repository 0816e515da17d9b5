#include "point/json_stream.hpp"

#include "common/error.hpp"
#include "common/nearest.hpp"
#include "point/columns.hpp"
#include "point/evaluator.hpp"

#include <nlohmann/json.hpp>

#include <algorithm>
#include <cmath>
#include <istream>
#include <limits>
#include <ostream>
#include <span>

namespace cleave::point {
namespace {

using Json = nlohmann::ordered_json;

constexpr double nan = std::numeric_limits<double>::quiet_NaN();
constexpr int deepest_nesting = 64;

/// One state variable: its name in the protocol, and its place among the numbers of State::variables.
struct Variable {
  std::string name, unit;
  std::size_t first, count;
};

/// Named like the columns of a table, but whole: "alpha" or, where both laws have one, "damage_alpha".
std::vector<Variable> variables_of(const Laws& laws) {
  std::vector<Variable> variables;
  const auto columns = variable_columns(laws);
  for (const auto* law : {&laws.plasticity, &laws.damage}) {
    if (!*law) continue;
    for (const auto& state : law->description().states) {
      const std::size_t first = variables.empty() ? 0 : variables.back().first + variables.back().count;
      std::string name = columns[first];
      if (state.tensor != CLEAVE_SCALAR) name.pop_back();
      variables.push_back({name, state.unit, first, std::size_t(state.tensor)});
    }
  }
  return variables;
}

std::string text(const Json& value) { return value.dump(-1, ' ', false, Json::error_handler_t::replace); }

/// What a value of a request is, for messages.
std::string is(const Json& value) {
  if (value.is_array()) return "is a list of " + std::to_string(value.size());
  if (value.is_object()) return "is an object";
  return "is " + text(value);
}

[[noreturn]] void refuse(const std::string& name, const std::string& what) { throw InputError(name + " " + what); }

double read_number(const Json& value, const std::string& name) {
  if (!value.is_number()) refuse(name, "must be a number, " + is(value));
  const double number = value.get<double>();
  if (!std::isfinite(number)) refuse(name, "must be finite");
  return number;
}

void read_numbers(const Json& value, const std::string& name, std::span<double> numbers) {
  if (!value.is_array() || value.size() != numbers.size())
    refuse(name, "must be a list of " + std::to_string(numbers.size()) + " numbers, " + is(value));
  for (std::size_t i = 0; i < numbers.size(); ++i) numbers[i] = read_number(value[i], name + "[" + std::to_string(i) + "]");
}

void check_keys(const Json& object, const std::string& what, const std::vector<std::string>& known) {
  for (const auto& [key, value] : object.items()) {
    if (std::find(known.begin(), known.end(), key) != known.end()) continue;
    const auto near = nearest(key, known);
    std::string list;
    for (const auto& name : known) list += (list.empty() ? "" : ", ") + name;
    throw InputError("unknown key " + text(key) + " in " + what +
                     (near           ? ", did you mean \"" + *near + "\"?"
                      : list.empty() ? "; it has none"
                                     : "; it may have: " + list));
  }
}

class JsonStream {
 public:
  JsonStream(const Laws& laws, std::ostream& out)
      : laws_(laws),
        out_(out),
        variables_(variables_of(laws)),
        initial_(initial_variables(laws)),
        evaluator_(make_evaluator(laws)),
        evolves_(laws.damage && !laws.damage_is_local),
        has_energy_(laws.elasticity.description().can(CLEAVE_HAS_ENERGY)) {
    point_keys_ = {"F", "d"};
    if (evolves_) point_keys_.push_back("dt");
    if (!variables_.empty()) point_keys_.push_back("state");
  }

  void announce() {
    Json hello;
    hello["protocol"] = 1;
    hello["cleave"] = CLEAVE_VERSION;
    hello["precision"] = laws_.precision == config::Precision::single_precision ? "single" : "double";
    for (const auto* law : {&laws_.elasticity, &laws_.plasticity, &laws_.damage})
      if (*law) hello["laws"].push_back({{"id", law->description().id}, {"version", law->description().version}});
    const auto quantity = [](const char* name, const char* unit, int components) {
      return Json{{"name", name}, {"unit", unit}, {"components", components}};
    };
    hello["request"] = Json::array({quantity("F", "1", 9), quantity("d", "1", 1)});
    if (evolves_) hello["request"].push_back(quantity("dt", "s", 1));
    hello["state"] = Json::array();
    for (const auto& v : variables_) {
      const std::vector<double> values(initial_.begin() + std::ptrdiff_t(v.first),
                                       initial_.begin() + std::ptrdiff_t(v.first + v.count));
      hello["state"].push_back({{"name", v.name},
                                {"unit", v.unit},
                                {"components", v.count},
                                {"initial", v.count == 1 ? Json(values[0]) : Json(values)}});
    }
    Json& response = hello["response"] = Json::array();
    if (has_energy_) {
      response.push_back(quantity("psi", "J/m^3", 1));
      response.push_back(quantity("psi_plus", "J/m^3", 1));
    }
    response.push_back(quantity("J", "1", 1));
    response.push_back(quantity("P", "Pa", 9));
    response.push_back(quantity("tau", "Pa", 9));
    response.push_back(quantity("yielded", "", 1));
    response.push_back(quantity("Fe", "1", 9));
    if (laws_.damage) response.push_back(quantity("d", "1", 1));
    if (evolves_) response.push_back(quantity("D", "1", 1));
    send(text(hello));
  }

  void answer(const std::string& line) {
    Json id;
    try {
      const Json request = parse(line);
      if (request.contains("id")) id = request["id"];
      send(evaluate(request, id));
    } catch (const std::runtime_error& e) {  // InputError, or SimulationError of a plugin that gives up
      send(text(Json{{"error", e.what()}, {"id", id}}));
    }
  }

 private:
  static Json parse(const std::string& line) {
    const auto shallow = [](int depth, Json::parse_event_t, Json&) {
      if (depth > deepest_nesting) throw InputError("the request is nested too deeply");
      return true;
    };
    Json request;
    try {
      request = Json::parse(line, shallow);
    } catch (const Json::exception& e) {
      // "[json.exception.parse_error.101] parse error at line 1, column 5: ..."
      const std::string what = e.what();
      const auto reason = what.find("] ");
      throw InputError("the request is not JSON: " + (reason == std::string::npos ? what : what.substr(reason + 2)));
    }
    if (!request.is_object()) throw InputError("a request must be an object, " + is(request));
    return request;
  }

  std::string evaluate(const Json& request, const Json& id) {
    const bool many = request.contains("points");
    std::vector<State> states;
    std::vector<double> seconds;  // nan: no time passes
    if (many) {
      check_keys(request, "a request with points", {"id", "points"});
      const Json& points = request["points"];
      if (!points.is_array()) refuse("points", "must be a list of points, " + is(points));
      for (std::size_t i = 0; i < points.size(); ++i) {
        const std::string name = "points[" + std::to_string(i) + "]";
        if (!points[i].is_object()) refuse(name, "must be an object, " + is(points[i]));
        check_keys(points[i], name, point_keys_);
        read(points[i], name + ".", states, seconds);
      }
    } else {
      std::vector<std::string> known = point_keys_;
      known.insert(known.end(), {"id", "points"});
      check_keys(request, "a request", known);
      read(request, "", states, seconds);
    }
    std::vector<Response> responses(states.size());
    evaluator_->evaluate(states, responses);
    std::string line = "{\"id\":" + text(id);
    if (many) line += ",\"points\":[";
    for (std::size_t k = 0; k < states.size(); ++k) {
      if (many)
        line += k == 0 ? "{" : ",{";
      else
        line += ',';
      append(line, states[k], seconds[k], responses[k]);
      line += '}';
    }
    if (many) line += "]}";
    return line;
  }

  void read(const Json& point, const std::string& prefix, std::vector<State>& states, std::vector<double>& seconds) const {
    State state;
    if (!point.contains("F")) refuse(prefix + "F", "is missing: the deformation gradient, nine numbers row by row");
    double F[9];
    read_numbers(point["F"], prefix + "F", F);
    for (int i = 0; i < 9; ++i) state.deformation(i / 3, i % 3) = F[i];
    if (point.contains("d")) {
      state.damage = state.degrading_damage = read_number(point["d"], prefix + "d");
      if (!(state.damage >= 0 && state.damage <= 1)) refuse(prefix + "d", "must be in [0, 1], " + is(point["d"]));
    }
    double dt = nan;
    if (point.contains("dt")) {
      dt = read_number(point["dt"], prefix + "dt");
      if (!(dt >= 0)) refuse(prefix + "dt", "must be a time of at least 0 s, " + is(point["dt"]));
    }
    state.variables = initial_;
    if (point.contains("state")) {
      const Json& given = point["state"];
      if (!given.is_object()) refuse(prefix + "state", "must be an object, " + is(given));
      std::vector<std::string> names;
      for (const auto& v : variables_) names.push_back(v.name);
      check_keys(given, prefix + "state", names);
      for (const auto& v : variables_) {
        if (!given.contains(v.name)) continue;
        const std::string name = prefix + "state." + v.name;
        if (v.count == 1)
          state.variables[v.first] = read_number(given[v.name], name);
        else
          read_numbers(given[v.name], name, std::span(state.variables).subspan(v.first, v.count));
      }
    }
    states.push_back(std::move(state));
    seconds.push_back(dt);
  }

  void append(std::string& line, const State& before, double seconds, const Response& r) const {
    const auto number = [&](double value) {
      if (!r.usable()) value = nan;
      if (std::isfinite(value))
        append_number(line, value, laws_.precision);
      else
        line += std::isnan(value) ? "\"nan\"" : value > 0 ? "\"inf\"" : "\"-inf\"";
    };
    const auto scalar = [&](const std::string& key, double value) {
      line += ",\"" + key + "\":";
      number(value);
    };
    const auto list = [&](const std::string& key, std::size_t count, auto&& value) {
      line += ",\"" + key + "\":[";
      for (std::size_t i = 0; i < count; ++i) {
        if (i > 0) line += ',';
        number(value(i));
      }
      line += ']';
    };
    const auto matrix = [&](const char* key, const Matrix3& a) {
      list(key, 9, [&](std::size_t i) { return a(Eigen::Index(i / 3), Eigen::Index(i % 3)); });
    };
    line += std::string("\"status\":\"") + name(r.status) + '"';
    if (has_energy_) {
      scalar("psi", r.energy);
      scalar("psi_plus", r.tensile_energy);
    }
    scalar("J", r.volume_ratio);
    matrix("P", r.first_piola);
    matrix("tau", r.kirchhoff);
    scalar("yielded", r.yielded ? 1 : 0);
    matrix("Fe", r.deformation);
    if (laws_.damage_is_local) {
      scalar("d", r.damage);
    } else if (evolves_) {
      if (!std::isnan(seconds)) scalar("d", laws_.damage_after(seconds, before.damage, r.driving_force));
      scalar("D", r.driving_force);
    }
    if (variables_.empty()) return;
    line += ",\"state\":{";
    const std::size_t members = line.size();
    for (const auto& v : variables_) {
      const auto value = [&](std::size_t i) { return r.usable() ? r.variables[v.first + i] : nan; };
      if (v.count == 1)
        scalar(v.name, value(0));
      else
        list(v.name, v.count, value);
    }
    line.erase(members, 1);  // the comma before the first
    line += '}';
  }

  void send(const std::string& line) {
    out_ << line << '\n' << std::flush;
    if (!out_) throw InputError("cannot write the standard output");
  }

  const Laws& laws_;
  std::ostream& out_;
  std::vector<Variable> variables_;
  std::vector<double> initial_;
  std::unique_ptr<Evaluator> evaluator_;
  bool evolves_, has_energy_;
  std::vector<std::string> point_keys_;
};

}  // namespace

void serve_json(const Laws& laws, std::istream& in, std::ostream& out) {
  JsonStream stream(laws, out);
  stream.announce();
  for (std::string line; std::getline(in, line);)
    if (line.find_first_not_of(" \t\r") != std::string::npos) stream.answer(line);
}

}  // namespace cleave::point
