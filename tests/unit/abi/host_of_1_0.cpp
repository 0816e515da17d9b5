// Compiled against the headers of ABI 1.0 alone: what a host of that version does with a plugin that was built today.
#include <cleave/elasticity.h>

#include <dlfcn.h>
#include <gtest/gtest.h>

#include <array>
#include <cmath>
#include <cstring>
#include <fstream>
#include <iterator>
#include <string>
#include <vector>

namespace cleave::test {
namespace {

static_assert(CLEAVE_ABI_MINOR == 0 && CLEAVE_FIELD_COUNT == 23, "the headers of 1.0");

constexpr double mu = 4e4, kappa = 7e4;

class HostOf10 : public ::testing::Test {
 protected:
  void SetUp() override {
    library_ = dlopen(CLEAVE_PLUGIN_OF_TODAY, RTLD_NOW | RTLD_LOCAL);
    ASSERT_NE(library_, nullptr) << dlerror();
    const auto entry = reinterpret_cast<cleave_plugin_entry_fn>(dlsym(library_, CLEAVE_ENTRY_SYMBOL));
    ASSERT_NE(entry, nullptr);
    const cleave_host host{sizeof host, {1, 0}, "cleave", "1.0.0"};
    ASSERT_EQ(entry(&host, &plugin_), CLEAVE_OK);
  }
  void TearDown() override {
    if (library_) dlclose(library_);
  }
  cleave_instance* create() const {
    std::vector<cleave_parameter> values;
    for (std::uint32_t i = 0; i < plugin_->schema->parameter_count; ++i) {
      const auto& schema = *plugin_->schema->parameters[i];
      cleave_parameter value{};
      value.struct_size = sizeof value;
      value.type = schema.type;
      value.key = schema.key;
      value.given = std::strcmp(schema.key, "shear_modulus") == 0 || std::strcmp(schema.key, "bulk_modulus") == 0;
      value.number = std::strcmp(schema.key, "shear_modulus") == 0 ? mu : kappa;
      values.push_back(value);
    }
    const cleave_parameters parameters{sizeof parameters, std::uint32_t(values.size()), values.data()};
    const cleave_context context{sizeof context, 3, 0.01, 1000, nullptr, nullptr};
    cleave_instance* instance = nullptr;
    EXPECT_EQ(plugin_->create(&parameters, &context, &instance, nullptr), CLEAVE_OK);
    return instance;
  }

  void* library_ = nullptr;
  const cleave_plugin* plugin_ = nullptr;
};

TEST_F(HostOf10, AgreesOnItsOwnVersion) {
  EXPECT_EQ(plugin_->abi.major, 1u);
  EXPECT_EQ(plugin_->abi.minor, 0u);
}

TEST_F(HostOf10, FindsAManifestOfAVersionItReads) {
  const std::string library = CLEAVE_PLUGIN_OF_TODAY;
  std::ifstream file(library.substr(0, library.rfind(".so")) + ".cleave.toml");
  const std::string text((std::istreambuf_iterator<char>(file)), {});
  EXPECT_NE(text.find("\nabi = [1, 0]\n"), std::string::npos) << text;
}

/// tau of b = diag(s^2, 1, 1): mu s^(-2/3) dev b + kappa/2 (s^2 - 1) I.
TEST_F(HostOf10, GetsStressThroughLayoutsThatEndBeforeTheFieldsOfToday) {
  cleave_instance* instance = create();
  ASSERT_NE(instance, nullptr);
  const double stretch = 1.3, square = stretch * stretch;
  constexpr std::size_t lanes = CLEAVE_TILE_BYTES / sizeof(double);
  struct alignas(CLEAVE_TILE_BYTES) Line {
    std::array<double, lanes> lane{};
  };
  std::vector<Line> b(6), tau(6);
  for (std::size_t c = 0; c < 3; ++c) b[c].lane.fill(c == 0 ? square : 1);
  std::vector<cleave_component> components;
  for (std::uint32_t stream = 0; stream < 2; ++stream)
    for (std::uint32_t c = 0; c < 6; ++c) components.push_back({stream, c * CLEAVE_TILE_BYTES});
  std::vector<cleave_field> fields(CLEAVE_FIELD_COUNT);
  fields[CLEAVE_FIELD_B] = {0, 6};
  fields[CLEAVE_FIELD_TAU] = {6, 6};
  const cleave_layout layout{sizeof layout,
                             CLEAVE_FIELD_COUNT,
                             {6 * CLEAVE_TILE_BYTES, 6 * CLEAVE_TILE_BYTES, 0, 0},
                             fields.data(),
                             components.data()};
  std::array<cleave_status, lanes> status{};
  const cleave_batch batch{sizeof batch, lanes, &layout, {b.data(), tau.data(), nullptr, nullptr}, 0, status.data(), nullptr};
  const auto* table = static_cast<const cleave_elasticity*>(plugin_->kind(CLEAVE_KIND_ELASTICITY));
  ASSERT_NE(table, nullptr);
  ASSERT_EQ(table->evaluate_f64(instance, &batch), CLEAVE_OK);
  const double shear = mu * std::pow(stretch, -2. / 3) * (square - 1) / 3, volume = 0.5 * kappa * (square - 1);
  for (std::size_t k = 0; k < lanes; ++k) {
    EXPECT_EQ(status[k], CLEAVE_STATUS_OK);
    EXPECT_NEAR(tau[0].lane[k], volume + 2 * shear, 1e-12 * mu);
    EXPECT_NEAR(tau[1].lane[k], volume - shear, 1e-12 * mu);
    EXPECT_NEAR(tau[3].lane[k], 0, 1e-12 * mu);
  }
  plugin_->destroy(instance);
}

}  // namespace
}  // namespace cleave::test
