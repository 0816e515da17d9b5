#include "output/atomic_file.hpp"

#include "common/error.hpp"

#include <fcntl.h>
#include <sys/stat.h>
#include <unistd.h>

#include <cerrno>
#include <streambuf>
#include <system_error>
#include <utility>
#include <vector>

namespace cleave::output {

void throw_file_error(const char* action, const std::filesystem::path& path, int error) {
  throw InputError(std::string("cannot ") + action + " " + path.string() + ": " + std::generic_category().message(error));
}

namespace {

/// Some file systems cannot sync; that is no reason to lose a frame.
bool sync_failed(int descriptor) { return ::fsync(descriptor) != 0 && errno != EINVAL && errno != ENOTSUP && errno != EROFS; }

/// A rename survives a power cut only once its directory is on the disk.
void sync_directory(const std::filesystem::path& directory) {
  const int descriptor = ::open(directory.c_str(), O_RDONLY | O_DIRECTORY | O_CLOEXEC);
  if (descriptor < 0) return;
  ::fsync(descriptor);
  ::close(descriptor);
}

}  // namespace

/// std::filebuf hides the reason of a failure and its descriptor, which fsync needs.
class AtomicFile::Buffer final : public std::streambuf {
 public:
  Buffer(const std::filesystem::path& target, const std::filesystem::path& partial) : target_(target), bytes_(1 << 20) {
    descriptor_ = ::open(partial.c_str(), O_WRONLY | O_CREAT | O_TRUNC | O_CLOEXEC, 0666);
    if (descriptor_ < 0) throw_file_error("write", target_, errno);
    setp(bytes_.data(), bytes_.data() + bytes_.size());
  }
  ~Buffer() override {
    if (descriptor_ >= 0) ::close(descriptor_);
  }

  void finish() {
    drain();
    if (sync_failed(descriptor_)) throw_file_error("write", target_, errno);
    if (::close(std::exchange(descriptor_, -1)) != 0) throw_file_error("write", target_, errno);
  }

 protected:
  int_type overflow(int_type byte) override {
    drain();
    if (!traits_type::eq_int_type(byte, traits_type::eof())) {
      *pptr() = traits_type::to_char_type(byte);
      pbump(1);
    }
    return traits_type::not_eof(byte);
  }

  std::streamsize xsputn(const char* bytes, std::streamsize count) override {
    if (count > epptr() - pptr()) drain();
    if (count >= static_cast<std::streamsize>(bytes_.size())) {
      write(bytes, static_cast<std::size_t>(count));
    } else {
      traits_type::copy(pptr(), bytes, static_cast<std::size_t>(count));
      pbump(static_cast<int>(count));
    }
    return count;
  }

  int sync() override {
    drain();
    return 0;
  }

  pos_type seekoff(off_type offset, std::ios_base::seekdir from, std::ios_base::openmode) override {
    if (offset == 0 && from == std::ios_base::cur) return position_ + (pptr() - pbase());
    drain();
    const int whence = from == std::ios_base::beg ? SEEK_SET : from == std::ios_base::cur ? SEEK_CUR : SEEK_END;
    const off_t position = ::lseek(descriptor_, offset, whence);
    if (position < 0) throw_file_error("write", target_, errno);
    return position_ = position;
  }

  pos_type seekpos(pos_type position, std::ios_base::openmode mode) override {
    return seekoff(off_type(position), std::ios_base::beg, mode);
  }

 private:
  void drain() {
    const auto count = static_cast<std::size_t>(pptr() - pbase());
    setp(bytes_.data(), bytes_.data() + bytes_.size());
    write(bytes_.data(), count);
  }

  void write(const char* bytes, std::size_t count) {
    while (count > 0) {
      const ssize_t done = ::write(descriptor_, bytes, count);
      if (done < 0 && errno == EINTR) continue;
      if (done <= 0) throw_file_error("write", target_, done < 0 ? errno : ENOSPC);
      bytes += done;
      count -= static_cast<std::size_t>(done);
      position_ += done;
    }
  }

  std::filesystem::path target_;
  std::vector<char> bytes_;
  off_t position_ = 0;
  int descriptor_ = -1;
};

AtomicFile::AtomicFile(std::filesystem::path target) : target_(std::move(target)), partial_(target_), stream_(nullptr) {
  partial_ += partial_suffix;
  buffer_ = std::make_unique<Buffer>(target_, partial_);
  stream_.rdbuf(buffer_.get());
  // With badbit in the mask a stream passes on what its buffer throws.
  stream_.exceptions(std::ios_base::badbit | std::ios_base::failbit);
}

AtomicFile::~AtomicFile() {
  if (!buffer_) return;
  buffer_.reset();
  ::unlink(partial_.c_str());
}

std::ostream& AtomicFile::stream() { return stream_; }

void AtomicFile::commit() {
  buffer_->finish();
  if (::rename(partial_.c_str(), target_.c_str()) != 0) throw_file_error("write", target_, errno);
  buffer_.reset();
  sync_directory(target_.has_parent_path() ? target_.parent_path() : ".");
}

}  // namespace cleave::output
