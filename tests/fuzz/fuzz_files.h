// SPDX-License-Identifier: GPL-3.0-or-later
// A folder in memory for targets that read files.
#pragma once

#include <unistd.h>

#include <cstdint>
#include <filesystem>
#include <fstream>
#include <string>

namespace servocal::fuzz {

inline std::filesystem::path ownFolder(const char* name) {
  const std::filesystem::path root = std::filesystem::exists("/dev/shm") ? "/dev/shm" : "/tmp";
  const auto folder = root / (std::string("servocal-") + name + "-" + std::to_string(getpid()));
  std::filesystem::create_directories(folder);
  return folder;
}

inline void write(const std::filesystem::path& file, const void* bytes, std::size_t size) {
  std::ofstream(file, std::ios::binary)
      .write(static_cast<const char*>(bytes), static_cast<std::streamsize>(size));
}
inline void write(const std::filesystem::path& file, const std::string& text) {
  write(file, text.data(), text.size());
}

/// A picture of 2 x 2 pixels, whole.
inline void writeImage(const std::filesystem::path& file) {
  constexpr unsigned char kPng[] = {0x89, 0x50, 0x4e, 0x47, 0x0d, 0x0a, 0x1a, 0x0a, 0x00, 0x00, 0x00, 0x0d,
                                    0x49, 0x48, 0x44, 0x52, 0x00, 0x00, 0x00, 0x02, 0x00, 0x00, 0x00, 0x02,
                                    0x08, 0x00, 0x00, 0x00, 0x00, 0x57, 0xdd, 0x52, 0xf8, 0x00, 0x00, 0x00,
                                    0x0e, 0x49, 0x44, 0x41, 0x54, 0x78, 0x9c, 0x63, 0x48, 0x70, 0x60, 0x50,
                                    0x10, 0x00, 0x00, 0x03, 0x36, 0x00, 0xd1, 0xb0, 0xdb, 0x6d, 0x6c, 0x00,
                                    0x00, 0x00, 0x00, 0x49, 0x45, 0x4e, 0x44, 0xae, 0x42, 0x60, 0x82};
  write(file, kPng, sizeof kPng);
}

}  // namespace servocal::fuzz
