#pragma once

#include "common/types.hpp"
#include "mpm/law_layout.hpp"
#include "plugins/registry.hpp"
#include "scene/fiber_field.hpp"

#include <cleave/discretization.h>

#include <atomic>
#include <string>

namespace cleave::discretization {

/// The elastic law of a body's material as it is lent to the plugin that steps the body: row-major matrices are gathered into
/// whole tiles of the law's batches, in double precision, and its results back. For any number of threads at once.
class ElasticResponse {
 public:
  /// `law` must outlive this and stay where it is. `fibers` are those of the body's points, read if the law needs them.
  ElasticResponse(const plugins::Instance& law, std::string body, scene::FiberField fibers);
  ElasticResponse(const ElasticResponse&) = delete;
  ElasticResponse& operator=(const ElasticResponse&) = delete;

  const cleave_elastic_response* table() const { return &table_; }

 private:
  struct Tiles;
  /// What a call gives the law and wants of it.
  struct Call {
    const mpm::LawLayout& layout;
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

  /// A layout with the strain, `delta` with its change as well, and the fibers the law reads.
  mpm::LawLayout inputs(bool deformation, bool delta) const;
  /// Calls the law batch by batch, and each(tiles, first of the call's points, points) with what it gave.
  template <class Each>
  cleave_result for_batches(const Call&, cleave_message*, const Each& each) const;
  void gather(const Call&, std::uint64_t begin, std::uint64_t points, Tiles&) const;
  /// The law's bound of waves in the present configuration as one in rest coordinates.
  double rest_modulus(std::uint64_t point, const double* F, double present) const;
  cleave_result fail(std::uint64_t point, const std::string& what, cleave_message*) const;

  const plugins::Instance& law_;
  std::string body_;
  scene::FiberField fibers_;
  bool takes_b_;  ///< the law gives no P and takes no F
  mpm::LawLayout stress_, energy_, stress_and_energy_, differential_, wave_modulus_;
  mutable std::atomic<bool> warned_{false};
  cleave_elastic_response table_{};
};

}  // namespace cleave::discretization
