#pragma once

#include <cleave/testkit/check.hpp>

#include <sys/mman.h>
#include <unistd.h>

#include <cstddef>
#include <cstdint>
#include <cstring>
#include <vector>

namespace cleave::testkit {

/// A copy of an array that ends where accessible memory ends; pages before it cannot be accessed either.
template <class T>
class Guarded {
 public:
  Guarded(const T* values, std::size_t count) : bytes_(count * sizeof(T)), page_(std::size_t(sysconf(_SC_PAGESIZE))) {
    inside_ = (bytes_ + page_ - 1) / page_ * page_;
    base_ = static_cast<char*>(mmap(nullptr, inside_ + 2 * page_, PROT_NONE, MAP_PRIVATE | MAP_ANONYMOUS, -1, 0));
    if (base_ == MAP_FAILED) throw Failed{"no memory for the check"};
    if (inside_) mprotect(base_ + page_, inside_, PROT_READ | PROT_WRITE);
    std::memset(base_ + page_, pattern, inside_ - bytes_);
    if (bytes_) std::memcpy(data(), values, bytes_);
  }
  /// Zeros.
  explicit Guarded(std::size_t count) : Guarded(std::vector<T>(count)) {}
  explicit Guarded(const std::vector<T>& values) : Guarded(values.data(), values.size()) {}
  Guarded(const Guarded&) = delete;
  Guarded& operator=(const Guarded&) = delete;
  ~Guarded() { munmap(base_, inside_ + 2 * page_); }

  T* data() const { return reinterpret_cast<T*>(base_ + page_ + inside_ - bytes_); }
  std::vector<T> values() const { return std::vector<T>(data(), data() + bytes_ / sizeof(T)); }
  const T* read_only() const {
    if (inside_) mprotect(base_ + page_, inside_, PROT_READ);
    return data();
  }
  /// Nothing wrote between the begin of the page and the array.
  bool intact_before() const {
    for (std::size_t i = 0; i < inside_ - bytes_; ++i)
      if (static_cast<unsigned char>(base_[page_ + i]) != pattern) return false;
    return true;
  }

 private:
  static constexpr unsigned char pattern = 0xA5;
  std::size_t bytes_, page_, inside_;
  char* base_;
};

/// The first `size` bytes of a struct, behind which, rounded up to a multiple of eight, memory cannot be accessed.
template <class T>
class Truncated {
 public:
  Truncated(const T& value, std::size_t size) : words_((size + 7) / 8) {
    static_assert(alignof(T) <= 8);
    std::memcpy(words_.data(), &value, size);
  }
  T* data() const { return reinterpret_cast<T*>(words_.data()); }

 private:
  Guarded<std::uint64_t> words_;
};

/// A struct as a newer host writes it: larger, and with members this version does not know.
template <class T>
struct Enlarged {
  T known;
  unsigned char unknown[64];
  explicit Enlarged(const T& value) : known(value) {
    std::memset(unknown, 0x5A, sizeof unknown);
    known.struct_size = sizeof *this;
  }
};

}  // namespace cleave::testkit
