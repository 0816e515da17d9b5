#pragma once

#include "mpm/buffer.hpp"
#include "mpm/grid.hpp"
#include "mpm/kernels/kernels.hpp"
#include "mpm/material.hpp"
#include "mpm/particle_blocks.hpp"
#include "mpm/particles.hpp"

#include <tbb/blocked_range.h>
#include <tbb/parallel_for.h>

#include <cstdint>
#include <limits>
#include <vector>

namespace cleave::mpm {

/// The incremental potential of a step of backward Euler (Wolper et al. 2019, section 3.3; Radovitzky & Ortiz 1999),
///
///   E(v) = 1/2 sum m_i |v_i - v*_i|^2 + sum_p V_p psi((I + dt C_p(v)) F_p),
///
/// as a function of the node velocities: its value, gradient and Hessian, by kernels/implicit_kernels.cpp. Units are the
/// grid's: mass in rho_ref dx^d, velocity in m/s. Vectors are four numbers per node of the grid, the first of them unused; only
/// nodes with mass count.
template <class T, int D>
class IncrementalPotential {
 public:
  struct Part {
    const Particles<T, D>* particles;
    ParticleView view;
    const Material* material;
    BoundLaw response, differential;  ///< Material::implicit_response and implicit_differential, or what stands for them
  };
  struct Value {
    double energy = 0;
    double inertia = 0;  ///< |m (v - v*)| in the norm of 1/m
    double stress = 0;   ///< |gradient of the elastic energy| in that norm
    bool valid = false;  ///< all laws are defined there
  };

  IncrementalPotential();

  /// The grid holds masses and v*. Parts are read until the next call; their grid and blocks must not change.
  void begin(const Grid<T, D>&, std::vector<Part>, double time_step, double cell_size, double reference_density);

  bool has_energy() const { return has_energy_; }
  std::size_t numbers() const { return numbers_; }                                ///< of a vector
  const T* target() const { return reinterpret_cast<const T*>(target_.data()); }  ///< mass, v*
  double mass() const { return mass_; }

  /// Value and gradient; the Hessian is then that of these velocities.
  Value evaluate(const T* velocity, T* gradient);
  void multiply(const T* direction, T* product);
  /// The Hessian's elastic part: diagonal blocks per node and, if asked for, tangents per octant (see
  /// ImplicitKernels::tangent).
  void find_tangents(bool octants);
  const T* diagonal() const { return reinterpret_cast<const T*>(diagonal_.data()); }
  const T* octants() const { return reinterpret_cast<const T*>(octants_.data()); }

  /// Of the last evaluation: the part and what its laws reported where it is not valid.
  std::size_t failed_part() const { return failed_part_; }
  const BlockReport& failure() const { return failure_; }

  /// Grid blocks that carry mass, ascending.
  const std::vector<std::uint32_t>& blocks() const { return blocks_; }

  /// f(first node) for every block.
  template <class F>
  void for_blocks(F&& f) const {
    tbb::parallel_for(tbb::blocked_range<std::size_t>(0, blocks_.size(), 16), [&](const auto& range) {
      for (std::size_t i = range.begin(); i < range.end(); i++) f(std::size_t(blocks_[i]) * GridShape<D>::block_nodes);
    });
  }
  /// Sum of f(first node), of anything with +=, in the order of the blocks.
  template <class Sum, class F>
  Sum sum_blocks(F&& f) const {
    std::vector<Sum> parts(blocks_.size());
    tbb::parallel_for(tbb::blocked_range<std::size_t>(0, blocks_.size(), 16), [&](const auto& range) {
      for (std::size_t i = range.begin(); i < range.end(); i++)
        parts[i] = f(std::size_t(blocks_[i]) * GridShape<D>::block_nodes);
    });
    Sum sum{};
    for (const Sum& part : parts) sum += part;
    return sum;
  }

 private:
  void clear(T* nodes, int numbers) const;

  const ImplicitKernels<T, D>& kernels_;
  std::vector<Part> parts_;
  std::vector<ImplicitView> views_;
  bool has_energy_ = true;
  std::size_t numbers_ = 0, grid_blocks_ = 0;
  double mass_ = 0;
  std::vector<std::uint32_t> blocks_;
  Buffer target_, diagonal_, octants_;
  std::vector<Buffer> deformation_;  // per part
  ThreadScratch scratch_;
  std::size_t failed_part_ = 0;
  BlockReport failure_;
};

}  // namespace cleave::mpm
