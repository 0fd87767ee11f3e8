// SPDX-License-Identifier: GPL-3.0-or-later
#include "tag_family.h"

#include <memory>
#include <opencv2/aruco.hpp>
#include <stdexcept>

extern "C" {
#include <apriltag/tag36h11.h>
}

namespace servocal::board {
namespace {

cv::Mat aprilTagCells(int code, int border_bits) {
  const std::unique_ptr<apriltag_family_t, void (*)(apriltag_family_t*)> family(tag36h11_create(),
                                                                                tag36h11_destroy);
  if (code < 0 || code >= static_cast<int>(family->ncodes))
    throw std::invalid_argument("tag family 36h11 has no code " + std::to_string(code));
  const int side = family->width_at_border + 2 * (border_bits - 1);
  cv::Mat cells = cv::Mat::zeros(side, side, CV_8UC1);
  for (unsigned bit = 0; bit < family->nbits; ++bit) {
    if ((family->codes[code] >> (family->nbits - 1 - bit)) & 1)
      cells.at<uchar>(family->bit_y[bit] + border_bits - 1, family->bit_x[bit] + border_bits - 1) = 255;
  }
  return cells;
}

}  // namespace

int arucoDictionary(const std::string& name) {
  if (name == "aruco_original") return cv::aruco::DICT_ARUCO_ORIGINAL;
  int index = 0;  // cv::aruco lists 4x4 to 7x7, each with 50, 100, 250 and 1000 codes.
  for (const char* bits : {"4x4", "5x5", "6x6", "7x7"}) {
    for (const char* codes : {"50", "100", "250", "1000"}) {
      if (name == std::string("aruco_") + bits + "_" + codes) return cv::aruco::DICT_4X4_50 + index;
      ++index;
    }
  }
  throw std::invalid_argument("no tag family '" + name + "'");
}

cv::Mat tagCells(const std::string& family, int code, int border_bits) {
  if (family == "apriltag_36h11") return aprilTagCells(code, border_bits);
  const cv::Ptr<cv::aruco::Dictionary> dictionary =
      cv::aruco::getPredefinedDictionary(arucoDictionary(family));
  if (code < 0 || code >= dictionary->bytesList.rows)
    throw std::invalid_argument("dictionary " + family + " has no code " + std::to_string(code));
  cv::Mat cells;
  dictionary->drawMarker(code, dictionary->markerSize + 2 * border_bits, cells, border_bits);
  return cells;
}

}  // namespace servocal::board
