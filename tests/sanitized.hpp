#pragma once
// Sanitizers reserve terabytes of address space, keep memory that is given back, end a program where it would crash, and have
// each library for one instruction set.

namespace cleave::test {

#if defined(__SANITIZE_ADDRESS__) || defined(__SANITIZE_THREAD__)
constexpr bool sanitized = true;
#else
constexpr bool sanitized = false;
#endif

}  // namespace cleave::test
