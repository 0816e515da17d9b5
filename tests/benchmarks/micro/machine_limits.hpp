#pragma once

#include <cstddef>

/// Loops that do nothing but reach a limit of the processor or its memory, compiled for the processor they are built on.
namespace limits {

inline constexpr int chains = 12;  ///< independent, more than latency times units of any processor

/// x <- a x + b in all lanes of `chains` vectors; returns one of them. Floating-point operations: see multiply_add_operations.
float multiply_add(long rounds, float a, float b);
double multiply_add(long rounds, double a, double b);
/// Of one round.
long multiply_add_operations(float);
long multiply_add_operations(double);

float sum(const float* x, std::size_t count);           ///< count: a multiple of 256
void scale(float* x, float factor, std::size_t count);  ///< x <- factor x
void triad(float* __restrict a, const float* __restrict b, const float* __restrict c, float factor,
           std::size_t count);  ///< a = b + factor c

}  // namespace limits
