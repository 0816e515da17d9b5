#include "app/study_command.hpp"

#include "bench/gnuplot.hpp"
#include "common/error.hpp"
#include "output/atomic_file.hpp"
#include "study/execute.hpp"
#include "study/results.hpp"
#include "study/scheduler.hpp"

#include <fmt/format.h>
#include <CLI/CLI.hpp>

#include <charconv>
#include <cstdio>

namespace cleave::app {
namespace {

namespace fs = std::filesystem;
using study::Plan;
using study::Study;

void write(const fs::path& path, const std::string& text) {
  output::AtomicFile file(path);
  file.stream() << text;
  file.commit();
}

/// "3" or "3:7", counted from 1, as indices.
std::vector<std::size_t> chosen(const std::string& text, std::size_t count) {
  const auto colon = text.find(':');
  const std::string first_text = text.substr(0, colon),
                    last_text = colon == std::string::npos ? first_text : text.substr(colon + 1);
  std::size_t first = 0, last = 0;
  const auto read = [](const std::string& digits, std::size_t& number) {
    const auto [end, problem] = std::from_chars(digits.data(), digits.data() + digits.size(), number);
    return problem == std::errc() && end == digits.data() + digits.size();
  };
  if (!read(first_text, first) || !read(last_text, last) || first < 1 || last < first || last > count)
    throw InputError(
        fmt::format("--run {}: error: expected the number of a run or two of them, as 3 or 3:7; this study has the "
                    "runs 1 to {}",
                    text, count));
  std::vector<std::size_t> indices;
  for (std::size_t i = first; i <= last; ++i) indices.push_back(i - 1);
  return indices;
}

void print_runs(const Plan& plan, const fs::path& out) {
  const std::size_t width = std::to_string(plan.runs.size()).size();
  for (std::size_t i = 0; i < plan.runs.size(); ++i) {
    const study::Run& run = plan.runs[i];
    const auto record = study::read_record(study::record_of(out, run));
    fmt::print("{:>{}}  {}{}\n", i + 1, width, run.what,
               record              ? fmt::format("  ({})", word_of(record->outcome))
               : run.scene.empty() ? "  (the scene is refused)"
                                   : "");
  }
}

/// Draws what can be drawn; gives the charts as SVG.
std::vector<std::pair<study::Chart, std::string>> draw(const std::vector<study::Chart>& charts, const fs::path& out) {
  std::vector<std::pair<study::Chart, std::string>> drawn;
  if (!bench::gnuplot_is_installed()) {
    fmt::print(stderr,
               "warning: no charts were drawn: gnuplot is not installed (on Debian: apt install gnuplot-nox); once it is, "
               "--collect draws them\n");
    return drawn;
  }
  for (const study::Chart& chart : charts) {
    const std::string svg =
        bench::draw_svg("set terminal svg noenhanced size 1000,560 font 'Helvetica,13' background 'white'\n" + chart.script);
    write(out / (chart.name + ".svg"), svg);
    write(out / (chart.name + ".png"),
          bench::draw_png(
              "set terminal pngcairo noenhanced size 1500,840 font 'Helvetica,13' fontscale 1.35 background 'white'\n" +
              chart.script));
    drawn.emplace_back(chart, svg);
  }
  return drawn;
}

void report(const Study& study, const Plan& plan, const StudyOptions& options, const fs::path& out) {
  const study::Results results = study::collect(study, plan, out);
  const auto drawn = draw(study::charts(study, plan, results), out);
  write(out / "results.csv", study::results_csv(study, plan, results));
  write(out / "results.json", study::results_json(study, plan, results, out));
  write(out / "report.html", study::report_html(study, plan, results, drawn, out));
  if (!options.charts.empty()) {
    fs::create_directories(options.charts);
    for (const auto& [chart, svg] : drawn)
      write(options.charts / fmt::format("{}_{}.svg", study.file.stem().string(), chart.name), svg);
  }
  fmt::print("\n{}\n", study::results_text(study, plan, results));
  for (const char* name : {"results.csv", "results.json", "report.html"}) fmt::print("  {}\n", (out / name).string());
  for (const auto& [chart, svg] : drawn) fmt::print("  {0}.svg, {0}.png\n", (out / chart.name).string());
  std::fflush(stdout);
}

/// Whoever runs what is left; empty: this program.
std::optional<study::Scheduler> scheduler_of(const StudyOptions& options) {
  if (options.jobs == "slurm") return study::Scheduler::slurm;
  if (options.jobs == "parallel") return study::Scheduler::parallel;
  return std::nullopt;
}

/// A word for --jobs is right, or why it is not.
std::string check_jobs(const std::string& text) {
  int number = 0;
  const auto [end, problem] = std::from_chars(text.data(), text.data() + text.size(), number);
  const bool counts = problem == std::errc() && end == text.data() + text.size() && number >= 1 && number <= 1024;
  return counts || text == "slurm" || text == "parallel"
             ? ""
             : "'" + text + "' is no number from 1 to 1024, and neither slurm nor parallel";
}

/// False if interrupted.
bool one_study(const fs::path& file, const StudyOptions& options, const plugins::Registry& registry, const fs::path& out) {
  const Study study = study::load_study(file, options.values, *config::catalog_of(registry));
  const Plan plan = study::make_plan(study, registry);
  fmt::print("{}: {} points, {} runs\n", study.title, plan.points.size(), plan.runs.size());
  std::fflush(stdout);
  if (options.dry_run) {
    print_runs(plan, out);
    return true;
  }
  study::ExecuteOptions execute;
  execute.out = out;
  const auto scheduler = scheduler_of(options);
  if (!scheduler) execute.jobs = std::stoi(options.jobs);
  if (!options.collect)
    execute.runs = options.runs.empty() ? chosen(fmt::format("1:{}", plan.runs.size()), plan.runs.size())
                                        : chosen(options.runs, plan.runs.size());
  std::vector<std::size_t> left;
  for (const std::size_t i : execute.runs) {
    const auto record = study::read_record(study::record_of(out, plan.runs[i]));
    if (!record || !record->complete(study.repetitions, study.time_limit, study.instructions)) left.push_back(i);
  }
  const std::size_t kept = execute.runs.size() - left.size();
  if (kept > 0) fmt::print("{} runs are finished already\n", kept);
  if (scheduler && !left.empty()) {
    const study::HandOver work{*scheduler, out, file, options.values, study.threads, left, options.machines};
    fmt::print("{} runs go to {} by {}\n", left.size(), options.jobs, study::script_of(work).string());
    std::fflush(stdout);
    if (study::hand_over(work) == study::Executed::interrupted) {
      fmt::print(stderr, "interrupted; {}the same command goes on with what is not finished\n",
                 *scheduler == study::Scheduler::slurm ? "jobs that Slurm has go on, scancel ends them; later " : "");
      return false;
    }
    execute.runs.clear();
  }
  std::size_t finished = kept;
  execute.finished = [&](std::size_t index, const study::Record& record) {
    fmt::print("[{}/{}] {}: {}{}\n", ++finished, execute.runs.size(), plan.runs[index].what, word_of(record.outcome),
               record.outcome == study::Outcome::done ? fmt::format(", {:.3g} s", record.wall()) : ", " + record.reason);
    std::fflush(stdout);
  };
  if (study::execute(study, plan, execute) == study::Executed::interrupted) {
    fmt::print(stderr, "interrupted; the same command goes on with what is not finished\n");
    return false;
  }
  if (options.runs.empty()) report(study, plan, options, out);
  return true;
}

}  // namespace

void add_study_options(CLI::App& cli, StudyOptions& options) {
  cli.add_option("study", options.studies, "Study files (TOML)")->required();
  cli.add_option("--out", options.out,
                 "Directory for the results (default: out/<study name>; of several studies: the "
                 "directory of theirs)");
  auto* jobs = cli.add_option("--jobs", options.jobs,
                              "Runs at a time (default: 1; more disturb each other's times), or who runs them: slurm, as a job "
                              "array, or parallel, GNU parallel")
                   ->check(check_jobs);
  cli.add_option("--sshlogin", options.machines,
                 "With --jobs parallel: file of the machines that share the directory, as GNU parallel reads it")
      ->check(CLI::ExistingFile)
      ->needs(jobs);
  cli.add_option("--value", options.values, "A further value of an axis: axis=value (repeatable)")->allow_extra_args(false);
  auto* dry_run = cli.add_flag("--dry-run", options.dry_run, "List the runs with their numbers, and run none");
  auto* run = cli.add_option("--run", options.runs,
                             "Only the run of this number, or of two with those between, as 3:7, without "
                             "charts");
  auto* collect = cli.add_flag("--collect", options.collect, "Run nothing, make tables and charts of what is finished");
  cli.add_option("--charts", options.charts, "Also write the charts into this directory, as <study name>_<chart>.svg");
  run->excludes(dry_run)->excludes(collect);
  collect->excludes(dry_run);
}

int study_command(const StudyOptions& options, const plugins::Registry& registry) {
  const bool several = options.studies.size() > 1;
  if (several && !options.values.empty()) throw InputError("--value: error: goes with one study");
  if (!options.machines.empty() && options.jobs != "parallel") throw InputError("--sshlogin: error: goes with --jobs parallel");
  if (!options.runs.empty() && scheduler_of(options))
    throw InputError("--run: error: does not go with --jobs " + options.jobs + ", which picks the runs itself");
  for (const fs::path& file : options.studies) {
    const fs::path out = options.out.empty() ? fs::path("out") / file.stem()
                         : several           ? options.out / file.stem()
                                             : options.out;
    if (!one_study(file, options, registry, out)) return 130;
  }
  return 0;
}

}  // namespace cleave::app
