// SPDX-License-Identifier: GPL-3.0-or-later
// Detection on rendered frames, next to OpenCV's two finders in the same run: recall by tilt, corner
// error, wrong orientations and boards, z-scores, CPU time. One thread.
#include <CLI/CLI.hpp>
#include <Eigen/Cholesky>
#include <algorithm>
#include <array>
#include <cstdio>
#include <ctime>
#include <map>
#include <opencv2/calib3d.hpp>
#include <opencv2/imgproc.hpp>
#include <optional>
#include <string>

#include "board_picture.h"
#include "servocal/board/detector.h"

namespace {

using namespace servocal;
using Eigen::Vector2d;
using test::Picture;
using test::PictureOptions;

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
      spacing = std::min(
          spacing, cv::norm(corners[row * size.width + column] - corners[row * size.width + column - 1]));
  for (int k = size.width; k < size.area(); ++k)
    spacing = std::min(spacing, cv::norm(corners[k] - corners[k - size.width]));
  const int half = std::max(1, static_cast<int>(0.4 * spacing));
  cv::cornerSubPix(gray, corners, {half, half}, {-1, -1},
                   {cv::TermCriteria::COUNT + cv::TermCriteria::EPS, 30, 0.01});
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

// Pictures of regular things that are no checkerboard of the wanted size: tiles, lines, dots, text, weave,
// noise, by `kind` in [0, 6).
cv::Mat texture(std::mt19937& random, int width, int height, int kind) {
  const auto uniform = [&](double low, double high) { return test::picture::uniform(random, low, high); };
  const double dark = uniform(10, 90), bright = dark + uniform(50, 150), pitch = uniform(8, 40);
  const double angle = uniform(0, M_PI), c = std::cos(angle), s = std::sin(angle);
  cv::Mat image(height, width, CV_8UC1, cv::Scalar(bright));
  if (kind == 3) {
    for (double y = 0; y < height; y += pitch)
      cv::putText(image, "the quick brown fox 0123456789 XXX HHH +++ ### jumps over the lazy dog",
                  {0, static_cast<int>(y)}, cv::FONT_HERSHEY_SIMPLEX, pitch / 30, cv::Scalar(dark),
                  1 + static_cast<int>(pitch / 20), cv::LINE_AA);
  }
  for (int y = 0; y < height && kind != 3; ++y) {
    for (int x = 0; x < width; ++x) {
      const double u = (c * x + s * y) / pitch, v = (c * y - s * x) / pitch;
      const double fu = u - std::floor(u), fv = v - std::floor(v);
      double value = bright;
      switch (kind) {
        case 0: value = fu < 0.12 || fv < 0.12 ? dark : bright; break;                 // Tiles and joints.
        case 1: value = fu < 0.5 ? dark : bright; break;                               // Stripes.
        case 2: value = std::hypot(fu - 0.5, fv - 0.5) < 0.33 ? dark : bright; break;  // Dots.
        case 4:
          value = 0.5 * (dark + bright) + 0.25 * (bright - dark) * (std::sin(M_PI * u) + std::sin(M_PI * v));
          break;
        default:
          value = (static_cast<int>(std::floor(u) + std::floor(v)) & 1) ? dark : bright;  // Endless squares.
      }
      image.at<uchar>(y, x) = cv::saturate_cast<uchar>(value);
    }
  }
  cv::GaussianBlur(image, image, {}, uniform(0.5, 1.5));
  cv::RNG noise(static_cast<std::uint64_t>(random()));
  cv::Mat grain(image.size(), CV_16SC1), sum;
  noise.fill(grain, cv::RNG::NORMAL, 0.0, uniform(1, 5));
  image.convertTo(sum, CV_16SC1);
  sum += grain;
  sum.convertTo(image, CV_8UC1);
  return image;
}

void line(const char* name, const Tally& t) {
  std::printf("%-12s", name);
  for (const auto& [tilt, counts] : t.by_tilt) std::printf(" %5.0f", 100.0 * counts.first / counts.second);
  std::printf(" | %6.3f %6.3f | %5d %5d | %7.1f %7.1f | %7.1f %7.1f\n", quantile(t.rms_px, 0.5),
              quantile(t.rms_px, 0.9), t.misplaced, t.false_boards, quantile(t.cpu_ms, 0.5),
              quantile(t.cpu_ms, 0.95), quantile(t.cpu_none_ms, 0.5), quantile(t.cpu_none_ms, 0.95));
}

void run(int width, int height, int frames, int opencv_every, unsigned seed) {
  const BoardSpec board;
  const Checkerboard& squares = *board.as<Checkerboard>();
  const cv::Size size(squares.cornersX(), squares.cornersY());
  std::mt19937 random(seed);
  Ours ours;
  Tally fcc, sb, ours_same;                   // The last: ours on the frames that OpenCV saw too.
  std::array<std::vector<double>, 3> common;  // RMS of ours and theirs where all found the board.
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
      error =
          detection->orientation_known ? rms(found, picture.corners) : rmsEitherWay(found, picture.corners);
      if (detection->orientation_known && rmsEitherWay(found, picture.corners) < error) ++ours.wrong_turn;
      double spacing = 1e9;
      for (int k = 1; k < size.area(); ++k) {
        if (k % size.width) spacing = std::min(spacing, (picture.corners[k] - picture.corners[k - 1]).norm());
        if (k >= size.width)
          spacing = std::min(spacing, (picture.corners[k] - picture.corners[k - size.width]).norm());
      }
      if (squares.hollow_inner_ratio * spacing >= 6) {
        ++ours.visible;
        if (!detection->orientation_known) ++ours.undecided;
      }
      if (detection->orientation_known && error < kMisplacedPx) {
        for (const Corner& corner : detection->corners) {
          ours.z_squares += corner.covariance_px2.llt()
                                .matrixL()
                                .solve(corner.pixel - picture.corners[corner.id])
                                .squaredNorm();
          ours.z_count += 2;
        }
      }
      // Two more frames of a board that moves.
      PictureOptions moved = o;
      for (int step = 0; step < 2; ++step) {
        moved.centre_px += Vector2d(8, -5);
        moved.roll_rad += 0.01;
        moved.seed = random();
        if (!wholePlateInside(board, moved)) break;
        const Picture next = test::renderPicture(board, moved);
        start = cpuMs();
        const auto track = detector.track(next.gray);
        ours.tracked_ms.push_back(cpuMs() - start);
        ++ours.tracks;
        if (!track) break;
        ++ours.tracked;
      }
    }
    tally(ours, tilt, error, detection.has_value());

    std::optional<cv::Mat> none;
    if (frame % 4 == 0) {
      // Half of them clutter, the rest textures.
      o.board = false;
      none = (frame / 4) % 2 == 0 ? test::renderPicture(board, o).gray
                                  : texture(random, width, height, (frame / 8) % 6);
      start = cpuMs();
      if (board::Detector(board).detect(*none)) ++ours.false_boards;
      ours.cpu_none_ms.push_back(cpuMs() - start);
    }

    if (opencv_every == 0 || (frame / 8) % opencv_every != 0) continue;
    tally(ours_same, tilt, error, detection.has_value());
    ours_same.cpu_ms.push_back(detect_ms);
    bool all_found = detection && error < kMisplacedPx;
    std::array<double, 2> errors{};
    for (const bool sector : {false, true}) {
      Tally& t = sector ? sb : fcc;
      start = cpuMs();
      const auto corners = sector ? sectorBased(picture.gray, size) : classic(picture.gray, size);
      t.cpu_ms.push_back(cpuMs() - start);
      errors[sector] = corners ? rmsEitherWay(*corners, picture.corners) : 0;
      tally(t, tilt, errors[sector], corners.has_value());
      all_found = all_found && corners && errors[sector] < kMisplacedPx;
      // The classic finder may take minutes for one large texture.
      if (!none || width * height > 1000000) continue;
      start = cpuMs();
      if (sector ? sectorBased(*none, size) : classic(*none, size)) ++t.false_boards;
      t.cpu_none_ms.push_back(cpuMs() - start);
    }
    if (all_found) {
      common[0].push_back(error);
      common[1].push_back(errors[0]);
      common[2].push_back(errors[1]);
    }
  }
  std::printf("\n%d x %d, %d frames with a board and %d without (OpenCV: every %d.)\n", width, height, frames,
              (frames + 3) / 4, opencv_every);
  std::printf("%-12s", "recall %");
  for (const int tilt : tilts) std::printf(" %4d'", tilt);
  std::printf(" | RMS px    p90 | >2 px false | CPU ms     p95 | no board   p95\n");
  line("servocal", ours);
  if (opencv_every > 0) {
    line(" same frames", ours_same);
    line("fcc+subpix", fcc);
    line("SB", sb);
  }
  if (!common[0].empty())
    std::printf("on the %zu frames found by all, median RMS px: servocal %.3f, fcc+subpix %.3f, SB %.3f\n",
                common[0].size(), quantile(common[0], 0.5), quantile(common[1], 0.5),
                quantile(common[2], 0.5));
  std::printf(
      "servocal: tracked %d of %d, %.2f ms (p95 %.2f); wrong turns %d; undecided %d of %d with a mark of 6 "
      "px; z std %.2f\n",
      ours.tracked, ours.tracks, quantile(ours.tracked_ms, 0.5), quantile(ours.tracked_ms, 0.95),
      ours.wrong_turn, ours.undecided, ours.visible, std::sqrt(ours.z_squares / std::max(1, ours.z_count)));
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
  std::printf(
      "\nWrong boards, %d frames each: other sizes taken for the hollow board %d, for a plain one %d; cut "
      "board found %d\n",
      frames, hollow_false, plain_false, cut_false);
}

}  // namespace

int main(int argc, char** argv) {
  CLI::App cli("Measures board detection on rendered frames, next to OpenCV's finders.", "detection_bench");
  int vga = 3000, kinect = 1600, hd = 480, wrong = 800, every = 16, hd_every = 60;
  unsigned seed = 1;
  cli.add_option("--vga", vga, "Frames at 640 x 480")->capture_default_str();
  cli.add_option("--ir", kinect, "Frames at 512 x 424")->capture_default_str();
  cli.add_option("--hd", hd, "Frames at 1920 x 1080")->capture_default_str();
  cli.add_option("--wrong", wrong, "Frames with wrong boards, of three kinds each")->capture_default_str();
  cli.add_option("--opencv-every", every, "OpenCV sees one group of 8 frames in this many; 0: none")
      ->capture_default_str();
  cli.add_option("--hd-opencv-every", hd_every, "The same at 1920 x 1080, where it takes minutes per frame")
      ->capture_default_str();
  cli.add_option("--seed", seed, "Seed of the frames")->capture_default_str();
  CLI11_PARSE(cli, argc, argv);
  cv::setNumThreads(1);
  if (vga > 0) run(640, 480, vga, every, seed);
  if (kinect > 0) run(512, 424, kinect, every, seed + 1);
  if (hd > 0) run(1920, 1080, hd, hd_every, seed + 2);
  if (wrong > 0) runWrongBoards(wrong, seed + 3);
  return 0;
}
