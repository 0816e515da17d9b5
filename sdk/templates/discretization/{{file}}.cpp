#include <cleave/discretization.hpp>

#include <cmath>
#include <numbers>
#include <stdexcept>
#include <unordered_map>

namespace {
using namespace cleave;

/// Brittle solid of points that pull on each other, with no grid and no strain: bond-based peridynamics, the "prototype
/// microelastic brittle" material. A bond joins each two points of a body whose distance |xi| at rest is less than the
/// horizon delta; at the distance |y| it pulls with a force that is linear in its stretch, until it breaks for good:
///
///   rho a_i = sum_j c s w V_j y/|y| + rho g,   s = (|y| - |xi|)/|xi|,   broken once s > critical_stretch
///   c = 18 kappa/(pi delta^4)         in 3D                   [Silling 2000; Silling & Askari 2005]
///   c = 72 kappa/(5 pi delta^3)       in 2D, plane strain     [the same energy in the plane; Gerstle et al. 2005]
///
/// w is the part of V_j inside the horizon. Poisson's ratio is 1/4, whatever the parameters. Forces along the bonds, equal
/// and opposite, keep linear and angular momentum. Pieces that have come apart do not see each other.
///
/// find_bonds() says who pulls on whom, and how stiffly; pull() is the law.
struct {{Type}} {
  static constexpr About about{.id = "{{kind}}/{{id}}",
                               .version = "1.0.0",
                               .author = "",
                               .summary = "Bond-based peridynamic solid that breaks",
                               .source = "Silling & Askari 2005"};

  double bulk_modulus, critical_stretch, horizon;
  static constexpr auto parameters = describe(
      number(&{{Type}}::bulk_modulus,
             {.key = "bulk_modulus", .unit = "Pa", .valid = positive, .description = "kappa of the unbroken solid"}),
      number(&{{Type}}::critical_stretch,
             {.key = "critical_stretch", .valid = positive, .description = "stretch at which a bond breaks"}),
      number(
          &{{Type}}::horizon,
          {.key = "horizon", .default_value = 3, .valid = between(1, 10), .description = "delta in mean distances of points"}));

  struct Bond {
    std::size_t i, j;
    double rest, stiffness;  ///< |xi| [m], c w V_i V_j [N]
  };
  std::vector<Bond> bonds;
  std::vector<std::size_t> first{0};        ///< point of each body, and the end
  std::vector<double> mass, volume, count;  ///< per point; count: of its bonds at rest
  double largest_step = infinity;
  /// What changes during a run. `intact` has an element for each bond, 1 or 0.
  std::vector<double> position, velocity, force, energy, damage, intact;
  static constexpr std::array changing{&{{Type}}::position, &{{Type}}::velocity, &{{Type}}::force,
                                       &{{Type}}::energy,   &{{Type}}::damage,   &{{Type}}::intact};

  void add_body(const cleave_body& body) {
    const std::size_t begin = first.back(), end = begin + body.point_count;
    position.insert(position.end(), body.position, body.position + 3 * body.point_count);
    velocity.insert(velocity.end(), body.velocity, body.velocity + 3 * body.point_count);
    volume.insert(volume.end(), body.volume, body.volume + body.point_count);
    for (std::size_t i = begin; i < end; ++i) mass.push_back(body.density * volume[i]);
    force.resize(3 * end);
    for (auto* values : {&energy, &damage, &count}) values->resize(end);
    first.push_back(end);
    find_bonds(begin, end, body.spacing, int(body.dimension));
  }

  /// Bonds of the points [begin, end), with a list of the points in each cube as long as a bond may be.
  void find_bonds(std::size_t begin, std::size_t end, double spacing, int dimension) {
    const double delta = horizon * spacing, longest = delta + spacing / 2, pi = std::numbers::pi;
    const double c =
        dimension == 2 ? 72 * bulk_modulus / (5 * pi * std::pow(delta, 3)) : 18 * bulk_modulus / (pi * std::pow(delta, 4));
    const auto cube = [&](std::size_t i, int axis) { return std::int64_t(std::floor(position[3 * i + axis] / longest)); };
    const auto key = [](std::int64_t x, std::int64_t y, std::int64_t z) { return (x * 2097152 + y) * 2097152 + z; };
    std::unordered_map<std::int64_t, std::vector<std::size_t>> cubes;
    for (std::size_t i = begin; i < end; ++i) cubes[key(cube(i, 0), cube(i, 1), cube(i, 2))].push_back(i);
    std::vector<double> stiffness(end);  // sum over the bonds of a point, N/m
    for (std::size_t i = begin; i < end; ++i)
      for (int n = 0; n < 27; ++n) {
        const auto near = cubes.find(key(cube(i, 0) + n / 9 - 1, cube(i, 1) + n / 3 % 3 - 1, cube(i, 2) + n % 3 - 1));
        if (near == cubes.end()) continue;
        for (const std::size_t j : near->second) {
          const double rest = length(separation(i, j));
          if (j <= i || rest >= longest || rest == 0) continue;
          const double inside = std::min(1.0, (longest - rest) / spacing);  // w
          bonds.push_back({i, j, rest, c * inside * volume[i] * volume[j]});
          for (const std::size_t k : {i, j}) {
            stiffness[k] += bonds.back().stiffness / rest;
            count[k] += 1;
          }
        }
      }
    intact.resize(bonds.size(), 1);
    // A row of M^-1 K adds up to at most twice the stiffness over the mass, and omega dt must stay below 2.
    for (std::size_t i = begin; i < end; ++i)
      if (stiffness[i] > 0) largest_step = std::min(largest_step, 0.8 * std::sqrt(2 * mass[i] / stiffness[i]));
  }

  /// From point i to point j.
  std::array<double, 3> separation(std::size_t i, std::size_t j) const {
    const double *a = &position[3 * i], *b = &position[3 * j];
    return {b[0] - a[0], b[1] - a[1], b[2] - a[2]};
  }
  static double length(const std::array<double, 3>& y) { return std::sqrt(y[0] * y[0] + y[1] * y[1] + y[2] * y[2]); }

  double stable_step() const { return largest_step; }

  /// Symplectic Euler: velocities from the forces where the points are, then positions from the velocities.
  void step(double time_step, const World& world) {
    const auto gravity = world.gravity();
    for (std::size_t k = 0; k < velocity.size(); ++k) velocity[k] += time_step * (force[k] / mass[k / 3] + gravity[k % 3]);
    world.collide(position, velocity);
    for (std::size_t body = 0; body + 1 < first.size(); ++body)
      for (std::size_t i = first[body]; i < first[body + 1]; ++i) {
        const auto held = world.handle(body, i - first[body]);
        for (std::size_t axis = 0; axis < 3; ++axis) {
          if (held) velocity[3 * i + axis] = held->velocity[axis];
          position[3 * i + axis] = held ? held->position[axis] : position[3 * i + axis] + time_step * velocity[3 * i + axis];
        }
      }
    pull();
  }

  /// Breaks bonds; forces, energies and damage where the points are.
  void pull() {
    for (auto* sum : {&force, &energy, &damage}) std::fill(sum->begin(), sum->end(), 0.0);
    for (std::size_t b = 0; b < bonds.size(); ++b) {
      const auto& [i, j, rest, stiffness] = bonds[b];
      const auto y = separation(i, j);
      const double distance = length(y), stretch = (distance - rest) / rest;
      if (stretch > critical_stretch) intact[b] = 0;
      const double pulling = intact[b] * stiffness * stretch;
      for (std::size_t axis = 0; axis < 3; ++axis) {
        const double along = y[axis] / std::max(distance, 1e-9 * rest);
        force[3 * i + axis] += pulling * along;
        force[3 * j + axis] -= pulling * along;
      }
      for (const std::size_t k : {i, j}) {
        energy[k] += 0.25 * pulling * stretch * rest / volume[k];  // each end has half of the bond's
        damage[k] += 1 - intact[b];
      }
    }
    for (std::size_t i = 0; i < count.size(); ++i) damage[i] /= std::max(count[i], 1.0);
  }

  std::vector<PointField> fields(std::uint64_t body) const {
    const auto of = [&](const std::vector<double>& values, std::size_t components) {
      return std::span(values).subspan(first[body] * components, (first[body + 1] - first[body]) * components);
    };
    return {{"position", "m", 3, of(position, 3)},
            {"velocity", "m/s", 3, of(velocity, 3)},
            {"energy", "J/m^3", 1, of(energy, 1)},
            {"damage", "1", 1, of(damage, 1)}};
  }

  std::vector<std::byte> save() const {
    std::vector<std::byte> state;
    for (const auto member : changing) {
      const auto bytes = std::as_bytes(std::span(this->*member));
      state.insert(state.end(), bytes.begin(), bytes.end());
    }
    return state;
  }
  void restore(std::span<const std::byte> state) {
    std::vector<double> numbers(state.size() / sizeof(double));
    std::memcpy(numbers.data(), state.data(), numbers.size() * sizeof(double));
    std::size_t size = 0;
    for (const auto member : changing) size += (this->*member).size();
    const bool fits = state.size() == size * sizeof(double);
    const auto flag = [](double value) { return value == 0 || value == 1; };
    if (!fits || !std::all_of(numbers.end() - std::ptrdiff_t(bonds.size()), numbers.end(), flag) ||
        !std::all_of(numbers.begin(), numbers.end(), [](double value) { return std::isfinite(value); }))
      throw std::runtime_error("this is not a saved state of these bodies");
    auto from = numbers.begin();
    for (const auto member : changing) {
      auto& values = this->*member;
      std::copy_n(from, values.size(), values.begin());
      from += std::ptrdiff_t(values.size());
    }
  }
};

}  // namespace

CLEAVE_PLUGIN({{Type}})
