// SPDX-License-Identifier: GPL-3.0-or-later
#include "fakenect_more.h"

#include <dlfcn.h>

#include <algorithm>
#include <cstdint>
#include <cstdlib>
#include <cstring>

namespace servocal::test {
namespace {

/// libfreenect's thread alone, or the test before it runs.
freenect_frame_mode video_mode{}, depth_mode{};
freenect_video_cb video_callback = nullptr;
bool video_runs = false, depth_runs = false;

template <class Function>
Function* fakenects(const char* name) {
  return reinterpret_cast<Function*>(dlsym(RTLD_NEXT, name));
}

freenect_frame_mode modeOf(int format, int bytes_per_px, int height) {
  freenect_frame_mode mode{};
  mode.resolution = FREENECT_RESOLUTION_MEDIUM;
  mode.dummy = format;
  mode.width = 640;
  mode.height = static_cast<std::int16_t>(height);
  mode.bytes = 640 * height * bytes_per_px;
  mode.framerate = 30;
  mode.is_valid = 1;
  return mode;
}

void complain(bool of_what, const char* sentence) {
  if (!of_what) return;
  const std::lock_guard<std::mutex> lock(fakeKinects().mutex);
  fakeKinects().violations.emplace_back(sentence);
}

/// The recorded red as infrared: 640 x 488, ten bits.
void onRecorded(freenect_device* device, void* pixels, std::uint32_t stamp) {
  if (video_mode.video_format != FREENECT_VIDEO_IR_10BIT) return video_callback(device, pixels, stamp);
  constexpr int kWidth = 640, kHeight = 488, kAbove = 4;
  std::vector<std::uint16_t> infrared(kWidth * kHeight, kMarginCounts);
  const auto* const rgb = static_cast<const std::uint8_t*>(pixels);
  for (int i = 0; i < kWidth * 480; ++i)
    infrared[static_cast<std::size_t>(kAbove * kWidth + i)] = static_cast<std::uint16_t>(4 * rgb[3 * i]);
  video_callback(device, infrared.data(), stamp);
}

}  // namespace

FakeKinects& fakeKinects() {
  static FakeKinects kinects;
  return kinects;
}

}  // namespace servocal::test

using namespace servocal::test;

extern "C" {

int freenect_list_device_attributes(freenect_context*, freenect_device_attributes** list) {
  const std::lock_guard<std::mutex> lock(fakeKinects().mutex);
  *list = nullptr;
  for (auto serial = fakeKinects().serials.rbegin(); serial != fakeKinects().serials.rend(); ++serial)
    *list = new freenect_device_attributes{*list, strdup(serial->c_str())};
  return static_cast<int>(fakeKinects().serials.size());
}

void freenect_free_device_attributes(freenect_device_attributes* list) {
  while (list != nullptr) {
    freenect_device_attributes* const one = list;
    list = one->next;
    std::free(const_cast<char*>(one->camera_serial));
    delete one;
  }
}

int freenect_open_device_by_camera_serial(freenect_context* context, freenect_device** device,
                                          const char* serial) {
  {
    const std::lock_guard<std::mutex> lock(fakeKinects().mutex);
    const auto& all = fakeKinects().serials;
    if (fakeKinects().busy || std::find(all.begin(), all.end(), serial) == all.end()) return -1;
    fakeKinects().cable_cut = false;
  }
  return freenect_open_device(context, device, 0);
}

int freenect_set_flag(freenect_device*, freenect_flag flag, freenect_flag_value value) {
  complain(!video_runs, "a setting of the color sensor while it does not run");
  const std::lock_guard<std::mutex> lock(fakeKinects().mutex);
  if (!fakeKinects().obeys_flags) return -1;
  if (value == FREENECT_OFF) fakeKinects().off.push_back(flag);
  return 0;
}

freenect_frame_mode freenect_find_video_mode(freenect_resolution, freenect_video_format format) {
  return format == FREENECT_VIDEO_RGB ? modeOf(format, 3, 480) : modeOf(format, 2, 488);
}
freenect_frame_mode freenect_find_depth_mode(freenect_resolution, freenect_depth_format format) {
  return modeOf(format, 2, 480);
}
freenect_frame_mode freenect_get_current_video_mode(freenect_device*) { return video_mode; }
freenect_frame_mode freenect_get_current_depth_mode(freenect_device*) { return depth_mode; }

int freenect_set_video_mode(freenect_device*, freenect_frame_mode mode) {
  complain(video_runs, "another video mode while it runs");
  video_mode = mode;
  return video_runs ? -1 : 0;
}
int freenect_set_depth_mode(freenect_device*, const freenect_frame_mode mode) {
  complain(mode.depth_format != FREENECT_DEPTH_MM, "depth that is not plain mm");
  depth_mode = mode;
  return 0;
}

int freenect_start_video(freenect_device* device) {
  if (video_runs) return -1;
  video_runs = true;
  {
    const std::lock_guard<std::mutex> lock(fakeKinects().mutex);
    fakeKinects().off.clear();
  }
  return fakenects<int(freenect_device*)>("freenect_start_video")(device);
}
int freenect_stop_video(freenect_device* device) {
  video_runs = false;
  return fakenects<int(freenect_device*)>("freenect_stop_video")(device);
}
int freenect_start_depth(freenect_device* device) {
  if (depth_runs) return -1;
  depth_runs = true;
  return fakenects<int(freenect_device*)>("freenect_start_depth")(device);
}
int freenect_stop_depth(freenect_device* device) {
  depth_runs = false;
  return fakenects<int(freenect_device*)>("freenect_stop_depth")(device);
}

void freenect_set_video_callback(freenect_device* device, freenect_video_cb callback) {
  video_callback = callback;
  fakenects<void(freenect_device*, freenect_video_cb)>("freenect_set_video_callback")(device, onRecorded);
}

int freenect_process_events_timeout(freenect_context* context, timeval* timeout) {
  {
    const std::lock_guard<std::mutex> lock(fakeKinects().mutex);
    if (fakeKinects().cable_cut) return -1;
  }
  return fakenects<int(freenect_context*, timeval*)>("freenect_process_events_timeout")(context, timeout);
}

}  // extern "C"
