/* Kind "cleave.elasticity/1": stress and energy of a hyperelastic law at a material point.
 *
 *   psi = g psi_plus + psi_minus + psi_fiber         energy per reference volume [J/m^3]
 *   P   = d psi / d F                                first Piola-Kirchhoff stress [Pa]
 *   tau = P F^T                                      Kirchhoff stress [Pa]
 *
 * Inputs   B (laws with CLEAVE_ACCEPTS_B) or F (CLEAVE_ACCEPTS_F); the host gives one of them. DEGRADATION if the material
 *          can be damaged. FIBER, SECOND_FIBER if needed. Where PIOLA or DELTA_P is asked for, the host gives F, also to laws
 *          that work on b; with DELTA_P, DELTA_F too.
 * Outputs  TAU, ENERGY, TENSILE_ENERGY, EFFECTIVE_STRESS, WAVE_MODULUS, DELTA_P, PIOLA (since 1.1): those present in the
 *          layout. TAU is always offered; the rest as declared by capability.
 *          With CLEAVE_HAS_PIOLA and CLEAVE_INVERSION_SAFE, PIOLA and DELTA_P are finite at every finite F; where P has no
 *          derivative, DELTA_P is a finite number that need not mean anything.
 * Status   FATAL where the law is undefined (J <= 0 without CLEAVE_INVERSION_SAFE). */
#ifndef CLEAVE_ELASTICITY_H
#define CLEAVE_ELASTICITY_H

#include "abi.h"

#ifdef __cplusplus
extern "C" {
#endif

#define CLEAVE_KIND_ELASTICITY "cleave.elasticity/1"

typedef struct cleave_elasticity {
  uint32_t struct_size;
  uint32_t reserved;
  /* [any-thread] no allocation, lock, I/O or thread. Null if the precision is not offered. */
  cleave_result (*evaluate_f32)(const cleave_instance*, const cleave_batch*);
  cleave_result (*evaluate_f64)(const cleave_instance*, const cleave_batch*);
} cleave_elasticity;

/* Extension "cleave.isochoric-response/1": what a return mapping has to know of an isotropic elastic law whose stress
 * splits into tau = mu_d J^(-2/3) dev(b) - p(J) I: the deviatoric modulus, the pressure and its inverse. A law whose
 * deviatoric stress is not of that form gives the response that is used for yielding, and documents it. */
#define CLEAVE_EXTENSION_ISOCHORIC_RESPONSE "cleave.isochoric-response/1"

enum cleave_pressure_law {
  CLEAVE_PRESSURE_QUADRATIC = 0,  /* p = -kappa/2 (J^2 - 1),   J = sqrt(1 - 2 p/kappa) */
  CLEAVE_PRESSURE_LINEAR = 1,     /* p = -kappa J (J - 1) */
  CLEAVE_PRESSURE_LOGARITHMIC = 2 /* p = -kappa ln J,          J = exp(-p/kappa) */
};

typedef struct cleave_isochoric_response {
  uint32_t struct_size;
  uint32_t pressure_law;     /* enum cleave_pressure_law */
  double deviatoric_modulus; /* mu_d [Pa] */
  double bulk_modulus;       /* kappa [Pa] */
} cleave_isochoric_response;

typedef struct cleave_isochoric_response_extension {
  uint32_t struct_size;
  uint32_t reserved;
  /* [any-thread] writes *response, whose struct_size the caller has set. */
  void (*response)(const cleave_instance*, cleave_isochoric_response* response);
} cleave_isochoric_response_extension;

#ifdef __cplusplus
}
#endif
#endif
