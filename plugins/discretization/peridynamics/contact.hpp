/// Short-range forces that keep apart what no bond holds together: other bodies, pieces, and the faces of a crack.
#ifndef CLEAVE_PERIDYNAMICS_CONTACT_HPP
#define CLEAVE_PERIDYNAMICS_CONTACT_HPP

#include "cell_list.hpp"
#include "solid.hpp"

namespace cleave::peridynamics {

/// Two points without a bond, closer than d = `distance` times the mean of their spacings, push each other with
/// kappa h^(D-2) (d - |y|) along y, as the solid in between would. Points that had a bond count as apart at their distance at
/// rest, if that is less.
class Contact {
 public:
  struct Body {
    std::size_t first, last;  ///< points
    double spacing;
    const Solid* solid;
  };

  Contact(double distance, double bulk, int dimension) : distance_(distance), bulk_(bulk), dimension_(dimension) {}

  /// Adds to the forces on points (3 numbers each). `damage` tells which points have broken bonds.
  void push(const Threads&, std::span<const Body> bodies, std::span<const double> position, std::span<const double> damage,
            std::span<double> force);
  /// Sum of the stiffnesses [N/m] that meet in a point, at most, of contacts that are closed or about to close.
  double stiffness() const { return stiffness_; }
  /// After a change of the positions that was no motion.
  void forget() { near_position_.clear(); }
  void restore_stiffness(double stiffness) { stiffness_ = stiffness; }

 private:
  /// Those of a point, ascending.
  struct Pair {
    std::uint32_t other;
    bool bonded;
    double distance;  ///< at which they touch
    std::size_t slot;
  };

  struct Pairs {
    std::vector<Pair> list;
    bool with_bonds = false;  ///< also of bonds, which may break: as soon as the point is damaged
  };

  void find_neighbours(std::span<const Body> bodies, std::span<const double> position);
  void find_pairs(std::span<const Body> bodies, std::uint32_t i, bool with_bonds);
  bool moved(const Threads&, std::span<const double> position) const;

  double distance_, bulk_;
  int dimension_;
  double reach_ = 0, slack_ = 0;       ///< of pairs; how much closer two points may have come since
  std::vector<double> near_position_;  ///< where pairs are found
  std::optional<CellList> cells_;      ///< of these places
  std::vector<Pairs> pairs_;
  double stiffness_ = 0;
};

}  // namespace cleave::peridynamics

#endif
