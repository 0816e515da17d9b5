/* Kind "cleave.discretization/1": a whole way of stepping bodies, in place of the host's material point method.
 *
 * The host builds the bodies of the scene (points, and tetrahedra where the body has them), and then drives steps, frames,
 * colliders, handles and checkpoints as it does for its own particles. All numbers are double.
 *
 * Capabilities (since 1.1): CLEAVE_NEEDS_ELASTICITY, the material's elastic law is evaluated through cleave_body::elasticity,
 * and a material without one is refused; without it a material has no elastic law. CLEAVE_NEEDS_TETRAHEDRA, bodies without
 * tetrahedra are refused. */
#ifndef CLEAVE_DISCRETIZATION_H
#define CLEAVE_DISCRETIZATION_H

#include "abi.h"

#ifdef __cplusplus
extern "C" {
#endif

#define CLEAVE_KIND_DISCRETIZATION "cleave.discretization/1"

/* The elastic law of a body's material, for a discretization that computes strains (CLEAVE_NEEDS_ELASTICITY). `first` is the
 * number of the body's first point in the call: what the law has per point (fibres) is looked up there. Arrays have 9 numbers
 * per point, row-major. Results are the same bits whichever way points are split into calls.
 * [ownership] host; valid until the instance is destroyed (since 1.1). */
typedef struct cleave_elastic_response {
  uint32_t struct_size;
  uint32_t reserved;
  void* user;
  /* psi [J/m^3] and P(F) [Pa], either of which may be null; energy is NaN where the law offers none. Fails where the law is
   * not defined, with a message that names the point. [any-thread] */
  cleave_result (*evaluate)(void* user, uint64_t first, uint64_t count, const double* F, double* energy, double* P,
                            cleave_message*);
  /* dP [Pa], the change of P(F) with dF. [any-thread] */
  cleave_result (*differential)(void* user, uint64_t first, uint64_t count, const double* F, const double* dF, double* dP,
                                cleave_message*);
  /* M [Pa], a bound of the stiffness that waves see: they travel at most sqrt(M/density) m/s in rest coordinates.
   * [any-thread] */
  cleave_result (*wave_modulus)(void* user, uint64_t first, uint64_t count, const double* F, double* modulus, cleave_message*);
} cleave_elastic_response;

/* One body as the scene describes it. [ownership] host; valid during add_body(). */
typedef struct cleave_body {
  uint32_t struct_size;
  uint32_t dimension;
  const char* name;
  double density; /* kg/m^3 */
  double spacing; /* mean distance of points, m */
  uint64_t point_count;
  const double* position; /* m, 3 per point */
  const double* velocity; /* m/s, 3 per point */
  const double* volume;   /* m^3, 1 per point */
  uint64_t vertex_count;  /* 0 if the body has no mesh */
  const double* vertices; /* m, 3 per vertex */
  uint64_t tetrahedron_count;
  const uint32_t* tetrahedra; /* 4 vertices each; the points are then the barycentres, in this order */
  /* since 1.1 */
  const double* vertex_velocity;             /* m/s, 3 per vertex */
  const cleave_threads* threads;             /* that add_body() may use; null: none */
  const cleave_elastic_response* elasticity; /* of the body's material; null if that has no elastic law */
} cleave_body;

/* What a handle may hold of a body. */
enum cleave_entity { CLEAVE_POINT = 0, CLEAVE_VERTEX = 1 };

/* How the plugin asks the host about the surroundings during step(). [ownership] host; valid during step(). */
typedef struct cleave_surroundings {
  uint32_t struct_size;
  uint32_t reserved;
  double gravity[3]; /* m/s^2 */
  void* user;
  /* Replaces the velocities (3 per point) of `count` points at `position` by what the colliders of the scene, where they
   * are at the end of the step, allow. [any-thread] */
  void (*collide)(void* user, uint64_t count, const double* position, double* velocity);
  /* Position (m, 3) and velocity (m/s, 3) at the end of the step of a point or vertex of a body (enum cleave_entity) that a
   * handle moves; returns 0 and writes nothing if it is free. [any-thread] */
  int32_t (*handle)(void* user, uint64_t body, uint32_t entity, uint64_t index, double* position, double* velocity);
  const cleave_threads* threads; /* that step() may use; null: none (since 1.1) */
} cleave_surroundings;

/* A quantity of the body's points that the plugin exposes, for output and measurement. The host knows these names:
 *   "position" [m, 3], "velocity" [m/s, 3]   always there
 *   "damage" [1]                             d in [0,1]
 *   "energy" [J/m^3]                         elastic energy per reference volume
 *   "F" [1, 9]                               deformation gradient, row-major
 * Others are written to frames as they are. [ownership] plugin; valid until the next step(), restore() or destroy(). */
typedef struct cleave_point_field {
  uint32_t struct_size;
  uint32_t components; /* 1, 3 or 9 */
  const char* name;    /* lower_case_with_underscores, but for "F" */
  const char* unit;
  const double* values;
} cleave_point_field;

/* What a body looks like from outside, and inside where it consists of tetrahedra. Vertices are shared by what hangs together:
 * where it has come apart they are there twice. Triangles close and look outwards; with tetrahedra they are faces of one alone.
 * [ownership] plugin; valid until the next step(), restore() or destroy(). */
typedef struct cleave_surface {
  uint32_t struct_size;
  uint32_t reserved;
  uint64_t vertex_count;
  const double* vertices; /* m, 3 per vertex */
  uint64_t triangle_count;
  const uint32_t* triangles;
  /* since 1.1; null or 0 if not given */
  const double* velocity;     /* m/s, 3 per vertex */
  const double* damage;       /* d in [0,1], 1 per vertex */
  const uint32_t* piece;      /* 1 per vertex: pieces of the body, numbered from 0; none are connected */
  uint64_t tetrahedron_count; /* those the body has, in its order */
  const uint32_t* tetrahedra; /* 4 of these vertices each */
} cleave_surface;

typedef struct cleave_discretization {
  uint32_t struct_size;
  uint32_t reserved;
  /* Takes over a body; numbered from 0 in call order. [main-thread] */
  cleave_result (*add_body)(cleave_instance*, const cleave_body*, cleave_message*);
  /* Largest step that is stable from the present state, s. [main-thread] */
  double (*stable_step)(const cleave_instance*);
  /* Advances all bodies. Uses no threads but those that the surroundings offer. [main-thread] */
  cleave_result (*step)(cleave_instance*, double time_step, const cleave_surroundings*, cleave_message*);
  /* Fields of a body: returns their number and, for index < number, fills *field. [main-thread] */
  uint32_t (*point_field)(const cleave_instance*, uint64_t body, uint32_t index, cleave_point_field* field);
  /* Surface of a body for output, topology may change; CLEAVE_ERROR_UNSUPPORTED if it has none. [main-thread] */
  cleave_result (*surface)(cleave_instance*, uint64_t body, cleave_surface* surface);
  /* Complete state as bytes: with buffer null returns the size, else writes `size` bytes and returns what it wrote.
   * restore() brings back a bitwise equal state. [main-thread] */
  uint64_t (*save)(const cleave_instance*, void* buffer, uint64_t size);
  cleave_result (*restore)(cleave_instance*, const void* buffer, uint64_t size, cleave_message*);
} cleave_discretization;

#ifdef __cplusplus
}
#endif
#endif
