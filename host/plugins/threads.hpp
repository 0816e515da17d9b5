#pragma once

#include <cleave/abi.h>

namespace cleave::plugins {

/// The threads of this program, as plugins may use them.
const cleave_threads* threads();

}  // namespace cleave::plugins
