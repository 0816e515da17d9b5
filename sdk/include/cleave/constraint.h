/* Kind "cleave.constraint/1": a projection of the grid velocities, after forces and before they return to the particles.
 *
 * The plugin gets the system as it stands and changes `velocity` so that its constraint holds:
 *
 *   minimise  1/2 (v - v*)^T M (v - v*)   subject to   B v = c      and the prescribed nodes
 *
 * All numbers are double, whatever the scene's precision. */
#ifndef CLEAVE_CONSTRAINT_H
#define CLEAVE_CONSTRAINT_H

#include "abi.h"

#ifdef __cplusplus
extern "C" {
#endif

#define CLEAVE_KIND_CONSTRAINT "cleave.constraint/1"

/* [ownership] host; valid during the call. Node arrays have node_count rows, particle arrays particle_count rows. The nodes are
 * those that a particle of these reaches, whatever else they carry. */
typedef struct cleave_constraint_system {
  uint32_t struct_size;
  uint32_t dimension; /* d = 2 or 3 */
  double cell_size;   /* m */
  double time_step;   /* s */
  uint64_t node_count;
  const double* mass;              /* kg, > 0 */
  double* velocity;                /* m/s, d per node: in v*, out the projected velocity */
  const int32_t* node_cell;        /* integer coordinates, d per node; position = cell_size * coordinate */
  const uint8_t* prescribed;       /* 0 free; 1 velocity fixed; 2 fixed along `normal` */
  const double* normal;            /* d per node, unit where prescribed is 2; null if no node has it */
  uint64_t particle_count;         /* particles of materials that use this constraint */
  const double* position;          /* in cells, d per particle */
  const double* volume;            /* current volume, m^3 */
  const double* deformation;       /* F, 9 per particle, row-major */
  const double* fiber;             /* reference direction, 3 per particle; null if not declared */
  const double* velocity_gradient; /* d x d per particle, row-major [1/s]: of the grid at the end of the step before */
  const uint64_t* nodes;           /* 3^d node rows per particle, last axis fastest, the quadratic stencil */
  /* since 1.1 */
  const double* damage;          /* in [0, 1], per particle; null if the material has no damage */
  const cleave_threads* threads; /* that project() may use; null: none (since 1.1) */
} cleave_constraint_system;

/* [ownership] caller; written by the plugin. */
typedef struct cleave_constraint_report {
  uint32_t struct_size;
  uint32_t iterations;
  double residual; /* |B v - c| relative to |B v* - c| */
  uint64_t rows;   /* of B */
} cleave_constraint_report;

typedef struct cleave_constraint {
  uint32_t struct_size;
  uint32_t reserved;
  /* May allocate; is called once per step and pass of damage, and again where another constraint has changed velocities of its
   * nodes. With CLEAVE_OK a message is something the user should know; the host says it once. [main-thread] */
  cleave_result (*project)(cleave_instance*, const cleave_constraint_system*, cleave_constraint_report*, cleave_message*);
  /* What the instance keeps from call to call, for checkpoints (since 1.1). save: with buffer null returns the size, else
   * writes `size` bytes and returns what it wrote. restore brings another instance with the same parameters, or this one, to
   * where the next calls of project() give the same bits; what save did not write is refused, with a message. Both may be null:
   * the host then cannot promise these bits. [main-thread] */
  uint64_t (*save)(const cleave_instance*, void* buffer, uint64_t size);
  cleave_result (*restore)(cleave_instance*, const void* buffer, uint64_t size, cleave_message*);
} cleave_constraint;

#ifdef __cplusplus
}
#endif
#endif
