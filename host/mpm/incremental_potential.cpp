#include "mpm/incremental_potential.hpp"

#include <cmath>
#include <cstring>
#include <utility>

namespace cleave::mpm {

namespace {
/// Nodes with less mass take no part: what they weigh to a particle is nothing to any precision.
constexpr double least_mass = 1e-25;
}  // namespace

template <class T, int D>
IncrementalPotential<T, D>::IncrementalPotential()
    : kernels_(kernels_of<T, D>(load_kernels().implicit)), scratch_([size = kernels_.scratch_bytes] { return Buffer(size); }) {}

template <class T, int D>
void IncrementalPotential<T, D>::begin(const Grid<T, D>& grid, std::vector<Part> parts, double time_step, double cell_size,
                                       double reference_density) {
  constexpr std::size_t nodes = GridShape<D>::block_nodes;
  parts_ = std::move(parts);
  numbers_ = grid.nodes() * 4;
  grid_blocks_ = grid.blocks();
  target_.reserve(numbers_ * sizeof(T));
  T* target = reinterpret_cast<T*>(target_.data());
  std::vector<double> mass(grid_blocks_, 0.0);
  tbb::parallel_for(tbb::blocked_range<std::size_t>(0, grid_blocks_, 32), [&](const auto& range) {
    for (std::size_t b = range.begin(); b < range.end(); b++) {
      T* to = target + b * nodes * 4;
      std::memcpy(to, grid.node(b * nodes), nodes * 4 * sizeof(T));
      for (std::size_t n = 0; n < nodes; n++)
        if (to[4 * n] >= T(least_mass))
          mass[b] += double(to[4 * n]);
        else
          to[4 * n] = 0;
    }
  });
  blocks_.clear();
  mass_ = 0;
  for (std::size_t b = 0; b < grid_blocks_; b++)
    if (mass[b] > 0) {
      blocks_.push_back(std::uint32_t(b));
      mass_ += mass[b];
    }
  has_energy_ = true;
  views_.clear();
  deformation_.resize(parts_.size());
  for (std::size_t k = 0; k < parts_.size(); k++) {
    const Material& m = *parts_[k].material;
    deformation_[k].reserve(parts_[k].particles->tiles() * std::size_t(deformation_rows<D>) * CLEAVE_TILE_BYTES);
    ImplicitView v;
    v.response = parts_[k].response;
    v.differential = parts_[k].differential;
    v.piola = m.gives_piola();
    v.takes_b = m.response_takes_b();
    v.energy = m.gives_energy();
    v.degraded = bool(m.damage());
    v.time_step = time_step;
    v.cell_size = cell_size;
    v.force_scale = 4 * time_step / (cell_size * reference_density);
    v.energy_scale = 1 / reference_density;
    v.deformation = deformation_[k].data();
    has_energy_ = has_energy_ && v.energy;
    views_.push_back(v);
  }
}

template <class T, int D>
void IncrementalPotential<T, D>::clear(T* nodes, int numbers) const {
  for_blocks([&](std::size_t first) {
    std::memset(nodes + first * std::size_t(numbers), 0, GridShape<D>::block_nodes * std::size_t(numbers) * sizeof(T));
  });
}

template <class T, int D>
auto IncrementalPotential<T, D>::evaluate(const T* velocity, T* gradient) -> Value {
  clear(gradient, 4);
  Value value;
  value.valid = true;
  failure_ = {};
  for (std::size_t k = 0; k < parts_.size(); k++) {
    const auto& blocks = parts_[k].particles->blocks();
    std::vector<BlockReport> reports(blocks.size());
    std::vector<double> energies(blocks.size(), 0.0);
    for_coloured(*parts_[k].particles, scratch_, [&](std::size_t i, void* memory) {
      kernels_.potential(parts_[k].view, blocks[i], views_[k], velocity, gradient, memory, reports[i], energies[i]);
    });
    for (const double e : energies) value.energy += e;
    for (const auto& r : reports)
      if (value.valid && (r.status >= CLEAVE_STATUS_RETRY || r.result != CLEAVE_OK)) {
        value.valid = false;
        failed_part_ = k;
        failure_ = r;
      }
  }
  struct Sums {
    double kinetic = 0, stress = 0;
    void operator+=(const Sums& o) {
      kinetic += o.kinetic;
      stress += o.stress;
    }
  };
  const T* target = this->target();
  const Sums sums = sum_blocks<Sums>([&](std::size_t first) {
    Sums s;
    for (std::size_t i = 4 * first, end = i + 4 * GridShape<D>::block_nodes; i < end; i += 4) {
      const T mass = target[i];
      gradient[i] = 0;
      double change2 = 0, force2 = 0;
      for (int a = 1; a <= 3; a++) {
        const T change = velocity[i + a] - target[i + a], force = mass > T(0) ? gradient[i + a] : T(0);
        gradient[i + a] = mass > T(0) ? force + mass * change : T(0);
        change2 += double(change) * double(change);
        force2 += double(force) * double(force);
      }
      if (!(mass > T(0))) continue;
      s.kinetic += double(mass) * change2;
      s.stress += force2 / double(mass);
    }
    return s;
  });
  value.energy += 0.5 * sums.kinetic;
  value.inertia = std::sqrt(sums.kinetic);
  value.stress = std::sqrt(sums.stress);
  value.valid = value.valid && std::isfinite(value.energy) && std::isfinite(value.stress);
  return value;
}

template <class T, int D>
void IncrementalPotential<T, D>::multiply(const T* direction, T* product) {
  clear(product, 4);
  for (std::size_t k = 0; k < parts_.size(); k++) {
    const auto& blocks = parts_[k].particles->blocks();
    for_coloured(*parts_[k].particles, scratch_, [&](std::size_t i, void* memory) {
      kernels_.product(parts_[k].view, blocks[i], views_[k], direction, product, memory);
    });
  }
  const T* target = this->target();
  for_blocks([&](std::size_t first) {
    for (std::size_t i = 4 * first, end = i + 4 * GridShape<D>::block_nodes; i < end; i += 4) {
      const T mass = target[i];
      product[i] = 0;
      for (int a = 1; a <= 3; a++) product[i + a] = mass > T(0) ? product[i + a] + mass * direction[i + a] : T(0);
    }
  });
}

template <class T, int D>
void IncrementalPotential<T, D>::find_tangents(bool of_octants) {
  constexpr std::size_t per_block = std::size_t(1 << D) * std::size_t(tangent_numbers<D>);
  diagonal_.reserve(numbers_ / 4 * diagonal_numbers * sizeof(T));
  if (of_octants) octants_.reserve(grid_blocks_ * per_block * sizeof(T));
  T* diagonal = reinterpret_cast<T*>(diagonal_.data());
  T* octants = of_octants ? reinterpret_cast<T*>(octants_.data()) : nullptr;
  tbb::parallel_for(tbb::blocked_range<std::size_t>(0, grid_blocks_, 32), [&](const auto& range) {
    constexpr std::size_t per_block_of_nodes = GridShape<D>::block_nodes * diagonal_numbers;
    std::memset(diagonal + range.begin() * per_block_of_nodes, 0, range.size() * per_block_of_nodes * sizeof(T));
    if (octants) std::memset(octants + range.begin() * per_block, 0, range.size() * per_block * sizeof(T));
  });
  for (std::size_t k = 0; k < parts_.size(); k++) {
    const auto& blocks = parts_[k].particles->blocks();
    for_coloured(*parts_[k].particles, scratch_, [&](std::size_t i, void* memory) {
      kernels_.tangent(parts_[k].view, blocks[i], views_[k], diagonal, octants, memory);
    });
  }
}

template class IncrementalPotential<float, 2>;
template class IncrementalPotential<float, 3>;
template class IncrementalPotential<double, 2>;
template class IncrementalPotential<double, 3>;

}  // namespace cleave::mpm
