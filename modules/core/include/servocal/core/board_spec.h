// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

#include <Eigen/Core>
#include <filesystem>
#include <vector>

namespace servocal {

class ConfigReader;

/// A checkerboard, as printed. Seen from its front with corner 0 at the upper left, the board frame o
/// has its origin at the centre of the inner-corner grid, x to the right (along a row), y down, and z
/// into the board, away from the viewer. Inner corners are numbered row by row from the upper left.
///
/// With a hollow corner, the corner square diagonally outside corner 0 is drawn as a black frame with
/// a white inside, which makes the board's orientation unique. Without it, a board of odd x odd or
/// even x even squares looks the same after half a turn.
struct BoardSpec {
  int squares_x = 7;              ///< Squares along x; at least 3.
  int squares_y = 5;              ///< Squares along y; at least 3.
  double square_size_m = 0.03;    ///< Side of a square, m.
  bool hollow_corner = true;      ///< One corner square hollow; needs an odd number of squares each way.
  double hollow_inner_ratio = 0.6;  ///< Side of the white inside over the side of the square.
  double margin_m = 0.015;        ///< White rim around the squares; part of the plate's outline.

  int cornersX() const { return squares_x - 1; }
  int cornersY() const { return squares_y - 1; }
  int cornerCount() const { return cornersX() * cornersY(); }
  /// Position of an inner corner in o, m; z is zero.
  Eigen::Vector3d corner(int id) const;
  /// All corners by id.
  std::vector<Eigen::Vector3d> corners() const;
  /// The plate's outline in o (rim included), clockwise from the upper left, m.
  std::vector<Eigen::Vector3d> outline() const;
  /// Corners of the squares' outline in o (without the rim), clockwise from the upper left, m. What a
  /// detector needs to see.
  std::vector<Eigen::Vector3d> squaresOutline() const;
  /// True if half a turn maps the printed pattern onto itself (no mark, and symmetric colors).
  bool isSymmetric() const;
};

/// Reads a board file (YAML, keys as in the `board:` section of a cell file).
/// @throws Error (kInvalidConfig) naming file, line, nearest valid key and allowed range.
BoardSpec loadBoard(const std::filesystem::path& file);

/// The same from a section of another file; every file that describes a board uses these keys.
/// @throws Error (kInvalidConfig) as loadBoard.
BoardSpec readBoard(const ConfigReader& section);

}  // namespace servocal
