// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

namespace servocal::session {

constexpr int kSchemaVersion = 4;
constexpr int kOldestReadable = 2;  // Before 3 there was no depth, before 4 images had no hashes.

/// docs/session-format.md explains every column.
constexpr const char* kTables = R"sql(
CREATE TABLE meta (
  key TEXT PRIMARY KEY,
  value                               -- as stored: text, integer or real
) WITHOUT ROWID;
CREATE TABLE observation (
  id INTEGER PRIMARY KEY,
  stage TEXT NOT NULL,
  robot_stamp_ns INTEGER,             -- this and below: NULL without a robot
  robot_device_stamp_s REAL,
  q_rad TEXT,                         -- JSON list
  bMe TEXT,                           -- JSON 4x4, rows
  twist_base TEXT                     -- JSON list: 3 x m/s, 3 x rad/s
);
CREATE TABLE view (
  id INTEGER PRIMARY KEY,
  observation_id INTEGER NOT NULL REFERENCES observation(id),
  camera TEXT NOT NULL,
  stream TEXT NOT NULL,
  stamp_ns INTEGER NOT NULL,
  device_stamp_s REAL,
  width_px INTEGER NOT NULL,
  height_px INTEGER NOT NULL,
  orientation_known INTEGER NOT NULL,
  image_file TEXT NOT NULL,           -- relative to the session folder; empty: none kept
  image_sha256 TEXT NOT NULL          -- of the file, hexadecimal; empty: none kept, or from before version 4
);
CREATE INDEX view_of_observation ON view(observation_id);
CREATE TABLE corner (
  view_id INTEGER NOT NULL REFERENCES view(id),
  id INTEGER NOT NULL,                -- index of the board's inner corner
  u_px REAL, v_px REAL,
  var_u_px2 REAL, cov_uv_px2 REAL, var_v_px2 REAL,
  PRIMARY KEY (view_id, id)
) WITHOUT ROWID;
CREATE TABLE attempt (
  id INTEGER PRIMARY KEY,
  stage TEXT NOT NULL,
  camera TEXT NOT NULL,
  start_ns INTEGER NOT NULL,
  end_ns INTEGER NOT NULL,
  cdMo TEXT,                          -- JSON 4x4, rows
  status TEXT NOT NULL,
  reason TEXT NOT NULL,
  observation_id INTEGER REFERENCES observation(id)
);
CREATE TABLE event (
  id INTEGER PRIMARY KEY,
  stamp_ns INTEGER NOT NULL,
  kind TEXT NOT NULL,
  message TEXT NOT NULL
);
)sql";

/// Since version 3.
constexpr const char* kDepthTables = R"sql(
CREATE TABLE depth (                  -- what the depth image said about the board; infrared views
  view_id INTEGER PRIMARY KEY REFERENCES view(id),
  plane_rms_m REAL,
  valid_share REAL,
  frames INTEGER NOT NULL,
  image_file TEXT NOT NULL,           -- 16-bit PNG; empty: none kept
  image_sha256 TEXT NOT NULL
);
CREATE TABLE corner_depth (
  view_id INTEGER NOT NULL REFERENCES view(id),
  id INTEGER NOT NULL,                -- index of the board's inner corner
  depth_m REAL,
  pixels INTEGER NOT NULL,
  PRIMARY KEY (view_id, id)
) WITHOUT ROWID;
CREATE TABLE depth_patch (
  id INTEGER PRIMARY KEY,
  view_id INTEGER NOT NULL REFERENCES view(id),
  u_px REAL, v_px REAL,
  depth_m REAL, sigma_m REAL,
  pixels INTEGER NOT NULL
);
CREATE INDEX patch_of_view ON depth_patch(view_id);
)sql";

/// From version 3 to 4.
constexpr const char* kAddHashes = R"sql(
ALTER TABLE view ADD COLUMN image_sha256 TEXT NOT NULL DEFAULT '';
ALTER TABLE depth ADD COLUMN image_sha256 TEXT NOT NULL DEFAULT '';
)sql";

}  // namespace servocal::session
