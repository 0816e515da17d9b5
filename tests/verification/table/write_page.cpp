// Writes the figures of a directory, CLEAVE_VERIFICATION_DIR of the tests, into docs/verification.md.

#include "page.hpp"

#include <cstdio>
#include <exception>

int main(int argc, char** argv) try {
  if (argc != 2) {
    std::fprintf(stderr, "usage: %s DIRECTORY\n", argv[0]);
    return 2;
  }
  const auto lines = cleave::test::collect(argv[1]);
  write_lines(cleave::test::verification_page(), lines);
  std::printf("%zu figures in %s\n", lines.size(), cleave::test::verification_page().c_str());
  return 0;
} catch (const std::exception& e) {
  std::fprintf(stderr, "%s\n", e.what());
  return 1;
}
