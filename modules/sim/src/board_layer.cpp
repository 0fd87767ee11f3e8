// SPDX-License-Identifier: GPL-3.0-or-later
#include "board_layer.h"

#include <Eigen/LU>
#include <algorithm>
#include <array>
#include <cmath>
#include <opencv2/imgproc.hpp>
#include <variant>

namespace servocal::sim {
namespace {

constexpr int kNodeStep = 16;       // Footprint and light are interpolated between nodes.
constexpr double kNearestM = 0.05;  // A board nearer than this is not drawn.
constexpr double kHighlightExponent = 60.0;

bool seenFromFront(const Eigen::Isometry3d& cMo) {
  return cMo.linear().col(2).dot(cMo.translation()) > 0.0;  // z of o points into the board.
}

// Extends the spans by the segment from p to q, a pixel wide on all sides.
void addSegment(const Eigen::Vector2d& p, const Eigen::Vector2d& q, int width, std::vector<Span>& spans) {
  const double top = std::min(p.y(), q.y()) - 1.0, bottom = std::max(p.y(), q.y()) + 1.0;
  const int last_row = static_cast<int>(spans.size()) - 1;
  if (bottom < 0.0 || top > last_row) return;
  for (int row = std::max(0, static_cast<int>(std::floor(top)));
       row <= std::min(last_row, static_cast<int>(std::ceil(bottom))); ++row) {
    double from = 0.0, to = 1.0;
    if (std::abs(q.y() - p.y()) > 1e-9) {
      from = std::clamp((row - 1.0 - p.y()) / (q.y() - p.y()), 0.0, 1.0);
      to = std::clamp((row + 1.0 - p.y()) / (q.y() - p.y()), 0.0, 1.0);
    }
    const double a = p.x() + from * (q.x() - p.x()), b = p.x() + to * (q.x() - p.x());
    const double left = std::clamp(std::min(a, b) - 2.0, 0.0, static_cast<double>(width));
    const double right = std::clamp(std::max(a, b) + 3.0, 0.0, static_cast<double>(width));
    spans[row].begin = std::min(spans[row].begin, static_cast<int>(left));
    spans[row].end = std::max(spans[row].end, static_cast<int>(std::ceil(right)));
  }
}

}  // namespace

BoardLayer::BoardLayer(const BoardSpec& board, const Lens& lens, const RayTable& rays, const Light& light,
                       const Tones& tones)
    : board_(board), unit_m_(board.spacing()), lens_(lens), rays_(rays), light_(light), tones_(tones) {
  if (board.as<Checkerboard>()) return;
  ink_.emplace(board);
  unit_m_ = ink_->texel_m();
}

void BoardLayer::outline(const Eigen::Isometry3d& cMo, std::vector<Span>& spans) const {
  spans.assign(static_cast<std::size_t>(lens_.height_px), Span{});
  const std::vector<Eigen::Vector3d> corners = board_.outline();
  for (const Eigen::Vector3d& corner : corners) {
    if ((cMo * corner).z() < kNearestM) return;
  }
  constexpr int kPieces = 12;  // Distortion bends the edges.
  std::vector<Eigen::Vector2d> points;
  for (std::size_t i = 0; i < corners.size(); ++i) {
    const Eigen::Vector3d& from = corners[i];
    const Eigen::Vector3d& to = corners[(i + 1) % corners.size()];
    for (int piece = 0; piece < kPieces; ++piece) {
      const Eigen::Vector3d point = cMo * (from + (to - from) * piece / kPieces);
      Eigen::Vector2d ray = point.head<2>() / point.z();
      // Far outside the image the distortion polynomial may fold back into it.
      const double limit = 1.1 * rays_.max_radius;
      if (ray.norm() > limit) ray *= limit / ray.norm();
      points.push_back(lens_.project({ray.x(), ray.y(), 1.0}));
    }
  }
  for (std::size_t i = 0; i < points.size(); ++i) {
    addSegment(points[i], points[(i + 1) % points.size()], lens_.width_px, spans);
  }
}

void BoardLayer::pad(int by) {
  const int rows = static_cast<int>(spans_.size());
  padded_.assign(spans_.size(), Span{});
  box_ = cv::Rect();
  Span columns, touched;
  for (int row = 0; row < rows; ++row) {
    Span& wide = padded_[row];
    for (int near = std::max(0, row - by); near <= std::min(rows - 1, row + by); ++near) {
      if (spans_[near].empty()) continue;
      wide.begin = std::min(wide.begin, std::max(0, spans_[near].begin - by));
      wide.end = std::max(wide.end, std::min(lens_.width_px, spans_[near].end + by));
    }
    if (wide.empty()) continue;
    columns = {std::min(columns.begin, wide.begin), std::max(columns.end, wide.end)};
    touched = {std::min(touched.begin, row), std::max(touched.end, row + 1)};
  }
  if (!columns.empty()) {
    box_ = cv::Rect(columns.begin, touched.begin, columns.end - columns.begin, touched.end - touched.begin);
  }
}

void BoardLayer::shade(const Eigen::Isometry3d& cMo, const cv::Rect& box) {
  const Eigen::Vector3d normal =
      seenFromFront(cMo) ? Eigen::Vector3d(-cMo.linear().col(2)) : Eigen::Vector3d(cMo.linear().col(2));
  const Eigen::Matrix3d rotation_inverse = cMo.linear().transpose();
  const double depth = normal.dot(cMo.translation());
  const double diffuse = 1.0 - light_.diffuse + light_.diffuse * std::max(0.0, normal.dot(light_.towards_c));
  const auto onBoard = [&](int u, int v) -> Eigen::Vector2d {
    const Eigen::Vector3d ray(rays_.xRow(v)[u], rays_.yRow(v)[u], 1.0);
    const Eigen::Vector3d point = rotation_inverse * (ray * (depth / normal.dot(ray)) - cMo.translation());
    return point.head<2>() / unit_m_;
  };
  nodes_.create(box.height / kNodeStep + 2, box.width / kNodeStep + 2, CV_32FC4);
  for (int row = 0; row < nodes_.rows; ++row) {
    for (int column = 0; column < nodes_.cols; ++column) {
      // At the image border the outermost ray pair stands for the ones beyond.
      const int u = std::min(box.x + column * kNodeStep, lens_.width_px - 2);
      const int v = std::min(box.y + row * kNodeStep, lens_.height_px - 2);
      const Eigen::Vector2d here = onBoard(u, v);
      const Eigen::Vector2d along_u = onBoard(u + 1, v) - here, along_v = onBoard(u, v + 1) - here;
      const Eigen::Vector3d towards_eye =
          -Eigen::Vector3d(rays_.xRow(v)[u], rays_.yRow(v)[u], 1.0).normalized();
      const Eigen::Vector3d& towards_light = light_.active ? towards_eye : light_.towards_c;
      const Eigen::Vector3d half = (towards_eye + towards_light).normalized();
      const double highlight =
          light_.specular * std::pow(std::max(0.0, normal.dot(half)), kHighlightExponent);
      const double fall =
          light_.active ? light_.active->at(u, v, depth / normal.dot(-towards_eye), cMo.translation().norm())
                        : light_.at(u, v);
      const double footprint_u = std::hypot(along_u.x(), along_v.x());
      const double footprint_v = std::hypot(along_u.y(), along_v.y());
      // Beyond the board's horizon a node is never used but must stay a number.
      const auto sane = [](double x) { return std::isfinite(x) ? std::clamp(x, 1e-4, 1e3) : 1e3; };
      nodes_.at<cv::Vec4f>(row, column) = {
          static_cast<float>(sane(footprint_u)), static_cast<float>(sane(footprint_v)),
          static_cast<float>(diffuse * fall), static_cast<float>(255.0 * highlight)};
    }
  }
}

BoardPattern BoardLayer::squaresSeen(const Eigen::Isometry3d& cMo) const {
  const Checkerboard& squares = *board_.as<Checkerboard>();
  const bool front = seenFromFront(cMo);
  const bool hollow = squares.hollow_corner && front;
  BoardPattern pattern{};
  fromRay(cMo, board_.patternOutline().front(), pattern.from_ray);
  pattern.squares_x = static_cast<float>(squares.squares_x);
  pattern.squares_y = static_cast<float>(squares.squares_y);
  pattern.margin = static_cast<float>(board_.margin_m / squares.square_size_m);
  pattern.hollow_low = hollow ? static_cast<float>(0.5 - 0.5 * squares.hollow_inner_ratio) : 0.0F;
  pattern.hollow_high = hollow ? static_cast<float>(0.5 + 0.5 * squares.hollow_inner_ratio) : 0.0F;
  pattern.plate = static_cast<float>(front ? tones_.white : tones_.back);
  pattern.white = pattern.plate;
  pattern.black = static_cast<float>(front ? tones_.black : tones_.back);
  return pattern;
}

InkPattern BoardLayer::inkSeen(const Eigen::Isometry3d& cMo) const {
  const bool front = seenFromFront(cMo);
  InkPattern pattern{};
  fromRay(cMo, board_.outline().front(), pattern.from_ray);
  pattern.integral = ink_->integral();
  pattern.tone = ink_->tone();
  pattern.reach = static_cast<float>(InkMap::kReach);
  pattern.width = ink_->width();
  pattern.height = ink_->height();
  pattern.white = static_cast<float>(front ? tones_.white : tones_.back);
  pattern.black = static_cast<float>(front ? tones_.black : tones_.back);
  return pattern;
}

void BoardLayer::fromRay(const Eigen::Isometry3d& cMo, const Eigen::Vector3d& origin_o,
                         float (&from_ray)[9]) const {
  Eigen::Matrix3d plane;
  plane << cMo.linear().col(0) * unit_m_, cMo.linear().col(1) * unit_m_, cMo * origin_o;
  const Eigen::Matrix3d inverse = plane.inverse();
  for (int i = 0; i < 9; ++i) from_ray[i] = static_cast<float>(inverse(i / 3, i % 3));
}

void BoardLayer::add(const Eigen::Isometry3d& cMo, const std::vector<Span>& spans, float weight) {
  shade(cMo, box_);
  std::variant<BoardPattern, InkPattern> pattern;
  if (ink_)
    pattern = inkSeen(cMo);
  else
    pattern = squaresSeen(cMo);

  std::array<std::vector<float>, 4> ramps;
  for (auto& ramp : ramps) ramp.resize(static_cast<std::size_t>(nodes_.cols) * kNodeStep);
  for (int v = box_.y; v < box_.y + box_.height; ++v) {
    if (spans[v].empty()) continue;
    const int offset = v - box_.y;
    const int node_row = offset / kNodeStep;
    const float down = static_cast<float>(offset % kNodeStep) / kNodeStep;
    const cv::Vec4f* upper = nodes_.ptr<cv::Vec4f>(node_row);
    const cv::Vec4f* lower = nodes_.ptr<cv::Vec4f>(node_row + 1);
    const int first = (spans[v].begin - box_.x) / kNodeStep;
    const int last = (spans[v].end - 1 - box_.x) / kNodeStep;
    for (int node = first; node <= last; ++node) {
      const cv::Vec4f left = upper[node] + down * (lower[node] - upper[node]);
      const cv::Vec4f right = upper[node + 1] + down * (lower[node + 1] - upper[node + 1]);
      for (int channel = 0; channel < 4; ++channel) {
        float* ramp = ramps[channel].data() + node * kNodeStep;
        const float slope = (right[channel] - left[channel]) / kNodeStep;
        for (int i = 0; i < kNodeStep; ++i) ramp[i] = left[channel] + slope * static_cast<float>(i);
      }
    }
    const int begin = spans[v].begin, shift = begin - box_.x;
    const BoardRow row{spans[v].end - begin,    rays_.xRow(v) + begin,   rays_.yRow(v) + begin,
                       ramps[0].data() + shift, ramps[1].data() + shift, ramps[2].data() + shift,
                       ramps[3].data() + shift};
    std::visit(
        [&](const auto& seen) {
          addBoardRow(seen, row, weight, color_.ptr<float>(offset) + shift,
                      alpha_.ptr<float>(offset) + shift);
        },
        pattern);
  }
}

void BoardLayer::draw(const std::vector<Eigen::Isometry3d>& poses, double blur_sigma_px) {
  spans_.assign(static_cast<std::size_t>(lens_.height_px), Span{});
  pose_spans_.resize(poses.size());
  for (std::size_t i = 0; i < poses.size(); ++i) {
    outline(poses[i], pose_spans_[i]);
    for (std::size_t row = 0; row < spans_.size(); ++row) {
      spans_[row].begin = std::min(spans_[row].begin, pose_spans_[i][row].begin);
      spans_[row].end = std::max(spans_[row].end, pose_spans_[i][row].end);
    }
  }
  const int reach = static_cast<int>(std::ceil(3.0 * blur_sigma_px));
  pad(reach);
  if (box_.empty()) return;
  color_.create(box_.size(), CV_32FC1);
  alpha_.create(box_.size(), CV_32FC1);
  color_.setTo(0.0);
  alpha_.setTo(0.0);
  const auto weight = static_cast<float>(1.0 / static_cast<double>(poses.size()));
  for (std::size_t i = 0; i < poses.size(); ++i) add(poses[i], pose_spans_[i], weight);
  if (reach > 0) {
    const cv::Size size(2 * reach + 1, 2 * reach + 1);
    cv::GaussianBlur(color_, color_, size, blur_sigma_px, blur_sigma_px, cv::BORDER_REPLICATE);
    cv::GaussianBlur(alpha_, alpha_, size, blur_sigma_px, blur_sigma_px, cv::BORDER_REPLICATE);
  }
}

}  // namespace servocal::sim
