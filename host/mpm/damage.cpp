#include "mpm/damage.hpp"

#include <tbb/parallel_for.h>

#include <algorithm>
#include <cmath>
#include <cstring>
#include <limits>

namespace cleave::mpm {

namespace {
constexpr double saturating_driving_force = saturated_damage / (1 - saturated_damage);
}

template <class T, int D>
DamageEvolution<T, D>::DamageEvolution(const Material& material, const BoundLaw& inputs, const BoundLaw& law,
                                       const config::DamageSolver& solver, double cell_size)
    : kernels_(kernels_of<T, D>(load_kernels().damage)),
      solver_(solver),
      inputs_(inputs),
      law_(law),
      viscosity_(material.damage_model().viscosity),
      length_(material.damage_model().length / cell_size),
      local_(material.damage().can(CLEAVE_DAMAGE_IS_LOCAL)),
      explicit_(!local_ && material.damage_model().integration == CLEAVE_INTEGRATION_EXPLICIT),
      cubic_(explicit_ && solver.laplacian == config::Laplacian::cubic),
      scratch_([size = kernels_.scratch_bytes] { return Buffer(size); }) {}

template <class T, int D>
double DamageEvolution<T, D>::step_bound(double driving_force) const {
  if (!explicit_) return std::numeric_limits<double>::infinity();
  const double eigenvalue = cubic_ ? 4.0 * D : 4.0;
  return viscosity_ / (1 + std::min(driving_force, saturating_driving_force) + length_ * length_ * eigenvalue);
}

template <class T, int D>
typename DamageEvolution<T, D>::Statistics DamageEvolution<T, D>::take_statistics() {
  return std::exchange(statistics_, Statistics());
}

// ------------------------------------------------------------------------------------------------- loops over blocks

template <class T, int D>
auto DamageEvolution<T, D>::grid_blocks_of(const Blocks& blocks, const Flags& home) const -> Flags {
  Flags grid(grid_size_, 0);
  for (std::size_t h = 0; h < blocks.size(); h++)
    if (home[h])
      for (int n = 0; n < GridShape<D>::neighbours; n++) grid[blocks[h].neighbours[n]] = 1;
  return grid;
}

template <class T, int D>
auto DamageEvolution<T, D>::homes_touching(const Blocks& blocks, const Flags& grid) const -> Flags {
  Flags home(blocks.size(), 0);
  for (std::size_t h = 0; h < blocks.size(); h++)
    for (int n = 0; n < GridShape<D>::neighbours && !home[h]; n++) home[h] = grid[blocks[h].neighbours[n]];
  return home;
}

template <class T, int D>
auto DamageEvolution<T, D>::dilated(const Blocks& blocks, const Flags& home, int distance) const -> Flags {
  Flags result = home;
  constexpr int centre = GridShape<D>::neighbours / 2;
  for (; distance > 0; distance--) {
    Flags grid(grid_size_, 0);
    for (std::size_t h = 0; h < blocks.size(); h++)
      if (result[h]) grid[blocks[h].neighbours[centre]] = 1;
    result = homes_touching(blocks, grid);
  }
  return result;
}

/// Blocks of one colour reach disjoint nodes; colours follow each other, so that sums have one order.
template <class T, int D>
template <class F>
void DamageEvolution<T, D>::for_coloured(const Particles<T, D>& particles, const Flags& home, F&& work) {
  std::vector<std::uint32_t> selected;
  for (const auto& colour : particles.colours()) {
    selected.clear();
    for (const auto i : colour)
      if (home[i]) selected.push_back(i);
    for_particle_blocks(selected, scratch_, work);
  }
}

template <class T, int D>
template <class F>
void DamageEvolution<T, D>::for_homes(const Flags& home, F&& work) {
  tbb::parallel_for(tbb::blocked_range<std::size_t>(0, home.size(), 4), [&](const auto& range) {
    void* memory = scratch();
    for (std::size_t i = range.begin(); i < range.end(); i++)
      if (home[i]) work(i, memory);
  });
}

template <class T, int D>
void DamageEvolution<T, D>::reach(const Blocks& blocks, std::size_t grid_blocks) {
  grid_size_ = grid_blocks;
  const Flags grid = grid_blocks_of(blocks, Flags(blocks.size(), 1));
  reached_.clear();
  for (std::size_t b = 0; b < grid.size(); b++)
    if (grid[b]) reached_.push_back(std::uint32_t(b));
}

template <class T, int D>
template <class F>
void DamageEvolution<T, D>::for_blocks(const Flags& grid, F&& work) {
  tbb::parallel_for(tbb::blocked_range<std::size_t>(0, reached_.size(), 64), [&](const auto& range) {
    for (std::size_t i = range.begin(); i < range.end(); i++)
      if (const std::size_t b = reached_[i]; grid[b]) work(b * GridShape<D>::block_nodes);
  });
}

template <class T, int D>
template <class F>
void DamageEvolution<T, D>::for_nodes(const Flags& grid, F&& work) {
  for_blocks(grid, [&](std::size_t first) {
    for (std::size_t n = first; n < first + GridShape<D>::block_nodes; n++) work(n);
  });
}

template <class T, int D>
template <class F>
double DamageEvolution<T, D>::sum_nodes(const Flags& grid, F&& term) {
  partial_.assign(reached_.size(), 0.0);
  tbb::parallel_for(tbb::blocked_range<std::size_t>(0, reached_.size(), 64), [&](const auto& range) {
    for (std::size_t i = range.begin(); i < range.end(); i++) {
      const std::size_t b = reached_[i];
      if (!grid[b]) continue;
      double sum = 0;
      for (std::size_t n = b * GridShape<D>::block_nodes, end = n + GridShape<D>::block_nodes; n < end; n++) sum += term(n);
      partial_[i] = sum;
    }
  });
  double sum = 0;
  for (double s : partial_) sum += s;
  return sum;
}

template <class T, int D>
void DamageEvolution<T, D>::clear(const Flags& grid, T* field, int numbers) {
  for_blocks(grid, [&](std::size_t first) {
    std::memset(field + first * std::size_t(numbers), 0, sizeof(T) * GridShape<D>::block_nodes * std::size_t(numbers));
  });
}

// ------------------------------------------------------------------------------------------------- stages

template <class T, int D>
void DamageEvolution<T, D>::drive(const ParticleView& view, Particles<T, D>& particles, double time_step,
                                  std::vector<BlockReport>& reports) {
  auto& blocks = particles.blocks();
  driving_force_.reserve(particles.tiles() * CLEAVE_TILE_BYTES);
  volume_.reserve(particles.tiles() * CLEAVE_TILE_BYTES);
  const DamageView damage = damage_view(time_step);
  reports.assign(blocks.size(), {});
  reports_.assign(blocks.size(), {});
  tbb::parallel_for(tbb::blocked_range<std::size_t>(0, blocks.size(), 4), [&](const auto& range) {
    void* memory = scratch();
    for (std::size_t i = range.begin(); i < range.end(); i++)
      kernels_.drive(view, blocks[i], damage, memory, reports[i], reports_[i]);
  });
  active_.resize(blocks.size());
  largest_driving_force_ = 0;
  for (std::size_t i = 0; i < blocks.size(); i++) {
    active_[i] = reports_[i].active || !solver_.active_set;
    blocks[i].damaged = reports_[i].damaged;
    largest_driving_force_ = std::max(largest_driving_force_, reports_[i].largest_driving_force);
  }
}

template <class T, int D>
void DamageEvolution<T, D>::evolve(const ParticleView& view, Particles<T, D>& particles, const Grid<T, D>& grid,
                                   double time_step) {
  statistics_.steps++;
  const auto active = std::count(active_.begin(), active_.end(), std::uint8_t(1));
  statistics_.active_blocks += particles.blocks().empty() ? 0 : double(active) / double(particles.blocks().size());
  if (local_ || active == 0) return;
  reach(particles.blocks(), grid.blocks());
  collected_.reserve(grid.nodes() * 4 * sizeof(T));
  for (Buffer* b : {&initial_, &change_, &residual_, &direction_, &product_}) b->reserve(grid.nodes() * sizeof(T));
  if (!explicit_) {
    solve(view, particles, time_step);
    return;
  }
  // The driving force is that of now, the step was chosen with the one before.
  const double parts = std::max(1.0, std::ceil(time_step / stable_step() - 1e-9));
  for (double part = 0; part < parts; part++) {
    integrate(view, particles, time_step / parts);
    for (std::size_t i = 0; i < active_.size(); i++) active_[i] = active_[i] || particles.blocks()[i].damaged;
  }
}

template <class T, int D>
void DamageEvolution<T, D>::integrate(const ParticleView& view, Particles<T, D>& particles, double time_step) {
  auto& blocks = particles.blocks();
  const DamageView damage = damage_view(time_step);
  // Driving forces act where they are. The damage of a block's particles reaches nodes of the blocks next to it, gradients of
  // particles there, nodes next to these, and their particles; cubic splines reach from nodes to particles at once.
  Flags spreading(blocks.size());
  for (std::size_t i = 0; i < blocks.size(); i++) spreading[i] = blocks[i].damaged || !solver_.active_set;
  const Flags near = dilated(blocks, spreading, 1);
  Flags reached = cubic_ ? near : dilated(blocks, near, 1);
  for (std::size_t i = 0; i < blocks.size(); i++) reached[i] |= active_[i];
  const Flags nodes = grid_blocks_of(blocks, reached);
  T *collected = numbers(collected_), *field = numbers(initial_), *laplacian = numbers(product_);
  clear(nodes, collected, 4);
  // Sums are complete where damage or its gradients reach; elsewhere the field is zero whatever they are.
  for_coloured(particles, reached, [&](std::size_t i, void* memory) {
    (cubic_ ? kernels_.collect_cubic : kernels_.collect)(view, blocks[i], damage, collected, memory);
  });
  for_nodes(nodes, [&](std::size_t n) { field[n] = collected[4 * n] > T(0) ? collected[4 * n + 1] / collected[4 * n] : T(0); });
  const double rate = time_step / viscosity_;
  reports_.assign(blocks.size(), {});
  if (cubic_) {
    for_homes(reached, [&](std::size_t i, void* memory) {
      kernels_.integrate_cubic(view, blocks[i], damage, field, rate, length_, memory, reports_[i]);
    });
  } else {
    clear(nodes, laplacian);
    for_coloured(particles, near,
                 [&](std::size_t i, void* memory) { kernels_.stiffness(view, blocks[i], damage, field, laplacian, memory); });
    for_nodes(nodes, [&](std::size_t n) { laplacian[n] = collected[4 * n] > T(0) ? -laplacian[n] / collected[4 * n] : T(0); });
    for_homes(reached, [&](std::size_t i, void* memory) {
      kernels_.integrate(view, blocks[i], damage, laplacian, rate, length_, memory, reports_[i]);
    });
  }
  for (std::size_t i = 0; i < blocks.size(); i++)
    if (reached[i]) blocks[i].damaged = reports_[i].damaged;
}

template <class T, int D>
void DamageEvolution<T, D>::solve(const ParticleView& view, Particles<T, D>& particles, double time_step) {
  auto& blocks = particles.blocks();
  const DamageView damage = damage_view(time_step);
  T *collected = numbers(collected_), *initial = numbers(initial_), *x = numbers(change_), *r = numbers(residual_),
    *p = numbers(direction_), *Ap = numbers(product_);
  const T memory_of_damage = T(viscosity_ / time_step), length2 = T(length_ * length_);
  // Diagonal of K over M in a uniformly filled grid: 16 D c a^(D-1), a = int N^2 = 11/20, c = int N^2 x^2 = 43/560.
  const T diagonal_of_K = T(16 * D * (43. / 560) * (D == 3 ? 0.3025 : 0.55)) * length2;
  const auto mass = [&](std::size_t n) { return collected[4 * n]; };
  const auto lumped = [&](std::size_t n) { return (memory_of_damage + T(1)) * collected[4 * n] + collected[4 * n + 2]; };
  // M + T: what is left of the diagonal when damage rests
  const auto resting = [&](std::size_t n) { return collected[4 * n] + collected[4 * n + 2]; };
  const auto preconditioned = [&](std::size_t n) {
    return mass(n) > T(0) ? r[n] / (lumped(n) + diagonal_of_K * mass(n)) : T(0);
  };

  // Coefficients are complete on nodes that only `filled` blocks reach. The search spreads with every iteration; where it
  // comes to nodes that are not complete, more blocks are filled. Coefficients found before are found again to the bit.
  Flags filled, nodes;
  const auto fill = [&](const Flags& home) {
    const Flags old = nodes;
    filled = home;
    nodes = grid_blocks_of(blocks, filled);
    clear(nodes, collected, 4);
    for_coloured(particles, filled,
                 [&](std::size_t i, void* memory) { kernels_.collect(view, blocks[i], damage, collected, memory); });
    Flags fresh = nodes;
    if (!old.empty())
      for (std::size_t b = 0; b < fresh.size(); b++) fresh[b] = std::uint8_t(nodes[b] && !old[b]);
    for (T* field : {initial, x, r, p, Ap}) clear(fresh, field);
  };
  const auto complete_for = [&](const Flags& home) {
    const Flags needed = dilated(blocks, home, 2);
    for (std::size_t i = 0; i < needed.size(); i++)
      if (needed[i] && !filled[i]) {
        Flags wider = dilated(blocks, needed, 2);
        for (std::size_t k = 0; k < wider.size(); k++) wider[k] = std::uint8_t(wider[k] | filled[k]);
        fill(wider);
        return;
      }
  };
  /// Node blocks where a field is not zero.
  const auto support = [&](const T* field) {
    Flags grid(grid_size_, 0);
    for_blocks(nodes, [&](std::size_t first) {
      for (std::size_t n = first; n < first + GridShape<D>::block_nodes; n++)
        if (field[n] != T(0)) {
          grid[first / GridShape<D>::block_nodes] = 1;
          break;
        }
    });
    return grid;
  };
  /// Ap = l^2 K field + diagonal field
  const auto multiply = [&](const T* field, const auto& diagonal) {
    const Flags home = homes_touching(blocks, solver_.active_set ? support(field) : nodes);
    complete_for(home);
    clear(nodes, Ap);
    for_coloured(particles, home,
                 [&](std::size_t i, void* memory) { kernels_.stiffness(view, blocks[i], damage, field, Ap, memory); });
    for_nodes(nodes, [&](std::size_t n) { Ap[n] = length2 * Ap[n] + diagonal(n) * field[n]; });
  };

  fill(dilated(blocks, active_, 4));
  for_nodes(nodes, [&](std::size_t n) { initial[n] = mass(n) > T(0) ? collected[4 * n + 1] / mass(n) : T(0); });
  // Solved for the change from S/M, whose right-hand side T - (M + T + l^2 K) S/M is what is out of balance. The memory
  // eta/dt S is on both sides of the equation: next to it, what drives slow damage would drown in the tolerance.
  multiply(initial, resting);
  for_nodes(nodes, [&](std::size_t n) {
    r[n] = collected[4 * n + 2] - Ap[n];
    p[n] = preconditioned(n);
  });
  const double scale = sum_nodes(nodes, [&](std::size_t n) {
    const double b = double(collected[4 * n + 1] + collected[4 * n + 2]);
    return mass(n) > T(0) ? b * b / double(lumped(n) + diagonal_of_K * mass(n)) : 0.0;
  });
  double rz = sum_nodes(nodes, [&](std::size_t n) { return double(r[n]) * double(p[n]); });
  const double tolerance = std::max(solver_.tolerance, 4.0 * double(std::numeric_limits<T>::epsilon()));
  const double enough = tolerance * tolerance * scale;
  int iteration = 0;
  for (; iteration < solver_.maximum_iterations && rz > enough; iteration++) {
    multiply(p, lumped);
    const double pAp = sum_nodes(nodes, [&](std::size_t n) { return double(p[n]) * double(Ap[n]); });
    if (!(pAp > 0)) break;
    const T alpha = T(rz / pAp);
    for_nodes(nodes, [&](std::size_t n) {
      x[n] += alpha * p[n];
      r[n] -= alpha * Ap[n];
    });
    const double next = sum_nodes(nodes, [&](std::size_t n) { return double(r[n]) * double(preconditioned(n)); });
    const T beta = T(next / rz);
    rz = next;
    for_nodes(nodes, [&](std::size_t n) { p[n] = preconditioned(n) + beta * p[n]; });
  }
  statistics_.solves++;
  statistics_.iterations += iteration;
  statistics_.most_iterations = std::max<std::int64_t>(statistics_.most_iterations, iteration);
  if (rz > enough) statistics_.unconverged++;

  const double rate = time_step / viscosity_, negligible = negligible_damage * rate / (1 + rate);
  const Flags touched = homes_touching(blocks, solver_.active_set ? support(x) : nodes);
  reports_.assign(blocks.size(), {});
  for_homes(touched,
            [&](std::size_t i, void* memory) { kernels_.advance(view, blocks[i], x, negligible, memory, reports_[i]); });
  for (std::size_t i = 0; i < blocks.size(); i++)
    if (touched[i]) blocks[i].damaged = reports_[i].damaged;
}

template class DamageEvolution<float, 2>;
template class DamageEvolution<float, 3>;
template class DamageEvolution<double, 2>;
template class DamageEvolution<double, 3>;

}  // namespace cleave::mpm
