/// Random numbers that are the same on every machine.
#ifndef CLEAVE_TESTKIT_RANDOM_HPP
#define CLEAVE_TESTKIT_RANDOM_HPP

#include <array>
#include <cmath>
#include <cstdint>

namespace cleave::testkit {

/// splitmix64 (Steele, Lea, Flood 2014).
class Random {
 public:
  explicit Random(std::uint64_t seed) : state_(seed) {}
  std::uint64_t bits() {
    std::uint64_t z = (state_ += 0x9e3779b97f4a7c15u);
    z = (z ^ (z >> 30)) * 0xbf58476d1ce4e5b9u;
    z = (z ^ (z >> 27)) * 0x94d049bb133111ebu;
    return z ^ (z >> 31);
  }
  double uniform(double low = 0, double high = 1) { return low + (high - low) * (double(bits() >> 11) * 0x1p-53); }
  int below(int n) { return int(bits() % std::uint64_t(n)); }

  /// A rotation, row-major, uniform over all of them (Shoemake 1992).
  std::array<double, 9> rotation() {
    const double u = uniform(), a = uniform(0, 2 * pi), b = uniform(0, 2 * pi), s = std::sqrt(1 - u), t = std::sqrt(u);
    const double x = s * std::sin(a), y = s * std::cos(a), z = t * std::sin(b), w = t * std::cos(b);
    return {1 - 2 * (y * y + z * z), 2 * (x * y - z * w), 2 * (x * z + y * w), 2 * (x * y + z * w),    1 - 2 * (x * x + z * z),
            2 * (y * z - x * w),     2 * (x * z - y * w), 2 * (y * z + x * w), 1 - 2 * (x * x + y * y)};
  }

 private:
  static constexpr double pi = 3.14159265358979323846;
  std::uint64_t state_;
};

}  // namespace cleave::testkit

#endif
