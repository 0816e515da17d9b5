#include "checkpoint/scene_changes.hpp"

#include <gmock/gmock.h>

#include <fstream>

namespace cleave::checkpoint {
namespace {

using testing::ElementsAre;
using testing::HasSubstr;
using testing::IsEmpty;

const std::string scene = R"([simulation]
cell_size = 0.1
end_time = 1.0
[[material]]
name = "jelly"
elasticity = { plugin = "elasticity/a", youngs_modulus = 100000.0 }
[[body]]
name = "block"
shape = { type = "box", size = [1.0, 2.0, 3.0] }
[output]
formats = ["vtp"]
)";

checkpoint::Run with_scene(const std::string& text) {
  checkpoint::Run run;
  run.scene = text;
  return run;
}

std::string replaced(std::string text, const std::string& from, const std::string& to) {
  text.replace(text.find(from), from.size(), to);
  return text;
}

TEST(SceneChanges, AreNamedByKeyWithOldAndNewValue) {
  const std::string other = replaced(replaced(scene, "100000.0", "200000.0"), "2.0,", "2.5,");
  EXPECT_THAT(changed_physics(with_scene(scene), with_scene(other)),
              ElementsAre("body.block.shape.size: [ 1.0, 2.0, 3.0 ] -> [ 1.0, 2.5, 3.0 ]",
                          "material.jelly.elasticity.youngs_modulus: 100000.0 -> 200000.0"));
}

TEST(SceneChanges, EndTimeAndOutputAreFreeToChange) {
  const std::string other =
      replaced(replaced(scene, "end_time = 1.0", "end_time = 2.0"), "[\"vtp\"]", "[\"ply\"]\nsurface = false");
  EXPECT_THAT(changed_physics(with_scene(scene), with_scene(other)), IsEmpty());
}

TEST(SceneChanges, WhatIsAddedOrLeftOutCounts) {
  const std::string more = scene + "[[collider]]\nname = \"ground\"\ncontact = \"slip\"\n";
  EXPECT_THAT(changed_physics(with_scene(scene), with_scene(more)),
              ElementsAre(HasSubstr("collider.ground.contact: none -> "), HasSubstr("collider.ground.name: none -> ")));
  EXPECT_THAT(changed_physics(with_scene(more), with_scene(scene)), ElementsAre(HasSubstr("-> none"), HasSubstr("-> none")));
}

TEST(SceneChanges, FilesCountByTheirContentsNotByTheirPlace) {
  const std::filesystem::path directory = testing::TempDir();
  const auto run_with = [&](const std::string& name, const std::string& contents) {
    const auto file = directory / name;
    std::ofstream(file) << contents;
    checkpoint::Run run =
        with_scene(scene + "[[collider]]\nname = \"c\"\nshape = { type = \"mesh\", file = \"" + file.string() + "\" }\n");
    run.files = files_of(run.scene);
    return run;
  };
  const checkpoint::Run first = run_with("a.obj", "v 0 0 0"), moved = run_with("b.obj", "v 0 0 0"),
                        edited = run_with("c.obj", "v 0 0 1");
  EXPECT_EQ(first.files.size(), 1u);
  EXPECT_THAT(changed_physics(first, moved), IsEmpty());
  EXPECT_THAT(changed_physics(first, edited),
              ElementsAre(testing::AllOf(HasSubstr("collider.c.shape.file"), HasSubstr("are not what they were"))));
  for (const char* name : {"a.obj", "b.obj", "c.obj"}) std::filesystem::remove(directory / name);
}

TEST(SceneChanges, VersionsAndInstructionSetsAreTheProgramsBuildsAndThreadsAreNotes) {
  checkpoint::Run saved = with_scene(scene);
  saved.program = "1.0.0";
  saved.isa = "x86-64-v4";
  saved.threads = 2;
  saved.plugins = {{"elasticity/a", "1.0.0", "/a.so", 1}, {"damage/b", "1.0.0", "/b.so", 2}};
  EXPECT_THAT(changes(saved, saved).program, IsEmpty());
  EXPECT_THAT(changes(saved, saved).notes, IsEmpty());
  checkpoint::Run now = saved;
  now.program = "1.1.0";
  now.isa = "x86-64-v3";
  now.threads = 4;
  now.plugins[0].version = "1.0.1";
  now.plugins[1].crc = 3;
  EXPECT_THAT(changes(saved, now).program, ElementsAre("cleave: 1.0.0 -> 1.1.0", "instruction set: x86-64-v4 -> x86-64-v3",
                                                       "plugin elasticity/a: 1.0.0 -> 1.0.1"));
  EXPECT_THAT(changes(saved, now).notes,
              ElementsAre("threads: 2 -> 4", HasSubstr("plugin damage/b 1.0.0 has been built anew")));
}

}  // namespace
}  // namespace cleave::checkpoint
