// SPDX-License-Identifier: GPL-3.0-or-later
#include <algorithm>
#include <filesystem>
#include <iostream>
#include <opencv2/imgcodecs.hpp>

#include "servocal/app/main.h"
#include "servocal/core/best_estimate.h"
#include "servocal/core/error.h"
#include "servocal/sensor/rectify.h"
#include "servocal/session/session.h"

namespace {

using namespace servocal;

constexpr const char* kFooter = R"(
A depth image is a 16-bit PNG as the camera delivers it, in pixels of the infrared image. Written are, for each,
NAME_color.png: the corrected depth for every pixel of the color image, and with --corrected also
NAME_corrected.png: in its own pixels. 16 bits, mm, 0 where there is none.

Lenses and poses are those of the joint estimate if the result has one, of the stages otherwise.
The same is one call of the library, sensor::DepthRectifier (docs/depth.md). Moves no robot.

Example:
  $ servocal-rectify runs/first/result.yaml --camera left --out rectified depth/*.png
  Wrote rectified/0001_color.png
)";

const CameraResult& cameraOf(const CalibrationResult& result, const std::string& name) {
  std::string names;
  for (const CameraResult& camera : result.cameras) {
    if (name.empty() ? camera.depth && result.cameras.size() == 1 : camera.camera == name) {
      if (camera.depth && camera.color_infrared) return camera;
      throw Error(ErrorKind::kNothingToDo, "the result has no depth correction of '" + camera.camera + "'");
    }
    names += (names.empty() ? "" : ", ") + camera.camera;
  }
  throw Error(ErrorKind::kNothingToDo, (name.empty() ? "say which camera (--camera)" : "no camera '" + name + "'") +
                                           "; the result has: " + names);
}

cv::Mat readDepth(const std::filesystem::path& file, const CameraModel& infrared) {
  const cv::Mat raw = cv::imread(file.string(), cv::IMREAD_UNCHANGED);
  if (raw.empty()) throw Error(ErrorKind::kBadData, file.string() + ": cannot be read as an image");
  if (raw.type() != CV_16UC1) throw Error(ErrorKind::kBadData, file.string() + ": not a 16-bit image of one channel");
  if (raw.cols != infrared.width_px || raw.rows != infrared.height_px) {
    throw Error(ErrorKind::kBadData, file.string() + " has " + std::to_string(raw.cols) + " x " +
                                         std::to_string(raw.rows) + " px; this camera's depth images have " +
                                         std::to_string(infrared.width_px) + " x " +
                                         std::to_string(infrared.height_px));
  }
  return raw;
}

void write(const std::filesystem::path& file, const cv::Mat& image) {
  if (!cv::imwrite(file.string(), image)) throw Error(ErrorKind::kBadData, "cannot write " + file.string());
  std::cout << "Wrote " << file.string() << '\n';
}

}  // namespace

int main(int argc, char** argv) {
  CLI::App cli("Corrects depth images by a calibration and registers them to color.", "servocal-rectify");
  cli.footer(kFooter);
  std::filesystem::path input, out;
  std::vector<std::filesystem::path> files;
  std::string camera_name;
  double unit_m = 0.001;
  bool write_corrected = false;
  cli.add_option("RESULT", input, "result.yaml or .json, or the session folder that holds result.yaml")->required();
  cli.add_option("DEPTH", files, "Depth images")->required();
  cli.add_option("--camera", camera_name, "Whose they are; may be left out if there is one camera");
  cli.add_option("--out", out, "Folder for the images; made if missing, files of the same name are replaced")
      ->required();
  cli.add_option("--unit-m", unit_m, "Length of one count of the images, m")
      ->capture_default_str()
      ->check(CLI::Range(1e-6, 0.1));
  cli.add_flag("--corrected", write_corrected, "Write the corrected depth in its own pixels as well");
  return app::guardedMain(cli, argc, argv, [&] {
    const CalibrationResult result =
        bestEstimate(session::loadResult(std::filesystem::is_directory(input) ? input / "result.yaml" : input));
    const CameraResult& camera = cameraOf(result, camera_name);
    const sensor::DepthRectifier rectifier(camera.depth->model, camera.intrinsics.camera,
                                           Pose<Color, Infrared>(camera.color_infrared->first_by_second), unit_m);
    std::filesystem::create_directories(out);
    for (const std::filesystem::path& file : files) {
      const cv::Mat raw = readDepth(file, camera.depth->model.camera);
      write(out / (file.stem().string() + "_color.png"), rectifier.registeredMm(raw));
      if (!write_corrected) continue;
      cv::Mat corrected_mm;
      rectifier.corrected(raw).convertTo(corrected_mm, CV_16UC1, 1000.0);
      write(out / (file.stem().string() + "_corrected.png"), corrected_mm);
    }
    return app::kOk;
  });
}
