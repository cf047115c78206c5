# SPDX-License-Identifier: BSD-3-Clause
"""What the parts of the report page say about a model and its run."""

import json
import pathlib
import re
import shlex

import numpy as np
import pytest

import models

REPOSITORY = pathlib.Path(__file__).resolve().parents[3]


@pytest.fixture(scope="module")
def positioned(mgsfm, tmp_path_factory):
    """A model in the world of measured positions, two of which are wrong."""
    folder = tmp_path_factory.mktemp("positioned")
    mgsfm("simulate", preset="standard", rig="stereo", num_frames=60,
          prior_sigma=0.05, prior_outlier_ratio=0.05, output_path=folder)
    mgsfm("mapper", database_path=folder / "database.db",
          output_path=folder / "it's sparse", use_prior_position=1,
          min_num_frames=4)
    return folder / "it's sparse"


def cells_of(page, section):
    return page.evaluate(
        f"[...document.querySelectorAll('#{section} tr')].map((row) =>"
        " [...row.cells].map((cell) => cell.innerText))")


def test_measured_positions_have_residuals_and_a_map(positioned, browser):
    page = browser.open((positioned / "0" / "report.html").as_uri())
    report = json.loads((positioned / "report.json").read_text())
    priors = report["models"][0]["position_priors"]
    assert priors["outliers"]
    rows = cells_of(page, "positions")
    shown = {row[0]: float(row[1].split()[0]) for row in rows if len(row) == 2
             and row[0].endswith(".png")}
    assert shown == {outlier["image"]: pytest.approx(outlier["distance"], abs=0.01)
                     for outlier in priors["outliers"]}
    # Outliers are the largest residuals, in the table and in the 3D view.
    largest = max(outlier["distance"] for outlier in priors["outliers"])
    position = next(row for row in rows if row[0] == "position [m]")
    assert float(position[3]) == pytest.approx(largest, rel=1e-2)
    distances = np.array(page.evaluate(
        "[...mgsfmPage.data.arrays.measured_position_error]"))
    assert np.nanmax(distances) == pytest.approx(largest, rel=1e-2)
    used = np.sort(distances[np.isfinite(distances)])[:priors["num_used"]]
    assert np.sqrt(np.mean(used ** 2)) == pytest.approx(priors["rms"], rel=0.1)
    assert page.evaluate(
        "document.querySelector('#positions svg').innerHTML").count("<polyline") > 2
    assert "rotation" not in page.evaluate(
        "document.getElementById('positions').innerText")
    assert page.complaints() == []


def test_the_foot_tells_how_to_repeat_the_run(positioned, browser, program):
    page = browser.open((positioned / "0" / "report.html").as_uri())
    rows = dict(row for row in cells_of(page, "run") if len(row) == 2)
    assert re.fullmatch(r"\d{4}-\d\d-\d\d \d\d:\d\d UTC", rows["written"])
    assert "commit " in rows["program"]
    words = shlex.split(rows["command"])
    assert words[:2] == ["mgsfm", "mapper"]
    assert words[words.index("--output_path") + 1] == str(positioned)
    changed = rows["options that differ from their defaults"].split(", ")
    assert "min_num_frames 4" in changed
    assert "use_prior_position true" in changed
    assert {option.split()[0] for option in changed} == {
        word[2:] for word in words if word.startswith("--")}


def test_coverage_is_the_seen_share_of_the_image(report, tmp_path):
    model = models.make_drive(num_sensors=1, points_per_frame=40)
    page, _ = report(models.write_model(model, tmp_path / "0"))
    seen = {(int(24 * x / models.WIDTH_PX), int(18 * y / models.HEIGHT_PX))
            for keypoints in model.keypoints for x, y, point in keypoints
            if len(model.tracks[point]) >= 2}
    head, row = cells_of(page, "registration")[:2]
    share = float(row[head.index("coverage of the image")].split("\u00a0")[0])
    assert share == pytest.approx(100 * len(seen) / (24 * 18), abs=0.5)


def without_images(model, is_missing):
    """The model without some of its images."""
    kept = [i for i, name in enumerate(model.names) if not is_missing(name)]
    new = {image: i for i, image in enumerate(kept)}
    model.tracks = [[(new[image], keypoint) for image, keypoint in track
                     if image in new] for track in model.tracks]
    for key in ("names", "keypoints", "camera_of_image"):
        setattr(model, key, [getattr(model, key)[i] for i in kept])
    model.rotations = model.rotations[kept]
    model.translations = model.translations[kept]
    return model


def test_frames_have_one_order_when_images_are_missing(report, tmp_path):
    model = without_images(
        models.make_drive(name="cam{sensor}/{frame}.png"),
        lambda name: name.endswith("/7.png") or name == "cam0/9.png")
    folder = models.write_model(model, tmp_path / "0")
    frames = [str(frame) for frame in range(20) if frame != 7]
    page, _ = report(folder, gt_path=folder)
    names = [re.findall(r"\d+", name)[-1]
             for name in page.evaluate("mgsfmPage.data.frameNames")]
    assert names == frames
    # The path of the 3D view and that of the chart go from frame to frame.
    centers = np.reshape(page.evaluate(
        "[...mgsfmPage.data.arrays.frame_center]"), (-1, 3))
    steps = np.linalg.norm(np.diff(centers, axis=0), axis=1)
    assert steps.max() < 2.1 * models.STEP
    distances = [float(text) for text in page.evaluate(
        "[...document.querySelectorAll('#truth svg text')]"
        ".map((text) => text.textContent)") if re.fullmatch(r"\d+(\.\d+)?", text)]
    assert max(distances) <= 20 * models.STEP  # along the path
    # A seam beside the missing frame lies between the frames that exist.
    full = page.evaluate("mgsfmPage.data.frameNames")
    missing = full[6].replace("6", "7")
    (tmp_path / "report.json").write_text(json.dumps({"models": [{"seams": [{
        "reason": "few_points", "frames_before": [[full[0], missing]],
        "frames_after": [[full[7], full[-1]]]}]}]}))
    page, _ = report(folder)
    assert page.evaluate("mgsfmPage.data.header.seams") == [[6, 7]]
    dashed = page.evaluate(
        "[...document.querySelectorAll('#view_graph line[stroke-dasharray]')]"
        ".map((line) => (line.x1.baseVal.value - 60) / 560 * 19)")
    assert 7.0 in [pytest.approx(value, abs=0.01) for value in dashed]
    # The slider shows the images of its frame.
    page.evaluate("mgsfmPage.setFrame(7)")
    assert page.evaluate("mgsfmPage.data.imagesOfFrame[7].map("
                         "(image) => mgsfmPage.data.imageNames[image])") == [
        "cam0/8.png", "cam1/8.png"]


def test_panels_are_in_the_order_of_cameras(report, tmp_path):
    model = models.make_drive(num_sensors=4)
    page, _ = report(models.write_model(model, tmp_path / "0"))
    page.send("Emulation.setDeviceMetricsOverride", width=390, height=844,
              deviceScaleFactor=1, mobile=True)
    for section in ("errors", "error_maps"):
        # The places of camera titles within the views of the drawing.
        shown = page.evaluate(f"""[...document.querySelectorAll('#{section} svg')]
            .map((svg) => {{ const {{x, y, width, height}} = svg.viewBox.baseVal;
                return [...document.querySelectorAll('#{section} text')]
                    .map((text) => [text.getBBox(), text.textContent])
                    .filter(([box]) => box.x >= x && box.x < x + width
                            && box.y >= y && box.y < y + height)
                    .map(([, text]) => text.slice(0, 4))
                    .filter((text) => text.startsWith('cam')); }})""")
        assert shown == [["cam0"], ["cam1"], ["cam2"], ["cam3"]]


def test_missing_frames_are_grouped_by_reason(report, tmp_path):
    folder = models.write_model(models.make_drive(), tmp_path / "0")
    reasons = ["dark"] * 3 + ["no match"] + ["dark"]
    (tmp_path / "report.json").write_text(json.dumps({
        "models": [{}], "unregistered_frames": [
            {"name": f"{i:06}", "reason": reason}
            for i, reason in enumerate(reasons)]}))
    page, _ = report(folder)
    assert [row[:3] for row in cells_of(page, "missing")[1:]] == [
        ["000000 to 000002", "3", "dark"], ["000003", "1", "no match"],
        ["000004", "1", "dark"]]


def test_stages_are_in_the_order_of_the_run(positioned, browser):
    page = browser.open((positioned / "0" / "report.html").as_uri())
    stages = [row[0] for row in cells_of(page, "run") if len(row) == 4]
    order = ["reading", "view graph", "rotation averaging",
             "translation averaging", "bundle adjustment", "seams",
             "input check", "writing", "all"]
    assert [stage for stage in stages if stage in order] == order


def test_sections_name_pages_of_the_guide_that_exist(positioned, browser):
    page = browser.open((positioned / "0" / "report.html").as_uri())
    guides = page.evaluate("[...document.querySelectorAll('section:has(h2)')]"
                           ".map((part) => part.querySelector('code').innerText)")
    assert len(guides) > 5
    assert all((REPOSITORY / guide).is_file() for guide in guides)


def test_text_of_wide_charts_is_legible_on_a_phone(report, tmp_path):
    folder = models.write_model(models.make_drive(), tmp_path / "0")
    page, _ = report(folder, gt_path=folder)
    page.send("Emulation.setDeviceMetricsOverride", width=390, height=844,
              deviceScaleFactor=1, mobile=True)
    boxes = np.array(page.evaluate("""(() => {
        const svg = document.querySelector('#truth svg');
        const edge = svg.getBoundingClientRect();
        return [...svg.querySelectorAll('text')].slice(1).map((text) => {
            const box = text.getBoundingClientRect();
            return [box.left - edge.left, box.top - edge.top,
                    box.right - edge.left, box.bottom - edge.top]; });
    })()"""))
    assert (boxes[:, 3] - boxes[:, 1]).min() > 7
    assert boxes.min() >= 0 and boxes[:, 2].max() <= 370
    for i, box in enumerate(boxes):  # none covers the middle of another
        middles = 0.5 * (boxes[:, :2] + boxes[:, 2:])
        covered = ((middles > box[:2]) & (middles < box[2:])).all(axis=1)
        assert covered.sum() == 1, i


def test_charts_do_not_share_clip_paths(positioned, report):
    page, _ = report(positioned / "0", gt_path=positioned / "0",
                     compare_path=positioned / "0")
    ids = page.evaluate("[...document.querySelectorAll('[id]')]"
                        ".map((element) => element.id)")
    assert len(ids) == len(set(ids))
    assert sum("clip" in name for name in ids) >= 7
    assert page.evaluate("""[...document.querySelectorAll('[clip-path]')].every(
        (part) => document.querySelector(part.getAttribute('clip-path')
            .replace(/url\\("?(.*?)"?\\)/, '$1')).ownerSVGElement
            === part.ownerSVGElement)""")
