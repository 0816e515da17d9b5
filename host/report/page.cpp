#include "report/page.hpp"

#include "common/error.hpp"
#include "report/assets.hpp"
#include "report/points.hpp"

#include <nlohmann/json.hpp>

#include <algorithm>
#include <charconv>
#include <cmath>
#include <fstream>
#include <iterator>
#include <optional>
#include <sstream>

namespace cleave::report {
namespace {

namespace fs = std::filesystem;
using nlohmann::json;

std::optional<std::string> contents(const fs::path& file) {
  std::ifstream in(file, std::ios::binary);
  if (!in) return std::nullopt;
  return std::string{std::istreambuf_iterator<char>(in), {}};
}

json text_or_null(const fs::path& file) {
  const auto text = contents(file);
  return text ? json(*text) : json();
}

std::vector<std::string> cells_of(const std::string& line) {
  std::vector<std::string> cells{""};
  bool quoted = false;
  for (const char c : line)
    if (c == '"')
      quoted = !quoted;
    else if (c == ',' && !quoted)
      cells.emplace_back();
    else
      cells.back() += c;
  return cells;
}

/// Numbers as numbers, what is not finite as null, words as they are.
json value_of(const std::string& cell) {
  double number = 0;
  const auto [end, error] = std::from_chars(cell.data(), cell.data() + cell.size(), number);
  if (error != std::errc() || end != cell.data() + cell.size()) return cell;
  return std::isfinite(number) ? json(number) : json();
}

/// A list for each column. A last row that is still being written is left out.
json columns_of(const std::string& table) {
  json columns = json::object();
  std::istringstream lines(table);
  std::string line;
  std::getline(lines, line);
  const auto names = cells_of(line);
  for (const auto& name : names) columns[name] = json::array();
  while (std::getline(lines, line)) {
    const auto cells = cells_of(line);
    if (lines.eof() || cells.size() != names.size()) continue;
    for (std::size_t c = 0; c < names.size(); c++) columns[names[c]].push_back(value_of(cells[c]));
  }
  return columns;
}

/// Of the folders that pictures may be in, those of the first that has any, evenly chosen if there are too many.
json pictures_of(const fs::path& run, double megabytes) {
  std::vector<fs::path> files;
  for (const char* folder : {"pictures", "preview"}) {
    std::error_code error;
    fs::directory_iterator entries(run / folder, error);
    for (; !error && entries != fs::directory_iterator(); entries.increment(error))
      if (entries->path().extension() == ".png") files.push_back(entries->path());
    if (!files.empty()) break;
  }
  std::sort(files.begin(), files.end());
  double bytes = 0;
  std::vector<std::string> pngs;
  for (const fs::path& file : files) {
    pngs.push_back(contents(file).value_or(""));
    bytes += double(pngs.back().size());
  }
  const std::size_t most = bytes > 0 ? std::size_t(std::max(1., megabytes * 1e6 / bytes * double(pngs.size()))) : 0;
  json pictures = json::array();
  for (std::size_t i = 0; i < std::min(most, pngs.size()); i++) {
    const std::size_t at = pngs.size() <= most || most < 2 ? i : i * (pngs.size() - 1) / (most - 1);
    if (pngs[at].starts_with("\x89PNG"))
      pictures.push_back({{"name", files[at].stem().string()}, {"data", base64(std::as_bytes(std::span(pngs[at])))}});
  }
  return pictures;
}

void replace(std::string& text, const std::string& what, const std::string& with) {
  const std::size_t at = text.find(what);
  text.replace(at, what.size(), with);
}

std::string escaped(const std::string& text) {
  std::string result;
  for (const char c : text) result += c == '&' ? "&amp;" : c == '<' ? "&lt;" : c == '>' ? "&gt;" : std::string(1, c);
  return result;
}

}  // namespace

std::string page(const fs::path& run, const Limits& limits) {
  const auto table = contents(run / "frames.csv");
  if (!table || !table->starts_with("frame,time,"))
    throw InputError("error: " + run.string() + " has no frames.csv: give a directory that `cleave run` has written");
  json data;
  const auto summary = contents(run / "summary.json");
  data["summary"] = summary ? json::parse(*summary, nullptr, false) : json();
  if (data["summary"].is_discarded()) throw InputError("error: " + (run / "summary.json").string() + " is not JSON");
  const bool ended = data["summary"].is_object();
  data["state"] = ended ? data["summary"].value("status", "done") : "running";
  data["failure"] = ended && data["state"] == "failed" ? text_or_null(run / "failure.txt") : json();
  data["scene"] = text_or_null(run / "scene.toml");
  data["table"] = columns_of(*table);
  data["points"] = points_of(run, limits);
  data["pictures"] = pictures_of(run, limits.pictures);
  std::string title = fs::weakly_canonical(run).filename().string();
  if (ended && data["summary"].contains("scene"))
    if (const auto scene = fs::path(data["summary"].value("scene", "")).stem().string(); scene != "scene" && !scene.empty())
      title = scene;
  data["title"] = title;
  data["directory"] = fs::absolute(run).lexically_normal().string();

  // Within a script "</" could end it, and "<!--" start a comment.
  std::string text = data.dump(-1, ' ', false, json::error_handler_t::replace);
  std::string inside;
  inside.reserve(text.size());
  for (const char c : text) inside += c == '<' ? "\\u003c" : std::string(1, c);
  std::string html = assets::report_html;
  replace(html, "<!--title-->", escaped(title));
  replace(html, "/*style*/", assets::report_css);
  replace(html, "/*charts*/", assets::charts_js);
  replace(html, "/*viewer*/", assets::viewer_js);
  replace(html, "<!--data-->", inside);
  return html;
}

}  // namespace cleave::report
