# SPDX-License-Identifier: BSD-3-Clause
"""Compares features and matches with those of COLMAP on the same images."""
import pathlib
import shutil
import sqlite3
import statistics
import tempfile

from experiments import options, peers
from experiments.measure import run_measured
from experiments.colmap_database import image_ids_of_pair

DESCRIPTION = """\
Features and matches of mgsfm and COLMAP, in turn, on the same images.

  python3 -m experiments compare_front_end IMAGES --num_frames 15 \\
      [-- OPTION VALUE ...]

IMAGES contains one folder for each camera. The first images of each folder are
used, and all their pairs matched, by both programs on the processor with the
same number of threads. Options behind -- go to both extractors, e.g.
--ImageReader.camera_model PINHOLE --ImageReader.camera_params 700,700,600,180.
Both matchers run on the features of both programs. Prints seconds and the
verified inliers of pairs; ratios are those of one call."""


def add_parser(subparsers):
    """The subcommand compare_front_end."""
    parser = options.add_command(
        subparsers, "compare_front_end", run,
        "features and matches beside those of COLMAP", DESCRIPTION)
    parser.set_defaults(takes_passed_on=True)
    parser.add_argument("images", type=pathlib.Path,
                        help="folder with one folder for each camera")
    parser.add_argument("--num_frames", type=options.positive(int), default=15,
                        help="images of each camera")
    options.add_threads(parser, 2)
    options.add_program(parser)


def run(arguments):
    """Extracts, matches, and prints the comparison."""
    program = options.find_program(arguments.program)
    if shutil.which("colmap") is None:
        raise SystemExit("no program colmap; install the Debian package colmap")
    with tempfile.TemporaryDirectory() as scratch:
        comparison = Comparison(program, arguments, pathlib.Path(scratch))
        comparison.extract()
        for features in ("mgsfm", "colmap"):
            comparison.match(features)


def copy_images(source, target, num_frames):
    """Copies the first images of each folder; returns their number."""
    folders = sorted(path for path in source.iterdir() if path.is_dir())
    num_images = 0
    for folder in folders:
        (target / folder.name).mkdir(parents=True)
        for image in sorted(folder.iterdir())[:num_frames]:
            shutil.copy(image, target / folder.name)
            num_images += 1
    return num_images


def inliers_of(database):
    """{names of both images: verified inliers} of a database."""
    with sqlite3.connect(f"file:{database}?mode=ro", uri=True) as connection:
        names = dict(connection.execute("SELECT image_id, name FROM images"))
        rows = connection.execute(
            "SELECT pair_id, rows FROM two_view_geometries WHERE rows > 0")
        return {tuple(sorted(names[i] for i in image_ids_of_pair(pair))): num
                for pair, num in rows}


def num_features_of(database):
    """The number of keypoints of all images."""
    with sqlite3.connect(f"file:{database}?mode=ro", uri=True) as connection:
        return connection.execute(
            "SELECT sum(rows) FROM keypoints").fetchone()[0]


class Comparison:
    """Both programs on a copy of the images in a scratch folder."""

    def __init__(self, program, arguments, scratch):
        self.scratch = scratch
        self.images = scratch / "images"
        self.num_images = copy_images(
            arguments.images, self.images, arguments.num_frames)
        self.mgsfm = program
        self.threads = arguments.threads
        self.options = arguments.passed_on

    def extract(self):
        """Features of both programs, into mgsfm.db and colmap.db."""
        ours = run_measured(
            [self.mgsfm, "feature_extractor", "--database_path",
             self.scratch / "mgsfm.db", "--image_path", self.images,
             "--num_threads", self.threads, *self.options])
        theirs = self.run_colmap(
            "feature_extractor", "--database_path",
            self.scratch / "colmap.db", "--image_path", self.images,
            "--ImageReader.single_camera_per_folder", "1",
            "--SiftExtraction.use_gpu", "0",
            "--SiftExtraction.num_threads", self.threads, *self.options)
        self.print_costs("extraction", ours, theirs)
        print("  features: "
              f"{num_features_of(self.scratch / 'mgsfm.db')} mgsfm, "
              f"{num_features_of(self.scratch / 'colmap.db')} COLMAP")

    def match(self, features):
        """Both matchers on the features of one program."""
        databases = [self.scratch / f"{features}_{name}.db"
                     for name in ("ours", "theirs")]
        for database in databases:
            shutil.copy(self.scratch / f"{features}.db", database)
        ours = run_measured(
            [self.mgsfm, "exhaustive_matcher", "--database_path", databases[0],
             "--num_threads", self.threads])
        theirs = self.run_colmap(
            "exhaustive_matcher", "--database_path", databases[1],
            "--SiftMatching.use_gpu", "0",
            "--SiftMatching.num_threads", self.threads)
        self.print_costs(f"matching with verification, features of {features}",
                         ours, theirs)
        inliers = [inliers_of(database) for database in databases]
        common = sorted(inliers[0].keys() & inliers[1].keys())
        if not common:
            print("  no pair was verified by both")
            return
        medians = [statistics.median(values[pair] for pair in common)
                   for values in inliers]
        print(f"  verified pairs: {len(inliers[0])} mgsfm, {len(inliers[1])} "
              f"COLMAP; median inliers of the {len(common)} common ones: "
              f"{medians[0]:g} mgsfm, {medians[1]:g} COLMAP, "
              f"ratio {medians[0] / medians[1]:.3f}", flush=True)

    @staticmethod
    def run_colmap(*words):
        """The cost of a command of COLMAP."""
        return run_measured(["colmap", *words], peers.environment())

    def print_costs(self, name, ours, theirs):
        """Seconds, processor seconds and their ratio."""
        print(f"{name}, {self.num_images} images: "
              f"{ours['seconds']:.1f} s mgsfm, {theirs['seconds']:.1f} s "
              f"COLMAP, {theirs['seconds'] / ours['seconds']:.1f} times; "
              f"{ours['processor_seconds']:.1f} s and "
              f"{theirs['processor_seconds']:.1f} s on processors",
              flush=True)
