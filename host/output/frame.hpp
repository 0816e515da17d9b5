#pragma once

#include "common/types.hpp"

#include <algorithm>
#include <array>
#include <cstdint>
#include <filesystem>
#include <memory>
#include <optional>
#include <string>
#include <vector>

namespace cleave::output {

using Color = std::array<std::uint8_t, 3>;  ///< red, green, blue; sRGB

/// One per-particle quantity; values.size() == components * particles, particle by particle.
struct Attribute {
  std::string name;
  int components = 1;  ///< 1, 3, 6 (symmetric: xx yy zz xy xz yz) or 9 (row-major)
  std::string unit;
  std::vector<float> values;
};

/// A body as it looks from outside, and what it consists of inside if that is known. Where it has come apart vertices are there
/// twice.
struct BodyMesh {
  std::int32_t body = 0;                ///< index into the frame's bodies
  std::vector<double> vertices;         ///< m, 3 per vertex
  std::vector<float> velocity, damage;  ///< 3 and 1 per vertex; may be empty
  std::vector<Color> colors;            ///< 1 per vertex; may be empty
  std::vector<std::int32_t> piece;      ///< 1 per vertex, numbered from 0; -1: of none
  std::int32_t pieces = 0;
  std::vector<std::uint32_t> triangles;   ///< 3 vertices each, normals outwards
  std::vector<std::uint32_t> tetrahedra;  ///< 4 vertices each; may be empty

  std::size_t vertex_count() const { return vertices.size() / 3; }
};

/// What viewers of a time series want to know of its scene.
struct Playback {
  double frame_rate = 24;  ///< frames per simulated second
  int up_axis = 1;         ///< 1: y, 2: z
};

/// Particles of all bodies at one instant, body after body. A particle's id is its place here, the same in every frame.
struct ParticleFrame {
  int index = 0;    ///< frame number, 0 is the initial state
  double time = 0;  ///< s
  int dimension = 3;
  double cell_size = 0;                     ///< m
  std::vector<std::string> bodies;          ///< names
  std::vector<std::size_t> body_ends;       ///< of each body, one past its last particle
  std::vector<Vector3> positions;           ///< m
  std::vector<Eigen::Vector3f> velocities;  ///< m/s
  std::vector<float> volumes;               ///< rest volume, m^3 (2D: m^2)
  std::vector<Attribute> attributes;        ///< J, damage, declared states, ...
  std::vector<Color> colors;                ///< of particles; empty if none are asked for
  Playback playback;
  std::vector<BodyMesh> meshes;  ///< of bodies that have a surface; empty if none is to be written

  std::size_t particles() const { return positions.size(); }
  std::size_t body_begin(std::size_t body) const { return body > 0 ? body_ends[body - 1] : 0; }
  /// Index into bodies.
  std::int32_t body_of(std::size_t particle) const {
    return std::int32_t(std::upper_bound(body_ends.begin(), body_ends.end(), particle) - body_ends.begin());
  }
};

/// Row of frames.csv.
struct FrameRecord {
  int frame = 0;
  double time = 0;
  std::int64_t steps = 0;  ///< since the previous frame
  double time_step = 0;    ///< last one, s
  double stable_step = 0;  ///< smallest of the largest steps that bounds allowed since the previous frame, s
  std::string limited_by;  ///< "elastic wave", "particle speed", "explicit damage", "maximum", "fixed", "frame",
                           ///< "discretization"
  double kinetic_energy = 0, elastic_energy = 0, gravity_energy = 0;  ///< J
  Vector3 momentum = Vector3::Zero();                                 ///< kg m/s
  Vector3 angular_momentum = Vector3::Zero();                         ///< kg m^2/s, about the origin
  Vector3 center_of_mass = Vector3::Zero();                           ///< m
  double mass = 0;                                                    ///< kg
  double volume = 0;                                                  ///< current, m^3
  double rest_volume = 0;                                             ///< m^3, no column of the table
  double minimum_J = 1, maximum_J = 1;
  double maximum_speed = 0;       ///< m/s
  std::int64_t halved_steps = 0;  ///< since the previous frame: rolled back, and taken in halves
  double under_sampled = 0;       ///< part of the particles that are more than a cell from the next ones
  double maximum_damage = 0;
  double damaged_fraction = 0;              ///< of the rest volume that has d > 1/2
  double damage_iterations = 0;             ///< of the implicit solves since the previous frame, mean
  std::int64_t damage_iterations_most = 0;  ///< and largest
  double damage_active = 0;                 ///< part of the particles in blocks where damage evolves, mean
  double newton_iterations = 0;             ///< of the implicit steps since the previous frame, mean
  double linear_iterations = 0;             ///< of conjugate gradients in those steps, mean of their sum over a step
  double constraint_iterations = 0;         ///< of the projections onto constraints since the previous frame, mean
  double constraint_residual = 0;           ///< what they leave, relative to what they found, largest
  std::optional<std::int64_t> pieces;       ///< of bodies that have a surface or can be damaged; empty if none does
  double debris = 0;                        ///< part of the rest volume of bodies that can be damaged that is of no piece
  double wall_seconds = 0;
};

struct PluginRecord {
  std::string id, version, path;
  std::string sha256;  ///< of the file, in hexadecimal digits
};

/// Contents of summary.json.
struct Summary {
  std::string status;  ///< "done", "failed", "interrupted"
  std::string scene;
  std::int64_t particles = 0, steps = 0;
  int frames = 0;
  double simulated_seconds = 0, wall_seconds = 0;
  double particle_steps_per_second = 0;
  std::vector<std::pair<std::string, double>> stage_seconds;       ///< "particles to grid", ...
  std::vector<std::pair<std::string, std::int64_t>> limits;        ///< steps that each bound set
  std::vector<std::pair<std::string, std::int64_t>> integrators;   ///< steps of the material point method that each took
  std::vector<std::pair<std::string, double>> bytes_per_particle;  ///< by part, "total" last
  std::vector<PluginRecord> plugins;
  int threads = 0;
  std::string precision, isa, version;
};

/// What a run that is resumed has left in its directory.
struct EarlierPart {
  int frames = 0;     ///< complete ones, from number 0 on; files of later ones are removed
  std::string table;  ///< frames.csv with their rows
};

/// Writes frames in the asked formats into a run directory:
///   points/frame_0000.vdb     OpenVDB point data grid per body: id, velocity, and every attribute
///   surface/frame_0000.vdb    level set per body (if asked)
///   vtp/frame_0000.vtp, particles.pvd
///   ply/frame_0000.ply
///   usd/frame_0000.usda, particles.usda
///   meshes/frame_0000.ply, .obj; .vtp, meshes.pvd; .vtu, tetrahedra.pvd
/// and frames.csv. Files appear whole or not at all (written beside, then renamed). Throws InputError where a file cannot be
/// written, naming it.
class Writer {
 public:
  /// With an earlier part that is continued, else whatever frames the directory holds are removed. `meshes`: formats of the
  /// surfaces of bodies, with a column of the table for their pieces; no value: there are none. `pieces`: columns for the
  /// pieces and the debris of particles.
  Writer(std::filesystem::path directory, const std::vector<std::string>& formats, bool surface, const EarlierPart* = nullptr,
         const std::optional<std::vector<std::string>>& meshes = std::nullopt, bool pieces = false, const Playback& = {});
  ~Writer();
  void frame(const ParticleFrame&);
  void record(const FrameRecord&);
  void summary(const Summary&);
  void text(const std::string& name, const std::string& contents);  ///< scene.toml and the like
  std::string table() const;                                        ///< frames.csv as it stands
  std::vector<std::filesystem::path> written() const;               ///< directories and index files, for the closing message

 private:
  struct State;
  std::unique_ptr<State> state_;
};

}  // namespace cleave::output
