// SPDX-License-Identifier: GPL-3.0-or-later
#include "slip_check.h"

#include <map>

#include "servocal/calib/board_pose.h"
#include "servocal/calib/slip.h"

namespace servocal::procedure {

std::optional<std::string> slipDuring(const std::vector<Observation>& observations, const CalibrationResult& result) {
  std::map<std::string, const CameraResult*> cameras;
  std::map<std::string, Pose<Base, Color>> bMc;
  const HandEyeSolution* best = nullptr;
  for (const CameraResult& camera : result.cameras) {
    if (!camera.hand_eye || camera.hand_eye->mount != Mount::kFixed) continue;
    cameras.emplace(camera.camera, &camera);
    bMc.emplace(camera.camera, Pose<Base, Color>(camera.hand_eye->camera_pose));
    const auto sigma = [](const HandEyeSolution& solution) { return solution.board_sigma.head<3>().norm(); };
    if (best == nullptr || sigma(*camera.hand_eye) < sigma(*best)) best = &*camera.hand_eye;
  }
  if (best == nullptr) return std::nullopt;
  const Pose<EndEffector, Board> eMo(best->board_pose);
  std::vector<calib::SlipView> views;
  for (const Observation& observation : observations) {
    if (!observation.robot) continue;
    for (const StreamObservation& view : observation.views) {
      const auto camera = cameras.find(view.camera);
      if (view.stream != Stream::kColor || camera == cameras.end()) continue;
      const Pose<Base, EndEffector>& bMe = observation.robot->bMe;
      const auto pose = calib::refineBoardPose(result.board, camera->second->intrinsics.camera, view.detection,
                                               bMc.at(view.camera).inverse() * bMe * eMo);
      if (pose) views.push_back({observation.id, view.camera, bMe, pose->cMo});
    }
  }
  const auto slip = calib::findSlip(views, bMc, eMo);
  if (!slip) return std::nullopt;
  return slip->sentence;
}

}  // namespace servocal::procedure
