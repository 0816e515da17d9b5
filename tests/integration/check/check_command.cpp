// `cleave check` from outside: the plugins that come with the program conform, and what it prints and returns if one does not.

#include "program.hpp"

#include <gmock/gmock.h>
#include <nlohmann/json.hpp>

#include <set>

namespace cleave::test {
namespace {

using nlohmann::ordered_json;
using testing::HasSubstr;

class Check : public Program {
 protected:
  static std::string fixture(const std::string& name) { return CLEAVE_CONFORMANCE_FIXTURES "/" + name + ".so"; }
};

/// One table for each kind, a row for each check, then the reasons of what was skipped.
std::string markdown(const ordered_json& reports) {
  std::map<std::string, std::vector<const ordered_json*>> kinds;
  for (const auto& report : reports) {
    const auto id = report["plugin"].get<std::string>();
    kinds[id.substr(0, id.find('/'))].push_back(&report);
  }
  std::ostringstream out;
  for (const std::string kind : {"elasticity", "plasticity", "damage", "constraint", "discretization"}) {
    const auto& plugins = kinds[kind];
    if (plugins.empty()) continue;
    const auto name = [&](const ordered_json& report) { return report["plugin"].get<std::string>().substr(kind.size() + 1); };
    out << "### " << kind << "\n\n| |";
    for (const auto* report : plugins) out << " " << name(*report) << " |";
    out << "\n|---|";
    for (std::size_t i = 0; i < plugins.size(); ++i) out << "---|";
    out << "\n";
    std::map<std::string, std::vector<std::string>> skipped;
    for (std::size_t row = 0; row < (*plugins.front())["checks"].size(); ++row) {
      const auto id = (*plugins.front())["checks"][row]["id"].get<std::string>();
      std::string line = "| `" + id + "` |";
      for (const auto* report : plugins) {
        const auto& check = (*report)["checks"][row];
        const auto verdict = check["verdict"].get<std::string>(), reason = check.value("reason", "");
        line += verdict == "passed" ? " ✓ |" : verdict == "failed" ? " **failed** |" : " – |";
        if (verdict == "skipped") skipped["`" + id + "`: " + reason].push_back(name(*report));
      }
      out << line << "\n";
    }
    out << "\n";
    for (const auto& [what, names] : skipped) {
      out << "- skipped " << what << " (";
      for (std::size_t i = 0; i < names.size(); ++i) out << (i ? ", " : "") << names[i];
      out << ")\n";
    }
    out << (skipped.empty() ? "" : "\n");
  }
  return out.str();
}

// CLEAVE_UPDATE_DOCS=1 writes the tables.
TEST_F(Check, ShippedPluginsConformAsThePageSays) {
  const Outcome run = cleave("check --all --json");
  const auto reports = ordered_json::parse(run.out);
  EXPECT_EQ(run.status, 0) << run.err;
  std::set<std::string> kinds;
  for (const auto& report : reports) {
    const auto id = report["plugin"].get<std::string>();
    kinds.insert(id.substr(0, id.find('/')));
    for (const auto& check : report["checks"])
      EXPECT_NE(check["verdict"], "failed") << id << ", " << check["id"] << ": " << check["reason"] << "\n"
                                            << check.value("reproduction", "");
  }
  EXPECT_TRUE(kinds.contains("elasticity") && kinds.contains("plasticity") && kinds.contains("damage"));

  const fs::path page = CLEAVE_SOURCE_DIR "/docs/conformance.md";
  const std::string begin = "<!-- shipped -->\n", end = "<!-- end of shipped -->\n", generated = markdown(reports);
  std::string text = contents(page);
  const auto first = text.find(begin), last = text.find(end);
  ASSERT_TRUE(first != std::string::npos && last != std::string::npos);
  const auto start = first + begin.size();
  if (std::getenv("CLEAVE_UPDATE_DOCS")) {
    std::ofstream(page) << text.replace(start, last - start, generated);
    return;
  }
  EXPECT_EQ(text.substr(start, last - start), generated) << "docs/conformance.md is out of date: run with CLEAVE_UPDATE_DOCS=1";
}

TEST_F(Check, PrintsALinePerCheckAndReturnsOneIfAnyFails) {
  const Outcome whole = cleave("check '" + fixture("whole") + "'");
  EXPECT_EQ(whole.status, 0) << whole.out;
  EXPECT_THAT(whole.out, HasSubstr("  call.threads "));
  const Outcome broken = cleave("check '" + fixture("whole") + "' '" + fixture("no_unit") + "' --only metadata.described");
  EXPECT_EQ(broken.status, 1);
  EXPECT_THAT(broken.out, HasSubstr("FAILED: parameter \"stiffness\" has no unit"));
  EXPECT_THAT(broken.out, HasSubstr("0 passed, 1 failed, 0 skipped"));
}

TEST_F(Check, CommandOfAFailureRunsTheFailingCaseAgain) {
  const Outcome first = cleave("check '" + fixture("rare_crash") + "' --only call.fuzz");
  const auto at = first.out.find("again with: cleave ");
  ASSERT_NE(at, std::string::npos) << first.out;
  const auto begin = at + std::string("again with: cleave ").size();
  const Outcome again = cleave(first.out.substr(begin, first.out.find('\n', begin) - begin));
  EXPECT_EQ(again.status, 1);
  EXPECT_EQ(again.out, first.out);
  EXPECT_EQ(cleave("check '" + fixture("rare_crash") + "' --reproduce 3").status, 2);
}

TEST_F(Check, JUnitFileHoldsTheVerdicts) {
  const Outcome run =
      cleave("check '" + fixture("no_unit") + "' --only metadata.described --only abi.loads --junit results.xml");
  EXPECT_EQ(run.status, 1);
  const std::string xml = contents(directory / "results.xml");
  EXPECT_THAT(xml, HasSubstr("tests=\"2\" failures=\"1\" skipped=\"0\""));
  EXPECT_EQ(cleave("check '" + fixture("whole") + "' --only abi.loads --junit missing/results.xml").status, 2);
}

TEST_F(Check, WrongCommandsSayWhatWouldBeRight) {
  const Outcome unknown = cleave("check elasticity/qrr");
  EXPECT_EQ(unknown.status, 2);
  EXPECT_THAT(unknown.err, HasSubstr("elasticity/qr"));
  EXPECT_THAT(cleave("check").err, HasSubstr("--all"));
  EXPECT_THAT(cleave("check elasticity/qr --all").err, HasSubstr("--all"));
  EXPECT_THAT(cleave("check elasticity/qr --only call.nothing").err, HasSubstr("cleave check --list"));
  EXPECT_THAT(cleave("check elasticity/qr --set fiber_scale").err, HasSubstr("key=value"));
  EXPECT_THAT(cleave("check --list").out, HasSubstr("abi.loads"));
}

}  // namespace
}  // namespace cleave::test
