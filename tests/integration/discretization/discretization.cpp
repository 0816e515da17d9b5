// Scenes whose bodies are stepped by discretization plugins, run with `cleave run`. "failing" lets points fall freely and does
// what it is told to at a given time; "brittle" is the template that authors start from.

#include "discretized.hpp"

namespace cleave::test {
namespace {

// ------------------------------------------------------------------------------------------------- the host's part

TEST_F(Discretization, FallsInItsOwnStepsAndIsMeasured) {
  const auto frames = run(scene(material("dust", dust) + block("cloud", "dust", "velocity = [3, 0, 0]\n")));
  const double mass = 64, t = 0.2, dt = 0.002, n = t / dt, g = 10;
  EXPECT_NEAR(last(frames, "mass"), mass, 1e-9);
  EXPECT_EQ(last(frames, "steps"), 50);
  EXPECT_EQ(frames.at("limited_by").back(), "discretization");
  EXPECT_NEAR(last(frames, "momentum_x"), 3 * mass, 1e-9);
  EXPECT_NEAR(last(frames, "momentum_y"), -mass * g * t, 1e-9);
  EXPECT_NEAR(last(frames, "kinetic_energy"), 0.5 * mass * (9 + g * g * t * t), 1e-9);
  // the plugin kicks, then drifts: sum of k g dt^2
  const double height = 1 - g * dt * dt * n * (n + 1) / 2;
  EXPECT_NEAR(last(frames, "center_of_mass_y"), height, 1e-9);
  EXPECT_NEAR(last(frames, "gravity_energy"), mass * g * height, 1e-8);
  EXPECT_NEAR(last(frames, "angular_momentum_z"), mass * (0.6 * -g * t - height * 3), 1e-8);
  // its F = diag(1, 2, 1)
  EXPECT_EQ(last(frames, "minimum_J"), 2);
  EXPECT_EQ(last(frames, "maximum_J"), 2);
  EXPECT_NEAR(last(frames, "volume"), 2 * 0.064, 1e-12);
  const auto summary = json(directory / "run/summary.json");
  EXPECT_GT(summary.get<double>("stage_seconds.discretization"), 0);
  EXPECT_EQ(summary.get<int>("limits.discretization"), 100);
  EXPECT_EQ(summary.get_child("plugins").size(), 1u);
  EXPECT_EQ(summary.get_child("plugins").front().second.get<std::string>("id"), "discretization/failing");
}

TEST_F(Discretization, FallsInThePlaneOfATwoDimensionalScene) {
  const auto frames = run(scene(
      material("dust", dust) +
          "[[body]]\nname = \"cloud\"\nmaterial = \"dust\"\nshape = { type = \"sphere\", center = [0, 1], radius = 0.4 }\n"
          "spin = { angular_velocity = 90 }\n",
      "dimension = 2\n"));
  EXPECT_NEAR(last(frames, "momentum_y"), -last(frames, "mass") * 2, 1e-9);
  for (const char* column : {"center_of_mass_z", "momentum_z", "angular_momentum_x", "angular_momentum_y"})
    EXPECT_EQ(last(frames, column), 0) << column;
  EXPECT_NEAR(last(frames, "mass"), 1000 * 3.14159265 * 0.16, 40);
  // edge of the square that a point stands for: half a cell
  const auto points = ply(frame("run", 2));
  for (const double t : points.at("temperature")) EXPECT_FLOAT_EQ(float(t), 300.1f);
}

TEST_F(Discretization, LeavesStepsToTheUserWhoLimitsThem) {
  const std::string body = material("dust", dust) + block("cloud", "dust");
  EXPECT_EQ(run(scene(body, "time_step = 0.001\n")).at("limited_by").back(), "fixed");
  const auto frames = run(scene(body, "maximum_time_step = 0.001\n"));
  EXPECT_EQ(frames.at("limited_by").back(), "maximum");
  EXPECT_EQ(last(frames, "steps"), 100);

  const std::string stiffens =
      "discretization = { plugin = \"failing\", largest_step = 0.002, at = 0.1, failure = \"stiffens\" }";
  const auto adapted = run(scene(material("dust", stiffens) + block("cloud", "dust")));
  EXPECT_EQ(adapted.at("steps"), (std::vector<std::string>{"0", "50", "500"}));
  write("scene.toml", scene(material("dust", stiffens) + block("cloud", "dust"), "time_step = 0.002\n"));
  const Outcome too_long = with_plugins("run scene.toml");
  EXPECT_EQ(too_long.status, 3);
  EXPECT_NE(too_long.err.find("the fixed step of 0.002 s is above 0.0002 s, the largest stable step that "
                              "discretization/failing gives for material 'dust'"),
            std::string::npos)
      << too_long.err;
}

TEST_F(Discretization, MeetsCollidersAsGridNodesDo) {
  const std::string body = material("dust", dust) + block("cloud", "dust", "velocity = [1, -8, 0]\n");
  const auto floor = [&](const std::string& more) {
    return scene(body + "[[collider]]\nshape = { type = \"half-space\", point = [0, 0.5, 0], normal = [0, 1, 0] }\n" + more);
  };
  // no point goes deeper than one step takes it; what slides keeps its speed along the floor
  run(floor("contact = \"separate\"\n"), "slides");
  const auto slides = ply(frame("slides", 2));
  for (std::size_t i = 0; i < slides.at("y").size(); i++) {
    EXPECT_GT(slides.at("y")[i], 0.5 - 0.002 * 10.1);
    EXPECT_NEAR(slides.at("vx")[i], 1, 1e-6);
    EXPECT_NEAR(slides.at("vy")[i], 0, 1e-6);
  }
  run(floor("contact = \"sticky\"\n"), "sticks");
  const auto sticks = ply(frame("sticks", 2));
  for (const double v : sticks.at("vx")) EXPECT_EQ(v, 0);
  // |v_t| falls by the friction coefficient times the loss of |v_n|, the whole fall
  const auto rubs = run(floor("friction = 0.05\n"), "rubs");
  EXPECT_NEAR(last(rubs, "momentum_x"), 64 * (1 - 0.05 * (8 + 10 * 0.2)), 0.02 * 64);
  // a wall that moves takes along what it meets
  run(scene(material("dust", dust) + block("cloud", "dust") +
            "[[collider]]\nshape = { type = \"half-space\", point = [0.4, 0, 0], normal = [-1, 0, 0] }\n"
            "motion = { velocity = [-2, 0, 0] }\n"),
      "pushed");
  const auto pushed = ply(frame("pushed", 2));
  for (std::size_t i = 0; i < pushed.at("x").size(); i++) {
    EXPECT_LT(pushed.at("x")[i], 0.4 - 2 * 0.2 + 1e-6) << "the wall as it stands at the end of the step";
    EXPECT_NEAR(pushed.at("vx")[i], pushed.at("x")[i] > -0.02 ? -2 : 0, 1e-5) << pushed.at("x")[i];
  }
}

TEST_F(Discretization, FollowsHandlesUntilTheyLetGo) {
  const std::string handle =
      "[[handle]]\nbody = \"cloud\"\nregion = { type = \"box\", center = [0, 1, 0], size = [1, 1, 1] }\n"
      "motion = { center = [0, 0, 0], velocity = [0.5, 0, 0], angular_velocity = [0, 0, 90] }\n";
  const auto held = run(scene(material("dust", dust) + block("cloud", "dust") + handle));
  const double angle = 0.2 * std::acos(0.0);
  EXPECT_NEAR(last(held, "center_of_mass_x"), 0.5 * 0.2 - std::sin(angle), 1e-9);
  EXPECT_NEAR(last(held, "center_of_mass_y"), std::cos(angle), 1e-9);
  const auto released = run(scene(material("dust", dust) + block("cloud", "dust") + handle + "release = 0.1\n"));
  EXPECT_NEAR(last(released, "momentum_y") - numbers(released.at("momentum_y"))[1], -64 * 10 * 0.1, 1e-8);
  EXPECT_NEAR(last(released, "momentum_x"), numbers(released.at("momentum_x"))[1], 1e-8);
}

TEST_F(Discretization, HoldsPointsOfSeveralMaterialsWithOneHandle) {
  const std::string bodies =
      material("dust", dust) + block("cloud", "dust") + material("rubber", rubber) + block("cushion", "rubber");
  const std::string region = "region = { type = \"box\", center = [0, 1, 0], size = [1, 1, 1] }\n";
  const auto frames = run(scene(bodies + "[[handle]]\n" + region + "motion = { velocity = [1, 0, 0] }\n"));
  EXPECT_NEAR(last(frames, "center_of_mass_x"), 0.2, 1e-5);  // single precision
  EXPECT_NEAR(last(frames, "center_of_mass_y"), 1, 1e-5);
  // one that names a body leaves the others alone
  for (const std::string body : {"cloud", "cushion"}) {
    run(scene(bodies + "[[handle]]\nbody = \"" + body + "\"\n" + region), body, "--frames 1");
    const auto points = ply(frame(body, 1));
    for (std::size_t i = 0; i < 128; i++)
      EXPECT_NEAR(points.at("vy")[i], (body == "cushion") == (i < 64) ? 0 : -1, 1e-4) << body << " " << i;
  }
  write("scene.toml", scene(bodies + "[[handle]]\nregion = { type = \"sphere\", center = [9, 9, 9], radius = 1 }\n"));
  const Outcome nothing = with_plugins("run scene.toml");
  EXPECT_EQ(nothing.status, 2);
  EXPECT_NE(nothing.err.find("handle 'handle-1' holds no particle"), std::string::npos) << nothing.err;
}

TEST_F(Discretization, StepsBesideTheMaterialPointMethod) {
  const std::string cloud = material("dust", dust) + block("cloud", "dust", "velocity = [3, 0, 0]\n"),
                    cushion = material("rubber", rubber) + block("cushion", "rubber", "velocity = [0, 0, 2]\n");
  const std::string fixed = "time_step = 0.001\nprecision = \"double\"\n";
  const auto both = run(scene(cloud + cushion, fixed), "both"), only_cloud = run(scene(cloud, fixed), "cloud"),
             only_cushion = run(scene(cushion, fixed), "cushion");
  // the parts do not see each other, and are measured together
  for (const char* sum : {"mass", "kinetic_energy", "gravity_energy", "elastic_energy", "momentum_x", "momentum_y",
                          "momentum_z", "angular_momentum_x", "angular_momentum_z", "volume"})
    EXPECT_NEAR(last(both, sum), last(only_cloud, sum) + last(only_cushion, sum), 1e-9 * (1 + std::abs(last(both, sum))))
        << sum;
  EXPECT_NEAR(last(both, "center_of_mass_y"),
              (last(only_cloud, "center_of_mass_y") + last(only_cushion, "center_of_mass_y")) / 2, 1e-9);
  EXPECT_NEAR(last(both, "minimum_J"), last(only_cushion, "minimum_J"), 1e-12);
  EXPECT_EQ(last(both, "maximum_J"), 2);

  // particles of the material point method come first; what only some bodies have is 0 for the others
  const auto all = ply(frame("both", 2)), cushions = ply(frame("cushion", 2));
  ASSERT_EQ(all.at("x").size(), 128u);
  for (std::size_t i = 0; i < 128; i++) {
    EXPECT_EQ(all.at("id")[i], double(i));
    EXPECT_EQ(all.at("body")[i], i < 64 ? 0 : 1);
    EXPECT_FLOAT_EQ(float(all.at("temperature")[i]), i < 64 ? 0.f : 300.1f);
    EXPECT_EQ(all.at("J")[i], i < 64 ? cushions.at("J")[i] : 2.0);
    for (const char* column : {"x", "y", "z", "vx", "vy", "vz"}) {
      if (i < 64) {
        EXPECT_EQ(all.at(column)[i], cushions.at(column)[i]) << column;
      }
    }
  }
  std::ifstream header(frame("both", 2));
  std::string text;
  for (std::string line; std::getline(header, line) && line != "end_header";) text += line + "\n";
  EXPECT_LT(text.find("cushion"), text.find("cloud")) << text;

  const auto automatic = run(scene(cloud + cushion), "automatic");
  EXPECT_EQ(automatic.at("limited_by").back(), "discretization");
  const auto summary = json(directory / "automatic/summary.json");
  EXPECT_EQ(summary.get<int>("particles"), 128);
  EXPECT_EQ(summary.get_child("plugins").size(), 2u);
}

TEST_F(Discretization, WritesTheFieldsAsked) {
  const std::string body = material("dust", dust) + block("cloud", "dust");
  run(scene(body) + "attributes = [\"F\"]\n", "gradient", "--frames 1");
  const auto gradient = ply(frame("gradient", 1));
  EXPECT_EQ(gradient.at("F_yy")[3], 2);
  EXPECT_EQ(gradient.at("F_xx")[3], 1);
  EXPECT_EQ(gradient.count("J") + gradient.count("temperature"), 0u);
  run(scene(material("dust", "discretization = { plugin = \"failing\", components = 3 }") + block("cloud", "dust")), "vector",
      "--frames 1");
  EXPECT_EQ(ply(frame("vector", 1)).count("temperature_y"), 1u);
  write("scene.toml", scene(body) + "attributes = [\"temprature\"]\n");
  const Outcome unknown = with_plugins("run scene.toml");
  EXPECT_EQ(unknown.status, 2);
  EXPECT_NE(unknown.err.find("no body of the scene has \"temprature\", did you mean \"temperature\"?"), std::string::npos)
      << unknown.err;
}

TEST_F(Discretization, IsWrittenBackWithItsDefaults) {
  const auto first = run(scene(material("dust", dust) + block("cloud", "dust")));
  const std::string resolved = contents(directory / "run/scene.toml");
  EXPECT_NE(resolved.find("discretization = { plugin = \"discretization/failing\", failure = \"none\", at = 0.0, "
                          "largest_step = 0.002, components = 1 }"),
            std::string::npos)
      << resolved;
  EXPECT_EQ(resolved.find("elasticity"), std::string::npos);
  const Outcome again = with_plugins("run run/scene.toml --quiet --out again");
  ASSERT_EQ(again.status, 0) << again.err;
  EXPECT_EQ(contents(frame("again", 2)), contents(frame("run", 2)));
  EXPECT_EQ(contents(directory / "again/scene.toml"), resolved);
  const Outcome validated = with_plugins("validate scene.toml");
  EXPECT_EQ(validated.status, 0) << validated.err;
  EXPECT_NE(validated.out.find("material dust: 1000 kg/m^3, discretization/failing"), std::string::npos) << validated.out;
}

// ------------------------------------------------------------------------------------------------- what is refused

TEST_F(Discretization, IsRefusedWithTheReason) {
  const std::string cloud = block("cloud", "dust");
  const auto refused = [&](const std::string& text, const std::string& reason, const std::string& command) {
    write("scene.toml", text);
    const Outcome outcome = with_plugins(command + " scene.toml");
    EXPECT_EQ(outcome.status, 2) << text;
    EXPECT_NE(outcome.err.find(reason), std::string::npos) << outcome.err << "\nshould say: " << reason;
    EXPECT_NE(outcome.err.find("error: "), std::string::npos) << outcome.err;
  };
  const auto law = [&](const std::string& lines) { return scene(material("dust", lines) + cloud); };
  for (const char* key : {"elasticity", "plasticity", "damage", "constraint"})
    refused(law(std::string(dust) + "\n" + key + " = { plugin = \"nacc\" }"),
            std::string("'") + key + "' cannot be given together with 'discretization'", "validate");
  refused(law(std::string(dust) + "\nfibers = { direction = [1, 0, 0] }"), "'fibers' has no effect", "validate");
  refused(scene(material("dust", dust) + block("cloud", "dust", "fibers = { direction = [1, 0, 0] }\n")),
          "'fibers' has no effect", "validate");
  refused(scene(material("dust", dust) +
                block("cloud", "dust", "toughness = { pattern = \"noise\", size = 1, minimum = 1, maximum = 2 }\n")),
          "'toughness' has no effect: a discretization plugin", "validate");
  refused(law("discretization = { plugin = \"faling\" }"), "no discretization plugin 'faling', did you mean 'failing'?",
          "validate");
  refused(law("discretization = { plugin = \"split-neo-hookean\" }"), "is an elasticity law, here belongs a discretization",
          "validate");
  refused(law("elasticity = { plugin = \"failing\" }"), "is a discretization, here belongs an elasticity law", "validate");
  refused(law("discretization = { plugin = \"failing\", failure = \"perhaps\" }"), "'failure'", "validate");

  refused(scene(material("dust", dust) + block("refused", "dust")),
          "body 'refused': discretization/failing cannot take it: this body is not wanted", "run");
  refused(scene(material("dust", dust) + cloud, "time_step = 0.01\n"),
          "discretization/failing is stable with steps of at most 0.002 s, simulation.time_step is 0.01 s", "run");
  refused(scene(material("dust", dust) + material("fog", "discretization = { plugin = \"failing\", components = 3 }") + cloud +
                block("bank", "fog")),
          "the field \"temperature\" with 3 components; another body has one of that name with 1", "run");
  refused(law("discretization = { plugin = \"failing\", components = 2 }"),
          "the field \"temperature\" with 2 components; there may be 1, 3 or 9", "run");
  write("points.csv", "x,y,z,F00,F01,F02,F10,F11,F12,F20,F21,F22\n0,0,0,1,0,0,0,1,0,0,0,1\n");
  refused(scene(material("dust", dust) + "[[body]]\nname = \"cloud\"\nmaterial = \"dust\"\nparticles = \"points.csv\"\n"),
          "its particle file gives deformation gradients", "run");
}

TEST_F(Discretization, NamesThePluginThatFails) {
  const auto fails = [&](const std::string& how, const std::string& reason) {
    write("scene.toml",
          scene(material("dust", "discretization = { plugin = \"failing\", at = 0.05, failure = \"" + how + "\" }") +
                block("fine", "dust") + block("cloud", "dust")));
    const Outcome outcome = with_plugins("run scene.toml --out " + how);
    EXPECT_EQ(outcome.status, 3) << how;
    EXPECT_NE(outcome.err.find(reason), std::string::npos) << outcome.err << "\nshould say: " << reason;
    const std::string failure = contents(directory / how / "failure.txt");
    for (const char* part : {"step ", "at t = 0.05", "material 'dust': plugin discretization/failing "})
      EXPECT_NE(failure.find(part), std::string::npos) << failure << "\nshould say: " << part;
    EXPECT_EQ(json(directory / how / "summary.json").get<std::string>("status"), "failed");
    EXPECT_EQ(table(directory / how / "failed_state.csv").at("x").size(), 128u);
    EXPECT_FALSE(fs::exists(directory / how / "failed_batch.json"));
  };
  fails("throws", "failed: the bonds have lost their patience");
  fails("nan-position", "moves point 5 of body 'cloud' to where its position is not finite");
  fails("nan-velocity", "moves point 7 of body 'cloud' to where its velocity is not finite");
  fails("no-step", "gives -1 s as the largest stable step");
}

// ------------------------------------------------------------------------------------------------- the template

TEST_F(Discretization, TemplateSceneBreaksABeam) {
  std::string text = contents(CLEAVE_SCENE_TEMPLATE);
  text.replace(text.find("{{id}}"), 6, "brittle");
  text.replace(text.find("\"vtp\""), 5, "\"ply\"");
  const auto frames = run(text, "one", "--threads 1");
  EXPECT_GT(last(frames, "damaged_fraction"), 0.1);
  EXPECT_LT(last(frames, "damaged_fraction"), 0.6);
  EXPECT_EQ(last(frames, "maximum_damage"), 1);
  const auto energy = [&](std::size_t i) {
    double sum = 0;
    for (const char* part : {"kinetic_energy", "elastic_energy", "gravity_energy"}) sum += numbers(frames.at(part))[i];
    return sum;
  };
  EXPECT_GT(energy(0), energy(frames.at("time").size() - 1)) << "breaking bonds takes energy";
  run(text, "two", "--threads 2 --frames 3");
  EXPECT_EQ(contents(frame("one", 3)), contents(frame("two", 3)));
}

TEST_F(Discretization, TemplateKeepsMomentaAndEnergyOfASpinningBlock) {
  const auto frames =
      run("[simulation]\ncell_size = 0.1\nend_time = 0.05\nframe_rate = 40\n" +
          material("solid", "discretization = { plugin = \"brittle\", bulk_modulus = 1e5, critical_stretch = 1 }") +
          block("block", "solid", "velocity = [1, 2, 3]\nspin = { angular_velocity = [0, 600, 300] }\n") +
          "[output]\nformats = [\"ply\"]\n");
  for (const char* momentum : {"momentum", "angular_momentum"})
    for (const char* axis : {"_x", "_y", "_z"}) {
      const auto values = numbers(frames.at(std::string(momentum) + axis));
      EXPECT_NEAR(values.back(), values.front(), 1e-9) << momentum << axis;
    }
  const auto kinetic = numbers(frames.at("kinetic_energy")), elastic = numbers(frames.at("elastic_energy"));
  EXPECT_GT(elastic.back(), 0.01) << "the block swells";
  EXPECT_NEAR(kinetic.back() + elastic.back(), kinetic.front(), 0.01 * (kinetic.front() - 0.5 * 64 * 14));
}

/// Points that fly apart evenly for one step: a strain of rate times step, without a grid to make it.
std::string swelling(int dimension, int across, double spacing, double rate) {
  std::string csv = "x,y,z,vx,vy,vz,volume\n";
  for (int i = 0; i < across; i++)
    for (int j = 0; j < across; j++)
      for (int k = 0; k < (dimension == 3 ? across : 1); k++) {
        const auto at = [&](int n) { return (n - across / 2) * spacing; };
        const std::array<double, 3> x{at(i), at(j), dimension == 3 ? at(k) : 0};
        csv += fmt::format("{},{},{},{},{},{},{}\n", x[0], x[1], x[2], rate * x[0], rate * x[1], rate * x[2],
                           std::pow(spacing, dimension));
      }
  return csv;
}

/// Energy of a point with a full family over that of the continuum.
TEST_F(Discretization, TemplateStoresTheEnergyOfItsBulkModulus) {
  const double kappa = 1e5, strain = 1e-3, dt = 1e-4;
  for (const int dimension : {3, 2}) {
    write("points.csv", swelling(dimension, 13, 0.1, strain / dt));
    const auto stored = [&](int horizon) {
      run(fmt::format("[simulation]\ndimension = {}\ncell_size = 0.2\nend_time = {}\nframe_rate = {}\ntime_step = {}\n",
                      dimension, dt, 1 / dt, dt) +
          material("solid", fmt::format("discretization = {{ plugin = \"brittle\", bulk_modulus = {}, critical_stretch = 1, "
                                        "horizon = {} }}",
                                        kappa, horizon)) +
          "[[body]]\nname = \"block\"\nmaterial = \"solid\"\nparticles = \"points.csv\"\n[output]\nformats = [\"ply\"]\n");
      const auto points = ply(frame("run", 1));
      const std::size_t middle = points.at("energy").size() / 2;
      EXPECT_NEAR(points.at("x")[middle], 0, 1e-12);
      EXPECT_EQ(points.at("damage")[middle], 0);
      // 3D: kappa/2 (3 strain)^2. In the plane: E/((1 + nu)(1 - 2 nu)) strain^2 with nu = 1/4 and E = 3/2 kappa.
      return points.at("energy")[middle] / ((dimension == 3 ? 4.5 : 2.4) * kappa * strain * strain);
    };
    // the sum over the family is a quadrature of the continuum's integral
    EXPECT_NEAR(stored(3), 1, 0.08) << dimension << "D";
    EXPECT_NEAR(stored(5), 1, 0.03) << dimension << "D";
  }
}

TEST_F(Discretization, DamageIsPartOfAllBodies) {
  write("points.csv", swelling(3, 5, 0.1, 10));
  write("torn.csv", "x,y,z,volume,F00,F01,F02,F10,F11,F12,F20,F21,F22\n9,0,0,0.011,1.5,0,0,0,1.5,0,0,0,1.5\n");
  const auto frames =
      run(scene(material("solid", "discretization = { plugin = \"brittle\", bulk_modulus = 1e5, critical_stretch = 1e-6 }") +
                "[[body]]\nname = \"broken\"\nmaterial = \"solid\"\nparticles = \"points.csv\"\n" +  //
                material("rubber", rubber) + block("cushion", "rubber") +
                material("glass", rubber + "\ndamage = { plugin = \"rankine\", failure_stress = 1, softening = 2 }") +
                "[[body]]\nname = \"torn\"\nmaterial = \"glass\"\nparticles = \"torn.csv\"\n"),
          "run", "--frames 1");
  EXPECT_EQ(last(frames, "maximum_damage"), 1);
  EXPECT_NEAR(last(frames, "damaged_fraction"), (0.125 + 0.011) / (0.125 + 0.064 + 0.011), 1e-6);
  EXPECT_EQ(numbers(frames.at("damaged_fraction")).front(), 0);
}

}  // namespace
}  // namespace cleave::test
