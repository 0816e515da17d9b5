#pragma once

#include "config/scene.hpp"

#include <string>
#include <vector>

namespace cleave::config {

/// Collects what is wrong with a scene, so that all of it is reported at once.
class Diagnostics {
 public:
  void error(const Location& where, const std::string& what) { errors_.push_back({where, what}); }
  void warning(const Location& where, const std::string& what) { warnings_.push_back({where, what}); }

  /// Throws InputError with one line per error, in the order of the file. Returns if there is none.
  void throw_errors() const;
  /// One line per warning, in the order of the file.
  std::vector<std::string> warnings() const;

 private:
  struct Entry {
    Location where;
    std::string what;
  };
  static std::vector<std::string> lines(std::vector<Entry>, const char* severity);

  std::vector<Entry> errors_, warnings_;
};

}  // namespace cleave::config
