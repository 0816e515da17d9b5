#include "checkpoint/state.hpp"
#include "common/error.hpp"

#include <gmock/gmock.h>
#include <zlib.h>

#include <numeric>
#include <sstream>

namespace cleave::checkpoint {
namespace {

using testing::HasSubstr;

std::string state_of_two_sections() {
  std::ostringstream out;
  StateWriter writer(out);
  const std::vector<double> numbers = {1, -2.5, 3e-300};
  writer.section("numbers", numbers.data(), numbers.size());
  writer.text("words", "some words");
  writer.end();
  return out.str();
}

std::string problem_with(const std::string& bytes) {
  std::istringstream in(bytes);
  try {
    const StateReader reader(in, "it");
    return "";
  } catch (const InputError& e) {
    return e.what();
  }
}

TEST(State, SectionsAreReadInAnyOrder) {
  std::istringstream in(state_of_two_sections());
  StateReader reader(in, "it");
  EXPECT_EQ(reader.text("words"), "some words");
  ASSERT_EQ(reader.bytes("numbers"), 24u);
  std::vector<double> numbers(3);
  reader.read("numbers", std::as_writable_bytes(std::span(numbers)));
  EXPECT_THAT(numbers, testing::ElementsAre(1, -2.5, 3e-300));
  EXPECT_TRUE(reader.has("words"));
  EXPECT_FALSE(reader.has("end"));
}

TEST(State, ASectionOfAnotherLengthOrThatIsNotThereIsNamed) {
  std::istringstream in(state_of_two_sections());
  StateReader reader(in, "it");
  std::vector<std::byte> too_short(23);
  EXPECT_THAT([&] { reader.read("numbers", too_short); },
              testing::ThrowsMessage<InputError>("it: section 'numbers' has 24 bytes where 23 are expected"));
  EXPECT_THAT([&] { reader.read("letters"); }, testing::ThrowsMessage<InputError>("it: there is no section 'letters'"));
}

TEST(State, CutOffAnywhereIsRefused) {
  const std::string whole = state_of_two_sections();
  ASSERT_EQ(problem_with(whole), "");
  for (std::size_t length = 0; length < whole.size(); length++)
    EXPECT_THAT(problem_with(whole.substr(0, length)), testing::AnyOf(HasSubstr("is cut off"), HasSubstr("is no checkpoint")))
        << length;
  EXPECT_THAT(problem_with(whole + "x"), HasSubstr("1 bytes follow its end"));
}

TEST(State, OneWrongBitAnywhereIsRefused) {
  const std::string whole = state_of_two_sections();
  constexpr std::size_t reserved = 12, sections = 16;
  for (std::size_t at = 0; at < whole.size(); at++)
    for (int bit = 0; bit < 8; bit++) {
      if (at >= reserved && at < sections) continue;
      std::string broken = whole;
      broken[at] = char(broken[at] ^ (1 << bit));
      EXPECT_NE(problem_with(broken), "") << "bit " << bit << " of byte " << at;
    }
}

TEST(State, AnotherFormatIsNamed) {
  std::string other = state_of_two_sections();
  other[8] = 2;
  EXPECT_EQ(problem_with(other), "it: has format 2, this program reads format 1");
  EXPECT_EQ(problem_with("[simulation]\ncell_size = 1\n"), "it: is no checkpoint");
}

TEST(State, ASectionThatIsMissingIsNoticed) {
  std::ostringstream out;
  StateWriter writer(out);
  writer.text("first", "1");
  const std::string with_one = out.str();
  writer.text("second", "2");
  const std::size_t second = out.str().size() - with_one.size();
  writer.end();
  std::string whole = out.str();
  whole.erase(with_one.size(), second);
  EXPECT_EQ(problem_with(whole), "it: is damaged: sections are missing");
}

TEST(State, ChecksumsAreThoseOfZlibHoweverManyThreadsMakeThem) {
  std::vector<std::byte> bytes((std::size_t(5) << 20) + 77);
  for (std::size_t i = 0; i < bytes.size(); i++) bytes[i] = std::byte(i * 2654435761u >> 13);
  const auto* begin = reinterpret_cast<const Bytef*>(bytes.data());
  for (const std::size_t size : {std::size_t(0), std::size_t(1), std::size_t(1) << 20, bytes.size()})
    for (const std::uint32_t before : {0u, 123456789u})
      EXPECT_EQ(checksum(std::span(bytes).first(size), before), crc32_z(before,
                                                                        size            ? begin
                                                                        : bytes.empty() ? nullptr
                                                                                        : begin,
                                                                        size))
          << size;
}

struct Values {
  double number = 0;
  bool flag = false;
  std::string text;
  std::vector<std::int32_t> list;
  std::map<std::string, std::int64_t> counts;

  template <class Self, class Archive>
  static void each(Self& self, Archive& archive) {
    archive(self.number, self.flag, self.text, self.list, self.counts);
  }
};

TEST(State, ValuesComeBackAsTheyWerePacked) {
  const Values given{-0.1, true, "elastic wave", {3, 1, 2}, {{"frame", 7}, {"", -1}}};
  std::ostringstream out;
  StateWriter writer(out);
  pack(writer, "values", [&](auto& archive) { Values::each(given, archive); });
  writer.end();
  std::istringstream in(out.str());
  StateReader reader(in, "it");
  Values read{1, false, "other", {9}, {{"other", 1}}};
  unpack(reader, "values", [&](auto& archive) { Values::each(read, archive); });
  EXPECT_EQ(read.number, given.number);
  EXPECT_EQ(read.flag, given.flag);
  EXPECT_EQ(read.text, given.text);
  EXPECT_EQ(read.list, given.list);
  EXPECT_EQ(read.counts, given.counts);
}

TEST(State, ValuesThatEndEarlyOrLateAreRefused) {
  for (const std::size_t size : {0u, 7u, 9u, 16u}) {
    std::ostringstream out;
    StateWriter writer(out);
    writer.text("values", std::string(size, '\xff'));
    writer.end();
    std::istringstream in(out.str());
    StateReader reader(in, "it");
    double number = 0;
    EXPECT_THAT([&] { unpack(reader, "values", [&](auto& archive) { archive(number); }); },
                testing::ThrowsMessage<InputError>(HasSubstr(size < 8 ? "is shorter than" : "is longer than")));
    std::vector<double> many;  // a count of 2^64 - 1
    EXPECT_THAT([&] { unpack(reader, "values", [&](auto& archive) { archive(many); }); },
                testing::ThrowsMessage<InputError>(HasSubstr("is shorter than")));
  }
}

}  // namespace
}  // namespace cleave::checkpoint
