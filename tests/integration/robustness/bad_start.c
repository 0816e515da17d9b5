/* Does harm before or while it says what it is; BAD_START chooses how. */
#include <cleave/abi.h>

#include <signal.h>
#include <stdlib.h>
#include <unistd.h>

#if BAD_START < 3
__attribute__((constructor)) static void start(void) {
#if BAD_START == 0
  raise(SIGSEGV);
#elif BAD_START == 1
  for (;;) pause();
#else
  exit(0);
#endif
}
#endif

CLEAVE_EXPORT cleave_result cleave_plugin_entry(const cleave_host* host, const cleave_plugin** plugin);
CLEAVE_EXPORT cleave_result cleave_plugin_entry(const cleave_host* host, const cleave_plugin** plugin) {
  (void)host;
  (void)plugin;
#if BAD_START == 3
  abort();
#endif
  return CLEAVE_ERROR_ABI;
}
