// SPDX-License-Identifier: GPL-3.0-or-later
#include "solver_sessions.h"

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <ctime>
#include <functional>
#include <opencv2/calib3d.hpp>
#include <optional>
#include <vector>

#include "calib_scene.h"
#include "hand_eye_peers.h"
#include "servocal/calib/joint.h"
#include "servocal/calib/uncertainty.h"
#include "servocal/procedure/recorded.h"
#include "servocal/session/image_set.h"

namespace servocal::test {
namespace {

double cpuMs() { return 1e3 * static_cast<double>(std::clock()) / CLOCKS_PER_SEC; }

double median(std::vector<double> values) {
  if (values.empty()) return NAN;
  std::nth_element(values.begin(), values.begin() + static_cast<std::ptrdiff_t>(values.size() / 2),
                   values.end());
  return values[values.size() / 2];
}

/// What a solver is given.
struct Session {
  BoardSpec board;
  Mount mount = Mount::kFixed;
  std::string camera;
  std::vector<std::string> fixed;  // distortion terms held at zero
  std::vector<Observation> observations;
  double robot_sigma_m = 0.0003;
  double robot_sigma_rad = 0.0005;
};

/// What it gives back.
struct Answer {
  CameraModel model;
  Eigen::Isometry3d camera_pose;  // bMc or eMc
  Eigen::Isometry3d board_pose;   // eMo or bMo
  std::vector<Eigen::Vector3d> corners;
};

Eigen::Isometry3d holderPose(Mount mount, const Observation& observation) {
  const auto& bMe = observation.robot->bMe;
  return mount == Mount::kFixed ? bMe.isometry() : bMe.inverse().isometry();
}

std::optional<Answer> solveOurs(const Session& session) {
  calib::JointOptions options;
  options.mount = session.mount;
  options.robot_sigma_m = session.robot_sigma_m;
  options.robot_sigma_rad = session.robot_sigma_rad;
  options.streams.emplace_back();
  options.streams.back().camera = session.camera;
  options.streams.back().fixed = session.fixed;
  const calib::JointOutcome outcome = calib::solveJoint(session.board, session.observations, options);
  if (!outcome.solution) return std::nullopt;
  const calib::JointSolution& solution = *outcome.solution;
  return Answer{solution.cameras[0].model, solution.cameras[0].pose, solution.board_pose,
                calib::shapedCorners(session.board, solution.board)};
}

/// Images alone, as the others do it: what their hand-eye solvers then start from.
struct Images {
  CameraModel model;
  Stops stops;
  double ms = 0.0;
};

Images solveImages(const Session& session) {
  std::vector<std::vector<cv::Point3f>> points;
  std::vector<std::vector<cv::Point2f>> pixels;
  Images out;
  cv::Size size;
  for (const Observation& observation : session.observations) {
    if (observation.views.empty() || observation.views[0].detection.corners.size() < 4) continue;
    const StreamObservation& view = observation.views[0];
    size = {view.width_px, view.height_px};
    points.emplace_back();
    pixels.emplace_back();
    for (const Corner& corner : view.detection.corners) {
      const Eigen::Vector3d point = session.board.corner(corner.id);
      points.back().emplace_back(point.x(), point.y(), 0.f);
      pixels.back().emplace_back(corner.pixel.x(), corner.pixel.y());
    }
    out.stops.lMr.emplace_back(holderPose(session.mount, observation));
  }
  int flags = 0;
  for (const std::string& name : session.fixed) {
    if (name == "k1") flags |= cv::CALIB_FIX_K1;
    if (name == "k2") flags |= cv::CALIB_FIX_K2;
    if (name == "k3") flags |= cv::CALIB_FIX_K3;
    if (name == "p1" || name == "p2") flags |= cv::CALIB_ZERO_TANGENT_DIST;
  }
  cv::Mat matrix, distortion;
  std::vector<cv::Mat> rotations, translations;
  const double start = cpuMs();
  cv::calibrateCamera(points, pixels, size, matrix, distortion, rotations, translations, flags);
  out.ms = cpuMs() - start;
  out.model = CameraModel::fromFieldOfView(size.width, size.height, 1.0);
  out.model.parameters << matrix.at<double>(0, 0), matrix.at<double>(1, 1), matrix.at<double>(0, 2),
      matrix.at<double>(1, 2), distortion.at<double>(0), distortion.at<double>(1), distortion.at<double>(2),
      distortion.at<double>(3), distortion.at<double>(4);
  for (std::size_t i = 0; i < rotations.size(); ++i) {
    cv::Mat rotation;
    cv::Rodrigues(rotations[i], rotation);
    out.stops.cMo.emplace_back(isometryOf(rotation, translations[i]));
  }
  return out;
}

/// The board's pose is what hand-eye solvers leave to the caller: the mean of what the views say.
Eigen::Isometry3d meanBoard(const Stops& stops, const Eigen::Isometry3d& lMc) {
  Eigen::Matrix3d sum = Eigen::Matrix3d::Zero();
  Eigen::Vector3d place = Eigen::Vector3d::Zero();
  for (std::size_t i = 0; i < stops.lMr.size(); ++i) {
    const Eigen::Isometry3d rMo = stops.lMr[i].inverse().isometry() * lMc * stops.cMo[i].isometry();
    sum += rMo.linear();
    place += rMo.translation() / static_cast<double>(stops.lMr.size());
  }
  const Eigen::JacobiSVD<Eigen::Matrix3d> svd(sum, Eigen::ComputeFullU | Eigen::ComputeFullV);
  Eigen::Isometry3d mean = Eigen::Isometry3d::Identity();
  mean.linear() = svd.matrixU() * svd.matrixV().transpose();
  mean.translation() = place;
  return mean;
}

using HandEye = std::function<std::optional<Eigen::Isometry3d>(const Stops&)>;

const std::vector<std::pair<std::string, HandEye>>& peers() {
  static const std::vector<std::pair<std::string, HandEye>> all = {
      {"Tsai", [](const Stops& s) { return opencvHandEye(s, cv::CALIB_HAND_EYE_TSAI); }},
      {"Park", [](const Stops& s) { return opencvHandEye(s, cv::CALIB_HAND_EYE_PARK); }},
      {"Horaud", [](const Stops& s) { return opencvHandEye(s, cv::CALIB_HAND_EYE_HORAUD); }},
      {"Andreff", [](const Stops& s) { return opencvHandEye(s, cv::CALIB_HAND_EYE_ANDREFF); }},
      {"Daniilidis", [](const Stops& s) { return opencvHandEye(s, cv::CALIB_HAND_EYE_DANIILIDIS); }},
      {"Shah", [](const Stops& s) { return opencvRobotWorld(s, cv::CALIB_ROBOT_WORLD_HAND_EYE_SHAH); }},
      {"Li", [](const Stops& s) { return opencvRobotWorld(s, cv::CALIB_ROBOT_WORLD_HAND_EYE_LI); }},
      {"vpHandEyeCalibration", [](const Stops& s) { return vispHandEye(s); }},
  };
  return all;
}

/// One solver's answers over sessions or folds.
struct Row {
  std::vector<double> focal_px, error, other_error, ms;
  int failed = 0;
};

/// Runs all solvers; `judge` puts an answer's errors into its row.
void runAll(const Session& session, const std::function<void(const Answer&, Row&)>& judge,
            std::vector<Row>& rows) {
  rows.resize(1 + peers().size());
  const auto enter = [&](Row& row, const std::optional<Answer>& answer, double ms) {
    row.ms.push_back(ms);
    if (answer && answer->camera_pose.matrix().allFinite()) {
      judge(*answer, row);
    } else {
      ++row.failed;
    }
  };
  double start = cpuMs();
  const auto ours = solveOurs(session);
  enter(rows[0], ours, cpuMs() - start);
  const Images images = solveImages(session);
  for (std::size_t i = 0; i < peers().size(); ++i) {
    std::optional<Answer> answer;
    start = cpuMs();
    try {
      if (const auto lMc = peers()[i].second(images.stops)) {
        answer = Answer{images.model, *lMc, meanBoard(images.stops, *lMc), session.board.corners()};
      }
    } catch (const cv::Exception&) {
    }
    enter(rows[i + 1], answer, images.ms + cpuMs() - start);
  }
}

std::string nameOf(std::size_t row) { return row == 0 ? "servocal joint" : "cv + " + peers()[row - 1].first; }

/// Views that the answer was not made from: RMS of what it predicts, the robot believed, against what is
/// seen.
double heldOutPx(const Session& session, const std::vector<Observation>& kept, const Answer& answer) {
  std::vector<double> squares;
  for (const Observation& observation : kept) {
    if (observation.views.empty()) continue;
    const Eigen::Isometry3d cMo =
        answer.camera_pose.inverse() * holderPose(session.mount, observation) * answer.board_pose;
    for (const Corner& corner : observation.views[0].detection.corners) {
      const auto pixel = answer.model.project(cMo * answer.corners[static_cast<std::size_t>(corner.id)]);
      squares.push_back(pixel ? (*pixel - corner.pixel).squaredNorm() : INFINITY);
    }
  }
  return std::sqrt(median(squares));
}

}  // namespace

void benchSessions(int seeds, Mount mount) {
  std::printf(
      "\nSessions, camera %s, 0.2 px, intrinsics unknown; the others get cv::calibrateCamera's poses, its "
      "time "
      "counted.\nMedian over %d seeds: |error of fx| (px), mean error over the workspace (mm), CPU ms\n",
      mount == Mount::kFixed ? "fixed in the cell" : "on the flange", seeds);
  std::printf("%6s %9s  %-28s %9s %9s %9s\n", "views", "robot mm", "solver", "fx px", "mm", "ms");
  for (const int views : {15, 30}) {
    for (const double robot_m : {1e-4, 3e-4}) {
      std::vector<Row> rows;
      for (int seed = 1; seed <= seeds; ++seed) {
        SceneOptions options;
        options.views = views;
        options.mount = mount;
        options.noise = {0.2, robot_m, 2.0 * robot_m};
        const Scene scene = makeScene(static_cast<std::uint64_t>(700 + seed), options);
        const Session session{scene.board, mount, kCamera, {}, scene.observations};
        const auto judge = [&](const Answer& answer, Row& row) {
          row.focal_px.push_back(std::abs(answer.model.fx() - scene.camera.fx()));
          double sum_m = 0;
          for (const auto& cMo : scene.cMo) {
            const Eigen::Vector3d point_c = cMo.translation();
            const auto plane = answer.model.unproject(scene.camera.project(point_c).value());
            const Eigen::Vector3d seen = point_c.z() * Eigen::Vector3d(plane->x(), plane->y(), 1.0);
            sum_m += (answer.camera_pose * seen - scene.camera_pose * point_c).norm();
          }
          row.error.push_back(1e3 * sum_m / static_cast<double>(scene.cMo.size()));
        };
        runAll(session, judge, rows);
      }
      for (std::size_t i = 0; i < rows.size(); ++i) {
        std::printf("%6d %9.1f  %-28s %9.3f %9.3f %9.1f", views, 1e3 * robot_m, nameOf(i).c_str(),
                    median(rows[i].focal_px), median(rows[i].error), median(rows[i].ms));
        std::printf(rows[i].failed ? "  (failed %d)\n" : "\n", rows[i].failed);
      }
      std::fflush(stdout);
    }
  }
}

void benchRecordings(const std::string& root) {
  constexpr int kFolds = 5;
  std::printf(
      "\nRecordings with robot poses, %d folds of interleaved views, each predicted from the others, the "
      "robot "
      "believed:\nmedian over folds of the median corner error (px), CPU ms\n%-18s %5s  %-28s %9s %9s\n",
      kFolds, "recording", "views", "solver", "px", "ms");
  for (const char* name :
       {"zhangnatha", "yz_eye_in_hand", "yz_eye_to_hand", "yz_charuco_white", "rct_10x10"}) {
    const std::string manifest = std::string(SERVOCAL_MANIFESTS) + "/" + name + ".yaml";
    const session::ImageSet images = session::loadImageSet(manifest, root);
    std::vector<Observation> seen;
    for (const Observation& observation : procedure::detectImages(images)) {
      if (observation.robot && !observation.views.empty()) seen.push_back(observation);
    }
    std::vector<Row> rows;
    for (int fold = 0; fold < kFolds; ++fold) {
      Session session{images.board,
                      images.mount,
                      images.camera,
                      images.fixed,
                      {},
                      images.robot_accuracy_m,
                      images.robot_accuracy_rad};
      std::vector<Observation> kept;
      for (std::size_t i = 0; i < seen.size(); ++i) {
        (static_cast<int>(i) % kFolds == fold ? kept : session.observations).push_back(seen[i]);
      }
      runAll(
          session,
          [&](const Answer& answer, Row& row) { row.error.push_back(heldOutPx(session, kept, answer)); },
          rows);
    }
    for (std::size_t i = 0; i < rows.size(); ++i) {
      std::printf("%-18s %5zu  %-28s %9.3f %9.1f", name, seen.size(), nameOf(i).c_str(),
                  median(rows[i].error), median(rows[i].ms));
      std::printf(rows[i].failed ? "  (failed %d of %d)\n" : "\n", rows[i].failed, kFolds);
    }
    std::fflush(stdout);
  }
}

}  // namespace servocal::test
