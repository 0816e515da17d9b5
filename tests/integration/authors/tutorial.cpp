#include "tutorial.hpp"

#include <cstdio>
#include <fstream>
#include <sstream>
#include <string_view>

namespace cleave::test {
namespace {

std::vector<std::string> lines_of(const std::string& text) {
  std::vector<std::string> lines;
  std::istringstream in(text);
  for (std::string line; std::getline(in, line);) {
    line.erase(line.find_last_not_of(" \r") + 1);
    lines.push_back(line);
  }
  return lines;
}

std::string value_in(const std::string& info, const std::string& key) {
  std::istringstream words(info);
  for (std::string word; words >> word;)
    if (word.starts_with(key + "=")) return word.substr(key.size() + 1);
  return "";
}

std::vector<std::string> words_of(const std::string& list) {
  std::vector<std::string> words;
  std::istringstream in(list);
  for (std::string word; std::getline(in, word, ',');) words.push_back(word);
  return words;
}

/// Pieces of a line between its `...` have to occur in this order, the first and the last at its ends.
bool line_matches(const std::string& pattern, const std::string& line) {
  std::size_t at = 0, from = 0;
  for (auto gap = pattern.find("..."); gap != std::string::npos; gap = pattern.find("...", from)) {
    const std::string piece = pattern.substr(from, gap - from);
    const auto found = from == 0 ? (line.starts_with(piece) ? 0 : std::string::npos) : line.find(piece, at);
    if (found == std::string::npos) return false;
    at = found + piece.size();
    from = gap + 3;
  }
  const std::string last = pattern.substr(from);
  return from == 0 ? line == last : line.size() >= at + last.size() && line.ends_with(last);
}

bool matches_from(const std::vector<std::string>& expected, std::size_t e, const std::vector<std::string>& lines,
                  std::size_t l) {
  for (; e < expected.size(); ++e, ++l) {
    if (expected[e] == "...") {
      for (std::size_t skip = l; skip <= lines.size(); ++skip)
        if (matches_from(expected, e + 1, lines, skip)) return true;
      return false;
    }
    if (l == lines.size() || !line_matches(expected[e], lines[l])) return false;
  }
  return l == lines.size();
}

std::string joined(const std::vector<std::string>& lines) {
  std::string text;
  for (const auto& line : lines) text += "    " + line + "\n";
  return text;
}

constexpr char mark = '\x1e';

std::string script_of(const std::vector<Step>& steps, const std::string& environment) {
  std::string script = "exec 2>&1 </dev/null\n" + environment + "\nroot=$PWD\n";
  for (const Step& step : steps) {
    if (const auto* file = std::get_if<File>(&step)) {
      script += "mkdir -p \"$root/$(dirname '" + file->name + "')\"\ncat >\"$root/" + file->name + "\" <<'END OF FILE'\n" +
                file->text + "END OF FILE\n";
    } else {
      script += "printf '\\036'\n" + std::get<Command>(step).text + "\nprintf '\\036%d\\036' $?\n";
    }
  }
  return script;
}

}  // namespace

bool matches(const std::vector<std::string>& expected, const std::vector<std::string>& lines) {
  return matches_from(expected, 0, lines, 0);
}

std::vector<Step> steps_of(const std::string& page) {
  std::vector<Step> steps;
  std::string language, info;
  bool inside = false;
  int number = 0;
  std::istringstream in(page);
  for (std::string line; std::getline(in, line);) {
    ++number;
    if (line.starts_with("```")) {
      inside = !inside;
      info = line.substr(3);
      language = info.substr(0, info.find(' '));
      if (const auto name = value_in(info, "file"); inside && !name.empty()) steps.push_back(File{name, ""});
    } else if (inside && !value_in(info, "file").empty()) {
      std::get<File>(steps.back()).text += line + "\n";
    } else if (inside && language == "console") {
      const auto status = value_in(info, "status");
      if (line.starts_with("$ ")) {
        steps.push_back(
            Command{number, status.empty() ? 0 : std::stoi(status), line.substr(2), {}, words_of(value_in(info, "needs"))});
      } else if (auto& command = std::get<Command>(steps.back()); line.starts_with("> ") && command.output.empty()) {
        command.text += "\n" + line.substr(2);
      } else {
        command.output.push_back(lines_of(line + "\n").front());
      }
    }
  }
  return steps;
}

std::set<std::string> leave_out(std::vector<Step>& steps, bool (*is_there)(const std::string& program)) {
  std::set<std::string> absent;
  std::erase_if(steps, [&](const Step& step) {
    const auto* command = std::get_if<Command>(&step);
    bool left_out = false;
    for (const std::string& program : command ? command->needs : std::vector<std::string>()) {
      if (is_there(program)) continue;
      absent.insert(program);
      left_out = true;
    }
    return left_out;
  });
  return absent;
}

std::string do_steps(const std::vector<Step>& steps, const std::string& directory, const std::string& environment) {
  const std::string script = directory + ".sh";
  std::ofstream(script) << script_of(steps, environment);
  FILE* pipe = popen(("cd '" + directory + "' && bash '" + script + "'").c_str(), "r");
  if (!pipe) return "bash cannot be started";
  std::string all;
  char buffer[4096];
  while (const std::size_t n = std::fread(buffer, 1, sizeof buffer, pipe)) all.append(buffer, n);
  pclose(pipe);

  // Before the first command, then its output, its status, what lies between, and so on.
  std::vector<std::string> parts(1);
  for (const char c : all)
    if (c == mark)
      parts.emplace_back();
    else
      parts.back() += c;
  std::string problems;
  std::size_t part = 1;
  for (const Step& step : steps) {
    const auto* command = std::get_if<Command>(&step);
    if (!command) continue;
    const std::string place = "line " + std::to_string(command->line) + ": " + command->text + "\n";
    if (part + 1 >= parts.size()) return problems + place + "  did not end\n" + joined(lines_of(parts.back()));
    const auto lines = lines_of(parts[part]);
    const int status = std::stoi(parts[part + 1]);
    part += 3;
    if (status != command->status)
      problems += place + "  ended with status " + std::to_string(status) + "\n" + joined(lines);
    else if (!matches(command->output, lines))
      problems += place + "  is said to print\n" + joined(command->output) + "  and prints\n" + joined(lines);
  }
  return problems;
}

}  // namespace cleave::test
