# SPDX-License-Identifier: BSD-3-Clause
"""Features and matches beside those of COLMAP, in turn, on the same images.

usage: compare_front_end.py IMAGES [--num_frames N] [-- OPTION VALUE ...]

IMAGES holds a folder for each camera. The first N images of each folder are
taken, and all their pairs matched, both programs on the processor with the same
number of threads. Options behind -- go to both extractors, as
--ImageReader.camera_model PINHOLE --ImageReader.camera_params 700,700,600,180.
COLMAP's matcher runs on our features and on its own; so do we. Prints seconds
and the verified inliers of pairs. Ratios are of one run.
"""
import argparse
import os
import pathlib
import shutil
import sqlite3
import statistics
import sys
import tempfile

from measuring import run_measured


def copy_images(source, target, num_frames):
    """The first images of each folder; how many there are in all."""
    folders = sorted(path for path in source.iterdir() if path.is_dir())
    num_images = 0
    for folder in folders:
        (target / folder.name).mkdir(parents=True)
        for image in sorted(folder.iterdir())[:num_frames]:
            shutil.copy(image, target / folder.name)
            num_images += 1
    return num_images


def inliers_of(database):
    """Verified inliers of each pair, by the names of its images."""
    with sqlite3.connect(f"file:{database}?mode=ro", uri=True) as connection:
        names = dict(connection.execute("SELECT image_id, name FROM images"))
        rows = connection.execute(
            "SELECT pair_id, rows FROM two_view_geometries WHERE rows > 0")
        return {tuple(sorted((names[pair // 2147483647],
                              names[pair % 2147483647]))): num_inliers
                for pair, num_inliers in rows}


def num_features_of(database):
    with sqlite3.connect(f"file:{database}?mode=ro", uri=True) as connection:
        return connection.execute("SELECT sum(rows) FROM keypoints").fetchone()[0]


class Comparison:
    def __init__(self, arguments, options, scratch):
        self.scratch = scratch
        self.images = scratch / "images"
        self.num_images = copy_images(
            arguments.images, self.images, arguments.num_frames)
        self.mgsfm = arguments.program
        self.threads = arguments.threads
        self.options = options

    def extract(self):
        ours = run_measured(
            [self.mgsfm, "feature_extractor", "--database_path",
             self.scratch / "mgsfm.db", "--image_path", self.images,
             "--num_threads", self.threads, *self.options])
        theirs = run_measured(
            ["colmap", "feature_extractor", "--database_path",
             self.scratch / "colmap.db", "--image_path", self.images,
             "--ImageReader.single_camera_per_folder", "1",
             "--SiftExtraction.use_gpu", "0",
             "--SiftExtraction.num_threads", self.threads, *self.options])
        self.report("extraction", ours, theirs)
        print("  features: "
              f"{num_features_of(self.scratch / 'mgsfm.db')} ours, "
              f"{num_features_of(self.scratch / 'colmap.db')} COLMAP's")

    def match(self, features):
        """Both programs, on the features of one of them."""
        databases = [self.scratch / f"{features}_{name}.db"
                     for name in ("ours", "theirs")]
        for database in databases:
            shutil.copy(self.scratch / f"{features}.db", database)
        ours = run_measured(
            [self.mgsfm, "exhaustive_matcher", "--database_path", databases[0],
             "--num_threads", self.threads])
        theirs = run_measured(
            ["colmap", "exhaustive_matcher", "--database_path", databases[1],
             "--SiftMatching.use_gpu", "0",
             "--SiftMatching.num_threads", self.threads])
        self.report(f"matching with verification, features of {features}",
                    ours, theirs)
        inliers = [inliers_of(database) for database in databases]
        common = sorted(inliers[0].keys() & inliers[1].keys())
        medians = [statistics.median(values[pair] for pair in common)
                   for values in inliers]
        print(f"  verified pairs: {len(inliers[0])} ours, {len(inliers[1])} "
              f"COLMAP's; median inliers of the {len(common)} common ones: "
              f"{medians[0]:g} ours, {medians[1]:g} COLMAP's, "
              f"ratio {medians[0] / medians[1]:.3f}", flush=True)

    def report(self, name, ours, theirs):
        print(f"{name}, {self.num_images} images: "
              f"{ours['seconds']:.1f} s ours, {theirs['seconds']:.1f} s "
              f"COLMAP, {theirs['seconds'] / ours['seconds']:.1f} times; "
              f"{ours['processor_seconds']:.1f} s and "
              f"{theirs['processor_seconds']:.1f} s on processors",
              flush=True)


def main():
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawTextHelpFormatter)
    parser.add_argument("images", type=pathlib.Path)
    parser.add_argument("--num_frames", type=int, default=15)
    parser.add_argument("--threads", default="2")
    parser.add_argument("--program", default=os.path.join(
        os.path.dirname(__file__), "../build/release/apps/mgsfm/mgsfm"))
    values = sys.argv[1:]
    end = values.index("--") if "--" in values else len(values)
    arguments = parser.parse_args(values[:end])
    os.environ["QT_QPA_PLATFORM"] = "offscreen"
    with tempfile.TemporaryDirectory() as scratch:
        comparison = Comparison(arguments, values[end + 1:],
                                pathlib.Path(scratch))
        comparison.extract()
        for features in ("mgsfm", "colmap"):
            comparison.match(features)


if __name__ == "__main__":
    main()
