#include "../../sanitized.hpp"
#include "run_to_resume.hpp"

#include <sys/resource.h>

namespace cleave::test {
namespace {

using testing::AllOf;
using testing::HasSubstr;
using testing::IsEmpty;
using testing::Not;

class Resume : public RunToResume {
 protected:
  Resume() { write("scene.toml", scene); }

  Outcome run(const std::string& arguments, const std::string& before = "") const {
    return cleave("run scene.toml --quiet " + arguments, before);
  }
  static void flip_a_bit(const fs::path& file) {
    std::fstream stream(file, std::ios::in | std::ios::out | std::ios::binary);
    stream.seekg(std::streamoff(fs::file_size(file) / 2));
    const int byte = stream.get();
    stream.seekp(std::streamoff(fs::file_size(file) / 2));
    stream.put(char(byte ^ 4));
  }

  const std::string scene = R"(
[simulation]
dimension = 2
cell_size = 0.1
end_time = 0.1
frame_rate = 100
gravity = [0, -10]
[[material]]
name = "jelly"
density = 1000
elasticity = { plugin = "split-neo-hookean", youngs_modulus = 1e5, poissons_ratio = 0.3 }
[[body]]
name = "block"
material = "jelly"
velocity = [0, -1]
shape = { type = "box", center = [0, 0.6], size = [1, 0.8] }
[[collider]]
shape = { type = "half-space", normal = [0, 1] }
[output]
formats = ["vtp"]
)";
};

TEST_F(Resume, ALongerRunGoesOnFromTheEndOfAShorterOne) {
  ASSERT_EQ(run("--out whole").status, 0);
  ASSERT_EQ(run("--out part --set simulation.end_time=0.04").status, 0);
  EXPECT_THAT(differences("whole", "part"), Not(IsEmpty()));
  const Outcome rest = cleave("run scene.toml --out part --resume");
  ASSERT_EQ(rest.status, 0) << rest.err;
  EXPECT_THAT(rest.out, HasSubstr("resumed at step"));
  EXPECT_THAT(differences("whole", "part"), IsEmpty());
  EXPECT_EQ(json(directory / "part/summary.json").get<int>("frames"), 11);
  EXPECT_EQ(json(directory / "part/summary.json").get<int>("steps"), json(directory / "whole/summary.json").get<int>("steps"));
}

TEST_F(Resume, StopsInTheMiddleOfAFrameLeaveNoTrace) {
  ASSERT_EQ(run("--out whole").status, 0);
  const int steps = json(directory / "whole/summary.json").get<int>("steps");
  for (int stop = 7; stop < steps; stop += 7) ASSERT_EQ(run("--out parts --resume --steps " + std::to_string(stop)).status, 0);
  EXPECT_THAT(differences("whole", "parts"), Not(IsEmpty()));
  ASSERT_EQ(run("--out parts --resume").status, 0);
  EXPECT_THAT(differences("whole", "parts"), IsEmpty());
}

TEST_F(Resume, AnEndBetweenFramesIsMadeUpFor) {
  ASSERT_EQ(run("--out part --set simulation.end_time=0.035").status, 0);
  EXPECT_TRUE(fs::exists(directory / "part/vtp/frame_0004.vtp"));
  const std::string early = contents(directory / "part/vtp/frame_0004.vtp");
  ASSERT_EQ(run("--out part --resume --set simulation.end_time=0.035").status, 0);
  EXPECT_EQ(contents(directory / "part/vtp/frame_0004.vtp"), early);
  ASSERT_EQ(run("--out part --resume").status, 0);
  EXPECT_NE(contents(directory / "part/vtp/frame_0004.vtp"), early);
  const auto rows = contents(directory / "part/frames.csv");
  EXPECT_EQ(std::count(rows.begin(), rows.end(), '\n'), 12);
  EXPECT_THAT(rows, AllOf(HasSubstr("\n4,0.04,"), Not(HasSubstr("0.035"))));
}

TEST_F(Resume, ARunThatIsDoneStaysAsItIs) {
  ASSERT_EQ(run("--out whole").status, 0);
  const auto before = results("whole");
  const Outcome again = run("--out whole --resume");
  EXPECT_EQ(again.status, 0) << again.err;
  EXPECT_EQ(results("whole"), before);
}

TEST_F(Resume, TheDirectoryOfARunIsEnoughToGoOn) {
  ASSERT_EQ(run("--out whole").status, 0);
  ASSERT_EQ(run("--out part --frames 3").status, 0);
  const Outcome first = cleave("run part --resume --quiet --frames 5");
  ASSERT_EQ(first.status, 0) << first.err;
  const Outcome second = cleave("run --resume --out part --quiet");
  ASSERT_EQ(second.status, 0) << second.err;
  EXPECT_THAT(differences("whole", "part"), IsEmpty());
}

TEST_F(Resume, OutputMayChangeOnTheWay) {
  ASSERT_EQ(run("--out whole --set 'output.formats=[\"vtp\", \"ply\"]'").status, 0);
  ASSERT_EQ(run("--out part --frames 5").status, 0);
  ASSERT_EQ(run("--out part --resume --set 'output.formats=[\"ply\"]'").status, 0);
  EXPECT_FALSE(fs::exists(directory / "part/ply/frame_0005.ply"));
  EXPECT_EQ(contents(directory / "part/ply/frame_0010.ply"), contents(directory / "whole/ply/frame_0010.ply"));
  EXPECT_EQ(contents(directory / "part/vtp/frame_0005.vtp"), contents(directory / "whole/vtp/frame_0005.vtp"));
}

TEST_F(Resume, WithoutACheckpointTheRunBegins) {
  const Outcome first = cleave("run scene.toml --out whole --resume");
  EXPECT_EQ(first.status, 0) << first.err;
  EXPECT_THAT(first.out, HasSubstr("there is no checkpoint in whole yet: from the beginning"));
  EXPECT_EQ(results("whole").count("vtp/frame_0010.vtp"), 1u);
}

TEST_F(Resume, WithoutTheOptionTheRunBeginsAnew) {
  ASSERT_EQ(run("--out it").status, 0);
  ASSERT_EQ(run("--out it --frames 2 --set output.checkpoint.seconds=0").status, 0);
  EXPECT_THAT(checkpoints("it"), IsEmpty());
  EXPECT_FALSE(fs::exists(directory / "it/vtp/frame_0003.vtp"));
}

TEST_F(Resume, OtherPhysicsAreRefusedByKey) {
  ASSERT_EQ(run("--out it --frames 3").status, 0);
  const auto before = results("it");
  const Outcome other =
      run("--out it --resume --set material.jelly.elasticity.youngs_modulus=2e5 --set simulation.gravity.1=-9 --set "
          "simulation.end_time=1");
  EXPECT_EQ(other.status, 2);
  EXPECT_THAT(other.err,
              AllOf(HasSubstr("material.jelly.elasticity.youngs_modulus: 100000.0 -> 200000.0"),
                    HasSubstr("simulation.gravity: [ 0.0, -10.0, 0.0 ] -> [ 0.0, -9.0, 0.0 ]"), Not(HasSubstr("end_time:"))));
  EXPECT_EQ(results("it"), before);
  fs::remove_all(directory / "it/checkpoints");
  EXPECT_EQ(run("--out it --resume --set simulation.gravity.1=-9").status, 2) << "also where there is no checkpoint yet";
}

TEST_F(Resume, AMeshThatHasChangedIsRefused) {
  const std::string tetrahedron = "v 0 0.2 0\nv 1 0.2 0\nv 0 1.2 0\nv 0 0.2 1\nf 1 3 2\nf 1 2 4\nf 2 3 4\nf 1 4 3\n";
  write("solid.obj", tetrahedron);
  std::string text = scene;
  text.replace(text.find("dimension = 2"), 13, "dimension = 3");
  text.replace(text.find("shape = { type = \"box\""),
               std::string("shape = { type = \"box\", center = [0, 0.6], size = [1, 0.8] }").size(),
               "shape = { type = \"mesh\", file = \"solid.obj\" }");
  text.replace(text.find("gravity = [0, -10]"), 18, "gravity = [0, -10, 0]");
  text.replace(text.find("velocity = [0, -1]"), 18, "velocity = [0, -1, 0]");
  text.replace(text.find("normal = [0, 1]"), 15, "normal = [0, 1, 0]");
  write("scene.toml", text);
  const Outcome first = run("--out it --frames 1");
  ASSERT_EQ(first.status, 0) << first.err;
  write("solid.obj", "# moved\n" + tetrahedron);
  const Outcome second = run("--out it --resume --frames 2");
  EXPECT_EQ(second.status, 2);
  EXPECT_THAT(second.err,
              AllOf(HasSubstr("body.block.shape.file"), HasSubstr("solid.obj"), HasSubstr("are not what they were")));
  write("solid.obj", tetrahedron);
  EXPECT_EQ(run("--out it --resume --frames 2").status, 0);
}

TEST_F(Resume, AnotherInstructionSetIsRefusedUnlessToldOtherwise) {
  if (sanitized) GTEST_SKIP() << "built for one instruction set";
  ASSERT_EQ(run("--out it --frames 3 --isa x86-64-v2").status, 0);
  const Outcome other = run("--out it --resume --isa x86-64-v3");
  if (other.err.find("this processor") != std::string::npos) GTEST_SKIP() << "the processor has one instruction set only";
  EXPECT_EQ(other.status, 2);
  EXPECT_THAT(other.err, AllOf(HasSubstr("instruction set: baseline -> x86-64-v3"), HasSubstr("--resume-anyway")));
  const Outcome anyway = run("--out it --resume-anyway --isa x86-64-v3");
  EXPECT_EQ(anyway.status, 0);
  EXPECT_THAT(anyway.err, HasSubstr("warning: resumed with another program"));
}

TEST_F(Resume, APluginOfAnotherVersionIsRefusedUnlessToldOtherwise) {
  const fs::path sound = fs::path(CLEAVE_FIXTURE_DIR) / "sound", law = directory / "laws/energy_only.so";
  fs::create_directory(directory / "laws");
  fs::copy_file(sound / "energy_only.so", law);
  std::string text = scene;
  text.replace(text.find("split-neo-hookean"), std::string("split-neo-hookean").size(), "energy-only");
  write("scene.toml", text);
  const std::string laws = " --allow-plugins-from laws";
  ASSERT_EQ(run("--out whole" + laws).status, 0);
  ASSERT_EQ(run("--out it --frames 3" + laws).status, 0);
  const auto before = results("it");

  fs::remove(law);
  const Outcome without = run("--out it --resume" + laws);
  EXPECT_EQ(without.status, 2);
  EXPECT_THAT(without.err, HasSubstr("energy-only"));

  fs::copy_file(sound / "next/energy_only_next.so", law);
  const Outcome other = run("--out it --resume" + laws);
  EXPECT_EQ(other.status, 2);
  EXPECT_THAT(other.err, AllOf(HasSubstr("was written by another program:"),
                               HasSubstr("plugin elasticity/energy-only: 1.0.0 -> 1.1.0"), HasSubstr("--resume-anyway")));
  EXPECT_EQ(results("it"), before);

  // the same version in another file: code is the same here, which a checksum cannot know
  fs::remove(law);
  fs::copy_file(sound / "energy_only.so", law);
  std::ofstream(law, std::ios::app | std::ios::binary).put('\0');
  fs::copy(directory / "it", directory / "rebuilt", fs::copy_options::recursive);
  const Outcome rebuilt = run("--out rebuilt --resume" + laws);
  EXPECT_EQ(rebuilt.status, 0) << rebuilt.err;
  EXPECT_THAT(rebuilt.err, AllOf(HasSubstr("warning: bits may differ"),
                                 HasSubstr("plugin elasticity/energy-only 1.0.0 has been built anew: " + law.string())));
  EXPECT_THAT(differences("whole", "rebuilt"), IsEmpty());

  fs::remove(law);
  fs::copy_file(sound / "next/energy_only_next.so", law);
  const Outcome anyway = run("--out it --resume-anyway" + laws);
  EXPECT_EQ(anyway.status, 0) << anyway.err;
  EXPECT_THAT(anyway.err, HasSubstr("warning: resumed with another program"));
}

TEST_F(Resume, ADamagedCheckpointIsSaidAndTheOneBeforeServes) {
  ASSERT_EQ(run("--out whole").status, 0);
  ASSERT_EQ(run("--out part --frames 5 --set output.checkpoint.frames=1").status, 0);
  ASSERT_EQ(checkpoints("part").size(), 2u);
  flip_a_bit(checkpoints("part")[1]);
  const Outcome resumed = run("--out part --resume --set output.checkpoint.frames=0");
  EXPECT_EQ(resumed.status, 0) << resumed.err;
  EXPECT_THAT(resumed.err, AllOf(HasSubstr("warning: part/checkpoints/step_"), HasSubstr("is damaged: the checksum of section"),
                                 HasSubstr("going back to part/checkpoints/step_")));
  EXPECT_THAT(differences("whole", "part"), IsEmpty());
}

TEST_F(Resume, WhereAllAreDamagedEachIsSaid) {
  ASSERT_EQ(run("--out it --frames 5 --set output.checkpoint.frames=1").status, 0);
  const auto files = checkpoints("it");
  ASSERT_EQ(files.size(), 2u);
  flip_a_bit(files[0]);
  fs::resize_file(files[1], fs::file_size(files[1]) / 2);
  const auto before = results("it");
  const Outcome resumed = run("--out it --resume");
  EXPECT_EQ(resumed.status, 2);
  EXPECT_THAT(resumed.err,
              AllOf(HasSubstr("no checkpoint can be resumed from"), HasSubstr("is damaged"), HasSubstr("is cut off after")));
  EXPECT_EQ(results("it"), before);
}

TEST_F(Resume, FramesTableAndIndexAreThoseOfTheCheckpointWhateverBecameOfThem) {
  ASSERT_EQ(run("--out whole").status, 0);
  ASSERT_EQ(run("--out part --frames 5").status, 0);
  fs::remove(directory / "part/frames.csv");
  fs::remove(directory / "part/particles.pvd");
  std::ofstream(directory / "part/vtp/frame_0006.vtp.partial") << "half a frame";
  std::ofstream(directory / "part/vtp/frame_0042.vtp") << "of another run";
  ASSERT_EQ(run("--out part --resume").status, 0);
  EXPECT_THAT(differences("whole", "part"), IsEmpty());
}

TEST_F(Resume, ARequestToEndLeavesACheckpoint) {
  ASSERT_EQ(run("--out whole --set simulation.end_time=1").status, 0);
  for (const int request : {SIGTERM, SIGINT}) {
    const std::string out = request == SIGTERM ? "terminated" : "interrupted";
    const pid_t child = start({"run", "scene.toml", "--out", out, "--quiet", "--set", "simulation.end_time=1"});
    while (!fs::exists(directory / out / "vtp/frame_0003.vtp") &&
           wait_for(child, std::chrono::milliseconds(1)) == still_running) {
    }
    kill(child, request);
    EXPECT_EQ(wait_for(child, std::chrono::minutes(1)), 130) << errors();
    EXPECT_EQ(checkpoints(out).size(), 1u);
    EXPECT_EQ(json(directory / out / "summary.json").get<std::string>("status"), "interrupted");
    ASSERT_EQ(run("--out " + out + " --resume --set simulation.end_time=1").status, 0);
    EXPECT_THAT(differences("whole", out), IsEmpty());
  }
}

TEST_F(Resume, AFullDiskCostsTheCheckpointAndNotTheRun) {
  ASSERT_EQ(run("--out it --frames 3 --set 'output.formats=[]'").status, 0);
  const auto before = checkpoints("it");
  ASSERT_EQ(before.size(), 1u);
  // no file grows beyond 16 KiB: a checkpoint would, the others do not
  const Outcome full = run("--out it --resume --set 'output.formats=[]'", "prlimit --fsize=16384");
  EXPECT_EQ(full.status, 0) << full.err;
  EXPECT_THAT(full.err, AllOf(HasSubstr("warning: there is no checkpoint of step"), HasSubstr("File too large")));
  EXPECT_EQ(checkpoints("it"), before);
  EXPECT_EQ(run("--out it --resume --set 'output.formats=[]'").status, 0);
}

TEST_F(Resume, APlaceForCheckpointsThatIsNoDirectoryIsNamed) {
  ASSERT_EQ(run("--out it --frames 3").status, 0);
  fs::remove_all(directory / "it/checkpoints");
  std::ofstream(directory / "it/checkpoints") << "a file where the directory should be";
  for (const char* resume : {"", " --resume"}) {
    const Outcome blocked = run(std::string("--out it --frames 3") + resume);
    EXPECT_EQ(blocked.status, 2);
    EXPECT_THAT(blocked.err, AllOf(HasSubstr("it/checkpoints"), HasSubstr("Not a directory")));
  }
}

TEST_F(Resume, CheckpointsThatVanishOnTheWayAreMissedAndMadeAgain) {
  const pid_t child = start({"run", "scene.toml", "--out", "it", "--quiet", "--set", "simulation.end_time=0.5", "--set",
                             "output.checkpoint.frames=1"});
  while (checkpoints("it").empty() && wait_for(child, std::chrono::milliseconds(1)) == still_running) {
  }
  fs::remove_all(directory / "it/checkpoints");
  EXPECT_EQ(wait_for(child, std::chrono::minutes(1)), 0) << errors();
  EXPECT_EQ(checkpoints("it").size(), 2u);
}

TEST_F(Resume, TimesOfCheckpointsAreReadLikeTheRestOfTheScene) {
  const Outcome wrong = run("--out it --set output.checkpoint.frames=-1 --set output.checkpoint.seconds=-1");
  EXPECT_EQ(wrong.status, 2);
  EXPECT_THAT(wrong.err, AllOf(HasSubstr("--set output.checkpoint.frames"), HasSubstr("--set output.checkpoint.seconds")));
  const Outcome unknown = run("--out it --set output.checkpoint.second=1");
  EXPECT_EQ(unknown.status, 2);
  EXPECT_THAT(unknown.err, HasSubstr("did you mean 'seconds'"));
  ASSERT_EQ(run("--out it --set output.checkpoint.frames=3 --set output.checkpoint.seconds=0").status, 0);
  EXPECT_THAT(contents(directory / "it/scene.toml"), HasSubstr("[output.checkpoint]\nframes = 3\nseconds = 0.0"));
  EXPECT_THAT(checkpoints("it"), testing::ElementsAre(directory / "it/checkpoints/step_000000000027.checkpoint",
                                                      directory / "it/checkpoints/step_000000000030.checkpoint"))
      << "of frame 9, and of the end";
}

TEST_F(Resume, AnEndBeforeTheCheckpointIsRefused) {
  ASSERT_EQ(run("--out it").status, 0);
  const Outcome earlier = run("--out it --resume --set simulation.end_time=0.05");
  EXPECT_EQ(earlier.status, 2);
  EXPECT_THAT(earlier.err, HasSubstr("simulation.end_time is 0.05 s"));
}

TEST_F(Resume, NothingToResumeIsAUsageError) {
  EXPECT_EQ(cleave("run").status, 2);
  EXPECT_EQ(cleave("run --resume").status, 2);
  const Outcome nowhere = cleave("run --resume --out nowhere");
  EXPECT_EQ(nowhere.status, 2);
  EXPECT_THAT(nowhere.err, HasSubstr("nowhere/scene.toml"));
}

TEST_F(Resume, AFailedRunKeepsTheStateBeforeTheStepThatFailed) {
  // steps far above what elastic waves allow, which no halving makes up for
  std::string text = scene;
  text.replace(text.find("gravity"), 0, "time_step = 2e-3\n");
  text.replace(text.find("youngs_modulus = 1e5"), 20, "youngs_modulus = 1e9");
  text.replace(text.find("velocity = [0, -1]"), 18, "velocity = [0, -50]");
  text.replace(text.find("center = [0, 0.6]"), 17, "center = [0, 0.8]");
  write("scene.toml", text);
  const Outcome failed = run("--out it");
  ASSERT_EQ(failed.status, 3) << failed.err;
  EXPECT_THAT(failed.err, HasSubstr("the state before the step that failed is in it/checkpoints/step_"));
  ASSERT_EQ(checkpoints("it").size(), 1u);
  const std::string failure = contents(directory / "it/failure.txt");
  const std::string step = failure.substr(5, failure.find(' ', 5) - 5);
  EXPECT_THAT(checkpoints("it")[0].string(), HasSubstr(std::string(12 - step.size(), '0') + step + ".checkpoint"));
  const Outcome again = run("--out it --resume");
  EXPECT_EQ(again.status, 3);
  EXPECT_EQ(contents(directory / "it/failure.txt"), failure);
}

}  // namespace
}  // namespace cleave::test
