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

// Rendered by another program, the printed page shows the board, at true size.
TEST(PrintBoard, IsFoundByTheDetectorAtTrueSize) {
  if (std::system("pdftoppm -v >/dev/null 2>&1") != 0) GTEST_SKIP() << "pdftoppm (poppler-utils) is not installed";
  const test::TemporaryFolder folder;
  BoardSpec large = test::plainBoard(11, 8);
  std::get<Checkerboard>(large.pattern).square_size_m = 0.04;
  for (const BoardSpec& board : {BoardSpec(), large}) {
    const auto pdf = folder.path() / "board.pdf";
    board::printBoard(board, pdf);
    const cv::Mat page = rasterize(pdf);
    ASSERT_FALSE(page.empty());
    const auto detection = board::Detector(board).detect(page);
    ASSERT_TRUE(detection);
    EXPECT_TRUE(detection->orientation_known);
    const double px_per_m = kDpi / 0.0254;
    Eigen::Vector2d origin = Eigen::Vector2d::Zero();  // The board frame's, which is the corners' mean.
    for (const Corner& corner : detection->corners) origin += corner.pixel / board.cornerCount();
    for (const Corner& corner : detection->corners) {
      const Eigen::Vector2d expected = origin + px_per_m * board.corner(corner.id).head<2>();
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
