/* What the compiler makes of a set of headers. Tables end with a null name. */
#pragma once

#include <stddef.h>
#include <stdint.h>

#ifdef __cplusplus
extern "C" {
#endif

/* "struct.member", or "struct." for a struct as a whole. */
struct layout_entry {
  const char* name;
  size_t offset, size;
  int type; /* of a member: which of the ABI's number types it is; 0 for all others */
};
struct layout_constant {
  const char* name;
  int64_t value;
};
struct layout_text {
  const char *name, *value;
};
struct layout {
  const struct layout_entry* entries;
  const struct layout_constant* constants;
  const struct layout_text* texts;
};

extern const struct layout layout_of_1_0, layout_of_today;

#ifdef __cplusplus
}
#endif
