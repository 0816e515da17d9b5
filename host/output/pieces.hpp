#pragma once

#include "output/frame.hpp"

#include <cstdint>
#include <utility>
#include <vector>

namespace cleave::output {

/// Which piece of its broken body each particle belongs to.
///
/// Particles of a body are neighbours if they were within 1.5 mean spacings of each other at rest; one without any has the
/// nearest as neighbour. Neighbours hold together as long as neither is broken (damage of `broken` or more) and they are no
/// further apart than three cells, beyond which the quadratic splines of two particles share no node. What holds together is a
/// piece if it has the rest volume of a cell at least. Other particles go, layer by layer, to the piece of their nearest
/// neighbour as bodies are at that instant; where no chain of neighbours leads to a piece they are debris, of no piece: -1.
///
/// From call to call a piece keeps its number: of the parts a piece has come into, the one with most of its rest volume has it,
/// the others get numbers that were not given before, in the order of their first particles.
class Pieces {
 public:
  static constexpr float broken = 0.9f;  ///< (1 - d)^2, what is left of the stiffness, is a hundredth

  /// Of bodies at rest as in `rest`, those with counted[body].
  Pieces(const ParticleFrame& rest, std::vector<bool> counted);

  struct Count {
    std::int64_t pieces = 0;
    double debris = 0;  ///< part of the rest volume of the counted bodies that is of no piece
  };
  /// The same particles at a later instant. Damage is that of the attribute "damage", if the frame has it.
  Count find(const ParticleFrame&);

  /// Of each particle, as find() found it last; -1 in debris and in bodies that are not counted. Empty before the first call.
  const std::vector<std::int32_t>& of_particles() const { return labels_; }
  std::size_t bytes() const;  ///< that it holds

  /// What the numbers that later calls give depend on, for checkpoints.
  template <class Self, class Archive>
  static void list(Self& self, Archive& archive) {
    archive(self.next_, self.labels_);
  }
  /// Whether what was read can be of these particles.
  bool consistent() const;

 private:
  void connect(const ParticleFrame& rest, std::size_t begin, std::size_t end);
  /// each(i, j) for all neighbours i < j.
  template <class Each>
  void for_neighbours(const Each&) const;
  void keep_numbers(const ParticleFrame&, std::vector<std::int32_t>& found, std::int32_t pieces);

  std::vector<bool> counted_;
  std::size_t particles_ = 0;
  std::vector<std::uint64_t> first_;   ///< of each particle and the end, in others_
  std::vector<std::uint32_t> others_;  ///< neighbours with larger numbers
  std::vector<std::int32_t> labels_;
  std::int32_t next_ = 0;
};

}  // namespace cleave::output
