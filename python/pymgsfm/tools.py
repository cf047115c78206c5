# SPDX-License-Identifier: BSD-3-Clause
"""Tools for finished models and for databases.

They take and write folders and files, as the commands do. Options, errors and
messages are those of the other commands.
"""

from __future__ import annotations

from typing import Optional, Sequence, Union

from .commands import Log, PathLike, Progress, run
from .options import OptionsLike
from .reconstruction import Reconstruction


def undistort(image_path: PathLike, input_path: PathLike,
              output_path: PathLike, options: OptionsLike = None, *,
              log: Optional[Log] = None,
              progress: Optional[Progress] = None) -> None:
    """Makes pinhole images and their model (image_undistorter).

    The option output_type selects the layout of the output folder: COLMAP, mvs,
    gaussian_splatting or nerfstudio.
    """
    run("image_undistorter", options, log=log, progress=progress,
        image_path=image_path, input_path=input_path, output_path=output_path)


def align_model(input_path: PathLike, output_path: PathLike,
                options: OptionsLike = None, *,
                log: Optional[Log] = None) -> Reconstruction:
    """Moves a model to positions, to another model or to the ground plane
    (model_aligner)."""
    run("model_aligner", options, log=log, input_path=input_path,
        output_path=output_path)
    return Reconstruction(output_path)


def merge_models(input_path1: PathLike, input_path2: PathLike,
                 output_path: PathLike, options: OptionsLike = None, *,
                 log: Optional[Log] = None) -> Reconstruction:
    """Merges two models of one database; keeps the world of the first
    (model_merger)."""
    run("model_merger", options, log=log, input_path1=input_path1,
        input_path2=input_path2, output_path=output_path)
    return Reconstruction(output_path)


def crop_model(input_path: PathLike, output_path: PathLike,
               boundary: Union[str, Sequence[float]],
               options: OptionsLike = None, *,
               log: Optional[Log] = None) -> Reconstruction:
    """Keeps the points in a box and the frames that observe them
    (model_cropper).

    Args:
      boundary: (6,) x1 y1 z1 x2 y2 z2 in the world of the model, or (2,)
        quantiles of the points along each axis.
    """
    run("model_cropper", options, log=log, input_path=input_path,
        output_path=output_path, boundary=boundary)
    return Reconstruction(output_path)


def delete_images(input_path: PathLike, output_path: PathLike,
                  options: OptionsLike = None, *,
                  log: Optional[Log] = None) -> Reconstruction:
    """Deletes images from a model (image_deleter).

    The option image_names_path or image_ids_path names a file that lists them.
    """
    run("image_deleter", options, log=log, input_path=input_path,
        output_path=output_path)
    return Reconstruction(output_path)


def convert_model(input_path: PathLike, output_path: PathLike,
                  output_type: str, options: OptionsLike = None, *,
                  log: Optional[Log] = None) -> None:
    """Writes a model in another format, such as "txt", "ply", "nvm", "tum"
    (model_converter; docs/reference/exchange.md lists all formats)."""
    run("model_converter", options, log=log, input_path=input_path,
        output_path=output_path, output_type=output_type)


def analyze_model(path: PathLike, options: OptionsLike = None, *,
                  log: Optional[Log] = None) -> str:
    """The text with statistics of a model that model_analyzer prints."""
    return str(run("model_analyzer", options, log=log, path=path))


def merge_databases(database_path1: PathLike, database_path2: PathLike,
                    merged_database_path: PathLike, *,
                    log: Optional[Log] = None) -> None:
    """Merges two databases without common images (database_merger)."""
    run("database_merger", log=log, database_path1=database_path1,
        database_path2=database_path2,
        merged_database_path=merged_database_path)


def clean_database(database_path: PathLike, type: str, *,
                   log: Optional[Log] = None) -> None:
    """Deletes rows of a database (database_cleaner).

    Args:
      type: "matches", "features", "images" or "all".
    """
    run("database_cleaner", log=log, database_path=database_path, type=type)
