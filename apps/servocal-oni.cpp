// SPDX-License-Identifier: GPL-3.0-or-later
#include <algorithm>
#include <atomic>
#include <cstdio>
#include <filesystem>
#include <iostream>
#include <map>
#include <opencv2/imgcodecs.hpp>
#include <optional>
#include <string>
#include <vector>

#include "servocal/app/main.h"
#include "servocal/app/progress.h"
#include "servocal/app/stop_on_signal.h"
#include "servocal/app_cameras/cameras.h"
#include "servocal/core/cell_config.h"
#include "servocal/core/error.h"
#include "servocal/sensor/infrared.h"
#include "servocal/sensor_openni2/recording.h"
#include "servocal/sim/cell.h"

namespace {

using namespace servocal;
namespace fs = std::filesystem;

constexpr const char* kFooter = R"(
Moves no robot. What a recording is good for, and what OpenNI2's own format loses: docs/cameras.md.

Example (a board held before an Xtion, first for its color, then for its infrared):
  $ servocal-oni record cell.yaml --camera xtion --seconds 60 --out xtion.oni
  xtion.oni: color 640 x 480 px, 897 frames, 30 Hz; infrared 640 x 480 px, 882 frames, 30 Hz; depth 640 x ...
  $ servocal-oni images xtion.oni --every 1 --out xtion
  Wrote 30 images of color, 30 of infrared, 30 of depth to xtion
)";

void show(const fs::path& file) {
  const openni2::Recording recording(file);
  std::string text;
  for (const openni2::RecordedStream& stream : recording.streams()) {
    char line[160];
    std::snprintf(line, sizeof(line), "%s %d x %d px, %s frames, %g Hz%s", toString(stream.stream),
                  stream.width_px, stream.height_px,
                  stream.frames ? std::to_string(*stream.frames).c_str() : "an unknown number of",
                  stream.rate_hz, stream.mirrored ? ", mirrored" : "");
    text += (text.empty() ? "" : "; ") + std::string(line);
  }
  std::cout << file.string() << ": " << text << '\n';
}

/// The cell with the one camera alone.
CellConfig only(CellConfig cell, const std::string& name) {
  std::string names;
  for (const CameraConfig& camera : cell.cameras) {
    names += (names.empty() ? "" : ", ") + camera.name;
    if (name.empty() ? cell.cameras.size() > 1 : camera.name != name) continue;
    if (camera.backend != CameraBackend::kOpenNi2) {
      throw Error(
          ErrorKind::kInvalidConfig,
          "Camera '" + camera.name + "' is not read by OpenNI2; only the backend 'openni2' records .oni.");
    }
    cell.cameras = {CameraConfig(camera)};
    return cell;
  }
  throw Error(ErrorKind::kNothingToDo,
              (name.empty() ? "Say which camera (--camera)" : "No camera '" + name + "'") +
                  "; the cell has: " + names);
}

/// Streams that run at once; groups that exclude each other have half of the time each.
std::vector<std::vector<Stream>> groupsOf(const sensor::CameraInfo& info) {
  std::vector<std::vector<Stream>> groups(1);
  for (const sensor::StreamMode& mode : info.streams) {
    if (mode.exclusive && mode.stream == Stream::kInfrared) groups.emplace_back();
    groups.back().push_back(mode.stream);
  }
  return groups;
}

void record(const CellConfig& whole, const std::string& name, double seconds, std::uint64_t seed,
            const fs::path& out) {
  const CellConfig cell = only(whole, name);
  if (fs::exists(out))
    throw Error(ErrorKind::kNothingToDo, out.string() + " is already there; choose another name.");
  std::optional<sim::Cell> simulation;
  if (whole.arm.backend == ArmBackend::kSim) simulation.emplace(whole, seed);
  WallClock wall;
  Clock& clock = simulation ? simulation->clock() : wall;
  app::CameraOptions options;
  options.record = out;
  {
    const app::Cameras cameras(cell, clock, simulation ? &*simulation : nullptr, options);
    for (const std::string& note : cameras.notes()) std::cerr << "Note: " << note << '\n';
    sensor::RgbdCamera& camera = *cameras.all().front();
    std::atomic<bool> stopped{false};
    const app::StopOnSignal stop([&] { stopped = true; });
    app::Progress progress;
    const auto groups = groupsOf(camera.info());
    for (const std::vector<Stream>& group : groups) {
      const Instant begin = clock.now(),
                    end = begin + fromSeconds(seconds / static_cast<double>(groups.size()));
      while (!stopped && clock.now() < end) {
        for (const Stream stream : group)
          (void)camera.next(stream, std::min(end, clock.now() + fromSeconds(0.5)));
        char line[80];
        std::snprintf(line, sizeof(line), "%6.1f of %.1f s  %s", toSeconds(clock.now() - begin),
                      toSeconds(end - begin), toString(group.front()));
        progress.show(line);
      }
    }
    progress.finish();
  }
  show(out);
}

/// An image as other programs read it: color BGR, infrared of 8 bits, depth of 16 bits (mm).
cv::Mat readable(const openni2::RecordedFrame& frame) {
  const bool deep = frame.image.depth() == CV_16U;
  return frame.stream == Stream::kInfrared && deep ? sensor::infraredToEightBits(frame.image) : frame.image;
}

void writeImages(const fs::path& file, double every_s, const fs::path& out) {
  openni2::Recording recording(file);
  fs::create_directories(out);
  std::map<Stream, double> due_s;
  std::map<Stream, int> written;
  while (const auto frame = recording.next()) {
    double& due = due_s[frame->stream];
    if (frame->time_s < due - 1e-4) continue;
    due = frame->time_s + every_s;
    char name[64];
    std::snprintf(name, sizeof(name), "%s_%06d.png", toString(frame->stream), frame->number);
    if (!cv::imwrite((out / name).string(), readable(*frame)))
      throw Error(ErrorKind::kBadData, "Cannot write " + (out / name).string() + ". Is the disk full?");
    ++written[frame->stream];
  }
  std::string text;
  for (const auto& [stream, count] : written)
    text += (text.empty() ? std::to_string(count) + " images of " : ", " + std::to_string(count) + " of ") +
            toString(stream);
  std::cout << "Wrote " << (text.empty() ? "nothing" : text) << " to " << out.string() << '\n';
}

}  // namespace

int main(int argc, char** argv) {
  CLI::App cli("Records a camera to OpenNI2's own format (.oni), and takes images out of such a recording.",
               "servocal-oni");
  cli.require_subcommand(1);
  cli.footer(kFooter);
  std::string cell_file, camera;
  fs::path file, out;
  double seconds = 30.0, every_s = 1.0;
  std::uint64_t seed = 1;
  CLI::App* const record_verb = cli.add_subcommand(
      "record",
      "Until the time is up or Ctrl-C; color and infrared that exclude each other have half of it each");
  record_verb->add_option("CELL", cell_file, "Cell file")->required();
  record_verb->add_option("--camera", camera, "Which of its cameras; may be left out if there is one");
  record_verb->add_option("--seconds", seconds, "How long")
      ->capture_default_str()
      ->check(CLI::Range(0.1, 3600.0));
  record_verb->add_option("--out", out, "The file; must not be there yet")->required();
  record_verb->add_option("--seed", seed, "Seed of a simulated cell")->capture_default_str();
  CLI::App* const show_verb = cli.add_subcommand("show", "Streams, sizes, numbers of frames");
  CLI::App* const images_verb =
      cli.add_subcommand("images", "Writes its frames as images (PNG); depth is in mm");
  for (CLI::App* verb : {show_verb, images_verb})
    verb->add_option("FILE", file, "Recording (.oni)")->required();
  images_verb->add_option("--every", every_s, "One in so many seconds of each stream; 0: all")
      ->capture_default_str()
      ->check(CLI::Range(0.0, 3600.0));
  images_verb->add_option("--out", out, "Folder for the images; files of the same name are replaced")
      ->required();
  return app::guardedMain(cli, argc, argv, [&] {
    if (record_verb->parsed()) record(loadCell(cell_file), camera, seconds, seed, out);
    if (show_verb->parsed()) show(file);
    if (images_verb->parsed()) writeImages(file, every_s, out);
    return app::kOk;
  });
}
