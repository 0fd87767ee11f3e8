// SPDX-License-Identifier: GPL-3.0-or-later
#include "rtde_fields.h"

#include <cmath>

namespace servocal::robot::ur {
namespace {

Vector6d readVector6(ByteReader& reader) {
  Vector6d vector;
  for (double& value : vector) value = reader.f64();
  return vector;
}

struct Output {
  const char* name;
  const char* type;
  void (*read)(ByteReader&, ControllerState&);
};

const Output kOutputs[] = {
    {"timestamp", "DOUBLE", [](ByteReader& r, ControllerState& s) { s.timestamp_s = r.f64(); }},
    {"actual_q", "VECTOR6D", [](ByteReader& r, ControllerState& s) { s.actual_q = readVector6(r); }},
    {"actual_TCP_pose", "VECTOR6D",
     [](ByteReader& r, ControllerState& s) { s.actual_tcp_pose = readVector6(r); }},
    {"actual_TCP_speed", "VECTOR6D",
     [](ByteReader& r, ControllerState& s) { s.actual_tcp_speed = readVector6(r); }},
    {"tcp_offset", "VECTOR6D", [](ByteReader& r, ControllerState& s) { s.tcp_offset = readVector6(r); }},
    {"robot_mode", "INT32", [](ByteReader& r, ControllerState& s) { s.robot_mode = r.i32(); }},
    {"safety_mode", "INT32", [](ByteReader& r, ControllerState& s) { s.safety_mode = r.i32(); }},
    {"robot_status_bits", "UINT32", [](ByteReader& r, ControllerState& s) { s.robot_status_bits = r.u32(); }},
    {"runtime_state", "UINT32", [](ByteReader& r, ControllerState& s) { s.runtime_state = r.u32(); }},
    {"target_speed_fraction", "DOUBLE", [](ByteReader& r, ControllerState& s) { s.speed_slider = r.f64(); }},
    {"speed_scaling", "DOUBLE", [](ByteReader& r, ControllerState& s) { s.speed_scaling = r.f64(); }},
    {"payload", "DOUBLE", [](ByteReader& r, ControllerState& s) { s.payload_kg = r.f64(); }},
    {"output_int_register_24", "INT32", [](ByteReader& r, ControllerState& s) { s.script_state = r.i32(); }},
    {"output_int_register_25", "INT32", [](ByteReader& r, ControllerState& s) { s.script_epoch = r.i32(); }},
    {"output_int_register_26", "INT32", [](ByteReader& r, ControllerState& s) { s.script_token = r.i32(); }},
    {"output_int_register_27", "INT32", [](ByteReader& r, ControllerState& s) { s.script_beat = r.i32(); }},
};

constexpr int kFirstRegister = 24;

void checkType(const std::string& name, const std::string& type, const std::string& wanted) {
  if (type == wanted) return;
  if (type == "IN_USE") {
    throw Error(
        ErrorKind::kRefusedToMove,
        "Another program or a fieldbus already writes the controller's variable '" + name +
            "', so the arm would have two masters. Stop the other program (ROS driver, PLC, a second run of "
            "this one), then start again.");
  }
  if (type == "NOT_FOUND") {
    throw Error(
        ErrorKind::kRefusedToMove,
        "The controller does not know the variable '" + name +
            "'. Its software is too old: update PolyScope to 3.12.3 (CB3) or 5.6 (e-Series), or later.");
  }
  failProtocol("the variable '" + name + "' is of type " + type + ", not " + wanted);
}

}  // namespace

bool ControllerState::isFinite() const {
  return std::isfinite(timestamp_s) && actual_q.allFinite() && actual_tcp_pose.allFinite() &&
         actual_tcp_speed.allFinite() && tcp_offset.allFinite() && std::isfinite(speed_slider) &&
         std::isfinite(speed_scaling) && std::isfinite(payload_kg);
}

std::vector<std::string> outputNames() {
  std::vector<std::string> names;
  for (const Output& output : kOutputs) names.emplace_back(output.name);
  return names;
}

std::vector<std::string> inputNames() {
  std::vector<std::string> names;
  for (int i = 0; i < 3; ++i) names.push_back("input_int_register_" + std::to_string(kFirstRegister + i));
  for (int i = 0; i < 6; ++i) names.push_back("input_double_register_" + std::to_string(kFirstRegister + i));
  return names;
}

void checkOutputs(const RecipeReply& reply) {
  std::size_t i = 0;
  for (const Output& output : kOutputs) checkType(output.name, reply.types.at(i++), output.type);
  if (reply.id == 0) failProtocol("it refused the list of outputs without naming a variable");
}

void checkInputs(const RecipeReply& reply) {
  const std::vector<std::string> names = inputNames();
  for (std::size_t i = 0; i < names.size(); ++i) {
    checkType(names[i], reply.types.at(i), i < 3 ? "INT32" : "DOUBLE");
  }
  if (reply.id == 0) failProtocol("it refused the list of inputs without naming a variable");
}

ControllerState decodeState(const Package& package, int recipe_id) {
  ByteReader reader(package.payload, "a data package");
  const int id = reader.u8();
  if (id != recipe_id) {
    failProtocol("a data package of recipe " + std::to_string(id) + " came, only " +
                 std::to_string(recipe_id) + " was asked for");
  }
  ControllerState state;
  for (const Output& output : kOutputs) output.read(reader, state);
  reader.finish();
  if (!state.isFinite()) failProtocol("a data package holds a number that is not finite");
  return state;
}

Bytes encodeInput(const ScriptInput& input, int recipe_id) {
  ByteWriter writer;
  writer.u8(static_cast<std::uint8_t>(recipe_id));
  writer.i32(input.heartbeat).i32(static_cast<std::int32_t>(input.mode)).i32(input.epoch);
  for (const double value : input.velocity) writer.f64(value);
  return pack(PackageType::kData, writer.bytes());
}

}  // namespace servocal::robot::ur
