#pragma once

#include "config/scene.hpp"

#include <memory>
#include <string>
#include <string_view>
#include <vector>

namespace cleave::config {

/// What reading a scene has to know of the plugins there are.
class PluginCatalog {
 public:
  virtual ~PluginCatalog() = default;
  /// Null if there is no usable plugin of that ID.
  virtual const plugins::Description* find(std::string_view id) const = 0;
  /// IDs of all usable plugins of a kind, sorted.
  virtual std::vector<std::string> ids(plugins::Kind) const = 0;
  /// Why a file that would be this plugin is not used: "path: reason". Empty if there is no such file.
  virtual std::string refusal(std::string_view /*id*/) const { return {}; }
  /// Where plugins were looked for, for messages.
  virtual std::vector<std::filesystem::path> search_path() const { return {}; }
};

/// The plugins a registry found. It must outlive the catalog.
std::unique_ptr<PluginCatalog> catalog_of(const plugins::Registry&);

/// load_scene and to_toml of scene.hpp, for any catalog.
Scene load_scene(const std::filesystem::path&, const std::vector<Override>&, const PluginCatalog&,
                 std::vector<std::string>* warnings = nullptr);
std::string to_toml(const Scene&, const PluginCatalog&);

}  // namespace cleave::config
