#include "solid.hpp"

#include "families.hpp"
#include "moments.hpp"
#include "neighbour_lanes.hpp"

#include <bit>
#include <numbers>
#include <stdexcept>

namespace cleave::peridynamics {
namespace {

constexpr double pi = std::numbers::pi;

using Vector = std::array<double, 3>;
Vector difference(const double* b, const double* a) { return {b[0] - a[0], b[1] - a[1], b[2] - a[2]}; }
using peridynamics::dot;
double dot(const Vector& a, const Vector& b) { return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]; }
double length(const Vector& v) { return std::sqrt(v[0] * v[0] + v[1] * v[1] + v[2] * v[2]); }

/// How the kernel holds positions. Single: whole numbers of a small unit, whose differences are exact however far from the
/// origin; they wrap around at 16 horizons, where no bond reaches. Differences of j and i and of i and j are opposite. They
/// are taken of unsigned numbers, which may wrap around.
template <class S>
struct Place;
template <>
struct Place<float> {
  static double unit(double horizon) { return std::ldexp(horizon, -27); }
  static float of(double x, double per_unit) {
    const double scaled = x * per_unit;
    return std::bit_cast<float>(std::abs(scaled) < 9e18 ? std::int32_t(std::int64_t(std::nearbyint(scaled))) : 0);
  }
  using Own = std::uint32_t;
  static Own own(float place) { return std::bit_cast<Own>(place); }
  static CLEAVE_INLINE Lanes<float> difference(Lanes<float> place, Own own) {
    return from_integer(reinterpret_cast<detail::Int32Vector>(integer_bits(place) - own));
  }
};
template <>
struct Place<double> {
  static double unit(double) { return 1; }
  static double of(double x, double) { return x; }
  using Own = double;
  static Own own(double place) { return place; }
  static CLEAVE_INLINE Lanes<double> difference(Lanes<double> place, Own own) { return place - own; }
};

template <class S>
struct Root {
  Lanes<S> root, inverse;
};
/// sqrt(a) rounded almost correctly, for extensions are small differences of lengths; tiny at 0.
template <class S>
CLEAVE_INLINE Root<S> root_of(Lanes<S> a) {
  const Lanes<S> square = max(a, Lanes<S>(std::numeric_limits<S>::min())), inverse = inverse_root(square),
                 root = square * inverse;
  return {fma(S(0.5) * inverse, fma(-root, root, square), root), inverse};
}

/// What a bond needs to know besides its length, stiffness and ends.
///   brittle     elastic, breaking at a fixed stretch
///   general     also plastic or toughened
///   published   with the cosines Lambda of the paper
enum class Form { brittle, general, published };

/// Four numbers for each point.
template <class S>
using Table = std::vector<S>;

template <class S>
class Bonds final : public Solid {
 public:
  Bonds(const Material&, const cleave_body&);

  void evaluate(const Threads& threads, std::span<const double> position, const Results& results) override {
    threads.for_ranges(points(), 4096, [&](std::uint64_t first, std::uint64_t last) {
      for (std::uint64_t k = first; k < last; ++k)
        for (std::size_t a = 0; a < 3; ++a)
          place_[4 * k + a] = Place<S>::of(position[3 * std::size_t(families_.order[k]) + a], 1 / unit_);
    });
    if (form_ == Form::brittle)
      both_passes<Form::brittle>(threads, results);
    else if (form_ == Form::general)
      both_passes<Form::general>(threads, results);
    else
      both_passes<Form::published>(threads, results);
  }

  void smooth(const Threads&, double share, std::span<double> velocity) const override;
  void damage(std::span<double> phi) const override {
    for (std::size_t i = 0; i < points(); ++i) phi[families_.order[i]] = damage_[i];
  }
  void for_shapes(std::span<const double> rest, std::span<const double> position, std::span<const double> velocity,
                  const std::function<void(std::size_t, const ShapeTensor&)>& visit) const override;

  double highest_square_frequency() const override { return highest_square_frequency_; }
  std::uint64_t directed_bonds() const override {
    std::uint64_t sum = 0;
    for (const std::uint32_t n : families_.count) sum += n;
    return sum;
  }
  std::uint64_t bytes_per_directed_bond() const override {
    return 2 * sizeof(std::uint16_t) + sizeof(S) * (plastic_.empty() ? 1 : 2);
  }

  bool intact(std::size_t slot) const override { return rest_[slot] > 0; }

  std::size_t saved_bytes() const override { return (directed_bonds() + 7) / 8 + plastic_stretches() * sizeof(S); }
  void save(std::vector<std::byte>& state) const override;
  void restore(std::span<const std::byte> state) override;

 private:
  static constexpr unsigned width = Lanes<S>::width;
  static constexpr double stiffness_steps = 65535;

  std::size_t points() const { return families_.order.size(); }
  std::size_t plastic_stretches() const { return plastic_.empty() ? 0 : directed_bonds(); }

  std::optional<Bond> find_bond(std::uint32_t body_i, std::uint32_t body_j) const override {
    const std::uint32_t i = place_in_order_[body_i], j = place_in_order_[body_j];
    const auto block = std::upper_bound(families_.blocks.begin(), families_.blocks.end(), i,
                                        [](std::uint32_t point, const Block& b) { return point < b.last; });
    const auto near = families_.near.begin();
    const auto first = near + std::ptrdiff_t(block->near_first), last = near + std::ptrdiff_t(block->near_last);
    const auto there = std::lower_bound(first, last, j);
    if (there == last || *there != j) return {};
    const auto list = families_.neighbour.begin() + std::ptrdiff_t(families_.first[i]);
    const auto end = list + families_.count[i];
    const auto found = std::lower_bound(list, end, std::uint16_t(2 * (there - first)));
    if (found == end || *found != std::uint16_t(2 * (there - first))) return {};
    const auto slot = std::size_t(found - families_.neighbour.begin());
    return Bond{slot, std::abs(double(rest_[slot])) * unit_};
  }

  /// phi of all points from their bonds.
  void count_damage();

  template <Form form>
  void both_passes(const Threads& threads, const Results& results) {
    threads.for_ranges(families_.blocks.size(), 1, [&](std::uint64_t first, std::uint64_t last) {
      for (std::uint64_t b = first; b < last; ++b) dilate<form>(families_.blocks[b], results);
    });
    threads.for_ranges(families_.blocks.size(), 1, [&](std::uint64_t first, std::uint64_t last) {
      for (std::uint64_t b = first; b < last; ++b) pull<form>(families_.blocks[b], results);
    });
    damage_.swap(damaged_);
  }

  /// Copies of four numbers of all points that a block sees, which stay in the cache while its bonds are worked on.
  template <class Fill>
  std::unique_ptr<S[]> near_table(const Block& block, const Fill& fill) const {
    auto table = std::make_unique_for_overwrite<S[]>(4 * (block.near_last - block.near_first));
    S* row = table.get();
    for (std::uint64_t k = block.near_first; k < block.near_last; ++k, row += 4) fill(row, std::size_t(families_.near[k]));
    return table;
  }

  template <Form form>
  void dilate(const Block&, const Results&);
  template <Form form>
  void pull(const Block&, const Results&);

  const Material material_;
  Families families_;
  std::vector<std::uint32_t> place_in_order_;
  Form form_;
  double unit_;                  ///< m of the lengths of the kernel
  S stiffness_step_;             ///< N
  S break_at_, toughening_;      ///< e - e_p at which a bond breaks; alpha/2
  S yield_ = 0, plastic_limit_;  ///< N at volumes of 1; gamma
  S published_share_;            ///< (delta/4)/2 of M&O's split; 0 with the other
  double bulk_coupling_;         ///< kappa - 5 mu/3

  // per point
  Table<S> place_;                                   ///< position, and nothing
  std::vector<S> volume_;                            ///< V_i over the mean
  std::vector<double> true_volume_;                  ///< V_i
  std::vector<S> dilatation_scale_, tension_scale_;  ///< theta_i from the sum over its bonds; T_i from theta_i
  std::vector<S> theta_, tension_;                   ///< theta_i, T_i [N]
  std::vector<S> damage_, damaged_;                  ///< phi_i before and after
  Table<S> rest_place_;                              ///< as place_, of the published form

  // per directed bond, padded
  std::vector<S> rest_;                   ///< |xi|; negative once broken
  std::vector<std::uint16_t> stiffness_;  ///< K |xi| in stiffness_step_
  std::vector<S> plastic_;                ///< e_p/|xi|

  double highest_square_frequency_ = 0;
  double horizon_, full_volume_;  ///< delta, and the volume of its ball
  double mean_volume_ = 0;
};

// ------------------------------------------------------------------------------------------------- at rest

/// What the stiffnesses of a body are made from: bonds of points in the order of the families.
struct Rest {
  const Threads threads;
  const Material& material;
  const Families& families;
  double spacing, horizon, reach;
  std::vector<Vector> at;
  std::vector<double> volume;

  struct Bond {
    std::size_t slot, j;
    Vector direction;
    double length, influence;  ///< |xi|, beta |xi|/|G xi|
  };
  template <class Visit>
  void for_bonds(const Block& block, std::size_t i, const Visit& visit) const {
    for (std::size_t s = families.first[i]; s < families.first[i] + families.count[i]; ++s) {
      Bond bond;
      bond.slot = s;
      bond.j = families.near[block.near_first + families.neighbour[s] / 2];
      Vector& n = bond.direction = difference(at[bond.j].data(), at[i].data());
      bond.length = peridynamics::length(n);
      // The part of a neighbour inside of the horizon: linear over one spacing around it [Silling & Askari 2005].
      bond.influence = material.surface_correction ? std::min(1.0, (reach - bond.length) / spacing) : 1;
      if (material.anisotropy) {
        const auto& G = *material.anisotropy;
        Vector Gxi{};
        for (std::size_t a = 0; a < 3; ++a)
          for (std::size_t b = 0; b < 3; ++b) Gxi[a] += G[3 * a + b] * n[b];
        bond.influence *= bond.length / peridynamics::length(Gxi);
      }
      for (double& component : n) component /= bond.length;
      visit(bond);
    }
  }
  /// visit(block, i); points of different blocks at the same time.
  template <class Visit>
  void for_points(const Visit& visit) const {
    threads.for_each(families.blocks.size(), [&](std::uint64_t b) {
      const Block& block = families.blocks[b];
      for (std::size_t i = block.first; i < block.last; ++i) visit(block, i);
    });
  }
  /// The largest (or the sum) of value(block, i), the same for any number of threads.
  template <class Value>
  double largest(const Value& value) const {
    return reduced(value, [](double a, double b) { return std::max(a, b); });
  }
  template <class Value>
  double sum(const Value& value) const {
    return reduced(value, [](double a, double b) { return a + b; });
  }

 private:
  template <class Value, class Join>
  double reduced(const Value& value, const Join& join) const {
    std::vector<double> parts(families.blocks.size());
    for_points([&](const Block& block, std::size_t i) {
      double& part = parts[std::size_t(&block - families.blocks.data())];
      part = join(part, value(block, i));
    });
    double all = 0;
    for (const double part : parts) all = join(all, part);
    return all;
  }
};

/// Where a cut is seen from two points, on different sides of its plane. Points in the plane count as in front.
class CutPlane {
 public:
  explicit CutPlane(const Material::Cut& cut) : cut_(cut) {
    for (std::size_t a = 0; a < 3; ++a) {
      const std::size_t b = (a + 1) % 3, c = (a + 2) % 3;
      normal_[a] = cut.edge[b] * cut.other_edge[c] - cut.edge[c] * cut.other_edge[b];
    }
  }
  double height(const Vector& x) const { return dot(normal_, difference(x.data(), cut_.corner.data())); }

  /// Whether the line from a to b goes through the parallelogram, its edges included.
  bool between(const Vector& a, const Vector& b) const {
    const double from = height(a), to = height(b);
    if ((from >= 0) == (to >= 0)) return false;
    Vector hit;
    for (std::size_t k = 0; k < 3; ++k) hit[k] = a[k] + from / (from - to) * (b[k] - a[k]) - cut_.corner[k];
    const double uu = dot(cut_.edge, cut_.edge), uv = dot(cut_.edge, cut_.other_edge),
                 vv = dot(cut_.other_edge, cut_.other_edge);
    const double hu = dot(hit, cut_.edge), hv = dot(hit, cut_.other_edge), area = uu * vv - uv * uv;
    const double u = (hu * vv - hv * uv) / area, v = (hv * uu - hu * uv) / area;
    constexpr double edge = 1e-9;
    return std::min(u, v) >= -edge && std::max(u, v) <= 1 + edge;
  }

 private:
  Material::Cut cut_;
  Vector normal_;
};

/// (1/m_i + 1/m_j)/2 of the bonds, m the weighted volume of a point over delta: of a full ball, or of its family.
std::vector<float> weights_by_volume(const Rest& rest) {
  const int D = rest.material.dimension;
  std::vector<double> moment(rest.at.size(), (D == 3 ? pi : 2 * pi / 3) * std::pow(rest.horizon, D + 1));
  if (rest.material.surface_correction)
    rest.for_points([&](const Block& block, std::size_t i) {
      moment[i] = 0;
      rest.for_bonds(block, i, [&](const Rest::Bond& b) { moment[i] += b.influence * b.length * rest.volume[b.j]; });
    });
  std::vector<float> weights(rest.families.neighbour.size());
  rest.for_points([&](const Block& block, std::size_t i) {
    rest.for_bonds(block, i, [&](const Rest::Bond& b) { weights[b.slot] = float(0.5 * (1 / moment[i] + 1 / moment[b.j])); });
  });
  return weights;
}

/// Under a uniform strain eps a bond of direction n has the stretch n.eps.n, so all that the elasticity of a point knows of
/// its bonds is the tensor sum_j V_j beta_ij |xi| w_i n n n n. In a ball full of bonds, of weight w = 1/m, it is the mean of
/// n n n n over all directions, which makes the solid isotropic and its moduli those given. With few bonds, or near a surface,
/// it is not, and the weights of the ends of a bond become
///
///   w_i(n) = (1 + g_i(n))/m_i,
///
/// g_i the polynomial of fourth order with the least squares that makes the tensor of i isotropic. Weights stay between a
/// tenth and four times 1/m_i, and their sum is kept: families that are too poor (along edges) come as close as positive
/// stiffnesses allow, and have the right bulk modulus.
std::vector<float> isotropic_weights(const Rest& rest) {
  const Moments target = isotropic_moments(rest.material.dimension);
  std::vector<Moments> polynomial(rest.at.size());
  std::vector<double> per_moment(rest.at.size());
  const auto factor = [&](std::size_t i, const Moments& phi) {
    return std::clamp(1 + dot(polynomial[i], phi), 0.1, 4.0) * per_moment[i];
  };
  rest.for_points([&](const Block& block, std::size_t i) {
    double moment = 0;
    rest.for_bonds(block, i, [&](const Rest::Bond& b) { moment += rest.volume[b.j] * b.influence * b.length; });
    if (moment == 0) return;
    MomentMatrix matrix;
    Moments missing = target;
    rest.for_bonds(block, i, [&](const Rest::Bond& b) {
      const double p = rest.volume[b.j] * b.influence * b.length / moment;
      const Moments phi = fourth_powers(b.direction);
      for (std::size_t k = 0; k < phi.size(); ++k) missing[k] -= p * phi[k];
      matrix.add(phi, p);
    });
    polynomial[i] = matrix.solve(missing);
    per_moment[i] = 1;
    double sum = 0;
    rest.for_bonds(block, i, [&](const Rest::Bond& b) {
      sum += rest.volume[b.j] * b.influence * b.length * factor(i, fourth_powers(b.direction));
    });
    per_moment[i] = 1 / sum;
  });
  std::vector<float> weights(rest.families.neighbour.size());
  rest.for_points([&](const Block& block, std::size_t i) {
    rest.for_bonds(block, i, [&](const Rest::Bond& b) {
      const Moments phi = fourth_powers(b.direction);
      weights[b.slot] = float(0.5 * (factor(i, phi) + factor(b.j, phi)));
    });
  });
  return weights;
}

/// Work per area of taking two halves of a full body apart, over the square of the extension (m) at which bonds break;
/// `stiffness` is sum K |xi| of both lists of a bond, per volume.
///
/// A bond takes K e^2/2. Of those with direction n a plane of normal N meets |N.xi| per area for each per volume, on average
/// over all N half of |xi|, in the plane 2/pi of it. As long as bonds across hold, a point at the distance z of the plane also
/// has, at a gap g of t = g/e,
///
///   theta = 2 s_c t (u^2/2 + zeta^3/u - 3 zeta^2/2),   zeta = z/delta < u = min(1, 1/t),   s_c = e/delta,
///
/// and the work of both sides, 2 (kappa - 5 mu/3) int dz int theta^2/g dg, is 13/21 (kappa - 5 mu/3) s_c^2 delta beside the
/// 5 mu s_c^2 delta of the bonds; in the plane 0.4374 beside 12/pi mu, integrated numerically.
double separation_work(const Material& material, double stiffness) {
  const bool space = material.dimension == 3;
  const double bonds = 0.5 * (space ? 0.5 : 2 / pi) * 0.5 * stiffness;
  const double dilatation = space ? 13.0 / 21 / 5 : 0.4374 / (12 / pi);
  return bonds * (1 + dilatation * (material.bulk / material.shear - 5.0 / 3));
}

template <class S>
Bonds<S>::Bonds(const Material& material, const cleave_body& body) : material_(material) {
  const int D = material.dimension;
  const double h = body.spacing;
  const bool corrected = material.surface_correction, published = material.split == Split::published;
  horizon_ = material.horizon * h;
  const double reach = corrected ? horizon_ + h / 2 : horizon_;
  const std::span position(body.position, 3 * body.point_count);
  const Threads threads = threads_of(body);
  families_ = find_families(threads, position, h, reach, width);
  const std::size_t n = points(), slots = families_.neighbour.size();
  place_in_order_.resize(n);
  for (std::size_t k = 0; k < n; ++k) place_in_order_[families_.order[k]] = std::uint32_t(k);

  const bool plastic = material.yield.has_value();
  form_ = published ? Form::published : plastic || material.toughening > 0 ? Form::general : Form::brittle;
  unit_ = Place<S>::unit(horizon_);
  toughening_ = S(0.5 * material.toughening);
  plastic_limit_ = S(material.plastic_limit);
  full_volume_ = D == 3 ? 4 * pi / 3 * std::pow(horizon_, 3) : pi * horizon_ * horizon_;
  bulk_coupling_ = material.bulk - 5 * material.shear / 3;
  // c of the split e_d = e - c Lambda theta: delta/4, in the plane delta/3.
  published_share_ = S(published ? 0.5 * (D == 3 ? horizon_ / 4 : horizon_ / 3) / unit_ : 0);

  Rest rest{threads, material, families_, h, horizon_, reach, std::vector<Vector>(n), std::vector<double>(n)};
  for (std::size_t i = 0; i < n; ++i) mean_volume_ += body.volume[i] / double(n);
  for (std::size_t k = 0; k < n; ++k) {
    const std::size_t i = families_.order[k];
    rest.at[k] = {position[3 * i], position[3 * i + 1], position[3 * i + 2]};
    rest.volume[k] = body.volume[i];
    volume_.push_back(S(body.volume[i] / mean_volume_));
  }
  true_volume_ = rest.volume;
  place_.resize(4 * n);
  if (published) {
    rest_place_.resize(4 * n);
    for (std::size_t k = 0; k < 4 * n; ++k) rest_place_[k] = k % 4 < 3 ? Place<S>::of(rest.at[k / 4][k % 4], 1 / unit_) : S(0);
  }
  for (auto* values : {&theta_, &tension_, &damage_, &damaged_, &dilatation_scale_, &tension_scale_}) values->resize(n);

  // K |xi|, K = alpha w_ij (delta/|G xi|) V_i V_j of both ends: alpha = 15 mu in space, 8 mu in the plane.
  const bool isotropic = corrected && !material.anisotropy && !published;
  const std::vector<float> weights = isotropic ? isotropic_weights(rest) : weights_by_volume(rest);
  const double alpha = D * (D + 2) * material.shear;
  const auto exact_stiffness = [&](std::size_t i, const Rest::Bond& b) {
    return 2 * alpha * double(weights[b.slot]) * b.influence * (rest.volume[i] * rest.volume[b.j]);
  };
  const double stiffest = rest.largest([&](const Block& block, std::size_t i) {
    double most = 0;
    rest.for_bonds(block, i, [&](const Rest::Bond& b) { most = std::max(most, exact_stiffness(i, b)); });
    return most;
  });
  stiffness_step_ = S(stiffest / stiffness_steps);
  if (plastic) yield_ = S(std::sqrt(2 * *material.yield) * mean_volume_ * mean_volume_ / double(stiffness_step_));
  rest_.assign(slots, S(-1));
  stiffness_.assign(slots, 0);
  if (plastic) plastic_.assign(slots, S(0));

  // theta_i = sum_j c_ij e_ij, c_ij = D K |xi| / sum_j K |xi|^2, and as published D K / sum_j K |xi|.
  std::vector<double> moment(n), row(n), coupling(n), unbalance(n);
  rest.for_points([&](const Block& block, std::size_t i) {
    Vector sum{};
    rest.for_bonds(block, i, [&](const Rest::Bond& b) {
      rest_[b.slot] = S(b.length / unit_);
      stiffness_[b.slot] = std::uint16_t(std::lround(exact_stiffness(i, b) / stiffest * stiffness_steps));
      const double G = stiffness_[b.slot] * double(stiffness_step_), c = published ? G / b.length : G;
      moment[i] += c * b.length;
      row[i] += 2 * G / b.length;
      coupling[i] += D * c;
      for (std::size_t a = 0; a < 3; ++a) sum[a] += D * c * b.direction[a];
    });
    if (!corrected)
      moment[i] =
          2 * alpha * rest.volume[i] * (published ? full_volume_ / (D == 3 ? pi : 2 * pi / 3) / std::pow(horizon_, D + 1) : 1);
    if (moment[i] == 0) return;
    coupling[i] /= moment[i];
    unbalance[i] = length(sum) / moment[i];
    dilatation_scale_[i] = S(D * (published ? 1 : unit_) / moment[i]);
    tension_scale_[i] = S(bulk_coupling_ * D * rest.volume[i] / moment[i] / (published ? unit_ : 1));
  });
  // Row sums of K bound the eigenvalues of M^-1 K. theta_i has the energy (kappa - 5 mu/3)/2 V_i theta_i^2; where that is
  // negative it only lowers them.
  highest_square_frequency_ = rest.largest([&](const Block& block, std::size_t i) -> double {
    if (moment[i] == 0) return 0;
    double volumetric = unbalance[i] * (coupling[i] + unbalance[i]) * rest.volume[i];
    rest.for_bonds(block, i, [&](const Rest::Bond& b) {
      const double G = stiffness_[b.slot] * double(stiffness_step_), c = D * (published ? G / b.length : G) / moment[b.j];
      volumetric += rest.volume[b.j] * c * (coupling[b.j] + unbalance[b.j]);
    });
    const double total = row[i] + std::max(bulk_coupling_, 0.0) * volumetric;
    return total / (body.density * rest.volume[i]);
  });

  std::optional<double> critical = material.critical_stretch;
  if (material.energy_release_rate) {
    const double stiffness = rest.sum([&](const Block&, std::size_t i) {
      double sum = 0;
      for (std::size_t s = families_.first[i]; s < families_.first[i + 1]; ++s) sum += stiffness_[s];
      return sum * double(stiffness_step_);
    });
    critical =
        std::sqrt(*material.energy_release_rate / separation_work(material, stiffness / (mean_volume_ * double(n)))) / horizon_;
  }
  break_at_ = S(critical ? *critical * horizon_ / unit_ : 1e30);

  for (const Material::Cut& cut : material.cuts) {
    const CutPlane plane(cut);
    rest.for_points([&](const Block& block, std::size_t i) {
      rest.for_bonds(block, i, [&](const Rest::Bond& b) {
        if (plane.between(rest.at[std::min(i, b.j)], rest.at[std::max(i, b.j)])) rest_[b.slot] = -std::abs(rest_[b.slot]);
      });
    });
  }
  count_damage();
}

// ------------------------------------------------------------------------------------------------- a step

/// theta_i = D/m_i sum_j w_ij |xi| e_ij V_j,   m_i = sum_j w_ij |xi|^2 V_j            [Silling et al. 2007]
/// theta_i = D/q_i sum_j w_ij Lambda e_ij V_j, q_i = sum_j w_ij |xi| V_j              [Chen et al. 2018, eq. 6]
///
/// The weights w V are those of the stiffness, K.
template <class S>
template <Form form>
CLEAVE_FLATTEN void Bonds<S>::dilate(const Block& block, const Results& results) {
  using L = Lanes<S>;
  const auto table = near_table(block, [&](S* row, std::size_t j) {
    std::copy_n(&place_[4 * j], 3, row);
    row[3] = 0;
  });
  const auto rest_table = form == Form::published
                              ? near_table(block, [&](S* row, std::size_t j) { std::copy_n(&rest_place_[4 * j], 4, row); })
                              : nullptr;
  for (std::size_t i = block.first; i < block.last; ++i) {
    const auto x = Place<S>::own(place_[4 * i]), y = Place<S>::own(place_[4 * i + 1]), z = Place<S>::own(place_[4 * i + 2]);
    L sum = 0;
    for (std::size_t s = families_.first[i]; s < families_.first[i + 1]; s += width) {
      const auto neighbour = load_neighbours(table.get(), &families_.neighbour[s]);
      const L dx = Place<S>::difference(neighbour.x, x), dy = Place<S>::difference(neighbour.y, y),
              dz = Place<S>::difference(neighbour.z, z);
      const L rest = L::load_unaligned(&rest_[s]);
      const L distance = root_of(dx * dx + dy * dy + dz * dz).root;
      L part = load_small<S>(&stiffness_[s]) * (distance - rest);
      if constexpr (form == Form::published) {
        const auto from = load_neighbours(rest_table.get(), &families_.neighbour[s]);
        const S* own = &rest_place_[4 * i];
        const L along = dx * Place<S>::difference(from.x, Place<S>::own(own[0])) +
                        dy * Place<S>::difference(from.y, Place<S>::own(own[1])) +
                        dz * Place<S>::difference(from.z, Place<S>::own(own[2]));
        part = part * along / max(distance * rest * rest, L(S(1e-30)));
      }
      sum += select(rest > S(0), part, L(0));
    }
    theta_[i] = dilatation_scale_[i] * (stiffness_step_ * total(sum));
    tension_[i] = tension_scale_[i] * theta_[i];
    results.dilatation[families_.order[i]] = theta_[i];
  }
}

/// On point i acts, of each bond,
///
///   (kappa - 5 mu/3) (V_i theta_i c_ij + V_j theta_j c_ji) + K_ij (e - e_p),   c_ij = d theta_i/d e_ij,
///
/// along it: A_ij + A_ji of the specification with the theta in e_d gathered with the other [Madenci & Oterkus 2014]. Both
/// ends compute the same bits, so forces are opposite, bonds break in both lists, and e_p is the same in both.
template <class S>
template <Form form>
CLEAVE_FLATTEN void Bonds<S>::pull(const Block& block, const Results& results) {
  using L = Lanes<S>;
  const auto table = near_table(block, [&](S* row, std::size_t j) {
    std::copy_n(&place_[4 * j], 3, row);
    row[3] = tension_[j];
  });
  const auto second_table = form == Form::brittle ? nullptr : near_table(block, [&](S* row, std::size_t j) {
    row[0] = theta_[j];
    row[1] = damage_[j];
    row[2] = volume_[j];
    row[3] = 0;
  });
  const auto rest_table = form == Form::published
                              ? near_table(block, [&](S* row, std::size_t j) { std::copy_n(&rest_place_[4 * j], 4, row); })
                              : nullptr;
  const S per_dimension = S(1) / S(2 * material_.dimension);
  const bool plastic = !plastic_.empty(), printed = material_.plastic_return == Return::printed;
  const L printed_factor = S(2 * horizon_ / unit_);
  for (std::size_t i = block.first; i < block.last; ++i) {
    const auto x = Place<S>::own(place_[4 * i]), y = Place<S>::own(place_[4 * i + 1]), z = Place<S>::own(place_[4 * i + 2]);
    const L tension = tension_[i], theta = theta_[i], damage = damage_[i];
    Sum<S> fx, fy, fz;
    L energy = 0, plastic_sum = 0;
    int intact = 0;
    for (std::size_t s = families_.first[i]; s < families_.first[i + 1]; s += width) {
      const auto neighbour = load_neighbours(table.get(), &families_.neighbour[s]);
      const L dx = Place<S>::difference(neighbour.x, x), dy = Place<S>::difference(neighbour.y, y),
              dz = Place<S>::difference(neighbour.z, z);
      const L rest = L::load_unaligned(&rest_[s]);
      const auto [distance, per_distance] = root_of(dx * dx + dy * dy + dz * dz);
      const L G = load_small<S>(&stiffness_[s]);
      auto whole = rest > S(0);
      const L per_rest = reciprocal(max(rest, L(std::numeric_limits<S>::min())));
      const L extension = distance - rest, stretch = extension * per_rest;
      L dilated = tension + neighbour.w, elastic = stretch;
      if constexpr (form == Form::brittle) {
        const auto breaks = whole & (extension > break_at_);
        if (any(breaks)) [[unlikely]] {
          select(breaks, -rest, rest).store_unaligned(&rest_[s]);
          whole = whole & !breaks;
        }
      } else {
        const auto second = load_neighbours(second_table.get(), &families_.neighbour[s]);
        L dilatation = (theta + second.x) * per_dimension;
        if constexpr (form == Form::published) {
          const auto from = load_neighbours(rest_table.get(), &families_.neighbour[s]);
          const S* own = &rest_place_[4 * i];
          const L cosine = (dx * Place<S>::difference(from.x, Place<S>::own(own[0])) +
                            dy * Place<S>::difference(from.y, Place<S>::own(own[1])) +
                            dz * Place<S>::difference(from.z, Place<S>::own(own[2]))) *
                           per_distance * per_rest;
          dilated *= cosine * per_rest;
          dilatation = (theta + second.x) * cosine * published_share_ * per_rest;
        }
        if (plastic) {
          L flow = L::load_unaligned(&plastic_[s]);
          const L pull = G * (stretch - dilatation - flow), excess = abs(pull) - yield_ * (second.z * volume_[i]);
          const auto yields = whole & (excess > S(0));
          if (any(yields)) {
            L more = copysign(excess / max(G, L(std::numeric_limits<S>::min())), pull);
            if (printed) more *= printed_factor * per_rest;
            flow = select(yields, max(min(flow + more, L(plastic_limit_)), L(-plastic_limit_)), flow);
            flow.store_unaligned(&plastic_[s]);
          }
          elastic = stretch - flow;
          plastic_sum += select(whole, abs(flow), L(0));
        }
        const L bound = break_at_ * (S(1) + toughening_ * (damage + second.y));
        const auto breaks = whole & (elastic * rest > bound);
        if (any(breaks)) [[unlikely]] {
          select(breaks, -rest, rest).store_unaligned(&rest_[s]);
          whole = whole & !breaks;
        }
      }
      const L pull = G * elastic, force = select(whole, (G * dilated + pull) * per_distance, L(0));
      fx.add(force * dx);
      fy.add(force * dy);
      fz.add(force * dz);
      energy += select(whole, pull * elastic * rest, L(0));
      intact += std::popcount(whole.bits());
    }
    const std::size_t point = families_.order[i];
    results.force[3 * point] = stiffness_step_ * fx.all();
    results.force[3 * point + 1] = stiffness_step_ * fy.all();
    results.force[3 * point + 2] = stiffness_step_ * fz.all();
    // Each end has half of the energy of a bond, K (e - e_p)^2/2.
    results.energy[point] = 0.25 * double(total(energy)) * double(stiffness_step_) * unit_ / true_volume_[i] +
                            0.5 * bulk_coupling_ * theta_[i] * theta_[i];
    const std::uint32_t all = families_.count[i];
    damaged_[i] = all ? S(1) - S(intact) / S(all) : S(0);
    results.damage[point] = damaged_[i];
    if (plastic) results.plastic_stretch[point] = intact ? double(total(plastic_sum)) / intact : 0;
  }
}

/// In single precision the differences of velocities are rounded as one, so that momentum is kept.
template <class S>
void Bonds<S>::smooth(const Threads& threads, double share, std::span<double> velocity) const {
  using L = Lanes<S>;
  Table<S> before(4 * points());
  threads.for_ranges(points(), 4096, [&](std::uint64_t first, std::uint64_t last) {
    for (std::uint64_t k = first; k < last; ++k) {
      for (std::size_t a = 0; a < 3; ++a) before[4 * k + a] = S(velocity[3 * std::size_t(families_.order[k]) + a]);
      before[4 * k + 3] = volume_[k];
    }
  });
  threads.for_ranges(families_.blocks.size(), 1, [&](std::uint64_t first_block, std::uint64_t last_block) {
    for (std::uint64_t b = first_block; b < last_block; ++b) {
      const Block& block = families_.blocks[b];
      const auto table = near_table(block, [&](S* row, std::size_t j) { std::copy_n(&before[4 * j], 4, row); });
      for (std::size_t i = block.first; i < block.last; ++i) {
        Sum<S> vx, vy, vz;
        const S* own = &before[4 * i];
        for (std::size_t s = families_.first[i]; s < families_.first[i + 1]; s += width) {
          const auto neighbour = load_neighbours(table.get(), &families_.neighbour[s]);
          const L volume = select(L::load_unaligned(&rest_[s]) > S(0), neighbour.w * volume_[i], L(0));
          vx.add(volume * (neighbour.x - own[0]));
          vy.add(volume * (neighbour.y - own[1]));
          vz.add(volume * (neighbour.z - own[2]));
        }
        const double scale = share * mean_volume_ * mean_volume_ / (true_volume_[i] * full_volume_);
        double* v = &velocity[3 * std::size_t(families_.order[i])];
        v[0] += scale * vx.all();
        v[1] += scale * vy.all();
        v[2] += scale * vz.all();
      }
    }
  });
}

template <class S>
void Bonds<S>::for_shapes(std::span<const double> rest, std::span<const double> position, std::span<const double> velocity,
                          const std::function<void(std::size_t, const ShapeTensor&)>& visit) const {
  for (const Block& block : families_.blocks)
    for (std::size_t i = block.first; i < block.last; ++i) {
      const std::size_t own = families_.order[i];
      ShapeTensor shape;
      for (std::size_t s = families_.first[i]; s < families_.first[i] + families_.count[i]; ++s) {
        const std::size_t other = families_.order[families_.near[block.near_first + families_.neighbour[s] / 2]];
        const double pull = stiffness_[s] * double(stiffness_step_), length = std::abs(double(rest_[s])) * unit_;
        shape.full += pull * length;
        if (!(rest_[s] > 0)) continue;
        const double stiffness = pull / length;
        const Vector xi = difference(&rest[3 * other], &rest[3 * own]),
                     y = difference(&position[3 * other], &position[3 * own]),
                     v = difference(&velocity[3 * other], &velocity[3 * own]);
        for (std::size_t b = 0; b < 3; ++b) {
          const double weighed = stiffness * xi[b];
          for (std::size_t a = 0; a < 3; ++a) {
            shape.rest[a][b] += xi[a] * weighed;
            shape.deformed[a][b] += y[a] * weighed;
            shape.moving[a][b] += v[a] * weighed;
          }
        }
      }
      visit(own, shape);
    }
}

template <class S>
void Bonds<S>::count_damage() {
  for (std::size_t i = 0; i < points(); ++i) {
    std::uint32_t intact = 0;
    const std::size_t first = families_.first[i], count = families_.count[i];
    for (std::size_t s = first; s < first + count; ++s) intact += rest_[s] > 0;
    damage_[i] = count ? S(1) - S(intact) / S(count) : S(0);
  }
}

// ------------------------------------------------------------------------------------------------- checkpoints

template <class S>
void Bonds<S>::save(std::vector<std::byte>& state) const {
  std::vector<std::byte> broken((directed_bonds() + 7) / 8), flows(plastic_stretches() * sizeof(S));
  std::size_t bond = 0;
  for (std::size_t i = 0; i < points(); ++i)
    for (std::size_t s = families_.first[i]; s < families_.first[i] + families_.count[i]; ++s, ++bond) {
      if (rest_[s] < 0) broken[bond / 8] |= std::byte(1u << bond % 8);
      if (!flows.empty()) std::memcpy(&flows[bond * sizeof(S)], &plastic_[s], sizeof(S));
    }
  state.insert(state.end(), broken.begin(), broken.end());
  state.insert(state.end(), flows.begin(), flows.end());
}

template <class S>
void Bonds<S>::restore(std::span<const std::byte> state) {
  const auto flows = state.subspan((directed_bonds() + 7) / 8);
  std::size_t bond = 0;
  for (std::size_t i = 0; i < points(); ++i)
    for (std::size_t s = families_.first[i]; s < families_.first[i] + families_.count[i]; ++s, ++bond) {
      const bool broken = (state[bond / 8] & std::byte(1u << bond % 8)) != std::byte(0);
      rest_[s] = broken ? -std::abs(rest_[s]) : std::abs(rest_[s]);
      if (!flows.empty()) std::memcpy(&plastic_[s], &flows[bond * sizeof(S)], sizeof(S));
    }
  count_damage();
}

}  // namespace

std::unique_ptr<Solid> make_solid(const Material& material, const cleave_body& body) {
  if (material.precision == Precision::single_precision) return std::make_unique<Bonds<float>>(material, body);
  return std::make_unique<Bonds<double>>(material, body);
}

}  // namespace cleave::peridynamics
