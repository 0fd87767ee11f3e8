// SPDX-License-Identifier: GPL-3.0-or-later
// Whatever has become of a session's database: it is read, checked and repaired, or ends in an Error. The input is
// damage to a sound one: four bytes at a time, place (3) and new value (1); an odd rest cuts the file.
#include <functional>
#include <iterator>

#include "fuzz_files.h"
#include "servocal/core/error.h"
#include "servocal/session/check.h"

namespace {

using namespace servocal;

std::string soundDatabase(const std::filesystem::path& folder) {
  {
    session::Session session = session::Session::create(folder / "sound", "name: x", BoardSpec{}, 1);
    for (int i = 0; i < 4; ++i) {
      Observation observation;
      observation.stage = "cover";
      observation.robot.emplace();
      observation.robot->q = Eigen::VectorXd::Constant(6, 0.1 * i);
      observation.robot->bMe = Pose<Base, EndEffector>::identity();
      StreamObservation view;
      view.camera = "cam1";
      view.stream = Stream::kInfrared;
      view.depth.emplace();
      view.depth->corners = {{0, 0.7, 12}, {1, 0.71, 10}};
      view.depth->patches = {{{10.0, 20.0}, 0.7, 0.001, 30}};
      for (int id = 0; id < 6; ++id) view.detection.corners.push_back({id, {10.0 * id, 5.0}, Eigen::Matrix2d::Identity()});
      observation.views = {view};
      session.add(observation, {});
      Attempt attempt;
      attempt.observation_id = i + 1;
      session.add(attempt);
      session.event({}, "stage", "cover");
    }
  }
  std::ifstream in(folder / "sound/session.sqlite", std::ios::binary);
  return {std::istreambuf_iterator<char>(in), std::istreambuf_iterator<char>()};
}

void attempt(const std::function<void()>& part) {
  try {
    part();
  } catch (const Error&) {
  }
}

}  // namespace

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* bytes, std::size_t size) {
  static const std::filesystem::path folder = fuzz::ownFolder("session");
  static const std::string sound = soundDatabase(folder);
  std::string damaged = sound;
  std::size_t at = 0;
  for (; at + 4 <= size; at += 4) {
    damaged[(bytes[at] | bytes[at + 1] << 8 | bytes[at + 2] << 16) % damaged.size()] = static_cast<char>(bytes[at + 3]);
  }
  if (at < size) damaged.resize(damaged.size() * bytes[at] / 255);
  const std::filesystem::path run = folder / "run";
  std::filesystem::remove_all(run);
  std::filesystem::create_directories(run / "images");
  fuzz::write(run / "session.sqlite", damaged);
  attempt([&] {
    const session::Session session = session::Session::open(run);
    attempt([&] { session.observations(); });
    attempt([&] { session.attempts(); });
    attempt([&] { session::describeSession(session); });
  });
  attempt([&] { session::checkSession(run); });
  attempt([&] { session::repairSession(run); });
  return 0;
}
