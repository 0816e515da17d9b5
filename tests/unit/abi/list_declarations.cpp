// list_declarations OUTPUT HEADER...
//
// Lists what C headers declare, for layout.c: STRUCT(name), MEMBER(struct, member), CONSTANT(name) for enumerators and
// numbers, TEXT(name) for strings.
#include <algorithm>
#include <fstream>
#include <iostream>
#include <iterator>
#include <regex>
#include <sstream>
#include <string>

namespace {

std::string without_comments(const std::string& text) {
  std::string rest;
  for (std::size_t at = 0; at < text.size();) {
    const auto begin = std::min(text.find("/*", at), text.size());
    rest += text.substr(at, begin - at);
    at = begin == text.size() ? begin : text.find("*/", begin) + 2;
  }
  return rest;
}

template <class Use>
void for_each_match(const std::string& text, const char* pattern, Use use) {
  const std::regex expression(pattern);
  for (std::sregex_iterator match(text.begin(), text.end(), expression), end; match != end; ++match) use(*match);
}

/// Names declared by the members of a struct: "double minimum, maximum", "uint32_t stride[4]", "void (*destroy)(...)".
void list_members(std::ostream& out, const std::string& name, const std::string& body) {
  std::istringstream declarations(body);
  for (std::string declaration; std::getline(declarations, declaration, ';');) {
    std::smatch match;
    if (std::regex_search(declaration, match, std::regex(R"(\(\*(\w+)\))"))) {
      out << "MEMBER(" << name << ", " << match[1] << ")\n";
      continue;
    }
    for_each_match(declaration, R"((\w+)\s*(\[\w+\])?\s*(,|$))",
                   [&](const std::smatch& member) { out << "MEMBER(" << name << ", " << member[1] << ")\n"; });
  }
}

void list(std::ostream& out, const std::string& text) {
  for_each_match(text, R"(typedef struct (\w+) \{([^}]*)\} \1;)", [&](const std::smatch& found) {
    out << "STRUCT(" << found[1] << ")\n";
    list_members(out, found[1], found[2]);
  });
  for_each_match(text, R"(enum[^{;]*\{([^}]*)\})", [&](const std::smatch& found) {
    for_each_match(found[1], R"((\w+)\s*=)", [&](const std::smatch& name) { out << "CONSTANT(" << name[1] << ")\n"; });
  });
  for_each_match(text, R"(#define (\w+) (\d\w*)\n)", [&](const std::smatch& name) { out << "CONSTANT(" << name[1] << ")\n"; });
  for_each_match(text, R"(#define (\w+) ")", [&](const std::smatch& name) { out << "TEXT(" << name[1] << ")\n"; });
}

}  // namespace

int main(int argc, char** argv) {
  std::ofstream out(argv[1]);
  for (int i = 2; i < argc; ++i) {
    std::ifstream header(argv[i]);
    if (!header) {
      std::cerr << "cannot read " << argv[i] << '\n';
      return 1;
    }
    list(out, without_comments({std::istreambuf_iterator<char>(header), {}}));
  }
  return out.flush() ? 0 : 1;
}
