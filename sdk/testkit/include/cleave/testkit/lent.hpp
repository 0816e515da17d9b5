/// What a host lends to plugins: an elastic law, and threads.
#ifndef CLEAVE_TESTKIT_LENT_HPP
#define CLEAVE_TESTKIT_LENT_HPP

#include <cleave/discretization.h>

#include <atomic>
#include <cstdint>
#include <mutex>
#include <string>

namespace cleave::testkit {

/// The elastic law of a body's material, for discretisations that evaluate it: the solid of Material in compression and
/// tension,
///   P = mu J^(-2/3) (F - tr b/3 F^-T) + kappa/2 (J^2 - 1) F^-T.
class LentElasticity {
 public:
  explicit LentElasticity(std::uint64_t points);
  LentElasticity(const LentElasticity&) = delete;
  LentElasticity& operator=(const LentElasticity&) = delete;
  const cleave_elastic_response* get() const { return &table_; }

  double stiffness = 1;  ///< factor on energies and stresses
  bool fails = false;    ///< everywhere, with `reason`
  static constexpr const char* reason = "the rubber has perished at point 0";

  /// The first thing asked that makes no sense; empty if nothing was.
  std::string misuse() const;
  /// Points evaluated so far, by whichever function.
  std::uint64_t evaluations() const { return evaluations_; }

 private:
  template <class Each>
  static cleave_result evaluated(void* self, std::uint64_t first, std::uint64_t count, const double* F, bool complete,
                                 cleave_message*, const Each& each);
  static cleave_result evaluate(void*, std::uint64_t, std::uint64_t, const double*, double*, double*, cleave_message*);
  static cleave_result differential(void*, std::uint64_t, std::uint64_t, const double*, const double*, double*,
                                    cleave_message*);
  static cleave_result wave_modulus(void*, std::uint64_t, std::uint64_t, const double*, double*, cleave_message*);

  std::uint64_t points_;
  cleave_elastic_response table_;
  std::atomic<std::uint64_t> evaluations_{0};
  mutable std::mutex mutex_;
  std::string misuse_;
};

/// Threads that work on ranges in an order that shows whether it matters.
class LentThreads {
 public:
  enum Order { forwards, backwards, side_by_side };
  explicit LentThreads(Order);
  LentThreads(const LentThreads&) = delete;
  LentThreads& operator=(const LentThreads&) = delete;
  const cleave_threads* get() const { return &table_; }
  static const char* name(Order);

  /// The first thing asked that makes no sense; empty if nothing was.
  const std::string& misuse() const { return misuse_; }
  bool used() const { return used_; }

 private:
  static void for_ranges(void*, std::uint64_t size, std::uint64_t grain, void (*work)(void*, std::uint64_t, std::uint64_t),
                         void* data);

  Order order_;
  cleave_threads table_;
  std::atomic<bool> working_{false};
  bool used_ = false;
  std::string misuse_;
};

}  // namespace cleave::testkit

#endif
