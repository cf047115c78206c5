# SPDX-License-Identifier: BSD-3-Clause
import pickle

import numpy as np
import pymgsfm
import pytest
from pymgsfm.options import to_texts


def test_attributes_and_documentation():
    options = pymgsfm.Options("mapper")
    assert options.Tracks.min_track_length == 3
    options.Tracks.min_track_length = 2
    options.compute_covariances = True
    assert options.Tracks.min_track_length == 2
    assert options.changed() == {"compute_covariances": True,
                                 "Tracks.min_track_length": 2}
    info = options.Tracks.info("min_track_length")
    assert (info.default, info.unit, info.range) == (3, "images", "[2, inf)")
    assert "track" in info.help
    assert options.Mapper.info("weak_seams").choices == ["keep", "split_jumps", "split"]
    assert "Tracks" in dir(options)


def test_all_ways_to_give_options():
    expected = [("Tracks.min_track_length", "2"), ("num_threads", "3")]
    nested = {"Tracks": {"min_track_length": 2}, "num_threads": np.int64(3)}
    flat = {"Tracks.min_track_length": 2, "num_threads": 3}
    assert sorted(to_texts(nested)) == expected
    assert sorted(to_texts(flat)) == expected
    assert sorted(to_texts(pymgsfm.Options("mapper", nested))) == expected


@pytest.mark.parametrize("name, value, message", [
    ("min_num_frames", 1, r"\[2"),
    ("min_num_frames", 2.5, "integer"),
    ("min_num_frames", True, "integer"),
    ("compute_covariances", 2, "true or false"),
    ("min_num_frame", 3, "min_num_frames"),
    ("Mapper.weak_seams", "drop", "keep, split_jumps, split"),
    ("min_num_frames", {3}, "set"),
])
def test_the_checks_of_the_program(name, value, message, tmp_path):
    with pytest.raises(pymgsfm.InputError, match=message):
        pymgsfm.Options("mapper", {name: value})
    with pytest.raises(pymgsfm.InputError, match=message):
        pymgsfm.global_mapping("none.db", None, tmp_path, {name: value})


def test_an_option_is_given_once(tmp_path):
    with pytest.raises(pymgsfm.InputError, match="given twice"):
        pymgsfm.evaluate("a", "b", {"gt_path": "c"})


def test_unknown_names():
    options = pymgsfm.Options("mapper")
    with pytest.raises(AttributeError, match="min_frames"):
        options.min_frames
    with pytest.raises(pymgsfm.InputError, match="group"):
        options.Tracks = 3
    with pytest.raises(pymgsfm.InputError, match="mapper"):
        pymgsfm.Options("map")


def test_versions():
    from conftest import run_program
    first_line = run_program("--version").splitlines()[0]
    assert first_line == (f"mgsfm {pymgsfm.__version__}, "
                          f"commit {pymgsfm.__commit__}")


def test_pickle():
    options = pymgsfm.Options("mapper", {"Tracks": {"min_track_length": 2}})
    again = pickle.loads(pickle.dumps(options))
    assert again == options and isinstance(again, pymgsfm.Options)
    group = pickle.loads(pickle.dumps(options.Tracks))
    assert group.changed() == {"min_track_length": 2}


def test_sequences_are_values_separated_by_commas():
    options = pymgsfm.Options("feature_extractor")
    options.ImageReader.camera_params = [370, 370.5, 320]
    assert options.ImageReader.camera_params == "370,370.5,320"
