#pragma once

#include "plugins/schema.hpp"

#include <optional>
#include <stdexcept>
#include <string_view>

namespace cleave::plugins {

/// Why a library is not used. The text completes "FILE: ...".
class Refusal : public std::runtime_error {
 public:
  using std::runtime_error::runtime_error;
};

/// Kind named by the part of an ID before the slash; empty if the ID is malformed or its kind unknown.
std::optional<Kind> kind_of_id(std::string_view id);
/// "cleave.elasticity/1".
const char* kind_id(Kind);

/// Throws Refusal unless a plugin that speaks this version can be used by this host.
void check_abi(cleave_version);

/// Copies what a plugin says of itself, after checking that its tables are whole and consistent: sizes, null members, IDs,
/// keys, defaults inside their bounds, offered functions. Throws Refusal. The ABI version has been agreed on before.
Description describe(const cleave_plugin&);

/// The checks of describe() that concern the description alone, so that a manifest is held to the same rules. Throws Refusal.
void check(const Description&);

}  // namespace cleave::plugins
