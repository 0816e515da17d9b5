/* A plugin written against the C header alone, whole except for the one DEFECT it is built with (defects.def).
 *
 *   psi = k/4 (tr b - 3 - 2 ln J),   tau = g k/2 (b - I)          elasticity
 *   a return that moves nothing and counts in its second state variable    plasticity, for defects of states */
#define _GNU_SOURCE
#include <cleave/elasticity.h>
#include <cleave/plasticity.h>

#include <math.h>
#include <pthread.h>
#include <sched.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <unistd.h>

#define DEFECT(name, what, checks) name,
enum defect {
#include "defects.def"
};
#undef DEFECT
#define IS(name) (BROKEN == name)
#define HAS_STATE (IS(writes_more_state) || IS(leaves_state_unwritten))

struct cleave_instance {
  double stiffness;
};
static double last_stiffness;
static unsigned calls;
static void* volatile memory;
static volatile double number;

#if BROKEN == 1
extern void nobody_defines_this(void);
#endif

/* ------------------------------------------------------------------ batches */

static const cleave_component* field(const cleave_batch* batch, int id) {
  const cleave_layout* layout = batch->layout;
  if ((uint32_t)id >= layout->field_count) return NULL;
  return layout->fields[id].count ? layout->components + layout->fields[id].first : NULL;
}

static void* address(const cleave_batch* batch, const cleave_component* c, uint32_t point, size_t size) {
  const uint32_t lanes = (uint32_t)(CLEAVE_TILE_BYTES / size);
  return (char*)batch->streams[c->stream] + (size_t)(point / lanes) * batch->layout->stride[c->stream] + c->offset +
         point % lanes * size;
}
static double get(const cleave_batch* batch, const cleave_component* c, uint32_t point, size_t size) {
  const void* at = address(batch, c, point, size);
  return size == 4 ? (double)*(const float*)at : *(const double*)at;
}
static void set(const cleave_batch* batch, const cleave_component* c, uint32_t point, size_t size, double value) {
  void* at = address(batch, c, point, size);
  if (size == 4)
    *(float*)at = (float)value;
  else
    *(double*)at = value;
}

static void* nothing(void* unused) { return unused; }
static pthread_mutex_t mutex = PTHREAD_MUTEX_INITIALIZER;
static double scratch[7];

static cleave_result evaluate(const cleave_instance* instance, const cleave_batch* batch, size_t size) {
  const double k = IS(shared_parameters) ? last_stiffness : instance->stiffness;
  const cleave_component *F = field(batch, CLEAVE_FIELD_F), *g = field(batch, CLEAVE_FIELD_DEGRADATION),
                         *tau = field(batch, CLEAVE_FIELD_TAU), *energy = field(batch, CLEAVE_FIELD_ENERGY),
                         *tension = field(batch, CLEAVE_FIELD_TENSILE_ENERGY);
  double drift = IS(counts_calls) ? 1e-9 * ++calls : 0;
  if (IS(allocates)) memory = malloc(batch->count + 1), free(memory);
  if (IS(locks)) pthread_mutex_lock(&mutex), pthread_mutex_unlock(&mutex);
  if (IS(prints)) fputs("evaluating\n", stderr);
  if (IS(exits) && batch->count == 100) exit(0);
  if (IS(rare_crash) && batch->count == 13) abort();
  if (IS(starts_thread)) {
    pthread_t thread;
    pthread_create(&thread, NULL, nothing, NULL);
    pthread_join(thread, NULL);
  }
  if (IS(fails_on_nothing) && batch->count == 0 && tau) number = get(batch, tau, 0, size);
  if (IS(depends_on_neighbours))
    for (uint32_t p = 0; p < batch->count; ++p) drift += 1e-6 * get(batch, F, p, size) / batch->count;
  if (IS(reads_all_fields) && batch->layout->fields[CLEAVE_FIELD_TOUGHNESS].count) drift = 1;
  int flagged = 0;
  for (uint32_t p = 0; p < batch->count; ++p) {
    double A[9], b[6];
    static const int rows[6][2] = {{0, 0}, {1, 1}, {2, 2}, {0, 1}, {0, 2}, {1, 2}};
    for (int i = 0; i < 9; ++i) {
      if (IS(assumes_adjacent)) {
        const cleave_component next = {F->stream, F->offset + (uint32_t)i * CLEAVE_TILE_BYTES};
        A[i] = get(batch, &next, p, size);
      } else {
        A[i] = get(batch, F + i, p, size);
      }
    }
    if (IS(writes_input)) set(batch, F, p, size, A[0]);
    const double J =
        A[0] * (A[4] * A[8] - A[5] * A[7]) - A[1] * (A[3] * A[8] - A[5] * A[6]) + A[2] * (A[3] * A[7] - A[4] * A[6]);
    for (int c = 0; c < 6; ++c) {
      b[c] = 0;
      for (int i = 0; i < 3; ++i) b[c] += A[3 * rows[c][0] + i] * A[3 * rows[c][1] + i];
    }
    const double degradation = g ? get(batch, g, p, size) : 1;
    double psi = k / 4 * (b[0] + b[1] + b[2] - 3 - 2 * log(J)), stress[6];
    for (int c = 0; c < 6; ++c) stress[c] = degradation * k / 2 * (b[c] - (c < 3)) + drift * k;
    if (IS(silent_not_a_number) && k > 1e7) stress[2] = NAN;
    if (IS(coarse_single) && size == 4)
      for (int c = 0; c < 6; ++c) stress[c] *= 1 + 0x1p-10;
    if (IS(static_scratch)) {
      memcpy(scratch, stress, sizeof stress);
      scratch[6] = psi;
      if (p % 16 == 0) sched_yield();
      memcpy(stress, scratch, sizeof stress);
      psi = scratch[6];
    }
    const int valid = J > 0 && isfinite(stress[0] + psi);
    if (!valid && !IS(no_status)) batch->status[p] = CLEAVE_STATUS_FATAL;
    flagged |= !valid;
    for (int c = 0; tau && c < 6; ++c) set(batch, tau + c, p, size, stress[c]);
    if (energy) set(batch, energy, p, size, degradation * psi);
    if (tension) set(batch, tension, p, size, psi);
    if (IS(writes_unrequested) && tau && !energy) {
      const uint32_t lanes = (uint32_t)(CLEAVE_TILE_BYTES / size);
      set(batch, tau, p + (batch->count + lanes - 1) / lanes * lanes, size, psi);
    }
  }
  if (IS(status_of_all) && flagged) memset(batch->status, CLEAVE_STATUS_FATAL, batch->count);
  return CLEAVE_OK;
}
static cleave_result evaluate_f32(const cleave_instance* i, const cleave_batch* b) { return evaluate(i, b, 4); }
static cleave_result evaluate_f64(const cleave_instance* i, const cleave_batch* b) { return evaluate(i, b, 8); }
static const cleave_elasticity elasticity = {sizeof elasticity, 0, evaluate_f32, evaluate_f64};

static cleave_result return_map(const cleave_instance* instance, const cleave_batch* batch, size_t size) {
  (void)instance;
  const cleave_component *F = field(batch, CLEAVE_FIELD_F), *out = field(batch, CLEAVE_FIELD_F_OUT),
                         *state = field(batch, CLEAVE_FIELD_STATE), *state_out = field(batch, CLEAVE_FIELD_STATE_OUT),
                         *yielded = field(batch, CLEAVE_FIELD_YIELDED);
  for (uint32_t p = 0; p < batch->count; ++p) {
    double sum = 0;
    for (int i = 0; i < 9; ++i) {
      const double value = get(batch, F + i, p, size);
      if (out) set(batch, out + i, p, size, value);
      sum += value;
    }
    double A[9];
    for (int i = 0; i < 9; ++i) A[i] = get(batch, F + i, p, size);
    const double J =
        A[0] * (A[4] * A[8] - A[5] * A[7]) - A[1] * (A[3] * A[8] - A[5] * A[6]) + A[2] * (A[3] * A[7] - A[4] * A[6]);
    if (!isfinite(sum) || !(J > 0)) batch->status[p] = CLEAVE_STATUS_FATAL;
    if (state_out) set(batch, state_out, p, size, get(batch, state, p, size));
    if (state_out && !(IS(leaves_state_unwritten) && sum > 0))
      set(batch, state_out + 1, p, size, get(batch, state + 1, p, size));
    if (yielded) set(batch, yielded, p, size, 0);
  }
  return CLEAVE_OK;
}
static cleave_result return_map_f32(const cleave_instance* i, const cleave_batch* b) { return return_map(i, b, 4); }
static cleave_result return_map_f64(const cleave_instance* i, const cleave_batch* b) { return return_map(i, b, 8); }
static const cleave_plasticity plasticity = {sizeof plasticity, 0, return_map_f32, return_map_f64};

/* ------------------------------------------------------------------ tables */

static const void* kind(const char* id) {
  const void* table = HAS_STATE ? (const void*)&plasticity : (const void*)&elasticity;
  if (IS(any_kind)) return table;
  return strcmp(id, HAS_STATE ? CLEAVE_KIND_PLASTICITY : CLEAVE_KIND_ELASTICITY) == 0 ? table : NULL;
}
static const void* extension(const char* id) {
  while (IS(hangs) && *id == 0) sched_yield();
  return IS(any_extension) ? &elasticity : NULL;
}

static cleave_result refuse(cleave_message* message, const char* subject, const char* text) {
  if (!message) return CLEAVE_ERROR_PARAMETER;
  if (IS(overruns_message)) {
    strcpy(message->subject, subject);
    strcpy(message->text, text);
    return CLEAVE_ERROR_PARAMETER;
  }
  if (!IS(assumes_whole_message) && !CLEAVE_HAS(cleave_message, message, subject)) return CLEAVE_ERROR_PARAMETER;
  if (message->text_capacity) snprintf(message->text, message->text_capacity, "%s", text);
  if (message->subject_capacity) snprintf(message->subject, message->subject_capacity, "%s", IS(names_nothing) ? "" : subject);
  return CLEAVE_ERROR_PARAMETER;
}

static cleave_result create(const cleave_parameters* parameters, const cleave_context* context, cleave_instance** instance,
                            cleave_message* message) {
  double stiffness = NAN;
  *instance = NULL;
  if (IS(reads_short_context) && ((const volatile cleave_context*)context)->elastic) stiffness = 0;
  for (uint32_t i = 0; i < parameters->count; ++i) {
    const char* first = (const char*)parameters->values;
    const cleave_parameter* p = (const cleave_parameter*)(first + (size_t)i * parameters->values->struct_size);
    if (strcmp(p->key, "stiffness") != 0) return refuse(message, p->key, "is not a parameter of this plugin");
    if (p->type != CLEAVE_TYPE_NUMBER) return refuse(message, p->key, "must be a number");
    stiffness = p->number;
  }
  if (parameters->count == 0) return refuse(message, "stiffness", "is missing");
  if (!IS(accepts_anything) && !(isfinite(stiffness) && stiffness > 0)) return refuse(message, "stiffness", "must be positive");
  *instance = malloc(sizeof **instance);
  (*instance)->stiffness = last_stiffness = stiffness;
  return CLEAVE_OK;
}
static void destroy(cleave_instance* instance) {
  if (!IS(leaks_instances)) free(instance);
}
static void initial_state(const cleave_instance* instance, double* values) {
  (void)instance;
  values[0] = 0.5;
  values[1] = 0;
  if (IS(writes_more_state)) values[2] = 1;
}

static const char* const about_id = HAS_STATE ? "plasticity/fixture" : "elasticity/fixture";
static cleave_about about = {sizeof about, NULL, "1.0.0", "somebody", "a law to be broken", "no paper", 0};
static const cleave_parameter_schema stiffness = {
    .struct_size = sizeof stiffness,
    .type = CLEAVE_TYPE_NUMBER,
    .key = "stiffness",
    .unit = IS(no_unit) ? "" : "Pa",
    .description = "k, how stiff",
    .required = !IS(default_out_of_bounds),
    .default_number = -1, /* counts where it is not required */
    .minimum = 0,
    .maximum = INFINITY,
    .minimum_open = 1,
    .physical_minimum = 1,
    .physical_maximum = 1e9,
};
static const cleave_parameter_schema* const parameters[] = {&stiffness};
static const cleave_state_schema states[2] = {
    {.struct_size = sizeof(cleave_state_schema), .tensor = 1, .name = "constant", .unit = "1", .description = "stays"},
    {.struct_size = sizeof(cleave_state_schema), .tensor = 1, .name = "count", .unit = "1", .description = "stays, too"}};
static const cleave_state_schema* const state_pointers[] = {&states[0], &states[1]};
static const cleave_schema schema = {
    .struct_size = sizeof schema,
    .parameter_count = 1,
    .parameters = parameters,
    .state_count = HAS_STATE ? 2 : 0,
    .states = state_pointers,
    .capabilities = CLEAVE_ACCEPTS_F | CLEAVE_SINGLE | CLEAVE_DOUBLE | (HAS_STATE ? 0 : CLEAVE_HAS_ENERGY)};

static cleave_plugin table = {sizeof table, {CLEAVE_ABI_MAJOR, 0},           &about, &schema, kind, extension, create,
                              destroy,      HAS_STATE ? initial_state : NULL};

#if BROKEN == 3
CLEAVE_EXPORT int another_symbol = 1;
#endif

__attribute__((constructor)) static void loaded(void) {
  /* Six times in a process: enough to be seen, and checks that load it often stay quick. The environment outlives unloading. */
  if (IS(slow_to_load)) {
    const char* before = getenv("FIXTURE_LOADS");
    const char loads[2] = {before ? (char)(*before + 1) : '1', 0};
    setenv("FIXTURE_LOADS", loads, 1);
    if (*loads <= '6') usleep(150000);
    if (*loads > '6') setenv("FIXTURE_LOADS", "6", 1);
  }
  if (IS(leaks_on_load)) memory = malloc(1000);
}

CLEAVE_EXPORT cleave_result cleave_plugin_entry(const cleave_host* host, const cleave_plugin** plugin);
CLEAVE_EXPORT cleave_result cleave_plugin_entry(const cleave_host* host, const cleave_plugin** plugin) {
#if BROKEN == 1
  nobody_defines_this();
#endif
  if (IS(crashes_in_entry)) abort();
  if (!CLEAVE_HAS(cleave_host, host, abi)) return CLEAVE_ERROR_ABI;
  if (IS(reads_host_name) && *(const volatile char*)host->name == 'x') return CLEAVE_ERROR_INTERNAL;
  if (!IS(any_major) && host->abi.major != CLEAVE_ABI_MAJOR) return CLEAVE_ERROR_ABI;
  if (IS(claims_newer_minor) && host->abi.minor > CLEAVE_ABI_MINOR) table.abi.minor = host->abi.minor + 1;
  about.id = about_id;
  /* The manifest is written by a program of another name than the hosts'. */
  if (IS(stale_manifest) && strcmp(host->name, "cleave") == 0) about.author = "somebody else";
  *plugin = &table;
  return CLEAVE_OK;
}
