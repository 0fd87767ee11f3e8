// SPDX-License-Identifier: GPL-3.0-or-later
#include <stdexcept>

#include "tags.h"

extern "C" {
#include <apriltag/apriltag.h>
#include <apriltag/tag36h11.h>
}

namespace servocal::board {
namespace {

using Eigen::Vector2d;

constexpr int kCorrectedBits = 1;
constexpr float kMinDecisionMargin = 8.0f;  // Gray levels between a cell and the threshold, on the mean.

struct FreeFamily {
  void operator()(apriltag_family_t* family) const { tag36h11_destroy(family); }
};
struct FreeDetector {
  void operator()(apriltag_detector_t* detector) const { apriltag_detector_destroy(detector); }
};
struct FreeDetections {
  void operator()(zarray_t* detections) const { apriltag_detections_destroy(detections); }
};

class AprilTagReader final : public TagReader {
 public:
  explicit AprilTagReader(int border_cells)
      : family_(tag36h11_create()), detector_(apriltag_detector_create()) {
    if (border_cells < 1 || border_cells > 2)
      throw std::invalid_argument("Detector: a tag's border is one or two cells wide");
    // The library's family has one cell of border; one more moves the code inwards.
    const int more = border_cells - 1;
    family_->width_at_border += 2 * more;
    family_->total_width += 2 * more;
    for (uint32_t k = 0; k < family_->nbits; ++k) {
      family_->bit_x[k] += more;
      family_->bit_y[k] += more;
    }
    apriltag_detector_add_family_bits(detector_.get(), family_.get(), kCorrectedBits);
    detector_->nthreads = 1;
    detector_->refine_edges = true;
    // At the default of 5, image noise makes thousands of candidates and a frame takes ten times as long.
    detector_->qtp.min_white_black_diff = 20;
  }

  std::vector<SeenTag> read(const cv::Mat& gray, int shrink) override {
    detector_->quad_decimate = static_cast<float>(shrink);
    image_u8_t image = {gray.cols, gray.rows, static_cast<int32_t>(gray.step), gray.data};
    const std::unique_ptr<zarray_t, FreeDetections> found(apriltag_detector_detect(detector_.get(), &image));
    std::vector<SeenTag> tags;
    for (int k = 0; k < zarray_size(found.get()); ++k) {
      const apriltag_detection_t* detection = nullptr;
      zarray_get(found.get(), k, &detection);
      if (detection->decision_margin < kMinDecisionMargin) continue;
      SeenTag tag;
      tag.code = detection->id;
      // The library counts counter-clockwise from the lower left and has pixel centres at one half.
      for (int corner = 0; corner < 4; ++corner) {
        const double* p = detection->p[3 - corner];
        tag.corners[corner] = Vector2d(p[0] - 0.5, p[1] - 0.5);
      }
      tags.push_back(tag);
    }
    return tags;
  }

  double cornerErrorPx(int) const override { return 0.0; }  // Edges are refined.

 private:
  std::unique_ptr<apriltag_family_t, FreeFamily> family_;  // Outlives the detector, which refers to it.
  std::unique_ptr<apriltag_detector_t, FreeDetector> detector_;
};

}  // namespace

std::unique_ptr<TagReader> makeAprilTagReader(int border_cells) {
  return std::make_unique<AprilTagReader>(border_cells);
}

}  // namespace servocal::board
