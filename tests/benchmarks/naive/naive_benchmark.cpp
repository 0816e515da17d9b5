// Whole steps, single precision, neo-Hookean, against the plain loop: one thread each, by turns, in time of the thread, so that
// the ratio means something on any machine, also on a busy one.
//
// With --only and --steps, one of the two alone: the difference of two runs under valgrind --tool=callgrind, which needs
// CLEAVE_ISA=x86-64-v3, are the instructions of the steps.

#include "pair.hpp"

#include <fmt/format.h>
#include <tbb/global_control.h>

#include <CLI/CLI.hpp>
#include <algorithm>
#include <ctime>

namespace {

double thread_seconds() {
  timespec t;
  clock_gettime(CLOCK_THREAD_CPUTIME_ID, &t);
  return double(t.tv_sec) + 1e-9 * double(t.tv_nsec);
}

double median(std::vector<double> values) {
  std::sort(values.begin(), values.end());
  return values[values.size() / 2];
}

}  // namespace

int main(int argc, char** argv) {
  using namespace cleave;
  CLI::App cli{"Whole steps against a plain scalar loop, one thread"};
  double million = 1;
  int steps = 20, repetitions = 7;
  std::string only;
  cli.add_option("--particles", million, "in millions")->check(CLI::PositiveNumber);
  cli.add_option("--steps", steps, "per repetition")->check(CLI::PositiveNumber);
  cli.add_option("--repetitions", repetitions)->check(CLI::PositiveNumber);
  cli.add_option("--only", only)->check(CLI::IsMember({"host", "plain"}));
  CLI11_PARSE(cli, argc, argv);

  tbb::global_control one_thread(tbb::global_control::max_allowed_parallelism, 1);
  plugins::Registry registry(plugins::Registry::default_search_path());
  const config::Scene scene = naive::block_scene(million);
  const auto simulation = mpm::Simulation::create(scene, registry);
  naive::Twin twin(scene, *simulation, steps * repetitions);

  const double work = 1e-6 * double(simulation->particles()) * steps;
  std::vector<double> host, plain, ratio;  // Mp/s
  for (int r = 0; r < repetitions; r++) {
    const auto run = [&](const char* which, std::vector<double>& rates, auto&& step) {
      if (!only.empty() && only != which) return;
      const double start = thread_seconds();
      for (int i = 0; i < steps; i++) step();
      rates.push_back(work / (thread_seconds() - start));
    };
    run("host", host, [&] { simulation->step(1e6); });
    run("plain", plain, [&] { twin.step(); });
    if (only.empty()) ratio.push_back(host.back() / plain.back());
  }
  fmt::print("{} particles, medians of {} repetitions of {} steps, one thread\n", simulation->particles(), repetitions, steps);
  if (!host.empty()) fmt::print("  host  {:6.2f} Mp/s  ({})\n", median(host), simulation->isa());
  if (!plain.empty()) fmt::print("  plain {:6.2f} Mp/s  ({})\n", median(plain), twin.isa());
  if (!ratio.empty())
    fmt::print("  ratio {:6.2f}, {:.2f} to {:.2f}\n", median(ratio), *std::min_element(ratio.begin(), ratio.end()),
               *std::max_element(ratio.begin(), ratio.end()));
}
