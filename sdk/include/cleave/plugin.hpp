/// CLEAVE_PLUGIN(Law) makes a plugin of a law: the one exported symbol, the version check, the description, and the creation
/// of instances from the scene's parameters. No exception leaves the plugin. Included by the header of each plugin kind.
#ifndef CLEAVE_PLUGIN_HPP
#define CLEAVE_PLUGIN_HPP

#include <cleave/about.hpp>
#include <cleave/detail/schema.hpp>
#include <cleave/parameters.hpp>

#include <exception>
#include <memory>

namespace cleave::detail {

/// What is particular to a kind; specialised in <cleave/elasticity.hpp> and its siblings:
///   struct Instance { Law law; ... };           what an instance holds
///   static void prepare(Instance&, const cleave_context*)   before the law's parameters are filled; may throw
///   static constexpr std::uint64_t capabilities
///   static const char* id();  static const void* table();   "cleave.elasticity/1" and the table behind it
///   static const void* extension(const char*)
template <Kind kind, class Law>
struct KindOf;

/// Runs `action`; an exception becomes a result and a message.
template <class Action>
cleave_result guarded(cleave_message* message, Action action) noexcept {
  try {
    return action();
  } catch (const ParameterError& error) {
    write_message(message, error.key, error.text);
    return CLEAVE_ERROR_PARAMETER;
  } catch (const UnsupportedError& error) {
    write_message(message, "", error.text);
    return CLEAVE_ERROR_UNSUPPORTED;
  } catch (const std::exception& error) {
    write_message(message, "", error.what());
    return CLEAVE_ERROR_INTERNAL;
  } catch (...) {
    write_message(message, "", "an unknown exception");
    return CLEAVE_ERROR_INTERNAL;
  }
}

template <class Law>
struct PluginOf {
  static constexpr Kind kind = kind_of(Law::about.id);
  static_assert(kind != Kind::unknown, "about.id must be \"kind/name\" with one of Cleave's kinds");
  using Table = KindOf<kind, Law>;
  using Instance = typename Table::Instance;

  static const Schema& schema() {
    static const Schema schema(std::type_identity<Law>{}, Table::capabilities);
    return schema;
  }

  static cleave_result create(const cleave_parameters* parameters, const cleave_context* context, cleave_instance** instance,
                              cleave_message* message) noexcept {
    if (!instance) return CLEAVE_ERROR_INTERNAL;
    *instance = nullptr;
    return guarded(message, [&]() -> cleave_result {
      Surroundings surroundings;
      if (context) {
        surroundings.dimension = int(context->dimension);
        surroundings.cell_size = context->cell_size;
        surroundings.density = context->density;
        if (CLEAVE_HAS(cleave_context, context, elastic)) surroundings.elastic = ElasticProbe(context->elastic);
      }
      auto created = std::make_unique<Instance>();
      Table::prepare(*created, context);
      fill(created->law, Values(schema(), parameters), surroundings);
      *instance = reinterpret_cast<cleave_instance*>(created.release());
      return CLEAVE_OK;
    });
  }
  static void destroy(cleave_instance* instance) noexcept { delete reinterpret_cast<Instance*>(instance); }

  static constexpr bool has_initial_state = requires(const Law& law) { law.initial_state(); };
  static void initial_state(const cleave_instance* instance, double* values) noexcept {
    if constexpr (has_initial_state) {
      const auto initial = reinterpret_cast<const Instance*>(instance)->law.initial_state();
      static_assert(std::tuple_size_v<std::remove_const_t<decltype(initial)>> == state_count<Law>(),
                    "initial_state() returns one number for every state component");
      std::copy(initial.begin(), initial.end(), values);
    }
  }

  static const void* kind_table(const char* id) noexcept {
    return id && std::strcmp(id, Table::id()) == 0 ? Table::table() : nullptr;
  }
  static const void* extension(const char* id) noexcept { return id ? Table::extension(id) : nullptr; }

  static cleave_result entry(const cleave_host* host, const cleave_plugin** plugin) noexcept {
    if (!host || !plugin || !CLEAVE_HAS(cleave_host, host, abi)) return CLEAVE_ERROR_ABI;
    if (host->abi.major != CLEAVE_ABI_MAJOR) return CLEAVE_ERROR_ABI;
    return guarded(nullptr, [&]() -> cleave_result {
      static_assert(state_count<Law>() <= int(CLEAVE_MAX_STATE));
      static const cleave_about about{sizeof(cleave_about), Law::about.id,     Law::about.version, Law::about.author,
                                      Law::about.summary,   Law::about.source, Law::about.budget};
      // One host per process: the minor version agreed on with the first caller holds.
      static const cleave_plugin table{sizeof(cleave_plugin),
                                       {CLEAVE_ABI_MAJOR, std::min<std::uint32_t>(CLEAVE_ABI_MINOR, host->abi.minor)},
                                       &about,
                                       &schema().abi(),
                                       &kind_table,
                                       &extension,
                                       &create,
                                       &destroy,
                                       has_initial_state ? &initial_state : nullptr};
      *plugin = &table;
      return CLEAVE_OK;
    });
  }
};

}  // namespace cleave::detail

/// Once per library, outside any namespace.
#define CLEAVE_PLUGIN(Law)                                                                                            \
  extern "C" CLEAVE_EXPORT cleave_result cleave_plugin_entry(const cleave_host* host, const cleave_plugin** plugin) { \
    return cleave::detail::PluginOf<Law>::entry(host, plugin);                                                        \
  }

#endif
