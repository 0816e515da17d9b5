// Threads that are lent to constraints.
#include <cleave/testkit/context.hpp>
#include <cleave/testkit/grid_system.hpp>
#include <cleave/testkit/lent.hpp>

#include <cstring>
#include <string>

namespace cleave::testkit {
namespace {

void same_with_threads(Context& context) {
  const Settings settings = context.settings().front();
  bool used = false;
  for (const int dimension : {2, 3})
    context.random_cases(1, [&](Random& random) {
      Block block;
      block.dimension = dimension;
      block.cells = dimension == 2 ? 24 : 7;
      block.strain = Block::rest;
      block.held = Block::walls;
      GridSystem system = random_block(random, block);
      const std::string what = "a block of " + std::to_string(system.particle_count()) + " particles in " +
                               std::to_string(dimension) + " dimensions";
      const auto projected = [&](const LentThreads* threads) {
        const ConstraintInstance instance(context.plugin(), settings, dimension);
        system.threads = threads ? threads->get() : nullptr;
        context.doing("projecting " + what);
        Projection projection = project(instance, system);
        if (projection.result != CLEAVE_OK)
          context.fail("project() fails with result " + std::to_string(projection.result) + ", " + projection.words + ", for " +
                       what);
        return projection;
      };
      const Projection expected = projected(nullptr);
      for (const auto order : {LentThreads::forwards, LentThreads::backwards, LentThreads::side_by_side}) {
        const LentThreads threads(order);
        const Projection found = projected(&threads);
        if (!threads.misuse().empty()) context.fail(threads.misuse());
        if (found.report.iterations != expected.report.iterations ||
            std::memcmp(found.velocity.data(), expected.velocity.data(), expected.velocity.size() * sizeof(double)) != 0)
          context.fail("the projection has other bits with " + std::string(LentThreads::name(order)) +
                       " than without threads, for " + what);
        used = used || threads.used();
      }
    });
  if (!used) context.remark("it uses no threads");
}

}  // namespace

std::vector<Check> constraint_threads_checks() {
  return {{"constraint.threads", 87,
           "A projection has the same bits without threads, with threads, and whichever range comes first.", constraint_kind,
           same_with_threads}};
}

}  // namespace cleave::testkit
