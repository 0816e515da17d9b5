/// Discretisations: a class with `about`, `parameters` where it has any, and
///
///   void add_body(const cleave_body& body);                          bodies are numbered from 0 in call order
///   double stable_step() const;                                      s
///   void step(double time_step, const World& world);
///   std::vector<PointField> fields(std::uint64_t body) const;        "position" and "velocity" are among them,
///                                                                    names as in <cleave/discretization.h>
///   std::vector<std::byte> save() const;                             the complete state
///   void restore(std::span<const std::byte> state);
///   std::optional<SurfaceMesh> surface(std::uint64_t body) const;    may be left out
///   static constexpr bool needs_elasticity = true;                   may be left out; elasticity_of(body) is then there
///   static constexpr bool needs_tetrahedra = true;                   may be left out; body.tetrahedra is then there
///
/// Arrays behind spans belong to the class and stay valid until the next step. Shapes are described in
/// <cleave/discretization.h>. An exception ends the run with its text.
#ifndef CLEAVE_DISCRETIZATION_HPP
#define CLEAVE_DISCRETIZATION_HPP

#include <cleave/discretization.h>
#include <cleave/detail/saved_state.hpp>
#include <cleave/plugin.hpp>
#include <cleave/threads.hpp>

#include <cstddef>
#include <span>
#include <utility>

namespace cleave {

/// What surrounds the bodies during a step.
class World {
 public:
  explicit World(const cleave_surroundings& surroundings) : surroundings_(surroundings) {}

  /// m/s^2
  std::array<double, 3> gravity() const {
    return {surroundings_.gravity[0], surroundings_.gravity[1], surroundings_.gravity[2]};
  }
  Threads threads() const {
    return Threads(CLEAVE_HAS(cleave_surroundings, &surroundings_, threads) ? surroundings_.threads : nullptr);
  }
  /// Replaces velocities (3 per point) by what the colliders of the scene allow. May be called by several threads.
  void collide(std::span<const double> position, std::span<double> velocity) const {
    surroundings_.collide(surroundings_.user, position.size() / 3, position.data(), velocity.data());
  }
  /// Position and velocity, at the end of the step, of a point or vertex that a handle moves; empty if it is free. May be
  /// called by several threads.
  struct Motion {
    std::array<double, 3> position, velocity;
  };
  std::optional<Motion> handle(std::uint64_t body, std::uint64_t point) const { return held(body, CLEAVE_POINT, point); }
  std::optional<Motion> vertex_handle(std::uint64_t body, std::uint64_t vertex) const {
    return held(body, CLEAVE_VERTEX, vertex);
  }

 private:
  std::optional<Motion> held(std::uint64_t body, cleave_entity entity, std::uint64_t index) const {
    Motion motion;
    if (!surroundings_.handle(surroundings_.user, body, entity, index, motion.position.data(), motion.velocity.data()))
      return {};
    return motion;
  }
  const cleave_surroundings& surroundings_;
};

/// Threads that add_body may use.
inline Threads threads_of(const cleave_body& body) {
  return Threads(CLEAVE_HAS(cleave_body, &body, threads) ? body.threads : nullptr);
}

/// m/s, 3 per vertex; empty if the host gives none.
inline std::span<const double> vertex_velocity_of(const cleave_body& body) {
  if (!CLEAVE_HAS(cleave_body, &body, vertex_velocity) || !body.vertex_velocity) return {};
  return {body.vertex_velocity, 3 * body.vertex_count};
}

/// The elastic law of a body's material. Matrices are row-major, 9 numbers per point, `first` the number of the body's first
/// point among them. Members may be called by several threads, and throw what the law says where it is not defined.
class ElasticResponse {
 public:
  explicit ElasticResponse(const cleave_elastic_response& response) : response_(&response) {}

  /// psi [J/m^3] and P(F) [Pa]; either may be empty. psi is NaN if the law offers none.
  void evaluate(std::uint64_t first, std::span<const double> F, std::span<double> energy, std::span<double> P) const {
    checked([&](cleave_message* message) {
      return response_->evaluate(response_->user, first, F.size() / 9, F.data(), energy.empty() ? nullptr : energy.data(),
                                 P.empty() ? nullptr : P.data(), message);
    });
  }
  /// dP [Pa], the change of P(F) with dF.
  void differential(std::uint64_t first, std::span<const double> F, std::span<const double> dF, std::span<double> dP) const {
    checked([&](cleave_message* message) {
      return response_->differential(response_->user, first, F.size() / 9, F.data(), dF.data(), dP.data(), message);
    });
  }
  /// M [Pa]: waves travel at most sqrt(M/density) in rest coordinates.
  void wave_modulus(std::uint64_t first, std::span<const double> F, std::span<double> modulus) const {
    checked([&](cleave_message* message) {
      return response_->wave_modulus(response_->user, first, F.size() / 9, F.data(), modulus.data(), message);
    });
  }

 private:
  /// Calls with a buffer for the reason, and throws that.
  template <class Call>
  static void checked(const Call& call) {
    char text[512] = "", subject[64] = "";
    cleave_message message{sizeof message, sizeof text, text, sizeof subject, 0, subject};
    if (call(&message) != CLEAVE_OK) throw std::runtime_error(text[0] ? text : "the elastic law gives no reason");
  }

  const cleave_elastic_response* response_;
};

/// Empty if the material has no elastic law; always there with `needs_elasticity`.
inline std::optional<ElasticResponse> elasticity_of(const cleave_body& body) {
  if (!CLEAVE_HAS(cleave_body, &body, elasticity) || !body.elasticity) return {};
  return ElasticResponse(*body.elasticity);
}

/// Values per point; name and unit are literals or otherwise outlive the field.
struct PointField {
  const char* name;
  const char* unit;
  std::uint32_t components;  ///< 1, 3 or 9
  std::span<const double> values;
};

/// As cleave_surface; what is not given is empty.
struct SurfaceMesh {
  std::span<const double> vertices;           ///< m, 3 per vertex
  std::span<const std::uint32_t> triangles;   ///< 3 per triangle, normals outwards
  std::span<const double> velocity;           ///< m/s, 3 per vertex
  std::span<const double> damage;             ///< 1 per vertex
  std::span<const std::uint32_t> piece;       ///< 1 per vertex
  std::span<const std::uint32_t> tetrahedra;  ///< 4 per tetrahedron, in the order of the body
};

namespace detail {

template <class Method>
struct KindOf<Kind::discretization, Method> {
  struct Instance {
    Method law;
  };
  static void prepare(Instance&, const cleave_context*) {}
  static constexpr bool needs_elasticity() {
    if constexpr (requires { Method::needs_elasticity; }) return Method::needs_elasticity;
    return false;
  }
  static constexpr bool needs_tetrahedra() {
    if constexpr (requires { Method::needs_tetrahedra; }) return Method::needs_tetrahedra;
    return false;
  }
  static constexpr std::uint64_t capabilities =
      CLEAVE_DOUBLE | (needs_elasticity() ? CLEAVE_NEEDS_ELASTICITY : 0) | (needs_tetrahedra() ? CLEAVE_NEEDS_TETRAHEDRA : 0);

  static Method& method(cleave_instance* instance) { return reinterpret_cast<Instance*>(instance)->law; }
  static const Method& method(const cleave_instance* instance) { return reinterpret_cast<const Instance*>(instance)->law; }

  static cleave_result add_body(cleave_instance* instance, const cleave_body* body, cleave_message* message) noexcept {
    return guarded(message, [&]() -> cleave_result {
      method(instance).add_body(*body);
      return CLEAVE_OK;
    });
  }
  /// Not a number if it cannot be told.
  static double stable_step(const cleave_instance* instance) noexcept {
    double step = std::numeric_limits<double>::quiet_NaN();
    guarded(nullptr, [&]() -> cleave_result {
      step = method(instance).stable_step();
      return CLEAVE_OK;
    });
    return step;
  }
  static cleave_result step(cleave_instance* instance, double time_step, const cleave_surroundings* surroundings,
                            cleave_message* message) noexcept {
    return guarded(message, [&]() -> cleave_result {
      method(instance).step(time_step, World(*surroundings));
      return CLEAVE_OK;
    });
  }
  static std::uint32_t point_field(const cleave_instance* instance, std::uint64_t body, std::uint32_t index,
                                   cleave_point_field* field) noexcept {
    std::uint32_t count = 0;
    guarded(nullptr, [&]() -> cleave_result {
      const std::vector<PointField> fields = method(instance).fields(body);
      count = std::uint32_t(fields.size());
      if (index < count && field && CLEAVE_HAS(cleave_point_field, field, values)) {
        field->components = fields[index].components;
        field->name = fields[index].name;
        field->unit = fields[index].unit;
        field->values = fields[index].values.data();
      }
      return CLEAVE_OK;
    });
    return count;
  }
  static cleave_result surface(cleave_instance* instance, std::uint64_t body, cleave_surface* surface) noexcept {
    return guarded(nullptr, [&]() -> cleave_result {
      if constexpr (requires(const Method& m) { m.surface(body); }) {
        const std::optional<SurfaceMesh> mesh = std::as_const(method(instance)).surface(body);
        if (!mesh || !CLEAVE_HAS(cleave_surface, surface, triangles)) return CLEAVE_ERROR_UNSUPPORTED;
        surface->vertex_count = mesh->vertices.size() / 3;
        surface->vertices = mesh->vertices.data();
        surface->triangle_count = mesh->triangles.size() / 3;
        surface->triangles = mesh->triangles.data();
        if (!CLEAVE_HAS(cleave_surface, surface, tetrahedra)) return CLEAVE_OK;
        const auto given = [](auto values) { return values.empty() ? nullptr : values.data(); };
        surface->velocity = given(mesh->velocity);
        surface->damage = given(mesh->damage);
        surface->piece = given(mesh->piece);
        surface->tetrahedron_count = mesh->tetrahedra.size() / 4;
        surface->tetrahedra = given(mesh->tetrahedra);
        return CLEAVE_OK;
      } else {
        return CLEAVE_ERROR_UNSUPPORTED;
      }
    });
  }
  static std::uint64_t save(const cleave_instance* instance, void* buffer, std::uint64_t size) noexcept {
    std::uint64_t written = 0;
    guarded(nullptr, [&]() -> cleave_result {
      written = hand_over(method(instance).save(), buffer, size);
      return CLEAVE_OK;
    });
    return written;
  }
  static cleave_result restore(cleave_instance* instance, const void* buffer, std::uint64_t size,
                               cleave_message* message) noexcept {
    return guarded(message, [&]() -> cleave_result {
      method(instance).restore(std::span(static_cast<const std::byte*>(buffer), size));
      return CLEAVE_OK;
    });
  }

  static const char* id() { return CLEAVE_KIND_DISCRETIZATION; }
  static const void* table() {
    static constexpr cleave_discretization table{
        sizeof(cleave_discretization), 0, &add_body, &stable_step, &step, &point_field, &surface, &save, &restore};
    return &table;
  }
  static const void* extension(const char*) { return nullptr; }
};

}  // namespace detail
}  // namespace cleave

#endif
