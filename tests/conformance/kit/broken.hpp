/// For broken plugins: `broken("sign_of_shear")` holds if the library was loaded to have this defect.
#pragma once

#include <cstdlib>
#include <cstring>

/// Environment variable that names the defect.
#define CLEAVE_DEFECT_VARIABLE "CLEAVE_CONFORMANCE_DEFECT"

inline bool broken(const char* defect) {
  static const char* const chosen = std::getenv(CLEAVE_DEFECT_VARIABLE);
  return chosen && std::strcmp(chosen, defect) == 0;
}
