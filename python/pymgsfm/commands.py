# SPDX-License-Identifier: BSD-3-Clause
"""The commands of the program mgsfm as functions.

Each runs the code of the corresponding command and writes the same files, byte
for byte. `options` are those of the command, with `num_threads`, `random_seed`
and `log_level`: an object `Options("mapper")`, or a dict, nested
(`{"Tracks": {"min_track_length": 2}}`) or flat
(`{"Tracks.min_track_length": 2}`).

All functions release the GIL. They raise

- `InputError` for bad input; nothing was written,
- `NotSolvableError` if nothing can be estimated,
- `KeyboardInterrupt` after Ctrl-C, in the main thread only.

`log(level, message)` receives the messages of a run; by default, the logger
`pymgsfm` of Python's `logging` does. `progress(stage, done, total)` is called
several times per second. Both run in the thread of the caller. If one raises an
exception, the run ends without output and the exception propagates.
"""

from __future__ import annotations

import contextlib
import json
import logging
import os
import tempfile
from pathlib import Path
from typing import Any, Callable, Dict, Optional, Sequence, Union, overload

from . import _core
from .errors import NotSolvableError
from .options import OptionsLike, to_texts, with_group_name
from .reconstruction import Reconstruction

PathLike = Union[str, "os.PathLike[str]"]
Model = Union[PathLike, Reconstruction]
Log = Callable[[str, str], object]
Progress = Callable[[str, int, int], object]

_logger = logging.getLogger("pymgsfm")
_LEVELS = {"debug": logging.DEBUG, "info": logging.INFO,
           "warning": logging.WARNING, "error": logging.ERROR}


def log_to_logging(level: str, message: str) -> None:
    """The default of `log`."""
    _logger.log(_LEVELS[level], "%s", message)


def run(command: str, options: OptionsLike = None, *,
        log: Optional[Log] = None, progress: Optional[Progress] = None,
        **values: Any) -> Any:
    """Runs any command by its name, as `mgsfm COMMAND` does.

    Keywords are options, too; a Reconstruction stands for a folder with it.
    Returns the printed result, as a dict if the command has one for programs,
    else as a str; None if it prints nothing.
    """
    with contextlib.ExitStack() as scratch:
        for name, value in values.items():
            if isinstance(value, Reconstruction):
                values[name] = scratch.enter_context(
                    tempfile.TemporaryDirectory())
                value.write(values[name])
        exit_code, json_text, text, message = _core.run_command(
            command, to_texts(with_group_name(options), values),
            log or log_to_logging, progress)
    if exit_code != 0:
        raise NotSolvableError(message or f"{command} estimated nothing")
    return json.loads(json_text) if json_text else text or None


def extract_features(database_path: PathLike, image_path: PathLike,
                     options: OptionsLike = None, *,
                     image_names: Optional[Sequence[str]] = None,
                     log: Optional[Log] = None,
                     progress: Optional[Progress] = None) -> None:
    """Extracts SIFT features of the images in a folder into a database.

    Images that have features in the database are skipped.

    Args:
      options: Of the command feature_extractor.
      image_names: Only these images; None: all.
    """
    with tempfile.TemporaryDirectory() as scratch:
        values: Dict[str, Any] = {}
        if image_names is not None:
            values["image_list_path"] = Path(scratch) / "names.txt"
            values["image_list_path"].write_text(
                "".join(f"{name}\n" for name in image_names), encoding="utf-8")
        run("feature_extractor", options, log=log, progress=progress,
            database_path=database_path, image_path=image_path, **values)


def import_features(database_path: PathLike, import_path: PathLike,
                    options: OptionsLike = None, *,
                    log: Optional[Log] = None,
                    progress: Optional[Progress] = None) -> None:
    """Imports features and matches of other programs, in hloc's format.

    Matches of the option matches_path are raw: call verify_matches next.
    """
    run("feature_importer", options, log=log, progress=progress,
        database_path=database_path, import_path=import_path)


def split_images(image_path: PathLike, output_path: PathLike,
                 options: OptionsLike = None, *, log: Optional[Log] = None,
                 progress: Optional[Progress] = None) -> None:
    """Splits panoramas or dual fisheyes into the images of a rig."""
    run("image_splitter", options, log=log, progress=progress,
        image_path=image_path, output_path=output_path)


def sample_videos(video_path: Union[PathLike, Sequence[PathLike]],
                  output_path: PathLike, options: OptionsLike = None, *,
                  log: Optional[Log] = None,
                  progress: Optional[Progress] = None) -> None:
    """Extracts images of videos, one video per camera of a rig.

    Writes the folder images and the file timestamps.txt to output_path. Call
    extract_features and configure_rigs with them next.
    """
    run("video_sampler", options, log=log, progress=progress,
        video_path=video_path, output_path=output_path)


def import_recording(recording_path: Union[PathLike, Sequence[PathLike]],
                     output_path: PathLike, options: OptionsLike = None, *,
                     log: Optional[Log] = None,
                     progress: Optional[Progress] = None) -> None:
    """Imports ROS bags and MCAP files: images, calibration, positions, gravity.

    Writes the folder images and, if known, rig_config.json, positions.txt and
    gravity.txt to output_path.
    """
    run("recording_importer", options, log=log, progress=progress,
        recording_path=recording_path, output_path=output_path)


def configure_rigs(database_path: PathLike, options: OptionsLike = None, *,
                   log: Optional[Log] = None) -> None:
    """Writes rigs and frames to a database, replacing those it has."""
    run("rig_configurator", options, log=log, database_path=database_path)


def match_exhaustive(database_path: PathLike, options: OptionsLike = None, *,
                     log: Optional[Log] = None,
                     progress: Optional[Progress] = None) -> None:
    """Matches all pairs of images and verifies the matches."""
    run("exhaustive_matcher", options, log=log, progress=progress,
        database_path=database_path)


def match_sequential(database_path: PathLike, options: OptionsLike = None, *,
                     log: Optional[Log] = None,
                     progress: Optional[Progress] = None) -> None:
    """Matches images with the next ones by name, and detects loops."""
    run("sequential_matcher", options, log=log, progress=progress,
        database_path=database_path)


def match_spatial(database_path: PathLike, options: OptionsLike = None, *,
                  log: Optional[Log] = None,
                  progress: Optional[Progress] = None) -> None:
    """Matches images with nearby positions (table pose_priors)."""
    run("spatial_matcher", options, log=log, progress=progress,
        database_path=database_path)


def match_vocab_tree(database_path: PathLike, options: OptionsLike = None, *,
                     log: Optional[Log] = None,
                     progress: Optional[Progress] = None) -> None:
    """Matches each image with those that look most similar."""
    run("vocab_tree_matcher", options, log=log, progress=progress,
        database_path=database_path)


def build_vocab_tree(database_path: PathLike, vocab_tree_path: PathLike,
                     options: OptionsLike = None, *,
                     log: Optional[Log] = None,
                     progress: Optional[Progress] = None) -> None:
    """Trains a vocabulary tree on the features of a database.

    The option VocabTree.vocab_tree_path of match_sequential and
    match_vocab_tree reads it.
    """
    run("vocab_tree_builder", options, log=log, progress=progress,
        database_path=database_path, vocab_tree_path=vocab_tree_path)


def import_matches(database_path: PathLike, match_list_path: PathLike,
                   options: OptionsLike = None, *, log: Optional[Log] = None,
                   progress: Optional[Progress] = None) -> None:
    """Imports pairs or matches from a text file."""
    run("matches_importer", options, log=log, progress=progress,
        database_path=database_path, match_list_path=match_list_path)


def verify_matches(database_path: PathLike, options: OptionsLike = None, *,
                   log: Optional[Log] = None,
                   progress: Optional[Progress] = None) -> None:
    """Verifies the raw matches of a database."""
    run("geometric_verifier", options, log=log, progress=progress,
        database_path=database_path)


def global_mapping(database_path: PathLike, image_path: Optional[PathLike],
                   output_path: PathLike, options: OptionsLike = None, *,
                   log: Optional[Log] = None,
                   progress: Optional[Progress] = None
                   ) -> Dict[int, Reconstruction]:
    """Reconstructs models from the verified matches of a database.

    Args:
      database_path: COLMAP database; it is only read.
      image_path: Folder of the images, to color points; None: black points.
      output_path: Folder for the models 0, 1, ... and report.json.
      options: Of the command mapper.

    Returns the models by number, the one with the most frames first.
    """
    run("mapper", options, log=log, progress=progress,
        database_path=database_path, image_path=image_path,
        output_path=output_path)
    return read_models(output_path)


def incremental_mapping(database_path: PathLike,
                        image_path: Optional[PathLike],
                        output_path: PathLike, options: OptionsLike = None, *,
                        log: Optional[Log] = None,
                        progress: Optional[Progress] = None
                        ) -> Dict[int, Reconstruction]:
    """Reconstructs models that grow frame by frame, as global_mapping does.

    It sets the option method to incremental.
    """
    run("mapper", options, log=log, progress=progress,
        database_path=database_path, image_path=image_path,
        output_path=output_path, method="incremental")
    return read_models(output_path)


def extend(database_path: PathLike, image_path: Optional[PathLike],
           input_path: Model, output_path: PathLike,
           options: OptionsLike = None, *, log: Optional[Log] = None,
           progress: Optional[Progress] = None) -> Reconstruction:
    """Adds the frames of a database that the model input_path lacks.

    Writes the model to the folder 0 of output_path, and returns it.
    """
    run("mapper", options, log=log, progress=progress,
        database_path=database_path, image_path=image_path,
        input_path=input_path, output_path=output_path)
    return read_models(output_path)[0]


def partition(database_path: PathLike, output_path: PathLike,
              num_clusters: int, options: OptionsLike = None, *,
              log: Optional[Log] = None,
              progress: Optional[Progress] = None) -> Dict[str, Any]:
    """Cuts a drive into overlapping clusters of frames, to be mapped one by one.

    Args:
      database_path: COLMAP database; it is only read.
      output_path: Folder for the lists of images 0.txt, 1.txt, ...: pass one as
        option image_list_path of global_mapping. join_models joins the models.
      num_clusters: Desired number; there are fewer if cuts would be weak.
      options: Of the command mapper.

    Returns the content of clusters.json (docs/guides/sub_maps.md).
    """
    run("mapper", options, log=log, progress=progress,
        database_path=database_path, output_path=output_path,
        partition=num_clusters)
    text = (Path(output_path) / "clusters.json").read_text(encoding="utf-8")
    clusters: Dict[str, Any] = json.loads(text)
    return clusters


def automatic_reconstruction(workspace_path: PathLike,
                             image_path: Optional[PathLike],
                             options: OptionsLike = None, *,
                             log: Optional[Log] = None,
                             progress: Optional[Progress] = None
                             ) -> Dict[int, Reconstruction]:
    """Extracts features, matches and maps; models are in workspace/sparse.

    Args:
      image_path: Folder of the images; None with the option video_path or
        recording_path.
    """
    run("automatic_reconstructor", options, log=log, progress=progress,
        workspace_path=workspace_path, image_path=image_path)
    return read_models(Path(workspace_path) / "sparse")


def bundle_adjustment(model: Model, options: OptionsLike = None,
                      output_path: Optional[PathLike] = None, *,
                      log: Optional[Log] = None,
                      progress: Optional[Progress] = None) -> Reconstruction:
    """Refines a model: frame poses, rig extrinsics, points.

    Args:
      model: A model in memory, which is changed, or the folder of a model.
        Points keep their ids, unless the option retriangulate makes new ones.
      options: Of the command bundle_adjuster.
      output_path: Folder for the adjusted model; None: nothing is written.

    Returns the adjusted model: that in memory if one was given.
    """
    with tempfile.TemporaryDirectory() as scratch:
        target = output_path or Path(scratch) / "output"
        run("bundle_adjuster", options, log=log, progress=progress,
            input_path=model, output_path=target)
        adjusted = Reconstruction(target)
    if not isinstance(model, Reconstruction):
        return adjusted
    model._take_over(adjusted)
    return model


@overload
def triangulate_points(database_path: PathLike,
                       image_path: Optional[PathLike], input_path: Model,
                       output_path: PathLike, options: OptionsLike = None, *,
                       log: Optional[Log] = None,
                       progress: Optional[Progress] = None
                       ) -> Reconstruction: ...
@overload
def triangulate_points(reconstruction: Reconstruction, database_path: PathLike,
                       image_path: Optional[PathLike], output_path: PathLike,
                       options: OptionsLike = None, *,
                       log: Optional[Log] = None,
                       progress: Optional[Progress] = None
                       ) -> Reconstruction: ...


def triangulate_points(*paths: Any, log: Optional[Log] = None,
                       progress: Optional[Progress] = None,
                       **keywords: Any) -> Reconstruction:
    """Triangulates the points of a model whose poses stay fixed.

    Args:
      database_path: COLMAP database; it is only read.
      image_path: Folder of the images, to color points; None: black points.
      input_path: The model, as a folder or in memory.
      output_path: Folder for the model with points.
      options: Of the command point_triangulator.

    pycolmap's order is accepted, too: a Reconstruction first.
    """
    names = ["database_path", "image_path", "input_path", "output_path",
             "options"]
    if "reconstruction" in keywords or (
            paths and isinstance(paths[0], Reconstruction)):
        names = ["reconstruction", "database_path", "image_path", "output_path",
                 "options"]
    values = {**dict(zip(names, paths)), **keywords}
    if set(values) | {"options"} != set(names) or len(paths) > len(names):
        raise TypeError("triangulate_points() takes " + ", ".join(names))
    options = values.pop("options", None)
    values["input_path"] = values.pop("reconstruction",
                                      values.get("input_path"))
    run("point_triangulator", options, log=log, progress=progress, **values)
    return Reconstruction(values["output_path"])


def evaluate(input_path: Model, gt_path: Optional[PathLike] = None,
             options: OptionsLike = None, *,
             log: Optional[Log] = None) -> Dict[str, Any]:
    """Compares a model with true poses or a true rig.

    Returns what `mgsfm model_evaluator --json` writes: lengths in the unit of
    the true poses, angles in degrees (docs/reference/formats.md).
    """
    result: Dict[str, Any] = run("model_evaluator", options, log=log,
                                 input_path=input_path, gt_path=gt_path)
    return result


def simulate(output_path: PathLike, options: OptionsLike = None, *,
             log: Optional[Log] = None,
             progress: Optional[Progress] = None) -> None:
    """Simulates a drive: a database or images, and the true model."""
    run("simulate", options, log=log, progress=progress,
        output_path=output_path)


def report(input_path: Model, output_path: PathLike,
           options: OptionsLike = None, *, log: Optional[Log] = None,
           progress: Optional[Progress] = None) -> None:
    """Writes an HTML page to inspect a model."""
    run("report", options, log=log, progress=progress, input_path=input_path,
        output_path=output_path)


def read_models(folder: PathLike) -> Dict[int, Reconstruction]:
    """The models 0, 1, ... in a folder."""
    numbers = sorted(int(path.name) for path in Path(folder).iterdir()
                     if path.is_dir() and path.name.isdecimal())
    return {number: Reconstruction(Path(folder) / str(number))
            for number in numbers}
