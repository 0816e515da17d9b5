// Structs only grow at their end, and no number changes its meaning [docs/abi.md].
#include "layout.h"

#include <gtest/gtest.h>

#include <map>
#include <string>

namespace cleave::test {
namespace {

std::map<std::string, layout_entry> entries(const layout& of) {
  std::map<std::string, layout_entry> all;
  for (const auto* entry = of.entries; entry->name; ++entry) all[entry->name] = *entry;
  return all;
}

bool is_struct(const std::string& name) { return name.back() == '.'; }

TEST(AbiLayout, MembersOf10AreWhereTheyWere) {
  const auto then = entries(layout_of_1_0), today = entries(layout_of_today);
  ASSERT_GT(then.size(), 150u);
  for (const auto& [name, entry] : then) {
    if (is_struct(name)) continue;
    EXPECT_EQ(today.at(name).offset, entry.offset) << name;
    EXPECT_EQ(today.at(name).size, entry.size) << name;
    EXPECT_EQ(today.at(name).type, entry.type) << name << " has become another type";
  }
}

TEST(AbiLayout, StructsGrowOnlyIfTheySayTheirSize) {
  const auto then = entries(layout_of_1_0), today = entries(layout_of_today);
  int structs = 0;
  for (const auto& [name, entry] : then) {
    if (!is_struct(name)) continue;
    ++structs;
    const auto size_member = then.find(name + "struct_size");
    if (size_member == then.end()) {
      EXPECT_EQ(today.at(name).size, entry.size) << name;
    } else {
      EXPECT_EQ(size_member->second.offset, 0u) << name;
      EXPECT_EQ(size_member->second.size, 4u) << name;
      EXPECT_GE(today.at(name).size, entry.size) << name;
    }
  }
  EXPECT_GT(structs, 25);
}

TEST(AbiLayout, NumbersAndNamesOf10MeanWhatTheyMeant) {
  std::map<std::string, std::int64_t> today;
  for (const auto* constant = layout_of_today.constants; constant->name; ++constant) today[constant->name] = constant->value;
  int numbers = 0, names = 0;
  for (const auto* constant = layout_of_1_0.constants; constant->name; ++constant, ++numbers) {
    const std::string name = constant->name;
    if (name == "CLEAVE_ABI_MINOR" || name == "CLEAVE_FIELD_COUNT")
      EXPECT_GE(today.at(name), constant->value) << name << " only grows";
    else
      EXPECT_EQ(today.at(name), constant->value) << name;
  }
  std::map<std::string, std::string> texts;
  for (const auto* text = layout_of_today.texts; text->name; ++text) texts[text->name] = text->value;
  for (const auto* text = layout_of_1_0.texts; text->name; ++text, ++names) EXPECT_EQ(texts.at(text->name), text->value);
  EXPECT_GT(numbers, 70);
  EXPECT_GE(names, 7) << "kinds, extensions and the entry point";
}

}  // namespace
}  // namespace cleave::test
