// SPDX-License-Identifier: GPL-3.0-or-later
#include "point_servo.h"

#include <visp3/visual_features/vpFeaturePoint.h>
#include <visp3/vs/vpServo.h>

#include <stdexcept>

#include "servocal/core/visp.h"

namespace servocal::servo {

Twist<EndEffector> pointServo(const std::vector<ImagePoint>& current,
                              const std::vector<ImagePoint>& desired,
                              const Pose<Color, EndEffector>& cMe, Mount mount) {
  if (current.size() < 4 || current.size() != desired.size())
    throw std::invalid_argument("the control law needs at least four points, each with its goal");

  // The task keeps pointers to the features: they must not move, and outlive it.
  std::vector<vpFeaturePoint> s(current.size()), s_star(desired.size());
  vpServo task;
  task.setServo(mount == Mount::kFixed ? vpServo::EYETOHAND_L_cVe_eJe : vpServo::EYEINHAND_L_cVe_eJe);
  task.setInteractionMatrixType(vpServo::MEAN, vpServo::PSEUDO_INVERSE);
  task.setLambda(1.0);
  for (std::size_t i = 0; i < current.size(); ++i) {
    s[i].set_xyZ(current[i].s.x(), current[i].s.y(), current[i].depth_m);
    s_star[i].set_xyZ(desired[i].s.x(), desired[i].s.y(), desired[i].depth_m);
    task.addFeature(s[i], s_star[i]);
  }
  vpMatrix eJe;
  eJe.eye(6);  // The arm takes twists of the end effector, so its Jacobian is the identity.
  task.set_cVe(toVisp(cMe));
  task.set_eJe(eJe);
  return twistFromVisp<EndEffector>(task.computeControlLaw());
}

}  // namespace servocal::servo
