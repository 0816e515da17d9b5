#include "config/catalog.hpp"

#include "common/error.hpp"
#include "common/nesting.hpp"
#include "config/field_reader.hpp"
#include "config/geometry_reader.hpp"
#include "config/law_reader.hpp"
#include "config/overrides.hpp"
#include "config/tetrahedra_reader.hpp"

#include <spdlog/fmt/fmt.h>

#include <algorithm>
#include <cmath>
#include <fstream>
#include <limits>
#include <map>
#include <vector>

namespace cleave::config {
namespace {

constexpr std::uintmax_t largest_file = 64u << 20;
constexpr std::int64_t most_particles_per_cell = 32768;

std::string read_text(const std::filesystem::path& path) {
  const std::string name = path.string();
  std::error_code status;
  const auto kind = std::filesystem::status(path, status).type();
  if (kind == std::filesystem::file_type::not_found) throw InputError(name + ": error: there is no such file");
  if (kind == std::filesystem::file_type::directory) throw InputError(name + ": error: is a directory, not a scene file");
  const auto too_large = [&] {
    return InputError(name + ": error: the file is larger than 64 MiB, which no scene needs; put particles into a CSV file");
  };
  const auto size = std::filesystem::file_size(path, status);
  if (!status && size > largest_file) throw too_large();
  std::ifstream file(path, std::ios::binary);
  if (!file) throw InputError(name + ": error: the file cannot be read");
  std::string text;
  std::vector<char> piece(1 << 16);
  while (file.read(piece.data(), std::streamsize(piece.size())), file.gcount() > 0) {
    text.append(piece.data(), std::size_t(file.gcount()));
    if (text.size() > largest_file) throw too_large();  // of a pipe or a device
  }
  if (!file.eof()) throw InputError(name + ": error: the file cannot be read");
  return text;
}

/// "Error while parsing string: what" as "what (in a string)".
std::string syntax_problem(std::string_view description) {
  constexpr std::string_view opening = "Error while parsing ";
  const auto colon = description.find(": ");
  if (description.rfind(opening, 0) != 0 || colon == std::string_view::npos) return std::string(description);
  const std::string what(description.substr(colon + 2));
  return what + " (in a " + std::string(description.substr(opening.size(), colon - opening.size())) + ")";
}

toml::table parse(const std::string& text, const std::string& file) {
  if (const int line = line_nested_too_deep(text))
    throw InputError(fmt::format("{}:{}: error: values are nested deeper than {} tables", file, line, deepest_toml));
  try {
    return toml::parse(text, file);
  } catch (const toml::parse_error& problem) {
    throw InputError(to_string(locate(problem.source())) + ": error: not TOML: " + syntax_problem(problem.description()));
  }
}

/// Names stand in messages, output files and overrides: plain, and not to be taken for an index.
bool usable_name(const std::string& name) {
  const auto plain = [](char c) {
    return (c >= 'a' && c <= 'z') || (c >= 'A' && c <= 'Z') || (c >= '0' && c <= '9') || c == '_' || c == '-' || c == ' ';
  };
  const auto digit = [](char c) { return c >= '0' && c <= '9'; };
  return !name.empty() && name.size() <= 64 && name.front() != ' ' && name.back() != ' ' &&
         std::all_of(name.begin(), name.end(), plain) && !std::all_of(name.begin(), name.end(), digit);
}

/// Reads `name` of one kind of thing and sees to it that no two share one.
class Names {
 public:
  explicit Names(std::string kind) : kind_(std::move(kind)) {}

  /// `fallback` empty: a name is required.
  std::string read(TableReader& table, const std::string& fallback = {}) {
    if (fallback.empty() && !table.require("name", "a text")) return unusable();
    if (!table.has("name")) {
      table.rename(kind_ + " '" + fallback + "'");
      return fallback;
    }
    const auto name = table.text("name");
    if (!name) return unusable();
    if (!usable_name(*name)) {
      table.error_at("name",
                     "'name' must be 1 to 64 letters, digits, '_', '-' or inner spaces, not all digits; is \"" + *name + "\"");
      return unusable();
    }
    table.rename(kind_ + " '" + *name + "'");
    const auto [entry, is_new] = first_.emplace(*name, table.where("name"));
    if (!is_new)
      table.error_at("name", "there already is a " + kind_ + " named '" + *name + "', at " + to_string(entry->second));
    return *name;
  }

  /// Reports a reference to a name that is not there, unless that only follows from what was reported before.
  void check(TableReader& table, std::string_view key, const std::string& name) const {
    if (incomplete_ || first_.empty() || first_.count(name)) return;
    std::vector<std::string> names;
    for (const auto& [known, where] : first_) names.push_back(known);
    table.error_at(
        key, "there is no " + kind_ + " named '" + name + "'" + suggestion(name, names, "; there are: " + list_text(names)));
  }

 private:
  std::string unusable() {
    incomplete_ = true;
    return {};
  }

  std::string kind_;
  std::map<std::string, Location> first_;
  bool incomplete_ = false;  ///< a name could not be read
};

void read_time_step(TableReader& table, Simulation& simulation) {
  const toml::node* node = table.find("time_step");
  if (!node || (node->is_string() && node->as_string()->get() == "auto")) return;
  if (node->is_number())
    simulation.time_step = table.number("time_step", "s", Range::positive());
  else
    table.error_at("time_step", "'time_step' must be \"auto\" or a number (s), is " + found(*node));
}

constexpr Range between_0_and_1{.minimum = 0, .maximum = 1, .minimum_open = true, .maximum_open = true};

ImplicitSolver read_implicit_solver(TableReader table) {
  ImplicitSolver solver;
  solver.tolerance = table.number("tolerance", "1", between_0_and_1).value_or(solver.tolerance);
  solver.maximum_iterations = int(table.integer("maximum_iterations", 1, 1000).value_or(solver.maximum_iterations));
  solver.maximum_linear_iterations =
      int(table.integer("maximum_linear_iterations", 1, 100000).value_or(solver.maximum_linear_iterations));
  table.finish();
  return solver;
}

/// "integrator" and what goes with it. The choice of an automatic one is that of a step, too, so that none can be given.
void read_integrator(TableReader& table, Simulation& simulation) {
  const bool has_integrator = table.has("integrator");
  const auto integrator = table.choice("integrator", {"symplectic", "implicit", "auto"});
  simulation.integrator = Integrator(integrator.value_or(std::size_t(simulation.integrator)));
  if (has_integrator && !integrator) {
    table.has("implicit");
  } else if (simulation.integrator == Integrator::symplectic) {
    table.refuse("implicit", "is only used with integrator = \"implicit\" or \"auto\"");
  } else if (auto implicit = table.table("implicit", "[simulation.implicit]")) {
    simulation.implicit = read_implicit_solver(std::move(*implicit));
  }
  if (simulation.integrator == Integrator::automatic && simulation.time_step)
    table.error_at("time_step",
                   "'time_step' must be \"auto\" with integrator = \"auto\", which compares the steps that each integrator can "
                   "take; give 'maximum_time_step', or name the integrator");
}

DamageSolver read_damage_solver(TableReader table) {
  DamageSolver solver;
  solver.passes = int(table.integer("passes", 1, 20).value_or(solver.passes));
  solver.tolerance = table.number("tolerance", "1", between_0_and_1).value_or(solver.tolerance);
  solver.maximum_iterations = int(table.integer("maximum_iterations", 1, 100000).value_or(solver.maximum_iterations));
  solver.laplacian = Laplacian(table.choice("laplacian", {"weak", "cubic"}).value_or(std::size_t(solver.laplacian)));
  solver.active_set = table.boolean("active_set").value_or(solver.active_set);
  table.finish();
  return solver;
}

/// `tetrahedra`: bodies may say what cells do not.
Simulation read_simulation(TableReader table, bool tetrahedra) {
  Simulation simulation;
  ReadContext& context = table.context();
  if (const auto dimension = table.integer("dimension", 2, 3)) simulation.dimension = context.dimension = int(*dimension);
  simulation.cell_size = context.cell_size = tetrahedra ? table.number("cell_size", "m", Range::positive()).value_or(0)
                                                        : table.required_number("cell_size", "m", Range::positive());
  simulation.end_time = table.required_number("end_time", "s", Range::positive());
  simulation.frame_rate = table.number("frame_rate", "1/s", Range::positive()).value_or(simulation.frame_rate);
  read_time_step(table, simulation);
  simulation.maximum_time_step = table.number("maximum_time_step", "s", Range::not_negative()).value_or(0);
  simulation.cfl = table.number("cfl", "1", {.minimum = 0, .maximum = 1, .minimum_open = true}).value_or(simulation.cfl);
  simulation.precision = Precision(table.choice("precision", {"single", "double"}).value_or(std::size_t(simulation.precision)));
  if (const auto gravity = table.vector("gravity", {.unit = "m/s^2", .planar = true})) simulation.gravity = *gravity;
  const bool has_transfer = table.has("transfer");
  const auto transfer = table.choice("transfer", {"apic", "flip", "pic"});
  simulation.transfer = Transfer(transfer.value_or(std::size_t(simulation.transfer)));
  if (simulation.transfer != Transfer::flip && !(has_transfer && !transfer))
    table.refuse("flip_ratio", "is only used with transfer = \"flip\"");
  else
    simulation.flip_ratio = table.number("flip_ratio", "1", Range::between(0, 1)).value_or(simulation.flip_ratio);
  read_integrator(table, simulation);
  if (auto damage = table.table("damage", "[simulation.damage]")) simulation.damage = read_damage_solver(std::move(*damage));
  table.finish();
  return simulation;
}

/// A material and what checking it with its bodies has to know.
struct ReadMaterial {
  Material material;
  bool has_damage = false;      ///< the file gives a damage law, usable or not
  bool discretized = false;     ///< the file gives a discretization, usable or not
  bool elastic = true;          ///< there may be an elastic law
  bool tetrahedral = false;     ///< its discretization steps bodies of tetrahedra alone
  bool fibers_refused = false;  ///< its own or a body's cannot be used
};

/// fibers or fibres; `refused` if they are given and cannot be used.
std::optional<Fibers> read_fibers_of(TableReader& table, bool& refused) {
  const bool american = table.has("fibers"), british = table.has("fibres");
  if (american && british) table.refuse("fibres", "and 'fibers' are the same; give one of them");
  if (!american && !british) return std::nullopt;
  const char* key = american ? "fibers" : "fibres";
  std::optional<Fibers> fibers;
  if (auto reader = table.table(key, "'" + std::string(key) + "' of " + table.what())) fibers = read_fibers(std::move(*reader));
  refused = refused || !fibers;
  return fibers;
}

void refuse_fibers(TableReader& table) {
  for (const char* key : {"fibers", "fibres"})
    table.refuse(key, "has no effect: fibers are read by laws, and there are none with this discretization");
}

ReadMaterial read_material(TableReader table, Names& names) {
  ReadMaterial read;
  Material& material = read.material;
  material.where = table.where();
  material.name = names.read(table);
  material.density = table.required_number("density", "kg/m^3", Range::positive());
  const auto law = [&](plugins::Kind kind) -> std::optional<PluginUse> {
    const char* key = plugins::name(kind);
    auto reader = table.table(key, "'" + std::string(key) + "' of " + table.what());
    return reader ? read_law(std::move(*reader), kind) : std::nullopt;
  };
  if (table.has("discretization")) {
    read.discretized = true;
    material.discretization = law(plugins::Kind::discretization);
    for (const char* key : {"plasticity", "damage", "constraint"})
      table.refuse(key, "cannot be given together with 'discretization', a plugin that steps the bodies as a whole");
    if (const auto* plugin = material.discretization ? table.context().catalog.find(material.discretization->id) : nullptr) {
      const std::uint64_t capabilities = plugin->capabilities_with(material.discretization->parameters);
      read.elastic = (capabilities & CLEAVE_NEEDS_ELASTICITY) != 0;
      read.tetrahedral = (capabilities & CLEAVE_NEEDS_TETRAHEDRA) != 0;
      if (read.tetrahedral && table.context().dimension == 2)
        table.error_at("discretization", "'" + plugin->id + "' steps tetrahedra, which need a scene of dimension = 3");
      if (read.elastic)
        table.require("elasticity", "the law that '" + plugin->id + "' evaluates, as { plugin = \"split-neo-hookean\", ... }");
      else
        table.refuse("elasticity", "cannot be given together with 'discretization': '" + plugin->id +
                                       "' evaluates no elastic law; how stiff bodies are is among its parameters");
    }
    if (read.elastic) {
      if (auto elasticity = law(plugins::Kind::elasticity)) material.elasticity = std::move(*elasticity);
      material.fibers = read_fibers_of(table, read.fibers_refused);
    } else {
      refuse_fibers(table);
    }
    table.finish();
    return read;
  }
  if (table.require("elasticity", "a table as { plugin = \"split-neo-hookean\", ... }"))
    if (auto elasticity = law(plugins::Kind::elasticity)) material.elasticity = std::move(*elasticity);
  material.plasticity = law(plugins::Kind::plasticity);
  material.damage = law(plugins::Kind::damage);
  material.constraint = law(plugins::Kind::constraint);
  read.has_damage = table.has("damage");
  material.fibers = read_fibers_of(table, read.fibers_refused);
  table.finish();
  return read;
}

void check_particles_per_cell(TableReader& table, const scene::SamplingSpec& sampling) {
  if (sampling.pattern == scene::SamplingPattern::blue_noise) return;
  const int dimension = table.context().dimension;
  const auto power = [&](int n) { return dimension == 2 ? n * n : n * n * n; };
  const int root = std::max(
      1, int(std::lround(dimension == 2 ? std::sqrt(sampling.particles_per_cell) : std::cbrt(sampling.particles_per_cell))));
  if (power(root) == sampling.particles_per_cell) return;
  const int lower = power(root) < sampling.particles_per_cell ? root : root - 1;
  table.error_at("particles_per_cell",
                 std::string("'particles_per_cell' must be a ") + (dimension == 2 ? "square" : "cube") + " in dimension " +
                     std::to_string(dimension) + " unless sampling = \"blue-noise\", is " +
                     std::to_string(sampling.particles_per_cell) + "; nearest are " +
                     std::to_string(power(std::max(lower, 1))) + " and " + std::to_string(power(lower + 1)));
}

void read_sampling(TableReader& table, Body& body) {
  scene::SamplingSpec& sampling = body.sampling;
  sampling.particles_per_cell = table.context().dimension == 2 ? 4 : 8;
  const auto per_cell = table.integer("particles_per_cell", 1, most_particles_per_cell);
  if (per_cell) sampling.particles_per_cell = int(*per_cell);
  if (table.has("particles")) {
    for (const char* key : {"sampling", "jitter", "seed"}) table.refuse(key, "has no meaning for particles from a file");
    return;
  }
  const bool has_pattern = table.has("sampling");
  const auto pattern = table.choice("sampling", {"regular", "jittered", "blue-noise"});
  if (pattern) sampling.pattern = scene::SamplingPattern(*pattern);
  if (has_pattern && !pattern) {
    table.has("jitter");
  } else if (sampling.pattern != scene::SamplingPattern::jittered) {
    table.refuse("jitter", "is only used with sampling = \"jittered\"");
  } else {
    sampling.jitter = table.number("jitter", "1", Range::between(0, 1)).value_or(sampling.jitter);
  }
  sampling.seed =
      std::uint64_t(table.integer("seed", 0, std::numeric_limits<std::int64_t>::max()).value_or(std::int64_t(sampling.seed)));
  if (per_cell && !(has_pattern && !pattern)) check_particles_per_cell(table, sampling);
}

Spin read_spin(TableReader table) {
  Spin spin;
  if (table.require("angular_velocity",
                    table.context().dimension == 2 ? "a number (degrees/s)" : "a list of 3 numbers (degrees/s)"))
    if (const auto velocity = read_rotation(table, "angular_velocity", "degrees/s")) spin.angular_velocity = *velocity;
  spin.center = table.vector("center", {.unit = "m"});
  table.finish();
  return spin;
}

/// Whether the body's tetrahedra, if it is to have any, can be used.
void read_tetrahedra_of(TableReader& table, Body& body, const ReadMaterial* material) {
  auto reader = table.table("tetrahedra", "'tetrahedra' of " + table.what());
  if (!reader) return;
  if (table.context().dimension == 2)
    table.error_at("tetrahedra", "'tetrahedra' fill space; a scene of dimension 2 (plane strain) has none, use dimension = 3");
  else if (material && !material->discretized)
    table.refuse("tetrahedra",
                 "has no effect: the material point method fills a shape with particles; only a 'discretization' "
                 "plugin of the material takes tetrahedra");
  body.tetrahedra = read_tetrahedra(std::move(*reader));
  for (const char* key : {"particles_per_cell", "sampling", "jitter", "seed"})
    table.refuse(key, "has no meaning for tetrahedra: the points are their barycentres");
}

/// What a body is made of: particles that fill a shape or come from a file, or the tetrahedra of a shape or of a file.
void read_contents(TableReader& table, Body& body, const ReadMaterial* material) {
  const bool has_shape = table.has("shape"), has_particles = table.has("particles"), has_tetrahedra = table.has("tetrahedra");
  read_tetrahedra_of(table, body, material);
  const bool from_file = body.tetrahedra && body.tetrahedra->file;
  if (has_tetrahedra && has_particles)
    table.refuse("particles", "cannot be given together with 'tetrahedra', whose barycentres are the points");
  else if (has_shape && has_particles)
    table.refuse("particles", "cannot be given together with 'shape'");
  else if (has_shape && from_file)
    table.refuse("shape", "cannot be given together with the 'file' of 'tetrahedra', which is the shape");
  else if (!has_shape && has_tetrahedra && body.tetrahedra && !from_file)
    table.error(table.where(), table.what() + " needs 'shape', a table, for 'tetrahedra' to be cut of, or a 'file' of them");
  else if (!has_shape && !has_particles && !has_tetrahedra)
    table.error(table.where(), table.what() + " needs 'shape', a table, or 'particles', a CSV file");
  if (!has_tetrahedra && material && material->tetrahedral)
    table.error(table.where(), table.what() + " needs tetrahedra: '" + material->material.discretization->id +
                                   "' steps nothing else; add tetrahedra = { edge_length = ... } or { file = \"...\" }");
  if (auto shape = table.table("shape", "shape")) body.shape = read_shape(std::move(*shape));
  if (!has_shape) body.particle_file = table.file("particles", {".csv"});
  if (!has_tetrahedra) read_sampling(table, body);
}

Body read_body(TableReader table, Names& names, const Names& materials, std::vector<ReadMaterial>& read_materials) {
  Body body;
  body.where = table.where();
  body.name = names.read(table);
  if (table.require("material", "the name of a material")) {
    body.material = table.text("material").value_or("");
    if (!body.material.empty()) materials.check(table, "material", body.material);
  }
  const auto of_body = [&](const ReadMaterial& read) { return !body.material.empty() && read.material.name == body.material; };
  const auto found = std::find_if(read_materials.begin(), read_materials.end(), of_body);
  ReadMaterial* const material = found != read_materials.end() ? &*found : nullptr;
  read_contents(table, body, material);
  if (const auto velocity = table.vector("velocity", {.unit = "m/s", .planar = true})) body.velocity = *velocity;
  if (auto spin = table.table("spin", "'spin' of " + table.what())) body.spin = read_spin(std::move(*spin));
  bool fibers_refused = false;
  if (material && !material->elastic)
    refuse_fibers(table);
  else
    body.fibers = read_fibers_of(table, fibers_refused);
  if (auto toughness = table.table("toughness", "'toughness' of " + table.what()))
    body.toughness = read_variation(std::move(*toughness));
  if (material) {
    material->fibers_refused = material->fibers_refused || fibers_refused;
    if (material->discretized)
      table.refuse("toughness", "has no effect: a discretization plugin is not given a variation of the toughness");
    else if (!material->has_damage)
      table.refuse("toughness", "varies the toughness of a damage law, which material '" + body.material +
                                    "' does not have; add to it: damage = { plugin = ... }");
  }
  table.finish();
  return body;
}

/// Whether the laws of a material work together, with the fibers that it or else all of its bodies have.
void check_material(const ReadMaterial& read, const std::vector<Body>& bodies, Precision precision, ReadContext& context) {
  if (read.fibers_refused || !read.elastic) return;
  Material material = read.material;
  const Body* without = nullptr;
  const Body* with = nullptr;
  for (const Body& body : bodies)
    if (body.material == material.name) (body.fibers ? with : without) = &body;
  if (!material.fibers && with && !without) {
    material.fibers = with->fibers;
    material.where = with->where;
  }
  if (!read.discretized) return check_combination(material, precision, context);
  Remedies remedies;
  remedies.single_precision = "discretizations evaluate laws in it; give one that does";
  check_combination(material, Precision::double_precision, context, remedies);
}

Collider read_collider(TableReader table, Names& names, const std::string& fallback) {
  Collider collider;
  collider.where = table.where();
  collider.name = names.read(table, fallback);
  if (table.require("shape", "a table"))
    if (auto shape = table.table("shape", "shape")) collider.shape = read_shape(std::move(*shape)).value_or(scene::ShapeSpec());
  collider.contact = Contact(table.choice("contact", {"sticky", "slip", "separate"}).value_or(std::size_t(collider.contact)));
  if (collider.contact == Contact::sticky)
    table.refuse("friction", "has no meaning with contact = \"sticky\"");
  else
    collider.friction = table.number("friction", "1", Range::not_negative()).value_or(0);
  if (auto motion = table.table("motion", "'motion' of " + table.what())) collider.motion = read_motion(std::move(*motion));
  table.finish();
  return collider;
}

Handle read_handle(TableReader table, Names& names, const std::string& fallback, const Names& bodies) {
  Handle handle;
  handle.where = table.where();
  handle.name = names.read(table, fallback);
  if (const auto body = table.text("body")) {
    handle.body = *body;
    bodies.check(table, "body", *body);
  }
  if (table.require("region", "a shape"))
    if (auto region = table.table("region", "region"))
      handle.region = read_shape(std::move(*region)).value_or(scene::ShapeSpec());
  if (auto motion = table.table("motion", "'motion' of " + table.what())) handle.motion = read_motion(std::move(*motion));
  handle.release = table.number("release", "s", Range::not_negative()).value_or(handle.release);
  table.finish();
  return handle;
}

/// `known` empty: any words.
std::optional<std::vector<std::string>> read_words(TableReader& table, std::string_view key,
                                                   const std::vector<std::string>& known) {
  const toml::node* node = table.find(key);
  if (!node) return std::nullopt;
  const toml::array* list = node->as_array();
  if (!list) {
    table.error_at(key, "'" + std::string(key) + "' must be a list of texts, is " + found(*node));
    return std::nullopt;
  }
  std::vector<std::string> words;
  for (const toml::node& element : *list) {
    const auto* word = element.as_string();
    const Location where = locate(element.source());
    if (!word)
      table.error(where, "'" + std::string(key) + "' must be a list of texts, this is " + found(element));
    else if (!known.empty() && std::find(known.begin(), known.end(), word->get()) == known.end())
      table.error(where, "unknown name \"" + word->get() + "\" in '" + std::string(key) + "'" +
                             suggestion(word->get(), known, "; there are: " + list_text(known)));
    else if (std::find(words.begin(), words.end(), word->get()) != words.end())
      table.error(where, "\"" + word->get() + "\" is twice in '" + std::string(key) + "'");
    else
      words.push_back(word->get());
  }
  return words;
}

/// Quantities a frame can hold beyond ids and velocities. Particles carry b where every law works on it and nothing constrains
/// them, else F. Empty if they are not known: the point fields of a discretization are its instance's.
std::vector<std::string> output_attributes(const Scene& scene, const PluginCatalog& catalog) {
  const auto discretized = [](const Material& material) { return bool(material.discretization); };
  if (std::any_of(scene.materials.begin(), scene.materials.end(), discretized)) return {};
  std::vector<std::string> names = {"J", "C", "piece", "stress"};
  const auto add = [&](const std::string& name) {
    if (std::find(names.begin(), names.end(), name) == names.end()) names.push_back(name);
  };
  for (const Material& material : scene.materials) {
    if (material.damage) add("damage");
    bool stores_b = true;
    for (const auto* use :
         {&material.elasticity, material.plasticity ? &*material.plasticity : nullptr,
          material.damage ? &*material.damage : nullptr, material.constraint ? &*material.constraint : nullptr}) {
      const auto* law = use ? catalog.find(use->id) : nullptr;
      if (!law) continue;
      for (const plugins::State& state : law->states) add(state.name);
      const std::uint64_t capabilities = law->capabilities_with(use->parameters);
      const bool needs_F = (capabilities & (CLEAVE_ACCEPTS_B | CLEAVE_ACCEPTS_F)) == CLEAVE_ACCEPTS_F;
      if (needs_F || law->kind == plugins::Kind::constraint) stores_b = false;
    }
    add(stores_b ? "b" : "F");
  }
  for (const Body& body : scene.bodies)
    if (body.toughness) add("toughness");
  return names;
}

CheckpointTimes read_checkpoint_times(TableReader table) {
  CheckpointTimes times;
  times.frames = int(table.integer("frames", 0, 1000000000).value_or(times.frames));
  times.seconds = table.number("seconds", "s", Range::not_negative()).value_or(times.seconds);
  table.finish();
  return times;
}

/// `known`: what frames can hold, empty if that is not known; `asked`: what they are to hold, empty: all.
ColorBy read_color(TableReader table, std::vector<std::string> known, const std::vector<std::string>& asked) {
  ColorBy color;
  if (table.require("by", "\"body\", \"speed\" or an attribute of frames")) color.by = table.text("by").value_or("");
  const bool numbered = color.by == "body" || color.by == "piece";
  if (!asked.empty()) known = asked;
  known.insert(known.end(), {"body", "speed"});
  if (!color.by.empty() && known.size() > 2 && std::find(known.begin(), known.end(), color.by) == known.end())
    table.error_at("by",
                   "frames do not hold \"" + color.by + "\"" + suggestion(color.by, known, "; there are: " + list_text(known)));
  if (numbered) {
    table.refuse("range", "has no effect: each " + color.by + " has a colour of its own");
  } else if (const auto range = table.numbers("range", "", 2, 2)) {
    color.range = {range->at(0), range->at(1)};
    if (!(range->at(0) < range->at(1))) table.error_at("range", "'range' must go from a smaller value to a larger one");
  } else if (!table.has("range") && !color.by.empty() && color.by != "damage") {
    table.require("range", "the values of the first and the last colour");
  }
  table.finish();
  return color;
}

Output read_output(TableReader table, const Scene& scene) {
  Output output;
  if (auto formats = read_words(table, "formats", {"vdb", "vtp", "ply", "usd"})) output.formats = std::move(*formats);
  output.surface = table.boolean("surface").value_or(false);
  if (output.surface && std::find(output.formats.begin(), output.formats.end(), "vdb") == output.formats.end())
    table.error_at("surface", "'surface' is written as .vdb; add \"vdb\" to 'formats'");
  if (auto attributes = read_words(table, "attributes", output_attributes(scene, table.context().catalog)))
    output.attributes = std::move(*attributes);
  if (std::any_of(scene.materials.begin(), scene.materials.end(), [](const Material& m) { return bool(m.discretization); }))
    output.meshes = read_words(table, "meshes", {"ply", "obj", "vtp", "vtu"});
  else
    table.refuse("meshes", "has no effect: only bodies of a discretization have meshes to write");
  if (auto color = table.table("color", "[output.color]"))
    output.color = read_color(std::move(*color), output_attributes(scene, table.context().catalog), output.attributes);
  if (auto checkpoint = table.table("checkpoint", "[output.checkpoint]"))
    output.checkpoint = read_checkpoint_times(std::move(*checkpoint));
  table.finish();
  return output;
}

/// Bodies of tetrahedra need no grid: lengths that go with its cells are then those of the shortest edges of a body.
double cell_size_of_edges(TableReader& simulation, const std::vector<Body>& bodies) {
  double shortest = std::numeric_limits<double>::infinity();
  for (const Body& body : bodies) {
    double edge = body.tetrahedra ? body.tetrahedra->edge_length : 0;
    if (body.tetrahedra && body.tetrahedra->file) try {
        edge = scene::measure(scene::build_tetrahedra(*body.tetrahedra, nullptr)).mean_edge;
      } catch (const InputError& e) {
        simulation.error(body.where, "body '" + body.name + "': " + e.what());
        return 0;
      }
    if (!(edge > 0)) {
      simulation.require("cell_size", "a number (m); only scenes whose bodies all have tetrahedra may leave it out");
      return 0;
    }
    shortest = std::min(shortest, edge);
  }
  return shortest;
}

bool some_body_has_tetrahedra(TableReader& root) {
  const toml::node* bodies = root.find("body");
  const toml::array* list = bodies ? bodies->as_array() : nullptr;
  return list && std::any_of(list->begin(), list->end(),
                             [](const toml::node& body) { return body.is_table() && body.as_table()->contains("tetrahedra"); });
}

Scene read_scene(TableReader root) {
  Scene scene;
  Names materials("material"), bodies("body"), colliders("collider"), handles("handle");
  std::vector<ReadMaterial> read_materials;
  const bool tetrahedra = some_body_has_tetrahedra(root);
  std::optional<TableReader> simulation;
  if (root.require("simulation", "a table with at least 'cell_size' and 'end_time'"))
    if (simulation = root.table("simulation", "[simulation]"); simulation)
      scene.simulation = read_simulation(*simulation, tetrahedra);
  if (root.require("material", "at least one [[material]]"))
    for (TableReader& table : root.tables("material", "[[material]]"))
      read_materials.push_back(read_material(std::move(table), materials));
  if (root.require("body", "at least one [[body]]"))
    for (TableReader& table : root.tables("body", "[[body]]"))
      scene.bodies.push_back(read_body(std::move(table), bodies, materials, read_materials));
  if (simulation && tetrahedra && !simulation->has("cell_size"))
    scene.simulation.cell_size = cell_size_of_edges(*simulation, scene.bodies);
  for (ReadMaterial& read : read_materials) {
    check_material(read, scene.bodies, scene.simulation.precision, root.context());
    scene.materials.push_back(std::move(read.material));
  }
  for (TableReader& table : root.tables("collider", "[[collider]]"))
    scene.colliders.push_back(
        read_collider(std::move(table), colliders, "collider-" + std::to_string(scene.colliders.size() + 1)));
  for (TableReader& table : root.tables("handle", "[[handle]]"))
    scene.handles.push_back(
        read_handle(std::move(table), handles, "handle-" + std::to_string(scene.handles.size() + 1), bodies));
  if (auto output = root.table("output", "[output]")) scene.output = read_output(std::move(*output), scene);
  root.finish();
  return scene;
}

}  // namespace

Scene load_scene(const std::filesystem::path& file, const std::vector<Override>& overrides, const PluginCatalog& catalog,
                 std::vector<std::string>* warnings) {
  toml::table root = parse(read_text(file), file.string());
  Diagnostics diagnostics;
  for (const Override& given : overrides) apply_override(root, given, diagnostics);
  // An override that leads nowhere makes the rest of the report misleading.
  diagnostics.throw_errors();

  const auto absolute = std::filesystem::absolute(file).lexically_normal();
  ReadContext context{diagnostics, catalog, file.string(), absolute.parent_path()};
  Scene scene = read_scene(TableReader(root, "the scene", context));
  diagnostics.throw_errors();
  scene.file = absolute;
  if (warnings) *warnings = diagnostics.warnings();
  return scene;
}

}  // namespace cleave::config
