#pragma once

#include <cleave/abi.h>

#include <cstdint>
#include <initializer_list>
#include <vector>

namespace cleave::mpm {

/// Owns a cleave_layout: which components of which stream make up each field.
class LawLayout {
 public:
  explicit LawLayout(std::initializer_list<std::uint32_t> strides) : strides_(strides), fields_(CLEAVE_FIELD_COUNT) { point(); }
  LawLayout(const LawLayout& other) : strides_(other.strides_), fields_(other.fields_), components_(other.components_) {
    point();
  }
  LawLayout& operator=(const LawLayout& other) {
    strides_ = other.strides_;
    fields_ = other.fields_;
    components_ = other.components_;
    point();
    return *this;
  }

  void add(cleave_field_id field, const std::vector<cleave_component>& components) {
    fields_[field] = {std::uint16_t(components_.size()), std::uint16_t(components.size())};
    components_.insert(components_.end(), components.begin(), components.end());
    point();
  }

  /// Valid until this object changes; the same for all threads.
  const cleave_layout* get() const { return &layout_; }

 private:
  void point() {
    layout_ = {};
    layout_.struct_size = sizeof layout_;
    layout_.field_count = CLEAVE_FIELD_COUNT;
    for (std::size_t i = 0; i < strides_.size(); i++) layout_.stride[i] = strides_[i];
    layout_.fields = fields_.data();
    layout_.components = components_.data();
  }

  std::vector<std::uint32_t> strides_;
  std::vector<cleave_field> fields_;
  std::vector<cleave_component> components_;
  cleave_layout layout_;
};

}  // namespace cleave::mpm
