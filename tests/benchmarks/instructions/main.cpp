#include "count.hpp"

#include <fmt/format.h>

#include <cstdio>
#include <cstring>
#include <exception>

namespace {

using namespace cleave::instructions;

/// What laws cost that are there and never act, each to be compared with the first of its group.
const std::vector<std::vector<Workload>>& idle_laws() {
  static const std::vector<std::vector<Workload>> groups = {
      {{"neo-Hookean", "neo_hookean.toml"},
       {"with NACC that never yields",
        "neo_hookean.toml",
        {R"(material.m.plasticity={ plugin = "nacc", alpha0 = -1.0, cohesion = 1.0, hardening_factor = 1.0, friction_slope = 2.36 })"}},
       {"with von Mises that never yields",
        "neo_hookean.toml",
        {R"(material.m.plasticity={ plugin = "von-mises", yield_stress = 1e9 })"}},
       {"with phase-field damage that never grows",
        "neo_hookean.toml",
        {R"(material.m.damage={ plugin = "phase-field", strength = 1e8, mobility = 15 })"}}},
      {{"QR",
        "fibres_anisotropic_damage.toml",
        {R"(material.m={ name = "m", density = 1000, elasticity = { plugin = "qr", youngs_modulus = 1e5, poissons_ratio = 0.3 } })"}},
       {"with fibres",
        "fibres_anisotropic_damage.toml",
        {R"(material.m={ name = "m", density = 1000, elasticity = { plugin = "qr", youngs_modulus = 1e5, poissons_ratio = 0.3, fiber_scale = 5 }, fibers = { direction = [1, 0, 0] } })"}},
       {"with fibres and anisotropic damage that never grows", "fibres_anisotropic_damage.toml"}}};
  return groups;
}

void print_idle_laws() {
  fmt::print("\nlaws that never act\n{:>12} {:>8} {:>6}\n", "instructions", "", "bytes");
  for (const auto& group : idle_laws()) {
    double first = 0;
    for (const auto& w : group) {
      const Count c = count(w);
      if (first == 0) first = c.per_particle();
      fmt::print("{:12.1f} {:+7.1f}% {:6g} {}\n", c.per_particle(), 100 * (c.per_particle() / first - 1),
                 c.bytes_per_particle.at("total"), w.name);
      std::fflush(stdout);
    }
  }
}

}  // namespace

/// count_instructions [--record]: counts what is guarded and what idle laws cost; --record makes the former the record.
int main(int argc, char** argv) {
  const bool record = argc == 2 && std::strcmp(argv[1], "--record") == 0;
  if (argc > 1 && !record) {
    fmt::print(stderr, "usage: {} [--record]\n", argv[0]);
    return 2;
  }
  try {
    if (const std::string reason = obstacle(); !reason.empty()) {
      fmt::print(stderr, "error: nothing can be counted: {}\n", reason);
      return 1;
    }
    Record now{compiler(), {}};
    const Record before = std::filesystem::exists(record_file()) ? read_record() : Record();
    fmt::print("instructions per particle and step, {} (recorded: {})\n", now.compiler,
               before.compiler.empty() ? "nothing" : before.compiler);
    for (const auto& w : guarded()) {
      const Count c = count(w);
      now.workloads[w.name] = figures_of(c);
      const auto recorded = before.workloads.find(w.name);
      const Figures old = recorded == before.workloads.end() ? Figures() : recorded->second;
      fmt::print("\n{}: {:.1f} (recorded: {:.1f})\n{}", w.name, c.per_particle(), old.instructions, comparison(c, old));
      std::fflush(stdout);
    }
    if (record) {
      write_record(now);
      fmt::print("\nrecorded in {}\n", record_file().string());
    } else {
      print_idle_laws();
    }
  } catch (const std::exception& e) {
    fmt::print(stderr, "error: {}\n", e.what());
    return 1;
  }
  return 0;
}
