// Bodies of tetrahedra that a discretization steps, as a host would, with elastic laws written here.
#pragma once

#include "../../lent_threads.hpp"

#include <gtest/gtest.h>
#include <cleave/decompositions.hpp>
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
using Texts = std::map<std::string, std::string>;
using Tensor = Matrix3<double>;

/// The library for the processor at hand.
inline const testkit::Plugin& library(const std::string& name) {
  static std::map<std::string, std::unique_ptr<testkit::Plugin>> open;
  auto& plugin = open[name];
  if (plugin) return *plugin;
  std::filesystem::path file = std::filesystem::path(CLEAVE_PLUGINS) / (name + ".so");
#if defined(__x86_64__)
  for (const auto& [supported, isa] : {std::pair(__builtin_cpu_supports("avx512f") && __builtin_cpu_supports("avx512vl") &&
                                                     __builtin_cpu_supports("avx512dq") && __builtin_cpu_supports("avx512bw"),
                                                 "x86-64-v4"),
                                       std::pair(__builtin_cpu_supports("avx2") && __builtin_cpu_supports("fma"), "x86-64-v3")})
    if (const auto faster = std::filesystem::path(CLEAVE_PLUGINS) / isa / (name + ".so");
        supported && std::filesystem::exists(faster)) {
      file = faster;
      break;
    }
#endif
  plugin = std::make_unique<testkit::Plugin>(file);
  return *plugin;
}

// ---------------------------------------------------------------- elastic laws

/// An elastic law that is lent to a body.
class Law {
 public:
  Law(double youngs_modulus, double poissons_ratio)
      : mu(youngs_modulus / (2 * (1 + poissons_ratio))),
        lambda(youngs_modulus * poissons_ratio / ((1 + poissons_ratio) * (1 - 2 * poissons_ratio))) {}
  virtual ~Law() = default;
  Law(const Law&) = delete;
  Law& operator=(const Law&) = delete;

  const double mu, lambda;  ///< Pa

  const cleave_elastic_response* table() const { return &table_; }

  virtual double energy(const Tensor& F) const = 0;
  virtual Tensor stress(const Tensor& F) const = 0;
  virtual Tensor differential(const Tensor& F, const Tensor& dF) const = 0;
  virtual bool defined(const Tensor&) const { return true; }
  /// The largest m n : dP(m n) of unit vectors m and n, or something above it.
  virtual double wave_modulus(const Tensor& F) const = 0;

 private:
  static Tensor matrix(const double* values) {
    Tensor F;
    for (int k = 0; k < 9; ++k) F[k] = values[k];
    return F;
  }
  static cleave_result evaluate(void* self, std::uint64_t first, std::uint64_t count, const double* F, double* energy,
                                double* P, cleave_message* message) {
    const Law& law = *static_cast<const Law*>(self);
    for (std::uint64_t i = 0; i < count; ++i) {
      const Tensor f = matrix(F + 9 * i);
      if (!law.defined(f)) {
        std::snprintf(message->text, message->text_capacity, "point %d is inside out", int(first + i));
        return CLEAVE_ERROR_INTERNAL;
      }
      if (energy) energy[i] = law.energy(f);
      const Tensor p = law.stress(f);
      for (int k = 0; P && k < 9; ++k) P[9 * i + std::uint64_t(k)] = p[k];
    }
    return CLEAVE_OK;
  }
  static cleave_result differentials(void* self, std::uint64_t, std::uint64_t count, const double* F, const double* dF,
                                     double* dP, cleave_message*) {
    const Law& law = *static_cast<const Law*>(self);
    for (std::uint64_t i = 0; i < count; ++i) {
      const Tensor p = law.differential(matrix(F + 9 * i), matrix(dF + 9 * i));
      for (int k = 0; k < 9; ++k) dP[9 * i + std::uint64_t(k)] = p[k];
    }
    return CLEAVE_OK;
  }
  static cleave_result wave_moduli(void* self, std::uint64_t, std::uint64_t count, const double* F, double* modulus,
                                   cleave_message*) {
    const Law& law = *static_cast<const Law*>(self);
    for (std::uint64_t i = 0; i < count; ++i) modulus[i] = law.wave_modulus(matrix(F + 9 * i));
    return CLEAVE_OK;
  }

  cleave_elastic_response table_{sizeof(cleave_elastic_response), 0, this, &evaluate, &differentials, &wave_moduli};
};

/// psi = lambda/2 (tr E)^2 + mu |E|^2, E = (F^T F - I)/2
struct SaintVenantKirchhoff : Law {
  using Law::Law;
  Tensor strain(const Tensor& F) const { return 0.5 * (transpose(F) * F - identity<double>()); }
  Tensor second(const Tensor& E) const { return lambda * trace(E) * Tensor(identity<double>()) + 2 * mu * E; }
  double energy(const Tensor& F) const override {
    const Tensor E = strain(F);
    return 0.5 * lambda * trace(E) * trace(E) + mu * squared_norm(E);
  }
  Tensor stress(const Tensor& F) const override { return F * second(strain(F)); }
  Tensor differential(const Tensor& F, const Tensor& dF) const override {
    const Tensor A = transpose(F) * dF, dE = 0.5 * (A + transpose(A));
    return dF * second(strain(F)) + F * second(dE);
  }
  double wave_modulus(const Tensor& F) const override {
    const auto C = symmetric_eigen(right_cauchy_green(F)), S = symmetric_eigen(symmetric_part(second(strain(F))));
    return (lambda + 2 * mu) * std::max({C.values[0], C.values[1], C.values[2]}) +
           std::max({S.values[0], S.values[1], S.values[2], 0.0});
  }
};

/// psi = mu/2 (|F|^2 - 3) - mu ln J + lambda/2 (ln J)^2, J > 0
struct NeoHookean : Law {
  using Law::Law;
  double energy(const Tensor& F) const override {
    const double l = std::log(determinant(F));
    return 0.5 * mu * (squared_norm(F) - 3) - mu * l + 0.5 * lambda * l * l;
  }
  Tensor stress(const Tensor& F) const override {
    const Tensor inverse_transposed = transpose(inverse(F));
    return mu * (F - inverse_transposed) + lambda * std::log(determinant(F)) * inverse_transposed;
  }
  Tensor differential(const Tensor& F, const Tensor& dF) const override {
    const Tensor G = transpose(inverse(F));
    return mu * dF + (mu - lambda * std::log(determinant(F))) * (G * transpose(dF) * G) + lambda * contract(G, dF) * G;
  }
  bool defined(const Tensor& F) const override { return determinant(F) > 0; }
  double wave_modulus(const Tensor& F) const override {
    const auto C = symmetric_eigen(right_cauchy_green(F));
    return mu +
           std::max(mu + lambda - lambda * std::log(determinant(F)), 0.0) / std::min({C.values[0], C.values[1], C.values[2]});
  }
};

// ---------------------------------------------------------------- bodies

struct Tets {
  std::vector<double> vertices, velocity;
  std::vector<std::uint32_t> tetrahedra;
  double density = 1000;

  /// nx x ny x nz cells of this size, six tetrahedra (Kuhn) in each.
  static Tets box(int nx, int ny, int nz, const Point& cell, const Point& corner = {}) {
    Tets body;
    for (int i = 0; i <= nx; ++i)
      for (int j = 0; j <= ny; ++j)
        for (int k = 0; k <= nz; ++k)
          for (const double x : {corner[0] + i * cell[0], corner[1] + j * cell[1], corner[2] + k * cell[2]})
            body.vertices.push_back(x);
    body.velocity.resize(body.vertices.size());
    constexpr int orders[6][3] = {{0, 1, 2}, {1, 2, 0}, {2, 0, 1}, {0, 2, 1}, {2, 1, 0}, {1, 0, 2}};
    for (int i = 0; i < nx; ++i)
      for (int j = 0; j < ny; ++j)
        for (int k = 0; k < nz; ++k)
          for (int o = 0; o < 6; ++o) {
            int at[3] = {i, j, k};
            std::uint32_t c[4];
            for (int n = 0; n < 4; ++n) {
              if (n > 0) ++at[orders[o][n - 1]];
              c[n] = std::uint32_t((at[0] * (ny + 1) + at[1]) * (nz + 1) + at[2]);
            }
            if (o >= 3) std::swap(c[2], c[3]);
            body.tetrahedra.insert(body.tetrahedra.end(), c, c + 4);
          }
    return body;
  }

  /// nx x ny x nz cells, cut into tetrahedra about the lines from centre to centre, and at the sides to those of the faces.
  static Tets body_centred(int nx, int ny, int nz, const Point& cell, const Point& corner = {}) {
    Tets body;
    std::map<std::array<int, 3>, std::uint32_t> numbers;  // of places in halves of a cell
    const auto vertex = [&](const std::array<int, 3>& place) {
      const auto [at, is_new] = numbers.emplace(place, std::uint32_t(body.size()));
      for (std::size_t a = 0; is_new && a < 3; ++a) body.vertices.push_back(corner[a] + 0.5 * cell[a] * place[a]);
      return at->second;
    };
    const int n[3] = {nx, ny, nz};
    for (int i = 0; i < nx; ++i)
      for (int j = 0; j < ny; ++j)
        for (int k = 0; k < nz; ++k)
          for (std::size_t axis = 0; axis < 3; ++axis)
            for (const int side : {-1, 1}) {
              const std::array<int, 3> centre = {2 * i + 1, 2 * j + 1, 2 * k + 1};
              auto other = centre, p = centre, q = centre;
              const bool outside = centre[axis] + 2 * side < 0 || centre[axis] + 2 * side > 2 * n[axis];
              if (!outside && side < 0) continue;  // the other cell has it
              other[axis] += outside ? side : 2 * side;
              p[axis] += side;
              q[axis] += side;
              const std::size_t b = (axis + 1) % 3, c = (axis + 2) % 3;
              constexpr int round[5][2] = {{-1, -1}, {1, -1}, {1, 1}, {-1, 1}, {-1, -1}};
              for (int e = 0; e < 4; ++e) {
                p[b] = centre[b] + round[e][0];
                p[c] = centre[c] + round[e][1];
                q[b] = centre[b] + round[e + 1][0];
                q[c] = centre[c] + round[e + 1][1];
                std::uint32_t corners[4] = {vertex(centre), vertex(other), vertex(p), vertex(q)};
                if (side < 0) std::swap(corners[2], corners[3]);
                body.tetrahedra.insert(body.tetrahedra.end(), corners, corners + 4);
              }
            }
    body.velocity.resize(body.vertices.size());
    return body;
  }

  std::size_t size() const { return vertices.size() / 3; }
  std::size_t points() const { return tetrahedra.size() / 4; }
  Point at(std::size_t v) const { return {vertices[3 * v], vertices[3 * v + 1], vertices[3 * v + 2]}; }
  double volume(std::size_t t) const {
    Tensor edges;
    for (int i = 0; i < 3; ++i)
      for (int k = 0; k < 3; ++k)
        edges(i, k) = at(tetrahedra[4 * t + std::size_t(k) + 1])[std::size_t(i)] - at(tetrahedra[4 * t])[std::size_t(i)];
    return determinant(edges) / 6;
  }
  /// Of each vertex: a quarter of its tetrahedra's.
  std::vector<double> masses() const {
    std::vector<double> mass(size());
    for (std::size_t n = 0; n < tetrahedra.size(); ++n) mass[tetrahedra[n]] += 0.25 * density * volume(n / 4);
    return mass;
  }
  double total_volume() const {
    double sum = 0;
    for (std::size_t t = 0; t < points(); ++t) sum += volume(t);
    return sum;
  }
  Tets& shake(double speed, unsigned seed = 1) {
    for (double& v : velocity) {
      seed = seed * 1664525u + 1013904223u;
      v += speed * (2.0 * (seed >> 8) / (1u << 24) - 1);
    }
    return *this;
  }
};

/// A discretization with its bodies.
class Specimen {
 public:
  explicit Specimen(const Texts& parameters = {}, const std::string& plugin = "fem")
      : instance_(
            std::make_unique<testkit::Instance>(library(plugin), testkit::read_settings(library(plugin).schema(), parameters))),
        table_(*static_cast<const cleave_discretization*>(library(plugin).kind_table())) {}

  Specimen& add(const Tets& tets, const Law* law) { return add(tets, law ? law->table() : nullptr); }
  Specimen& add(const Tets& tets, const cleave_elastic_response* elasticity = nullptr) {
    std::vector<double> position, velocity, volume;
    double sum = 0;
    for (std::size_t t = 0; t < tets.points(); ++t) {
      for (std::size_t a = 0; a < 3; ++a) {
        const auto mean = [&](const std::vector<double>& values) {
          double total = 0;
          for (std::size_t n = 0; n < 4; ++n) total += 0.25 * values[3 * tets.tetrahedra[4 * t + n] + a];
          return total;
        };
        position.push_back(mean(tets.vertices));
        velocity.push_back(mean(tets.velocity));
      }
      volume.push_back(tets.volume(t));
      sum += volume.back();
    }
    cleave_body body{};
    body.struct_size = sizeof body;
    body.dimension = 3;
    body.name = "body";
    body.density = tets.density;
    body.spacing = std::cbrt(sum / double(tets.points()));
    body.point_count = tets.points();
    body.position = position.data();
    body.velocity = velocity.data();
    body.volume = volume.data();
    body.vertex_count = tets.size();
    body.vertices = tets.vertices.data();
    body.tetrahedron_count = tets.points();
    body.tetrahedra = tets.tetrahedra.data();
    body.vertex_velocity = tets.velocity.data();
    body.elasticity = elasticity;
    testkit::Words words;
    if (table_.add_body(instance_->handle(), &body, &words.message) != CLEAVE_OK) throw std::runtime_error(words.said());
    rest_.push_back(tets);
    volumes_.push_back(volume);
    return *this;
  }

  std::array<double, 3> gravity{};
  unsigned threads = 1;
  /// Motion of a vertex (of a point, if the discretization asks for points) by its place at rest.
  std::function<bool(const Point& rest, Point& position, Point& velocity)> handle;
  std::function<void(const Point& position, Point& velocity)> collider;

  double stable_step() const { return table_.stable_step(instance_->handle()); }
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
    surroundings.handle = [](void* user, std::uint64_t body, std::uint32_t entity, std::uint64_t index, double* position,
                             double* velocity) -> std::int32_t {
      const auto& self = *static_cast<Specimen*>(user);
      const Tets& tets = self.rest_.at(body);
      Point rest{};
      for (std::size_t n = 0; n < 4; ++n)
        for (std::size_t a = 0; a < 3; ++a)
          rest[a] += 0.25 * tets.vertices[3 * (entity == CLEAVE_VERTEX ? index : tets.tetrahedra[4 * index + n]) + a];
      Point x = rest, v{};
      if (!self.handle || !self.handle(rest, x, v)) return 0;
      std::copy(x.begin(), x.end(), position);
      std::copy(v.begin(), v.end(), velocity);
      return 1;
    };
    for (int n = 0; n < count; ++n) {
      testkit::Words words;
      if (table_.step(instance_->handle(), time_step, &surroundings, &words.message) != CLEAVE_OK)
        throw std::runtime_error(words.said());
    }
    return *this;
  }

  std::vector<double> field(const std::string& name, std::size_t body = 0) const {
    cleave_point_field field{};
    field.struct_size = sizeof field;
    for (std::uint32_t f = 0; f < table_.point_field(instance_->handle(), body, f, &field); ++f)
      if (name == field.name) return {field.values, field.values + field.components * volumes_.at(body).size()};
    ADD_FAILURE() << "no field " << name;
    return {};
  }
  /// J, of the field "energy".
  double elastic_energy() const {
    double sum = 0;
    const auto density = field("energy");
    for (std::size_t t = 0; t < density.size(); ++t) sum += density[t] * volumes_.front()[t];
    return sum;
  }
  cleave_surface surface(std::size_t body = 0) const {
    cleave_surface surface{};
    surface.struct_size = sizeof surface;
    if (table_.surface(instance_->handle(), body, &surface) != CLEAVE_OK) throw std::runtime_error("no surface");
    return surface;
  }
  std::vector<double> vertices(std::size_t body = 0) const {
    const auto s = surface(body);
    return {s.vertices, s.vertices + 3 * s.vertex_count};
  }
  std::vector<double> vertex_velocity(std::size_t body = 0) const {
    const auto s = surface(body);
    return {s.velocity, s.velocity + 3 * s.vertex_count};
  }
  std::vector<unsigned char> save() const {
    std::vector<unsigned char> bytes(table_.save(instance_->handle(), nullptr, 0));
    bytes.resize(table_.save(instance_->handle(), bytes.data(), bytes.size()));
    return bytes;
  }
  void restore(const std::vector<unsigned char>& bytes) {
    testkit::Words words;
    if (table_.restore(instance_->handle(), bytes.data(), bytes.size(), &words.message) != CLEAVE_OK)
      throw std::runtime_error(words.said());
  }

 private:
  std::unique_ptr<testkit::Instance> instance_;
  const cleave_discretization& table_;
  std::vector<Tets> rest_;
  std::vector<std::vector<double>> volumes_;
};

struct Momentum {
  Point linear{}, angular{};
  double size = 0, angular_size = 0;  ///< sum m |v|, sum m |x| |v|
};
inline Momentum momentum(const std::vector<double>& mass, const std::vector<double>& x, const std::vector<double>& v) {
  Momentum sum;
  for (std::size_t i = 0; i < mass.size(); ++i) {
    for (std::size_t a = 0; a < 3; ++a) {
      const std::size_t b = (a + 1) % 3, c = (a + 2) % 3;
      sum.linear[a] += mass[i] * v[3 * i + a];
      sum.angular[a] += mass[i] * (x[3 * i + b] * v[3 * i + c] - x[3 * i + c] * v[3 * i + b]);
    }
    const double speed = mass[i] * std::hypot(v[3 * i], v[3 * i + 1], v[3 * i + 2]);
    sum.size += speed;
    sum.angular_size += speed * std::hypot(x[3 * i], x[3 * i + 1], x[3 * i + 2]);
  }
  return sum;
}
inline double kinetic_energy(const std::vector<double>& mass, const std::vector<double>& v) {
  double sum = 0;
  for (std::size_t k = 0; k < v.size(); ++k) sum += 0.5 * mass[k / 3] * v[k] * v[k];
  return sum;
}

}  // namespace cleave::test
