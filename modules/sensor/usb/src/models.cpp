// SPDX-License-Identifier: GPL-3.0-or-later
#include "models.h"

#include <algorithm>

namespace servocal::usb {
namespace {

constexpr std::uint16_t kMicrosoft = 0x045e, kPrimeSense = 0x1d27, kOrbbec = 0x2bc5, kIntel = 0x8086;

CameraModel kinect1() {
  // Bayer, and 11 bits of depth.
  return {"Kinect v1", CameraBackend::kFreenect, false, false, 0.0, 1.0, 1.375, 640, 480, 640, 480};
}

CameraModel kinect2() {
  // Reserves isochronous packets of 33792 bytes 8000 times a second.
  return {"Kinect v2", CameraBackend::kOpenNi2, true, false, 270.3, 0.0, 0.0, 1920, 1080, 512, 424};
}

CameraModel primeSense(const char* name) {
  return {name, CameraBackend::kOpenNi2, false, false, 0.0, 2.0, 1.5, 640, 480, 640, 480};
}

CameraModel realSense(const char* name) {
  // Its color stream alone: reading depth needs the vendor's library.
  return {name, CameraBackend::kV4l2, false, true, 0.0, 2.0, 0.0, 1920, 1080, 0, 0};
}

struct Entry {
  std::uint16_t vendor_id, product_id;
  CameraModel model;
};

const std::vector<Entry>& table() {
  static const std::vector<Entry> entries{
      {kMicrosoft, 0x02ae, kinect1()},
      {kMicrosoft, 0x02bf, kinect1()},  // "for Windows"
      {kMicrosoft, 0x02c4, kinect2()},
      {kMicrosoft, 0x02d8, kinect2()},
      {kPrimeSense, 0x0600, primeSense("Xtion or PrimeSense (PS1080)")},
      {kPrimeSense, 0x0601, primeSense("Xtion or PrimeSense (PS1080)")},
      {kPrimeSense, 0x0609, primeSense("PrimeSense Carmine 1.09")},
      {kOrbbec, 0x0401, primeSense("Orbbec Astra")},
      {kOrbbec, 0x0402, primeSense("Orbbec Astra S")},
      {kOrbbec, 0x0403, primeSense("Orbbec Astra Pro (depth)")},
      {kOrbbec, 0x0404, primeSense("Orbbec Astra Mini")},
      {kIntel, 0x0ad3, realSense("RealSense D415")},
      {kIntel, 0x0b07, realSense("RealSense D435")},
      {kIntel, 0x0b3a, realSense("RealSense D435i")},
      {kIntel, 0x0b5b, realSense("RealSense D405")},
      {kIntel, 0x0b5c, realSense("RealSense D455")},
      {kIntel, 0x0b64, realSense("RealSense L515")},
      {kIntel, 0x0aa5, realSense("RealSense SR300")},
  };
  return entries;
}

}  // namespace

std::optional<CameraModel> knownModel(std::uint16_t vendor_id, std::uint16_t product_id) {
  const auto& entries = table();
  const auto found = std::find_if(entries.begin(), entries.end(), [&](const Entry& entry) {
    return entry.vendor_id == vendor_id && entry.product_id == product_id;
  });
  if (found == entries.end()) return std::nullopt;
  return found->model;
}

CameraModel webcam() {
  return {"UVC camera", CameraBackend::kV4l2, false, true, 0.0, 2.0, 0.0, 1280, 720, 0, 0};
}

}  // namespace servocal::usb
