// SPDX-License-Identifier: GPL-3.0-or-later
// Runs under umockdev-wrapper: cameras are plugged into a USB that is not there.
#include <gtest/gtest.h>
#include <umockdev.h>

#include <vector>

#include "errors.h"
#include "mock_usb.h"
#include "servocal/sensor_freenect/camera.h"
#include "servocal/sensor_openni2/camera.h"
#include "servocal/sensor_usb/usb_cameras.h"

namespace servocal::usb {
namespace {

const test::MockUsbDevice kHub{1, 3, "1-3", 0x05e3, 0x0608, 480, "", 9};
const test::MockUsbDevice kKinect1{1, 5, "1-3.1", 0x045e, 0x02ae, 480, "A00362A01385118A", 0xff};
const test::MockUsbDevice kKinect2{2, 7, "2-1", 0x045e, 0x02c4, 5000, "012345643247", 0xff};
const test::MockUsbDevice kKeyboard{1, 6, "1-4", 0x04d9, 0x0169, 12, "", 3};
const test::MockUsbDevice kWebcam{1, 8, "1-5", 0x046d, 0x0825, 480, "", 14};

class MockedUsb : public testing::Test {
 protected:
  MockedUsb() : bed_(umockdev_testbed_new()) {
    EXPECT_TRUE(umockdev_in_mock_environment()) << "start this test with umockdev-wrapper";
    add(test::mockBus(1, 480));
    add(test::mockBus(2, 5000));
    add(test::mockText(kHub));  // libusb knows a port by the hubs on the way
  }
  ~MockedUsb() override { g_object_unref(bed_); }

  void add(const std::string& text) {
    GError* error = nullptr;
    umockdev_testbed_add_from_string(bed_, text.c_str(), &error);
    EXPECT_EQ(error, nullptr) << (error != nullptr ? error->message : "");
  }
  static std::string pathOf(const test::MockUsbDevice& device) {
    return "/sys/devices/pci0000:00/0000:00:14.0/usb" + std::to_string(device.bus) + "/" + device.port;
  }
  void plug(const test::MockUsbDevice& device) {
    add(test::mockText(device));
    umockdev_testbed_uevent(bed_, pathOf(device).c_str(), "add");
  }
  void unplug(const test::MockUsbDevice& device) {
    umockdev_testbed_uevent(bed_, pathOf(device).c_str(), "remove");
    umockdev_testbed_remove_device(bed_, pathOf(device).c_str());
  }

  UMockdevTestbed* bed_;
};

TEST_F(MockedUsb, CamerasAreListedByPortAndNothingElseIs) {
  for (const auto& device : {kKinect2, kKeyboard, kWebcam, kKinect1}) add(test::mockText(device));
  const auto found = cameras();
  ASSERT_EQ(found.size(), 3u);
  EXPECT_EQ(found[0].model.name, "Kinect v1");
  EXPECT_EQ(found[0].port, "1-3.1");
  EXPECT_EQ(found[0].serial, "A00362A01385118A");
  EXPECT_EQ(found[0].speed_mbit, 480.0);
  EXPECT_EQ(found[0].bus, 1);
  EXPECT_EQ(found[0].address, 5);
  EXPECT_EQ(found[1].model.name, "UVC camera");
  EXPECT_EQ(found[2].model.name, "Kinect v2");
  EXPECT_EQ(speedText(found[2]), "USB 3, 5000 Mbit/s");
}

TEST_F(MockedUsb, WhoComesAndGoesIsTold) {
  add(test::mockText(kKinect1));
  std::vector<std::string> seen;
  Watch watch([&](Watch::Change change, const Camera& camera) {
    seen.push_back((change == Watch::Change::kCame ? "+" : "-") + camera.serial);
  });
  EXPECT_EQ(seen, (std::vector<std::string>{"+A00362A01385118A"}));
  const auto until = [&](std::size_t count) {
    for (int i = 0; i < 100 && seen.size() < count; ++i) watch.wait(std::chrono::milliseconds(50));
  };
  plug(kKinect2);
  until(2);
  unplug(kKinect1);
  until(3);
  plug(kKeyboard);
  watch.wait(std::chrono::milliseconds(100));
  EXPECT_EQ(seen, (std::vector<std::string>{"+A00362A01385118A", "+012345643247", "-A00362A01385118A"}));
}

// Plugged in, but nothing that Debian ships reads it: say so, instead of "no device".
TEST_F(MockedUsb, AKinectWithoutAnOpenNi2DriverIsNamed) {
  WallClock clock;
  CameraConfig config;
  config.name = "left";
  config.backend = CameraBackend::kOpenNi2;
  const auto refusal = [&] {
    return test::messageOf(ErrorKind::kHardwareAbsent, [&] { (void)openni2::openCamera(config, clock); });
  };
  EXPECT_EQ(refusal().find("Kinect"), std::string::npos);
  add(test::mockText(kKinect2));
  test::expectPart(refusal(), "Kinect v2 012345643247 is plugged in (port 2-1)");
  test::expectPart(refusal(), "docs/cameras.md");
  add(test::mockText(kKinect1));
  test::expectPart(refusal(), "say 'backend: freenect'");
}

// The real libfreenect: this mocked Kinect does not even tell its serial number.
TEST_F(MockedUsb, AKinectThatLibfreenectCannotOpenIsNamed) {
  WallClock clock;
  CameraConfig config;
  config.name = "front";
  config.backend = CameraBackend::kFreenect;
  config.width_px = 640;
  config.height_px = 480;
  const auto refusal = [&] {
    return test::messageOf(ErrorKind::kHardwareAbsent, [&] { (void)freenect::openCamera(config, clock); });
  };
  test::expectPart(refusal(), "no Kinect v1 is plugged in");
  EXPECT_EQ(refusal().find("port"), std::string::npos);
  add(test::mockText(kKinect1));
  test::expectPart(refusal(), "Kinect v1 A00362A01385118A is plugged in (port 1-3.1)");
  test::expectPart(refusal(), "servocal-devices");
}

}  // namespace
}  // namespace servocal::usb
