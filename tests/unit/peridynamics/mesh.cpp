// The mesh of tetrahedra around the points: what cracks, splits and stays watertight.
#include "specimen.hpp"

#include <algorithm>
#include <set>

namespace cleave::test {
namespace {

constexpr double step = 1e-9;  // so short that forces have no time to act

using Surface = Specimen::Surface;

/// Volume inside of the triangles of a piece, m^3.
double enclosed(const Surface& s, std::uint32_t piece) {
  double volume = 0;
  for (std::size_t t = 0; t < s.triangles.size(); t += 3) {
    if (s.piece[s.triangles[t]] != piece) continue;
    const double* p[3];
    for (std::size_t a = 0; a < 3; ++a) p[a] = &s.vertices[3 * s.triangles[t + a]];
    for (std::size_t a = 0; a < 3; ++a)
      volume += p[0][a] * (p[1][(a + 1) % 3] * p[2][(a + 2) % 3] - p[1][(a + 2) % 3] * p[2][(a + 1) % 3]) / 6;
  }
  return volume;
}

std::uint32_t pieces(const Surface& s) { return *std::max_element(s.piece.begin(), s.piece.end()) + 1; }

/// Every piece is closed and consistently oriented: as many triangles go along an edge one way as the other. No triangle is
/// there twice, either way round. Each piece encloses what its tetrahedra have. Returns the volume of all pieces.
double walk(const Surface& s, const Points& body) {
  std::map<std::pair<std::uint32_t, std::uint32_t>, int> edges;
  std::set<std::array<std::uint32_t, 3>> faces;
  for (std::size_t t = 0; t < s.triangles.size(); t += 3) {
    std::array<std::uint32_t, 3> face = {s.triangles[t], s.triangles[t + 1], s.triangles[t + 2]};
    for (std::size_t a = 0; a < 3; ++a) {
      EXPECT_NE(face[a], face[(a + 1) % 3]);
      EXPECT_EQ(s.piece[face[a]], s.piece[face[0]]);
      const auto [low, high] = std::minmax(face[a], face[(a + 1) % 3]);
      edges[{low, high}] += face[a] == low ? 1 : -1;
    }
    std::sort(face.begin(), face.end());
    EXPECT_TRUE(faces.insert(face).second) << "a triangle is there twice";
  }
  for (const auto& [edge, balance] : edges) EXPECT_EQ(balance, 0) << "edge " << edge.first << "-" << edge.second << " is open";

  EXPECT_EQ(s.tetrahedra.size(), body.tetrahedra.size());
  std::vector<double> inside(pieces(s));
  for (std::size_t t = 0; t < s.tetrahedra.size(); t += 4) {
    for (std::size_t a = 1; a < 4; ++a) EXPECT_EQ(s.piece[s.tetrahedra[t + a]], s.piece[s.tetrahedra[t]]);
    const double hand = Points::tetrahedron_volume(&body.tetrahedra[t], body.vertices) > 0 ? 1 : -1;
    inside[s.piece[s.tetrahedra[t]]] += hand * Points::tetrahedron_volume(&s.tetrahedra[t], s.vertices);
  }
  double all = 0;
  for (std::uint32_t p = 0; p < inside.size(); ++p) {
    EXPECT_NEAR(enclosed(s, p), inside[p], 1e-9 * body.volume.front() * double(body.size()));
    all += inside[p];
  }
  return all;
}

double total_volume(const Points& body) {
  double sum = 0;
  for (const double v : body.volume) sum += v;
  return sum;
}

Point turned(const Point& x, double angle) {
  const double norm = std::sqrt(14.0);
  const Point n = {1 / norm, 2 / norm, 3 / norm};
  const double along = n[0] * x[0] + n[1] * x[1] + n[2] * x[2];
  Point y;
  for (std::size_t a = 0; a < 3; ++a) {
    const std::size_t b = (a + 1) % 3, c = (a + 2) % 3;
    y[a] = std::cos(angle) * x[a] + std::sin(angle) * (n[b] * x[c] - n[c] * x[b]) + (1 - std::cos(angle)) * along * n[a];
  }
  return y;
}

TEST(EmbeddedMesh, IsThatOfTheBodyUntilItCracks) {
  const Points body = Points::mesh(4, 3, 5);
  const Surface s = Specimen(Texts{{"critical_stretch", "0.1"}}).add(body).surface();
  EXPECT_EQ(s.tetrahedra, body.tetrahedra);
  for (std::size_t k = 0; k < body.vertices.size(); ++k) EXPECT_NEAR(s.vertices[k], body.vertices[k], 1e-12);
  EXPECT_EQ(s.triangles.size() / 3, 2 * 2 * (4 * 3 + 3 * 5 + 5 * 4));
  EXPECT_EQ(pieces(s), 1u);
  EXPECT_NEAR(walk(s, body), total_volume(body), 1e-12 * total_volume(body));
  EXPECT_THROW(Specimen().add(Points::box(3, 3, 3)).surface(), std::runtime_error) << "points alone have no surface";
}

TEST(EmbeddedMesh, TurnsAndStretchesWithItsBody) {
  // Any affine motion is followed exactly, at the surface too; velocities are those of the motion.
  const Points body = Points::mesh(4, 4, 4);
  for (const double stretch : {1.0, 1.3}) {
    const auto map = [&](const Point& x) { return turned({stretch * x[0], x[1], x[2]}, 2.5); };
    Specimen solid;
    solid.add(body);
    const double rate = 7;
    solid.handle = [&](std::size_t, std::size_t i, Point& x, Point& v) {
      x = map(body.at(i));
      for (std::size_t a = 0; a < 3; ++a) v[a] = rate * x[a];
      return true;
    };
    const Surface s = solid.step(step).surface();
    for (std::size_t v = 0; v < body.vertices.size(); v += 3) {
      const Point y = map({body.vertices[v], body.vertices[v + 1], body.vertices[v + 2]});
      for (std::size_t a = 0; a < 3; ++a) {
        EXPECT_NEAR(s.vertices[v + a], y[a], 1e-9 * body.spacing);
        EXPECT_NEAR(s.velocity[v + a], rate * y[a], 1e-9 * body.spacing * rate);
      }
    }
  }
}

TEST(EmbeddedMesh, ComesApartWhereAllBondsAreBroken) {
  // The right half of a bar is taken away: two pieces as they were.
  const Points body = Points::mesh(6, 3, 3);
  Specimen solid(Texts{{"critical_stretch", "0.1"}});
  solid.add(body);
  double gap = 0;
  solid.handle = [&](std::size_t, std::size_t i, Point& x, Point& v) {
    x = body.at(i);
    x[0] += x[0] > 0.03 ? gap : 0;
    v = {};
    return true;
  };
  for (gap = 0; gap < 0.05; gap += 0.005) solid.step(step);
  const Surface s = solid.surface();
  ASSERT_EQ(pieces(s), 2u);
  EXPECT_NEAR(walk(s, body), total_volume(body), 1e-6 * total_volume(body));
  for (std::uint32_t p = 0; p < 2; ++p) EXPECT_NEAR(enclosed(s, p), total_volume(body) / 2, 0.1 * total_volume(body));
  EXPECT_GT(*std::max_element(s.damage.begin(), s.damage.end()), 0.2);
}

TEST(EmbeddedMesh, OpensAlongAnInitialCrack) {
  const Points body = Points::mesh(6, 6, 6);
  const auto with_crack = [&](const std::string& numbers) {
    const Surface s = Specimen(Texts{{"initial_crack", "[" + numbers + "]"}}).add(body).surface();
    EXPECT_NEAR(walk(s, body), total_volume(body), 1e-12 * total_volume(body));
    return s;
  };
  const std::size_t vertices = body.vertices.size() / 3, triangles = 2 * 2 * 3 * 36;
  // Through the body; from its edge to the middle; inside of it; between two points only, so that no vertex is set free.
  const Surface through = with_crack("0.03, -1, -1,  0, 2, 0,  0, 0, 2");
  EXPECT_EQ(pieces(through), 2u);
  const Surface notch = with_crack("0.03, -1, -1,  0, 1.03, 0,  0, 0, 2");
  EXPECT_EQ(pieces(notch), 1u);
  EXPECT_GT(notch.triangles.size() / 3, triangles + 20);
  const Surface penny = with_crack("0.03, 0.015, 0.015,  0, 0.03, 0,  0, 0, 0.03");
  EXPECT_EQ(pieces(penny), 1u);
  EXPECT_GT(penny.vertices.size() / 3, vertices);
  const std::size_t i = body.size() / 2 + 3;
  const Point x = body.at(i);
  const auto text = [](double v) { return std::to_string(v) + ", "; };
  const Surface small = with_crack(text(x[0] - 1e-4) + text(x[1] + 1e-3) + text(x[2] - 1e-4) + "2e-4, 0, 0,  0, 0, 2e-4");
  EXPECT_EQ(small.vertices.size() / 3, vertices);
  EXPECT_EQ(small.triangles.size() / 3, triangles);

  const auto phi = Specimen(Texts{{"initial_crack", "[0.03, -1, -1,  0, 2, 0,  0, 0, 2]"}}).add(body).field("damage");
  for (std::size_t k = 0; k < body.size(); ++k) {
    const double away = std::abs(body.at(k)[0] - 0.03) / body.spacing;
    EXPECT_GT(phi[k], away < 0.2 ? 0.3 : -1);
    EXPECT_LE(phi[k], away > 2 ? 0 : 1);
  }
}

TEST(EmbeddedMesh, StaysWatertightWhileItShatters) {
  const Points rest = Points::mesh(5, 5, 5);
  for (const char* precision : {"single", "double"}) {
    const auto begin = [&] {
      Points body = rest;
      Specimen solid(Texts{{"critical_stretch", "0.02"}, {"precision", precision}});
      const double time_step = 0.3 * Specimen().add(body).stable_step();
      solid.add(body.shake(0.02 * body.spacing / time_step));
      return std::pair(std::move(solid), time_step);
    };
    auto [solid, time_step] = begin();
    std::uint32_t most = 0;
    std::size_t vertices = rest.vertices.size() / 3, jump = 0;
    for (int n = 0; n < 12; ++n) {
      const Surface s = solid.step(time_step, 3).surface();
      walk(s, rest);
      EXPECT_GE(s.vertices.size() / 3, vertices) << "splits stay";
      jump = std::max(jump, s.vertices.size() / 3 - vertices);
      vertices = s.vertices.size() / 3;
      most = std::max(most, pieces(s));
    }
    EXPECT_GT(most, 20u);
    EXPECT_GT(jump, 20u) << "many vertices split at once";

    // A mesh follows from the state: restored, it is the same to the bit.
    const auto state = solid.save();
    auto [fresh, same_step] = begin();
    fresh.restore(state);
    EXPECT_EQ(fresh.surface(), solid.surface());
    EXPECT_EQ(fresh.step(time_step).surface(), solid.step(time_step).surface());
  }
}

TEST(EmbeddedMesh, FollowsABrittleWallThatIsShotThrough) {
  // A cube flies through a wall of glass: the hole is of many pieces, the rim holds, and no momentum is lost.
  const Points wall = Points::mesh(2, 14, 14);
  Points bullet = Points::box(5, 5, 5, {-0.025, 0.058, 0.059}, wall.spacing);
  bullet.density = 8000;
  Specimen solid(Texts{{"critical_stretch", "0.01"}, {"precision", "single"}});
  const double time_step = 0.4 * Specimen(Texts{{"precision", "single"}}).add(wall).stable_step();
  for (std::size_t i = 0; i < bullet.size(); ++i) bullet.velocity[3 * i] = 0.03 * wall.spacing / time_step;
  solid.add(wall).add(bullet);
  const auto momenta = [&] {
    Point sum{}, turn{};
    for (std::size_t b = 0; b < 2; ++b) {
      const Points& body = b == 0 ? wall : bullet;
      const auto x = solid.field("position", b), v = solid.field("velocity", b);
      for (std::size_t i = 0; i < body.size(); ++i)
        for (std::size_t a = 0; a < 3; ++a) {
          const std::size_t c = 3 * i + (a + 1) % 3, d = 3 * i + (a + 2) % 3;
          sum[a] += body.density * body.volume[i] * v[3 * i + a];
          turn[a] += body.density * body.volume[i] * (x[c] * v[d] - x[d] * v[c]);
        }
    }
    return std::pair(sum, turn);
  };
  const auto [linear, angular] = momenta();
  solid.step(time_step, 300);
  const auto [linear_after, angular_after] = momenta();
  for (std::size_t a = 0; a < 3; ++a) {
    EXPECT_NEAR(linear_after[a], linear[a], 1e-12 * linear[0]);
    EXPECT_NEAR(angular_after[a], angular[a], 1e-6 * linear[0] * 0.14);
  }
  const Surface s = solid.surface();
  walk(s, wall);
  EXPECT_GT(pieces(s), 10u);
  double rim = 0, middle = 0;
  for (std::size_t v = 0; v < s.piece.size(); ++v) {
    const double y = s.vertices[3 * v + 1], z = s.vertices[3 * v + 2];
    const bool corner = std::max(std::abs(y - 0.07), std::abs(z - 0.07)) > 0.068;
    rim += corner && s.damage[v] > 0.3;
    middle += std::max(std::abs(y - 0.07), std::abs(z - 0.07)) < 0.02 && s.damage[v] > 0.3;
  }
  EXPECT_LT(rim, 0.2 * double(s.piece.size()));
  EXPECT_GT(middle, 20);
}

TEST(EmbeddedMesh, SaysWhatIsWrongWithTetrahedra) {
  const auto refused = [](const Points& body, const std::string& reason) {
    try {
      Specimen().add(body);
      ADD_FAILURE() << "taken; should say: " << reason;
    } catch (const std::runtime_error& error) {
      EXPECT_NE(std::string(error.what()).find(reason), std::string::npos) << error.what();
    }
  };
  Points few = Points::mesh(1, 1, 1);
  few.tetrahedra.resize(20);
  refused(few, "5 tetrahedra for 6 points");
  Points outside = Points::mesh(1, 1, 1);
  outside.tetrahedra[5] = 8;
  refused(outside, "tetrahedron 1 has vertex 8 of 8");
  Points thrice = Points::mesh(1, 1, 1);
  std::copy_n(&thrice.tetrahedra[0], 3, &thrice.tetrahedra[4]);
  std::copy_n(&thrice.tetrahedra[0], 3, &thrice.tetrahedra[8]);
  refused(thrice, "share a face; a face has two sides");
  EXPECT_THROW(Specimen(Texts{{"initial_crack", "[0, 0, 0, 1, 0, 0]"}}), testkit::Failed);
  EXPECT_THROW(Specimen(Texts{{"second_initial_crack", "[0, 0, 0, 1, 0, 0, 2, 0, 0]"}}), testkit::Failed);
}

}  // namespace
}  // namespace cleave::test
