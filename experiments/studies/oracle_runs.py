# SPDX-License-Identifier: BSD-3-Clause
"""Runs of mgsfm_oracle_benchmark: a simulated drive, mapped, and compared with
the oracles of bench/oracle/oracle.h."""
import json
import subprocess


class OracleRun:
    """One run, as the benchmark wrote it."""

    def __init__(self, values):
        self.values = values

    @property
    def name(self):
        return self.values.get("name", "")

    @property
    def has_model(self):
        return "mapper" in self.values

    @property
    def rig(self):
        return self.setting("rig")

    @property
    def num_images(self):
        return self.values["input"]["num_images"]

    @property
    def num_registered(self):
        return self.values["mapper"]["num_registered"] if self.has_model else 0

    @property
    def registered_percent(self):
        return 100.0 * self.num_registered / max(1, self.num_images)

    def setting(self, option):
        """The value of an option of the simulation."""
        return self.values["options"]["Simulation"][option]

    def mean_error(self, who, kind):
        """The mean over images, of "mapper", "oracle" or "full_oracle"; kind is
        position_m or rotation_deg. Only with a model."""
        return self.values[who][kind]["mean"]


def read_runs(folder):
    """All runs in a folder, by name."""
    if not folder.is_dir():
        raise SystemExit(f"{folder} is not a folder")
    runs = [read_run(path) for path in folder.glob("*.json")]
    if not runs:
        raise SystemExit(f"no run in {folder}")
    return sorted(runs, key=lambda run: run.name)


def read_run(path):
    """One run; ends with one line if the file is none."""
    try:
        values = json.loads(path.read_text())
    except json.JSONDecodeError:
        values = {}
    if "options" not in values:
        raise SystemExit(f"{path} is not a run of mgsfm_oracle_benchmark")
    return OracleRun(values)


def run_once(program, path, name, options):
    """Runs the benchmark unless `path` exists."""
    if path.exists():
        return
    done = subprocess.run(
        list(map(str, [program, "--name", name, "--json_path", path,
                       "--log_level", "error", *options])), check=False)
    # Exit code 2, nothing reconstructed, is a result, too.
    if done.returncode not in (0, 2):
        raise subprocess.CalledProcessError(done.returncode, done.args)
