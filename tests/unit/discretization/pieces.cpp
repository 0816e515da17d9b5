// What a surface falls apart into.

#include "discretization/connected_pieces.hpp"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

namespace cleave::discretization {
namespace {

using testing::ElementsAre;

cleave_surface surface_of(std::uint64_t vertices, const std::vector<std::uint32_t>& triangles,
                          const std::vector<std::uint32_t>& tetrahedra = {}) {
  cleave_surface surface{};
  surface.struct_size = sizeof surface;
  surface.vertex_count = vertices;
  surface.triangle_count = triangles.size() / 3;
  surface.triangles = triangles.data();
  surface.tetrahedron_count = tetrahedra.size() / 4;
  surface.tetrahedra = tetrahedra.data();
  return surface;
}

TEST(ConnectedPieces, AreNumberedByTheirFirstVertices) {
  const std::vector<std::uint32_t> triangles = {7, 5, 6, 0, 3, 1, 8, 7, 4};
  const Pieces pieces = connected_pieces(surface_of(9, triangles));
  EXPECT_EQ(pieces.count, 2);
  EXPECT_THAT(pieces.of_vertex, ElementsAre(0, 0, -1, 0, 1, 1, 1, 1, 1)) << "vertex 2 is of no triangle";
}

/// Two shells around one inside: the tetrahedra between them connect what triangles do not.
TEST(ConnectedPieces, AreConnectedByTetrahedraToo) {
  const std::vector<std::uint32_t> triangles = {0, 1, 2, 3, 4, 5}, tetrahedra = {2, 6, 7, 8, 8, 3, 7, 6};
  EXPECT_EQ(connected_pieces(surface_of(9, triangles)).count, 2);
  EXPECT_EQ(connected_pieces(surface_of(9, triangles, tetrahedra)).count, 1);
}

TEST(ConnectedPieces, AreThoseThePluginGives) {
  const std::vector<std::uint32_t> triangles = {0, 1, 2, 3, 4, 5}, piece = {2, 2, 2, 0, 0, 1};
  cleave_surface surface = surface_of(6, triangles);
  surface.piece = piece.data();
  EXPECT_EQ(connected_pieces(surface).count, 3);
  EXPECT_THAT(connected_pieces(surface).of_vertex, ElementsAre(2, 2, 2, 0, 0, 1));
}

}  // namespace
}  // namespace cleave::discretization
