// SPDX-License-Identifier: GPL-3.0-or-later
#include "servocal/board/detector.h"

#include <opencv2/imgproc.hpp>
#include <stdexcept>

#include "finder.h"

namespace servocal::board {
namespace {

void requireImage(const cv::Mat& image) {
  if (image.empty() || (image.type() != CV_8UC1 && image.type() != CV_8UC3))
    throw std::invalid_argument("Detector: the image must be 8-bit gray or BGR, and not empty");
}

std::unique_ptr<Finder> makeFinder(const BoardSpec& board) {
  if (board.as<Checkerboard>()) return makeCheckerboardFinder(board);
  if (board.as<TagGrid>()) return makeTagGridFinder(board);
  if (board.as<Charuco>()) return makeCharucoFinder(board);
  return makeCircleFinder(board);
}

}  // namespace

cv::Mat toGray(const cv::Mat& image) {
  if (image.type() == CV_8UC1) return image;
  cv::Mat gray;
  cv::cvtColor(image, gray, cv::COLOR_BGR2GRAY);
  return gray;
}

struct Detector::Impl {
  std::unique_ptr<Finder> finder;
};

Detector::Detector(const BoardSpec& board) : impl_(std::make_unique<Impl>()) { impl_->finder = makeFinder(board); }
Detector::~Detector() = default;
Detector::Detector(Detector&&) noexcept = default;

std::optional<BoardDetection> Detector::detect(const cv::Mat& image) {
  requireImage(image);
  return impl_->finder->detect(image);
}

std::optional<BoardDetection> Detector::track(const cv::Mat& image) {
  requireImage(image);
  return impl_->finder->track(image);
}

void Detector::reset() { impl_->finder->reset(); }

}  // namespace servocal::board
