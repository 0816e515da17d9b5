#include "count.hpp"

#include <fmt/format.h>
#include <toml++/toml.h>

#include <algorithm>
#include <cstdint>
#include <cstdlib>
#include <fstream>
#include <nlohmann/json.hpp>
#include <sstream>
#include <stdexcept>

namespace cleave::instructions {
namespace {

namespace fs = std::filesystem;

constexpr const char* isa = "x86-64-v3";
constexpr std::size_t listed = 10;

struct Directory {
  Directory() {
    std::string name = (fs::temp_directory_path() / "cleave-count-XXXXXX").string();
    if (!mkdtemp(name.data())) throw std::runtime_error("cannot make a directory in " + fs::temp_directory_path().string());
    path = name;
  }
  ~Directory() { fs::remove_all(path); }
  Directory(const Directory&) = delete;
  Directory& operator=(const Directory&) = delete;
  fs::path path;
};

std::string contents(const fs::path& file) {
  std::ifstream in(file);
  std::stringstream text;
  text << in.rdbuf();
  return text.str();
}

struct Run {
  double total = 0;
  std::map<std::string, double> functions;
  nlohmann::json summary;
};

/// Own costs by function. Lines that follow "calls=" are costs of what was called.
void read_profile(const fs::path& file, Run& run) {
  std::ifstream in(file);
  std::string library, function;
  bool called = false;
  for (std::string line; std::getline(in, line);) {
    if (line.starts_with("ob="))
      library = fs::path(line.substr(3)).filename();
    else if (line.starts_with("fn="))
      function = short_name(library, line.substr(3));
    else if (line.starts_with("calls="))
      called = true;
    else if (!line.empty() && (std::isdigit(line[0]) || line[0] == '+' || line[0] == '-' || line[0] == '*')) {
      const double cost = std::strtod(line.c_str() + line.find(' '), nullptr);
      if (!std::exchange(called, false)) {
        run.functions[function] += cost;
        run.total += cost;
      }
    }
  }
}

Run run(const Workload& w, int steps) {
  const Directory directory;
  const fs::path profile = directory.path / "profile", log = directory.path / "log", out = directory.path / "out";
  std::string command = fmt::format("CLEAVE_ISA={} ", isa);
  command += fmt::format(
      "valgrind --tool=callgrind --callgrind-out-file='{}' --dump-line=no --compress-strings=no --compress-pos=no "
      "'{}' run '{}' --out '{}' --steps {} --threads 1 --quiet",
      profile.string(), CLEAVE_PROGRAM, (fs::path(CLEAVE_COUNT_SOURCES) / "scenes" / w.scene).string(), out.string(), steps);
  for (const auto& s : w.sets) command += fmt::format(" --set '{}'", s);
  command += fmt::format(" >'{}' 2>&1 </dev/null", log.string());
  if (std::system(command.c_str()) != 0) throw std::runtime_error(w.name + ": " + command + "\n" + contents(log));
  Run r;
  read_profile(profile, r);
  r.summary = nlohmann::json::parse(contents(out / "summary.json"));
  if (r.summary.at("steps") != steps)
    throw std::runtime_error(fmt::format("{}: the scene ends before {} steps are done", w.name, steps));
  return r;
}

/// Without what is between brackets of any kind but braces.
std::string without_brackets(const std::string& text) {
  std::string result;
  int depth = 0;
  for (const char c : text) {
    if (c == '(' || c == '<' || c == '[') depth++;
    if (depth <= 0) result += c;
    if (c == ')' || c == '>' || c == ']') depth--;
  }
  return result;
}

std::vector<std::pair<std::string, double>> largest(const std::map<std::string, double>& functions) {
  std::vector<std::pair<std::string, double>> r(functions.begin(), functions.end());
  std::stable_sort(r.begin(), r.end(), [](const auto& a, const auto& b) { return a.second > b.second; });
  r.resize(std::min(r.size(), listed));
  return r;
}

}  // namespace

std::string short_name(const std::string& library, const std::string& function) {
  std::string name = without_brackets(function);
  for (std::size_t at; (at = name.find("::::")) != std::string::npos;) name.erase(at, 2);
  if (name.starts_with("::")) name.erase(0, 2);
  for (std::size_t at; (at = name.find(" const::")) != std::string::npos;) name.erase(at, 6);
  const auto end = name.find_last_not_of(' ');
  name.erase(end == std::string::npos ? 0 : end + 1);
  if (name.ends_with(" const")) name.erase(name.size() - 6);
  if (const auto space = name.rfind(' '); space != std::string::npos) name.erase(0, space + 1);
  return library + ": " + (name.empty() ? function : name);
}

std::string obstacle() {
  if (CLEAVE_SANITIZED) return "a build with sanitizers runs other instructions";
  if (std::string(CLEAVE_BUILD_TYPE) != "Release")
    return "only release builds are counted, this is a " CLEAVE_BUILD_TYPE " build";
#if defined(__x86_64__)
  if (!__builtin_cpu_supports("avx2") || !__builtin_cpu_supports("fma")) return "this processor has no AVX2";
#else
  return "the figures are of x86-64";
#endif
  if (std::system("valgrind --version >/dev/null 2>&1") != 0) return "valgrind is not installed (Debian: valgrind)";
  return {};
}

Count count(const Workload& w) {
  const Run shorter = run(w, first_step), longer = run(w, last_step);
  constexpr double steps = last_step - first_step;
  Count c;
  c.particles = longer.summary.at("particles");
  c.per_step = (longer.total - shorter.total) / steps;
  c.functions = longer.functions;
  for (const auto& [name, cost] : shorter.functions) c.functions[name] -= cost;
  for (auto& [name, cost] : c.functions) cost /= steps;
  c.bytes_per_particle = longer.summary.at("bytes_per_particle");
  return c;
}

const std::vector<Workload>& guarded() {
  static const std::vector<Workload> workloads = {
      {"neo_hookean_single", "neo_hookean.toml"},
      {"neo_hookean_double", "neo_hookean.toml", {"simulation.precision=double"}},
      {"fibres_anisotropic_damage_intact", "fibres_anisotropic_damage.toml"},
      {"nacc_yielding", "nacc.toml"},
      {"phase_field_implicit", "phase_field.toml"},
  };
  return workloads;
}

Figures figures_of(const Count& c) {
  Figures f;
  f.instructions = c.per_particle();
  for (const auto& [name, cost] : largest(c.functions)) f.functions[name] = cost / c.particles;
  return f;
}

std::string compiler() { return CLEAVE_COMPILER; }

fs::path record_file() { return fs::path(CLEAVE_COUNT_SOURCES) / "record.toml"; }

Record read_record() {
  const toml::table file = toml::parse_file(record_file().string());
  Record r;
  r.compiler = file["compiler"].value_or("");
  for (const auto& [name, value] : file) {
    const toml::table* workload = value.as_table();
    if (!workload) continue;
    Figures f;
    f.instructions = (*workload)["instructions"].value_or(0.0);
    if (const toml::table* functions = (*workload)["functions"].as_table())
      for (const auto& [function, cost] : *functions) f.functions[std::string(function.str())] = cost.value_or(0.0);
    r.workloads[std::string(name.str())] = f;
  }
  return r;
}

void write_record(const Record& r) {
  std::ofstream out(record_file());
  out << fmt::format(
      "# Instructions per particle and step with {}, and the functions that have most of them. Written by\n"
      "# ./dev count --record\ncompiler = \"{}\"\n",
      isa, r.compiler);
  for (const auto& [name, figures] : r.workloads) {
    out << fmt::format("\n[{}]\ninstructions = {:.1f}\n[{}.functions]\n", name, figures.instructions, name);
    for (const auto& [function, cost] : largest(figures.functions)) out << fmt::format("'{}' = {:.2f}\n", function, cost);
  }
  if (!out.flush()) throw std::runtime_error("cannot write " + record_file().string());
}

std::string comparison(const Count& c, const Figures& recorded) {
  std::string text = fmt::format("{:>10} {:>10}\n", "counted", "recorded");
  for (const auto& [name, cost] : largest(c.functions)) {
    const auto before = recorded.functions.find(name);
    text += fmt::format("{:10.2f} {:>10} {}\n", cost / c.particles,
                        before == recorded.functions.end() ? "-" : fmt::format("{:.2f}", before->second), name);
  }
  return text;
}

}  // namespace cleave::instructions
