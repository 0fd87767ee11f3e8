// SPDX-License-Identifier: GPL-3.0-or-later
#include "rows.h"

#include <map>
#include <nlohmann/json.hpp>

#include "servocal/core/error.h"

namespace servocal::session {
namespace {

using Json = nlohmann::json;

std::int64_t nanoseconds(Instant instant) { return instant.time_since_epoch().count(); }
Instant instant(std::int64_t stamp_ns) { return Instant(Duration(stamp_ns)); }

std::string toText(const Eigen::VectorXd& values) {
  return Json(std::vector<double>(values.data(), values.data() + values.size())).dump();
}

template <class A, class B>
std::string toText(const Pose<A, B>& pose) {
  Json rows = Json::array();
  const Eigen::Matrix4d matrix = pose.isometry().matrix();
  for (int row = 0; row < 4; ++row) {
    rows.push_back({matrix(row, 0), matrix(row, 1), matrix(row, 2), matrix(row, 3)});
  }
  return rows.dump();
}

Eigen::VectorXd toVector(const std::string& text) {
  const auto values = Json::parse(text).get<std::vector<double>>();
  return Eigen::Map<const Eigen::VectorXd>(values.data(), static_cast<Eigen::Index>(values.size()));
}

template <class A, class B>
Pose<A, B> toPose(const std::string& text) {
  const auto rows = Json::parse(text).get<std::vector<std::vector<double>>>();
  Eigen::Isometry3d transform = Eigen::Isometry3d::Identity();
  for (int row = 0; row < 3; ++row) {
    for (int column = 0; column < 4; ++column) transform.matrix()(row, column) = rows.at(row).at(column);
  }
  return Pose<A, B>(transform);
}

template <class Enum>
Enum fromName(const std::string& name, int count) {
  for (int value = 0; value < count; ++value) {
    if (name == toString(static_cast<Enum>(value))) return static_cast<Enum>(value);
  }
  throw Error(ErrorKind::kBadData,
              "the session names an unknown '" + name + "'; it is damaged or of a newer version");
}

RobotState robotState(const Statement& row) {
  RobotState robot;
  robot.stamp = instant(row.integer(2));
  robot.device_stamp_s = row.number(3);
  robot.q = toVector(row.text(4));
  robot.bMe = toPose<Base, EndEffector>(row.text(5));
  const Eigen::VectorXd twist = toVector(row.text(6));
  if (twist.size() != 6)
    throw Error(ErrorKind::kBadData, "the session holds a twist of other than 6 numbers");
  robot.twist = {twist.head<3>(), twist.tail<3>()};
  return robot;
}

std::vector<Corner> selectCorners(Statement& query, std::int64_t view_id) {
  std::vector<Corner> corners;
  query.bind(view_id);
  while (query.step()) {
    Corner corner;
    corner.id = static_cast<int>(query.integer(0));
    corner.pixel = {query.number(1), query.number(2)};
    corner.covariance_px2 << query.number(3), query.number(4), query.number(4), query.number(5);
    corners.push_back(corner);
  }
  query.rewind();
  return corners;
}

void insertDepth(const Database& database, std::int64_t view_id, const BoardDepth& depth) {
  Statement insert(database, "INSERT INTO depth VALUES (?, ?, ?, ?, ?)");
  insert.bind(view_id).bind(depth.plane_rms_m).bind(depth.valid_share).bind(std::int64_t{depth.frames});
  insert.bind(depth.image_file).run();
  Statement insert_corner(database, "INSERT INTO corner_depth VALUES (?, ?, ?, ?)");
  for (const CornerDepth& corner : depth.corners) {
    insert_corner.bind(view_id).bind(std::int64_t{corner.id}).bind(corner.depth_m).bind(std::int64_t{corner.pixels});
    insert_corner.run();
  }
  Statement insert_patch(database, "INSERT INTO depth_patch VALUES (NULL, ?, ?, ?, ?, ?, ?)");
  for (const DepthPatch& patch : depth.patches) {
    insert_patch.bind(view_id).bind(patch.pixel.x()).bind(patch.pixel.y()).bind(patch.depth_m).bind(patch.sigma_m);
    insert_patch.bind(std::int64_t{patch.pixels}).run();
  }
}

/// Depth of all views that have it, by view.
std::map<std::int64_t, BoardDepth> selectDepths(const Database& database) {
  std::map<std::int64_t, BoardDepth> depths;
  Statement rows(database, "SELECT * FROM depth");
  while (rows.step()) {
    BoardDepth& depth = depths[rows.integer(0)];
    depth.plane_rms_m = rows.number(1);
    depth.valid_share = rows.number(2);
    depth.frames = static_cast<int>(rows.integer(3));
    depth.image_file = rows.text(4);
  }
  Statement corners(database, "SELECT view_id, id, depth_m, pixels FROM corner_depth ORDER BY view_id, id");
  while (corners.step()) {
    depths[corners.integer(0)].corners.push_back(
        {static_cast<int>(corners.integer(1)), corners.number(2), static_cast<int>(corners.integer(3))});
  }
  Statement patches(database, "SELECT view_id, u_px, v_px, depth_m, sigma_m, pixels FROM depth_patch ORDER BY id");
  while (patches.step()) {
    depths[patches.integer(0)].patches.push_back({{patches.number(1), patches.number(2)}, patches.number(3),
                                                  patches.number(4), static_cast<int>(patches.integer(5))});
  }
  return depths;
}

/// Damaged JSON inside a cell is damaged data, not a bug.
template <class Read>
auto guarded(const Read& read) {
  try {
    return read();
  } catch (const Json::exception& error) {
    throw Error(ErrorKind::kBadData, std::string("the session holds a damaged value: ") + error.what());
  } catch (const std::out_of_range& error) {
    throw Error(ErrorKind::kBadData, "the session holds a damaged matrix");
  }
}

}  // namespace

void insertObservation(const Database& database, const Observation& observation) {
  Statement insert(database, "INSERT INTO observation VALUES (?, ?, ?, ?, ?, ?, ?)");
  insert.bind(observation.id).bind(observation.stage);
  if (const auto& robot = observation.robot) {
    Eigen::VectorXd twist(6);
    twist << robot->twist.linear_mps, robot->twist.angular_radps;
    insert.bind(nanoseconds(robot->stamp)).bind(robot->device_stamp_s).bind(toText(robot->q));
    insert.bind(toText(robot->bMe)).bind(toText(twist));
  } else {
    insert.bindNull().bindNull().bindNull().bindNull().bindNull();
  }
  insert.run();
  Statement insert_view(database, "INSERT INTO view VALUES (NULL, ?, ?, ?, ?, ?, ?, ?, ?, ?)");
  Statement insert_corner(database, "INSERT INTO corner VALUES (?, ?, ?, ?, ?, ?, ?)");
  for (const StreamObservation& view : observation.views) {
    insert_view.bind(observation.id).bind(view.camera).bind(std::string(toString(view.stream)));
    insert_view.bind(nanoseconds(view.stamp)).bind(view.device_stamp_s);
    insert_view.bind(std::int64_t{view.width_px}).bind(std::int64_t{view.height_px});
    insert_view.bind(std::int64_t{view.detection.orientation_known}).bind(view.image_file);
    insert_view.run();
    const std::int64_t view_id = database.lastId();
    for (const Corner& corner : view.detection.corners) {
      insert_corner.bind(view_id).bind(std::int64_t{corner.id});
      insert_corner.bind(corner.pixel.x()).bind(corner.pixel.y());
      insert_corner.bind(corner.covariance_px2(0, 0)).bind(corner.covariance_px2(0, 1));
      insert_corner.bind(corner.covariance_px2(1, 1)).run();
    }
    if (view.depth) insertDepth(database, view_id, *view.depth);
  }
}

std::vector<Observation> selectObservations(const Database& database) {
  return guarded([&] {
    const bool has_depth = database.hasTable("depth");
    const auto depths = has_depth ? selectDepths(database) : std::map<std::int64_t, BoardDepth>();
    std::vector<Observation> observations;
    std::map<std::int64_t, std::size_t> index_of;
    Statement rows(database, "SELECT * FROM observation ORDER BY id");
    while (rows.step()) {
      Observation observation;
      observation.id = rows.integer(0);
      observation.stage = rows.text(1);
      if (!rows.isNull(5)) observation.robot = robotState(rows);
      index_of[observation.id] = observations.size();
      observations.push_back(std::move(observation));
    }
    Statement views(database, "SELECT * FROM view ORDER BY id");
    Statement corners(database,
                      "SELECT id, u_px, v_px, var_u_px2, cov_uv_px2, var_v_px2 FROM corner WHERE view_id = ? "
                      "ORDER BY id");
    while (views.step()) {
      StreamObservation view;
      view.camera = views.text(2);
      view.stream = fromName<Stream>(views.text(3), 3);
      view.stamp = instant(views.integer(4));
      view.device_stamp_s = views.number(5);
      view.width_px = static_cast<int>(views.integer(6));
      view.height_px = static_cast<int>(views.integer(7));
      view.detection.orientation_known = views.integer(8) != 0;
      view.image_file = views.text(9);
      view.detection.corners = selectCorners(corners, views.integer(0));
      if (const auto depth = depths.find(views.integer(0)); depth != depths.end()) view.depth = depth->second;
      const auto owner = index_of.find(views.integer(1));
      if (owner == index_of.end())
        throw Error(ErrorKind::kBadData, "the session holds a view of no observation");
      observations[owner->second].views.push_back(std::move(view));
    }
    return observations;
  });
}

std::int64_t insertAttempt(const Database& database, const Attempt& attempt) {
  Statement insert(database, "INSERT INTO attempt VALUES (NULL, ?, ?, ?, ?, ?, ?, ?, ?)");
  insert.bind(attempt.stage).bind(attempt.camera);
  insert.bind(nanoseconds(attempt.start)).bind(nanoseconds(attempt.end));
  if (attempt.cdMo.isFinite()) {
    insert.bind(toText(attempt.cdMo));
  } else {
    insert.bindNull();
  }
  insert.bind(std::string(toString(attempt.status))).bind(attempt.reason);
  if (attempt.observation_id) {
    insert.bind(*attempt.observation_id);
  } else {
    insert.bindNull();
  }
  insert.run();
  return database.lastId();
}

std::vector<Attempt> selectAttempts(const Database& database) {
  return guarded([&] {
    std::vector<Attempt> attempts;
    Statement rows(database, "SELECT * FROM attempt ORDER BY id");
    while (rows.step()) {
      Attempt attempt;
      attempt.id = rows.integer(0);
      attempt.stage = rows.text(1);
      attempt.camera = rows.text(2);
      attempt.start = instant(rows.integer(3));
      attempt.end = instant(rows.integer(4));
      if (!rows.isNull(5)) attempt.cdMo = toPose<Color, Board>(rows.text(5));
      attempt.status = fromName<DriveStatus>(rows.text(6), 6);
      attempt.reason = rows.text(7);
      if (!rows.isNull(8)) attempt.observation_id = rows.integer(8);
      attempts.push_back(std::move(attempt));
    }
    return attempts;
  });
}

}  // namespace servocal::session
