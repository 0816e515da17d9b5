// The weak Laplacian of the transfers' kernel, K_ij = sum_p V_p grad_i(x_p) . grad_j(x_p) with grad_i = 4 w_ip (x_i - x_p) in
// cells, against a plain double loop, and the properties that the solver and the step bound rest on.

#include "damage_scenes.hpp"

#include "mpm/grid.hpp"
#include "mpm/particles.hpp"

#include <random>

namespace cleave::mpm {
namespace {

template <class Real, int Dimension>
struct Kind {
  using T = Real;
  static constexpr int D = Dimension;
};

/// Particles on their grid, and K as the kernels compute it.
template <class T, int D>
class Discrete {
 public:
  explicit Discrete(const std::vector<NewParticle>& points) : particles_(TileLayout({.dimension = D, .damage = true})) {
    particles_.assign(points, {}, {});
    std::vector<BlockCoordinate> homes;
    for (const auto& b : particles_.blocks()) homes.push_back(b.coordinate);
    grid_.rebuild(homes);
    for (auto& b : particles_.blocks()) grid_.link(b, b.coordinate);
    volume_.reserve(particles_.tiles() * CLEAVE_TILE_BYTES);
    scratch_.reserve(kernels().scratch_bytes);
    particles_.for_each([&](const auto&, std::uint64_t slot) {
      reinterpret_cast<T*>(volume_.data())[slot] = particles_.value(particles_.layout().volume, slot);
    });
  }

  std::size_t size() const { return grid_.nodes(); }
  Vector3 node(std::size_t i) const { return grid_.node_coordinates(i).template cast<double>(); }

  std::vector<double> stiffness(const std::vector<double>& f) {
    Buffer from, to;
    from.reserve((size() + 16) * sizeof(T));
    to.reserve((size() + 16) * sizeof(T));
    for (std::size_t i = 0; i < size(); i++) reinterpret_cast<T*>(from.data())[i] = T(f[i]);
    DamageView damage;
    damage.volume = volume_.data();
    for (const auto& b : particles_.blocks())
      kernels().stiffness(particles_.view(), b, damage, reinterpret_cast<T*>(from.data()), reinterpret_cast<T*>(to.data()),
                          scratch_.data());
    const T* result = reinterpret_cast<T*>(to.data());
    return {result, result + size()};
  }

  /// f(node, weight, x_i - x_p) of each particle in turn, straight from the definition of the kernel.
  template <class F>
  void for_stencil(const NewParticle& p, F&& f) const {
    Index3 first = Index3::Zero();
    double w[3][3] = {{1, 0, 0}, {1, 0, 0}, {1, 0, 0}};
    for (int a = 0; a < D; a++) {
      first[a] = int(std::floor(p.position[a] - 0.5));
      for (int i = 0; i < 3; i++) {
        const double r = std::abs(p.position[a] - first[a] - i);
        w[a][i] = r < 0.5 ? 0.75 - r * r : 0.5 * (1.5 - r) * (1.5 - r);
      }
    }
    for (int i = 0; i < 3; i++)
      for (int j = 0; j < 3; j++)
        for (int k = 0; k < (D == 3 ? 3 : 1); k++) {
          const Index3 n = first + Index3(i, j, k);
          Vector3 r = n.cast<double>() - p.position;
          if (D == 2) r.z() = 0;
          f(grid_.node_index(n), w[0][i] * w[1][j] * w[2][k], r);
        }
  }

 private:
  const DamageKernels<T, D>& kernels() const { return kernels_of<T, D>(load_kernels().damage); }
  Particles<T, D> particles_;
  Grid<T, D> grid_;
  Buffer volume_, scratch_;
};

std::vector<NewParticle> cloud(int dimension, int cells, int per_cell) {
  std::mt19937 random(17);
  std::uniform_real_distribution<double> uniform(0, 1);
  std::vector<NewParticle> points;
  const int n = int(std::pow(cells, dimension)) * per_cell;
  for (int i = 0; i < n; i++) {
    NewParticle p;
    p.id = std::uint32_t(i);
    for (int a = 0; a < dimension; a++) p.position[a] = cells * (uniform(random) - 0.4);
    p.volume = (0.5 + uniform(random)) / per_cell;
    points.push_back(p);
  }
  return points;
}

double dot(const std::vector<double>& a, const std::vector<double>& b) {
  double sum = 0;
  for (std::size_t i = 0; i < a.size(); i++) sum += a[i] * b[i];
  return sum;
}

template <class K>
class WeakLaplacian : public testing::Test {};
using Kinds = testing::Types<Kind<float, 2>, Kind<float, 3>, Kind<double, 2>, Kind<double, 3>>;
TYPED_TEST_SUITE(WeakLaplacian, Kinds);

TYPED_TEST(WeakLaplacian, IsTheSumOverParticlesOfTheProductsOfGradients) {
  using T = typename TypeParam::T;
  constexpr int D = TypeParam::D;
  const auto points = cloud(D, D == 3 ? 6 : 18, D == 3 ? 8 : 4);  // several blocks
  Discrete<T, D> discrete(points);
  std::mt19937 random(2);
  std::uniform_real_distribution<double> uniform(-1, 1);
  std::vector<double> f(discrete.size()), h(discrete.size());
  for (auto* field : {&f, &h})
    for (auto& x : *field) x = double(T(uniform(random)));
  std::vector<double> expected(discrete.size(), 0.0), mass = expected;
  double largest = 0;
  for (const auto& p : points) {
    Vector3 gradient = Vector3::Zero();
    discrete.for_stencil(p, [&](std::size_t i, double w, const Vector3& r) { gradient += 4 * w * f[i] * r; });
    discrete.for_stencil(p, [&](std::size_t i, double w, const Vector3& r) {
      expected[i] += p.volume * 4 * w * gradient.dot(r);
      mass[i] += p.volume * w;
    });
  }
  const double rounding = sizeof(T) == 4 ? 1e-5 : 1e-13;
  const auto Kf = discrete.stiffness(f);
  for (std::size_t i = 0; i < f.size(); i++) largest = std::max(largest, std::abs(Kf[i] - expected[i]));
  EXPECT_LT(largest, rounding);
  EXPECT_NEAR(dot(h, Kf), dot(f, discrete.stiffness(h)), rounding * dot(mass, mass)) << "symmetric";

  double rest = 0;
  for (double x : discrete.stiffness(std::vector<double>(f.size(), 1.0))) rest = std::max(rest, std::abs(x));
  EXPECT_LT(rest, rounding) << "a constant has no gradient";

  // f = a . x has the gradient a at every particle, so that f K f = a^2 V
  const Vector3 a(0.3, -0.7, D == 3 ? 0.5 : 0);
  for (std::size_t i = 0; i < f.size(); i++) f[i] = a.dot(discrete.node(i));
  double volume = 0;
  for (const auto& p : points) volume += p.volume;
  EXPECT_NEAR(dot(f, discrete.stiffness(f)), a.squaredNorm() * volume, 20 * rounding * volume);

  // Eigenvalues of M^-1 K, with which the step bound of explicit damage is made: |grad|^2 = |sum 4 w f r|^2 <= 4 sum w f^2
  // because sum w r r^T = I/4, so that they are at most 4.
  for (auto& x : f) x = uniform(random);
  double eigenvalue = 0;
  for (int i = 0; i < 100; i++) {
    double norm = 0;
    for (std::size_t k = 0; k < f.size(); k++) norm += mass[k] * f[k] * f[k];
    for (auto& x : f) x /= std::sqrt(norm);
    const auto g = discrete.stiffness(f);
    eigenvalue = dot(f, g);
    for (std::size_t k = 0; k < f.size(); k++) f[k] = mass[k] > 0 ? g[k] / mass[k] : 0;
  }
  EXPECT_LT(eigenvalue, 4 * (1 + rounding));
  EXPECT_GT(eigenvalue, 1);
}

TYPED_TEST(WeakLaplacian, HasTheEigenvalueFourForALoneParticle) {
  using T = typename TypeParam::T;
  constexpr int D = TypeParam::D;
  NewParticle p;
  p.position = Vector3(0.3, 1.1, D == 3 ? -0.6 : 0);
  p.volume = 0.7;
  Discrete<T, D> discrete({p});
  // f = x - x_p: K f = V 4 w (x_i - x_p) . grad f = 4 V w f
  std::vector<double> f(discrete.size());
  for (std::size_t i = 0; i < f.size(); i++) f[i] = discrete.node(i)[0] - p.position[0];
  const auto Kf = discrete.stiffness(f);
  discrete.for_stencil(p, [&](std::size_t i, double w, const Vector3&) {
    EXPECT_NEAR(Kf[i], 4 * p.volume * w * f[i], sizeof(T) == 4 ? 1e-6 : 1e-14);
  });
}

}  // namespace
}  // namespace cleave::mpm
