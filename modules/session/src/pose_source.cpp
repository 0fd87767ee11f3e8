// SPDX-License-Identifier: GPL-3.0-or-later
#include "pose_source.h"

#include <algorithm>
#include <charconv>
#include <cmath>
#include <fstream>
#include <map>
#include <sstream>

#include "rotation_format.h"
#include "servocal/core/error.h"

namespace servocal::session {
namespace {

namespace fs = std::filesystem;
using Rotation = PoseFormat::Rotation;
using BasePose = Pose<Base, EndEffector>;

constexpr double kPi = 3.14159265358979323846;
constexpr double kRotationTolerance = 2e-3;  ///< Three printed decimals of a rotation matrix pass.

[[noreturn]] void refuse(const std::string& where, const std::string& cause) {
  throw Error(ErrorKind::kBadData, where + ": " + cause);
}

std::string nameOf(double value) {
  std::ostringstream text;
  text << value;
  return text.str();
}

/// Components of a pose that is not a matrix, in the order of the values below.
std::vector<std::string> componentNames(const PoseFormat& format) {
  std::vector<std::string> names = {"x", "y", "z"};
  std::vector<std::string> rotation = {"rx", "ry", "rz"};
  if (format.rotation == Rotation::kQuaternion) rotation = {"qx", "qy", "qz", "qw"};
  if (format.rotation == Rotation::kEuler) rotation = eulerAngleNames(format.euler_order);
  names.insert(names.end(), rotation.begin(), rotation.end());
  return names;
}

/// The pose as it stands in the file, in metres: numbers of a 4x4 or 3x4 matrix row by row, or the
/// components in the order of componentNames.
Eigen::Isometry3d toTransform(const PoseFormat& format, const std::vector<double>& values,
                              const std::string& where) {
  for (const double value : values) {
    if (!std::isfinite(value)) refuse(where, "the robot pose holds " + nameOf(value) + ", not a number");
  }
  Eigen::Isometry3d pose = Eigen::Isometry3d::Identity();
  if (format.rotation == Rotation::kMatrix) {
    for (int row = 0; row < 3; ++row) {
      for (int column = 0; column < 4; ++column) {
        pose.matrix()(row, column) = values[static_cast<std::size_t>(4 * row + column)];
      }
    }
    if (values.size() == 16 &&
        (values[12] != 0.0 || values[13] != 0.0 || values[14] != 0.0 || values[15] != 1.0)) {
      refuse(where, "the last row of the 4x4 matrix is not 0 0 0 1");
    }
    const double distance = distanceFromRotation(pose.linear());
    if (distance > kRotationTolerance) {
      refuse(where, distance >= 2.0
                        ? "the matrix mirrors; it is no rotation"
                        : "the matrix is no rotation: its columns are not of unit length and square "
                          "to each other (off by " +
                              nameOf(distance) + ")");
    }
    pose.linear() = nearestRotation(pose.linear());
  } else {
    pose.translation() << values[0], values[1], values[2];
    if (format.rotation == Rotation::kQuaternion) {
      const Eigen::Quaterniond q(values[6], values[3], values[4], values[5]);
      if (std::abs(q.norm() - 1.0) > kRotationTolerance) {
        refuse(where, "the quaternion has length " + nameOf(q.norm()) + ", not 1; is the order x y z w?");
      }
      pose.linear() = q.normalized().toRotationMatrix();
    } else {
      Eigen::Vector3d angles(values[3], values[4], values[5]);
      if (!format.degrees && angles.cwiseAbs().maxCoeff() > 2.0 * kPi + 0.01) {
        refuse(where,
               "an angle of " + nameOf(angles.cwiseAbs().maxCoeff()) +
                   " is more than a full turn in radians; the poses look like degrees (angle_unit: deg)");
      }
      if (format.degrees) angles *= kPi / 180.0;
      pose.linear() = format.rotation == Rotation::kEuler
                          ? fromEuler(format.euler_order, angles)
                          : BasePose::fromRotationVector(angles, Eigen::Vector3d::Zero()).rotation();
    }
  }
  if (format.millimetres) pose.translation() *= 0.001;
  if (pose.translation().norm() > 20.0) {
    refuse(where, "the arm would be " + nameOf(pose.translation().norm()) +
                      " m from its base; the poses look like millimetres (length_unit: mm)");
  }
  return pose;
}

double toNumber(const std::string& token, const std::string& where) {
  double value = 0.0;
  const char* begin = token.data() + (token[0] == '+' ? 1 : 0);
  const char* end = token.data() + token.size();
  const auto [stop, error] = std::from_chars(begin, end, value);
  if (error != std::errc() || stop != end) refuse(where, "'" + token + "' is not a number");
  return value;
}

std::vector<std::string> tokensOf(std::string line) {
  line = line.substr(0, line.find('#'));
  for (char& c : line) {
    if (c == ',' || c == ';' || c == '[' || c == ']') c = ' ';
  }
  std::istringstream stream(line);
  std::vector<std::string> tokens;
  for (std::string token; stream >> token;) tokens.push_back(token);
  return tokens;
}

std::ifstream openText(const fs::path& file, const std::string& where) {
  std::error_code ignored;
  if (!fs::is_regular_file(file, ignored)) refuse(where, "there is no such file");
  std::ifstream in(file);
  if (!in) refuse(where, "it cannot be opened");
  return in;
}

/// All numbers of a text file, comments aside.
std::vector<double> bareNumbers(std::istream& in, const std::string& where) {
  std::vector<double> values;
  for (std::string line; std::getline(in, line);) {
    for (const std::string& token : tokensOf(line)) values.push_back(toNumber(token, where));
  }
  return values;
}

/// ViSP's saveYAML of a pose vector (6 x 1: m, theta-u in rad) or a matrix (4 x 4). Its free-text header
/// is no YAML, so lines before `rows:` are passed over.
Eigen::Isometry3d readVisp(const fs::path& file, const std::string& where) {
  std::ifstream in = openText(file, where);
  int rows = 0, cols = 0;
  std::string line, data;
  const auto valueOf = [](const std::string& text) { return std::atoi(text.c_str() + text.find(':') + 1); };
  while (std::getline(in, line) && line.rfind("data:", 0) != 0) {
    if (line.rfind("rows:", 0) == 0) rows = valueOf(line);
    if (line.rfind("cols:", 0) == 0) cols = valueOf(line);
  }
  while (std::getline(in, line)) {
    const std::size_t bracket = line.find('[');
    if (bracket != std::string::npos) data += line.substr(bracket) + "\n";
  }
  std::istringstream stream(data);
  const std::vector<double> values = bareNumbers(stream, where);
  const bool vector = rows == 6 && cols == 1, matrix = rows == 4 && cols == 4;
  if ((!vector && !matrix) || values.size() != static_cast<std::size_t>(rows * cols)) {
    refuse(where, "not a ViSP pose: wanted 6 x 1 or 4 x 4, found rows " + std::to_string(rows) + ", cols " +
                      std::to_string(cols) + " and " + std::to_string(values.size()) + " numbers");
  }
  PoseFormat format;
  format.rotation = vector ? Rotation::kRotationVector : Rotation::kMatrix;
  return toTransform(format, values, where);
}

/// The mapping that holds the last part of a dotted key, and that part.
std::pair<ConfigReader, std::string> descend(ConfigReader reader, std::string key) {
  for (std::size_t dot = key.find('.'); dot != std::string::npos; dot = key.find('.')) {
    reader = reader.section(key.substr(0, dot));
    key = key.substr(dot + 1);
  }
  return {std::move(reader), key};
}

Eigen::Isometry3d readKeyed(const PoseFormat& format, const fs::path& file, const std::string& where) {
  std::vector<double> values;
  try {
    if (format.rotation == Rotation::kMatrix) {
      const auto [reader, key] = descend(ConfigReader::fromFile(file), format.key);
      const Eigen::MatrixXd matrix = reader.matrix(key, 4, 4, {});
      for (int i = 0; i < 16; ++i) values.push_back(matrix(i / 4, i % 4));
    } else {
      for (const std::string& dotted : format.keys) {
        const auto [reader, key] = descend(ConfigReader::fromFile(file), dotted);
        values.push_back(reader.number(key, {}));
      }
    }
  } catch (const Error& error) {
    // Here the file is data, not configuration.
    throw Error(ErrorKind::kBadData, error.what());
  }
  return toTransform(format, values, where);
}

Eigen::Isometry3d readFile(const PoseFormat& format, const fs::path& file) {
  const std::string where = "pose file '" + file.string() + "'";
  if (format.rotation == Rotation::kVisp) return readVisp(file, where);
  if (format.rotation == Rotation::kMatrix && format.key.empty()) {
    std::ifstream in = openText(file, where);
    const std::vector<double> values = bareNumbers(in, where);
    if (values.size() != 12 && values.size() != 16) {
      refuse(where, "a 4x4 matrix has 16 numbers (or 12), not " + std::to_string(values.size()));
    }
    return toTransform(format, values, where);
  }
  openText(file, where);
  return readKeyed(format, file, where);
}

std::string replaced(std::string text, const std::string& from, const std::string& to) {
  for (std::size_t at = text.find(from); at != std::string::npos; at = text.find(from, at + to.size())) {
    text.replace(at, from.size(), to);
  }
  return text;
}

std::vector<Eigen::Isometry3d> readFiles(const PoseFormat& format, const fs::path& folder,
                                         const std::vector<std::string>& names) {
  std::vector<Eigen::Isometry3d> poses;
  for (const std::string& name : names) {
    const fs::path image = name;
    const std::string stem = (image.parent_path() / image.stem()).string();
    // {stem} is the bare file name; {path} keeps the image's folder.
    const std::string file =
        replaced(replaced(format.files, "{stem}", image.stem().string()), "{path}", stem);
    std::error_code ignored;
    if (!fs::exists(folder / file, ignored)) {
      refuse("image '" + name + "' has no robot pose", "'" + (folder / file).string() + "' is not there");
    }
    poses.push_back(readFile(format, folder / file));
  }
  return poses;
}

struct TableRow {
  std::string image;  ///< Empty if the table does not name images.
  Eigen::Isometry3d pose;
};

TableRow readRow(const PoseFormat& format, const std::vector<std::string>& tokens, const std::string& where) {
  TableRow row;
  std::map<std::string, double> named;
  std::vector<double> values;
  for (std::size_t i = 0; i < format.columns.size(); ++i) {
    const std::string& column = format.columns[i];
    if (column == "matrix") {
      for (std::size_t k = i; k < tokens.size(); ++k) values.push_back(toNumber(tokens[k], where));
      if (values.size() != 12 && values.size() != 16) {
        refuse(where, "a matrix has 16 numbers (or 12), not " + std::to_string(values.size()));
      }
    } else if (i >= tokens.size()) {
      refuse(where, "has " + std::to_string(tokens.size()) + " columns, not " +
                        std::to_string(format.columns.size()));
    } else if (column == "image") {
      row.image = tokens[i];
    } else if (column != "skip") {
      named[column] = toNumber(tokens[i], where);
    }
  }
  if (format.columns.back() != "matrix" && tokens.size() != format.columns.size()) {
    refuse(where,
           "has " + std::to_string(tokens.size()) + " columns, not " + std::to_string(format.columns.size()));
  }
  if (format.rotation != Rotation::kMatrix) {
    for (const std::string& name : componentNames(format)) values.push_back(named.at(name));
  }
  row.pose = toTransform(format, values, where);
  return row;
}

std::vector<Eigen::Isometry3d> readTable(const PoseFormat& format, const fs::path& folder,
                                         const std::vector<std::string>& names) {
  const fs::path file = folder / format.table;
  const std::string in_table = "pose table '" + file.string() + "'";
  std::ifstream in = openText(file, in_table);
  std::vector<TableRow> rows;
  int line_number = 0;
  for (std::string line; std::getline(in, line);) {
    if (++line_number <= format.skip_lines) continue;
    const std::vector<std::string> tokens = tokensOf(line);
    if (!tokens.empty()) {
      rows.push_back(readRow(format, tokens, in_table + ", line " + std::to_string(line_number)));
    }
  }
  std::vector<Eigen::Isometry3d> poses;
  if (std::find(format.columns.begin(), format.columns.end(), "image") == format.columns.end()) {
    if (rows.size() != names.size()) {
      refuse(in_table, "it has " + std::to_string(rows.size()) + " poses for " +
                           std::to_string(names.size()) +
                           " images; without a column 'image' each image needs its own row");
    }
    for (const TableRow& row : rows) poses.push_back(row.pose);
    return poses;
  }
  for (const std::string& name : names) {
    const fs::path image = name;
    const auto names_it = [&](const TableRow& row) {
      return row.image == name || row.image == image.filename() || row.image == image.stem();
    };
    const auto count = std::count_if(rows.begin(), rows.end(), names_it);
    if (count == 0) refuse(in_table, "it has no row for image '" + name + "'");
    if (count > 1) refuse(in_table, "it has " + std::to_string(count) + " rows for image '" + name + "'");
    poses.push_back(std::find_if(rows.begin(), rows.end(), names_it)->pose);
  }
  return poses;
}

/// Units that only all poses together betray: nobody's flange stays within millimetres of the base.
void checkUnits(const PoseFormat& format, const std::vector<Eigen::Isometry3d>& poses) {
  const auto within = [](double limit_m) {
    return [=](const Eigen::Isometry3d& pose) { return pose.translation().norm() < limit_m; };
  };
  if (format.millimetres && !poses.empty() && std::all_of(poses.begin(), poses.end(), within(0.005))) {
    refuse("robot poses", "all are within 5 mm of the base; they look like metres (length_unit: m)");
  }
}

void checkColumns(const ConfigReader& section, const PoseFormat& format) {
  std::vector<std::string> allowed = componentNames(format);
  if (format.rotation == Rotation::kMatrix) allowed = {"matrix"};
  for (const std::string& name : allowed) {
    if (std::count(format.columns.begin(), format.columns.end(), name) != 1) {
      section.fail("columns", "'columns' must name '" + name + "' exactly once");
    }
  }
  for (const std::string& column : format.columns) {
    const bool known = column == "image" || column == "skip" ||
                       std::find(allowed.begin(), allowed.end(), column) != allowed.end();
    if (!known) {
      std::string list = "image, skip";
      for (const std::string& name : allowed) list += ", " + name;
      section.fail("columns", "unknown column '" + column + "'; this format has: " + list);
    }
  }
  if (format.rotation == Rotation::kMatrix && format.columns.back() != "matrix") {
    section.fail("columns", "'matrix' must be the last column; it takes the rest of the row");
  }
}

}  // namespace

PoseFormat readPoseFormat(const ConfigReader& section) {
  PoseFormat format;
  format.end_effector_in_base = section.choice("pose", {"bMe", "eMb"}) == 0;
  format.rotation = static_cast<Rotation>(
      section.choice("format", {"matrix", "quaternion", "rotation_vector", "euler", "visp"}));
  if (format.rotation == Rotation::kEuler) {
    format.euler_order = eulerOrders()[section.choice("euler_order", eulerOrders())];
  }
  if (format.rotation != Rotation::kVisp)
    format.millimetres = section.choice("length_unit", {"m", "mm"}) == 1;
  if (format.rotation == Rotation::kEuler || format.rotation == Rotation::kRotationVector) {
    format.degrees = section.choice("angle_unit", {"rad", "deg"}) == 1;
  }
  if (section.has("files") == section.has("table")) {
    section.fail("files", "say either 'files' (one pose file per image) or 'table' (one file for all)");
  }
  if (section.has("files")) {
    format.files = section.text("files");
    if (format.files.find("{stem}") == std::string::npos &&
        format.files.find("{path}") == std::string::npos) {
      section.fail("files", "'files' must hold {stem}, the image's name without its ending");
    }
    if (format.rotation == Rotation::kMatrix) format.key = section.text("key", "");
    if (format.rotation != Rotation::kMatrix && format.rotation != Rotation::kVisp) {
      const std::vector<std::string> names = componentNames(format);
      format.keys = section.has("keys") ? section.texts("keys") : names;
      if (format.keys.size() != names.size()) {
        std::string list;
        for (const std::string& name : names) list += " " + name;
        section.fail("keys", "'keys' must say where these stand in a pose file, in this order:" + list);
      }
    }
  } else {
    if (format.rotation == Rotation::kVisp)
      section.fail("table", "ViSP poses come one file per image ('files')");
    format.table = section.text("table");
    format.columns = section.texts("columns");
    format.skip_lines = section.integer("skip_lines", {0, 1000}, 0);
    checkColumns(section, format);
  }
  return format;
}

std::vector<BasePose> readPoses(const PoseFormat& format, const fs::path& folder,
                                const std::vector<std::string>& names) {
  const std::vector<Eigen::Isometry3d> read =
      format.table.empty() ? readFiles(format, folder, names) : readTable(format, folder, names);
  checkUnits(format, read);
  std::vector<BasePose> poses;
  for (const Eigen::Isometry3d& pose : read) {
    poses.emplace_back(format.end_effector_in_base ? pose : pose.inverse());
  }
  return poses;
}

std::vector<PoseReading> otherReadings(const PoseFormat& format, const fs::path& folder,
                                       const std::vector<std::string>& names) {
  std::vector<std::pair<std::string, PoseFormat>> others;
  const bool euler = format.rotation == Rotation::kEuler;
  const bool vector = format.rotation == Rotation::kRotationVector;
  if (euler || vector) {
    PoseFormat other = format;
    other.degrees = !format.degrees;
    others.emplace_back(std::string("the angles are in ") +
                            (other.degrees ? "degrees (angle_unit: deg)" : "radians (angle_unit: rad)"),
                        other);
    const std::vector<std::string> components = componentNames(format);
    for (const std::string& order : eulerOrders()) {
      other = format;
      other.rotation = Rotation::kEuler;
      other.euler_order = order;
      if ((euler && order == format.euler_order) || componentNames(other) != components) continue;
      others.emplace_back("the angles are Euler angles (euler_order: " + order + ")", other);
    }
  }
  if (euler) {
    PoseFormat other = format;
    other.rotation = Rotation::kRotationVector;
    if (componentNames(other) == componentNames(format)) {
      others.emplace_back("the angles are a rotation vector (format: rotation_vector)", other);
    }
  }
  std::vector<PoseReading> readings;
  for (const auto& [what, other] : others) {
    try {
      readings.push_back({what, readPoses(other, folder, names)});
    } catch (const Error&) {
      // Not a way to read these files.
    }
  }
  if (format.rotation == Rotation::kQuaternion) {
    PoseReading reading{"the quaternions are in the order w x y z", readPoses(format, folder, names)};
    for (BasePose& bMe : reading.bMe) {
      const BasePose stored = format.end_effector_in_base ? bMe : relabel<Base, EndEffector>(bMe.inverse());
      const Eigen::Quaterniond q = stored.quaternion();
      const auto pose =
          BasePose::fromQuaternion(Eigen::Quaterniond(q.x(), q.y(), q.z(), q.w()), stored.translation());
      bMe = format.end_effector_in_base ? pose : relabel<Base, EndEffector>(pose.inverse());
    }
    readings.push_back(std::move(reading));
  }
  return readings;
}

}  // namespace servocal::session
