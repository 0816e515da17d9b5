#include "call_watch.hpp"

#include <elf.h>
#include <link.h>
#include <sys/mman.h>
#include <unistd.h>

#include <cstdint>
#include <cstring>
#include <string>
#include <utility>
#include <vector>

// Calls between libraries go through tables of addresses (the global offset table), which the dynamic loader has filled when
// the library was opened. The watch puts its own functions into them.

namespace cleave::testkit {
namespace {

constexpr const char* watched[] = {
    // the allocator; in C++ operator new and delete, plain, for arrays, sized and aligned
    "malloc", "calloc", "realloc", "free", "posix_memalign", "aligned_alloc", "strdup", "_Znwm", "_Znam",
    "_ZnwmSt11align_val_t", "_ZnamSt11align_val_t", "_ZnwmRKSt9nothrow_t", "_ZnamRKSt9nothrow_t", "_ZdlPv", "_ZdaPv", "_ZdlPvm",
    "_ZdaPvm", "_ZdlPvSt11align_val_t", "_ZdlPvmSt11align_val_t", "mmap", "munmap",
    // locks and threads
    "pthread_mutex_lock", "pthread_mutex_trylock", "pthread_rwlock_rdlock", "pthread_rwlock_wrlock", "pthread_spin_lock",
    "pthread_cond_wait", "pthread_once", "mtx_lock", "sem_wait", "__cxa_guard_acquire", "pthread_create", "thrd_create", "fork",
    "sleep", "usleep", "nanosleep", "clock_nanosleep",
    // input and output
    "open", "open64", "openat", "fopen", "fopen64", "read", "write", "fread", "fwrite", "fputs", "fputc", "puts", "putchar",
    "printf", "fprintf", "vprintf", "vfprintf", "__printf_chk", "__fprintf_chk", "fflush", "system"};
constexpr int watched_count = sizeof watched / sizeof watched[0];

void (*report)(const char*) = nullptr;

template <int k>
void trap() {
  report(watched[k]);
}
template <int... k>
std::vector<void (*)()> traps(std::integer_sequence<int, k...>) {
  return {&trap<k>...};
}

/// An entry of such a table, and what it does not hold at present: the watch's function or the original.
struct Slot {
  void** address;
  void* other;
};
std::vector<Slot> slots;

struct Tables {
  const ElfW(Sym) * symbols;
  const char* names;
};

ElfW(Addr) absolute(ElfW(Addr) base, ElfW(Addr) address) { return address < base ? base + address : address; }

void put(void** slot, void* function) {
  const auto page = std::uintptr_t(sysconf(_SC_PAGESIZE));
  // A slot may lie in a segment that became read-only after loading.
  mprotect(reinterpret_cast<void*>(reinterpret_cast<std::uintptr_t>(slot) / page * page), page, PROT_READ | PROT_WRITE);
  *slot = function;
}

void watch(const dl_phdr_info& library, const std::vector<void (*)()>& functions) {
  const ElfW(Dyn)* dynamic = nullptr;
  for (int i = 0; i < library.dlpi_phnum; ++i)
    if (library.dlpi_phdr[i].p_type == PT_DYNAMIC)
      dynamic = reinterpret_cast<const ElfW(Dyn)*>(library.dlpi_addr + library.dlpi_phdr[i].p_vaddr);
  if (!dynamic) return;
  Tables tables{};
  ElfW(Addr) relocations[2] = {};
  std::size_t sizes[2] = {};
  for (; dynamic->d_tag != DT_NULL; ++dynamic) {
    const ElfW(Addr) address = absolute(library.dlpi_addr, dynamic->d_un.d_ptr);
    switch (dynamic->d_tag) {
      case DT_SYMTAB:
        tables.symbols = reinterpret_cast<const ElfW(Sym)*>(address);
        break;
      case DT_STRTAB:
        tables.names = reinterpret_cast<const char*>(address);
        break;
      case DT_JMPREL:
        relocations[0] = address;
        break;
      case DT_PLTRELSZ:
        sizes[0] = dynamic->d_un.d_val;
        break;
      case DT_RELA:
        relocations[1] = address;
        break;
      case DT_RELASZ:
        sizes[1] = dynamic->d_un.d_val;
        break;
      default:
        break;
    }
  }
  if (!tables.symbols || !tables.names) return;
  for (int part : {0, 1}) {
    const auto* relocation = reinterpret_cast<const ElfW(Rela)*>(relocations[part]);
    for (std::size_t i = 0; relocation && i < sizes[part] / sizeof *relocation; ++i) {
#if defined(__x86_64__)
      const auto type = ELF64_R_TYPE(relocation[i].r_info);
      if (type != R_X86_64_JUMP_SLOT && type != R_X86_64_GLOB_DAT) continue;
#elif defined(__aarch64__)
      const auto type = ELF64_R_TYPE(relocation[i].r_info);
      if (type != R_AARCH64_JUMP_SLOT && type != R_AARCH64_GLOB_DAT) continue;
#endif
      const char* name = tables.names + tables.symbols[ELF64_R_SYM(relocation[i].r_info)].st_name;
      for (int k = 0; k < watched_count; ++k)
        if (std::strcmp(name, watched[k]) == 0) {
          auto** slot = reinterpret_cast<void**>(library.dlpi_addr + relocation[i].r_offset);
          slots.push_back({slot, reinterpret_cast<void*>(functions[std::size_t(k)])});
        }
    }
  }
}

}  // namespace

CallWatch::CallWatch(void (*found)(const char* function)) {
  report = found;
  static std::vector<void (*)()> functions;
  functions = traps(std::make_integer_sequence<int, watched_count>());
  slots.clear();
  dl_iterate_phdr(
      [](dl_phdr_info* library, std::size_t, void*) {
        const std::string name = library->dlpi_name ? library->dlpi_name : "";
        // Not the program itself, nor the C library and the loader, whose own calls are no plugin's.
        if (!name.empty() && name.find("/libc.") == std::string::npos && name.find("/ld-") == std::string::npos &&
            name.find("vdso") == std::string::npos && name.find("san.so") == std::string::npos)
          watch(*library, functions);
        return 0;
      },
      nullptr);
  // Nothing may allocate from here on.
  for (auto& [slot, other] : slots) {
    void* original = *slot;
    put(slot, other);
    other = original;
  }
}

CallWatch::~CallWatch() {
  for (const auto& [slot, original] : slots) put(slot, original);
}

}  // namespace cleave::testkit
