// SPDX-License-Identifier: GPL-3.0-or-later
// One function per format, one file per family. All share a signature, and Export says how it ended.
#pragma once

#include "servocal/report/export.h"

namespace servocal::report {

using Exporter = Export (*)(const CalibrationResult&, const ExportOptions&);

// ros_files.cpp
Export exportRosCameraInfo(const CalibrationResult& result, const ExportOptions& options);
Export exportEasyHandEye2(const CalibrationResult& result, const ExportOptions& options);
// frame_files.cpp
Export exportRos2StaticTf(const CalibrationResult& result, const ExportOptions& options);
Export exportUrdf(const CalibrationResult& result, const ExportOptions& options);
// opencv_files.cpp
Export exportOpenCv(const CalibrationResult& result, const ExportOptions& options);
Export exportIaiKinect2(const CalibrationResult& result, const ExportOptions& options);
// visp_files.cpp
Export exportVisp(const CalibrationResult& result, const ExportOptions& options);
// rig_files.cpp
Export exportKalibr(const CalibrationResult& result, const ExportOptions& options);
Export exportMrcal(const CalibrationResult& result, const ExportOptions& options);
Export exportColmap(const CalibrationResult& result, const ExportOptions& options);

inline Export refused(std::string reason) { return {ExportStatus::kRefused, std::move(reason), {}, {}}; }
inline Export complete() { return {ExportStatus::kComplete, "", {}, {}}; }

}  // namespace servocal::report
