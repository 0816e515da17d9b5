#pragma once

#include <cstddef>

/// A plain explicit step of the material point method, to compare with: MLS-MPM (Hu et al. 2018) with quadratic B-splines and
/// APIC (Jiang et al. 2015), neo-Hookean solid, one thread, particles one after the other on a dense grid, SI units, single
/// precision. The same physics and order as the kernels of the host; written for the reader, and left to the compiler.
namespace naive {

struct Particle {
  float position[3], velocity[3];
  float affine[3][3];       ///< C, 1/s
  float deformation[3][3];  ///< F
  float volume;             ///< at rest
};

struct Node {
  float mass, momentum[3];  ///< momentum, then velocity
};

struct Body {
  float cell_size, time_step, density, shear_modulus, bulk_modulus;
  float gravity[3];
  float origin[3];  ///< of the grid; particles keep a cell away from its ends
  int nodes[3];
  Particle* particles;
  std::size_t particle_count;
  Node* grid;  ///< last axis fastest
  std::size_t grid_size;
};

/// Compiled for the processor this was built on, and for x86-64-v3.
namespace native {
void step(const Body&);
}
namespace x86_64_v3 {
void step(const Body&);
}

}  // namespace naive
