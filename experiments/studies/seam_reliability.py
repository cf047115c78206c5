# SPDX-License-Identifier: BSD-3-Clause
"""How well the standard deviations of seams predict actual errors.

The error of a seam is that of the pose of one of the two frames next to it
relative to the other. Seams with a misplaced frame do not count: the standard
deviations hold if the points that cross the seam are right.
"""
import math
import pathlib
import statistics

from experiments import alignment, colmap_model, poses, tables
from experiments.studies import hard_evaluation

MIN_FRAMES = 10  # of a model: fewer do not determine its scale
NUM_BINS = 5
KINDS = ("position", "rotation")
UNITS = {"position": "m", "rotation": "deg"}


def read_images(folder, truth):
    """{frame: {camera: (pose in the model, true pose)}}."""
    images = {}
    for name, pose in sorted(colmap_model.read_poses(folder).items()):
        if name in truth:
            camera = str(pathlib.PurePosixPath(name).parent)
            images.setdefault(hard_evaluation.frame_of(name), {})[camera] = (
                alignment.pose_of(*pose), truth[name])
    return images


def relative_pose(pose1, pose2):
    """(second_from_first, position of the second in the first)."""
    rotation = poses.rotation_from_quaternion(*pose1[0])
    offset = [b - a for a, b in zip(pose1[1], pose2[1])]
    return (alignment.multiply(pose2[0], alignment.conjugate(pose1[0])),
            [alignment.dot(row, offset) for row in rotation])


def relative_errors(image1, image2, scale):
    """The errors of the position (in m) and the rotation (in degrees)."""
    turn, position = relative_pose(image1[0], image2[0])
    true_turn, true_position = relative_pose(image1[1], image2[1])
    wrong = alignment.multiply(turn, alignment.conjugate(true_turn))
    sine = min(1.0, math.hypot(*wrong[1:]))  # accurate for small angles
    return (math.dist([scale * x for x in position], true_position),
            math.degrees(2.0 * math.asin(sine)))


def evaluate_seams(model_report, folder, truth):
    """Predicted and actual errors of the seams of a model, one entry each."""
    images = read_images(folder, truth)
    if len(images) < MIN_FRAMES:
        return []
    first = {frame: next(iter(images[frame].values())) for frame in images}
    fit = alignment.align([m for m, _ in first.values()],
                          [t for _, t in first.values()])
    errors = hard_evaluation.errors_of(first, first)
    entries = []
    for seam in model_report.get("seams", []):
        if seam["sigma_position"] is None:
            continue
        before, after = (hard_evaluation.frame_of(seam[key])
                         for key in ("frame_before", "frame_after"))
        both = images.get(before, {}).keys() & images.get(after, {}).keys()
        if not both:
            continue
        camera = min(both)
        position, rotation = relative_errors(
            images[before][camera], images[after][camera], fit.scale)
        entries.append({
            "position": [fit.scale * seam["sigma_position"], position],
            "rotation": [seam["sigma_rotation_deg"], rotation],
            "is_misplaced": any(hard_evaluation.is_misplaced(errors[frame])
                                for frame in (before, after))})
    return entries


def bins_of(samples):
    """All samples (predicted, actual), then bins of equal size, by ascending
    prediction."""
    ordered = sorted(samples)
    count = len(ordered)
    bins = [ordered[i * count // NUM_BINS:(i + 1) * count // NUM_BINS]
            for i in range(NUM_BINS)]
    return [ordered] + [one for one in bins if one]


def reliability_table(rows):
    """A Markdown table of predicted against actual errors of the seams of all
    drives; empty without seams."""
    seams = [seam for row in rows for seam in row.get("seam_errors", [])]
    right = [seam for seam in seams if not seam["is_misplaced"]]
    cells = []
    for kind in KINDS if right else ():
        for number, members in enumerate(
                bins_of([tuple(seam[kind]) for seam in right])):
            predicted, actual = (statistics.median(values)
                                 for values in zip(*members))
            beyond = sum(a > 2.0 * p for p, a in members) / len(members)
            cells.append([
                kind, f"bin {number}" if number else "all", str(len(members)),
                f"{predicted:.4f} {UNITS[kind]}", f"{actual:.4f} {UNITS[kind]}",
                f"{actual / predicted:.2f}", f"{100.0 * beyond:.0f} %"])
    return tables.markdown_table(
        ["seams with both frames in place", "bin", "seams",
         "median standard deviation", "median error", "ratio",
         "errors beyond two standard deviations"], cells) if cells else ""
