#!/usr/bin/env python3
# SPDX-License-Identifier: GPL-3.0-or-later
"""Negative controls of cmake/check_layers.py: each planted offence is found, and named by file and line."""

import pathlib
import sys
import tempfile
import unittest

sys.path.insert(0, str(pathlib.Path(__file__).resolve().parents[2] / "cmake"))
import check_layers  # noqa: E402


class PlantedOffences(unittest.TestCase):
    def offences(self, files):
        with tempfile.TemporaryDirectory() as folder:
            root = pathlib.Path(folder)
            for name, text in files.items():
                path = root / "modules" / name
                path.parent.mkdir(parents=True, exist_ok=True)
                path.write_text(text)
            return check_layers.check(root)

    def expect_one(self, name, text, part):
        found = self.offences({name: text})
        self.assertEqual(len(found), 1, found)
        self.assertIn(part, found[0])
        self.assertTrue(found[0].startswith("modules/" + name), found[0])

    def test_a_clean_tree_passes(self):
        self.assertEqual(self.offences({
            "servo/src/a.cpp": '#include <vector>\n#include <unistd.h>\n#include <visp3/vs/vpServo.h>\n'
                               '#include "servocal/core/visp.h"\n'
                               '#include "servocal/robot/guard.h"\n#include "a.h"\n',
            "core/src/b.cpp": "#include <yaml-cpp/yaml.h>\n#include <Eigen/Core>\n",
        }), [])

    def test_upward_and_sideways_includes(self):
        self.expect_one("core/src/a.cpp", '\n#include "servocal/board/detector.h"\n',
                        ":2: module 'core' may not include module 'board'")
        self.expect_one("calib/src/a.cpp", '#include "servocal/board/detector.h"\n',
                        "may not include module 'board'")
        self.expect_one("servo/src/a.cpp", '#include "servocal/calib/hand_eye.h"\n',
                        "may not include module 'calib'")
        self.expect_one("coverage/src/a.cpp", '#include "servocal/robot/arm.h"\n',
                        "may not include module 'robot'")

    def test_third_party_in_the_wrong_place(self):
        self.expect_one("calib/src/a.cpp", "#include <visp3/core/vpColVector.h>\n", "may not use ViSP")
        self.expect_one("robot/src/a.cpp", '#include "servocal/core/visp.h"\n', "(ViSP)")
        self.expect_one("core/src/a.cpp", "#include <opencv2/core.hpp>\n", "may not use OpenCV")
        self.expect_one("core/include/servocal/core/a.h", "#include <yaml-cpp/yaml.h>\n",
                        "may not show in a public header")
        self.expect_one("session/src/a.cpp", "#include <yaml-cpp/yaml.h>\n", "may not use yaml-cpp")
        self.expect_one("session/include/servocal/session/a.h", "#include <sqlite3.h>\n",
                        "may not show in a public header")
        self.expect_one("board/src/a.cpp", "#include <sqlite3.h>\n", "may not use SQLite")
        self.expect_one("plan/src/a.cpp", "#  include <boost/any.hpp>\n", "belongs to no library")

    def test_ways_around_the_table(self):
        self.expect_one("calib/src/a.cpp", '#include "../../board/src/grid.h"\n',
                        "leaves the module's own folder")
        found = self.offences({"misc/src/a.cpp": ""})
        self.assertEqual(len(found), 1)
        self.assertIn("no module 'misc'", found[0])

    def test_targets_inside_a_module(self):
        self.assertEqual(self.offences({"robot/ur/CMakeLists.txt": "",
                                        "robot/ur/src/a.cpp": '#include "servocal/robot/arm.h"\n'}), [])
        found = self.offences({"robot/ur/CMakeLists.txt": "",
                               "robot/ur/src/a.cpp": "#include <kdl/chain.hpp>\n"})
        self.assertEqual(len(found), 1, found)
        self.assertIn("module 'robot_ur' may not use KDL", found[0])
        found = self.offences({"sim/ur_controller/CMakeLists.txt": "",
                               "sim/ur_controller/src/a.cpp": '#include "servocal/robot_ur/arm.h"\n'})
        self.assertEqual(len(found), 1, found)
        self.assertIn("module 'sim_ur_controller' may not include module 'robot_ur'", found[0])
        found = self.offences({"robot/new/CMakeLists.txt": ""})
        self.assertEqual(len(found), 1, found)
        self.assertIn("no module 'robot_new'", found[0])

    def test_headers_that_nobody_declares(self):
        found = self.offences({"core/CMakeLists.txt": "PUBLIC_HEADERS a.h",
                               "core/include/servocal/core/a.h": "",
                               "core/include/servocal/core/forgotten.h": ""})
        self.assertEqual(len(found), 1)
        self.assertIn("forgotten.h: not declared", found[0])


if __name__ == "__main__":
    unittest.main()
