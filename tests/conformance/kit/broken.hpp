/// For broken plugins: `broken("sign_of_shear")` holds if the library was loaded to have this defect.
#pragma once

#include <cstdlib>
#include <cstring>

/// Environment variable that names the defect.
#define CLEAVE_DEFECT_VARIABLE "CLEAVE_CONFORMANCE_DEFECT"

/// Read when the library is loaded: a batch call may take no lock.
inline const char* const chosen_defect = std::getenv(CLEAVE_DEFECT_VARIABLE);

inline bool broken(const char* defect) { return chosen_defect && std::strcmp(chosen_defect, defect) == 0; }
