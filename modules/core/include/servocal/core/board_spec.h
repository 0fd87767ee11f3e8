// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

#include <Eigen/Core>
#include <filesystem>
#include <string>
#include <utility>
#include <variant>
#include <vector>

namespace servocal {

class ConfigReader;

/// A checkerboard. Inner corners are numbered row by row from the upper left.
///
/// With a hollow corner, the corner square diagonally outside corner 0 is drawn as a black frame with
/// a white inside, which makes the board's orientation unique. Without it, a board of odd x odd or
/// even x even squares looks the same after half a turn.
struct Checkerboard {
  int squares_x = 7;              ///< Squares along x; at least 3.
  int squares_y = 5;              ///< Squares along y; at least 3.
  double square_size_m = 0.03;    ///< Side of a square, m.
  bool hollow_corner = true;      ///< One corner square hollow; needs an odd number of squares each way.
  double hollow_inner_ratio = 0.6;  ///< Side of the white inside over the side of the square.

  int cornersX() const { return squares_x - 1; }
  int cornersY() const { return squares_y - 1; }
  int cornerCount() const { return cornersX() * cornersY(); }
};

/// Square black-and-white tags on a grid, upright: an AprilGrid, an ArUco grid, or one tag alone. Corners
/// are numbered four to a tag, clockwise from its upper left, tags row by row from the board's upper left
/// (whatever their codes).
struct TagGrid {
  std::string family = "apriltag_36h11";  ///< That, or an OpenCV ArUco dictionary: "aruco_6x6_250".
  int tags_x = 6;
  int tags_y = 6;
  double tag_size_m = 0.022;      ///< Side of a tag, black border included, m.
  double tag_gap_m = 0.0066;      ///< White between neighboring tags, m.
  int border_bits = 1;            ///< Width of the black border in cells of the code: 1 or 2.
  int first_id = 0;               ///< Code of the first tag; the others count up row by row,
  bool first_row_is_lowest = true;  ///< from the lower left upwards (Kalibr), or from the upper left down.

  bool isAprilTag() const { return family == "apriltag_36h11"; }
  /// Code of the tag whose corners are 4 * place .. 4 * place + 3.
  int code(int place) const;
};

/// A checkerboard with ArUco markers in its white squares. Inner corners are numbered as on a Checkerboard;
/// markers count up from 0, row by row from the upper left.
struct Charuco {
  int squares_x = 9;
  int squares_y = 7;
  double square_size_m = 0.04;
  double marker_size_m = 0.03;    ///< Side of a marker, black border included, m.
  std::string dictionary = "aruco_5x5_250";  ///< OpenCV's predefined dictionary.
  bool first_square_white = false;  ///< The upper left square is white (OpenCV before 4.7 with an even
                                    ///< number of rows).
};

/// Black discs on white, on a square grid or, asymmetric, every other row shifted by half a spacing and
/// rows half a spacing apart. Centres are numbered row by row from the upper left, where the bigger disc
/// is if there is one.
struct CircleGrid {
  int circles_x = 10;             ///< In one row.
  int circles_y = 8;              ///< Rows.
  double spacing_m = 0.025;       ///< Between the centres of neighbors in one row, m.
  double diameter_m = 0.015;
  bool asymmetric = false;
  double bigger_corner_ratio = 1.0;  ///< Diameter of disc 0 over that of the others; 1: no mark.
};

/// The calibration board, as printed. Seen from its front, the board frame o has its origin at the centre
/// of its points, x to the right (along a row), y down, and z into the board, away from the viewer. The
/// "corners" of a board are the points a detector measures, whatever its pattern.
struct BoardSpec {
  std::variant<Checkerboard, TagGrid, Charuco, CircleGrid> pattern = Checkerboard{};
  double margin_m = 0.015;        ///< White rim around the pattern; part of the plate's outline.

  template <typename Pattern>
  const Pattern* as() const { return std::get_if<Pattern>(&pattern); }

  int cornerCount() const;
  /// Position of a corner in o, m; z is zero.
  Eigen::Vector3d corner(int id) const;
  /// All corners by id.
  std::vector<Eigen::Vector3d> corners() const;
  /// Smallest distance of neighboring corners, m.
  double spacing() const;
  /// The pattern's outline in o (without the rim), clockwise from the upper left, m. What a detector of
  /// whole boards needs to see.
  std::vector<Eigen::Vector3d> patternOutline() const;
  /// The plate's outline in o (rim included), clockwise from the upper left, m.
  std::vector<Eigen::Vector3d> outline() const;
  /// Turns about z that map the pattern onto itself: 1 (none but the whole turn), 2 or 4. If more than
  /// one, an image does not tell which corner is which; the robot's motion does.
  int symmetry() const;
  /// The corner that is seen as corner `id` if the board is turned by turn / symmetry() of a whole turn
  /// from x towards y; `turn` in [0, symmetry()).
  int turnedId(int id, int turn) const;
  /// "7 x 5 squares of 30 mm, one corner hollow": for people.
  std::string describe() const;
};

/// Reads a board file (YAML, keys as in the `board:` section of a cell file).
/// @throws Error (kInvalidConfig) naming file, line, nearest valid key and allowed range.
BoardSpec loadBoard(const std::filesystem::path& file);

/// The same from a section of another file; every file that describes a board uses these keys.
/// @throws Error (kInvalidConfig) as loadBoard.
BoardSpec readBoard(const ConfigReader& section);

/// The keys and values, as YAML and JSON scalars, from which readBoard makes the same board again.
std::vector<std::pair<std::string, std::string>> boardKeys(const BoardSpec& board);

}  // namespace servocal
