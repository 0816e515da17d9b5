// Compiled for this processor: includes nothing with inline functions that the linker could keep for others.

#include "machine_limits.hpp"

namespace limits {
namespace {

#if defined(__AVX512F__)
constexpr int width = 64;
#elif defined(__AVX__)
constexpr int width = 32;
#else
constexpr int width = 16;
#endif
typedef float Single __attribute__((vector_size(width)));
typedef double Double __attribute__((vector_size(width)));

template <class Vector, class T>
T multiply_add_chains(long rounds, T a, T b) {
  Vector x[chains];
  for (int i = 0; i < chains; i++) x[i] = Vector{} + T(i);
  const Vector factor = Vector{} + a, term = Vector{} + b;
  for (long r = 0; r < rounds; r++) {
#pragma GCC unroll 12
    for (int i = 0; i < chains; i++) {
      x[i] = x[i] * factor + term;
      asm("" : "+x"(x[i]));  // in a register, as itself
    }
  }
  Vector all = x[0];
  for (int i = 1; i < chains; i++) all += x[i];
  return all[0] / T(chains);
}

}  // namespace

float multiply_add(long rounds, float a, float b) { return multiply_add_chains<Single>(rounds, a, b); }
double multiply_add(long rounds, double a, double b) { return multiply_add_chains<Double>(rounds, a, b); }
long multiply_add_operations(float) { return 2l * chains * width / long(sizeof(float)); }
long multiply_add_operations(double) { return 2l * chains * width / long(sizeof(double)); }

float sum(const float* x, std::size_t count) {
  constexpr std::size_t lanes = width / sizeof(float), at_once = 8;
  Single part[at_once] = {};
  for (std::size_t i = 0; i < count; i += lanes * at_once)
    for (std::size_t k = 0; k < at_once; k++) part[k] += *reinterpret_cast<const Single*>(x + i + k * lanes);
  float all = 0;
  for (const Single& p : part)
    for (std::size_t l = 0; l < lanes; l++) all += p[l];
  return all;
}

void scale(float* x, float factor, std::size_t count) {
  for (std::size_t i = 0; i < count; i++) x[i] *= factor;
}

void triad(float* __restrict a, const float* __restrict b, const float* __restrict c, float factor, std::size_t count) {
  for (std::size_t i = 0; i < count; i++) a[i] = b[i] + factor * c[i];
}

}  // namespace limits
