/// The length over which a damage law smears a crack, given in metres or in grid cells.
#ifndef CLEAVE_PLUGINS_DAMAGE_LENGTH_SCALE_HPP
#define CLEAVE_PLUGINS_DAMAGE_LENGTH_SCALE_HPP

#include <cleave/parameters.hpp>

namespace cleave {

struct LengthScale {
  std::optional<double> metres, cells;

  bool given() const { return metres || cells; }
  /// The parameter that was given, or would be the one to give.
  const char* key() const { return cells ? "length_scale_cells" : "length_scale"; }

  /// l0 [m]; half a cell where nothing is given [Wolper et al. 2020, section 3.1].
  double in(const Surroundings& surroundings) const {
    if (metres) return *metres;
    if (surroundings.cell_size > 0) return cells.value_or(0.5) * surroundings.cell_size;
    throw ParameterError{key(), cells ? "needs a grid, and there is no cell size here: give length_scale in metres instead"
                                      : "is needed: its default is half a cell, and there is no cell size here"};
  }

  static constexpr auto parameters =
      describe(number(&LengthScale::metres, {.key = "length_scale",
                                             .unit = "m",
                                             .valid = positive,
                                             .description = "l0, half width of a crack; the same at every resolution"}),
               number(&LengthScale::cells, {.key = "length_scale_cells",
                                            .default_value = 0.5,
                                            .valid = positive,
                                            .description = "l0 in grid cells, 0.5 if no length is given"}),
               at_most_one_of("length_scale", "length_scale_cells"));
};

}  // namespace cleave

#endif
