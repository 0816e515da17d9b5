#pragma once

#include "plugins/registry.hpp"
#include "scene/fiber_field.hpp"
#include "scene/rigid_motion.hpp"
#include "scene/sampling.hpp"
#include "scene/shape.hpp"
#include "scene/tetrahedra.hpp"
#include "scene/variation.hpp"

#include <filesystem>
#include <optional>
#include <string>
#include <vector>

namespace cleave::config {

/// Place in a configuration file, 1-based. line 0: not from a file (an override given on the command line).
struct Location {
  std::string file;
  int line = 0, column = 0;
};
std::string to_string(const Location&);  ///< "scene.toml:12:5"
/// How a message about something in a scene begins: "scene.toml:12:5: error: ", nothing for what is not from a file.
inline std::string error_at(const Location& where) { return where.line > 0 ? to_string(where) + ": error: " : ""; }

enum class Precision { single_precision, double_precision };
enum class Transfer { apic, flip, pic };

enum class Laplacian { weak, cubic };

/// How the evolution of damage is integrated; what is integrated is the damage law's.
struct DamageSolver {
  int passes = 1;           ///< of damage and motion per step
  double tolerance = 1e-5;  ///< of the implicit solve: what is left out of balance, relative to driving forces and damage
  int maximum_iterations = 200;
  Laplacian laplacian = Laplacian::weak;  ///< of explicit integration
  bool active_set = true;                 ///< leave out blocks that damage cannot reach
  bool operator==(const DamageSolver&) const = default;
};

enum class Integrator {
  symplectic,  ///< symplectic Euler: forces of the state the step starts from
  implicit,    ///< backward Euler: forces of the state it ends in
  automatic    ///< whichever is predicted to cost less
};

/// How the equations of an implicit step are solved.
struct ImplicitSolver {
  double tolerance = 1e-3;              ///< impulses out of balance, relative to those that balance
  int maximum_iterations = 30;          ///< of Newton's method
  int maximum_linear_iterations = 500;  ///< of conjugate gradients, in each of them
  bool operator==(const ImplicitSolver&) const = default;
};

struct Simulation {
  int dimension = 3;
  double cell_size = 0;             ///< m
  double end_time = 0;              ///< s
  double frame_rate = 24;           ///< frames per simulated second
  std::optional<double> time_step;  ///< s; empty: automatic
  double maximum_time_step = 0;     ///< s, upper limit of the automatic step; 0: none
  double cfl = 0.4;                 ///< fraction of the elastic limit dx/c for the automatic step
  Precision precision = Precision::single_precision;
  Vector3 gravity = Vector3(0, 0, 0);  ///< m/s^2
  Transfer transfer = Transfer::apic;
  double flip_ratio = 0.95;  ///< of Transfer::flip
  Integrator integrator = Integrator::symplectic;
  ImplicitSolver implicit;
  DamageSolver damage;
};

/// A plugin with the parameters the scene gives it, checked against its schema.
struct PluginUse {
  std::string id;  ///< "elasticity/split-neo-hookean"
  plugins::GivenParameters parameters;
  Location where;
};

using Fibers = scene::FiberSpec;

struct Material {
  std::string name;
  double density = 0;    ///< kg/m^3
  PluginUse elasticity;  ///< without an id: none, of a discretization that evaluates none
  std::optional<PluginUse> plasticity, damage, constraint;
  std::optional<PluginUse> discretization;  ///< steps its bodies as a whole; no law then but an elastic one
  std::optional<Fibers> fibers;
  Location where;
};

struct Spin {
  Vector3 angular_velocity = Vector3::Zero();  ///< rad/s
  std::optional<Vector3> center;               ///< m; empty: the body's centre of mass
};

struct Body {
  std::string name;
  std::string material;
  std::optional<scene::ShapeSpec> shape;  ///< one of shape, particle_file and a file of tetrahedra
  std::optional<std::filesystem::path> particle_file;
  /// The body is cut into these, and its points are their barycentres: of its shape, or those of a file.
  std::optional<scene::TetrahedraSpec> tetrahedra;
  scene::SamplingSpec sampling;
  Vector3 velocity = Vector3::Zero();
  Spin spin;
  std::optional<Fibers> fibers;                   ///< empty: the material's
  std::optional<scene::VariationSpec> toughness;  ///< factor on the toughness of the material's damage law; empty: 1
  Location where;
};

enum class Contact {
  sticky,   ///< no relative motion
  slip,     ///< free along the surface (friction applies), never off it
  separate  ///< the same, but free to leave
};

struct Collider {
  std::string name;
  scene::ShapeSpec shape;
  Contact contact = Contact::separate;
  double friction = 0;  ///< Coulomb coefficient
  scene::RigidMotion motion;
  Location where;
};

/// Particles of `body` (all bodies if empty) inside `region` at the start follow `motion` until `release`.
struct Handle {
  std::string name;
  std::string body;
  scene::ShapeSpec region;
  scene::RigidMotion motion;
  double release = std::numeric_limits<double>::infinity();  ///< s
  Location where;
};

/// When the state of a run is kept, for it to be resumed from.
struct CheckpointTimes {
  int frames = 0;        ///< every so many frames; 0: not by frames
  double seconds = 120;  ///< of wall time between two; 0: not by time
  bool any() const { return frames > 0 || seconds > 0; }
  bool operator==(const CheckpointTimes&) const = default;
};

/// What colours of particles and meshes show.
struct ColorBy {
  std::string by;                                  ///< "body", "speed" or an attribute
  std::optional<std::pair<double, double>> range;  ///< from the first to the last colour
  bool operator==(const ColorBy&) const = default;
};

struct Output {
  std::vector<std::string> formats = {"vdb"};  ///< any of "vdb", "vtp", "ply", "usd"
  bool surface = false;                        ///< vdb: also a level set of each body's surface
  std::vector<std::string> attributes;  ///< beyond id and velocity: state names, "F", "J", "damage", ...; empty: all declared
  /// Formats of the surfaces of discretized bodies: any of "ply", "obj", "vtp", "vtu"; no value: "ply" where bodies have one.
  std::optional<std::vector<std::string>> meshes;
  std::optional<ColorBy> color;
  CheckpointTimes checkpoint;
};

struct Scene {
  std::filesystem::path file;
  Simulation simulation;
  std::vector<Material> materials;
  std::vector<Body> bodies;
  std::vector<Collider> colliders;
  std::vector<Handle> handles;
  Output output;
};

/// "path=value" from the command line: path as simulation.cell_size, material.0.density or material.clay.density,
/// value as TOML (bare words are taken as strings).
struct Override {
  std::string path, value;
};
Override parse_override(const std::string&);

/// Reads and checks a scene completely: every key known (else the nearest known one), every type, bound and combination, plugin
/// parameters against the plugin's own schema, files present. All problems are reported at once, one per line as
/// "file:line:column: error: what. what would be right". Throws InputError with all of them.
Scene load_scene(const std::filesystem::path&, const std::vector<Override>&, const plugins::Registry&,
                 std::vector<std::string>* warnings = nullptr);

/// The scene as a complete TOML file that load_scene reads back to the same scene: every default written out, paths absolute.
std::string to_toml(const Scene&, const plugins::Registry&);

}  // namespace cleave::config
