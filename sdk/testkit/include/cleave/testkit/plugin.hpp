/// A plugin library opened as the host opens it, and instances of its law.
#ifndef CLEAVE_TESTKIT_PLUGIN_HPP
#define CLEAVE_TESTKIT_PLUGIN_HPP

#include <cleave/abi.h>
#include <cleave/elasticity.h>
#include <cleave/testkit/parameters.hpp>

#include <cstdint>
#include <filesystem>
#include <string>
#include <vector>

namespace cleave::testkit {

/// Throws Failed with the reason where a host would refuse the library.
class Plugin {
 public:
  explicit Plugin(const std::filesystem::path&);
  ~Plugin();
  Plugin(const Plugin&) = delete;
  Plugin& operator=(const Plugin&) = delete;

  const cleave_plugin& table() const { return *table_; }
  const cleave_schema& schema() const { return *table_->schema; }
  const std::string& id() const { return id_; }
  std::uint32_t kind() const { return kind_; }  ///< one bit of Kinds
  const void* kind_table() const { return kind_table_; }
  bool can(std::uint64_t capability) const { return (schema().capabilities & capability) != 0; }

 private:
  void* handle_;
  const cleave_plugin* table_ = nullptr;
  std::string id_;
  std::uint32_t kind_ = 0;
  const void* kind_table_ = nullptr;
};

void* open_library(const std::filesystem::path&);  ///< throws Failed
cleave_plugin_entry_fn entry_of(void* handle);     ///< throws Failed
cleave_host this_host();

/// What a plugin wrote to a message.
struct Words {
  char text[1024] = {}, subject[128] = {};
  cleave_message message{sizeof(cleave_message), sizeof text, text, sizeof subject, 0, subject};
  std::string said() const;  ///< "subject: text"
};

/// The surroundings laws are created in: three dimensions, cells of 1 cm, 1000 kg/m^3, and as elastic law of the material a
/// neo-Hookean solid of mu = 1e5 Pa, kappa = 2e5 Pa:
///   psi_plus = mu/2 (J^(-2/3) tr b - 3) + [J >= 1] kappa/2 ((J^2 - 1)/2 - ln J),  s = (mu J^(-2/3) dev b + kappa/2 (J^2-1)
///   I)/J
struct Material {
  static constexpr double shear_modulus = 1e5, bulk_modulus = 2e5;
  static constexpr double youngs_modulus = 9 * bulk_modulus * shear_modulus / (3 * bulk_modulus + shear_modulus);
  explicit Material(std::uint32_t kind);
  Material(const Material&) = delete;
  Material& operator=(const Material&) = delete;

  static double tensile_energy(const double* F);
  static void effective_stress(const double* F, double* stress);

  cleave_isochoric_response response;
  cleave_elastic_probe probe;
  cleave_context context;
};

class Instance {
 public:
  /// Throws Failed with the plugin's words if it refuses.
  Instance(const Plugin&, const Settings&);
  ~Instance();
  Instance(const Instance&) = delete;
  Instance& operator=(const Instance&) = delete;

  const Plugin& plugin() const { return plugin_; }
  cleave_instance* handle() const { return handle_; }
  std::uint64_t capabilities() const { return capabilities_; }
  bool can(std::uint64_t capability) const { return (capabilities_ & capability) != 0; }
  std::vector<double> initial_state() const;

 private:
  const Plugin& plugin_;
  Material material_;
  std::uint64_t capabilities_;
  cleave_instance* handle_ = nullptr;
};

int state_components(const cleave_schema&);

}  // namespace cleave::testkit

#endif
