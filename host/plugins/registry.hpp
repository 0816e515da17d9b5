#pragma once

#include "plugins/schema.hpp"

#include <cleave/damage.h>
#include <cleave/discretization.h>
#include <cleave/elasticity.h>
#include <cleave/plasticity.h>

#include <filesystem>
#include <map>
#include <memory>
#include <optional>
#include <string>
#include <string_view>
#include <vector>

namespace cleave::plugins {

/// A loaded plugin library. It stays loaded while this object or any of its instances lives.
class Plugin {
 public:
  virtual ~Plugin() = default;
  virtual const Description& description() const = 0;
  virtual const std::filesystem::path& path() const = 0;  ///< of the file that was loaded (an ISA variant, perhaps)
  virtual const std::string& sha256() const = 0;          ///< of that file, in hexadecimal digits
  virtual const cleave_plugin& table() const = 0;
  /// Table of the plugin's kind (cleave_elasticity, ...), never null.
  virtual const void* kind_table() const = 0;
};

/// Surroundings of an instance; see cleave_context.
struct Context {
  int dimension = 3;
  double cell_size = 0;  ///< m, 0 if there is no grid
  double density = 0;    ///< kg/m^3
  /// Of the elastic law of the same material; empty and null for the elastic law itself.
  std::optional<cleave_isochoric_response> isochoric = {};
  const cleave_elastic_probe* elastic = nullptr;
};

/// A law with its parameters. Movable; destroys the instance before the library may unload.
class Instance {
 public:
  Instance() = default;
  /// Throws InputError naming the plugin and the parameter if the plugin refuses.
  Instance(std::shared_ptr<const Plugin>, const GivenParameters&, const Context&);
  Instance(Instance&&) noexcept;
  Instance& operator=(Instance&&) noexcept;
  ~Instance();

  explicit operator bool() const { return handle_ != nullptr; }
  const Plugin& plugin() const { return *plugin_; }
  const Description& description() const { return plugin_->description(); }
  cleave_instance* handle() const { return handle_; }
  /// What the law can do and needs with these parameters.
  bool can(cleave_capability c) const { return (capabilities_ & c) != 0; }

  const cleave_elasticity& elasticity() const { return *static_cast<const cleave_elasticity*>(plugin_->kind_table()); }
  const cleave_plasticity& plasticity() const { return *static_cast<const cleave_plasticity*>(plugin_->kind_table()); }
  const cleave_damage& damage() const { return *static_cast<const cleave_damage*>(plugin_->kind_table()); }
  const cleave_discretization& discretization() const {
    return *static_cast<const cleave_discretization*>(plugin_->kind_table());
  }

  /// Initial value of every state component, in the order of the schema.
  std::vector<double> initial_state() const;
  /// What a return mapping may rely on, if the (elasticity) plugin offers it.
  std::optional<cleave_isochoric_response> isochoric_response() const;

 private:
  std::shared_ptr<const Plugin> plugin_;
  cleave_instance* handle_ = nullptr;
  std::uint64_t capabilities_ = 0;
};

/// One file found in the search path: usable, or refused with the reason.
struct Found {
  std::filesystem::path path;
  std::optional<Description> description;  ///< empty if refused before the description could be read
  std::string refusal;                     ///< empty if usable
  bool from_manifest = false;              ///< the description was read without running the plugin's code
};

/// Finds plugin libraries and loads those that are asked for.
///
/// Search path, first match of an ID wins: CLEAVE_PLUGIN_PATH (colon-separated directories), then the directory
/// lib/cleave/plugins beside the program's bin directory (install and build tree alike). A second library with an ID that is
/// already there is refused as a duplicate. Scanning reads manifests; only libraries without a fresh manifest are opened.
/// Nothing is opened that lies elsewhere, not even through a link in one of the directories.
class Registry {
 public:
  /// Scans the given directories; default_search_path() for what the program uses.
  explicit Registry(std::vector<std::filesystem::path> search_path);
  ~Registry();
  static std::vector<std::filesystem::path> default_search_path();

  const std::vector<std::filesystem::path>& search_path() const { return search_path_; }
  const std::vector<Found>& found() const { return found_; }

  /// Description of a usable plugin, null if there is none of that ID.
  const Description* find(std::string_view id) const;
  /// IDs of all usable plugins of a kind, sorted.
  std::vector<std::string> ids(Kind) const;

  /// Loads (or returns the already loaded) plugin. Throws InputError with the reason: unknown ID with the nearest known one,
  /// or the refusal.
  std::shared_ptr<const Plugin> load(std::string_view id);

  /// Why find() gave nothing: the reason the file of that name was refused, or the nearest known ID.
  std::string unknown_id(std::string_view id) const;

 private:
  std::vector<std::filesystem::path> search_path_;
  std::vector<Found> found_;
  std::map<std::string, std::weak_ptr<const Plugin>, std::less<>> loaded_;
};

}  // namespace cleave::plugins
