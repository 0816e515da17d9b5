#pragma once

namespace cleave::testkit {

/// While one lives, calls of functions that allocate, lock, do input or output or start threads, made by the plugin or by
/// libraries it uses, call `found` with the function's name in their place. `found` must not return. For one thread.
class CallWatch {
 public:
  explicit CallWatch(void (*found)(const char* function));
  ~CallWatch();
  CallWatch(const CallWatch&) = delete;
  CallWatch& operator=(const CallWatch&) = delete;
};

}  // namespace cleave::testkit
