#include "micro.hpp"
#include "specimen.hpp"

#include "common/error.hpp"
#include "plugins/isa.hpp"

#include <dlfcn.h>
#include <tbb/global_control.h>

#include <cstdlib>
#include <cstring>
#include <filesystem>
#include <map>
#include <memory>

namespace cleave::benchmarks {
namespace {

int failures = 0;

/// Names an instruction set in the environment, as a user would, while it lives.
class Forced {
 public:
  explicit Forced(const std::string& isa) {
    if (const char* given = std::getenv("CLEAVE_ISA")) before_ = std::make_unique<std::string>(given);
    if (isa != "baseline") setenv("CLEAVE_ISA", isa.c_str(), 1);
  }
  ~Forced() {
    if (before_)
      setenv("CLEAVE_ISA", before_->c_str(), 1);
    else
      unsetenv("CLEAVE_ISA");
  }
  Forced(const Forced&) = delete;
  Forced& operator=(const Forced&) = delete;

 private:
  std::unique_ptr<std::string> before_;
};

}  // namespace

void check(benchmark::State& state, bool right, const char* claim) {
  if (right) return;
  failures++;
  state.SkipWithError((std::string("not so: ") + claim).c_str());
}

int failed_checks() { return failures; }

std::vector<std::string> instruction_sets() {
  auto names = plugins::preferred_isa_directories();
#if defined(__x86_64__)
  if (!std::getenv("CLEAVE_ISA") || names.empty()) names.push_back("x86-64-v2");
#else
  names.push_back("baseline");
#endif
  return names;
}

const mpm::KernelSet& kernels_for(const std::string& isa) {
  const std::string path = CLEAVE_KERNELS "/" + (isa == "x86-64-v2" ? "baseline" : isa) + ".so";
  void* library = dlopen(path.c_str(), RTLD_NOW | RTLD_LOCAL);  // stays: the program uses it until it ends
  void* entry = library ? dlsym(library, CLEAVE_KERNELS_SYMBOL) : nullptr;
  if (!entry) throw InputError(dlerror());
  return *reinterpret_cast<mpm::KernelsEntry>(entry)();
}

plugins::Registry& registry_for(const std::string& isa) {
  static std::map<std::string, std::unique_ptr<plugins::Registry>> registries;
  auto& found = registries[isa];
  if (!found) {
    const Forced environment(isa);
    found = std::make_unique<plugins::Registry>(std::vector<std::filesystem::path>{CLEAVE_PLUGINS});
  }
  return *found;
}

mpm::Material material_for(const std::string& isa, const config::Material& material, int dimension, double cell_size) {
  plugins::Registry& registry = registry_for(isa);
  const Forced environment(isa);
  return mpm::Material(material, registry, dimension, cell_size, false);
}

}  // namespace cleave::benchmarks

/// --smoke: small blocks, one iteration of each; the rest is Google Benchmark's.
int main(int argc, char** argv) {
  using namespace cleave::benchmarks;
  std::vector<char*> arguments(argv, argv + argc);
  Scale scale{1 << 18, std::size_t(1) << 28};
  char one_iteration[] = "--benchmark_min_time=1e-9";
  if (argc > 1 && std::strcmp(argv[1], "--smoke") == 0) {
    arguments[1] = one_iteration;
    scale = {1 << 12, std::size_t(1) << 20};
  }
  tbb::global_control one_thread(tbb::global_control::max_allowed_parallelism, 1);
  benchmark::Initialize(&argc, arguments.data());
  if (benchmark::ReportUnrecognizedArguments(argc, arguments.data())) return 1;
  register_roofline(scale);
  register_transfers(scale);
  register_order(scale);
  register_damage(scale);
  register_laws();
  benchmark::RunSpecifiedBenchmarks();
  return failed_checks() == 0 ? 0 : 1;
}
