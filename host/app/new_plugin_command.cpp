#include "app/new_plugin_command.hpp"

#include "common/error.hpp"
#include "common/nearest.hpp"

#include <fmt/format.h>
#include <fmt/ranges.h>

#include <algorithm>
#include <array>
#include <cctype>
#include <fstream>
#include <iterator>
#include <map>
#include <string_view>
#include <utility>
#include <vector>

namespace cleave::app {
namespace {

namespace fs = std::filesystem;

using Files = std::map<std::string, std::string>;  ///< name -> text
using Tokens = std::vector<std::pair<std::string, std::string>>;

constexpr std::string_view common_folder = "common", kinds_place = "{{of this kind}}";

bool is_lower(char c) { return c >= 'a' && c <= 'z'; }
bool is_digit(char c) { return c >= '0' && c <= '9'; }
bool is_word(char c) { return std::isalnum(static_cast<unsigned char>(c)) || c == '_'; }

/// Words of lower case letters and digits, joined by single '-', that begin with a letter.
bool is_name(std::string_view name) {
  if (name.empty() || !is_lower(name.front()) || name.back() == '-' || name.find("--") != name.npos) return false;
  return std::all_of(name.begin(), name.end(), [](char c) { return is_lower(c) || is_digit(c) || c == '-'; });
}

/// What a name that cannot be used probably means: "MyLaw" and "my_law" are "my-law".
std::string usable(std::string_view wrong) {
  std::string name;
  char before = ' ';
  bool starts_word = false;
  for (const char c : wrong) {
    const bool upper = c >= 'A' && c <= 'Z';
    const char lower = upper ? char(c - 'A' + 'a') : c;
    const bool used = is_lower(lower) || (is_digit(c) && !name.empty());
    starts_word = starts_word || !used || (upper && is_lower(before));
    before = c;
    if (!used) continue;
    if (starts_word && !name.empty()) name += '-';
    name += lower;
    starts_word = false;
  }
  return name.empty() ? "my-law" : name;
}

std::string type_of(std::string_view name) {
  std::string type;
  bool starts_word = true;
  for (const char c : name) {
    if (c != '-') type += starts_word ? char(std::toupper(static_cast<unsigned char>(c))) : c;
    starts_word = c == '-';
  }
  return type;
}

std::string replaced(std::string text, const Tokens& tokens) {
  for (const auto& [token, value] : tokens)
    for (auto at = text.find(token); at != text.npos; at = text.find(token, at + value.size()))
      text.replace(at, token.size(), value);
  return text;
}

bool contains_word(std::string_view text, std::string_view word) {
  for (auto at = text.find(word); at != text.npos; at = text.find(word, at + 1)) {
    const auto end = at + word.size();
    if ((at == 0 || !is_word(text[at - 1])) && (end == text.size() || !is_word(text[end]))) return true;
  }
  return false;
}

fs::path template_folder() {
  const fs::path folder = fs::read_symlink("/proc/self/exe").parent_path().parent_path() / "share/cleave/templates";
  if (!fs::is_directory(folder / common_folder))
    throw InputError("there are no templates in " + folder.string() + ": install Cleave with its SDK");
  return folder;
}

std::vector<std::string> kinds_in(const fs::path& templates) {
  std::vector<std::string> kinds;
  for (const auto& entry : fs::directory_iterator(templates))
    if (entry.is_directory() && entry.path().filename() != common_folder) kinds.push_back(entry.path().filename());
  std::sort(kinds.begin(), kinds.end());
  return kinds;
}

Files read_folder(const fs::path& folder) {
  Files files;
  for (const auto& entry : fs::directory_iterator(folder)) {
    std::ifstream file(entry.path());
    files[entry.path().filename()] = {std::istreambuf_iterator<char>(file), {}};
    if (!file) throw InputError("cannot read " + entry.path().string());
  }
  return files;
}

/// The files of a project of this kind, tokens and all.
Files read_templates(const fs::path& templates, const std::string& kind) {
  Files files = read_folder(templates / common_folder);
  for (auto& [name, text] : read_folder(templates / kind)) {
    const auto common = files.find(name);
    if (common == files.end())
      files[name] = text;
    else
      common->second = replaced(common->second, {{std::string(kinds_place), text}});
  }
  return files;
}

/// What the name becomes in the places that the tokens stand for.
struct Names {
  std::string id, type, file;

  explicit Names(const std::string& name) : id(name), type(type_of(name)), file(name) {
    std::replace(file.begin(), file.end(), '-', '_');
  }
};

void check_name(const Names& names, const Files& templates) {
  if (!is_name(names.id))
    throw InputError(
        fmt::format("\"{}\" cannot be the name of a plugin: use lower case letters and digits, a letter first, with "
                    "single '-' between words; for example \"{}\"",
                    names.id, usable(names.id)));
  // What CMake and CTest call their own targets.
  constexpr std::array reserved{"all",     "clean",      "depend",        "edit_cache", "help",
                                "install", "preinstall", "rebuild_cache", "test"};
  const bool is_target = std::find(reserved.begin(), reserved.end(), names.file) != reserved.end();
  const bool is_type = std::any_of(templates.begin(), templates.end(), [&](const auto& file) {
    return file.first.ends_with(".cpp") && contains_word(file.second, names.type);
  });
  if (is_target || is_type)
    throw InputError(
        fmt::format("\"{0}\" has a meaning of its own in the project of a plugin; choose another name, for example "
                    "\"{0}-law\"",
                    names.id));
}

void write(const fs::path& path, const std::string& text) {
  std::ofstream file(path);
  file << text;
  if (!file.flush()) throw InputError("cannot write " + path.string());
}

}  // namespace

int new_plugin_command(const NewPluginOptions& options) {
  const fs::path templates = template_folder();
  const std::vector<std::string> kinds = kinds_in(templates);
  if (std::find(kinds.begin(), kinds.end(), options.kind) == kinds.end()) {
    const auto near = nearest(options.kind, kinds);
    throw InputError(fmt::format("there is no kind of plugin \"{}\"{}; the kinds are {}", options.kind,
                                 near ? ", did you mean \"" + *near + "\"?" : "", fmt::join(kinds, ", ")));
  }
  const Files files = read_templates(templates, options.kind);
  const Names names(options.name);
  check_name(names, files);

  const fs::path directory = options.directory.empty() ? fs::path(options.name) : options.directory;
  std::error_code error;
  if (fs::exists(directory, error) && !(fs::is_directory(directory, error) && fs::is_empty(directory, error)))
    throw InputError(directory.string() + (fs::is_directory(directory, error) ? " is not empty" : " is a file") +
                     ": name a new or empty directory with --dir");
  fs::create_directories(directory, error);
  if (error) throw InputError("cannot create " + directory.string() + ": " + error.message());

  const Tokens tokens{{"{{id}}", names.id}, {"{{Type}}", names.type}, {"{{file}}", names.file}, {"{{kind}}", options.kind}};
  fmt::print("{} is a project for {}/{}:\n", directory.string(), options.kind, options.name);
  for (const auto& [name, text] : files) {
    const std::string target = replaced(name, tokens);
    write(directory / target, replaced(text, tokens));
    fmt::print("  {}\n", target);
  }
  fmt::print("How to build, test and run it: {}\n", (directory / "README.md").string());
  return 0;
}

}  // namespace cleave::app
