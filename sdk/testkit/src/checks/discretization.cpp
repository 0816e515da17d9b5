// How bodies move.
#include "points.hpp"

#include <cleave/testkit/body.hpp>

#include <algorithm>
#include <cmath>
#include <functional>
#include <map>

namespace cleave::testkit {
namespace {

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
    const auto turning = [&](const Point& x) {
      const Point turn = cross(spin, difference(x, body.centre()));
      return Point{1e-3 * turn[0] / step, 1e-3 * turn[1] / step, 1e-3 * turn[2] / step};
    };
    for (std::size_t i = 0; i < body.points(); ++i) {
      const Point v = turning(body.point(i));
      std::copy(v.begin(), v.end(), body.velocity.begin() + std::ptrdiff_t(3 * i));
    }
    // What is shaken at the points of a mesh, its vertices do not see.
    for (std::size_t i = 0; form.mesh() && i < body.vertices.size() / 3; ++i) {
      const Point v = turning(body.vertex(i));
      body.vertex_velocity.insert(body.vertex_velocity.end(), v.begin(), v.end());
    }
    if (!form.mesh()) shake(body, random, 1e-3 * speed);
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

}  // namespace

std::vector<Check> discretization_checks() {
  return {
      {"discretization.motion", 49, "Without forces linear and angular momentum are kept, and a uniform translation is exact.",
       discretization_kind, keeps_motion},
      {"discretization.rigid-rotation", 58, "A body that was turned and shifted as a whole rests there when it is let go.",
       discretization_kind, rotates_freely},
      {"discretization.patch-test", 59, "Under a uniform strain nothing accelerates away from the surface.",
       discretization_kind, patch_test},
      {"discretization.stable-step", 61, "The stable step is positive and finite, and 200 of them keep the energy bounded.",
       discretization_kind, stable_step},
      {"discretization.gravity", 63, "Free fall is exact: the centre of mass gains g t, and nothing deforms.",
       discretization_kind, falls},
      {"discretization.colliders", 64, "Points move as colliders allow: none gets through a floor.", discretization_kind,
       collides},
      {"discretization.handles", 65, "What a handle holds is where and as fast as the handle says; the rest is free.",
       discretization_kind, holds},
  };
}

}  // namespace cleave::testkit
