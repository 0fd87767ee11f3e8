// SPDX-License-Identifier: GPL-3.0-or-later
#include "find_node.h"

#include <gtest/gtest.h>
#include <unistd.h>

#include "errors.h"
#include "temporary_folder.h"

namespace servocal::v4l2 {
namespace {

namespace fs = std::filesystem;

/// Two webcams as udev lists them: each with a node for images and one that tells about them.
class FindNode : public testing::Test {
 protected:
  FindNode() {
    fs::create_directories(devices.path() / "v4l" / "by-id");
    add(0, "usb-Maker_Cam_1A2B-video-index0");
    add(1, "usb-Maker_Cam_1A2B-video-index1");
    add(2, "usb-Other_Cam_77-video-index0");
    config.name = "web";
  }
  void add(int number, const std::string& name) {
    const std::string node = "video" + std::to_string(number);
    devices.write(node, "");
    fs::create_symlink("../../" + node, devices.path() / "v4l" / "by-id" / name);
  }
  Node find(const std::string& device) {
    config.device = device;
    return findNode(config, devices.path());
  }
  std::string refusal(const std::string& device) {
    return test::messageOf(ErrorKind::kHardwareAbsent, [&] { find(device); });
  }

  test::TemporaryFolder devices;
  CameraConfig config;
};

TEST_F(FindNode, ByAPartOfItsName) {
  EXPECT_EQ(find("1A2B").name, "usb-Maker_Cam_1A2B");
  EXPECT_EQ(fs::canonical(find("Other").path), fs::canonical(devices.path() / "video2"));
}

// By its name, so that it is known again when its number has changed.
TEST_F(FindNode, ByNumberAndByPath) {
  EXPECT_EQ(find("2").name, "usb-Other_Cam_77");
  EXPECT_EQ(find((devices.path() / "video0").string()).name, "usb-Maker_Cam_1A2B");
  devices.write("video9", "");
  EXPECT_EQ(find("9").path, devices.path() / "video9");
  EXPECT_EQ(find("9").name, "");
}

TEST_F(FindNode, SaysWhatThereIs) {
  test::expectPart(refusal("Cam"), "usb-Maker_Cam_1A2B, usb-Other_Cam_77");
  test::expectPart(refusal(""), "several");
  test::expectPart(refusal("C920"), "usb-Other_Cam_77");
  test::expectPart(refusal("5"), "video5");
}

TEST_F(FindNode, WithoutANameTheOnlyOne) {
  fs::remove(devices.path() / "v4l" / "by-id" / "usb-Other_Cam_77-video-index0");
  EXPECT_EQ(find("").name, "usb-Maker_Cam_1A2B");
}

}  // namespace
}  // namespace servocal::v4l2
