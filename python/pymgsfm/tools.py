# SPDX-License-Identifier: BSD-3-Clause
"""Tools for finished models and for databases.

They take models as folders or in memory, and write folders and files, as the
commands do. Options, errors and messages are those of the other commands.
"""

from __future__ import annotations

from typing import Dict, Optional, Sequence, Union

from .commands import Log, Model, PathLike, Progress, read_models, run
from .options import OptionsLike
from .reconstruction import Reconstruction


def undistort(image_path: PathLike, input_path: Model,
              output_path: PathLike, options: OptionsLike = None, *,
              log: Optional[Log] = None,
              progress: Optional[Progress] = None) -> None:
    """Makes pinhole images and their model (image_undistorter).

    The option output_type selects the layout of the output folder: COLMAP, mvs,
    gaussian_splatting or nerfstudio.
    """
    run("image_undistorter", options, log=log, progress=progress,
        image_path=image_path, input_path=input_path, output_path=output_path)


def align_model(input_path: Model, output_path: PathLike,
                options: OptionsLike = None, *,
                log: Optional[Log] = None) -> Reconstruction:
    """Moves a model to positions, to another model or to the ground plane
    (model_aligner)."""
    run("model_aligner", options, log=log, input_path=input_path,
        output_path=output_path)
    return Reconstruction(output_path)


def merge_models(input_path1: Model, input_path2: Model,
                 output_path: PathLike, options: OptionsLike = None, *,
                 log: Optional[Log] = None) -> Reconstruction:
    """Merges two models of one database; keeps the world of the first
    (model_merger)."""
    run("model_merger", options, log=log, input_path1=input_path1,
        input_path2=input_path2, output_path=output_path)
    return Reconstruction(output_path)


def split_model(input_path: Model, output_path: PathLike,
                options: OptionsLike = None, *, log: Optional[Log] = None,
                progress: Optional[Progress] = None
                ) -> Dict[int, Reconstruction]:
    """Splits a model into overlapping ones of whole frames (model_splitter).

    Writes the folders 0, 1, ... of output_path, and returns their models.
    """
    run("model_splitter", options, log=log, progress=progress,
        input_path=input_path, output_path=output_path)
    return read_models(output_path)


def join_models(input_path: PathLike, output_path: PathLike,
                options: OptionsLike = None, *, log: Optional[Log] = None,
                progress: Optional[Progress] = None
                ) -> Dict[int, Reconstruction]:
    """Joins the models of the clusters of a drive, and adjusts the result
    (model_merger with the option graph).

    Args:
      input_path: Folder with an output folder of global_mapping for each
        cluster, named 0, 1, ..., or the output of split_model.
      output_path: Folder for the models 0, 1, ...: one if all are connected.
      options: Such as cluster_path, the output of partition, and
        database_path, to close loops between clusters.
    """
    run("model_merger", options, log=log, progress=progress, graph=True,
        input_path=input_path, output_path=output_path)
    return read_models(output_path)


def crop_model(input_path: Model, output_path: PathLike,
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


def delete_images(input_path: Model, output_path: PathLike,
                  options: OptionsLike = None, *,
                  log: Optional[Log] = None) -> Reconstruction:
    """Deletes images from a model (image_deleter).

    The option image_names_path or image_ids_path names a file that lists them.
    """
    run("image_deleter", options, log=log, input_path=input_path,
        output_path=output_path)
    return Reconstruction(output_path)


def convert_model(input_path: Model, output_path: PathLike,
                  output_type: str = "bin", options: OptionsLike = None, *,
                  log: Optional[Log] = None) -> None:
    """Converts a model from or to another format (model_converter;
    docs/reference/exchange.md lists all formats).

    Args:
      input_path: Folder of a model, or a file of another program; the option
        input_type names its format if its extension does not.
      output_path: File or folder to write.
      output_type: Such as "bin", "txt", "ply", "nvm", "tum".
    """
    run("model_converter", options, log=log, input_path=input_path,
        output_path=output_path, output_type=output_type)


def analyze_model(path: Model, options: OptionsLike = None, *,
                  log: Optional[Log] = None) -> str:
    """The text with statistics of a model that model_analyzer prints."""
    return str(run("model_analyzer", options, log=log, path=path))


def merge_databases(database_paths: Union[PathLike, Sequence[PathLike], None],
                    merged_database_path: PathLike,
                    options: OptionsLike = None, *,
                    log: Optional[Log] = None,
                    progress: Optional[Progress] = None) -> None:
    """Merges shards, or databases of different images (database_merger).

    Args:
      database_paths: In any order; None with the option database_list_path.
      merged_database_path: Database to write; it must not exist.
      options: Such as image_prefix and vehicle, lists with a value per database.
    """
    run("database_merger", options, log=log, progress=progress,
        database_path=database_paths,
        merged_database_path=merged_database_path)


def clean_database(database_path: PathLike, type: str,
                   options: OptionsLike = None, *,
                   log: Optional[Log] = None) -> None:
    """Deletes rows of a database (database_cleaner).

    Args:
      type: "matches", "features", "images" or "all".
    """
    run("database_cleaner", options, log=log, database_path=database_path,
        type=type)
