// cleave-manifest LIBRARY [OUTPUT]
//
// Writes what a plugin library says of itself as TOML, by default to NAME.cleave.toml beside NAME.so, so that hosts can list
// the plugin without running its code. The library's size in bytes is recorded; a manifest counts only while it matches.
#include "manifest_text.hpp"

#include <dlfcn.h>

#include <filesystem>
#include <fstream>
#include <iostream>
#include <string>

namespace {

using cleave::manifest::Failure;
using cleave::manifest::manifest;

const cleave_plugin& load(const std::filesystem::path& library) {
  // Never closed: the process ends with the manifest written.
  void* handle = dlopen(std::filesystem::absolute(library).c_str(), RTLD_NOW | RTLD_LOCAL);
  if (!handle) throw Failure{dlerror()};
  const auto entry = reinterpret_cast<cleave_plugin_entry_fn>(dlsym(handle, CLEAVE_ENTRY_SYMBOL));
  if (!entry) throw Failure{"exports no " CLEAVE_ENTRY_SYMBOL};
  // The manifest states the least minor version the plugin works with: a host that speaks no more than that reads it too.
  const cleave_plugin* plugin = nullptr;
  cleave_result result = CLEAVE_ERROR_ABI;
  for (std::uint32_t minor = 0; minor <= CLEAVE_ABI_MINOR && result == CLEAVE_ERROR_ABI; ++minor) {
    const cleave_host host{sizeof host, {CLEAVE_ABI_MAJOR, minor}, "cleave-manifest", "1.0.0"};
    result = entry(&host, &plugin);
  }
  if (result != CLEAVE_OK || !plugin) throw Failure{CLEAVE_ENTRY_SYMBOL " failed with result " + std::to_string(result)};
  if (plugin->abi.major != CLEAVE_ABI_MAJOR) throw Failure{"speaks another plugin ABI than this program"};
  if (!plugin->about || !plugin->schema) throw Failure{"describes neither itself nor its parameters"};
  return *plugin;
}

}  // namespace

int main(int argc, char** argv) {
  if (argc < 2 || argc > 3) {
    std::cerr << "usage: cleave-manifest LIBRARY [OUTPUT]\n";
    return 2;
  }
  const std::filesystem::path library = argv[1];
  const auto output =
      argc == 3 ? std::filesystem::path(argv[2]) : std::filesystem::path(library).replace_extension(".cleave.toml");
  try {
    const std::string text = manifest(load(library), std::filesystem::file_size(library));
    std::ofstream file(output, std::ios::binary);
    file << text;
    if (!file.flush()) throw Failure{"cannot write " + output.string()};
  } catch (const Failure& failure) {
    std::cerr << "cleave-manifest: " << library.string() << ": " << failure.reason << '\n';
    return 1;
  } catch (const std::exception& error) {
    std::cerr << "cleave-manifest: " << library.string() << ": " << error.what() << '\n';
    return 1;
  }
  return 0;
}
