#include "scene/lattice_tetrahedra.hpp"

#include "common/error.hpp"

#include <spdlog/fmt/fmt.h>
#include <tbb/parallel_for.h>

#include <algorithm>
#include <cmath>
#include <optional>
#include <unordered_map>

namespace cleave::scene {
namespace {

using Node = std::uint64_t;

/// A point of the lattice: the cube vertex (i,j,k), or the centre of the cube that begins there.
struct Place {
  std::array<int, 3> at;
  bool centre;
};

/// A vertex of the mesh: a node of the lattice (second == first), or the cut of the edge between an inner and an outer node.
struct Vertex {
  Node first, second;
  bool operator==(const Vertex&) const = default;
};

struct VertexHash {
  std::size_t operator()(const Vertex& v) const {
    return std::size_t((v.first * 0x9e3779b97f4a7c15u) ^ ((v.second + 0x7f4a7c15u) * 0xc2b2ae3d27d4eb4fu));
  }
};

/// Nearer to a node than this fraction of the edge, a cut is taken into the node.
constexpr double nearest_on_long_edge = 0.24999, nearest_on_short_edge = 0.41189;
constexpr double most_cubes = 3e7;

class Stuffing {
 public:
  Stuffing(const SignedDistance& shape, double edge_length) : shape_(shape), box_(shape.bounds()) {
    double cubes = 1;
    for (int a = 0; a < 3; a++) {
      const double number = std::max(1.0, std::round(box_.sizes()[a] / edge_length));
      cubes *= number + 2;
      if (!(cubes <= most_cubes))
        throw InputError(
            fmt::format("edges of {:.4g} m are too short for a shape {:.4g} x {:.4g} x {:.4g} m; they would divide its "
                        "bounding box into more than {:g} cubes",
                        edge_length, box_.sizes()[0], box_.sizes()[1], box_.sizes()[2], most_cubes));
      count_[std::size_t(a)] = int(number);
      edge_[a] = box_.sizes()[a] / number;
    }
    corners_ = Node(count_[0] + 1) * Node(count_[1] + 1) * Node(count_[2] + 1);
    nodes_ = corners_ + Node(count_[0] + 2) * Node(count_[1] + 2) * Node(count_[2] + 2);
  }

  TetrahedralMesh mesh() {
    find_sides();
    warp();
    for (int axis = 0; axis < 3; axis++) cut_tetrahedra_along(axis);
    return std::move(mesh_);
  }

 private:
  // The lattice. Cube vertices are numbered from 0 to count, centres from -1 (outside of the bounding box) to count.

  Node number(const Place& p) const {
    const auto [i, j, k] = p.at;
    if (!p.centre) return (Node(k) * Node(count_[1] + 1) + Node(j)) * Node(count_[0] + 1) + Node(i);
    return corners_ + (Node(k + 1) * Node(count_[1] + 2) + Node(j + 1)) * Node(count_[0] + 2) + Node(i + 1);
  }

  Place place(Node node) const {
    const bool centre = node >= corners_;
    const int begin = centre ? -1 : 0, extent = centre ? 2 : 1;
    if (centre) node -= corners_;
    Place p{{}, centre};
    for (std::size_t a = 0; a < 3; a++) {
      const Node n = Node(count_[a] + extent);
      p.at[a] = int(node % n) + begin;
      node /= n;
    }
    return p;
  }

  bool exists(const Place& p) const {
    for (std::size_t a = 0; a < 3; a++)
      if (p.at[a] < (p.centre ? -1 : 0) || p.at[a] > count_[a]) return false;
    return true;
  }

  Vector3 position(const Place& p) const {
    Vector3 x;
    for (int a = 0; a < 3; a++) {
      const double cubes = p.at[std::size_t(a)] + (p.centre ? 0.5 : 0.0);
      // the last plane is the bounding box's to the bit
      x[a] = cubes == count_[std::size_t(a)] ? box_.max()[a] : box_.min()[a] + cubes * edge_[a];
    }
    return x;
  }

  /// Where a node has come to lie.
  Vector3 position(Node node) const {
    const auto warped = warped_.find(node);
    return warped != warped_.end() ? warped->second : position(place(node));
  }

  template <class Visit>
  void for_each_neighbour(const Place& p, const Visit& visit) const {
    for (std::size_t a = 0; a < 3; a++)
      for (const int step : {-1, 1}) {
        Place neighbour = p;
        neighbour.at[a] += step;
        if (exists(neighbour)) visit(number(neighbour), nearest_on_long_edge);
      }
    for (int corner = 0; corner < 8; corner++) {
      Place neighbour{p.at, !p.centre};
      for (std::size_t a = 0; a < 3; a++) neighbour.at[a] += (corner >> a & 1) - (p.centre ? 0 : 1);
      if (exists(neighbour)) visit(number(neighbour), nearest_on_short_edge);
    }
  }

  /// 1 inside, -1 outside, 0 on the surface.
  void find_sides() {
    side_.resize(nodes_);
    const double on_surface = 1e-7 * edge_.minCoeff();
    constexpr Node chunk = 4096;
    tbb::parallel_for(Node(0), (nodes_ + chunk - 1) / chunk, [&](Node c) {
      for (Node node = c * chunk; node < std::min(nodes_, (c + 1) * chunk); node++) {
        const Vector3 x = position(place(node));
        const double distance = box_.contains(x) ? shape_.distance(x) : box_.exteriorDistance(x);
        side_[node] = std::abs(distance) <= on_surface ? std::int8_t(0) : distance < 0 ? std::int8_t(1) : std::int8_t(-1);
      }
    });
  }

  /// The point of the surface between an inner and an outer node: regula falsi that halves the weight of an end it does not
  /// move (Illinois), within a bracket.
  Vector3 cut(Node a, Node b) {
    const Vertex edge{std::min(a, b), std::max(a, b)};
    const auto [found, is_new] = cuts_.try_emplace(edge);
    if (!is_new) return found->second;
    const Vector3 begin = position(place(edge.first)), end = position(place(edge.second));
    double low = 0, high = 1, at_low = shape_.distance(begin), at_high = shape_.distance(end), t = 0.5;
    const double resolved = 1e-9 * edge_.minCoeff();
    int last = 0;
    for (int i = 0; i < 60 && high - low > 1e-10; i++) {
      t = i < 40 ? (low * at_high - high * at_low) / (at_high - at_low) : (low + high) / 2;
      const double value = shape_.distance(begin + t * (end - begin));
      if (std::abs(value) <= resolved) break;
      const bool moves_low = (value < 0) == (at_low < 0);
      (moves_low ? low : high) = t;
      (moves_low ? at_low : at_high) = value;
      if (last == (moves_low ? 1 : -1)) (moves_low ? at_high : at_low) /= 2;
      last = moves_low ? 1 : -1;
    }
    found->second = begin + t * (end - begin);
    return found->second;
  }

  /// Takes nodes that a cut comes too near to onto the surface, so that no tetrahedron gets thin.
  void warp() {
    for (Node node = 0; node < nodes_; node++) {
      if (side_[node] == 0) continue;
      const Place p = place(node);
      const Vector3 x = position(p);
      double nearest = 1;
      Vector3 target;
      for_each_neighbour(p, [&](Node neighbour, double limit) {
        if (side_[neighbour] * side_[node] >= 0) return;
        const Vector3 c = cut(node, neighbour);
        const double fraction = (c - x).norm() / (position(place(neighbour)) - x).norm();
        if (fraction >= limit || fraction >= nearest) return;
        nearest = fraction;
        target = c;
      });
      if (nearest == 1) continue;
      side_[node] = 0;
      warped_.emplace(node, target);
    }
  }

  /// The tetrahedra about the edges between centres that are neighbours along an axis: each such edge, with each edge of the
  /// face that the two cubes share.
  void cut_tetrahedra_along(int axis) {
    const std::size_t a = std::size_t(axis), b = (a + 1) % 3, c = (a + 2) % 3;
    for (int k = c == 2 || b == 2 ? 0 : -1; k < count_[2]; k++)
      for (int j = c == 1 || b == 1 ? 0 : -1; j < count_[1]; j++)
        for (int i = c == 0 || b == 0 ? 0 : -1; i < count_[0]; i++) {
          const Place low{{i, j, k}, true};
          Place high = low;
          high.at[a]++;
          const Node below = number(low), above = number(high);
          std::array<Node, 4> face;
          for (std::size_t corner = 0; corner < 4; corner++) {
            Place p{high.at, false};
            p.at[b] += corner == 1 || corner == 2;
            p.at[c] += corner >= 2;
            face[corner] = number(p);
          }
          // the two centres, and the two corners: long edges; the other four are short
          for (std::size_t corner = 0; corner < 4; corner++)
            cut_tetrahedron({below, above, face[corner], face[(corner + 1) % 4]});
        }
  }

  static bool is_long(std::size_t i, std::size_t j) { return (i < 2) == (j < 2); }

  void cut_tetrahedron(const std::array<Node, 4>& nodes) {
    if (std::none_of(nodes.begin(), nodes.end(), [&](Node n) { return side_[n] > 0; })) return;
    std::vector<std::size_t> inner, outer, on;
    for (std::size_t i = 0; i < 4; i++) (side_[nodes[i]] > 0 ? inner : side_[nodes[i]] < 0 ? outer : on).push_back(i);
    const auto node = [&](std::size_t i) { return Vertex{nodes[i], nodes[i]}; };
    const auto cut_of = [&](std::size_t i, std::size_t o) {
      return Vertex{std::min(nodes[i], nodes[o]), std::max(nodes[i], nodes[o])};
    };
    // A quadrilateral between two inner nodes and their cuts towards an outer one: which of the nodes its diagonal starts
    // from. Tetrahedra on both sides of the face decide alike, as it depends on the face alone.
    const auto starts_at_first = [&](std::size_t i, std::size_t j, std::size_t o) {
      if (is_long(i, o) != is_long(j, o)) return is_long(j, o);  // to the cut of the long edge
      const Vector3 one = position(nodes[i]) - cut(nodes[j], nodes[o]), other = position(nodes[j]) - cut(nodes[i], nodes[o]);
      const double difference = one.norm() - other.norm();
      return std::abs(difference) > 1e-9 * edge_.minCoeff() ? difference < 0 : nodes[i] < nodes[j];
    };
    if (outer.empty()) {
      add({node(0), node(1), node(2), node(3)});
    } else if (inner.size() == 1) {
      std::array<Vertex, 4> corners{node(inner[0])};
      std::size_t n = 1;
      for (const std::size_t o : outer) corners[n++] = cut_of(inner[0], o);
      for (const std::size_t z : on) corners[n++] = node(z);
      add(corners);
    } else if (inner.size() == 2 && outer.size() == 1) {
      const auto [i, j] = std::pair{inner[0], inner[1]};
      const Vertex ci = cut_of(i, outer[0]), cj = cut_of(j, outer[0]), apex = node(on[0]);
      const bool first = starts_at_first(i, j, outer[0]);
      add({node(i), node(j), first ? cj : ci, apex});
      add({first ? node(i) : node(j), ci, cj, apex});
    } else if (inner.size() == 2) {
      const auto [i, j] = std::pair{inner[0], inner[1]};
      const auto [o, p] = std::pair{outer[0], outer[1]};
      add_prism({node(i), cut_of(i, o), cut_of(i, p)}, {node(j), cut_of(j, o), cut_of(j, p)},
                {starts_at_first(i, j, o), std::nullopt, !starts_at_first(i, j, p)});
    } else {
      const std::size_t o = outer[0];
      add_prism({node(inner[0]), node(inner[1]), node(inner[2])},
                {cut_of(inner[0], o), cut_of(inner[1], o), cut_of(inner[2], o)},
                {starts_at_first(inner[0], inner[1], o), starts_at_first(inner[1], inner[2], o),
                 starts_at_first(inner[2], inner[0], o)});
    }
  }

  /// A prism between two triangles whose corners belong together. `diagonals[i]`: whether the diagonal of the side between
  /// edges i and i+1 starts at corner i of the bottom (and ends at i+1 of the top), or the other way round; the inner side,
  /// which no neighbour shares, may take either. They never go round in a circle, so that a corner with two of them exists,
  /// and the prism is the fan from there.
  void add_prism(const std::array<Vertex, 3>& bottom, const std::array<Vertex, 3>& top,
                 std::array<std::optional<bool>, 3> diagonals) {
    if (!diagonals[1]) diagonals[1] = !(*diagonals[0]);
    for (std::size_t i = 0; i < 3; i++) {
      const std::size_t next = (i + 1) % 3, last = (i + 2) % 3;
      const bool at_bottom = *diagonals[i] && !*diagonals[last];  // both sides' diagonals at bottom i
      const bool at_top = !*diagonals[i] && *diagonals[last];
      if (!at_bottom && !at_top) continue;
      const auto& [here, there] = at_bottom ? std::pair{bottom, top} : std::pair{top, bottom};
      add({here[i], there[0], there[1], there[2]});
      // the side opposite, between corners next and last; its diagonal starts at `next` of the bottom if so said
      const bool from_here = *diagonals[next] == at_bottom;
      add({here[i], here[next], here[last], from_here ? there[last] : there[next]});
      add({here[i], from_here ? here[next] : here[last], there[next], there[last]});
      return;
    }
  }

  std::uint32_t index(const Vertex& v) {
    const auto [found, is_new] = index_.try_emplace(v, std::uint32_t(mesh_.vertices.size()));
    if (is_new) mesh_.vertices.push_back(v.first == v.second ? position(v.first) : cut(v.first, v.second));
    return found->second;
  }

  /// Which way round the corners go is that of the lattice, which warping does not change.
  void add(const std::array<Vertex, 4>& corners) {
    std::array<Vector3, 4> x;
    std::array<std::uint32_t, 4> vertices;
    for (std::size_t i = 0; i < 4; i++) {
      const auto& [first, second] = corners[i];
      x[i] = first == second ? position(place(first)) : cut(first, second);
      vertices[i] = index(corners[i]);
    }
    if ((x[1] - x[0]).dot((x[2] - x[0]).cross(x[3] - x[0])) < 0) std::swap(vertices[2], vertices[3]);
    mesh_.tetrahedra.push_back(vertices);
  }

  const SignedDistance& shape_;
  Box box_;
  std::array<int, 3> count_{};
  Vector3 edge_;
  Node corners_ = 0, nodes_ = 0;
  std::vector<std::int8_t> side_;
  std::unordered_map<Node, Vector3> warped_;
  std::unordered_map<Vertex, Vector3, VertexHash> cuts_;
  std::unordered_map<Vertex, std::uint32_t, VertexHash> index_;
  TetrahedralMesh mesh_;
};

}  // namespace

TetrahedralMesh lattice_tetrahedra(const SignedDistance& shape, double edge_length) {
  const Box bounds = shape.bounds();
  if (bounds.isEmpty()) throw InputError("the shape is empty: its parts have nothing in common");
  if (!bounds.sizes().allFinite())
    throw InputError("the shape is unbounded and cannot be cut into tetrahedra; intersect it with a box");
  TetrahedralMesh mesh = Stuffing(shape, edge_length).mesh();
  if (mesh.tetrahedra.empty())
    throw InputError(
        fmt::format("no tetrahedron lies inside the shape, which is {:.4g} x {:.4g} x {:.4g} m; give edges shorter than "
                    "{:.4g} m",
                    bounds.sizes()[0], bounds.sizes()[1], bounds.sizes()[2], edge_length));
  separate_touching_parts(mesh);
  return mesh;
}

}  // namespace cleave::scene
