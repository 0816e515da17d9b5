#pragma once

#include "common/types.hpp"
#include "mpm/law_layout.hpp"
#include "mpm/law_watch.hpp"
#include "plugins/registry.hpp"
#include "scene/fiber_field.hpp"

#include <cleave/discretization.h>

#include <atomic>
#include <deque>
#include <mutex>
#include <string>
#include <vector>

namespace cleave::discretization {

/// The elastic law of a body's material as it is lent to the plugin that steps the body: row-major matrices are gathered into
/// whole tiles of the law's batches, in double precision, and its results back. For any number of threads at once.
class ElasticResponse {
 public:
  /// `law` must outlive this and stay where it is. `fibers` are those of the body's points, read if the law needs them.
  /// `origin` is what batches that the law fails on say of it, `first_particle` the number of the body's first point in them.
  ElasticResponse(const plugins::Instance& law, std::string body, scene::FiberField fibers, mpm::BatchOrigin origin = {},
                  std::int64_t first_particle = 0);
  ElasticResponse(const ElasticResponse&) = delete;
  ElasticResponse& operator=(const ElasticResponse&) = delete;

  const cleave_elastic_response* table() const { return &table_; }

  /// The batch of the latest call that failed with words which are part of `reason`, as the JSON of write_batch; empty if there
  /// is none. Plugins hand on the words of the call that they gave up at, and none of those that they only tried.
  std::string failed_batch(const std::string& reason) const;
  void forget_failures();

 private:
  struct Tiles;
  /// Fields of the law that are read and written in a call, and the law as it is called with them.
  class Watched {
   public:
    Watched(const plugins::Instance& law, mpm::LawLayout layout, mpm::BatchOrigin origin);
    const cleave_layout* layout() const { return layout_.get(); }
    cleave_result operator()(const cleave_batch& batch) const { return call_.function(call_.instance, &batch); }
    const mpm::LawWatch& watch() const { return watch_; }

   private:
    mpm::LawLayout layout_;
    mpm::LawWatch watch_;
    mpm::BoundLaw call_;
  };
  /// What a call gives the law and wants of it.
  struct Call {
    const Watched& law;
    std::uint64_t first, count;
    const double* F;
    const double* dF = nullptr;  ///< may be null
    bool same_point = false;     ///< F and fibers are those of the first point in all of them
  };

  static cleave_result evaluate(void* self, std::uint64_t first, std::uint64_t count, const double* F, double* energy,
                                double* P, cleave_message*);
  static cleave_result differential(void* self, std::uint64_t first, std::uint64_t count, const double* F, const double* dF,
                                    double* dP, cleave_message*);
  static cleave_result wave_modulus(void* self, std::uint64_t first, std::uint64_t count, const double* F, double* modulus,
                                    cleave_message*);

  /// The law with the strain, `delta` with its change as well, the fibers it reads, and these outputs.
  Watched bind(const mpm::BatchOrigin&, bool deformation, bool delta, std::initializer_list<cleave_field_id> outputs) const;
  /// Calls the law batch by batch, and each(tiles, first of the call's points, points) with what it gave.
  template <class Each>
  cleave_result for_batches(const Call&, cleave_message*, const Each& each) const;
  void gather(const Call&, std::uint64_t begin, std::uint64_t points, Tiles&) const;
  /// The law's bound of waves in the present configuration as one in rest coordinates.
  double rest_modulus(std::uint64_t point, const double* F, double present) const;
  std::string words(std::uint64_t point, const std::string& what) const;
  void keep(const std::string& words, const Call&, std::uint64_t begin, const cleave_batch&, cleave_result) const;

  const plugins::Instance& law_;
  std::string body_;
  scene::FiberField fibers_;
  std::int64_t first_particle_;
  bool takes_b_;  ///< the law gives no P and takes no F
  Watched stress_, energy_, stress_and_energy_, differential_, wave_modulus_;
  mutable std::atomic<bool> warned_{false};

  struct Failure {
    std::string words;
    const mpm::LawWatch* law;
    mpm::BatchSnapshot batch;
    std::vector<std::int64_t> particles;
  };
  static constexpr std::size_t most_failures = 64;  ///< more than threads that can fail at once
  mutable std::mutex failures_mutex_;
  mutable std::deque<Failure> failures_;

  cleave_elastic_response table_{};
};

}  // namespace cleave::discretization
