#!/usr/bin/env python3
# SPDX-License-Identifier: GPL-3.0-or-later
"""Checks who includes whom. The tables below are docs/architecture.md's, closed: what is not allowed is
refused. Prints one line per offence, file:line: sentence, and ends with 1 if there is any.

usage: check_layers.py ROOT
"""

import pathlib
import re
import sys

# Modules that a module may include, itself aside.
MODULES = {
    "core": set(),
    "board": {"core"},
    "sensor": {"core"},
    "sensor_usb": {"core"},
    "sensor_openni2": {"core", "sensor", "sensor_usb"},
    "sensor_freenect": {"core", "sensor", "sensor_usb"},
    "sensor_v4l2": {"core", "sensor"},
    "robot": {"core"},
    "robot_ur": {"core", "robot"},
    "coverage": {"core"},
    "calib": {"core"},
    "session": {"core"},
    "servo": {"core", "robot", "coverage"},
    "plan": {"core", "coverage", "calib", "robot"},
    "sim": {"core", "board", "robot", "sensor"},
    "sim_openni2_driver": {"core", "sensor"},  # serves any camera; knows no simulator
    "sim_ur_controller": set(),  # uses sim's own ur5.h and nothing of the driver it is there to test
    "sim_ur_cell": {"core", "sim", "sim_ur_controller"},
    "report": {"core", "calib", "robot", "session"},
    "ros2": {"core", "sensor", "robot", "board"},
    "procedure": {"core", "board", "sensor", "robot", "coverage", "calib", "session", "servo", "plan"},
    "live": {"core", "procedure", "sensor"},
    "app": {"core"},
    "app_arm": {"core", "robot", "robot_ur", "servo", "sim", "sim_ur_cell"},
    "app_dry_run": {"core", "coverage", "plan", "robot"},
    "app_cameras": {  # all drivers
        "core", "sensor", "sensor_openni2", "sensor_freenect", "sensor_v4l2", "sim", "sim_openni2_driver"},
}

# The one header of core that knows ViSP; its own target, core_visp.
VISP_HEADER = "servocal/core/visp.h"
MAY_USE_CORE_VISP = {"servo"}

# Third-party library -> how its headers begin.
LIBRARIES = {
    "Eigen": ("Eigen/",),
    "ViSP": ("visp3/",),
    "OpenCV": ("opencv2/",),
    "yaml-cpp": ("yaml-cpp/",),
    "SQLite": ("sqlite3.h",),
    "OpenSSL": ("openssl/",),
    "nlohmann-json": ("nlohmann/",),
    "Ceres": ("ceres/",),
    "KDL": ("kdl/",),
    "urdfdom": ("urdf_parser/", "urdf_model/"),
    "OMPL": ("ompl/",),
    "FCL": ("fcl/",),
    "AprilTag": ("apriltag/",),
    "Cairo": ("cairo/", "cairo.h", "cairo-pdf.h"),
    "OpenNI2": ("OpenNI.h", "Driver/Oni"),
    "libfreenect": ("libfreenect",),
    "libusb": ("libusb",),
    "CLI11": ("CLI/",),
    "httplib": ("httplib.h",),
    "Cyclone DDS": ("dds/",),
}

# Libraries a module may use in its sources, beside Eigen, which all may.
IN_SOURCES = {
    "core": {"yaml-cpp"},
    "board": {"OpenCV", "AprilTag", "Cairo"},
    "sensor": {"OpenCV"},
    "sensor_usb": {"libusb"},
    "sensor_openni2": {"OpenCV", "OpenNI2"},
    "sensor_freenect": {"OpenCV", "libfreenect"},
    "sensor_v4l2": {"OpenCV"},
    "robot": {"KDL", "urdfdom", "OMPL", "FCL"},
    "calib": {"OpenCV", "Ceres"},
    "session": {"OpenCV", "SQLite", "nlohmann-json", "OpenSSL"},  # OpenSSL: SHA-256
    "servo": {"ViSP"},
    "sim": {"OpenCV", "urdfdom"},
    "sim_openni2_driver": {"OpenCV", "OpenNI2"},
    "report": {"nlohmann-json", "OpenCV"},  # OpenCV: a session's images, drawn over each other
    "ros2": {"Cyclone DDS", "OpenCV"},
    "live": {"httplib", "nlohmann-json", "OpenCV"},  # OpenCV: JPEGs
    "procedure": {"OpenCV"},  # images pass through on their way to the session
    "app": {"CLI11"},
}

# Libraries a module may show in its public headers, beside Eigen. A short list on purpose.
IN_HEADERS = {
    "board": {"OpenCV"},
    "sensor": {"OpenCV"},
    "session": {"OpenCV"},
    "sim": {"OpenCV"},
    "procedure": set(),
    "app": {"CLI11"},
}

# POSIX; everything else in angle brackets without a folder or an ending is the standard library.
POSIX = re.compile(
    r"^(sys/\w+|unistd|fcntl|glob|poll|signal|stdlib|termios|pthread|dlfcn|netdb|netinet/\w+|arpa/inet)"
    r"\.h$")
INCLUDE = re.compile(r'^\s*#\s*include\s*([<"])([^">]+)[">]')


def library_of(header):
    for library, beginnings in LIBRARIES.items():
        if header.startswith(beginnings):
            return library
    return None


def check_include(module, is_public, header, bracket):
    """The sentence against an include, or None."""
    if header.startswith("servocal/"):
        other = header.split("/")[1]
        if header == VISP_HEADER:
            if module in MAY_USE_CORE_VISP:
                return None
            return f"module '{module}' may not include {header} (ViSP)"
        if other != module and other not in MODULES[module]:
            return f"module '{module}' may not include module '{other}'"
        return None
    if bracket == '"':
        return f"'{header}' leaves the module's own folder" if ".." in header else None
    library = library_of(header)
    if library is None:
        if re.fullmatch(r"[a-z0-9_]+", header) or POSIX.match(header):
            return None
        return f"'{header}' belongs to no library the house knows"
    if library == "Eigen":
        return None
    if is_public:
        if library not in IN_HEADERS.get(module, set()):
            return f"{library} ('{header}') may not show in a public header of module '{module}'"
    elif library not in IN_SOURCES.get(module, set()):
        return f"module '{module}' may not use {library} ('{header}')"
    return None


def check_file(root, module, folder, path):
    is_public = "include" in path.relative_to(folder).parts
    is_visp_header = path.as_posix().endswith("include/" + VISP_HEADER)
    for number, line in enumerate(path.read_text(encoding="utf-8").splitlines(), start=1):
        match = INCLUDE.match(line)
        if not match:
            continue
        bracket, header = match.groups()
        if is_visp_header and library_of(header) == "ViSP":
            continue
        offence = check_include(module, is_public, header, bracket)
        if offence:
            yield f"{path.relative_to(root)}:{number}: {offence}"


def targets_of(root):
    """Name and folder of every module, and of every target inside one: a folder modules/<m>/<t> with a
    CMakeLists.txt of its own is the target <m>_<t>."""
    for folder in sorted((root / "modules").iterdir()):
        if not folder.is_dir():
            continue
        yield folder.name, folder
        for inner in sorted(folder.iterdir()):
            if (inner / "CMakeLists.txt").exists():
                yield f"{folder.name}_{inner.name}", inner


def check(root):
    """All offences of a source tree."""
    offences = []
    targets = list(targets_of(root))
    folders = {folder for _, folder in targets}
    for module, folder in targets:
        if module not in MODULES:
            offences.append(f"{folder.relative_to(root)}: the house has no module '{module}'; see "
                            "docs/architecture.md")
            continue
        files = sorted(p for p in folder.rglob("*") if p.suffix in {".h", ".hpp", ".cpp", ".in"})
        files = [p for p in files if not any(q in folders and q != folder and folder in q.parents for q in p.parents)]
        for path in files:
            offences += check_file(root, module, folder, path)
        declaration = folder / "CMakeLists.txt"
        declared = declaration.read_text(encoding="utf-8") if declaration.exists() else None
        for header in sorted((folder / "include").rglob("*.h")):
            if declared is not None and header.name not in declared:
                offences.append(f"{header.relative_to(root)}: not declared in "
                                f"{declaration.relative_to(root)}, so nobody checks that it compiles alone")
    return offences


def main():
    if len(sys.argv) != 2:
        print(__doc__.strip().splitlines()[-1], file=sys.stderr)
        return 2
    root = pathlib.Path(sys.argv[1]).resolve()
    offences = check(root)
    for offence in offences:
        print(offence)
    return 1 if offences else 0


if __name__ == "__main__":
    sys.exit(main())
