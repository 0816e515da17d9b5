#include "advise/advise.hpp"

#include "advise/facts.hpp"
#include "common/error.hpp"
#include "mpm/integrator_choice.hpp"

#include <fmt/format.h>
#include <unistd.h>

#include <algorithm>
#include <cmath>

namespace cleave::advise {
namespace {

using config::Material;
using config::Precision;
using config::Scene;

/// Gains below this are not worth a change.
constexpr double worth = 1.25;

/// "%", with three digits
std::string percent(double part) { return fmt::format("{:.3g} %", 100 * part); }

class Adviser {
 public:
  Adviser(const Scene& scene, const std::vector<config::Override>& given, plugins::Registry& registry, const Costs& costs,
          const Machine& machine)
      : scene_(scene), given_(given), registry_(registry), costs_(costs), machine_(machine) {}

  Advised advise() {
    if (fits_no_machine()) return std::move(result_);
    facts_ = gather(scene_, registry_);
    result_.forecast = forecast();
    memory();
    steps();
    integrator();
    precision();
    laws();
    lengths();
    sampling();
    flatness();
    idle_parts();
    frames();
    std::stable_sort(result_.advice.begin(), result_.advice.end(),
                     [](const Advice& a, const Advice& b) { return a.speedup.value_or(0) > b.speedup.value_or(0); });
    return std::move(result_);
  }

 private:
  /// Keeps an advice if the scene can still be read with it.
  void add(Advice advice) {
    auto overrides = given_;
    for (const std::string& set : advice.set) overrides.push_back(config::parse_override(set));
    if (!advice.set.empty() && advice.remove.empty()) {
      try {
        config::load_scene(scene_.file, overrides, registry_);
      } catch (const InputError&) {
        return;
      }
    }
    result_.advice.push_back(std::move(advice));
  }

  const config::Simulation& simulation() const { return scene_.simulation; }
  int dimension() const { return simulation().dimension; }
  bool all_particles() const {
    return std::none_of(scene_.materials.begin(), scene_.materials.end(),
                        [](const Material& m) { return bool(m.discretization); });
  }

  /// Thread seconds of a step; nothing where the costs of a material are not recorded.
  std::optional<double> step_cost(const std::vector<Material>& materials, Precision precision) const {
    double seconds = 0;
    for (const BodyFacts& body : facts_.bodies) {
      if (materials[body.material].discretization) return std::nullopt;
      const auto ns = costs_.nanoseconds(Costs::laws_of(materials[body.material]), precision, dimension());
      if (!ns) return std::nullopt;
      seconds += 1e-9 * *ns * double(body.particles);
    }
    return seconds;
  }

  Forecast forecast() const {
    Forecast f;
    f.particles = facts_.particles;
    f.time_step = facts_.step.seconds;
    f.bound = facts_.step.name;
    f.frames = std::int64_t(std::floor(simulation().end_time * simulation().frame_rate * (1 + 1e-12))) + 1;
    f.steps = std::max(simulation().end_time / f.time_step, double(f.frames - 1));
    f.memory = facts_.bytes_per_particle * double(facts_.particles);
    if (simulation().integrator == config::Integrator::symplectic)
      if (const auto cost = step_cost(scene_.materials, simulation().precision)) f.thread_seconds = *cost * f.steps;
    return f;
  }

  bool fits_no_machine() {
    const double least = least_memory(scene_);
    if (least < machine_.memory) return false;
    too_large(least, "at least ");
    return true;
  }

  void memory() {
    // frames that are being written, and sorting, want their share
    const double need = 2 * result_.forecast->memory;
    if (need > machine_.memory) too_large(need, "");
  }

  void too_large(double need, const char* at_least) {
    const double coarser = std::pow(need / (0.5 * machine_.memory), 1. / dimension());
    add({.what = "take larger cells",
         .reason = fmt::format("the particles need {}{:.3g} GB of memory, and this machine has {:.3g} GB", at_least, need / 1e9,
                               machine_.memory / 1e9),
         .effect = fmt::format("half of the memory is used; cells are {:.3g} times as large", coarser),
         .speedup = std::pow(coarser, dimension() + 1),
         .set = {fmt::format("simulation.cell_size={:.3g}", simulation().cell_size * coarser)},
         .remove = {}});
  }

  void steps() {
    const double gain = facts_.free_step.seconds / facts_.step.seconds;
    if (!std::isfinite(gain)) return;  // nothing but accuracy bounds the steps
    if (simulation().time_step && gain > worth)
      add({.what = "take automatic steps",
           .reason = fmt::format("the fixed step of {:.3g} s is {:.3g} times shorter than the largest stable one at the start, "
                                 "{:.3g} s ({})",
                                 *simulation().time_step, gain, facts_.free_step.seconds, facts_.free_step.name),
           .effect = fmt::format("{:.3g} times fewer steps; they follow the bound when it changes", gain),
           .speedup = gain,
           .set = {"simulation.time_step=auto"},
           .remove = {}});
    else if (!simulation().time_step && simulation().maximum_time_step > 0 && gain > worth &&
             simulation().integrator == config::Integrator::symplectic)
      add({.what = "let steps be as long as they may",
           .reason = fmt::format("maximum_time_step holds them at {:.3g} s where {:.3g} s are stable ({})", facts_.step.seconds,
                                 facts_.free_step.seconds, facts_.free_step.name),
           .effect = fmt::format("{:.3g} times fewer steps", gain),
           .speedup = gain,
           .set = {"simulation.maximum_time_step=0"},
           .remove = {}});
    constexpr double usual_cfl = 0.4;
    if (!simulation().time_step && simulation().cfl * worth < usual_cfl && facts_.step.name == std::string("elastic wave")) {
      const double longer = usual_cfl / simulation().cfl;
      add({.what = "take the default cfl",
           .reason =
               fmt::format("elastic waves bound the steps, and cfl = {:g} makes them {:.3g} times shorter than the default, "
                           "itself 2.5 times below the bound",
                           simulation().cfl, longer),
           .effect = fmt::format("{:.3g} times fewer steps", longer),
           .speedup = longer,
           .set = {fmt::format("simulation.cfl={:g}", usual_cfl)},
           .remove = {}});
    }
    for (std::size_t i = 0; i < facts_.materials.size(); ++i) {
      if (!facts_.materials[i].explicit_damage || facts_.free_step.name != std::string("explicit damage")) continue;
      const auto& law = *scene_.materials[i].damage;
      for (const auto& parameter : registry_.find(law.id)->parameters)
        if (std::find(parameter.choices.begin(), parameter.choices.end(), "implicit") != parameter.choices.end())
          add({.what = "integrate damage implicitly",
               .reason = fmt::format("explicit damage bounds the step at {:.3g} s", facts_.free_step.seconds),
               .effect = "damage no longer bounds the step; each has a solve",
               .speedup = {},
               .set = {fmt::format("material.{}.damage.{}=implicit", scene_.materials[i].name, parameter.key)},
               .remove = {}});
    }
  }

  void integrator() {
    if (!facts_.implicit_step || !facts_.symplectic_step) return;
    const mpm::Bound &implicit = *facts_.implicit_step, &symplectic = *facts_.symplectic_step;
    double longest = 1 / simulation().frame_rate;
    const char* limit = "frames";
    if (const double most = simulation().maximum_time_step; most > 0 && most < longest) {
      longest = most;
      limit = "maximum_time_step";
    }
    const double implicit_step = std::min(implicit.seconds, longest), symplectic_step = std::min(symplectic.seconds, longest),
                 longer = implicit_step / symplectic_step;
    const char* bound = implicit.seconds < longest ? implicit.name : limit;
    // What one Newton iteration takes, and what a stiff body does: a few iterations and a hundred products.
    const double least = mpm::implicit_cost({.evaluations = 2, .products = 1}),
                 usual = mpm::implicit_cost({.evaluations = 6, .products = 100, .tangents = 1});
    if (simulation().integrator == config::Integrator::implicit && !simulation().time_step) {
      const double shared = shared_cost(), faster = (least + shared) / (1 + shared) / longer;
      if (faster > worth)
        add({.what = "take symplectic steps",
             .reason =
                 fmt::format("implicit steps are {} symplectic ones here ({:.3g} s, bounded by {}), and cost {:.2g} times "
                             "as much or more",
                             longer < 1.05 ? "no longer than" : fmt::format("{:.3g} times as long as", longer), implicit_step,
                             bound, (least + shared) / (1 + shared)),
             .effect = fmt::format("{:.2g} times faster or more; backward Euler damps nothing any more", faster),
             .speedup = faster,
             .set = {"simulation.integrator=symplectic"},
             .remove = {}});
    }
    if (simulation().integrator != config::Integrator::symplectic || longer < worth * usual) return;
    // Backward Euler takes exp(-2 pi^2 dt/T) of the amplitude in each period T.
    add({.what = "let the program choose the integrator, if vibrations do not matter",
         .reason = fmt::format("implicit steps could be {:.3g} times as long as symplectic ones ({:.3g} s, bounded by {}), and "
                               "usually cost {:.2g} to {:.3g} times as much",
                               longer, implicit_step, bound, least, usual),
         .effect = fmt::format("about {:.2g} times faster; vibrations of periods below {:.2g} s lose a fifth of their "
                               "amplitude or more in each",
                               longer / usual, 100 * implicit_step),
         .speedup = longer / usual,
         .set = {"simulation.integrator=auto"},
         .remove = {}});
  }

  /// What damage and constraints add to a step of either integrator, in steps of elastic material.
  double shared_cost() const {
    auto elastic = scene_.materials;
    for (Material& material : elastic) material.damage = material.constraint = std::nullopt;
    const auto with = step_cost(scene_.materials, simulation().precision), without = step_cost(elastic, simulation().precision);
    if (with && without) return std::max(0.0, *with / *without - 1);
    constexpr double typical = 4;
    const bool extra = std::any_of(scene_.materials.begin(), scene_.materials.end(),
                                   [](const Material& m) { return m.damage || m.constraint; });
    return extra ? typical : 0;
  }

  void precision() {
    if (!all_particles()) return;
    double strain = std::numeric_limits<double>::infinity();
    for (const MaterialFacts& material : facts_.materials)
      if (material.strain.expected > 0) strain = std::min(strain, material.strain.expected);
    if (!std::isfinite(strain)) return;
    // Strains are what a number near 1 differs from 1 by; each step rounds it, here one way and there the other.
    constexpr double roundoff = 6e-8;
    const double lost = roundoff * std::sqrt(result_.forecast->steps) / strain;
    const auto in_single = step_cost(scene_.materials, Precision::single_precision),
               in_double = step_cost(scene_.materials, Precision::double_precision);
    const double ratio = in_single && in_double ? *in_double / *in_single : 1.7;
    const bool single = simulation().precision == Precision::single_precision;
    const std::string numbers =
        fmt::format("strains of about {} over {:.2g} steps: single precision rounds away about {} of them",
                    percent(std::min(strain, 1.0)), result_.forecast->steps, percent(lost));
    if (single && lost > 0.01)
      add({.what = "compute in double precision",
           .reason = numbers,
           .effect = fmt::format("that error goes; {:.2g} times slower, twice the memory", ratio),
           .speedup = 1 / ratio,
           .set = {"simulation.precision=double"},
           .remove = {}});
    if (!single && lost < 1e-3)
      add({.what = "compute in single precision",
           .reason = numbers,
           .effect = fmt::format("{:.2g} times faster, half of the memory", ratio),
           .speedup = ratio,
           .set = {"simulation.precision=single"},
           .remove = {}});
  }

  void laws() {
    for (std::size_t i = 0; i < scene_.materials.size(); ++i) {
      const Material& material = scene_.materials[i];
      const MaterialFacts& facts = facts_.materials[i];
      const bool used = std::any_of(facts_.bodies.begin(), facts_.bodies.end(), [&](const auto& b) { return b.material == i; });
      if (!used) {
        add({.what = "remove material " + material.name,
             .reason = "no body is made of it",
             .effect = "nothing changes",
             .speedup = {},
             .set = {},
             .remove = {"material." + material.name}});
        continue;
      }
      if (!facts.response) continue;
      const std::string load =
          fmt::format("speeds up to {:.3g} m/s{}{} strain it by at most about {}", facts_.motions.speed,
                      simulation().gravity.isZero() ? "" : ", gravity",
                      facts_.motions.displacement > 0 ? ", and what holds or presses it" : "", percent(facts.strain.largest));
      const auto without = [&](std::optional<config::PluginUse> Material::*law, const std::string& key,
                               const std::string& why) {
        auto fewer = scene_.materials;
        fewer[i].*law = std::nullopt;
        const auto before = step_cost(scene_.materials, simulation().precision),
                   after = step_cost(fewer, simulation().precision);
        const bool recorded = before && after;
        add({.what = fmt::format("leave out {} of material {}", ((material.*law)->id), material.name),
             .reason = load + ", " + why,
             .effect = recorded ? fmt::format("{:.2g} times faster steps, less memory", std::max(1.0, *before / *after))
                                : "faster steps, less memory",
             .speedup = recorded ? std::optional(std::max(1.0, *before / *after)) : std::nullopt,
             .set = {},
             .remove = {fmt::format("material.{}.{}", material.name, key)}});
      };
      if (material.plasticity && !facts.response->yields)
        without(&Material::plasticity, "plasticity", "and at no strain of that size, in any direction, does it flow");
      constexpr double negligible = 1e-3;
      if (material.damage && facts.response->damage < negligible)
        without(&Material::damage, "damage",
                facts.response->damage > 0 ? fmt::format("which damages it by {:.2g} at most", facts.response->damage)
                                           : "which does not damage it");
    }
  }

  void lengths() {
    constexpr double resolved = 2;
    const double dx = simulation().cell_size;
    std::vector<std::size_t> following;  // materials of which it is that of the cells
    for (std::size_t i = 0; i < scene_.materials.size(); ++i) {
      const MaterialFacts& facts = facts_.materials[i];
      if (!(facts.length > 0)) continue;
      const double cells = facts.length / dx;
      const std::string& name = scene_.materials[i].name;
      constexpr double plenty = 6;
      if (facts.length_in_cells) {
        if (cells < resolved) following.push_back(i);
        continue;
      }
      const double factor = cells / resolved;
      if (cells < 0.99 * resolved)
        add({.what = "take smaller cells",
             .reason =
                 fmt::format("the damage of {} spreads over a length of {:.3g} m, {:.2g} cells: profiles of cracks are not "
                             "resolved below {:g}",
                             name, facts.length, cells, resolved),
             .effect = fmt::format("cracks are resolved; {:.3g} times the work", std::pow(1 / factor, dimension() + 1)),
             .speedup = std::pow(factor, dimension() + 1),
             .set = {fmt::format("simulation.cell_size={:.3g}", facts.length / resolved)},
             .remove = {}});
      const double thinnest = thinnest_body();
      // no coarser than cracks and the thinnest body bear
      const double coarser = std::min(factor, thinnest > 0 ? thinnest / (8 * dx) : factor);
      if (cells > plenty && coarser > worth)
        add({.what = "take larger cells",
             .reason = fmt::format("the damage of {} spreads over a length of {:.3g} m, {:.2g} cells, and {:g} resolve a crack",
                                   name, facts.length, cells, resolved),
             .effect =
                 fmt::format("{:.3g} times less work; cells of {:.3g} m", std::pow(coarser, dimension() + 1), coarser * dx),
             .speedup = std::pow(coarser, dimension() + 1),
             .set = {fmt::format("simulation.cell_size={:.3g}", coarser * dx)},
             .remove = {}});
    }
    if (!following.empty()) follows_cells(following, resolved);
  }

  void follows_cells(const std::vector<std::size_t>& materials, double resolved) {
    const double wanted = resolved * simulation().cell_size;
    std::string names;
    std::vector<std::string> set;
    double wider = 1;
    for (const std::size_t i : materials) {
      const MaterialFacts& facts = facts_.materials[i];
      names += fmt::format("{}{} cells in {}", names.empty() ? "" : ", ",
                           fmt::format("{:.2g}", facts.length / simulation().cell_size), scene_.materials[i].name);
      wider = std::max(wider, wanted / facts.length);
      if (facts.fixes_length)
        set.push_back(fmt::format("material.{}.damage.{}={:.3g}", scene_.materials[i].name, facts.fixes_length->key,
                                  facts.fixes_length->per_length * wanted));
    }
    if (set.size() < materials.size()) set.clear();
    add({.what = "if the energy of cracks has to be right, give damage a length in metres",
         .reason =
             fmt::format("the length over which damage spreads follows the cells ({}): the energy that a crack takes changes "
                         "with the cell size, and below {:g} cells with how cracks run through the grid",
                         names, resolved),
         .effect = fmt::format("cracks are {:.2g} times as wide, and stay so with smaller cells", wider),
         .speedup = {},
         .set = std::move(set),
         .remove = {}});
  }

  double thinnest_body() const {
    double thinnest = 0;
    for (const BodyFacts& body : facts_.bodies)
      if (body.thickness > 0) thinnest = thinnest > 0 ? std::min(thinnest, body.thickness) : body.thickness;
    return thinnest;
  }

  void sampling() {
    const int usual = dimension() == 3 ? 8 : 4;
    for (std::size_t i = 0; i < scene_.bodies.size(); ++i) {
      const auto& body = scene_.bodies[i];
      if (!body.shape || body.tetrahedra || scene_.materials[facts_.bodies[i].material].discretization) continue;
      const int per_cell = body.sampling.particles_per_cell;
      const std::string path = fmt::format("body.{}.particles_per_cell={}", body.name, usual);
      const double share = double(facts_.bodies[i].particles) / double(facts_.particles);
      if (per_cell >= 2 * usual) {
        const double gain = 1 / (1 - share * (1 - double(usual) / per_cell));
        if (gain > worth)
          add({.what = fmt::format("sample body {} with {} particles per cell", body.name, usual),
               .reason = fmt::format("it has {}, and the size of the cells limits the accuracy", per_cell),
               .effect = fmt::format("{:.3g} times less work and memory", gain),
               .speedup = gain,
               .set = {path},
               .remove = {}});
      } else if (per_cell < usual) {
        const double more = 1 + share * (double(usual) / per_cell - 1);
        add({.what = fmt::format("sample body {} with {} particles per cell", body.name, usual),
             .reason = fmt::format("with {} it comes apart where it is stretched so far that cells are empty", per_cell),
             .effect = fmt::format("stretches {:.2g} times as far; {:.3g} times the work",
                                   std::pow(double(usual) / per_cell, 1. / dimension()), more),
             .speedup = 1 / more,
             .set = {path},
             .remove = {}});
      }
    }
    thin_bodies();
  }

  void thin_bodies() {
    constexpr double too_thin = 2, enough = 3;
    const BodyFacts* thinnest = nullptr;
    int number = 0;
    for (const BodyFacts& body : facts_.bodies) {
      if (!(body.thickness > 0) || body.thickness >= too_thin * simulation().cell_size ||
          scene_.materials[body.material].discretization)
        continue;
      number++;
      if (!thinnest || body.thickness < thinnest->thickness) thinnest = &body;
    }
    if (!thinnest) return;
    const double factor = thinnest->thickness / simulation().cell_size / enough;
    add({.what = fmt::format("take smaller cells, if body {} bends",
                             scene_.bodies[std::size_t(thinnest - facts_.bodies.data())].name),
         .reason = fmt::format("it is about {:.2g} cells thick{}, and bending takes {:g}", factor * enough,
                               number == 1   ? ""
                               : number == 2 ? ", another body hardly more"
                                             : fmt::format(", {} others hardly more", number - 1),
                               enough),
         .effect = fmt::format("bends as it should; {:.3g} times the work", std::pow(1 / factor, dimension() + 1)),
         .speedup = std::pow(factor, dimension() + 1),
         .set = {fmt::format("simulation.cell_size={:.3g}", simulation().cell_size * factor)},
         .remove = {}});
  }

  void flatness() {
    if (!prismatic(scene_)) return;
    double depth = 0;
    for (const BodyFacts& body : facts_.bodies) depth = std::max(depth, body.bounds.sizes().z());
    const double layers = depth / simulation().cell_size * 2;  // two particles to a cell
    std::vector<std::string> set{"simulation.dimension=2"};
    for (const auto& body : scene_.bodies)
      if (body.sampling.particles_per_cell == 8) set.push_back(fmt::format("body.{}.particles_per_cell=4", body.name));
    add({.what = "simulate a section in two dimensions",
         .reason =
             fmt::format("bodies, loads and what they touch are the same along z, over {:.3g} m, four times what they measure "
                         "across or more: but for its ends the scene is one of plane strain",
                         depth),
         .effect = fmt::format("about {:.3g} times less work; the ends are left out", layers),
         .speedup = layers,
         .set = std::move(set),
         .remove = {}});
  }

  void idle_parts() {
    for (std::size_t i = 0; i < scene_.colliders.size(); ++i) {
      const double reach = facts_.motions.reach + 2 * simulation().cell_size;
      if (facts_.collider_gap[i] <= reach) continue;
      add({.what = "remove collider " + scene_.colliders[i].name,
           .reason = fmt::format("it is {:.3g} m from the nearest body, and nothing goes farther than {:.3g} m until the end",
                                 facts_.collider_gap[i], reach),
           .effect = "nothing changes",
           .speedup = {},
           .set = {},
           .remove = {"collider." + scene_.colliders[i].name}});
    }
  }

  void frames() {
    const double interval = 1 / simulation().frame_rate, step = facts_.step.seconds;
    if (std::isfinite(step) && step > worth * interval) {
      const double rate = std::max(1 / step, 1 / simulation().end_time);
      add({.what = "write fewer frames",
           .reason =
               fmt::format("there is a frame every {:.3g} s, and steps could be {:.3g} s ({}): frames are what bounds them",
                           interval, step, facts_.step.name),
           .effect = fmt::format("{:.3g} times fewer steps and files", rate > 0 ? simulation().frame_rate / rate : 1),
           .speedup = simulation().frame_rate / rate,
           .set = {fmt::format("simulation.frame_rate={:.3g}", rate)},
           .remove = {}});
    }
    // id, position, velocity and some attributes
    constexpr double bytes = 60, much = 50e9;
    const double disk =
        bytes * double(facts_.particles) * double(result_.forecast->frames) * double(scene_.output.formats.size());
    if (disk > much)
      add({.what = "write fewer frames",
           .reason = fmt::format("{} frames in {} format{} take about {:.3g} GB", result_.forecast->frames,
                                 scene_.output.formats.size(), scene_.output.formats.size() == 1 ? "" : "s", disk / 1e9),
           .effect = fmt::format("about {:.3g} GB", much / 1e9),
           .speedup = {},
           .set = {fmt::format("simulation.frame_rate={:.3g}", simulation().frame_rate * much / disk)},
           .remove = {}});
  }

  const Scene& scene_;
  const std::vector<config::Override>& given_;
  plugins::Registry& registry_;
  const Costs& costs_;
  const Machine& machine_;
  Facts facts_;
  Advised result_;
};

}  // namespace

Machine this_machine() { return {double(::sysconf(_SC_PHYS_PAGES)) * double(::sysconf(_SC_PAGESIZE))}; }

Advised advise(const Scene& scene, const std::vector<config::Override>& given, plugins::Registry& registry, const Costs& costs,
               const Machine& machine) {
  return Adviser(scene, given, registry, costs, machine).advise();
}

}  // namespace cleave::advise
