#include "common/error.hpp"
#include "mpm/kernels/kernels.hpp"
#include "plugins/isa.hpp"

#include <boost/dll/shared_library.hpp>
#include <filesystem>
#include <string>
#include <system_error>
#include <vector>

namespace cleave::mpm {

namespace {

const KernelSet& load() {
  const auto program = std::filesystem::read_symlink("/proc/self/exe");
  const auto directory = program.parent_path().parent_path() / "lib/cleave/kernels";
  auto names = plugins::preferred_isa_directories();
  names.push_back("baseline");
  std::string reasons;
  for (const auto& name : names) {
    const auto path = directory / (name + ".so");
    std::error_code error;
    boost::dll::shared_library library(path, error, boost::dll::load_mode::rtld_now | boost::dll::load_mode::rtld_local);
    if (error) {
      reasons += "\n  " + path.string() + ": " + error.message();
      continue;
    }
    // never unloaded: tables and code are used until the program ends
    static std::vector<boost::dll::shared_library> loaded;
    loaded.push_back(library);
    return *library.get<const KernelSet*()>(CLEAVE_KERNELS_SYMBOL)();
  }
  throw InputError("no transfer kernels can be loaded:" + reasons);
}

}  // namespace

const KernelSet& load_kernels() {
  static const KernelSet& set = load();
  return set;
}

}  // namespace cleave::mpm
