# SPDX-License-Identifier: BSD-3-Clause
"""Lists and small files: written by numpy or read by it."""
import json
import sqlite3

import colmap_files
import numpy
from numpy.testing import assert_allclose


def names_of(model):
    return sorted(image.name for image in model.images.values())


def centers_of(model):
    """By the name of the image."""
    return {image.name: numpy.linalg.inv(image.cam_from_world)[:3, 3]
            for image in model.images.values()}


def save(path, names, values):
    """A line `name value ...` per image, as numpy writes text."""
    numpy.savetxt(path, [[name, *map(repr, map(float, row))]
                         for name, row in zip(names, values)], fmt="%s",
                  header="written by numpy")


def test_positions_transform_and_evaluation(mgsfm, model, drive, tmp_path):
    turn = colmap_files.rotation_of(0.5, 0.5, -0.5, 0.5)
    scale, shift = 2.5, numpy.array([10.0, -4.0, 3.0])
    centers = centers_of(model)
    names = names_of(model)
    save(tmp_path / "positions.txt", names,
         [scale * turn @ centers[name] + shift for name in names])
    mgsfm("model_aligner", "--input_path", drive / "truth", "--output_path",
          tmp_path / "out", "--ref_images_path", tmp_path / "positions.txt",
          "--ref_is_gps", 0, "--transform_path", tmp_path / "transform.txt")
    row = numpy.loadtxt(tmp_path / "transform.txt")
    assert_allclose(row[0], scale, rtol=1e-6)
    assert_allclose(colmap_files.rotation_of(*row[1:5]), turn, atol=1e-6)
    assert_allclose(row[5:], shift, atol=1e-5)
    moved = centers_of(colmap_files.read_binary(tmp_path / "out"))
    mgsfm("model_evaluator", "--input_path", tmp_path / "out", "--gt_path",
          drive / "truth", "--alignment", "none", "--json",
          tmp_path / "evaluation.json")
    errors = json.loads((tmp_path / "evaluation.json").read_text())
    distances = [numpy.linalg.norm(moved[n] - centers[n]) for n in names]
    assert_allclose(errors["position_m"]["mean"], numpy.mean(distances))
    assert_allclose(errors["position_m"]["max"], numpy.max(distances))
    assert errors["num_registered"] == errors["num_images"] == 24


def test_origin_of_gps(mgsfm, model, drive, tmp_path):
    """The first image by name is the origin; a degree has 111.2 km."""
    names = names_of(model)
    centers = centers_of(model)
    # East, north, up of a drive that looks north.
    axes = numpy.array([[1, 0, 0], [0, 0, 1], [0, -1, 0]])
    enu = [axes @ (centers[name] - centers[names[0]]) for name in names]
    save(tmp_path / "gps.txt", names, [
        [48 + n / 111_200, 11 + e / 111_200 / numpy.cos(numpy.radians(48)),
         500 + u] for e, n, u in enu])
    mgsfm("model_aligner", "--input_path", drive / "truth", "--output_path",
          tmp_path / "out", "--ref_images_path", tmp_path / "gps.txt")
    origin = json.loads((tmp_path / "out" / "geo_origin.json").read_text())
    assert_allclose([origin[f"{key}"] for key in (
        "latitude_deg", "longitude_deg", "altitude_m")], [48, 11, 500])
    aligned = centers_of(colmap_files.read_binary(tmp_path / "out"))
    assert_allclose([aligned[name] for name in names], enu, atol=0.5)


def test_images_gravity_and_times(mgsfm, model, drive, tmp_path):
    names = [name for name in names_of(model) if "000011" not in name]
    (tmp_path / "images.txt").write_text("\r\n".join(names))
    save(tmp_path / "gravity.txt", names, [
        image.cam_from_world[:3, :3] @ [0.0, 1.0, 0.0] for image in sorted(
            model.images.values(), key=lambda image: image.name)
        if image.name in names])
    save(tmp_path / "times.txt", names,
         [[0.1 * int(name[-10:-4])] for name in names])
    mgsfm("mapper", "--database_path", drive / "database.db",
          "--image_list_path", tmp_path / "images.txt", "--gravity_path",
          tmp_path / "gravity.txt", "--image_timestamps_path",
          tmp_path / "times.txt", "--output_path", tmp_path / "out",
          "--write_report", 0)
    read = colmap_files.read_binary(tmp_path / "out" / "0")
    assert names_of(read) == names
    # Gravity is +y in the world of the model.
    for name, image in ((i.name, i) for i in read.images.values()):
        same = next(i for i in model.images.values() if i.name == name)
        assert_allclose(image.cam_from_world[:3, :3] @ [0, 1, 0],
                        same.cam_from_world[:3, :3] @ [0, 1, 0], atol=1e-3)


def test_pairs(mgsfm, drive, tmp_path):
    """hloc's parser of pairs: two names in each line."""
    path = tmp_path / "pairs.txt"
    mgsfm("exhaustive_matcher", "--database_path", drive / "database.db",
          "--output_pairs_path", path)
    pairs = [line.split() for line in path.read_text().rstrip("\n").split("\n")]
    names = {name for pair in pairs for name in pair}
    assert len(names) == 24
    assert len({frozenset(pair) for pair in pairs}) == 24 * 23 // 2 == len(pairs)


def test_cameras_of_folders(mgsfm, tmp_path):
    random = numpy.random.default_rng(2)
    lines = []
    for k, folder in enumerate(("left eye", "right")):
        path = tmp_path / "images" / folder / "0.pgm"
        path.parent.mkdir(parents=True)
        path.write_bytes(b"P5 160 120 255\n" + random.integers(
            0, 256, 160 * 120, dtype=numpy.uint8).tobytes())
        lines.append([folder, "OPENCV", 160, 120, 100.5 + k, 101.5, 80.25, 60,
                      -0.1, 0.01, 1e-4, -2e-4])
    numpy.savetxt(tmp_path / "cameras.txt", lines, fmt="%s")
    mgsfm("feature_extractor", "--database_path", tmp_path / "a.db",
          "--image_path", tmp_path / "images",
          "--ImageReader.camera_params_path", tmp_path / "cameras.txt")
    rows = sqlite3.connect(tmp_path / "a.db").execute(
        "select name, model, width, height, params from images "
        "join cameras using (camera_id) order by name").fetchall()
    for line, (name, kind, width, height, params) in zip(lines, rows):
        assert (name, kind, width, height) == (f"{line[0]}/0.pgm", 4, 160, 120)
        assert_allclose(numpy.frombuffer(params), line[4:])
