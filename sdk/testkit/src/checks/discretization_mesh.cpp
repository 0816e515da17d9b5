// Tetrahedra, the surface they have before and after they come apart, and the elastic law that is lent for them.
#include "points.hpp"

#include <cleave/testkit/body.hpp>

#include <algorithm>
#include <array>
#include <cmath>
#include <map>
#include <numeric>
#include <set>
#include <string>

namespace cleave::testkit {
namespace {

/// What a discretisation shows of a body; tetrahedra and pieces may be missing.
struct Surface {
  std::vector<Point> vertices;
  std::vector<std::array<std::uint32_t, 3>> triangles;
  std::vector<std::array<std::uint32_t, 4>> tetrahedra;
  std::vector<std::uint32_t> piece;
};

double volume(const Point& a, const Point& b, const Point& c, const Point& d) {
  const Point u = difference(b, a), w = cross(difference(c, a), difference(d, a));
  return (u[0] * w[0] + u[1] * w[1] + u[2] * w[2]) / 6;
}
double volume(const Surface& s, const std::array<std::uint32_t, 4>& t) {
  return volume(s.vertices[t[0]], s.vertices[t[1]], s.vertices[t[2]], s.vertices[t[3]]);
}

/// Skips if the body has none, or one that discretization.surface reports.
Surface surface_of(Context& context, const Scene& scene) {
  cleave_surface given{};
  given.struct_size = sizeof given;
  const cleave_result result = scene.table().surface(scene.instance(), 0, &given);
  if (result == CLEAVE_ERROR_UNSUPPORTED) context.skip("it offers no surface of " + scene.bodies().front().described());
  Surface surface;
  for (std::uint64_t i = 0; i < given.vertex_count; ++i)
    surface.vertices.push_back({given.vertices[3 * i], given.vertices[3 * i + 1], given.vertices[3 * i + 2]});
  const auto cells = [&](auto& list, const std::uint32_t* corners, std::uint64_t count) {
    list.resize(count);
    for (std::uint64_t c = 0; c < count; ++c)
      for (std::uint32_t& corner : list[c])
        if ((corner = *corners++) >= given.vertex_count)
          context.skip("it has corners beyond its vertices, see discretization.surface");
  };
  cells(surface.triangles, given.triangles, given.triangle_count);
  cells(surface.tetrahedra, given.tetrahedra, given.tetrahedron_count);
  if (given.piece) surface.piece.assign(given.piece, given.piece + given.vertex_count);
  return surface;
}

/// Calls look(scene, when) for a cube of tetrahedra at rest, and while one half of it is carried away from the other.
template <class Look>
void tear(Context& context, const Look& look) {
  const Settings settings = context.settings().front();
  const Body body = tetrahedra(4);
  std::string words;
  {
    Scene scene(context, settings);
    context.doing("given " + body.described());
    if (scene.try_add(body, &words) != CLEAVE_OK) context.skip("it takes no tetrahedra: " + words);
  }
  const double step = quiet_step(context, settings, body);
  Scene scene(context, settings);
  scene.add(body);
  look(scene, "at rest");
  const double middle = body.corner[0] + (0.5 * body.cells + 1e-6) * body.edge;
  constexpr int moves = 12;
  for (int n = 1; n <= moves; ++n) {
    context.doing("carrying one half of " + body.described() + " away, step " + std::to_string(n));
    scene.handle = [&](std::size_t, const Point& rest, Motion& motion) {
      const double speed = rest[0] > middle ? 3 * body.edge / (moves * step) : 0;
      motion = {{rest[0] + n * step * speed, rest[1], rest[2]}, {speed, 0, 0}};
      return true;
    };
    scene.step(step);
    if (n % 4 == 0) look(scene, "after " + std::to_string(n) + " of " + std::to_string(moves) + " steps that tear it apart");
  }
}

void surface_closed(Context& context) {
  tear(context, [&](const Scene& scene, const std::string& when) {
    const Surface s = surface_of(context, scene);
    const std::string where = ", in the surface of " + scene.bodies().front().described() + " " + when;
    std::set<std::array<std::uint32_t, 3>> seen;
    std::map<std::pair<std::uint32_t, std::uint32_t>, int> edges;
    double enclosed = 0;
    for (auto t : s.triangles) {
      for (std::size_t k = 0; k < 3; ++k) {
        const std::uint32_t a = t[k], b = t[(k + 1) % 3];
        if (a == b) context.fail("a triangle has a vertex twice" + where);
        edges[{std::min(a, b), std::max(a, b)}] += a < b ? 1 : -1;
      }
      enclosed += volume({0, 0, 0}, s.vertices[t[0]], s.vertices[t[1]], s.vertices[t[2]]);
      std::sort(t.begin(), t.end());
      if (!seen.insert(t).second) context.fail("two triangles have the same vertices" + where);
    }
    for (const auto& [edge, balance] : edges)
      if (balance != 0)
        context.fail("the edge from vertex " + std::to_string(edge.first) + " to " + std::to_string(edge.second) +
                     " is not passed as often one way as the other: it is not closed, or a triangle is turned inside out," +
                     where);
    if (!(enclosed > 0)) context.fail("the volume enclosed is " + number(enclosed) + " m^3: triangles look inwards" + where);
    if (s.tetrahedra.empty()) return;
    constexpr std::size_t faces[4][3] = {{1, 2, 3}, {0, 3, 2}, {0, 1, 3}, {0, 2, 1}};
    std::map<std::array<std::uint32_t, 3>, int> tetrahedra_at;
    for (const auto& t : s.tetrahedra)
      for (const auto& face : faces) {
        std::array<std::uint32_t, 3> corners = {t[face[0]], t[face[1]], t[face[2]]};
        std::sort(corners.begin(), corners.end());
        ++tetrahedra_at[corners];
      }
    std::size_t outside = 0;
    for (const auto& [corners, count] : tetrahedra_at) {
      outside += count == 1;
      if (count == 1 && !seen.contains(corners))
        context.fail("a face that belongs to one tetrahedron alone is not part of it" + where);
    }
    if (outside != s.triangles.size())
      context.fail("there are " + std::to_string(s.triangles.size()) + " triangles, and " + std::to_string(outside) +
                   " faces that belong to one tetrahedron alone" + where);
  });
}

void pieces_whole(Context& context) {
  std::size_t most = 0;
  tear(context, [&](const Scene& scene, const std::string& when) {
    const Surface s = surface_of(context, scene);
    const Body& body = scene.bodies().front();
    if (s.tetrahedra.empty()) context.skip("its surfaces come without tetrahedra");
    const std::string where = ", for " + body.described() + " " + when;
    if (s.tetrahedra.size() != body.points())
      context.fail("has " + std::to_string(s.tetrahedra.size()) + " tetrahedra of " + std::to_string(body.points()) + where);
    std::vector<std::uint32_t> above(s.vertices.size());
    std::iota(above.begin(), above.end(), 0u);
    const auto root = [&](std::uint32_t v) {
      while (above[v] != v) v = above[v] = above[above[v]];
      return v;
    };
    std::vector<bool> used(s.vertices.size());
    for (const auto& t : s.tetrahedra)
      for (const std::uint32_t corner : t) {
        used[corner] = true;
        above[root(corner)] = root(t[0]);
      }
    std::map<std::uint32_t, double> filled, enclosed;  // by the root of the piece
    double rest = 0, sum = 0;
    for (std::size_t i = 0; i < s.tetrahedra.size(); ++i) {
      const double here = volume(s, s.tetrahedra[i]);
      filled[root(s.tetrahedra[i][0])] += here;
      sum += here;
      rest += body.volume[i];
    }
    for (const auto& t : s.triangles)
      enclosed[root(t[0])] += volume({0, 0, 0}, s.vertices[t[0]], s.vertices[t[1]], s.vertices[t[2]]);
    if (when == "at rest" && !(std::abs(sum - rest) <= 1e-9 * rest))
      context.fail("its tetrahedra fill " + number(sum) + " m^3, the body " + number(rest) + " m^3" + where);
    for (const auto& [piece, inside] : filled)
      if (!(std::abs(enclosed[piece] - inside) <= 1e-9 * rest))
        context.fail("the surface of a piece encloses " + number(enclosed[piece]) + " m^3, its tetrahedra fill " +
                     number(inside) + " m^3" + where);
    most = std::max(most, filled.size());
    if (s.piece.empty()) return;
    std::map<std::uint32_t, std::uint32_t> number_of;  // of each piece
    std::set<std::uint32_t> numbers;
    for (std::uint32_t v = 0; v < s.vertices.size(); ++v) {
      if (!used[v]) continue;
      const auto [entry, first] = number_of.emplace(root(v), s.piece[v]);
      if (entry->second != s.piece[v]) context.fail("vertices that tetrahedra connect have the numbers of two pieces" + where);
      if (first && !numbers.insert(s.piece[v]).second)
        context.fail("two pieces that nothing connects have the same number" + where);
    }
    if (numbers.empty() || *numbers.rbegin() + 1 != numbers.size()) context.fail("pieces are not numbered from 0 on" + where);
  });
  context.remark(most > 1 ? "torn into " + std::to_string(most) + " pieces" : "it stays in one piece");
}

void vertex_velocities(Context& context) {
  const Settings settings = context.settings().front();
  Body body = tetrahedra(3);
  context.random_cases(2, [&](Random& random) {
    double L[3][3];
    for (auto& row : L)
      for (double& rate : row) rate = random.uniform(-1, 1);
    const auto flow = [&](const std::vector<double>& places) {
      std::vector<double> velocity(places.size());
      for (std::size_t i = 0; i < places.size() / 3; ++i)
        for (std::size_t a = 0; a < 3; ++a)
          for (std::size_t b = 0; b < 3; ++b) velocity[3 * i + a] += L[a][b] * (places[3 * i + b] - body.centre()[b]);
      return velocity;
    };
    body.velocity = flow(body.position);
    body.vertex_velocity = flow(body.vertices);
    Scene scene(context, settings);
    std::string words;
    context.doing("given " + body.described() + " with velocities of its vertices");
    if (scene.try_add(body, &words) != CLEAVE_OK) context.skip("it takes no tetrahedra: " + words);
    const auto velocity = scene.velocity();
    for (std::size_t i = 0; i < velocity.size(); ++i)
      if (!(std::abs(velocity[i] - body.velocity[i]) <= 1e-9 * body.edge))
        context.fail("point " + std::to_string(i / 3) + " of " + body.described() +
                     " does not have the velocity that it and its corners got");
  });
}

void evaluates_law(Context& context) {
  if (!context.plugin().can(CLEAVE_NEEDS_ELASTICITY)) context.skip("it evaluates no elastic law");
  const Settings settings = context.settings().front();
  const Form form(context, settings);
  context.random_cases(1, [&](Random& random) {
    Body body = form.body(5, 3);
    const auto begin = [&](Scene& scene, double stiffness) {
      scene.stiffness = stiffness;
      scene.add(body);
    };
    double step;
    {
      Scene scene(context, settings);
      begin(scene, 4);
      step = 0.25 * scene.stable_step();
    }
    shake(body, random, 1e-3 * body.edge / step);
    const auto moved = [&](double stiffness) {
      Scene scene(context, settings);
      begin(scene, stiffness);
      context.doing("stepping " + body.described());
      for (int n = 0; n < 20; ++n) scene.step(step);
      if (const auto misuse = scene.elasticity(0)->misuse(); !misuse.empty()) context.fail(misuse);
      if (scene.elasticity(0)->evaluations() == 0) context.fail("never evaluates the elastic law that it says it needs");
      return scene.velocity();
    };
    if (moved(1) == moved(4)) context.fail("a law four times as stiff moves " + body.described() + " in the same way");
  });
  Scene scene(context, settings);
  scene.add(form.body(4, 2));
  const double step = 0.25 * scene.stable_step();
  scene.elasticity(0)->fails = true;
  context.doing("stepping while the elastic law fails");
  try {
    scene.step(step);
  } catch (const Failed& failed) {
    if (failed.reason.find(LentElasticity::reason) == std::string::npos)
      context.fail("does not hand on why the elastic law fails (\"" + std::string(LentElasticity::reason) +
                   "\") but says: " + failed.reason);
    return;
  }
  context.fail("goes on although the elastic law fails at every point");
}

}  // namespace

std::vector<Check> discretization_mesh_checks() {
  return {
      {"discretization.elasticity", 83,
       "The elastic law is asked for points that exist, moves the body, and ends the step with its own words if it fails.",
       discretization_kind, evaluates_law},
      {"discretization.surface-closed", 84,
       "The surface is closed, looks outwards and bounds the tetrahedra, with each face once, also of a body torn apart.",
       discretization_kind, surface_closed},
      {"discretization.pieces", 85,
       "Pieces are what tetrahedra connect, their surfaces enclose what these fill, and together they fill the body.",
       discretization_kind, pieces_whole},
      {"discretization.vertex-velocity", 86, "Tetrahedra start with the velocities that their vertices got.",
       discretization_kind, vertex_velocities},
  };
}

}  // namespace cleave::testkit
