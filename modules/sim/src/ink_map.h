// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

#include <cstdint>
#include <opencv2/core/mat.hpp>

#include "servocal/core/board_spec.h"

namespace servocal::sim {

/// A plate's print as a summed-area table, from which the ink under any box is read in constant time.
/// Texels hold the share of their area that is ink, so an edge between two of them stays where it is; it
/// is only smeared over one texel, a fraction of a pixel.
///
/// Source: F. Crow, "Summed-Area Tables for Texture Mapping", SIGGRAPH 1984.
class InkMap {
 public:
  explicit InkMap(const BoardSpec& board);

  double texel_m() const { return texel_m_; }
  int width() const { return integral_.cols - 1; }   ///< Of the plate, texels.
  int height() const { return integral_.rows - 1; }
  const std::int32_t* integral() const { return integral_.ptr<std::int32_t>(); }
  /// Per texel: kWhite or kBlack if all within kReach texels along both axes is, else kMixed. Most of a
  /// board is; only its edges need the table.
  const std::uint8_t* tone() const { return tone_.ptr<std::uint8_t>(); }

  static constexpr std::uint8_t kWhite = 0, kMixed = 128, kBlack = 255;
  static constexpr int kReach = 5;

 private:
  double texel_m_;
  cv::Mat integral_;  ///< CV_32SC1, continuous, like the other.
  cv::Mat tone_;      ///< CV_8UC1
};

}  // namespace servocal::sim
