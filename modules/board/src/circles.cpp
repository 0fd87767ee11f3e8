// SPDX-License-Identifier: GPL-3.0-or-later
#include <Eigen/Cholesky>
#include <Eigen/Geometry>
#include <Eigen/LU>
#include <algorithm>
#include <cmath>
#include <opencv2/calib3d.hpp>
#include <opencv2/features2d.hpp>
#include <opencv2/imgproc.hpp>
#include <stdexcept>

#include "finder.h"
#include "sample.h"
#include "warp.h"

namespace servocal::board {
namespace {

using Eigen::Matrix2d;
using Eigen::Matrix3d;
using Eigen::Vector2d;

constexpr double kFloorPx = 0.01;  // Below this, print and lens decide, not noise.
constexpr double kMinStep = 12.0;  // Gray levels between disc and surroundings.

/// A disc as measured.
struct Disc {
  Vector2d centre;  // Of the ellipse, px.
  Matrix2d covariance_px2;
  double size = 1.0;  // Over the nominal diameter.
};

/// Where brightness along from + t * ray, t in [0, most], first reaches half of what it rises by.
std::optional<double> edgeAlong(const cv::Mat& gray, const Vector2d& from, const Vector2d& ray, double most) {
  thread_local std::vector<double> profile;
  const double step = 0.3 / ray.norm();
  profile.clear();
  double brightest = 0;
  for (double t = 0; t <= most; t += step) {
    const Vector2d p = from + t * ray;
    if (!insideImage(gray, p)) break;
    profile.push_back(bilinear(gray, p));
    brightest = std::max(brightest, profile.back());
  }
  if (profile.size() < 6 || brightest - profile.front() < kMinStep) return std::nullopt;
  double dark = 0;  // Inner third of the way: surely inside.
  const std::size_t third = std::max<std::size_t>(1, static_cast<std::size_t>(0.4 / step));
  for (std::size_t k = 0; k < third && k < profile.size(); ++k) dark += profile[k] / third;
  const double middle = 0.5 * (dark + brightest);
  for (std::size_t k = third + 1; k < profile.size(); ++k) {  // Dirt near the centre is no edge.
    if (profile[k] < middle) continue;
    return step * (k - 1 + (middle - profile[k - 1]) / (profile[k] - profile[k - 1]));
  }
  return std::nullopt;
}

/// Fits an ellipse to the edge of a disc. `axes`: radii along x and y of the board, px; `most`: how far from
/// the centre to look, in radii.
std::optional<Disc> fitDisc(const cv::Mat& gray, Vector2d centre, const Matrix2d& axes, double most) {
  const double around = 2 * M_PI * std::sqrt(std::abs(axes.determinant()));
  const int rays = std::clamp(static_cast<int>(around / 2.0), 12, 64);
  Disc disc;
  for (int pass = 0; pass < 2; ++pass) {
    // In units of the radii the ellipse is a circle, nearly: a x^2 + b x y + c y^2 + d x + e y = 1.
    Eigen::Matrix<double, 5, 5> normal = Eigen::Matrix<double, 5, 5>::Zero();
    Eigen::Matrix<double, 5, 1> right = Eigen::Matrix<double, 5, 1>::Zero();
    std::vector<Vector2d> points;
    std::vector<double> reach;
    for (int k = 0; k < rays; ++k) {
      const double angle = 2 * M_PI * k / rays;
      const Vector2d unit(std::cos(angle), std::sin(angle));
      const auto t = edgeAlong(gray, centre, axes * unit, most);
      if (!t) continue;
      points.push_back(*t * unit);
      reach.push_back(*t);
    }
    if (static_cast<int>(points.size()) < std::max(8, 4 * rays / 5)) return std::nullopt;
    // Dirt and highlights on the edge stand out from the rest of it.
    std::vector<double> sorted = reach;
    std::nth_element(sorted.begin(), sorted.begin() + sorted.size() / 2, sorted.end());
    const double usual = sorted[sorted.size() / 2];
    std::vector<Vector2d> kept;
    for (std::size_t k = 0; k < points.size(); ++k)
      if (std::abs(reach[k] - usual) < 0.25 * usual) kept.push_back(points[k]);
    points = std::move(kept);
    for (const Vector2d& p : points) {
      Eigen::Matrix<double, 5, 1> row;
      row << p.x() * p.x(), p.x() * p.y(), p.y() * p.y(), p.x(), p.y();
      normal += row * row.transpose();
      right += row;
    }
    if (static_cast<int>(points.size()) < std::max(8, 4 * rays / 5)) return std::nullopt;
    const Eigen::Matrix<double, 5, 1> conic = normal.ldlt().solve(right);
    Matrix2d form;
    form << conic[0], 0.5 * conic[1], 0.5 * conic[1], conic[2];
    if (!(form.determinant() > 1e-6)) return std::nullopt;
    const Vector2d middle = -0.5 * form.inverse() * conic.tail<2>();
    const double level =
        1 + middle.dot(form * middle);  // The ellipse: (p - middle)' form (p - middle) = level.
    if (!(level > 0) || middle.norm() > 0.7) return std::nullopt;
    disc.size = std::sqrt(level / std::sqrt(form.determinant()));

    // Distance of the edge from the ellipse, px, and what it says about the centre.
    double squares = 0;
    Matrix2d information = Matrix2d::Zero();
    const Matrix2d to_units = axes.inverse();
    for (const Vector2d& p : points) {
      const Vector2d d = p - middle;
      const Vector2d gradient = to_units.transpose() * (2 * form * d);  // By pixels.
      const double miss = (d.dot(form * d) - level) / gradient.norm();
      squares += miss * miss;
      information += gradient.normalized() * gradient.normalized().transpose();
    }
    const double variance = squares / (static_cast<double>(points.size()) - 5);
    if (variance > std::pow(0.15 * std::sqrt(std::abs(axes.determinant())) + 0.3, 2)) return std::nullopt;
    centre += axes * middle;
    disc.centre = centre;
    disc.covariance_px2 = variance * information.inverse() + kFloorPx * kFloorPx * Matrix2d::Identity();
  }
  return disc;
}

/// From the projection of a circle's centre to the centre of the ellipse that is seen, px.
Vector2d perspectiveShift(const Matrix3d& homography, const Vector2d& centre, double radius) {
  Matrix3d circle;  // Points p with p' circle p = 0.
  circle << 1, 0, -centre.x(), 0, 1, -centre.y(), -centre.x(), -centre.y(),
      centre.squaredNorm() - radius * radius;
  const Matrix3d back = homography.inverse();
  const Matrix3d seen = back.transpose() * circle * back;
  const Vector2d ellipse = -seen.topLeftCorner<2, 2>().inverse() * seen.topRightCorner<2, 1>();
  return ellipse - (homography * centre.homogeneous()).hnormalized();
}

cv::Ptr<cv::FeatureDetector> blobDetector(const cv::Size& size) {
  cv::SimpleBlobDetector::Params params;
  params.minThreshold = 20;
  params.maxThreshold = 230;
  params.thresholdStep = 10;
  params.minRepeatability = 2;
  params.minDistBetweenBlobs = 4;
  params.minArea = 25;
  params.maxArea = static_cast<float>(0.03 * size.area());
  params.filterByCircularity = false;  // Tilted discs are narrow.
  params.filterByInertia = true;
  params.minInertiaRatio = 0.08f;
  params.filterByConvexity = true;
  params.minConvexity = 0.85f;
  return cv::SimpleBlobDetector::create(params);
}

class CircleFinder final : public Finder {
 public:
  explicit CircleFinder(const BoardSpec& board)
      : board_(board), grid_(*board.as<CircleGrid>()), corners_(board.corners()) {
    for (Eigen::Vector3d& corner : corners_) corner /= grid_.spacing_m;
  }

  std::optional<BoardDetection> detect(const cv::Mat& image) override {
    const cv::Mat gray = toGray(image);
    reset();
    // Discs are large in large images, mostly.
    int shrink = 1;
    while (std::max(gray.cols, gray.rows) / shrink > 1400) shrink *= 2;
    for (; shrink >= 1; shrink /= 2) {
      for (const bool white : {white_, !white_}) {
        if (auto detection = find(colored(gray, white), shrink, Vector2d::Zero())) {
          white_ = white;
          return detection;
        }
      }
    }
    return std::nullopt;
  }

  std::optional<BoardDetection> track(const cv::Mat& image) override {
    if (last_.empty()) return std::nullopt;
    Vector2d low = last_.front(), high = low;
    for (const Vector2d& p : last_) low = low.cwiseMin(p), high = high.cwiseMax(p);
    constexpr double kMotionPx = 40.0;
    const double step = (high - low).norm() / std::max(grid_.circles_x, grid_.circles_y);
    low += velocity_.cwiseMin(0.0) - Vector2d::Constant(step + kMotionPx);
    high += velocity_.cwiseMax(0.0) + Vector2d::Constant(step + kMotionPx);
    const int x0 = std::max(0, static_cast<int>(low.x())), y0 = std::max(0, static_cast<int>(low.y()));
    const int x1 = std::min(image.cols, static_cast<int>(high.x()) + 1);
    const int y1 = std::min(image.rows, static_cast<int>(high.y()) + 1);
    if (x1 - x0 < 24 || y1 - y0 < 24) return std::nullopt;
    const cv::Mat gray = toGray(image(cv::Rect(x0, y0, x1 - x0, y1 - y0)));
    const int shrink = std::clamp(static_cast<int>(step / 20.0), 1, 4);
    return find(colored(gray, white_), shrink, Vector2d(x0, y0));
  }

  void reset() override {
    last_.clear();
    velocity_.setZero();
  }

 private:
  BoardSpec board_;
  CircleGrid grid_;
  std::vector<Eigen::Vector3d> corners_;  // By id; unit: the spacing.
  std::vector<Vector2d> last_;            // By id. Empty: nothing to track.
  Vector2d velocity_ = Vector2d::Zero();  // Of the board, px per frame.

  bool white_ = false;  // White discs on black, last time (a plate lit from behind).

  static cv::Mat colored(const cv::Mat& gray, bool white) {
    if (!white) return gray;
    cv::Mat inverted;
    cv::bitwise_not(gray, inverted);
    return inverted;
  }

  double radius(int id) const {
    return 0.5 * grid_.diameter_m / grid_.spacing_m * (id == 0 ? grid_.bigger_corner_ratio : 1.0);
  }

  Matrix3d homographyTo(const std::vector<Vector2d>& pixels) const {
    std::vector<Vector2d> from;
    for (const Eigen::Vector3d& corner : corners_) from.push_back(corner.head<2>());
    return fitHomography(from, pixels);
  }

  std::optional<BoardDetection> find(const cv::Mat& gray, int shrink, const Vector2d& offset) {
    cv::Mat small = gray;
    if (shrink > 1) cv::resize(gray, small, cv::Size(), 1.0 / shrink, 1.0 / shrink, cv::INTER_AREA);
    std::vector<cv::KeyPoint> blobs;
    blobDetector(small.size())->detect(small, blobs);
    for (const std::vector<cv::Point2f>& group : groupsOf(blobs)) {
      std::vector<cv::Point2f> found;
      const int kind = grid_.asymmetric ? cv::CALIB_CB_ASYMMETRIC_GRID : cv::CALIB_CB_SYMMETRIC_GRID;
      const cv::Size size(grid_.circles_x, grid_.circles_y);
      if (!cv::findCirclesGrid(group, size, found, kind, nullptr) &&
          !cv::findCirclesGrid(group, size, found, kind | cv::CALIB_CB_CLUSTERING, nullptr))
        continue;
      std::vector<Vector2d> pixels;
      for (const cv::Point2f& p : found)
        pixels.push_back((Vector2d(p.x, p.y) + Vector2d::Constant(0.5)) * shrink - Vector2d::Constant(0.5));
      if (auto detection = accept(gray, numberings(pixels), offset)) return detection;
    }
    return std::nullopt;
  }

  /// Blobs of like size that stand about as far apart as the board's discs, if they are enough for a board:
  /// the grid finder is confused by other dots in the image.
  std::vector<std::vector<cv::Point2f>> groupsOf(const std::vector<cv::KeyPoint>& blobs) const {
    const double apart = (grid_.asymmetric ? M_SQRT1_2 : 1.0) * grid_.spacing_m / grid_.diameter_m;
    const double ratio = 1.6 * grid_.bigger_corner_ratio;
    const auto belong = [&](const cv::KeyPoint& a, const cv::KeyPoint& b) {
      const double small = std::min(a.size, b.size), large = std::max(a.size, b.size);
      return large < ratio * small && cv::norm(a.pt - b.pt) < 2.0 * apart * large;
    };
    std::vector<std::vector<cv::Point2f>> groups;
    std::vector<char> taken(blobs.size(), 0);
    for (std::size_t first = 0; first < blobs.size(); ++first) {
      if (taken[first]) continue;
      std::vector<std::size_t> members{first};
      taken[first] = 1;
      for (std::size_t k = 0; k < members.size(); ++k) {
        for (std::size_t other = 0; other < blobs.size(); ++other) {
          if (taken[other] || !belong(blobs[members[k]], blobs[other])) continue;
          taken[other] = 1;
          members.push_back(other);
        }
      }
      if (static_cast<int>(members.size()) < grid_.circles_x * grid_.circles_y) continue;
      std::vector<cv::Point2f> group;
      for (const std::size_t k : members) group.push_back(blobs[k].pt);
      groups.push_back(group);
    }
    return groups;
  }

  /// Every numbering of what was found that shows the board's front, none of its mirror images.
  std::vector<std::vector<Vector2d>> numberings(const std::vector<Vector2d>& found) const {
    const int columns = grid_.circles_x, rows = grid_.circles_y;
    std::vector<std::vector<Vector2d>> result;
    for (int way = 0; way < (columns == rows && !grid_.asymmetric ? 8 : 4); ++way) {
      std::vector<Vector2d> pixels;
      for (int id = 0; id < columns * rows; ++id) {
        int column = way & 1 ? columns - 1 - id % columns : id % columns;
        int row = way & 2 ? rows - 1 - id / columns : id / columns;
        if (way & 4) std::swap(column, row);
        pixels.push_back(found[row * columns + column]);
      }
      const Matrix3d homography = homographyTo(pixels);
      if (!(homography.topLeftCorner<2, 2>().determinant() > 0)) continue;  // At the board's centre.
      double worst = 0, nearest = 1e9;
      for (std::size_t id = 0; id < pixels.size(); ++id) {
        const Vector2d expected = (homography * corners_[id].head<2>().homogeneous()).hnormalized();
        worst = std::max(worst, (expected - pixels[id]).norm());
        if (id > 0) nearest = std::min(nearest, (pixels[id] - pixels[id - 1]).norm());
      }
      if (worst < 0.35 * nearest) result.push_back(pixels);
    }
    return result;
  }

  std::optional<BoardDetection> accept(const cv::Mat& gray,
                                       const std::vector<std::vector<Vector2d>>& numberings,
                                       const Vector2d& offset) {
    const bool marked = grid_.bigger_corner_ratio > 1.0;
    std::vector<std::vector<Disc>> candidates;
    std::vector<std::vector<Vector2d>> rough;
    for (const std::vector<Vector2d>& pixels : numberings) {
      const auto discs = measure(gray, pixels);
      if (!discs || (marked && !hasMark(*discs))) continue;
      candidates.push_back(*discs);
      rough.push_back(pixels);
    }
    if (candidates.empty() || (marked && candidates.size() > 1)) return std::nullopt;
    // Undecided: the numbering that continues the track, or else the one that starts nearest the upper left.
    std::size_t best = 0;
    const auto cost = [&](std::size_t k) {
      const Vector2d first = candidates[k].front().centre + offset;
      return last_.empty() ? first.x() + 1.001 * first.y() : (first - last_.front() - velocity_).norm();
    };
    for (std::size_t k = 1; k < candidates.size(); ++k)
      if (cost(k) < cost(best)) best = k;

    std::vector<Vector2d> centres;
    for (const Disc& disc : candidates[best]) centres.push_back(disc.centre);
    const Matrix3d homography = homographyTo(centres);
    BoardDetection detection;
    detection.orientation_known = board_.symmetry() == 1;
    std::vector<Vector2d> now;
    for (std::size_t id = 0; id < centres.size(); ++id) {
      const Vector2d shift =
          perspectiveShift(homography, corners_[id].head<2>(), radius(static_cast<int>(id)));
      if (!shift.allFinite()) return std::nullopt;
      const Vector2d pixel = centres[id] - shift + offset;
      detection.corners.push_back({static_cast<int>(id), pixel, candidates[best][id].covariance_px2});
      now.push_back(pixel);
    }
    velocity_ = last_.empty() ? Vector2d(Vector2d::Zero()) : Vector2d(now.front() - last_.front());
    last_ = now;
    return detection;
  }

  std::optional<std::vector<Disc>> measure(const cv::Mat& gray, const std::vector<Vector2d>& pixels) const {
    const Matrix3d homography = homographyTo(pixels);
    const double gap = grid_.asymmetric ? M_SQRT1_2 : 1.0;
    std::vector<Disc> discs;
    for (std::size_t id = 0; id < pixels.size(); ++id) {
      const Vector2d at = corners_[id].head<2>();
      const auto project = [&](const Vector2d& p) {
        return Vector2d((homography * p.homogeneous()).hnormalized());
      };
      const double r = radius(static_cast<int>(id));
      Matrix2d axes;
      for (int axis = 0; axis < 2; ++axis)
        axes.col(axis) =
            0.5 * (project(at + r * Vector2d::Unit(axis)) - project(at - r * Vector2d::Unit(axis)));
      const double most =
          0.95 * (gap - 0.5 * grid_.diameter_m / grid_.spacing_m) / r;  // Up to the next disc.
      const auto disc = fitDisc(gray, pixels[id], axes, std::min(2.0, most));
      if (!disc) return std::nullopt;
      discs.push_back(*disc);
    }
    return discs;
  }

  /// Disc 0 is as big as it should be beside the others, and no other is.
  bool hasMark(const std::vector<Disc>& discs) const {
    std::vector<double> others;
    for (std::size_t id = 1; id < discs.size(); ++id) others.push_back(discs[id].size);
    std::sort(others.begin(), others.end());
    const double usual = others[others.size() / 2], half_way = 0.5 * (1 + grid_.bigger_corner_ratio);
    return discs[0].size * grid_.bigger_corner_ratio > half_way * usual && others.back() < half_way * usual;
  }
};

}  // namespace

std::unique_ptr<Finder> makeCircleFinder(const BoardSpec& board) {
  const CircleGrid& grid = *board.as<CircleGrid>();
  if (grid.circles_x < 3 || grid.circles_y < 3)
    throw std::invalid_argument("Detector: the board needs at least 3 x 3 circles");
  return std::make_unique<CircleFinder>(board);
}

}  // namespace servocal::board
