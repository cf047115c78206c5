# SPDX-License-Identifier: BSD-3-Clause
"""The numbers of growth, robustness and the table of oracles."""
import json

import pytest

from experiments.studies import (growth_numbers, oracle_runs, oracle_table,
                                 robustness, sub_maps)


def report_of(num_images, tracks_s, total_memory_mib, num_observations):
    """A report of the mapper with one model."""
    def costs(stage, seconds, memory):
        return {"seconds": {stage: seconds},
                "processor_seconds": {stage: 2.0 * seconds},
                "peak_memory_mib_after": {stage: memory}}
    return {"input": {"num_images": num_images},
            **costs("reading", 1.0, 10.0), "peak_memory_mib": total_memory_mib,
            "models": [{"num_images": num_images - 1,
                        "tracks": {"num_observations": num_observations},
                        **costs("tracks", tracks_s, 20.0)}]}


def growth_runs():
    """Tracks take c n^1.5, memory grows with n^0.5, reading not at all."""
    return [growth_numbers.make_run(report_of(
        n, 0.001 * n ** 1.5, 3.0 * n ** 0.5, 10.0 * n))
            for n in (100, 400, 900)]


def test_exponents_of_power_laws():
    runs = growth_runs()
    for stage, kind, exponent in (
            ("tracks", "seconds", 1.5), ("tracks", "processor_seconds", 1.5),
            ("reading", "seconds", 0.0),
            (growth_numbers.TOTAL, "peak_memory_mib", 0.5)):
        assert growth_numbers.fit_exponent(
            runs, stage, kind) == pytest.approx(exponent, abs=1e-12)


def test_no_exponent_without_two_sizes():
    runs = growth_runs()
    assert growth_numbers.fit_exponent(runs[:1], "tracks", "seconds") is None
    assert growth_numbers.fit_exponent(runs[:1] * 2, "tracks",
                                       "seconds") is None
    assert growth_numbers.fit_exponent(runs, "no stage", "seconds") is None


def test_growth_tables():
    runs = growth_runs()[:2]
    lines = growth_numbers.runs_table(runs).splitlines()
    assert lines[2] == "| 100 | 99 | 1000 | 2.0 s | 4.0 s | 30 MiB |"
    assert lines[3] == "| 400 | 399 | 4000 | 9.0 s | 18.0 s | 60 MiB |"
    # log(9 / 2) / log(4).
    assert lines[4] == "| exponent | | | 1.08 | 1.08 | 0.50 |".replace(
        "| | |", "|  |  |")
    lines = growth_numbers.stages_table(runs).splitlines()
    assert lines[0] == "| stage | 100 | 400 | exponent of processor time |"
    assert lines[3] == ("| tracks | 1.00 s, 2.00 s, 20 MiB | "
                        "8.00 s, 16.00 s, 20 MiB | 1.50 |")


def test_reports_are_sorted_by_size(tmp_path):
    for n in (1000, 200):
        (tmp_path / f"{n}.json").write_text(json.dumps(
            report_of(n, 1.0, 1.0, n)))
    assert [run.num_images for run in growth_numbers.read_runs(tmp_path)] == [
        200, 1000]
    (tmp_path / "other.json").write_text("{}")
    with pytest.raises(SystemExit, match="other.json is not a report"):
        growth_numbers.read_runs(tmp_path)


def test_growth_of_two_short_drives(run_experiments, try_experiments, program,
                                    tmp_path):
    def call(*options):
        return ("growth", "--output", tmp_path / "out", "--program", program,
                *options)
    out = run_experiments(*call("--sizes", "24,48"))
    assert "48 images are done" in out
    assert "| 24 | 24 |" in out and "| 48 | 48 |" in out
    assert "| bundle adjustment | " in out
    assert sorted(p.name for p in (tmp_path / "out").iterdir()) == [
        "24.json", "48.json"]
    again = run_experiments(*call("--sizes", "48"))
    assert "are done" not in again
    assert out.endswith(again)
    odd = try_experiments(*call("--sizes", "24,25"))
    assert "'25' is not an even number" in odd.stderr


def test_growth_along_a_trajectory(run_experiments, program, tmp_path):
    (tmp_path / "path.txt").write_text("".join(
        f"1 0 0 0 0 1 0 0 0 0 1 {i}\n" for i in range(100)))
    out = run_experiments("growth", "--output", tmp_path / "out", "--program",
                          program, "--sizes", 16, "--trajectory",
                          tmp_path / "path.txt")
    assert "| 16 | 16 |" in out


def sub_map_values():
    """Costs and errors of a drive with two clusters."""
    def job(seconds, mib):
        return {"processor_seconds": seconds, "peak_memory_mib": mib}

    def errors(mean):
        return {"num_registered": 40, "position_m": {"mean": mean}}
    return {"single": job(20.0, 400.0), "cut": job(1.0, 80.0),
            "clusters": [job(8.0, 100.0), job(7.0, 120.0)],
            "join": job(9.0, 300.0), "single_errors": errors(0.02),
            "joined_errors": errors(0.021)}


def test_sub_maps_are_relative_to_the_single_run():
    # 1 + 8 + 7 + 9 s; the larger cluster.
    assert sub_maps.row_of("a", sub_map_values()) == [
        "a", "40", "0.0200 m", "0.0210 m (1.05)", "20.0 s", "25.0 s (1.25)",
        "400 MiB", "80 MiB (0.20)", "120 MiB (0.30)", "300 MiB (0.75)"]


def test_sub_maps_of_a_short_drive(run_experiments, try_experiments, program,
                                   simulate, tmp_path):
    drive = simulate(tmp_path / "drive")

    def call(*words):
        return ("sub_maps", *words, "--num_clusters", 2, "--output",
                tmp_path / "out", "--program", program)
    out = run_experiments(*call(drive))
    assert "| drive | 24 |" in out
    assert [p.name for p in (tmp_path / "out").iterdir()] == ["drive.json"]
    assert len(json.loads((tmp_path / "out/drive.json").read_text())[
        "clusters"]) == 2
    assert run_experiments(*call(drive)) == out
    assert "has no folder truth" in try_experiments(*call(tmp_path)).stderr


def oracle_values(name, x, seed_error=None, rig="stereo"):
    """A run with 20 images; `seed_error`: of the mapper in meters."""
    values = {"name": name, "seconds": {"mapper": 12.3},
              "peak_memory_mib": 45.6, "input": {"num_images": 20},
              "options": {"Simulation": {"rig": rig, "mismatch_ratio": x}}}
    if seed_error is None:
        return values

    def errors(scale):
        return {"position_m": {"mean": scale * seed_error},
                "rotation_deg": {"mean": 0.25}}
    return {**values, "oracle_ratio": 1.25, "full_oracle_ratio": 1.2,
            "mapper": {**errors(1.0), "num_registered": 19, "rig": [
                {"rotation_deg": 0.1, "position_m": 0.01},
                {"rotation_deg": 0.05, "position_m": 0.02}]},
            "oracle": errors(0.8), "full_oracle": errors(0.5)}


def test_oracle_table():
    runs = [oracle_runs.OracleRun(oracle_values("a", 0.1, 0.5)),
            oracle_runs.OracleRun(oracle_values("b", 0.1))]
    lines = oracle_table.report(runs, 1.1, 1.3).splitlines()
    assert lines[2] == (
        "| a | **19 of 20** | 0.5000 m | 0.4000 m | **1.250** | 0.2500 m | "
        "1.200 | 0.2500 deg | 0.1000 deg, 0.0200 m | 12 s | 46 MiB |")
    assert lines[3].startswith("| b | **0 of 20** | ")
    assert lines[3].endswith(" | 12 s | 46 MiB |")
    assert len({line.count("|") for line in lines[:4]}) == 1
    assert lines[5] == ("0 of 2 runs registered all images with ratios of at "
                        "most 1.1 and 1.3.")
    runs[0].values["mapper"]["num_registered"] = 20
    assert "1 of 2 runs" in oracle_table.report(runs, 1.25, 1.3)
    assert "0 of 2 runs" in oracle_table.report(runs, 1.25, 1.1)


def test_curves_are_medians_over_seeds():
    values = [oracle_values(f"s{k}", 0.2, error)
              for k, error in enumerate((0.3, 0.1, 0.2))]
    values += [oracle_values("t0", 0.1, 0.6), oracle_values("t1", 0.1),
               oracle_values("u", 0.1, rig="kitti360")]
    curves = robustness.make_curves(
        [oracle_runs.OracleRun(v) for v in values],
        robustness.SWEEPS["mismatch_ratio"])
    assert list(curves) == ["kitti360", "stereo"]
    assert curves["stereo"]["mapper_m"] == {10.0: 0.6, 20.0: 0.2}
    assert curves["stereo"]["full_oracle_m"] == {10.0: 0.3, 20.0: 0.1}
    # Runs without a model count as no image; half of 95 % and 0 %.
    assert curves["stereo"]["registered_percent"] == {10.0: 47.5, 20.0: 95.0}
    assert curves["kitti360"] == {"mapper_m": {}, "full_oracle_m": {},
                                  "registered_percent": {10.0: 0.0}}


def test_runs_are_read_by_name(tmp_path):
    for name in ("b", "a"):
        (tmp_path / f"{name}_file.json").write_text(
            json.dumps(oracle_values(name, 0.1)))
    assert [run.name for run in oracle_runs.read_runs(tmp_path)] == ["a", "b"]
    (tmp_path / "c.json").write_text("[")
    with pytest.raises(SystemExit, match="c.json is not a run"):
        oracle_runs.read_runs(tmp_path)


def test_oracle_table_of_a_short_drive(run_experiments, oracle_benchmark,
                                       tmp_path):
    (tmp_path / "in").mkdir()
    (tmp_path / "in/03.txt").write_text("".join(
        f"1 0 0 0 0 1 0 0 0 0 1 {i}\n" for i in range(24)))

    def call():
        return run_experiments(
            "oracle_table", tmp_path / "in", "--output", tmp_path / "out",
            "--program", oracle_benchmark)
    out = call()
    # Every second pose; two and four cameras.
    assert "| 03 stereo | 24 of 24 |" in out
    assert "| 03 kitti360 | 48 of 48 |" in out
    table = out[out.index("| run |"):]
    # Finished runs are not repeated.
    assert call() == table
    (run, *_) = oracle_runs.read_runs(tmp_path / "out/standard")
    assert run.rig == "kitti360"
    assert run.setting("mismatch_ratio") > 0
