// SPDX-License-Identifier: GPL-3.0-or-later
// The exports read back by the programs they are for: 1,000 points, projected by the reader's own model from
// what the reader read, must fall on our pixels.
#include <gtest/gtest.h>
#include <urdf_parser/urdf_parser.h>
#include <visp3/core/vpMeterPixelConversion.h>
#include <visp3/core/vpPixelMeterConversion.h>
#include <visp3/core/vpPoseVector.h>
#include <visp3/core/vpXmlParserCamera.h>
#include <yaml-cpp/yaml.h>

#include <fstream>
#include <functional>
#include <opencv2/calib3d.hpp>
#include <opencv2/core.hpp>
#include <random>
#include <sstream>
#ifdef SERVOCAL_HAS_MRCAL
extern "C" {
#include <mrcal/mrcal.h>
}
#endif
#ifdef SERVOCAL_HAS_ROS_PARSERS
#include <camera_calibration_parsers/parse.h>
#endif

#include "errors.h"
#include "random_result.h"
#include "servocal/report/export.h"
#include "temporary_folder.h"

namespace servocal::report {
namespace {

constexpr double kExactPx = 1e-6;

/// Where the reader's own model puts a point of the camera frame, px.
using Reader = std::function<Eigen::Vector2d(const Eigen::Vector3d&)>;

/// 1,000 points in front of the camera, all over its image, 0.3 to 3 m away.
std::vector<Eigen::Vector3d> pointsOf(const CameraModel& camera) {
  std::mt19937_64 random(17);
  std::uniform_real_distribution<double> uniform(0.0, 1.0);
  std::vector<Eigen::Vector3d> points;
  while (points.size() < 1000) {
    const Eigen::Vector2d pixel(uniform(random) * (camera.width_px - 1),
                                uniform(random) * (camera.height_px - 1));
    const auto ray = camera.unproject(pixel);
    const double depth_m = 0.3 + 2.7 * uniform(random);
    if (ray) points.push_back(depth_m * Eigen::Vector3d(ray->homogeneous()));
  }
  return points;
}

double worstPx(const CameraModel& camera, const Reader& reader) {
  double worst_px = 0.0;
  for (const Eigen::Vector3d& point : pointsOf(camera)) {
    worst_px = std::max(worst_px, (reader(point) - camera.project(point).value()).norm());
  }
  return worst_px;
}

/// The same for points of a carrying frame: `reader` is given them there.
double worstPx(const CameraModel& camera, const Eigen::Isometry3d& parent_by_camera, const Reader& reader) {
  return worstPx(camera, [&](const Eigen::Vector3d& point) { return reader(parent_by_camera * point); });
}

Eigen::MatrixXd eigen(const cv::Mat& matrix) {
  Eigen::MatrixXd result(matrix.rows, matrix.cols);
  for (int row = 0; row < matrix.rows; ++row) {
    for (int column = 0; column < matrix.cols; ++column) result(row, column) = matrix.at<double>(row, column);
  }
  return result;
}

Reader openCvReader(const cv::Mat& k, const cv::Mat& d) {
  return [k, d](const Eigen::Vector3d& point) {
    std::vector<cv::Point2d> pixels;
    const std::vector<cv::Point3d> points = {{point.x(), point.y(), point.z()}};
    cv::projectPoints(points, cv::Vec3d(0, 0, 0), cv::Vec3d(0, 0, 0), k, d, pixels);
    return Eigen::Vector2d(pixels[0].x, pixels[0].y);
  };
}

cv::Mat matrixIn(const std::filesystem::path& file, const std::string& key) {
  const cv::FileStorage storage(file.string(), cv::FileStorage::READ);
  cv::Mat matrix;
  storage[key] >> matrix;
  EXPECT_FALSE(matrix.empty()) << key;
  return matrix;
}

CalibrationResult inStages(int cameras) {
  CalibrationResult result = test::RandomResult(3).make(cameras);
  result.joint.reset();
  return result;
}

class Readers : public ::testing::Test {
 protected:
  /// cam1 has the five-coefficient lens, cam2 the rational one and a structured-light depth; both stand in
  /// the cell.
  CalibrationResult result_ = inStages(2);
  const test::TemporaryFolder folder_;

  Export write(Format format) {
    Export exported = exportResult(result_, format);
    EXPECT_EQ(exported.status, ExportStatus::kComplete) << exported.reason;
    if (exported.status == ExportStatus::kComplete) writeExport(exported, folder_.path());
    return exported;
  }

  struct Item {
    std::string name;
    CameraModel model;
    Eigen::Isometry3d bMc;
  };
  std::vector<Item> items() const {
    std::vector<Item> all;
    for (const CameraResult& camera : result_.cameras) {
      const Eigen::Isometry3d& bMc = camera.hand_eye->camera_pose;
      all.push_back({camera.camera + "_color", camera.intrinsics.camera, bMc});
      all.push_back({camera.camera + "_infrared", camera.infrared->camera,
                     bMc * camera.color_infrared->first_by_second});
    }
    return all;
  }

  /// Lenses that Kalibr can hold.
  void dropK3() {
    for (CameraResult& camera : result_.cameras) {
      CameraModel& color = camera.intrinsics.camera;
      color.lens = LensModel::kPlumbBob;
      color.parameters.conservativeResize(9);
      color.parameters[8] = camera.infrared->camera.parameters[8] = 0.0;
    }
  }
};

// Negative control: the measure sees a millionth of a focal length, and a millimetre.
TEST_F(Readers, TheMeasureSeesSmallMistakes) {
  const Item item = items().front();
  CameraModel other = item.model;
  other.parameters[0] *= 1 + 1e-6;
  const auto project = [&](const Eigen::Vector3d& point) { return other.project(point).value(); };
  EXPECT_GT(worstPx(item.model, project), 100 * kExactPx);
  Eigen::Isometry3d shifted = item.bMc;
  shifted.translation().x() += 1e-6;
  EXPECT_GT(
      worstPx(item.model, item.bMc,
              [&](const Eigen::Vector3d& p) { return item.model.project(shifted.inverse() * p).value(); }),
      100 * kExactPx);
}

TEST_F(Readers, OpenCvFileStorage) {
  write(Format::kOpenCv);
  for (const Item& item : items()) {
    const std::filesystem::path file = folder_ / (item.name + ".yaml");
    const Reader reader =
        openCvReader(matrixIn(file, "camera_matrix"), matrixIn(file, "distortion_coefficients"));
    EXPECT_LT(worstPx(item.model, reader), kExactPx) << item.name;
    const Eigen::Isometry3d pose(Eigen::Matrix4d(eigen(matrixIn(file, "parent_from_camera"))));
    EXPECT_EQ(static_cast<std::string>(cv::FileStorage(file.string(), cv::FileStorage::READ)["parent_frame"]),
              "base");
    EXPECT_LT(
        worstPx(item.model, item.bMc, [&](const Eigen::Vector3d& p) { return reader(pose.inverse() * p); }),
        kExactPx);
  }
  // The stereo file, as OpenCV means it: x2 = R x1 + T, and corresponding pixels satisfy x2' F x1 = 0.
  const std::filesystem::path file = folder_ / "stereo_cam1_color_cam1_infrared.yaml";
  const Eigen::Matrix3d r = eigen(matrixIn(file, "R")), f = eigen(matrixIn(file, "F")),
                        k1 = eigen(matrixIn(file, "M1")), k2 = eigen(matrixIn(file, "M2"));
  const Eigen::Vector3d t = eigen(matrixIn(file, "T"));
  const Item color = items()[0], infrared = items()[1];
  const Reader second = openCvReader(matrixIn(file, "M2"), matrixIn(file, "D2"));
  EXPECT_LT(worstPx(infrared.model, color.bMc.inverse() * infrared.bMc,
                    [&](const Eigen::Vector3d& p) { return second(r * p + t); }),
            kExactPx);
  const Eigen::Vector3d point(0.1, -0.2, 1.3);
  const Eigen::Vector3d line = f * (k1 * point / point.z());
  EXPECT_NEAR((k2 * (r * point + t)).hnormalized().homogeneous().dot(line / line.head<2>().norm()), 0.0,
              1e-9);
}

TEST_F(Readers, RosCameraInfo) {
#ifdef SERVOCAL_HAS_ROS_PARSERS
  write(Format::kRosCameraInfo);
  for (const Item& item : items()) {
    std::string name;
    sensor_msgs::CameraInfo info;
    ASSERT_TRUE(
        camera_calibration_parsers::readCalibration((folder_ / (item.name + ".yaml")).string(), name, info));
    EXPECT_EQ(name, item.name);
    EXPECT_EQ(info.distortion_model, toString(item.model.lens));
    EXPECT_EQ(static_cast<int>(info.width), item.model.width_px);
    EXPECT_EQ(static_cast<int>(info.height), item.model.height_px);
    EXPECT_EQ(info.P[0], item.model.fx());
    EXPECT_EQ(info.P[6], item.model.cy());
    EXPECT_EQ(info.R[0], 1.0);
    EXPECT_LT(
        worstPx(item.model, openCvReader(cv::Mat(3, 3, CV_64F, info.K.data()), cv::Mat(info.D, true).t())),
        kExactPx);
  }
#else
  GTEST_SKIP() << "libcamera-calibration-parsers-dev is not installed";
#endif
}

TEST_F(Readers, VispXmlHoldsTheNearestLensAndSaysHowNear) {
  const Export exported = write(Format::kVisp);
  for (const Item& item : items()) {
    vpXmlParserCamera parser;
    vpCameraParameters camera;
    ASSERT_EQ(parser.parse(camera, (folder_ / "cameras.xml").string(), item.name,
                           vpCameraParameters::perspectiveProjWithDistortion, item.model.width_px,
                           item.model.height_px),
              vpXmlParserCamera::SEQUENCE_OK);
    double forward_px2 = 0.0, inverse_px2 = 0.0;
    const auto points = pointsOf(item.model);
    for (const Eigen::Vector3d& point : points) {
      const Eigen::Vector2d pixel = item.model.project(point).value();
      double u = 0, v = 0, x = 0, y = 0;
      vpMeterPixelConversion::convertPoint(camera, point.x() / point.z(), point.y() / point.z(), u, v);
      vpPixelMeterConversion::convertPoint(camera, pixel.x(), pixel.y(), x, y);
      forward_px2 += (Eigen::Vector2d(u, v) - pixel).squaredNorm() / points.size();
      inverse_px2 += (Eigen::Vector2d(camera.get_px() * (x - point.x() / point.z()),
                                      camera.get_py() * (y - point.y() / point.z())))
                         .squaredNorm() /
                     points.size();
    }
    // The notes state what these points show, on a grid of their own.
    for (const std::string& note : exported.notes) {
      if (note.rfind("cameras.xml, " + item.name, 0) != 0) continue;
      double forward_said = 0, inverse_said = 0;
      ASSERT_EQ(std::sscanf(note.c_str() + note.find("u(x)"), "u(x), v(x): %lf px", &forward_said), 1)
          << note;
      ASSERT_EQ(std::sscanf(note.c_str() + note.find("x(u"), "x(u, v): %lf px", &inverse_said), 1) << note;
      EXPECT_NEAR(std::sqrt(forward_px2), forward_said, 0.2 * forward_said) << note;
      EXPECT_NEAR(std::sqrt(inverse_px2), inverse_said, 0.2 * inverse_said) << note;
      EXPECT_GT(forward_said, 0.01) << note;
    }
  }
  // A lens that ViSP can hold comes back exactly.
  CameraModel& lens = result_.cameras[0].intrinsics.camera;
  lens.parameters.tail<5>() << 0.05, 0, 0, 0, 0;
  write(Format::kVisp);
  vpXmlParserCamera parser;
  vpCameraParameters camera;
  parser.parse(camera, (folder_ / "cameras.xml").string(), "cam1_color",
               vpCameraParameters::perspectiveProjWithDistortion, lens.width_px, lens.height_px);
  EXPECT_LT(worstPx(lens,
                    [&](const Eigen::Vector3d& point) {
                      Eigen::Vector2d pixel;
                      vpMeterPixelConversion::convertPoint(camera, point.x() / point.z(),
                                                           point.y() / point.z(), pixel.x(), pixel.y());
                      return pixel;
                    }),
            kExactPx);
}

TEST_F(Readers, VispPoseVectors) {
  write(Format::kVisp);
  for (const Item& item : items()) {
    vpPoseVector vector;
    ASSERT_TRUE(vpPoseVector::loadYAML((folder_ / (item.name + "_rPc.yaml")).string(), vector));
    const vpHomogeneousMatrix rMc(vector);
    EXPECT_LT(worstPx(item.model, item.bMc,
                      [&](const Eigen::Vector3d& p) {
                        const vpColVector in({p.x(), p.y(), p.z(), 1.0});
                        const vpColVector out = rMc.inverse() * in;
                        return item.model.project({out[0], out[1], out[2]}).value();
                      }),
              kExactPx);
  }
}

TEST_F(Readers, Urdf) {
  write(Format::kUrdf);
  std::ostringstream text;
  text << std::ifstream(folder_ / "base_cameras.urdf").rdbuf();
  const auto robot = urdf::parseURDF(text.str());
  ASSERT_TRUE(robot);
  EXPECT_EQ(robot->getRoot()->name, "base");
  for (const Item& item : items()) {
    Eigen::Isometry3d pose = Eigen::Isometry3d::Identity();
    auto link = robot->getLink(item.name + "_optical_frame");
    ASSERT_TRUE(link) << item.name;
    for (; link->parent_joint; link = robot->getLink(link->parent_joint->parent_link_name)) {
      const urdf::Pose& origin = link->parent_joint->parent_to_joint_origin_transform;
      const urdf::Rotation& q = origin.rotation;
      Eigen::Isometry3d step = Eigen::Isometry3d::Identity();
      step.linear() = Eigen::Quaterniond(q.w, q.x, q.y, q.z).toRotationMatrix();
      step.translation() << origin.position.x, origin.position.y, origin.position.z;
      pose = step * pose;
    }
    EXPECT_LT(
        worstPx(item.model, item.bMc,
                [&](const Eigen::Vector3d& p) { return item.model.project(pose.inverse() * p).value(); }),
        kExactPx);
  }
}

// Roll and yaw are one where a camera link looks straight up or down: there formulas divide by zero.
TEST_F(Readers, UrdfOfALinkThatLooksStraightDown) {
  for (const double tilt_rad : {0.0, 1e-3, 1e-7, 1e-10, 1e-13}) {
    for (const double down : {M_PI, 0.0}) {
      auto& pose = result_.cameras[0].hand_eye->camera_pose;
      pose = Pose<Base, Color>::fromRotationVector({down, 0, 0}, {0.1, 0.2, 0.9}).isometry() *
             Eigen::AngleAxisd(0.7, Eigen::Vector3d::UnitZ()) *
             Eigen::AngleAxisd(tilt_rad, Eigen::Vector3d::UnitX());
      write(Format::kUrdf);
      std::ostringstream text;
      text << std::ifstream(folder_ / "base_cameras.urdf").rdbuf();
      const auto link = urdf::parseURDF(text.str())->getLink("cam1_link");
      const urdf::Rotation& q = link->parent_joint->parent_to_joint_origin_transform.rotation;
      const Eigen::Matrix3d read = Eigen::Quaterniond(q.w, q.x, q.y, q.z).toRotationMatrix();
      Eigen::Matrix3d optical;  // pose of the optical frame in the link
      optical << 0, 0, 1, -1, 0, 0, 0, -1, 0;
      EXPECT_LT((read * optical - pose.linear()).norm(), 1e-8) << tilt_rad;
    }
  }
}

TEST_F(Readers, Mrcal) {
#ifdef SERVOCAL_HAS_MRCAL
  write(Format::kMrcal);
  for (const Item& item : items()) {
    mrcal_cameramodel_t* model =
        mrcal_read_cameramodel_file((folder_ / (item.name + ".cameramodel")).c_str());
    ASSERT_NE(model, nullptr);
    EXPECT_EQ(static_cast<int>(model->imagersize[0]), item.model.width_px);
    EXPECT_LT(worstPx(item.model, item.bMc,
                      [&](const Eigen::Vector3d& p) {
                        Eigen::Vector3d in_camera;
                        mrcal_transform_point_rt(in_camera.data(), nullptr, nullptr, model->rt_cam_ref,
                                                 p.data());
                        const mrcal_point3_t point = {{in_camera.x(), in_camera.y(), in_camera.z()}};
                        mrcal_point2_t pixel;
                        EXPECT_TRUE(mrcal_project(&pixel, nullptr, nullptr, &point, 1, &model->lensmodel,
                                                  model->intrinsics));
                        return Eigen::Vector2d(pixel.x, pixel.y);
                      }),
              kExactPx);
    mrcal_free_cameramodel(&model);
  }
#else
  GTEST_SKIP() << "libmrcal-dev is not installed";
#endif
}

// No reader in Debian: Kalibr's formulas (pinhole, radtan) written out, and its chain followed from camera to
// camera.
TEST_F(Readers, Kalibr) {
  dropK3();
  write(Format::kKalibr);
  const YAML::Node chain = YAML::LoadFile((folder_ / "camchain.yaml").string());
  ASSERT_EQ(chain.size(), 4u);
  Eigen::Isometry3d camera_by_first = Eigen::Isometry3d::Identity();
  for (std::size_t i = 0; i < 4; ++i) {
    const Item item = items()[i];
    const YAML::Node node = chain["cam" + std::to_string(i)];
    EXPECT_EQ(node["camera_model"].as<std::string>() + node["distortion_model"].as<std::string>(),
              "pinholeradtan");
    EXPECT_EQ(node["cam_overlaps"].size(), 3u);
    const auto f = node["intrinsics"].as<std::vector<double>>(),
               k = node["distortion_coeffs"].as<std::vector<double>>();
    ASSERT_EQ(f.size() + k.size(), 8u);
    if (i > 0) {
      Eigen::Isometry3d step;
      for (int e = 0; e < 16; ++e) step.matrix()(e / 4, e % 4) = node["T_cn_cnm1"][e / 4][e % 4].as<double>();
      camera_by_first = step * camera_by_first;
    }
    const Reader reader = [&](const Eigen::Vector3d& p) {
      const Eigen::Vector3d in_camera = camera_by_first * p;
      const double x = in_camera.x() / in_camera.z(), y = in_camera.y() / in_camera.z(), rho2 = x * x + y * y;
      const double radial = k[0] * rho2 + k[1] * rho2 * rho2;
      return Eigen::Vector2d(f[0] * (x + x * radial + 2 * k[2] * x * y + k[3] * (rho2 + 2 * x * x)) + f[2],
                             f[1] * (y + y * radial + 2 * k[3] * x * y + k[2] * (rho2 + 2 * y * y)) + f[3]);
    };
    EXPECT_LT(worstPx(item.model, items()[0].bMc.inverse() * item.bMc, reader), kExactPx) << item.name;
  }
}

// No reader here: COLMAP's FULL_OPENCV and OPENCV written out; its pixel (0,0) is the image's corner.
TEST_F(Readers, Colmap) {
  for (const bool short_form : {false, true}) {
    if (short_form) dropK3();
    write(Format::kColmap);
    std::ifstream cameras(folder_ / "cameras.txt"), images(folder_ / "images.txt");
    std::map<std::string, Reader> lenses;  // by camera id
    int read = 0;
    for (std::string line; std::getline(cameras, line);) {
      if (line.empty() || line[0] == '#') continue;
      std::istringstream words(line);
      std::string id, model;
      int width = 0, height = 0;
      words >> id >> model >> width >> height;
      EXPECT_EQ(model, short_form ? "OPENCV" : "FULL_OPENCV");
      std::vector<double> p;
      for (double value = 0; words >> value;) p.push_back(value);
      ASSERT_EQ(p.size(), short_form ? 8u : 12u);
      p.resize(12, 0.0);
      lenses[id] = [p](const Eigen::Vector3d& point) {
        const double x = point.x() / point.z(), y = point.y() / point.z(), r2 = x * x + y * y;
        const double radial =
            (1 + r2 * (p[4] + r2 * (p[5] + r2 * p[8]))) / (1 + r2 * (p[9] + r2 * (p[10] + r2 * p[11])));
        return Eigen::Vector2d(p[0] * (x * radial + 2 * p[6] * x * y + p[7] * (r2 + 2 * x * x)) + p[2] - 0.5,
                               p[1] * (y * radial + 2 * p[7] * x * y + p[6] * (r2 + 2 * y * y)) + p[3] - 0.5);
      };
    }
    for (std::string line; std::getline(images, line);) {
      if (line.empty() || line[0] == '#') continue;
      std::istringstream words(line);
      std::string id, camera, name;
      double qw, qx, qy, qz;
      Eigen::Vector3d t;
      words >> id >> qw >> qx >> qy >> qz >> t.x() >> t.y() >> t.z() >> camera >> name;
      ASSERT_FALSE(words.fail()) << line;
      const Item item = items().at(static_cast<std::size_t>(std::stoi(camera) - 1));
      EXPECT_EQ(name, item.name + ".png");
      const Eigen::Matrix3d r = Eigen::Quaterniond(qw, qx, qy, qz).toRotationMatrix();
      EXPECT_LT(worstPx(item.model, item.bMc,
                        [&](const Eigen::Vector3d& p) { return lenses.at(camera)(r * p + t); }),
                kExactPx);
      ++read;
      ASSERT_TRUE(std::getline(images, line) && line.empty()) << "the line of points";
    }
    EXPECT_EQ(read, 4);
  }
}

TEST_F(Readers, IaiKinect2) {
  result_ = inStages(1);
  write(Format::kIaiKinect2);
  const auto matrix = [&](const std::string& file, const char* key) {
    return matrixIn(folder_ / ("cam1/" + file), key);
  };
  const Item color = items()[0], infrared = items()[1];
  EXPECT_LT(worstPx(color.model, openCvReader(matrix("calib_color.yaml", "cameraMatrix"),
                                              matrix("calib_color.yaml", "distortionCoefficients"))),
            kExactPx);
  EXPECT_LT(worstPx(infrared.model, openCvReader(matrix("calib_ir.yaml", "cameraMatrix"),
                                                 matrix("calib_ir.yaml", "distortionCoefficients"))),
            kExactPx);
  EXPECT_EQ(matrix("calib_ir.yaml", "projection").rows, 4);
  const Eigen::Matrix3d r = eigen(matrix("calib_pose.yaml", "rotation"));
  const Eigen::Vector3d t = eigen(matrix("calib_pose.yaml", "translation"));
  EXPECT_LT(worstPx(color.model, infrared.bMc.inverse() * color.bMc,
                    [&](const Eigen::Vector3d& p) { return color.model.project(r * p + t).value(); }),
            kExactPx);
  // The one number for depth: what it leaves, on points of our own, is what the file says.
  const std::filesystem::path file = folder_ / "cam1/calib_depth.yaml";
  const double shift_m =
      static_cast<double>(cv::FileStorage(file.string(), cv::FileStorage::READ)["depthShift"]) / 1e3;
  const DepthModel& depth = result_.cameras[0].depth->model;
  std::mt19937_64 random(3);
  std::uniform_real_distribution<double> uniform(0.0, 1.0);
  double left_m2 = 0.0;
  constexpr int kSamples = 4000;
  for (int i = 0; i < kSamples; ++i) {
    const double raw_m = depth.near_m + uniform(random) * (depth.far_m - depth.near_m);
    const double corrected_m = depth.correct({uniform(random) * 511, uniform(random) * 423}, raw_m).value();
    left_m2 += std::pow(raw_m + shift_m - corrected_m, 2) / kSamples;
  }
  std::ostringstream text;
  text << std::ifstream(file).rdbuf();
  double said_mm = 0;
  const std::size_t at = text.str().find("leaves ");
  ASSERT_EQ(std::sscanf(text.str().c_str() + at, "leaves %lf mm RMS", &said_mm), 1) << text.str();
  EXPECT_NEAR(std::sqrt(left_m2) * 1e3, said_mm, 0.1 * said_mm);
}

TEST_F(Readers, EasyHandEye2) {
  result_ = inStages(3);
  write(Format::kEasyHandEye2);
  for (const CameraResult& camera : result_.cameras) {
    const YAML::Node file = YAML::LoadFile((folder_ / (camera.camera + ".calib")).string());
    const bool fixed = camera.hand_eye->mount == Mount::kFixed;
    EXPECT_EQ(file["parameters"]["calibration_type"].as<std::string>(),
              fixed ? "eye_on_base" : "eye_in_hand");
    EXPECT_EQ(file["parameters"]["tracking_base_frame"].as<std::string>(),
              camera.camera + "_color_optical_frame");
    EXPECT_TRUE(file["parameters"]["freehand_robot_movement"].as<bool>());
    const YAML::Node t = file["transform"]["translation"], q = file["transform"]["rotation"];
    Eigen::Isometry3d pose = Eigen::Isometry3d::Identity();
    pose.linear() =
        Eigen::Quaterniond(q["w"].as<double>(), q["x"].as<double>(), q["y"].as<double>(), q["z"].as<double>())
            .toRotationMatrix();
    pose.translation() << t["x"].as<double>(), t["y"].as<double>(), t["z"].as<double>();
    const CameraModel& lens = camera.intrinsics.camera;
    EXPECT_LT(worstPx(lens, camera.hand_eye->camera_pose,
                      [&](const Eigen::Vector3d& p) { return lens.project(pose.inverse() * p).value(); }),
              kExactPx);
  }
}

}  // namespace
}  // namespace servocal::report
