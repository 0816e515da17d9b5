#include "run_to_resume.hpp"

#include <random>

namespace cleave::test {
namespace {

struct Scene {
  const char* name;
  const char* simulation;
  const char* material;
  const char* more;
  friend std::ostream& operator<<(std::ostream& out, const Scene& scene) { return out << scene.name; }
};

constexpr const char* elastic = "elasticity = { plugin = \"split-neo-hookean\", youngs_modulus = 1e5, poissons_ratio = 0.3 }\n";

const Scene scenes[] = {
    {"Explicit", "", elastic, ""},
    {"DoubleFlip", "precision = \"double\"\ntransfer = \"flip\"", elastic, ""},
    {"Implicit", "integrator = \"implicit\"\nmaximum_time_step = 2e-3", elastic, ""},
    {"Plasticity", "",
     "elasticity = { plugin = \"split-neo-hookean\", youngs_modulus = 1e5, poissons_ratio = 0.3 }\n"
     "plasticity = { plugin = \"von-mises\", yield_stress = 300, hardening_modulus = 1e4 }\n",
     ""},
    {"ImplicitDamage", "",
     "elasticity = { plugin = \"split-neo-hookean\", youngs_modulus = 1e5, poissons_ratio = 0.3 }\n"
     "damage = { plugin = \"phase-field\", strength = 200, length_scale_cells = 1 }\n",
     ""},
    {"ExplicitDamage", "",
     "elasticity = { plugin = \"split-neo-hookean\", youngs_modulus = 1e5, poissons_ratio = 0.3 }\n"
     "damage = { plugin = \"anisotropic\", critical_stress = 200, viscosity = 0.01, length_scale_cells = 1 }\n"
     "fibers = { direction = [1, 0] }\n",
     ""},
    {"Constraint", "",
     "elasticity = { plugin = \"qr\", youngs_modulus = 1e4, poissons_ratio = 0.3 }\n"
     "constraint = { plugin = \"inextensibility\", tolerance = 1e-5 }\nfibers = { direction = [1, 0] }\n",
     ""},
    {"Peridynamics", "", elastic,
     "[[material]]\nname = \"brittle\"\ndensity = 1000\n"
     "discretization = { plugin = \"peridynamics\", youngs_modulus = 1e5, poissons_ratio = 0.25, critical_stretch = 0.02 }\n"
     "[[body]]\nname = \"beam\"\nmaterial = \"brittle\"\nsampling = \"regular\"\n"
     "shape = { type = \"box\", center = [1.5, 0.2], size = [0.8, 0.3] }\nvelocity = [0, -2]\n"},
};

class KilledAtAnyMoment : public RunToResume, public testing::WithParamInterface<Scene> {
 protected:
  KilledAtAnyMoment() {
    std::ostringstream text;
    text << "[simulation]\ncell_size = 0.1\nend_time = 0.15\nframe_rate = 100\ndimension = 2\ngravity = [0, -20]\n"
         << GetParam().simulation << "\n[[material]]\nname = \"block\"\ndensity = 1000\n"
         << GetParam().material << "[[body]]\nname = \"block\"\nmaterial = \"block\"\nvelocity = [0.3, -2]\n"
         << "shape = { type = \"box\", center = [0, 0.42], size = [1.2, 0.8] }\n"
         << "[[collider]]\nshape = { type = \"half-space\", normal = [0, 1] }\nfriction = 0.3\n"
         << GetParam().more << "[output]\nformats = [\"ply\", \"vtp\"]\n"
         << "[output.checkpoint]\nframes = 2\nseconds = 0.005\n";
    write("scene.toml", text.str());
  }
};

TEST_P(KilledAtAnyMoment, TwentyTimesEveryRunEndsInTheSameFiles) {
  const auto begin = std::chrono::steady_clock::now();
  ASSERT_EQ(finish({"run", "scene.toml", "--out", "whole", "--quiet"}), 0) << errors();
  const auto whole = std::chrono::steady_clock::now() - begin;
  std::mt19937 random(7);
  const auto longest = std::chrono::duration_cast<std::chrono::microseconds>(whole).count();
  const std::vector<std::string> again = {"run", "scene.toml", "--out", "killed", "--quiet", "--resume"};
  // A run may come to its end before it is killed often enough: then another one is begun.
  int resumed = 0;
  for (int kills = 0; kills < 20 || (resumed < 5 && kills < 100);) {
    fs::remove_all(directory / "killed");
    const int last = std::max(20, kills + 10);
    for (int status = still_running; status == still_running;) {
      resumed += !checkpoints("killed").empty();
      const pid_t child = start(again);
      const std::chrono::microseconds patience(std::uniform_int_distribution<long>(0, longest)(random));
      status = wait_for(child, kills == last ? std::chrono::minutes(5) : patience);
      if (status == still_running) {
        kill(child, SIGKILL);
        status = wait_for(child, std::chrono::minutes(1));
        if (status == 128 + SIGKILL) {
          status = still_running;
          kills++;
        }
      }
      if (status != still_running) {
        ASSERT_EQ(status, 0) << errors();
      }
    }
    EXPECT_THAT(differences("whole", "killed"), testing::IsEmpty()) << "after " << kills << " kills";
  }
  EXPECT_GE(resumed, 5) << "too few kills came after a checkpoint to say anything";
  RecordProperty("resumed", resumed);
}

INSTANTIATE_TEST_SUITE_P(Scenes, KilledAtAnyMoment, testing::ValuesIn(scenes),
                         [](const auto& info) { return std::string(info.param.name); });

}  // namespace
}  // namespace cleave::test
