# SPDX-License-Identifier: BSD-3-Clause
"""The steps of a use case; finished steps are reused."""
import dataclasses
import json
import os
import pathlib
import subprocess


@dataclasses.dataclass(frozen=True)
class Workbench:
    """Runs mgsfm in a folder of results."""

    program: pathlib.Path
    output: pathlib.Path
    data: pathlib.Path  # with recorded data

    def run(self, *command, environment=None):
        """Runs a command of mgsfm; its output appears only if it fails."""
        done = subprocess.run(
            list(map(str, [self.program, *command])), text=True, check=False,
            stdout=subprocess.PIPE, stderr=subprocess.STDOUT,
            env={**os.environ, **(environment or {})})
        if done.returncode != 0:
            print(done.stdout, end="")
            raise subprocess.CalledProcessError(done.returncode, done.args)

    def simulate(self, name, *options):
        """Simulates a drive; returns its folder."""
        folder = self.output / name
        if not (folder / "database.db").exists():
            self.run("simulate", "--output_path", folder,
                     "--log_level", "error", *options)
        return folder

    def map(self, name, database, *options, environment=None):
        """Maps a database; returns the folder of models."""
        folder = self.output / name
        if not (folder / "report.json").exists():
            self.run("mapper", "--database_path", database, "--output_path",
                     folder, "--log_level", "error", *options,
                     environment=environment)
        return folder

    def report(self, name):
        """The report of map()."""
        return json.loads((self.output / name / "report.json").read_text())

    def errors(self, name, *options, model="0"):
        """The errors of a model of map(), as model_evaluator reports them."""
        path = self.output / name / "evaluation.json"
        self.run("model_evaluator", "--input_path", self.output / name / model,
                 "--json", path, *options)
        return json.loads(path.read_text())

    def recorded(self, name):
        """A folder of recorded data, or None if it is absent."""
        return self.data / name if (self.data / name).is_dir() else None


def position(errors, digits=2):
    """The mean position error."""
    return f"{errors['position_m']['mean']:.{digits}f} m"


def registered_and_position(errors, digits):
    """Registered images, and their mean position error."""
    return (f"{errors['num_registered']} of {errors['num_images']}, "
            + position(errors, digits))


def reprojection(report):
    """The mean reprojection error of the first model."""
    return f"{report['models'][0]['mean_reprojection_error_px']:.3f} px"


def kitti_truth(kitti):
    """Options of model_evaluator for kitti06_stereo."""
    return ["--gt_path", kitti / "gt_poses.txt", "--gt_format", "kitti",
            "--calib_path", kitti / "calib.txt"]
