#pragma once

#include <sys/mman.h>

#include <cstddef>
#include <cstring>
#include <new>
#include <utility>

namespace cleave::mpm {

/// Large zero-initialised memory straight from the operating system, on huge pages where there are some. What was never touched
/// takes no memory; memory is returned at once when freed.
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

  /// Room for so many bytes; the contents are lost if there was less.
  void reserve(std::size_t bytes) {
    if (bytes <= bytes_) return;
    release();
    bytes = whole_pages(bytes);
    data_ = map(bytes);
    bytes_ = bytes;
  }

  /// The same with the contents kept: their pages move to another address and are not copied. Takes an eighth more than asked
  /// for, so that slow growth seldom moves them.
  void extend(std::size_t bytes) {
    if (bytes <= bytes_) return;
    bytes = whole_pages(bytes + bytes / 8);
    char* place = map(bytes);
    if (data_ && mremap(data_, bytes_, bytes, MREMAP_MAYMOVE | MREMAP_FIXED, place) == MAP_FAILED) {
      munmap(place, bytes);
      throw std::bad_alloc();
    }
    data_ = place;
    bytes_ = bytes;
  }

  char* data() const { return data_; }
  std::size_t bytes() const { return bytes_; }

 private:
  static constexpr std::size_t page = std::size_t(2) << 20;
  static std::size_t whole_pages(std::size_t bytes) { return (bytes + page - 1) / page * page; }

  /// Pages that start where a huge page does.
  static char* map(std::size_t bytes) {
    void* p = mmap(nullptr, bytes + page, PROT_READ | PROT_WRITE, MAP_PRIVATE | MAP_ANONYMOUS, -1, 0);
    if (p == MAP_FAILED) throw std::bad_alloc();
    char* begin = static_cast<char*>(p);
    char* aligned = reinterpret_cast<char*>(whole_pages(reinterpret_cast<std::size_t>(begin)));
    if (aligned != begin) munmap(begin, std::size_t(aligned - begin));
    const std::size_t behind = std::size_t(begin + bytes + page - (aligned + bytes));
    if (behind) munmap(aligned + bytes, behind);
    madvise(aligned, bytes, MADV_HUGEPAGE);
    return aligned;
  }
  void release() {
    if (data_) munmap(data_, bytes_);
    data_ = nullptr;
    bytes_ = 0;
  }
  char* data_ = nullptr;
  std::size_t bytes_ = 0;
};

}  // namespace cleave::mpm
