// SPDX-License-Identifier: GPL-3.0-or-later
#include "servocal/session/session.h"

#include <opencv2/imgcodecs.hpp>
#include <stdexcept>

#include "database.h"
#include "durable_file.h"
#include "rows.h"
#include "schema.h"
#include "servocal/core/config_reader.h"
#include "servocal/core/error.h"

namespace servocal::session {
namespace {

namespace fs = std::filesystem;

fs::path databaseFile(const fs::path& folder) { return folder / "session.sqlite"; }

template <class Value>
void putMeta(const Database& database, const char* key, const Value& value) {
  Statement(database, "INSERT INTO meta VALUES (?, ?)").bind(std::string(key)).bind(value).run();
}

/// "images/000012_cam1_color.png"; characters that file systems dislike become '-'.
std::string imageName(std::int64_t id, const StreamObservation& view, Stream stream) {
  std::string number = std::to_string(id);
  number.insert(0, 6 - std::min<std::size_t>(6, number.size()), '0');
  std::string camera = view.camera;
  for (char& c : camera) {
    if (std::isalnum(static_cast<unsigned char>(c)) == 0 && c != '_' && c != '.') c = '-';
  }
  return "images/" + number + "_" + camera + "_" + toString(stream) + ".png";
}

void checkFinite(const Observation& observation) {
  const auto refuse = [&](const char* what) {
    throw std::invalid_argument("observation of stage '" + observation.stage + "': " + what +
                                " is not finite");
  };
  if (const auto& robot = observation.robot) {
    if (!robot->bMe.isFinite()) refuse("bMe");
    if (!robot->q.allFinite()) refuse("q");
    if (!robot->twist.isFinite()) refuse("the twist");
  }
  for (const StreamObservation& view : observation.views) {
    for (const Corner& corner : view.detection.corners) {
      if (!corner.pixel.allFinite()) refuse("a corner's pixel");
    }
  }
}

}  // namespace

struct Session::Impl {
  fs::path folder;
  std::unique_ptr<FileLock> lock;  ///< Held by the writer only.
  std::unique_ptr<Database> database;
  std::int64_t next_id = 1;

  void demandWriter() const {
    if (lock == nullptr) throw std::invalid_argument("this session was opened for reading");
  }

  std::string text(const char* key) const {
    Statement query(*database, "SELECT value FROM meta WHERE key = ?");
    query.bind(std::string(key));
    if (!query.step()) throw missing(key);
    return query.text(0);
  }
  double number(const char* key) const {
    Statement query(*database, "SELECT value FROM meta WHERE key = ?");
    query.bind(std::string(key));
    if (!query.step()) throw missing(key);
    return query.number(0);
  }
  Error missing(const char* key) const {
    return Error(ErrorKind::kBadData, "session '" + folder.string() + "' lacks '" + key + "' in table meta");
  }
};

Session::Session(std::unique_ptr<Impl> impl) : impl_(std::move(impl)) {}
Session::~Session() = default;
Session::Session(Session&&) noexcept = default;

Session Session::create(const fs::path& folder, const std::string& cell_text, const BoardSpec& board,
                        std::uint64_t seed) {
  auto impl = std::make_unique<Impl>();
  impl->folder = folder;
  makeFolder(folder);
  impl->lock = std::make_unique<FileLock>(folder / "session.lock");
  makeFolder(folder / "images");
  impl->database = std::make_unique<Database>(databaseFile(folder), Database::Access::kCreate);
  const Database& database = *impl->database;
  // A file without tables is left over from a program that died while making it; it holds nothing.
  if (database.hasTable("meta")) {
    throw Error(ErrorKind::kBadData,
                "folder '" + folder.string() + "' already holds a session; choose another one");
  }
  database.execute("PRAGMA journal_mode = WAL; PRAGMA synchronous = FULL; PRAGMA foreign_keys = ON;");
  Transaction transaction(database);
  database.execute(kSchema);
  putMeta(database, "schema_version", std::int64_t{kSchemaVersion});
  putMeta(database, "cell_text", cell_text);
  putMeta(database, "seed", std::to_string(seed));  // as text: SQLite's integers are signed
  std::string board_text;
  for (const auto& [key, value] : boardKeys(board)) board_text += key + ": " + value + "\n";
  putMeta(database, "board_text", board_text);
  transaction.commit();
  syncFolder(folder);
  return Session(std::move(impl));
}

Session Session::open(const fs::path& folder) {
  if (!isSession(folder)) {
    throw Error(ErrorKind::kBadData, "folder '" + folder.string() + "' holds no session (no session.sqlite)");
  }
  auto impl = std::make_unique<Impl>();
  impl->folder = folder;
  impl->database = std::make_unique<Database>(databaseFile(folder), Database::Access::kRead);
  if (!impl->database->hasTable("meta")) {
    throw Error(ErrorKind::kBadData, "session '" + folder.string() +
                                         "' is empty: its program ended before it could store anything");
  }
  const double version = impl->number("schema_version");
  if (!(version >= kOldestReadable && version <= kSchemaVersion)) {
    throw Error(ErrorKind::kBadData, "session '" + folder.string() + "' has schema version " +
                                         std::to_string(static_cast<int>(version)) + ", this program reads " +
                                         std::to_string(kOldestReadable) + " to " + std::to_string(kSchemaVersion));
  }
  return Session(std::move(impl));
}

Observation Session::add(Observation observation, const std::vector<ViewImages>& images) {
  impl_->demandWriter();
  if (!images.empty() && images.size() != observation.views.size()) {
    throw std::invalid_argument("an observation of " + std::to_string(observation.views.size()) +
                                " views cannot have " + std::to_string(images.size()) + " images");
  }
  checkFinite(observation);
  observation.id = impl_->next_id;
  bool wrote_images = false;
  const auto write = [&](const StreamObservation& view, Stream stream, const cv::Mat& image) -> std::string {
    if (image.empty()) return "";
    const std::string name = imageName(observation.id, view, stream);
    std::vector<unsigned char> png;
    // Level 1: nearly as small as the default for camera images, and several times as fast.
    if (!cv::imencode(".png", image, png, {cv::IMWRITE_PNG_COMPRESSION, 1})) {
      throw std::invalid_argument("the image of camera '" + view.camera + "' cannot be stored as PNG");
    }
    writeWhole(impl_->folder / name, png.data(), png.size());
    wrote_images = true;
    return name;
  };
  for (std::size_t i = 0; i < images.size(); ++i) {
    StreamObservation& view = observation.views[i];
    view.image_file = write(view, view.stream, images[i].image);
    if (view.depth) view.depth->image_file = write(view, Stream::kDepth, images[i].depth);
  }
  if (wrote_images) syncFolder(impl_->folder / "images");
  Transaction transaction(*impl_->database);
  insertObservation(*impl_->database, observation);
  transaction.commit();
  ++impl_->next_id;
  return observation;
}

Attempt Session::add(Attempt attempt) {
  impl_->demandWriter();
  attempt.id = insertAttempt(*impl_->database, attempt);
  return attempt;
}

void Session::event(Instant stamp, const std::string& kind, const std::string& message) {
  impl_->demandWriter();
  Statement(*impl_->database, "INSERT INTO event VALUES (NULL, ?, ?, ?)")
      .bind(std::int64_t{stamp.time_since_epoch().count()})
      .bind(kind)
      .bind(message)
      .run();
}

std::vector<Observation> Session::observations() const { return selectObservations(*impl_->database); }

std::vector<Attempt> Session::attempts() const { return selectAttempts(*impl_->database); }

std::string Session::cellText() const { return impl_->text("cell_text"); }

BoardSpec Session::board() const {
  return readBoard(ConfigReader::fromText(impl_->text("board_text"), "board in " + databaseFile(impl_->folder).string()));
}

const fs::path& Session::folder() const { return impl_->folder; }

bool isSession(const fs::path& folder) {
  std::error_code ignored;
  return fs::is_regular_file(databaseFile(folder), ignored);
}

}  // namespace servocal::session
