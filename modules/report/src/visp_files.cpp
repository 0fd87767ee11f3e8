// SPDX-License-Identifier: GPL-3.0-or-later
// ViSP: camera XML (vpXmlParserCamera) and pose vectors as YAML (vpPoseVector::loadYAML).
#include "formats.h"
#include "number_text.h"
#include "one_coefficient_lens.h"
#include "rig.h"

namespace servocal::report {
namespace {

std::string element(const char* name, const std::string& value) {
  return std::string("<") + name + ">" + value + "</" + name + ">";
}

std::string said(const OneCoefficientLens& lens) {
  return "u(x), v(x): " + shortNumber(lens.forward_rms_px) + " px RMS, " + shortNumber(lens.forward_max_px) +
         " px at most; x(u, v): " + shortNumber(lens.inverse_rms_px) + " px RMS, " +
         shortNumber(lens.inverse_max_px) + " px at most";
}

std::string cameraXml(const RigCamera& camera, const OneCoefficientLens& lens) {
  return "  <camera>\n    <!-- " + camera.optical_frame +
         ". One distortion coefficient cannot hold the calibrated lens. Left over the image by this model, " +
         said(lens) + ". -->\n    " + element("name", camera.name) + "\n    " +
         element("image_width", std::to_string(camera.model.width_px)) + "\n    " +
         element("image_height", std::to_string(camera.model.height_px)) + "\n    <model>\n      " +
         element("type", "perspectiveProjWithDistortion") + "\n      " + element("px", number(lens.px)) +
         "\n      " + element("py", number(lens.py)) + "\n      " + element("u0", number(lens.u0)) +
         "\n      " + element("v0", number(lens.v0)) + "\n      " + element("kud", number(lens.kud)) +
         "\n      " + element("kdu", number(lens.kdu)) + "\n    </model>\n  </camera>\n";
}

/// Translation (m), then the rotation vector (rad).
std::string poseVector(const Eigen::Isometry3d& pose, const std::string& header) {
  const Eigen::AngleAxisd turn(Eigen::Quaterniond(pose.linear()).normalized());
  Eigen::Matrix<double, 6, 1> vector;
  vector << pose.translation(), turn.angle() * turn.axis();
  std::string text = "# " + header + "\nrows: 6\ncols: 1\ndata: \n";
  for (const double entry : vector) text += "  - [" + number(entry) + "]\n";
  return text;
}

void addPose(Export& exported, const std::string& name, const std::string& parent, const std::string& child,
             const Eigen::Isometry3d& pose) {
  const std::string what = child + " in " + parent;
  exported.files.push_back({name, poseVector(pose, what + ": tx ty tz (m), rotation vector (rad)")});
  exported.notes.push_back(name + ": " + what);
}

}  // namespace

Export exportVisp(const CalibrationResult& result, const ExportOptions& options) {
  const Rig rig = opticalRig(result, options);
  Export exported = complete();
  std::string xml = "<?xml version=\"1.0\"?>\n<root>\n";
  for (const RigCamera& camera : rig.cameras) {
    const OneCoefficientLens lens = fitOneCoefficientLens(camera.model);
    xml += cameraXml(camera, lens);
    exported.notes.push_back("cameras.xml, " + camera.name +
                             ": an approximation, since ViSP's model has one distortion "
                             "coefficient; left over the image, " +
                             said(lens));
  }
  exported.files.push_back({"cameras.xml", xml + "</root>\n"});
  for (const RigCamera& camera : rig.cameras) {
    const auto pose = rig.poseOf(camera.optical_frame);
    if (!pose || pose->root == camera.optical_frame) continue;
    const std::string letter = pose->root == options.base_frame     ? "r"
                               : pose->root == options.flange_frame ? "e"
                                                                    : "c";
    addPose(exported, camera.name + "_" + letter + "Pc.yaml", pose->root, camera.optical_frame,
            pose->root_by_camera);
  }
  for (const CameraResult& camera : result.cameras) {
    if (!camera.hand_eye || !camera.hand_eye->board_pose.matrix().allFinite()) continue;
    const bool fixed = camera.hand_eye->mount == Mount::kFixed;
    addPose(exported, camera.camera + (fixed ? "_ePo.yaml" : "_rPo.yaml"),
            fixed ? options.flange_frame : options.base_frame, options.board_frame,
            camera.hand_eye->board_pose);
  }
  return exported;
}

}  // namespace servocal::report
