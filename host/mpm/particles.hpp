#pragma once

#include "checkpoint/state.hpp"
#include "common/types.hpp"
#include "mpm/block_coordinate.hpp"
#include "mpm/buffer.hpp"
#include "mpm/kernels/kernels.hpp"

#include <array>
#include <functional>
#include <string>
#include <vector>

namespace cleave::mpm {

/// What is stored per particle of a material, and where inside a tile. Only what the material's laws declared is there.
struct TileLayout {
  struct Part {
    std::string name;
    int components;
  };
  std::uint32_t position, velocity, affine, volume, strain;
  std::uint32_t fiber = 0, second_fiber = 0, damage = 0, toughness = 0, state = 0;  ///< 0: not stored (there is the position)
  bool stores_b = false;
  int state_components = 0;
  std::uint32_t stride = 0;
  std::vector<Part> parts;

  struct Needs {
    int dimension = 3;
    bool stores_b = false;
    int fibers = 0, state_components = 0;
    bool damage = false, toughness = false;
  };
  explicit TileLayout(const Needs&);
};

/// Initial values of one particle.
struct NewParticle {
  std::uint32_t id = 0;
  Vector3 position = Vector3::Zero();  ///< in cells
  Vector3 velocity = Vector3::Zero();
  Matrix3 velocity_gradient = Matrix3::Zero();  ///< 1/s
  double volume = 0;                            ///< in cells
  Matrix3 deformation = Matrix3::Identity();
  double damage = 0;
  double toughness = 1;  ///< factor on the toughness of the damage law
};

/// Particles that a source holds in its own way: read one at a time, by several threads at once.
struct NewParticles {
  std::size_t count = 0;
  std::function<Vector3(std::size_t)> position;  ///< in cells
  /// The rest of one, and its stored state variables and fibers in the order of the layout.
  std::function<NewParticle(std::size_t, double* state, double* fibers)> read;
};

/// The particles of one material, in tiles, sorted by home block and by cell inside the block.
/// Block and cell belong to the first node of a particle's stencil: floor(x - 1/2).
template <class T, int D>
class Particles {
 public:
  static constexpr int lanes = tile_lanes<T>;
  static constexpr int edge = GridShape<D>::block_edge;
  struct Block : BlockView {
    BlockCoordinate coordinate;
  };

  explicit Particles(TileLayout layout) : layout_(std::move(layout)) {}

  /// Takes over particles. Beyond what they are stored in this needs 8 bytes of each.
  void assign(const NewParticles&);
  /// The same from arrays; `state` and `fibers` hold the stored components of each particle in turn.
  void assign(const std::vector<NewParticle>&, const std::vector<double>& state, const std::vector<double>& fibers);

  /// Moves every particle to the block it is in. Blocks come in Morton order; the result does not depend on threads.
  /// Throws SimulationError if a particle is farther from the origin than blocks can be numbered; nothing has moved then.
  void sort();

  /// Everything as it is stored, but for which grid blocks are next to each block. `prefix` of the names of sections.
  void save(checkpoint::StateWriter&, const std::string& prefix) const;
  /// Ids have to be below `ids`, the number of particles that of before. Throws InputError, and then is not to be used.
  void restore(checkpoint::StateReader&, const std::string& prefix, std::uint64_t ids);

  const TileLayout& layout() const { return layout_; }
  std::vector<Block>& blocks() { return blocks_; }
  const std::vector<Block>& blocks() const { return blocks_; }
  /// Indices of blocks by colour: the parity of their coordinates.
  const std::array<std::vector<std::uint32_t>, 8>& colours() const { return colours_; }
  std::size_t size() const { return size_; }
  std::size_t tiles() const { return tiles_; }
  char* data() const { return storage_.data(); }
  /// Where the kernels find what is stored, without laws.
  ParticleView view() const {
    ParticleView v;
    v.tiles = storage_.data();
    v.stride = layout_.stride;
    v.position = layout_.position;
    v.velocity = layout_.velocity;
    v.affine = layout_.affine;
    v.volume = layout_.volume;
    v.strain = layout_.strain;
    v.stores_b = layout_.stores_b;
    v.damage = layout_.damage;
    return v;
  }
  std::uint32_t id(std::uint64_t slot) const { return ids()[slot]; }

  T& value(std::uint32_t offset, std::uint64_t slot) const {
    return *(reinterpret_cast<T*>(storage_.data() + (slot / lanes) * layout_.stride + offset) + slot % lanes);
  }
  T& value(std::uint32_t offset, int component, std::uint64_t slot) const {
    return value(offset + component * CLEAVE_TILE_BYTES, slot);
  }
  /// Position in cells from the grid's origin.
  Vector3 position(const Block& b, std::uint64_t slot) const {
    Vector3 x = Vector3::Zero();
    for (int a = 0; a < D; a++) x[a] = double(b.coordinate[a]) * edge + double(value(layout_.position, a, slot));
    return x;
  }
  const Block* block_of(std::uint64_t slot) const;
  Matrix3 deformation_or_b(std::uint64_t slot) const;  ///< full matrix of the stored strain measure
  double jacobian(std::uint64_t slot) const;           ///< det F of the stored (elastic) strain

  /// Calls f(block, slot) for every particle, in storage order.
  template <class F>
  void for_each(F&& f) const {
    for (const auto& b : blocks_)
      for (std::uint32_t i = 0; i < b.count; i++) f(b, b.first_tile * lanes + i);
  }

 private:
  void place(std::size_t tiles);
  void colour();
  void permute();
  void clear_tails();
  std::uint32_t* ids() const { return reinterpret_cast<std::uint32_t*>(ids_.data()); }

  TileLayout layout_;
  Buffer storage_, ids_;
  Buffer from_, scratch_;  // of sort(): the slot each particle comes from; what is on its way
  std::vector<Block> blocks_;
  std::array<std::vector<std::uint32_t>, 8> colours_;
  std::size_t size_ = 0, tiles_ = 0;
};

}  // namespace cleave::mpm
