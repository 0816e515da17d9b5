#pragma once

#include "mpm/buffer.hpp"
#include "mpm/particles.hpp"

#include <tbb/enumerable_thread_specific.h>
#include <tbb/parallel_for.h>

#include <cstdint>
#include <vector>

namespace cleave::mpm {

/// Memory that kernels work in, one piece for each thread.
using ThreadScratch = tbb::enumerable_thread_specific<Buffer>;

/// Calls work(block, scratch) for the particle blocks listed, in parallel.
template <class F>
void for_particle_blocks(const std::vector<std::uint32_t>& blocks, ThreadScratch& scratch, F&& work) {
  tbb::parallel_for(tbb::blocked_range<std::size_t>(0, blocks.size(), 4), [&](const auto& range) {
    void* memory = scratch.local().data();
    for (std::size_t i = range.begin(); i < range.end(); i++) work(blocks[i], memory);
  });
}

/// The same for all blocks, where work adds to the grid: blocks of one colour reach disjoint nodes, and colours follow each
/// other, so that sums have one order.
template <class T, int D, class F>
void for_coloured(const Particles<T, D>& particles, ThreadScratch& scratch, F&& work) {
  for (const auto& colour : particles.colours()) for_particle_blocks(colour, scratch, work);
}

}  // namespace cleave::mpm
