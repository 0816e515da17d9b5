/// Turns the declarations of a law (<cleave/parameters.hpp>) into the ABI's schema, and the ABI's values into its members.
#ifndef CLEAVE_DETAIL_SCHEMA_HPP
#define CLEAVE_DETAIL_SCHEMA_HPP

#include <cleave/parameters.hpp>

namespace cleave::detail {

/// Text for a cleave_message, cut to its capacity. A null message or buffer is fine.
inline void copy_text(char* destination, std::uint32_t capacity, std::string_view text) {
  if (!destination || capacity == 0) return;
  const std::size_t length = std::min<std::size_t>(text.size(), capacity - 1);
  std::memcpy(destination, text.data(), length);
  destination[length] = '\0';
}
inline void write_message(cleave_message* message, std::string_view subject, std::string_view text) {
  if (!message || !CLEAVE_HAS(cleave_message, message, subject)) return;
  copy_text(message->text, message->text_capacity, text);
  copy_text(message->subject, message->subject_capacity, subject);
}

// ---------------------------------------------------------------- schema

inline void set_bounds(cleave_parameter_schema& schema, const Bounds& valid, const Bounds& physical) {
  schema.minimum = valid.minimum;
  schema.maximum = valid.maximum;
  schema.minimum_open = valid.minimum_open;
  schema.maximum_open = valid.maximum_open;
  schema.physical_minimum = physical.minimum;
  schema.physical_maximum = physical.maximum;
}

inline cleave_parameter_schema common_schema(cleave_type type, const char* key, const char* unit, const char* description,
                                             bool required) {
  cleave_parameter_schema schema{};
  schema.struct_size = sizeof schema;
  schema.type = type;
  schema.key = key;
  schema.unit = unit;
  schema.description = description;
  schema.required = required;
  set_bounds(schema, unbounded, unbounded);
  return schema;
}

inline cleave_parameter_schema to_schema(const NumberSpec& spec) {
  auto schema = common_schema(CLEAVE_TYPE_NUMBER, spec.key, spec.unit, spec.description, !spec.default_value);
  schema.default_number = spec.default_value.value_or(0);
  set_bounds(schema, spec.valid, spec.physical.value_or(spec.valid));
  std::copy(spec.needs.begin(), spec.needs.end(), schema.needs);
  return schema;
}
inline cleave_parameter_schema to_schema(const IntegerSpec& spec) {
  auto schema = common_schema(CLEAVE_TYPE_INTEGER, spec.key, spec.unit, spec.description, !spec.default_value);
  schema.default_number = spec.default_value.value_or(0);
  const Bounds representable{std::max(spec.valid.minimum, double(std::numeric_limits<int>::min())),
                             std::min(spec.valid.maximum, double(std::numeric_limits<int>::max())), spec.valid.minimum_open,
                             spec.valid.maximum_open};
  set_bounds(schema, representable, representable);
  return schema;
}
inline cleave_parameter_schema to_schema(const BooleanSpec& spec) {
  auto schema = common_schema(CLEAVE_TYPE_BOOLEAN, spec.key, "", spec.description, !spec.default_value);
  schema.default_number = spec.default_value.value_or(false);
  return schema;
}
/// Refers to `spec`, which is part of a law's static declarations.
inline cleave_parameter_schema to_schema(const ChoiceSpec& spec) {
  auto schema = common_schema(CLEAVE_TYPE_TEXT, spec.key, "", spec.description, !spec.default_value);
  schema.default_text = spec.default_value;
  schema.choices = spec.choices.data();
  while (schema.choice_count < spec.choices.size() && spec.choices[schema.choice_count]) ++schema.choice_count;
  return schema;
}
inline cleave_parameter_schema to_schema(const ListSpec& spec) {
  auto schema = common_schema(CLEAVE_TYPE_NUMBER_LIST, spec.key, spec.unit, spec.description, !spec.default_value);
  if (spec.default_value) {
    schema.default_list = spec.default_value->data();
    schema.default_count = spec.default_value->size();
  }
  schema.min_count = spec.min_count;
  schema.max_count = std::min(spec.max_count, NumberList::capacity);
  set_bounds(schema, spec.valid, spec.valid);
  std::copy(spec.needs.begin(), spec.needs.end(), schema.needs);
  return schema;
}

inline cleave_state_schema to_schema(const StateSpec& spec, cleave_tensor tensor) {
  cleave_state_schema schema{};
  schema.struct_size = sizeof schema;
  schema.tensor = tensor;
  schema.name = spec.name;
  schema.unit = spec.unit;
  schema.description = spec.description;
  schema.monotonicity = std::uint32_t(spec.change);
  std::copy(spec.initial.begin(), spec.initial.end(), schema.initial);
  return schema;
}

/// True if `word` is one of the space-separated words of `words`.
inline bool contains_word(std::string_view words, std::string_view word) {
  while (!words.empty()) {
    const auto space = std::min(words.find(' '), words.size());
    if (words.substr(0, space) == word) return true;
    words.remove_prefix(std::min(space + 1, words.size()));
  }
  return false;
}

/// The ABI's view of a law's declarations. Immovable: its arrays point into each other.
class Schema {
 public:
  Schema(const Schema&) = delete;
  Schema& operator=(const Schema&) = delete;

  template <class Law>
  Schema(std::type_identity<Law>, std::uint64_t capabilities) {
    if constexpr (requires { Law::parameters; }) add(Law::parameters);
    if constexpr (requires { Law::states; }) add(Law::states);
    for (auto& alternatives : alternatives_)
      for (std::uint32_t i = 0; i < alternatives.set_count; ++i)
        for (auto& parameter : parameters_)
          if (contains_word(alternatives.sets[i], parameter.key)) {
            parameter.in_set = 1;
            parameter.required = 0;
          }
    for (const auto& parameter : parameters_) parameter_pointers_.push_back(&parameter);
    for (const auto& state : states_) state_pointers_.push_back(&state);
    for (const auto& alternatives : alternatives_) alternatives_pointers_.push_back(&alternatives);
    schema_.struct_size = sizeof schema_;
    schema_.parameter_count = std::uint32_t(parameters_.size());
    schema_.parameters = parameter_pointers_.data();
    schema_.state_count = std::uint32_t(states_.size());
    schema_.states = state_pointers_.data();
    schema_.alternatives_count = std::uint32_t(alternatives_.size());
    schema_.alternatives = alternatives_pointers_.data();
    schema_.capabilities = capabilities;
  }

  const cleave_schema& abi() const { return schema_; }
  const std::vector<cleave_parameter_schema>& parameters() const { return parameters_; }
  const std::vector<cleave_alternatives>& alternatives() const { return alternatives_; }

 private:
  template <class... Items>
  void add(const Declarations<Items...>& declarations) {
    std::apply([this](const auto&... item) { (this->add(item), ...); }, declarations.items);
  }
  template <class Owner, class Value, class Spec>
  void add(const Declared<Owner, Value, Spec>& item) {
    parameters_.push_back(to_schema(item.spec));
  }
  template <class Owner, class Group>
  void add(const Nested<Owner, Group>&) {
    add(Group::parameters);
  }
  template <cleave_tensor Tensor>
  void add(const DeclaredState<Tensor>& item) {
    states_.push_back(to_schema(item.spec, Tensor));
  }
  void add(const AlternativeSets& item) {
    cleave_alternatives alternatives{};
    alternatives.struct_size = sizeof alternatives;
    alternatives.sets = item.sets.data();
    while (alternatives.set_count < item.sets.size() && item.sets[alternatives.set_count]) ++alternatives.set_count;
    alternatives.optional = item.optional;
    alternatives_.push_back(alternatives);
  }

  std::vector<cleave_parameter_schema> parameters_;
  std::vector<cleave_state_schema> states_;
  std::vector<cleave_alternatives> alternatives_;
  std::vector<const cleave_parameter_schema*> parameter_pointers_;
  std::vector<const cleave_state_schema*> state_pointers_;
  std::vector<const cleave_alternatives*> alternatives_pointers_;
  cleave_schema schema_{};
};

/// Number of state components of a law.
template <class Law>
consteval int state_count() {
  if constexpr (requires { Law::states; })
    return std::apply(
        []<cleave_tensor... T>(const DeclaredState<T>&...) { return (0 + ... + int(T)); }, Law::states.items);
  else
    return 0;
}

// ---------------------------------------------------------------- values

/// The values the host hands to create(), checked against the schema. Throws ParameterError naming the parameter.
class Values {
 public:
  Values(const Schema& schema, const cleave_parameters* parameters) : schema_(schema), parameters_(parameters) {
    if (parameters_ && parameters_->count > 0 && !parameters_->values) parameters_ = nullptr;
    for (std::uint32_t i = 0; i < count(); ++i) check_known(value(i));
    for (const auto& parameter : schema_.parameters()) check(parameter);
    for (const auto& alternatives : schema_.alternatives()) check(alternatives);
  }

  /// What the member declared under this key becomes; null if it belongs to alternatives and was not given.
  const cleave_parameter* value_of(const char* key) const {
    for (const auto& parameter : schema_.parameters())
      if (std::strcmp(parameter.key, key) == 0) {
        const cleave_parameter* given = find(key);
        return parameter.in_set && !given->given ? nullptr : given;
      }
    return nullptr;
  }

  /// "exact" of the choices {"exact", "trace"} is 0.
  static int choice_index(const cleave_parameter_schema& schema, const cleave_parameter& given) {
    std::string all = "must be one of ";
    for (std::uint32_t i = 0; i < schema.choice_count; ++i) {
      if (given.text && std::strcmp(given.text, schema.choices[i]) == 0) return int(i);
      all.append(i ? ", \"" : "\"").append(schema.choices[i]).append("\"");
    }
    throw ParameterError{schema.key, all.append(", is \"").append(given.text ? given.text : "").append("\"")};
  }

 private:
  const cleave_parameter* find(const char* key) const {
    for (std::uint32_t i = 0; i < count(); ++i)
      if (std::strcmp(value(i).key, key) == 0) return &value(i);
    return nullptr;
  }
  std::uint32_t count() const { return parameters_ ? parameters_->count : 0; }
  /// A newer host's elements are larger than ours.
  const cleave_parameter& value(std::uint32_t i) const {
    const auto* first = reinterpret_cast<const char*>(parameters_->values);
    return *reinterpret_cast<const cleave_parameter*>(first + std::size_t(i) * parameters_->values->struct_size);
  }

  void check_known(const cleave_parameter& given) const {
    if (!given.key) throw ParameterError{"", "a parameter has no name"};
    for (const auto& parameter : schema_.parameters())
      if (std::strcmp(parameter.key, given.key) == 0) return;
    throw ParameterError{given.key, "is not a parameter of this plugin"};
  }

  static std::string text(double value) {
    char buffer[32];
    std::snprintf(buffer, sizeof buffer, "%.10g", value);
    return buffer;
  }
  static void check_bounds(const cleave_parameter_schema& schema, double value) {
    const bool below = schema.minimum_open ? !(value > schema.minimum) : !(value >= schema.minimum);
    const bool above = schema.maximum_open ? !(value < schema.maximum) : !(value <= schema.maximum);
    if (std::isfinite(value) && !below && !above) return;
    std::string unit;
    if (std::strcmp(schema.unit, "1") != 0) unit.append(" ").append(schema.unit);
    std::string problem = "must be ";
    if (!std::isfinite(value))
      problem += "finite";
    else if (below)
      problem.append(schema.minimum_open ? "greater than " : "at least ").append(text(schema.minimum)).append(unit);
    else
      problem.append(schema.maximum_open ? "less than " : "at most ").append(text(schema.maximum)).append(unit);
    throw ParameterError{schema.key, problem + ", is " + text(value)};
  }

  void check(const cleave_parameter_schema& schema) const {
    const cleave_parameter* given = find(schema.key);
    if (given && schema.in_set && !given->given) return;
    if (!given || (schema.required && !given->given)) throw ParameterError{schema.key, "is required"};
    if (given->type != schema.type) throw ParameterError{schema.key, "is of the wrong type"};
    switch (schema.type) {
      case CLEAVE_TYPE_NUMBER:
        check_bounds(schema, given->number);
        break;
      case CLEAVE_TYPE_INTEGER:
        check_bounds(schema, double(given->integer));
        break;
      case CLEAVE_TYPE_TEXT:
        choice_index(schema, *given);
        break;
      case CLEAVE_TYPE_NUMBER_LIST:
        if (given->count < schema.min_count || given->count > schema.max_count || (given->count > 0 && !given->list))
          throw ParameterError{schema.key, "has " + std::to_string(given->count) + " elements, must have " +
                                               std::to_string(schema.min_count) + " to " + std::to_string(schema.max_count)};
        for (std::uint32_t i = 0; i < given->count; ++i) check_bounds(schema, given->list[i]);
        break;
      default:
        break;
    }
  }

  /// Exactly one whole set, or none where that is allowed.
  void check(const cleave_alternatives& alternatives) const {
    std::string given_keys, wanted;
    int given_count = 0;
    for (const auto& parameter : schema_.parameters()) {
      const cleave_parameter* value = find(parameter.key);
      if (!value || !value->given || !in_any_set(alternatives, parameter.key)) continue;
      given_keys.append(given_count++ ? " " : "").append(parameter.key);
    }
    if (given_count == 0 && alternatives.optional) return;
    std::string_view nearest;
    for (std::uint32_t i = 0; i < alternatives.set_count; ++i) {
      const std::string_view set = alternatives.sets[i];
      int matching = 0;
      for_each_word(given_keys, [&](std::string_view key) { matching += contains_word(set, key); });
      const int size = 1 + int(std::count(set.begin(), set.end(), ' '));
      if (matching == given_count && size == given_count) return;
      if (matching == given_count && nearest.empty()) nearest = set;
      std::string words(set);
      for (std::size_t at = 0; (at = words.find(' ', at)) != std::string::npos; at += 5) words.replace(at, 1, " and ");
      wanted.append(i ? ", or " : "").append(words);
    }
    std::string subject;
    if (nearest.empty()) {
      for_each_word(given_keys, [&](std::string_view key) { subject = key; });
      throw ParameterError{subject, "does not go with the others: give " + wanted};
    }
    for_each_word(nearest, [&](std::string_view key) {
      if (subject.empty() && !contains_word(given_keys, key)) subject = key;
    });
    throw ParameterError{subject, "is missing: give " + wanted};
  }
  template <class Use>
  static void for_each_word(std::string_view words, Use use) {
    while (!words.empty()) {
      const auto space = std::min(words.find(' '), words.size());
      use(words.substr(0, space));
      words.remove_prefix(std::min(space + 1, words.size()));
    }
  }
  static bool in_any_set(const cleave_alternatives& alternatives, std::string_view key) {
    for (std::uint32_t i = 0; i < alternatives.set_count; ++i)
      if (contains_word(alternatives.sets[i], key)) return true;
    return false;
  }

  const Schema& schema_;
  const cleave_parameters* parameters_;
};

template <class Value, class Spec>
void assign(Value& member, const Spec& spec, const cleave_parameter& given) {
  if constexpr (std::is_same_v<Spec, NumberSpec>)
    member = given.number;
  else if constexpr (std::is_same_v<Spec, IntegerSpec>)
    member = int(given.integer);
  else if constexpr (std::is_same_v<Spec, BooleanSpec>)
    member = given.number != 0;
  else if constexpr (std::is_same_v<Spec, ChoiceSpec>)
    member = Value(Values::choice_index(to_schema(spec), given));
  else {
    member.resize(given.count);
    std::copy(given.list, given.list + given.count, member.data());
  }
}

template <class Owner>
void fill(Owner& owner, const Values& values, const Surroundings& surroundings);

template <class Owner, class Item>
void fill_item(Owner& owner, const Item& item, const Values& values, const Surroundings& surroundings) {
  if constexpr (requires { item.spec; }) {
    if (const cleave_parameter* given = values.value_of(item.spec.key)) assign(owner.*item.member, item.spec, *given);
  } else if constexpr (requires { item.member; }) {
    fill(owner.*item.member, values, surroundings);
  }
}

/// Fills the declared members of a law, innermost groups first, and lets each complete itself.
template <class Owner>
void fill(Owner& owner, const Values& values, const Surroundings& surroundings) {
  if constexpr (requires { Owner::parameters; })
    std::apply([&](const auto&... item) { (fill_item(owner, item, values, surroundings), ...); }, Owner::parameters.items);
  if constexpr (requires { owner.complete(surroundings); })
    owner.complete(surroundings);
  else if constexpr (requires { owner.complete(); })
    owner.complete();
}

}  // namespace cleave::detail

#endif
