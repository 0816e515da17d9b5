#include "common/error.hpp"
#include "scene/text_input.hpp"
#include "scene/vtk_cells.hpp"

#include <spdlog/fmt/fmt.h>
#include <zlib.h>
#include <boost/property_tree/ptree.hpp>
#include <boost/property_tree/xml_parser.hpp>

#include <algorithm>
#include <array>
#include <cmath>
#include <cstring>
#include <limits>
#include <optional>
#include <sstream>

namespace cleave::scene {
namespace {

using Tree = boost::property_tree::ptree;

constexpr std::uint64_t most = std::numeric_limits<std::uint32_t>::max() - 1;

/// Base64 in groups of four digits. Padding ends a group, not the text: VTK encodes a header and what follows it one by one.
std::optional<std::string> from_base64(std::string_view text) {
  static constexpr std::string_view digits = "ABCDEFGHIJKLMNOPQRSTUVWXYZabcdefghijklmnopqrstuvwxyz0123456789+/";
  static constexpr auto values = [] {
    std::array<signed char, 256> table{};
    table.fill(-1);
    for (std::size_t i = 0; i < digits.size(); i++) table[static_cast<unsigned char>(digits[i])] = static_cast<signed char>(i);
    return table;
  }();
  std::string bytes;
  bytes.reserve(text.size() / 4 * 3);
  unsigned bits = 0;
  int filled = 0, padding = 0;
  for (const char c : text) {
    if (c == ' ' || c == '\n' || c == '\r' || c == '\t') continue;
    const int value = c == '=' ? 0 : values[static_cast<unsigned char>(c)];
    if (value < 0 || (c == '=' ? filled < 2 : padding > 0)) return std::nullopt;
    padding += c == '=';
    bits = bits << 6 | unsigned(value);
    if (++filled < 4) continue;
    for (int i = 0; i < 3 - padding; i++) bytes += static_cast<char>(bits >> (16 - 8 * i) & 255);
    bits = 0;
    filled = padding = 0;
  }
  if (filled > 0) return std::nullopt;
  return bytes;
}

struct Type {
  std::size_t size;
  bool floating, is_signed;
};

std::optional<Type> type_named(const std::string& name) {
  for (const std::size_t bits : {8, 16, 32, 64})
    for (const char* kind : {"Int", "UInt", "Float"})
      if (name == kind + std::to_string(bits) && !(*kind == 'F' && bits < 32))
        return Type{bits / 8, *kind == 'F', *kind != 'U'};
  return std::nullopt;
}

double number_of(const char* bytes, const Type& type) {
  if (type.floating) {
    double number;
    float single;
    if (type.size == 8) return std::memcpy(&number, bytes, 8), number;
    return std::memcpy(&single, bytes, 4), double(single);
  }
  std::uint64_t word = 0;
  std::memcpy(&word, bytes, type.size);  // little endian, as the machine is
  if (!type.is_signed) return double(word);
  const int unused = 64 - 8 * int(type.size);
  return double(std::int64_t(word << unused) >> unused);
}

/// An unstructured grid in VTK's XML.
class Reader {
 public:
  Reader(const std::filesystem::path& file, std::string_view bytes) : file_(file) { open(bytes); }

  TetrahedraFile read() {
    const auto grid = root_.get_child_optional("UnstructuredGrid");
    if (!grid) fail("has no <UnstructuredGrid>");
    VtkCells cells;
    for (const auto& [name, piece] : *grid)
      if (name == "Piece") read_piece(piece, cells);
    take_tetrahedra(cells, result_, [&](const std::string& problem) { fail(problem); });
    return std::move(result_);
  }

 private:
  [[noreturn]] void fail(const std::string& problem) const { throw InputError(file_.string() + ": " + problem); }

  /// Appended bytes are no XML: they are cut out before the rest is parsed.
  void open(std::string_view bytes) {
    std::string xml(bytes);
    if (const auto appended = bytes.find("<AppendedData"); appended != std::string_view::npos) {
      const auto underscore = bytes.find('_', bytes.find('>', appended));
      const auto end = bytes.rfind("</AppendedData>");
      if (underscore == std::string_view::npos || end == std::string_view::npos || end < underscore)
        fail("its <AppendedData> does not begin with _ or has no end");
      appended_ = bytes.substr(underscore + 1, end - underscore - 1);
      xml = std::string(bytes.substr(0, underscore + 1)) + std::string(bytes.substr(end));
    }
    // Parsed element in element, each on the stack: a grid has few.
    if (std::count(xml.begin(), xml.end(), '<') > 10000) fail("has more than 10000 tags");
    Tree tree;
    try {
      std::istringstream stream(xml);
      boost::property_tree::read_xml(stream, tree);
    } catch (const boost::property_tree::xml_parser_error& e) {
      throw InputError(fmt::format("{}:{}: is no XML: {}", file_.string(), e.line(), e.message()));
    }
    const auto root = tree.get_child_optional("VTKFile");
    if (!root) fail("has no <VTKFile>");
    root_ = *root;
    const auto attribute = [&](const char* name, const char* otherwise) {
      return root_.get<std::string>(std::string("<xmlattr>.") + name, otherwise);
    };
    if (const auto type = attribute("type", ""); type != "UnstructuredGrid")
      fail("is of type \"" + type + "\"; tetrahedra are in files of type \"UnstructuredGrid\"");
    if (attribute("byte_order", "LittleEndian") != "LittleEndian") fail("has byte_order BigEndian; only LittleEndian is read");
    const auto header = attribute("header_type", "UInt32");
    if (header != "UInt32" && header != "UInt64") fail("has header_type \"" + header + "\", must be UInt32 or UInt64");
    header_size_ = header == "UInt64" ? 8 : 4;
    const auto compressor = attribute("compressor", "");
    if (!compressor.empty() && compressor != "vtkZLibDataCompressor")
      fail("is compressed by " + compressor + "; only vtkZLibDataCompressor is read");
    compressed_ = !compressor.empty();
    encoded_ = root_.get<std::string>("AppendedData.<xmlattr>.encoding", "raw") == "base64";
  }

  std::uint64_t attribute(const Tree& element, const char* name) const {
    const auto count = element.get_optional<std::uint64_t>(std::string("<xmlattr>.") + name);
    if (!count || *count > most) fail(fmt::format("a <Piece> needs {}, a count of at most {}", name, most));
    return *count;
  }

  void read_piece(const Tree& piece, VtkCells& cells) {
    const std::uint64_t points = attribute(piece, "NumberOfPoints"), count = attribute(piece, "NumberOfCells");
    if (points == 0) return;
    const double first_vertex = double(result_.mesh.vertices.size()), first_corner = double(cells.corners.size());
    if (first_vertex + double(points) > double(most)) fail(fmt::format("has more than {} points", most));
    const auto coordinates = numbers(array(piece, "Points", ""));
    if (coordinates.size() != 3 * points) fail(fmt::format("has {} coordinates for {} points", coordinates.size(), points));
    for (std::uint64_t i = 0; i < points; i++) {
      const Vector3 x(coordinates[3 * i], coordinates[3 * i + 1], coordinates[3 * i + 2]);
      if (!x.allFinite()) fail(fmt::format("point {} is not finite", i));
      result_.mesh.vertices.push_back(x);
    }
    const auto corners = numbers(array(piece, "Cells", "connectivity")), ends = numbers(array(piece, "Cells", "offsets")),
               types = numbers(array(piece, "Cells", "types"));
    if (ends.size() != count || types.size() != count)
      fail(fmt::format("has {} offsets and {} types for {} cells", ends.size(), types.size(), count));
    for (const double corner : corners) {
      if (!(corner >= 0 && corner < double(points)))
        fail(fmt::format("a cell has corner {:g}; corners must be from 0 to {}", corner, points - 1));
      cells.corners.push_back(first_vertex + corner);
    }
    if (cells.offsets.empty()) cells.offsets.push_back(0);
    for (const double end : ends) {
      if (!(end >= 0 && end <= double(corners.size()) && first_corner + end >= cells.offsets.back()))
        fail(fmt::format("its offsets must rise to at most {}, the number of corners", corners.size()));
      cells.offsets.push_back(first_corner + end);
    }
    cells.types.insert(cells.types.end(), types.begin(), types.end());
  }

  /// The array of this name (any if empty) in a part of a piece.
  const Tree& array(const Tree& piece, const char* part, const std::string& name) const {
    if (const auto arrays = piece.get_child_optional(part))
      for (const auto& [element, array] : *arrays)
        if (element == "DataArray" && (name.empty() || array.get<std::string>("<xmlattr>.Name", "") == name)) return array;
    fail(fmt::format("a <Piece> has no {} in its <{}>", name.empty() ? "<DataArray>" : "\"" + name + "\"", part));
  }

  std::vector<double> numbers(const Tree& array) const {
    const auto name = array.get<std::string>("<xmlattr>.Name", ""), form = array.get<std::string>("<xmlattr>.format", "ascii");
    const auto type = type_named(array.get<std::string>("<xmlattr>.type", ""));
    if (!type) fail("array \"" + name + "\" needs a type of numbers, Int8 to Float64");
    std::vector<double> values;
    if (form == "ascii") {
      std::istringstream text(array.data());
      for (std::string word; text >> word;) {
        const auto value = parse_number(word);
        if (!value) fail("array \"" + name + "\" holds something that is not a number");
        values.push_back(*value);
      }
      return values;
    }
    std::string bytes;
    if (form == "binary") {
      bytes = decoded(array.data(), name);
    } else if (form == "appended") {
      const auto offset = array.get_optional<std::uint64_t>("<xmlattr>.offset");
      if (!offset || *offset > appended_.size()) fail("array \"" + name + "\" needs an offset inside of <AppendedData>");
      bytes = encoded_ ? decoded(appended_.substr(*offset), name) : std::string(appended_.substr(*offset));
    } else {
      fail("array \"" + name + "\" has the format \"" + form + "\", must be ascii, binary or appended");
    }
    bytes = compressed_ ? inflated(bytes, name) : uncompressed(bytes, name);
    if (bytes.size() % type->size != 0) fail("array \"" + name + "\" ends within a number");
    for (std::size_t at = 0; at < bytes.size(); at += type->size) values.push_back(number_of(bytes.data() + at, *type));
    return values;
  }

  std::string decoded(std::string_view text, const std::string& name) const {
    auto bytes = from_base64(text);
    if (!bytes) fail("array \"" + name + "\" is no base64");
    return std::move(*bytes);
  }

  std::uint64_t header(std::string_view bytes, std::size_t place, const std::string& name) const {
    if (bytes.size() / header_size_ <= place) fail("array \"" + name + "\" ends within its header");
    std::uint64_t word = 0;
    std::memcpy(&word, bytes.data() + place * header_size_, header_size_);
    return word;
  }

  /// Its length in bytes, and these.
  std::string uncompressed(std::string_view bytes, const std::string& name) const {
    const std::uint64_t length = header(bytes, 0, name);
    if (length > bytes.size() - header_size_) fail(fmt::format("array \"{}\" ends before its {} bytes", name, length));
    return std::string(bytes.substr(header_size_, length));
  }

  /// Number of blocks, size of a block, size of the last one if it is smaller, sizes of the compressed blocks, and these.
  std::string inflated(std::string_view bytes, const std::string& name) const {
    const std::uint64_t blocks = header(bytes, 0, name);
    if (blocks == 0) return {};
    const std::uint64_t block = header(bytes, 1, name), last = header(bytes, 2, name);
    if (blocks > bytes.size() / header_size_) fail("array \"" + name + "\" ends within its header");
    std::size_t at = (3 + blocks) * header_size_;
    std::string all;
    for (std::uint64_t i = 0; i < blocks; i++) {
      const std::uint64_t packed = header(bytes, 3 + i, name), size = i + 1 == blocks && last > 0 ? last : block;
      constexpr std::uint64_t most_deflated = 1032;  // bytes that one byte of a deflated stream stands for
      if (at > bytes.size() || packed > bytes.size() - at || size > most_deflated * (packed + 1))
        fail(fmt::format("array \"{}\": block {} is longer than what is left", name, i));
      const std::size_t before = all.size();
      all.resize(before + size);
      uLongf length = size;
      const int result = uncompress(reinterpret_cast<Bytef*>(all.data() + before), &length,
                                    reinterpret_cast<const Bytef*>(bytes.data() + at), packed);
      if (result != Z_OK || length != size) fail(fmt::format("array \"{}\": block {} cannot be unpacked", name, i));
      at += packed;
    }
    return all;
  }

  std::filesystem::path file_;
  Tree root_;
  std::string_view appended_;
  std::size_t header_size_ = 8;
  bool compressed_ = false, encoded_ = false;
  TetrahedraFile result_;
};

}  // namespace

TetrahedraFile parse_vtu(const std::filesystem::path& file, std::string_view bytes) { return Reader(file, bytes).read(); }

}  // namespace cleave::scene
