#include "config/overrides.hpp"

#include "common/error.hpp"
#include "common/nesting.hpp"

#include <algorithm>
#include <charconv>
#include <memory>

namespace cleave::config {
namespace {

std::vector<std::string> split(const std::string& path) {
  std::vector<std::string> parts(1);
  for (const char c : path) {
    if (c == '.')
      parts.emplace_back();
    else
      parts.back() += c;
  }
  return parts;
}

toml::source_region region_of(const std::string& location) {
  return {{1, 1}, {1, 1}, std::make_shared<const std::string>(location)};
}

/// The value as a one-entry table, so that it keeps where it is from. Words that are not TOML are text.
std::optional<toml::table> parse_value(const Override& given, const std::string& location, Diagnostics& diagnostics) {
  try {
    toml::table parsed = toml::parse("value = " + given.value, location);
    if (parsed.size() == 1) return parsed;
    diagnostics.error({location}, "takes one value");
    return std::nullopt;
  } catch (const toml::parse_error& problem) {
    const std::string_view openings = "[{\"'";
    if (!given.value.empty() && openings.find(given.value.front()) != std::string_view::npos) {
      diagnostics.error({location}, "the value is not TOML: " + std::string(problem.description()));
      return std::nullopt;
    }
  }
  std::string literal = "value = \"";
  for (const char c : given.value) literal += c == '"' || c == '\\' ? std::string("\\") + c : std::string(1, c);
  try {
    return toml::parse(literal + "\"", location);
  } catch (const toml::parse_error&) {
    diagnostics.error({location}, "the value is not text that a scene may hold");
    return std::nullopt;
  }
}

std::string name_of(const toml::node& element) {
  const toml::table* table = element.as_table();
  const toml::node* name = table ? table->get("name") : nullptr;
  return name && name->is_string() ? name->as_string()->get() : std::string();
}

/// An element by index, or by its `name`.
std::optional<std::size_t> find_element(const toml::array& list, const std::string& list_name, const std::string& part,
                                        const std::string& location, Diagnostics& diagnostics) {
  std::size_t index = 0;
  const char* end = part.data() + part.size();
  if (const auto number = std::from_chars(part.data(), end, index); number.ec == std::errc() && number.ptr == end) {
    if (index < list.size()) return index;
    diagnostics.error({location}, list.empty()
                                      ? "'" + list_name + "' is empty"
                                      : "'" + list_name + "' has only the elements 0 to " + std::to_string(list.size() - 1));
    return std::nullopt;
  }
  std::vector<std::string> names;
  for (const toml::node& element : list) {
    const std::string name = name_of(element);
    if (name == part) return names.size();
    names.push_back(name);
  }
  names.erase(std::remove(names.begin(), names.end(), std::string()), names.end());
  diagnostics.error({location}, "no " + list_name + " named '" + part + "'" +
                                    suggestion(part, names, names.empty() ? "" : "; there are: " + list_text(names)));
  return std::nullopt;
}

}  // namespace

Override parse_override(const std::string& text) {
  const auto equals = text.find('=');
  const std::string path = text.substr(0, equals);
  const auto parts = split(path);
  const bool complete = std::none_of(parts.begin(), parts.end(), [](const std::string& part) { return part.empty(); });
  if (equals == std::string::npos || !complete)
    throw InputError(std::string(override_prefix) + text +
                     ": error: expected path=value, for example simulation.cell_size=0.01");
  if (parts.size() > deepest_toml || line_nested_too_deep(text.substr(equals + 1)))
    throw InputError(std::string(override_prefix) + text.substr(0, 40) + "...: error: nested deeper than " +
                     std::to_string(deepest_toml) + " tables");
  return {path, text.substr(equals + 1)};
}

void apply_override(toml::table& root, const Override& given, Diagnostics& diagnostics) {
  const std::string location = std::string(override_prefix) + given.path;
  auto value = parse_value(given, location, diagnostics);
  if (!value) return;
  toml::node& leaf = *value->get("value");

  toml::node* node = &root;
  const auto parts = split(given.path);
  std::string walked;
  for (std::size_t i = 0; i < parts.size(); ++i) {
    const std::string& part = parts[i];
    const bool last = i + 1 == parts.size();
    if (toml::table* table = node->as_table()) {
      const toml::key key(part, region_of(location));
      if (last) {
        table->erase(part);
        leaf.visit([&](auto& concrete) { table->insert_or_assign(key, std::move(concrete)); });
        return;
      }
      if (!table->contains(part)) {
        toml::table made = toml::parse("made = {}", location);
        table->insert_or_assign(key, std::move(*made.get_as<toml::table>("made")));
        table->get_as<toml::table>(part)->is_inline(false);
      }
      node = table->get(part);
    } else if (toml::array* list = node->as_array()) {
      const auto index = find_element(*list, walked, part, location, diagnostics);
      if (!index) return;
      if (last) {
        leaf.visit([&](auto& concrete) { list->replace(list->cbegin() + std::ptrdiff_t(*index), std::move(concrete)); });
        return;
      }
      node = list->get(*index);
    } else {
      diagnostics.error({location}, "'" + walked + "' is " + found(*node) + ", it has nothing named '" + part + "'");
      return;
    }
    walked = part;
  }
}

}  // namespace cleave::config
