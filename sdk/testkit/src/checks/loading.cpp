#include "guarded.hpp"
#include "manifest_text.hpp"

#include <cleave/damage.h>
#include <cleave/testkit/batch.hpp>
#include <cleave/testkit/context.hpp>

#include <dlfcn.h>
#include <elf.h>
#include <link.h>
#include <malloc.h>

#include <algorithm>
#include <chrono>
#include <cstdio>
#include <cstring>
#include <fstream>
#include <iterator>
#include <sstream>

namespace cleave::testkit {
namespace {

void loads(Context& context) { context.plugin(); }

void exports_entry_only(Context& context) {
  std::ifstream file(context.library(), std::ios::binary);
  const std::string bytes((std::istreambuf_iterator<char>(file)), {});
  const auto at = [&]<class T>(std::uint64_t offset, T& value) {
    if (offset + sizeof value > bytes.size()) context.fail("the library file is truncated");
    std::memcpy(&value, bytes.data() + offset, sizeof value);
  };
  ElfW(Ehdr) header;
  at(0, header);
  std::string others;
  bool has_entry = false;
  for (int i = 0; i < header.e_shnum; ++i) {
    ElfW(Shdr) section, names;
    at(header.e_shoff + std::uint64_t(i) * header.e_shentsize, section);
    if (section.sh_type != SHT_DYNSYM) continue;
    at(header.e_shoff + std::uint64_t(section.sh_link) * header.e_shentsize, names);
    for (std::uint64_t k = 1; k < section.sh_size / sizeof(ElfW(Sym)); ++k) {
      ElfW(Sym) symbol;
      at(section.sh_offset + k * sizeof symbol, symbol);
      const auto binding = ELF64_ST_BIND(symbol.st_info);
      if (symbol.st_shndx == SHN_UNDEF || symbol.st_shndx >= SHN_LORESERVE || binding == STB_LOCAL) continue;
      const std::string name = bytes.c_str() + names.sh_offset + symbol.st_name;
      if (name == CLEAVE_ENTRY_SYMBOL)
        has_entry = true;
      else
        others += (others.empty() ? "" : ", ") + name;
    }
  }
  if (!has_entry) context.fail("exports no " CLEAVE_ENTRY_SYMBOL);
  if (!others.empty()) context.fail("exports also " + others.substr(0, 500));
}

void negotiates_version(Context& context) {
  const auto entry = entry_of(open_library(context.library()));
  for (std::uint32_t major : {CLEAVE_ABI_MAJOR + 1, CLEAVE_ABI_MAJOR - 1}) {
    // Before it has decided, a plugin may look at nothing but struct_size and abi.
    cleave_host host = this_host();
    host.abi = {major, 7};
    host.name = host.version = reinterpret_cast<const char*>(8);
    const Truncated seen(host, offsetof(cleave_host, abi) + sizeof host.abi);
    const cleave_plugin* plugin = nullptr;
    context.doing("asked by a host of ABI version " + std::to_string(major));
    if (entry(seen.data(), &plugin) != CLEAVE_ERROR_ABI)
      context.fail("does not refuse a host of ABI version " + std::to_string(major) + ".7 with CLEAVE_ERROR_ABI");
  }
  Enlarged newer(this_host());
  newer.known.abi.minor = CLEAVE_ABI_MINOR + 50;
  const cleave_plugin* plugin = nullptr;
  context.doing("asked by a host of a newer minor version");
  const cleave_result result = entry(&newer.known, &plugin);
  if (result == CLEAVE_ERROR_ABI) return;
  if (result != CLEAVE_OK || !plugin)
    context.fail("a host of a newer minor version gets neither a table nor CLEAVE_ERROR_ABI but result " +
                 std::to_string(result));
  if (plugin->abi.major != CLEAVE_ABI_MAJOR || plugin->abi.minor > newer.known.abi.minor)
    context.fail("answers a host of ABI version 1." + std::to_string(newer.known.abi.minor) + " with " +
                 std::to_string(plugin->abi.major) + "." + std::to_string(plugin->abi.minor));
}

cleave_parameter unknown_parameter() {
  cleave_parameter unknown{};
  unknown.struct_size = sizeof unknown;
  unknown.key = "no_such_parameter_in_any_plugin";
  unknown.given = 1;
  unknown.text = "";
  return unknown;
}

/// Messages of every size, with a parameter that is refused.
void cut_messages(Context& context) {
  const Plugin& plugin = context.plugin();
  const Settings settings = context.settings().front();
  const Material material(plugin.kind());
  for (std::uint32_t capacity : {1u, 2u, 7u, 32u}) {
    PackedParameters parameters(plugin.schema(), settings);
    parameters.values().push_back(unknown_parameter());
    parameters.refresh();
    char text[64], subject[64];
    std::memset(text, 0x5A, sizeof text);
    std::memset(subject, 0x5A, sizeof subject);
    cleave_message message{sizeof message, capacity, text, capacity, 0, subject};
    cleave_instance* instance = nullptr;
    context.doing("writing a message into " + std::to_string(capacity) + " bytes");
    if (plugin.table().create(parameters.get(), &material.context, &instance, &message) == CLEAVE_OK)
      plugin.table().destroy(instance);
    for (const char* buffer : {text, subject})
      for (std::uint32_t i = capacity; i < 64; ++i)
        if (buffer[i] != 0x5A) context.fail("writes beyond the " + std::to_string(capacity) + " bytes of a message");
  }
}

void struct_sizes(Context& context) {
  const Plugin& plugin = context.plugin();
  const auto entry = entry_of(open_library(context.library()));
  {
    cleave_host short_host{};
    short_host.struct_size = offsetof(cleave_host, abi);
    const Truncated host(short_host, short_host.struct_size);
    const cleave_plugin* table = nullptr;
    context.doing("given a cleave_host of four bytes");
    if (entry(host.data(), &table) == CLEAVE_OK) context.fail("accepts a cleave_host that does not state its version");
    const Enlarged newer(this_host());
    context.doing("given a larger cleave_host");
    if (entry(&newer.known, &table) != CLEAVE_OK) context.fail("refuses a host whose cleave_host is larger");
  }
  cut_messages(context);
  const Settings settings = context.settings().front();
  const Material material(plugin.kind());
  const auto create = [&](const cleave_parameters* parameters, const cleave_context* surroundings, bool must) {
    cleave_instance* instance = nullptr;
    Words words;
    const cleave_result result = plugin.table().create(parameters, surroundings, &instance, &words.message);
    if (result == CLEAVE_OK) plugin.table().destroy(instance);
    if (must && result != CLEAVE_OK) context.fail("refuses structs that are larger than it knows: " + words.said());
  };
  {
    const PackedParameters parameters(plugin.schema(), settings);
    cleave_context without_probe = material.context;
    without_probe.struct_size = offsetof(cleave_context, elastic);
    const Truncated surroundings(without_probe, without_probe.struct_size);
    context.doing("given a cleave_context that ends before `elastic`");
    create(parameters.get(), surroundings.data(), false);

    const Enlarged larger(material.context);
    context.doing("given a larger cleave_context");
    create(parameters.get(), &larger.known, true);

    std::vector<Enlarged<cleave_parameter>> values;
    for (std::uint32_t i = 0; i < parameters.get()->count; ++i) values.emplace_back(parameters.get()->values[i]);
    Enlarged list(*parameters.get());
    list.known.values = values.empty() ? nullptr : &values[0].known;
    context.doing("given larger elements of cleave_parameters");
    create(&list.known, &material.context, true);
  }
  {
    PackedParameters parameters(plugin.schema(), settings);
    parameters.values().push_back(unknown_parameter());
    parameters.refresh();
    Words words;
    words.message.struct_size = offsetof(cleave_message, subject_capacity);
    const Truncated message(words.message, words.message.struct_size);
    cleave_instance* refused = nullptr;
    context.doing("given a cleave_message that ends before `subject`");
    plugin.table().create(parameters.get(), &material.context, &refused, message.data());
    plugin.table().destroy(refused);
  }
  if (material.context.isochoric) {
    cleave_isochoric_response response = material.response;
    response.struct_size = offsetof(cleave_isochoric_response, bulk_modulus);
    const Truncated seen(response, response.struct_size);
    cleave_context surroundings = material.context;
    surroundings.isochoric = seen.data();
    const PackedParameters parameters(plugin.schema(), settings);
    context.doing("given a cleave_isochoric_response that ends before `bulk_modulus`");
    create(parameters.get(), &surroundings, false);
  }
  const Instance instance(plugin, settings);
  if (const auto* extension = static_cast<const cleave_isochoric_response_extension*>(
          plugin.table().extension(CLEAVE_EXTENSION_ISOCHORIC_RESPONSE))) {
    cleave_isochoric_response response{};
    response.struct_size = offsetof(cleave_isochoric_response, bulk_modulus);
    const Truncated seen(response, response.struct_size);
    context.doing("asked for a cleave_isochoric_response that ends before `bulk_modulus`");
    extension->response(instance.handle(), seen.data());
  }
  if (plugin.kind() == damage_kind) {
    const auto& table = *static_cast<const cleave_damage*>(plugin.kind_table());
    cleave_damage_model model{};
    model.struct_size = offsetof(cleave_damage_model, residual);
    const Truncated seen(model, model.struct_size);
    context.doing("given a cleave_damage_model that ends before `residual`");
    table.model(instance.handle(), seen.data());
  }
  if (!(plugin.kind() & batch_kinds)) return;
  Random random(context.seed());
  for (const auto precision : precisions(plugin))
    for (const auto& measure : measures(instance)) {
      const Request request = random_request(instance, random, 20, measure);
      context.doing("given a layout whose table ends with the last field in use");
      Placement short_table;
      short_table.short_field_table = true;
      const Answer expected = evaluated(instance, precision, request);
      const Answer answer = evaluated(instance, precision, request, short_table);
      if (const auto where = first_difference(expected, answer); !where.empty())
        context.fail("a layout of fewer fields changes " + where);

      context.doing("given a larger cleave_batch and cleave_layout");
      PreparedCall call(instance, precision, request);
      Enlarged layout(*call.batch().layout);
      Enlarged batch(call.batch());
      call.batch().layout = batch.known.layout = &layout.known;
      const std::uint32_t size = batch.known.struct_size;
      call.batch() = batch.known;
      call.batch().struct_size = size;
      if (call.call() != CLEAVE_OK) context.fail("refuses a larger cleave_batch and cleave_layout");
      if (const auto where = first_difference(expected, call.answer()); !where.empty())
        context.fail("a larger cleave_layout changes " + where);
    }
}

void unknown_names(Context& context) {
  const Plugin& plugin = context.plugin();
  for (const char* name : {"cleave.elasticity/99", "cleave.nothing/1", "org.nobody.anything/1", "elasticity", ""}) {
    context.doing("asked for \"" + std::string(name) + "\"");
    if (plugin.table().kind(name)) context.fail("kind(\"" + std::string(name) + "\") is not null");
    if (plugin.table().extension(name)) context.fail("extension(\"" + std::string(name) + "\") is not null");
  }
}

void scan_time(Context& context) {
  double best = 1e9;
  for (int i = 0; i < 5 && best > 0.1; ++i) {
    const auto begin = std::chrono::steady_clock::now();
    {
      const Plugin plugin(context.library());
      manifest::manifest(plugin.table(), 0);
    }
    best = std::min(best, std::chrono::duration<double>(std::chrono::steady_clock::now() - begin).count());
  }
  if (best > 0.1) context.fail("loading and reading what it says takes " + std::to_string(int(best * 1000)) + " ms");
}

void cycles(Context& context) {
  const Settings settings = context.settings().front();
  constexpr int rounds = 100;
  // A leak is memory that grows with every round, past what libraries set aside at first and now and then.
  const auto growth = [&](auto round) {
    std::size_t least = std::size_t(-1);
    for (int repetition = 0; repetition < 3 && least >= 8; ++repetition) {
      for (int i = 0; i < 10; ++i) round();
      const auto before = mallinfo2().uordblks + mallinfo2().hblkhd;
      for (int i = 0; i < rounds; ++i) round();
      const auto after = mallinfo2().uordblks + mallinfo2().hblkhd;
      least = std::min<std::size_t>(least, after > before ? (after - before) / rounds : 0);
    }
    return least;
  };
  context.doing("creating and destroying instances");
  if (const auto bytes = growth([&] { const Instance instance(context.plugin(), settings); }); bytes >= 8)
    context.fail("create() and destroy() leave " + std::to_string(bytes) + " bytes behind each time");
  context.plugin().table().destroy(nullptr);

  context.doing("loading and unloading");
  const auto load = [&] {
    const Plugin plugin(context.library());
    const Instance instance(plugin, settings);
  };
  context.close();
  if (const auto bytes = growth(load); bytes >= 8)
    context.fail("loading and unloading leaves " + std::to_string(bytes) + " bytes behind each time");
}

/// Lines that say something.
std::vector<std::string> statements(const std::string& text) {
  std::vector<std::string> all;
  std::istringstream in(text);
  for (std::string line; std::getline(in, line);)
    if (!line.empty() && line[0] != '#') all.push_back(line);
  return all;
}

void manifest_agrees(Context& context) {
  const auto& library = context.library();
  std::filesystem::path path = std::filesystem::path(library).replace_extension(".cleave.toml");
  std::uintmax_t bytes = std::filesystem::file_size(library);
  const auto directory = std::filesystem::absolute(library).parent_path();
  if (!std::filesystem::exists(path) && directory.filename().string().rfind("x86-64-v", 0) == 0) {
    // A variant for newer processors shares the manifest of the library one directory up.
    path = directory.parent_path() / path.filename();
    bytes = std::filesystem::file_size(directory.parent_path() / library.filename());
  }
  std::ifstream file(path, std::ios::binary);
  if (!file) context.skip("there is no manifest " + path.string() + ", the host asks the library itself");
  const auto written = statements(std::string((std::istreambuf_iterator<char>(file)), {}));
  const auto said = statements(manifest::manifest(context.plugin().table(), bytes));
  for (std::size_t i = 0; i < std::max(written.size(), said.size()); ++i) {
    const std::string is = i < written.size() ? written[i] : "nothing", should = i < said.size() ? said[i] : "nothing";
    // The least minor version it works with, at most what was agreed on.
    const cleave_version agreed = context.plugin().table().abi;
    unsigned major = 0, minor = 0;
    if (std::sscanf(is.c_str(), "abi = [%u, %u]", &major, &minor) == 2 && major == agreed.major && minor <= agreed.minor)
      continue;
    if (is != should) context.fail("the manifest says `" + is + "`, the plugin `" + should + "`");
  }
}

}  // namespace

std::vector<Check> loading_checks() {
  return {
      {"abi.loads", 1, "It loads with immediate binding, agrees on the ABI and describes itself: nothing is undefined.",
       all_kinds, loads},
      {"abi.exports-entry-only", 2, "It exports the entry point and no other symbol.", all_kinds, exports_entry_only},
      {"abi.negotiates-version", 3,
       "A newer minor version of the host is negotiated down or refused; another major version is refused at once.", all_kinds,
       negotiates_version},
      {"abi.struct-sizes", 4, "Shorter and longer structs than it knows cause no access out of range.", all_kinds,
       struct_sizes},
      {"abi.unknown-names", 5, "Unknown kinds and unknown extensions are null.", all_kinds, unknown_names},
      {"abi.scan-time", 6, "Loading it and reading what it says takes less than 100 ms.", all_kinds, scan_time},
      {"abi.cycles", 7, "A hundred rounds of create and destroy, and of load and unload, leave nothing behind.", all_kinds,
       cycles},
      {"abi.manifest", 8, "The manifest beside the library says what the loaded plugin says.", all_kinds, manifest_agrees},
  };
}

}  // namespace cleave::testkit
