#include "bench/json.hpp"

#include <sstream>

namespace cleave::bench {

toml::table to_json(const plugins::GivenParameters& parameters) {
  toml::table table;
  for (const auto& parameter : parameters)
    std::visit(
        [&](const auto& value) {
          if constexpr (std::is_same_v<std::decay_t<decltype(value)>, std::vector<double>>) {
            toml::array list;
            for (double element : value) list.push_back(element);
            table.insert(parameter.first, std::move(list));
          } else {
            table.insert(parameter.first, value);
          }
        },
        parameter.second);
  return table;
}

std::string json_text(const toml::table& table) {
  std::ostringstream text;
  text << toml::json_formatter(table) << '\n';
  return text.str();
}

}  // namespace cleave::bench
