// An elastic plugin as the host lends it to a discretization. Apart, since host and SDK both have a Vector3.
#pragma once

#include <cleave/discretization.h>

#include <cstddef>
#include <map>
#include <memory>
#include <string>

namespace cleave::test {

/// Of a body of so many points, its fibers along x and y.
class LentLaw {
 public:
  LentLaw(const std::string& name, const std::map<std::string, double>& parameters, std::size_t points);
  ~LentLaw();
  const cleave_elastic_response* table() const;

 private:
  struct Lent;
  std::unique_ptr<Lent> lent_;
};

}  // namespace cleave::test
