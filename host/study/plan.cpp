#include "study/plan.hpp"

#include "common/error.hpp"

#include <fmt/format.h>
#include <toml++/toml.h>

#include <algorithm>
#include <cstdlib>
#include <fstream>
#include <functional>

namespace cleave::study {
namespace {

namespace fs = std::filesystem;

/// Contents of all files that a scene names.
void add_files(const toml::node& node, Digest& digest) {
  if (const auto* text = node.as_string()) {
    std::error_code error;
    if (text->get().find('/') != std::string::npos && fs::is_regular_file(text->get(), error)) digest.add_file(text->get());
  } else if (const auto* list = node.as_array()) {
    for (const toml::node& element : *list) add_files(element, digest);
  } else if (const auto* table = node.as_table()) {
    for (const auto& [key, value] : *table) add_files(value, digest);
  }
}

/// The program and what it loads beside plugins.
std::string program_digest() {
  Digest digest;
  const fs::path program = fs::read_symlink("/proc/self/exe");
  digest.add(CLEAVE_VERSION).add_file(program);
  std::vector<fs::path> kernels;
  std::error_code error;
  for (const auto& entry : fs::directory_iterator(program.parent_path().parent_path() / "lib/cleave/kernels", error))
    kernels.push_back(entry.path());
  std::sort(kernels.begin(), kernels.end());
  for (const auto& path : kernels) digest.add_file(path);
  const char* isa = std::getenv("CLEAVE_ISA");
  return digest.add(isa ? isa : "").hex();
}

void add_plugins(const config::Scene& scene, const plugins::Registry& registry, Digest& digest) {
  const auto add = [&](const config::PluginUse& use) {
    for (const plugins::Found& found : registry.found())
      if (found.refusal.empty() && found.description->id == use.id)
        digest.add(use.id).add(found.description->version).add_file(found.path);
  };
  for (const config::Material& material : scene.materials) {
    add(material.elasticity);
    for (const auto* use : {&material.plasticity, &material.damage, &material.constraint, &material.discretization})
      if (*use) add(**use);
  }
}

class Planner {
 public:
  Planner(const Study& study, const plugins::Registry& registry, Plan& plan)
      : study_(study), registry_(registry), plan_(plan), program_(program_digest()) {}

  std::size_t run(const std::string& what, const std::vector<config::Override>& overrides) {
    Run run{what, overrides, {}, {}, {}};
    Digest digest;
    digest.add(program_).add(std::to_string(study_.threads));
    try {
      config::Scene scene = config::load_scene(study_.scene, overrides, registry_);
      scene.output.formats.clear();
      if (study_.error && study_.error->particles) scene.output.formats.push_back("vtp");
      scene.output.surface = false;
      if (std::any_of(scene.materials.begin(), scene.materials.end(), [](const auto& m) { return bool(m.discretization); }))
        scene.output.meshes.emplace();
      scene.output.checkpoint = {.frames = 0, .seconds = 0};  // runs are whole or none
      run.scene = config::to_toml(scene, registry_);
      add_plugins(scene, registry_, digest);
      digest.add(run.scene);
      add_files(toml::parse(run.scene), digest);
    } catch (const InputError& refusal) {
      run.refusal = refusal.what();
      digest.add(run.refusal);
      for (const auto& given : overrides) digest.add(given.path).add(given.value);
    }
    run.key = digest.hex();
    const auto same = std::find_if(plan_.runs.begin(), plan_.runs.end(), [&](const Run& r) { return r.key == run.key; });
    if (same != plan_.runs.end()) return std::size_t(same - plan_.runs.begin());
    plan_.runs.push_back(std::move(run));
    return plan_.runs.size() - 1;
  }

 private:
  const Study& study_;
  const plugins::Registry& registry_;
  Plan& plan_;
  std::string program_;
};

void append(std::vector<config::Override>& list, const std::vector<config::Override>& more) {
  list.insert(list.end(), more.begin(), more.end());
}

std::vector<config::Override> overrides_at(const Study& study, const std::vector<std::size_t>& at) {
  std::vector<config::Override> overrides = study.set;
  for (std::size_t i = 0; i < at.size(); ++i) append(overrides, study.axes[i].values[at[i]].overrides);
  return overrides;
}

}  // namespace

Digest& Digest::add(std::string_view text) {
  const auto mix = [&](unsigned char byte) { hash_ = (hash_ ^ byte) * 1099511628211u; };
  for (const char c : text) mix(static_cast<unsigned char>(c));
  mix(0xff);
  return *this;
}

Digest& Digest::add_file(const fs::path& path) {
  std::ifstream file(path, std::ios::binary);
  std::string buffer(1 << 20, '\0');
  while (file.read(buffer.data(), std::streamsize(buffer.size())), file.gcount() > 0)
    add(std::string_view(buffer.data(), std::size_t(file.gcount())));
  return add("");
}

std::string Digest::hex() const { return fmt::format("{:016x}", hash_); }

std::vector<std::vector<std::size_t>> product(const std::vector<Axis>& axes) {
  std::vector<std::vector<std::size_t>> places{{}};
  for (const Axis& axis : axes) {
    std::vector<std::vector<std::size_t>> longer;
    for (const auto& place : places)
      for (std::size_t i = 0; i < axis.values.size(); ++i) {
        longer.push_back(place);
        longer.back().push_back(i);
      }
    places = std::move(longer);
  }
  return places;
}

std::string name_of(const Study& study, const std::vector<std::size_t>& at) {
  std::string name;
  for (std::size_t i = 0; i < at.size(); ++i) {
    const Axis& axis = study.axes[i];
    name += fmt::format("{}{} {}{}{}", i > 0 ? ", " : "", axis.name, axis.values[at[i]].label, axis.unit.empty() ? "" : " ",
                        axis.unit);
  }
  return name;
}

std::vector<double> numbers_at(const Study& study, const std::vector<std::size_t>& at) {
  std::vector<double> numbers;
  for (std::size_t i = 0; i < at.size(); ++i)
    if (study.axes[i].numeric()) numbers.push_back(*study.axes[i].values[at[i]].number);
  return numbers;
}

Plan make_plan(const Study& study, const plugins::Registry& registry) {
  Plan plan;
  Planner planner(study, registry, plan);
  for (const auto& at : product(study.axes)) {
    Point point;
    point.at = at;
    point.run = planner.run(name_of(study, at), overrides_at(study, at));
    plan.points.push_back(point);
  }
  if (study.error && study.error->has_reference)
    for (Point& point : plan.points) {
      std::vector<std::size_t> at = point.at;
      for (std::size_t i = 0; i < at.size(); ++i) {
        const auto wanted = study.error->reference_at.find(study.axes[i].name);
        if (wanted == study.error->reference_at.end()) continue;
        const auto& values = study.axes[i].values;
        at[i] = std::size_t(
            std::find_if(values.begin(), values.end(), [&](const AxisValue& value) { return value.label == wanted->second; }) -
            values.begin());
      }
      auto overrides = overrides_at(study, at);
      append(overrides, study.error->reference_set);
      point.reference = planner.run("reference: " + name_of(study, at), overrides);
    }
  if (study.map && study.map->bound_of_runs)
    for (std::size_t i = 0; i < study.axes[0].values.size(); ++i) {
      auto overrides = study.set;
      append(overrides, study.axes[0].values[i].overrides);
      append(overrides, study.map->bound_set);
      plan.bound_runs.push_back(planner.run("bound: " + name_of(study, {i}), overrides));
    }
  return plan;
}

}  // namespace cleave::study
