/* The binary boundary between Cleave and a plugin. Plain C: no exception, RTTI, allocator or C++ type crosses it.
 *
 * Read this header like a contract. Each function carries
 *   [thread]    [main-thread]  called by one thread at a time, never during a batch call on the same instance
 *               [any-thread]   called concurrently, also on the same instance
 *   [ownership] who owns each pointer and how long it lives
 *   [errors]    what is returned and what the host does with it.
 *
 * Growth. Every struct begins with struct_size, set by its writer to sizeof as the writer knows it. Members are only ever
 * appended; a reader looks at a member only if struct_size covers it (CLEAVE_HAS). Within one major version nothing is
 * removed or reordered, so a plugin built against an older minor version loads in every newer host of the same major.
 * Enumerators and capability bits are only ever appended; unknown ones are ignored.
 */
#ifndef CLEAVE_ABI_H
#define CLEAVE_ABI_H

#include <stddef.h>
#include <stdint.h>

#ifdef __cplusplus
extern "C" {
#endif

#define CLEAVE_ABI_MAJOR 1u
#define CLEAVE_ABI_MINOR 1u

#if defined(_WIN32)
#define CLEAVE_EXPORT __declspec(dllexport)
#else
#define CLEAVE_EXPORT __attribute__((visibility("default")))
#endif

/* True if the struct behind `p` was written by someone who knew `member`. */
#define CLEAVE_HAS(type, p, member) ((p)->struct_size >= (uint32_t)(offsetof(type, member) + sizeof(((const type*)0)->member)))

/* ---------------------------------------------------------------- results and errors */

/* Result of a call as a whole. */
typedef int32_t cleave_result;
enum {
  CLEAVE_OK = 0,
  CLEAVE_ERROR_ABI = 1,         /* the two sides share no version; from cleave_plugin_entry only */
  CLEAVE_ERROR_PARAMETER = 2,   /* a parameter is refused; message.subject names it */
  CLEAVE_ERROR_UNSUPPORTED = 3, /* a combination this plugin does not offer; message.text says which */
  CLEAVE_ERROR_INTERNAL = 4     /* the plugin cannot go on; the host stops the run and names the plugin */
};

/* Status of one material point after a batch call. The host keeps the worst status seen for a point in a step. */
typedef uint8_t cleave_status;
enum {
  CLEAVE_STATUS_OK = 0,
  CLEAVE_STATUS_UNRELIABLE = 1, /* outputs are finite but outside the law's validity (say, far beyond its data) */
  CLEAVE_STATUS_RETRY = 2,      /* no valid result for this step size; a smaller one may have one */
  CLEAVE_STATUS_FATAL = 3       /* no valid result (say J <= 0 in a law undefined there); outputs of this point are
                                   unspecified and must not be used. The host stops and names the point */
};

/* Where a plugin writes words. [ownership] the caller owns the struct and both buffers; text is cut, never overrun. */
typedef struct cleave_message {
  uint32_t struct_size;
  uint32_t text_capacity;    /* bytes, including the terminating zero */
  char* text;                /* what went wrong and what would be right; UTF-8 */
  uint32_t subject_capacity; /* bytes, including the terminating zero */
  uint32_t reserved;
  char* subject; /* key of the parameter (or state variable) it is about; empty if none */
} cleave_message;

/* ---------------------------------------------------------------- threads */

/* Threads that the host lends; where a call is handed none, or null, the plugin works alone (since 1.1).
 * [ownership] host; valid during the call that it is handed to. */
typedef struct cleave_threads {
  uint32_t struct_size;
  uint32_t count; /* that there are, at least 1 */
  void* user;
  /* Calls work(data, k * grain, min((k + 1) * grain, size)) once for each k, by any of the threads and in any order, and
   * returns when all have returned. The ranges do not depend on the number of threads. Not to be called from work.
   * [main-thread] */
  void (*for_ranges)(void* user, uint64_t size, uint64_t grain, void (*work)(void* data, uint64_t first, uint64_t last),
                     void* data);
} cleave_threads;

/* ---------------------------------------------------------------- who is there */

typedef struct cleave_version {
  uint32_t major, minor;
} cleave_version;

/* What the host says of itself. [ownership] host; lives as long as the plugin stays loaded. */
typedef struct cleave_host {
  uint32_t struct_size;
  cleave_version abi;  /* newest version the host speaks; it also speaks every older minor of this major */
  const char* name;    /* "cleave" */
  const char* version; /* of the host, "1.0.0" */
} cleave_host;

/* What a plugin says of itself. [ownership] static data of the plugin. All strings UTF-8, none null. */
typedef struct cleave_about {
  uint32_t struct_size;
  const char* id;      /* "kind/name": lower case letters, digits and '-', stable for ever */
  const char* version; /* of the plugin, "major.minor.patch" */
  const char* author;
  const char* summary; /* one line */
  const char* source;  /* paper and equation the formulas are from */
  double budget_ns;    /* of laws called with batches: what the stress, the return or the driving force of a point may cost in
                          double precision on a current processor [ns]; 0: nothing is said. For conformance checks alone */
} cleave_about;

/* ---------------------------------------------------------------- parameters */

enum cleave_type {
  CLEAVE_TYPE_NUMBER = 0,  /* one finite double */
  CLEAVE_TYPE_INTEGER = 1, /* one int64 */
  CLEAVE_TYPE_BOOLEAN = 2,
  CLEAVE_TYPE_TEXT = 3,       /* one of `choices` if there are any */
  CLEAVE_TYPE_NUMBER_LIST = 4 /* min_count..max_count finite doubles (a 3x3 matrix is nine, row-major) */
};

/* One parameter a scene may set. [ownership] static data of the plugin. Strings UTF-8, never null unless said. */
typedef struct cleave_parameter_schema {
  uint32_t struct_size;
  uint32_t type;            /* enum cleave_type */
  const char* key;          /* lower_case_with_underscores */
  const char* unit;         /* SI: "Pa", "m", "s", "kg/m^3", "degrees", "1" if dimensionless, "" for text and booleans */
  const char* description;  /* one line */
  uint32_t required;        /* nonzero: the scene must give it. Zero: default_* applies */
  uint32_t in_set;          /* nonzero: belongs to an alternative set (see cleave_schema.alternatives) */
  double default_number;    /* NUMBER; INTEGER and BOOLEAN as a number */
  const char* default_text; /* TEXT; null otherwise */
  const double* default_list;
  uint32_t default_count;
  uint32_t min_count, max_count;
  /* Validity: outside, the formulas mean nothing and the host refuses the scene. Bounds apply to every element. */
  double minimum, maximum;
  uint32_t minimum_open, maximum_open; /* nonzero: the bound itself is refused */
  /* Physical: what materials are known to have, inside the validity bounds; outside, the host warns. */
  double physical_minimum, physical_maximum;
  const char* const* choices; /* TEXT: choice_count strings, or null for free text */
  uint32_t choice_count;
  uint32_t reserved;
  /* Capabilities (enum cleave_capability) the law has only where element k of this parameter is not zero; a NUMBER has one
   * element, other types none. So a law can read fibres for some parameters and do without them for others. */
  uint64_t needs[2];
} cleave_parameter_schema;

/* A value handed to create(). [ownership] host; valid during create() only. */
typedef struct cleave_parameter {
  uint32_t struct_size;
  uint32_t type;
  const char* key;
  uint32_t given; /* nonzero if the scene gave it, zero if it is the default */
  uint32_t count; /* LIST: number of elements */
  double number;  /* NUMBER; BOOLEAN as 0 or 1 */
  int64_t integer;
  const char* text;
  const double* list;
} cleave_parameter;

/* All parameters of the schema, in the order of the schema, checked by the host against type and bounds.
 * Members of alternative sets that were not given are present with given == 0 and must be ignored. */
typedef struct cleave_parameters {
  uint32_t struct_size;
  uint32_t count;
  const cleave_parameter* values;
} cleave_parameters;

/* ---------------------------------------------------------------- state variables */

enum cleave_tensor { /* number of components */
                     CLEAVE_SCALAR = 1,
                     CLEAVE_VECTOR = 3,    /* x y z */
                     CLEAVE_SYMMETRIC = 6, /* xx yy zz xy xz yz */
                     CLEAVE_MATRIX = 9     /* row-major */
};

enum cleave_monotonicity { CLEAVE_FREE = 0, CLEAVE_NEVER_DECREASES = 1, CLEAVE_NEVER_INCREASES = 2 };

/* One state variable the host stores per point. [ownership] static data of the plugin. */
typedef struct cleave_state_schema {
  uint32_t struct_size;
  uint32_t tensor; /* enum cleave_tensor */
  const char* name;
  const char* unit;
  const char* description;
  uint32_t monotonicity;
  uint32_t reserved;
  double initial[9]; /* unless the plugin offers initial_state() */
} cleave_state_schema;

/* ---------------------------------------------------------------- capabilities */

enum cleave_capability {
  /* strain measure: a law that sets ACCEPTS_B works on b = F F^T alone, and the host may store b in place of F */
  CLEAVE_ACCEPTS_B = 1 << 0,
  CLEAVE_ACCEPTS_F = 1 << 1,
  CLEAVE_ISOTROPIC = 1 << 2,
  CLEAVE_INVERSION_SAFE = 1 << 3,     /* finite, restoring stress for J <= 0 */
  CLEAVE_NEEDS_FIBER = 1 << 4,        /* reads FIBER */
  CLEAVE_NEEDS_SECOND_FIBER = 1 << 5, /* reads FIBER and SECOND_FIBER */
  /* what an elasticity law can compute beyond stress */
  CLEAVE_HAS_ENERGY = 1 << 6,
  CLEAVE_HAS_TANGENT = 1 << 7,
  CLEAVE_HAS_WAVE_MODULUS = 1 << 8,
  CLEAVE_HAS_EFFECTIVE_STRESS = 1 << 9,
  /* what other laws need from the elastic law of the same material */
  CLEAVE_NEEDS_ISOCHORIC_RESPONSE = 1 << 10, /* extension "cleave.isochoric-response/1" */
  CLEAVE_NEEDS_TENSILE_ENERGY = 1 << 11,
  CLEAVE_NEEDS_EFFECTIVE_STRESS = 1 << 12,
  CLEAVE_FLOW_IS_ISOCHORIC = 1 << 13,      /* plasticity: the return keeps det b */
  CLEAVE_DAMAGE_IS_LOCAL = 1 << 14,        /* damage: writes the new damage itself, no gradient term */
  CLEAVE_SINGLE = 1 << 15,                 /* offers f32 batches */
  CLEAVE_DOUBLE = 1 << 16,                 /* offers f64 batches */
  CLEAVE_HAS_ISOCHORIC_RESPONSE = 1 << 17, /* elasticity: offers extension "cleave.isochoric-response/1" */
  CLEAVE_HAS_PIOLA = 1 << 18,              /* elasticity: computes PIOLA from F (since 1.1) */
  CLEAVE_NEEDS_ELASTICITY = 1 << 19,       /* discretization: evaluates the elastic law of its material (since 1.1) */
  CLEAVE_NEEDS_TETRAHEDRA = 1 << 20        /* discretization: bodies must have tetrahedra (since 1.1) */
};

/* Keys of which one whole set has to be given: each entry of `sets` is a space-separated list of keys, for example
 * "youngs_modulus poissons_ratio" and "shear_modulus bulk_modulus". Keys of two different sets must not be mixed
 * unless one set lists them together. If optional is nonzero, giving none is allowed. */
typedef struct cleave_alternatives {
  uint32_t struct_size;
  uint32_t set_count;
  const char* const* sets;
  uint32_t optional;
  uint32_t reserved;
} cleave_alternatives;

/* [ownership] static data of the plugin. Arrays of structs are arrays of pointers, so that elements may grow. */
typedef struct cleave_schema {
  uint32_t struct_size;
  uint32_t parameter_count;
  const cleave_parameter_schema* const* parameters;
  uint32_t state_count;
  uint32_t alternatives_count;
  const cleave_state_schema* const* states;
  const cleave_alternatives* const* alternatives;
  uint64_t capabilities; /* union of enum cleave_capability */
} cleave_schema;

/* ---------------------------------------------------------------- batches of material points */

/* Points are stored in tiles. A tile holds CLEAVE_TILE_BYTES of every component: 16 points in single precision, 8 in double;
 * component by component, so that one component of one tile is one aligned cache line:
 *
 *   stream s:  | tile 0: component A x16 | component B x16 | ... | tile 1: component A x16 | ...
 *              |<------------ stride[s] bytes ------------------>|
 *
 * A component is found by a stream and a byte offset inside a tile; value k of component c in a batch is at
 *   (char*)streams[c.stream] + (k / lanes) * stride[c.stream] + c.offset + (k % lanes) * sizeof(real).
 * Everything in bytes is the same for f32 and f64. A stride of 0 repeats one tile (constants).
 *
 * The memory of the last tile is whole even if count does not fill it: the lanes beyond count may be read and computed
 * (they hold finite values), and written. Everything else outside the components of the layout must not be touched. */
#define CLEAVE_TILE_BYTES 64u
#define CLEAVE_MAX_STREAMS 4u
#define CLEAVE_MAX_STATE 16u

/* Fields: what a component means. Inputs are read, outputs are written; a field absent from the layout has count 0.
 * b, tau, sigma are symmetric: xx yy zz xy xz yz. F, P are row-major. Always three-dimensional; a 2D scene is plane strain.
 * An output may occupy the memory of the input it replaces (F_OUT over F): read all inputs of a lane before writing. */
enum cleave_field_id {
  CLEAVE_FIELD_B = 0,                /* 6 in   left Cauchy-Green tensor b = F F^T of the elastic part                [1] */
  CLEAVE_FIELD_F = 1,                /* 9 in   deformation gradient of the elastic part                              [1] */
  CLEAVE_FIELD_DEGRADATION = 2,      /* 1 in   g in [0,1]; absent: 1                                                 [1] */
  CLEAVE_FIELD_FIBER = 3,            /* 3 in   first fibre direction, reference frame, unit                          [1] */
  CLEAVE_FIELD_SECOND_FIBER = 4,     /* 3 in   second one, orthogonal to the first, unit                             [1] */
  CLEAVE_FIELD_TAU = 5,              /* 6 out  Kirchhoff stress, degraded by g                                       [Pa] */
  CLEAVE_FIELD_ENERGY = 6,           /* 1 out  psi = g psi_plus + psi_minus + psi_fiber, per reference volume        [J/m^3] */
  CLEAVE_FIELD_TENSILE_ENERGY = 7,   /* 1 out  psi_plus, not degraded                                                [J/m^3] */
  CLEAVE_FIELD_EFFECTIVE_STRESS = 8, /* 6 out Cauchy stress of the isotropic part, not degraded                    [Pa] */
  CLEAVE_FIELD_WAVE_MODULUS = 9,     /* 1 out  upper bound of rho_0 c^2, c the fastest wave through the current
                                               configuration, degraded by g as far as the law can tell             [Pa] */
  CLEAVE_FIELD_DELTA_F = 10,         /* 9 in   direction dF                                                          [1] */
  CLEAVE_FIELD_DELTA_P = 11,         /* 9 out  first Piola-Kirchhoff stress: directional derivative along dF         [Pa] */
  CLEAVE_FIELD_B_OUT = 12,           /* 6 out  b after the return                                                    [1] */
  CLEAVE_FIELD_F_OUT = 13,           /* 9 out  F after the return                                                    [1] */
  CLEAVE_FIELD_STATE = 14,           /* n in   state variables in the order of the schema, at the start of the step */
  CLEAVE_FIELD_STATE_OUT = 15,       /* n out  at its end */
  CLEAVE_FIELD_YIELDED = 16,         /* 1 out  1 where the return moved the point, else 0                            [1] */
  CLEAVE_FIELD_DAMAGE = 17,          /* 1 in   d in [0,1]                                                            [1] */
  CLEAVE_FIELD_DAMAGE_OUT = 18,      /* 1 out  only of laws with CLEAVE_DAMAGE_IS_LOCAL                              [1] */
  CLEAVE_FIELD_DRIVING_FORCE = 19,   /* 1 out  D >= 0 of the damage evolution                                        [1] */
  CLEAVE_FIELD_TENSILE_ENERGY_IN = 20,   /* 1 in  psi_plus as the elastic law gave it                              [J/m^3] */
  CLEAVE_FIELD_EFFECTIVE_STRESS_IN = 21, /* 6 in  effective stress as the elastic law gave it                      [Pa] */
  CLEAVE_FIELD_TOUGHNESS = 22,           /* 1 in   factor on the toughness of this point; absent: 1                      [1] */
  CLEAVE_FIELD_PIOLA = 23, /* 9 out  first Piola-Kirchhoff stress P(F), degraded by g; reads F (since 1.1)              [Pa] */
  CLEAVE_FIELD_COUNT = 24
};

typedef struct cleave_component {
  uint32_t stream;
  uint32_t offset; /* bytes inside a tile, a multiple of CLEAVE_TILE_BYTES */
} cleave_component;

typedef struct cleave_field {
  uint16_t first, count; /* components[first .. first+count); count 0: absent */
} cleave_field;

/* Where everything lives. Built once per material and purpose; a call only brings new stream pointers.
 * [ownership] host; unchanged during a call. field_count is the writer's CLEAVE_FIELD_COUNT: fields beyond are absent. */
typedef struct cleave_layout {
  uint32_t struct_size;
  uint32_t field_count;
  uint32_t stride[CLEAVE_MAX_STREAMS];
  const cleave_field* fields;
  const cleave_component* components;
} cleave_layout;

/* One call. A law computes exactly the output fields present in the layout (it declared that it can), all points
 * [0, count), any count including 0.
 * [ownership] host owns everything; pointers are valid during the call. Streams are 64-byte aligned.
 * [errors] per point: status[k] for k < count, preset to OK by the host, to be raised where needed. A point that is not OK
 * must not disturb its neighbours. As a whole: a result other than OK stops the run and message is shown. */
typedef struct cleave_batch {
  uint32_t struct_size;
  uint32_t count;
  const cleave_layout* layout;
  void* streams[CLEAVE_MAX_STREAMS];
  double time_step; /* s; 0 when no time passes */
  cleave_status* status;
  cleave_message* message; /* may be null */
} cleave_batch;

/* ---------------------------------------------------------------- instances */

/* A law with its parameters, as one material of one scene uses it. Opaque; immutable after create(). */
typedef struct cleave_instance cleave_instance;

struct cleave_isochoric_response;

/* The isotropic part of a material's elastic law, not degraded, for other laws to derive their parameters from.
 * [ownership] host; valid during create() only. */
typedef struct cleave_elastic_probe {
  uint32_t struct_size;
  uint32_t reserved;
  double shear_modulus, bulk_modulus; /* at rest [Pa] */
  /* psi_plus [J/m^3] at F (row-major, det F > 0); NaN if the law offers no energy or is undefined there. [main-thread] */
  double (*tensile_energy)(const struct cleave_elastic_probe*, const double* F);
} cleave_elastic_probe;

/* What a law may know of its surroundings. [ownership] host; valid during create() only. */
typedef struct cleave_context {
  uint32_t struct_size;
  uint32_t dimension;                                /* 2 (plane strain) or 3 */
  double cell_size;                                  /* m; 0 where there is no grid */
  double density;                                    /* kg/m^3 at rest; 0 where none is known */
  const struct cleave_isochoric_response* isochoric; /* of the elastic law; null if it offers none */
  const cleave_elastic_probe* elastic;               /* the elastic law of the material; null for an elastic law itself */
} cleave_context;

/* What the plugin offers. [ownership] static data of the plugin, lives as long as the library is loaded. */
typedef struct cleave_plugin {
  uint32_t struct_size;
  cleave_version abi; /* what the plugin will speak in this process; at most the host's */
  const cleave_about* about;
  const cleave_schema* schema;

  /* Table of the given kind, for example "cleave.elasticity/1" -> const cleave_elasticity*; null if it is not of that
   * kind or version. [any-thread] */
  const void* (*kind)(const char* kind_id);

  /* Table of an optional extension, "cleave.name/version" or "org.name/version"; null if unknown. [any-thread] */
  const void* (*extension)(const char* extension_id);

  /* A new instance, or CLEAVE_ERROR_* with a message that names the parameter. Never null with CLEAVE_OK. [main-thread] */
  cleave_result (*create)(const cleave_parameters*, const cleave_context*, cleave_instance** instance, cleave_message*);

  /* [main-thread] null is allowed and does nothing. */
  void (*destroy)(cleave_instance*);

  /* Initial values of all state components, in the order of the schema, as this instance wants them. Null if
   * schema->states[i]->initial says it all. [any-thread] */
  void (*initial_state)(const cleave_instance*, double* values);
} cleave_plugin;

/* The one exported symbol. The host says what it speaks; the plugin answers with a table both understand, or refuses with
 * CLEAVE_ERROR_ABI. It looks at nothing but host->struct_size and host->abi before it has decided. No work is done here.
 * [main-thread] */
typedef cleave_result (*cleave_plugin_entry_fn)(const cleave_host* host, const cleave_plugin** plugin);
#define CLEAVE_ENTRY_SYMBOL "cleave_plugin_entry"

#ifdef __cplusplus
}
#endif
#endif
