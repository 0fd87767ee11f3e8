// SPDX-License-Identifier: GPL-3.0-or-later
#include <gtest/gtest.h>

#include <Eigen/Geometry>
#include <cmath>

#include "errors.h"
#include "pose_source.h"
#include "rotation_format.h"
#include "temporary_folder.h"

namespace servocal::session {
namespace {

using test::expectPart;

Eigen::Matrix3d rx(double a) {
  return (Eigen::Matrix3d() << 1, 0, 0, 0, std::cos(a), -std::sin(a), 0, std::sin(a), std::cos(a)).finished();
}
Eigen::Matrix3d ry(double a) {
  return (Eigen::Matrix3d() << std::cos(a), 0, std::sin(a), 0, 1, 0, -std::sin(a), 0, std::cos(a)).finished();
}
Eigen::Matrix3d rz(double a) {
  return (Eigen::Matrix3d() << std::cos(a), -std::sin(a), 0, std::sin(a), std::cos(a), 0, 0, 0, 1).finished();
}

TEST(EulerAngles, OrdersAgreeWithWrittenOutProducts) {
  const Eigen::Vector3d a(0.3, -0.7, 1.9);
  const auto same = [](const Eigen::Matrix3d& x, const Eigen::Matrix3d& y) {
    return (x - y).cwiseAbs().maxCoeff() < 1e-15;
  };
  EXPECT_TRUE(same(fromEuler("extrinsic_xyz", a), rz(a[2]) * ry(a[1]) * rx(a[0])));
  EXPECT_TRUE(same(fromEuler("intrinsic_zyx", a), rz(a[2]) * ry(a[1]) * rx(a[0])));
  EXPECT_TRUE(same(fromEuler("intrinsic_xyz", a), rx(a[0]) * ry(a[1]) * rz(a[2])));
  EXPECT_TRUE(same(fromEuler("extrinsic_zyx", a), rx(a[0]) * ry(a[1]) * rz(a[2])));
  EXPECT_TRUE(same(fromEuler("intrinsic_zyz", a), rz(a[0]) * ry(a[1]) * rz(a[2])));
  EXPECT_TRUE(same(fromEuler("extrinsic_zxz", a), rz(a[2]) * rx(a[1]) * rz(a[0])));
  // Negative control: the comparison does tell two orders apart.
  EXPECT_FALSE(same(fromEuler("extrinsic_xyz", a), fromEuler("intrinsic_xyz", a)));
}

class PoseFormats : public ::testing::Test {
 protected:
  Pose<Base, EndEffector> read(const std::string& section, const std::string& file) const {
    folder_.write("1.txt", file);
    const ConfigReader reader = ConfigReader::fromText(section + "\n", "m.yaml");
    const PoseFormat format = readPoseFormat(reader);
    reader.finish();
    return readPoses(format, folder_.path(), {"1.png"}).at(0);
  }
  std::string refusal(const std::string& section, const std::string& file) const {
    return test::messageOf(ErrorKind::kBadData, [&] { read(section, file); });
  }
  void expectTruth(const Pose<Base, EndEffector>& bMe, double tolerance = 1e-12) const {
    EXPECT_LT(distanceM(bMe, truth_), tolerance);
    EXPECT_LT(angleRad(bMe, truth_), tolerance);
  }

  test::TemporaryFolder folder_;
  const Pose<Base, EndEffector> truth_{rz(1.9) * ry(-0.7) * rx(0.3), Eigen::Vector3d(0.4, -0.5, 0.6)};
};

std::string list(const Eigen::MatrixXd& matrix, const char* open, const char* close) {
  std::ostringstream text;
  text.precision(17);
  for (int row = 0; row < matrix.rows(); ++row) {
    text << (row == 0 ? "" : ",\n ") << open;
    for (int column = 0; column < matrix.cols(); ++column)
      text << (column == 0 ? "" : ", ") << matrix(row, column);
    text << close;
  }
  return text.str();
}

TEST_F(PoseFormats, Matrices) {
  const Eigen::Matrix4d matrix = truth_.isometry().matrix();
  const std::string bare = list(matrix, "", "");
  const std::string common = "pose: bMe\nformat: matrix\nlength_unit: m\nfiles: \"{stem}.txt\"\n";
  expectTruth(
      read(common + "key: end2base", "{\"end2base\": [" + list(matrix, "[", "]") + "], \"other\": 1}"));
  expectTruth(read(common + "key: end2base", "end2base: [" + bare + "]"));
  expectTruth(read(common + "key: a.T", "a:\n  T: {rows: 4, cols: 4, data: [" + bare + "]}"));
  expectTruth(read(common, "# comment\n" + bare));
  const Eigen::Matrix4d inverse = truth_.inverse().isometry().matrix();
  expectTruth(
      read("pose: eMb\nformat: matrix\nlength_unit: m\nfiles: \"{stem}.txt\"\n", list(inverse, "", "")));
  Eigen::Matrix4d millimetres = matrix;
  millimetres.topRightCorner<3, 1>() *= 1000;
  expectTruth(
      read("pose: bMe\nformat: matrix\nlength_unit: mm\nfiles: \"{stem}.txt\"\n", list(millimetres, "", "")));
}

TEST_F(PoseFormats, MatricesThatAreNoPoses) {
  const std::string section = "pose: bMe\nformat: matrix\nlength_unit: m\nfiles: \"{stem}.txt\"\nkey: T";
  Eigen::Matrix4d matrix = truth_.isometry().matrix();
  matrix(0, 0) += 0.01;
  expectPart(refusal(section, "T: [" + list(matrix, "", "") + "]"), "the matrix is no rotation");
  matrix = truth_.isometry().matrix();
  matrix.col(0) *= -1;
  expectPart(refusal(section, "T: [" + list(matrix, "", "") + "]"), "mirrors");
  expectPart(refusal(section, "T: [" + list(truth_.isometry().matrix().transpose(), "", "") + "]"),
             "last row");
  expectPart(refusal(section, "T: [[NaN, 0, 0, 0], [0, 1, 0, 0], [0, 0, 1, 0], [0, 0, 0, 1]]"),
             "1.txt:1: 'T' must be finite, not 'NaN'");
  expectPart(refusal(section, "T: [1, 2, 3]"), "must be a matrix of 4 rows of 4 numbers, not a list of 3");
  expectPart(refusal(section, "U: 1"), "missing key 'T'");
  expectPart(refusal("pose: bMe\nformat: matrix\nlength_unit: m\nfiles: \"{stem}.txt\"", "1 2 3"),
             "1.txt': a 4x4 matrix has 16 numbers (or 12), not 3");
}

TEST_F(PoseFormats, QuaternionsAreXyzw) {
  const Eigen::Quaterniond q = truth_.quaternion();
  const std::string section =
      "pose: bMe\nformat: quaternion\nlength_unit: m\nfiles: \"{stem}.txt\"\nkeys: [t.x, t.y, t.z, r.x, r.y, "
      "r.z, r.w]";
  std::ostringstream file;
  file.precision(17);
  file << "t: {x: 0.4, y: -0.5, z: 0.6}\nr: {w: " << q.w() << ", x: " << q.x() << ", y: " << q.y()
       << ", z: " << q.z() << "}\n";
  expectTruth(read(section, file.str()));
  expectPart(refusal("pose: bMe\nformat: quaternion\nlength_unit: m\nfiles: \"{stem}.txt\"",
                     "{x: 0, y: 0, z: 0, qx: 1, qy: 1, qz: 0, qw: 0}"),
             "the quaternion has length 1.41421, not 1");
}

TEST_F(PoseFormats, EulerAnglesAndRotationVectorsNameTheirUnits) {
  const std::string euler = "pose: bMe\nformat: euler\nlength_unit: m\nfiles: \"{stem}.txt\"\n";
  expectTruth(read(euler + "euler_order: extrinsic_xyz\nangle_unit: rad",
                   "{x: 0.4, y: -0.5, z: 0.6, rx: 0.3, ry: -0.7, rz: 1.9}"));
  const auto deg = [](double rad) { return std::to_string(rad * 180 / M_PI); };
  expectTruth(
      read("pose: bMe\nformat: euler\nlength_unit: mm\nfiles: \"{stem}.txt\"\neuler_order: "
           "intrinsic_zyx\nangle_unit: deg",
           "{x: 400, y: -500, z: 600, rx: " + deg(0.3) + ", ry: " + deg(-0.7) + ", rz: " + deg(1.9) + "}"),
      1e-7);
  const Eigen::Vector3d vector = truth_.rotationVector();
  std::ostringstream file;
  file.precision(17);
  file << "{x: 0.4, y: -0.5, z: 0.6, rx: " << vector.x() << ", ry: " << vector.y() << ", rz: " << vector.z()
       << "}";
  expectTruth(
      read("pose: bMe\nformat: rotation_vector\nlength_unit: m\nangle_unit: rad\nfiles: \"{stem}.txt\"",
           file.str()));
}

TEST_F(PoseFormats, UnitsThatTheDataBetray) {
  const std::string euler = "pose: bMe\nformat: euler\neuler_order: extrinsic_xyz\nfiles: \"{stem}.txt\"\n";
  expectPart(
      refusal(euler + "length_unit: m\nangle_unit: rad", "{x: 0.4, y: 0, z: 0, rx: -91, ry: 44, rz: 11}"),
      "the poses look like degrees (angle_unit: deg)");
  expectPart(
      refusal(euler + "length_unit: m\nangle_unit: deg", "{x: 400, y: 0, z: 0, rx: -91, ry: 44, rz: 11}"),
      "the poses look like millimetres (length_unit: mm)");
  expectPart(
      refusal(euler + "length_unit: mm\nangle_unit: deg", "{x: 0.4, y: 0, z: 0, rx: -91, ry: 44, rz: 11}"),
      "they look like metres (length_unit: m)");
}

TEST_F(PoseFormats, VispYaml) {
  const Eigen::Vector3d u = truth_.rotationVector();
  std::ostringstream vector;
  vector.precision(17);
  vector << "# pose of image 1\nrows: 6\ncols: 1\ndata: \n  - [0.4]\n  - [-0.5]\n  - [0.6]\n  - [" << u.x()
         << "]\n  - [" << u.y() << "]\n  - [" << u.z() << "]\n";
  const std::string section = "pose: bMe\nformat: visp\nfiles: \"{stem}.txt\"";
  expectTruth(read(section, vector.str()));
  expectTruth(read(section, "a free text: header\n" + vector.str()));
  std::string matrix = "rows: 4\ncols: 4\ndata:\n";
  std::istringstream rows(list(truth_.isometry().matrix(), "  - [", "]"));
  for (std::string line; std::getline(rows, line);) matrix += line + "\n";
  expectTruth(read(section, matrix));
  expectPart(refusal(section, "rows: 6\ncols: 1\ndata:\n  - [1]\n"), "found rows 6, cols 1 and 1 numbers");
}

class PoseTable : public ::testing::Test {
 protected:
  std::vector<Pose<Base, EndEffector>> read(const std::string& columns, const std::string& table,
                                            const std::vector<std::string>& names) const {
    folder_.write("poses.txt", table);
    const ConfigReader reader = ConfigReader::fromText(
        "pose: bMe\nformat: rotation_vector\nlength_unit: m\nangle_unit: rad\ntable: poses.txt\ncolumns: " +
            columns + "\n",
        "m.yaml");
    const PoseFormat format = readPoseFormat(reader);
    return readPoses(format, folder_.path(), names);
  }
  std::string refusal(const std::string& columns, const std::string& table,
                      const std::vector<std::string>& names) const {
    return test::messageOf(ErrorKind::kBadData, [&] { read(columns, table, names); });
  }
  test::TemporaryFolder folder_;
  const std::string plain_ = "[x, y, z, rx, ry, rz]";
  const std::string named_ = "[image, x, y, z, rx, ry, rz]";
};

TEST_F(PoseTable, RowsInOrderOrByName) {
  const auto ordered = read(plain_, "# mm\n1 0 0 0 0 0\n\n2;0;0;0;0;0\n", {"a.png", "b.png"});
  EXPECT_EQ(ordered[1].translation().x(), 2.0);
  const auto named =
      read(named_, "b.png, 2,0,0,0,0,0\na, 1,0,0,0,0,0\nunused, 9,0,0,0,0,0\n", {"img/a.png", "img/b.png"});
  EXPECT_EQ(named[0].translation().x(), 1.0);
  EXPECT_EQ(named[1].translation().x(), 2.0);
}

TEST_F(PoseTable, EveryMismatchIsNamed) {
  expectPart(refusal(plain_, "1 0 0 0 0 0\n", {"a.png", "b.png"}), "it has 1 poses for 2 images");
  expectPart(refusal(plain_, "1 0 0 0 0 0\n2 0 0 0 0\n", {"a", "b"}),
             "poses.txt', line 2: has 5 columns, not 6");
  expectPart(refusal(plain_, "1 0 0 0 0 0\n2 0 0 0 0 0 0\n", {"a", "b"}), "line 2: has 7 columns, not 6");
  expectPart(refusal(plain_, "1 0 0 nan 0 0\n", {"a"}), "line 1: the robot pose holds nan, not a number");
  expectPart(refusal(plain_, "1 0 0 x 0 0\n", {"a"}), "line 1: 'x' is not a number");
  expectPart(refusal(named_, "a.png 1 0 0 0 0 0\n", {"a.png", "b.png"}), "it has no row for image 'b.png'");
  expectPart(refusal(named_, "a 1 0 0 0 0 0\na 1 0 0 0 0 0\n", {"a.png"}), "it has 2 rows for image 'a.png'");
}

TEST(PoseSection, MistakesAreConfigurationErrors) {
  const auto refusal = [](const std::string& text) {
    return test::messageOf(ErrorKind::kInvalidConfig, [&] {
      const ConfigReader reader = ConfigReader::fromText(text, "m.yaml");
      readPoseFormat(reader);
      reader.finish();
    });
  };
  EXPECT_EQ(refusal("pose: bMc\n"), "m.yaml:1: 'pose' is 'bMc', allowed: bMe, eMb");
  expectPart(refusal("pose: bMe\nformat: euler\neuler_order: xyz\n"),
             "m.yaml:3: 'euler_order' is 'xyz', allowed: extrinsic_xyz");
  expectPart(refusal("pose: bMe\nformat: matrix\n"), "missing key 'length_unit'");
  expectPart(refusal("pose: bMe\nformat: rotation_vector\nlength_unit: m\n"), "missing key 'angle_unit'");
  expectPart(refusal("pose: bMe\nformat: matrix\nlength_unit: m\n"), "say either 'files'");
  expectPart(refusal("pose: bMe\nformat: matrix\nlength_unit: m\nfiles: pose.txt\n"),
             "m.yaml:4: 'files' must hold {stem}");
  expectPart(
      refusal("pose: bMe\nformat: quaternion\nlength_unit: m\ntable: t\ncolumns: [x, y, z, qx, qy, qz]\n"),
      "m.yaml:5: 'columns' must name 'qw' exactly once");
  expectPart(
      refusal(
          "pose: bMe\nformat: quaternion\nlength_unit: m\ntable: t\ncolumns: [x, y, z, qx, qy, qz, qw, q]\n"),
      "unknown column 'q'; this format has: image, skip, x, y, z, qx, qy, qz, qw");
}

}  // namespace
}  // namespace servocal::session
