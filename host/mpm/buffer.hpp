#pragma once

#include <sys/mman.h>

#include <cstddef>
#include <cstring>
#include <new>
#include <utility>

namespace cleave::mpm {

/// Large zero-initialised memory straight from the operating system, on huge pages where there are some. Growing drops the
/// contents; memory is returned at once when freed.
class Buffer {
 public:
  Buffer() = default;
  explicit Buffer(std::size_t bytes) { reserve(bytes); }
  Buffer(Buffer&& o) noexcept : data_(std::exchange(o.data_, nullptr)), bytes_(std::exchange(o.bytes_, 0)) {}
  Buffer& operator=(Buffer&& o) noexcept {
    std::swap(data_, o.data_);
    std::swap(bytes_, o.bytes_);
    return *this;
  }
  ~Buffer() { release(); }

  void reserve(std::size_t bytes) {
    if (bytes <= bytes_) return;
    release();
    constexpr std::size_t page = std::size_t(2) << 20;
    bytes = (bytes + page - 1) / page * page;
    void* p = mmap(nullptr, bytes + page, PROT_READ | PROT_WRITE, MAP_PRIVATE | MAP_ANONYMOUS, -1, 0);
    if (p == MAP_FAILED) throw std::bad_alloc();
    // trim to huge-page alignment
    char* begin = static_cast<char*>(p);
    char* aligned = reinterpret_cast<char*>((reinterpret_cast<std::size_t>(begin) + page - 1) / page * page);
    if (aligned != begin) munmap(begin, std::size_t(aligned - begin));
    const std::size_t behind = std::size_t(begin + bytes + page - (aligned + bytes));
    if (behind) munmap(aligned + bytes, behind);
    madvise(aligned, bytes, MADV_HUGEPAGE);
    data_ = aligned;
    bytes_ = bytes;
  }

  char* data() const { return data_; }
  std::size_t bytes() const { return bytes_; }

 private:
  void release() {
    if (data_) munmap(data_, bytes_);
    data_ = nullptr;
    bytes_ = 0;
  }
  char* data_ = nullptr;
  std::size_t bytes_ = 0;
};

}  // namespace cleave::mpm
