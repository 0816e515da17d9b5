#include "plugins/library.hpp"

#include "common/error.hpp"
#include "plugins/elf.hpp"
#include "plugins/trust.hpp"

#include <boost/dll/shared_library.hpp>

#include <utility>

namespace cleave::plugins {
namespace {

const cleave_host this_host{sizeof(cleave_host), {CLEAVE_ABI_MAJOR, CLEAVE_ABI_MINOR}, "cleave", CLEAVE_VERSION};

boost::dll::shared_library open(const std::filesystem::path& path) {
  if (const auto problem = problem_with_library_file(path)) throw Refusal(*problem);
  // Local, so that two plugins never share a symbol; at once, so that a missing symbol is refused here and not in a run.
  constexpr auto mode = boost::dll::load_mode::rtld_now | boost::dll::load_mode::rtld_local;
  std::error_code error;
  boost::dll::shared_library library;
  // An absolute path keeps dlopen from searching the system's libraries.
  library.load(std::filesystem::absolute(path), error, mode);
  if (!library.is_loaded()) {
    // std::error_code drops the dynamic loader's words.
    const char* words = dlerror();
    throw Refusal("cannot be loaded: " + std::string(words ? words : error.message().c_str()));
  }
  return library;
}

std::string digest(const std::filesystem::path& path) try { return sha256_of_file(path); } catch (const InputError&) {
  throw Refusal("cannot be read");
}

const cleave_plugin* negotiate(const boost::dll::shared_library& library) {
  if (!library.has(CLEAVE_ENTRY_SYMBOL)) throw Refusal("is not a Cleave plugin: it exports no " CLEAVE_ENTRY_SYMBOL);
  const cleave_plugin* plugin = nullptr;
  const auto entry = reinterpret_cast<cleave_plugin_entry_fn>(&library.get<void()>(CLEAVE_ENTRY_SYMBOL));
  const cleave_result result = entry(&this_host, &plugin);
  if (result == CLEAVE_ERROR_ABI)
    throw Refusal("refuses this host's plugin ABI " + std::to_string(CLEAVE_ABI_MAJOR) + "." +
                  std::to_string(CLEAVE_ABI_MINOR) + "; rebuild it with this host's SDK");
  if (result != CLEAVE_OK) throw Refusal(CLEAVE_ENTRY_SYMBOL " failed with result " + std::to_string(result));
  if (!plugin) throw Refusal(CLEAVE_ENTRY_SYMBOL " gave no plugin table");
  if (!CLEAVE_HAS(cleave_plugin, plugin, abi)) throw Refusal("its plugin table states no ABI version");
  check_abi(plugin->abi);
  return plugin;
}

class Library final : public Plugin {
 public:
  explicit Library(const std::filesystem::path& path)
      : path_(path), sha256_(digest(path)), library_(open(path)), table_(negotiate(library_)), description_(describe(*table_)) {
    kind_table_ = table_->kind(kind_id(description_.kind));
  }
  const Description& description() const override { return description_; }
  const std::filesystem::path& path() const override { return path_; }
  const std::string& sha256() const override { return sha256_; }
  const cleave_plugin& table() const override { return *table_; }
  const void* kind_table() const override { return kind_table_; }

 private:
  std::filesystem::path path_;
  std::string sha256_;
  boost::dll::shared_library library_;
  const cleave_plugin* table_;
  Description description_;
  const void* kind_table_ = nullptr;
};

}  // namespace

std::shared_ptr<const Plugin> open_library(const std::filesystem::path& path) { return std::make_shared<Library>(path); }

}  // namespace cleave::plugins
