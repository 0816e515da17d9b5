#include "guarded.hpp"

#include <cleave/testkit/context.hpp>
#include <cleave/testkit/grid_system.hpp>

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <cstdio>
#include <cstring>

namespace cleave::testkit {
namespace {

/// Largest residual of what counts as projected, relative.
constexpr double tolerance = 1e-6;
/// Largest error of velocities, relative to sqrt(v*^T M v*): how much a residual weighs there depends on the scaling of rows,
/// and velocities that nearly dependent rows hardly see are left to it.
constexpr double velocity_tolerance = 5e-4;

/// A law that offers to give way, with a parameter `relaxation`, is held to what it does without.
Settings unrelaxed(const cleave_schema& schema, Settings settings) {
  for (std::uint32_t i = 0; i < schema.parameter_count; ++i)
    if (std::strcmp(schema.parameters[i]->key, "relaxation") == 0) settings["relaxation"] = 0.0;
  return settings;
}

std::string number(double value) {
  char text[32];
  std::snprintf(text, sizeof text, "%.3g", value);
  return text;
}

std::string described(const Block& block) {
  const char* fibers[] = {"fibres along one direction", "fibres along random directions", "no fibres"};
  const char* strains[] = {"at rest", "rotated", "strained by a percent"};
  const char* holds[] = {"free", "between walls", "with every node prescribed"};
  const std::string edge = std::to_string(block.cells);
  return "a block of " + edge + "x" + edge + (block.dimension == 3 ? "x" + edge : "") + " cells, " + strains[block.strain] +
         ", " + fibers[block.fibers] + ", " + holds[block.held];
}

/// The blocks of which a projection exists whatever the constraint asks of the deformation: a common strain with a common
/// fibre can be undone by one velocity gradient, and without strain there is nothing to undo.
std::vector<Block> blocks() {
  std::vector<Block> all;
  for (int dimension : {2, 3}) {
    const int cells = dimension == 2 ? 5 : 3;
    all.push_back({dimension, cells, 2, Block::random, Block::rotated, Block::free});
    all.push_back({dimension, cells, 2, Block::uniform, Block::strained, Block::free});
    all.push_back({dimension, cells, 2, Block::random, Block::rest, Block::walls});
  }
  return all;
}

double size(const GridSystem& system, const std::vector<double>& velocity) {
  return std::sqrt(system.product(velocity, velocity));
}
std::vector<double> difference(const std::vector<double>& a, const std::vector<double>& b) {
  std::vector<double> result(a.size());
  for (std::size_t i = 0; i < a.size(); ++i) result[i] = a[i] - b[i];
  return result;
}
bool same_bits(const std::vector<double>& a, const std::vector<double>& b) {
  return a.size() == b.size() && (a.empty() || std::memcmp(a.data(), b.data(), a.size() * sizeof(double)) == 0);
}

void expect_finite(Context& context, const Projection& projection, const std::string& what) {
  for (double v : projection.velocity)
    if (!std::isfinite(v)) context.fail("gives velocities that are not finite and no error, for " + what);
  if (!(projection.report.residual >= 0) || !std::isfinite(projection.report.residual))
    context.fail("reports the residual " + number(projection.report.residual) + ", for " + what);
}

/// As project(), but throws Failed unless the call succeeded with finite numbers.
Projection projected(Context& context, const ConstraintInstance& instance, const GridSystem& system, const std::string& what) {
  context.doing(what);
  const Projection projection = project(instance, system);
  if (projection.result != CLEAVE_OK)
    context.fail("project() fails with result " + std::to_string(projection.result) + ", " + projection.words + ", for " +
                 what);
  expect_finite(context, projection, what);
  return projection;
}

/// Calls body(instance, block, random, what) for each block, with random systems of it.
template <class Body>
void for_blocks(Context& context, int count, Body body) {
  for (const Settings& given : context.settings())
    for (const Block& block : blocks()) {
      const Settings settings = unrelaxed(context.plugin().schema(), given);
      const std::string what = described(block) + ", with " + text(settings);
      context.random_cases(count, [&](Random& random) {
        const ConstraintInstance instance(context.plugin(), settings, block.dimension);
        body(instance, block, random, what);
      });
    }
}

void projects(Context& context) {
  double change = 0;
  for_blocks(context, 2, [&](const ConstraintInstance& instance, const Block& block, Random& random, const std::string& what) {
    std::array<double, 3> carried{};
    const GridSystem system = random_block(random, block, &carried);
    const Projection once = projected(context, instance, system, what);
    if (once.report.residual > tolerance)
      context.fail("reports the residual " + number(once.report.residual) + " after " + std::to_string(once.report.iterations) +
                   " iterations, above " + number(tolerance) + ", for " + what);
    const double scale = size(system, system.velocity);
    const auto correction = difference(once.velocity, system.velocity);
    change = std::max(change, size(system, correction) / scale);

    // What the particles know of the step before stays: rows may ask for rates that depend on it.
    GridSystem again = system;
    again.velocity = once.velocity;
    const Projection twice = projected(context, instance, again, "the projected velocities of " + what);
    if (const double moved = size(system, difference(twice.velocity, once.velocity)) / scale; moved > velocity_tolerance)
      context.fail("a second projection changes the velocities by " + number(moved) +
                   " of what they were: the first did not meet the constraint, for " + what);

    // Without strain to undo and rates of the step before, the motion of the walls meets the constraint as well, and the
    // correction is orthogonal to what lies between the two: the projected velocity is the nearest one.
    if (block.strain == Block::strained) return;
    GridSystem first = system;
    std::fill(first.velocity_gradient.begin(), first.velocity_gradient.end(), 0.0);
    const Projection nearest = projected(context, instance, first, what + ", after a step without motion");
    const auto nearest_correction = difference(nearest.velocity, system.velocity);
    std::vector<double> relative = nearest.velocity;
    for (std::size_t i = 0; block.held == Block::walls && i < relative.size(); ++i)
      relative[i] -= carried[i % std::size_t(block.dimension)];
    if (const double cosine = system.product(nearest_correction, relative) / (scale * scale);
        std::abs(cosine) > velocity_tolerance)
      context.fail("(v - v*)^T M v is " + number(cosine) +
                   " of v*^T M v* and should be zero: a nearer velocity meets the constraint, for " + what);
  });
  if (change == 0) context.fail("leaves all random velocities as they are");
}

void keeps_momentum(Context& context) {
  for_blocks(context, 2, [&](const ConstraintInstance& instance, const Block& block, Random& random, const std::string& what) {
    if (block.held != Block::free) return;
    const GridSystem system = random_block(random, block);
    const Projection projection = projected(context, instance, system, what);
    const auto d = std::size_t(block.dimension);
    std::vector<double> change(d);
    double scale = 0;
    for (std::size_t i = 0; i < system.velocity.size(); ++i) {
      change[i % d] += system.mass[i / d] * (projection.velocity[i] - system.velocity[i]);
      scale += system.mass[i / d] * std::abs(system.velocity[i]);
    }
    for (std::size_t a = 0; a < d; ++a)
      if (std::abs(change[a]) > 1e-10 * scale)
        context.fail("the momentum along axis " + std::to_string(a) + " changes by " + number(change[a] / scale) +
                     " of sum m |v|, for " + what);
  });
}

void keeps_prescribed(Context& context) {
  for_blocks(context, 2, [&](const ConstraintInstance& instance, const Block& block, Random& random, const std::string& what) {
    if (block.held != Block::walls) return;
    const GridSystem system = random_block(random, block);
    const Projection projection = projected(context, instance, system, what);
    const auto d = std::size_t(block.dimension);
    for (std::size_t i = 0; i < system.node_count(); ++i) {
      const double *before = &system.velocity[d * i], *after = &projection.velocity[d * i];
      double along = 0, scale = 0;
      bool same = true;
      for (std::size_t a = 0; a < d; ++a) {
        along += (after[a] - before[a]) * system.normal[d * i + a];
        scale += std::abs(after[a]) + std::abs(before[a]);
        same = same && std::memcmp(after + a, before + a, sizeof(double)) == 0;
      }
      if (system.prescribed[i] == 1 && !same)
        context.fail("changes the velocity of node " + std::to_string(i) + ", which is fixed (prescribed 1), for " + what);
      if (system.prescribed[i] == 2 && std::abs(along) > 1e-10 * scale)
        context.fail("changes the velocity of node " + std::to_string(i) + " along its normal by " + number(along) +
                     " m/s, which is fixed (prescribed 2), for " + what);
    }
  });
}

void nothing_to_do(Context& context) {
  const Settings settings = context.settings().front();
  context.random_cases(4, [&](Random& random) {
    for (int dimension : {2, 3}) {
      const ConstraintInstance instance(context.plugin(), settings, dimension);
      const int cells = dimension == 2 ? 5 : 3;
      const auto unchanged = [&](const GridSystem& system, const std::vector<bool>& nodes, const std::string& what) {
        const Projection projection = projected(context, instance, system, what);
        const auto d = std::size_t(dimension);
        for (std::size_t i = 0; i < d * system.node_count(); ++i)
          if (!nodes[i / d] && std::memcmp(&projection.velocity[i], &system.velocity[i], sizeof(double)) != 0)
            context.fail("changes the velocity of node " + std::to_string(i / d) + " by " +
                         number(projection.velocity[i] - system.velocity[i]) + " m/s, for " + what);
      };
      const std::string dimensions = std::to_string(dimension) + " dimensions";
      const GridSystem block = random_block(random, {dimension, cells, 2, Block::random, Block::rotated, Block::free});

      GridSystem none = block;
      none.keep_particles(std::vector<bool>(block.particle_count(), false));
      unchanged(none, std::vector<bool>(block.node_count(), false), "a system without particles, in " + dimensions);

      std::vector<bool> some(block.particle_count());
      for (std::size_t p = 0; p < some.size(); ++p)
        some[p] = block.position[std::size_t(dimension) * p] < block.position[0] + 0.3 * cells;
      GridSystem part = block;
      part.keep_particles(some);
      unchanged(part, block.near(some), "nodes that only particles of other materials are near, in " + dimensions);

      if (instance.reads_fibers()) {
        const GridSystem bare = random_block(random, {dimension, cells, 2, Block::none, Block::rotated, Block::free});
        unchanged(bare, std::vector<bool>(bare.node_count(), false), "particles with fibres of length zero, in " + dimensions);
      }

      GridSystem rest = random_block(random, {dimension, cells, 2, Block::random, Block::rest, Block::free});
      std::fill(rest.velocity.begin(), rest.velocity.end(), 0.0);
      rest.gather_gradients();
      const std::string what = "a block that is undeformed and does not move, in " + dimensions;
      const Projection projection = projected(context, instance, rest, what);
      for (double v : projection.velocity)
        if (std::abs(v) > 1e-9) context.fail("sets nodes moving at " + number(v) + " m/s, for " + what);
    }
  });
}

void rank_deficient(Context& context) {
  const Settings settings = context.settings().front();
  context.random_cases(4, [&](Random& random) {
    for (int dimension : {2, 3}) {
      const ConstraintInstance instance(context.plugin(), settings, dimension);
      const auto attempt = [&](const GridSystem& system, bool solvable, std::string what) {
        what += ", in " + std::to_string(dimension) + " dimensions";
        context.doing(what);
        const Projection projection = project(instance, system);
        if (projection.result != CLEAVE_OK) {
          if (projection.words.find("(no words)") != std::string::npos)
            context.fail("fails with result " + std::to_string(projection.result) + " without a word, for " + what);
          return;
        }
        expect_finite(context, projection, what);
        if (solvable && projection.report.residual > tolerance)
          context.fail("reports the residual " + number(projection.report.residual) +
                       " and no error, though rest meets the constraint, for " + what);
      };
      const auto places = [&](std::vector<std::array<double, 3>> points) {
        std::vector<double> all;
        for (const auto& point : points) all.insert(all.end(), point.begin(), point.begin() + dimension);
        return particles_at(random, dimension, all);
      };
      const std::array<double, 3> at = {random.uniform(3, 4), random.uniform(3, 4), random.uniform(3, 4)};
      attempt(places({at}), true, "one particle in a cell");
      attempt(places({at, {at[0] + 4, at[1], at[2]}, {at[0], at[1] + 1, at[2]}}), true, "particles that are one to a cell");
      attempt(places({at, at}), true, "two particles at one place");
      attempt(places({{3.5, 4.5, 5.5}}), true, "a particle on the boundary of a node's support");
      attempt(places({{3.5 + 1e-7, 4.5 + 1e-7, at[2]}, at}), true, "a particle 1e-7 cells inside of a node's support");
      GridSystem half = places({at});
      for (std::size_t i = 0; i < half.node_count(); i += 2) {
        half.prescribed[i] = 1;
        std::fill_n(&half.velocity[std::size_t(dimension) * i], dimension, 0.0);
      }
      half.gather_gradients();
      attempt(half, true, "one particle in a cell, every other node prescribed");
      attempt(random_block(random, {dimension, 3, 2, Block::random, Block::rest, Block::everything}), false,
              "a block whose nodes are all prescribed");
    }
  });
}

void deterministic(Context& context) {
  const Settings settings = context.settings().front();
  const auto other_settings = context.settings_at(0.62);
  for (const Block& block : blocks())
    context.random_cases(1, [&](Random& random) {
      const std::string what = described(block);
      const GridSystem system = random_block(random, block);
      const GridSystem other = random_block(random, block);
      const auto expect = [&](const Projection& a, const Projection& b, const std::string& how) {
        if (!same_bits(a.velocity, b.velocity) || a.report.residual != b.report.residual ||
            a.report.iterations != b.report.iterations || a.report.rows != b.report.rows)
          context.fail(how + ", for " + what);
      };
      const auto alone = [&] {
        const ConstraintInstance instance(context.plugin(), settings, block.dimension);
        return std::array{projected(context, instance, system, what), projected(context, instance, other, what)};
      };
      const auto first = alone(), second = alone();
      expect(first[0], second[0], "a second instance gives other results for the same system");
      expect(first[1], second[1], "a second instance gives other results for the same two systems");
      const ConstraintInstance a(context.plugin(), settings, block.dimension);
      const ConstraintInstance b(context.plugin(), other_settings.value_or(settings), block.dimension);
      const Projection before = projected(context, a, system, what);
      project(b, other);
      expect(first[0], before, "a second instance beside it changes the results of the first");
      expect(first[1], projected(context, a, other, what), "a call of a second instance changes the results of the first");
    });
}

using State = std::vector<unsigned char>;

State saved(Context& context, const ConstraintInstance& instance) {
  const cleave_constraint& table = instance.table();
  State state(table.save(instance.handle(), nullptr, 0));
  const Guarded memory(state);
  const std::uint64_t written = table.save(instance.handle(), memory.data(), state.size());
  if (written != state.size())
    context.fail("save() writes " + std::to_string(written) + " bytes where it said " + std::to_string(state.size()));
  if (!memory.intact_before()) context.fail("save() writes before its buffer");
  return memory.values();
}

void checkpoint(Context& context) {
  const Settings settings = context.settings().front();
  for (const Block& block : blocks())
    context.random_cases(1, [&](Random& random) {
      const std::string what = described(block);
      GridSystem system = random_block(random, block);
      std::vector<GridSystem> steps;  // the same nodes and particles, as from step to step
      for (int step = 0; step < 6; ++step) {
        for (std::size_t i = 0; i < system.velocity.size(); ++i)
          if (system.prescribed[i / std::size_t(block.dimension)] == 0) system.velocity[i] += random.uniform(-0.1, 0.1);
        system.gather_gradients();
        steps.push_back(system);
      }
      const auto play = [&](const ConstraintInstance& instance, std::size_t first, std::size_t last) {
        std::vector<Projection> results;
        for (std::size_t step = first; step < last; ++step) results.push_back(projected(context, instance, steps[step], what));
        return results;
      };
      const ConstraintInstance instance(context.plugin(), settings, block.dimension);
      const cleave_constraint& table = instance.table();
      const bool offers = CLEAVE_HAS(cleave_constraint, &table, restore);
      if (!offers || (!table.save && !table.restore)) context.skip("offers neither save() nor restore()");
      if (!table.save || !table.restore) context.fail("offers one of save() and restore()");
      play(instance, 0, 3);
      context.doing("saving, after three steps of " + what);
      const State state = saved(context, instance);
      if (saved(context, instance) != state) context.fail("two save() of one state write different bytes, for " + what);
      const auto expected = play(instance, 3, 6);
      const auto restore = [&](const ConstraintInstance& to, const State& bytes, Words& words) {
        const Guarded memory(bytes);
        return table.restore(to.handle(), memory.read_only(), bytes.size(), &words.message);
      };
      const ConstraintInstance fresh(context.plugin(), settings, block.dimension);
      for (const ConstraintInstance* other : {&instance, &fresh}) {
        const std::string which = other == &fresh ? "a fresh instance" : "the instance that saved it";
        context.doing("restoring " + which + ", for " + what);
        Words words;
        if (const cleave_result result = restore(*other, state, words); result != CLEAVE_OK)
          context.fail("restore() refuses what save() wrote, with result " + std::to_string(result) + ": " + words.said());
        if (saved(context, *other) != state) context.fail("restored into " + which + ", a state is saved as another one");
        const auto results = play(*other, 3, 6);
        for (std::size_t step = 0; step < results.size(); ++step)
          if (!same_bits(results[step].velocity, expected[step].velocity) ||
              results[step].report.iterations != expected[step].report.iterations)
            context.fail("restored into " + which + ", step " + std::to_string(step + 1) + " has other bits, for " + what);
      }
      const auto refused = [&](const State& bytes, const std::string& which) {
        const ConstraintInstance to(context.plugin(), settings, block.dimension);
        context.doing("restoring " + which + ", for " + what);
        Words words;
        if (restore(to, bytes, words) == CLEAVE_OK) context.fail("restore() accepts " + which);
        if (!words.text[0]) context.fail("restore() refuses " + which + " without a word");
      };
      if (!state.empty()) refused(State(state.begin(), state.end() - 1), "a state without its last byte");
      State longer = state;
      longer.push_back(0);
      refused(longer, "a state and one more byte");
    });
}

void inputs_unchanged(Context& context) {
  const Settings settings = context.settings().front();
  for (const Block& block : blocks())
    context.random_cases(1, [&](Random& random) {
      const std::string what = described(block);
      const GridSystem system = random_block(random, block);
      const auto call = [&](std::size_t report_size, bool larger) {
        const ConstraintInstance instance(context.plugin(), settings, block.dimension);
        const Guarded mass(system.mass), velocity(system.velocity), normal(system.normal), position(system.position),
            volume(system.volume), deformation(system.deformation), fiber(system.fiber), gradient(system.velocity_gradient);
        const Guarded node_cell(system.node_cell);
        const Guarded prescribed(system.prescribed);
        const Guarded nodes(system.nodes);
        Enlarged seen(cleave_constraint_system{
            sizeof(cleave_constraint_system), std::uint32_t(system.dimension), system.cell_size, system.time_step,
            system.node_count(), mass.read_only(), velocity.data(), node_cell.read_only(), prescribed.read_only(),
            system.normal.empty() ? nullptr : normal.read_only(), system.particle_count(), position.read_only(),
            volume.read_only(), deformation.read_only(), instance.reads_fibers() ? fiber.read_only() : nullptr,
            gradient.read_only(), nodes.read_only(), nullptr, nullptr});
        if (!larger) seen.known.struct_size = sizeof seen.known;
        const Guarded<char> the_system(reinterpret_cast<const char*>(&seen), seen.known.struct_size);
        Enlarged report(cleave_constraint_report{});
        report.known.struct_size = std::uint32_t(report_size);
        const Guarded<char> the_report(reinterpret_cast<const char*>(&report), report_size);
        Words words;
        const cleave_result result = instance.table().project(
            instance.handle(), reinterpret_cast<const cleave_constraint_system*>(the_system.read_only()),
            reinterpret_cast<cleave_constraint_report*>(the_report.data()), &words.message);
        if (result != CLEAVE_OK) context.fail("fails with " + words.said() + ", for " + what);
        if (!velocity.intact_before()) context.fail("writes before the first velocity, for " + what);
        if (!the_report.intact_before()) context.fail("writes before the report, for " + what);
        if (std::memcmp(the_report.data(), &report.known.struct_size, sizeof report.known.struct_size) != 0)
          context.fail("changes the struct_size of the report, for " + what);
        for (std::size_t i = sizeof report.known; i < report_size; ++i)
          if (the_report.data()[i] != 0x5A) context.fail("writes beyond the members of the report it knows, for " + what);
        return velocity.values();
      };
      context.doing("given read-only inputs in guarded memory, for " + what);
      const auto expected = call(sizeof(cleave_constraint_report), false);
      context.doing("given a report that ends before `rows`, for " + what);
      call(offsetof(cleave_constraint_report, rows), false);
      context.doing("given larger structs than it knows, for " + what);
      if (!same_bits(expected, call(sizeof(Enlarged<cleave_constraint_report>), true)))
        context.fail("larger structs than it knows change the velocities, for " + what);
    });
}

}  // namespace

std::vector<Check> constraint_checks() {
  return {
      {"constraint.projects", 47,
       "After the projection the residual is small, a second projection changes nothing, and no nearer velocity would do.",
       constraint_kind, projects},
      {"constraint.nothing-to-do", 48,
       "Without particles, without fibres and away from them nothing changes, and what is at rest stays at rest.",
       constraint_kind, nothing_to_do},
      {"constraint.momentum", 53, "The linear momentum of a body that nothing holds is kept.", constraint_kind, keeps_momentum},
      {"constraint.prescribed", 54, "Prescribed nodes keep their velocity, or its part along their normal.", constraint_kind,
       keeps_prescribed},
      {"constraint.rank-deficient", 55,
       "One particle in a cell, two at one place, and nodes that are all prescribed converge or give an error with words.",
       constraint_kind, rank_deficient},
      {"constraint.deterministic", 56,
       "Fresh instances give the same bits for the same systems, and instances do not influence each other.", constraint_kind,
       deterministic},
      {"constraint.inputs-unchanged", 57,
       "Inputs are only read, nothing beyond the arrays is touched, and shorter or longer structs do no harm.", constraint_kind,
       inputs_unchanged},
      {"constraint.checkpoint", 81,
       "What is kept from step to step, saved and restored into the same or a fresh instance, gives the same bits; parts of it "
       "are refused with words.",
       constraint_kind, checkpoint},
  };
}

}  // namespace cleave::testkit
