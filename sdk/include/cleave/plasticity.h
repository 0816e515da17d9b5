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

#ifdef __cplusplus
}
#endif
#endif
