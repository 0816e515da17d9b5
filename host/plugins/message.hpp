#pragma once

#include <cleave/abi.h>

#include <array>
#include <cstdint>
#include <string>

namespace cleave::plugins {

/// Where a plugin writes what went wrong in a call.
class Message {
 public:
  Message() {
    message_.struct_size = sizeof message_;
    message_.text = text_.data();
    message_.text_capacity = std::uint32_t(text_.size() - 1);  // the last byte stays 0
    message_.subject = subject_.data();
    message_.subject_capacity = std::uint32_t(subject_.size() - 1);
  }
  Message(const Message&) = delete;
  Message& operator=(const Message&) = delete;

  cleave_message* get() { return &message_; }
  /// Empty if the plugin wrote nothing. Whatever it wrote, they end.
  const char* text() const { return text_.data(); }
  const char* subject() const { return subject_.data(); }
  /// The text, or that there is none.
  std::string reason(cleave_result result) const {
    return *text() ? text() : "result " + std::to_string(result) + ", no reason given";
  }

 private:
  std::array<char, 1025> text_{};
  std::array<char, 129> subject_{};
  cleave_message message_{};
};

}  // namespace cleave::plugins
