#pragma once

#include "plugins/registry.hpp"

namespace cleave::plugins {

/// The isotropic part of an elastic law, measured through its own entry points, for laws of the same material that derive
/// parameters from it. The instance must outlive the probe and stay where it is.
class ElasticProbe : private cleave_elastic_probe {
 public:
  explicit ElasticProbe(const Instance& elasticity);
  ElasticProbe(const ElasticProbe&) = delete;
  ElasticProbe& operator=(const ElasticProbe&) = delete;
  const cleave_elastic_probe* get() const { return this; }

 private:
  const Instance& elasticity_;
};

}  // namespace cleave::plugins
