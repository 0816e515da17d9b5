#include "tetgen_module.h"

#include <tetgen.h>

#include <cstdint>
#include <cstdio>
#include <exception>
#include <limits>
#include <map>
#include <vector>

namespace {

/// What the numbers that TetGen throws stand for (TetGen manual 1.5, "error codes").
const char* meaning(int code) {
  switch (code) {
    case 1:
      return "TetGen ran out of memory";
    case 3:
      return "TetGen found that the surface intersects itself";
    case 4:
    case 5:
      return "TetGen found features of the surface too close to each other to resolve";
    default:
      return "TetGen failed on this surface";
  }
}

/// p: of closed surfaces; q: ratios of radius to edge of 1.4 and dihedral angles of 10 degrees; A: regions; Q: silent.
const char* tetrahedralize_surfaces(std::uint64_t vertex_count, const double* vertices, std::uint64_t triangle_count,
                                    const std::uint32_t* triangles, double greatest_volume, void* user,
                                    cleave_take_tetrahedra take) {
  if (vertex_count > std::uint64_t(std::numeric_limits<int>::max()) / 3 ||
      triangle_count > std::uint64_t(std::numeric_limits<int>::max()))
    return "TetGen cannot take as many triangles";
  tetgenio in, out;  // what is allocated here they release
  in.numberofpoints = int(vertex_count);
  in.pointlist = new REAL[3 * vertex_count];
  for (std::uint64_t i = 0; i < 3 * vertex_count; i++) in.pointlist[i] = vertices[i];
  in.facetlist = new tetgenio::facet[triangle_count];
  in.numberoffacets = int(triangle_count);
  for (std::uint64_t t = 0; t < triangle_count; t++) {
    tetgenio::facet& facet = in.facetlist[t];
    tetgenio::init(&facet);
    facet.numberofpolygons = 1;
    facet.polygonlist = new tetgenio::polygon[1];
    tetgenio::polygon& polygon = facet.polygonlist[0];
    tetgenio::init(&polygon);
    polygon.numberofvertices = 3;
    polygon.vertexlist = new int[3];
    for (int i = 0; i < 3; i++) polygon.vertexlist[i] = int(triangles[3 * t + std::uint64_t(i)]);
  }
  char switches[64];
  std::snprintf(switches, sizeof switches, "pq1.4/10Aa%.17gQ", greatest_volume);
  tetrahedralize(switches, &in, &out);
  std::vector<std::uint32_t> corners(4 * std::size_t(out.numberoftetrahedra)), region;
  for (std::size_t i = 0; i < corners.size(); i++) corners[i] = std::uint32_t(out.tetrahedronlist[i]);
  std::map<double, std::uint32_t> regions;
  for (int t = 0; t < out.numberoftetrahedra; t++) {
    const double attribute =
        out.numberoftetrahedronattributes > 0 ? out.tetrahedronattributelist[t * out.numberoftetrahedronattributes] : 0.0;
    region.push_back(regions.try_emplace(attribute, std::uint32_t(regions.size())).first->second);
  }
  take(user, std::uint64_t(out.numberofpoints), out.pointlist, std::uint64_t(out.numberoftetrahedra), corners.data(),
       region.data());
  return nullptr;
}

}  // namespace

extern "C" __attribute__((visibility("default"))) const char* cleave_tetrahedralize(
    std::uint64_t vertex_count, const double* vertices, std::uint64_t triangle_count, const std::uint32_t* triangles,
    double greatest_volume, void* user, cleave_take_tetrahedra take) {
  try {
    return tetrahedralize_surfaces(vertex_count, vertices, triangle_count, triangles, greatest_volume, user, take);
  } catch (int code) {
    return meaning(code);
  } catch (const std::exception&) {
    return "TetGen ran out of memory";
  }
}
