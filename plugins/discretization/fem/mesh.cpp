#include "mesh.hpp"

#include <algorithm>
#include <cmath>
#include <numeric>
#include <stdexcept>
#include <string>

namespace cleave::fem {

Mesh::Mesh(std::span<const double> positions, std::span<const std::uint32_t> corners, double density)
    : rest(positions.begin(), positions.end()) {
  mass.resize(positions.size() / 3);
  corner.resize(corners.size() / 4);
  volume.resize(corner.size());
  gradient.resize(corner.size());
  squared_gradients.resize(corner.size());
  const auto at = [&](std::uint32_t v) { return Vector(rest[3 * v], rest[3 * v + 1], rest[3 * v + 2]); };
  for (std::size_t t = 0; t < corner.size(); ++t) {
    std::copy_n(corners.begin() + std::ptrdiff_t(4 * t), 4, corner[t].begin());
    for (const std::uint32_t v : corner[t])
      if (v >= vertices())
        throw std::runtime_error("tetrahedron " + std::to_string(t) + " has vertex " + std::to_string(v) + " of " +
                                 std::to_string(vertices()));
    const Vector origin = at(corner[t][0]);
    const Matrix edges = Matrix::from_columns(at(corner[t][1]) - origin, at(corner[t][2]) - origin, at(corner[t][3]) - origin);
    const double six_volumes = determinant(edges), longest = norm(edges);
    if (!(six_volumes > 1e-12 * longest * longest * longest))
      throw std::runtime_error("tetrahedron " + std::to_string(t) + (six_volumes < 0 ? " is inside out" : " is flat"));
    volume[t] = six_volumes / 6;
    gradient[t] = inverse(edges);
    squared_gradients[t] =
        squared_norm(gradient[t]) + squared_norm(gradient[t].row(0) + gradient[t].row(1) + gradient[t].row(2));
    for (const std::uint32_t v : corner[t]) mass[v] += 0.25 * density * volume[t];
  }
  for (std::size_t v = 0; v < vertices(); ++v)
    if (!(mass[v] > 0)) throw std::runtime_error("vertex " + std::to_string(v) + " belongs to no tetrahedron");
  find_incident();
  find_boundary();
  find_pieces();
}

void Mesh::find_incident() {
  incident_begin.assign(vertices() + 1, 0);
  for (const auto& c : corner)
    for (const std::uint32_t v : c) ++incident_begin[v + 1];
  std::partial_sum(incident_begin.begin(), incident_begin.end(), incident_begin.begin());
  incident.resize(4 * tetrahedra());
  std::vector<std::size_t> next(incident_begin.begin(), incident_begin.end() - 1);
  for (std::size_t t = 0; t < tetrahedra(); ++t)
    for (std::uint32_t k = 0; k < 4; ++k) incident[next[corner[t][k]]++] = std::uint32_t(4 * t + k);
}

void Mesh::find_boundary() {
  constexpr std::uint32_t faces[4][3] = {{0, 2, 1}, {0, 1, 3}, {0, 3, 2}, {1, 2, 3}};
  struct Face {
    std::array<std::uint32_t, 3> sorted, outward;
  };
  std::vector<Face> all;
  all.reserve(4 * tetrahedra());
  for (const auto& c : corner)
    for (const auto& f : faces) {
      Face face{{}, {c[f[0]], c[f[1]], c[f[2]]}};
      face.sorted = face.outward;
      std::sort(face.sorted.begin(), face.sorted.end());
      all.push_back(face);
    }
  std::stable_sort(all.begin(), all.end(), [](const Face& a, const Face& b) { return a.sorted < b.sorted; });
  for (std::size_t first = 0, last = 0; first < all.size(); first = last) {
    while (last < all.size() && all[last].sorted == all[first].sorted) ++last;
    if (last - first > 2)
      throw std::runtime_error(std::to_string(last - first) + " tetrahedra share the face of vertices " +
                               std::to_string(all[first].sorted[0]) + ", " + std::to_string(all[first].sorted[1]) + " and " +
                               std::to_string(all[first].sorted[2]) + "; at most two can");
    if (last - first == 1) boundary.insert(boundary.end(), all[first].outward.begin(), all[first].outward.end());
  }
}

void Mesh::find_pieces() {
  std::vector<std::uint32_t> parent(vertices());
  std::iota(parent.begin(), parent.end(), 0u);
  const auto root = [&](std::uint32_t v) {
    while (parent[v] != v) v = parent[v] = parent[parent[v]];
    return v;
  };
  for (const auto& c : corner)
    for (std::uint32_t k = 1; k < 4; ++k) {
      const std::uint32_t a = root(c[0]), b = root(c[k]);
      parent[std::max(a, b)] = std::min(a, b);
    }
  piece.resize(vertices());
  for (std::uint32_t v = 0; v < vertices(); ++v) piece[v] = root(v) == v ? pieces++ : piece[root(v)];
}

}  // namespace cleave::fem
