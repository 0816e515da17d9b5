#include "embedded_mesh.hpp"

#include "shape_tensor.hpp"

#include <algorithm>
#include <numeric>
#include <stdexcept>
#include <string>

namespace cleave::peridynamics {
namespace {

/// Sets that are united, each known by its least member.
class DisjointSets {
 public:
  explicit DisjointSets(std::size_t size) : parent_(size) { std::iota(parent_.begin(), parent_.end(), 0u); }
  std::uint32_t find(std::uint32_t i) {
    while (parent_[i] != i) i = parent_[i] = parent_[parent_[i]];
    return i;
  }
  void unite(std::uint32_t a, std::uint32_t b) {
    a = find(a);
    b = find(b);
    parent_[std::max(a, b)] = std::min(a, b);
  }

 private:
  std::vector<std::uint32_t> parent_;
};

constexpr std::uint32_t none = 0xffffffff;

}  // namespace

EmbeddedMesh::EmbeddedMesh(const cleave_body& body)
    : rest_(body.vertices, body.vertices + 3 * body.vertex_count),
      tetrahedra_(body.tetrahedra, body.tetrahedra + 4 * body.tetrahedron_count),
      left_handed_(body.tetrahedron_count) {
  const auto count = std::uint32_t(body.tetrahedron_count);
  if (body.tetrahedron_count != body.point_count || body.tetrahedron_count > none / 4)
    throw std::runtime_error(std::to_string(body.tetrahedron_count) + " tetrahedra for " + std::to_string(body.point_count) +
                             " points; there has to be one point in each, of at most 2^30");
  struct Key {
    Corners vertices;
    std::uint32_t tetrahedron;
    std::uint8_t across;
    auto operator<=>(const Key&) const = default;
  };
  std::vector<Key> keys;
  keys.reserve(4 * std::size_t(count));
  for (std::uint32_t t = 0; t < count; ++t) {
    const std::uint32_t* v = &tetrahedra_[4 * std::size_t(t)];
    for (int a = 0; a < 4; ++a)
      if (v[a] >= body.vertex_count)
        throw std::runtime_error("tetrahedron " + std::to_string(t) + " has vertex " + std::to_string(v[a]) + " of " +
                                 std::to_string(body.vertex_count));
    double e[3][3];
    for (std::size_t a = 0; a < 3; ++a)
      for (std::size_t c = 0; c < 3; ++c) e[a][c] = rest_[3 * std::size_t(v[a + 1]) + c] - rest_[3 * std::size_t(v[0]) + c];
    left_handed_[t] = e[0][0] * (e[1][1] * e[2][2] - e[1][2] * e[2][1]) + e[0][1] * (e[1][2] * e[2][0] - e[1][0] * e[2][2]) +
                          e[0][2] * (e[1][0] * e[2][1] - e[1][1] * e[2][0]) <
                      0;
    for (std::uint8_t across = 0; across < 4; ++across) {
      Corners face{};
      for (std::size_t a = 0, n = 0; a < 4; ++a)
        if (a != across) face[n++] = v[a];
      std::sort(face.begin(), face.end());
      keys.push_back({face, t, across});
    }
  }
  std::sort(keys.begin(), keys.end());
  for (std::size_t k = 0; k < keys.size(); ++k) {
    const bool shared = k + 1 < keys.size() && keys[k + 1].vertices == keys[k].vertices;
    if (shared && k + 2 < keys.size() && keys[k + 2].vertices == keys[k].vertices)
      throw std::runtime_error("tetrahedra " + std::to_string(keys[k].tetrahedron) + ", " +
                               std::to_string(keys[k + 1].tetrahedron) + " and " + std::to_string(keys[k + 2].tetrahedron) +
                               " share a face; a face has two sides");
    const Key& other = keys[shared ? k + 1 : k];
    faces_.push_back({{keys[k].tetrahedron, other.tetrahedron}, {keys[k].across, other.across}, shared});
    k += shared;
  }
  std::sort(faces_.begin(), faces_.end(), [](const Face& a, const Face& b) {
    return std::pair(a.tetrahedron[0], a.across[0]) < std::pair(b.tetrahedron[0], b.across[0]);
  });
}

EmbeddedMesh::Corners EmbeddedMesh::corners_of(const Face& face, int side) const {
  static constexpr std::uint8_t outwards[4][3] = {{1, 2, 3}, {0, 3, 2}, {0, 1, 3}, {0, 2, 1}};
  const std::uint32_t t = face.tetrahedron[side];
  Corners corners;
  for (std::size_t a = 0; a < 3; ++a) corners[a] = 4 * t + outwards[face.across[side]][a];
  if (left_handed_[t]) std::swap(corners[1], corners[2]);
  return corners;
}

std::uint32_t EmbeddedMesh::partner(const Face& face, std::uint32_t corner) const {
  std::uint32_t other = 4 * face.tetrahedron[1];
  while (tetrahedra_[other] != tetrahedra_[corner]) ++other;
  return other;
}

void EmbeddedMesh::split(const Solid& solid) {
  const std::size_t tetrahedra = left_handed_.size();
  DisjointSets corners(tetrahedra_.size()), pieces(tetrahedra);
  for (const Face& face : faces_) {
    if (!face.shared) continue;
    const auto bond = solid.bond(face.tetrahedron[0], face.tetrahedron[1]);
    if (!bond || !solid.intact(bond->slot)) continue;
    for (const std::uint32_t corner : corners_of(face, 0)) corners.unite(corner, partner(face, corner));
    pieces.unite(face.tetrahedron[0], face.tetrahedron[1]);
  }

  // The group with the first of a vertex' tetrahedra keeps its place among the vertices; the others follow behind.
  std::vector<std::uint32_t> first(rest_.size() / 3, none);
  for (std::uint32_t c = 0; c < tetrahedra_.size(); ++c) first[tetrahedra_[c]] = std::min(first[tetrahedra_[c]], c);
  vertex_of_corner_.assign(tetrahedra_.size(), none);
  std::uint32_t count = 0;
  for (const std::uint32_t c : first)
    if (c != none) vertex_of_corner_[c] = count++;
  for (std::uint32_t c = 0; c < tetrahedra_.size(); ++c) {
    const std::uint32_t group = corners.find(c);
    if (vertex_of_corner_[group] == none) vertex_of_corner_[group] = count++;
    vertex_of_corner_[c] = vertex_of_corner_[group];
  }

  piece_.assign(count, 0);
  std::vector<std::uint32_t> number(tetrahedra, none);
  std::uint32_t numbers = 0;
  for (std::uint32_t t = 0; t < tetrahedra; ++t) {
    const std::uint32_t piece = pieces.find(t);
    if (number[piece] == none) number[piece] = numbers++;
    for (std::uint32_t c = 4 * t; c < 4 * t + 4; ++c) piece_[vertex_of_corner_[c]] = number[piece];
  }

  // A crack whose two sides still have all three vertices in common is closed.
  triangles_.clear();
  for (const Face& face : faces_) {
    const Corners own = corners_of(face, 0);
    const auto joined = [&](std::uint32_t c) { return vertex_of_corner_[c] == vertex_of_corner_[partner(face, c)]; };
    if (face.shared && std::all_of(own.begin(), own.end(), joined)) continue;
    for (int side = 0; side < 1 + face.shared; ++side)
      for (const std::uint32_t c : corners_of(face, side)) triangles_.push_back(vertex_of_corner_[c]);
  }
}

void EmbeddedMesh::move(const Solid& solid, std::span<const double> position, std::span<const double> velocity,
                        std::span<const double> damage, std::span<const double> mass) {
  std::vector<double> centres(position.size());
  for (std::size_t c = 0; c < tetrahedra_.size(); ++c)
    for (std::size_t a = 0; a < 3; ++a) centres[3 * (c / 4) + a] += 0.25 * rest_[3 * std::size_t(tetrahedra_[c]) + a];
  std::vector<double> weight(piece_.size());
  vertices_.assign(3 * weight.size(), 0);
  velocity_.assign(3 * weight.size(), 0);
  damage_.assign(weight.size(), 0);
  solid.for_shapes(centres, position, velocity, [&](std::size_t t, const ShapeTensor& shape) {
    const LocalMotion motion = local_motion(shape);
    for (std::size_t c = 4 * t; c < 4 * t + 4; ++c) {
      const double* from = &rest_[3 * std::size_t(tetrahedra_[c])];
      const double arm[3] = {from[0] - centres[3 * t], from[1] - centres[3 * t + 1], from[2] - centres[3 * t + 2]};
      const std::size_t v = vertex_of_corner_[c];
      weight[v] += mass[t];
      damage_[v] += mass[t] * damage[t];
      for (std::size_t a = 0; a < 3; ++a) {
        double x = position[3 * t + a], u = velocity[3 * t + a];
        for (std::size_t b = 0; b < 3; ++b) {
          x += motion.gradient[a][b] * arm[b];
          u += motion.rate[a][b] * arm[b];
        }
        vertices_[3 * v + a] += mass[t] * x;
        velocity_[3 * v + a] += mass[t] * u;
      }
    }
  });
  for (std::size_t v = 0; v < weight.size(); ++v) {
    damage_[v] /= weight[v];
    for (std::size_t a = 0; a < 3; ++a) {
      vertices_[3 * v + a] /= weight[v];
      velocity_[3 * v + a] /= weight[v];
    }
  }
}

SurfaceMesh EmbeddedMesh::surface(const Solid& solid, std::span<const double> position, std::span<const double> velocity,
                                  std::span<const double> damage, std::span<const double> mass) {
  split(solid);
  move(solid, position, velocity, damage, mass);
  return {vertices_, triangles_, velocity_, damage_, piece_, vertex_of_corner_};
}

}  // namespace cleave::peridynamics
