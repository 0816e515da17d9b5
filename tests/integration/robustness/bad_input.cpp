#include "robust.hpp"

#include <sys/stat.h>

namespace cleave::test {
namespace {

using BadInput = Robust;

const std::string cube =
    "v 0 0 0\nv 1 0 0\nv 1 1 0\nv 0 1 0\nv 0 0 1\nv 1 0 1\nv 1 1 1\nv 0 1 1\n"
    "f 4 3 2 1\nf 5 6 7 8\nf 1 2 6 5\nf 2 3 7 6\nf 3 4 8 7\n";  // the last face is missing
const std::string tetgen_nodes = "4 3 0 0\n0 0 0 0\n1 1 0 0\n2 0 1 0\n3 0 0 1\n";

TEST_F(BadInput, SoundSceneRuns) { expect(sound_scene, 0, ""); }

// ---------------------------------------------------------------- scene files

TEST_F(BadInput, NestedDeep) {
  std::string key = "a", value = "1";
  for (int i = 0; i < 200000; ++i) key += ".a";
  expect(key + " = 1\n", 2, "scene.toml:1: error: values are nested deeper than 256 tables");
  expect("\n[" + key + "]\n", 2, "scene.toml:2: error: values are nested deeper");
  for (int i = 0; i < 10000; ++i) value = "[" + value + "]";
  expect("a = " + value + "\n", 2, "scene.toml:1: error: values are nested deeper");
  // toml++ takes 256 tables within each other, and keys of any number of dots in each of them
  value = "1";
  for (int i = 0; i < 100; ++i) value = "{a.a.a.a.a = " + value + "}";
  expect("a = " + value + "\n", 2, "scene.toml:1: error: values are nested deeper");
  write("scene.toml", sound_scene);
  expect_command("run scene.toml --set " + key.substr(0, 99999) + "=1", 2, "nested deeper than 256 tables");
}

TEST_F(BadInput, DotsInTextAndCommentsAreNoNesting) {
  const std::string dots(1000, '.');
  expect("# " + dots + "\n" + changed("\"block\"", "\"\"\"\\\n     block\"\"\" # " + dots + " ['"), 0, "");
  expect(changed("\"block\"", "\"" + dots + "\""), 2, "scene.toml:12:");
}

TEST_F(BadInput, HundredMegabytesOfToml) {
  std::ofstream large(directory / "scene.toml");
  for (int i = 0; i < 100; ++i) large << std::string(1 << 20, '#') << '\n';
  large.close();
  expect_command("run scene.toml", 2, "scene.toml: error: the file is larger than 64 MiB");
  expect_command("run /dev/zero", 2, "/dev/zero: error: the file is larger than 64 MiB", with_kilobytes(4000000));
  fs::copy_file(directory / "scene.toml", directory / "study.toml");
  expect_command("study study.toml", 2, "study.toml: error: the file is larger than 64 MiB");
}

TEST_F(BadInput, InvalidUtf8) {
  expect(changed("\"block\"", "\"bl\xff\xfeock\""), 2, "scene.toml:12:");
  write("study.toml", "title = \"\xc3\x28\"\n");
  expect_command("study study.toml", 2, "study.toml:1:");
  write("scene.toml", sound_scene);
  expect_command("run scene.toml --set body.0.name=\xff", 2, "the value is not text that a scene may hold", "");
}

TEST_F(BadInput, EmptyAndNullBytes) {
  expect("", 2, "simulation");
  expect(std::string(4096, '\0'), 2, "scene.toml:1:");
}

TEST_F(BadInput, AbsurdParameters) {
  const std::pair<const char*, const char*> parameters[] = {
      {"cell_size = 0.1", "cell_size = nan"},
      {"cell_size = 0.1", "cell_size = -1"},
      {"end_time = 0.02", "end_time = inf"},
      {"frame_rate = 100", "frame_rate = 0"},
      {"density = 1000", "density = nan"},
      {"density = 1000", "density = -5"},
      {"youngs_modulus = 1e5", "youngs_modulus = nan"},
      {"youngs_modulus = 1e5", "youngs_modulus = -1"},
      {"poissons_ratio = 0.3", "poissons_ratio = 0.5"},
      {"size = [0.3, 0.3, 0.3]", "size = [nan, 0.3, 0.3]"},
      {"dimension = 3", "dimension = 17"},
      {"size = [0.3, 0.3, 0.3]", "size = [0, 0.3, 0.3]"},
  };
  for (const auto& [before, after] : parameters) expect(changed(before, after), 2, "scene.toml:");
}

TEST_F(BadInput, OverridesThatAreNone) {
  write("scene.toml", sound_scene);
  for (const char* set : {"=", "a", "..=1", "simulation.cell_size=", "simulation.cell_size=nan", "body.7.name=x"})
    expect_command(std::string("run scene.toml --set ") + set, 2, "error: ");
}

// ---------------------------------------------------------------- sizes

TEST_F(BadInput, MoreParticlesThanMemory) {
  // More than 16 GB hold, which stand for the memory of the machine.
  expect(changed("size = [0.3, 0.3, 0.3]", "size = [54, 54, 54]"), 2,
         "body 'block': about 1.26e+09 particles take at least 188 GB", with_kilobytes(16000000));
  expect(changed("size = [0.3, 0.3, 0.3]", "size = [1e9, 1e9, 1e9]"), 2, "use larger cells");
  expect(changed("cell_size = 0.1", "cell_size = 1e-9"), 2, "use larger cells");
}

TEST_F(BadInput, AllocationThatFails) {
  if (!memory_can_be_limited) GTEST_SKIP() << "sanitizers need more address space than a limit of it leaves";
  // particles of a file are not counted beforehand; the limit stands for a machine that is too small
  std::ofstream csv(directory / "p.csv");
  csv << "x,y,z\n";
  for (int i = 0; i < 2000000; ++i) csv << i % 100 << ',' << i / 100 % 100 << ',' << i / 10000 << '\n';
  csv.close();
  expect(with_particles("p.csv"), 2, "there is not enough memory", with_kilobytes(180000));
}

TEST_F(BadInput, NoParticles) {
  expect(changed("size = [0.3, 0.3, 0.3]", "size = [1e-4, 1e-4, 1e-4]"), 2, "no particle lies inside the shape");
  write("p.csv", "x,y,z\n");
  expect(with_particles("p.csv"), 2, "p.csv");
  expect(
      with_shape("{ type = \"intersection\", shapes = [{ type = \"sphere\", radius = 1 }, { type = \"sphere\", center = [9, 0, "
                 "0], radius = 1 }] }"),
      2, "no");
  expect(sound_scene.substr(0, sound_scene.find("[[body]]")), 2, "body");
}

TEST_F(BadInput, ParticlesThatLeave) {
  // faster than the grid can ever reach: half a light year in the time of the scene
  expect(changed("material = \"rubber\"\n", "material = \"rubber\"\nvelocity = [1e20, 0, 0]\n"), 3, "particle");
}

// ---------------------------------------------------------------- particle files

TEST_F(BadInput, NanInParticles) {
  write("p.csv", "x,y,z,vx,vy,vz\n0,0,0,0,0,0\n0.1,nan,0,0,0,0\n");
  expect(with_particles("p.csv"), 2, "p.csv:3: ");
  write("p.csv", "x,y,z,vx,vy,vz\n0,0,0,inf,0,0\n");
  expect(with_particles("p.csv"), 2, "p.csv:2: ");
  write("p.csv", "x,y,z,volume\n0,0,0,-1\n");
  expect(with_particles("p.csv"), 2, "p.csv:2: ");
  write("p.csv", "x,y,z\n1,2\n");
  expect(with_particles("p.csv"), 2, "p.csv:2: ");
  write("p.csv", std::string("\xff\xfe\0x", 4));
  expect(with_particles("p.csv"), 2, "p.csv");
}

// ---------------------------------------------------------------- meshes

TEST_F(BadInput, MeshesThatAreMissingOrUnreadable) {
  expect(with_shape("{ type = \"mesh\", file = \"no.obj\" }"), 2, "scene.toml:14:33: error: there is no file");
  fs::create_directory(directory / "dir.obj");
  expect(with_shape("{ type = \"mesh\", file = \"dir.obj\" }"), 2, "there is no file");
  for (const char* name : {"m.obj", "m.ply", "m.stl"}) {
    write(name, "");
    expect(with_shape(std::string("{ type = \"mesh\", file = \"") + name + "\" }"), 2, name);
    write(name, std::string("\x7f"
                            "ELF\0\1\2\3",
                            8) +
                    std::string(300, '\xee'));
    expect(with_shape(std::string("{ type = \"mesh\", file = \"") + name + "\" }"), 2, name);
  }
  write("m.png", "x");
  expect(with_shape("{ type = \"mesh\", file = \"m.png\" }"), 2,
         "'file' must be a file of type .obj, .ply, .stl, is \"m.png\"");
  fs::create_symlink("loop.obj", directory / "loop.obj");
  expect(with_shape("{ type = \"mesh\", file = \"loop.obj\" }"), 2, "loop.obj");
}

TEST_F(BadInput, MeshWithoutReadPermission) {
  if (geteuid() == 0 && std::system("setpriv --version >/dev/null 2>&1") != 0) GTEST_SKIP() << "setpriv is not there";
  write("m.obj", cube);
  fs::permissions(directory / "m.obj", fs::perms::none);
  fs::permissions(directory, fs::perms::all);
  write("scene.toml", with_shape("{ type = \"mesh\", file = \"m.obj\" }"));
  expect_command("run scene.toml --out run", 2, "m.obj: Permission denied",
                 geteuid() == 0 ? "setpriv --reuid=65534 --regid=65534 --clear-groups" : "");
}

TEST_F(BadInput, MeshWithAHole) {
  write("m.obj", cube);
  expect(with_shape("{ type = \"mesh\", file = \"m.obj\" }"), 2, "m.obj: not closed: 4 open edges around 1");
  write("m.obj", "v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n");
  expect(with_shape("{ type = \"mesh\", file = \"m.obj\" }"), 2, "m.obj: not closed: 3 open edges");
  write("m.obj", "v 0 0 0\nv 1 0 0\nv nan 1 0\nf 1 2 3\n");
  expect(with_shape("{ type = \"mesh\", file = \"m.obj\" }"), 2, "m.obj:3: ");
  write("m.obj", "v 0 0 0\nf 1 2 3\n");
  expect(with_shape("{ type = \"mesh\", file = \"m.obj\" }"), 2, "m.obj:2: ");
}

TEST_F(BadInput, MeshWithSmallHolesIsClosedAndSaysSo) {
  // the last face of the cube with a window of 0.2 m by 0.2 m, and one face given twice
  write("m.obj", cube +
                     "v 0 0.4 0.4\nv 0 0.6 0.4\nv 0 0.6 0.6\nv 0 0.4 0.6\n"
                     "f 1 4 10 9\nf 4 8 11 10\nf 8 5 12 11\nf 5 1 9 12\nf 1 2 6 5\nf 1 2 6 5\n");
  write("scene.toml", with_shape("{ type = \"mesh\", file = \"m.obj\" }"));
  expect_command("run scene.toml --out run", 0, "m.obj: closed 1 hole (4 open edges)");
}

TEST_F(BadInput, TetrahedraThatAreNone) {
  const std::string body = "tetrahedra = { file = \"m.node\" }";
  const auto scene = changed("shape = { type = \"box\", center = [0, 0.5, 0], size = [0.3, 0.3, 0.3] }", body);
  std::string fem = scene;
  fem.replace(fem.find("elasticity ="), 0, "discretization = { plugin = \"fem\" }\n");
  expect(fem, 2, "m.node");
  write("m.node", tetgen_nodes);
  expect(fem, 2, "m.node: there is no m.ele beside it");
  write("m.ele", "1 4 0\n0 0 1 2 9\n");
  expect(fem, 2, "m.ele:2: ");
  write("m.ele", "99999999999 4 0\n");
  expect(fem, 2, "m.ele:1: ");
  write("m.node", "4 3 0 0\n0 0 0 0\n1 1 0 0\n2 2 0 0\n3 3 0 0\n");
  write("m.ele", "1 4 0\n0 0 1 2 3\n");
  expect(fem, 2, "m.node");
}

// ---------------------------------------------------------------- checkpoints and studies

TEST_F(BadInput, DamagedCheckpoints) {
  write("scene.toml", sound_scene + "checkpoint = { frames = 1 }\n");
  ASSERT_EQ(cleave("run scene.toml --out run").status, 0);
  std::vector<fs::path> files;
  for (const auto& entry : fs::directory_iterator(directory / "run/checkpoints")) files.push_back(entry.path());
  ASSERT_FALSE(files.empty());
  for (const auto& file : files) {
    std::fstream bytes(file, std::ios::in | std::ios::out | std::ios::binary);
    bytes.seekp(std::streamoff(fs::file_size(file) / 2));
    bytes.put('\x55').put('\xaa').put('\x33');
  }
  const Outcome run = cleave("run run --resume");
  EXPECT_EQ(run.status, 2) << run.err;
  EXPECT_NE(run.err.find("is damaged: the checksum of section"), std::string::npos) << run.err;
}

TEST_F(BadInput, StudiesThatAreNone) {
  expect_command("study no.toml", 2, "no.toml: error: there is no such study file");
  write("study.toml", "this is no study");
  expect_command("study study.toml", 2, "study.toml:1:");
  write("study.toml", "[a" + std::string(3000, '.') + "b]\n");
  expect_command("study study.toml", 2, "study.toml:1: error: values are nested deeper");
  write("study.toml", "scene = \"no.toml\"\n");
  expect_command("study study.toml", 2, "study.toml");
}

}  // namespace
}  // namespace cleave::test
