#include "plugins/registry.hpp"

#include "common/error.hpp"
#include "common/nearest.hpp"
#include "plugins/isa.hpp"
#include "plugins/library.hpp"
#include "plugins/manifest.hpp"
#include "plugins/trust.hpp"

#include <spdlog/spdlog.h>

#include <algorithm>
#include <cstdlib>
#include <set>

namespace cleave::plugins {
namespace {

namespace fs = std::filesystem;

std::vector<fs::path> libraries_in(const fs::path& directory) {
  std::vector<fs::path> libraries;
  std::error_code error;
  for (fs::directory_iterator entry(directory, error), end; !error && entry != end; entry.increment(error))
    if (entry->path().extension() == ".so" && !entry->is_directory(error)) libraries.push_back(entry->path());
  std::sort(libraries.begin(), libraries.end());
  return libraries;
}

/// Opens a library of the search path, in a child process before if the user wants that. Throws Refusal.
std::shared_ptr<const Plugin> open_listed(const fs::path& path, const std::vector<fs::path>& search_path) {
  if (const auto problem = problem_with_place(path, search_path)) throw Refusal(*problem);
  if (plugins_are_isolated())
    if (const auto problem = problem_in_child(path)) throw Refusal(*problem);
  return open_library(path);
}

/// Its code is about to run as the user's.
void warn_of_writers(const fs::path& library) {
  for (const auto& path : world_writable(library))
    spdlog::warn("{}: any user can change {}, and with it what this program does; chmod o-w {}", library.string(),
                 path == library ? "this plugin" : path.string(), path.string());
}

Found inspect(const fs::path& path, const std::vector<fs::path>& search_path) {
  Found found;
  found.path = path;
  try {
    if (const auto problem = problem_with_place(path, search_path)) throw Refusal(*problem);
    found.description = read_manifest(path);
    found.from_manifest = found.description.has_value();
    if (!found.description) found.description = open_listed(path, search_path)->description();
  } catch (const Refusal& refusal) {
    found.description.reset();
    found.refusal = refusal.what();
  }
  return found;
}

/// A manifest states the least minor version of the ABI that the library works with, the loaded library what it agreed on.
bool says_what_was_found(Description loaded, const Description& found) {
  loaded.abi_minor = found.abi_minor;
  return loaded == found;
}

/// The build of a library for this processor, if there is one beside it that is the same plugin; else the library itself.
std::shared_ptr<const Plugin> best_variant(const std::shared_ptr<const Plugin>& anchor,
                                           const std::vector<fs::path>& search_path) {
  const fs::path& path = anchor->path();
  for (const auto& directory : preferred_isa_directories()) {
    const fs::path candidate = path.parent_path() / directory / path.filename();
    std::error_code error;
    if (!fs::exists(candidate, error)) continue;
    try {
      auto variant = open_listed(candidate, search_path);
      if (variant->description() == anchor->description()) return variant;
      spdlog::warn("{}: describes another build than {}, which is used instead", candidate.string(), path.string());
    } catch (const Refusal& refusal) {
      spdlog::warn("{}: {}; {} is used instead", candidate.string(), refusal.what(), path.string());
    }
  }
  return anchor;
}

}  // namespace

std::vector<fs::path> Registry::default_search_path() {
  std::vector<fs::path> path;
  if (const char* listed = std::getenv("CLEAVE_PLUGIN_PATH")) {
    std::string_view rest = listed;
    while (!rest.empty()) {
      const auto colon = std::min(rest.find(':'), rest.size());
      if (colon > 0) path.emplace_back(rest.substr(0, colon));
      rest.remove_prefix(std::min(colon + 1, rest.size()));
    }
  }
  std::error_code error;
  const fs::path program = fs::read_symlink("/proc/self/exe", error);
  if (!error) path.push_back(program.parent_path().parent_path() / "lib/cleave/plugins");
  return path;
}

Registry::Registry(std::vector<fs::path> search_path) : search_path_(std::move(search_path)) {
  std::set<fs::path> seen;
  for (const auto& directory : search_path_) {
    std::error_code error;
    const fs::path place = fs::weakly_canonical(directory, error);
    if (!seen.insert(error ? directory : place).second) continue;
    for (const auto& library : libraries_in(directory)) {
      Found found = inspect(library, search_path_);
      if (found.refusal.empty())
        for (const auto& other : found_)
          if (other.refusal.empty() && other.description->id == found.description->id)
            found.refusal = "has the id \"" + other.description->id + "\", which " + other.path.string() + " already provides";
      found_.push_back(std::move(found));
    }
  }
}

Registry::~Registry() = default;

const Description* Registry::find(std::string_view id) const {
  for (const auto& found : found_)
    if (found.refusal.empty() && found.description->id == id) return &*found.description;
  return nullptr;
}

std::vector<std::string> Registry::ids(Kind kind) const {
  std::vector<std::string> all;
  for (const auto& found : found_)
    if (found.refusal.empty() && found.description->kind == kind) all.push_back(found.description->id);
  std::sort(all.begin(), all.end());
  return all;
}

std::shared_ptr<const Plugin> Registry::load(std::string_view id) {
  if (const auto known = loaded_.find(id); known != loaded_.end())
    if (auto plugin = known->second.lock()) return plugin;

  const auto usable =
      std::find_if(found_.begin(), found_.end(), [&](const Found& f) { return f.refusal.empty() && f.description->id == id; });
  if (usable == found_.end()) throw InputError(unknown_id(id));
  try {
    auto anchor = open_listed(usable->path, search_path_);
    if (!says_what_was_found(anchor->description(), *usable->description))
      throw Refusal("is not what it was when it was found" +
                    std::string(usable->from_manifest
                                    ? ": its manifest " + manifest_path(usable->path).filename().string() +
                                          " describes another build; rebuild the plugin or delete the manifest"
                                    : ""));
    auto plugin = best_variant(anchor, search_path_);
    warn_of_writers(plugin->path());
    loaded_.insert_or_assign(std::string(id), plugin);
    return plugin;
  } catch (const Refusal& refusal) {
    throw InputError("plugin \"" + std::string(id) + "\": " + usable->path.string() + " " + refusal.what());
  }
}

std::string Registry::unknown_id(std::string_view id) const {
  std::string message = "there is no plugin \"" + std::string(id) + "\"";
  std::vector<std::string> known;
  for (const auto& found : found_) {
    if (found.refusal.empty()) known.push_back(found.description->id);
    // A refused file of that very name is what the user meant.
    std::string stem = found.path.stem().string();
    const auto name_part = id.substr(std::min(id.find('/') + 1, id.size()));
    std::replace(stem.begin(), stem.end(), '_', '-');
    if (!found.refusal.empty() && (stem == name_part || (found.description && found.description->id == id)))
      return message + ": " + found.path.string() + " " + found.refusal;
  }
  if (id.find('/') == std::string_view::npos) {
    // The kind was left out.
    std::vector<std::string> names;
    for (const auto& other : known) names.push_back(other.substr(other.find('/') + 1));
    if (const auto meant = nearest(id, names))
      return message + ", did you mean \"" + known[std::find(names.begin(), names.end(), *meant) - names.begin()] + "\"?";
  }
  if (const auto meant = nearest(id, known)) return message + ", did you mean \"" + *meant + "\"?";
  const auto kind = id.substr(0, id.find('/'));
  std::string listed;
  for (const auto& other : known)
    if (other.compare(0, kind.size() + 1, std::string(kind) + "/") == 0) listed += (listed.empty() ? "" : ", ") + other;
  if (!listed.empty()) return message + "; there are " + listed;
  message += " in ";
  for (std::size_t i = 0; i < search_path_.size(); ++i) message += (i ? ":" : "") + search_path_[i].string();
  return message;
}

}  // namespace cleave::plugins
