# SPDX-License-Identifier: BSD-3-Clause
"""Commands and options by pycolmap's names, where those differ.

The options have mgsfm's names and defaults; an unknown one raises InputError.
[The table](pycolmap.md) lists all names.
"""

from __future__ import annotations

from typing import Any, Dict, Optional

from .commands import Log, Model, PathLike, Progress, match_vocab_tree
from .options import OptionGroup, Options, OptionsLike
from .tools import undistort


def match_vocabtree(database_path: PathLike, options: OptionsLike = None, *,
                    log: Optional[Log] = None,
                    progress: Optional[Progress] = None) -> None:
    """match_vocab_tree"""
    match_vocab_tree(database_path, options, log=log, progress=progress)


def undistort_images(output_path: PathLike, input_path: Model,
                     image_path: PathLike, options: OptionsLike = None, *,
                     output_type: str = "COLMAP", log: Optional[Log] = None,
                     progress: Optional[Progress] = None) -> None:
    """undistort, in pycolmap's order of arguments."""
    undistort(image_path, input_path, output_path,
              {**_values(options), "output_type": output_type}, log=log,
              progress=progress)


def _values(options: OptionsLike) -> Dict[str, Any]:
    return dict(options.changed() if isinstance(options, OptionGroup)
                else options or {})


def _group(command: str, name: str, values: Dict[str, Any]) -> OptionGroup:
    group: OptionGroup = getattr(Options(command), name)
    group.update(values)
    return group


def ImageReaderOptions(**values: Any) -> OptionGroup:  # noqa: N802
    """The group ImageReader of the options of extract_features."""
    return _group("feature_extractor", "ImageReader", values)


def SiftExtractionOptions(**values: Any) -> OptionGroup:  # noqa: N802
    """The group SiftExtraction of the options of extract_features."""
    return _group("feature_extractor", "SiftExtraction", values)


def SiftMatchingOptions(**values: Any) -> OptionGroup:  # noqa: N802
    """The group SiftMatching of the options of match functions."""
    return _group("exhaustive_matcher", "SiftMatching", values)


def TwoViewGeometryOptions(**values: Any) -> OptionGroup:  # noqa: N802
    """The group TwoViewGeometry of the options of match functions, and the
    options of estimate_two_view_geometry."""
    return _group("exhaustive_matcher", "TwoViewGeometry", values)


def BundleAdjustmentOptions(**values: Any) -> OptionGroup:  # noqa: N802
    """The group BundleAdjustment of the options of bundle_adjustment."""
    return _group("bundle_adjuster", "BundleAdjustment", values)


def IncrementalPipelineOptions(**values: Any) -> Options:  # noqa: N802
    """The options of incremental_mapping and global_mapping."""
    return Options("mapper", values)


GlobalPipelineOptions = IncrementalPipelineOptions
