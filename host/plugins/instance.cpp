#include "common/error.hpp"
#include "common/nearest.hpp"
#include "plugins/message.hpp"
#include "plugins/parameters.hpp"
#include "plugins/registry.hpp"

#include <utility>

namespace cleave::plugins {
namespace {

std::vector<std::string> keys(const Description& description) {
  std::vector<std::string> all;
  for (const auto& parameter : description.parameters) all.push_back(parameter.key);
  return all;
}

void check(const Description& description, const GivenParameters& given) {
  for (const auto& [key, value] : given) {
    const Parameter* known = nullptr;
    for (const auto& parameter : description.parameters)
      if (parameter.key == key) known = &parameter;
    if (!known) {
      const auto meant = nearest(key, keys(description));
      throw InputError(description.id + ": unknown parameter \"" + key + "\"" +
                       (meant ? ", did you mean \"" + *meant + "\"?" : ""));
    }
    if (const auto problem = problem_with(*known, value)) throw InputError(description.id + ": " + key + " " + *problem);
  }
  for (const auto& parameter : description.parameters)
    if (parameter.required && !given.contains(parameter.key))
      throw InputError(description.id + ": " + parameter.key + " is required (" + parameter.description + ")");
}

/// `value` must outlive the result, which points into it.
cleave_parameter pack(const Parameter& parameter, const Value& value, bool given) {
  cleave_parameter packed{};
  packed.struct_size = sizeof packed;
  packed.type = parameter.type;
  packed.key = parameter.key.c_str();
  packed.given = given;
  packed.text = "";
  if (const auto* number = std::get_if<double>(&value)) packed.number = *number;
  if (const auto* integer = std::get_if<std::int64_t>(&value)) {
    packed.integer = *integer;
    packed.number = double(*integer);
  }
  if (const auto* flag = std::get_if<bool>(&value)) packed.number = *flag ? 1 : 0;
  if (const auto* text = std::get_if<std::string>(&value)) packed.text = text->c_str();
  if (const auto* list = std::get_if<std::vector<double>>(&value)) {
    packed.list = list->data();
    packed.count = std::uint32_t(list->size());
  }
  return packed;
}

std::string refusal(const Description& description, cleave_result result, const char* text, const char* subject) {
  std::string message = description.id + ": ";
  if (*subject) message += std::string(subject) + " ";
  if (*text) return message + text;
  return message + "cannot be created (result " + std::to_string(result) + ", no reason given)";
}

}  // namespace

Instance::Instance(std::shared_ptr<const Plugin> plugin, const GivenParameters& given, const Context& context)
    : plugin_(std::move(plugin)) {
  const Description& description = plugin_->description();
  check(description, given);
  capabilities_ = description.capabilities_with(given);

  std::vector<cleave_parameter> values;
  for (const auto& parameter : description.parameters) {
    const auto scene_value = given.find(parameter.key);
    const bool is_given = scene_value != given.end();
    values.push_back(pack(parameter, is_given ? scene_value->second : parameter.default_value, is_given));
  }
  const cleave_parameters parameters{sizeof parameters, std::uint32_t(values.size()), values.data()};
  cleave_context surroundings{};
  surroundings.struct_size = sizeof surroundings;
  surroundings.dimension = std::uint32_t(context.dimension);
  surroundings.cell_size = context.cell_size;
  surroundings.density = context.density;
  surroundings.isochoric = context.isochoric ? &*context.isochoric : nullptr;
  surroundings.elastic = context.elastic;

  Message message;
  const cleave_result result = plugin_->table().create(&parameters, &surroundings, &handle_, message.get());
  if (result != CLEAVE_OK) {
    handle_ = nullptr;
    throw InputError(refusal(description, result, message.text(), message.subject()));
  }
  if (!handle_) throw InputError(description.id + ": create() gave no instance");
}

Instance::Instance(Instance&& other) noexcept
    : plugin_(std::move(other.plugin_)), handle_(std::exchange(other.handle_, nullptr)), capabilities_(other.capabilities_) {}

Instance& Instance::operator=(Instance&& other) noexcept {
  std::swap(plugin_, other.plugin_);
  std::swap(handle_, other.handle_);
  std::swap(capabilities_, other.capabilities_);
  return *this;
}

Instance::~Instance() {
  if (handle_) plugin_->table().destroy(handle_);
}

std::vector<double> Instance::initial_state() const {
  const auto& states = description().states;
  std::vector<double> values;
  for (const auto& state : states)
    values.insert(values.end(), state.initial.begin(), state.initial.begin() + int(state.tensor));
  if (plugin_->table().initial_state && !values.empty()) plugin_->table().initial_state(handle_, values.data());
  return values;
}

std::optional<cleave_isochoric_response> Instance::isochoric_response() const {
  const auto* extension =
      static_cast<const cleave_isochoric_response_extension*>(plugin_->table().extension(CLEAVE_EXTENSION_ISOCHORIC_RESPONSE));
  if (!extension || !CLEAVE_HAS(cleave_isochoric_response_extension, extension, response)) return std::nullopt;
  cleave_isochoric_response response{};
  response.struct_size = sizeof response;
  extension->response(handle_, &response);
  return response;
}

}  // namespace cleave::plugins
