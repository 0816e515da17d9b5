#include "app/validate_command.hpp"

#include "common/error.hpp"
#include "config/scene.hpp"
#include "discretization/simulation.hpp"
#include "mpm/material.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <optional>

namespace cleave::app {
namespace {

using config::Body;
using config::Material;
using config::Scene;

/// Area (2D) or volume (3D) of a shape, from a lattice of points over its bounds.
double estimate_volume(const scene::SignedDistance& shape, int dimension) {
  constexpr int per_axis = 64;
  const Box bounds = shape.bounds();
  if (bounds.isEmpty()) return 0;
  const Vector3 spacing = bounds.sizes() / per_axis;
  const int layers = dimension == 2 ? 1 : per_axis;
  long inside = 0;
  for (int i = 0; i < per_axis; ++i)
    for (int j = 0; j < per_axis; ++j)
      for (int k = 0; k < layers; ++k) {
        Vector3 x = bounds.min() + spacing.cwiseProduct(Vector3(i + 0.5, j + 0.5, k + 0.5));
        if (dimension == 2) x.z() = 0;
        inside += shape.distance(x) < 0;
      }
  return double(inside) * spacing.x() * spacing.y() * (dimension == 2 ? 1 : spacing.z());
}

double cell_volume(const Scene& scene) { return std::pow(scene.simulation.cell_size, scene.simulation.dimension); }

/// Number of particles of a body. Reads its files, so this is also where a broken one shows.
double estimate_particles(const Scene& scene, const Body& body) {
  const int dimension = scene.simulation.dimension;
  const int per_cell = body.sampling.particles_per_cell;
  if (body.particle_file)
    return double(scene::read_particles(*body.particle_file, dimension, cell_volume(scene) / per_cell).positions.size());
  const auto shape = scene::build_shape(*body.shape, scene.simulation.cell_size);
  if (!shape->bounds().isEmpty() && !shape->bounds().sizes().allFinite())
    throw InputError("the shape of body '" + body.name + "' has no end; intersect it with a bounded one");
  const double volume = estimate_volume(*shape, dimension);
  if (volume == 0) throw InputError("the shape of body '" + body.name + "' holds no particle");
  return volume / cell_volume(scene) * per_cell;
}

/// "12", "1300", "1.2 million"
std::string rounded(double count) {
  if (count >= 1e6) return fmt::format("{:.3g} million", count / 1e6);
  if (count < 100) return fmt::format("{:.0f}", count);
  const double unit = std::pow(10, std::floor(std::log10(count)) - 1);
  return fmt::format("{:.0f}", std::round(count / unit) * unit);
}

std::string laws_of(const Material& material) {
  std::string text = material.discretization ? material.discretization->id : material.elasticity.id;
  if (material.discretization && !material.elasticity.id.empty()) text += ", " + material.elasticity.id;
  for (const auto* use : {&material.plasticity, &material.damage, &material.constraint})
    if (*use) text += ", " + (*use)->id;
  return text;
}

/// "2180 tetrahedra, 604 vertices, edges of 0.04 to 0.1 m, dihedral angles of 39.8 to 100 degrees".
std::string summary_of(const scene::TetrahedralMesh& mesh) {
  const auto m = scene::measure(mesh);
  const double degrees = 180 / EIGEN_PI;
  std::string text = fmt::format(
      "{} tetrahedra, {} vertices, {:.4g} m^3, edges of {:.3g} to {:.3g} m, dihedral angles of {:.3g} to "
      "{:.3g} degrees",
      mesh.tetrahedra.size(), mesh.vertices.size(), m.volume, m.shortest_edge, m.longest_edge, m.least_dihedral_angle * degrees,
      m.greatest_dihedral_angle * degrees);
  if (m.pieces > 1) text += fmt::format(", in {} pieces", m.pieces);
  return text;
}

struct Estimate {
  std::vector<double> particles;    ///< by body
  std::vector<std::string> meshes;  ///< by body, empty without tetrahedra
  double cells = 0;
  std::vector<std::string> errors;
};

Estimate estimate(const Scene& scene) {
  Estimate result;
  const auto attempt = [&](const config::Location& where, const auto& work) {
    try {
      work();
    } catch (const InputError& error) {
      result.errors.push_back(config::to_string(where) + ": error: " + error.what());
    }
  };
  for (const Body& body : scene.bodies) {
    double particles = 0;
    std::string mesh;
    attempt(body.where, [&] {
      if (!body.tetrahedra) {
        particles = estimate_particles(scene, body);
        result.cells += particles / body.sampling.particles_per_cell;
      } else {
        const auto built = scene::build_tetrahedra(*body.tetrahedra, body.shape ? &*body.shape : nullptr);
        particles = double(built.tetrahedra.size());
        mesh = summary_of(built);
      }
    });
    result.particles.push_back(particles);
    result.meshes.push_back(mesh);
  }
  for (const auto& collider : scene.colliders)
    attempt(collider.where, [&] { scene::build_shape(collider.shape, scene.simulation.cell_size); });
  for (const auto& handle : scene.handles)
    attempt(handle.where, [&] { scene::build_shape(handle.region, scene.simulation.cell_size); });
  return result;
}

void print_summary(const Scene& scene, const Estimate& estimate) {
  const config::Simulation& simulation = scene.simulation;
  double particles = 0;
  for (const double count : estimate.particles) particles += count;
  if (estimate.cells > 0)
    fmt::print("ok: {}D, {} precision, cells of {:g} m, {:g} s at {:g} frames/s, about {} particles in {} cells\n",
               simulation.dimension, simulation.precision == config::Precision::single_precision ? "single" : "double",
               simulation.cell_size, simulation.end_time, simulation.frame_rate, rounded(particles), rounded(estimate.cells));
  else
    fmt::print("ok: {}D, {:g} s at {:g} frames/s, {} tetrahedra\n", simulation.dimension, simulation.end_time,
               simulation.frame_rate, rounded(particles));
  for (const Material& material : scene.materials)
    fmt::print("  material {}: {:g} kg/m^3, {}\n", material.name, material.density, laws_of(material));
  for (std::size_t i = 0; i < scene.bodies.size(); ++i)
    if (estimate.meshes[i].empty())
      fmt::print("  body {}: {}, about {} particles\n", scene.bodies[i].name, scene.bodies[i].material,
                 rounded(estimate.particles[i]));
    else
      fmt::print("  body {}: {}, {}\n", scene.bodies[i].name, scene.bodies[i].material, estimate.meshes[i]);
  for (const auto& collider : scene.colliders)
    fmt::print("  collider {}{}\n", collider.name, collider.motion.at_rest() ? "" : ", moving");
  for (const auto& handle : scene.handles)
    fmt::print("  handle {}{}\n", handle.name, handle.body.empty() ? "" : " of " + handle.body);
}

bool has_discretizations(const Scene& scene) {
  return std::any_of(scene.materials.begin(), scene.materials.end(), [](const Material& m) { return bool(m.discretization); });
}

}  // namespace

int validate_command(const std::filesystem::path& file, const std::vector<std::string>& sets, plugins::Registry registry) {
  std::optional<Scene> scene;
  std::vector<std::string> warnings;
  Estimate estimated;
  try {
    std::vector<config::Override> overrides;
    for (const std::string& set : sets) overrides.push_back(config::parse_override(set));
    scene = config::load_scene(file, overrides, registry, &warnings);
    estimated = estimate(*scene);
    const auto unsupported = mpm::unsupported(*scene, registry);
    estimated.errors.insert(estimated.errors.begin(), unsupported.begin(), unsupported.end());
    // What a discretization takes and shows is known to its instance alone.
    if (estimated.errors.empty() && has_discretizations(*scene)) discretization::simulate(*scene, registry);
  } catch (const InputError& error) {
    fmt::print(stderr, "{}\n", error.what());
    return 2;
  }
  for (const std::string& warning : warnings) fmt::print(stderr, "{}\n", warning);
  for (const std::string& error : estimated.errors) fmt::print(stderr, "{}\n", error);
  if (!estimated.errors.empty()) return 2;
  print_summary(*scene, estimated);
  return 0;
}

}  // namespace cleave::app
