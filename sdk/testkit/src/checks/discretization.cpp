#include "guarded.hpp"

#include <cleave/testkit/body.hpp>

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <cstdio>
#include <cstring>
#include <memory>
#include <optional>
#include <set>

namespace cleave::testkit {
namespace {

std::string number(double value) {
  char text[32];
  std::snprintf(text, sizeof text, "%.3g", value);
  return text;
}

Point at(const std::vector<double>& values, std::size_t i) { return {values[3 * i], values[3 * i + 1], values[3 * i + 2]}; }
Point difference(const Point& a, const Point& b) { return {a[0] - b[0], a[1] - b[1], a[2] - b[2]}; }
double length(const Point& a) { return std::sqrt(a[0] * a[0] + a[1] * a[1] + a[2] * a[2]); }
Point cross(const Point& a, const Point& b) {
  return {a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]};
}
double largest(const std::vector<double>& vectors) {
  double most = 0;
  for (std::size_t i = 0; i < vectors.size() / 3; ++i) {
    const double here = length(at(vectors, i));
    if (!(here <= most)) most = here;  // also what is not a number
  }
  return most;
}

/// Velocities up to `speed` at random.
void shake(Body& body, Random& random, double speed) {
  for (double& v : body.velocity) v += random.uniform(-speed, speed);
}

/// A quarter of the step a discretisation tells for such a body at rest: what other checks than that of the step use.
double quiet_step(Context& context, const Settings& settings, const Body& body) {
  Scene scene(context, settings);
  scene.add(body);
  return 0.25 * scene.stable_step();
}

struct Momentum {
  Point linear{}, angular{};
  double linear_size = 0, angular_size = 0;
};
Momentum momentum(const Scene& scene) {
  const Body& body = scene.bodies().front();
  const auto x = scene.position(), v = scene.velocity();
  Momentum sum;
  for (std::size_t i = 0; i < body.points(); ++i) {
    const Point arm = difference(at(x, i), body.centre()), turn = cross(arm, at(v, i));
    for (std::size_t a = 0; a < 3; ++a) {
      sum.linear[a] += body.mass(i) * v[3 * i + a];
      sum.angular[a] += body.mass(i) * turn[a];
    }
    sum.linear_size += body.mass(i) * length(at(v, i));
    sum.angular_size += body.mass(i) * length(arm) * length(at(v, i));
  }
  return sum;
}

void keeps_motion(Context& context) {
  const Settings settings = context.settings().front();
  const Form form(context, settings);
  const Body rest = form.body(5, 3);
  const double step = quiet_step(context, settings, rest), speed = rest.edge / step;
  {
    Body body = rest;
    const Point u = {0.02 * speed, -0.013 * speed, 0.007 * speed};
    for (std::size_t i = 0; i < body.velocity.size(); ++i) body.velocity[i] = u[i % 3];
    Scene scene(context, settings);
    scene.add(body);
    constexpr int steps = 50;
    for (int n = 0; n < steps; ++n) scene.step(step);
    const auto x = scene.position(), v = scene.velocity();
    for (std::size_t i = 0; i < v.size(); ++i) {
      const double moved = x[i] - body.position[i] - steps * step * u[i % 3];
      if (!(std::abs(v[i] - u[i % 3]) <= 1e-9 * length(u)))
        context.fail("a uniform translation changes its velocity by " + number((v[i] - u[i % 3]) / length(u)) + " of it in " +
                     std::to_string(steps) + " steps, with " + body.described());
      if (!(std::abs(moved) <= 1e-9 * steps * step * length(u)))
        context.fail("points of a uniform translation are " + number(moved) + " m from where they should be after " +
                     std::to_string(steps) + " steps, with " + body.described());
    }
  }
  context.random_cases(3, [&](Random& random) {
    Body body = rest;
    const Point spin = {random.uniform(-1, 1), random.uniform(-1, 1), random.uniform(-1, 1)};
    for (std::size_t i = 0; i < body.points(); ++i) {
      const Point turn = cross(spin, difference(body.point(i), body.centre()));
      for (std::size_t a = 0; a < 3; ++a) body.velocity[3 * i + a] = 1e-3 * turn[a] / step;
    }
    shake(body, random, 1e-3 * speed);
    Scene scene(context, settings);
    scene.add(body);
    const Momentum before = momentum(scene);
    constexpr int steps = 60;
    for (int n = 0; n < steps; ++n) scene.step(step);
    const Momentum after = momentum(scene);
    if (const double change = length(difference(after.linear, before.linear)); !(change <= 1e-10 * before.linear_size))
      context.fail("the linear momentum of a body that nothing acts on changes by " + number(change / before.linear_size) +
                   " of sum m |v| in " + std::to_string(steps) + " steps, with " + body.described());
    // Of a mesh the host sees the barycentres; what turns inside of a tetrahedron is not in their sum.
    const double tolerance = form.mesh() ? 0.05 : 1e-8;
    if (const double change = length(difference(after.angular, before.angular)); !(change <= tolerance * before.angular_size))
      context.fail("the angular momentum of a body that nothing acts on changes by " + number(change / before.angular_size) +
                   " of sum m |x| |v| in " + std::to_string(steps) + " steps, with " + body.described());
  });
}

using Map = std::function<Point(const Point&, double part)>;

/// Moves all of the body along map(x, 0..1), comes to rest there, and lets go of what is free. Skips where handles do not hold.
void place(Context& context, Scene& scene, const Map& map, double step, const std::function<bool(const Point&)>& is_free) {
  const Body& body = scene.bodies().front();
  context.doing("holding all points of " + body.described() + " by handles");
  constexpr int moves = 8;
  for (int n = 1; n <= moves + 2; ++n) {
    const double now = std::min(1.0, double(n) / moves), before = std::min(1.0, double(n - 1) / moves);
    scene.handle = [&](std::size_t, const Point& rest, Motion& motion) {
      motion.position = map(rest, now);
      const Point moved = difference(motion.position, map(rest, before));
      for (std::size_t a = 0; a < 3; ++a) motion.velocity[a] = moved[a] / step;
      return true;
    };
    scene.step(step);
  }
  const auto x = scene.position();
  for (std::size_t i = 0; i < body.points(); ++i)
    if (!(length(difference(at(x, i), map(body.point(i), 1))) <= 1e-9 * body.edge))
      context.skip("points do not stay where handles hold them, see discretization.handles");
  scene.handle = [&map, is_free](std::size_t, const Point& rest, Motion& motion) {
    if (is_free(rest)) return false;
    motion = {map(rest, 1), {}};
    return true;
  };
}

/// x -> c + (I + part E) (x - c), strains of 1e-4: too little to break anything.
Map stretch(const Body& body) {
  return [c = body.centre()](const Point& x, double part) {
    constexpr double E[3][3] = {{1, 0.5, 0.2}, {0.5, -0.6, 0.3}, {0.2, 0.3, 0.8}};
    Point y = x;
    for (std::size_t a = 0; a < 3; ++a)
      for (std::size_t b = 0; b < 3; ++b) y[a] += 1e-4 * part * E[a][b] * (x[b] - c[b]);
    return y;
  };
}

/// The fastest velocity after letting go of all of a body strained by 1e-4. Skips if nothing moves.
double released_speed(Context& context, const Settings& settings, const Body& body, double step) {
  Scene scene(context, settings);
  scene.add(body);
  const Map map = stretch(body);
  place(context, scene, map, step, [](const Point&) { return true; });
  scene.step(step);
  const double speed = largest(scene.velocity());
  if (speed == 0) context.skip("a strain of 1e-4 moves nothing");
  return speed;
}

void rotates_freely(Context& context) {
  const Settings settings = context.settings().front();
  const Form form(context, settings);
  const Body body = form.body(5, 3);
  const double step = quiet_step(context, settings, body);
  const double scale = released_speed(context, settings, body, step);
  const Map turned = [c = body.centre()](const Point& x, double part) {
    // Rodrigues' formula, 30 degrees about (1, 2, 3).
    const double angle = part * 0.5235987755982988, norm = std::sqrt(14.0);
    const Point axis = {1 / norm, 2 / norm, 3 / norm}, r = difference(x, c), w = cross(axis, r);
    const double along = axis[0] * r[0] + axis[1] * r[1] + axis[2] * r[2];
    const Point shift = {0.05, -0.03, 0.02};
    Point y;
    for (std::size_t a = 0; a < 3; ++a)
      y[a] = c[a] + part * shift[a] + std::cos(angle) * r[a] + std::sin(angle) * w[a] + (1 - std::cos(angle)) * along * axis[a];
    return y;
  };
  Scene scene(context, settings);
  scene.add(body);
  place(context, scene, turned, step, [](const Point&) { return true; });
  for (int n = 0; n < 10; ++n) {
    scene.step(step);
    if (const double speed = largest(scene.velocity()); !(speed <= 1e-7 * scale))
      context.fail("a body turned by 30 degrees moves at " + number(speed) + " m/s " + std::to_string(n + 1) +
                   " steps after it was let go, a strain of 1e-4 moves it at " + number(scale) + " m/s, with " +
                   body.described());
  }
}

void patch_test(Context& context) {
  const Settings settings = context.settings().front();
  const Form form(context, settings);
  // Seven mean distances of points: twice the horizon of most nonlocal methods.
  const Body body = form.body(15, 9);
  const int depth = form.mesh() ? 4 : 7;
  const double step = quiet_step(context, settings, body);
  const double scale = released_speed(context, settings, body, step);
  Scene scene(context, settings);
  scene.add(body);
  const Map map = stretch(body);
  place(context, scene, map, step, [&](const Point& x) {
    for (std::size_t a = 0; a < 3; ++a) {
      const double low = (x[a] - body.corner[a]) / body.edge;
      if (std::min(low, body.cells - low) < depth - 1e-6) return false;
    }
    return true;
  });
  scene.step(step);
  const auto v = scene.velocity();
  // The tetrahedra of a cell differ; what acts on all of them vanishes.
  std::map<int, std::pair<Point, int>> sums;
  for (std::size_t i = 0; i < body.points(); ++i) {
    if (body.depth[i] < depth) continue;
    auto& [sum, count] = sums[body.cell[i]];
    for (std::size_t a = 0; a < 3; ++a) sum[a] += v[3 * i + a];
    ++count;
  }
  for (const auto& [cell, sum] : sums)
    if (const double speed = length(sum.first) / sum.second; !(speed <= 1e-6 * scale))
      context.fail("under a uniform strain of 1e-4 the acceleration of a point " + std::to_string(depth) +
                   " cells inside of the surface is " + number(speed / scale) +
                   " of that of the surface and should be zero, with " + body.described());
}

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
  Play(Context& context, const Settings& settings, const Form& form, Random& random)
      : bodies{form.body(4, 2), form.body(3, 3, {0.5, -0.2, 0.5})}, step(quiet_step(context, settings, bodies[0])) {
    for (Body& body : bodies) shake(body, random, 1e-3 * body.edge / step);
  }
  std::unique_ptr<Scene> begin(Context& context, const Settings& settings) const {
    auto scene = std::make_unique<Scene>(context, settings);
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

void stable_step(Context& context) {
  const Settings settings = context.settings().front();
  const Form form(context, settings);
  context.random_cases(2, [&](Random& random) {
    Body body = form.body(5, 3);
    double first;
    {
      Scene scene(context, settings);
      scene.add(body);
      first = scene.told_step();
    }
    if (!(first > 0) || !std::isfinite(first)) context.fail("tells " + number(first) + " s as the largest stable step");
    shake(body, random, 1e-3 * body.edge / first);
    Scene scene(context, settings);
    scene.add(body);
    const auto kinetic = [&] {
      const auto v = scene.velocity();
      double sum = 0;
      for (std::size_t i = 0; i < body.points(); ++i) sum += 0.5 * body.mass(i) * std::pow(length(at(v, i)), 2);
      return sum;
    };
    const double given = kinetic();
    if (given == 0) context.skip("it does not keep the velocities it gets, see discretization.fields");
    for (int n = 1; n <= 200; ++n) {
      const double step = scene.told_step();
      if (!(step > 0) || !std::isfinite(step))
        context.fail("tells " + number(step) + " s as the largest stable step after " + std::to_string(n - 1) + " steps");
      scene.step(step);
      // Close to the limit a stable integration trades several times the energy to and fro.
      if (const double energy = kinetic(); !(energy <= 10 * given))
        context.fail("steps as long as stable_step() tells are not stable: after " + std::to_string(n) + " of them, the last " +
                     number(step) + " s, the kinetic energy is " + number(energy / given) + " times what there was, with " +
                     body.described());
    }
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

void falls(Context& context) {
  const Settings settings = context.settings().front();
  const Form form(context, settings);
  const Body body = form.body(4, 3);
  const double step = quiet_step(context, settings, body), size = 1e-3 * body.edge / (step * step);
  Scene scene(context, settings);
  scene.add(body);
  scene.gravity = {0.3 * size, -0.9 * size, 0.1 * size};
  constexpr int steps = 40;
  for (int n = 0; n < steps; ++n) scene.step(step);
  const auto x = scene.position(), v = scene.velocity();
  Point fallen{}, fast{};
  double mass = 0;
  for (std::size_t i = 0; i < body.points(); ++i) {
    mass += body.mass(i);
    for (std::size_t a = 0; a < 3; ++a) {
      fallen[a] += body.mass(i) * (x[3 * i + a] - body.position[3 * i + a]);
      fast[a] += body.mass(i) * v[3 * i + a];
    }
  }
  for (std::size_t a = 0; a < 3; ++a) {
    const double t = steps * step, g = scene.gravity[a];
    if (const double off = fast[a] / mass / (g * t) - 1; !(std::abs(off) <= 1e-9))
      context.fail("after " + std::to_string(steps) + " steps of free fall the velocity of the centre of mass is off g t by " +
                   number(off) + " of it, with " + body.described());
    // Integrators of first order are off by half a step's worth.
    if (const double off = fallen[a] / mass / (0.5 * g * t * t) - 1; !(std::abs(off) <= 1.0 / steps + 1e-6))
      context.fail("after " + std::to_string(steps) + " steps of free fall the centre of mass is off g t^2/2 by " +
                   number(off) + " of it, with " + body.described());
    for (std::size_t i = 0; i < body.points(); ++i)
      if (!(std::abs(v[3 * i + a] - g * t) <= 1e-7 * size * t))
        context.fail("points fall at different speeds where nothing but gravity acts, with " + body.described());
  }
}

void collides(Context& context) {
  const Settings settings = context.settings().front();
  const Form form(context, settings);
  Body body = form.body(4, 3);
  const double step = quiet_step(context, settings, body), speed = 0.002 * body.edge / step;
  for (std::size_t i = 0; i < body.points(); ++i) body.velocity[3 * i + 2] = -speed;
  double lowest = body.corner[2] + body.cells * body.edge;
  for (std::size_t i = 0; i < body.points(); ++i) lowest = std::min(lowest, body.position[3 * i + 2]);
  for (std::size_t i = 0; i < body.vertices.size() / 3; ++i) lowest = std::min(lowest, body.vertices[3 * i + 2]);
  const double floor = lowest - 0.25 * body.edge;
  Scene scene(context, settings);
  scene.add(body);
  scene.gravity = {0, 0, -2e-4 * body.edge / (step * step)};
  scene.collider = [floor](const Point& x, Point& v) {
    if (x[2] < floor) v[2] = std::max(v[2], 0.0);
  };
  std::vector<double> before = body.position;
  for (int n = 0; n < 300; ++n) {
    scene.step(step);
    const auto x = scene.position(), v = scene.velocity();
    for (std::size_t i = 0; i < body.points(); ++i) {
      const double depth = floor - x[3 * i + 2];
      if (!std::isfinite(depth)) context.fail("a body that falls on a floor gets positions that are not finite");
      if (!(depth <= 0.05 * body.edge))
        context.fail("a point of a body that falls on a floor gets " + number(depth / body.edge) +
                     " cells below it: what collide() makes of its velocity is not what it moves with, with " +
                     body.described());
      if (depth > 0 && before[3 * i + 2] < floor && v[3 * i + 2] < -1e-3 * speed)
        context.fail("a point that was below the floor leaves the step moving down, against what collide() made of it, with " +
                     body.described());
    }
    before = x;
  }
}

void holds(Context& context) {
  const Settings settings = context.settings().front();
  const Form form(context, settings);
  const std::vector<Body> bodies = {form.body(3, 2), form.body(5, 3, {0.5, -0.2, 0.5})};
  const double step = quiet_step(context, settings, bodies[1]), speed = 0.02 * bodies[1].edge / step;
  Scene scene(context, settings);
  for (const Body& body : bodies) scene.add(body);
  const auto held = [&](const Point& rest) { return rest[0] < bodies[1].corner[0] + (2 + 1e-6) * bodies[1].edge; };
  for (int n = 1; n <= 20; ++n) {
    scene.handle = [&](std::size_t body, const Point& rest, Motion& motion) {
      if (body != 1 || !held(rest)) return false;
      motion = {{rest[0], rest[1] + n * step * speed, rest[2]}, {0, speed, 0}};
      return true;
    };
    scene.step(step);
    const auto x = scene.position(1), v = scene.velocity(1);
    for (std::size_t i = 0; i < bodies[1].points(); ++i) {
      if (!held(bodies[1].point(i))) continue;
      Point there = bodies[1].point(i);
      there[1] += n * step * speed;
      if (const double apart = length(difference(at(x, i), there)); !(apart <= 1e-9 * bodies[1].edge))
        context.fail("a point that a handle moves is " + number(apart) + " m from where the handle is after step " +
                     std::to_string(n) + ", with " + bodies[1].described());
      if (const double apart = length(difference(at(v, i), {0, speed, 0})); !(apart <= 1e-9 * speed))
        context.fail("the velocity of a point that a handle moves is off by " + number(apart) + " m/s after step " +
                     std::to_string(n) + ", with " + bodies[1].described());
    }
    if (const double moving = largest(scene.velocity(0)); !(moving <= 1e-6 * speed))
      context.fail("a handle of body 1 moves points of body 0 at " + number(moving) + " m/s");
  }
  scene.handle = nullptr;
  const auto before = scene.position(1);
  scene.step(step);
  const auto after = scene.position(1);
  if (after == before) context.fail("points stay where they are after their handle let them go at " + number(speed) + " m/s");
}

void takes_bodies(Context& context) {
  const Settings settings = context.settings().front();
  std::string no_points, no_mesh;
  const auto takes = [&](const Body& body, std::string& words) {
    Scene scene(context, settings);
    context.doing("given " + body.described());
    return scene.try_add(body, &words) == CLEAVE_OK;
  };
  const bool points = takes(lattice(4), no_points), mesh = takes(tetrahedra(3), no_mesh);
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
    cleave_surroundings surroundings{sizeof surroundings, 0, {0, 0, -1}, nullptr, nullptr, nullptr};
    surroundings.collide = [](void*, std::uint64_t, const double*, double*) {};
    surroundings.handle = [](void*, std::uint64_t, std::uint32_t, std::uint64_t, double*, double*) -> std::int32_t {
      return 0;
    };
    if (guarded) {
      {
        const Guarded position(body.position), velocity(body.velocity), volume(body.volume), vertices(body.vertices);
        const Guarded tetrahedra(body.tetrahedra);
        Enlarged given(body.abi());
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

std::vector<Check> discretization_checks() {
  return {
      {"discretization.motion", 49, "Without forces linear and angular momentum are kept, and a uniform translation is exact.",
       discretization_kind, keeps_motion},
      {"discretization.checkpoint", 50,
       "A saved state, restored into the same or a fresh instance, goes on with the same bits.", discretization_kind,
       checkpoint},
      {"discretization.rigid-rotation", 58, "A body that was turned and shifted as a whole rests there when it is let go.",
       discretization_kind, rotates_freely},
      {"discretization.patch-test", 59, "Under a uniform strain nothing accelerates away from the surface.",
       discretization_kind, patch_test},
      {"discretization.restore-refuses", 60, "Truncated, random and foreign bytes are no state and are refused with words.",
       discretization_kind, refuses_garbage},
      {"discretization.stable-step", 61, "The stable step is positive and finite, and 200 of them keep the energy bounded.",
       discretization_kind, stable_step},
      {"discretization.fields", 62,
       "Position and velocity of the points are there, fields are described, and what a body got is what it has.",
       discretization_kind, fields_described},
      {"discretization.gravity", 63, "Free fall is exact: the centre of mass gains g t, and nothing deforms.",
       discretization_kind, falls},
      {"discretization.colliders", 64, "Points move as colliders allow: none gets through a floor.", discretization_kind,
       collides},
      {"discretization.handles", 65, "What a handle holds is where and as fast as the handle says; the rest is free.",
       discretization_kind, holds},
      {"discretization.bodies", 66,
       "A lattice of points or a cube of tetrahedra is taken; a body without points is refused with words or harmless.",
       discretization_kind, takes_bodies},
      {"discretization.surface", 67, "Triangles of the surface refer to vertices that exist and are finite.",
       discretization_kind, surface_valid},
      {"discretization.deterministic", 68,
       "The same steps give the same bits in every instance, and instances do not influence each other.", discretization_kind,
       deterministic},
      {"discretization.inputs-unchanged", 69,
       "Bodies and surroundings are only read, and not after the call; shorter or longer structs do no harm.",
       discretization_kind, inputs_unchanged},
  };
}

}  // namespace cleave::testkit
