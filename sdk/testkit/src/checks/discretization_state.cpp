// What a host is told of bodies, and what it keeps of them.
#include "guarded.hpp"
#include "points.hpp"

#include <cleave/testkit/body.hpp>

#include <cmath>
#include <cstddef>
#include <cstring>
#include <map>
#include <memory>
#include <string>

namespace cleave::testkit {
namespace {

/// Fields of all bodies, and the step the discretisation tells.
struct Snapshot {
  std::vector<Fields> fields;
  double step = 0;
};
Snapshot snapshot(const Scene& scene) {
  Snapshot all;
  for (std::size_t b = 0; b < scene.bodies().size(); ++b) all.fields.push_back(scene.fields(b));
  all.step = scene.told_step();
  return all;
}
/// What differs in some bit; empty if nothing does.
std::string first_difference(const Snapshot& a, const Snapshot& b) {
  for (std::size_t body = 0; body < a.fields.size(); ++body) {
    if (a.fields[body].size() != b.fields[body].size()) return "the number of fields";
    for (const auto& [name, values] : a.fields[body]) {
      const auto other = b.fields[body].find(name);
      if (other == b.fields[body].end() || !(values == other->second))
        return "\"" + name + "\" of body " + std::to_string(body);
    }
  }
  return std::memcmp(&a.step, &b.step, sizeof a.step) == 0 ? "" : "the stable step";
}

/// Two bodies that fall, one of them held at a side, both shaken.
struct Play {
  Play(Context& context, const Settings& settings, const Form& form, Random& random, bool large = false)
      : bodies{large ? form.body(11, 6) : form.body(4, 2), form.body(3, 3, {0.5, -0.2, 0.5})},
        step(quiet_step(context, settings, bodies[0])) {
    for (Body& body : bodies) shake(body, random, 1e-3 * body.edge / step);
  }
  std::unique_ptr<Scene> begin(Context& context, const Settings& settings, const LentThreads* threads = nullptr) const {
    auto scene = std::make_unique<Scene>(context, settings);
    scene->threads = threads;
    for (const Body& body : bodies) scene->add(body);
    scene->gravity = {0, 0, -1e-4 * bodies[0].edge / (step * step)};
    scene->handle = [this](std::size_t body, const Point& rest, Motion& motion) {
      if (body != 1 || rest[0] > bodies[1].corner[0] + bodies[1].edge) return false;
      motion = {rest, {}};
      return true;
    };
    return scene;
  }
  void run(Scene& scene, int steps) const {
    for (int n = 0; n < steps; ++n) scene.step(step);
  }

  std::vector<Body> bodies;
  double step;
};

void checkpoint(Context& context) {
  const Settings settings = context.settings().front();
  const Form form(context, settings);
  context.random_cases(2, [&](Random& random) {
    const Play play(context, settings, form, random);
    const auto scene = play.begin(context, settings);
    play.run(*scene, 7);
    context.doing("saving");
    const Snapshot saved = snapshot(*scene);
    const auto state = scene->save();
    if (scene->save() != state) context.fail("two save() of one state write different bytes");
    {
      const Guarded memory(state);
      context.doing("saving into " + std::to_string(state.size()) + " bytes of guarded memory");
      scene->table().save(scene->instance(), memory.data(), state.size());
      if (!memory.intact_before()) context.fail("save() writes before its buffer");
    }
    play.run(*scene, 9);
    const Snapshot later = snapshot(*scene);
    const auto replay = [&](Scene& other, const std::string& which) {
      context.doing("restoring " + which);
      other.restore(state);
      if (const auto what = first_difference(saved, snapshot(other)); !what.empty())
        context.fail("restored " + which + ", " + what + " is not what it was when it was saved");
      play.run(other, 9);
      if (const auto what = first_difference(later, snapshot(other)); !what.empty())
        context.fail("restored " + which + ", " + what + " is different after nine steps");
      play.run(other, 3);
    };
    replay(*scene, "into the instance that saved it");
    replay(*scene, "a second time");
    const auto fresh = play.begin(context, settings);
    replay(*fresh, "into a fresh instance with the same bodies");
  });
}

void refuses_garbage(Context& context) {
  const Settings settings = context.settings().front();
  const Form form(context, settings);
  context.random_cases(3, [&](Random& random) {
    const Play play(context, settings, form, random);
    const auto source = play.begin(context, settings);
    play.run(*source, 3);
    const auto state = source->save();
    Scene other(context, settings);
    other.add(form.body(3, 2));
    const auto foreign = other.save();
    const auto expect = [&](const std::vector<unsigned char>& bytes, const std::string& what) {
      const auto scene = play.begin(context, settings);
      const Guarded memory(bytes);
      context.doing("restoring " + what);
      Words words;
      const cleave_result result = scene->table().restore(scene->instance(), memory.read_only(), bytes.size(), &words.message);
      if (result == CLEAVE_OK) context.fail("restore() accepts " + what);
      if (!words.text[0]) context.fail("restore() refuses " + what + " without a word");
    };
    const auto part = [&](std::size_t size) { return std::vector<unsigned char>(state.begin(), state.begin() + long(size)); };
    expect({}, "no bytes");
    expect(part(state.size() / 2), "the first half of a state");
    expect(part(state.size() - 1), "a state without its last byte");
    auto longer = state;
    longer.push_back(0);
    expect(longer, "a state and one more byte");
    auto garbage = state;
    for (auto& byte : garbage) byte = static_cast<unsigned char>(random.below(256));
    expect(garbage, "random bytes of the size of a state");
    expect(foreign, "the state of other bodies");
  });
}

void fields_described(Context& context) {
  const Settings settings = context.settings().front();
  const Form form(context, settings);
  Random random(context.seed());
  Scene scene(context, settings);
  for (Body body : {form.body(4, 2), form.body(3, 3, {0.5, -0.2, 0.5})}) {
    shake(body, random, 1e-4);
    scene.add(body);
  }
  const auto& table = scene.table();
  const auto look = [&](const std::string& when) {
    for (std::size_t b = 0; b < scene.bodies().size(); ++b) {
      const Body& body = scene.bodies()[b];
      const std::string where = " of body " + std::to_string(b) + " " + when;
      std::map<std::string, int> found;
      std::uint32_t count = 1;
      for (std::uint32_t i = 0; i < count; ++i) {
        cleave_point_field field{};
        field.struct_size = sizeof field;
        context.doing("asked for field " + std::to_string(i) + where);
        const std::uint32_t told = table.point_field(scene.instance(), b, i, &field);
        if (i > 0 && told != count)
          context.fail("point_field() tells " + std::to_string(told) + " fields, told " + std::to_string(count) + " before," +
                       where);
        count = told;
        if (count == 0) context.fail("has no fields" + where);
        if (!field.name || !field.unit || !field.values) context.fail("leaves name, unit or values of a field null," + where);
        const std::string name = field.name;
        if (name != "F" && (name.empty() || name.find_first_not_of("abcdefghijklmnopqrstuvwxyz0123456789_") != name.npos))
          context.fail("the field \"" + name + "\" is not named in lower_case_with_underscores");
        if (!field.unit[0]) context.fail("the field \"" + name + "\" has no unit (\"1\" if dimensionless)");
        if (field.components != 1 && field.components != 3 && field.components != 9)
          context.fail("the field \"" + name + "\" has " + std::to_string(field.components) +
                       " components; there may be 1, 3 or 9");
        if (!found.emplace(name, field.components).second) context.fail("has two fields \"" + name + "\"" + where);
        for (std::size_t k = 0; k < field.components * body.points(); ++k) {
          if (!std::isfinite(field.values[k]))
            context.fail("\"" + name + "\" of point " + std::to_string(k / field.components) + where + " is not finite");
          if (name == "damage" && !(field.values[k] >= 0 && field.values[k] <= 1))
            context.fail("\"damage\" of point " + std::to_string(k) + where + " is " + number(field.values[k]) +
                         ", outside of [0, 1]");
        }
      }
      cleave_point_field beyond{};
      beyond.struct_size = sizeof beyond;
      context.doing("asked for a field behind the last one" + where);
      if (table.point_field(scene.instance(), b, count, &beyond) != count || beyond.name || beyond.values)
        context.fail("point_field() for an index behind the last one does not just return the number of fields," + where);
      constexpr std::pair<const char*, int> shapes[] = {
          {"position", 3}, {"velocity", 3}, {"damage", 1}, {"energy", 1}, {"F", 9}};
      for (const auto& [name, components] : shapes) {
        const auto field = found.find(name);
        if (field == found.end() ? components == 3 : field->second != components)
          context.fail("has no field \"" + std::string(name) + "\" of " + std::to_string(components) + " components," + where);
      }
    }
  };
  look("before the first step");
  for (std::size_t b = 0; b < scene.bodies().size(); ++b) {
    const Body& body = scene.bodies()[b];
    const auto x = scene.position(b), v = scene.velocity(b);
    for (std::size_t i = 0; i < x.size(); ++i) {
      if (!(std::abs(x[i] - body.position[i]) <= 1e-9 * body.edge))
        context.fail("point " + std::to_string(i / 3) + " of body " + std::to_string(b) + " is not where it was put");
      // A discretisation may keep velocities elsewhere than at the points, so those at random are averaged.
      if (!form.mesh() && !(std::abs(v[i] - body.velocity[i]) <= 1e-13))
        context.fail("point " + std::to_string(i / 3) + " of body " + std::to_string(b) + " does not have the velocity it got");
    }
  }
  const double step = 0.25 * scene.stable_step();
  for (int n = 0; n < 3; ++n) scene.step(step);
  look("after three steps");
}

void takes_bodies(Context& context) {
  const Settings settings = context.settings().front();
  std::string no_points, no_mesh;
  const auto takes = [&](const Body& body, std::string& words) {
    Scene scene(context, settings);
    context.doing("given " + body.described());
    return scene.try_add(body, &words) == CLEAVE_OK;
  };
  const bool points = !context.plugin().can(CLEAVE_NEEDS_TETRAHEDRA) && takes(lattice(4), no_points),
             mesh = takes(tetrahedra(3), no_mesh);
  if (!points && !mesh)
    context.fail("takes neither a lattice of points (" + no_points + ") nor a cube of tetrahedra (" + no_mesh + ")");

  Scene scene(context, settings);
  Body empty = points ? lattice(0) : tetrahedra(0);
  empty.vertices.clear();
  std::string words;
  context.doing("given a body without points");
  const cleave_result result = scene.try_add(empty, &words);
  if (result != CLEAVE_OK && words.find("(no words)") != words.npos)
    context.fail("refuses a body without points with result " + std::to_string(result) + " and without a word");
  const std::size_t next = scene.bodies().size();
  scene.add(points ? lattice(4) : tetrahedra(3));
  context.doing("going on after a body without points");
  const double step = 0.25 * scene.stable_step();
  for (int n = 0; n < 3; ++n) scene.step(step);
  for (double x : scene.position(next))
    if (!std::isfinite(x)) context.fail("after a body without points the positions of another one are not finite");
  cleave_surface surface{};
  surface.struct_size = sizeof surface;
  scene.table().surface(scene.instance(), 0, &surface);
  scene.restore(scene.save());
}

void surface_valid(Context& context) {
  const Settings settings = context.settings().front();
  const Form form(context, settings);
  Scene scene(context, settings);
  scene.add(form.body(4, 3));
  // A body of points may be taken and have no surface, so one with a mesh is tried as well.
  scene.try_add(tetrahedra(2, {0.5, -0.2, 0.5}), nullptr);
  const double step = 0.25 * scene.stable_step();
  bool any = false;
  for (int n = 0; n < 2; ++n) {
    for (std::size_t b = 0; b < scene.bodies().size(); ++b) {
      cleave_surface surface{};
      surface.struct_size = sizeof surface;
      context.doing("asked for the surface of body " + std::to_string(b));
      const cleave_result result = scene.table().surface(scene.instance(), b, &surface);
      if (result == CLEAVE_ERROR_UNSUPPORTED) continue;
      if (result != CLEAVE_OK)
        context.fail("surface() gives result " + std::to_string(result) + "; a body without one has CLEAVE_ERROR_UNSUPPORTED");
      any = true;
      const std::string of = "the surface of body " + std::to_string(b);
      if ((surface.vertex_count && !surface.vertices) || (surface.triangle_count && !surface.triangles))
        context.fail(of + " has null arrays");
      for (std::uint64_t i = 0; i < 3 * surface.vertex_count; ++i)
        if (!std::isfinite(surface.vertices[i])) context.fail(of + " has vertices that are not finite");
      for (std::uint64_t i = 0; i < 3 * surface.triangle_count; ++i)
        if (surface.triangles[i] >= surface.vertex_count)
          context.fail(of + " has a triangle with vertex " + std::to_string(surface.triangles[i]) + " of " +
                       std::to_string(surface.vertex_count));
      for (std::uint64_t i = 0; surface.velocity && i < 3 * surface.vertex_count; ++i)
        if (!std::isfinite(surface.velocity[i])) context.fail(of + " has velocities that are not finite");
      for (std::uint64_t i = 0; surface.damage && i < surface.vertex_count; ++i)
        if (!(surface.damage[i] >= 0 && surface.damage[i] <= 1))
          context.fail(of + " has the damage " + number(surface.damage[i]) + ", outside of [0, 1]");
    }
    scene.step(step);
  }
  if (!any) context.skip("it offers no surface of " + scene.bodies().front().described());
}

void deterministic(Context& context) {
  const Settings settings = context.settings().front();
  const Form form(context, settings);
  context.random_cases(2, [&](Random& random) {
    const Play play(context, settings, form, random), other(context, settings, form, random);
    const auto first = play.begin(context, settings);
    play.run(*first, 20);
    const Snapshot expected = snapshot(*first);
    const auto second = play.begin(context, settings);
    const auto beside = other.begin(context, settings);
    for (int n = 0; n < 20; ++n) {
      play.run(*second, 1);
      other.run(*beside, 1);
    }
    if (const auto what = first_difference(expected, snapshot(*second)); !what.empty())
      context.fail("a second instance beside a third gets another " + what + " after 20 steps of the same");
    if (const auto what = first_difference(expected, snapshot(*first)); !what.empty())
      context.fail("steps of other instances change " + what + " of the first");
  });
}

void same_with_threads(Context& context) {
  const Settings settings = context.settings().front();
  const Form form(context, settings);
  bool used = false;
  context.random_cases(1, [&](Random& random) {
    const Play play(context, settings, form, random, true);
    const auto alone = play.begin(context, settings);
    play.run(*alone, 8);
    const Snapshot expected = snapshot(*alone);
    for (const auto order : {LentThreads::forwards, LentThreads::backwards, LentThreads::side_by_side}) {
      const LentThreads threads(order);
      const std::string which = LentThreads::name(order);
      context.doing("lent " + which);
      const auto scene = play.begin(context, settings, &threads);
      play.run(*scene, 8);
      if (const auto what = first_difference(expected, snapshot(*scene)); !what.empty())
        context.fail(what + " has other bits with " + which + " than without threads, after eight steps of " +
                     play.bodies[0].described());
      used = used || threads.used();
    }
  });
  if (!used) context.remark("it uses no threads");
}

void inputs_unchanged(Context& context) {
  const Settings settings = context.settings().front();
  const Form form(context, settings);
  const Body body = form.body(4, 2);
  const double step = quiet_step(context, settings, body);
  const auto run = [&](bool guarded) {
    Scene scene(context, settings);
    const auto& table = scene.table();
    Words words;
    const auto check = [&](cleave_result result, const char* function) {
      if (result != CLEAVE_OK) context.fail(std::string(function) + " fails: " + words.said());
    };
    cleave_surroundings surroundings{sizeof surroundings, 0, {0, 0, -1}, nullptr, nullptr, nullptr, nullptr};
    surroundings.collide = [](void*, std::uint64_t, const double*, double*) {};
    surroundings.handle = [](void*, std::uint64_t, std::uint32_t, std::uint64_t, double*, double*) -> std::int32_t {
      return 0;
    };
    if (guarded) {
      {
        const Guarded position(body.position), velocity(body.velocity), volume(body.volume), vertices(body.vertices);
        const Guarded tetrahedra(body.tetrahedra);
        Enlarged given(scene.lent(body));
        given.known.position = position.read_only();
        given.known.velocity = velocity.read_only();
        given.known.volume = volume.read_only();
        given.known.vertices = body.vertices.empty() ? nullptr : vertices.read_only();
        given.known.tetrahedra = body.tetrahedra.empty() ? nullptr : tetrahedra.read_only();
        const Guarded whole(&given, 1);
        context.doing("given a body in read-only memory, and a larger cleave_body than it knows");
        check(table.add_body(scene.instance(), &whole.read_only()->known, &words.message), "add_body()");
      }
      // The memory of the body and of the surroundings of each step is gone afterwards.
      for (int n = 0; n < 5; ++n) {
        const Enlarged larger(surroundings);
        const Guarded seen(&larger, 1);
        context.doing("stepping after the memory of the body is gone, with larger cleave_surroundings than it knows");
        check(table.step(scene.instance(), step, &seen.read_only()->known, &words.message), "step()");
      }
    } else {
      scene.add(body);
      for (int n = 0; n < 5; ++n) check(table.step(scene.instance(), step, &surroundings, &words.message), "step()");
    }
    cleave_point_field shorter{};
    shorter.struct_size = offsetof(cleave_point_field, values);
    const Guarded<char> field(reinterpret_cast<const char*>(&shorter), shorter.struct_size);
    context.doing("given a cleave_point_field that ends before `values`");
    std::vector<double> all;
    const std::uint32_t count = table.point_field(scene.instance(), 0, 0, reinterpret_cast<cleave_point_field*>(field.data()));
    for (std::uint32_t i = 0; i < count; ++i) {
      Enlarged larger(cleave_point_field{});
      table.point_field(scene.instance(), 0, i, &larger.known);
      for (unsigned char byte : larger.unknown)
        if (byte != 0x5A) context.fail("point_field() writes beyond the members it knows");
      const std::string name = larger.known.name ? larger.known.name : "";
      if (larger.known.values && (name == "position" || name == "velocity"))
        all.insert(all.end(), larger.known.values, larger.known.values + 3 * body.points());
    }
    return all;
  };
  const auto plain = run(false), guarded = run(true);
  if (plain.size() != guarded.size() || std::memcmp(plain.data(), guarded.data(), plain.size() * sizeof(double)) != 0)
    context.fail("larger structs than it knows change the motion");
}

}  // namespace

std::vector<Check> discretization_state_checks() {
  return {
      {"discretization.checkpoint", 50,
       "A saved state, restored into the same or a fresh instance, goes on with the same bits.", discretization_kind,
       checkpoint},
      {"discretization.restore-refuses", 60, "Truncated, random and foreign bytes are no state and are refused with words.",
       discretization_kind, refuses_garbage},
      {"discretization.fields", 62,
       "Position and velocity of the points are there, fields are described, and what a body got is what it has.",
       discretization_kind, fields_described},
      {"discretization.bodies", 66,
       "A lattice of points or a cube of tetrahedra is taken; a body without points is refused with words or harmless.",
       discretization_kind, takes_bodies},
      {"discretization.surface", 67,
       "Triangles of the surface refer to vertices that exist; positions, velocities and damage are finite.",
       discretization_kind, surface_valid},
      {"discretization.deterministic", 68,
       "The same steps give the same bits in every instance, and instances do not influence each other.", discretization_kind,
       deterministic},
      {"discretization.threads", 82, "Steps have the same bits without threads, with threads, and whichever range comes first.",
       discretization_kind, same_with_threads},
      {"discretization.inputs-unchanged", 69,
       "Bodies and surroundings are only read, and not after the call; shorter or longer structs do no harm.",
       discretization_kind, inputs_unchanged},
  };
}

}  // namespace cleave::testkit
