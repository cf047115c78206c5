# SPDX-License-Identifier: BSD-3-Clause
"""Misplaced frames, seams, and the subcommand hard_drives."""
import csv
import math
import random

import pytest

from experiments import alignment, poses
from experiments.studies import hard_evaluation, seam_reliability


def random_turn(generator):
    """A random unit quaternion."""
    return alignment.normalized([generator.gauss(0, 1) for _ in range(4)])


def transformed(similarity, turn, pose):
    """A pose in a world that is transformed."""
    quaternion, center = pose
    return (alignment.multiply(quaternion, alignment.conjugate(turn)),
            similarity.apply(center))


def make_similarity(generator):
    """A random similarity, and its rotation as a quaternion."""
    turn = random_turn(generator)
    return alignment.Similarity(
        2.5, poses.rotation_from_quaternion(*turn), (3.0, -8.0, 20.0)), turn


def road(num_frames, bend=0.02):
    """{frame: pose} along a road in the plane y = 0."""
    frames, x, z = {}, 0.0, 0.0
    for i in range(num_frames):
        yaw = bend * i
        # cam_from_world turns by -yaw about y.
        frames[f"{i:06d}"] = ((math.cos(0.5 * yaw), 0.0,
                               -math.sin(0.5 * yaw), 0.0), (x, 0.0, z))
        x, z = x + math.sin(yaw), z + math.cos(yaw)
    return frames


@pytest.mark.parametrize("bend", (0.0, 0.02))
def test_alignment_of_a_transformed_road(bend):
    generator = random.Random(1)
    truth = list(road(50, bend).values())
    similarity, turn = make_similarity(generator)
    model = [transformed(similarity, turn, pose) for pose in truth]
    fit = alignment.align(model, truth)
    for position, angle in alignment.errors(fit, model, truth):
        assert position == pytest.approx(0.0, abs=1e-6)
        assert angle == pytest.approx(0.0, abs=1e-4)


@pytest.mark.parametrize("num_frames", (3, 8))
def test_rotations_align_a_short_straight_road(num_frames):
    generator = random.Random(3)
    truth = list(road(num_frames, 0.0).values())
    similarity, turn = make_similarity(generator)
    model = []
    for pose in truth:
        quaternion, center = transformed(similarity, turn, pose)
        model.append((quaternion, tuple(
            x + 2.5 * generator.gauss(0.0, 0.02) for x in center)))
    fit = alignment.align(model, truth)
    for position, angle in alignment.errors(fit, model, truth):
        assert position < 0.1
        assert angle < 0.5


def test_one_turned_frame_does_not_turn_the_others():
    generator = random.Random(4)
    similarity, turn = make_similarity(generator)
    truth = list(road(5).values())
    poses_of_model = [transformed(similarity, turn, pose) for pose in truth]
    quaternion, center = poses_of_model[3]
    poses_of_model[3] = (
        alignment.multiply((math.sqrt(0.5), math.sqrt(0.5), 0.0, 0.0),
                           quaternion),
        tuple(x + 100.0 for x in center))
    fit = alignment.align(poses_of_model, truth)
    errors = alignment.errors(fit, poses_of_model, truth)
    assert all(angle < 0.5 for k, (_, angle) in enumerate(errors) if k != 3)
    assert errors[3][1] == pytest.approx(90.0, abs=0.5)


def torn(num_frames, first_moved):
    """{frame: (pose in the model, truth)}: the end of the road is turned by 90
    degrees about the up axis, and shifted."""
    generator = random.Random(2)
    turn = (math.sqrt(0.5), 0.0, math.sqrt(0.5), 0.0)
    tear = alignment.Similarity(
        1.0, poses.rotation_from_quaternion(*turn), (30.0, 0.0, 5.0))
    similarity, world_turn = make_similarity(generator)
    frames = {}
    for i, (frame, pose) in enumerate(road(num_frames).items()):
        moved = transformed(tear, turn, pose) if i >= first_moved else pose
        frames[frame] = (transformed(similarity, world_turn, moved), pose)
    return frames


def seam_at(frames, number):
    """The seam before a frame."""
    names = list(frames)
    return set(names[:number]), set(names[number:])


def test_a_named_seam_covers_misplaced_frames():
    frames = torn(60, 40)
    result = hard_evaluation.evaluate_model(frames, [seam_at(frames, 40)])
    assert result["misplaced"] == list(frames)[40:]
    assert not result["silent"]
    assert result["num_false_seams"] == 0


def test_without_a_seam_all_misplaced_frames_are_silent():
    frames = torn(60, 40)
    result = hard_evaluation.evaluate_model(frames, [])
    assert set(result["misplaced"]) >= set(list(frames)[40:])
    assert result["silent"] == result["misplaced"]


def test_a_seam_elsewhere_is_false_and_does_not_help():
    frames = torn(60, 40)
    result = hard_evaluation.evaluate_model(frames, [seam_at(frames, 10)])
    assert set(result["silent"]) == set(list(frames)[40:])
    assert result["num_false_seams"] == 1


def test_a_gross_failure_is_a_mean_or_a_single_frame():
    def row(positions, rotations):
        return hard_evaluation.summarize([{
            "positions_m": positions, "rotations_deg": rotations,
            "misplaced": [], "silent": [], "num_seams": 0,
            "num_false_seams": 0}], 4)
    assert not row([0.9] * 4, [1.0] * 4)["is_gross"]
    assert row([1.1] * 4, [1.0] * 4)["is_gross"]
    assert row([0.1, 0.1, 0.1, 5.1], [1.0] * 4)["is_gross"]
    assert row([0.1] * 4, [0.1, 0.1, 0.1, 5.1])["is_gross"]
    assert hard_evaluation.summarize([], 4)["is_gross"]


def test_seams_of_a_report():
    frames = [f"{i:06d}" for i in range(1, 9)]
    assert hard_evaluation.seams_of({}, frames) == []
    assert hard_evaluation.seams_of({"seams": [
        {"frames_before": ["000001", ["000006", "000008"]],
         "frames_after": [["cam0/000002.png", "cam0/000003.png"]]}]},
                                    frames) == [
             ({"000001", "000006", "000007", "000008"}, {"000002", "000003"})]


def test_relative_errors_do_not_depend_on_the_world():
    generator = random.Random(3)
    truth = list(road(2).values())
    similarity, turn = make_similarity(generator)
    first, second = (transformed(similarity, turn, pose) for pose in truth)
    scale = 1.0 / similarity.scale
    position, rotation = seam_reliability.relative_errors(
        (first, truth[0]), (second, truth[1]), scale)
    assert position == pytest.approx(0.0, abs=1e-9)
    assert rotation == pytest.approx(0.0, abs=1e-6)
    # Turns the second camera by 0.01 degrees about a random axis.
    axis = alignment.normalized([generator.gauss(0, 1) for _ in range(3)])
    half = math.radians(0.005)
    wrong = (math.cos(half), *(math.sin(half) * x for x in axis))
    turned = alignment.multiply(wrong, second[0]), second[1]
    position, rotation = seam_reliability.relative_errors(
        (first, truth[0]), (turned, truth[1]), scale)
    assert position == pytest.approx(0.0, abs=1e-9)
    assert rotation == pytest.approx(0.01, rel=1e-6)


def test_reliability_of_known_ratios():
    # Errors are twice the standard deviations of positions, and half those of
    # rotations; a misplaced frame does not count.
    seams = [{"position": [0.01 * i, 0.02 * i], "rotation": [0.2 * i, 0.1 * i],
              "is_misplaced": False} for i in range(1, 12)]
    seams.append({"position": [0.1, 50.0], "rotation": [0.1, 90.0],
                  "is_misplaced": True})
    lines = seam_reliability.reliability_table(
        [{"seam_errors": seams[:6]}, {"seam_errors": seams[6:]}, {}]
    ).splitlines()[2:]
    cells = [[cell.strip() for cell in line.strip("|").split("|")]
             for line in lines]
    assert len(cells) == 2 * (1 + seam_reliability.NUM_BINS)
    assert cells[0] == ["position", "all", "11", "0.0600 m", "0.1200 m",
                        "2.00", "0 %"]
    assert {row[5] for row in cells} == {"2.00", "0.50"}
    assert sum(int(row[2]) for row in cells[1:6]) == 11
    assert seam_reliability.reliability_table([{}]) == ""


def test_hard_drives_resumes_and_leaves_only_results(
        program, run_experiments, try_experiments, tmp_path):
    data = tmp_path / "trajectories"
    data.mkdir()
    lines = []
    for i in range(40):
        lines.append(f"1 0 0 0 0 1 0 0 0 0 1 {0.8 * i}\n")
    (data / "07.txt").write_text("".join(lines))
    words = ["hard_drives", data, "--program", program, "--presets",
             "moderate", "--rigs", "stereo", "--seeds", "1,2", "--frame_step",
             "2", "--jobs", "2", "--output", tmp_path / "out"]
    first = run_experiments(*words)
    with open(tmp_path / "out/drives.csv", encoding="utf-8") as file:
        rows = list(csv.DictReader(file))
    assert [row["name"] for row in rows] == ["moderate_07_stereo_1",
                                             "moderate_07_stereo_2"]
    assert all(row["num_frames"] == "20" for row in rows)
    assert sorted(path.name for path in (tmp_path / "out").iterdir()) == [
        "drives.csv", "drives.md", "moderate_07_stereo_1.json",
        "moderate_07_stereo_2.json"]
    # The second call only prints the tables.
    second = run_experiments(*words)
    assert first.endswith(second)
    other = try_experiments(*words, "--", "--BundleAdjustment.max_num_iterations",
                            "5")
    assert other.returncode != 0
    assert "choose another --output" in other.stderr
