#pragma once

#include "common/types.hpp"

#include <cstdint>
#include <optional>
#include <vector>

namespace cleave::render {

/// A surface. Colours are linear (see to_linear).
struct Triangles {
  std::vector<Eigen::Vector3f> vertices;
  std::vector<Eigen::Vector3f> normals;  ///< 1 per vertex, unit; empty: those of the triangles
  std::vector<Eigen::Vector3f> colors;   ///< 1 per vertex, or 1 for all
  std::vector<std::uint32_t> corners;    ///< 3 per triangle
  float opacity = 1;                     ///< below 1: seen through, and without shadow
};

struct Balls {
  std::vector<Eigen::Vector3f> centers;
  std::vector<float> radii;
  std::vector<Eigen::Vector3f> colors;  ///< 1 per ball
};

/// What a picture is taken of.
struct Stage {
  std::vector<Triangles> surfaces;
  std::vector<Balls> balls;
  struct Ground {
    Vector3 point, normal;
  };
  std::optional<Ground> ground;  ///< an endless floor that fades into the background
  Vector3 up = Vector3::UnitY();
  Vector3 middle = Vector3::Zero();  ///< of what is looked at, and
  double size = 1;                   ///< its radius: shadows and the floor are as wide
  bool flat = false;                 ///< colours alone, without light and shadow
};

}  // namespace cleave::render
