// SPDX-License-Identifier: GPL-3.0-or-later
// What is said of cameras; what is seen of them is tested on a mocked USB.
#include <gtest/gtest.h>

#include "errors.h"
#include "models.h"
#include "servocal/sensor_usb/usb_cameras.h"

namespace servocal::usb {
namespace {

using test::expectPart;

Camera plugged(std::uint16_t vendor_id, std::uint16_t product_id, int bus, const std::string& port,
               double speed_mbit) {
  Camera camera;
  camera.model = knownModel(vendor_id, product_id).value();
  camera.vendor_id = vendor_id;
  camera.product_id = product_id;
  camera.bus = bus;
  camera.port = port;
  camera.speed_mbit = speed_mbit;
  camera.serial = "S" + port;
  return camera;
}
Camera kinect1(int bus, const std::string& port) { return plugged(0x045e, 0x02ae, bus, port, 480); }
Camera kinect2(int bus, const std::string& port, double speed_mbit = 5000) {
  return plugged(0x045e, 0x02c4, bus, port, speed_mbit);
}

TEST(UsbProblems, CamerasThatWorkAreNotTalkedAbout) {
  EXPECT_TRUE(problems({}).empty());
  EXPECT_TRUE(problems({kinect1(1, "1-1"), kinect2(2, "2-1"), kinect2(4, "4-1")}).empty());
}

TEST(UsbProblems, AUsb3CameraOnUsb2IsNamed) {
  const auto found = problems({kinect2(1, "1-4", 480)});
  ASSERT_EQ(found.size(), 1u);
  expectPart(found[0], "Kinect v2 S1-4 at port 1-4 hangs on USB 2");
}

TEST(UsbProblems, TwoCamerasThatDoNotFitOnOneBusAreNamed) {
  const auto two_v2 = problems({kinect2(2, "2-1"), kinect2(2, "2-2")});
  ASSERT_EQ(two_v2.size(), 1u);
  expectPart(two_v2[0], "2-1");
  expectPart(two_v2[0], "2-2");
  expectPart(two_v2[0], "541 MB/s of about 400");
  EXPECT_EQ(problems({kinect1(1, "1-1"), kinect1(1, "1-2")}).size(), 1u);
  EXPECT_TRUE(problems({kinect1(1, "1-1"), kinect1(3, "3-1")}).empty());
}

// Two Kinect v1 that never send color and infrared at once need half of it.
TEST(UsbProblems, TheModesOfTheCellDecide) {
  CellConfig cell;
  for (const std::string serial : {"S1-1", "S1-2"}) {
    CameraConfig camera;
    camera.device = serial;
    camera.width_px = 640;
    camera.height_px = 480;
    camera.infrared = InfraredConfig{};
    camera.infrared->width_px = 640;
    camera.infrared->height_px = 480;
    camera.infrared->excludes_color = true;
    cell.cameras.push_back(camera);
  }
  const std::vector<Camera> both{kinect1(1, "1-1"), kinect1(1, "1-2")};
  EXPECT_EQ(problems(both).size(), 1u);
  EXPECT_TRUE(problems(both, &cell).empty());
  cell.cameras[0].width_px = 1280;
  cell.cameras[0].height_px = 1024;
  EXPECT_EQ(problems(both, &cell).size(), 1u);
}

TEST(UsbProblems, APermissionIsAnsweredWithTheRule) {
  Camera camera = kinect1(1, "1-1");
  camera.may_open = false;
  const auto found = problems({camera});
  ASSERT_EQ(found.size(), 1u);
  expectPart(found[0], "ATTR{idVendor}==\"045e\", ATTR{idProduct}==\"02ae\"");
  expectPart(found[0], "uaccess");
}

TEST(UsbProblems, AKernelDriverInTheWayIsNamedAndOneThatIsNeededIsMissed) {
  Camera camera = kinect1(1, "1-1");
  camera.kernel_driver = "gspca_kinect";
  auto found = problems({camera});
  ASSERT_EQ(found.size(), 1u);
  expectPart(found[0], "modprobe -r gspca_kinect");
  Camera real_sense = plugged(0x8086, 0x0b07, 2, "2-1", 5000);
  found = problems({real_sense});
  ASSERT_EQ(found.size(), 1u);
  expectPart(found[0], "uvcvideo");
  real_sense.kernel_driver = "uvcvideo";
  real_sense.may_open = false;  // /dev/video has rights of its own.
  EXPECT_TRUE(problems({real_sense}).empty());
}

}  // namespace
}  // namespace servocal::usb
