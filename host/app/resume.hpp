#pragma once

#include "checkpoint/run_directory.hpp"
#include "mpm/simulation.hpp"

#include <filesystem>
#include <optional>
#include <string>

namespace cleave::app {

/// What is known of a run before it begins, for checkpoints of it and for comparing with those there are.
checkpoint::Run describe_run(const std::string& scene, int threads);
/// The program and the plugins that compute it.
void add_program(checkpoint::Run&, const mpm::Simulation&);

/// The checkpoint that a run goes on from; none: from the beginning. Throws InputError if what is in `out` is of another scene,
/// or if there are checkpoints but none that is whole.
std::optional<checkpoint::Opened> find_start(const checkpoint::RunCheckpoints&, const std::filesystem::path& out,
                                             const checkpoint::Run& now);
/// Throws InputError unless what computes is what it was, or may be `anyway`.
void compare_programs(const checkpoint::Opened& start, const checkpoint::Run& now, bool anyway);

}  // namespace cleave::app
