#include "scene/flow_field.hpp"

#include "common/error.hpp"

#include <spdlog/fmt/fmt.h>
#include <tbb/parallel_for.h>

#include <Eigen/Eigenvalues>
#include <Eigen/IterativeLinearSolvers>
#include <Eigen/SparseCore>

#include <algorithm>
#include <array>
#include <cmath>
#include <cstdint>
#include <map>

namespace cleave::scene {
namespace {

using Lattice = Eigen::Matrix<std::int64_t, 3, 1>;
constexpr int none = -1;

bool before(const Lattice& a, const Lattice& b) {
  return std::lexicographical_compare(a.data(), a.data() + 3, b.data(), b.data() + 3);
}

/// The cells of a grid that hold a position, and which of them share faces.
class Cells {
 public:
  Cells(const std::vector<Vector3>& positions, double edge, int dimension) : edge_(edge), dimension_(dimension) {
    cells_.reserve(positions.size());
    for (const Vector3& x : positions) cells_.push_back(containing(x));
    std::sort(cells_.begin(), cells_.end(), before);
    count_positions();
    neighbors_.resize(cells_.size());
    for (auto& n : neighbors_) n.fill(none);
    for (int c = 0; c < size(); ++c)
      for (int axis = 0; axis < dimension; ++axis) {
        const int above = find(at(c) + Lattice::Unit(axis));
        if (above == none) continue;
        neighbors_[std::size_t(c)][std::size_t(2 * axis + 1)] = above;
        neighbors_[std::size_t(above)][std::size_t(2 * axis)] = c;
      }
  }

  int size() const { return int(cells_.size()); }
  int dimension() const { return dimension_; }
  const Lattice& at(int cell) const { return cells_[std::size_t(cell)]; }
  /// How many positions a cell holds.
  int count(int cell) const { return counts_[std::size_t(cell)]; }
  /// Cells across the faces, low and high side of each axis; none where there is no cell.
  const std::array<int, 6>& neighbors(int cell) const { return neighbors_[std::size_t(cell)]; }

  Lattice containing(const Vector3& x) const {
    Lattice cell = Lattice::Zero();
    for (int axis = 0; axis < dimension_; ++axis) cell[axis] = std::int64_t(std::floor(x[axis] / edge_));
    return cell;
  }
  Vector3 center(int cell) const {
    Vector3 x = Vector3::Zero();
    for (int axis = 0; axis < dimension_; ++axis) x[axis] = (double(at(cell)[axis]) + 0.5) * edge_;
    return x;
  }
  int find(const Lattice& cell) const {
    const auto found = std::lower_bound(cells_.begin(), cells_.end(), cell, before);
    return found != cells_.end() && *found == cell ? int(found - cells_.begin()) : none;
  }

  /// The cell at an offset of at most one cell along each axis, if faces lead there: not across a gap.
  int reach(int cell, Lattice offset) const {
    if (offset.isZero()) return cell;
    for (int axis = 0; axis < dimension_; ++axis) {
      if (offset[axis] == 0) continue;
      const int next = neighbors(cell)[std::size_t(2 * axis + (offset[axis] > 0 ? 1 : 0))];
      if (next == none) continue;
      Lattice rest = offset;
      rest[axis] = 0;
      if (const int end = reach(next, rest); end != none) return end;
    }
    return none;
  }
  template <class Visit>
  void for_each_around(int cell, const Visit& visit) const {
    const int depth = dimension_ == 3 ? 1 : 0;
    for (int k = -depth; k <= depth; ++k)
      for (int j = -1; j <= 1; ++j)
        for (int i = -1; i <= 1; ++i) {
          const Lattice offset(i, j, k);
          if (offset.isZero()) continue;
          if (const int other = reach(cell, offset); other != none) visit(other, Vector3(i, j, k));
        }
  }

 private:
  /// Makes the sorted cells unique, with `counts_` how often each was there.
  void count_positions() {
    std::size_t end = 0;
    for (const Lattice& cell : cells_) {
      if (end > 0 && cells_[end - 1] == cell) {
        ++counts_.back();
        continue;
      }
      cells_[end++] = cell;
      counts_.push_back(1);
    }
    cells_.resize(end);
  }

  double edge_;
  int dimension_;
  std::vector<Lattice> cells_;
  std::vector<int> counts_;
  std::vector<std::array<int, 6>> neighbors_;
};

/// What the positions tell of the shape of the body inside its cells.
struct Filling {
  std::vector<double> volume;               ///< part of each cell the body fills, in (0, 1]
  std::vector<std::array<double, 6>> area;  ///< part of each face the body fills, in the order of Cells::neighbors
};

/// Number of positions in a cell the body fills: the mean of the cells with neighbours all around, else the most there are.
double positions_per_cell(const Cells& cells) {
  const int all_around = cells.dimension() == 3 ? 26 : 8;
  double sum = 0, full = 0, most = 0;
  for (int c = 0; c < cells.size(); ++c) {
    int around = 0;
    cells.for_each_around(c, [&](int, const Vector3&) { ++around; });
    most = std::max(most, double(cells.count(c)));
    if (around < all_around) continue;
    sum += cells.count(c);
    ++full;
  }
  return full > 0 ? sum / full : most;
}

/// Signed distance of a node to a plane surface, in cells and negative outside, from the density there: positions weighted with
/// the linear kernel N give, at distance d inside a half-space of density 1, 1/2 + d - d^2/2, and likewise outside.
double depth(double density) {
  const double beyond = std::clamp(density - 0.5, -0.5, 0.5);
  return std::copysign(1 - std::sqrt(1 - 2 * std::abs(beyond)), beyond);
}

/// Part of a line on which a function that is linear between its ends is positive.
double positive_part(double a, double b) {
  if (a > 0 && b > 0) return 1;
  if (a <= 0 && b <= 0) return 0;
  return std::max(a, b) / std::abs(a - b);
}

Filling measure_filling(const Cells& cells, const std::vector<Vector3>& positions, double edge) {
  // Share of each corner in the positions of a cell, in whole units so that their order does not matter.
  constexpr double unit = 0x1p-32;
  std::vector<std::array<std::int64_t, 8>> shares(std::size_t(cells.size()), std::array<std::int64_t, 8>{});
  for (const Vector3& x : positions) {
    const int c = cells.find(cells.containing(x));
    const Vector3 within = (x - cells.center(c)) / edge;
    for (int corner = 0; corner < 1 << cells.dimension(); ++corner) {
      double weight = 1;
      for (int axis = 0; axis < cells.dimension(); ++axis) weight *= 0.5 + (corner >> axis & 1 ? within[axis] : -within[axis]);
      shares[std::size_t(c)][std::size_t(corner)] += std::int64_t(weight / unit);
    }
  }

  Filling filling;
  filling.volume.resize(shares.size());
  filling.area.resize(shares.size());
  const double full = positions_per_cell(cells);
  const int corners = 1 << cells.dimension();
  for (int c = 0; c < cells.size(); ++c) {
    filling.volume[std::size_t(c)] = std::min(1.0, cells.count(c) / full);
    double density[8] = {};
    const auto add = [&](int other, const Vector3& offset) {
      for (int corner = 0; corner < corners; ++corner) {
        int seen_from_there = 0;
        bool shared = true;
        for (int axis = 0; axis < cells.dimension(); ++axis) {
          const int place = (corner >> axis & 1) - int(offset[axis]);
          shared = shared && (place == 0 || place == 1);
          seen_from_there |= (place & 1) << axis;
        }
        if (shared) density[corner] += unit * double(shares[std::size_t(other)][std::size_t(seen_from_there)]) / full;
      }
    };
    add(c, Vector3::Zero());
    cells.for_each_around(c, add);
    for (int axis = 0; axis < cells.dimension(); ++axis) {
      const int above = cells.neighbors(c)[std::size_t(2 * axis + 1)];
      if (above == none) continue;
      double d[4] = {};
      for (int corner = 0, n = 0; corner < corners; ++corner)
        if (corner >> axis & 1) d[n++] = depth(density[corner]);
      double area = 0;
      if (cells.dimension() == 2) {
        area = positive_part(d[0], d[1]);
      } else {
        constexpr int lines = 8;
        for (int line = 0; line < lines; ++line) {
          const double t = (line + 0.5) / lines;
          area += positive_part(d[0] + t * (d[2] - d[0]), d[1] + t * (d[3] - d[1])) / lines;
        }
      }
      // Thinner than its cells can show, the body still conducts.
      constexpr double least_area = 1e-3;
      area = std::max(area, least_area);
      filling.area[std::size_t(c)][std::size_t(2 * axis + 1)] = area;
      filling.area[std::size_t(above)][std::size_t(2 * axis)] = area;
    }
  }
  return filling;
}

enum class Role : std::uint8_t { free, inflow, outflow };

/// Where the potential is given.
struct Regions {
  const SignedDistance& inflow;
  const SignedDistance& outflow;
  std::vector<Role> roles;  ///< of each cell

  Role role(int cell) const { return roles[std::size_t(cell)]; }
  /// How far from the centre of a free cell the region of another is, as a part of the way to the centre of that one.
  double entry(const Cells& cells, int free, int other) const {
    const SignedDistance& region = role(other) == Role::inflow ? inflow : outflow;
    const double outside = region.distance(cells.center(free)), inside = region.distance(cells.center(other));
    constexpr double nearest = 1e-3;  // keeps the equations well conditioned
    return std::max(nearest, outside / (outside - inside));
  }
};

std::vector<Role> assign_roles(const Cells& cells, const SignedDistance& inflow, const SignedDistance& outflow) {
  std::vector<Role> roles(std::size_t(cells.size()), Role::free);
  int in = 0, out = 0, both = 0;
  for (int c = 0; c < cells.size(); ++c) {
    const Vector3 x = cells.center(c);
    const bool is_in = inflow.distance(x) <= 0, is_out = outflow.distance(x) <= 0;
    in += is_in;
    out += is_out;
    both += is_in && is_out;
    if (is_in || is_out) roles[std::size_t(c)] = is_in ? Role::inflow : Role::outflow;
  }
  const auto of_the_body = fmt::format("the {} cells of the body", cells.size());
  if (in == 0 || out == 0)
    throw InputError(
        fmt::format("the '{}' of the fibers holds the centre of none of {}; make it larger or move it into the body",
                    in == 0 ? "inflow" : "outflow", of_the_body));
  if (both > 0)
    throw InputError(fmt::format("'inflow' and 'outflow' of the fibers share {} of {}; move them apart", both, of_the_body));
  return roles;
}

/// Connected parts of the body, as the number of the part of each cell.
std::vector<int> connected_parts(const Cells& cells, int& count) {
  std::vector<int> part(std::size_t(cells.size()), none), open;
  count = 0;
  for (int start = 0; start < cells.size(); ++start) {
    if (part[std::size_t(start)] != none) continue;
    part[std::size_t(start)] = count;
    open.assign(1, start);
    while (!open.empty()) {
      const int c = open.back();
      open.pop_back();
      for (const int n : cells.neighbors(c))
        if (n != none && part[std::size_t(n)] == none) {
          part[std::size_t(n)] = count;
          open.push_back(n);
        }
    }
    ++count;
  }
  return part;
}

/// Part of the cells that may lie apart, as single particles do at thin edges and tips, without a body being in pieces.
constexpr double stray_part = 0.01;

/// Cells of parts that do not reach both regions, in which nothing flows. Throws where that is more than a few strays.
std::vector<bool> stray_cells(const Cells& cells, const std::vector<Role>& roles) {
  int count = 0;
  const auto part = connected_parts(cells, count);
  std::vector<std::array<int, 3>> of_role(std::size_t(count), {0, 0, 0});
  for (std::size_t c = 0; c < part.size(); ++c) ++of_role[std::size_t(part[c])][std::size_t(roles[c])];
  int apart = 0, through = 0, in = 0, out = 0;
  for (const auto& [free, inflow, outflow] : of_role) {
    in += inflow;
    out += outflow;
    if (inflow > 0 && outflow > 0)
      ++through;
    else
      apart += free + inflow + outflow;
  }
  if (through == 0)
    throw InputError(fmt::format(
        "the body does not connect 'inflow' ({} cells) and 'outflow' ({} cells) of the fibers: its {} cells are in {} parts, "
        "none of which reaches both",
        in, out, cells.size(), count));
  if (apart > stray_part * cells.size())
    throw InputError(
        fmt::format("{} of the {} cells of the body are not connected to the part between 'inflow' and 'outflow' of the "
                    "fibers: the body is "
                    "in {} parts, {} of which reach both; make each part a body of its own",
                    apart, cells.size(), count, through));
  std::vector<bool> stray(part.size());
  for (std::size_t c = 0; c < part.size(); ++c) {
    const auto& [free, inflow, outflow] = of_role[std::size_t(part[c])];
    stray[c] = inflow == 0 || outflow == 0;
  }
  return stray;
}

/// phi in every cell. One equation for each free cell: the fluxes through the filled parts of its faces cancel (Ng, Min and
/// Gibou 2009: walls at any angle leave a linear phi exact). A region is met where its surface is (Gibou et al. 2002).
std::vector<double> solve_potential(const Cells& cells, const Regions& regions, const Filling& filling) {
  const auto& roles = regions.roles;
  std::vector<int> unknown(roles.size(), none);
  int unknowns = 0;
  for (std::size_t c = 0; c < roles.size(); ++c)
    if (roles[c] == Role::free) unknown[c] = unknowns++;
  std::vector<double> phi(roles.size(), 0);
  for (std::size_t c = 0; c < roles.size(); ++c) phi[c] = roles[c] == Role::inflow ? 1 : 0;
  if (unknowns == 0) return phi;

  std::vector<Eigen::Triplet<double>> entries;
  Eigen::VectorXd source = Eigen::VectorXd::Zero(unknowns);
  for (int c = 0; c < cells.size(); ++c) {
    const int row = unknown[std::size_t(c)];
    if (row == none) continue;
    double total = 0;
    for (std::size_t face = 0; face < 6; ++face) {
      const int n = cells.neighbors(c)[face];
      if (n == none) continue;
      const double area = filling.area[std::size_t(c)][face];
      if (unknown[std::size_t(n)] != none) {
        total += area;
        entries.emplace_back(row, unknown[std::size_t(n)], -area);
      } else {
        const double near = area / regions.entry(cells, c, n);
        total += near;
        source[row] += near * phi[std::size_t(n)];
      }
    }
    entries.emplace_back(row, row, total);
  }
  Eigen::SparseMatrix<double> laplacian(unknowns, unknowns);
  laplacian.setFromTriplets(entries.begin(), entries.end());
  Eigen::ConjugateGradient<Eigen::SparseMatrix<double>, Eigen::Lower | Eigen::Upper, Eigen::IncompleteCholesky<double>> solver;
  // Directions are wanted in dead ends too, where the gradient is a small fraction of that of the main flow.
  constexpr double tolerance = 1e-12;
  solver.setTolerance(tolerance);
  solver.setMaxIterations(std::max(1000, 20 * int(std::cbrt(unknowns))));
  solver.compute(laplacian);
  const Eigen::VectorXd solution = solver.solve(source);
  if (!(solver.error() < 1e-8))
    throw InputError(fmt::format("the flow of the fibers did not converge: residual {:.3g} after {} iterations over {} cells",
                                 solver.error(), solver.iterations(), unknowns));
  for (std::size_t c = 0; c < roles.size(); ++c)
    if (unknown[c] != none) phi[c] = solution[unknown[c]];
  return phi;
}

/// Gradient of phi per cell of a free cell: the linear function that fits the cells around best, weighted with
/// volume/distance^2.
Vector3 gradient(const Cells& cells, const std::vector<double>& phi, const Regions& regions, const Filling& filling, int cell) {
  Matrix3 moments = Matrix3::Zero();
  Vector3 differences = Vector3::Zero();
  cells.for_each_around(cell, [&](int other, const Vector3& to_center) {
    const Vector3 offset =
        regions.role(other) == Role::free ? to_center : Vector3(regions.entry(cells, cell, other) * to_center);
    const double weight = filling.volume[std::size_t(other)] / to_center.squaredNorm();
    moments += weight * offset * offset.transpose();
    differences += weight * (phi[std::size_t(other)] - phi[std::size_t(cell)]) * offset;
  });
  // A body one cell thick says nothing of the gradient across.
  const Eigen::SelfAdjointEigenSolver<Matrix3> axes(moments);
  Vector3 result = Vector3::Zero();
  for (int i = 0; i < 3; ++i)
    if (axes.eigenvalues()[i] > 1e-6 * axes.eigenvalues()[2])
      result += axes.eigenvectors().col(i).dot(differences) / axes.eigenvalues()[i] * axes.eigenvectors().col(i);
  return result;
}

/// Gives the cells without a direction the mean of those around them, layer by layer. All of a part of the body without any
/// direction means that its regions touch.
void carry_on(const Cells& cells, std::vector<Vector3>& directions) {
  std::vector<int> open;
  for (int c = 0; c < cells.size(); ++c)
    if (directions[std::size_t(c)].isZero(0)) open.push_back(c);
  while (!open.empty()) {
    std::vector<std::pair<int, Vector3>> reached;
    std::vector<int> left;
    for (const int c : open) {
      Vector3 sum = Vector3::Zero(), any = Vector3::Zero();
      cells.for_each_around(c, [&](int other, const Vector3&) {
        const Vector3& d = directions[std::size_t(other)];
        sum += d;
        if (!d.isZero(0)) any = d;
      });
      if (any.isZero(0))
        left.push_back(c);
      else
        reached.emplace_back(c, sum.norm() > 1e-6 ? Vector3(sum.normalized()) : any);
    }
    if (reached.empty())
      throw InputError(
          fmt::format("'inflow' and 'outflow' of the fibers leave no room for a flow between them in {} of the {} cells of the "
                      "body; move them apart",
                      left.size(), cells.size()));
    for (const auto& [c, direction] : reached) directions[std::size_t(c)] = direction;
    open = std::move(left);
  }
}

std::vector<Vector3> cell_directions(const Cells& cells, const Regions& regions, const Filling& filling) {
  const auto phi = solve_potential(cells, regions, filling);
  std::vector<Vector3> gradients(std::size_t(cells.size()), Vector3::Zero());
  tbb::parallel_for(0, cells.size(), [&](int c) {
    if (regions.role(c) == Role::free) gradients[std::size_t(c)] = gradient(cells, phi, regions, filling, c);
  });
  double largest = 0;
  for (const Vector3& g : gradients) largest = std::max(largest, g.norm());
  // Below this share of the fastest flow the gradient is no more than what the solver leaves.
  constexpr double slowest = 1e-6;
  for (Vector3& g : gradients) g = g.norm() > slowest * largest ? Vector3(-g.normalized()) : Vector3(Vector3::Zero());
  // Cells that the surface cuts know their own gradient badly: each takes the mean around it, weighted with volume.
  std::vector<Vector3> directions(gradients.size(), Vector3::Zero());
  tbb::parallel_for(0, cells.size(), [&](int c) {
    if (gradients[std::size_t(c)].isZero(0)) return;
    Vector3 sum = filling.volume[std::size_t(c)] * gradients[std::size_t(c)];
    cells.for_each_around(c, [&](int other, const Vector3& offset) {
      sum += filling.volume[std::size_t(other)] / (1 + offset.squaredNorm()) * gradients[std::size_t(other)];
    });
    directions[std::size_t(c)] = sum.norm() > 1e-6 ? Vector3(sum.normalized()) : gradients[std::size_t(c)];
  });
  return directions;
}

/// The mean of the directions of the cells around x, weighted as in trilinear interpolation.
Vector3 interpolate(const Cells& cells, const std::vector<Vector3>& directions, const Vector3& x, double edge) {
  const int home = cells.find(cells.containing(x));
  const Vector3 within = (x - cells.center(home)) / edge;
  Vector3 sum = directions[std::size_t(home)];
  for (int axis = 0; axis < cells.dimension(); ++axis) sum *= 1 - std::abs(within[axis]);
  cells.for_each_around(home, [&](int other, const Vector3& offset) {
    double weight = 1;
    for (int axis = 0; axis < cells.dimension(); ++axis)
      weight *= std::max(0.0, offset[axis] == 0 ? 1 - std::abs(within[axis]) : offset[axis] * within[axis]);
    sum += weight * directions[std::size_t(other)];
  });
  return sum.norm() > 1e-6 ? Vector3(sum.normalized()) : directions[std::size_t(home)];
}

/// Directions of the positions that are connected, and of the nearest of them for those in stray cells.
template <class Directions>
std::vector<Vector3> around_strays(const Cells& cells, const std::vector<bool>& stray, const std::vector<Vector3>& positions,
                                   const Directions& directions) {
  std::vector<Vector3> connected;
  std::vector<std::size_t> index;
  for (std::size_t i = 0; i < positions.size(); ++i)
    if (!stray[std::size_t(cells.find(cells.containing(positions[i])))]) {
      connected.push_back(positions[i]);
      index.push_back(i);
    }
  const auto found = directions(connected);
  std::vector<Vector3> field(positions.size(), Vector3::Zero());
  for (std::size_t k = 0; k < index.size(); ++k) field[index[k]] = found[k];
  std::map<int, Vector3> of_cell;
  for (std::size_t i = 0; i < positions.size(); ++i) {
    if (!field[i].isZero(0)) continue;
    const auto [entry, first] = of_cell.try_emplace(cells.find(cells.containing(positions[i])));
    if (first) {
      std::size_t nearest = 0;
      for (std::size_t k = 1; k < connected.size(); ++k)
        if ((connected[k] - positions[i]).squaredNorm() < (connected[nearest] - positions[i]).squaredNorm()) nearest = k;
      entry->second = found[nearest];
    }
    field[i] = entry->second;
  }
  return field;
}

}  // namespace

std::vector<Vector3> flow_directions(const SignedDistance& inflow, const SignedDistance& outflow,
                                     const std::vector<Vector3>& positions, double cell_size, int dimension) {
  const Cells cells(positions, cell_size, dimension);
  const Regions regions{inflow, outflow, assign_roles(cells, inflow, outflow)};
  const auto stray = stray_cells(cells, regions.roles);
  if (std::find(stray.begin(), stray.end(), true) != stray.end())
    return around_strays(cells, stray, positions, [&](const std::vector<Vector3>& connected) {
      return flow_directions(inflow, outflow, connected, cell_size, dimension);
    });
  auto directions = cell_directions(cells, regions, measure_filling(cells, positions, cell_size));
  carry_on(cells, directions);
  std::vector<Vector3> field(positions.size());
  tbb::parallel_for(std::size_t{0}, positions.size(),
                    [&](std::size_t i) { field[i] = interpolate(cells, directions, positions[i], cell_size); });
  return field;
}

}  // namespace cleave::scene
