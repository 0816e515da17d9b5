/// Bodies for discretisations, and what a host does with them: steps, colliders, handles, checkpoints.
#ifndef CLEAVE_TESTKIT_BODY_HPP
#define CLEAVE_TESTKIT_BODY_HPP

#include <cleave/discretization.h>
#include <cleave/testkit/context.hpp>
#include <cleave/testkit/lent.hpp>
#include <cleave/testkit/plugin.hpp>

#include <array>
#include <functional>
#include <map>
#include <memory>
#include <string>
#include <vector>

namespace cleave::testkit {

using Point = std::array<double, 3>;

/// A cube of cells, with points and in one of two forms a mesh of tetrahedra.
struct Body {
  std::string name;
  int cells = 0;       ///< along each edge
  double edge = 0.01;  ///< of a cell, m
  Point corner{};
  std::vector<double> position, velocity, volume, vertices;
  std::vector<std::uint32_t> tetrahedra;
  std::vector<double> vertex_velocity;  ///< empty: not given
  std::vector<int> depth;               ///< of each point: cells between its cell and the nearest face of the cube
  std::vector<int> cell;                ///< of each point: number of its cell

  std::size_t points() const { return volume.size(); }
  Point point(std::size_t i) const { return {position[3 * i], position[3 * i + 1], position[3 * i + 2]}; }
  Point vertex(std::size_t i) const { return {vertices[3 * i], vertices[3 * i + 1], vertices[3 * i + 2]}; }
  Point centre() const;
  double mass(std::size_t point) const { return density * volume[point]; }
  cleave_body abi() const;
  std::string described() const;

  static constexpr double density = 1000;
};

/// One point in the middle of each cell, no mesh.
Body lattice(int cells, const Point& corner = {0.3, -0.2, 0.5});
/// Six tetrahedra in each cell (Kuhn), points at their barycentres.
Body tetrahedra(int cells, const Point& corner = {0.3, -0.2, 0.5});

/// The form of bodies a discretisation takes: the lattice unless it refuses that or says that it needs tetrahedra. Throws
/// Skipped if it refuses both.
class Form {
 public:
  Form(Context&, const Settings&);
  bool mesh() const { return mesh_; }
  /// A lattice of so many cells, or tetrahedra in fewer ones.
  Body body(int lattice_cells, int mesh_cells, const Point& corner = {0.3, -0.2, 0.5}) const;

 private:
  bool mesh_;
};

struct PointValues {
  int components = 0;
  std::string unit;
  std::vector<double> values;
  bool operator==(const PointValues&) const;  ///< bit by bit
};
using Fields = std::map<std::string, PointValues>;

/// What a handle asks of a point or vertex: where it is at the end of the step, and how fast.
struct Motion {
  Point position{}, velocity{};
};

/// An instance with its bodies and what surrounds them.
class Scene {
 public:
  Scene(Context&, const Settings&);
  Scene(const Scene&) = delete;
  Scene& operator=(const Scene&) = delete;

  /// Throws Failed with the plugin's words if it refuses.
  void add(const Body&);
  /// CLEAVE_OK, or the result with its words in `words`.
  cleave_result try_add(const Body&, std::string* words);
  /// A body as it is handed over, with an elastic law where the discretisation evaluates one; valid as long as `body`.
  cleave_body lent(const Body& body);
  /// The laws that the bodies have got, in order; null where the discretisation evaluates none.
  LentElasticity* elasticity(std::size_t body) const { return laws_.at(body).get(); }
  double stiffness = 1;  ///< of the laws of bodies added from here on
  /// Of bodies added, and steps taken, from here on; none if null.
  const LentThreads* threads = nullptr;

  Point gravity{};
  /// Replaces a velocity by what the colliders allow there; none if empty.
  std::function<void(const Point& position, Point& velocity)> collider;
  /// The motion of what rests at this place of a body; returns false if it is free. None is held if empty.
  std::function<bool(std::size_t body, const Point& rest, Motion&)> handle;

  /// Throws Skipped if it is no number a step can have, which `discretization.stable-step` reports.
  double stable_step();
  double told_step() const { return table().stable_step(instance_.handle()); }
  void step(double time_step);
  /// Throws Skipped if a field of points is missing, which `discretization.fields` reports.
  Fields fields(std::size_t body = 0) const;
  std::vector<double> position(std::size_t body = 0) const { return fields(body).at("position").values; }
  std::vector<double> velocity(std::size_t body = 0) const { return fields(body).at("velocity").values; }

  std::vector<unsigned char> save() const;
  void restore(const std::vector<unsigned char>&);

  const cleave_discretization& table() const {
    return *static_cast<const cleave_discretization*>(instance_.plugin().kind_table());
  }
  cleave_instance* instance() const { return instance_.handle(); }
  const std::vector<Body>& bodies() const { return bodies_; }

 private:
  Context& context_;
  std::vector<std::unique_ptr<LentElasticity>> laws_;  // outlive the instance
  Instance instance_;
  std::vector<Body> bodies_;
};

}  // namespace cleave::testkit

#endif
