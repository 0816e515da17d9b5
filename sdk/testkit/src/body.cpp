#include <cleave/testkit/body.hpp>

#include <algorithm>
#include <cmath>
#include <cstring>

namespace cleave::testkit {
namespace {

Body cube(int cells, const Point& corner) {
  Body body;
  body.name = "cube";
  body.cells = cells;
  body.corner = corner;
  return body;
}

void add_point(Body& body, const Point& x, double volume, int i, int j, int k) {
  const int last = body.cells - 1;
  body.position.insert(body.position.end(), x.begin(), x.end());
  body.velocity.insert(body.velocity.end(), 3, 0.0);
  body.volume.push_back(volume);
  body.depth.push_back(std::min({i, j, k, last - i, last - j, last - k}));
  body.cell.push_back((i * body.cells + j) * body.cells + k);
}

template <class Visit>
void for_cells(int cells, Visit visit) {
  for (int i = 0; i < cells; ++i)
    for (int j = 0; j < cells; ++j)
      for (int k = 0; k < cells; ++k) visit(i, j, k);
}

/// What the host offers to a step, and arguments that make no sense.
struct Surroundings {
  const Scene& scene;
  std::string wrong;

  static void collide(void* user, std::uint64_t count, const double* position, double* velocity) {
    auto& self = *static_cast<Surroundings*>(user);
    for (std::uint64_t i = 0; self.scene.collider && i < count; ++i) {
      Point v = {velocity[3 * i], velocity[3 * i + 1], velocity[3 * i + 2]};
      self.scene.collider({position[3 * i], position[3 * i + 1], position[3 * i + 2]}, v);
      std::copy(v.begin(), v.end(), velocity + 3 * i);
    }
  }
  static std::int32_t handle(void* user, std::uint64_t body, std::uint32_t entity, std::uint64_t index, double* position,
                             double* velocity) {
    auto& self = *static_cast<Surroundings*>(user);
    const auto& bodies = self.scene.bodies();
    if (body >= bodies.size() || entity > CLEAVE_VERTEX ||
        index >= (entity == CLEAVE_POINT ? bodies[body].points() : bodies[body].vertices.size() / 3)) {
      self.wrong = "asks for the handle of entity " + std::to_string(entity) + " number " + std::to_string(index) +
                   " of body " + std::to_string(body) + ", which does not exist";
      return 0;
    }
    Motion motion;
    if (!self.scene.handle) return 0;
    const Point rest = entity == CLEAVE_POINT ? bodies[body].point(index) : bodies[body].vertex(index);
    if (!self.scene.handle(body, rest, motion)) return 0;
    std::copy(motion.position.begin(), motion.position.end(), position);
    std::copy(motion.velocity.begin(), motion.velocity.end(), velocity);
    return 1;
  }
};

}  // namespace

Point Body::centre() const {
  const double half = 0.5 * cells * edge;
  return {corner[0] + half, corner[1] + half, corner[2] + half};
}

cleave_body Body::abi() const {
  const auto data = [](const auto& values) { return values.empty() ? nullptr : values.data(); };
  const double spacing = points() ? std::cbrt(std::pow(cells * edge, 3) / double(points())) : edge;
  cleave_body body{};
  body.struct_size = sizeof body;
  body.dimension = 3;
  body.name = name.c_str();
  body.density = density;
  body.spacing = spacing;
  body.point_count = points();
  body.position = data(position);
  body.velocity = data(velocity);
  body.volume = data(volume);
  body.vertex_count = vertices.size() / 3;
  body.vertices = data(vertices);
  body.tetrahedron_count = tetrahedra.size() / 4;
  body.tetrahedra = data(tetrahedra);
  body.vertex_velocity = data(vertex_velocity);
  return body;
}

std::string Body::described() const {
  const std::string n = std::to_string(cells);
  return (tetrahedra.empty() ? "a lattice of " + n + "x" + n + "x" + n + " points"
                             : "a cube of " + std::to_string(points()) + " tetrahedra") +
         (points() ? "" : " without points");
}

Body lattice(int cells, const Point& corner) {
  Body body = cube(cells, corner);
  for_cells(cells, [&](int i, int j, int k) {
    const double e = body.edge;
    add_point(body, {corner[0] + (i + 0.5) * e, corner[1] + (j + 0.5) * e, corner[2] + (k + 0.5) * e}, e * e * e, i, j, k);
  });
  return body;
}

Body tetrahedra(int cells, const Point& corner) {
  Body body = cube(cells, corner);
  const int n = cells + 1;
  const double e = body.edge;
  for (int i = 0; i < n; ++i)
    for (int j = 0; j < n; ++j)
      for (int k = 0; k < n; ++k) {
        const Point x = {corner[0] + i * e, corner[1] + j * e, corner[2] + k * e};
        body.vertices.insert(body.vertices.end(), x.begin(), x.end());
      }
  // A path from one corner of the cell to the opposite one for each order of the axes; odd orders turn it inside out.
  constexpr int orders[6][3] = {{0, 1, 2}, {1, 2, 0}, {2, 0, 1}, {0, 2, 1}, {2, 1, 0}, {1, 0, 2}};
  for_cells(cells, [&](int i, int j, int k) {
    for (int o = 0; o < 6; ++o) {
      int at[3] = {i, j, k};
      std::uint32_t corners[4];
      Point barycentre{};
      for (int c = 0; c < 4; ++c) {
        if (c > 0) ++at[orders[o][c - 1]];
        corners[c] = std::uint32_t((at[0] * n + at[1]) * n + at[2]);
        for (std::size_t a = 0; a < 3; ++a) barycentre[a] += 0.25 * (corner[a] + at[a] * e);
      }
      if (o >= 3) std::swap(corners[2], corners[3]);
      body.tetrahedra.insert(body.tetrahedra.end(), corners, corners + 4);
      add_point(body, barycentre, e * e * e / 6, i, j, k);
    }
  });
  return body;
}

Form::Form(Context& context, const Settings& settings) {
  const auto takes = [&](const Body& body, std::string* words) {
    Scene scene(context, settings);
    context.doing("given " + body.described());
    return scene.try_add(body, words) == CLEAVE_OK;
  };
  std::string no_points, no_mesh;
  const bool needs_mesh = context.plugin().can(CLEAVE_NEEDS_TETRAHEDRA);
  mesh_ = needs_mesh || !takes(lattice(4), &no_points);
  if (mesh_ && !takes(tetrahedra(3), &no_mesh))
    context.skip("takes neither a lattice of points (" + (needs_mesh ? "it needs tetrahedra" : no_points) +
                 ") nor a cube of tetrahedra (" + no_mesh + "), see discretization.bodies");
  context.remark(needs_mesh ? "with cubes of tetrahedra"
                 : mesh_    ? "with cubes of tetrahedra, for it refuses lattices of points: " + no_points
                            : "with lattices of points");
}

Body Form::body(int lattice_cells, int mesh_cells, const Point& corner) const {
  return mesh_ ? tetrahedra(mesh_cells, corner) : lattice(lattice_cells, corner);
}

bool PointValues::operator==(const PointValues& other) const {
  return components == other.components && unit == other.unit && values.size() == other.values.size() &&
         (values.empty() || std::memcmp(values.data(), other.values.data(), values.size() * sizeof(double)) == 0);
}

Scene::Scene(Context& context, const Settings& settings) : context_(context), instance_(context.plugin(), settings) {}

void Scene::add(const Body& body) {
  std::string words;
  context_.doing("given " + body.described());
  const cleave_result result = try_add(body, &words);
  if (result != CLEAVE_OK)
    throw Failed{"add_body() refuses " + body.described() + " with result " + std::to_string(result) + ": " + words};
}

cleave_body Scene::lent(const Body& body) {
  cleave_body given = body.abi();
  laws_.push_back(context_.plugin().can(CLEAVE_NEEDS_ELASTICITY) ? std::make_unique<LentElasticity>(body.points()) : nullptr);
  if (laws_.back()) {
    laws_.back()->stiffness = stiffness;
    given.elasticity = laws_.back()->get();
  }
  if (threads) given.threads = threads->get();
  return given;
}

cleave_result Scene::try_add(const Body& body, std::string* words) {
  Words said;
  const cleave_body given = lent(body);
  const cleave_result result = table().add_body(instance_.handle(), &given, &said.message);
  if (result == CLEAVE_OK)
    bodies_.push_back(body);
  else
    laws_.pop_back();
  if (words) *words = said.said();
  return result;
}

double Scene::stable_step() {
  const double step = told_step();
  if (!(step > 0) || !std::isfinite(step)) throw Skipped{"it tells no step, see discretization.stable-step"};
  return step;
}

void Scene::step(double time_step) {
  Surroundings user{*this, ""};
  const cleave_surroundings surroundings{sizeof surroundings,
                                         0,
                                         {gravity[0], gravity[1], gravity[2]},
                                         &user,
                                         &Surroundings::collide,
                                         &Surroundings::handle,
                                         threads ? threads->get() : nullptr};
  Words words;
  const cleave_result result = table().step(instance_.handle(), time_step, &surroundings, &words.message);
  if (result != CLEAVE_OK) throw Failed{"step() fails with result " + std::to_string(result) + ": " + words.said()};
  if (!user.wrong.empty()) throw Failed{user.wrong};
  if (threads && !threads->misuse().empty()) throw Failed{threads->misuse()};
}

Fields Scene::fields(std::size_t body) const {
  Fields all;
  cleave_point_field field{};
  field.struct_size = sizeof field;
  const std::uint32_t count = table().point_field(instance_.handle(), body, 0, &field);
  for (std::uint32_t i = 0; i < count; ++i) {
    field = {};
    field.struct_size = sizeof field;
    table().point_field(instance_.handle(), body, i, &field);
    const std::size_t size = field.components * bodies_.at(body).points();
    if (!field.name || !field.unit || field.components > 9 || (size && !field.values))
      throw Skipped{"its fields are not complete, see discretization.fields"};
    PointValues values{int(field.components), field.unit, {}};
    if (size) values.values.assign(field.values, field.values + size);
    all[field.name] = values;
  }
  for (const char* name : {"position", "velocity"})
    if (!all.contains(name) || all.at(name).components != 3)
      throw Skipped{std::string("it gives no ") + name + " of points, see discretization.fields"};
  return all;
}

std::vector<unsigned char> Scene::save() const {
  const std::uint64_t size = table().save(instance_.handle(), nullptr, 0);
  // What is written beyond the size does no harm here; `discretization.checkpoint` looks for it.
  std::vector<unsigned char> bytes(size + 64);
  const std::uint64_t written = table().save(instance_.handle(), bytes.data(), size);
  if (written != size) throw Failed{"save() says " + std::to_string(size) + " bytes and writes " + std::to_string(written)};
  bytes.resize(size);
  return bytes;
}

void Scene::restore(const std::vector<unsigned char>& bytes) {
  Words words;
  const cleave_result result = table().restore(instance_.handle(), bytes.data(), bytes.size(), &words.message);
  if (result != CLEAVE_OK)
    throw Failed{"restore() refuses what save() wrote, with result " + std::to_string(result) + ": " + words.said()};
}

}  // namespace cleave::testkit
