#include "discretization/simulation.hpp"
#include "checkpoint/state.hpp"
#include "common/error.hpp"
#include "config/scene.hpp"
#include "plugins/registry.hpp"

#include <gmock/gmock.h>
#include <tbb/global_control.h>

#include <cstdlib>
#include <filesystem>
#include <fstream>
#include <map>
#include <sstream>

namespace cleave {
namespace {

struct Scene {
  const char* name;
  int dimension;
  const char* simulation;  ///< further keys
  const char* material;    ///< of the falling block
  const char* more;        ///< further tables
  friend std::ostream& operator<<(std::ostream& out, const Scene& scene) { return out << scene.name; }
};

constexpr const char* neo_hookean =
    "elasticity = { plugin = \"split-neo-hookean\", youngs_modulus = 1e5, poissons_ratio = 0.3 }\n";

const Scene scenes[] = {
    {"explicit in single precision", 3, "gravity = [0, -10, 0]", neo_hookean,
     "[[handle]]\nregion = { type = \"box\", center = [0, 0.5, 0], size = [1, 0.1, 1] }\nmotion = { velocity = [0, 1, 0] }\n"
     "release = 0.02\n"},
    {"explicit in double precision with FLIP", 2, "precision = \"double\"\ntransfer = \"flip\"\ngravity = [0, -10]",
     neo_hookean, ""},
    {"von Mises plasticity", 2, "gravity = [0, -50]",
     "elasticity = { plugin = \"split-neo-hookean\", youngs_modulus = 1e5, poissons_ratio = 0.3 }\n"
     "plasticity = { plugin = \"von-mises\", yield_stress = 300, hardening_modulus = 1e4 }\n",
     ""},
    {"NACC plasticity", 3, "precision = \"double\"\ngravity = [0, -50, 0]",
     "elasticity = { plugin = \"split-neo-hookean\", youngs_modulus = 1e5, poissons_ratio = 0.3 }\n"
     "plasticity = { plugin = \"nacc\", alpha0 = -0.02, cohesion = 0.5, hardening_factor = 1, friction_slope = 1.5 }\n",
     ""},
    {"local damage", 2, "gravity = [0, -50]",
     "elasticity = { plugin = \"split-neo-hookean\", youngs_modulus = 1e5, poissons_ratio = 0.3 }\n"
     "damage = { plugin = \"rankine\", failure_stress = 200, softening = 1 }\n",
     ""},
    {"implicit damage in two passes", 2, "gravity = [0, -50]\n[simulation.damage]\npasses = 2",
     "elasticity = { plugin = \"split-neo-hookean\", youngs_modulus = 1e5, poissons_ratio = 0.3 }\n"
     "damage = { plugin = \"phase-field\", strength = 200, length_scale_cells = 1 }\n",
     ""},
    {"explicit damage", 2, "gravity = [0, -50]\n[simulation.damage]\nlaplacian = \"cubic\"",
     "elasticity = { plugin = \"split-neo-hookean\", youngs_modulus = 1e5, poissons_ratio = 0.3 }\n"
     "damage = { plugin = \"anisotropic\", critical_stress = 200, viscosity = 0.01, length_scale_cells = 1 }\n"
     "fibers = { direction = [1, 0] }\n",
     ""},
    {"fibres and anisotropic damage", 3, "gravity = [0, -50, 0]",
     "elasticity = { plugin = \"qr\", youngs_modulus = 1e5, poissons_ratio = 0.3, fiber_scale = 5 }\n"
     "damage = { plugin = \"anisotropic\", critical_stress = 200, viscosity = 0.01, length_scale_cells = 1, "
     "structural_alpha = [4], integration = \"implicit\" }\n"
     "fibers = { direction = [1, 1, 0] }\n",
     ""},
    {"implicit steps", 3, "integrator = \"implicit\"\nmaximum_time_step = 2e-3\ngravity = [0, -10, 0]", neo_hookean, ""},
    {"implicit steps in the plane", 2,
     "precision = \"double\"\nintegrator = \"implicit\"\nmaximum_time_step = 2e-3\ngravity = [0, -10]", neo_hookean, ""},
    {"implicit steps with damage", 2, "integrator = \"implicit\"\nmaximum_time_step = 2e-3\ngravity = [0, -50]",
     "elasticity = { plugin = \"split-neo-hookean\", youngs_modulus = 1e5, poissons_ratio = 0.3 }\n"
     "damage = { plugin = \"phase-field\", strength = 200, length_scale_cells = 1 }\n",
     ""},
    {"an automatic integrator", 2, "integrator = \"auto\"\nmaximum_time_step = 4e-3\ngravity = [0, -10]",
     "elasticity = { plugin = \"split-neo-hookean\", youngs_modulus = 1e11, poissons_ratio = 0.3 }\n", ""},
    {"inextensible fibres", 2, "gravity = [0, -10]",
     "elasticity = { plugin = \"qr\", youngs_modulus = 2e3, poissons_ratio = 0.3 }\n"
     "constraint = { plugin = \"inextensibility\", tolerance = 1e-5 }\nfibers = { direction = [1, 0] }\n",
     ""},
    {"an incompressible solid", 2, "precision = \"double\"\ngravity = [0, -10]",
     "elasticity = { plugin = \"split-neo-hookean\", youngs_modulus = 2e3, poissons_ratio = 0.3 }\n"
     "constraint = { plugin = \"incompressibility\" }\n",
     ""},
    {"methods side by side", 2, "gravity = [0, -10]", neo_hookean,
     "[[material]]\nname = \"brittle\"\ndensity = 1000\n"
     "discretization = { plugin = \"peridynamics\", youngs_modulus = 1e5, poissons_ratio = 0.25, critical_stretch = 0.02 }\n"
     "[[body]]\nname = \"beam\"\nmaterial = \"brittle\"\nsampling = \"regular\"\n"
     "shape = { type = \"box\", center = [1.5, 0.2], size = [0.8, 0.3] }\nvelocity = [0, -2]\n"},
};

std::string text_of(const Scene& scene) {
  const bool solid = scene.dimension == 3;
  std::ostringstream text;
  text << "[simulation]\ncell_size = 0.1\nend_time = 1\nframe_rate = 100\ndimension = " << scene.dimension << "\n"
       << scene.simulation << "\n[[material]]\nname = \"block\"\ndensity = 1000\n"
       << scene.material
       << "[[body]]\nname = \"block\"\nmaterial = \"block\"\nvelocity = " << (solid ? "[0.3, -2, 0]" : "[0.3, -2]")
       << "\nshape = { type = \"box\", center = "
       << (solid ? "[0, 0.32, 0], size = [0.8, 0.6, 0.5]" : "[0, 0.42], size = [1, 0.8]")
       << " }\n[[collider]]\nshape = { type = \"half-space\", normal = [0, 1" << (solid ? ", 0" : "") << "] }\nfriction = 0.3\n"
       << scene.more;
  return text.str();
}

class Restart : public testing::TestWithParam<Scene> {
 protected:
  Restart() {
    std::string name = (std::filesystem::temp_directory_path() / "cleave-restart-XXXXXX").string();
    directory = mkdtemp(name.data());
    std::ofstream(directory / "scene.toml") << text_of(GetParam());
    scene = config::load_scene(directory / "scene.toml", {}, registry, nullptr);
  }
  ~Restart() override { std::filesystem::remove_all(directory); }

  std::unique_ptr<mpm::Simulation> begin() { return discretization::simulate(scene, registry); }

  /// To a number of steps, frames on the way.
  void run(mpm::Simulation& simulation, std::int64_t steps) const {
    while (simulation.steps() < steps) {
      const double rate = scene.simulation.frame_rate;
      const double target = (std::floor(simulation.time() * rate + 1e-6) + 1) / rate;
      simulation.step(target);
      if (simulation.time() == target) simulation.measure();
    }
  }

  static std::string saved(const mpm::Simulation& simulation) {
    std::ostringstream out;
    checkpoint::StateWriter writer(out);
    simulation.save(writer);
    writer.end();
    return out.str();
  }
  static void restore(mpm::Simulation& simulation, const std::string& state) {
    std::istringstream in(state);
    checkpoint::StateReader reader(in, "state");
    simulation.restore(reader);
  }
  /// Sections of a that are not the same in b, but for seconds of wall time.
  static std::vector<std::string> differences(const std::string& a, const std::string& b) {
    std::istringstream first(a), second(b);
    checkpoint::StateReader x(first, "a"), y(second, "b");
    std::vector<std::string> names;
    for (const auto& name : x.sections())
      if (!name.ends_with("seconds") && (!y.has(name) || x.read(name) != y.read(name))) names.push_back(name);
    return names;
  }

  std::filesystem::path directory;
  plugins::Registry registry{plugins::Registry::default_search_path()};
  config::Scene scene;
};

/// Steps at which states are saved, all of them of one run that goes on.
constexpr std::int64_t save_at[] = {3, 17, 30};
constexpr std::int64_t last_step = 42;

TEST_P(Restart, HasTheBitsOfARunThatNeverEnded) {
  const auto whole = begin();
  run(*whole, last_step);
  const std::string expected = saved(*whole);

  const auto saving = begin();
  std::map<std::int64_t, std::string> states;
  for (const auto steps : save_at) {
    run(*saving, steps);
    states[steps] = saved(*saving);
    EXPECT_EQ(saved(*saving), states[steps]) << "saving changes what is saved";
  }
  run(*saving, last_step);
  EXPECT_THAT(differences(expected, saved(*saving)), testing::IsEmpty()) << "of a run that saved on its way";

  const auto again = begin();
  run(*again, 5);  // a state that has to be replaced
  for (const auto& [steps, state] : states) {
    const auto fresh = begin();
    ASSERT_THAT(differences(state, saved(*fresh)), testing::Not(testing::IsEmpty()));
    for (auto* simulation : {fresh.get(), again.get()}) {
      restore(*simulation, state);
      EXPECT_THAT(differences(state, saved(*simulation)), testing::IsEmpty()) << "restored at step " << steps;
      EXPECT_EQ(simulation->steps(), steps);
      run(*simulation, last_step);
      EXPECT_THAT(differences(expected, saved(*simulation)), testing::IsEmpty()) << "resumed at step " << steps;
    }
  }
}

TEST_P(Restart, OfAnotherNumberOfThreadsHasTheSameBits) {
  std::string state, expected;
  {
    const tbb::global_control one(tbb::global_control::max_allowed_parallelism, 1);
    const auto whole = begin();
    run(*whole, save_at[1]);
    state = saved(*whole);
    run(*whole, last_step);
    expected = saved(*whole);
  }
  const tbb::global_control three(tbb::global_control::max_allowed_parallelism, 3);
  const auto resumed = begin();
  restore(*resumed, state);
  run(*resumed, last_step);
  EXPECT_THAT(differences(expected, saved(*resumed)), testing::IsEmpty());
}

TEST_P(Restart, RefusesAStateWithoutOneOfItsSections) {
  const auto whole = begin();
  run(*whole, 2);
  const std::string state = saved(*whole);
  std::istringstream in(state);
  checkpoint::StateReader reader(in, "state");
  for (const auto& left_out : reader.sections()) {
    if (left_out.ends_with("memory")) continue;  // of a constraint, which may have none
    std::ostringstream out;
    checkpoint::StateWriter writer(out);
    for (const auto& name : reader.sections())
      if (name != left_out) writer.section(name, reader.read(name));
    writer.end();
    const auto fresh = begin();
    EXPECT_THAT([&] { restore(*fresh, out.str()); }, testing::ThrowsMessage<InputError>(testing::HasSubstr(left_out)));
  }
}

INSTANTIATE_TEST_SUITE_P(Scenes, Restart, testing::ValuesIn(scenes), [](const auto& info) {
  std::string name;
  bool capital = true;
  for (const char c : std::string(info.param.name)) {
    if (c != ' ') name += capital ? char(std::toupper(c)) : c;
    capital = c == ' ';
  }
  return name;
});

TEST(Restore, RefusesTheStateOfAnotherScene) {
  plugins::Registry registry(plugins::Registry::default_search_path());
  const auto directory = std::filesystem::path(testing::TempDir());
  const auto simulation = [&](const std::string& text) {
    std::ofstream(directory / "restore.toml") << text;
    return discretization::simulate(config::load_scene(directory / "restore.toml", {}, registry, nullptr), registry);
  };
  const std::string text = text_of(scenes[1]);
  std::string larger = text;
  larger.replace(larger.find("size = [1, 0.8]"), 15, "size = [1, 0.9]");
  std::ostringstream out;
  checkpoint::StateWriter writer(out);
  simulation(larger)->save(writer);
  writer.end();
  std::istringstream in(out.str());
  checkpoint::StateReader reader(in, "state");
  const auto other = simulation(text);
  EXPECT_THAT([&] { other->restore(reader); }, testing::ThrowsMessage<InputError>(testing::AllOf(
                                                   testing::HasSubstr("blocks"), testing::HasSubstr("particles"))));
  std::filesystem::remove(directory / "restore.toml");
}

}  // namespace
}  // namespace cleave
