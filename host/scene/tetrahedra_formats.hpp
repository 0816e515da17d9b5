#pragma once

#include "scene/tetrahedral_mesh.hpp"
#include "scene/text_input.hpp"

#include <filesystem>
#include <string_view>

namespace cleave::scene {

/// What a file holds. Vertex indices are checked by the readers, nothing else.
struct TetrahedraFile {
  TetrahedralMesh mesh;
  std::int64_t first_number = 0;  ///< of a tetrahedron, as the file counts
  std::vector<std::string> notes;
};

TetrahedraFile parse_tetgen(const std::filesystem::path& node_file, std::string_view nodes,
                            const std::filesystem::path& ele_file, std::string_view elements);
TetrahedraFile parse_medit(const std::filesystem::path& file, std::string_view bytes);
TetrahedraFile parse_vtk(const std::filesystem::path& file, std::string_view bytes);
TetrahedraFile parse_vtu(const std::filesystem::path& file, std::string_view bytes);

/// Words of a text in which what follows a '#' up to the end of the line is a comment.
class CommentedText {
 public:
  /// Throws InputError with file:line if the text is not UTF-8, as a binary file is not.
  CommentedText(const std::filesystem::path& file, std::string_view text);

  std::string_view word();           ///< of this line; empty at its end
  std::string_view word_anywhere();  ///< empty at the end of the text
  /// Goes to the next line that has words. False if there is none.
  bool next_row();
  bool at_end() const { return cursor_.at_end(); }
  int line() const { return cursor_.line(); }

  double number(const char* what);  ///< the next word of this line, finite
  double number_anywhere(const char* what);
  /// The next word of this line (of the text): a whole number in the range, "what" in messages.
  std::int64_t integer(const char* what, std::int64_t least, std::int64_t greatest);
  std::int64_t integer_anywhere(const char* what, std::int64_t least, std::int64_t greatest);

  [[noreturn]] void fail(const std::string& problem) const { cursor_.fail(problem); }

 private:
  std::string_view without_comment(std::string_view word);
  double finite(std::string_view word, const char* what) const;
  std::int64_t whole(std::string_view word, const char* what, std::int64_t least, std::int64_t greatest) const;

  TextCursor cursor_;
  bool commented_ = false;  ///< the rest of this line is a comment
};

}  // namespace cleave::scene
