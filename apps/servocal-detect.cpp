// SPDX-License-Identifier: GPL-3.0-or-later
#include <cmath>
#include <ctime>
#include <iomanip>
#include <iostream>
#include <nlohmann/json.hpp>
#include <opencv2/core/utility.hpp>
#include <opencv2/imgcodecs.hpp>
#include <optional>
#include <string>
#include <vector>

#include "servocal/app/main.h"
#include "servocal/board/detector.h"
#include "servocal/core/board_spec.h"
#include "servocal/core/error.h"

namespace {

using namespace servocal;
using nlohmann::json;

struct ImageReport {
  std::string image;
  int width_px = 0, height_px = 0;
  double cpu_ms = 0.0;
  std::optional<BoardDetection> detection;
};

double cpuMs() { return 1e3 * static_cast<double>(std::clock()) / CLOCKS_PER_SEC; }

ImageReport detectIn(const std::string& file, const BoardSpec& board) {
  const cv::Mat image = cv::imread(file, cv::IMREAD_COLOR);
  if (image.empty()) {
    throw Error(ErrorKind::kBadData, "Cannot read the image " + file +
                                         ": missing, truncated or of an unknown format. Check the file.");
  }
  ImageReport report{file, image.cols, image.rows, 0.0, std::nullopt};
  board::Detector detector(board);
  const double start = cpuMs();
  report.detection = detector.detect(image);
  report.cpu_ms = cpuMs() - start;
  return report;
}

json toJson(const ImageReport& report) {
  json entry = {{"image", report.image}, {"width_px", report.width_px}, {"height_px", report.height_px},
                {"cpu_ms", report.cpu_ms}, {"found", report.detection.has_value()}};
  if (!report.detection) return entry;
  entry["orientation_known"] = report.detection->orientation_known;
  entry["corners"] = json::array();
  for (const Corner& corner : report.detection->corners) {
    const Eigen::Matrix2d& c = corner.covariance_px2;
    entry["corners"].push_back({{"id", corner.id}, {"pixel", {corner.pixel.x(), corner.pixel.y()}},
                                {"covariance_px2", {{c(0, 0), c(0, 1)}, {c(1, 0), c(1, 1)}}}});
  }
  return entry;
}

void printTable(const ImageReport& report) {
  std::cout << report.image << " (" << report.width_px << " x " << report.height_px << ", " << std::fixed
            << std::setprecision(1) << report.cpu_ms << " ms CPU): ";
  if (!report.detection) {
    std::cout << "no board\n";
    return;
  }
  std::cout << report.detection->corners.size() << " corners, orientation "
            << (report.detection->orientation_known ? "known" : "unknown: ids may be turned by 180 degrees")
            << "\n   id      x px      y px  sigma x  sigma y\n" << std::setprecision(3);
  for (const Corner& corner : report.detection->corners) {
    std::cout << std::setw(5) << corner.id << std::setw(10) << corner.pixel.x() << std::setw(10) << corner.pixel.y()
              << std::setw(9) << std::sqrt(corner.covariance_px2(0, 0)) << std::setw(9)
              << std::sqrt(corner.covariance_px2(1, 1)) << '\n';
  }
}

}  // namespace

int main(int argc, char** argv) {
  CLI::App cli("Finds the calibration board in images. Moves no robot.", "servocal-detect");
  std::vector<std::string> images;
  std::string board_file;
  bool as_json = false;
  cli.add_option("IMAGE", images, "Images to look at")->required();
  cli.add_option("--board", board_file,
                 "Board file (YAML); the default board, 7 x 5 squares of 30 mm with a hollow corner, if not given");
  cli.add_flag("--json", as_json, "Print JSON: corner ids, pixels, covariance (px^2), orientation, CPU time (ms)");
  cli.footer("Pixel (0,0) is the centre of the top-left pixel. Example:\n"
             "  $ servocal-detect --board board.yaml left01.jpg\n"
             "  left01.jpg (640 x 480, 8.1 ms CPU): 54 corners, orientation known\n"
             "     id      x px      y px  sigma x  sigma y\n"
             "      0   475.784   264.518    0.015    0.015\n"
             "  ...\n"
             "  Found the board in 1 of 1 images.\n"
             "Exit code 4: the board is in none of the images.\n");
  return app::guardedMain(cli, argc, argv, [&] {
    cv::setNumThreads(1);
    const BoardSpec board = board_file.empty() ? BoardSpec() : loadBoard(board_file);
    std::size_t found = 0;
    json reports = json::array();
    for (const std::string& image : images) {
      const ImageReport report = detectIn(image, board);
      if (report.detection) ++found;
      if (as_json) reports.push_back(toJson(report));
      else printTable(report);
    }
    if (as_json) std::cout << json{{"images", reports}}.dump(1) << '\n';
    else std::cout << "Found the board in " << found << " of " << images.size() << " images.\n";
    return found > 0 ? app::kOk : app::kGoalNotMet;
  });
}
