#include "app/command_line.hpp"

#include <cleave/abi.h>
#include <fmt/format.h>
#include <fmt/ranges.h>
#include <tbb/global_control.h>
#include <tbb/version.h>
#include <zlib.h>

#include <Eigen/Core>
#include <algorithm>
#include <boost/version.hpp>
#include <cctype>
#include <vector>

namespace cleave::app {
namespace {

/// Commands and options a person is shown: those without a group are for scripts.
std::vector<const CLI::App*> commands(const CLI::App& app) {
  auto all = app.get_subcommands([](const CLI::App* command) { return !command->get_group().empty(); });
  return {all.begin(), all.end()};
}

std::vector<const CLI::Option*> options(const CLI::App& app) {
  std::vector<const CLI::Option*> all;
  for (const CLI::Option* option : app.get_options())
    if (!option->get_group().empty()) all.push_back(option);
  return all;
}

bool takes_a_value(const CLI::Option& option) { return option.get_type_size_max() > 0 && option.get_items_expected_max() > 0; }

std::vector<std::string> names(const CLI::Option& option) {
  std::vector<std::string> all;
  for (const std::string& name : option.get_snames()) all.push_back("-" + name);
  for (const std::string& name : option.get_lnames()) all.push_back("--" + name);
  return all;
}

/// The values of an option that lists them: its type reads TYPE:{a,b,c}.
std::vector<std::string> listed_values(const CLI::Option& option) {
  const std::string type = option.get_type_name();
  const auto open = type.find('{'), close = type.find('}');
  std::vector<std::string> values;
  if (open == std::string::npos || close == std::string::npos || close < open) return values;
  for (std::size_t start = open + 1; start <= close;) {
    const std::size_t end = std::min(type.find(',', start), close);
    values.push_back(type.substr(start, end - start));
    start = end + 1;
  }
  return values;
}

/// What stands for a value in a synopsis: the name of its type, without its bounds.
std::string placeholder(const CLI::Option& option) {
  const std::string type = option.get_type_name();
  std::string word = type.substr(0, type.find_first_of(" :["));
  if (word.empty() || word == "TEXT") word = "VALUE";
  if (word == "INT" || word == "UINT") word = "N";
  if (word == "FLOAT") word = "X";
  return word;
}

std::string path_of(const CLI::App& app) {
  std::string path;
  for (const CLI::App* a = &app; a->get_parent(); a = a->get_parent())
    path = path.empty() ? a->get_name() : a->get_name() + " " + path;
  return path;
}

/// visit(command, path) for the program itself and all its commands.
template <class Visit>
void each_command(const CLI::App& app, const Visit& visit) {
  visit(app, path_of(app));
  for (const CLI::App* command : commands(app)) each_command(*command, visit);
}

bool names_plugins(const CLI::App& app) {
  const auto all = options(app);
  return std::any_of(all.begin(), all.end(),
                     [](const CLI::Option* o) { return o->get_positional() && o->get_type_name() == "PLUGIN"; });
}

constexpr const char* listed_plugins = "command cleave plugins 2>/dev/null | cut -d' ' -f1 | grep /";

std::string roff(const std::string& text) {
  std::string escaped;
  for (const char c : text) {
    if (c == '\\')
      escaped += "\\e";
    else if (c == '-')
      escaped += "\\-";
    else if (c == '\'')
      escaped += "\\(aq";
    else if (c == '.' && (escaped.empty() || escaped.back() == '\n'))
      escaped += "\\&.";
    else
      escaped += c;
  }
  return escaped;
}

std::string roff_options(const CLI::App& app) {
  std::string page;
  for (const CLI::Option* option : options(app)) {
    if (option->get_positional() && names(*option).empty()) {
      page += fmt::format(".TP\n\\fI{}\\fR\n{}\n", roff(option->get_name(true)), roff(option->get_description()));
      continue;
    }
    std::string heading;
    for (const std::string& name : names(*option)) heading += (heading.empty() ? "\\fB" : ", \\fB") + roff(name) + "\\fR";
    if (takes_a_value(*option)) {
      const auto values = listed_values(*option);
      heading += " \\fI" + roff(values.empty() ? placeholder(*option) : fmt::format("{}", fmt::join(values, "|"))) + "\\fR";
    }
    page += ".TP\n" + heading + "\n" + roff(option->get_description()) + "\n";
  }
  return page;
}

std::string usage(const CLI::App& app) {
  std::string line = "\\fBcleave " + path_of(app) + "\\fR";
  if (!commands(app).empty()) return line + " \\fICOMMAND\\fR";
  line += " [\\fIOPTIONS\\fR]";
  for (const CLI::Option* option : options(app)) {
    if (!option->get_positional()) continue;
    const std::string name = roff(option->get_name(true));
    const std::string more = option->get_items_expected_max() > 1 ? "..." : "";
    line += option->get_required() ? fmt::format(" \\fI{}\\fR{}", name, more) : fmt::format(" [\\fI{}\\fR{}]", name, more);
  }
  return line;
}

}  // namespace

std::string build_facts() {
  return fmt::format(
      "cleave {}\n"
      "plugin ABI  {}.{}\n"
      "compiler    {} {}\n"
      "build       {}\n"
      "kernels     {}\n"
      "libraries   Eigen {}.{}.{}, Boost {}.{}.{}, OpenVDB {}, oneTBB {}.{}, zlib {}\n"
      "licence     MIT",
      CLEAVE_VERSION, CLEAVE_ABI_MAJOR, CLEAVE_ABI_MINOR,
#if defined(__clang__)
      "clang", __clang_version__,
#else
      "g++", __VERSION__,
#endif
      CLEAVE_BUILD_FLAGS, "x86-64-v2, x86-64-v3, x86-64-v4", EIGEN_WORLD_VERSION, EIGEN_MAJOR_VERSION, EIGEN_MINOR_VERSION,
      BOOST_VERSION / 100000, BOOST_VERSION / 100 % 1000, BOOST_VERSION % 100, CLEAVE_OPENVDB_VERSION, TBB_VERSION_MAJOR,
      TBB_VERSION_MINOR, zlibVersion());
}

std::string bash_completion(const CLI::App& program) {
  std::string all_commands, words, values;
  each_command(program, [&](const CLI::App& app, const std::string& path) {
    std::vector<std::string> offered;
    for (const CLI::App* command : commands(app)) offered.push_back(command->get_name());
    if (!path.empty()) all_commands += fmt::format("      '{}') path=$candidate ;;\n", path);
    std::vector<std::string> flags;
    for (const CLI::Option* option : options(app)) {
      const auto spelled = names(*option);
      flags.insert(flags.end(), spelled.begin(), spelled.end());
      if (spelled.empty() || !takes_a_value(*option)) {
        if (option->get_positional() && spelled.empty())
          for (const auto& value : listed_values(*option)) offered.push_back(value);
        continue;
      }
      const auto listed = listed_values(*option);
      for (const auto& name : spelled)
        values +=
            fmt::format("    '{} {}') {}; return ;;\n", path, name,
                        listed.empty() ? "COMPREPLY=()"
                                       : fmt::format("COMPREPLY=($(compgen -W '{}' -- \"$current\"))", fmt::join(listed, " ")));
    }
    words +=
        fmt::format("    '{}') offered='{}' flags='{}'{} ;;\n", path, fmt::join(offered, " "), fmt::join(flags, " "),
                    names_plugins(app) ? fmt::format("; [[ $current == -* ]] || offered+=\" $({})\"", listed_plugins) : "");
  });
  return fmt::format(R"(# Completion of cleave for bash; zsh: autoload -U bashcompinit && bashcompinit, then source this file.
_cleave() {{
  local current=${{COMP_WORDS[COMP_CWORD]}} previous=${{COMP_WORDS[COMP_CWORD-1]}} path= candidate offered= flags= i
  COMPREPLY=()
  for ((i = 1; i < COMP_CWORD; i++)); do
    candidate=${{path:+$path }}${{COMP_WORDS[i]}}
    case $candidate in
{}    esac
  done
  case "$path $previous" in
{}  esac
  case $path in
{}  esac
  if [[ $current == -* ]]; then
    COMPREPLY=($(compgen -W "$flags" -- "$current"))
  else
    COMPREPLY=($(compgen -W "$offered" -- "$current"))
  fi
}}
complete -o default -F _cleave cleave
)",
                     all_commands, values, words);
}

std::string fish_completion(const CLI::App& program) {
  const auto quoted = [](std::string text) {
    for (std::size_t at = 0; (at = text.find('\'', at)) != std::string::npos; at += 2) text.replace(at, 1, "\\'");
    return "'" + text + "'";
  };
  std::string script = "# Completion of cleave for fish.\n";
  each_command(program, [&](const CLI::App& app, const std::string& path) {
    std::string condition = "__fish_use_subcommand";
    if (!path.empty()) {
      condition.clear();
      for (std::size_t start = 0; start <= path.size();) {
        const std::size_t end = std::min(path.find(' ', start), path.size());
        condition += (condition.empty() ? "" : "; and ") + ("__fish_seen_subcommand_from " + path.substr(start, end - start));
        start = end + 1;
      }
    }
    for (const CLI::App* command : commands(app))
      script += fmt::format("complete -c cleave -n {} -a {} -d {}\n", quoted(condition), command->get_name(),
                            quoted(command->get_description()));
    if (names_plugins(app))
      script += fmt::format("complete -c cleave -n {} -a {}\n", quoted(condition), quoted(fmt::format("({})", listed_plugins)));
    for (const CLI::Option* option : options(app)) {
      if (names(*option).empty()) continue;
      std::string line = "complete -c cleave -n " + quoted(condition);
      for (const auto& name : option->get_snames()) line += " -s " + name;
      for (const auto& name : option->get_lnames()) line += " -l " + name;
      if (takes_a_value(*option)) {
        line += " -r";
        if (const auto listed = listed_values(*option); !listed.empty())
          line += fmt::format(" -f -a {}", quoted(fmt::format("{}", fmt::join(listed, " "))));
      }
      script += line + " -d " + quoted(option->get_description()) + "\n";
    }
  });
  return script;
}

std::string manual(const CLI::App& program) {
  std::string page = fmt::format(".TH CLEAVE 1 \"\" \"cleave {}\" \"User Commands\"\n", CLEAVE_VERSION);
  page += ".SH NAME\ncleave \\- simulator of solids that tear, shatter and split, with every material law a plugin\n";
  page += ".SH SYNOPSIS\n";
  each_command(program, [&](const CLI::App& app, const std::string& path) {
    if (!path.empty() && commands(app).empty()) page += usage(app) + "\n.br\n";
  });
  page += R"(.SH DESCRIPTION
Cleave simulates fracture with the material point method, peridynamics and finite elements. A scene is a TOML file that names
material laws; every law is a shared library that is found and loaded when the scene asks for it. Quantities are in SI units.
)";
  page += ".SH OPTIONS\n" + roff_options(program);
  page += ".SH COMMANDS\n";
  each_command(program, [&](const CLI::App& app, const std::string& path) {
    if (path.empty() || !commands(app).empty()) return;
    page += fmt::format(".SS cleave {}\n{}.\n", roff(path), roff(app.get_description())) + roff_options(app);
  });
  page += R"(.SH EXIT STATUS
.TP
.B 0
done
.TP
.B 1
something else went wrong; for \fBcleave check\fR: a check failed
.TP
.B 2
bad input: the message says file, line and column and what would be right
.TP
.B 3
the simulation failed: the message says step, time, particles and plugin, and the state is in the output directory
.TP
.B 130
interrupted (SIGINT, SIGTERM): a checkpoint has been written
.SH ENVIRONMENT
.TP
.B CLEAVE_PLUGIN_PATH
directories with plugins, separated by colons, searched before those of the installation
.TP
.B CLEAVE_ISA
instruction set of kernels and plugins: x86\-64\-v2, x86\-64\-v3 or x86\-64\-v4
.SH FILES
Relative to the prefix of the installation:
.TP
.I lib/cleave/plugins
plugins that are shipped
.TP
.I share/cleave/configs
scenes and studies that are shipped
.TP
.I share/doc/cleave
documentation
.SH EXAMPLES
.nf
cleave run scene.toml \-\-out out/scene
cleave run out/scene \-\-resume
cleave plugins elasticity/qr
cleave check elasticity/qr
cleave study study.toml
.fi
)";
  return page;
}

}  // namespace cleave::app
