#pragma once

#include <sys/resource.h>

#include <algorithm>
#include <cstdint>
#include <fstream>
#include <limits>
#include <string>

namespace cleave {

/// Bytes that this process can still allocate without the system running out: free memory and swap, within its own limit.
inline double available_memory() {
  double bytes = 0;
  std::ifstream meminfo("/proc/meminfo");
  std::string name, unit;
  for (double kilobytes = 0; meminfo >> name >> kilobytes; std::getline(meminfo, unit))
    if (name == "MemAvailable:" || name == "SwapFree:") bytes += 1024 * kilobytes;
  if (bytes == 0) bytes = std::numeric_limits<double>::infinity();  // the system does not say
  rlimit limit{};
  if (getrlimit(RLIMIT_AS, &limit) == 0 && limit.rlim_cur != RLIM_INFINITY) bytes = std::min(bytes, double(limit.rlim_cur));
  return bytes;
}

}  // namespace cleave
