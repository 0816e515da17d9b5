// Throughput of whole explicit steps through run-time loaded plugins: a spinning, falling block of one million particles,
// 8 per cell (2D: 4), cells of 1/128 m, about 0.05 cells of motion per step. Prints the median of several repetitions.

#include "config/scene.hpp"
#include "mpm/simulation.hpp"
#include "plugins/registry.hpp"

#include <fmt/format.h>
#include <tbb/global_control.h>

#include <CLI/CLI.hpp>
#include <algorithm>
#include <chrono>

int main(int argc, char** argv) {
  using namespace cleave;
  CLI::App cli{"Throughput of explicit steps"};
  int dimension = 3, threads = 2, steps = 40, repetitions = 5;
  double million = 1;
  std::string precision = "single";
  std::vector<std::string> laws = {"elasticity/split-neo-hookean", "elasticity/fixed-corotated"};
  cli.add_option("--dimension", dimension)->check(CLI::IsMember({2, 3}));
  cli.add_option("--threads", threads);
  cli.add_option("--steps", steps, "per repetition");
  cli.add_option("--repetitions", repetitions);
  cli.add_option("--particles", million, "in millions");
  cli.add_option("--precision", precision)->check(CLI::IsMember({"single", "double"}));
  cli.add_option("--elasticity", laws, "plugins, one after the other");
  CLI11_PARSE(cli, argc, argv);

  tbb::global_control limit(tbb::global_control::max_allowed_parallelism, std::size_t(threads));
  plugins::Registry registry(plugins::Registry::default_search_path());
  for (const auto& law : laws) {
    config::Scene scene;
    auto& s = scene.simulation;
    s.dimension = dimension;
    s.cell_size = 1.0 / 128;
    s.end_time = 1e9;
    s.precision = precision == "single" ? config::Precision::single_precision : config::Precision::double_precision;
    s.gravity = dimension == 3 ? Vector3(0, 0, -1) : Vector3(0, -1, 0);
    config::Material m;
    m.name = "material";
    m.density = 1000;
    m.elasticity.id = law;
    m.elasticity.parameters = {{"youngs_modulus", 1e5}, {"poissons_ratio", 0.3}};
    scene.materials.push_back(m);
    config::Body b;
    b.name = "block";
    b.material = "material";
    b.sampling.particles_per_cell = dimension == 3 ? 8 : 4;
    const double edge = std::pow(million * 1e6 / b.sampling.particles_per_cell, 1.0 / dimension) * s.cell_size;
    b.shape = scene::ShapeSpec{};
    b.shape->size = Vector3::Constant(edge);
    b.velocity = Vector3(0.8, 0.4, dimension == 3 ? -0.7 : 0);
    b.spin.angular_velocity = Vector3(0, 0, 2);
    scene.bodies.push_back(b);

    auto simulation = mpm::Simulation::create(scene, registry);
    for (int i = 0; i < 5; i++) simulation->step(1e6);
    const auto stages_before = simulation->stage_seconds();
    std::vector<double> rates;
    for (int r = 0; r < repetitions; r++) {
      const auto start = std::chrono::steady_clock::now();
      for (int i = 0; i < steps; i++) simulation->step(1e6);
      const double seconds = std::chrono::duration<double>(std::chrono::steady_clock::now() - start).count();
      rates.push_back(double(simulation->particles()) * steps / seconds * 1e-6);
    }
    std::sort(rates.begin(), rates.end());
    fmt::print("{} {}D {} {} thread{} {} {} particles: median {:.1f} Mp/s, best {:.1f}; ns per particle and step:", law,
               dimension, precision, threads, threads == 1 ? "" : "s", simulation->isa(), simulation->particles(),
               rates[rates.size() / 2], rates.back());
    const auto stages = simulation->stage_seconds();
    for (std::size_t i = 0; i < stages.size(); i++)
      fmt::print(" {} {:.2f}", stages[i].first,
                 (stages[i].second - stages_before[i].second) * 1e9 / (double(simulation->particles()) * steps * repetitions));
    fmt::print("\n");
  }
}
