#include "newton.hpp"
#include "solid.hpp"

#include <cleave/checksum.hpp>

#include <cmath>
#include <stdexcept>

namespace {
using namespace cleave;
using namespace cleave::fem;

enum class Integrator { symplectic_euler, implicit, quasi_static };
enum class InitialConfiguration { rest, random };

/// Linear tetrahedra, total Lagrangian, of any elastic law: the reference that other discretisations are compared with.
/// docs/fem.md has the formulas.
struct FiniteElements {
  static constexpr About about{.id = "discretization/fem",
                               .version = "1.0.0",
                               .author = "Cleave",
                               .summary = "Finite elements: linear tetrahedra, explicit, implicit or quasi-static",
                               .source = "Belytschko, Liu & Moran 2000, Nonlinear Finite Elements, chapter 4"};
  static constexpr bool needs_elasticity = true;
  static constexpr bool needs_tetrahedra = true;

  Integrator integrator;
  double mass_damping, tolerance, initial_size;
  int maximum_iterations, seed;
  InitialConfiguration initial_configuration;

  static constexpr auto parameters = describe(
      choice(&FiniteElements::integrator,
             {.key = "integrator",
              .choices = {"symplectic-euler", "implicit", "quasi-static"},
              .default_value = "symplectic-euler",
              .description = "implicit: backward Euler; quasi-static: equilibrium at the end of each step"}),
      number(&FiniteElements::mass_damping,
             {.key = "mass_damping",
              .unit = "1/s",
              .default_value = 0,
              .valid = non_negative,
              .description = "alpha of Rayleigh's damping C = alpha M; without effect on quasi-static bodies"}),
      number(&FiniteElements::tolerance, {.key = "tolerance",
                                          .default_value = 1e-6,
                                          .valid = strictly_between(0, 1),
                                          .description = "of implicit and quasi-static steps: forces out of balance "
                                                         "over those that meet at the vertices"}),
      integer(&FiniteElements::maximum_iterations, {.key = "maximum_iterations",
                                                    .default_value = 200,
                                                    .valid = between(1, 100000),
                                                    .description = "of Newton's method in a step"}),
      choice(&FiniteElements::initial_configuration,
             {.key = "initial_configuration",
              .choices = {"rest", "random"},
              .default_value = "rest",
              .description = "random: the bodies of the scene are at rest, and vertices start anywhere in a box"}),
      number(&FiniteElements::initial_size, {.key = "initial_size",
                                             .default_value = 1,
                                             .valid = non_negative,
                                             .description = "of the box in which vertices start at random, over the "
                                                            "bounding box of the body; near 0: one point"}),
      integer(&FiniteElements::seed,
              {.key = "seed", .default_value = 1, .valid = between(0, 1000000), .description = "of random initial positions"}));

  struct Body {
    Body(const cleave_body& given, const ElasticResponse& law)
        : name(given.name ? given.name : ""),
          solid(given, law),
          position(solid.mesh().rest),
          velocity(position.size()),
          point_position(3 * given.point_count),
          point_velocity(3 * given.point_count) {}

    std::string name;
    Solid solid;
    std::optional<Newton> newton;
    std::vector<double> position, velocity;  ///< of vertices, 3 each
    // What follows from these.
    Response response;
    double square_frequency = 0;
    std::vector<double> point_position, point_velocity;

    const Mesh& mesh() const { return solid.mesh(); }
    Vector at(const std::vector<double>& values, std::size_t vertex) const {
      return {values[3 * vertex], values[3 * vertex + 1], values[3 * vertex + 2]};
    }
  };
  std::vector<std::unique_ptr<Body>> bodies;

  void add_body(const cleave_body& given) {
    if (given.dimension != 3) throw UnsupportedError{"bodies are of tetrahedra: the scene must have dimension = 3"};
    if (given.tetrahedron_count == 0) throw UnsupportedError{"the body must be made of tetrahedra"};
    if (given.tetrahedron_count > 0x3fffffff) throw UnsupportedError{"the body has more than 2^30 tetrahedra"};
    const auto law = elasticity_of(given);
    if (!law) throw UnsupportedError{"the material must have an elastic law"};
    const Threads threads = threads_of(given);
    auto body = std::make_unique<Body>(given, *law);
    set_velocity(*body, given);
    if (initial_configuration == InitialConfiguration::random) scatter(*body);
    if (integrator != Integrator::symplectic_euler)
      body->newton.emplace(threads, body->solid, Newton::Settings{tolerance, maximum_iterations});
    body->solid.evaluate(threads, body->position, body->response);
    follow(threads, *body);
    bodies.push_back(std::move(body));
  }

  /// As given, or each vertex the mean of its tetrahedra's, by volume: momentum is that of the points.
  static void set_velocity(Body& body, const cleave_body& given) {
    if (const auto velocity = vertex_velocity_of(given); !velocity.empty()) {
      std::copy(velocity.begin(), velocity.end(), body.velocity.begin());
      return;
    }
    const Mesh& mesh = body.mesh();
    for (std::size_t t = 0; t < mesh.tetrahedra(); ++t)
      for (const std::uint32_t v : mesh.corner[t])
        for (std::size_t a = 0; a < 3; ++a)
          body.velocity[3 * v + a] += 0.25 * given.density * mesh.volume[t] / mesh.mass[v] * given.velocity[3 * t + a];
  }

  void scatter(Body& body) const {
    double low[3] = {infinity, infinity, infinity}, high[3] = {-infinity, -infinity, -infinity};
    for (std::size_t k = 0; k < body.position.size(); ++k) {
      low[k % 3] = std::min(low[k % 3], body.position[k]);
      high[k % 3] = std::max(high[k % 3], body.position[k]);
    }
    std::uint64_t state = std::uint64_t(seed);
    for (std::size_t k = 0; k < body.position.size(); ++k) {
      std::uint64_t z = state += 0x9e3779b97f4a7c15;  // [Steele, Lea & Flood 2014]
      z = (z ^ (z >> 30)) * 0xbf58476d1ce4e5b9;
      z = (z ^ (z >> 27)) * 0x94d049bb133111eb;
      const double part = double((z ^ (z >> 31)) >> 11) * 0x1p-53;
      body.position[k] = 0.5 * (low[k % 3] + high[k % 3]) + initial_size * (part - 0.5) * (high[k % 3] - low[k % 3]);
    }
  }

  double stable_step() const {
    if (integrator != Integrator::symplectic_euler) return infinity;
    double square_frequency = 0;
    for (const auto& body : bodies) square_frequency = std::max(square_frequency, body->square_frequency);
    return 0.9 * 2 / std::sqrt(square_frequency);
  }

  void step(double time_step, const World& world) {
    const Threads threads = world.threads();
    for (std::size_t b = 0; b < bodies.size(); ++b) {
      Body& body = *bodies[b];
      try {
        if (integrator == Integrator::symplectic_euler)
          step_explicitly(threads, time_step, world, b, body);
        else
          step_by_solving(threads, time_step, world, b, body);
        body.solid.evaluate(threads, body.position, body.response);
        follow(threads, body);
      } catch (const std::exception& error) {
        throw std::runtime_error("body '" + body.name + "': " + error.what());
      }
    }
  }

  void step_explicitly(const Threads& threads, double time_step, const World& world, std::size_t b, Body& body) const {
    const auto gravity = world.gravity();
    const double slowed = 1 / (1 + mass_damping * time_step);
    for (std::size_t k = 0; k < body.velocity.size(); ++k)
      body.velocity[k] =
          slowed * (body.velocity[k] + time_step * (body.response.force[k] / body.mesh().mass[k / 3] + gravity[k % 3]));
    world.collide(body.position, body.velocity);
    threads.for_ranges(body.mesh().vertices(), 4096, [&](std::uint64_t first, std::uint64_t last) {
      for (std::size_t v = first; v < last; ++v) {
        const auto motion = world.vertex_handle(b, v);
        for (std::size_t a = 0; a < 3; ++a) {
          if (motion) body.velocity[3 * v + a] = motion->velocity[a];
          body.position[3 * v + a] =
              motion ? motion->position[a] : body.position[3 * v + a] + time_step * body.velocity[3 * v + a];
        }
      }
    });
  }

  // ---------------------------------------------------------------- implicit and quasi-static

  void step_by_solving(const Threads& threads, double time_step, const World& world, std::size_t b, Body& body) const {
    const Mesh& mesh = body.mesh();
    const bool dynamic = integrator == Integrator::implicit;
    const auto gravity = world.gravity();
    const std::vector<double> before = body.position;

    std::vector<Constraint> constraints(mesh.vertices());
    std::vector<double> guess = before;
    Potential potential{std::vector<double>(mesh.vertices()), before, std::vector<double>(before.size())};
    for (std::size_t v = 0; v < mesh.vertices(); ++v) {
      // m (v_new - v)/dt + alpha m v_new with v_new = (x - x_n)/dt
      const double inertia = 1 / (time_step * time_step), damping = mass_damping / time_step;
      if (dynamic) potential.inertia[v] = mesh.mass[v] * (inertia + damping);
      for (std::size_t k = 3 * v; k < 3 * v + 3; ++k) {
        if (dynamic) {
          const double drift = time_step * body.velocity[k];
          potential.target[k] += (drift + time_step * time_step * gravity[k % 3]) * inertia / (inertia + damping);
          guess[k] += drift;
        } else {
          potential.load[k] = mesh.mass[v] * gravity[k % 3];
        }
      }
      if (const auto motion = world.vertex_handle(b, v)) {
        constraints[v].kind = Constraint::fixed;
        std::copy(motion->position.begin(), motion->position.end(), &guess[3 * v]);
      }
    }
    if (!dynamic) require_support(body, constraints);

    body.newton->solve(threads, potential, constraints, body.position, guess, !dynamic);
    // Vertices that the solution takes into colliders are held at their surface, and the rest is solved for again.
    constexpr int passes = 5;
    for (int pass = 0; pass < passes; ++pass) {
      guess = body.position;
      if (!hold_at_colliders(time_step, world, before, constraints, guess)) break;
      body.newton->solve(threads, potential, constraints, body.position, guess, !dynamic);
    }
    for (std::size_t k = 0; k < before.size(); ++k) body.velocity[k] = (body.position[k] - before[k]) / time_step;
  }

  /// A piece without inertia has to be held so that it can neither shift nor turn.
  static void require_support(const Body& body, std::span<const Constraint> constraints) {
    const Mesh& mesh = body.mesh();
    std::vector<std::array<std::uint32_t, 2>> first(mesh.pieces);
    std::vector<std::uint32_t> held(mesh.pieces);
    std::vector<bool> supported(mesh.pieces);
    for (std::uint32_t v = 0; v < mesh.vertices(); ++v) {
      const std::uint32_t piece = mesh.piece[v];
      if (constraints[v].kind != Constraint::fixed || supported[piece]) continue;
      if (held[piece] < 2) {
        first[piece][held[piece]++] = v;
        continue;
      }
      const Vector origin = body.at(mesh.rest, first[piece][0]);
      const Vector line = body.at(mesh.rest, first[piece][1]) - origin, arm = body.at(mesh.rest, v) - origin;
      supported[piece] = squared_norm(cross(line, arm)) > 1e-12 * squared_norm(line) * squared_norm(arm);
    }
    for (std::uint32_t piece = 0; piece < mesh.pieces; ++piece)
      if (!supported[piece])
        throw std::runtime_error((mesh.pieces > 1 ? "its piece " + std::to_string(piece) : std::string("it")) +
                                 " can move freely: quasi-static, handles have to hold three of its vertices that are not on a "
                                 "line; or step it with integrator = \"implicit\" and mass_damping");
  }

  /// Constrains the free vertices whose velocity colliders change: a frictionless contact takes the motion along its normal,
  /// others take all of it. Moves `guess` to where they meet the collider on their way. Returns false if there are none.
  static bool hold_at_colliders(double time_step, const World& world, const std::vector<double>& before,
                                std::vector<Constraint>& constraints, std::vector<double>& guess) {
    std::vector<std::uint32_t> meeting;
    std::vector<double> velocity(guess.size());
    for (std::size_t k = 0; k < guess.size(); ++k) velocity[k] = (guess[k] - before[k]) / time_step;
    std::vector<double> allowed = velocity;
    world.collide(guess, allowed);
    const auto differ = [](const double* a, const double* b, double tolerance) {
      return std::hypot(a[0] - b[0], a[1] - b[1], a[2] - b[2]) > tolerance;
    };
    double fastest = 0;
    for (const double v : velocity) fastest = std::max(fastest, std::abs(v));
    for (std::uint32_t v = 0; v < constraints.size(); ++v)
      if (constraints[v].kind == Constraint::free && differ(&allowed[3 * v], &velocity[3 * v], 1e-9 * fastest))
        meeting.push_back(v);
    if (meeting.empty()) return false;

    // Their way is the part of the motion up to where the collider begins to change it.
    const std::size_t count = meeting.size();
    std::vector<double> inside(count, 1.0), outside(count, 0.0), x(3 * count), u(3 * count);
    const auto changed_at = [&](const std::vector<double>& part, std::size_t m) {
      const std::size_t v = 3 * meeting[m];
      for (std::size_t a = 0; a < 3; ++a) x[3 * m + a] = before[v + a] + part[m] * (guess[v + a] - before[v + a]);
      std::copy_n(&velocity[v], 3, &u[3 * m]);
    };
    std::vector<double> part(count, 0.0);
    std::vector<bool> began_inside(count);
    constexpr int halvings = 30;
    for (int n = 0; n <= halvings; ++n) {
      for (std::size_t m = 0; m < count; ++m) changed_at(part, m);
      world.collide(x, u);
      for (std::size_t m = 0; m < count; ++m) {
        const bool changed = differ(&u[3 * m], &velocity[3 * meeting[m]], 1e-9 * fastest);
        if (n == 0) began_inside[m] = changed;
        (changed ? inside : outside)[m] = part[m];
        part[m] = began_inside[m] ? 0 : 0.5 * (inside[m] + outside[m]);
      }
    }

    // A contact is frictionless if it lets pass every velocity along the plane across the change.
    std::vector<bool> slides(count, true);
    std::vector<Vector> normal(count);
    for (std::size_t m = 0; m < count; ++m) {
      const std::size_t v = 3 * meeting[m];
      const Vector change(allowed[v] - velocity[v], allowed[v + 1] - velocity[v + 1], allowed[v + 2] - velocity[v + 2]);
      normal[m] = change / norm(change);
      std::copy_n(&guess[v], 3, &x[3 * m]);
    }
    for (int probe = 0; probe < 4; ++probe) {
      const auto along = [&](std::size_t m) {
        const Vector& n = normal[m];
        const Vector axis = std::abs(n[0]) < 0.6 ? Vector(1, 0, 0) : Vector(0, 1, 0);
        Vector t = cross(n, axis);
        t = t / norm(t);
        if (probe & 1) t = cross(n, t);
        return (probe & 2 ? -fastest : fastest) * t;
      };
      std::vector<double> probed(3 * count);
      for (std::size_t m = 0; m < count; ++m)
        for (std::size_t a = 0; a < 3; ++a) probed[3 * m + a] = allowed[3 * meeting[m] + a] + along(m)[int(a)];
      u = probed;
      world.collide(x, u);
      for (std::size_t m = 0; m < count; ++m)
        if (differ(&u[3 * m], &probed[3 * m], 1e-6 * fastest)) slides[m] = false;
    }

    for (std::size_t m = 0; m < count; ++m) {
      const std::size_t v = 3 * meeting[m];
      constraints[meeting[m]] = {slides[m] ? Constraint::plane : Constraint::fixed, normal[m]};
      const Vector after(allowed[v], allowed[v + 1], allowed[v + 2]);
      const Vector along_surface = after - dot(after, normal[m]) * normal[m];
      const double way = began_inside[m] ? 0 : outside[m];
      for (std::size_t a = 0; a < 3; ++a)
        guess[v + a] = before[v + a] + way * (guess[v + a] - before[v + a]) +
                       time_step * (began_inside[m] ? after[int(a)] : (1 - way) * along_surface[int(a)]);
    }
    return true;
  }

  /// What follows from positions and velocities of the vertices.
  static void follow(const Threads& threads, Body& body) {
    body.square_frequency = body.solid.stiffness(threads, body.response.F).square_frequency;
    threads.for_ranges(body.mesh().tetrahedra(), 4096, [&](std::uint64_t first, std::uint64_t last) {
      for (std::size_t t = first; t < last; ++t)
        for (std::size_t a = 0; a < 3; ++a) {
          const auto mean = [&](const std::vector<double>& values) {
            const auto& c = body.mesh().corner[t];
            return 0.25 * (values[3 * c[0] + a] + values[3 * c[1] + a] + values[3 * c[2] + a] + values[3 * c[3] + a]);
          };
          body.point_position[3 * t + a] = mean(body.position);
          body.point_velocity[3 * t + a] = mean(body.velocity);
        }
    });
  }

  std::vector<PointField> fields(std::uint64_t b) const {
    const Body& body = *bodies[b];
    std::vector<PointField> all = {
        {"position", "m", 3, body.point_position}, {"velocity", "m/s", 3, body.point_velocity}, {"F", "1", 9, body.response.F}};
    if (std::isfinite(body.response.energy.front())) all.push_back({"energy", "J/m^3", 1, body.response.energy});
    return all;
  }

  std::optional<SurfaceMesh> surface(std::uint64_t b) const {
    const Body& body = *bodies[b];
    const Mesh& mesh = body.mesh();
    SurfaceMesh surface;
    surface.vertices = body.position;
    surface.triangles = mesh.boundary;
    surface.velocity = body.velocity;
    surface.piece = mesh.piece;
    surface.tetrahedra = {mesh.corner.front().data(), 4 * mesh.tetrahedra()};
    return surface;
  }

  // ---------------------------------------------------------------- checkpoints

  struct Header {
    std::uint64_t checksum, size;  ///< of all that follows
  };
  std::size_t saved_bytes() const {
    std::size_t size = sizeof(Header);
    for (const auto& body : bodies) size += 2 * body->position.size() * sizeof(double);
    return size;
  }

  std::vector<std::byte> save() const {
    std::vector<std::byte> state(sizeof(Header));
    state.reserve(saved_bytes());
    for (const auto& body : bodies)
      for (const auto* values : {&body->position, &body->velocity}) {
        const auto bytes = std::as_bytes(std::span(*values));
        state.insert(state.end(), bytes.begin(), bytes.end());
      }
    Header header{0, state.size()};
    std::memcpy(state.data(), &header, sizeof header);
    header.checksum = checksum(std::span(state).subspan(sizeof header.checksum));
    std::memcpy(state.data(), &header, sizeof header);
    return state;
  }

  void restore(std::span<const std::byte> state) {
    Header header{};
    const bool fits = state.size() == saved_bytes();
    if (fits) std::memcpy(&header, state.data(), sizeof header);
    if (!fits || header.size != state.size() || header.checksum != checksum(state.subspan(sizeof header.checksum)))
      throw std::runtime_error("this is not a saved state of these bodies");
    const std::byte* from = state.data() + sizeof header;
    for (const auto& body : bodies) {
      for (auto* values : {&body->position, &body->velocity}) {
        std::memcpy(values->data(), from, values->size() * sizeof(double));
        from += values->size() * sizeof(double);
      }
      body->solid.evaluate(Threads(), body->position, body->response);
      follow(Threads(), *body);
    }
  }
};

}  // namespace

CLEAVE_PLUGIN(FiniteElements)
