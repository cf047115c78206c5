# SPDX-License-Identifier: BSD-3-Clause
"""How far frames of models are misplaced, and whether their report says so.

A frame is misplaced if it is off by more than MAX_POSITION_M or
MAX_ROTATION_DEG. A gross failure is a mean position error above MAX_MEAN_M, or
a misplaced frame.
"""
import pathlib
import statistics

from experiments import alignment, colmap_model

MAX_MEAN_M = 1.0
MAX_POSITION_M = 5.0
MAX_ROTATION_DEG = 5.0
# A seam is false if the median frame of its smaller side is closer than this to
# its place, with respect to the larger side.
MIN_SEAM_M = 1.0
MIN_SEAM_DEG = 1.0
NUM_FITTED_FRAMES = 100  # of a side of a seam, as there may be many seams


def frame_of(image):
    """The frame of an image "CAMERA/FRAME.EXTENSION", or of a frame's name."""
    return pathlib.PurePosixPath(image).stem


def read_frames(folder, truth):
    """{frame: (pose in the model, true pose)} by one image of each frame.

    truth: {image name: pose}.
    """
    frames = {}
    for name, pose in sorted(colmap_model.read_poses(folder).items()):
        if name in truth and frame_of(name) not in frames:
            frames[frame_of(name)] = (alignment.pose_of(*pose), truth[name])
    return frames


def errors_of(frames, aligned_by):
    """{frame: (position error, rotation error)} of all frames of a model,
    aligned by some of them."""
    used = [frames[frame] for frame in aligned_by]
    fit = alignment.align([m for m, _ in used], [t for _, t in used])
    found = alignment.errors(fit, [m for m, _ in frames.values()],
                             [t for _, t in frames.values()])
    return dict(zip(frames, found))


def is_misplaced(error):
    """True beyond the limits of a gross failure."""
    return error[0] > MAX_POSITION_M or error[1] > MAX_ROTATION_DEG


def sides_of(frames, seams):
    """The frames in groups that no seam separates, the largest group first."""
    groups = {}
    for frame in frames:
        key = tuple((frame in before) - (frame in after)
                    for before, after in seams)
        groups.setdefault(key, []).append(frame)
    return sorted(groups.values(), key=len, reverse=True)


def is_false_seam(frames, seam):
    """True if both sides of a seam are in their places."""
    sides = sorted(([f for f in frames if f in side] for side in seam),
                   key=len)
    if not sides[0]:
        return True
    step = 1 + len(sides[1]) // NUM_FITTED_FRAMES
    errors = errors_of(frames, sides[1][::step])
    smaller = [errors[frame] for frame in sides[0]]
    return (statistics.median(e[0] for e in smaller) < MIN_SEAM_M
            and statistics.median(e[1] for e in smaller) < MIN_SEAM_DEG)


def seams_of(model_report, frames):
    """[(frames before, frames after)] of the seams that the report names, by
    names or by ranges [first, last]."""
    def is_in(frame, entry):
        first, last = (entry, entry) if isinstance(entry, str) else entry
        return frame_of(first) <= frame <= frame_of(last)
    return [tuple({frame for frame in frames
                   if any(is_in(frame, entry) for entry in seam[side])}
                  for side in ("frames_before", "frames_after"))
            for seam in model_report.get("seams", [])]


def evaluate_model(frames, seams):
    """Errors of a model, and the misplaced frames with and without a seam."""
    errors = errors_of(frames, frames)
    sides = sides_of(frames, seams)
    from_largest = errors_of(frames, sides[0]) if seams else errors
    misplaced = [f for f in frames if is_misplaced(from_largest[f])]
    largest = set(sides[0])
    return {"positions_m": [e[0] for e in errors.values()],
            "rotations_deg": [e[1] for e in errors.values()],
            "misplaced": misplaced,
            "silent": [f for f in misplaced if f in largest],
            "num_seams": len(seams),
            "num_false_seams": sum(is_false_seam(frames, s) for s in seams)}


def evaluate(report, folders, truth):
    """The row of a drive: each model of the report is aligned on its own."""
    models = []
    for model_report, folder in zip(report["models"], folders):
        frames = read_frames(folder, truth)
        if len(frames) >= 3:
            models.append(evaluate_model(frames, seams_of(model_report, frames)))
    return summarize(models, len({frame_of(name) for name in truth}))


def summarize(models, num_frames):
    """One row for all models of a drive."""
    def joined(key):
        return [value for model in models for value in model[key]]
    positions, rotations = joined("positions_m"), joined("rotations_deg")
    row = {"num_frames": num_frames, "num_placed": len(positions),
           "num_models": len(models)}
    if not positions:
        return {**row, "is_gross": True, "num_misplaced": 0, "num_silent": 0,
                "num_seams": 0, "num_false_seams": 0, "misplaced": []}
    row.update(mean_m=statistics.fmean(positions),
               median_m=statistics.median(positions), max_m=max(positions),
               max_deg=max(rotations))
    row["is_gross"] = (row["mean_m"] > MAX_MEAN_M
                       or is_misplaced((row["max_m"], row["max_deg"])))
    row.update(num_misplaced=len(joined("misplaced")),
               num_silent=len(joined("silent")),
               num_seams=sum(m["num_seams"] for m in models),
               num_false_seams=sum(m["num_false_seams"] for m in models),
               misplaced=joined("misplaced"))
    return row
