# SPDX-License-Identifier: BSD-3-Clause
"""Tools for models and databases; each writes what the program writes."""

import shutil
import sqlite3
from pathlib import Path

import numpy as np
import pymgsfm
import pytest
from conftest import run_program
from test_commands import read_files

RENDERED = Path(__file__).resolve().parents[2] / "data" / "rendered_rig"


def test_align_model(sparse, drive, tmp_path):
    options = {"ref_model_path": drive / "truth"}
    aligned = pymgsfm.align_model(sparse / "0", tmp_path / "python", options)
    run_program("model_aligner", "--input_path", sparse / "0", "--output_path",
                tmp_path / "program", "--ref_model_path", drive / "truth")
    assert read_files(tmp_path / "program") == read_files(tmp_path / "python")
    truth = pymgsfm.Reconstruction(drive / "truth")
    for image in aligned.images.values():
        true_image = truth.find_image_with_name(image.name)
        assert np.linalg.norm(image.projection_center()
                              - true_image.projection_center()) < 0.1


def test_convert_model(sparse, tmp_path):
    pymgsfm.convert_model(sparse / "0", tmp_path / "a.ply", "ply")
    run_program("model_converter", "--input_path", sparse / "0",
                "--output_path", tmp_path / "b.ply", "--output_type", "ply")
    assert (tmp_path / "a.ply").read_bytes() == (tmp_path / "b.ply").read_bytes()


def test_analyze_model(sparse, model):
    text = pymgsfm.analyze_model(sparse / "0")
    assert text == run_program("model_analyzer", "--path", sparse / "0")
    assert str(model.num_points3D()) in text


def test_crop_model(sparse, model, tmp_path):
    low, high = np.quantile(model.points3D.xyz, [0.1, 0.9], axis=0)
    box = [*low, *high]
    cropped = pymgsfm.crop_model(sparse / "0", tmp_path, box)
    inside = ((model.points3D.xyz >= low) & (model.points3D.xyz <= high))
    assert cropped.num_points3D() == np.count_nonzero(inside.all(axis=1))
    with pytest.raises(pymgsfm.InputError, match="boundary"):
        pymgsfm.crop_model(sparse / "0", tmp_path / "bad", [1.0, 2.0, 3.0])


def test_delete_images_and_merge_models(sparse, model, tmp_path):
    names = sorted({image.name.split("/")[-1]
                    for image in model.images.values()})
    parts = []
    for part, deleted in (("head", names[8:]), ("tail", names[:4])):
        (tmp_path / "list.txt").write_text("".join(
            f"{image.name}\n" for image in model.images.values()
            if image.name.split("/")[-1] in deleted))
        parts.append(pymgsfm.delete_images(
            sparse / "0", tmp_path / part,
            {"image_names_path": tmp_path / "list.txt"}))
    assert [part.num_frames() for part in parts] == [8, 8]
    merged = pymgsfm.merge_models(tmp_path / "head", tmp_path / "tail",
                                  tmp_path / "merged")
    assert merged.num_frames() == 12


def test_databases(drive, tmp_path):
    copy = tmp_path / "copy.db"
    shutil.copy(drive / "database.db", copy)
    pymgsfm.clean_database(copy, "matches")
    with sqlite3.connect(copy) as database:
        assert database.execute(
            "SELECT COUNT(*) FROM two_view_geometries").fetchone() == (0,)
        assert database.execute(
            "SELECT COUNT(*) FROM images").fetchone() == (24,)
    merged = tmp_path / "merged.db"
    pymgsfm.merge_databases(copy, drive / "database.db", merged)
    with sqlite3.connect(merged) as database:
        assert database.execute(
            "SELECT COUNT(*) FROM images").fetchone() == (24,)
    with pytest.raises(pymgsfm.InputError, match="exists already"):
        pymgsfm.merge_databases(copy, drive / "database.db", merged)


def test_undistort(tmp_path):
    truth = pymgsfm.Reconstruction(RENDERED / "truth")
    names = [image.name for image in truth.images.values()
             if not image.name.endswith("000003.jpg")]
    (tmp_path / "list.txt").write_text("\n".join(names) + "\n")
    frame = pymgsfm.delete_images(RENDERED / "truth", tmp_path / "frame",
                                  {"image_names_path": tmp_path / "list.txt"})
    assert frame.num_reg_images() == 4
    pymgsfm.undistort(RENDERED / "images", tmp_path / "frame",
                      tmp_path / "dense", {"output_type": "gaussian_splatting"})
    views = pymgsfm.Reconstruction(tmp_path / "dense" / "sparse" / "0")
    assert views.num_reg_images() > 4
    assert all(camera.model_name == "PINHOLE"
               for camera in views.cameras.values())
    for image in views.images.values():
        assert (tmp_path / "dense" / "images" / image.name).exists()


def test_split_images_names_what_is_missing(tmp_path):
    with pytest.raises(pymgsfm.InputError, match="none"):
        pymgsfm.split_images(tmp_path / "none", tmp_path / "out")


def test_unknown_command():
    with pytest.raises(pymgsfm.InputError, match="'mapper'"):
        pymgsfm.run("maper")
