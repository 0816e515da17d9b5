#pragma once

#include "common/error.hpp"
#include "config/scene.hpp"

namespace cleave::config {

/// Loads the plugin a scene names and creates its instance. Throws InputError with the place in the scene.
inline plugins::Instance instantiate(plugins::Registry& registry, const PluginUse& use, const plugins::Context& context) {
  try {
    return plugins::Instance(registry.load(use.id), use.parameters, context);
  } catch (const InputError& e) {
    throw InputError(error_at(use.where) + e.what());
  }
}

}  // namespace cleave::config
