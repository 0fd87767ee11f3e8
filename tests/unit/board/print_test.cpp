// SPDX-License-Identifier: GPL-3.0-or-later
#include "servocal/board/print.h"

#include <gtest/gtest.h>

#include <cstdlib>
#include <fstream>
#include <opencv2/imgcodecs.hpp>

#include "pictures.h"
#include "servocal/board/detector.h"
#include "servocal/core/error.h"
#include "temporary_folder.h"

namespace servocal {
namespace {

constexpr int kDpi = 150;

cv::Mat rasterize(const std::filesystem::path& pdf) {
  const std::filesystem::path stem = std::filesystem::path(pdf).replace_extension();
  const std::string command = "pdftoppm -r " + std::to_string(kDpi) + " -gray -singlefile '" + pdf.string() + "' '" +
                              stem.string() + "' 2>/dev/null";
  if (std::system(command.c_str()) != 0) return {};
  return cv::imread(stem.string() + ".pgm", cv::IMREAD_GRAYSCALE);
}

std::vector<BoardSpec> boardsOfEveryKind() {
  BoardSpec large = test::plainBoard(11, 8);
  std::get<Checkerboard>(large.pattern).square_size_m = 0.04;
  TagGrid april;
  TagGrid aruco;
  aruco.family = "aruco_6x6_250";
  aruco.tags_x = 4;
  aruco.tags_y = 3;
  aruco.tag_size_m = 0.03;
  aruco.first_row_is_lowest = false;
  TagGrid wide = april;
  wide.border_bits = 2;
  Charuco white;
  white.squares_y = 6;
  white.square_size_m = 0.03;
  white.marker_size_m = 0.02;
  white.first_square_white = true;
  CircleGrid marked;
  marked.bigger_corner_ratio = 1.3;
  CircleGrid asymmetric;
  asymmetric.asymmetric = true;
  asymmetric.circles_x = 4;
  asymmetric.circles_y = 11;  // An odd number of rows is not symmetric.
  asymmetric.spacing_m = 0.03;
  asymmetric.diameter_m = 0.011;
  return {BoardSpec(),      large,          BoardSpec{april},   BoardSpec{wide},      BoardSpec{aruco},
          BoardSpec{white}, BoardSpec{Charuco()}, BoardSpec{marked}, BoardSpec{asymmetric}};
}

// Rendered by another program, the printed page shows the board, at true size.
TEST(PrintBoard, IsFoundByTheDetectorAtTrueSize) {
  if (std::system("pdftoppm -v >/dev/null 2>&1") != 0) GTEST_SKIP() << "pdftoppm (poppler-utils) is not installed";
  const test::TemporaryFolder folder;
  for (const BoardSpec& board : boardsOfEveryKind()) {
    SCOPED_TRACE(board.describe());
    const auto pdf = folder.path() / "board.pdf";
    board::printBoard(board, pdf);
    const cv::Mat page = rasterize(pdf);
    ASSERT_FALSE(page.empty());
    const auto detection = board::Detector(board).detect(page);
    ASSERT_TRUE(detection);
    EXPECT_TRUE(detection->orientation_known);
    ASSERT_EQ(static_cast<int>(detection->corners.size()), board.cornerCount());
    const double px_per_m = kDpi / 0.0254;
    Eigen::Vector2d origin = Eigen::Vector2d::Zero();  // Mean of the corners, px.
    Eigen::Vector2d middle = Eigen::Vector2d::Zero();  // Of the corners, m; zero but on asymmetric grids.
    for (const Corner& corner : detection->corners) {
      origin += corner.pixel / board.cornerCount();
      middle += board.corner(corner.id).head<2>() / board.cornerCount();
    }
    for (const Corner& corner : detection->corners) {
      const Eigen::Vector2d expected = origin + px_per_m * (board.corner(corner.id).head<2>() - middle);
      // The rasterizer itself rounds edges by a good part of a pixel.
      EXPECT_LT((corner.pixel - expected).norm(), 1.0) << "corner " << corner.id;
    }
  }
}

// Negative control: a page at 97 % (as "fit to page" prints) is not the true size.
TEST(PrintBoard, TheCheckSeesAScaledPage) {
  const BoardSpec board;
  const double px_per_m = kDpi / 0.0254;
  EXPECT_GT(0.03 * px_per_m * (board.corner(23) - board.corner(0)).norm(), 10 * 1.0);
}

TEST(PrintBoard, RefusesWhatItCannotWrite) {
  try {
    board::printBoard(BoardSpec(), "/nonexistent/board.pdf");
    FAIL() << "no error";
  } catch (const Error& error) {
    EXPECT_EQ(error.kind(), ErrorKind::kBadData);
    EXPECT_NE(std::string(error.what()).find("/nonexistent/board.pdf"), std::string::npos) << error.what();
  }
  BoardSpec huge;
  std::get<Checkerboard>(huge.pattern).square_size_m = 0.3;
  EXPECT_THROW(board::printBoard(huge, "unused.pdf"), std::invalid_argument);
}

}  // namespace
}  // namespace servocal
