// SPDX-License-Identifier: GPL-3.0-or-later
#include "rows.h"

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
  robot.stamp = instant(row.integer(1));
  robot.device_stamp_s = row.number(2);
  robot.q = toVector(row.text(3));
  robot.bMe = toPose<Base, EndEffector>(row.text(4));
  const Eigen::VectorXd twist = toVector(row.text(5));
  if (twist.size() != 6)
    throw Error(ErrorKind::kBadData, "the session holds a twist of other than 6 numbers");
  robot.twist = {twist.head<3>(), twist.tail<3>()};
  return robot;
}

/// Makes a statement ready for its next use on every way out.
class StatementUse {
 public:
  explicit StatementUse(Statement& statement) : statement_(statement) {}
  ~StatementUse() { statement_.reset(); }
  StatementUse(const StatementUse&) = delete;
  StatementUse& operator=(const StatementUse&) = delete;
  Statement* operator->() const { return &statement_; }
  Statement& operator*() const { return statement_; }

 private:
  Statement& statement_;
};

std::vector<Corner> selectCorners(Statement& statement, std::int64_t view_id) {
  std::vector<Corner> corners;
  const StatementUse query(statement);
  query->bind(view_id);
  while (query->step()) {
    Corner corner;
    corner.id = static_cast<int>(query->integer(0));
    corner.pixel = {query->number(1), query->number(2)};
    corner.covariance_px2 << query->number(3), query->number(4), query->number(4), query->number(5);
    corners.push_back(corner);
  }
  return corners;
}

void bindOptional(Statement& statement, std::optional<std::int64_t> value) {
  if (value) {
    statement.bind(*value);
  } else {
    statement.bindNull();
  }
}

std::string hashOf(const ImageHashes& hashes, const std::string& image_file) {
  const auto hash = hashes.find(image_file);
  return hash == hashes.end() ? "" : hash->second;
}

void insertDepth(const Database& database, std::int64_t view_id, const BoardDepth& depth,
                 const std::string& sha256) {
  Statement insert(database, "INSERT INTO depth VALUES (?, ?, ?, ?, ?, ?)");
  insert.bind(view_id).bind(depth.plane_rms_m).bind(depth.valid_share).bind(std::int64_t{depth.frames});
  insert.bind(depth.image_file).bind(sha256).run();
  Statement insert_corner(database, "INSERT INTO corner_depth VALUES (?, ?, ?, ?)");
  for (const CornerDepth& corner : depth.corners) {
    insert_corner.bind(view_id)
        .bind(std::int64_t{corner.id})
        .bind(corner.depth_m)
        .bind(std::int64_t{corner.pixels});
    insert_corner.run();
  }
  Statement insert_patch(database, "INSERT INTO depth_patch VALUES (NULL, ?, ?, ?, ?, ?, ?)");
  for (const DepthPatch& patch : depth.patches) {
    insert_patch.bind(view_id)
        .bind(patch.pixel.x())
        .bind(patch.pixel.y())
        .bind(patch.depth_m)
        .bind(patch.sigma_m);
    insert_patch.bind(std::int64_t{patch.pixels}).run();
  }
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

void insertObservation(const Database& database, const Observation& observation, const ImageHashes& hashes) {
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
  Statement insert_view(database, "INSERT INTO view VALUES (NULL, ?, ?, ?, ?, ?, ?, ?, ?, ?, ?)");
  Statement insert_corner(database, "INSERT INTO corner VALUES (?, ?, ?, ?, ?, ?, ?)");
  for (const StreamObservation& view : observation.views) {
    insert_view.bind(observation.id).bind(view.camera).bind(std::string(toString(view.stream)));
    insert_view.bind(nanoseconds(view.stamp)).bind(view.device_stamp_s);
    insert_view.bind(std::int64_t{view.width_px}).bind(std::int64_t{view.height_px});
    insert_view.bind(std::int64_t{view.detection.orientation_known}).bind(view.image_file);
    insert_view.bind(hashOf(hashes, view.image_file)).run();
    const std::int64_t view_id = database.lastId();
    for (const Corner& corner : view.detection.corners) {
      insert_corner.bind(view_id).bind(std::int64_t{corner.id});
      insert_corner.bind(corner.pixel.x()).bind(corner.pixel.y());
      insert_corner.bind(corner.covariance_px2(0, 0)).bind(corner.covariance_px2(0, 1));
      insert_corner.bind(corner.covariance_px2(1, 1)).run();
    }
    if (view.depth) insertDepth(database, view_id, *view.depth, hashOf(hashes, view.depth->image_file));
  }
}

ObservationReader::DepthStatements::DepthStatements(const Database& database)
    : view(database, "SELECT plane_rms_m, valid_share, frames, image_file FROM depth WHERE view_id = ?"),
      corners(database, "SELECT id, depth_m, pixels FROM corner_depth WHERE view_id = ? ORDER BY id"),
      patches(database,
              "SELECT u_px, v_px, depth_m, sigma_m, pixels FROM depth_patch WHERE view_id = ? ORDER BY id") {}

ObservationReader::ObservationReader(const Database& database)
    : database_(database), has_hashes_(database.hasColumn("view", "image_sha256")),
      robot_(database,
             "SELECT stage, robot_stamp_ns, robot_device_stamp_s, q_rad, bMe, twist_base FROM observation "
             "WHERE id = ?"),
      views_(database,
             "SELECT id, camera, stream, stamp_ns, device_stamp_s, width_px, height_px, orientation_known, "
             "image_file FROM view WHERE observation_id = ? ORDER BY id"),
      corners_(database,
               "SELECT id, u_px, v_px, var_u_px2, cov_uv_px2, var_v_px2 FROM corner WHERE view_id = ? "
               "ORDER BY id") {
  if (database.hasTable("depth")) depth_.emplace(database);
}

std::vector<std::int64_t> ObservationReader::ids() {
  std::vector<std::int64_t> ids;
  Statement rows(database_, "SELECT id FROM observation ORDER BY id");
  while (rows.step()) ids.push_back(rows.integer(0));
  return ids;
}

std::optional<BoardDepth> ObservationReader::readDepth(std::int64_t view_id) {
  if (!depth_) return std::nullopt;
  const StatementUse row(depth_->view), corners(depth_->corners), patches(depth_->patches);
  row->bind(view_id);
  if (!row->step()) return std::nullopt;
  BoardDepth depth;
  depth.plane_rms_m = row->number(0);
  depth.valid_share = row->number(1);
  depth.frames = static_cast<int>(row->integer(2));
  depth.image_file = row->text(3);
  corners->bind(view_id);
  while (corners->step()) {
    depth.corners.push_back(
        {static_cast<int>(corners->integer(0)), corners->number(1), static_cast<int>(corners->integer(2))});
  }
  patches->bind(view_id);
  while (patches->step()) {
    depth.patches.push_back({{patches->number(0), patches->number(1)},
                             patches->number(2),
                             patches->number(3),
                             static_cast<int>(patches->integer(4))});
  }
  return depth;
}

Observation ObservationReader::read(std::int64_t id) {
  return guarded([&] {
    const StatementUse robot(robot_), views(views_);
    Observation observation;
    observation.id = id;
    robot->bind(id);
    if (!robot->step())
      throw Error(ErrorKind::kBadData, "the session holds no observation " + std::to_string(id));
    observation.stage = robot->text(0);
    if (!robot->isNull(4)) observation.robot = robotState(*robot);
    views->bind(id);
    while (views->step()) {
      StreamObservation view;
      view.camera = views->text(1);
      view.stream = fromName<Stream>(views->text(2), 3);
      view.stamp = instant(views->integer(3));
      view.device_stamp_s = views->number(4);
      view.width_px = static_cast<int>(views->integer(5));
      view.height_px = static_cast<int>(views->integer(6));
      view.detection.orientation_known = views->integer(7) != 0;
      view.image_file = views->text(8);
      view.detection.corners = selectCorners(corners_, views->integer(0));
      view.depth = readDepth(views->integer(0));
      observation.views.push_back(std::move(view));
    }
    return observation;
  });
}

ImageHashes ObservationReader::hashes(std::int64_t id) {
  ImageHashes hashes;
  if (!has_hashes_) return hashes;
  Statement rows(
      database_,
      "SELECT image_file, image_sha256 FROM view WHERE observation_id = ?1 UNION ALL "
      "SELECT depth.image_file, depth.image_sha256 FROM depth JOIN view ON view.id = depth.view_id "
      "WHERE view.observation_id = ?1");
  rows.bind(id);
  while (rows.step()) hashes.emplace(rows.text(0), rows.text(1));
  return hashes;
}

std::vector<Observation> selectObservations(const Database& database) {
  ObservationReader reader(database);
  std::vector<Observation> observations;
  for (const std::int64_t id : reader.ids()) observations.push_back(reader.read(id));
  return observations;
}

std::int64_t insertAttempt(const Database& database, const Attempt& attempt) {
  Statement insert(database, "INSERT INTO attempt VALUES (?, ?, ?, ?, ?, ?, ?, ?, ?)");
  bindOptional(insert, attempt.id > 0 ? std::optional(attempt.id) : std::nullopt);
  insert.bind(attempt.stage).bind(attempt.camera);
  insert.bind(nanoseconds(attempt.start)).bind(nanoseconds(attempt.end));
  if (attempt.cdMo.isFinite()) {
    insert.bind(toText(attempt.cdMo));
  } else {
    insert.bindNull();
  }
  insert.bind(std::string(toString(attempt.status))).bind(attempt.reason);
  bindOptional(insert, attempt.observation_id);
  insert.run();
  return database.lastId();
}

std::vector<Attempt> selectAttempts(const Database& database, std::optional<std::int64_t> id) {
  return guarded([&] {
    std::vector<Attempt> attempts;
    Statement rows(database, id ? "SELECT * FROM attempt WHERE id = ?" : "SELECT * FROM attempt ORDER BY id");
    if (id) rows.bind(*id);
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

void insertEvent(const Database& database, const SessionEvent& event) {
  Statement(database, "INSERT INTO event VALUES (NULL, ?, ?, ?)")
      .bind(nanoseconds(event.stamp))
      .bind(event.kind)
      .bind(event.message)
      .run();
}

std::vector<SessionEvent> selectEvents(const Database& database, std::optional<std::int64_t> id) {
  std::vector<SessionEvent> events;
  Statement rows(database, id ? "SELECT stamp_ns, kind, message FROM event WHERE id = ?"
                              : "SELECT stamp_ns, kind, message FROM event ORDER BY id");
  if (id) rows.bind(*id);
  while (rows.step()) events.push_back({instant(rows.integer(0)), rows.text(1), rows.text(2)});
  return events;
}

}  // namespace servocal::session
