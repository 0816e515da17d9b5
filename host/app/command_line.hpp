#pragma once

#include <CLI/CLI.hpp>

#include <string>

namespace cleave::app {

/// Facts of this build, for `cleave --version`: the first line is name and version, a line each for ABI, compiler, instruction
/// sets and libraries follows.
std::string build_facts();

/// What an interactive bash sources (zsh: after bashcompinit): commands, options, their listed values, plugins, files.
std::string bash_completion(const CLI::App& program);

/// The same for fish.
std::string fish_completion(const CLI::App& program);

/// man page of section 1 (roff): every command with its options, exit status, environment and files.
std::string manual(const CLI::App& program);

}  // namespace cleave::app
