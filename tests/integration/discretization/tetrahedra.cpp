// Bodies of tetrahedra, and the elastic law of their material, in the hands of a plugin; and the meshes that frames get.
// "tearing" keeps the shape of tetrahedra, and lets what lies beyond x = 0 fly off as a piece of its own at a given time.

#include "discretized.hpp"

#include <set>

namespace cleave::test {
namespace {

std::string jelly(const std::string& more = "", const std::string& law = rubber) {
  return material("jelly", "discretization = { plugin = \"tearing\"" + more + " }\n" + law);
}

/// A cube of edge 0.4 m about the origin.
std::string cube(const std::string& name = "cube", const std::string& more = "", const std::string& center = "[0, 0, 0]") {
  return "[[body]]\nname = \"" + name + "\"\nmaterial = \"jelly\"\nshape = { type = \"box\", center = " + center +
         ", size = [0.4, 0.4, 0.4] }\ntetrahedra = { edge_length = 0.2 }\n" + more;
}

struct Mesh {
  std::map<std::string, std::vector<double>> vertices;
  std::vector<std::array<std::int32_t, 3>> triangles;

  double volume() const {
    double sum = 0;
    for (const auto& t : triangles) {
      const auto corner = [&](std::size_t k) {
        const auto v = std::size_t(t[k]);
        return std::array{vertices.at("x")[v], vertices.at("y")[v], vertices.at("z")[v]};
      };
      const auto [a0, a1, a2] = corner(0);
      const auto [b0, b1, b2] = corner(1);
      const auto [c0, c1, c2] = corner(2);
      sum += (a0 * (b1 * c2 - b2 * c1) + a1 * (b2 * c0 - b0 * c2) + a2 * (b0 * c1 - b1 * c0)) / 6;
    }
    return sum;
  }
};

Mesh mesh(const fs::path& file) {
  std::ifstream in(file, std::ios::binary);
  EXPECT_TRUE(in) << file;
  std::vector<std::pair<std::string, std::string>> properties;
  std::size_t vertices = 0, triangles = 0;
  for (std::string line; std::getline(in, line) && line != "end_header";) {
    std::istringstream words(line);
    std::string first, second, third;
    words >> first >> second >> third;
    if (first == "element") (second == "vertex" ? vertices : triangles) = std::stoul(third);
    if (first == "property" && second != "list") properties.emplace_back(third, second);
  }
  Mesh mesh;
  const auto read = [&](auto number) {
    in.read(reinterpret_cast<char*>(&number), sizeof number);
    return number;
  };
  for (std::size_t i = 0; i < vertices; i++)
    for (const auto& [name, type] : properties)
      mesh.vertices[name].push_back(type == "int" ? double(read(std::int32_t())) : double(read(float())));
  for (std::size_t i = 0; i < triangles; i++) {
    EXPECT_EQ(read(std::uint8_t()), 3);
    auto& t = mesh.triangles.emplace_back();
    for (auto& corner : t) corner = read(std::int32_t());
  }
  EXPECT_TRUE(in) << file;
  EXPECT_EQ(in.get(), EOF) << file;
  return mesh;
}

class Tetrahedra : public Discretization {
 protected:
  Mesh frame_mesh(int index, const std::string& out = "run") const {
    return mesh(directory / out / fmt::format("meshes/frame_{:04}.ply", index));
  }
};

TEST_F(Tetrahedra, HaveTheElasticLawOfTheirMaterial) {
  // stvk-hencky: psi = mu ln^2 s + lambda/2 ln^2 s
  const double s = 1.3, mu = 1e5 / 2.6, lambda = 1e5 * 0.3 / (1.3 * 0.4);
  const auto frames = run(scene(jelly(", stretch = 1.3",
                                      "elasticity = { plugin = \"stvk-hencky\", youngs_modulus = 1e5, "
                                      "poissons_ratio = 0.3 }") +
                                cube()),
                          "run", "--frames 1");
  const double expected = 0.064 * (mu + lambda / 2) * std::log(s) * std::log(s);
  EXPECT_NEAR(last(frames, "elastic_energy"), expected, 1e-6 * expected);
  EXPECT_NEAR(last(frames, "mass"), 64, 1e-9);
  const std::string resolved = contents(directory / "run/scene.toml");
  EXPECT_NE(resolved.find("elasticity = { plugin = \"elasticity/stvk-hencky\""), std::string::npos) << resolved;
  const auto used = json(directory / "run/summary.json").get_child("plugins");
  EXPECT_EQ(used.size(), 2u) << "the law is a plugin of the run, too";

  write("scene.toml", scene(jelly(", stretch = -1") + cube()));
  const Outcome outcome = with_plugins("run scene.toml");
  EXPECT_EQ(outcome.status, 2);
  for (const char* part : {"body 'cube': discretization/tearing cannot take it: point ",
                           " of body 'cube': det F = -1, where elasticity/split-neo-hookean is not defined"})
    EXPECT_NE(outcome.err.find(part), std::string::npos) << outcome.err;
}

TEST_F(Tetrahedra, AreRefusedWithTheReason) {
  const auto refused = [&](const std::string& text, const std::string& where, const std::string& reason) {
    write("scene.toml", text);
    const Outcome outcome = with_plugins("validate scene.toml");
    EXPECT_EQ(outcome.status, 2) << text;
    EXPECT_NE(outcome.err.find("scene.toml:" + where + ": error: "), std::string::npos) << outcome.err;
    EXPECT_NE(outcome.err.find(reason), std::string::npos) << outcome.err << "\nshould say: " << reason;
  };
  refused(scene(jelly("", "") + cube()), "6:1", "needs 'elasticity', the law that 'discretization/tearing' evaluates");
  refused(scene(jelly("", rubber + "\nplasticity = { plugin = \"von-mises\", yield_stress = 1 }") + cube()), "11:1",
          "'plasticity' cannot be given together with 'discretization'");
  refused(scene(material("dust", std::string(dust) + "\n" + rubber) + block("cloud", "dust")), "10:1",
          "'discretization/failing' evaluates no elastic law");
  refused(scene(jelly() + block("cube", "jelly")), "11:1", "tetrahedra");
}

TEST_F(Tetrahedra, AreHeldByTheirVertices) {
  // three layers of vertices, of which the handle has the lowest, where no barycentre is
  const auto frames = run(scene(jelly() + cube("cube", "velocity = [0, 0, 1]\n") +
                                "[[handle]]\nregion = { type = \"box\", center = [0, -0.2, 0], size = [1, 0.01, 1] }\n"
                                "motion = { velocity = [0, -0.5, 0] }\n"));
  const Mesh start = frame_mesh(0), end = frame_mesh(2);
  std::size_t held = 0;
  for (std::size_t i = 0; i < start.vertices.at("y").size(); i++) {
    const bool low = start.vertices.at("y")[i] < -0.199;
    held += low;
    EXPECT_NEAR(end.vertices.at("y")[i] - start.vertices.at("y")[i], low ? -0.1 : 0, 1e-6);
    EXPECT_NEAR(end.vertices.at("z")[i] - start.vertices.at("z")[i], low ? 0 : 0.2, 1e-6);
    EXPECT_NEAR(end.vertices.at("vy")[i], low ? -0.5 : 0, 1e-6);
  }
  EXPECT_GT(held, 0u);
  EXPECT_LT(held, start.vertices.at("y").size());
}

TEST_F(Tetrahedra, AreWrittenAsMeshesThatComeApart) {
  const auto frames = run(scene(jelly(", at = 0.1") + cube() + cube("still", "", "[-3, 0, 0]")));
  EXPECT_EQ(frames.at("pieces"), (std::vector<std::string>{"2", "2", "3"}));
  const Mesh whole = frame_mesh(1), torn = frame_mesh(2);
  EXPECT_NEAR(whole.volume(), 2 * 0.064, 1e-6);
  EXPECT_NEAR(torn.volume(), 2 * 0.064, 1e-6);
  EXPECT_GT(torn.triangles.size(), whole.triangles.size()) << "two faces of the crack";
  EXPECT_EQ(std::set<double>(whole.vertices.at("piece").begin(), whole.vertices.at("piece").end()), (std::set<double>{0, 1}));
  std::map<double, std::set<double>> speeds, bodies;
  for (std::size_t i = 0; i < torn.vertices.at("piece").size(); i++) {
    if (torn.vertices.at("piece")[i] < 0) continue;  // of no tetrahedron any more
    speeds[torn.vertices.at("piece")[i]].insert(torn.vertices.at("vx")[i]);
    bodies[torn.vertices.at("piece")[i]].insert(torn.vertices.at("body")[i]);
    EXPECT_EQ(torn.vertices.at("damage")[i], torn.vertices.at("body")[i] == 0 ? 0.5 : torn.vertices.at("damage")[i]);
  }
  EXPECT_EQ(speeds, (std::map<double, std::set<double>>{{0, {0}}, {1, {1}}, {2, {0}}}));
  EXPECT_EQ(bodies, (std::map<double, std::set<double>>{{0, {0}}, {1, {0}}, {2, {1}}}));
}

TEST_F(Tetrahedra, AreWrittenInTheFormatsAsked) {
  run(scene(jelly(", at = 0.1") + cube()) + "meshes = [\"obj\", \"vtp\", \"vtu\"]\n");
  const fs::path meshes = directory / "run/meshes";
  EXPECT_FALSE(fs::exists(meshes / "frame_0000.ply"));
  for (const int frame : {0, 2}) {
    std::ifstream obj(meshes / fmt::format("frame_{:04}.obj", frame));
    std::size_t vertices = 0;
    std::vector<std::string> groups;
    for (std::string line; std::getline(obj, line);) {
      std::istringstream words(line);
      std::string kind;
      words >> kind;
      vertices += kind == "v";
      if (kind == "o" || kind == "g") groups.push_back(line);
      for (std::size_t corner; kind == "f" && words >> corner;) {
        EXPECT_GE(corner, 1u);
        EXPECT_LE(corner, vertices);
      }
    }
    EXPECT_EQ(groups, frame ? (std::vector<std::string>{"o cube", "g cube_0", "g cube_1"})
                            : (std::vector<std::string>{"o cube", "g cube_0"}));
  }
  const std::string surface = contents(meshes / "frame_0002.vtp"), inside = contents(meshes / "frame_0002.vtu");
  EXPECT_NE(surface.find("<Polys>"), std::string::npos);
  EXPECT_NE(inside.find("<VTKFile type=\"UnstructuredGrid\""), std::string::npos);
  for (const std::string* text : {&surface, &inside})
    for (const char* name : {"velocity", "damage", "piece", "body"})
      EXPECT_NE(text->find(std::string("Name=\"") + name + "\""), std::string::npos) << name;
  EXPECT_NE(contents(directory / "run/meshes.pvd").find("file=\"meshes/frame_0002.vtp\""), std::string::npos);
  EXPECT_NE(contents(directory / "run/tetrahedra.pvd").find("file=\"meshes/frame_0002.vtu\""), std::string::npos);
  // as often as not the previous run had others: they are removed
  run(scene(jelly() + cube()) + "meshes = []\n", "run", "--frames 1");
  EXPECT_FALSE(fs::exists(meshes / "frame_0002.vtp"));
  EXPECT_FALSE(fs::exists(directory / "run/meshes.pvd"));
}

TEST_F(Tetrahedra, HaveMeshesOnlyWhereThereAreSurfaces) {
  const auto frames = run(scene(material("dust", dust) + block("cloud", "dust")), "run", "--frames 1");
  EXPECT_EQ(frames.count("pieces"), 0u);
  EXPECT_FALSE(fs::exists(directory / "run/meshes"));
  const auto refused = [&](const std::string& text, const std::string& command, const std::string& reason) {
    write("scene.toml", text);
    const Outcome outcome = with_plugins(command + " scene.toml");
    EXPECT_EQ(outcome.status, 2);
    EXPECT_NE(outcome.err.find(reason), std::string::npos) << outcome.err;
  };
  for (const char* command : {"run", "validate"})
    refused(scene(material("dust", dust) + block("cloud", "dust")) + "meshes = [\"ply\"]\n", command,
            "output.meshes: no body of the scene has a surface that \"ply\" could be written of");
  refused(scene(material("rubber", rubber) + block("cushion", "rubber")) + "meshes = [\"ply\"]\n", "validate",
          "'meshes' has no effect");
  refused(scene(jelly() + cube()) + "meshes = [\"stl\"]\n", "validate", "unknown name \"stl\" in 'meshes'");
  run(scene(jelly() + cube() + material("rubber", rubber) + block("cushion", "rubber")), "both", "--frames 1");
  const Mesh mesh = frame_mesh(1, "both");
  EXPECT_EQ(mesh.vertices.at("body").front(), 1) << "the bodies of the material point method come first";
}

TEST_F(Tetrahedra, AreCheckedForTheFieldsThatFramesAreToHold) {
  write("scene.toml", scene(jelly() + cube()) + "attributes = [\"veloctiy\"]\n");
  for (const char* command : {"run scene.toml", "validate scene.toml"}) {
    const Outcome outcome = with_plugins(command);
    EXPECT_EQ(outcome.status, 2) << command;
    EXPECT_NE(outcome.err.find("output.attributes: no body of the scene has \"veloctiy\""), std::string::npos) << outcome.err;
  }
}

TEST_F(Tetrahedra, NeedNoCells) {
  const std::string start = "[simulation]\nend_time = 0.2\nframe_rate = 10\n", output = "[output]\nformats = [\"ply\"]\n";
  run(start + jelly() + cube() + output, "run", "--frames 1");
  EXPECT_NE(contents(directory / "run/scene.toml").find("cell_size = 0.2 "), std::string::npos) << "the edges of the body";
  const Outcome valid = with_plugins("validate scene.toml");
  EXPECT_EQ(valid.status, 0) << valid.err;
  EXPECT_EQ(valid.out.find("cells"), std::string::npos) << valid.out;
  // of a size, on the other hand, edges can be
  run(scene(jelly() + cube()), "given", "--frames 1 --set body.0.tetrahedra={}");
  EXPECT_EQ(frame_mesh(0, "given").triangles, frame_mesh(0).triangles);
  write("scene.toml", start + jelly() + cube() + material("dust", dust) + block("cloud", "dust"));
  const Outcome refused = with_plugins("validate scene.toml");
  EXPECT_EQ(refused.status, 2);
  EXPECT_NE(
      refused.err.find("scene.toml:1:1: error: [simulation] needs 'cell_size', a number (m); only scenes whose bodies all "
                       "have tetrahedra may leave it out"),
      std::string::npos)
      << refused.err;
}

TEST_F(Tetrahedra, AreReadBackFromTheFilesThatAreWritten) {
  run(scene(jelly() + cube()) + "meshes = [\"ply\", \"vtu\"]\n", "run", "--frames 1");
  fs::copy(directory / "run/meshes/frame_0000.vtu", directory / "cube.vtu");
  run("[simulation]\nend_time = 0.1\nframe_rate = 10\n" + jelly() +
          "[[body]]\nname = \"cube\"\nmaterial = \"jelly\"\ntetrahedra = { file = \"cube.vtu\" }\n" +
          "[output]\nformats = [\"ply\"]\n",
      "again");
  const Mesh written = frame_mesh(0), read = frame_mesh(0, "again");
  EXPECT_EQ(read.triangles, written.triangles);
  for (const char* axis : {"x", "y", "z"}) EXPECT_EQ(read.vertices.at(axis), written.vertices.at(axis));
}

TEST_F(Tetrahedra, LeaveTheBatchThatTheirLawFailsOn) {
  write("scene.toml",
        scene(material("rubber", rubber + "\ndiscretization = { plugin = \"fem\" }") + material("jelly", rubber) +
              "[[body]]\nname = \"points\"\nmaterial = \"jelly\"\nsampling = \"regular\"\n"
              "shape = { type = \"box\", center = [3, 0, 0], size = [0.4, 0.4, 0.4] }\n"
              "[[body]]\nname = \"cube\"\nmaterial = \"rubber\"\ntetrahedra = {}\n"
              "shape = { type = \"box\", center = [0, 0, 0], size = [0.4, 0.4, 0.4] }\n"
              "[[handle]]\nbody = \"cube\"\nregion = { type = \"box\", center = [0.2, 0, 0], size = [0.01, 1, 1] }\n"
              "motion = { velocity = [-1e6, 0, 0] }\n"));
  const Outcome run = with_plugins("run scene.toml --quiet --out run");
  EXPECT_EQ(run.status, 3) << run.err;
  EXPECT_NE(run.err.find("where elasticity/split-neo-hookean is not defined"), std::string::npos) << run.err;
  ASSERT_TRUE(fs::exists(directory / "run/failed_batch.json")) << run.err;
  const auto batch = json(directory / "run/failed_batch.json");
  EXPECT_EQ(batch.get<std::string>("failed"), "elasticity/split-neo-hookean");
  EXPECT_EQ(batch.get<std::string>("material"), "rubber");
  EXPECT_GE(batch.get_child("particles").front().second.get_value<int>(), 64) << "of the scene, in which others come first";
  const Outcome again = with_plugins("point --replay run/failed_batch.json --output again.csv");
  EXPECT_NE(again.err.find("those of the run, to the bit"), std::string::npos) << again.err;
}

}  // namespace
}  // namespace cleave::test
