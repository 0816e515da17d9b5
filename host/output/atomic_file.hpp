#pragma once

#include <filesystem>
#include <memory>
#include <ostream>

namespace cleave::output {

/// A file that appears whole or not at all: its bytes go to "<target>.partial" beside it, which commit() moves into place once
/// they are on the disk. Until then, and after any failure, an older file of that name stays as it was. Every failure to write
/// is an InputError with the name and the system's reason, thrown out of the stream operation in which it happened.
class AtomicFile {
 public:
  explicit AtomicFile(std::filesystem::path target);
  ~AtomicFile();
  AtomicFile(const AtomicFile&) = delete;
  AtomicFile& operator=(const AtomicFile&) = delete;

  std::ostream& stream();  ///< binary, seekable
  void commit();

 private:
  class Buffer;
  std::filesystem::path target_, partial_;
  std::unique_ptr<Buffer> buffer_;
  std::ostream stream_;
};

inline constexpr const char* partial_suffix = ".partial";

/// Throws InputError "cannot <action> <path>: <the system's reason for `error`>".
[[noreturn]] void throw_file_error(const char* action, const std::filesystem::path&, int error);

}  // namespace cleave::output
