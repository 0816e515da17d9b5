#include <cleave/testkit/grid_system.hpp>

#include <cleave/testkit/check.hpp>

#include <algorithm>
#include <cmath>
#include <map>

namespace cleave::testkit {
namespace {

using Vector = std::array<double, 3>;

Vector random_direction(Random& random, int dimension) {
  if (dimension == 2) {
    const double angle = random.uniform(0, 6.283185307179586);
    return {std::cos(angle), std::sin(angle), 0};
  }
  const auto R = random.rotation();
  return {R[0], R[3], R[6]};
}

std::array<double, 9> random_rotation(Random& random, int dimension) {
  if (dimension == 3) return random.rotation();
  const double angle = random.uniform(0, 6.283185307179586), c = std::cos(angle), s = std::sin(angle);
  return {c, -s, 0, s, c, 0, 0, 0, 1};
}

/// Values (0) and derivatives (1) of the three quadratic B-splines around x, from node floor(x - 1/2) on.
struct Spline {
  int base;
  double value[3], slope[3];
  explicit Spline(double x) : base(int(std::floor(x - 0.5))) {
    const double f = x - base;
    const double a = 1.5 - f, b = f - 1, c = f - 0.5;
    value[0] = 0.5 * a * a, value[1] = 0.75 - b * b, value[2] = 0.5 * c * c;
    slope[0] = -a, slope[1] = -2 * b, slope[2] = c;
  }
};

/// Calls visit(k, cell, weight, gradient) for each node of the stencil, last axis fastest; the gradient is per cell size.
template <class Visit>
void for_stencil(int dimension, const double* position, Visit visit) {
  const Spline x(position[0]), y(position[1]), z(dimension == 3 ? position[2] : 1.0);
  const int last = dimension == 3 ? 3 : 1;
  for (int i = 0, k = 0; i < 3; ++i)
    for (int j = 0; j < 3; ++j)
      for (int l = 0; l < last; ++l, ++k) {
        const double w = dimension == 3 ? z.value[l] : 1, dw = dimension == 3 ? z.slope[l] : 0;
        visit(k, std::array<std::int32_t, 3>{x.base + i, y.base + j, dimension == 3 ? z.base + l : 0},
              x.value[i] * y.value[j] * w,
              Vector{x.slope[i] * y.value[j] * w, x.value[i] * y.slope[j] * w, x.value[i] * y.value[j] * dw});
      }
}

constexpr double density = 1000;
constexpr std::uint64_t no_node = ~std::uint64_t(0);

/// Nodes, their masses and random velocities for the particles there are.
void build_grid(GridSystem& system, Random& random) {
  const int d = system.dimension;
  const auto D = std::size_t(d);
  std::map<std::array<std::int32_t, 3>, std::uint64_t> rows;
  system.nodes.resize(system.particle_count() * system.stencil());
  for (std::size_t p = 0; p < system.particle_count(); ++p) {
    std::uint64_t* of_particle = &system.nodes[p * system.stencil()];
    for_stencil(d, &system.position[D * p], [&](int k, const auto& cell, double weight, const Vector&) {
      of_particle[k] = no_node;
      if (weight == 0) return;
      const auto [entry, added] = rows.emplace(cell, system.mass.size());
      if (added) {
        system.mass.push_back(0);
        system.node_cell.insert(system.node_cell.end(), cell.begin(), cell.begin() + d);
      }
      system.mass[entry->second] += weight * density * system.volume[p];
      of_particle[k] = entry->second;
    });
    // A node on the boundary of its support may have no mass and no row; its weight is zero, and any row does.
    std::replace(of_particle, of_particle + system.stencil(), no_node, of_particle[system.stencil() / 2]);
  }
  system.prescribed.assign(system.node_count(), 0);
  for (std::size_t i = 0; i < D * system.node_count(); ++i) system.velocity.push_back(random.uniform(-1, 1));
}

void add_particle(GridSystem& system, Random& random, const double* place, double volume) {
  const auto d = std::size_t(system.dimension);
  system.position.insert(system.position.end(), place, place + d);
  system.volume.push_back(volume);
  const double identity[9] = {1, 0, 0, 0, 1, 0, 0, 0, 1};
  system.deformation.insert(system.deformation.end(), identity, identity + 9);
  const Vector a = random_direction(random, system.dimension);
  system.fiber.insert(system.fiber.end(), a.begin(), a.end());
}

void hold(GridSystem& system, Random& random, const Block& block, const Vector& carried) {
  const auto d = std::size_t(system.dimension);
  if (block.held == Block::everything) {
    std::fill(system.prescribed.begin(), system.prescribed.end(), 1);
    return;
  }
  system.normal.assign(d * system.node_count(), 0);
  std::int32_t low = system.node_cell[d - 1], side = system.node_cell[0];
  for (std::size_t i = 0; i < system.node_count(); ++i) {
    low = std::min(low, system.node_cell[d * i + d - 1]);
    side = std::min(side, system.node_cell[d * i]);
  }
  for (std::size_t i = 0; i < system.node_count(); ++i) {
    double* v = &system.velocity[d * i];
    if (system.node_cell[d * i + d - 1] <= low + 1) {
      system.prescribed[i] = 1;
      std::copy_n(carried.begin(), d, v);
    } else if (system.node_cell[d * i] == side) {
      system.prescribed[i] = 2;
      const Vector n = random_direction(random, system.dimension);
      double normal_part = 0;
      for (std::size_t a = 0; a < d; ++a) normal_part += (v[a] - carried[a]) * n[a];
      for (std::size_t a = 0; a < d; ++a) v[a] -= normal_part * n[a];
      std::copy_n(n.begin(), d, &system.normal[d * i]);
    }
  }
}

}  // namespace

void GridSystem::gather_gradients() {
  const auto d = std::size_t(dimension);
  velocity_gradient.assign(d * d * particle_count(), 0);
  for (std::size_t p = 0; p < particle_count(); ++p)
    for_stencil(dimension, &position[d * p], [&](int k, const auto&, double, const Vector& gradient) {
      const double* v = &velocity[d * nodes[p * stencil() + std::size_t(k)]];
      for (std::size_t a = 0; a < d; ++a)
        for (std::size_t b = 0; b < d; ++b) velocity_gradient[d * d * p + d * a + b] += v[a] * gradient[b] / cell_size;
    });
}

void GridSystem::keep_particles(const std::vector<bool>& keep) {
  const auto d = std::size_t(dimension);
  const auto filter = [&](auto& values, std::size_t size) {
    std::size_t to = 0;
    for (std::size_t p = 0; p < keep.size(); ++p)
      if (keep[p]) {
        std::copy_n(values.begin() + std::ptrdiff_t(p * size), size, values.begin() + std::ptrdiff_t(to * size));
        ++to;
      }
    values.resize(to * size);
  };
  filter(position, d);
  filter(volume, 1);
  filter(deformation, 9);
  filter(fiber, 3);
  filter(velocity_gradient, d * d);
  filter(nodes, stencil());
}

std::vector<bool> GridSystem::near(const std::vector<bool>& which) const {
  std::vector<bool> result(node_count(), false);
  for (std::size_t p = 0; p < particle_count(); ++p)
    for (std::size_t k = 0; which[p] && k < stencil(); ++k) result[nodes[p * stencil() + k]] = true;
  return result;
}

double GridSystem::product(const std::vector<double>& u, const std::vector<double>& v) const {
  double sum = 0;
  for (std::size_t i = 0; i < u.size(); ++i) sum += mass[i / std::size_t(dimension)] * u[i] * v[i];
  return sum;
}

GridSystem random_block(Random& random, const Block& block, Vector* carried) {
  GridSystem system;
  system.dimension = block.dimension;
  const int d = block.dimension, n = block.cells * block.per_edge;
  const double cell_volume = std::pow(system.cell_size, d), volume = cell_volume / std::pow(block.per_edge, d);
  const Vector corner = {random.uniform(3, 4), random.uniform(3, 4), random.uniform(3, 4)};
  for (int i = 0; i < n; ++i)
    for (int j = 0; j < n; ++j)
      for (int k = 0; k < (d == 3 ? n : 1); ++k) {
        Vector place = {double(i), double(j), double(k)};
        for (std::size_t a = 0; a < 3; ++a) place[a] = corner[a] + (place[a] + random.uniform(0.1, 0.9)) / block.per_edge;
        add_particle(system, random, place.data(), volume * random.uniform(0.9, 1.1));
      }
  const Vector along = random_direction(random, d);
  const auto R = random_rotation(random, d);
  // F = R (I + E), with E of the order of a percent, in the plane if there are two dimensions.
  std::array<double, 9> F = R;
  for (std::size_t r = 0; r < 3; ++r)
    for (std::size_t c = 0; c < std::size_t(d); ++c)
      for (std::size_t k = 0; k < std::size_t(d); ++k) F[3 * r + c] += R[3 * r + k] * random.uniform(-0.02, 0.02);
  for (std::size_t p = 0; p < system.particle_count(); ++p) {
    if (block.fibers == Block::uniform) std::copy_n(along.begin(), 3, &system.fiber[3 * p]);
    if (block.fibers == Block::none) std::fill_n(&system.fiber[3 * p], 3, 0.0);
    const auto own = block.strain == Block::rotated ? random_rotation(random, d) : F;
    if (block.strain != Block::rest) std::copy_n(own.begin(), 9, &system.deformation[9 * p]);
  }
  build_grid(system, random);
  const Vector velocity = {random.uniform(-1, 1), random.uniform(-1, 1), random.uniform(-1, 1)};
  if (carried) *carried = velocity;
  if (block.held != Block::free) hold(system, random, block, velocity);
  system.gather_gradients();
  return system;
}

GridSystem particles_at(Random& random, int dimension, const std::vector<double>& places) {
  GridSystem system;
  system.dimension = dimension;
  for (std::size_t i = 0; i < places.size(); i += std::size_t(dimension))
    add_particle(system, random, &places[i], 0.25 * std::pow(system.cell_size, dimension));
  build_grid(system, random);
  system.gather_gradients();
  return system;
}

ConstraintInstance::ConstraintInstance(const Plugin& plugin, const Settings& settings, int dimension)
    : plugin_(plugin),
      material_(plugin.kind()),
      reads_fibers_(capabilities_with(plugin.schema(), settings) & CLEAVE_NEEDS_FIBER) {
  material_.context.dimension = std::uint32_t(dimension);
  const PackedParameters parameters(plugin.schema(), settings);
  Words words;
  const cleave_result result = plugin.table().create(parameters.get(), &material_.context, &handle_, &words.message);
  if (result != CLEAVE_OK || !handle_)
    throw Failed{"create() refuses " + text(settings) + " in " + std::to_string(dimension) + " dimensions: " + words.said()};
}
ConstraintInstance::~ConstraintInstance() {
  if (handle_) plugin_.table().destroy(handle_);
}

Projection project(const ConstraintInstance& instance, const GridSystem& system) {
  GridSystem copy = system;
  // What is written beside the velocities does no harm here; `constraint.inputs-unchanged` looks for it.
  constexpr std::size_t slack = 16;
  std::vector<double> velocity(system.velocity.size() + 2 * slack);
  std::copy(system.velocity.begin(), system.velocity.end(), velocity.begin() + slack);
  const auto data = [](auto& values) { return values.empty() ? nullptr : values.data(); };
  const cleave_constraint_system seen{sizeof seen,
                                      std::uint32_t(copy.dimension),
                                      copy.cell_size,
                                      copy.time_step,
                                      copy.node_count(),
                                      data(copy.mass),
                                      velocity.data() + slack,
                                      data(copy.node_cell),
                                      data(copy.prescribed),
                                      data(copy.normal),
                                      copy.particle_count(),
                                      data(copy.position),
                                      data(copy.volume),
                                      data(copy.deformation),
                                      instance.reads_fibers() ? data(copy.fiber) : nullptr,
                                      data(copy.velocity_gradient),
                                      data(copy.nodes),
                                      nullptr,
                                      system.threads};
  Projection projection;
  projection.report.struct_size = sizeof projection.report;
  Words words;
  projection.result = instance.table().project(instance.handle(), &seen, &projection.report, &words.message);
  projection.words = words.said();
  projection.velocity.assign(velocity.begin() + slack, velocity.end() - slack);
  return projection;
}

}  // namespace cleave::testkit
