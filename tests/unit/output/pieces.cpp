#include "output/pieces.hpp"

#include <gtest/gtest.h>

#include <algorithm>
#include <random>
#include <set>

namespace cleave::output {
namespace {

constexpr double spacing = 0.05;  // half a cell

/// A block of nx x ny x nz particles, intact.
ParticleFrame block(int nx, int ny, int nz, double jitter = 0) {
  std::mt19937 random(3);
  std::uniform_real_distribution<double> offset(-jitter / 2, jitter / 2);
  ParticleFrame frame;
  frame.cell_size = 2 * spacing;
  frame.dimension = nz > 1 ? 3 : 2;
  for (int z = 0; z < nz; z++)
    for (int y = 0; y < ny; y++)
      for (int x = 0; x < nx; x++) {
        const Vector3 place(x + offset(random), y + offset(random), nz > 1 ? z + offset(random) : 0);
        frame.positions.push_back(spacing * place);
      }
  const std::size_t n = frame.particles();
  frame.velocities.assign(n, Eigen::Vector3f::Zero());
  frame.volumes.assign(n, float(std::pow(spacing, frame.dimension)));
  frame.attributes.push_back({"damage", 1, "1", std::vector<float>(n, 0.f)});
  frame.bodies = {"block"};
  frame.body_ends = {n};
  return frame;
}

/// Breaks particles whose place at rest lies in a slab normal to x.
void break_between(ParticleFrame& frame, const ParticleFrame& rest, double from, double to, double up_to_y = 1e9) {
  for (std::size_t i = 0; i < rest.particles(); i++)
    if (const Vector3& x = rest.positions[i]; x.x() > from && x.x() < to && x.y() < up_to_y)
      frame.attributes[0].values[i] = 0.97f;
}

std::set<std::int32_t> numbers(const Pieces& pieces) { return {pieces.of_particles().begin(), pieces.of_particles().end()}; }

TEST(PiecesOfABody, AreOneUntilACrackIsThrough) {
  const ParticleFrame rest = block(24, 8, 6);
  ParticleFrame frame = rest;
  Pieces pieces(rest, {true});
  EXPECT_EQ(pieces.find(frame).pieces, 1);
  break_between(frame, rest, 9.5 * spacing, 11.5 * spacing, 6.5 * spacing);  // a ligament of one layer is left
  EXPECT_EQ(pieces.find(frame).pieces, 1);
  break_between(frame, rest, 9.5 * spacing, 11.5 * spacing);
  const auto count = pieces.find(frame);
  EXPECT_EQ(count.pieces, 2);
  EXPECT_EQ(count.debris, 0);
}

TEST(PiecesOfABody, GetTheBrokenParticlesThatAreNearest) {
  const ParticleFrame rest = block(24, 8, 6);
  ParticleFrame frame = rest;
  break_between(frame, rest, 9.5 * spacing, 13.5 * spacing);  // columns 10 to 13
  for (std::size_t i = 0; i < rest.particles(); i++)
    if (rest.positions[i].x() > 11.5 * spacing) frame.positions[i].x() += spacing;  // opened in the middle
  Pieces pieces(rest, {true});
  EXPECT_EQ(pieces.find(frame).pieces, 2);
  for (std::size_t i = 0; i < rest.particles(); i++)
    EXPECT_EQ(pieces.of_particles()[i], rest.positions[i].x() < 11.5 * spacing ? 0 : 1);
}

TEST(PiecesOfABody, KeepTheirNumbersWhereMostOfThemIs) {
  const ParticleFrame rest = block(40, 6, 5);
  ParticleFrame frame = rest;
  Pieces pieces(rest, {true});
  pieces.find(frame);
  break_between(frame, rest, 9.5 * spacing, 11.5 * spacing);
  pieces.find(frame);
  const auto number_at = [&](int column) { return pieces.of_particles()[std::size_t(column)]; };
  EXPECT_EQ(number_at(30), 0) << "the larger part, though the smaller one has the first particle";
  EXPECT_EQ(number_at(2), 1);
  break_between(frame, rest, 29.5 * spacing, 31.5 * spacing);
  EXPECT_EQ(pieces.find(frame).pieces, 3);
  EXPECT_EQ(number_at(20), 0);
  EXPECT_EQ(number_at(2), 1);
  EXPECT_EQ(number_at(38), 2);
  break_between(frame, rest, -1, 11.5 * spacing);  // piece 1 is crushed, its number is not given again
  EXPECT_EQ(pieces.find(frame).pieces, 2);
  break_between(frame, rest, 19.5 * spacing, 21.5 * spacing);
  EXPECT_EQ(pieces.find(frame).pieces, 3);
  EXPECT_TRUE(numbers(pieces).contains(3));
  EXPECT_FALSE(numbers(pieces).contains(1));
}

TEST(PiecesOfABody, SmallerThanACellAreDebrisOnceTheyAreAway) {
  const ParticleFrame rest = block(24, 8, 6);
  ParticleFrame frame = rest;
  const auto in_chip = [&](std::size_t i) {
    const Vector3& x = rest.positions[i];
    return x.x() < 1.5 * spacing && x.y() < 1.5 * spacing && x.z() < 0.5 * spacing;  // 4 particles, half a cell
  };
  for (std::size_t i = 0; i < rest.particles(); i++) {
    const Vector3& x = rest.positions[i];
    if (x.x() < 3.5 * spacing && x.y() < 3.5 * spacing && x.z() < 2.5 * spacing && !in_chip(i))
      frame.attributes[0].values[i] = 1;
  }
  Pieces pieces(rest, {true});
  EXPECT_EQ(pieces.find(frame).debris, 0) << "still between broken particles of the block";
  for (std::size_t i = 0; i < rest.particles(); i++)
    if (in_chip(i)) frame.positions[i].x() -= 1;
  const auto count = pieces.find(frame);
  EXPECT_EQ(count.pieces, 1);
  EXPECT_NEAR(count.debris, 4 / (24. * 8 * 6), 1e-6);
  for (std::size_t i = 0; i < rest.particles(); i++) EXPECT_EQ(pieces.of_particles()[i], in_chip(i) ? -1 : 0);
}

TEST(PiecesOfABody, ComeApartWithoutDamageWhereNoNodeIsShared) {
  const ParticleFrame rest = block(20, 6, 5);
  for (const auto& [gap, pieces_expected] : {std::pair(2.4, 1), std::pair(3.1, 2)}) {
    ParticleFrame frame = rest;
    frame.attributes.clear();
    for (auto& x : frame.positions)
      if (x.x() > 9.5 * spacing) x.x() += gap * rest.cell_size;
    EXPECT_EQ(Pieces(rest, {true}).find(frame).pieces, pieces_expected) << gap;
  }
}

TEST(PiecesOfABody, AreNotTornByTheRandomnessOfSampling) {
  for (const int nz : {1, 12})
    for (const double jitter : {0.5, 1.0}) {
      const ParticleFrame rest = block(20, 15, nz, jitter);
      const auto count = Pieces(rest, {true}).find(rest);
      EXPECT_EQ(count.pieces, 1) << nz << ", jitter " << jitter;
      EXPECT_EQ(count.debris, 0) << nz << ", jitter " << jitter;
    }
}

TEST(PiecesOfABody, TakeFortyBytesPerParticle) {
  const ParticleFrame rest = block(40, 40, 40, 1);
  Pieces pieces(rest, {true});
  pieces.find(rest);
  EXPECT_NEAR(double(pieces.bytes()) / double(rest.particles()), 40, 3);
}

TEST(PiecesOfABody, AreNeverSharedWithAnotherAndOnlyCountedBodiesHaveAny) {
  ParticleFrame rest = block(12, 6, 5);
  const std::size_t third = rest.particles() / 3;  // bodies that touch
  rest.bodies = {"a", "b", "c"};
  rest.body_ends = {third, 2 * third, rest.particles()};
  Pieces pieces(rest, {true, false, true});
  EXPECT_EQ(pieces.find(rest).pieces, 2);
  const auto& found = pieces.of_particles();
  for (std::size_t i = 0; i < rest.particles(); i++) EXPECT_EQ(found[i], i < third ? 0 : i < 2 * third ? -1 : 1);
}

}  // namespace
}  // namespace cleave::output
