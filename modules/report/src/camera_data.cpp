// SPDX-License-Identifier: GPL-3.0-or-later
#include "camera_data.h"

#include <algorithm>
#include <cmath>
#include <map>

#include "evidence.h"

namespace servocal::report {
namespace {

constexpr double kDegPerRad = 180.0 / 3.14159265358979323846;

Json viewsTree(const std::vector<ViewResidual>& views) {
  Json rows = Json::array();
  for (const ViewResidual& view : views) {
    rows.push_back({{"id", view.observation_id},
                    {"name", view.name},
                    {"rms_px", rounded(view.rms_px, 4)},
                    {"used", view.used},
                    {"cause", toString(view.cause)},
                    {"reason", view.reason}});
  }
  return rows;
}

Json parametersTree(const IntrinsicsResult& intrinsics) {
  const std::vector<std::string>& names = parameterNames(intrinsics.camera.lens);
  Json rows = Json::array();
  for (std::size_t i = 0; i < names.size(); ++i) {
    const auto at = static_cast<Eigen::Index>(i);
    const int digits = i < 4 ? 3 : 6;
    Json row = {{"name", names[i]},
                {"value", rounded(intrinsics.camera.parameters[at], digits)},
                {"unit", i < 4 ? "px" : ""}};
    if (intrinsics.sigma.size() > 0) row["sigma"] = rounded(intrinsics.sigma[at], digits);
    rows.push_back(row);
  }
  return rows;
}

/// Columns, not rows: there may be tens of thousands.
Json residualsTree(const std::vector<CornerResidual>& residuals) {
  Json tree = {{"view", Json::array()},
               {"u", Json::array()},
               {"v", Json::array()},
               {"du", Json::array()},
               {"dv", Json::array()}};
  for (const CornerResidual& corner : residuals) {
    tree["view"].push_back(corner.view);
    tree["u"].push_back(rounded(corner.pixel.x(), 1));
    tree["v"].push_back(rounded(corner.pixel.y(), 1));
    tree["du"].push_back(rounded(corner.residual.x(), 3));
    tree["dv"].push_back(rounded(corner.residual.y(), 3));
  }
  return tree;
}

Json coverageTree(const CoverageSummary& coverage) {
  Json cells = Json::array();
  for (int cell = 0; cell < coverage.cells_x * coverage.cells_y; ++cell) {
    const auto at = static_cast<std::size_t>(cell);
    const bool full = coverage.corners_per_cell[at] >= coverage.corners_to_fill;
    cells.push_back({{"x", cell % coverage.cells_x},
                     {"y", cell / coverage.cells_x},
                     {"corners", coverage.corners_per_cell[at]},
                     {"state", full                       ? "filled"
                               : coverage.unreachable[at] ? "out of reach"
                                                          : "open"}});
  }
  Json bins = {{{"bin", "near"}, {"views", coverage.near_views}},
               {{"bin", "far"}, {"views", coverage.far_views}}};
  for (const auto& [bin, views] : coverage.tilt_bins) bins.push_back({{"bin", bin}, {"views", views}});
  return {{"cells", cells}, {"corners_to_fill", coverage.corners_to_fill}, {"views", bins}};
}

Json streamTree(const ReportInput& input, const CameraResult& camera, Stream stream,
                const IntrinsicsResult& intrinsics) {
  Json tree = {{"stream", toString(stream)},
               {"width_px", intrinsics.camera.width_px},
               {"height_px", intrinsics.camera.height_px},
               {"lens", toString(intrinsics.camera.lens)},
               {"parameters", parametersTree(intrinsics)},
               {"rms_px", rounded(intrinsics.rms_px, 4)},
               {"corners", intrinsics.corners},
               {"views", viewsTree(intrinsics.views)}};
  const auto& coverage = stream == Stream::kColor ? camera.coverage : camera.infrared_coverage;
  if (coverage) tree["coverage"] = coverageTree(*coverage);
  Json limits = Json::array();
  for (const TiltLimit& limit : camera.tilt_limits) {
    if (limit.stream != stream) continue;
    limits.push_back({{"direction", limit.direction},
                      {"limit_deg", rounded(limit.limit_rad * kDegPerRad, 2)},
                      {"ended_by", limit.ended_by}});
  }
  tree["tilt_limits"] = limits;
  tree["residuals"] = residualsTree(cornerResiduals(input, camera.camera, stream, intrinsics));
  constexpr int kAcross = 25, kDown = 17;
  Json map = Json::array();
  for (const PixelSigma& at : projectionSigma(intrinsics, kAcross, kDown)) {
    map.push_back({{"u", rounded(at.pixel.x(), 1)},
                   {"v", rounded(at.pixel.y(), 1)},
                   {"sigma_px", rounded(at.sigma_px, 4)}});
  }
  tree["uncertainty"] = map;
  return tree;
}

Json poseTree(const std::string& parent, const Eigen::Isometry3d& pose,
              const Eigen::Matrix<double, 6, 1>& sigma) {
  const Eigen::AngleAxisd turn(Eigen::Quaterniond(pose.linear()).normalized());
  return {{"parent", parent},
          {"translation_mm", rounded(Eigen::VectorXd(pose.translation() * 1e3), 3)},
          {"translation_sigma_mm", rounded(Eigen::VectorXd(sigma.head<3>() * 1e3), 3)},
          {"rotation_vector_deg", rounded(Eigen::VectorXd(turn.angle() * turn.axis() * kDegPerRad), 4)},
          {"rotation_sigma_deg", rounded(Eigen::VectorXd(sigma.tail<3>() * kDegPerRad), 4)}};
}

Json handEyeTree(const ReportInput& input, const CameraResult& camera) {
  const HandEyeSolution& solution = *camera.hand_eye;
  const bool fixed = solution.mount == Mount::kFixed;
  Json steps = Json::array();
  for (const HandEyeStep& step : handEyeSteps(input, camera)) {
    steps.push_back({{"views", step.views},
                     {"error_mm", rounded(step.error_m * 1e3, 4)},
                     {"sigma_mm", rounded(step.sigma_m * 1e3, 4)},
                     {"error_deg", rounded(step.error_rad * kDegPerRad, 5)}});
  }
  return {{"camera", poseTree(fixed ? "base" : "end_effector", solution.camera_pose, solution.camera_sigma)},
          {"board", poseTree(fixed ? "end_effector" : "base", solution.board_pose, solution.board_sigma)},
          {"rms_px", rounded(solution.rms_px, 4)},
          {"robot_correction_mm", rounded(solution.robot_rms_m * 1e3, 3)},
          {"robot_correction_deg", rounded(solution.robot_rms_rad * kDegPerRad, 4)},
          {"scatter_mm", rounded(solution.scatter_m * 1e3, 3)},
          {"scatter_deg", rounded(solution.scatter_rad * kDegPerRad, 4)},
          {"views", viewsTree(solution.views)},
          {"steps", steps}};
}

Json depthTree(const ReportInput& input, const CameraResult& camera) {
  const DepthResult& depth = *camera.depth;
  const DepthModel& model = depth.model;
  Json tree = {{"sensor", toString(model.sensor)},
               {"rms_before_mm", rounded(depth.rms_before_m * 1e3, 3)},
               {"rms_after_mm", rounded(depth.rms_after_m * 1e3, 3)},
               {"near_m", rounded(model.near_m, 3)},
               {"far_m", rounded(model.far_m, 3)},
               {"views", depth.views},
               {"patches", depth.patches},
               {"notes", depth.notes},
               {"sigma", Json::array()},
               {"samples", Json::array()},
               {"correction", Json::array()}};
  for (Eigen::Index i = 0; i < std::min(depth.sigma_m.size(), depth.sigma_at_m.size()); ++i) {
    tree["sigma"].push_back(
        {{"at_m", rounded(depth.sigma_at_m[i], 3)}, {"sigma_mm", rounded(depth.sigma_m[i] * 1e3, 3)}});
  }
  const std::vector<DepthSample> samples = depthSamples(input, camera);
  constexpr std::size_t kMost = 3000;  // an eye sees no more
  const std::size_t stride = samples.size() / kMost + 1;
  for (std::size_t i = 0; i < samples.size(); i += stride) {
    const DepthSample& at = samples[i];
    tree["samples"].push_back({{"u", rounded(at.pixel.x(), 0)},
                               {"v", rounded(at.pixel.y(), 0)},
                               {"depth_m", rounded(at.depth_m, 3)},
                               {"before_mm", rounded(at.before_m * 1e3, 2)},
                               {"after_mm", rounded(at.after_m * 1e3, 2)}});
  }
  constexpr int kAcross = 16, kDown = 12;
  const double middle_m = 0.5 * (model.near_m + model.far_m);
  for (int cell = 0; cell < kAcross * kDown; ++cell) {
    const Eigen::Vector2d pixel((cell % kAcross + 0.5) / kAcross * (model.camera.width_px - 1),
                                (cell / kAcross + 0.5) / kDown * (model.camera.height_px - 1));
    const auto corrected_m = model.correct(pixel, middle_m);
    if (!corrected_m) continue;
    tree["correction"].push_back({{"x", cell % kAcross},
                                  {"y", cell / kAcross},
                                  {"correction_mm", rounded((*corrected_m - middle_m) * 1e3, 2)}});
  }
  tree["correction_at_m"] = rounded(middle_m, 3);
  return tree;
}

/// Every corner for the numbers, one view for the eye: the one with most corners.
Json overlayTree(const ReportInput& input, const CameraResult& camera,
                 const std::vector<OverlayCorner>& corners) {
  std::map<std::int64_t, int> of_view;
  double before_px2 = 0.0, after_px2 = 0.0;
  int before = 0, after = 0;
  for (const OverlayCorner& corner : corners) {
    ++of_view[corner.view];
    if (corner.before) before_px2 += (*corner.before - corner.color).squaredNorm(), ++before;
    if (corner.after) after_px2 += (*corner.after - corner.color).squaredNorm(), ++after;
  }
  const auto most = std::max_element(of_view.begin(), of_view.end(),
                                     [](const auto& a, const auto& b) { return a.second < b.second; });
  Json tree = {{"views", of_view.size()}, {"corners", Json::array()}, {"shown_view", most->first}};
  if (before > 0) tree["rms_before_px"] = rounded(std::sqrt(before_px2 / before), 2);
  if (after > 0) tree["rms_after_px"] = rounded(std::sqrt(after_px2 / after), 2);
  const auto point = [](const std::optional<Eigen::Vector2d>& pixel) {
    return pixel ? rounded(Eigen::VectorXd(*pixel), 1) : Json(nullptr);
  };
  for (const OverlayCorner& corner : corners) {
    if (corner.view != most->first) continue;
    tree["corners"].push_back(
        {{"color", point(corner.color)}, {"before", point(corner.before)}, {"after", point(corner.after)}});
  }
  if (const auto pictures = overlayPictures(input, camera, most->first))
    tree["pictures"] = {{"before", pictures->before}, {"after", pictures->after}};
  return tree;
}

}  // namespace

Json pairData(const CameraPair& pair, const std::string& first, const std::string& second) {
  const Eigen::Matrix<double, 6, 1> sigma = pair.covariance.diagonal().cwiseSqrt();
  return {{"first", first},
          {"second", second},
          {"pose", poseTree(first, pair.first_by_second, sigma)},
          {"rms_px", rounded(pair.rms_px, 4)},
          {"views", viewsTree(pair.views)}};
}

Json cameraData(const ReportInput& input, const CameraResult& camera, const CameraResult& best) {
  Json tree = {{"name", camera.camera},
               {"notes", camera.notes},
               {"streams", Json::array({streamTree(input, camera, Stream::kColor, camera.intrinsics)})}};
  if (camera.hand_eye) {
    tree["mount"] = camera.hand_eye->mount == Mount::kFixed ? "fixed" : "flange";
    tree["hand_eye"] = handEyeTree(input, camera);
  }
  if (camera.infrared)
    tree["streams"].push_back(streamTree(input, camera, Stream::kInfrared, *camera.infrared));
  if (camera.color_infrared) {
    tree["color_infrared"] =
        pairData(*camera.color_infrared, camera.camera + " color", camera.camera + " infrared");
    tree["combined_views"] = camera.combined_views;
  }
  if (camera.depth) tree["depth"] = depthTree(input, camera);
  if (const auto overlay = overlayCorners(input, best); !overlay.empty())
    tree["overlay"] = overlayTree(input, best, overlay);
  if (camera.held_out) {
    tree["held_out"] = {{"views", camera.held_out->views},
                        {"rms_px", rounded(camera.held_out->rms_px, 3)},
                        {"rms_mm", rounded(camera.held_out->rms_m * 1e3, 3)}};
  }
  if (camera.board_scale) {
    tree["board_scale"] = {{"scale", rounded(camera.board_scale->scale, 6)},
                           {"sigma", rounded(camera.board_scale->sigma, 6)}};
  }
  if (camera.time_offset_s) {
    tree["time_offset_ms"] = rounded(*camera.time_offset_s * 1e3, 2);
    tree["time_offset_sigma_ms"] = rounded(camera.time_offset_sigma_s * 1e3, 2);
  }
  if (camera.affine_baseline) {
    tree["affine_baseline"] = {{"rms_mm", rounded(camera.affine_baseline->rms_m * 1e3, 3)},
                               {"inliers", camera.affine_baseline->inliers},
                               {"points", camera.affine_baseline->points}};
  }
  return tree;
}

}  // namespace servocal::report
