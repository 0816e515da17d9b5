#include "config/field_reader.hpp"

#include "config/angles.hpp"
#include "config/geometry_reader.hpp"
#include "plugins/parameters.hpp"

#include <algorithm>
#include <cmath>

namespace cleave::config {
namespace {

using Layout = Fibers::Layout;

const VectorForm in_plane{.unit = "", .planar = true};
const VectorForm point{.unit = "m"};

/// What is orthogonal to rounding is kept to the bit, so that a written scene reads back the same.
bool make_orthogonal(TableReader& table, const Vector3& direction, Vector3& second) {
  const double cosine = direction.dot(second);
  if (std::abs(cosine) > 1e-3) {
    const double angle = std::acos(std::clamp(cosine, -1.0, 1.0)) * 180 / EIGEN_PI;
    table.error_at("second", "'second' must be at right angles to 'direction', is at " +
                                 plugins::number_text(std::round(angle * 100) / 100) + " degrees");
    return false;
  }
  if (std::abs(cosine) > 1e-15) second = (second - cosine * direction).normalized();
  return true;
}

bool read_uniform(TableReader& table, Fibers& fibers) {
  if (!table.require("direction", "the direction of the fibers")) return false;
  const auto direction = table.direction("direction", in_plane);
  if (!direction) return false;
  fibers.direction = *direction;
  if (fibers.second) return make_orthogonal(table, fibers.direction, *fibers.second);
  if (table.context().dimension == 2) fibers.second = Vector3(-direction->y(), direction->x(), 0);
  return true;
}

/// The axis of a layout round a line; in 2D the line is at right angles to the plane.
bool read_axis(TableReader& table, Fibers& fibers) {
  fibers.center = table.vector("center", point).value_or(Vector3::Zero());
  const bool flat = table.context().dimension == 2;
  if (flat && !table.has("axis"))
    fibers.axis = Vector3::UnitZ();
  else if (table.require("axis", "the direction of the line"))
    fibers.axis = table.direction("axis");
  if (flat && fibers.axis && !fibers.axis->head<2>().isZero(0)) {
    table.error_at("axis", "'axis' must be [0, 0, 1], out of the plane, in a scene of dimension 2");
    return false;
  }
  return fibers.axis.has_value();
}

bool read_radial(TableReader& table, Fibers& fibers) {
  if (table.has("axis")) return read_axis(table, fibers);
  fibers.center = table.vector("center", point).value_or(Vector3::Zero());
  return true;
}

bool read_longitudinal(TableReader& table, Fibers& fibers) {
  if (table.context().dimension == 3) fibers.center = table.vector("center", point);
  if (table.require("axis", "the direction of the fibers")) fibers.axis = table.direction("axis", in_plane);
  return fibers.axis.has_value();
}

bool read_helical(TableReader& table, Fibers& fibers) {
  if (table.context().dimension == 2) {
    table.error_at("layout", "the layout \"helical\" leaves the plane of a scene of dimension 2; use \"cylindrical\"");
    for (const char* key : {"center", "axis", "angle"}) table.has(key);
    return false;
  }
  fibers.angle = radians(table.required_number("angle", "degrees", Range::between(-90, 90)));
  return read_axis(table, fibers);
}

bool read_grid(TableReader& table, Fibers& fibers) {
  fibers.grid = table.text("grid").value_or("");
  if (fibers.second) table.refuse("second_grid", "cannot be given together with 'second'");
  fibers.second_grid = table.text("second_grid").value_or("");
  if (!table.require("file", "a grid of vectors of type .vdb")) return false;
  const auto file = table.file("file", {".vdb"});
  if (file) fibers.file = *file;
  return file.has_value();
}

bool read_flow(TableReader& table, Fibers& fibers) {
  const auto region = [&](const char* key, const std::string& expected) -> std::optional<scene::ShapeSpec> {
    if (!table.require(key, expected)) return std::nullopt;
    auto shape = table.table(key, key);
    return shape ? read_shape(std::move(*shape)) : std::nullopt;
  };
  fibers.inflow = region("inflow", "a shape that holds where the flow enters the body");
  fibers.outflow = region("outflow", "a shape that holds where the flow leaves the body");
  return fibers.inflow && fibers.outflow;
}

bool read_layout(TableReader& table, Fibers& fibers) {
  switch (fibers.layout) {
    case Layout::uniform:
      return read_uniform(table, fibers);
    case Layout::radial:
      return read_radial(table, fibers);
    case Layout::cylindrical:
      return read_axis(table, fibers);
    case Layout::longitudinal:
      return read_longitudinal(table, fibers);
    case Layout::helical:
      return read_helical(table, fibers);
    case Layout::grid:
      return read_grid(table, fibers);
    case Layout::flow:
      return read_flow(table, fibers);
  }
  return false;
}

}  // namespace

std::optional<Fibers> read_fibers(TableReader table) {
  const bool has_layout = table.has("layout");
  const auto layout = table.choice("layout", layout_names());
  if (has_layout && !layout) return std::nullopt;
  Fibers fibers;
  if (layout) fibers.layout = Layout(*layout);
  bool usable = true;
  if (table.context().dimension == 2 && fibers.layout != Layout::uniform) {
    for (const char* key : {"second", "second_grid"})
      table.refuse(key, "follows from the first direction in a scene of dimension 2; leave it out");
  } else {
    const bool has_second = table.has("second");
    fibers.second = table.direction("second", in_plane);
    usable = fibers.second.has_value() == has_second;
  }
  usable = read_layout(table, fibers) && usable;
  table.finish();
  return usable ? std::optional(fibers) : std::nullopt;
}

std::optional<scene::VariationSpec> read_variation(TableReader table) {
  scene::VariationSpec variation;
  std::optional<std::size_t> pattern;
  if (table.require("pattern", "one of " + list_text(pattern_names(), "\"")))
    pattern = table.choice("pattern", pattern_names());
  if (pattern) variation.pattern = scene::VariationSpec::Pattern(*pattern);
  variation.size = table.required_number("size", "m", Range::positive());
  variation.minimum = table.required_number("minimum", "1", Range::positive());
  variation.maximum = table.required_number("maximum", "1", Range::positive());
  if (variation.maximum > 0 && variation.maximum < variation.minimum)
    table.error_at("maximum", "'maximum' must be at least 'minimum', " + plugins::number_text(variation.minimum) + ", is " +
                                  plugins::number_text(variation.maximum));
  variation.seed =
      std::uint64_t(table.integer("seed", 0, std::numeric_limits<std::int64_t>::max()).value_or(std::int64_t(variation.seed)));
  table.finish();
  return pattern ? std::optional(variation) : std::nullopt;
}

const std::vector<std::string>& layout_names() {
  static const std::vector<std::string> names = {"uniform", "radial", "cylindrical", "longitudinal", "helical", "grid", "flow"};
  return names;
}

const std::vector<std::string>& pattern_names() {
  static const std::vector<std::string> names = {"voronoi", "noise"};
  return names;
}

}  // namespace cleave::config
