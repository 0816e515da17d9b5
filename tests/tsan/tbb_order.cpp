#include <dlfcn.h>
#include <oneapi/tbb/detail/_small_object_pool.h>
#include <oneapi/tbb/detail/_task.h>
#include <sanitizer/tsan_interface.h>

// oneTBB is a library that is not instrumented: ThreadSanitizer does not see the atomics in it that order what one thread hands
// to another. These take the place of its entry points in programs that are, call them, and say what they order:
//   what came before spawn() comes before the task;
//   what came before the last reference to a wait context was given up comes before the end of the wait (the count itself is in
//   headers, and seen);
//   what came before memory of tasks was given back comes before it is used again.
namespace tbb::detail::r1 {
namespace {

template <class Function>
Function* next(const char* symbol) {
  return reinterpret_cast<Function*>(dlsym(RTLD_NEXT, symbol));
}

/// Stands for a task on its way to another thread.
class Handed final : public d1::task {
 public:
  explicit Handed(d1::task& inner) : inner_(&inner) { __tsan_release(this); }
  // TBB cancels a task that has thrown: it lives until one of both returns.
  d1::task* execute(d1::execution_data& data) override {
    __tsan_acquire(this);
    return done(inner_->execute(data));
  }
  d1::task* cancel(d1::execution_data& data) override {
    __tsan_acquire(this);
    return done(inner_->cancel(data));
  }

 private:
  d1::task* done(d1::task* following) {
    delete this;
    return following;
  }
  d1::task* inner_;
};

/// The count of references follows a word of flags.
void* count_of(d1::wait_context& context) { return reinterpret_cast<char*>(&context) + sizeof(std::uint64_t); }

}  // namespace

void spawn(d1::task& task, d1::task_group_context& context) {
  static const auto real =
      next<void(d1::task&, d1::task_group_context&)>("_ZN3tbb6detail2r15spawnERNS0_2d14taskERNS2_18task_group_contextE");
  real(*new Handed(task), context);
}

void spawn(d1::task& task, d1::task_group_context& context, d1::slot_id slot) {
  static const auto real = next<void(d1::task&, d1::task_group_context&, d1::slot_id)>(
      "_ZN3tbb6detail2r15spawnERNS0_2d14taskERNS2_18task_group_contextEt");
  real(*new Handed(task), context, slot);
}

void execute_and_wait(d1::task& task, d1::task_group_context& context, d1::wait_context& wait,
                      d1::task_group_context& waiting) {
  static const auto real = next<void(d1::task&, d1::task_group_context&, d1::wait_context&, d1::task_group_context&)>(
      "_ZN3tbb6detail2r116execute_and_waitERNS0_2d14taskERNS2_18task_group_contextERNS2_12wait_contextES6_");
  real(task, context, wait, waiting);
  __tsan_acquire(count_of(wait));
}

void wait(d1::wait_context& wait, d1::task_group_context& context) {
  static const auto real = next<void(d1::wait_context&, d1::task_group_context&)>(
      "_ZN3tbb6detail2r14waitERNS0_2d112wait_contextERNS2_18task_group_contextE");
  real(wait, context);
  __tsan_acquire(count_of(wait));
}

void* allocate(d1::small_object_pool*& pool, std::size_t bytes, const d1::execution_data& data) {
  static const auto real = next<void*(d1::small_object_pool*&, std::size_t, const d1::execution_data&)>(
      "_ZN3tbb6detail2r18allocateERPNS0_2d117small_object_poolEmRKNS2_14execution_dataE");
  void* memory = real(pool, bytes, data);
  __tsan_acquire(memory);
  return memory;
}

void* allocate(d1::small_object_pool*& pool, std::size_t bytes) {
  static const auto real =
      next<void*(d1::small_object_pool*&, std::size_t)>("_ZN3tbb6detail2r18allocateERPNS0_2d117small_object_poolEm");
  void* memory = real(pool, bytes);
  __tsan_acquire(memory);
  return memory;
}

void deallocate(d1::small_object_pool& pool, void* memory, std::size_t bytes, const d1::execution_data& data) {
  static const auto real = next<void(d1::small_object_pool&, void*, std::size_t, const d1::execution_data&)>(
      "_ZN3tbb6detail2r110deallocateERNS0_2d117small_object_poolEPvmRKNS2_14execution_dataE");
  __tsan_release(memory);
  real(pool, memory, bytes, data);
}

void deallocate(d1::small_object_pool& pool, void* memory, std::size_t bytes) {
  static const auto real =
      next<void(d1::small_object_pool&, void*, std::size_t)>("_ZN3tbb6detail2r110deallocateERNS0_2d117small_object_poolEPvm");
  __tsan_release(memory);
  real(pool, memory, bytes);
}

}  // namespace tbb::detail::r1
