/* Kind "cleave.plasticity/1": a return mapping. It takes the elastic trial state of a step back onto the yield surface.
 *
 * Inputs   B or F (trial), STATE if the law has state variables.
 * Outputs  B_OUT or F_OUT (same measure as the input), STATE_OUT, and YIELDED where the layout has it.
 *          A trial inside the yield surface leaves all of them bitwise equal to the input.
 * Stress is the undegraded ("effective") one of cleave_context.isochoric.
 * Outputs may share memory with the inputs they replace. */
#ifndef CLEAVE_PLASTICITY_H
#define CLEAVE_PLASTICITY_H

#include "abi.h"

#ifdef __cplusplus
extern "C" {
#endif

#define CLEAVE_KIND_PLASTICITY "cleave.plasticity/1"

typedef struct cleave_plasticity {
  uint32_t struct_size;
  uint32_t reserved;
  /* [any-thread] no allocation, lock, I/O or thread. Null if the precision is not offered. */
  cleave_result (*return_map_f32)(const cleave_instance*, const cleave_batch*);
  cleave_result (*return_map_f64)(const cleave_instance*, const cleave_batch*);
} cleave_plasticity;

/* Extension "cleave.return-guarantees/1": what the return of an instance guarantees, where its parameters decide. Without the
 * extension every return is consistent, and keeps the volume if the schema says CLEAVE_FLOW_IS_ISOCHORIC. */
#define CLEAVE_EXTENSION_RETURN_GUARANTEES "cleave.return-guarantees/1"

enum cleave_return_guarantee {
  /* Returned states lie on the yield surface and the return dissipates, also at large elastic strain. */
  CLEAVE_RETURN_IS_CONSISTENT = 1 << 0,
  CLEAVE_RETURN_KEEPS_VOLUME = 1 << 1 /* det b */
};

typedef struct cleave_return_guarantees {
  uint32_t struct_size;
  uint32_t reserved;
  /* Union of enum cleave_return_guarantee. [any-thread] */
  uint64_t (*of)(const cleave_instance*);
} cleave_return_guarantees;

#ifdef __cplusplus
}
#endif
#endif
