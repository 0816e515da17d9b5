#include "config/catalog.hpp"

#include <algorithm>

namespace cleave::config {
namespace {

/// "libcleave_split_neo_hookean.so" and "split-neo-hookean" become comparable.
std::string comparable(std::string text) {
  std::replace(text.begin(), text.end(), '_', '-');
  return text;
}

bool named_like(const std::filesystem::path& file, std::string_view id) {
  const std::string stem = comparable(file.stem().string());
  const std::string law = comparable(std::string(id.substr(id.find('/') + 1)));
  if (stem.size() < law.size() || stem.compare(stem.size() - law.size(), law.size(), law) != 0) return false;
  return stem.size() == law.size() || stem[stem.size() - law.size() - 1] == '-' || stem == "lib" + law;
}

class RegistryCatalog : public PluginCatalog {
 public:
  explicit RegistryCatalog(const plugins::Registry& registry) : registry_(registry) {}

  const plugins::Description* find(std::string_view id) const override { return registry_.find(id); }
  std::vector<std::string> ids(plugins::Kind kind) const override { return registry_.ids(kind); }
  std::vector<std::filesystem::path> search_path() const override { return registry_.search_path(); }

  std::string refusal(std::string_view id) const override {
    for (const plugins::Found& found : registry_.found()) {
      if (found.refusal.empty()) continue;
      if (found.description ? found.description->id == id : named_like(found.path, id))
        return found.path.string() + ": " + found.refusal;
    }
    return {};
  }

 private:
  const plugins::Registry& registry_;
};

}  // namespace

std::unique_ptr<PluginCatalog> catalog_of(const plugins::Registry& registry) {
  return std::make_unique<RegistryCatalog>(registry);
}

Scene load_scene(const std::filesystem::path& file, const std::vector<Override>& overrides, const plugins::Registry& registry,
                 std::vector<std::string>* warnings) {
  return load_scene(file, overrides, RegistryCatalog(registry), warnings);
}

std::string to_toml(const Scene& scene, const plugins::Registry& registry) { return to_toml(scene, RegistryCatalog(registry)); }

}  // namespace cleave::config
