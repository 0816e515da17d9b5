/// For GoogleTest users:   CLEAVE_CONFORMANCE_TESTS(MyLaw, "plugins/my_law.so")   makes one test of every check
/// for its kind. The library has to be there when the tests are listed: let the test program depend on it.
#ifndef CLEAVE_TESTKIT_GTEST_HPP
#define CLEAVE_TESTKIT_GTEST_HPP

#include <cleave/testkit/runner.hpp>

#include <gtest/gtest.h>

#include <cctype>

namespace cleave::testkit {

/// Runs one check: fails or skips the current test as the check does.
inline void expect_conformance(const Options& options, const char* id) {
  const Result result = run_checks(options, {id}).results.at(0);
  if (result.verdict == Verdict::skipped) GTEST_SKIP() << result.reason;
  EXPECT_EQ(result.verdict, Verdict::passed) << result.check->sentence << "\n" << result.reason << "\n" << result.reproduction;
}

inline std::string test_name(const testing::TestParamInfo<const char*>& info) {
  std::string name = info.param;
  for (char& c : name)
    if (!std::isalnum(static_cast<unsigned char>(c))) c = '_';
  return name;
}

inline std::vector<const char*> check_ids(const char* library) {
  Options options;
  options.library = library;
  return applicable_checks(options);
}

}  // namespace cleave::testkit

#define CLEAVE_CONFORMANCE_TESTS(Suite, library_path)                                                       \
  class Suite : public testing::TestWithParam<const char*> {};                                              \
  TEST_P(Suite, Conforms) {                                                                                 \
    cleave::testkit::Options options;                                                                       \
    options.library = library_path;                                                                         \
    cleave::testkit::expect_conformance(options, GetParam());                                               \
  }                                                                                                         \
  INSTANTIATE_TEST_SUITE_P(Conformance, Suite, testing::ValuesIn(cleave::testkit::check_ids(library_path)), \
                           cleave::testkit::test_name)

#endif
