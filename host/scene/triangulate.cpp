#include "scene/mesh_formats.hpp"

#include <span>

namespace cleave::scene {
namespace {

using Eigen::Vector2d;

double signed_area(const Vector2d& a, const Vector2d& b, const Vector2d& c) {
  return (b[0] - a[0]) * (c[1] - a[1]) - (b[1] - a[1]) * (c[0] - a[0]);
}

/// The corners in the polygon's own plane (along the axis its normal is nearest to), counter-clockwise.
std::vector<Vector2d> flatten(const std::vector<Vector3>& vertices, std::span<const int> polygon) {
  Vector3 normal = Vector3::Zero();
  const Vector3& origin = vertices[static_cast<std::size_t>(polygon.front())];
  for (std::size_t i = 1; i + 1 < polygon.size(); ++i) {
    normal += (vertices[static_cast<std::size_t>(polygon[i])] - origin)
                  .cross(vertices[static_cast<std::size_t>(polygon[i + 1])] - origin);
  }
  Eigen::Index along = 0;
  normal.cwiseAbs().maxCoeff(&along);
  Eigen::Index u = (along + 1) % 3, v = (along + 2) % 3;
  if (normal[along] < 0) std::swap(u, v);
  std::vector<Vector2d> flat;
  flat.reserve(polygon.size());
  for (const int corner : polygon) {
    const Vector3& vertex = vertices[static_cast<std::size_t>(corner)];
    flat.emplace_back(vertex[u], vertex[v]);
  }
  return flat;
}

bool is_ear(const std::vector<Vector2d>& flat, const std::vector<std::size_t>& left, std::size_t i) {
  const std::size_t n = left.size(), before = left[(i + n - 1) % n], tip = left[i], after = left[(i + 1) % n];
  const Vector2d &a = flat[before], &b = flat[tip], &c = flat[after];
  if (!(signed_area(a, b, c) > 0)) return false;
  for (const std::size_t other : left) {
    if (other == before || other == tip || other == after) continue;
    const Vector2d& p = flat[other];
    if (p == a || p == b || p == c) continue;
    if (signed_area(a, b, p) >= 0 && signed_area(b, c, p) >= 0 && signed_area(c, a, p) >= 0) return false;
  }
  return true;
}

void clip_ears(const std::vector<Vector3>& vertices, std::span<const int> polygon, std::vector<std::array<int, 3>>& triangles) {
  const std::vector<Vector2d> flat = flatten(vertices, polygon);
  std::vector<std::size_t> left(polygon.size());
  for (std::size_t i = 0; i < left.size(); ++i) left[i] = i;
  std::size_t start = 1;
  while (left.size() > 3) {
    const std::size_t n = left.size();
    std::size_t ear = start % n;
    // A polygon that is degenerate or crosses itself may have no ear; any corner is then as good as another.
    for (std::size_t tried = 0; tried < n; ++tried) {
      if (const std::size_t candidate = (start + tried) % n; is_ear(flat, left, candidate)) {
        ear = candidate;
        break;
      }
    }
    triangles.push_back({polygon[left[(ear + n - 1) % n]], polygon[left[ear]], polygon[left[(ear + 1) % n]]});
    left.erase(left.begin() + static_cast<std::ptrdiff_t>(ear));
    start = ear;
  }
  triangles.push_back({polygon[left[0]], polygon[left[1]], polygon[left[2]]});
}

}  // namespace

TriangleMesh triangulate(PolygonMesh&& mesh) {
  constexpr std::size_t too_many_corners = 4096;  // ear clipping takes quadratic time
  TriangleMesh result;
  result.triangles.reserve(mesh.corners.size() - std::min(mesh.corners.size(), 2 * mesh.polygon_ends.size()));
  std::size_t begin = 0;
  for (const std::size_t end : mesh.polygon_ends) {
    const std::span<const int> polygon(mesh.corners.data() + begin, end - begin);
    begin = end;
    if (polygon.size() == 3 || polygon.size() > too_many_corners) {
      for (std::size_t i = 1; i + 1 < polygon.size(); ++i) {
        result.triangles.push_back({polygon[0], polygon[i], polygon[i + 1]});
      }
    } else {
      clip_ears(mesh.vertices, polygon, result.triangles);
    }
  }
  result.vertices = std::move(mesh.vertices);
  return result;
}

}  // namespace cleave::scene
