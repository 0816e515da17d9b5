#include <cleave/testkit/runner.hpp>

#include <algorithm>
#include <cstdio>
#include <sstream>

namespace cleave::testkit {
namespace {

const char* word(Verdict verdict) {
  switch (verdict) {
    case Verdict::passed:
      return "passed";
    case Verdict::failed:
      return "FAILED";
    case Verdict::skipped:
      break;
  }
  return "skipped";
}

std::string json(const std::string& text) {
  std::string result = "\"";
  for (const char c : text) {
    char escape[8];
    if (c == '"' || c == '\\') {
      result += '\\';
      result += c;
    } else if (static_cast<unsigned char>(c) < 0x20) {
      std::snprintf(escape, sizeof escape, "\\u%04x", unsigned(static_cast<unsigned char>(c)));
      result += escape;
    } else {
      result += c;
    }
  }
  return result + '"';
}

std::string xml(const std::string& text) {
  std::string result;
  for (const char c : text) {
    if (c == '&')
      result += "&amp;";
    else if (c == '<')
      result += "&lt;";
    else if (c == '>')
      result += "&gt;";
    else if (c == '"')
      result += "&quot;";
    else
      result += static_cast<unsigned char>(c) < 0x20 ? ' ' : c;
  }
  return result;
}

std::string seconds(double value) {
  char text[32];
  std::snprintf(text, sizeof text, "%.3f", value);
  return text;
}

std::string padded(std::string text, std::size_t width) {
  text.resize(std::max(text.size(), width), ' ');
  return text;
}

std::size_t id_width() {
  std::size_t width = 0;
  for (const Check& check : all_checks()) width = std::max(width, std::string(check.id).size());
  return width;
}

int count(const Report& report, Verdict verdict) {
  return int(
      std::count_if(report.results.begin(), report.results.end(), [&](const Result& r) { return r.verdict == verdict; }));
}

std::string title(const Report& report) { return report.id.empty() ? report.library.string() : report.id; }

}  // namespace

std::string to_table(const Report& report) {
  std::ostringstream out;
  out << title(report) << " (" << report.library.string() << ")\n";
  for (const Result& result : report.results) {
    out << "  " << padded(result.check->id, id_width()) << "  " << word(result.verdict);
    if (!result.reason.empty()) out << ": " << result.reason;
    if (!result.remark.empty()) out << ": " << result.remark;
    if (!result.reproduction.empty()) out << "; again with: " << result.reproduction;
    out << '\n';
  }
  out << "  " << count(report, Verdict::passed) << " passed, " << count(report, Verdict::failed) << " failed, "
      << count(report, Verdict::skipped) << " skipped\n";
  return out.str();
}

std::string to_json(const std::vector<Report>& reports) {
  std::ostringstream out;
  out << "[";
  for (const Report& report : reports) {
    out << (&report == reports.data() ? "\n" : ",\n") << "{\"plugin\": " << json(report.id)
        << ", \"library\": " << json(report.library.string()) << ", \"passed\": " << (report.passed() ? "true" : "false")
        << ", \"checks\": [";
    for (const Result& result : report.results) {
      const std::string verdict = result.verdict == Verdict::failed ? "failed" : word(result.verdict);
      out << (&result == report.results.data() ? "\n" : ",\n") << "  {\"id\": " << json(result.check->id)
          << ", \"verdict\": " << json(verdict) << ", \"seconds\": " << seconds(result.seconds);
      if (!result.reason.empty()) out << ", \"reason\": " << json(result.reason);
      if (!result.remark.empty()) out << ", \"remark\": " << json(result.remark);
      if (!result.reproduction.empty()) out << ", \"reproduction\": " << json(result.reproduction);
      out << "}";
    }
    out << "]}";
  }
  out << "\n]\n";
  return out.str();
}

std::string to_junit(const std::vector<Report>& reports) {
  std::ostringstream out;
  out << "<?xml version=\"1.0\" encoding=\"UTF-8\"?>\n<testsuites>\n";
  for (const Report& report : reports) {
    const std::string suite = xml(title(report));
    out << "  <testsuite name=\"" << suite << "\" tests=\"" << report.results.size() << "\" failures=\""
        << count(report, Verdict::failed) << "\" skipped=\"" << count(report, Verdict::skipped) << "\">\n";
    for (const Result& result : report.results) {
      out << "    <testcase classname=\"" << suite << "\" name=\"" << result.check->id << "\" time=\""
          << seconds(result.seconds) << "\"";
      if (result.verdict == Verdict::passed) {
        if (result.remark.empty())
          out << "/>\n";
        else
          out << "><system-out>" << xml(result.remark) << "</system-out></testcase>\n";
        continue;
      }
      const char* tag = result.verdict == Verdict::failed ? "failure" : "skipped";
      out << "><" << tag << " message=\"" << xml(result.reason) << "\"";
      if (result.reproduction.empty())
        out << "/>";
      else
        out << ">" << xml(result.reproduction) << "</" << tag << ">";
      out << "</testcase>\n";
    }
    out << "  </testsuite>\n";
  }
  out << "</testsuites>\n";
  return out.str();
}

std::string list_checks() {
  std::ostringstream out;
  for (const Check& check : all_checks())
    out << padded(check.id, id_width()) << "  " << check.sentence
        << (check.kinds == all_kinds ? "" : " [" + kinds_text(check.kinds) + "]") << '\n';
  return out.str();
}

std::string checks_markdown() {
  std::ostringstream out;
  out << "| | check | requirement | kinds |\n|---|---|---|---|\n";
  for (const Check& check : all_checks())
    out << "| " << check.number << " | `" << check.id << "` | " << check.sentence << " | " << kinds_text(check.kinds) << " |\n";
  return out.str();
}

}  // namespace cleave::testkit
