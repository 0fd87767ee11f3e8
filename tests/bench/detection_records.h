// SPDX-License-Identifier: GPL-3.0-or-later
// What a detector did on one frame, as a line of text: runs over parts of the frames are put together by
// putting their lines together.
#pragma once

#include <sstream>
#include <string>
#include <vector>

namespace servocal::bench {

struct Record {
  std::string camera;  ///< "640x480"
  std::string kind;    ///< "board", "tracked", "empty", "other", "other-plain", "covered", "tags"
  std::string by;      ///< "servocal", "classic", "sectors", "apriltag"
  int frame = 0;
  int tilt_deg = 0;
  int shown = 1;          ///< Boards, or tags, in view.
  int found = 0;          ///< Of them.
  double error_px = 0.0;  ///< RMS of what was found.
  double cpu_ms = 0.0;
  int turn = 0;            ///< 1: orientation known and right; -1: wrong; 0: undecided, or not asked for.
  double mark_px = 0.0;    ///< Shortest side of the mark's white inside.
  double z_squares = 0.0;  ///< Sum over coordinates of (error / claimed sigma)^2.
  int z_count = 0;

  std::string line() const {
    std::ostringstream out;
    out << camera << ' ' << kind << ' ' << by << ' ' << frame << ' ' << tilt_deg << ' ' << shown << ' '
        << found << ' ' << error_px << ' ' << cpu_ms << ' ' << turn << ' ' << mark_px << ' ' << z_squares
        << ' ' << z_count;
    return out.str();
  }
};

inline std::istream& operator>>(std::istream& in, Record& r) {
  return in >> r.camera >> r.kind >> r.by >> r.frame >> r.tilt_deg >> r.shown >> r.found >> r.error_px >>
         r.cpu_ms >> r.turn >> r.mark_px >> r.z_squares >> r.z_count;
}

/// Prints the tables of docs/results.md from records.
void printTables(const std::vector<Record>& records);

}  // namespace servocal::bench
