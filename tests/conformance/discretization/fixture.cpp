#include <cleave/discretization.hpp>

#include "kit/broken.hpp"

#include <algorithm>
#include <cmath>
#include <cstdlib>
#include <cstring>
#include <map>
#include <stdexcept>

namespace {

/// Points joined by springs to their neighbours within 1.5 spacings, to be broken: the force of a bond is
///   f = k (|y| - |xi|) y/|y|,  xi at rest, y as it is.
/// Of a body of tetrahedra what has moved by more than an edge is a piece of its own.
struct Springs {
  static constexpr cleave::About about{.id = "discretization/fixture", .version = "1.0.0", .summary = "Springs to be broken"};
  static constexpr double stiffness = 1e3;  ///< N/m

  struct Bond {
    std::size_t i, j;
    std::array<double, 3> rest;
    double stiffness;
  };
  struct Body {
    std::vector<double> position, velocity, mass;
    std::vector<Bond> bonds;
    std::vector<std::uint32_t> tetrahedra;
    std::vector<double> rest, vertices;
    double edge = 0;
    std::optional<cleave::ElasticResponse> law;
    double step = 1e-3;
    const double* kept = nullptr;
  };
  std::vector<Body> bodies;
  static inline int steps_of_all = 0;

  static std::vector<double> identities(std::size_t count) {
    std::vector<double> F(9 * count);
    for (std::size_t c = 0; c < F.size(); ++c) F[c] = c % 9 % 4 == 0 ? 1 : 0;
    return F;
  }
  /// Asks the law for the stress of the points at rest.
  static void look_at_law(const Body& body) {
    if (!body.law || broken("elastic_ignored")) return;
    const std::size_t count = body.mass.size() + (broken("elastic_beyond") ? 1 : 0);
    std::vector<double> P(9 * count);
    try {
      body.law->evaluate(0, identities(count), {}, P);
    } catch (const std::exception&) {
      if (broken("elastic_reworded")) throw std::runtime_error("something is wrong");
      if (!broken("elastic_swallowed")) throw;
    }
  }

  static double norm(const std::array<double, 3>& a) { return std::sqrt(a[0] * a[0] + a[1] * a[1] + a[2] * a[2]); }

  void add_body(const cleave_body& given) {
    if (broken("takes_nothing")) throw cleave::UnsupportedError{"no bodies at all"};
    if (!given.tetrahedron_count && (broken("needs_mesh") || broken("uneven_springs_of_mesh") || broken("holds_vertices")))
      throw cleave::UnsupportedError{"it has no tetrahedra"};
    if (given.point_count == 0 && broken("wordless")) throw std::runtime_error("");
    if (given.point_count == 0 && broken("reads_first_point") && given.position[0] == 1) return;
    Body body;
    const std::size_t n = given.point_count;
    body.position.assign(given.position, given.position + 3 * n);
    body.velocity.assign(given.velocity, given.velocity + 3 * n);
    if (broken("starts_at_rest")) std::fill(body.velocity.begin(), body.velocity.end(), 0.0);
    body.kept = given.velocity;
    body.tetrahedra.assign(given.tetrahedra, given.tetrahedra + 4 * given.tetrahedron_count);
    body.vertices.assign(given.vertices, given.vertices + 3 * given.vertex_count);
    body.rest = body.position;
    body.edge = given.spacing;
    // How stiff springs are follows the elastic law of the material, if there is one.
    double scale = 1;
    body.law = cleave::elasticity_of(given);
    if (body.law && n > 0 && !broken("elastic_ignored")) {
      double modulus;
      body.law->wave_modulus(0, identities(1), {&modulus, 1});
      scale = modulus / 7e5;
    }
    std::vector<double> sum(n);
    for (std::size_t i = 0; i < n; ++i) {
      body.mass.push_back(given.density * given.volume[i]);
      for (std::size_t j = i + 1; j < n; ++j) {
        Bond bond{i, j, {}, scale * stiffness};
        for (std::size_t a = 0; a < 3; ++a) bond.rest[a] = given.position[3 * j + a] - given.position[3 * i + a];
        if (norm(bond.rest) > 1.5 * given.spacing) continue;
        if (broken("uneven_springs") || broken("uneven_springs_of_mesh"))
          bond.stiffness *= 1 + 1e-3 * double((i * i + j * j) % 5);
        sum[i] += bond.stiffness;
        sum[j] += bond.stiffness;
        body.bonds.push_back(bond);
      }
    }
    // Gershgorin: omega^2 <= 2 sum k / m.
    for (std::size_t i = 0; i < n; ++i)
      if (sum[i] > 0) body.step = std::min(body.step, 0.8 * std::sqrt(2 * body.mass[i] / sum[i]));
    bodies.push_back(body);
  }

  double stable_step() const {
    if (broken("no_step")) return 0;
    double step = 1e-3;
    for (const Body& body : bodies) step = std::min(step, body.step);
    return broken("too_long_a_step") ? 3 * step : step;
  }

  /// Of a mesh whose vertices are held, a barycentre is held with all of its four.
  std::optional<cleave::World::Motion> held(const cleave::World& world, std::size_t b, std::size_t i) const {
    if (!broken("holds_vertices")) return world.handle(b, i);
    cleave::World::Motion mean{};
    for (std::size_t c = 0; c < 4; ++c) {
      const auto motion = world.vertex_handle(b, bodies[b].tetrahedra[4 * i + c]);
      if (!motion) return {};
      for (std::size_t a = 0; a < 3; ++a) {
        mean.position[a] += 0.25 * motion->position[a];
        mean.velocity[a] += 0.25 * motion->velocity[a];
      }
    }
    return mean;
  }

  void step(double dt, const cleave::World& world) {
    for (std::size_t b = 0; b < bodies.size(); ++b) {
      Body& body = bodies[b];
      auto &x = body.position, &v = body.velocity;
      look_at_law(body);
      if (broken("sums_as_threads_come") && !v.empty()) {
        double sum = 0;
        world.threads().for_ranges(body.mass.size(), 64,
                                   [&](std::uint64_t first, std::uint64_t) { sum = 0.9 * sum + 1e-12 * v[3 * first]; });
        v[0] += sum;
      }
      if (broken("threads_in_threads"))
        world.threads().for_ranges(body.mass.size(), 64, [&](std::uint64_t, std::uint64_t) {
          world.threads().for_ranges(1, 1, [](std::uint64_t, std::uint64_t) {});
        });
      if (broken("keeps_body_arrays") && body.kept && body.kept[0] == 12345) v[0] = 0;
      for (const Bond& bond : body.bonds) {
        std::array<double, 3> y;
        for (std::size_t a = 0; a < 3; ++a) y[a] = x[3 * bond.j + a] - x[3 * bond.i + a];
        const double now = norm(y), rest = norm(bond.rest);
        double extension = now - rest;
        if (broken("linear_strain")) {
          extension = -rest;
          for (std::size_t a = 0; a < 3; ++a) extension += bond.rest[a] * y[a] / rest;
        }
        for (std::size_t a = 0; a < 3; ++a) {
          double force = bond.stiffness * extension * y[a] / now;
          if (broken("sideways_forces")) force += 0.01 * bond.stiffness * extension * y[(a + 1) % 3] / now;
          v[3 * bond.i + a] += dt * force / body.mass[bond.i];
          v[3 * bond.j + a] -= dt * force / body.mass[bond.j] * (broken("momentum_leak") ? 1.001 : 1);
        }
      }
      const auto gravity = world.gravity();
      ++steps_of_all;
      for (std::size_t i = 0; i < v.size(); ++i) {
        if (!broken("ignores_gravity")) v[i] += dt * gravity[i % 3];
        if (broken("air_drag")) v[i] *= 1 - 1e-6;
        if (broken("counts_steps")) v[i] *= 1 + 1e-15 * (steps_of_all % 7);
      }
      std::vector<double> free = v;
      if (!broken("ignores_colliders")) world.collide(x, v);
      if (!broken("ignores_handles"))
        for (std::size_t i = 0; i < body.mass.size(); ++i)
          if (const auto motion = held(world, broken("handles_of_first_body") ? 0 : b, i)) {
            std::copy(motion->position.begin(), motion->position.end(), &x[3 * i]);
            std::copy(motion->velocity.begin(), motion->velocity.end(), &v[3 * i]);
            std::fill_n(&free[3 * i], 3, 0.0);
          } else {
            for (std::size_t a = 0; a < 3; ++a)
              x[3 * i + a] += dt * (broken("moves_before_colliding") ? free[3 * i + a] : v[3 * i + a]);
          }
      else
        for (std::size_t i = 0; i < x.size(); ++i) x[i] += dt * v[i];
    }
  }

  std::vector<cleave::PointField> fields(std::uint64_t index) const {
    if (index >= bodies.size()) return {};
    const Body& body = bodies[index];
    std::vector<cleave::PointField> all = {{"position", "m", 3, body.position}, {"velocity", "m/s", 3, body.velocity}};
    if (broken("no_velocity")) all.pop_back();
    if (broken("no_unit")) all.push_back({"mass", "", 1, body.mass});
    if (broken("capital_field")) all.push_back({"Mass", "kg", 1, body.mass});
    return all;
  }

  /// Of what surface() shows; vertices of the piece that has moved follow those of the rest.
  mutable std::vector<double> shown, damage;
  mutable std::vector<std::uint32_t> triangles, shown_tetrahedra, piece;

  std::optional<cleave::SurfaceMesh> surface(std::uint64_t index) const {
    if (index >= bodies.size() || bodies[index].tetrahedra.empty() || broken("no_surface")) return {};
    const Body& body = bodies[index];
    const auto count = std::uint32_t(body.vertices.size() / 3);
    shown = body.vertices;
    shown_tetrahedra = body.tetrahedra;
    piece.assign(count, 0);
    const std::size_t points = body.mass.size();
    for (std::size_t i = 0; i < points; ++i) {
      if (std::abs(body.position[3 * i] - body.rest[3 * i]) < body.edge) continue;
      if (shown.size() == body.vertices.size()) {
        shown.insert(shown.end(), body.vertices.begin(), body.vertices.end());
        piece.resize(2 * count, broken("one_number_for_all_pieces") ? 0 : broken("numbers_pieces_from_one") ? 2 : 1);
      }
      for (std::size_t c = 4 * i; c < 4 * i + 4; ++c) {
        const std::uint32_t vertex = body.tetrahedra[c];
        for (std::size_t a = 0; a < 3; ++a)
          shown[3 * (count + vertex) + a] = body.vertices[3 * vertex + a] + body.position[3 * i + a] - body.rest[3 * i + a];
        if (!broken("stays_in_one_piece")) shown_tetrahedra[c] = count + vertex;
      }
    }
    triangles.clear();
    constexpr int faces[4][3] = {{1, 2, 3}, {0, 3, 2}, {0, 1, 3}, {0, 2, 1}};
    std::map<std::array<std::uint32_t, 3>, std::pair<int, std::array<std::uint32_t, 3>>> all;
    for (std::size_t i = 0; i < points; ++i)
      for (const auto& face : faces) {
        std::array<std::uint32_t, 3> corners, sorted;
        for (std::size_t k = 0; k < 3; ++k) corners[k] = shown_tetrahedra[4 * i + std::size_t(face[k])];
        sorted = corners;
        std::sort(sorted.begin(), sorted.end());
        auto& [times, seen] = all[sorted];
        ++times;
        seen = corners;
      }
    for (const auto& [sorted, face] : all)
      if (face.first == 1) triangles.insert(triangles.end(), face.second.begin(), face.second.end());
    if (broken("turned_triangle")) std::swap(triangles[0], triangles[1]);
    if (broken("looks_inwards"))
      for (std::size_t t = 0; t < triangles.size(); t += 3) std::swap(triangles[t], triangles[t + 1]);
    if (broken("triangle_twice")) triangles.insert(triangles.end(), triangles.begin(), triangles.begin() + 3);
    if (broken("hole")) triangles.resize(triangles.size() - 3);
    if (broken("dangling_triangle")) triangles[0] = 1000000;
    if (broken("loses_tetrahedron")) shown_tetrahedra.resize(shown_tetrahedra.size() - 4);
    damage.assign(shown.size() / 3, broken("damage_above_one") ? 2 : 0);
    return cleave::SurfaceMesh{.vertices = shown,
                               .triangles = triangles,
                               .velocity = {},
                               .damage = damage,
                               .piece = piece,
                               .tetrahedra = shown_tetrahedra};
  }

  static constexpr std::uint64_t magic = 0x53676e6972707331;
  std::vector<std::byte> save() const {
    std::vector<std::byte> bytes;
    const auto append = [&](const void* from, std::size_t size) {
      const auto* begin = static_cast<const std::byte*>(from);
      bytes.insert(bytes.end(), begin, begin + size);
    };
    append(&magic, sizeof magic);
    for (const Body& body : bodies) {
      const std::uint64_t count = body.position.size();
      append(&count, sizeof count);
      append(body.position.data(), count * sizeof(double));
      if (!broken("saves_positions_only")) append(body.velocity.data(), count * sizeof(double));
    }
    static int saves = 0;
    if (broken("saves_grow")) bytes.resize(bytes.size() + std::size_t(++saves / 2));
    return bytes;
  }
  void restore(std::span<const std::byte> bytes) {
    std::size_t next = 0;
    const auto take = [&](void* to, std::size_t size) {
      if (!broken("reads_any_bytes") && size > bytes.size() - next) throw std::runtime_error("the state is cut off");
      if (size > 0) std::memcpy(to, bytes.data() + next, size);
      next += size;
    };
    std::uint64_t tag = 0;
    take(&tag, sizeof tag);
    if (tag != magic && !broken("reads_any_bytes")) throw std::runtime_error("this is no state of springs");
    for (Body& body : bodies) {
      std::uint64_t count = 0;
      take(&count, sizeof count);
      if (broken("reads_any_bytes")) body.position.resize(std::min<std::uint64_t>(count, 1u << 20));
      if (count != body.velocity.size()) throw std::runtime_error(broken("refuses_wordless") ? "" : "a state of other bodies");
      take(body.position.data(), count * sizeof(double));
      if (!broken("saves_positions_only")) take(body.velocity.data(), count * sizeof(double));
    }
    if (next != bytes.size() && !broken("ignores_what_follows") && !broken("saves_grow"))
      throw std::runtime_error("the state is longer than it should be");
  }
};

/// What the header of the kind would not let an author write.
using Plugin = cleave::detail::PluginOf<Springs>;

std::uint32_t point_field(const cleave_instance* instance, std::uint64_t body, std::uint32_t index, cleave_point_field* field) {
  cleave_point_field whole{};
  whole.struct_size = sizeof whole;
  const std::uint32_t count = Plugin::Table::point_field(instance, body, index, &whole);
  whole.struct_size = field->struct_size;
  if (broken("fills_short_field")) *field = whole;
  if (broken("fills_any_field")) Plugin::Table::point_field(instance, body, std::min(index, count - 1), field);
  return count;
}

std::uint64_t save(const cleave_instance* instance, void* buffer, std::uint64_t size) {
  const std::uint64_t written = Plugin::Table::save(instance, buffer, size);
  if (buffer && broken("saves_beyond_buffer")) static_cast<std::byte*>(buffer)[size] = std::byte{0};
  return written;
}

const void* kind(const char* id) {
  static cleave_discretization table = *static_cast<const cleave_discretization*>(Plugin::Table::table());
  if (broken("fills_short_field") || broken("fills_any_field")) table.point_field = &point_field;
  table.save = &save;
  return std::strcmp(id, CLEAVE_KIND_DISCRETIZATION) == 0 ? &table : nullptr;
}

}  // namespace

extern "C" CLEAVE_EXPORT cleave_result cleave_plugin_entry(const cleave_host* host, const cleave_plugin** plugin) {
  const cleave_result result = Plugin::entry(host, plugin);
  if (result != CLEAVE_OK) return result;
  static cleave_plugin changed = **plugin;
  static cleave_schema schema = *changed.schema;
  for (const char* name : {"elastic", "elastic_ignored", "elastic_beyond", "elastic_swallowed", "elastic_reworded"})
    if (broken(name)) schema.capabilities |= CLEAVE_NEEDS_ELASTICITY;
  if (broken("says_it_needs_mesh")) schema.capabilities |= CLEAVE_NEEDS_TETRAHEDRA;
  changed.schema = &schema;
  changed.kind = &kind;
  *plugin = &changed;
  return result;
}
