#include <cleave/testkit/plugin.hpp>

#include <cleave/constraint.h>
#include <cleave/damage.h>
#include <cleave/discretization.h>
#include <cleave/plasticity.h>
#include <cleave/testkit/check.hpp>

#include <dlfcn.h>

#include <cmath>

namespace cleave::testkit {
namespace {

struct KindName {
  const char *prefix, *id;
  std::uint32_t bit;
};
constexpr KindName kind_names[] = {{"elasticity/", CLEAVE_KIND_ELASTICITY, elasticity_kind},
                                   {"plasticity/", CLEAVE_KIND_PLASTICITY, plasticity_kind},
                                   {"damage/", CLEAVE_KIND_DAMAGE, damage_kind},
                                   {"constraint/", CLEAVE_KIND_CONSTRAINT, constraint_kind},
                                   {"discretization/", CLEAVE_KIND_DISCRETIZATION, discretization_kind}};

/// Functions without which a law of the kind cannot be used; empty if all are there.
std::string missing_function(std::uint32_t kind, const void* table, const cleave_schema& schema) {
  const auto precisions = [&](bool single_precision, bool double_precision) -> std::string {
    if (single_precision != bool(schema.capabilities & CLEAVE_SINGLE)) return "its f32 function and CLEAVE_SINGLE disagree";
    if (double_precision != bool(schema.capabilities & CLEAVE_DOUBLE)) return "its f64 function and CLEAVE_DOUBLE disagree";
    return single_precision || double_precision ? "" : "offers no precision";
  };
  switch (kind) {
    case elasticity_kind: {
      const auto& t = *static_cast<const cleave_elasticity*>(table);
      return precisions(t.evaluate_f32, t.evaluate_f64);
    }
    case plasticity_kind: {
      const auto& t = *static_cast<const cleave_plasticity*>(table);
      return precisions(t.return_map_f32, t.return_map_f64);
    }
    case damage_kind: {
      const auto& t = *static_cast<const cleave_damage*>(table);
      return t.model ? precisions(t.drive_f32, t.drive_f64) : "the damage table has no model()";
    }
    case constraint_kind:
      return static_cast<const cleave_constraint*>(table)->project ? "" : "the constraint table has no project()";
    default: {
      const auto& t = *static_cast<const cleave_discretization*>(table);
      return t.add_body && t.stable_step && t.step && t.point_field && t.surface && t.save && t.restore
                 ? ""
                 : "the discretization table has a null function";
    }
  }
}

}  // namespace

std::string kinds_text(std::uint32_t kinds) {
  if (kinds == all_kinds) return "all";
  std::string all;
  for (const auto& kind : kind_names)
    if (kinds & kind.bit) {
      const std::string prefix = kind.prefix;
      all += (all.empty() ? "" : ", ") + prefix.substr(0, prefix.size() - 1);
    }
  return all;
}

void* open_library(const std::filesystem::path& path) {
  // Local and at once, as the host does.
  void* handle = dlopen(std::filesystem::absolute(path).c_str(), RTLD_NOW | RTLD_LOCAL);
  if (!handle) throw Failed{"cannot be loaded: " + std::string(dlerror())};
  return handle;
}

cleave_plugin_entry_fn entry_of(void* handle) {
  const auto entry = reinterpret_cast<cleave_plugin_entry_fn>(dlsym(handle, CLEAVE_ENTRY_SYMBOL));
  if (!entry) throw Failed{"exports no " CLEAVE_ENTRY_SYMBOL};
  return entry;
}

cleave_host this_host() { return {sizeof(cleave_host), {CLEAVE_ABI_MAJOR, CLEAVE_ABI_MINOR}, "cleave", "1.0.0"}; }

std::string Words::said() const { return std::string(subject) + (subject[0] ? " " : "") + (text[0] ? text : "(no words)"); }

Plugin::Plugin(const std::filesystem::path& path) : handle_(open_library(path)) {
  const cleave_host host = this_host();
  const cleave_result result = entry_of(handle_)(&host, &table_);
  if (result != CLEAVE_OK || !table_) throw Failed{CLEAVE_ENTRY_SYMBOL " failed with result " + std::to_string(result)};
  if (table_->abi.major != CLEAVE_ABI_MAJOR) throw Failed{"speaks another major version of the ABI"};
  if (table_->struct_size < offsetof(cleave_plugin, initial_state) + sizeof(void*)) throw Failed{"its table is too small"};
  if (!table_->about || !table_->about->id || !table_->schema) throw Failed{"describes neither itself nor its parameters"};
  if (!table_->kind || !table_->extension || !table_->create || !table_->destroy) throw Failed{"its table has a null function"};
  id_ = table_->about->id;
  for (const auto& name : kind_names)
    if (id_.rfind(name.prefix, 0) == 0) {
      kind_ = name.bit;
      kind_table_ = table_->kind(name.id);
    }
  if (!kind_) throw Failed{"its ID \"" + id_ + "\" does not begin with a kind (\"elasticity/\", ...)"};
  if (!kind_table_) throw Failed{"gives no table for the kind its ID names"};
  if (const auto problem = missing_function(kind_, kind_table_, schema()); !problem.empty()) throw Failed{problem};
}

Plugin::~Plugin() { dlclose(handle_); }

Material::Material(std::uint32_t kind)
    : response{sizeof response, CLEAVE_PRESSURE_QUADRATIC, shear_modulus, bulk_modulus},
      probe{sizeof probe, 0, shear_modulus, bulk_modulus,
            [](const cleave_elastic_probe*, const double* F) { return tensile_energy(F); }},
      context{sizeof context, 3, 0.01, 1000, &response, &probe} {
  if (kind == elasticity_kind || kind == discretization_kind) {
    context.isochoric = nullptr;
    context.elastic = nullptr;
  }
  if (kind == discretization_kind) context.cell_size = 0;
}

namespace {
double determinant(const double* F) {
  return F[0] * (F[4] * F[8] - F[5] * F[7]) - F[1] * (F[3] * F[8] - F[5] * F[6]) + F[2] * (F[3] * F[7] - F[4] * F[6]);
}
double squared_norm(const double* F) {
  double sum = 0;
  for (int i = 0; i < 9; ++i) sum += F[i] * F[i];
  return sum;
}
}  // namespace

double Material::tensile_energy(const double* F) {
  const double J = determinant(F);
  if (!(J > 0)) return std::nan("");
  const double shear = 0.5 * shear_modulus * (squared_norm(F) / std::cbrt(J * J) - 3);
  return shear + (J >= 1 ? 0.5 * bulk_modulus * (0.5 * (J * J - 1) - std::log(J)) : 0);
}

void Material::effective_stress(const double* F, double* stress) {
  constexpr int rows[6][2] = {{0, 0}, {1, 1}, {2, 2}, {0, 1}, {0, 2}, {1, 2}};
  const double J = determinant(F), mean = squared_norm(F) / 3, pressure = 0.5 * bulk_modulus * (J * J - 1);
  for (int c = 0; c < 6; ++c) {
    double b = 0;
    for (int k = 0; k < 3; ++k) b += F[3 * rows[c][0] + k] * F[3 * rows[c][1] + k];
    stress[c] = (shear_modulus / std::cbrt(J * J) * (b - (c < 3 ? mean : 0)) + (c < 3 ? pressure : 0)) / J;
  }
}

Instance::Instance(const Plugin& plugin, const Settings& settings)
    : plugin_(plugin), material_(plugin.kind()), capabilities_(capabilities_with(plugin.schema(), settings)) {
  const PackedParameters parameters(plugin.schema(), settings);
  Words words;
  const cleave_result result = plugin.table().create(parameters.get(), &material_.context, &handle_, &words.message);
  if (result != CLEAVE_OK) throw Failed{"create() refuses " + text(settings) + ": " + words.said()};
  if (!handle_) throw Failed{"create() gave no instance and no error for " + text(settings)};
}
Instance::~Instance() {
  if (handle_) plugin_.table().destroy(handle_);
}

int state_components(const cleave_schema& schema) {
  int count = 0;
  for (std::uint32_t i = 0; i < schema.state_count; ++i) count += int(schema.states[i]->tensor);
  return count;
}

std::vector<double> Instance::initial_state() const {
  const cleave_schema& schema = plugin_.schema();
  std::vector<double> values;
  for (std::uint32_t i = 0; i < schema.state_count; ++i)
    values.insert(values.end(), schema.states[i]->initial, schema.states[i]->initial + schema.states[i]->tensor);
  // Room for a plugin that writes too much, which `metadata.state-size` looks for.
  values.resize(values.size() + 64);
  if (plugin_.table().initial_state && values.size() > 64) plugin_.table().initial_state(handle_, values.data());
  values.resize(values.size() - 64);
  return values;
}

}  // namespace cleave::testkit
