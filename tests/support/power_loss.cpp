// SPDX-License-Identifier: GPL-3.0-or-later
#include "power_loss.h"

#include <fcntl.h>
#include <sys/stat.h>
#include <unistd.h>

#include <fstream>
#include <functional>
#include <iterator>
#include <map>
#include <optional>
#include <random>
#include <sstream>
#include <stdexcept>
#include <string>

namespace servocal::test {
namespace {

namespace fs = std::filesystem;
using Names = std::map<std::string, std::string>;  ///< In a folder: name to node.

constexpr std::size_t kSector = 512;

/// Which file or folder it is, whatever its name: a number is used again once a file is gone, not at the same
/// time.
std::string nodeOf(const fs::path& path) {
  struct statx status = {};
  if (statx(AT_FDCWD, path.c_str(), 0, STATX_INO | STATX_BTIME, &status) != 0) return "";
  return std::to_string(status.stx_ino) + "-" + std::to_string(status.stx_btime.tv_sec) + "." +
         std::to_string(status.stx_btime.tv_nsec);
}

std::optional<std::string> contentOf(const fs::path& file) {
  std::ifstream in(file, std::ios::binary);
  if (!in) return std::nullopt;
  return std::string(std::istreambuf_iterator<char>(in), {});
}

/// Whole or not at all: its writer may be killed.
void store(const fs::path& file, const std::string& content) {
  const fs::path beside = file.string() + ".new";
  std::ofstream(beside, std::ios::binary) << content;
  fs::rename(beside, file);
}

Names namesIn(const fs::path& folder) {
  Names names;
  for (const fs::directory_entry& entry : fs::directory_iterator(folder)) {
    names[entry.path().filename().string()] = nodeOf(entry.path());
  }
  return names;
}

std::string asText(const Names& names) {
  std::string text;
  for (const auto& [name, node] : names) text += node + " " + name + "\n";
  return text;
}

Names asNames(const std::string& text) {
  Names names;
  std::istringstream lines(text);
  std::string node, name;
  while (lines >> node && std::getline(lines >> std::ws, name)) names[name] = node;
  return names;
}

/// Every folder below, it included, with its node.
void forAll(const fs::path& folder, const std::function<void(const fs::path&)>& visit) {
  visit(folder);
  for (const fs::directory_entry& entry : fs::recursive_directory_iterator(folder)) visit(entry.path());
}

}  // namespace

SurvivingDisk::SurvivingDisk(const fs::path& folder, const fs::path& shadow)
    : folder_(folder), shadow_(shadow) {
  forAll(folder, [&](const fs::path& path) {
    store(shadow_ / nodeOf(path),
          fs::is_directory(path) ? asText(namesIn(path)) : contentOf(path).value_or(""));
  });
}

void SurvivingDisk::sync(int descriptor) const {
  const fs::path path = fs::read_symlink("/proc/self/fd/" + std::to_string(descriptor));
  const std::string folder = folder_.string();
  if (path.string().compare(0, folder.size(), folder) != 0 || !fs::exists(path)) return;
  store(shadow_ / nodeOf(path),
        fs::is_directory(path) ? asText(namesIn(path)) : contentOf(path).value_or(""));
}

void SurvivingDisk::restore(const fs::path& to, Unsynced unsynced, std::uint64_t seed) const {
  std::mt19937_64 random(seed);
  const bool partly = unsynced == Unsynced::kPartly;
  std::map<std::string, fs::path> present;  // What was there when the power went off, by node.
  forAll(folder_, [&](const fs::path& path) { present[nodeOf(path)] = path; });

  const auto contentFor = [&](const std::string& node) {
    std::string content = contentOf(shadow_ / node).value_or("");
    if (!partly || present.count(node) == 0) return content;
    const std::string written = contentOf(present[node]).value_or("");
    if (random() % 2 == 0) content.resize(written.size());
    for (std::size_t at = 0; at < std::min(content.size(), written.size()); at += kSector) {
      if (random() % 2 == 0)
        content.replace(at, kSector, written.substr(at, std::min(kSector, content.size() - at)));
    }
    return content;
  };
  const auto namesFor = [&](const std::string& node) {
    Names names = asNames(contentOf(shadow_ / node).value_or(""));
    if (!partly || present.count(node) == 0) return names;
    const Names written = namesIn(present[node]), synced = names;
    for (const auto& [name, its_node] : written) {
      if (random() % 2 == 0) names[name] = its_node;
    }
    for (const auto& [name, its_node] : synced) {
      if (written.count(name) == 0 && random() % 2 == 0) names.erase(name);
    }
    return names;
  };
  const std::function<void(const std::string&, const fs::path&)> make = [&](const std::string& node,
                                                                            const fs::path& at) {
    for (const auto& [name, its_node] : namesFor(node)) {
      const bool is_folder = present.count(its_node) > 0 && fs::is_directory(present[its_node]);
      if (!is_folder) {
        std::ofstream(at / name, std::ios::binary) << contentFor(its_node);
        continue;
      }
      fs::create_directory(at / name);
      make(its_node, at / name);
    }
  };
  make(nodeOf(folder_), to);
}

}  // namespace servocal::test
