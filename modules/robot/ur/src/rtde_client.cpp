// SPDX-License-Identifier: GPL-3.0-or-later
#include "rtde_client.h"

#include <chrono>
#include <tuple>

namespace servocal::robot::ur {
namespace {

constexpr Duration kSendTimeout = std::chrono::milliseconds(20);
constexpr std::size_t kMostMessages = 100;  // A controller that chatters must not fill the memory.
// Right after its start the controller restarts its RTDE server once.
constexpr double kBootedAfterS = 40.0;

std::string joined(const std::vector<std::string>& names) {
  std::string list;
  for (const std::string& name : names) list += (list.empty() ? "" : ",") + name;
  return list;
}

// tcp_offset and the dashboard's serial number came with these.
bool isNewEnough(const ControllerVersion& version) {
  const auto number = std::make_tuple(version.major, version.minor, version.bugfix);
  return version.eSeries() ? number >= std::make_tuple(5u, 6u, 0u) : number >= std::make_tuple(3u, 12u, 3u);
}

}  // namespace

RtdeClient::RtdeClient(const std::string& host, int port, Duration reply_timeout)
    : socket_(host, port, "robot's RTDE server", reply_timeout), reply_timeout_(reply_timeout) {
  const auto accepts = [this](std::uint16_t protocol) {
    return decodeAccepted(ask(PackageType::kProtocolVersion, ByteWriter().u16(protocol).bytes()));
  };
  const bool speaks_2 = accepts(2);
  if (!speaks_2) accepts(1);  // Only to hear which version it is.
  version_ = decodeControllerVersion(ask(PackageType::kControllerVersion, {}));
  if (!speaks_2 || !isNewEnough(version_)) {
    throw Error(
        ErrorKind::kRefusedToMove,
        "The controller at " + host + " runs PolyScope " + version_.toString() +
            "; this program needs 3.12.3 (CB3) or 5.6 (e-Series) or later, to read the serial number and the "
            "TCP offset. Update the controller.");
  }
}

void RtdeClient::keep(const Package& package) {
  if (messages_.size() < kMostMessages) messages_.push_back(decodeTextMessage(package));
}

Package RtdeClient::reply(PackageType type) {
  // Its own clock, not the run's: this only bounds the wait for one reply.
  const auto give_up = std::chrono::steady_clock::now() + reply_timeout_;
  for (;;) {
    while (const std::optional<Package> package = reader_.next()) {
      if (package->type == type) return *package;
      if (package->type == PackageType::kTextMessage) {
        keep(*package);
      } else if (package->type == PackageType::kData && type == PackageType::kStart) {
        early_.push_back(decodeState(*package, output_recipe_));
      } else {
        failProtocol(std::string("a package of type '") + static_cast<char>(package->type) +
                     "' came where the reply of type '" + static_cast<char>(type) + "' was due");
      }
    }
    const Duration left = give_up - std::chrono::steady_clock::now();
    if (left <= Duration::zero()) failProtocol("no reply came in time");
    const Bytes bytes = socket_.receive(left);
    reader_.feed(bytes.data(), bytes.size());
  }
}

Package RtdeClient::ask(PackageType type, const Bytes& payload) {
  socket_.send(pack(type, payload), reply_timeout_);
  return reply(type);
}

void RtdeClient::start(double rate_hz) {
  rate_hz_ = rate_hz > 0.0 ? rate_hz : version_.eSeries() ? 500.0 : 125.0;
  const auto outputs = outputNames(), inputs = inputNames();
  const RecipeReply output =
      decodeRecipe(ask(PackageType::kSetupOutputs, ByteWriter().f64(rate_hz_).text(joined(outputs)).bytes()),
                   outputs.size());
  checkOutputs(output);
  output_recipe_ = output.id;
  const RecipeReply input =
      decodeRecipe(ask(PackageType::kSetupInputs, ByteWriter().text(joined(inputs)).bytes()), inputs.size());
  checkInputs(input);
  input_recipe_ = input.id;
  if (!decodeAccepted(ask(PackageType::kStart, {}))) {
    throw Error(
        ErrorKind::kHardwareAbsent,
        "The controller refused to start the exchange of data. Restart the controller, then start again.");
  }
  const auto give_up = std::chrono::steady_clock::now() + reply_timeout_;
  while (early_.empty()) {
    if (std::chrono::steady_clock::now() > give_up) failProtocol("no data came after the start");
    const Bytes bytes = socket_.receive(reply_timeout_ / 10);
    reader_.feed(bytes.data(), bytes.size());
    early_ = receive();
  }
  if (early_.back().timestamp_s < kBootedAfterS) {
    throw Error(ErrorKind::kHardwareAbsent,
                "The controller started " + std::to_string(static_cast<int>(early_.back().timestamp_s)) +
                    " s ago and may not be ready. Wait a minute, then start again.");
  }
}

std::vector<ControllerState> RtdeClient::receive() {
  std::vector<ControllerState> states = std::exchange(early_, {});
  const Bytes bytes = socket_.receive(Duration::zero());
  reader_.feed(bytes.data(), bytes.size());
  while (const std::optional<Package> package = reader_.next()) {
    if (package->type == PackageType::kData) {
      states.push_back(decodeState(*package, output_recipe_));
    } else if (package->type == PackageType::kTextMessage) {
      keep(*package);
    } else {
      failProtocol(std::string("a package of type '") + static_cast<char>(package->type) +
                   "' came that nobody asked for");
    }
  }
  return states;
}

void RtdeClient::send(const ScriptInput& input) {
  socket_.send(encodeInput(input, input_recipe_), kSendTimeout);
}

}  // namespace servocal::robot::ur
