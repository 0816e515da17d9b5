// Bodies of finite elements in explicit steps: what is kept, what is stable, what they look like.
#include "specimen.hpp"

#include <algorithm>
#include <set>

namespace cleave::test {
namespace {

const NeoHookean rubber(1e5, 0.3);

/// Vertices inside moved at random by this part of a cell.
Tets jittered(Tets tets, double part, double cell, const std::function<bool(const Point&)>& inside) {
  unsigned seed = 7;
  for (std::size_t v = 0; v < tets.size(); ++v)
    for (std::size_t a = 0; a < 3; ++a) {
      seed = seed * 1664525u + 1013904223u;
      if (inside(tets.at(v))) tets.vertices[3 * v + a] += part * cell * (2.0 * (seed >> 8) / (1u << 24) - 1);
    }
  return tets;
}
Tets jittered_cube(int n, double cell = 0.01) {
  return jittered(Tets::box(n, n, n, {cell, cell, cell}), 0.2, cell, [&](const Point& x) {
    return std::all_of(x.begin(), x.end(), [&](double c) { return c > 0.5 * cell && c < (n - 0.5) * cell; });
  });
}

TEST(FiniteElements, KeepMomentum) {
  Tets cube = jittered_cube(4);
  Specimen solid;
  const double step = Specimen().add(cube, &rubber).stable_step();
  solid.add(cube.shake(0.05 * 0.01 / step), &rubber);
  const auto mass = cube.masses();
  const Momentum before = momentum(mass, cube.vertices, cube.velocity);
  solid.step(0.5 * step, 200);
  const Momentum after = momentum(mass, solid.vertices(), solid.vertex_velocity());
  for (std::size_t a = 0; a < 3; ++a) {
    EXPECT_NEAR(after.linear[a], before.linear[a], 1e-14 * before.size);
    EXPECT_NEAR(after.angular[a], before.angular[a], 1e-13 * before.angular_size);
  }
}

TEST(FiniteElements, MoveRigidlyWithoutStress) {
  // 40 degrees about (1, 2, 3) far from the origin.
  Tets cube = jittered_cube(3);
  for (std::size_t v = 0; v < cube.size(); ++v) cube.vertices[3 * v] += 5;
  Specimen solid;
  solid.add(cube, &rubber);
  solid.handle = [](const Point& rest, Point& x, Point& v) {
    const double angle = 0.7, norm = std::sqrt(14.0);
    const Point n = {1 / norm, 2 / norm, 3 / norm}, r = {rest[0] - 5, rest[1], rest[2]};
    const double along = n[0] * r[0] + n[1] * r[1] + n[2] * r[2];
    for (std::size_t a = 0; a < 3; ++a) {
      const std::size_t b = (a + 1) % 3, c = (a + 2) % 3;
      x[a] = rest[a] - r[a] + std::cos(angle) * r[a] + std::sin(angle) * (n[b] * r[c] - n[c] * r[b]) +
             (1 - std::cos(angle)) * along * n[a];
    }
    v = {};
    return true;
  };
  const double step = 0.5 * solid.stable_step();
  solid.step(step);
  solid.handle = nullptr;
  solid.step(step, 10);
  // A strain of 1e-4 moves vertices at 1e-4 c.
  const double sound = std::sqrt(rubber.lambda + 2 * rubber.mu) / std::sqrt(cube.density);
  for (const double v : solid.vertex_velocity()) EXPECT_NEAR(v, 0, 1e-11 * sound);
}

/// The highest frequency of small vibrations [1/s]: by power iteration with M^-1 K, which two short steps from rest apply.
double highest_frequency(const Tets& rest, const Law& law) {
  Tets body = rest;
  const double step = 1e-9;
  body.shake(1);
  double square = 0;
  for (int n = 0; n < 150; ++n) {
    double size = 0;
    for (const double v : body.velocity) size = std::max(size, std::abs(v));
    for (double& v : body.velocity) v *= 1e-7 * 0.01 / step / size;
    const auto after = Specimen().add(body, &law).step(step, 2).vertex_velocity();
    double most = 0, before = 0;
    for (std::size_t k = 0; k < after.size(); ++k) {
      const double pulled = (body.velocity[k] - after[k]) / (step * step);
      before += body.velocity[k] * body.velocity[k];
      most += pulled * pulled;
      body.velocity[k] = pulled * step * step;
    }
    square = std::sqrt(most / before);
  }
  return std::sqrt(square);
}

TEST(FiniteElements, TellAStepBelowTheLimitOfStability) {
  for (const double nu : {0.0, 0.3, 0.45}) {
    const NeoHookean law(1e5, nu);
    for (const Tets& body : {jittered_cube(3), Tets::box(1, 1, 1, {0.01, 0.002, 0.03})}) {
      const double limit = 2 / highest_frequency(body, law), told = Specimen().add(body, &law).stable_step();
      RecordProperty("over_limit_" + std::to_string(int(100 * nu)) + "_" + std::to_string(body.points()),
                     std::to_string(told / limit));
      EXPECT_LT(told, limit) << nu;
      EXPECT_GT(told, 0.3 * limit) << nu;
    }
  }
}

TEST(FiniteElements, StayStableAtTheStepTheyTell) {
  Tets cube = jittered_cube(3);
  const double step = Specimen().add(cube, &rubber).stable_step();
  cube.shake(1e-3 * 0.01 / step);
  const double before = kinetic_energy(cube.masses(), cube.velocity);
  Specimen solid;
  solid.add(cube, &rubber).step(step, 3000);
  const double after = kinetic_energy(cube.masses(), solid.vertex_velocity()) + solid.elastic_energy();
  EXPECT_NEAR(after / before, 1, 0.5);
}

TEST(FiniteElements, ComputeTheSameBitsWithAnyNumberOfThreads) {
  for (const char* integrator : {"symplectic-euler", "implicit"}) {
    const auto state = [&](unsigned threads) {
      Tets cube = jittered_cube(5);
      Specimen solid(Texts{{"integrator", integrator}});
      const double step = Specimen().add(cube, &rubber).stable_step();
      solid.add(cube.shake(0.02 * 0.01 / step), &rubber);
      solid.threads = threads;
      return solid.step(step, 3).save();
    };
    EXPECT_EQ(state(1), state(3)) << integrator;
  }
}

TEST(FiniteElements, GoOnFromASavedStateWithTheSameBits) {
  for (const char* integrator : {"symplectic-euler", "implicit"}) {
    Tets cube = jittered_cube(3);
    const double step = Specimen().add(cube, &rubber).stable_step();
    cube.shake(0.05 * 0.01 / step);
    Specimen solid(Texts{{"integrator", integrator}}), fresh(Texts{{"integrator", integrator}});
    solid.add(cube, &rubber).add(Tets::box(1, 2, 1, {0.01, 0.01, 0.01}), &rubber);
    fresh.add(cube, &rubber).add(Tets::box(1, 2, 1, {0.01, 0.01, 0.01}), &rubber);
    const auto state = solid.step(step, 5).save();
    const auto expected = solid.step(step, 5).save();
    fresh.restore(state);
    EXPECT_EQ(fresh.step(step, 5).save(), expected) << integrator;
    auto broken = state;
    broken[broken.size() / 2] ^= 1;
    EXPECT_THROW(fresh.restore(broken), std::runtime_error);
    EXPECT_THROW(fresh.restore({}), std::runtime_error);
  }
}

TEST(FiniteElements, AreSlowedByMassDamping) {
  Tets cube = Tets::box(2, 2, 2, {0.01, 0.01, 0.01});
  for (double& v : cube.velocity) v = 1e-3;
  for (const char* integrator : {"symplectic-euler", "implicit"}) {
    Specimen solid(Texts{{"integrator", integrator}, {"mass_damping", "50"}});
    const double step = Specimen().add(cube, &rubber).stable_step();
    for (const double v : solid.add(cube, &rubber).step(step, 10).vertex_velocity())
      EXPECT_NEAR(v, 1e-3 * std::pow(1 + 50 * step, -10), 1e-9) << integrator;
  }
}

TEST(FiniteElements, ShowASurfaceThatIsClosedPieceByPiece) {
  Tets body = jittered_cube(3);
  const Tets other = Tets::box(2, 1, 1, {0.01, 0.01, 0.01}, {0.05, 0, 0});
  const auto first = std::uint32_t(body.size());
  body.vertices.insert(body.vertices.end(), other.vertices.begin(), other.vertices.end());
  body.velocity.resize(body.vertices.size());
  for (const std::uint32_t v : other.tetrahedra) body.tetrahedra.push_back(first + v);
  Specimen solid;
  solid.add(body, &rubber);
  const auto surface = solid.surface();
  ASSERT_EQ(surface.tetrahedron_count, body.points());
  std::set<std::pair<std::uint32_t, std::uint32_t>> edges;
  double volume[2] = {};
  for (std::size_t t = 0; t < surface.triangle_count; ++t) {
    const std::uint32_t* c = surface.triangles + 3 * t;
    Tensor corners;
    for (int k = 0; k < 3; ++k) {
      EXPECT_TRUE(edges.emplace(c[k], c[(k + 1) % 3]).second) << "two triangles go the same way along an edge";
      for (int a = 0; a < 3; ++a) corners(a, k) = surface.vertices[3 * c[k] + unsigned(a)];
    }
    volume[surface.piece[c[0]]] += determinant(corners) / 6;
  }
  for (const auto& [a, b] : edges) EXPECT_TRUE(edges.contains({b, a})) << "an edge of one triangle alone";
  EXPECT_NEAR(volume[0], 27e-6, 1e-18);
  EXPECT_NEAR(volume[1], 2e-6, 1e-18);
}

TEST(FiniteElements, StandOnAFloor) {
  Tets cube = Tets::box(2, 2, 2, {0.01, 0.01, 0.01}, {0, 0, 0.005});
  Specimen solid(Texts{{"mass_damping", "30"}});
  solid.add(cube, &rubber);
  solid.gravity = {0, 0, -10};
  solid.collider = [](const Point& x, Point& v) {
    if (x[2] < 0) v[2] = std::max(v[2], 0.0);
  };
  const double step = solid.stable_step();
  double lowest = 1, fastest = 0;
  solid.step(step, int(1 / step));
  const auto x = solid.vertices(), v = solid.vertex_velocity();
  for (std::size_t k = 2; k < x.size(); k += 3) {
    lowest = std::min(lowest, x[k]);
    fastest = std::max(fastest, std::abs(v[k]));
  }
  EXPECT_NEAR(lowest, 0, 1e-3);
  EXPECT_LT(fastest, 1e-3);
}

TEST(FiniteElements, SayWhatIsWrongWithABody) {
  const auto refused = [](const Tets& tets, const Law* law, const std::string& reason) {
    try {
      Specimen().add(tets, law);
      ADD_FAILURE() << "taken; should say: " << reason;
    } catch (const std::runtime_error& error) {
      EXPECT_NE(std::string(error.what()).find(reason), std::string::npos) << error.what();
    }
  };
  const Tets cell = Tets::box(1, 1, 1, {1, 1, 1});
  Tets wrong = cell;
  std::swap(wrong.tetrahedra[4], wrong.tetrahedra[5]);
  refused(wrong, &rubber, "tetrahedron 1 is inside out");
  wrong = cell;
  for (std::size_t v = 0; v < wrong.size(); ++v) wrong.vertices[3 * v + 2] = 0;
  refused(wrong, &rubber, "tetrahedron 0 is flat");
  wrong = cell;
  wrong.vertices.insert(wrong.vertices.end(), {2, 2, 2});
  refused(wrong, &rubber, "vertex 8 belongs to no tetrahedron");
  wrong = cell;
  for (int copy = 0; copy < 2; ++copy)
    for (int k = 0; k < 4; ++k) wrong.tetrahedra.push_back(wrong.tetrahedra[std::size_t(k)]);
  refused(wrong, &rubber, "share the face of vertices");
  refused(cell, nullptr, "must have an elastic law");
}

TEST(FiniteElements, StartAtRandomPlacesInABox) {
  const SaintVenantKirchhoff law(1e5, 0.3);
  const Tets cube = Tets::box(3, 3, 3, {0.01, 0.01, 0.01});
  const auto start = [&](const char* size, const char* seed) {
    return Specimen(Texts{{"initial_configuration", "random"}, {"initial_size", size}, {"seed", seed}})
        .add(cube, &law)
        .vertices();
  };
  const auto wide = start("2", "1");
  const auto [low, high] = std::minmax_element(wide.begin(), wide.end());
  EXPECT_GT(*low, 0.015 - 0.03);
  EXPECT_LT(*low, 0.015 - 0.025);
  EXPECT_LT(*high, 0.015 + 0.03);
  EXPECT_GT(*high, 0.015 + 0.025);
  EXPECT_EQ(start("2", "1"), wide);
  EXPECT_NE(start("2", "2"), wide);
  for (const double x : start("0", "1")) EXPECT_DOUBLE_EQ(x, 0.015);
}

}  // namespace
}  // namespace cleave::test
