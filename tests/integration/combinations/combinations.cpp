// Every combination of the shipped laws, in 2D and 3D, single and double precision: 100 steps that stay clean, or a refusal
// with its reason before the run. docs/combinations.md is the table of the outcomes; CLEAVE_UPDATE_DOCS=1 writes it.

#include "common/error.hpp"
#include "config/scene.hpp"
#include "mpm/simulation.hpp"
#include "plugins/registry.hpp"

#include <fmt/format.h>
#include <gtest/gtest.h>

#include <cmath>
#include <cstdlib>
#include <filesystem>
#include <fstream>
#include <map>
#include <set>
#include <sstream>

namespace cleave::test {
namespace {

namespace fs = std::filesystem;

struct Combination {
  std::string elasticity, plasticity, damage;  ///< IDs; empty: none
};

/// Parameters under which a law does something in the scene below; laws not named here run on their defaults.
std::string parameters(const std::string& id) {
  static const std::map<std::string, std::string> known = {
      {"elasticity/qr", "youngs_modulus = 1e4, poissons_ratio = 0.3, fiber_scale = 2.0"},
      {"plasticity/nacc", "cohesion = 0.5, hardening_factor = 1.0, friction_slope = 2.36, alpha0 = -0.02"},
      {"plasticity/cohesive-cam-clay", "cohesion = 0.5, hardening_factor = 1.0, friction_slope = 2.36, alpha0 = -0.02"},
      {"plasticity/von-mises", "yield_stress = 300.0, hardening_modulus = 100.0"},
      {"plasticity/hencky-von-mises", "yield_stress = 300.0, hardening_modulus = 100.0"},
      {"plasticity/drucker-prager", "friction_angle = 30.0, cohesion = 200.0"},
      {"plasticity/hencky-drucker-prager", "friction_angle = 30.0, cohesion = 200.0"},
      {"damage/phase-field", "strength = 60.0, mobility = 100.0"},
      {"damage/anisotropic", "critical_stress = 50.0, viscosity = 0.05"},
      {"damage/rankine", "failure_stress = 60.0, softening = 1.0"},
  };
  const auto it = known.find(id);
  if (it != known.end()) return it->second;
  return id.starts_with("elasticity/") ? "youngs_modulus = 1e4, poissons_ratio = 0.3" : "";
}

std::string law(const std::string& id) {
  if (id.empty()) return "";
  const std::string kind = id.substr(0, id.find('/')), given = parameters(id);
  return kind + " = { plugin = \"" + id + "\"" + (given.empty() ? "" : ", ") + given + " }\n";
}

/// A bar of 1 m pulled by 10 % and bent by its ends.
std::string scene_text(const Combination& c, int dimension, bool single) {
  const auto point = [&](const std::string& x, const std::string& y) {
    return "[" + x + ", " + y + (dimension == 3 ? ", 0.0]" : "]");
  };
  const auto size = [&](const std::string& x, const std::string& y) {
    return "[" + x + ", " + y + (dimension == 3 ? ", " + y + "]" : "]");
  };
  const std::string turn = dimension == 3 ? "[20.0, 0.0, 15.0]" : "15.0";
  return fmt::format(R"([simulation]
dimension = {}
cell_size = 0.1
end_time = 10.0
precision = "{}"
[[material]]
name = "m"
density = 1000.0
fibers = {{ direction = {} }}
{}{}{}
[[body]]
name = "bar"
material = "m"
shape = {{ type = "box", size = {} }}
[[handle]]
region = {{ type = "box", center = {}, size = {} }}
[[handle]]
region = {{ type = "box", center = {}, size = {} }}
motion = {{ velocity = {}, angular_velocity = {}, end = 1.0 }}
)",
                     dimension, single ? "single" : "double", point("0.8", "0.6"), law(c.elasticity), law(c.plasticity),
                     law(c.damage), size("1.0", "0.4"), point("-0.5", "0.0"), size("0.2", "1.0"), point("0.5", "0.0"),
                     size("0.2", "1.0"), point("0.1", "0.0"), turn);
}

plugins::Registry& registry() {
  static plugins::Registry r(plugins::Registry::default_search_path());
  return r;
}

/// Empty if all is well after 100 steps.
std::string trouble(mpm::Simulation& simulation) {
  const auto before = simulation.measure();
  for (int i = 0; i < 100; i++) simulation.step(10);
  const auto after = simulation.measure();
  if (!(std::abs(after.mass - before.mass) <= 1e-6 * before.mass)) return "the mass has changed";
  if (!(after.maximum_speed < 50)) return fmt::format("a speed of {} m/s", after.maximum_speed);
  for (const auto& p : simulation.state()) {
    bool finite = p.position.allFinite() && p.velocity.allFinite() && p.strain.allFinite();
    for (double s : p.state) finite = finite && std::isfinite(s);
    if (!finite) return fmt::format("particle {} is not finite", p.id);
    if (!(p.damage >= 0 && p.damage <= 1)) return fmt::format("particle {} has d = {}", p.id, p.damage);
  }
  return "";
}

struct Outcome {
  std::string refusal;  ///< before the run, without the place; empty: ran
  bool damaged = false;
  std::vector<Vector3> positions;  ///< after the run
};

Outcome outcome(const Combination& c, int dimension, bool single) {
  const fs::path file = fs::temp_directory_path() / fmt::format("cleave-combination-{}.toml", ::getpid());
  std::ofstream(file) << scene_text(c, dimension, single);
  Outcome result;
  std::unique_ptr<mpm::Simulation> simulation;
  try {
    simulation = mpm::Simulation::create(config::load_scene(file, {}, registry()), registry());
  } catch (const InputError& e) {
    const std::string text = e.what();
    const auto at = text.find("error: ");
    result.refusal = at == std::string::npos ? text : text.substr(at + 7);
  }
  fs::remove(file);
  if (!simulation) return result;
  const auto start = simulation->state();
  EXPECT_EQ(trouble(*simulation), "");
  const auto end = simulation->state();
  for (std::size_t i = 0; i < start.size(); i++) {
    result.damaged = result.damaged || end[i].damage > start[i].damage;
    result.positions.push_back(end[i].position);
  }
  return result;
}

std::vector<std::string> ids(plugins::Kind kind, bool none) {
  std::vector<std::string> r = registry().ids(kind);
  if (none) r.insert(r.begin(), "");
  return r;
}

using Table = std::map<std::string, std::map<std::string, std::vector<std::string>>>;  // row, damage -> outcomes

void run_all_with(const std::string& elasticity, Table& table) {
  std::map<std::string, std::vector<Vector3>> without_plasticity;  // by damage law and variant
  for (const auto& plasticity : ids(plugins::Kind::plasticity, true))
    for (const auto& damage : ids(plugins::Kind::damage, true)) {
      const Combination c{elasticity, plasticity, damage};
      bool yielded = false, damaged = false;
      std::set<std::string> refusals;
      int ran = 0;
      for (int dimension : {2, 3})
        for (bool single : {true, false}) {
          SCOPED_TRACE(fmt::format("{} + {} + {}, {}D, {}", c.elasticity, plasticity.empty() ? "none" : plasticity,
                                   damage.empty() ? "none" : damage, dimension, single ? "single" : "double"));
          try {
            const Outcome o = outcome(c, dimension, single);
            if (!o.refusal.empty()) refusals.insert(o.refusal);
            ran += o.refusal.empty();
            auto& elastic = without_plasticity[damage + (dimension == 2 ? "2" : "3") + (single ? "s" : "d")];
            if (plasticity.empty()) elastic = o.positions;
            yielded = yielded || o.positions != elastic;
            damaged = damaged || o.damaged;
          } catch (const SimulationError& e) {
            ADD_FAILURE() << e.what();
          }
        }
      auto& cell = table[c.elasticity + (plasticity.empty() ? "" : " + " + plasticity)][damage];
      if (refusals.empty()) cell.push_back("runs");
      for (const auto& r : refusals) cell.push_back(ran ? "runs in part; " + r : r);
      if (!refusals.empty()) continue;
      // a combination in which a law has nothing to do would prove nothing
      EXPECT_TRUE(damaged || damage.empty()) << c.elasticity << " + " << plasticity << " + " << damage << ": no damage";
      EXPECT_TRUE(yielded || plasticity.empty()) << c.elasticity << " + " << plasticity << " + " << damage << ": no yield";
    }
}

std::string short_name(const std::string& id) { return id.substr(id.find('/') + 1); }

std::string document(Table& table) {
  std::ostringstream out;
  std::vector<std::string> notes;
  out << "# Which laws go together\n\n"
         "Each cell is 100 steps of a bar that is pulled and bent, in two and three dimensions, in single and double "
         "precision:\nclean, or refused when the scene is loaded for the reason given below. Written by the test "
         "`integration_combinations`\n(`CLEAVE_UPDATE_DOCS=1 ctest -R Combinations`), which fails when this page is not "
         "true.\n\n| elasticity | plasticity |";
  const auto damages = ids(plugins::Kind::damage, true);
  for (const auto& d : damages) out << ' ' << (d.empty() ? "no damage" : short_name(d)) << " |";
  out << "\n|---|---|";
  for (std::size_t i = 0; i < damages.size(); i++) out << "---|";
  out << '\n';
  for (const auto& e : ids(plugins::Kind::elasticity, false))
    for (const auto& p : ids(plugins::Kind::plasticity, true)) {
      out << "| " << short_name(e) << " | " << (p.empty() ? "none" : short_name(p)) << " |";
      for (const auto& d : damages) {
        out << ' ';
        for (const auto& text : table[e + (p.empty() ? "" : " + " + p)][d]) {
          if (text == "runs") {
            out << "runs";
            continue;
          }
          auto at = std::find(notes.begin(), notes.end(), text);
          if (at == notes.end()) at = notes.insert(notes.end(), text);
          out << "refused (" << at - notes.begin() + 1 << ")";
        }
        out << " |";
      }
      out << '\n';
    }
  if (!notes.empty()) out << '\n';
  for (std::size_t i = 0; i < notes.size(); i++) out << i + 1 << ". " << notes[i] << '\n';
  return out.str();
}

TEST(Combinations, RunCleanlyOrAreRefusedAndTheDocumentSaysWhich) {
  Table table;
  for (const auto& elasticity : ids(plugins::Kind::elasticity, false)) run_all_with(elasticity, table);
  const fs::path page = fs::path(CLEAVE_SOURCE_DIR) / "docs/combinations.md";
  if (std::getenv("CLEAVE_UPDATE_DOCS")) std::ofstream(page) << document(table);
  std::stringstream there;
  there << std::ifstream(page).rdbuf();
  EXPECT_EQ(there.str(), document(table)) << "docs/combinations.md is out of date: run with CLEAVE_UPDATE_DOCS=1";
}

}  // namespace
}  // namespace cleave::test
