# SPDX-License-Identifier: BSD-3-Clause
"""Tables and their numbers."""
import json
import math

import pytest

from experiments import paper_tables, tables
from experiments.studies import bench_table


def test_all_formats_have_the_cells():
    table = tables.Table("name", "A title", ["sequence", "m_1"], 2)
    table.rows = [["00", 1.234], ["01", None]]
    for text in (table.text(), table.markdown(), table.csv(), table.latex()):
        assert "1.23" in text
        assert "1.234" not in text
        assert tables.MISSING in text
    assert r"m\_1" in table.latex()
    assert table.json()["rows"][0][1] == 1.234


def test_markdown():
    assert tables.markdown_table(["a", "b"], [["1", "2"]]) == (
        "| a | b |\n|---|---|\n| 1 | 2 |\n")


def test_all_files_are_written(tmp_path, capsys):
    table = tables.Table("name", "A title", ["sequence", "m"], 1)
    table.rows = [["00", 0.5]]
    tables.write([table], tmp_path / "tables", {"title": "A drive"})
    assert "A title" in capsys.readouterr().out
    for suffix in ("txt", "md", "csv", "tex", "json"):
        assert "0.5" in (tmp_path / f"tables.{suffix}").read_text()
    written = json.loads((tmp_path / "tables.json").read_text())
    assert written["title"] == "A drive"


def record_of(mean, **more):
    return {"exit_code": 0, "peak_memory_mib": 100.0, "seconds_counted": 1.5,
            "processor_seconds_counted": 2.5,
            "stages": {"translation averaging": {"processor_seconds": 0.25}},
            "errors": {
                "num_registered": 9, "num_images": 10,
                "position_m": {"median": 0.5 * mean, "mean": mean},
                "rotation_deg": {"median": 1.0, "mean": 2.0},
                "position_auc": [{"threshold": 0.5, "area": 0.25}],
                "sensors": [{"name": "cam1", "rotation_deg": 0.1,
                             "direction_deg": 0.2, "length_m": 0.99,
                             "true_length_m": 1.0}]}, **more}


def test_cells_of_the_paper():
    records = {("00", "ours"): record_of(0.2), ("00", "other"): record_of(0.4),
               ("01", "ours"): {"exit_code": 2, "is_stopped": False},
               ("00", "bilinear"): record_of(0.6),
               ("00", "averaged"): record_of(0.8)}
    rows = {table.name: [dict(zip(table.header, cells))
                         for cells in table.cells()]
            for table in paper_tables.make_tables(
                records, [["ours", "other"], ["bilinear"], ["averaged"]])}
    assert [row["sequence"] for row in rows["position_error"]] == ["00", "01"]
    assert rows["position_error"][0]["ours"] == "0.100 / 0.200"
    assert rows["position_error"][1]["ours"] == tables.MISSING
    assert rows["rotation_error"][0]["other"] == "1.000 / 2.000"
    assert rows["position_auc"][0]["ours @ 0.5 m"] == "25.0"
    assert rows["registered"][0]["ours"] == "9 / 10"
    assert rows["rig_extrinsics"][0]["sequence, camera"] == "00, cam1"
    assert rows["rig_extrinsics"][0]["ours"] == "0.100, 0.200, -1.00"
    assert rows["rig_extrinsics"][0][
        "rotation before bundle adjustment"] == "0.100"
    assert rows["runtime_seconds"][0]["ours"] == "1.50"
    assert rows["runtime_processor_seconds"][0]["ours"] == "2.50"
    assert rows["peak_memory"][0]["ours"] == "100"
    assert rows["peak_memory"][1]["ours"] == tables.MISSING
    assert rows["ablation"][0]["bilinear"] == "0.300 / 0.600"
    assert rows["ablation_averaged"][0]["averaged"] == "0.400 / 0.800"
    assert rows["translation_averaging"][0]["averaged"] == "0.25"


def test_means_and_the_best_of_a_row():
    records = {("00", "ours"): record_of(0.2), ("00", "other"): record_of(0.4),
               ("01", "ours"): record_of(0.3), ("01", "other"): record_of(0.1),
               ("02", "ours"): record_of(0.9),
               ("02", "other"): {"exit_code": 1, "is_stopped": False}}
    found = {table.name: table for table in paper_tables.make_tables(
        records, [["ours", "other"], [], []])}
    errors = found["position_error"]
    assert errors.cells()[-1] == ["mean of 2", "0.125 / 0.250", "0.125 / 0.250"]
    lines = errors.latex().splitlines()
    assert r"00 & \textbf{0.100 / 0.200} & 0.200 / 0.400 \\" in lines
    assert r"01 & 0.150 / 0.300 & \textbf{0.050 / 0.100} \\" in lines
    assert "| 02 | 0.450 / 0.900 | - |" in errors.markdown()
    assert r"\textwidth" in errors.latex()
    # A method without a model has registered nothing.
    assert found["registered"].cells()[2] == ["02", "9 / 10", "0 / 10"]
    assert found["position_auc"].cells()[2][2] == "0.0"
    assert r"\textbf{25.0} & 0.0 \\" in found["position_auc"].latex()
    assert found["registered"].cells()[-1] == ["mean of 3", "9", "6"]
    assert found["runtime_seconds"].cells()[-1] == ["mean of 2", "1.50", "1.50"]


def test_values_of_one_period_are_compared():
    table = tables.Table("name", "title", ["s", "a 1", "a 2", "b 1", "b 2"], 0,
                         max, 2)
    table.rows = [["0", 1, 8, 2, 7]]
    assert table.cells("<{}>") == [["0", "1", "<8>", "<2>", "7"]]


def test_wide_tables_fit_a_page():
    names = [f"a_method_of_a_long_name_{k}" for k in range(9)]
    table = tables.Table("name", "A title", ["sequence", *names], 1)
    table.rows = [["00", *map(float, range(9))]]
    lines = table.text().splitlines()
    assert max(map(len, lines)) <= tables.PAGE_WIDTH
    assert [word for line in lines for word in line.split()
            if word in names] == names
    latex = table.latex()
    assert latex.count(r"\begin{tabular*}{\textwidth}") == latex.count(
        r"sequence &") > 1
    assert latex.count(r"\caption") == 1


def test_seeds_are_compared_run_by_run():
    found = {"ours": (1.0, 2.0, 4.0, 5.0), "other": (2.0, 2.0, 8.0, None)}
    records = {
        (f"hard_{seed}", method):
            {"errors": {"position_m": {"mean": value}} if value else None}
        for method, values in found.items()
        for seed, value in enumerate(values)}
    errors, ratios = paper_tables.over_seeds(
        records, {"hard": [f"hard_{seed}" for seed in range(4)], "none": []},
        ["ours", "other"])
    # A run without result does not count.
    assert errors.rows[0][:2] == ["hard", "3"]
    assert errors.rows[0][2] == pytest.approx(2.0)
    assert errors.rows[0][3] == pytest.approx(32.0 ** (1.0 / 3.0))
    # Ratios 2, 1 and 2: their logarithms have the standard deviation
    # log(2) / sqrt(3).
    mean = 2.0 ** (2.0 / 3.0)
    assert ratios.rows[0] == [
        "hard", "3", "lowest 3 times",
        f"{mean:.3f} +- {mean * math.log(2.0) / 3.0:.3f}"]
    assert errors.rows[1] == ratios.rows[1] == ["none", "0", None, None]


def test_benchmarks_are_compared_by_name():
    def run(seconds, iteration):
        return {"name": "kitti", "seconds": seconds,
                "position_m": {"mean": 0.5},
                "stages": {"tracks": {"seconds": 1.0,
                                      "processor_seconds": 2.0}},
                "solvers": {"native": {"seconds_per_iteration": iteration}}}
    new = [run(3.0, 0.1), {"name": "new one", "seconds": 1.0}]
    lines = bench_table.ratio_lines(new, [run(2.0, 0.2)])
    ratios = {line[25:66].strip(): float(line[66:]) for line in lines}
    assert ratios == {"native, s/iteration": 0.5, "seconds": 1.5,
                      "tracks, processor seconds": 1.0, "position error": 1.0}
    assert bench_table.stage_lines(new) == ["kitti: tracks 1.00"]
