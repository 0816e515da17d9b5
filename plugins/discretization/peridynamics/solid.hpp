/// The peridynamic solid: ordinary state-based, elastic with dilatation and deviatoric parts, plastic and breaking bond by
/// bond [Silling et al. 2007; Chen et al. 2018].
#ifndef CLEAVE_PERIDYNAMICS_SOLID_HPP
#define CLEAVE_PERIDYNAMICS_SOLID_HPP

#include "shape_tensor.hpp"

#include <cleave/discretization.hpp>

#include <functional>
#include <memory>
#include <optional>

namespace cleave::peridynamics {

enum class Precision { single_precision, double_precision };
enum class Split { corrected, published };
enum class Return { consistent, printed };

/// Parameters of the material, SI.
struct Material {
  int dimension = 3;
  double shear = 0, bulk = 0;  ///< mu, kappa
  double horizon = 0;          ///< delta in mean spacings
  Precision precision = Precision::double_precision;
  Split split = Split::corrected;
  bool surface_correction = true;
  std::optional<std::array<double, 9>> anisotropy;  ///< G, row-major
  std::optional<double> yield;                      ///< psi_0, (N/m^6)^2
  double plastic_limit = 0;                         ///< gamma over |xi|
  Return plastic_return = Return::consistent;
  std::optional<double> critical_stretch;
  std::optional<double> energy_release_rate;  ///< J/m^2, instead
  double toughening = 0;                      ///< alpha

  /// A parallelogram that bonds are cut by: a corner and its two edges, m.
  struct Cut {
    std::array<double, 3> corner, edge, other_edge;
  };
  std::vector<Cut> cuts;
};

/// Per point, in the order of the body.
struct Results {
  std::span<double> force;            ///< N, 3 per point
  std::span<double> energy;           ///< J/m^3
  std::span<double> dilatation;       ///< theta
  std::span<double> damage;           ///< phi = 1 - n/N
  std::span<double> plastic_stretch;  ///< mean |e_p|/|xi| of the bonds; empty without plasticity
};

/// The bonds of one body.
class Solid {
 public:
  virtual ~Solid() = default;

  /// Stretches, yields and breaks bonds where the points are (3 numbers each).
  virtual void evaluate(const Threads&, std::span<const double> position, const Results&) = 0;
  /// v_i += share sum_j V_j (v_j - v_i)/V, j over the unbroken bonds, V the volume of a full family: momentum is kept.
  virtual void smooth(const Threads&, double share, std::span<double> velocity) const = 0;

  /// phi = 1 - n/N of each point, n of its N bonds unbroken.
  virtual void damage(std::span<double> phi) const = 0;
  /// visit(i, its sums) for the points that were at `rest` (3 numbers each) and are at `position`, moving with `velocity`.
  virtual void for_shapes(std::span<const double> rest, std::span<const double> position, std::span<const double> velocity,
                          const std::function<void(std::size_t, const ShapeTensor&)>& visit) const = 0;

  /// A bound of the square of the highest frequency of the unbroken body, 1/s^2.
  virtual double highest_square_frequency() const = 0;
  virtual std::uint64_t directed_bonds() const = 0;
  virtual std::uint64_t bytes_per_directed_bond() const = 0;

  struct Bond {
    std::size_t slot;
    double rest_length;  ///< |xi|, m
  };
  std::optional<Bond> bond(std::size_t i, std::size_t j) const { return find_bond(std::uint32_t(i), std::uint32_t(j)); }
  virtual bool intact(std::size_t slot) const = 0;

  /// What changes during a run: broken bonds, and e_p/|xi| of each.
  virtual void save(std::vector<std::byte>& state) const = 0;
  virtual std::size_t saved_bytes() const = 0;
  virtual void restore(std::span<const std::byte> state) = 0;

 private:
  virtual std::optional<Bond> find_bond(std::uint32_t i, std::uint32_t j) const = 0;
};

std::unique_ptr<Solid> make_solid(const Material&, const cleave_body&);

}  // namespace cleave::peridynamics

#endif
