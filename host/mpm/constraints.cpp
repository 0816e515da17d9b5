#include "mpm/constraints.hpp"

#include "common/error.hpp"
#include "plugins/message.hpp"
#include "plugins/threads.hpp"

#include <cleave/constraint.h>

#include <fmt/format.h>
#include <spdlog/spdlog.h>
#include <tbb/parallel_for.h>
#include <tbb/parallel_reduce.h>

#include <Eigen/LU>
#include <algorithm>
#include <atomic>
#include <cmath>
#include <functional>
#include <limits>

namespace cleave::mpm {

namespace {
constexpr std::uint32_t no_row = ~0u;
/// More than what is lost of a position, in cells, at the farthest block.
constexpr double position_rounding = 4e-9;
/// Laws that share nodes take turns until one of all changes velocities by no more than this part of what the first did.
constexpr double sweep_tolerance = 1e-3;
constexpr int maximum_sweeps = 10;

enum Prescribed : std::uint8_t { free_node = 0, fixed_velocity = 1, fixed_along_normal = 2 };
}  // namespace

template <class T, int D>
std::size_t Constraints<T, D>::bytes_per_particle(const TileLayout& layout) {
  const int numbers = D + 1 + 9 + (layout.fiber ? 3 : 0) + D * D + (layout.damage ? 1 : 0);
  return std::size_t(numbers) * sizeof(double) + stencil * sizeof(std::uint64_t);
}

template <class T, int D>
void Constraints<T, D>::project(Grid<T, D>& grid, const std::vector<const Particles<T, D>*>& sets,
                                const std::vector<HeldNode>& held, double time_step) {
  double first = 0;
  for (int sweep = 0; sweep < maximum_sweeps; sweep++) {
    double change = 0;
    for (auto& law : laws_) {
      collect_particles(grid, *sets[law.set]);
      collect_nodes(grid);
      mark(held);
      call(law, time_step);
      change += write_back(grid);
    }
    if (sweep == 0) first = change;
    if (change <= sweep_tolerance * sweep_tolerance * first) return;
    if (sweep == 0 && (laws_.size() < 2 || !share_nodes(grid, sets))) return;
  }
}

template <class T, int D>
bool Constraints<T, D>::share_nodes(const Grid<T, D>& grid, const std::vector<const Particles<T, D>*>& sets) const {
  constexpr std::size_t none = ~std::size_t(0);
  std::vector<std::size_t> law_of_block(grid.blocks(), none);
  for (const auto& law : laws_)
    for (const auto& block : sets[law.set]->blocks())
      for (int k = 0; k < GridShape<D>::neighbours; k++) {
        const std::uint32_t neighbour = block.neighbours[k];
        if (law_of_block[neighbour] != none && law_of_block[neighbour] != law.set) return true;
        law_of_block[neighbour] = law.set;
      }
  return false;
}

template <class T, int D>
void Constraints<T, D>::collect_nodes(const Grid<T, D>& grid) {
  constexpr std::size_t block_nodes = Grid<T, D>::block_nodes;
  std::vector<std::size_t> first(reached_blocks_.size() + 1, 0);
  tbb::parallel_for(std::size_t(0), reached_blocks_.size(), [&](std::size_t i) {
    const std::size_t begin = reached_blocks_[i] * block_nodes;
    for (std::size_t n = begin; n < begin + block_nodes; n++) first[i + 1] += reached_[n] && grid.node(n)[0] > 0;
  });
  for (std::size_t i = 0; i < reached_blocks_.size(); i++) first[i + 1] += first[i];
  const std::size_t rows = first.back();
  node_of_row_.resize(rows);
  mass_.resize(rows);
  velocity_.resize(rows * D);
  node_cell_.resize(rows * D);
  const double unit = reference_density_ * std::pow(cell_size_, D);
  tbb::parallel_for(std::size_t(0), reached_blocks_.size(), [&](std::size_t i) {
    std::size_t row = first[i];
    const std::size_t begin = reached_blocks_[i] * block_nodes;
    for (std::size_t n = begin; n < begin + block_nodes; n++) {
      const T* node = grid.node(n);
      row_of_node_[n] = no_row;
      if (!reached_[n] || !(node[0] > 0)) continue;
      row_of_node_[n] = std::uint32_t(row);
      node_of_row_[row] = n;
      mass_[row] = double(node[0]) * unit;
      const Index3 cell = grid.node_coordinates(n);
      for (int a = 0; a < D; a++) {
        velocity_[row * D + a] = double(node[1 + a]);
        node_cell_[row * D + a] = cell[a];
      }
      row++;
    }
  });
  // On the boundary of its support a weight is zero, and the node may be without mass. The middle node never is.
  tbb::parallel_for(tbb::blocked_range<std::size_t>(0, volume_.size(), 1024), [&](const auto& range) {
    for (std::size_t p = range.begin(); p < range.end(); p++) {
      std::uint64_t* nodes = nodes_.data() + p * stencil;
      const std::uint64_t middle = row_of_node_[nodes[stencil / 2]];
      for (int n = 0; n < stencil; n++) {
        const std::uint32_t row = row_of_node_[nodes[n]];
        nodes[n] = row == no_row ? middle : row;
      }
    }
  });
}

/// A node that is held along two directions counts as held altogether.
template <class T, int D>
void Constraints<T, D>::mark(const std::vector<HeldNode>& held) {
  prescribed_.assign(mass_.size(), free_node);
  any_normal_ = false;
  for (const auto& h : held) {
    const auto block = std::uint32_t(h.node / std::size_t(GridShape<D>::block_nodes));
    if (!std::binary_search(reached_blocks_.begin(), reached_blocks_.end(), block)) continue;
    const std::uint32_t row = row_of_node_[h.node];
    if (row == no_row || prescribed_[row] == fixed_velocity) continue;
    if (h.normal.isZero()) {
      prescribed_[row] = fixed_velocity;
      continue;
    }
    if (!std::exchange(any_normal_, true)) normal_.assign(velocity_.size(), 0.0);
    double* normal = normal_.data() + row * D;
    if (prescribed_[row] == fixed_along_normal) {
      double cosine = 0;
      for (int a = 0; a < D; a++) cosine += normal[a] * h.normal[a];
      if (std::abs(cosine) < 1 - 1e-6) prescribed_[row] = fixed_velocity;
    } else {
      prescribed_[row] = fixed_along_normal;
      for (int a = 0; a < D; a++) normal[a] = h.normal[a];
    }
  }
}

template <class T, int D>
void Constraints<T, D>::collect_particles(const Grid<T, D>& grid, const Particles<T, D>& particles) {
  constexpr std::uint32_t edge = GridShape<D>::block_edge;
  constexpr int block_nodes = GridShape<D>::block_nodes, last = D == 3 ? 3 : 1;
  const TileLayout& l = particles.layout();
  const std::size_t count = particles.size();
  position_.resize(count * D);
  volume_.resize(count);
  deformation_.resize(count * 9);
  fiber_.resize(l.fiber ? count * 3 : 0);
  velocity_gradient_.resize(count * D * D);
  damage_.resize(l.damage ? count : 0);
  nodes_.resize(count * stencil);
  const auto& blocks = particles.blocks();
  std::vector<std::size_t> first(blocks.size());
  std::size_t next = 0;
  for (std::size_t b = 0; b < blocks.size(); b++) {
    first[b] = next;
    next += blocks[b].count;
  }
  reached_.resize(grid.nodes());
  row_of_node_.resize(grid.nodes());
  reached_blocks_.clear();
  for (const auto& block : blocks)
    reached_blocks_.insert(reached_blocks_.end(), block.neighbours, block.neighbours + GridShape<D>::neighbours);
  std::sort(reached_blocks_.begin(), reached_blocks_.end());
  reached_blocks_.erase(std::unique(reached_blocks_.begin(), reached_blocks_.end()), reached_blocks_.end());
  for (const std::uint32_t block : reached_blocks_)
    std::fill_n(reached_.begin() + std::ptrdiff_t(block) * block_nodes, block_nodes, 0);
  const double cell_volume = std::pow(cell_size_, D);
  tbb::parallel_for(tbb::blocked_range<std::size_t>(0, blocks.size(), 4), [&](const auto& range) {
    for (std::size_t b = range.begin(); b < range.end(); b++)
      for (std::uint32_t i = 0; i < blocks[b].count; i++) {
        const std::uint64_t slot = blocks[b].first_tile * Particles<T, D>::lanes + i;
        const std::size_t p = first[b] + i;
        // Of each axis: the blocks and the place in them of three nodes, counted from the first node of the block before
        std::uint32_t neighbour[3][3] = {}, inside[3][3] = {};
        for (int a = 0; a < D; a++) {
          // The first node as the transfers find it; in double precision a position beside a boundary could find another.
          const T x = particles.value(l.position, a, slot), start = std::floor(x - T(0.5));
          const std::uint32_t base = std::uint32_t(int(start) + int(edge));
          for (std::uint32_t k = 0; k < 3; k++) {
            neighbour[a][k] = (base + k) / edge * (a + 1 == D ? 1 : a + 2 == D ? 3 : 9);
            inside[a][k] = (base + k) % edge * (a + 1 == D ? 1 : a + 2 == D ? edge : edge * edge);
          }
          const double within = std::clamp(double(x) - double(start), 0.5, 1.5 - position_rounding);
          position_[p * D + a] = double(blocks[b].coordinate[a]) * edge + double(start) + within;
        }
        std::uint64_t* to = nodes_.data() + p * stencil;
        for (int x = 0; x < 3; x++)
          for (int y = 0; y < 3; y++)
            for (int z = 0; z < last; z++) {
              const std::uint32_t block = blocks[b].neighbours[neighbour[0][x] + neighbour[1][y] + neighbour[2][z]];
              const std::size_t n = std::size_t(block) * block_nodes + (inside[0][x] + inside[1][y] + inside[2][z]);
              std::atomic_ref(reached_[n]).store(1, std::memory_order_relaxed);
              *to++ = n;
            }
        const Matrix3 F = particles.deformation_or_b(slot);
        for (int c = 0; c < 9; c++) deformation_[p * 9 + c] = F(c / 3, c % 3);
        volume_[p] = double(particles.value(l.volume, slot)) * cell_volume * std::abs(F.determinant());
        if (l.damage) damage_[p] = double(particles.value(l.damage, slot));
        for (int c = 0; l.fiber && c < 3; c++) fiber_[p * 3 + c] = double(particles.value(l.fiber, c, slot));
        for (int c = 0; c < D * D; c++) velocity_gradient_[p * D * D + c] = double(particles.value(l.affine, c, slot));
      }
  });
}

template <class T, int D>
void Constraints<T, D>::call(Law& called, double time_step) {
  const plugins::Instance& law = *called.instance;
  cleave_constraint_system system{};
  system.struct_size = sizeof system;
  system.dimension = D;
  system.cell_size = cell_size_;
  system.time_step = time_step;
  system.node_count = mass_.size();
  system.mass = mass_.data();
  system.velocity = velocity_.data();
  system.node_cell = node_cell_.data();
  system.prescribed = prescribed_.data();
  system.normal = any_normal_ ? normal_.data() : nullptr;
  system.particle_count = volume_.size();
  system.position = position_.data();
  system.volume = volume_.data();
  system.deformation = deformation_.data();
  system.fiber = law.can(CLEAVE_NEEDS_FIBER) ? fiber_.data() : nullptr;
  system.velocity_gradient = velocity_gradient_.data();
  system.nodes = nodes_.data();
  system.damage = damage_.empty() ? nullptr : damage_.data();
  system.threads = plugins::threads();
  cleave_constraint_report report{};
  report.struct_size = sizeof report;
  plugins::Message message;

  const auto fail = [&](const std::string& what) {
    throw SimulationError(fmt::format("plugin {} {} {}", law.description().id, law.description().version, what));
  };
  const auto& table = *static_cast<const cleave_constraint*>(law.plugin().kind_table());
  if (const cleave_result result = table.project(law.handle(), &system, &report, message.get()); result != CLEAVE_OK) {
    fail(*message.text() ? fmt::format("failed: {}", message.text()) : fmt::format("failed with error {}", result));
  }
  for (std::size_t i = 0; i < velocity_.size(); i++)
    if (!std::isfinite(T(velocity_[i]))) {
      Vector3 x = Vector3::Zero();
      for (int a = 0; a < D; a++) x[a] = double(node_cell_[i / D * D + a]) * cell_size_;
      fail(fmt::format("gives velocities that are not finite, at the grid node at ({:.6g}, {:.6g}, {:.6g}) m", x[0], x[1],
                       x[2]));
    }
  if (!std::isfinite(report.residual)) fail("reports a residual that is not a number");
  if (*message.text() && !std::exchange(called.spoke, true))
    spdlog::warn("plugin {}: {}; said once", law.description().id, message.text());
  statistics_.projections++;
  statistics_.iterations += report.iterations;
  statistics_.particles += std::int64_t(volume_.size());
  statistics_.particle_iterations += std::int64_t(volume_.size()) * report.iterations;
  statistics_.largest_residual = std::max(statistics_.largest_residual, report.residual);
}

namespace {
/// Null if the law cannot save.
const cleave_constraint* table_that_saves(const plugins::Instance& law) {
  const auto* table = static_cast<const cleave_constraint*>(law.plugin().kind_table());
  return CLEAVE_HAS(cleave_constraint, table, restore) && table->save && table->restore ? table : nullptr;
}
std::string memory_of(const std::string& prefix, std::size_t law) { return fmt::format("{}{} memory", prefix, law); }
}  // namespace

template <class T, int D>
void Constraints<T, D>::save(checkpoint::StateWriter& writer, const std::string& prefix) const {
  checkpoint::pack(writer, prefix + "statistics", [&](auto& archive) {
    archive(statistics_);
    for (const Law& law : laws_) archive(law.spoke);
  });
  for (std::size_t i = 0; i < laws_.size(); i++) {
    const plugins::Instance& law = *laws_[i].instance;
    const auto* table = table_that_saves(law);
    if (!table) continue;
    std::vector<std::byte> bytes(table->save(law.handle(), nullptr, 0));
    if (const std::uint64_t written = table->save(law.handle(), bytes.data(), bytes.size()); written != bytes.size())
      throw SimulationError(fmt::format("plugin {} {} saves {} bytes where it said {}", law.description().id,
                                        law.description().version, written, bytes.size()));
    writer.section(memory_of(prefix, i), bytes);
  }
}

template <class T, int D>
void Constraints<T, D>::restore(checkpoint::StateReader& reader, const std::string& prefix) {
  for (std::size_t i = 0; i < laws_.size(); i++) {
    const std::string section = memory_of(prefix, i);
    const plugins::Instance& law = *laws_[i].instance;
    const auto* table = table_that_saves(law);
    if (!table || !reader.has(section)) continue;
    const auto bytes = reader.read(section);
    plugins::Message message;
    if (const cleave_result result = table->restore(law.handle(), bytes.data(), bytes.size(), message.get());
        result != CLEAVE_OK)
      reader.refuse(section, "is refused by plugin " + law.description().id + ": " + message.reason(result));
  }
  checkpoint::unpack(reader, prefix + "statistics", [&](auto& archive) {
    archive(statistics_);
    for (Law& law : laws_) archive(law.spoke);
  });
}

template <class T, int D>
std::vector<std::string> Constraints<T, D>::not_saved() const {
  std::vector<std::string> lines;
  for (const Law& law : laws_)
    if (!table_that_saves(*law.instance))
      lines.push_back(fmt::format("plugin {} {} does not save what it keeps from step to step", law.instance->description().id,
                                  law.instance->description().version));
  return lines;
}

/// Nodes that are held altogether keep their velocity, whatever a law does.
template <class T, int D>
double Constraints<T, D>::write_back(Grid<T, D>& grid) const {
  return tbb::parallel_deterministic_reduce(
      tbb::blocked_range<std::size_t>(0, node_of_row_.size(), 1024), 0.0,
      [&](const auto& range, double change) {
        for (std::size_t row = range.begin(); row < range.end(); row++) {
          if (prescribed_[row] == fixed_velocity) continue;
          T* node = grid.node(node_of_row_[row]);
          for (int a = 0; a < D; a++) {
            const double before = double(node[1 + a]);
            node[1 + a] = T(velocity_[row * D + a]);
            change += mass_[row] * (double(node[1 + a]) - before) * (double(node[1 + a]) - before);
          }
        }
        return change;
      },
      std::plus<>());
}

template class Constraints<float, 2>;
template class Constraints<float, 3>;
template class Constraints<double, 2>;
template class Constraints<double, 3>;

}  // namespace cleave::mpm
