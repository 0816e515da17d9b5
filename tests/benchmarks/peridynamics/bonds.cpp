// Directed bonds per second of processor time and bytes per directed bond, one thread:
//
//   peridynamics_benchmark [POINTS_ALONG_AN_EDGE [REPETITIONS]]
//
// A cube of jittered points with a horizon of 2.87 spacings and thus some 154 neighbours, strained and sheared a little.

#include "solid.hpp"

#include <time.h>

#include <cstdio>
#include <cstdlib>
#include <random>

namespace {
using namespace cleave;
using namespace cleave::peridynamics;

double processor_seconds() {
  timespec t;
  clock_gettime(CLOCK_PROCESS_CPUTIME_ID, &t);
  return double(t.tv_sec) + 1e-9 * double(t.tv_nsec);
}

struct Cube {
  std::vector<double> position, volume, velocity;

  explicit Cube(int edge) {
    std::mt19937 random(3);
    std::uniform_real_distribution<double> jitter(-0.15, 0.15);
    for (int i = 0; i < edge; ++i)
      for (int j = 0; j < edge; ++j)
        for (int k = 0; k < edge; ++k) {
          for (const int at : {i, j, k}) position.push_back(0.01 * (at + jitter(random)));
          volume.push_back(1e-6);
        }
    velocity.resize(position.size());
  }
};

/// Median of the processor time of a step, s.
double time_of(Solid& solid, const Cube& cube, int repetitions) {
  const std::size_t n = cube.volume.size();
  std::vector<double> x = cube.position, force(3 * n), energy(n), dilatation(n), damage(n), plastic(n), seconds;
  for (std::size_t i = 0; i < n; ++i) {
    const double sheared = 1e-4 * x[3 * i + 1];
    for (std::size_t a = 0; a < 3; ++a) x[3 * i + a] *= 1 + 1e-4 * double(a);
    x[3 * i] += sheared;
  }
  for (int r = 0; r <= repetitions; ++r) {
    const double start = processor_seconds();
    solid.evaluate(Threads(), x, {force, energy, dilatation, damage, plastic});
    seconds.push_back(processor_seconds() - start);
  }
  std::nth_element(seconds.begin() + 1, seconds.begin() + 1 + repetitions / 2, seconds.end());
  return seconds[1 + std::size_t(repetitions) / 2];
}

}  // namespace

int main(int argc, char** argv) {
  const int edge = argc > 1 ? std::atoi(argv[1]) : 67, repetitions = argc > 2 ? std::atoi(argv[2]) : 9;
  if (edge < 2 || repetitions < 1) {
    std::fprintf(stderr, "usage: peridynamics_benchmark [POINTS_ALONG_AN_EDGE [REPETITIONS]], at least 2 and 1\n");
    return 2;
  }
  const Cube cube(edge);
  cleave_body body{};
  body.struct_size = sizeof body;
  body.dimension = 3;
  body.density = 1000;
  body.spacing = 0.01;
  body.point_count = cube.volume.size();
  body.position = cube.position.data();
  body.velocity = cube.velocity.data();
  body.volume = cube.volume.data();
  std::printf("%-34s %9s %12s %12s %10s\n", "bonds", "points", "directed", "Mbonds/s", "B/bond");
  for (const bool single : {true, false})
    for (const int what : {0, 1, 2, 3}) {
      constexpr const char* names[] = {"elastic, breaking", "and plastic", "and toughened", "as published"};
      Material material;
      material.shear = 1e5;
      material.bulk = 2e5;
      material.horizon = 2.87;
      material.precision = single ? Precision::single_precision : Precision::double_precision;
      material.critical_stretch = 0.1;
      material.plastic_limit = 0.2;
      if (what > 0) material.yield = 1e24;
      if (what > 1) material.toughening = 1;
      if (what > 2) material.split = Split::published;
      const double start = processor_seconds();
      const auto solid = make_solid(material, body);
      const double made = processor_seconds() - start, seconds = time_of(*solid, cube, repetitions);
      std::printf("%-7s%-27s %9zu %12zu %12.0f %10zu   (made in %.1f s)\n", single ? "single " : "double ", names[what],
                  cube.volume.size(), std::size_t(solid->directed_bonds()), 1e-6 * double(solid->directed_bonds()) / seconds,
                  std::size_t(solid->bytes_per_directed_bond()), made);
    }
}
