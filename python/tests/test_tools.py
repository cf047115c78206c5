# SPDX-License-Identifier: BSD-3-Clause
"""Tools for models and databases; each writes what the program writes."""

import inspect
import re
import shutil
import sqlite3
import struct
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


def test_split_and_join_models(sparse, model, tmp_path):
    parts = pymgsfm.split_model(sparse / "0", tmp_path / "parts",
                                {"num_overlap_frames": 3})
    run_program("model_splitter", "--input_path", sparse / "0",
                "--output_path", tmp_path / "program",
                "--num_overlap_frames", 3)
    assert read_files(tmp_path / "parts") == read_files(tmp_path / "program")
    assert list(parts) == [0, 1]
    assert all(part.num_frames() < 12 for part in parts.values())
    joined = pymgsfm.join_models(tmp_path / "parts", tmp_path / "joined")
    assert [part.num_frames() for part in joined.values()] == [12]


def test_partition_and_join_models(drive, tmp_path):
    database = drive / "database.db"
    clusters = pymgsfm.partition(database, tmp_path / "clusters", 2,
                                 {"partition_overlap": 3})["clusters"]
    assert len(clusters) == 2
    for number, cluster in enumerate(clusters):
        names = tmp_path / "clusters" / cluster["image_list"]
        part = pymgsfm.global_mapping(
            database, None, tmp_path / "maps" / str(number),
            {"image_list_path": names})[0]
        assert part.num_reg_images() == cluster["num_images"]
    joined = pymgsfm.join_models(
        tmp_path / "maps", tmp_path / "joined",
        {"cluster_path": tmp_path / "clusters", "database_path": database})
    assert [part.num_frames() for part in joined.values()] == [12]


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
    pymgsfm.merge_databases([copy, drive / "database.db"], merged,
                            {"image_prefix": ["monday/", "tuesday/"]})
    with sqlite3.connect(merged) as database:
        assert database.execute(
            "SELECT COUNT(*) FROM images WHERE name LIKE 'monday/%'"
        ).fetchone() == (24,)
        assert database.execute(
            "SELECT COUNT(*) FROM images").fetchone() == (48,)
    with pytest.raises(pymgsfm.InputError, match="exists already"):
        pymgsfm.merge_databases([copy, drive / "database.db"], merged)


def test_convert_model_from_other_programs(sparse, drive, model, tmp_path):
    pymgsfm.convert_model(sparse / "0", tmp_path / "poses.txt", "kitti")
    pymgsfm.convert_model(tmp_path / "poses.txt", tmp_path / "posed", "bin",
                          {"input_type": "kitti",
                           "database_path": drive / "database.db",
                           "rig_config_path": sparse / "0"})
    posed = pymgsfm.Reconstruction(tmp_path / "posed")
    assert posed.num_points3D() == 0
    for image in model.images.values():
        np.testing.assert_allclose(
            posed.find_image_with_name(image.name).projection_center(),
            image.projection_center(), atol=1e-6)


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
    pymgsfm.undistort_images(tmp_path / "same", frame, RENDERED / "images",
                             output_type="gaussian_splatting")
    assert (pymgsfm.Reconstruction(tmp_path / "same" / "sparse" / "0")
            .summary() == views.summary())


def test_split_images_names_what_is_missing(tmp_path):
    with pytest.raises(pymgsfm.InputError, match="none"):
        pymgsfm.split_images(tmp_path / "none", tmp_path / "out")


def test_import_recording_names_what_is_missing(tmp_path):
    with pytest.raises(pymgsfm.InputError, match="none.bag"):
        pymgsfm.import_recording([tmp_path / "none.bag"], tmp_path / "out")


def write_video(path, images):
    """An AVI file (MJPEG) of JPEG files of 640 x 200 px, ten per second."""
    def chunk(name, *parts):
        body = b"".join(parts)
        return name + struct.pack("<I", len(body)) + body + bytes(len(body) % 2)

    frames = [image.read_bytes() for image in images]
    largest = max(map(len, frames))
    width, height = 640, 200
    main_header = struct.pack("<14I", 100_000, 0, 0, 0x10, len(frames), 0, 1,
                              largest, width, height, 0, 0, 0, 0)
    stream_header = b"vidsMJPG" + struct.pack(
        "<10I4H", 0, 0, 0, 1, 10, 0, len(frames), largest, 0, 0, 0, 0, width,
        height)
    image_format = struct.pack("<3I2H4s5I", 40, width, height, 1, 24, b"MJPG",
                               0, 0, 0, 0, 0)
    index, movie = b"", b"movi"
    for frame in frames:
        index += b"00dc" + struct.pack("<3I", 0x10, len(movie), len(frame))
        movie += chunk(b"00dc", frame)
    stream = chunk(b"LIST", b"strl", chunk(b"strh", stream_header),
                   chunk(b"strf", image_format))
    headers = chunk(b"LIST", b"hdrl", chunk(b"avih", main_header), stream)
    path.write_bytes(chunk(b"RIFF", b"AVI ", headers, chunk(b"LIST", movie),
                           chunk(b"idx1", index)))


def test_sample_videos(tmp_path):
    videos = [tmp_path / "front_left.avi", tmp_path / "front_right.avi"]
    for path in videos:
        write_video(path, sorted((RENDERED / "images" / path.stem).iterdir()))
    try:
        pymgsfm.sample_videos(videos, tmp_path / "out",
                              {"sampling": "rate", "rate": 5})
    except pymgsfm.InputError as error:
        if "this build cannot read videos" in str(error):
            pytest.skip("built without FFmpeg")
        raise
    num_images = len(list((RENDERED / "images" / "front_left").iterdir()))
    for path in videos:
        images = list((tmp_path / "out" / "images" / path.stem).iterdir())
        assert len(images) == num_images // 2


def test_build_vocab_tree(tmp_path):
    images = tmp_path / "images"
    for sensor in ("front_left", "front_right"):
        (images / sensor).mkdir(parents=True)
        for path in sorted((RENDERED / "images" / sensor).iterdir())[:4]:
            shutil.copy(path, images / sensor)
    database, tree = tmp_path / "database.db", tmp_path / "tree.bin"
    options = pymgsfm.SiftExtractionOptions(max_num_features=500)
    names = [f"front_left/{path.name}"
             for path in (images / "front_left").iterdir()]
    pymgsfm.extract_features(database, images, options, image_names=names)
    with pymgsfm.Database.open(database) as rows:
        assert {image.name for image in rows.read_all_images()} == set(names)
    pymgsfm.extract_features(database, images, options)
    pymgsfm.build_vocab_tree(database, tree, {"num_visual_words": 256})
    pymgsfm.match_vocab_tree(database, {"VocabTree": {"vocab_tree_path": tree}})
    with pymgsfm.Database.open(database) as rows:
        num_pairs = rows.num_verified_image_pairs()
        assert num_pairs >= 6
    pymgsfm.clean_database(database, "matches")
    pymgsfm.match_vocabtree(database, {"VocabTree": {"vocab_tree_path": tree}})
    with pymgsfm.Database.open(database) as rows:
        assert rows.num_verified_image_pairs() == num_pairs


def test_a_function_for_every_command():
    functions = [getattr(pymgsfm, name) for name in pymgsfm.__all__]
    called = {name for function in functions if inspect.isfunction(function)
              for name in re.findall(r'run\(\s*"(\w+)"',
                                     inspect.getsource(function))}
    assert called == set(pymgsfm._core.command_names())


def test_unknown_command():
    with pytest.raises(pymgsfm.InputError, match="'mapper'"):
        pymgsfm.run("maper")
