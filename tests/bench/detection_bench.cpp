// SPDX-License-Identifier: GPL-3.0-or-later
// Detection on rendered frames, next to OpenCV's two finders in the same run: recall by tilt, corner
// error, wrong orientations and boards, z-scores, CPU time. One thread.
#include <CLI/CLI.hpp>
#include <Eigen/Cholesky>
#include <cstdio>
#include <ctime>
#include <map>
#include <opencv2/calib3d.hpp>
#include <optional>
#include <string>

#include "board_picture.h"
#include "servocal/board/detector.h"

namespace {

using namespace servocal;
using test::Picture;
using test::PictureOptions;
using Eigen::Vector2d;

double cpuMs() {
  timespec time;
  clock_gettime(CLOCK_PROCESS_CPUTIME_ID, &time);
  return time.tv_sec * 1e3 + time.tv_nsec * 1e-6;
}

double quantile(std::vector<double> values, double q) {
  if (values.empty()) return std::nan("");
  std::sort(values.begin(), values.end());
  return values[std::min(values.size() - 1, static_cast<std::size_t>(q * values.size()))];
}

// What one detector did on one camera's frames.
struct Tally {
  std::map<int, std::pair<int, int>> by_tilt;  // Found, shown.
  std::vector<double> rms_px, cpu_ms, cpu_none_ms;
  int misplaced = 0, false_boards = 0;
};

struct Ours : Tally {
  std::vector<double> tracked_ms;
  int tracked = 0, tracks = 0, wrong_turn = 0, undecided = 0, visible = 0;
  double z_squares = 0;
  int z_count = 0;
};

double rms(const std::vector<Vector2d>& found, const std::vector<Vector2d>& truth) {
  double sum = 0;
  for (std::size_t k = 0; k < found.size(); ++k) sum += (found[k] - truth[k]).squaredNorm();
  return std::sqrt(sum / found.size());
}

// OpenCV does not know the board's orientation: the better of both orders counts.
double rmsEitherWay(const std::vector<Vector2d>& found, std::vector<Vector2d> truth) {
  const double straight = rms(found, truth);
  std::reverse(truth.begin(), truth.end());
  return std::min(straight, rms(found, truth));
}

constexpr double kMisplacedPx = 2.0;

void tally(Tally& tally, int tilt_deg, double error_px, bool found) {
  auto& [hits, shown] = tally.by_tilt[tilt_deg];
  ++shown;
  if (!found) return;
  if (error_px > kMisplacedPx) {
    ++tally.misplaced;
    return;
  }
  ++hits;
  tally.rms_px.push_back(error_px);
}

std::optional<std::vector<Vector2d>> classic(const cv::Mat& gray, const cv::Size& size) {
  std::vector<cv::Point2f> corners;
  if (!cv::findChessboardCorners(gray, size, corners)) return std::nullopt;
  // The window that served best on such boards: 0.4 of the smallest spacing.
  double spacing = 1e9;
  for (int row = 0; row < size.height; ++row)
    for (int column = 1; column < size.width; ++column)
      spacing = std::min(spacing, cv::norm(corners[row * size.width + column] - corners[row * size.width + column - 1]));
  for (int k = size.width; k < size.area(); ++k)
    spacing = std::min(spacing, cv::norm(corners[k] - corners[k - size.width]));
  const int half = std::max(1, static_cast<int>(0.4 * spacing));
  cv::cornerSubPix(gray, corners, {half, half}, {-1, -1}, {cv::TermCriteria::COUNT + cv::TermCriteria::EPS, 30, 0.01});
  std::vector<Vector2d> result;
  for (const cv::Point2f& p : corners) result.emplace_back(p.x, p.y);
  return result;
}

std::optional<std::vector<Vector2d>> sectorBased(const cv::Mat& gray, const cv::Size& size) {
  std::vector<cv::Point2f> corners;
  if (!cv::findChessboardCornersSB(gray, size, corners)) return std::nullopt;
  std::vector<Vector2d> result;
  for (const cv::Point2f& p : corners) result.emplace_back(p.x, p.y);
  return result;
}

PictureOptions drawOptions(std::mt19937& random, int width, int height, double tilt_deg) {
  const auto uniform = [&](double low, double high) { return test::picture::uniform(random, low, high); };
  PictureOptions o;
  o.width_px = width;
  o.height_px = height;
  o.focal_px = 0.94 * width;
  o.tilt_rad = tilt_deg * M_PI / 180;
  o.square_px = std::exp(uniform(std::log(8.0), std::log(60.0)));
  o.tilt_axis_rad = uniform(0, 2 * M_PI);
  o.roll_rad = uniform(0, 2 * M_PI);
  o.blur_px = uniform(0, 1) < 0.1 ? uniform(1.5, 3) : uniform(0.5, 1.5);
  o.motion_px = uniform(0, 1) < 0.2 ? uniform(0, 3) : 0;
  o.motion_rad = uniform(0, M_PI);
  o.noise_gray = uniform(1, 5);
  o.black = uniform(10, 60);
  o.white = o.black + uniform(60, 180);
  o.light_gradient = uniform(-0.3, 0.3);
  o.highlight_gray = uniform(0, 1) < 0.2 ? uniform(0, 60) : 0;
  o.k1 = uniform(-0.2, 0.1);
  o.centre_px = {uniform(0, width), uniform(0, height)};
  o.seed = random();
  return o;
}

bool wholePlateInside(const BoardSpec& board, PictureOptions o) {
  const auto outline = test::projectOutline(board, o);
  return std::all_of(outline.begin(), outline.end(), [&](const Vector2d& p) {
    return p.x() > 2 && p.y() > 2 && p.x() < o.width_px - 3 && p.y() < o.height_px - 3;
  });
}

void line(const char* name, const Tally& t) {
  std::printf("%-12s", name);
  for (const auto& [tilt, counts] : t.by_tilt) std::printf(" %5.0f", 100.0 * counts.first / counts.second);
  std::printf(" | %6.3f %6.3f | %5d %5d | %7.1f %7.1f | %7.1f %7.1f\n", quantile(t.rms_px, 0.5), quantile(t.rms_px, 0.9),
              t.misplaced, t.false_boards, quantile(t.cpu_ms, 0.5), quantile(t.cpu_ms, 0.95),
              quantile(t.cpu_none_ms, 0.5), quantile(t.cpu_none_ms, 0.95));
}

void run(int width, int height, int frames, int opencv_every, unsigned seed) {
  const BoardSpec board;
  const Checkerboard& squares = *board.as<Checkerboard>();
  const cv::Size size(squares.cornersX(), squares.cornersY());
  std::mt19937 random(seed);
  Ours ours;
  Tally fcc, sb, ours_same;  // The last: ours on the frames that OpenCV saw too.
  const int tilts[] = {0, 15, 30, 45, 55, 60, 65, 70};
  for (int frame = 0; frame < frames; ++frame) {
    const int tilt = tilts[frame % 8];
    PictureOptions o = drawOptions(random, width, height, tilt);
    while (!wholePlateInside(board, o)) o = drawOptions(random, width, height, tilt);
    // One in eight: something in front of an outer square.
    if (random() % 8 == 0) o.covers.push_back({2.0, -0.6, 2.6, 0.6, 120});
    const Picture picture = test::renderPicture(board, o);

    board::Detector detector(board);
    double start = cpuMs();
    const auto detection = detector.detect(picture.gray);
    const double detect_ms = cpuMs() - start;
    ours.cpu_ms.push_back(detect_ms);
    double error = 0;
    if (detection) {
      std::vector<Vector2d> found;
      for (const Corner& corner : detection->corners) found.push_back(corner.pixel);
      error = detection->orientation_known ? rms(found, picture.corners) : rmsEitherWay(found, picture.corners);
      if (detection->orientation_known && rmsEitherWay(found, picture.corners) < error) ++ours.wrong_turn;
      double spacing = 1e9;
      for (int k = 1; k < size.area(); ++k) {
        if (k % size.width) spacing = std::min(spacing, (picture.corners[k] - picture.corners[k - 1]).norm());
        if (k >= size.width) spacing = std::min(spacing, (picture.corners[k] - picture.corners[k - size.width]).norm());
      }
      if (squares.hollow_inner_ratio * spacing >= 6) {
        ++ours.visible;
        if (!detection->orientation_known) ++ours.undecided;
      }
      if (detection->orientation_known && error < kMisplacedPx) {
        for (const Corner& corner : detection->corners) {
          ours.z_squares += corner.covariance_px2.llt().matrixL().solve(corner.pixel - picture.corners[corner.id]).squaredNorm();
          ours.z_count += 2;
        }
      }
      o.centre_px += Vector2d(8, -5);
      o.seed = random();
      const Picture next = test::renderPicture(board, o);
      start = cpuMs();
      const auto track = detector.track(next.gray);
      ours.tracked_ms.push_back(cpuMs() - start);
      ++ours.tracks;
      if (track) ++ours.tracked;
      o.centre_px -= Vector2d(8, -5);
    }
    tally(ours, tilt, error, detection.has_value());

    o.board = false;
    const Picture none = test::renderPicture(board, o);
    start = cpuMs();
    if (board::Detector(board).detect(none.gray)) ++ours.false_boards;
    const double none_ms = cpuMs() - start;
    ours.cpu_none_ms.push_back(none_ms);

    if (opencv_every == 0 || (frame / 8) % opencv_every != 0) continue;
    tally(ours_same, tilt, error, detection.has_value());
    ours_same.cpu_ms.push_back(detect_ms);
    ours_same.cpu_none_ms.push_back(none_ms);
    for (const bool sector : {false, true}) {
      Tally& t = sector ? sb : fcc;
      start = cpuMs();
      const auto corners = sector ? sectorBased(picture.gray, size) : classic(picture.gray, size);
      t.cpu_ms.push_back(cpuMs() - start);
      tally(t, tilt, corners ? rmsEitherWay(*corners, picture.corners) : 0, corners.has_value());
      start = cpuMs();
      if (sector ? sectorBased(none.gray, size) : classic(none.gray, size)) ++t.false_boards;
      t.cpu_none_ms.push_back(cpuMs() - start);
    }
  }
  std::printf("\n%d x %d, %d frames with a board and %d without (OpenCV: every %d.)\n", width, height, frames, frames, opencv_every);
  std::printf("%-12s", "recall %");
  for (const int tilt : tilts) std::printf(" %4d'", tilt);
  std::printf(" | RMS px    p90 | >2 px false | CPU ms     p95 | no board   p95\n");
  line("servocal", ours);
  if (opencv_every > 0) {
    line(" same frames", ours_same);
    line("fcc+subpix", fcc);
    line("SB", sb);
  }
  std::printf("servocal: tracked %d of %d, %.2f ms (p95 %.2f); wrong turns %d; undecided %d of %d with a mark of 6 px; z std %.2f\n",
              ours.tracked, ours.tracks, quantile(ours.tracked_ms, 0.5), quantile(ours.tracked_ms, 0.95), ours.wrong_turn,
              ours.undecided, ours.visible, std::sqrt(ours.z_squares / std::max(1, ours.z_count)));
  std::fflush(stdout);
}

// Boards that are not the wanted one: other sizes, and the right one cut by something in front.
void runWrongBoards(int frames, unsigned seed) {
  std::mt19937 random(seed);
  int plain_false = 0, hollow_false = 0, cut_false = 0;
  const std::pair<int, int> sizes[] = {{7, 6}, {8, 5}, {9, 7}, {6, 5}, {7, 4}, {10, 7}, {5, 5}, {9, 5}};
  for (int frame = 0; frame < frames; ++frame) {
    PictureOptions o = drawOptions(random, 640, 480, test::picture::uniform(random, 0, 55));
    const auto [squares_x, squares_y] = sizes[frame % 8];
    const BoardSpec other{Checkerboard{squares_x, squares_y, 0.03, false}};
    BoardSpec wanted;
    const Picture picture = test::renderPicture(other, o);
    if (board::Detector(wanted).detect(picture.gray)) ++hollow_false;
    wanted.pattern = Checkerboard{7, 5, 0.03, false};
    if (board::Detector(wanted).detect(picture.gray)) ++plain_false;
    // A strip over one line of corners.
    o.covers.push_back({-1, 0.7, 8, 1.3, test::picture::uniform(random, 0, 255)});
    if (board::Detector(BoardSpec()).detect(test::renderPicture(BoardSpec(), o).gray)) ++cut_false;
  }
  std::printf("\nWrong boards, %d frames each: other sizes taken for the hollow board %d, for a plain one %d; cut board found %d\n",
              frames, hollow_false, plain_false, cut_false);
}

}  // namespace

int main(int argc, char** argv) {
  CLI::App cli("Measures board detection on rendered frames, next to OpenCV's finders.", "detection_bench");
  int vga = 400, kinect = 200, hd = 80, every = 4, hd_every = 10;
  unsigned seed = 1;
  cli.add_option("--vga", vga, "Frames at 640 x 480")->capture_default_str();
  cli.add_option("--ir", kinect, "Frames at 512 x 424")->capture_default_str();
  cli.add_option("--hd", hd, "Frames at 1920 x 1080")->capture_default_str();
  cli.add_option("--opencv-every", every, "OpenCV sees one group of 8 frames in this many; 0: none")->capture_default_str();
  cli.add_option("--hd-opencv-every", hd_every, "The same at 1920 x 1080, where it takes minutes per frame")
      ->capture_default_str();
  cli.add_option("--seed", seed, "Seed of the frames")->capture_default_str();
  CLI11_PARSE(cli, argc, argv);
  cv::setNumThreads(1);
  if (vga > 0) run(640, 480, vga, every, seed);
  if (kinect > 0) run(512, 424, kinect, every, seed + 1);
  if (hd > 0) run(1920, 1080, hd, hd_every, seed + 2);
  if (vga > 0) runWrongBoards(vga, seed + 3);
  return 0;
}
