#pragma once

#include "plugins/schema.hpp"

#include <toml++/toml.h>

#include <string>

namespace cleave::bench {

toml::table to_json(const plugins::GivenParameters&);
std::string json_text(const toml::table&);

}  // namespace cleave::bench
