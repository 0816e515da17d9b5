#pragma once

#include <stdexcept>
#include <string>

namespace cleave {

/// Something the user gave cannot be used. The message stands alone: what is wrong, where, and what would be right.
/// Commands end with exit status 2.
class InputError : public std::runtime_error {
 public:
  using std::runtime_error::runtime_error;
};

/// The simulation cannot go on. Commands end with exit status 3, after the state has been written.
class SimulationError : public std::runtime_error {
 public:
  using std::runtime_error::runtime_error;
};

}  // namespace cleave
