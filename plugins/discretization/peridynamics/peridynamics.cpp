#include "contact.hpp"
#include "embedded_mesh.hpp"
#include "solid.hpp"

#include <cleave/checksum.hpp>

#include <cmath>
#include <stdexcept>

namespace {
using namespace cleave;
using namespace cleave::peridynamics;

enum class Integrator { symplectic_euler, velocity_verlet };

/// Ordinary state-based peridynamics: a solid of points that pull on each other within a horizon, elastic with any Poisson's
/// ratio, plastic, and breaking bond by bond. docs/peridynamics.md has the formulas.
struct Peridynamics {
  static constexpr About about{.id = "discretization/peridynamics",
                               .version = "1.0.0",
                               .author = "Cleave",
                               .summary = "State-based peridynamic solid, elastic, plastic and breaking",
                               .source = "Chen et al. 2018, Peridynamics-based fracture animation; Silling et al. 2007"};

  IsotropicModuli moduli;
  double horizon, plastic_limit, toughening, contact_distance, air_damping, laplacian_damping;
  std::optional<double> yield, critical_stretch, energy_release_rate;
  NumberList anisotropy, initial_crack, second_initial_crack;
  bool surface_correction;
  Split split;
  Return plastic_return;
  Precision precision;
  Integrator integrator;

  static constexpr auto parameters = describe(
      &Peridynamics::moduli,
      number(&Peridynamics::horizon, {.key = "horizon",
                                      .default_value = 1.45,
                                      .valid = between(1, 10),
                                      .description = "delta in mean spacings of the points; bonds reach this far"}),
      number(&Peridynamics::critical_stretch,
             {.key = "critical_stretch",
              .valid = positive,
              .description = "elastic extension of a bond over delta at which it breaks; left out: none does"}),
      number(&Peridynamics::energy_release_rate,
             {.key = "energy_release_rate",
              .unit = "J/m^2",
              .valid = positive,
              .description = "G of a crack, which gives the critical stretch; instead of that"}),
      at_most_one_of("critical_stretch", "energy_release_rate"),
      number(&Peridynamics::toughening, {.key = "toughening",
                                         .default_value = 0,
                                         .valid = non_negative,
                                         .description = "alpha: bonds of damaged points break at (1 + alpha phi) of it"}),
      number(&Peridynamics::yield, {.key = "yield",
                                    .unit = "N^2/m^12",
                                    .valid = positive,
                                    .description = "psi_0: bonds flow where A_dev^2/2 exceeds it; left out: none does"}),
      at_most_one_of("yield"),
      number(&Peridynamics::plastic_limit, {.key = "plastic_limit",
                                            .default_value = 0.2,
                                            .valid = non_negative,
                                            .description = "gamma: largest plastic stretch of a bond"}),
      choice(&Peridynamics::plastic_return, {.key = "return",
                                             .choices = {"consistent", "printed"},
                                             .default_value = "consistent",
                                             .description = "plastic flow to the yield surface, or as eq. 15 prints it"}),
      list(&Peridynamics::anisotropy, {.key = "anisotropy",
                                       .max_count = 9,
                                       .default_value = NumberList{},
                                       .description = "G, row by row: bonds weigh delta/|G xi|; empty: isotropic"}),
      list(&Peridynamics::initial_crack,
           {.key = "initial_crack",
            .unit = "m",
            .max_count = 9,
            .default_value = NumberList{},
            .description = "corner and two edges of a parallelogram; bonds through it are broken from the start"}),
      list(&Peridynamics::second_initial_crack, {.key = "second_initial_crack",
                                                 .unit = "m",
                                                 .max_count = 9,
                                                 .default_value = NumberList{},
                                                 .description = "another one"}),
      boolean(&Peridynamics::surface_correction,
              {.key = "surface_correction",
               .default_value = true,
               .description = "stiffness from the family each point has, not from a full ball"}),
      choice(&Peridynamics::split, {.key = "deviatoric",
                                    .choices = {"corrected", "published"},
                                    .default_value = "corrected",
                                    .description = "e_d = e - theta |xi|/3, none in a change of volume, or as eq. 9"}),
      number(&Peridynamics::contact_distance,
             {.key = "contact_distance",
              .default_value = 0.9,
              .valid = between(0, 1),
              .description = "spacings below which points without a bond push each other; 0: never"}),
      number(&Peridynamics::air_damping, {.key = "air_damping",
                                          .default_value = 0,
                                          .valid = {.minimum = 0, .maximum = 1, .maximum_open = true},
                                          .description = "part of the velocity lost in each step"}),
      number(&Peridynamics::laplacian_damping,
             {.key = "laplacian_damping",
              .default_value = 0,
              .valid = between(0, 0.5),
              .description = "part of the difference to the neighbours' velocity lost in each step"}),
      choice(&Peridynamics::integrator, {.key = "integrator",
                                         .choices = {"symplectic-euler", "velocity-verlet"},
                                         .default_value = "symplectic-euler",
                                         .description = "how velocities and positions are stepped"}),
      choice(&Peridynamics::precision,
             {.key = "precision",
              .choices = {"single", "double"},
              .default_value = "double",
              .description = "of the bonds; single is smaller and faster, with a noise of 1e-7 in stretch"}));

  void complete() {
    add_cut("initial_crack", initial_crack);
    add_cut("second_initial_crack", second_initial_crack);
    if (anisotropy.size() == 0) return;
    if (anisotropy.size() != 9)
      throw ParameterError{"anisotropy", "has " + std::to_string(anisotropy.size()) + " numbers, must have 9 or none"};
    const double* g = anisotropy.data();
    const double determinant =
        g[0] * (g[4] * g[8] - g[5] * g[7]) - g[1] * (g[3] * g[8] - g[5] * g[6]) + g[2] * (g[3] * g[7] - g[4] * g[6]);
    double scale = 0;
    for (const double value : anisotropy) scale = std::max(scale, std::abs(value));
    if (!(std::abs(determinant) > 1e-9 * scale * scale * scale))
      throw ParameterError{"anisotropy", "must be invertible: a bond along a direction that G maps to 0 has no weight"};
  }

  void add_cut(const char* key, const NumberList& given) {
    if (given.size() == 0) return;
    if (given.size() != 9) throw ParameterError{key, "has " + std::to_string(given.size()) + " numbers, must have 9 or none"};
    const double* c = given.data();
    const Material::Cut cut{{c[0], c[1], c[2]}, {c[3], c[4], c[5]}, {c[6], c[7], c[8]}};
    const auto& u = cut.edge;
    const auto& v = cut.other_edge;
    const double area = std::hypot(u[1] * v[2] - u[2] * v[1], u[2] * v[0] - u[0] * v[2], u[0] * v[1] - u[1] * v[0]);
    if (!(area > 1e-9 * std::hypot(u[0], u[1], u[2]) * std::hypot(v[0], v[1], v[2])))
      throw ParameterError{key, "must have two edges of different directions: its last six numbers span no area"};
    cuts.push_back(cut);
  }

  std::vector<Material::Cut> cuts;
  std::vector<std::unique_ptr<Solid>> solids;
  std::vector<std::unique_ptr<EmbeddedMesh>> meshes;  ///< of bodies that have tetrahedra
  std::vector<Contact::Body> bodies;
  std::optional<Contact> contact;
  std::vector<double> mass;
  bool moved = true;  ///< since the forces were computed
  double square_frequency = 0, lightest = infinity;

  /// What changes during a run, besides bonds.
  std::vector<double> position, velocity, force, energy, damage, dilatation, plastic_stretch;
  static constexpr std::array changing{&Peridynamics::position,       &Peridynamics::velocity, &Peridynamics::force,
                                       &Peridynamics::energy,         &Peridynamics::damage,   &Peridynamics::dilatation,
                                       &Peridynamics::plastic_stretch};

  std::size_t points() const { return mass.size(); }

  void add_body(const cleave_body& body) {
    const std::size_t first = points(), last = first + body.point_count;
    if (last > 0xffffffff) throw std::runtime_error("more than 2^32 points");
    for (std::size_t i = 0; i < body.point_count; ++i)
      if (!(body.volume[i] > 0)) throw std::runtime_error("point " + std::to_string(i) + " has no volume");
    if (body.point_count > 0) {
      solids.push_back(make_solid(material(int(body.dimension)), body));
      square_frequency = std::max(square_frequency, solids.back()->highest_square_frequency());
    } else {
      solids.push_back(nullptr);
    }
    bodies.push_back({first, last, body.spacing, solids.back().get()});
    position.insert(position.end(), body.position, body.position + 3 * body.point_count);
    velocity.insert(velocity.end(), body.velocity, body.velocity + 3 * body.point_count);
    for (std::size_t i = 0; i < body.point_count; ++i) {
      mass.push_back(body.density * body.volume[i]);
      lightest = std::min(lightest, mass.back());
    }
    meshes.push_back(body.tetrahedron_count > 0 ? std::make_unique<EmbeddedMesh>(body) : nullptr);
    force.resize(3 * last);
    for (auto* values : {&energy, &damage, &dilatation}) values->resize(last);
    if (solids.back()) solids.back()->damage(std::span(damage).subspan(first));
    if (yield) plastic_stretch.resize(last);
    if (contact_distance > 0 && !contact) contact.emplace(contact_distance, moduli.bulk, int(body.dimension));
    moved = true;
  }

  Material material(int dimension) const {
    Material m;
    m.dimension = dimension;
    m.shear = moduli.shear;
    m.bulk = moduli.bulk;
    m.horizon = horizon;
    m.precision = precision;
    m.split = split;
    m.surface_correction = surface_correction;
    if (anisotropy.size() == 9) {
      m.anisotropy.emplace();
      std::copy(anisotropy.begin(), anisotropy.end(), m.anisotropy->begin());
    }
    m.yield = yield;
    m.plastic_limit = plastic_limit;
    m.plastic_return = plastic_return;
    m.critical_stretch = critical_stretch;
    m.energy_release_rate = energy_release_rate;
    m.toughening = toughening;
    m.cuts = cuts;
    return m;
  }

  /// omega dt < 2 with a bound of omega [Silling & Askari 2005, section 5], and a margin for what deformation adds.
  double stable_step() const {
    double square = square_frequency;
    if (contact && points() > 0) square += 2 * contact->stiffness() / lightest;
    return square > 0 ? 1.7 / std::sqrt(square) : 1e30;
  }

  void step(double time_step, const World& world) {
    const Threads threads = world.threads();
    if (moved) compute_forces(threads);
    const bool verlet = integrator == Integrator::velocity_verlet;
    kick(threads, verlet ? 0.5 * time_step : time_step, world.gravity());
    if (!verlet) damp(threads);
    world.collide(position, velocity);
    drift(threads, time_step, world);
    compute_forces(threads);
    if (!verlet) return;
    kick(threads, 0.5 * time_step, world.gravity());
    damp(threads);
    world.collide(position, velocity);
    for_points(threads, [&](std::size_t b, std::size_t k, std::size_t i) {
      if (const auto motion = world.handle(b, k)) std::copy_n(motion->velocity.begin(), 3, &velocity[3 * i]);
    });
  }

  void kick(const Threads& threads, double time_step, const std::array<double, 3>& gravity) {
    threads.for_ranges(points(), 4096, [&](std::uint64_t first, std::uint64_t last) {
      for (std::size_t i = first; i < last; ++i)
        for (std::size_t a = 0; a < 3; ++a) velocity[3 * i + a] += time_step * (force[3 * i + a] / mass[i] + gravity[a]);
    });
  }

  /// v = (1 - la) v and v += ll L(v)                                           [Chen et al. 2018, section 6]
  void damp(const Threads& threads) {
    if (laplacian_damping > 0)
      for (const auto& body : bodies)
        if (body.solid) body.solid->smooth(threads, laplacian_damping, of(body, velocity, 3));
    if (air_damping > 0)
      for (double& v : velocity) v *= 1 - air_damping;
  }

  void drift(const Threads& threads, double time_step, const World& world) {
    for_points(threads, [&](std::size_t b, std::size_t k, std::size_t i) {
      const auto motion = world.handle(b, k);
      for (std::size_t a = 0; a < 3; ++a) {
        if (motion) velocity[3 * i + a] = motion->velocity[a];
        position[3 * i + a] = motion ? motion->position[a] : position[3 * i + a] + time_step * velocity[3 * i + a];
      }
    });
  }

  /// visit(body, point of the body, point)
  template <class Visit>
  void for_points(const Threads& threads, const Visit& visit) const {
    for (std::size_t b = 0; b < bodies.size(); ++b)
      threads.for_ranges(bodies[b].last - bodies[b].first, 4096, [&](std::uint64_t first, std::uint64_t last) {
        for (std::uint64_t k = first; k < last; ++k) visit(b, k, bodies[b].first + k);
      });
  }

  void compute_forces(const Threads& threads) {
    for (std::size_t b = 0; b < bodies.size(); ++b) {
      const auto& body = bodies[b];
      if (!solids[b]) continue;
      solids[b]->evaluate(threads, of(body, position, 3),
                          {of(body, force, 3), of(body, energy, 1), of(body, dilatation, 1), of(body, damage, 1),
                           yield ? of(body, plastic_stretch, 1) : std::span<double>{}});
    }
    if (contact) contact->push(threads, bodies, position, damage, force);
    moved = false;
  }

  static std::span<double> of(const Contact::Body& body, std::vector<double>& values, std::size_t components) {
    return std::span(values).subspan(body.first * components, (body.last - body.first) * components);
  }

  std::vector<PointField> fields(std::uint64_t b) const {
    const auto& body = bodies[b];
    const auto of = [&](const std::vector<double>& values, std::size_t components) {
      return std::span(values).subspan(body.first * components, (body.last - body.first) * components);
    };
    std::vector<PointField> all = {{"position", "m", 3, of(position, 3)},
                                   {"velocity", "m/s", 3, of(velocity, 3)},
                                   {"energy", "J/m^3", 1, of(energy, 1)},
                                   {"damage", "1", 1, of(damage, 1)},
                                   {"dilatation", "1", 1, of(dilatation, 1)}};
    if (yield) all.push_back({"plastic_stretch", "1", 1, of(plastic_stretch, 1)});
    return all;
  }

  std::optional<SurfaceMesh> surface(std::uint64_t b) const {
    if (!meshes[b]) return {};
    const auto of = [&](const std::vector<double>& values, std::size_t components) {
      return std::span(values).subspan(bodies[b].first * components, (bodies[b].last - bodies[b].first) * components);
    };
    return meshes[b]->surface(*solids[b], of(position, 3), of(velocity, 3), of(damage, 1), of(mass, 1));
  }

  struct Header {
    std::uint64_t checksum, size;  ///< of all that follows
    double contact_stiffness;
    std::uint8_t moved, reserved[7] = {};
  };
  std::size_t saved_bytes() const {
    std::size_t size = sizeof(Header);
    for (const auto member : changing) size += (this->*member).size() * sizeof(double);
    for (const auto& solid : solids) size += solid ? solid->saved_bytes() : 0;
    return size;
  }

  std::vector<std::byte> save() const {
    std::vector<std::byte> state;
    state.reserve(saved_bytes());
    const auto append = [&](std::span<const std::byte> bytes) { state.insert(state.end(), bytes.begin(), bytes.end()); };
    Header header{0, saved_bytes(), contact ? contact->stiffness() : 0, moved};
    append(std::as_bytes(std::span(&header, 1)));
    for (const auto member : changing) append(std::as_bytes(std::span(this->*member)));
    for (const auto& solid : solids)
      if (solid) solid->save(state);
    header.checksum = checksum(std::span(state).subspan(sizeof header.checksum));
    std::memcpy(state.data(), &header.checksum, sizeof header.checksum);
    return state;
  }

  void restore(std::span<const std::byte> state) {
    Header header{};
    if (state.size() == saved_bytes()) std::memcpy(&header, state.data(), sizeof header);
    if (state.size() < sizeof header || header.size != state.size() ||
        header.checksum != checksum(state.subspan(sizeof header.checksum)))
      throw std::runtime_error("this is not a saved state of these bodies");
    state = state.subspan(sizeof header);
    const auto take = [&](std::size_t size) {
      const auto part = state.first(size);
      state = state.subspan(size);
      return part;
    };
    for (const auto member : changing) {
      auto& values = this->*member;
      const auto part = take(values.size() * sizeof(double));
      if (!part.empty()) std::memcpy(values.data(), part.data(), part.size());
    }
    for (const auto& solid : solids)
      if (solid) solid->restore(take(solid->saved_bytes()));
    moved = header.moved != 0;
    if (!contact) return;
    contact->forget();
    contact->restore_stiffness(header.contact_stiffness);
  }
};

}  // namespace

CLEAVE_PLUGIN(Peridynamics)
