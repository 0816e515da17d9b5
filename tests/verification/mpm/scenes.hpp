#pragma once

#include "common/error.hpp"
#include "config/scene.hpp"
#include "mpm/simulation.hpp"
#include "plugins/registry.hpp"

#include <algorithm>
#include <filesystem>
#include <fstream>
#include <iomanip>
#include <string>
#include <vector>

/// Scenes built in code for verification: particles are given one by one, so that a case controls everything.
namespace cleave::test {

inline plugins::Registry& registry() {
  static plugins::Registry r([] {
    auto path = plugins::Registry::default_search_path();
    path.push_back(CLEAVE_BINARY_DIR "/tests/point_plugins");  // laws made for tests
    return path;
  }());
  return r;
}

/// A directory that goes away with the object.
class TemporaryDirectory {
 public:
  TemporaryDirectory() {
    std::string name = (std::filesystem::temp_directory_path() / "cleave-test-XXXXXX").string();
    path_ = mkdtemp(name.data());
  }
  ~TemporaryDirectory() { std::filesystem::remove_all(path_); }
  TemporaryDirectory(const TemporaryDirectory&) = delete;
  TemporaryDirectory& operator=(const TemporaryDirectory&) = delete;
  const std::filesystem::path& path() const { return path_; }

 private:
  std::filesystem::path path_;
};

struct Point {
  Vector3 x = Vector3::Zero(), v = Vector3::Zero();
  double volume = 1;
  Matrix3 F = Matrix3::Identity();
};

/// Velocities are left to the body if no point has one.
inline void write_particles(const std::filesystem::path& file, const std::vector<Point>& points) {
  std::ofstream out(file);
  const bool moving = std::any_of(points.begin(), points.end(), [](const Point& p) { return !p.v.isZero(); });
  out << std::setprecision(17) << "x,y,z," << (moving ? "vx,vy,vz," : "") << "volume,F00,F01,F02,F10,F11,F12,F20,F21,F22\n";
  for (const auto& p : points) {
    out << p.x[0] << ',' << p.x[1] << ',' << p.x[2] << ',';
    if (moving) out << p.v[0] << ',' << p.v[1] << ',' << p.v[2] << ',';
    out << p.volume;
    for (int i = 0; i < 9; i++) out << ',' << p.F(i / 3, i % 3);
    out << '\n';
  }
}

/// All behind the plane through `point`.
inline config::Collider half_space(config::Contact contact, const Vector3& normal, const Vector3& point = Vector3::Zero()) {
  config::Collider collider;
  collider.name = "half-space";
  collider.contact = contact;
  collider.shape.type = scene::ShapeSpec::Type::half_space;
  collider.shape.axis = normal;
  collider.shape.center = point;
  return collider;
}

/// A scene of one body made of the given points.
class PointScene {
 public:
  config::Scene scene;

  PointScene(int dimension, double cell_size, const std::vector<Point>& points, const std::string& law,
             const plugins::GivenParameters& parameters, double density) {
    write_particles(directory_.path() / "points.csv", points);
    auto& s = scene.simulation;
    s.dimension = dimension;
    s.cell_size = cell_size;
    s.end_time = 1;
    s.precision = config::Precision::double_precision;
    config::Material m;
    m.name = "material";
    m.density = density;
    m.elasticity.id = law;
    m.elasticity.parameters = parameters;
    scene.materials.push_back(m);
    config::Body b;
    b.name = "body";
    b.material = "material";
    b.particle_file = directory_.path() / "points.csv";
    scene.bodies.push_back(b);
  }

  std::unique_ptr<mpm::Simulation> start() const { return mpm::Simulation::create(scene, registry()); }

 private:
  TemporaryDirectory directory_;
};

/// Points at the centres of equal sub-cells, `per_axis` to a cell, that fill the box [low, high).
inline std::vector<Point> lattice(int dimension, double cell_size, int per_axis, const Vector3& low, const Vector3& high) {
  std::vector<Point> points;
  const double h = cell_size / per_axis;
  Index3 n;
  for (int a = 0; a < 3; a++) n[a] = a < dimension ? int(std::lround((high[a] - low[a]) / h)) : 1;
  for (int i = 0; i < n[0]; i++)
    for (int j = 0; j < n[1]; j++)
      for (int k = 0; k < n[2]; k++) {
        Point p;
        p.x = low + h * Vector3(i + 0.5, j + 0.5, k + 0.5);
        if (dimension == 2) p.x.z() = 0;
        p.volume = std::pow(h, dimension);
        points.push_back(p);
      }
  return points;
}

}  // namespace cleave::test
