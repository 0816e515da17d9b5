#include "scene/tetrahedral_mesh.hpp"

#include "common/error.hpp"

#include <fmt/format.h>

#include <Eigen/Geometry>
#include <algorithm>
#include <cmath>
#include <limits>
#include <numeric>

namespace cleave::scene {
namespace {

Vector3 corner(const TetrahedralMesh& mesh, std::size_t tetrahedron, int i) {
  return mesh.vertices[mesh.tetrahedra[tetrahedron][std::size_t(i)]];
}

/// A face of a tetrahedron; those with the same vertices are the two sides of one place.
struct Face {
  Triangle sorted;
  std::uint32_t tetrahedron;
  std::uint8_t opposite;  ///< corner of the tetrahedron
  bool even;              ///< an even permutation of `sorted`, normals outwards
};

Triangle triangle_of(const TetrahedralMesh& mesh, const Face& face) {
  const auto& t = mesh.tetrahedra[face.tetrahedron];
  const auto& corners = tetrahedron_faces[face.opposite];
  return {t[std::size_t(corners[0])], t[std::size_t(corners[1])], t[std::size_t(corners[2])]};
}

/// All faces, ordered so that the sides of one place are neighbours.
std::vector<Face> sorted_faces(const TetrahedralMesh& mesh) {
  std::vector<Face> faces;
  faces.reserve(4 * mesh.tetrahedra.size());
  for (std::size_t t = 0; t < mesh.tetrahedra.size(); t++)
    for (std::uint8_t f = 0; f < 4; f++) {
      Face face{{}, std::uint32_t(t), f, true};
      auto& v = face.sorted = triangle_of(mesh, face);
      for (const auto& [i, j] : {std::pair{0, 1}, std::pair{1, 2}, std::pair{0, 1}})
        if (v[std::size_t(i)] > v[std::size_t(j)]) {
          std::swap(v[std::size_t(i)], v[std::size_t(j)]);
          face.even = !face.even;
        }
      faces.push_back(face);
    }
  std::sort(faces.begin(), faces.end(), [](const Face& a, const Face& b) {
    return a.sorted != b.sorted ? a.sorted < b.sorted : a.tetrahedron < b.tetrahedron;
  });
  return faces;
}

/// `visit(first, last)` for each place, with the range of its sides.
template <class Visit>
void for_each_place(const std::vector<Face>& faces, const Visit& visit) {
  for (auto first = faces.begin(); first != faces.end();) {
    const auto last = std::find_if(first, faces.end(), [&](const Face& face) { return face.sorted != first->sorted; });
    visit(first, last);
    first = last;
  }
}

/// Sets of numbers that are joined pair by pair.
class DisjointSets {
 public:
  explicit DisjointSets(std::size_t size) : parent_(size) { std::iota(parent_.begin(), parent_.end(), std::size_t(0)); }
  /// The least number of the set.
  std::size_t find(std::size_t i) {
    while (parent_[i] != i) i = parent_[i] = parent_[parent_[i]];
    return i;
  }
  void join(std::size_t i, std::size_t j) {
    i = find(i), j = find(j);
    parent_[std::max(i, j)] = std::min(i, j);
  }

 private:
  std::vector<std::size_t> parent_;
};

/// How many tetrahedra have something, and the first of them.
struct Found {
  std::size_t count = 0, first = std::numeric_limits<std::size_t>::max();
  void add(std::size_t tetrahedron) {
    count++;
    first = std::min(first, tetrahedron);
  }
};

std::string counted(std::size_t count, const char* one, const char* many) {
  return fmt::format("{} {}", count, count == 1 ? one : many);
}

std::size_t drop_unused_vertices(TetrahedralMesh& mesh) {
  constexpr std::uint32_t unused = std::numeric_limits<std::uint32_t>::max();
  std::vector<std::uint32_t> number(mesh.vertices.size(), unused);
  for (const auto& t : mesh.tetrahedra)
    for (const auto v : t) number[v] = 0;
  std::uint32_t next = 0;
  for (std::size_t v = 0; v < number.size(); v++)
    if (number[v] != unused) {
      mesh.vertices[next] = mesh.vertices[v];
      number[v] = next++;
    }
  const std::size_t dropped = mesh.vertices.size() - next;
  mesh.vertices.resize(next);
  for (auto& t : mesh.tetrahedra)
    for (auto& v : t) v = number[v];
  return dropped;
}

}  // namespace

double signed_volume(const TetrahedralMesh& mesh, std::size_t tetrahedron) {
  const Vector3 x = corner(mesh, tetrahedron, 0);
  const Vector3 a = corner(mesh, tetrahedron, 1) - x, b = corner(mesh, tetrahedron, 2) - x,
                c = corner(mesh, tetrahedron, 3) - x;
  return a.dot(b.cross(c)) / 6;
}

std::vector<double> volumes(const TetrahedralMesh& mesh) {
  std::vector<double> result(mesh.tetrahedra.size());
  for (std::size_t t = 0; t < result.size(); t++) result[t] = signed_volume(mesh, t);
  return result;
}

std::vector<Vector3> barycentres(const TetrahedralMesh& mesh) {
  std::vector<Vector3> result(mesh.tetrahedra.size());
  for (std::size_t t = 0; t < result.size(); t++)
    result[t] = (corner(mesh, t, 0) + corner(mesh, t, 1) + corner(mesh, t, 2) + corner(mesh, t, 3)) / 4;
  return result;
}

std::vector<Triangle> surface_of(const TetrahedralMesh& mesh) {
  const auto faces = sorted_faces(mesh);
  std::vector<Face> outer;
  for_each_place(faces, [&](auto first, auto last) {
    if (last - first == 1) outer.push_back(*first);
  });
  std::sort(outer.begin(), outer.end(), [](const Face& a, const Face& b) {
    return a.tetrahedron != b.tetrahedron ? a.tetrahedron < b.tetrahedron : a.opposite < b.opposite;
  });
  std::vector<Triangle> triangles;
  triangles.reserve(outer.size());
  for (const Face& face : outer) triangles.push_back(triangle_of(mesh, face));
  return triangles;
}

MeshMeasures measure(const TetrahedralMesh& mesh) {
  MeshMeasures m;
  if (mesh.tetrahedra.empty()) return m;
  for (const double v : volumes(mesh)) m.volume += v;
  std::vector<std::array<std::uint32_t, 2>> edges;
  edges.reserve(6 * mesh.tetrahedra.size());
  double least = -1, greatest = 1;  // cosines of the least and greatest angle
  for (std::size_t t = 0; t < mesh.tetrahedra.size(); t++) {
    std::array<Vector3, 4> normals;
    for (std::size_t f = 0; f < 4; f++) {
      const auto& c = tetrahedron_faces[f];
      const Vector3 x = corner(mesh, t, c[0]);
      normals[f] = (corner(mesh, t, c[1]) - x).cross(corner(mesh, t, c[2]) - x).normalized();
    }
    for (std::size_t i = 0; i < 4; i++)
      for (std::size_t j = i + 1; j < 4; j++) {
        const double cosine = -normals[i].dot(normals[j]);
        least = std::max(least, cosine);
        greatest = std::min(greatest, cosine);
        const auto [a, b] = std::minmax(mesh.tetrahedra[t][i], mesh.tetrahedra[t][j]);
        edges.push_back({a, b});
      }
  }
  DisjointSets parts(mesh.tetrahedra.size());
  for_each_place(sorted_faces(mesh), [&](auto first, auto last) {
    if (last - first == 2) parts.join(first->tetrahedron, (first + 1)->tetrahedron);
  });
  for (std::size_t t = 0; t < mesh.tetrahedra.size(); t++) m.pieces += parts.find(t) == t;
  m.least_dihedral_angle = std::acos(std::clamp(least, -1.0, 1.0));
  m.greatest_dihedral_angle = std::acos(std::clamp(greatest, -1.0, 1.0));
  std::sort(edges.begin(), edges.end());
  edges.erase(std::unique(edges.begin(), edges.end()), edges.end());
  m.shortest_edge = std::numeric_limits<double>::infinity();
  for (const auto& [a, b] : edges) {
    const double length = (mesh.vertices[a] - mesh.vertices[b]).norm();
    m.shortest_edge = std::min(m.shortest_edge, length);
    m.longest_edge = std::max(m.longest_edge, length);
    m.mean_edge += length / double(edges.size());
  }
  return m;
}

std::vector<std::string> make_valid(TetrahedralMesh& mesh, const std::string& name, std::int64_t first_number) {
  if (mesh.tetrahedra.empty()) throw InputError(name + ": there are no tetrahedra");
  const auto number = [&](std::size_t tetrahedron) { return std::int64_t(tetrahedron) + first_number; };
  std::vector<std::string> notes;
  Found flat, inverted;
  for (std::size_t t = 0; t < mesh.tetrahedra.size(); t++) {
    const double volume = signed_volume(mesh, t);
    double longest = 0;
    for (int i = 0; i < 4; i++)
      for (int j = i + 1; j < 4; j++) longest = std::max(longest, (corner(mesh, t, i) - corner(mesh, t, j)).norm());
    // Below this a volume is rounding alone: coordinates are some 1e16 times their errors.
    if (!(std::abs(volume) > 1e-12 * longest * longest * longest)) {
      flat.add(t);
    } else if (volume < 0) {
      inverted.add(t);
      std::swap(mesh.tetrahedra[t][2], mesh.tetrahedra[t][3]);
    }
  }
  if (flat.count > 0)
    throw InputError(fmt::format("{}: {} no volume, the first is number {}; remove them or mesh the body again", name,
                                 counted(flat.count, "tetrahedron has", "tetrahedra have"), number(flat.first)));
  if (inverted.count == mesh.tetrahedra.size())
    notes.push_back(fmt::format("{}: all {} tetrahedra were inside out and have been turned", name, inverted.count));
  else if (inverted.count > 0)
    notes.push_back(fmt::format("{}: {} inside out, the first number {}, and {} been turned", name,
                                counted(inverted.count, "tetrahedron was", "tetrahedra were"), number(inverted.first),
                                inverted.count == 1 ? "has" : "have"));
  Found crowded, overlapping;
  for_each_place(sorted_faces(mesh), [&](auto first, auto last) {
    if (last - first > 2) crowded.add(first->tetrahedron);
    if (last - first == 2 && first->even == (first + 1)->even) overlapping.add(first->tetrahedron);
  });
  if (crowded.count > 0)
    throw InputError(
        fmt::format("{}: {} to more than two tetrahedra, the first of them to number {}; each must belong to one or two", name,
                    counted(crowded.count, "face belongs", "faces belong"), number(crowded.first)));
  if (overlapping.count > 0)
    throw InputError(
        fmt::format("{}: {} tetrahedra overlap with a neighbour on the same side of a common face, the first is number {}",
                    name, overlapping.count, number(overlapping.first)));
  if (const std::size_t dropped = drop_unused_vertices(mesh))
    notes.push_back(fmt::format("{}: {} to no tetrahedron and {} left out", name,
                                counted(dropped, "vertex belongs", "vertices belong"), dropped == 1 ? "is" : "are"));
  return notes;
}

std::size_t separate_touching_parts(TetrahedralMesh& mesh) {
  DisjointSets corners(4 * mesh.tetrahedra.size());  // joined where they are the same vertex of one part
  for_each_place(sorted_faces(mesh), [&](auto first, auto last) {
    if (last - first != 2) return;
    const auto &a = mesh.tetrahedra[first->tetrahedron], &b = mesh.tetrahedra[(first + 1)->tetrahedron];
    for (std::size_t i = 0; i < 4; i++)
      for (std::size_t j = 0; j < 4; j++)
        if (a[i] == b[j]) corners.join(4 * std::size_t(first->tetrahedron) + i, 4 * std::size_t((first + 1)->tetrahedron) + j);
  });
  const std::size_t before = mesh.vertices.size();
  std::vector<bool> taken(before, false);
  const auto old = mesh.tetrahedra;
  for (std::size_t t = 0; t < old.size(); t++)
    for (std::size_t i = 0; i < 4; i++) {
      const std::size_t root = corners.find(4 * t + i);
      auto& vertex = mesh.tetrahedra[t][i];
      if (root != 4 * t + i) {
        vertex = mesh.tetrahedra[root / 4][root % 4];
      } else if (taken[old[t][i]]) {
        vertex = std::uint32_t(mesh.vertices.size());
        mesh.vertices.push_back(Vector3(mesh.vertices[old[t][i]]));
      } else {
        taken[old[t][i]] = true;
      }
    }
  return mesh.vertices.size() - before;
}

}  // namespace cleave::scene
