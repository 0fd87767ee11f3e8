// SPDX-License-Identifier: GPL-3.0-or-later
#include "urdf_chain.h"

#include <algorithm>
#include <fstream>
#include <sstream>
#include <string>

#include "builtin_urdf.h"
#include "servocal/core/error.h"

namespace servocal::robot {
namespace {

[[noreturn]] void refuse(const ArmConfig& arm, const std::string& what) {
  throw Error(ErrorKind::kInvalidConfig, "URDF '" + arm.urdf + "': " + what);
}

std::string urdfText(const ArmConfig& arm) {
  if (arm.urdf == "ur5") return kUr5Urdf;
  std::ifstream file(arm.urdf);
  if (!file) refuse(arm, "cannot be read. Give \"ur5\" or the path of a URDF file.");
  std::ostringstream text;
  text << file.rdbuf();
  return text.str();
}

}  // namespace

UrdfChain readChain(const ArmConfig& arm) {
  UrdfChain chain;
  chain.model = urdf::parseURDF(urdfText(arm));
  if (!chain.model) refuse(arm, "is not a robot description.");
  if (!chain.model->getLink(arm.base_link)) refuse(arm, "has no link '" + arm.base_link + "'.");
  urdf::LinkConstSharedPtr link = chain.model->getLink(arm.flange_link);
  if (!link) refuse(arm, "has no link '" + arm.flange_link + "'.");
  for (; link->name != arm.base_link; link = link->getParent()) {
    if (!link->parent_joint || !link->getParent())
      refuse(arm, "has no chain from '" + arm.base_link + "' to '" + arm.flange_link + "'.");
    chain.joints.push_back(link->parent_joint);
  }
  std::reverse(chain.joints.begin(), chain.joints.end());

  bool moves = false;
  for (const urdf::JointSharedPtr& joint : chain.joints) {
    const std::string name = "joint '" + joint->name + "' ";
    const bool continuous = joint->type == urdf::Joint::CONTINUOUS;
    const bool turns = continuous || joint->type == urdf::Joint::REVOLUTE;
    if (!turns && joint->type != urdf::Joint::FIXED)
      refuse(arm, name + "neither turns nor is fixed; only such chains are supported.");
    if (joint->mimic) refuse(arm, name + "follows another joint, which is not supported.");
    if (turns && !continuous && (!joint->limits || !(joint->limits->lower < joint->limits->upper)))
      refuse(arm, name + "has no limits.");
    moves |= turns;
  }
  if (!moves) refuse(arm, "has no joint between the two links.");
  return chain;
}

}  // namespace servocal::robot
