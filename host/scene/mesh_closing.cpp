#include "scene/mesh_closing.hpp"

#include "common/error.hpp"

#include <algorithm>
#include <cstdint>
#include <numeric>
#include <string>

namespace cleave::scene {
namespace {

using Triangle = std::array<int, 3>;

const Vector3& vertex(const TriangleMesh& mesh, int index) { return mesh.vertices[static_cast<std::size_t>(index)]; }

Vector3 area_vector(const TriangleMesh& mesh, const Triangle& t) {
  return (vertex(mesh, t[1]) - vertex(mesh, t[0])).cross(vertex(mesh, t[2]) - vertex(mesh, t[0])) / 2;
}

TriangleMesh welded(const TriangleMesh& mesh) {
  TriangleMesh result;
  result.vertices = mesh.vertices;
  result.triangles.reserve(mesh.triangles.size());
  const std::vector<int> first = coincident_vertices(mesh.vertices);
  for (Triangle t : mesh.triangles) {
    for (int& corner : t) corner = first[static_cast<std::size_t>(corner)];
    if (t[0] != t[1] && t[1] != t[2] && t[2] != t[0]) result.triangles.push_back(t);
  }
  return result;
}

/// The edges that an odd number of triangles share, each as one of those triangles goes along it.
std::vector<std::array<int, 2>> find_open_edges(const TriangleMesh& mesh) {
  struct Edge {
    std::uint64_t key;
    std::array<int, 2> ends;
  };
  std::vector<Edge> edges;
  edges.reserve(3 * mesh.triangles.size());
  for (const Triangle& t : mesh.triangles) {
    for (std::size_t i = 0; i < 3; ++i) {
      const int a = t[i], b = t[(i + 1) % 3];
      const auto low = static_cast<std::uint64_t>(std::min(a, b)), high = static_cast<std::uint64_t>(std::max(a, b));
      edges.push_back({low << 32 | high, {a, b}});
    }
  }
  std::stable_sort(edges.begin(), edges.end(), [](const Edge& a, const Edge& b) { return a.key < b.key; });
  std::vector<std::array<int, 2>> open;
  for (std::size_t begin = 0, end = 0; begin < edges.size(); begin = end) {
    while (end < edges.size() && edges[end].key == edges[begin].key) ++end;
    if ((end - begin) % 2 == 1) open.push_back(edges[begin].ends);
  }
  return open;
}

/// Splits the open edges into loops without repeated vertices. An even number of open edges meets at every vertex (each
/// triangle brings two or none), so that a walk along unused edges can only end where it has already been.
std::vector<std::vector<int>> find_loops(const std::vector<std::array<int, 2>>& edges, std::size_t vertex_count) {
  std::vector<std::size_t> begins(vertex_count + 1, 0);
  for (const auto& edge : edges) {
    for (const int end : edge) ++begins[static_cast<std::size_t>(end) + 1];
  }
  std::partial_sum(begins.begin(), begins.end(), begins.begin());
  std::vector<std::size_t> incident(2 * edges.size()), cursor(begins.begin(), begins.end() - 1);
  for (std::size_t e = 0; e < edges.size(); ++e) {
    for (const int end : edges[e]) incident[cursor[static_cast<std::size_t>(end)]++] = e;
  }
  std::copy(begins.begin(), begins.end() - 1, cursor.begin());

  std::vector<std::vector<int>> loops;
  std::vector<char> used(edges.size(), 0);
  std::vector<std::size_t> place_in_path(vertex_count, 0);  // counted from 1; 0: not on the path
  for (std::size_t first = 0; first < edges.size(); ++first) {
    if (used[first]) continue;
    std::vector<int> path = {edges[first][0]};
    place_in_path[static_cast<std::size_t>(path.back())] = 1;
    while (true) {
      const auto here = static_cast<std::size_t>(path.back());
      while (cursor[here] < begins[here + 1] && used[incident[cursor[here]]]) ++cursor[here];
      if (cursor[here] == begins[here + 1]) break;
      const std::size_t e = incident[cursor[here]];
      used[e] = 1;
      const int next = edges[e][0] == path.back() ? edges[e][1] : edges[e][0];
      const std::size_t place = place_in_path[static_cast<std::size_t>(next)];
      if (place == 0) {
        path.push_back(next);
        place_in_path[static_cast<std::size_t>(next)] = path.size();
        continue;
      }
      loops.emplace_back(path.begin() + static_cast<std::ptrdiff_t>(place - 1), path.end());
      while (path.size() > place) {
        place_in_path[static_cast<std::size_t>(path.back())] = 0;
        path.pop_back();
      }
    }
    for (const int v : path) place_in_path[static_cast<std::size_t>(v)] = 0;
  }
  return loops;
}

/// Appends a fan about the centroid of a loop, facing as its neighbours do if the loop runs along one of their edges.
void cap(TriangleMesh& mesh, const std::vector<int>& loop, bool runs_along_triangles) {
  Vector3 centroid = Vector3::Zero();
  for (const int v : loop) centroid += vertex(mesh, v);
  const int hub = static_cast<int>(mesh.vertices.size());
  mesh.vertices.push_back(centroid / static_cast<double>(loop.size()));
  for (std::size_t i = 0; i < loop.size(); ++i) {
    const int a = loop[i], b = loop[(i + 1) % loop.size()];
    mesh.triangles.push_back(runs_along_triangles ? Triangle{b, a, hub} : Triangle{a, b, hub});
  }
}

double total_area(const TriangleMesh& mesh, std::size_t begin, std::size_t end) {
  double area = 0;
  for (std::size_t i = begin; i < end; ++i) area += area_vector(mesh, mesh.triangles[i]).norm();
  return area;
}

struct Component {
  Box box;
  double volume = 0;
};

void split_cavities(TriangleMesh&& mesh, ClosedSurfaces& result) {
  std::vector<int> parent(mesh.vertices.size());
  std::iota(parent.begin(), parent.end(), 0);
  const auto root_of = [&](int v) {
    while (parent[static_cast<std::size_t>(v)] != v) {
      int& up = parent[static_cast<std::size_t>(v)];
      v = up = parent[static_cast<std::size_t>(up)];
    }
    return v;
  };
  for (const Triangle& t : mesh.triangles) {
    for (int i = 1; i < 3; ++i) parent[static_cast<std::size_t>(root_of(t[static_cast<std::size_t>(i)]))] = root_of(t[0]);
  }
  std::vector<int> component_of(mesh.vertices.size(), -1);
  std::vector<Component> components;
  for (const Triangle& t : mesh.triangles) {
    int& component = component_of[static_cast<std::size_t>(root_of(t[0]))];
    if (component < 0) {
      component = static_cast<int>(components.size());
      components.emplace_back();
    }
    Component& c = components[static_cast<std::size_t>(component)];
    for (const int corner : t) c.box.extend(vertex(mesh, corner));
    // About a point nearby, so that far-away meshes do not lose their volume to rounding.
    const Vector3& about = vertex(mesh, mesh.triangles.front()[0]);
    c.volume += area_vector(mesh, t).dot(vertex(mesh, t[0]) - about) / 3;
  }
  // The largest component decides which way triangles face outwards.
  const auto largest = std::max_element(components.begin(), components.end(), [](const Component& a, const Component& b) {
    return std::abs(a.volume) < std::abs(b.volume);
  });
  std::vector<char> is_cavity(components.size(), 0);
  for (std::size_t i = 0; i < components.size(); ++i) {
    if (components[i].volume * largest->volume >= 0) continue;
    for (const Component& other : components) {
      if (other.volume * largest->volume > 0 && other.box.contains(components[i].box)) is_cavity[i] = 1;
    }
  }
  if (std::find(is_cavity.begin(), is_cavity.end(), 1) == is_cavity.end()) {
    result.solids = std::move(mesh);
    return;
  }
  result.solids.vertices = result.cavities.vertices = std::move(mesh.vertices);
  for (const Triangle& t : mesh.triangles) {
    const int component = component_of[static_cast<std::size_t>(root_of(t[0]))];
    (is_cavity[static_cast<std::size_t>(component)] ? result.cavities : result.solids).triangles.push_back(t);
  }
}

}  // namespace

ClosedSurfaces close_mesh(const TriangleMesh& mesh, const std::string& name) {
  constexpr double largest_cap_share = 0.05;
  TriangleMesh closed = welded(mesh);
  if (closed.triangles.empty()) throw InputError(name + ": every face of the mesh is degenerate");

  ClosedSurfaces result;
  const std::vector<std::array<int, 2>> open = find_open_edges(closed);
  result.open_edges = open.size();
  if (!open.empty()) {
    const std::vector<std::vector<int>> loops = find_loops(open, closed.vertices.size());
    result.closed_holes = loops.size();
    std::vector<std::array<int, 2>> directed = open;
    std::sort(directed.begin(), directed.end());
    const std::size_t own_triangles = closed.triangles.size();
    for (const std::vector<int>& loop : loops) {
      cap(closed, loop, std::binary_search(directed.begin(), directed.end(), std::array<int, 2>{loop[0], loop[1]}));
    }
    const double own_area = total_area(closed, 0, own_triangles);
    const double cap_area = total_area(closed, own_triangles, closed.triangles.size());
    if (!(cap_area <= largest_cap_share * own_area)) {
      throw InputError(name + ": not closed: " + std::to_string(open.size()) + " open edges around " +
                       std::to_string(loops.size()) + (loops.size() == 1 ? " hole" : " holes") +
                       " too large to be closed without guessing what the mesh encloses");
    }
  }
  split_cavities(std::move(closed), result);
  return result;
}

}  // namespace cleave::scene
