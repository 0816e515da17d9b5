/* Kind "cleave.damage/1": what drives damage. The host owns the damage field d in [0,1] and integrates, for every law,
 *
 *   eta dd/dt = < (1 - d) D - (d - l^2 lap d) >
 *
 * from the driving force D >= 0 that the law supplies. Stress is degraded by g(d) = (1-r)(1-d)^2 + r.
 *
 * Inputs   TENSILE_ENERGY_IN, EFFECTIVE_STRESS_IN as declared by capability (from the elastic law, undegraded); F or B;
 *          FIBER, SECOND_FIBER as declared; DAMAGE; TOUGHNESS; STATE.
 * Outputs  DRIVING_FORCE and STATE_OUT; or, for laws with CLEAVE_DAMAGE_IS_LOCAL, DAMAGE_OUT and STATE_OUT.
 *          D never decreases for a point once reached if the law keeps a history. */
#ifndef CLEAVE_DAMAGE_H
#define CLEAVE_DAMAGE_H

#include "abi.h"

#ifdef __cplusplus
extern "C" {
#endif

#define CLEAVE_KIND_DAMAGE "cleave.damage/1"

enum cleave_integration { CLEAVE_INTEGRATION_IMPLICIT = 0, CLEAVE_INTEGRATION_EXPLICIT = 1 };

typedef struct cleave_damage_model {
  uint32_t struct_size;
  uint32_t integration; /* enum cleave_integration: what the scene (or the law's default) asks for */
  double viscosity;     /* eta [s] */
  double length;        /* l [m]; 0 for a local law */
  double residual;      /* r in [0,1) */
} cleave_damage_model;

typedef struct cleave_damage {
  uint32_t struct_size;
  uint32_t reserved;
  /* [any-thread] writes *model, whose struct_size the caller has set. */
  void (*model)(const cleave_instance*, cleave_damage_model* model);
  /* [any-thread] no allocation, lock, I/O or thread. Null if the precision is not offered. */
  cleave_result (*drive_f32)(const cleave_instance*, const cleave_batch*);
  cleave_result (*drive_f64)(const cleave_instance*, const cleave_batch*);
} cleave_damage;

#ifdef __cplusplus
}
#endif
#endif
