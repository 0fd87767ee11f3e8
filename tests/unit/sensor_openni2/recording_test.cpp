// SPDX-License-Identifier: GPL-3.0-or-later
// Recorded and played by libOpenNI2 itself; what comes back is compared with what the camera handed out.
#include "servocal/sensor_openni2/recording.h"

#include <OpenNI.h>
#include <gtest/gtest.h>

#include <filesystem>
#include <fstream>
#include <map>
#include <opencv2/core.hpp>
#include <opencv2/imgproc.hpp>

#include "errors.h"
#include "plugged.h"
#include "servocal/sensor_openni2/camera.h"
#include "temporary_folder.h"

namespace servocal::openni2 {
namespace {

using std::chrono::milliseconds;
using test::expectPart;
using test::messageOf;
using test::Plugged;

using Images = std::map<Stream, std::vector<cv::Mat>>;

/// A Kinect whose color is small enough for the player.
CellConfig smallKinect() {
  CellConfig config = test::kinect(DepthSensor::kTimeOfFlight);
  config.cameras[0].width_px = 960;
  config.cameras[0].height_px = 540;
  return config;
}

/// Opens the camera, takes `frames` of each of `streams` in turn, records all that to `file`; what it took.
Images record(const CellConfig& config, const std::filesystem::path& file, const std::vector<Stream>& streams,
              int frames) {
  Plugged plugged(config);
  OpenOptions options = test::raw();
  options.record = file;
  const auto opened = openCamera(config.cameras[0], plugged.cell.clock(), options);
  Images taken;
  for (int i = 0; i < frames; ++i) {
    for (const Stream stream : streams) {
      const auto frame = opened.camera->next(stream, plugged.cell.clock().now() + std::chrono::seconds(2));
      if (frame) taken[stream].push_back(frame->image);
    }
  }
  return taken;
}

std::string fileText(const std::filesystem::path& file) {
  std::ifstream in(file, std::ios::binary);
  return {std::istreambuf_iterator<char>(in), {}};
}

/// How many of `part` are in `all`, in the same order.
int found(const std::vector<cv::Mat>& part, const std::vector<cv::Mat>& all) {
  int count = 0;
  std::size_t from = 0;
  for (const cv::Mat& image : part) {
    for (std::size_t i = from; i < all.size(); ++i) {
      if (image.size() != all[i].size() || image.type() != all[i].type()) return 0;
      if (cv::norm(image, all[i], cv::NORM_INF) != 0.0) continue;
      ++count;
      from = i + 1;
      break;
    }
  }
  return count;
}

TEST(Recording, PlaysBackEveryFrameOfColorInfraredAndDepthBitByBit) {
  const test::TemporaryFolder folder;
  const std::filesystem::path file = folder.path() / "kinect.oni";
  const Images taken = record(smallKinect(), file, {Stream::kColor, Stream::kInfrared, Stream::kDepth}, 12);

  Recording recording(file);
  ASSERT_EQ(recording.streams().size(), 3u);
  Images played;
  std::map<Stream, double> time_s;
  while (const auto frame = recording.next()) {
    auto& images = played[frame->stream];
    images.push_back(frame->image);
    EXPECT_EQ(frame->number, static_cast<int>(images.size()));
    if (images.size() > 1) {
      EXPECT_NEAR(frame->time_s - time_s[frame->stream], 1.0 / 30.0, 1e-5);
    }
    time_s[frame->stream] = frame->time_s;
  }
  for (const RecordedStream& stream : recording.streams()) {
    SCOPED_TRACE(toString(stream.stream));
    EXPECT_EQ(stream.rate_hz, 30.0);
    EXPECT_FALSE(stream.mirrored);
    ASSERT_TRUE(stream.frames);
    EXPECT_EQ(static_cast<int>(played[stream.stream].size()), *stream.frames);
    EXPECT_GE(found(taken.at(stream.stream), played[stream.stream]), 11);
  }
  EXPECT_FALSE(recording.next());
}

TEST(Recording, StreamsThatExcludeEachOtherComeOneAfterTheOther) {
  const test::TemporaryFolder folder;
  const std::filesystem::path file = folder.path() / "kinect1.oni";
  const CellConfig config = test::kinect(DepthSensor::kStructuredLight);
  const Images taken = record(config, file, {Stream::kColor, Stream::kInfrared}, 2);
  Recording recording(file);
  Images played;
  while (const auto frame = recording.next()) played[frame->stream].push_back(frame->image);
  EXPECT_GE(found(taken.at(Stream::kColor), played[Stream::kColor]), 1);
  EXPECT_EQ(found(taken.at(Stream::kInfrared), played[Stream::kInfrared]), 2);
}

TEST(Recording, OneMirroredByAnotherProgramIsTurnedBack) {
  const test::TemporaryFolder folder;
  const std::filesystem::path file = folder.path() / "mirrored.oni";
  const CellConfig config = smallKinect();
  cv::Mat last;
  {
    Plugged plugged(config);
    ASSERT_EQ(openni::OpenNI::initialize(), openni::STATUS_OK);
    openni::Device device;
    ASSERT_EQ(device.open("servocal://front"), openni::STATUS_OK);
    openni::VideoStream stream;
    ASSERT_EQ(stream.create(device, openni::SENSOR_DEPTH), openni::STATUS_OK);
    device.setImageRegistrationMode(openni::IMAGE_REGISTRATION_OFF);
    ASSERT_TRUE(stream.getMirroringEnabled());  // As devices come up.
    openni::Recorder recorder;
    recorder.create(file.c_str());
    recorder.attach(stream);
    recorder.start();
    stream.start();
    for (int i = 0; i < 60; ++i) {
      plugged.cell.clock().sleepUntil(plugged.cell.clock().now() + milliseconds(10));
      openni::VideoStream* streams[] = {&stream};
      int ready = -1;
      if (openni::OpenNI::waitForAnyStream(streams, 1, &ready, 0) != openni::STATUS_OK) continue;
      openni::VideoFrameRef frame;
      stream.readFrame(&frame);
      last =
          cv::Mat(frame.getHeight(), frame.getWidth(), CV_16UC1, const_cast<void*>(frame.getData())).clone();
    }
    stream.stop();
    recorder.destroy();
    stream.destroy();
    device.close();
    openni::OpenNI::shutdown();
  }
  Recording recording(file);
  ASSERT_EQ(recording.streams().size(), 1u);
  EXPECT_TRUE(recording.streams()[0].mirrored);
  cv::Mat played;
  while (const auto frame = recording.next()) played = frame->image;
  cv::flip(last, last, 1);
  ASSERT_GT(cv::countNonZero(last), 0);
  const int width = (last.cols) / 2;  // A symmetric picture would prove nothing.
  EXPECT_NE(cv::sum(last.colRange(0, width)), cv::sum(last.colRange(last.cols - width, last.cols)));
  EXPECT_EQ(cv::norm(played, last, cv::NORM_INF), 0.0);
}

TEST(Recording, WhatThePlayerCannotTakeIsLeftOutWithANote) {
  const test::TemporaryFolder folder;
  const CellConfig config = test::kinect(DepthSensor::kTimeOfFlight);
  Plugged plugged(config);
  OpenOptions options = test::raw();
  options.record = folder.path() / "big.oni";
  const auto opened = openCamera(config.cameras[0], plugged.cell.clock(), options);
  EXPECT_TRUE(std::any_of(opened.notes.begin(), opened.notes.end(), [](const std::string& note) {
    return note.find("color is not recorded") == 0 && note.find("1920 x 1080") != std::string::npos;
  }));
}

TEST(Recording, RefusesWhatIsNone) {
  const test::TemporaryFolder folder;
  expectPart(messageOf(ErrorKind::kBadData, [&] { Recording{folder.path() / "none.oni"}; }),
             "cannot be read");
  std::ofstream(folder.path() / "text.oni") << "no recording";
  expectPart(messageOf(ErrorKind::kBadData, [&] { Recording{folder.path() / "text.oni"}; }),
             "no recording of OpenNI2");
  const CellConfig config = smallKinect();
  Plugged plugged(config);
  OpenOptions options;
  options.record = folder.path() / "no-such-folder" / "a.oni";
  expectPart(
      messageOf(ErrorKind::kBadData, [&] { openCamera(config.cameras[0], plugged.cell.clock(), options); }),
      "no file can be written there");
}

TEST(Recording, OneThatIsCutShortOrDamagedSaysSo) {
  const test::TemporaryFolder folder;
  const std::filesystem::path file = folder.path() / "a.oni", cut = folder.path() / "cut.oni";
  (void)record(smallKinect(), file, {Stream::kColor}, 6);
  std::filesystem::copy_file(file, cut);
  std::filesystem::resize_file(cut, 4'000'000);
  expectPart(messageOf(ErrorKind::kBadData, [&] { Recording{cut}; }), "cut short or is damaged");

  // Somewhere in the middle the head of a record is gone.
  std::string bytes = fileText(file);
  const std::size_t head = bytes.find(std::string("NIR", 4), 4'000'000);
  ASSERT_NE(head, std::string::npos);
  std::fill_n(bytes.begin() + static_cast<std::ptrdiff_t>(head), 4, '\0');
  std::ofstream(file, std::ios::binary) << bytes;
  const std::string message = messageOf(ErrorKind::kBadData, [&] {
    Recording recording(file);
    while (recording.next()) continue;
  });
  expectPart(message, "of color");
}

TEST(Recording, AnUnpluggedCameraEndsIt) {
  const test::TemporaryFolder folder;
  const std::filesystem::path file = folder.path() / "unplugged.oni";
  const CellConfig config = smallKinect();
  {
    Plugged plugged(config);
    OpenOptions options;
    options.record = file;
    const auto opened = openCamera(config.cameras[0], plugged.cell.clock(), options);
    const auto next = [&] {
      return opened.camera->next(Stream::kDepth, plugged.cell.clock().now() + std::chrono::seconds(1));
    };
    for (int i = 0; i < 5; ++i) ASSERT_TRUE(next());
    plugged.served.unplug("front");
    expectPart(messageOf(ErrorKind::kHardwareAbsent, next), "is gone");
    plugged.served.plug("front");
    expectPart(messageOf(ErrorKind::kHardwareAbsent, next), "is gone");
  }
  Recording recording(file);
  int frames = 0;
  while (recording.next()) ++frames;
  EXPECT_GE(frames, 4);
}

}  // namespace
}  // namespace servocal::openni2
