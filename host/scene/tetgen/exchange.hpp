#pragma once

#include <cstdint>
#include <fstream>
#include <string>
#include <vector>

namespace cleave::scene::tetgen {

/// What the program and the process that runs TetGen pass each other, in files: numbers as they lie in memory. Lengths are in
/// multiples of the edge length asked for.

enum Exit : int { done = 0, cannot_exchange = 1, out_of_memory = 2, intersecting = 3, too_close = 4, failed = 5 };

struct Surface {
  std::vector<double> vertices;          ///< 3 per vertex
  std::vector<std::uint32_t> triangles;  ///< 3 vertices each
  double greatest_volume = 0;            ///< of a tetrahedron
};

struct Mesh {
  std::vector<double> vertices;           ///< 3 per vertex
  std::vector<std::uint32_t> tetrahedra;  ///< 4 vertices each
  std::vector<std::uint32_t> region;      ///< that each lies in, numbered from 0 without gaps; surfaces bound regions
};

template <class T>
void put(std::ofstream& file, const std::vector<T>& values) {
  const std::uint64_t count = values.size();
  file.write(reinterpret_cast<const char*>(&count), sizeof count);
  file.write(reinterpret_cast<const char*>(values.data()), std::streamsize(count * sizeof(T)));
}

template <class T>
void get(std::ifstream& file, std::vector<T>& values) {
  std::uint64_t count = 0;
  file.read(reinterpret_cast<char*>(&count), sizeof count);
  values.resize(file ? count : 0);
  file.read(reinterpret_cast<char*>(values.data()), std::streamsize(values.size() * sizeof(T)));
}

}  // namespace cleave::scene::tetgen
