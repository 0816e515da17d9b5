// Directed bonds per second of processor time and bytes per directed bond, one thread:
//
//   peridynamics_benchmark [POINTS_ALONG_AN_EDGE [REPETITIONS]]
//
// A cube of jittered points with a horizon of 2.87 spacings and thus some 154 neighbours, strained and sheared a little. Then
// the forces of a step of brittle glass on two threads, contact included, by the clock on the wall: with 67 points along an
// edge the body is as large as the glass wall of Chen et al. 2018, 3e5 points.

#include "contact.hpp"

#include <malloc.h>
#include <time.h>

#include <atomic>
#include <chrono>
#include <cstdio>
#include <cstdlib>
#include <random>
#include <thread>

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

double wall_seconds() { return std::chrono::duration<double>(std::chrono::steady_clock::now().time_since_epoch()).count(); }

std::size_t bytes_in_use() {
  const auto info = mallinfo2();
  return info.uordblks + info.hblkhd;
}

void for_ranges(void*, std::uint64_t size, std::uint64_t grain, void (*work)(void*, std::uint64_t, std::uint64_t), void* data) {
  std::atomic<std::uint64_t> next = 0;
  const auto help = [&] {
    for (std::uint64_t first; (first = next.fetch_add(grain)) < size;) work(data, first, std::min(first + grain, size));
  };
  std::thread other(help);
  help();
  other.join();
}

/// Forces of bonds and contact, a hundredth of the points so far apart from the others that their bonds have broken.
void time_wall(cleave_body body, const Cube& cube, int repetitions) {
  const cleave_threads pool{sizeof pool, 2, nullptr, &for_ranges};
  const Threads threads(&pool);
  body.threads = &pool;
  Material glass;
  glass.shear = 2e10;
  glass.bulk = 3.3e10;
  glass.horizon = 2.87;
  glass.precision = Precision::single_precision;
  glass.critical_stretch = 5e-4;
  const std::size_t before = bytes_in_use();
  const double start = wall_seconds();
  const auto solid = make_solid(glass, body);
  const double made = wall_seconds() - start;
  const std::size_t n = cube.volume.size(), bytes = bytes_in_use() - before;
  Contact contact(0.9, glass.bulk, 3);
  std::vector<double> x = cube.position, force(3 * n), energy(n), dilatation(n), damage(n), seconds, processor;
  const Contact::Body bodies[] = {{0, n, body.spacing, solid.get()}};
  for (int r = 0; r <= repetitions; ++r) {
    const double begin = wall_seconds(), processor_begin = processor_seconds();
    solid->evaluate(threads, x, {force, energy, dilatation, damage, {}});
    contact.push(threads, bodies, x, damage, force);
    seconds.push_back(wall_seconds() - begin);
    processor.push_back(processor_seconds() - processor_begin);
    if (r > 0) continue;
    for (std::size_t i = 0; i < n / 100; ++i) x[3 * i] += 1e-3 * body.spacing * double(i % 2);
  }
  for (auto* times : {&seconds, &processor}) std::sort(times->begin() + 1, times->end());
  const double bonds = double(solid->directed_bonds());
  std::printf(
      "glass of %zu points and %.0f directed bonds: %.3f s per step on two threads, %.3f s of their processor time; made in "
      "%.1f s; %.1f B per directed bond with all that is kept per point\n",
      n, bonds, seconds[1 + std::size_t(repetitions) / 2], processor[1 + std::size_t(repetitions) / 2], made,
      double(bytes) / bonds);
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
  time_wall(body, cube, repetitions);
}
