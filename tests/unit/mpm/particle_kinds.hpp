#pragma once

#include <gtest/gtest.h>

namespace cleave::mpm {

/// What particles are made for: a precision and a dimension.
template <class Real, int Dimension>
struct Kind {
  using T = Real;
  static constexpr int D = Dimension;
};

using Kinds = testing::Types<Kind<float, 2>, Kind<float, 3>, Kind<double, 2>, Kind<double, 3>>;

}  // namespace cleave::mpm
