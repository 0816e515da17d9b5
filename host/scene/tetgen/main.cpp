// Runs TetGen on a surface: tetgen SURFACE MESH, both files of exchange.hpp. A program of its own, because TetGen is under the
// AGPL, and because it may end the process it runs in on a surface that it cannot mesh.

#include "exchange.hpp"

#include <tetgen.h>

#include <cstdint>
#include <cstdio>
#include <limits>
#include <map>
#include <new>

namespace cleave::scene::tetgen {
namespace {

void give(const Surface& surface, tetgenio& in) {
  in.numberofpoints = int(surface.vertices.size() / 3);
  in.pointlist = new REAL[surface.vertices.size()];
  std::copy(surface.vertices.begin(), surface.vertices.end(), in.pointlist);
  in.numberoffacets = int(surface.triangles.size() / 3);
  in.facetlist = new tetgenio::facet[surface.triangles.size() / 3];
  for (std::size_t t = 0; t < surface.triangles.size() / 3; t++) {
    tetgenio::facet& facet = in.facetlist[t];
    tetgenio::init(&facet);
    facet.numberofpolygons = 1;
    facet.polygonlist = new tetgenio::polygon[1];
    tetgenio::polygon& polygon = facet.polygonlist[0];
    tetgenio::init(&polygon);
    polygon.numberofvertices = 3;
    polygon.vertexlist = new int[3];
    for (std::size_t i = 0; i < 3; i++) polygon.vertexlist[i] = int(surface.triangles[3 * t + i]);
  }
}

void run(const char* switches, tetgenio& in, tetgenio& out) {
  char text[64];
  std::snprintf(text, sizeof text, "%s", switches);
  tetrahedralize(text, &in, &out);
}

Exit mesh(const Surface& surface, Mesh& result) {
  constexpr std::size_t most = std::size_t(std::numeric_limits<int>::max()) / 4;
  if (surface.vertices.size() > most || surface.triangles.size() > most) return out_of_memory;
  {
    tetgenio in, crossings;  // what is allocated for them they release
    give(surface, in);
    run("pdQ", in, crossings);
    if (crossings.numberoftrifaces > 0) return intersecting;
  }
  tetgenio in, out;
  give(surface, in);
  // p: of closed surfaces; q: radii at most 1.4 times the shortest edge, dihedral angles of 10 degrees; A: regions; Q: quiet
  char switches[64];
  std::snprintf(switches, sizeof switches, "pq1.4/10Aa%.17fQ", surface.greatest_volume);
  run(switches, in, out);
  if (out.numberoftetrahedra == 0) return failed;
  result.vertices.assign(out.pointlist, out.pointlist + 3 * std::size_t(out.numberofpoints));
  const auto count = std::size_t(out.numberoftetrahedra);
  for (std::size_t i = 0; i < 4 * count; i++) result.tetrahedra.push_back(std::uint32_t(out.tetrahedronlist[i]));
  const auto attributes = std::size_t(out.numberoftetrahedronattributes);
  std::map<double, std::uint32_t> regions;
  for (std::size_t t = 0; t < count; t++) {
    const double attribute = attributes > 0 ? out.tetrahedronattributelist[t * attributes] : 0;
    result.region.push_back(regions.try_emplace(attribute, std::uint32_t(regions.size())).first->second);
  }
  return done;
}

/// What the numbers that TetGen throws stand for (TetGen 1.5 manual).
Exit meaning(int thrown) {
  return thrown == 1 ? out_of_memory : thrown == 3 ? intersecting : thrown == 4 || thrown == 5 ? too_close : failed;
}

}  // namespace
}  // namespace cleave::scene::tetgen

int main(int count, char** arguments) {
  using namespace cleave::scene::tetgen;
  if (count != 3) return cannot_exchange;
  Surface surface;
  std::ifstream in(arguments[1], std::ios::binary);
  in.read(reinterpret_cast<char*>(&surface.greatest_volume), sizeof surface.greatest_volume);
  get(in, surface.vertices);
  get(in, surface.triangles);
  if (!in) return cannot_exchange;
  Mesh result;
  try {
    if (const Exit problem = mesh(surface, result); problem != done) return problem;
  } catch (int thrown) {
    return meaning(thrown);
  } catch (const std::bad_alloc&) {
    return out_of_memory;
  }
  std::ofstream out(arguments[2], std::ios::binary);
  put(out, result.vertices);
  put(out, result.tetrahedra);
  put(out, result.region);
  out.close();
  return out ? done : cannot_exchange;
}
