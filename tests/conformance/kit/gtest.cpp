// What the header for GoogleTest makes of a library: one test of every check.
#include <cleave/testkit/gtest.hpp>

CLEAVE_CONFORMANCE_TESTS(SplitNeoHookean, CLEAVE_BINARY_DIR "/lib/cleave/plugins/split_neo_hookean.so");
