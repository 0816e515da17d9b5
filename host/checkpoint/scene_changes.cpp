#include "checkpoint/scene_changes.hpp"

#include "common/error.hpp"
#include "common/nesting.hpp"

#include <fmt/format.h>
#include <toml++/toml.h>

#include <algorithm>
#include <filesystem>
#include <sstream>

namespace cleave::checkpoint {

namespace {

namespace fs = std::filesystem;

/// Called with (key, value) for all values but tables and lists of tables: these are gone through. Elements of lists are named
/// by their name, where they have one.
template <class F>
void for_values(const std::string& key, const toml::node& node, const F& each) {
  const auto inside = [&](const std::string& name) { return key.empty() ? name : key + "." + name; };
  if (const auto* table = node.as_table()) {
    for (const auto& [name, value] : *table) for_values(inside(std::string(name.str())), value, each);
  } else if (const auto* list = node.as_array(); list && list->is_array_of_tables()) {
    for (std::size_t i = 0; i < list->size(); i++) {
      const auto name = (*list->get(i)->as_table())["name"].value<std::string>();
      for_values(inside(name ? *name : std::to_string(i)), *list->get(i), each);
    }
  } else {
    each(key, node);
  }
}

toml::table parsed(const std::string& scene) {
  if (line_nested_too_deep(scene)) throw InputError("the scene that is resumed cannot be read: it is nested too deep");
  try {
    return toml::parse(scene);
  } catch (const toml::parse_error& e) {
    throw InputError("the scene that is resumed cannot be read: " + std::string(e.description()));
  }
}

std::map<std::string, std::string> values_of(const std::string& scene) {
  std::map<std::string, std::string> values;
  for_values("", parsed(scene), [&](const std::string& key, const toml::node& value) {
    std::ostringstream text;
    value.visit([&](const auto& v) {
      if constexpr (!toml::is_table<decltype(v)>) text << v;
    });
    values[key] = text.str();
  });
  return values;
}

bool free_to_change(const std::string& key) { return key == "simulation.end_time" || key.starts_with("output."); }

}  // namespace

std::map<std::string, std::uint32_t> files_of(const std::string& scene) {
  std::map<std::string, std::uint32_t> files;
  for_values("", parsed(scene), [&](const std::string& key, const toml::node& value) {
    const auto text = value.value<std::string>();
    if (!text || !text->starts_with('/') || !fs::is_regular_file(*text)) return;
    files[key] = checksum_of_file(*text);
    fs::path second = *text;
    if (second.extension() == ".node" && fs::is_regular_file(second.replace_extension(".ele")))
      files[key] = checksum_of_file(second, files[key]);
  });
  return files;
}

std::vector<std::string> changed_physics(const Run& saved, const Run& now) {
  std::vector<std::string> lines;
  const auto before = values_of(saved.scene), after = values_of(now.scene);
  const auto same_file = [&](const std::string& key) { return saved.files.contains(key) && now.files.contains(key); };
  for (const auto& [key, value] : before) {
    if (free_to_change(key) || same_file(key)) continue;
    const auto found = after.find(key);
    if (found == after.end())
      lines.push_back(fmt::format("{}: {} -> none", key, value));
    else if (found->second != value)
      lines.push_back(fmt::format("{}: {} -> {}", key, value, found->second));
  }
  for (const auto& [key, value] : after)
    if (!free_to_change(key) && !same_file(key) && !before.contains(key))
      lines.push_back(fmt::format("{}: none -> {}", key, value));
  for (const auto& [key, crc] : saved.files)
    if (const auto found = now.files.find(key); found != now.files.end() && found->second != crc)
      lines.push_back(fmt::format("{}: the contents of {} are not what they were", key, after.at(key)));
  std::sort(lines.begin(), lines.end());
  return lines;
}

Changes changes(const Run& saved, const Run& now) {
  Changes result;
  result.physics = changed_physics(saved, now);
  if (saved.program != now.program)
    result.program.push_back(fmt::format("cleave: {} -> {}", saved.program, now.program));
  else if (saved.program_crc != now.program_crc)
    result.notes.push_back(fmt::format("cleave {} has been built anew", now.program));
  if (saved.isa != now.isa) result.program.push_back(fmt::format("instruction set: {} -> {}", saved.isa, now.isa));
  if (saved.threads != now.threads) result.notes.push_back(fmt::format("threads: {} -> {}", saved.threads, now.threads));
  for (const auto& plugin : now.plugins) {
    const auto found =
        std::find_if(saved.plugins.begin(), saved.plugins.end(), [&](const auto& other) { return other.id == plugin.id; });
    if (found == saved.plugins.end()) continue;
    if (found->version != plugin.version)
      result.program.push_back(fmt::format("plugin {}: {} -> {}", plugin.id, found->version, plugin.version));
    else if (found->crc != plugin.crc)
      result.notes.push_back(fmt::format("plugin {} {} has been built anew: {}", plugin.id, plugin.version, plugin.file));
  }
  return result;
}

}  // namespace cleave::checkpoint
