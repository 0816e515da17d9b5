#pragma once

#include <cleave/abi.h>

#include <cstddef>
#include <cstdint>

/// The inner loops of a step, compiled once per instruction set into their own shared objects and picked at start-up.
/// Only plain data crosses: everything here is layout, no behaviour.
///
/// Units inside the kernels. Positions are in cells relative to their home block's first node, so that precision does not
/// depend on where in space a body is. Grid mass and momentum are in units of the reference mass rho_ref dx^d, so that no scene
/// is too light for single precision. Velocities are in m/s, stress in Pa.
namespace cleave::mpm {

/// Grid blocks are 4x4x4 nodes (8x8 in two dimensions); a node is four numbers: mass, then momentum or velocity, padded.
/// Particles may stray one cell from their home block before they must be sorted again, hence the arena's slack.
template <int D>
struct GridShape {
  static constexpr int block_edge = D == 3 ? 4 : 8;
  static constexpr int block_nodes = 64;
  static constexpr int arena_edge = block_edge + 4;
  static constexpr int arena_nodes = D == 3 ? 512 : 144;
  static constexpr int neighbours = D == 3 ? 27 : 9;
};

template <class T>
inline constexpr int tile_lanes = int(CLEAVE_TILE_BYTES / sizeof(T));

/// Points per plugin call: small enough that everything a chunk touches stays in the first-level cache.
inline constexpr int chunk_points = 32;

using LawFunction = cleave_result (*)(const cleave_instance*, const cleave_batch*);

/// Rows of the kernel's scratch per tile: the six components of stress (or the inputs of a damage law), one for writes that
/// nobody reads (components that are constant in two dimensions) or the driving force, and the degradation g.
inline constexpr int stress_rows = 8;
inline constexpr int discarded_row = 6;
inline constexpr int driving_force_row = 6;
inline constexpr int degradation_row = 7;

/// Driving forces of damage that are taken as none, and damage that is if it is all that would come of a lasting cause: a
/// thousandth of what single precision resolves of an energy.
inline constexpr double negligible_damage = 1e-6;
/// tr b = |F|^2 up to which broken points are stretched: ten times their length.
inline constexpr double largest_broken_stretch = 100;

/// Points with so much damage do not bound explicit steps: whatever the step, they end between here and 1.
inline constexpr double saturated_damage = 0.99;

/// A law bound to a material's storage. Stream 0 is the particle tiles, stream 1 the kernel's scratch (see stress_rows),
/// stream 2 one tile of constants: a row of zeros, then a row of ones.
struct BoundLaw {
  const cleave_instance* instance = nullptr;
  LawFunction function = nullptr;
  const cleave_layout* layout = nullptr;
};

/// The particles of one material. Offsets in bytes inside a tile; components of a quantity follow each other.
struct ParticleView {
  char* tiles = nullptr;
  std::uint32_t stride = 0;
  std::uint32_t position = 0;  ///< D, cells from the home block's first node
  std::uint32_t velocity = 0;  ///< D, m/s
  std::uint32_t affine = 0;    ///< D*D velocity gradient C, row-major, 1/s
  std::uint32_t volume = 0;    ///< 1, rest volume in cells
  std::uint32_t strain = 0;    ///< b: xx yy zz xy xz yz (2D: xx yy zz xy); F: row-major (2D: 00 01 10 11 22)
  bool stores_b = false;
  bool detect_inversion = false;  ///< a step that turns a neighbourhood inside out is an error for this material
  double relative_density = 1;    ///< rho / rho_ref
  BoundLaw elasticity, plasticity;
  BoundLaw degraded_elasticity;  ///< of blocks with damage: reads g from the scratch
  std::uint32_t damage = 0;      ///< 1, d; only where the material has a damage law
  double residual = 0;           ///< r of g = (1-r)(1-d)^2 + r
  void* constants = nullptr;     ///< stream 2
};

struct BlockView {
  std::uint64_t first_tile = 0;
  std::uint32_t count = 0;
  std::uint32_t neighbours[27];  ///< grid blocks at offsets (-1,-1,-1) .. (1,1,1), last axis fastest
  bool damaged = false;          ///< some particle has d > 0
};

enum class TransferScheme : std::uint32_t { apic, pic, flip };

struct StepView {
  double start = 0;        ///< s
  double time_step = 0;    ///< s
  double cell_size = 0;    ///< m
  double force_scale = 0;  ///< 4 dt / (dx rho_ref): stress times rest volume in cells to momentum per cell of offset
  TransferScheme scheme = TransferScheme::apic;
  double flip_ratio = 0;
  bool stress = true;                 ///< false: scatter mass and momentum alone (FLIP's reference velocity, implicit steps)
  void* grid = nullptr;               ///< block_nodes * 4 numbers per block
  const void* grid_before = nullptr;  ///< FLIP: velocities before forces
  double least_volume_ratio = 0;      ///< volume after the step over that before it, up to which a neighbourhood is turned
};

enum class LawKind : std::uint8_t { elasticity, plasticity, damage };

/// What a kernel noticed while working on blocks. Merged with max/or: independent of order.
struct BlockReport {
  double maximum_speed = 0;  ///< largest component of velocity, m/s
  bool strayed = false;      ///< a particle left its home block's slack: sort before the next step
  std::uint8_t status = 0;   ///< worst cleave_status
  cleave_result result = CLEAVE_OK;
  LawKind failed = LawKind::elasticity;
  bool not_finite = false;     ///< a velocity or position is no number
  bool inverted = false;       ///< a neighbourhood was pressed to least_volume_ratio or beyond
  std::uint64_t slot = ~0ull;  ///< smallest particle slot (tile * lanes + lane) with a problem
};

/// The same kernels for each precision and dimension.
template <template <class T, int D> class Kernels>
struct KernelTable {
  Kernels<float, 2> single_2d;
  Kernels<float, 3> single_3d;
  Kernels<double, 2> double_2d;
  Kernels<double, 3> double_3d;
};

template <class T, int D>
struct TransferKernels {
  std::size_t scratch_bytes = 0;  ///< per thread, 64-byte aligned, zero before first use
  /// Adds the block's particles to the grid. Blocks of the same colour may run at once.
  void (*particle_to_grid)(const ParticleView&, const BlockView&, const StepView&, void* scratch, BlockReport&) = nullptr;
  /// Momentum to velocity, plus gravity * dt; blocks [first, last) of the grid.
  void (*grid_update)(T* grid, std::uint64_t first, std::uint64_t last, const T* velocity_change) = nullptr;
  /// Grid velocity to the block's particles: position, velocity, affine, strain, return mapping.
  void (*grid_to_particle)(const ParticleView&, const BlockView&, const StepView&, void* scratch, BlockReport&) = nullptr;
};

/// Evolution of damage on the particles of one material (see DamageEvolution for the equations). Positions and lengths are in
/// cells, volumes in cells. Per-slot arrays are indexed like the particles; node arrays have block_nodes numbers per block.
struct DamageView {
  BoundLaw inputs;                ///< elastic law: psi_plus or the effective stress into the scratch
  BoundLaw law;                   ///< damage law: driving force into the scratch, or the new damage in place
  bool local = false;             ///< the law writes the damage itself
  double time_step = 0;           ///< s
  void* driving_force = nullptr;  ///< D per slot
  void* volume = nullptr;         ///< current volume per slot
};

struct DamageReport {
  double largest_driving_force = 0;  ///< where d < saturated_damage
  bool active = false;               ///< some particle has D > 0 or d > 0
  bool damaged = false;              ///< some particle has d > 0
};

template <class T, int D>
struct DamageKernels {
  std::size_t scratch_bytes = 0;  ///< per thread, 64-byte aligned, zero before first use
  /// Calls the laws: D and the current volume of each particle, history in place.
  void (*drive)(const ParticleView&, const BlockView&, const DamageView&, void* scratch, BlockReport&, DamageReport&) = nullptr;
  /// nodes (four numbers each) += V (1, d, D, 0) w
  void (*collect)(const ParticleView&, const BlockView&, const DamageView&, T* nodes, void* scratch) = nullptr;
  /// to += K from, K_ij = sum_p V_p grad_i(x_p) . grad_j(x_p) with the MLS gradient 4 w (x_i - x_p)
  void (*stiffness)(const ParticleView&, const BlockView&, const DamageView&, const T* from, T* to, void* scratch) = nullptr;
  /// d <- clamp(max(d, d + sum w change)), but 0 stays 0 up to `negligible`
  void (*advance)(const ParticleView&, const BlockView&, const T* change, double negligible, void* scratch,
                  DamageReport&) = nullptr;
  /// d <- min(1, d + rate <(1 - d) D - (d - length^2 lap d)>), lap d = sum w laplacian; 0 stays 0 up to rate negligible_damage
  void (*integrate)(const ParticleView&, const BlockView&, const DamageView&, const T* laplacian, double rate, double length,
                    void* scratch, DamageReport&) = nullptr;
  /// The same two on cubic B-splines around the cell centres: nodes += V (1, d, 0, 0) w, and lap d = sum d_i lap w.
  /// Particles must be sorted into their blocks.
  void (*collect_cubic)(const ParticleView&, const BlockView&, const DamageView&, T* nodes, void* scratch) = nullptr;
  void (*integrate_cubic)(const ParticleView&, const BlockView&, const DamageView&, const T* damage, double rate, double length,
                          void* scratch, DamageReport&) = nullptr;
};

/// Of the same shared object.
KernelTable<DamageKernels> damage_kernels();

/// Rows of F at the end of a step, per tile: 3D all of it row-major, 2D 00 01 10 11 22.
template <int D>
inline constexpr int deformation_rows = D == 3 ? 9 : 5;
/// Components of the spatial tangent a_iakb, symmetric under ia <-> kb: the upper triangle by rows.
template <int D>
inline constexpr int tangent_numbers = D == 3 ? 45 : 10;
/// Numbers of a node's diagonal block: its upper triangle by rows, padded.
inline constexpr int diagonal_numbers = 8;

/// Rows of the implicit kernels' scratch per tile: P, dP or tau; dF (or A, for laws without P); b, for laws that take nothing
/// else; energy; degradation; one for writes that nobody reads.
inline constexpr int implicit_delta_row = 9;
inline constexpr int implicit_b_row = 18;
inline constexpr int implicit_energy_row = 24;
inline constexpr int implicit_degradation_row = 25;
inline constexpr int implicit_discarded_row = 26;
inline constexpr int implicit_rows = 27;

/// The elastic law of one material in a step of backward Euler. Streams 0 to 2 as for other laws, stream 3 is `deformation`.
struct ImplicitView {
  BoundLaw response;      ///< P or tau, and the energy if there is one, of F at the end of the step
  BoundLaw differential;  ///< dP along dF there
  bool piola = true;      ///< the response gives P, else tau
  bool takes_b = false;   ///< the response is one of b
  bool energy = true;
  bool degraded = false;        ///< both read g
  double time_step = 0;         ///< s
  double cell_size = 0;         ///< m
  double force_scale = 0;       ///< as of StepView
  double energy_scale = 0;      ///< 1/rho_ref: energies are in J per rho_ref dx^d
  char* deformation = nullptr;  ///< F at the end of the step, deformation_rows per tile
};

/// Steps of backward Euler; see implicit_kernels.cpp for the equations. Nodes are four numbers as on the grid; what comes out
/// of `potential` and `product` is added to, with the mass first. Blocks of the same colour may run at once.
template <class T, int D>
struct ImplicitKernels {
  std::size_t scratch_bytes = 0;  ///< per thread, 64-byte aligned, zero before first use
  /// Energy of the block's particles and its gradient by the node velocities; leaves F at these velocities in the view.
  void (*potential)(const ParticleView&, const BlockView&, const ImplicitView&, const T* velocity, T* gradient, void* scratch,
                    BlockReport&, double& energy) = nullptr;
  /// The Hessian at the F of the view times a direction.
  void (*product)(const ParticleView&, const BlockView&, const ImplicitView&, const T* direction, T* out,
                  void* scratch) = nullptr;
  /// Adds the diagonal blocks of the Hessian to the nodes (diagonal_numbers each), and the sum of its tangents over the
  /// particles of each half-edge octant of a grid block to octants[(block * 2^D + octant) * tangent_numbers], if not null.
  void (*tangent)(const ParticleView&, const BlockView&, const ImplicitView&, T* diagonal, T* octants, void* scratch) = nullptr;
};

/// Of the same shared object.
KernelTable<ImplicitKernels> implicit_kernels();

struct KernelSet {
  const char* isa = nullptr;
  KernelTable<TransferKernels> transfer;
  KernelTable<DamageKernels> damage;
  KernelTable<ImplicitKernels> implicit;
};

/// The kernels of one precision and dimension.
template <class T, int D, template <class, int> class Kernels>
const Kernels<T, D>& kernels_of(const KernelTable<Kernels>& set) {
  if constexpr (sizeof(T) == sizeof(float)) {
    if constexpr (D == 2)
      return set.single_2d;
    else
      return set.single_3d;
  } else {
    if constexpr (D == 2)
      return set.double_2d;
    else
      return set.double_3d;
  }
}

/// The symbol each kernel library exports.
#define CLEAVE_KERNELS_SYMBOL "cleave_kernels"
using KernelsEntry = const KernelSet* (*)();

/// Kernels for the best instruction set of this processor, or the one CLEAVE_ISA names. Throws InputError.
const KernelSet& load_kernels();

}  // namespace cleave::mpm
