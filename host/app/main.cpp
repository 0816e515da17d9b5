#include "app/advise_command.hpp"
#include "app/bench_command.hpp"
#include "app/check_command.hpp"
#include "app/command_line.hpp"
#include "app/new_plugin_command.hpp"
#include "app/plugins_command.hpp"
#include "app/point_command.hpp"
#include "app/render_command.hpp"
#include "app/report_command.hpp"
#include "app/run_command.hpp"
#include "app/study_command.hpp"
#include "app/trust_options.hpp"
#include "app/validate_command.hpp"
#include "common/error.hpp"
#include "plugins/isa.hpp"

#include <fmt/format.h>
#include <spdlog/sinks/stdout_color_sinks.h>
#include <spdlog/spdlog.h>
#include <CLI/CLI.hpp>

#include <cstdio>
#include <exception>
#include <new>

int main(int argc, char** argv) {
  using namespace cleave;
  spdlog::set_default_logger(spdlog::stderr_color_mt("cleave"));
  spdlog::set_pattern("%^%l%$: %v");

  CLI::App cli{"Cleave simulates solids that tear, shatter and split, with every material law a plugin."};
  cli.set_version_flag("--version", app::build_facts, "Print the version and the facts of this build, and exit");
  cli.require_subcommand(1);
  cli.failure_message([](const CLI::App* app, const CLI::Error& error) {
    if (error.get_name() == "RequiredError" && app->get_subcommands().empty()) return app->help();
    return std::string("error: ") + error.what() + "\nsee cleave --help and cleave COMMAND --help\n";
  });

  int status = 0;
  const auto registry = [] { return plugins::Registry(plugins::Registry::default_search_path()); };

  app::RunOptions run;
  auto* run_cli = cli.add_subcommand("run", "Simulate a scene");
  auto* run_scene = run_cli->add_option("scene", run.scene, "Scene file (TOML); with --resume also a directory with results");
  run_cli->add_option("--out", run.out, "Directory for the results (default: out/<scene name>)");
  run_cli->add_option("--threads", run.threads, "Number of threads (default: all)")->check(CLI::Range(1, 1024));
  run_cli->add_option("--frames", run.frames, "Stop after this many frames")->check(CLI::Range(0, 2000000000));
  run_cli->add_option("--steps", run.steps, "Stop after this many steps")->check(CLI::Range(0, 2000000000));
  run_cli->add_option("--set", run.sets, "Change a value of the scene: path=value (repeatable)")->allow_extra_args(false);
  run_cli->add_flag("--quiet", run.quiet, "Print nothing but errors");
  run_cli->add_flag("--preview{1}", run.preview, "Draw frames while it runs, into the folder preview; --preview=N: every N-th");
  run_cli->add_flag("--resume", run.resume, "Go on from the newest checkpoint, from the beginning if there is none");
  run_cli->add_flag("--resume-anyway", run.resume_anyway,
                    "The same, also where the program, a plugin or the instruction set is another one");
  run_cli->callback([&] {
    run.resume = run.resume || run.resume_anyway;
    if (run_scene->empty() && !(run.resume && !run.out.empty())) throw CLI::RequiredError("scene");
    auto r = registry();
    status = app::run_command(run, r);
  });

  std::filesystem::path validate_scene;
  std::vector<std::string> validate_sets;
  auto* validate_cli = cli.add_subcommand("validate", "Check a scene completely without running it");
  validate_cli->add_option("scene", validate_scene, "Scene file (TOML)")->required();
  validate_cli->add_option("--set", validate_sets, "Change a value of the scene: path=value (repeatable)")
      ->allow_extra_args(false);
  validate_cli->callback([&] { status = app::validate_command(validate_scene, validate_sets, registry()); });

  app::PluginsOptions list;
  auto* plugins_cli = cli.add_subcommand("plugins", "List the plugins, or describe one");
  plugins_cli->add_option("id", list.id, "Plugin to describe, for example elasticity/split-neo-hookean")->type_name("PLUGIN");
  plugins_cli->add_flag("--json", list.json, "Machine-readable output");
  plugins_cli->add_flag("--markdown", list.markdown, "A reference page: parameters, units, defaults, bounds, state");
  plugins_cli->add_flag("--explain", list.explain, "Also say where plugins were looked for and what was refused, and why");
  plugins_cli->callback([&] { status = app::plugins_command(list); });

  app::PointOptions point;
  auto* point_cli = cli.add_subcommand("point", "Drive material points without a simulation");
  app::add_point_options(*point_cli, point);
  point_cli->callback([&] {
    auto r = registry();
    status = app::point_command(point, r);
  });

  app::BenchOptions bench;
  auto* bench_cli = cli.add_subcommand("bench", "Measure the program");
  bench_cli->require_subcommand(1);
  auto* kernels_cli = bench_cli->add_subcommand("kernels", "Time per point of the material laws");
  app::add_bench_options(*kernels_cli, bench);
  kernels_cli->callback([&] {
    auto r = registry();
    status = app::bench_command(bench, r);
  });

  app::BenchStepsOptions bench_steps;
  auto* steps_cli = bench_cli->add_subcommand("steps", "Whole steps per second, of blocks of every material or of a scene");
  app::add_bench_steps_options(*steps_cli, bench_steps);
  steps_cli->callback([&] {
    auto r = registry();
    status = app::bench_steps_command(bench_steps, r);
  });

  app::BenchHaloOptions bench_halo;
  auto* halo_cli =
      bench_cli->add_subcommand("halo", "What the parts of a scene would exchange if it were divided among processes");
  app::add_bench_halo_options(*halo_cli, bench_halo);
  halo_cli->callback([&] {
    auto r = registry();
    status = app::bench_halo_command(bench_halo, r);
  });

  app::CheckOptions check;
  auto* check_cli = cli.add_subcommand("check", "Prove plugins: run the conformance checks");
  app::add_check_options(*check_cli, check);
  check_cli->callback([&] { status = app::check_command(check); });

  app::AdviseOptions advise;
  auto* advise_cli = cli.add_subcommand("advise", "Say what a scene would be better for, from bounds and recorded costs");
  app::add_advise_options(*advise_cli, advise);
  advise_cli->callback([&] { status = app::advise_command(advise, registry()); });

  app::StudyOptions study;
  auto* study_cli = cli.add_subcommand("study", "Speed against accuracy, and maps of stability, over many runs of a scene");
  app::add_study_options(*study_cli, study);
  study_cli->callback([&] { status = app::study_command(study, registry()); });

  app::RenderOptions render;
  auto* render_cli = cli.add_subcommand("render", "Draw pictures of a run");
  app::add_render_options(*render_cli, render);
  render_cli->callback([&] { status = app::render_command(render, registry()); });

  app::ReportOptions report;
  auto* report_cli = cli.add_subcommand("report", "Write one HTML page of all that is known of a run");
  app::add_report_options(*report_cli, report);
  report_cli->callback([&] { status = app::report_command(report); });

  app::NewPluginOptions project;
  auto* new_plugin_cli = cli.add_subcommand("new-plugin", "Write a project for a plugin: source, tests, scene and build");
  new_plugin_cli->add_option("kind", project.kind, "elasticity, plasticity, damage, constraint or discretization")->required();
  new_plugin_cli->add_option("name", project.name, "Name of the plugin, for example my-law")->required();
  new_plugin_cli->add_option("--dir", project.directory, "Directory to write into (default: ./NAME)");
  new_plugin_cli->callback([&] { status = app::new_plugin_command(project); });

  std::string shell;
  auto* completion_cli = cli.add_subcommand("completion", "Print what a shell completes commands, options and plugins with");
  completion_cli->add_option("shell", shell, "bash (also for zsh, with bashcompinit) or fish")
      ->required()
      ->check(CLI::IsMember({"bash", "fish"}));
  completion_cli->callback([&] { fmt::print("{}", shell == "bash" ? app::bash_completion(cli) : app::fish_completion(cli)); });
  auto* manual_cli = cli.add_subcommand("manual", "Print the manual page (roff)")->group("");
  manual_cli->callback([&] { fmt::print("{}", app::manual(cli)); });

  // Before the name of a command or after it; options take effect before any command runs.
  for (CLI::App* command :
       {&cli, run_cli, point_cli, bench_cli, kernels_cli, steps_cli, halo_cli, check_cli, advise_cli, study_cli})
    command->add_option_function<std::string>("--isa", plugins::force_isa,
                                              "Instruction set of kernels and plugins: x86-64-v2, x86-64-v3 or x86-64-v4 "
                                              "(default: the best one that CLEAVE_ISA or the processor allows)");
  for (CLI::App* command : {&cli, run_cli, validate_cli, plugins_cli, point_cli, bench_cli, kernels_cli, steps_cli, halo_cli,
                            check_cli, advise_cli, study_cli, render_cli})
    app::add_trust_options(*command);

  try {
    cli.parse(argc, argv);
  } catch (const CLI::ParseError& e) {
    const int code = cli.exit(e);
    return code == 0 ? 0 : 2;
  } catch (const InputError& e) {
    std::fflush(stdout);
    fmt::print(stderr, "{}\n", e.what());
    return 2;
  } catch (const SimulationError& e) {
    std::fflush(stdout);
    fmt::print(stderr, "error: {}\n", e.what());
    return 3;
  } catch (const std::bad_alloc&) {
    std::fflush(stdout);
    fmt::print(stderr, "error: there is not enough memory; use larger cells or smaller bodies, or a machine with more\n");
    return 2;
  } catch (const std::exception& e) {
    std::fflush(stdout);
    fmt::print(stderr, "error: {}\n", e.what());
    return 1;
  }
  return status;
}
