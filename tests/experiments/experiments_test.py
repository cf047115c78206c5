# SPDX-License-Identifier: BSD-3-Clause
"""Tests the drivers of data sets on small folders of their form.

usage: experiments_test.py PROGRAM
"""
import functools
import json
import math
import pathlib
import subprocess
import sys
import tempfile
import unittest

SCRIPTS = pathlib.Path(__file__).resolve().parents[2] / "scripts"
sys.path.insert(0, str(SCRIPTS))
import experiment_tables  # noqa: E402
import experiments  # noqa: E402
import measuring  # noqa: E402

try:
    import mei_camera
except ImportError:
    mei_camera = None

PROGRAM = sys.argv.pop(1)


def turn(axis, angle):
    """Rotation matrix and quaternion about one of the axes."""
    i, j = (axis + 1) % 3, (axis + 2) % 3
    rows = [[float(r == c) for c in range(3)] for r in range(3)]
    rows[i][i] = rows[j][j] = math.cos(angle)
    rows[j][i], rows[i][j] = math.sin(angle), -math.sin(angle)
    quaternion = [math.cos(angle / 2), 0.0, 0.0, 0.0]
    quaternion[1 + axis] = math.sin(angle / 2)
    return rows, quaternion


class RotationTest(unittest.TestCase):
    def test_quaternions_of_turns(self):
        for axis in range(3):
            for angle in (0.0, 0.3, -1.2, 3.0):
                rows, quaternion = turn(axis, angle)
                found = experiments.rotation_to_quaternion(rows)
                sign = math.copysign(1.0, sum(
                    a * b for a, b in zip(found, quaternion)))
                for a, b in zip(found, quaternion):
                    self.assertAlmostEqual(sign * a, b, places=12)


class TruthTest(unittest.TestCase):
    def test_positions_are_those_of_the_cameras(self):
        def pose(angle, position):
            rows, _ = turn(1, angle)
            return [row + [p] for row, p in zip(rows, position)] + [
                [0.0, 0.0, 0.0, 1.0]]
        with tempfile.TemporaryDirectory() as folder:
            folder = pathlib.Path(folder)
            experiments.write_truth(
                folder, ["a PINHOLE 4 4 1 1 2 2", "b PINHOLE 4 4 1 1 2 2"],
                {"a": pose(0.0, [0, 0, 0]), "b": pose(0.5, [1, 0, 0])},
                {"1.png": pose(math.pi / 2, [3, 4, 5])})
            positions = experiments.read_positions(folder)
        expected = {"a/1.png": (3, 4, 5), "b/1.png": (3, 4, 4)}
        for name, position in expected.items():
            for a, b in zip(positions[name], position):
                self.assertAlmostEqual(a, b, places=12)


class MeasuringTest(unittest.TestCase):
    def measure(self, script, time_limit=0):
        with tempfile.TemporaryDirectory() as folder:
            return measuring.run_logged(["sh", "-c", script],
                                        pathlib.Path(folder) / "log",
                                        time_limit)

    def test_who_ended_a_run(self):
        self.assertTrue(measuring.was_killed(self.measure("kill -9 $$")))
        self.assertTrue(measuring.was_killed(self.measure("kill -15 $$")))
        self.assertFalse(measuring.was_killed(self.measure("kill -11 $$")))
        self.assertFalse(measuring.was_killed(self.measure("exit 9")))
        self.assertFalse(measuring.was_killed(self.measure("true")))
        stopped = self.measure("sleep 100", 0.1)
        self.assertTrue(stopped["is_stopped"])
        self.assertFalse(measuring.was_killed(stopped))


class TableTest(unittest.TestCase):
    def test_all_formats_have_the_cells(self):
        table = experiment_tables.Table("name", "A title", ["sequence", "m_1"],
                                        2)
        table.rows = [["00", 1.234], ["01", None]]
        for text in (table.text(), table.markdown(), table.csv(),
                     table.latex()):
            self.assertIn("1.23", text)
            self.assertIn(experiment_tables.MISSING, text)
        self.assertIn(r"m\_1", table.latex())

    def test_seeds_are_compared_run_by_run(self):
        found = {"ours": (1.0, 2.0, 4.0, 5.0), "other": (2.0, 2.0, 8.0, None)}
        records = {
            (f"hard_{seed}", method):
                {"errors": {"position_m": {"mean": value}} if value else None}
            for method, values in found.items()
            for seed, value in enumerate(values)}
        errors, ratios = experiment_tables.over_seeds(
            records, {"hard": [f"hard_{seed}" for seed in range(4)]},
            ["ours", "other"])
        # A run without result has no part in it.
        self.assertEqual(errors.rows[0][:2], ["hard", "3"])
        self.assertAlmostEqual(errors.rows[0][2], 2.0)
        self.assertAlmostEqual(errors.rows[0][3], 32.0 ** (1.0 / 3.0))
        # Ratios 2, 1 and 2: logarithms of deviation log(2) / sqrt(3).
        mean = 2.0 ** (2.0 / 3.0)
        self.assertEqual(
            ratios.rows[0],
            ["hard", "3", "lowest 3 times",
             f"{mean:.3f} +- {mean * math.log(2.0) / 3.0:.3f}"])


@unittest.skipIf(mei_camera is None, "numpy is not installed")
class MeiCameraTest(unittest.TestCase):
    def test_fit_is_close(self):
        mei = {"xi": 2.2, "k1": 0.02, "k2": 1.6, "p1": 0.0, "p2": 0.0,
               "gamma1": 1300.0, "gamma2": 1300.0, "u0": 700.0, "v0": 690.0}
        params, rms, largest = mei_camera.fit_fisheye(mei)
        self.assertLess(rms, 0.1)
        self.assertLess(largest, 0.5)
        self.assertAlmostEqual(params[0], params[1], places=6)


class KittiOdometryTest(unittest.TestCase):
    METHODS = ("mgsfm,mma,hybrid_bilinear,hybrid_non_bilinear,"
               "hybrid_bilinear_averaged")

    def run_driver(self, tree, work, *options):
        done = self.try_driver(tree, work, *options)
        self.assertEqual(done.returncode, 0, done.stdout + done.stderr)
        return done.stdout

    def try_driver(self, tree, work, *options):
        return subprocess.run(
            [sys.executable, "-B", SCRIPTS / "kitti_odometry.py", tree,
             "--methods", self.METHODS, "--work", work, "--program", PROGRAM,
             "--threads", "2", "--no_pictures", *options],
            capture_output=True, text=True, check=False)

    def simulate(self, folder):
        subprocess.run(
            [PROGRAM, "simulate", "--log_level", "warning", "--output_path",
             folder, "--num_frames", "12", "--pixel_noise", "0.3"], check=True)

    def test_tables_and_resuming(self):
        with tempfile.TemporaryDirectory() as folder:
            folder = pathlib.Path(folder)
            self.simulate(folder / "tree" / "sequences" / "00")
            nothing = self.try_driver(folder / "tree", folder / "work",
                                      "--only_done")
            first = self.run_driver(folder / "tree", folder / "work")
            records = {p.name: p.stat().st_mtime_ns
                       for p in (folder / "work" / "00").glob("*.json")}
            second = self.run_driver(folder / "tree", folder / "work")
            self.assertEqual(records, {
                p.name: p.stat().st_mtime_ns
                for p in (folder / "work" / "00").glob("*.json")})
            tables = json.loads(
                (folder / "work" / "tables.json").read_text())
            for suffix in ("txt", "md", "csv", "tex"):
                self.assertTrue(
                    (folder / "work" / f"tables.{suffix}").exists())
        self.assertIn("nothing is done", nothing.stderr)
        self.assertIn("24 of 24", first)
        self.assertIn("Position error", second)
        # Our method is one of the ablation and not run twice.
        self.assertEqual(
            [record["method"] for record in tables["records"]],
            ["mgsfm", "mma", "hybrid_bilinear", "hybrid_bilinear_averaged"])
        rows = {table["name"]: dict(zip(table["header"], table["rows"][0]))
                for table in tables["tables"]}
        self.assertEqual(rows["ablation"]["hybrid_non_bilinear"],
                         rows["position_error"]["mgsfm"])
        # Of a short drive bundle adjustment leaves less.
        mean = {record["method"]: record["errors"]["position_m"]["mean"]
                for record in tables["records"]}
        self.assertLess(mean["hybrid_bilinear"],
                        mean["hybrid_bilinear_averaged"])
        for record in tables["records"]:
            self.assertEqual(record["exit_code"], 0)
            self.assertEqual(record["errors"]["num_registered"], 24)
            self.assertLess(record["errors"]["position_m"]["mean"], 0.1)
            self.assertGreater(record["seconds_counted"], 0.0)

    def test_what_fails_leaves_no_record(self):
        with tempfile.TemporaryDirectory() as folder:
            folder = pathlib.Path(folder)
            sequences = folder / "tree" / "sequences"
            for name in ("00", "01"):
                self.simulate(sequences / name)
            # What a stopped simulation leaves.
            (sequences / ".02.mgsfm-part").mkdir()
            (sequences / "00" / "truth").rename(folder / "truth")
            call = functools.partial(self.try_driver, folder / "tree",
                                     folder / "work", "--methods", "mgsfm")
            wrong = call("--mapper_options=--Mapper.no_such_option 1")
            self.assertEqual([], list(folder.glob("work/*/*.json")))
            stopped = call("--sequences", "01", "--time_limit", "0.001")
            self.assertIn("time limit", stopped.stdout)
            without_truth = call()
            (folder / "truth").rename(sequences / "00" / "truth")
            whole = call()
            other = call("--mapper_options=--random_seed 3")
        self.assertIn("no_such_option", wrong.stdout)
        self.assertIn("2 of the runs failed", wrong.stderr)
        # 01 was run though 00 could not be evaluated.
        self.assertEqual(without_truth.returncode, 1)
        self.assertEqual(without_truth.stdout.count("24 of 24"), 1)
        self.assertIn("1 of the runs failed", without_truth.stderr)
        self.assertEqual(whole.returncode, 0)
        # Only the evaluation was missing.
        self.assertEqual(whole.stdout.count("24 of 24"), 1)
        self.assertEqual(other.returncode, 1)
        self.assertIn("other options", other.stdout)


class HardestSettingsTest(unittest.TestCase):
    def test_a_short_drive_over_two_seeds(self):
        with tempfile.TemporaryDirectory() as folder:
            folder = pathlib.Path(folder)
            (folder / "kitti_trajectories").mkdir()
            poses = (f"1 0 0 {0.1 * math.sin(i)} 0 1 0 0 0 0 1 {1.0 * i}"
                     for i in range(24))
            (folder / "kitti_trajectories" / "03.txt").write_text(
                "".join(f"{pose}\n" for pose in poses))
            text = subprocess.run(
                [SCRIPTS / "hardest_settings.sh", folder, "--sequences",
                 "kitti360_03", "--seeds", "2", "--methods", "mgsfm,mma",
                 "--work", folder / "work", "--program", PROGRAM,
                 "--threads", "2"],
                capture_output=True, text=True,
                check=True).stdout
            tables = json.loads(
                (folder / "work" / "hardest_settings.json").read_text())
        # Every second pose, four cameras.
        self.assertEqual(text.count("48 of 48"), 4)
        rows = {table["name"]: table["rows"] for table in tables["tables"]}
        ((*setting, ours, mma),) = rows["errors_over_seeds"]
        self.assertEqual(setting, ["kitti360_03", "2"])
        self.assertLess(max(ours, mma), 0.2)
        self.assertEqual(len(rows["ratios_over_seeds"]), 1)


if __name__ == "__main__":
    unittest.main()
