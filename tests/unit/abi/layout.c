/* Compiled with the headers of 1.0 and with those of today. Both times the list is that of 1.0: what has gone since then does
 * not compile. */
#include <cleave/constraint.h>
#include <cleave/damage.h>
#include <cleave/discretization.h>
#include <cleave/elasticity.h>
#include <cleave/plasticity.h>

#include "layout.h"

#define MEMBER_OF(type, member) (((const type*)0)->member)
#define TYPE(expression)                                                                                              \
  _Generic((expression), uint8_t : 1, uint16_t : 2, uint32_t : 3, uint64_t : 4, int32_t : 5, int64_t : 6, double : 7, \
           default : 0)

#define STRUCT(type) {#type ".", 0, sizeof(type), 0},
#define MEMBER(type, member) \
  {#type "." #member, offsetof(type, member), sizeof(MEMBER_OF(type, member)), TYPE(MEMBER_OF(type, member))},
#define CONSTANT(name)
#define TEXT(name)
static const struct layout_entry entries[] = {
#include "declarations.h"
    {NULL, 0, 0, 0}};
#undef STRUCT
#undef MEMBER
#undef CONSTANT
#define STRUCT(type)
#define MEMBER(type, member)
#define CONSTANT(name) {#name, (int64_t)name},
static const struct layout_constant constants[] = {
#include "declarations.h"
    {NULL, 0}};
#undef CONSTANT
#undef TEXT
#define CONSTANT(name)
#define TEXT(name) {#name, name},
static const struct layout_text texts[] = {
#include "declarations.h"
    {NULL, NULL}};

const struct layout LAYOUT = {entries, constants, texts};
