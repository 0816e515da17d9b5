// Compiled once per instruction set, in a namespace of its own. Includes nothing with inline functions that the linker could
// keep for all.

#include "mls_mpm.hpp"

#include <math.h>
#include <string.h>

namespace naive::CLEAVE_NAIVE_ISA {
namespace {

/// The 3x3x3 nodes around a position: weights N of each axis, and the distance of the first node from the position in cells.
struct Stencil {
  int first[3];
  float weight[3][3], offset[3];
};

Stencil stencil(const Body& body, const Particle& p) {
  Stencil s;
  for (int a = 0; a < 3; a++) {
    const float x = (p.position[a] - body.origin[a]) * (1 / body.cell_size);
    s.first[a] = int(x - 0.5f);
    const float fx = x - float(s.first[a]);
    s.weight[a][0] = 0.5f * (1.5f - fx) * (1.5f - fx);
    s.weight[a][1] = 0.75f - (fx - 1) * (fx - 1);
    s.weight[a][2] = 0.5f * (fx - 0.5f) * (fx - 0.5f);
    s.offset[a] = -fx;
  }
  return s;
}

/// tau = mu J^(-2/3) dev(b) + kappa/2 (J^2 - 1) I with b = F F^T
void kirchhoff_stress(const Body& body, const float (&F)[3][3], float (&tau)[3][3]) {
  float b[3][3];
  for (int i = 0; i < 3; i++)
    for (int j = 0; j < 3; j++) b[i][j] = F[i][0] * F[j][0] + F[i][1] * F[j][1] + F[i][2] * F[j][2];
  const float J = F[0][0] * (F[1][1] * F[2][2] - F[1][2] * F[2][1]) - F[0][1] * (F[1][0] * F[2][2] - F[1][2] * F[2][0]) +
                  F[0][2] * (F[1][0] * F[2][1] - F[1][1] * F[2][0]);
  const float root = cbrtf(J), shear = body.shear_modulus / (root * root);
  const float mean = (b[0][0] + b[1][1] + b[2][2]) * (1.f / 3), pressure = 0.5f * body.bulk_modulus * (J * J - 1);
  for (int i = 0; i < 3; i++) {
    for (int j = 0; j < 3; j++) tau[i][j] = shear * b[i][j];
    tau[i][i] += pressure - shear * mean;
  }
}

void particles_to_grid(const Body& body) {
  const float dx = body.cell_size, scale = 4 * body.time_step / (dx * dx);
  memset(static_cast<void*>(body.grid), 0, body.grid_size * sizeof(Node));
  for (std::size_t k = 0; k < body.particle_count; k++) {
    const Particle& p = body.particles[k];
    const Stencil s = stencil(body, p);
    const float mass = p.volume * body.density;
    float tau[3][3], A[3][3];  // A = m C - 4 dt/dx^2 V tau
    kirchhoff_stress(body, p.deformation, tau);
    for (int i = 0; i < 3; i++)
      for (int j = 0; j < 3; j++) A[i][j] = mass * p.affine[i][j] - scale * p.volume * tau[i][j];
    for (int x = 0; x < 3; x++)
      for (int y = 0; y < 3; y++) {
        Node* row = &body.grid[std::size_t((s.first[0] + x) * body.nodes[1] + s.first[1] + y) * std::size_t(body.nodes[2]) +
                               std::size_t(s.first[2])];
        for (int z = 0; z < 3; z++) {
          const float w = s.weight[0][x] * s.weight[1][y] * s.weight[2][z];
          const float d[3] = {(s.offset[0] + float(x)) * dx, (s.offset[1] + float(y)) * dx, (s.offset[2] + float(z)) * dx};
          row[z].mass += w * mass;
          for (int i = 0; i < 3; i++)
            row[z].momentum[i] += w * (mass * p.velocity[i] + A[i][0] * d[0] + A[i][1] * d[1] + A[i][2] * d[2]);
        }
      }
  }
}

void update_grid(const Body& body) {
  for (Node* n = body.grid; n < body.grid + body.grid_size; n++)
    if (n->mass > 0)
      for (int i = 0; i < 3; i++) n->momentum[i] = n->momentum[i] / n->mass + body.gravity[i] * body.time_step;
}

void grid_to_particles(const Body& body) {
  const float dx = body.cell_size, dt = body.time_step, scale = 4 / (dx * dx);
  for (std::size_t k = 0; k < body.particle_count; k++) {
    Particle& p = body.particles[k];
    const Stencil s = stencil(body, p);
    float v[3] = {}, B[3][3] = {};  // B = sum w v_i (x_i - x_p)^T
    for (int x = 0; x < 3; x++)
      for (int y = 0; y < 3; y++) {
        const Node* row =
            &body.grid[std::size_t((s.first[0] + x) * body.nodes[1] + s.first[1] + y) * std::size_t(body.nodes[2]) +
                       std::size_t(s.first[2])];
        for (int z = 0; z < 3; z++) {
          const float w = s.weight[0][x] * s.weight[1][y] * s.weight[2][z];
          const float d[3] = {(s.offset[0] + float(x)) * dx, (s.offset[1] + float(y)) * dx, (s.offset[2] + float(z)) * dx};
          for (int i = 0; i < 3; i++) {
            const float wv = w * row[z].momentum[i];
            v[i] += wv;
            for (int j = 0; j < 3; j++) B[i][j] += wv * d[j];
          }
        }
      }
    for (int i = 0; i < 3; i++) {
      p.velocity[i] = v[i];
      p.position[i] += dt * v[i];
      for (int j = 0; j < 3; j++) p.affine[i][j] = scale * B[i][j];
    }
    float F[3][3];  // (I + dt C) F
    for (int i = 0; i < 3; i++)
      for (int j = 0; j < 3; j++)
        F[i][j] = p.deformation[i][j] + dt * (p.affine[i][0] * p.deformation[0][j] + p.affine[i][1] * p.deformation[1][j] +
                                              p.affine[i][2] * p.deformation[2][j]);
    memcpy(p.deformation, F, sizeof F);
  }
}

}  // namespace

void step(const Body& body) {
  particles_to_grid(body);
  update_grid(body);
  grid_to_particles(body);
}

}  // namespace naive::CLEAVE_NAIVE_ISA
