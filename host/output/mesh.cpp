#include "output/mesh.hpp"

#include "output/atomic_file.hpp"
#include "output/names.hpp"
#include "output/number.hpp"
#include "output/vtk_xml.hpp"

#include <algorithm>
#include <charconv>

namespace cleave::output {
namespace {

/// All meshes of a frame as one.
class Meshes {
 public:
  explicit Meshes(const ParticleFrame& frame) : frame_(frame) {
    for (const BodyMesh& mesh : frame.meshes) {
      first_vertex_.push_back(vertices_);
      first_piece_.push_back(pieces_);
      vertices_ += mesh.vertex_count();
      triangles_ += mesh.triangles.size() / 3;
      tetrahedra_ += mesh.tetrahedra.size() / 4;
      pieces_ += mesh.pieces;
      has_velocity_ = has_velocity_ || !mesh.velocity.empty();
      has_damage_ = has_damage_ || !mesh.damage.empty();
    }
  }
  std::size_t vertices() const { return vertices_; }
  std::size_t triangles() const { return triangles_; }
  std::size_t tetrahedra() const { return tetrahedra_; }
  bool has_velocity() const { return has_velocity_; }
  bool has_damage() const { return has_damage_; }

  struct Vertex {
    const double* position;
    const float* velocity;
    float damage;
    std::int32_t piece, body;
  };
  template <class Each>
  void for_vertices(const Each& each) const {
    static constexpr float none[3] = {};
    for (std::size_t m = 0; m < frame_.meshes.size(); m++) {
      const BodyMesh& mesh = frame_.meshes[m];
      for (std::size_t i = 0; i < mesh.vertex_count(); i++)
        each(Vertex{mesh.vertices.data() + 3 * i, mesh.velocity.empty() ? none : mesh.velocity.data() + 3 * i,
                    mesh.damage.empty() ? 0.f : mesh.damage[i],
                    mesh.piece[i] < 0 ? mesh.piece[i] : mesh.piece[i] + std::int32_t(first_piece_[m]), mesh.body});
    }
  }
  /// each(corners, body) with the numbers of the vertices in the whole.
  template <std::size_t Corners, class Each>
  void for_cells(std::vector<std::uint32_t> BodyMesh::*cells, const Each& each) const {
    for (std::size_t m = 0; m < frame_.meshes.size(); m++) {
      const auto& list = frame_.meshes[m].*cells;
      for (std::size_t c = 0; c + Corners <= list.size(); c += Corners) {
        std::array<std::int64_t, Corners> corners;
        for (std::size_t k = 0; k < Corners; k++) corners[k] = std::int64_t(first_vertex_[m] + list[c + k]);
        each(corners, frame_.meshes[m].body);
      }
    }
  }
  std::size_t first_vertex(std::size_t mesh) const { return first_vertex_[mesh]; }

 private:
  const ParticleFrame& frame_;
  std::vector<std::size_t> first_vertex_, first_piece_;
  std::size_t vertices_ = 0, triangles_ = 0, tetrahedra_ = 0, pieces_ = 0;
  bool has_velocity_ = false, has_damage_ = false;
};

std::string one_line(std::string text) {
  std::replace_if(
      text.begin(), text.end(), [](char c) { return static_cast<unsigned char>(c) < 0x20; }, ' ');
  return text;
}

/// Values of one kind per vertex, in order.
template <class T, std::size_t Width, class Value>
void write_vertex_array(std::ostream& out, const char* name, const Meshes& meshes, const Value& value) {
  std::vector<T> all;
  all.reserve(Width * meshes.vertices());
  meshes.for_vertices([&](const Meshes::Vertex& v) { value(v, all); });
  vtk::write_array<T>(out, name, component_suffixes(int(Width)), meshes.vertices(),
                      [&](std::size_t i, T* values) { std::copy_n(all.data() + Width * i, Width, values); });
}

void write_vtk_points(std::ostream& out, const Meshes& meshes) {
  out << "<PointData>\n";
  if (meshes.has_velocity())
    write_vertex_array<float, 3>(out, "velocity", meshes,
                                 [](const auto& v, auto& all) { all.insert(all.end(), v.velocity, v.velocity + 3); });
  if (meshes.has_damage())
    write_vertex_array<float, 1>(out, "damage", meshes, [](const auto& v, auto& all) { all.push_back(v.damage); });
  write_vertex_array<std::int32_t, 1>(out, "piece", meshes, [](const auto& v, auto& all) { all.push_back(v.piece); });
  write_vertex_array<std::int32_t, 1>(out, "body", meshes, [](const auto& v, auto& all) { all.push_back(v.body); });
  out << "</PointData>\n<Points>\n";
  write_vertex_array<double, 3>(out, "Points", meshes,
                                [](const auto& v, auto& all) { all.insert(all.end(), v.position, v.position + 3); });
  out << "</Points>\n";
}

template <std::size_t Corners>
void write_vtk_cells(std::ostream& out, const Meshes& meshes, std::vector<std::uint32_t> BodyMesh::*cells, std::size_t count) {
  const std::vector<std::string> scalar{""};
  std::vector<std::int64_t> corners;
  corners.reserve(Corners * count);
  meshes.for_cells<Corners>(cells,
                            [&](const auto& cell, std::int32_t) { corners.insert(corners.end(), cell.begin(), cell.end()); });
  vtk::write_array<std::int64_t>(out, "connectivity", scalar, corners.size(),
                                 [&](std::size_t i, std::int64_t* value) { *value = corners[i]; });
  vtk::write_array<std::int64_t>(out, "offsets", scalar, count, [](std::size_t i, std::int64_t* value) {
    *value = static_cast<std::int64_t>(Corners * (i + 1));
  });
}

}  // namespace

void write_mesh_ply(const std::filesystem::path& path, const ParticleFrame& frame) {
  const Meshes meshes(frame);
  AtomicFile file(path);
  std::ostream& out = file.stream();
  out << "ply\nformat binary_little_endian 1.0\ncomment time " << number(frame.time) << " s\ncomment frame " << frame.index
      << "\n";
  for (const BodyMesh& mesh : frame.meshes)
    out << "comment body " << mesh.body << ' ' << one_line(frame.bodies[std::size_t(mesh.body)]) << '\n';
  out << "element vertex " << meshes.vertices() << "\nproperty float x\nproperty float y\nproperty float z\n";
  if (meshes.has_velocity()) out << "property float vx\nproperty float vy\nproperty float vz\n";
  if (meshes.has_damage()) out << "property float damage\n";
  out << "property int piece\nproperty int body\nelement face " << meshes.triangles()
      << "\nproperty list uchar int vertex_indices\nend_header\n";
  const auto put = [&out](const auto& value) { out.write(reinterpret_cast<const char*>(&value), sizeof value); };
  meshes.for_vertices([&](const Meshes::Vertex& v) {
    for (int a = 0; a < 3; a++) put(float(v.position[a]));
    for (int a = 0; meshes.has_velocity() && a < 3; a++) put(v.velocity[a]);
    if (meshes.has_damage()) put(v.damage);
    put(v.piece);
    put(v.body);
  });
  meshes.for_cells<3>(&BodyMesh::triangles, [&](const auto& triangle, std::int32_t) {
    put(std::uint8_t(3));
    for (const std::int64_t corner : triangle) put(std::int32_t(corner));
  });
  file.commit();
}

void write_mesh_obj(const std::filesystem::path& path, const ParticleFrame& frame) {
  const Meshes meshes(frame);
  AtomicFile file(path);
  std::ostream& out = file.stream();
  const auto put = [&out](const auto& value) {
    char text[32];
    out.put(' ').write(text, std::to_chars(text, text + sizeof text, value).ptr - text);
  };
  out << "# time " << number(frame.time) << " s, frame " << frame.index << "\n";
  UniqueNames unique;
  for (std::size_t m = 0; m < frame.meshes.size(); m++) {
    const BodyMesh& mesh = frame.meshes[m];
    const std::string name = unique.add(frame.bodies[std::size_t(mesh.body)]);
    out << "o " << name << "\n";
    for (std::size_t i = 0; i < mesh.vertex_count(); i++) {
      out << 'v';
      for (std::size_t a = 0; a < 3; a++) put(float(mesh.vertices[3 * i + a]));
      out << "\n";
    }
    std::vector<std::size_t> order(mesh.triangles.size() / 3);
    for (std::size_t t = 0; t < order.size(); t++) order[t] = t;
    const auto piece = [&](std::size_t t) { return mesh.piece[mesh.triangles[3 * t]]; };
    std::stable_sort(order.begin(), order.end(), [&](std::size_t a, std::size_t b) { return piece(a) < piece(b); });
    for (std::size_t n = 0; n < order.size(); n++) {
      const std::size_t t = order[n];
      if (n == 0 || piece(t) != piece(order[n - 1])) out << "g " << name << '_' << piece(t) << "\n";
      out << 'f';
      for (std::size_t k = 0; k < 3; k++) put(std::uint64_t(meshes.first_vertex(m) + mesh.triangles[3 * t + k] + 1));
      out << "\n";
    }
  }
  file.commit();
}

void write_mesh_vtp(const std::filesystem::path& path, const ParticleFrame& frame) {
  const Meshes meshes(frame);
  AtomicFile file(path);
  std::ostream& out = file.stream();
  vtk::write_start(out, "PolyData", frame);
  out << "<Piece NumberOfPoints=\"" << meshes.vertices()
      << "\" NumberOfVerts=\"0\" NumberOfLines=\"0\" NumberOfStrips=\"0\" NumberOfPolys=\"" << meshes.triangles() << "\">\n";
  write_vtk_points(out, meshes);
  out << "<Polys>\n";
  write_vtk_cells<3>(out, meshes, &BodyMesh::triangles, meshes.triangles());
  out << "</Polys>\n";
  vtk::write_end(out, "PolyData");
  file.commit();
}

void write_mesh_vtu(const std::filesystem::path& path, const ParticleFrame& frame) {
  constexpr std::uint8_t tetrahedron = 10;  // VTK_TETRA
  const Meshes meshes(frame);
  AtomicFile file(path);
  std::ostream& out = file.stream();
  vtk::write_start(out, "UnstructuredGrid", frame);
  out << "<Piece NumberOfPoints=\"" << meshes.vertices() << "\" NumberOfCells=\"" << meshes.tetrahedra() << "\">\n";
  write_vtk_points(out, meshes);
  out << "<Cells>\n";
  write_vtk_cells<4>(out, meshes, &BodyMesh::tetrahedra, meshes.tetrahedra());
  vtk::write_array<std::uint8_t>(out, "types", {""}, meshes.tetrahedra(),
                                 [](std::size_t, std::uint8_t* value) { *value = tetrahedron; });
  out << "</Cells>\n";
  vtk::write_end(out, "UnstructuredGrid");
  file.commit();
}

}  // namespace cleave::output
