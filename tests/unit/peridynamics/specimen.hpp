// Bodies of points that discretization/peridynamics steps, as a host would.
#pragma once

#include "../../lent_threads.hpp"

#include <gtest/gtest.h>
#include <cleave/testkit/body.hpp>

#include <cmath>
#include <cstring>
#include <functional>
#include <map>
#include <memory>
#include <stdexcept>

namespace cleave::test {

using testkit::Point;
using testkit::Settings;

/// The library for the processor at hand.
inline const testkit::Plugin& peridynamics() {
  static const testkit::Plugin plugin([] {
    const std::string directory = CLEAVE_PLUGINS;
#if defined(__x86_64__)
    for (const auto& [supported, isa] :
         {std::pair(__builtin_cpu_supports("avx512f") && __builtin_cpu_supports("avx512vl") &&
                        __builtin_cpu_supports("avx512dq") && __builtin_cpu_supports("avx512bw"),
                    "/x86-64-v4"),
          std::pair(__builtin_cpu_supports("avx2") && __builtin_cpu_supports("fma"), "/x86-64-v3")})
      if (supported && std::filesystem::exists(directory + isa + "/peridynamics.so"))
        return directory + isa + "/peridynamics.so";
#endif
    return directory + "/peridynamics.so";
  }());
  return plugin;
}

/// A box of nx x ny x nz points, `spacing` apart, each with the volume of its cube.
struct Points {
  std::vector<double> position, velocity, volume;
  std::vector<double> vertices;  ///< of tetrahedra around the points, if there are any
  std::vector<std::uint32_t> tetrahedra;
  double spacing = 0.01, density = 1000;
  std::uint32_t dimension = 3;

  static Points box(int nx, int ny, int nz, const Point& corner = {}, double spacing = 0.01) {
    Points p;
    p.spacing = spacing;
    for (int i = 0; i < nx; ++i)
      for (int j = 0; j < ny; ++j)
        for (int k = 0; k < nz; ++k) p.add({corner[0] + i * spacing, corner[1] + j * spacing, corner[2] + k * spacing});
    return p;
  }
  /// nx x ny x nz cubes of six tetrahedra [Kuhn 1960], the vertices inside moved at random by up to a tenth of an edge.
  static Points mesh(int nx, int ny, int nz, const Point& corner = {}, double edge = 0.01) {
    Points p;
    p.spacing = edge / std::cbrt(6.0);
    unsigned seed = 7;
    const auto vertex = [&](int i, int j, int k) { return std::uint32_t((i * (ny + 1) + j) * (nz + 1) + k); };
    for (int i = 0; i <= nx; ++i)
      for (int j = 0; j <= ny; ++j)
        for (int k = 0; k <= nz; ++k)
          for (const auto& [at, last, low] : {std::tuple(i, nx, corner[0]), {j, ny, corner[1]}, {k, nz, corner[2]}}) {
            seed = seed * 1664525u + 1013904223u;
            const double jitter = at > 0 && at < last ? 0.2 * (seed >> 8) / (1u << 24) - 0.1 : 0;
            p.vertices.push_back(low + (at + jitter) * edge);
          }
    for (int i = 0; i < nx; ++i)
      for (int j = 0; j < ny; ++j)
        for (int k = 0; k < nz; ++k)
          for (const auto& axes : {std::array{0, 1, 2}, {0, 2, 1}, {1, 0, 2}, {1, 2, 0}, {2, 0, 1}, {2, 1, 0}}) {
            std::array<int, 3> at = {i, j, k};
            std::uint32_t corners[4] = {vertex(at[0], at[1], at[2])};
            for (std::size_t a = 0; a < 3; ++a) {
              ++at[std::size_t(axes[a])];
              corners[a + 1] = vertex(at[0], at[1], at[2]);
            }
            p.tetrahedra.insert(p.tetrahedra.end(), corners, corners + 4);
            Point centre{};
            for (const std::uint32_t v : corners)
              for (std::size_t a = 0; a < 3; ++a) centre[a] += p.vertices[3 * v + a] / 4;
            p.add(centre);
            p.volume.back() = std::abs(p.tetrahedron_volume(&p.tetrahedra[p.tetrahedra.size() - 4], p.vertices));
          }
    return p;
  }
  static double tetrahedron_volume(const std::uint32_t* corners, const std::vector<double>& vertices) {
    double e[3][3];
    for (std::size_t a = 0; a < 3; ++a)
      for (std::size_t c = 0; c < 3; ++c) e[a][c] = vertices[3 * corners[a + 1] + c] - vertices[3 * corners[0] + c];
    return (e[0][0] * (e[1][1] * e[2][2] - e[1][2] * e[2][1]) + e[0][1] * (e[1][2] * e[2][0] - e[1][0] * e[2][2]) +
            e[0][2] * (e[1][0] * e[2][1] - e[1][1] * e[2][0])) /
           6;
  }
  void add(const Point& x) {
    position.insert(position.end(), x.begin(), x.end());
    velocity.insert(velocity.end(), 3, 0.0);
    volume.push_back(std::pow(spacing, dimension));
  }
  std::size_t size() const { return volume.size(); }
  double mass() const { return density * volume.front(); }
  Point at(std::size_t i) const { return {position[3 * i], position[3 * i + 1], position[3 * i + 2]}; }

  /// Velocities that lead to map(x) in one step of this length.
  Points& towards(const std::function<Point(const Point&)>& map, double step) {
    for (std::size_t i = 0; i < size(); ++i) {
      const Point y = map(at(i));
      for (std::size_t a = 0; a < 3; ++a) velocity[3 * i + a] = (y[a] - position[3 * i + a]) / step;
    }
    return *this;
  }
  Points& shake(double speed, unsigned seed = 1) {
    for (double& v : velocity) {
      seed = seed * 1664525u + 1013904223u;
      v += speed * (2.0 * (seed >> 8) / (1u << 24) - 1);
    }
    return *this;
  }
};

using Texts = std::map<std::string, std::string>;

class Specimen {
 public:
  /// mu = 1e5 Pa, kappa = 2e5 Pa unless given.
  explicit Specimen(Texts parameters = {})
      : instance_(std::make_unique<testkit::Instance>(
            peridynamics(), testkit::read_settings(peridynamics().schema(), with_moduli(std::move(parameters))))) {}

  Specimen& add(const Points& points) {
    cleave_body body{};
    body.struct_size = sizeof body;
    body.dimension = points.dimension;
    body.name = "body";
    body.density = points.density;
    body.spacing = points.spacing;
    body.point_count = points.size();
    body.position = points.position.data();
    body.velocity = points.velocity.data();
    body.volume = points.volume.data();
    body.vertex_count = points.vertices.size() / 3;
    body.vertices = points.vertices.data();
    body.tetrahedron_count = points.tetrahedra.size() / 4;
    body.tetrahedra = points.tetrahedra.data();
    const LentThreads pool(threads);
    body.threads = pool.get();
    testkit::Words words;
    if (table().add_body(instance_->handle(), &body, &words.message) != CLEAVE_OK) throw std::runtime_error(words.said());
    counts_.push_back(points.size());
    return *this;
  }

  std::array<double, 3> gravity{};
  unsigned threads = 1;
  std::function<bool(std::size_t body, std::size_t point, Point& position, Point& velocity)> handle;
  std::function<void(const Point& position, Point& velocity)> collider;

  double stable_step() const { return table().stable_step(instance_->handle()); }
  Specimen& step(double time_step, int count = 1) {
    const LentThreads pool(threads);
    cleave_surroundings surroundings{};
    surroundings.struct_size = sizeof surroundings;
    std::copy(gravity.begin(), gravity.end(), surroundings.gravity);
    surroundings.user = this;
    surroundings.threads = pool.get();
    surroundings.collide = [](void* user, std::uint64_t n, const double* position, double* velocity) {
      const auto& self = *static_cast<Specimen*>(user);
      for (std::uint64_t i = 0; self.collider && i < n; ++i) {
        Point v{velocity[3 * i], velocity[3 * i + 1], velocity[3 * i + 2]};
        self.collider({position[3 * i], position[3 * i + 1], position[3 * i + 2]}, v);
        std::copy(v.begin(), v.end(), velocity + 3 * i);
      }
    };
    surroundings.handle = [](void* user, std::uint64_t body, std::uint32_t, std::uint64_t point, double* position,
                             double* velocity) -> std::int32_t {
      const auto& self = *static_cast<Specimen*>(user);
      Point x{}, v{};
      if (!self.handle || !self.handle(body, point, x, v)) return 0;
      std::copy(x.begin(), x.end(), position);
      std::copy(v.begin(), v.end(), velocity);
      return 1;
    };
    for (int n = 0; n < count; ++n) {
      testkit::Words words;
      if (table().step(instance_->handle(), time_step, &surroundings, &words.message) != CLEAVE_OK)
        throw std::runtime_error(words.said());
    }
    return *this;
  }

  std::vector<double> field(const std::string& name, std::size_t body = 0) const {
    cleave_point_field field{};
    field.struct_size = sizeof field;
    for (std::uint32_t f = 0; f < table().point_field(instance_->handle(), body, f, &field); ++f)
      if (name == field.name) return {field.values, field.values + field.components * counts_.at(body)};
    ADD_FAILURE() << "no field " << name;
    return {};
  }
  struct Surface {
    std::vector<double> vertices, velocity, damage;
    std::vector<std::uint32_t> triangles, piece, tetrahedra;
    bool operator==(const Surface&) const = default;
  };
  Surface surface(std::size_t body = 0) const {
    cleave_surface s{};
    s.struct_size = sizeof s;
    if (const auto result = table().surface(instance_->handle(), body, &s); result != CLEAVE_OK)
      throw std::runtime_error("surface() returns " + std::to_string(result));
    return {{s.vertices, s.vertices + 3 * s.vertex_count}, {s.velocity, s.velocity + 3 * s.vertex_count},
            {s.damage, s.damage + s.vertex_count},         {s.triangles, s.triangles + 3 * s.triangle_count},
            {s.piece, s.piece + s.vertex_count},           {s.tetrahedra, s.tetrahedra + 4 * s.tetrahedron_count}};
  }
  std::vector<unsigned char> save() const {
    std::vector<unsigned char> bytes(table().save(instance_->handle(), nullptr, 0));
    bytes.resize(table().save(instance_->handle(), bytes.data(), bytes.size()));
    return bytes;
  }
  void restore(const std::vector<unsigned char>& bytes) {
    testkit::Words words;
    if (table().restore(instance_->handle(), bytes.data(), bytes.size(), &words.message) != CLEAVE_OK)
      throw std::runtime_error(words.said());
  }

 private:
  static Texts with_moduli(Texts parameters) {
    if (!parameters.contains("youngs_modulus")) {
      parameters.try_emplace("shear_modulus", "1e5");
      parameters.try_emplace("bulk_modulus", "2e5");
    }
    return parameters;
  }
  static const cleave_discretization& table() {
    return *static_cast<const cleave_discretization*>(peridynamics().kind_table());
  }

  std::unique_ptr<testkit::Instance> instance_;
  std::vector<std::size_t> counts_;
};

struct Momentum {
  Point linear{}, angular{};
  double size = 0, angular_size = 0;  ///< sum m |v|, sum m |x| |v|
};
/// Of equal masses 1.
inline Momentum momentum(const std::vector<double>& x, const std::vector<double>& v) {
  Momentum sum;
  for (std::size_t i = 0; i < x.size(); i += 3) {
    for (std::size_t a = 0; a < 3; ++a) {
      const std::size_t b = (a + 1) % 3, c = (a + 2) % 3;
      sum.linear[a] += v[i + a];
      sum.angular[a] += x[i + b] * v[i + c] - x[i + c] * v[i + b];
    }
    const double speed = std::hypot(v[i], v[i + 1], v[i + 2]);
    sum.size += speed;
    sum.angular_size += speed * std::hypot(x[i], x[i + 1], x[i + 2]);
  }
  return sum;
}

inline double largest(const std::vector<double>& values) {
  double most = 0;
  for (const double value : values) most = std::max(most, std::abs(value));
  return most;
}

}  // namespace cleave::test
