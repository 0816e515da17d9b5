#pragma once

#include <Eigen/Dense>

#include <random>
#include <vector>

namespace cleave::plugins::test {

using Tensor = Eigen::Matrix<double, 3, 3, Eigen::RowMajor>;

inline std::vector<double> row_major(const Tensor& F) { return {F.data(), F.data() + 9}; }
inline std::vector<double> symmetric(const Tensor& b) { return {b(0, 0), b(1, 1), b(2, 2), b(0, 1), b(0, 2), b(1, 2)}; }
inline Tensor tensor(const std::vector<double>& v) {
  Tensor a;
  if (v.size() == 6)
    a << v[0], v[3], v[4], v[3], v[1], v[5], v[4], v[5], v[2];
  else
    a = Eigen::Map<const Tensor>(v.data());
  return a;
}
inline std::vector<double> left_cauchy_green(const Tensor& F) { return symmetric(F * F.transpose()); }

/// Deformation gradients with J > 0: rotated, sheared, stretched by up to about `strain`.
inline std::vector<Tensor> deformations(int count, double strain, unsigned seed = 7) {
  std::mt19937 random(seed);
  std::uniform_real_distribution<double> uniform(-1, 1);
  std::vector<Tensor> all;
  while (int(all.size()) < count) {
    const Tensor F = Tensor::Identity() + strain * Tensor::NullaryExpr([&] { return uniform(random); });
    const Eigen::AngleAxisd turn(3 * uniform(random), Eigen::Vector3d(uniform(random), 1, uniform(random)).normalized());
    if (F.determinant() > 0.05) all.push_back(turn.toRotationMatrix() * F);
  }
  return all;
}

}  // namespace cleave::plugins::test
