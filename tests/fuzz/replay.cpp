// SPDX-License-Identifier: GPL-3.0-or-later
// Reads every file of the given folders once, in the order of their names: for compilers without libFuzzer.
#include <algorithm>
#include <cstdint>
#include <filesystem>
#include <fstream>
#include <iostream>
#include <iterator>
#include <vector>

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* bytes, std::size_t size);

namespace {

std::vector<std::filesystem::path> filesIn(const std::filesystem::path& folder) {
  std::vector<std::filesystem::path> files;
  for (const auto& entry : std::filesystem::directory_iterator(folder)) {
    if (entry.is_regular_file()) files.push_back(entry.path());
  }
  std::sort(files.begin(), files.end());
  return files;
}

}  // namespace

int main(int argc, char** argv) {
  for (int i = 1; i < argc; ++i) {
    const auto files = filesIn(argv[i]);
    for (const auto& file : files) {
      std::cerr << file.string() << '\n';  // Before it is read: the last name is the one that broke it.
      std::ifstream in(file, std::ios::binary);
      const std::vector<std::uint8_t> bytes(std::istreambuf_iterator<char>(in), {});
      LLVMFuzzerTestOneInput(bytes.data(), bytes.size());
    }
    if (files.empty()) {
      std::cerr << argv[i] << " holds no seed\n";
      return 1;
    }
  }
  return argc > 1 ? 0 : 1;
}
