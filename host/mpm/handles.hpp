#pragma once

#include "config/scene.hpp"
#include "mpm/colliders.hpp"
#include "mpm/grid.hpp"
#include "mpm/particles.hpp"

#include <cstdint>
#include <vector>

namespace cleave::mpm {

/// Particle groups with prescribed rigid motion. A grid node follows a handle where at least half of its mass comes from the
/// handle's particles, which themselves move exactly as prescribed.
template <class T, int D>
class Handles {
 public:
  static constexpr std::uint16_t none = 0xffff;

  Handles(const std::vector<config::Handle>& handles, double cell_size) : handles_(handles), cell_size_(cell_size) {}

  /// handle_of_id[id]: the handle of a particle, or `none`.
  void assign(std::vector<std::uint16_t> handle_of_id);
  bool any() const { return any_; }

  /// Finds the handles' particles again; call whenever particles were sorted.
  void prepare(const std::vector<Particles<T, D>*>&);
  /// After the grid update: prescribes node velocities for the step from `time` to `time + time_step`, and adds those nodes to
  /// `held` if that is given.
  void apply(Grid<T, D>&, const std::vector<const Particles<T, D>*>&, const std::vector<double>& densities, double time,
             double time_step, std::vector<HeldNode>* held = nullptr);
  /// After the transfer back: puts the handles' particles where they have to be. Returns true if one left its block's slack.
  /// Here and in `positions` a set that is null is left alone.
  bool move(const std::vector<Particles<T, D>*>&, const std::vector<std::vector<Vector3>>& positions_before, double time,
            double time_step) const;
  /// Positions of the handles' particles, per set, as `move` wants them.
  std::vector<std::vector<Vector3>> positions(const std::vector<const Particles<T, D>*>&) const;
  double maximum_speed(double time) const;

 private:
  /// The particles of one handle in one block: slots[first], ..., slots[first + count - 1].
  struct Run {
    std::uint16_t handle, colour;
    std::uint32_t block, first, count;
  };
  /// Of one set, ordered by handle, colour and block.
  struct Members {
    std::vector<std::uint64_t> slots;
    std::vector<Run> runs;
    std::vector<std::size_t> begin;  ///< of the runs of each handle and colour, and the end
  };
  void add_mass(const Particles<T, D>&, const Members&, const Run&, double density);
  bool active(std::uint16_t handle, double time) const { return time < handles_[handle].release; }

  std::vector<config::Handle> handles_;
  double cell_size_;
  bool any_ = false;
  std::vector<std::uint16_t> handle_of_id_;
  std::vector<Members> members_;                     // per set
  std::vector<std::vector<std::uint32_t>> reached_;  // per handle: grid blocks that its particles reach, ascending
  std::vector<float> mass_;                          // per grid node, zero between calls
};

}  // namespace cleave::mpm
