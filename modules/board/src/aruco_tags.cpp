// SPDX-License-Identifier: GPL-3.0-or-later
#include <opencv2/aruco.hpp>
#include <opencv2/imgproc.hpp>

#include "tag_family.h"
#include "tags.h"

namespace servocal::board {
namespace {

class ArucoReader final : public TagReader {
 public:
  ArucoReader(const std::string& dictionary, int border_cells)
      : dictionary_(cv::aruco::getPredefinedDictionary(arucoDictionary(dictionary))),
        parameters_(cv::aruco::DetectorParameters::create()) {
    parameters_->markerBorderBits = border_cells;
    parameters_->cornerRefinementMethod = cv::aruco::CORNER_REFINE_NONE;  // Corners are measured by fitTag.
  }

  std::vector<SeenTag> read(const cv::Mat& gray, int shrink) override {
    cv::Mat small = gray;
    if (shrink > 1) cv::resize(gray, small, cv::Size(), 1.0 / shrink, 1.0 / shrink, cv::INTER_AREA);
    std::vector<std::vector<cv::Point2f>> corners;
    std::vector<int> codes;
    cv::aruco::detectMarkers(small, dictionary_, corners, codes, parameters_);
    std::vector<SeenTag> tags;
    for (std::size_t k = 0; k < codes.size(); ++k) {
      SeenTag tag;
      tag.code = codes[k];
      for (int corner = 0; corner < 4; ++corner) {
        const cv::Point2f& p = corners[k][corner];
        tag.corners[corner] = {(p.x + 0.5) * shrink - 0.5, (p.y + 0.5) * shrink - 0.5};
      }
      tags.push_back(tag);
    }
    return tags;
  }

  double cornerErrorPx(int shrink) const override { return 1.5 * shrink; }

 private:
  cv::Ptr<cv::aruco::Dictionary> dictionary_;
  cv::Ptr<cv::aruco::DetectorParameters> parameters_;
};

}  // namespace

std::unique_ptr<TagReader> makeArucoReader(const std::string& dictionary, int border_cells) {
  return std::make_unique<ArucoReader>(dictionary, border_cells);
}

}  // namespace servocal::board
