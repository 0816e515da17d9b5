#pragma once

#include "config/scene.hpp"

#include <filesystem>
#include <optional>
#include <set>
#include <string>
#include <vector>

namespace cleave::advise {

/// What steps of materials cost, as `cleave bench steps --json` records it. Materials are the sets of their laws' IDs.
class Costs {
 public:
  /// Those that come with the program (costs.json beside this file says by which command).
  static Costs shipped();
  /// A file of `cleave bench steps --json`, or a list of such. Throws InputError.
  static Costs read(const std::filesystem::path&);

  /// Later ones go before earlier ones.
  void add(const Costs&);
  /// Nanoseconds of one thread per particle and step, of the fastest sample; nothing where it was not measured.
  std::optional<double> nanoseconds(const std::set<std::string>& laws, config::Precision, int dimension) const;
  static std::set<std::string> laws_of(const config::Material&);

 private:
  struct Entry {
    std::set<std::string> laws;
    config::Precision precision;
    int dimension;
    double nanoseconds;
  };
  static Costs parse(const std::string& text, const std::string& name);

  std::vector<Entry> entries_;
};

}  // namespace cleave::advise
