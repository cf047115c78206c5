# SPDX-License-Identifier: BSD-3-Clause
"""Measures whole mapper runs, from the database to the model on disk."""
import json
import pathlib
import shutil
import tempfile

from experiments.measure import run_measured, stages_of
from experiments.peers import KNOWN, environment
from experiments.sequence import FIXED_INTRINSICS

# Rig and number of frames of each simulated drive.
SIMULATED = (("mono", 200), ("stereo", 200), ("kitti360", 100), ("cube6", 60))


class Bench:
    """Runs cases, and writes FOLDER/NAME.json of each: wall and processor
    seconds and peak memory of the process and of each stage, and errors."""

    def __init__(self, program, threads, num_runs, folder, scratch):
        self.program = program
        self.threads = threads
        self.num_runs = num_runs
        self.folder = folder
        self.scratch = scratch

    def command(self, name, *options):
        """The command line of a command of mgsfm."""
        return [self.program, name, "--log_level", "warning",
                "--num_threads", self.threads, *options]

    def errors(self, model, truth):
        """Errors of images; truth: options of model_evaluator."""
        if not truth:
            return {}
        path = self.scratch / "errors.json"
        run_measured(self.command("model_evaluator", "--input_path", model,
                                  "--json", path, *truth))
        errors = json.loads(path.read_text())
        return {key: errors[key]
                for key in ("num_registered", "position_m", "rotation_deg")}

    def write(self, name, case):
        """Prints a case and writes its file."""
        print(f"{name:24} {case['seconds']:8.2f} s "
              f"{case['processor_seconds']:8.2f} s on processors "
              f"{case['peak_memory_mib']:6.0f} MiB", end="")
        position = case.get("position_m")
        print(f"  position {position['mean']:.4f} m" if position else "",
              flush=True)
        case["name"] = name
        (self.folder / f"{name}.json").write_text(json.dumps(case, indent=2))
        return case

    def map(self, name, database, truth=(), options=()):
        """The fastest of several runs, because others may use the machine."""
        best = None
        for _ in range(self.num_runs):
            model = self.scratch / name
            measured = run_measured(self.command(
                "mapper", "--database_path", database, "--output_path", model,
                *options))
            if best and measured["seconds"] >= best["seconds"]:
                continue
            best = measured
            report = json.loads((model / "report.json").read_text())
            best["stages"] = stages_of(report)
            best["num_images"] = report["input"]["num_images"]
            best["num_observations"] = sum(
                m["num_observations"] for m in report["models"])
        best.update(self.errors(model / "0", truth))
        return self.write(name, best)

    def map_by_colmap(self, name, database, images, truth):
        """One run of COLMAP's mapper on a copy of the database."""
        model = self.scratch / name
        model.mkdir()
        copy = shutil.copyfile(database, self.scratch / f"{name}.db")
        measured = run_measured(KNOWN["colmap"].command({
            "database": copy, "output": model, "images": images,
            "threads": self.threads}), environment())
        measured.update(self.errors(model / "0", truth))
        return self.write(name, measured)

    def simulate(self, name, rig, num_frames):
        """Simulates and maps a drive; its files are removed."""
        folder = self.scratch / f"input_{name}"
        run_measured(self.command(
            "simulate", "--output_path", folder, "--preset", "standard",
            "--rig", rig, "--num_frames", num_frames))
        self.map(name, folder / "database.db",
                 ["--gt_path", folder / "truth"])
        shutil.rmtree(folder)


def run_all(program, threads, num_runs, data, folder, with_colmap):
    """All cases whose data exist; one JSON file each in `folder`."""
    with tempfile.TemporaryDirectory() as scratch:
        bench = Bench(program, threads, num_runs, folder, pathlib.Path(scratch))
        kitti = data / "kitti06_stereo"
        truth = ["--gt_path", kitti / "gt_poses.txt", "--gt_format", "kitti"]
        if kitti.exists():
            bench.map("kitti06_stereo", kitti / "database.db", truth,
                      FIXED_INTRINSICS)
        if kitti.exists() and with_colmap:
            compare_with_colmap(bench, kitti, truth)
        euroc = data / "euroc_v101_stereo"
        if euroc.exists():
            bench.map("euroc_v101_stereo", euroc / "database.db", [],
                      FIXED_INTRINSICS)
        for rig, num_frames in SIMULATED:
            bench.simulate(f"simulated_{rig}", rig, num_frames)


def compare_with_colmap(bench, kitti, truth):
    """Both programs in turn, and the ratios of their costs and errors."""
    database = kitti / "database.db"
    ours = bench.map("kitti06_stereo_again", database, truth, FIXED_INTRINSICS)
    theirs = bench.map_by_colmap("kitti06_stereo_colmap", database,
                                 kitti / "images", truth)
    print("mgsfm / colmap")
    for text, one, other in (
            ("processor seconds", ours["processor_seconds"],
             theirs["processor_seconds"]),
            ("seconds", ours["seconds"], theirs["seconds"]),
            ("position error, mean", ours["position_m"]["mean"],
             theirs["position_m"]["mean"])):
        print(f"  {text}: {one / other:.3f}")
