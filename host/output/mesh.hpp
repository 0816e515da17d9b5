#pragma once

#include "output/frame.hpp"

#include <filesystem>

namespace cleave::output {

/// The meshes of a frame, body after body in one file, with velocity and damage at the vertices if any body gives them (0 for
/// the others), `body`, and `piece`: numbered over all bodies, so that vertices of one number are what hangs together.

/// Binary little-endian PLY: x y z, vx vy vz, damage, piece, body of each vertex; triangles.
void write_mesh_ply(const std::filesystem::path&, const ParticleFrame&);

/// Wavefront OBJ: an object per body and a group per piece, named BODY and BODY_PIECE. Positions and triangles alone: the
/// format has no place for more.
void write_mesh_obj(const std::filesystem::path&, const ParticleFrame&);

/// VTK XML PolyData of the triangles.
void write_mesh_vtp(const std::filesystem::path&, const ParticleFrame&);

/// VTK XML UnstructuredGrid of the tetrahedra.
void write_mesh_vtu(const std::filesystem::path&, const ParticleFrame&);

}  // namespace cleave::output
