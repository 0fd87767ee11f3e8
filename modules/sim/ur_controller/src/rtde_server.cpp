// SPDX-License-Identifier: GPL-3.0-or-later
#include "rtde_server.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include <sstream>

namespace servocal::sim {
namespace {

constexpr int kMergedPackages = 4;
constexpr double kLatenessS = 0.030;
constexpr double kJitterS = 0.040;
constexpr double kLoss = 0.1, kSentAgainAfterS = 0.2;
constexpr char kOutputRecipe = 1, kInputRecipe = 2;

std::string package(char type, const std::string& payload) {
  return bigEndian(payload.size() + 3, 2) + type + payload;
}

std::string text(const std::string& message) {
  const std::string source = "RTDE";
  return package('M', static_cast<char>(message.size()) + message + static_cast<char>(source.size()) +
                          source + static_cast<char>(3));
}

std::vector<std::string> split(const std::string& list) {
  std::vector<std::string> names;
  std::istringstream stream(list);
  for (std::string name; std::getline(stream, name, ',');) names.push_back(name);
  if (!list.empty() && list.back() == ',') names.emplace_back();
  return names;
}

std::string vector6(const Vector6d& vector) {
  std::string bytes;
  for (const double value : vector) bytes += bigEndian(value);
  return bytes;
}

Vector6d poseVector(const Eigen::Isometry3d& pose) {
  const Eigen::AngleAxisd turn(pose.linear());
  Vector6d vector;
  vector << pose.translation(), turn.angle() * turn.axis();
  return vector;
}

/// The number behind a register's name; nothing if it is another one.
std::optional<int> registerOf(const std::string& name, const std::string& kind) {
  if (name.compare(0, kind.size(), kind) != 0) return std::nullopt;
  const std::string digits = name.substr(kind.size());
  if (digits.empty() || digits.find_first_not_of("0123456789") != std::string::npos || digits.size() > 2)
    return std::nullopt;
  const int index = std::stoi(digits);
  return index < 48 ? std::optional<int>(index) : std::nullopt;
}

constexpr char kInputInteger[] = "input_int_register_";
constexpr char kInputFloat[] = "input_double_register_";
constexpr char kOutputInteger[] = "output_int_register_";

struct Output {
  const char* type;
  std::string bytes;
};

int robotMode(const ControllerState& s) { return s.has(UrFault::kPowerOff) ? 3 : 7; }
int safetyMode(const ControllerState& s) {
  if (s.has(UrFault::kProtectiveStop)) return 3;
  if (s.has(UrFault::kEmergencyStop)) return 7;
  return s.has(UrFault::kReducedMode) ? 2 : 1;
}
unsigned runtimeState(const ControllerState& s) { return !s.program ? 1 : s.paused() ? 4 : 2; }
unsigned statusBits(const ControllerState& s) {
  return (s.has(UrFault::kPowerOff) ? 0u : 1u) | (s.program ? 2u : 0u) |
         (s.has(UrFault::kTeachButton) ? 4u : 0u);
}

std::optional<Output> output(const std::string& name, const ControllerState& s) {
  if (name == "timestamp") return Output{"DOUBLE", bigEndian(s.has(UrFault::kJustBooted) ? 12.0 : s.time_s)};
  if (name == "actual_q") {
    Vector6d q = s.arm.q();
    if (s.has(UrFault::kNotFinite)) q[2] = std::numeric_limits<double>::quiet_NaN();
    return Output{"VECTOR6D", vector6(q)};
  }
  if (name == "actual_TCP_pose") return Output{"VECTOR6D", vector6(poseVector(s.arm.tcp()))};
  if (name == "actual_TCP_speed") return Output{"VECTOR6D", vector6(s.arm.tcpSpeed())};
  if (name == "tcp_offset") {
    if (s.has(UrFault::kMissingVariable)) return std::nullopt;
    Vector6d offset = poseVector(s.options.tcp_offset);
    if (s.has(UrFault::kTcpChanged)) offset[2] += 0.01;
    return Output{"VECTOR6D", vector6(offset)};
  }
  if (name == "robot_mode") return Output{"INT32", bigEndian(static_cast<std::uint32_t>(robotMode(s)), 4)};
  if (name == "safety_mode") return Output{"INT32", bigEndian(static_cast<std::uint32_t>(safetyMode(s)), 4)};
  if (name == "runtime_state") return Output{"UINT32", bigEndian(runtimeState(s), 4)};
  if (name == "robot_status_bits") return Output{"UINT32", bigEndian(statusBits(s), 4)};
  if (name == "target_speed_fraction" || name == "speed_scaling")
    return Output{"DOUBLE", bigEndian(s.slider())};
  if (name == "payload") return Output{"DOUBLE", bigEndian(s.has(UrFault::kPayloadChanged) ? 2.0 : 0.5)};
  if (const auto index = registerOf(name, kOutputInteger)) {
    const auto value = s.output_integers.find(*index);
    return Output{
        "INT32",
        bigEndian(static_cast<std::uint32_t>(value == s.output_integers.end() ? 0 : value->second), 4)};
  }
  return std::nullopt;
}

/// TCP keeps the order: not before those that wait already.
double inOrder(const std::deque<std::pair<double, std::string>>& waiting, double at_s) {
  return waiting.empty() ? at_s : std::max(at_s, waiting.back().first);
}

}  // namespace

std::vector<int> RtdeServer::descriptors() const {
  std::vector<int> all = {listener_.descriptor()};
  for (const auto& client : clients_) all.push_back(client->connection->descriptor());
  return all;
}

void RtdeServer::serve() {
  while (auto connection = listener_.accept()) {
    clients_.push_back(std::make_unique<Client>());
    clients_.back()->connection = std::move(connection);
  }
  for (const auto& client : clients_) {
    if (state_.has(UrFault::kClosesLink)) client->connection->close();
    client->connection->read();
    std::string& bytes = client->connection->received();
    while (bytes.size() >= 3) {
      const std::size_t size = fromBigEndian(bytes, 0, 2);
      if (size < 3) client->connection->close();
      if (size < 3 || bytes.size() < size) break;
      const std::string whole = bytes.substr(0, size);
      bytes.erase(0, size);
      handle(*client, whole[2], whole.substr(3));
    }
  }
  clients_.erase(std::remove_if(clients_.begin(), clients_.end(),
                                [](const auto& client) { return !client->connection->open(); }),
                 clients_.end());
}

double RtdeServer::lateness() {
  if (state_.has(UrFault::kLate)) return kLatenessS;
  if (state_.has(UrFault::kJitter)) return chance_.uniform(0.0, kJitterS);
  if (state_.has(UrFault::kLossy)) return chance_.uniform(0.0, 1.0) < kLoss ? kSentAgainAfterS : 0.0;
  return 0.0;
}

void RtdeServer::send(Client& client, const std::string& bytes) {
  if (state_.has(UrFault::kSilent)) return;
  const double late_s = lateness();
  if (late_s > 0.0 || !client.late.empty()) {
    client.late.emplace_back(inOrder(client.late, state_.time_s + late_s), bytes);
  } else if (state_.has(UrFault::kSplitPackages)) {
    for (const char byte : bytes) client.connection->write(std::string(1, byte));
  } else {
    client.connection->write(bytes);
  }
}

void RtdeServer::handle(Client& client, char type, const std::string& payload) {
  if (type == 'U') {
    const double late_s = state_.has(UrFault::kLossy) ? lateness() : 0.0;
    if (late_s == 0.0 && client.late_inputs.empty()) return takeInput(client, payload);
    client.late_inputs.emplace_back(inOrder(client.late_inputs, state_.time_s + late_s), payload);
    return;
  }
  if (state_.has(UrFault::kTextMidHandshake))
    send(client, text("RTDE control interface is busy with other things"));
  switch (type) {
    case 'V': {
      const bool accepted = !(state_.has(UrFault::kOldProtocol) && fromBigEndian(payload, 0, 2) > 1);
      return send(client, package('V', std::string(1, accepted ? 1 : 0)));
    }
    case 'v': {
      if (state_.has(UrFault::kForeignReply)) return send(client, package('P', std::string(1, 1)));
      const UrControllerOptions& o = state_.options;
      return send(client, package('v', bigEndian(o.major, 4) + bigEndian(o.minor, 4) +
                                           bigEndian(o.bugfix, 4) + bigEndian(0x1234u, 4)));
    }
    case 'O': return setupOutputs(client, payload);
    case 'I': return setupInputs(client, payload);
    case 'S': {
      const bool accepted = !state_.has(UrFault::kRefusesStart);
      client.started = accepted && !state_.has(UrFault::kUnansweredStart);
      client.next_due_s = state_.time_s;
      if (client.started && state_.has(UrFault::kDataBeforeStart)) {
        sendData(client);
        client.next_due_s += 1.0 / client.frequency_hz;
      }
      return send(client, package('S', std::string(1, accepted ? 1 : 0)));
    }
    case 'P': client.started = false; return send(client, package('P', std::string(1, 1)));
    default: return;  // As the controller: nothing.
  }
}

void RtdeServer::setupOutputs(Client& client, const std::string& payload) {
  client.frequency_hz = std::clamp(doubleFromBigEndian(payload, 0), 1.0, state_.eSeries() ? 500.0 : 125.0);
  client.outputs = split(payload.substr(8));
  std::string types;
  bool complete = true;
  for (const std::string& name : client.outputs) {
    const auto found = output(name, state_);
    complete = complete && found.has_value();
    types += (types.empty() ? "" : ",") + std::string(found ? found->type : "NOT_FOUND");
  }
  if (state_.has(UrFault::kTrailingComma)) types += ',';
  if (state_.has(UrFault::kEmptyType)) types.insert(types.find(','), ",");
  send(client, package('O', std::string(1, complete ? kOutputRecipe : 0) + types));
}

bool RtdeServer::owned(const std::string& name, const Client& asking) const {
  return std::any_of(clients_.begin(), clients_.end(), [&](const auto& client) {
    return client.get() != &asking &&
           std::find(client->inputs.begin(), client->inputs.end(), name) != client->inputs.end();
  });
}

void RtdeServer::setupInputs(Client& client, const std::string& payload) {
  const std::vector<std::string> names = split(payload);
  std::string types;
  bool complete = true;
  for (const std::string& name : names) {
    std::string type = registerOf(name, kInputInteger) ? "INT32"
                       : registerOf(name, kInputFloat) ? "DOUBLE"
                                                       : "";
    if (type.empty())
      type = "NOT_FOUND";
    else if (owned(name, client))
      type = "IN_USE";
    complete = complete && type != "NOT_FOUND" && type != "IN_USE";
    types += (types.empty() ? "" : ",") + type;
  }
  if (complete) client.inputs = names;
  if (state_.has(UrFault::kTrailingComma)) types += ',';
  send(client, package('I', std::string(1, complete ? kInputRecipe : 0) + types));
}

void RtdeServer::takeInput(Client& client, const std::string& payload) {
  if (state_.has(UrFault::kDeaf) || client.inputs.empty()) return;
  std::size_t size = 1;
  for (const std::string& name : client.inputs) size += registerOf(name, kInputInteger) ? 4 : 8;
  if (payload.size() != size || payload[0] != kInputRecipe) return client.connection->close();
  std::size_t at = 1;
  for (const std::string& name : client.inputs) {
    if (const auto index = registerOf(name, kInputInteger)) {
      state_.input_integers[*index] = static_cast<std::int32_t>(fromBigEndian(payload, at, 4));
      at += 4;
    } else {
      state_.input_floats[*registerOf(name, kInputFloat)] = doubleFromBigEndian(payload, at);
      at += 8;
    }
    state_.fresh_inputs.insert(name);
  }
  state_.last_input_s = state_.time_s;
  // What servocal's own program takes for a motion; only the truth told to tests rests on it.
  const int mode = state_.input_integers[25];
  if (mode == 1 || mode == 2) state_.last_moving_input_s = state_.time_s;
}

void RtdeServer::sendData(Client& client) {
  std::string payload(1, kOutputRecipe);
  for (const std::string& name : client.outputs) {
    if (const auto found = output(name, state_)) payload += found->bytes;
  }
  spoil(client, payload);
}

void RtdeServer::spoil(Client& client, const std::string& payload) {
  const std::string good = package('U', payload);
  if (state_.has(UrFault::kOversizePackage)) return send(client, package('U', payload + std::string(4, 0)));
  if (state_.has(UrFault::kOversizeHeader)) return send(client, std::string("\xff\xffU", 3) + payload);
  if (state_.has(UrFault::kZeroSize)) return send(client, std::string(3, 0) + payload);
  if (state_.has(UrFault::kUnknownType)) return send(client, package('X', payload));
  if (state_.has(UrFault::kForeignRecipe)) return send(client, package('U', '\x07' + payload.substr(1)));
  if (state_.has(UrFault::kGarbage)) {
    Random random(static_cast<std::uint64_t>(1000.0 * state_.time_s), "garbage");
    std::string noise;
    for (int i = 0; i < 200; ++i) noise += static_cast<char>(random.bits());
    return send(client, noise);
  }
  if (state_.has(UrFault::kMergedPackages)) {
    client.merged += good;
    if (++client.merged_count < kMergedPackages) return;
    client.merged_count = 0;
    return send(client, std::exchange(client.merged, ""));
  }
  if (state_.has(UrFault::kOutOfOrder)) {
    if (client.swapped.empty()) {
      client.swapped = good;
      return;
    }
    return send(client, good + std::exchange(client.swapped, ""));
  }
  send(client, good);
  if (state_.has(UrFault::kRepeatedPackages)) send(client, good);
}

void RtdeServer::publish() {
  for (const auto& client : clients_) {
    while (!client->late.empty() && client->late.front().first <= state_.time_s) {
      client->connection->write(client->late.front().second);
      client->late.pop_front();
    }
    while (!client->late_inputs.empty() && client->late_inputs.front().first <= state_.time_s) {
      takeInput(*client, client->late_inputs.front().second);
      client->late_inputs.pop_front();
    }
    if (!client->started || state_.time_s < client->next_due_s - 1e-6) continue;
    client->next_due_s += 1.0 / client->frequency_hz;
    sendData(*client);
  }
}

}  // namespace servocal::sim
