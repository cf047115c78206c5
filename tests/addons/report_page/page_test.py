# SPDX-License-Identifier: BSD-3-Clause
"""What a person sees and does in the report page."""

import base64
import html.parser
import json
import pathlib

import matplotlib.image
import numpy as np
import pytest

import models

REPOSITORY = pathlib.Path(__file__).resolve().parents[3]
MAX_BYTES = 10_000_000
SENSOR_COLORS = {0: "0072b2", 1: "e69f00"}


@pytest.fixture(scope="module")
def drive(tmp_path_factory):
    model = models.make_drive()
    folder = models.write_model(model, tmp_path_factory.mktemp("drive") / "0")
    return model, folder


def rgb(color):
    return np.array([int(color[i:i + 2], 16) for i in (0, 2, 4)]) / 255


def project(page, positions):
    """Pixels in the window of positions in the world of the model, from the
    matrices of the viewer and the header."""
    state = json.loads(page.evaluate("""JSON.stringify((() => {
        const {view, data} = mgsfmPage;
        view.camera.updateMatrixWorld();
        const box = document.getElementById('stage').getBoundingClientRect();
        return {origin: data.header.origin, size: data.header.box_size,
                view: view.camera.matrixWorldInverse.elements,
                lens: view.camera.projectionMatrix.elements,
                box: [box.left, box.top,
                      view.stage.clientWidth, view.stage.clientHeight]};
    })())"""))
    unit = 0.5 * np.linalg.norm(state["size"])
    local = (np.atleast_2d(positions) - state["origin"]) / unit
    homogeneous = np.c_[local, np.ones(len(local))]
    matrices = [np.array(state[key]).reshape(4, 4).T for key in ("lens", "view")]
    clip = homogeneous @ (matrices[0] @ matrices[1]).T
    left, top, width, height = state["box"]
    ndc = clip[:, :2] / clip[:, 3:]
    return np.c_[left + 0.5 * (ndc[:, 0] + 1) * width,
                 top + 0.5 * (1 - ndc[:, 1]) * height]


def settle(page):
    page.evaluate("new Promise((done) => setTimeout(done, 350))")


def scroll_to_view(page):
    page.evaluate("document.getElementById('view').scrollIntoView()")
    settle(page)


def has_color(picture, pixel, color, radius=3, tolerance=0.12):
    x, y = np.round(pixel).astype(int)
    patch = picture[max(y - radius, 0):y + radius + 1,
                    max(x - radius, 0):x + radius + 1]
    return bool((np.abs(patch - rgb(color)).max(axis=2) < tolerance).any())


def details(page):
    return page.evaluate("document.getElementById('details').innerText")


def test_draws_cameras_where_the_model_has_them(drive, report):
    model, folder = drive
    page, _ = report(folder)
    scroll_to_view(page)
    page.evaluate("document.getElementById('show_points').click()")
    settle(page)
    picture = page.screenshot()
    pixels = project(page, model.centers())
    drawn = [has_color(picture, pixel, SENSOR_COLORS[camera - 1])
             for pixel, camera in zip(pixels, model.camera_of_image)]
    assert np.mean(drawn) > 0.9
    # Elsewhere there is nothing of the sort.
    away = [has_color(picture, pixel + [150, 0], SENSOR_COLORS[camera - 1])
            for pixel, camera in zip(pixels, model.camera_of_image)]
    assert np.mean(away) < 0.1
    assert page.complaints() == []


def test_draws_points_where_the_model_has_them(drive, report):
    model, folder = drive
    page, _ = report(folder)
    scroll_to_view(page)
    page.evaluate("""for (const id of ['show_cameras', 'show_path'])
        document.getElementById(id).click()""")
    page.evaluate("mgsfmPage.view.setFrame(0); mgsfmPage.view.current.set([])")
    page.evaluate("mgsfmPage.view.options.pointSize = 4; mgsfmPage.view.zoom(2.5)")
    page.evaluate("mgsfmPage.view.current.object.visible = false; "
                  "mgsfmPage.view.render(Infinity)")
    settle(page)
    picture = page.screenshot()
    kept = [i for i, track in enumerate(model.tracks) if len(track) >= 2]
    pixels = project(page, model.points[kept])
    box = page.evaluate("""(() => { const box = document.getElementById('stage')
        .getBoundingClientRect(); return [box.left, box.top, box.right,
        Math.min(box.bottom, innerHeight)]; })()""")
    inside = [(pixel, model.colors[i]) for pixel, i in zip(pixels, kept)
              if box[0] + 5 < pixel[0] < box[2] - 5
              and box[1] + 5 < pixel[1] < box[3] - 5]
    assert len(inside) > 100
    drawn = [has_color(picture, pixel, bytes(color).hex(), radius=2,
                       tolerance=0.05) for pixel, color in inside]
    assert np.mean(drawn) > 0.9


def test_click_on_a_camera_and_a_point(drive, report):
    model, folder = drive
    page, _ = report(folder)
    scroll_to_view(page)
    image = 4
    page.click(*project(page, model.centers()[image])[0])
    settle(page)
    chosen = page.evaluate("mgsfmPage.view.selection.image")
    name = page.evaluate(f"mgsfmPage.data.imageNames[{chosen}]")
    index = model.names.index(name)
    distance = np.linalg.norm(model.centers()[index] - model.centers()[image])
    assert distance <= models.STEP
    num_points = sum(len(model.tracks[point]) >= 2
                     for *_, point in model.keypoints[index])
    text = details(page)
    assert name in text
    assert f"points\t{num_points}\n" in text
    page.press("Escape")
    page.evaluate("document.getElementById('show_cameras').click()")
    settle(page)
    nearest = int(page.evaluate("mgsfmPage.view.pick(400, 300)?.point ?? "
                                "mgsfmPage.view.pickPoint(560, 330) ?? 0"))
    page.evaluate(f"mgsfmPage.select({{point: {nearest}}})")
    position = page.evaluate(
        f"mgsfmPage.view.poses.toWorld(mgsfmPage.view.poses.point({nearest}))"
        ".toArray()")
    point = np.linalg.norm(model.points - position, axis=1).argmin()
    assert np.linalg.norm(model.points[point] - position) < 1e-3
    text = details(page)
    assert f"images\t{len(model.tracks[point])}\n" in text
    for image, _ in model.tracks[point]:
        assert model.names[image] in text
    assert page.complaints() == []


def test_slider_keys_and_coloring(drive, report):
    model, folder = drive
    page, _ = report(folder)
    scroll_to_view(page)
    page.evaluate("""(() => { const slider = document.getElementById('frame');
        slider.value = 7; slider.dispatchEvent(new Event('input')); })()""")
    assert "000007" in page.evaluate(
        "document.getElementById('frame_name').textContent")
    page.click(*project(page, model.centers()[3])[0])
    page.evaluate("document.getElementById('stage').focus()")
    before = page.evaluate("mgsfmPage.view.currentFrame")
    page.press(".")
    assert page.evaluate("mgsfmPage.view.currentFrame") == before + 1
    page.press("t")
    settle(page)
    direction = page.evaluate("mgsfmPage.view.camera.position.clone().sub("
                              "mgsfmPage.view.controls.target).normalize()"
                              ".dot(mgsfmPage.view.up)")
    assert direction > 0.99
    pictures = []
    for color in ("camera", "error", "time"):
        page.evaluate(f"""(() => {{
            const list = document.getElementById('camera_color');
            list.value = '{color}'; list.dispatchEvent(new Event('change'));
        }})()""")
        settle(page)
        pictures.append(page.screenshot())
    assert np.abs(pictures[0] - pictures[1]).max() > 0.3
    assert np.abs(pictures[1] - pictures[2]).max() > 0.3
    assert page.complaints() == []


def test_follows_the_rig(drive, report):
    model, folder = drive
    page, _ = report(folder)
    scroll_to_view(page)
    page.evaluate("document.getElementById('stage').focus()")
    page.press("f")
    for frame in (3, 12):
        page.evaluate(f"mgsfmPage.setFrame({frame})")
        target = page.evaluate("mgsfmPage.view.poses.toWorld("
                               "mgsfmPage.view.controls.target).toArray()")
        # The rig is at its first sensor.
        np.testing.assert_allclose(target, model.centers()[frame], atol=1e-3)


def test_touch_selects_and_turns(drive, report):
    model, folder = drive
    page, _ = report(folder)
    scroll_to_view(page)
    page.send("Emulation.setTouchEmulationEnabled", enabled=True,
              maxTouchPoints=2)
    x, y = project(page, model.centers()[4])[0]
    page.touch([[(x, y)]])
    settle(page)
    assert page.evaluate("mgsfmPage.view.selection?.image !== undefined")
    place = "mgsfmPage.view.camera.position.toArray()"
    length = ("mgsfmPage.view.camera.position.distanceTo("
              "mgsfmPage.view.controls.target)")
    before, distance = page.evaluate(place), page.evaluate(length)
    page.touch([[(400 + 8 * i, 400)] for i in range(10)])
    settle(page)
    assert not np.allclose(page.evaluate(place), before)
    assert page.evaluate(length) == pytest.approx(distance, rel=1e-3)
    page.touch([[(500 - 8 * i, 400), (600 + 8 * i, 400)] for i in range(10)])
    settle(page)
    assert page.evaluate(length) < 0.9 * distance
    assert page.complaints() == []


def test_themes_and_print(drive, report):
    _, folder = drive
    page, _ = report(folder)
    brightness = []
    for _ in range(2):
        brightness.append(page.screenshot()[:200, :20].mean())
        page.evaluate("document.getElementById('theme').click()")
    assert max(brightness) > 0.9 and min(brightness) < 0.2
    pdf = base64.b64decode(page.send("Page.printToPDF")["data"])
    assert pdf.startswith(b"%PDF")
    assert page.evaluate("document.querySelectorAll('#canvas').length") == 1
    assert page.complaints() == []


def test_seams_and_reasons_of_the_report(drive, report, tmp_path):
    model, _ = drive
    folder = models.write_model(model, tmp_path / "0")
    page, _ = report(folder)
    names = page.evaluate("mgsfmPage.data.frameNames")
    (tmp_path / "report.json").write_text(json.dumps({
        "models": [{"seams": [{"reason": "few_points",
                               "frames_before": [[names[0], names[6]]],
                               "frames_after": [[names[7], names[19]]]}]}],
        "warnings": [{"text": "<b>Look at the lens</b>"}]}))
    page, _ = report(folder)
    assert page.evaluate("mgsfmPage.data.header.seams") == [[6, 7]]
    text = page.evaluate("document.body.innerText")
    assert "few points" in text and "<b>Look at the lens</b>" in text
    dashed = page.evaluate(
        "[...document.querySelectorAll('#view_graph line[stroke-dasharray]')]"
        ".map((line) => (line.x1.baseVal.value - 60) / 560 * 20)")
    assert min(dashed) == pytest.approx(0.0, abs=0.01)  # across all rows
    assert 7.0 in [pytest.approx(value, abs=0.01) for value in dashed]


def test_measures_distances(drive, report):
    model, folder = drive
    page, _ = report(folder)
    scroll_to_view(page)
    page.evaluate("document.getElementById('measure').click()")
    page.evaluate("mgsfmPage.measure({image: 0}); mgsfmPage.measure({image: 6})")
    settle(page)
    shown = float(page.evaluate(
        "document.getElementById('labels').textContent").split()[0])
    names = [page.evaluate(f"mgsfmPage.data.imageNames[{i}]") for i in (0, 6)]
    centers = [model.centers()[model.names.index(name)] for name in names]
    assert shown == pytest.approx(np.linalg.norm(centers[0] - centers[1]),
                                  rel=1e-3)


class Tables(html.parser.HTMLParser):
    """The texts of all table cells, and what the page refers to."""

    def __init__(self, path):
        super().__init__()
        self.cells, self.tags, self.urls = [], [], []
        self.feed(path.read_text())

    def handle_starttag(self, tag, attributes):
        self.tags.append(tag)
        self.urls += [value for key, value in attributes
                      if key in ("src", "href") and value]
        if tag in ("td", "th"):
            self.cells.append("")

    def handle_data(self, data):
        if self.cells:
            self.cells[-1] += data


def test_is_readable_without_scripts(drive, report):
    _, folder = drive
    _, path = report(folder)
    tables = Tables(path)
    assert "20 of 20 (100\u00a0%)" in tables.cells
    assert tables.tags.count("svg") >= 5
    assert all(url.startswith(("data:image/png;", "#")) for url in tables.urls)


HOSTILE = ["<script>document.title='hacked'</script>", "\"'&<b>x</b>",
           "a" * 300, "\u202etxet\u05d0\u05d1", "</script><script>alert(1)//",
           "<!--", "/*arrays*/", "\u2028\u200b ", "${1}$&"]


SIZES = [(1440, 900, False), (1024, 768, False), (390, 844, True)]


def resize(page, width, height, is_phone, theme="light"):
    page.send("Emulation.setDeviceMetricsOverride", width=width, height=height,
              deviceScaleFactor=1, mobile=is_phone)
    page.send("Emulation.setTouchEmulationEnabled", enabled=is_phone,
              maxTouchPoints=2)
    page.send("Emulation.setEmulatedMedia", features=[
        {"name": "prefers-color-scheme", "value": theme}])
    settle(page)


def rectangle(page, selector):
    """left, top, right, bottom in the window."""
    return page.evaluate(f"""(() => {{ const box = document.querySelector(
        '{selector}').getBoundingClientRect();
        return [box.left, box.top, box.right, box.bottom]; }})()""")


@pytest.mark.parametrize("theme", ["light", "dark"])
@pytest.mark.parametrize("size", SIZES)
def test_opens_on_a_stage(drive, report, pictures, size, theme):
    model, folder = drive
    page, _ = report(folder)
    resize(page, *size, theme)
    left, top, right, bottom = rectangle(page, "#stage")
    assert top < 0.6 * size[1]
    picture = page.screenshot(pictures(f"opens_{size[0]}_{theme}.png"))
    assert np.median(picture[int(top) + 60:int(bottom) - 60,
                             int(left) + 20:int(right) - 20]) < 0.2
    # All frames are in view, and reach from one side to the other.
    pixels = project(page, model.centers())
    assert (pixels > [left, top]).all() and (pixels < [right, bottom]).all()
    shares = np.ptp(pixels, axis=0) / [right - left, bottom - top]
    assert shares.max() > 0.7
    assert page.evaluate("document.documentElement.scrollWidth") == size[0]
    assert page.complaints() == []


@pytest.mark.parametrize("size", SIZES)
def test_charts_fit_the_window(drive, report, pictures, size):
    page, _ = report(drive[1])
    resize(page, *size)
    assert page.evaluate("""[...document.querySelectorAll('.chart, .strip')]
        .every((chart) => chart.scrollWidth <= chart.clientWidth
               && chart.getBoundingClientRect().right <= innerWidth)""")
    page.send("Emulation.setDeviceMetricsOverride", width=size[0],
              height=page.evaluate("document.body.scrollHeight"),
              deviceScaleFactor=1, mobile=size[2])
    settle(page)
    page.screenshot(pictures(f"charts_{size[0]}.png"))


@pytest.mark.parametrize("size", SIZES)
def test_details_are_in_sight(drive, report, size):
    page, _ = report(drive[1])
    resize(page, *size)
    page.evaluate("mgsfmPage.select({image: 3})")
    _, top, _, bottom = rectangle(page, "#details table")
    assert top < size[1] and bottom - top > 50
    page.evaluate("document.querySelector('#details .close').click()")
    assert details(page) == ""


def write_images(model, folder):
    """One image per name, of a gray that tells its number."""
    for i, name in enumerate(model.names):
        path = folder / name
        path.parent.mkdir(parents=True, exist_ok=True)
        matplotlib.image.imsave(path, np.full(
            (models.HEIGHT_PX, models.WIDTH_PX, 3), 5 * i + 20, np.uint8))
    return folder


def test_looks_through_a_camera(drive, report, tmp_path):
    model, folder = drive
    page, _ = report(folder, image_path=write_images(model, tmp_path / "images"))
    scroll_to_view(page)
    shown = page.evaluate(f"mgsfmPage.data.imageNames.indexOf('{model.names[3]}')")
    page.evaluate(f"mgsfmPage.select({{image: {shown}}}); "
                  "[...document.querySelectorAll('#details button')].at(-1).click()")
    page.wait_for("document.querySelector('#photo img')?.naturalWidth > 0")
    settle(page)
    # Points are drawn on the photo where the image has its keypoints.
    left, top, right, bottom = rectangle(page, "#photo img")
    scale = (right - left) / models.WIDTH_PX
    assert scale == pytest.approx((bottom - top) / models.HEIGHT_PX, rel=1e-3)
    x, y, points = np.array(model.keypoints[3]).T
    places = np.c_[left + scale * x, top + scale * y]
    pixels = project(page, model.points[points.astype(int)])
    assert np.abs(pixels - places).max() < 2 + 5 * 0.3 * scale
    # The slider moves to the image of the same camera.
    page.evaluate("mgsfmPage.setFrame(9)")
    assert page.evaluate("document.querySelector('#photo img').alt") == (
        model.names[9])
    page.evaluate("document.getElementById('stage').focus()")
    page.press("Escape")
    assert page.evaluate("mgsfmPage.view.through") is None
    assert page.complaints() == []


def test_images_of_the_frame_follow_the_slider(drive, report, tmp_path):
    model, folder = drive
    images = write_images(model, tmp_path / "images #1")
    page, path = report(folder, image_path=images)
    shown = "[...document.querySelectorAll('#frame_images img')]"
    for frame in (2, 11):
        page.evaluate(f"mgsfmPage.setFrame({frame})")
        assert page.evaluate(f"{shown}.map((image) => image.alt)") == [
            f"cam{sensor}/{frame:06}.png" for sensor in (0, 1)]
    # Photos of full size come from the folder, thumbnails from the page.
    page.evaluate("mgsfmPage.select({image: 5})")
    width = "document.querySelector('#details img').naturalWidth"
    page.wait_for(f"{width} === {models.WIDTH_PX}")
    images.rename(tmp_path / "elsewhere")
    page.send("Page.navigate", url=path.as_uri())
    page.wait_for("Boolean(window.mgsfmPage)")
    page.evaluate("mgsfmPage.select({image: 5})")
    page.wait_for(f"{width} > 0 && {width} < {models.WIDTH_PX}")


def test_a_cell_of_the_view_graph_shows_its_images(drive, report):
    model, folder = drive
    page, _ = report(folder)
    page.evaluate("document.querySelector('#view_graph svg').scrollIntoView()")
    left, top, right, _ = rectangle(page, "#view_graph svg")
    scale = (right - left) / page.evaluate(
        "document.querySelector('#view_graph svg').viewBox.baseVal.width")
    frames = (3, 5)
    page.click(*[start + scale * (edge + 560 * (frame + 0.5) / 20)
                 for start, edge, frame in ((left, 60, 5), (top, 12, 3))])
    text = page.evaluate("document.getElementById('pair').innerText")
    of_frames = [[i for i, name in enumerate(model.names)
                  if f"{frame:06}" in name] for frame in frames]

    def common(first, second):
        return len({point for *_, point in model.keypoints[first]}
                   & {point for *_, point in model.keypoints[second]})

    most = max(common(a, b) for a in of_frames[0] for b in of_frames[1])
    assert f"{most} common points" in text
    assert "000003.png" in text and "000005.png" in text


def test_takes_missing_colors_from_the_images(report, tmp_path):
    model = models.make_drive()
    model.colors[:] = 0
    page, _ = report(models.write_model(model, tmp_path / "0"),
                     image_path=write_images(model, tmp_path / "images"))
    assert page.evaluate("mgsfmPage.view.hasColors")
    colors = np.reshape(page.evaluate(
        "[...mgsfmPage.data.arrays.point_color]"), (-1, 3))
    assert np.ptp(colors, axis=1).max() == 0 and colors.min() >= 20


def test_the_wheel_scrolls_until_the_view_was_clicked(drive, report):
    page, _ = report(drive[1])
    resize(page, 1024, 500, False)
    scroll_to_view(page)
    left, top, right, bottom = rectangle(page, "#stage")
    distance = ("mgsfmPage.view.camera.position.distanceTo("
                "mgsfmPage.view.controls.target)")
    before = page.evaluate(f"[scrollY, {distance}]")

    def turn_wheel():
        page.send("Input.dispatchMouseEvent", type="mouseWheel",
                  x=0.5 * (left + right), y=top + 200, deltaX=0, deltaY=-60)
        settle(page)
        return page.evaluate(f"[scrollY, {distance}]")

    after = turn_wheel()
    assert after[0] < before[0] and after[1] == pytest.approx(before[1])
    scroll_to_view(page)
    page.click(0.5 * (left + right), top + 200)
    page.evaluate("document.getElementById('stage').focus()")
    assert turn_wheel()[1] < 0.99 * before[1]
    assert page.evaluate(
        "getComputedStyle(document.getElementById('canvas')).touchAction"
    ) == "pan-y"


def test_a_link_shows_the_same_view(drive, report, browser):
    page, path = report(drive[1])
    page.evaluate("mgsfmPage.setFrame(4); mgsfmPage.view.turn(0.7, 0.1); "
                  "mgsfmPage.view.zoom(0.6)")
    settle(page)
    places = ("[mgsfmPage.view.currentFrame, ...mgsfmPage.view.camera.position,"
              " ...mgsfmPage.view.controls.target]")
    page.evaluate("document.getElementById('copy_link').click()")
    link = page.evaluate("location.hash")
    other = browser.open(path.as_uri() + link)
    np.testing.assert_allclose(other.evaluate(places), page.evaluate(places),
                               atol=1e-5)


def test_a_picture_replaces_the_view_without_webgl(drive, report):
    page, path = report(drive[1])
    page.send("Page.addScriptToEvaluateOnNewDocument",
              source="HTMLCanvasElement.prototype.getContext = () => null")
    page.send("Page.reload")
    page.wait_for("Boolean(document.querySelector('#plan p'))")
    _, top, _, bottom = rectangle(page, "#plan svg")
    assert bottom - top > 100
    assert rectangle(page, "#view")[3] == 0
    assert "This browser does not draw the 3D view" in page.evaluate(
        "document.body.innerText")


def test_scales_fit_the_values(drive, report):
    page, _ = report(drive[1])
    page.evaluate("""(() => {
        const list = document.getElementById('point_color');
        list.value = 'error'; list.dispatchEvent(new Event('change'));
    })()""")
    legend = page.evaluate("document.getElementById('legend').innerText")
    errors = np.array(page.evaluate("[...mgsfmPage.data.arrays.point_error]"))
    assert "reprojection error [px]" in legend
    assert float(legend.split()[-1]) == pytest.approx(
        np.quantile(errors, 0.95, method="lower") / 32, rel=0.01)


def test_names_are_only_text(tmp_path, report):
    model = models.make_drive(num_frames=len(HOSTILE), num_sensors=1)
    model.names = [name.replace("/", "\u2215") + ".png" for name in HOSTILE]
    folder = models.write_model(model, tmp_path / "</title><script>" / "0")
    page, path = report(folder)
    for image in range(len(HOSTILE)):
        page.evaluate(f"mgsfmPage.select({{image: {image}}})")
        name = page.evaluate(f"mgsfmPage.data.imageNames[{image}]")
        assert name in model.names
        assert page.evaluate("[...document.querySelectorAll('#details td')]"
                             ".map((cell) => cell.textContent)")[0] == name
    assert page.evaluate("document.title") != "hacked"
    assert page.evaluate("document.scripts.length") == 3
    assert page.evaluate("document.querySelectorAll('b').length") == (
        page.evaluate("document.querySelectorAll('.card b').length"))
    assert page.complaints() == []
    assert Tables(path).tags.count("script") == 3


def test_model_without_images(tmp_path, report):
    empty = models.Model([], [], [], np.zeros((0, 3)), np.zeros((0, 3)), [],
                         [], [])
    page, _ = report(models.write_model(empty, tmp_path / "0"))
    assert "The model has no image." in page.evaluate("document.body.innerText")
    assert page.complaints() == []


@pytest.mark.parametrize("offset", [1e7, 1e12])
def test_extreme_coordinates(tmp_path, report, offset):
    model = models.make_drive(offset=(offset, -offset, 0.5 * offset))
    model.points[::50] += 1e14  # points at nearly infinite distance
    page, path = report(models.write_model(model, tmp_path / "0"))
    assert path.stat().st_size < MAX_BYTES
    scroll_to_view(page)
    assert page.evaluate("mgsfmPage.view.poses.unit") < 100
    if offset < 1e9:  # beyond, doubles do not resolve the drive
        picture = page.screenshot()
        pixels = project(page, model.centers())
        assert np.mean([has_color(picture, p, SENSOR_COLORS[c - 1], radius=6)
                        for p, c in zip(pixels, model.camera_of_image)]) > 0.5
    assert page.complaints() == []


def test_truth_and_another_model(tmp_path, drive, report):
    model, folder = drive
    shifted = models.make_drive()
    shifted.translations = 2.0 * shifted.translations  # of twice the size
    shifted.points = 2.0 * shifted.points
    other = models.write_model(shifted, tmp_path / "other")
    page, _ = report(folder, compare_path=other, gt_path=other)
    text = page.evaluate("document.body.innerText")
    assert "Comparison of two models" in text
    assert "Errors against the ground truth" in text
    # After alignment they are the same.
    for name in ("truth", "other"):
        errors = page.evaluate(
            f"[...mgsfmPage.data.arrays.{name}_position_error]")
        assert np.max(errors) < 1e-6
        centers = np.reshape(page.evaluate(
            f"[...mgsfmPage.data.arrays.{name}_center]"), (-1, 3))
        frames = np.reshape(page.evaluate(
            "[...mgsfmPage.data.arrays.frame_center]"), (-1, 3))
        np.testing.assert_allclose(centers, frames, atol=1e-4)
    assert page.complaints() == []


def test_demo_of_the_mapper(tmp_path, mgsfm, browser):
    mgsfm("mapper", database_path=REPOSITORY / "data/demo/database.db",
          output_path=tmp_path / "sparse")
    page = browser.open((tmp_path / "sparse/0/report.html").as_uri())
    summary = json.loads((tmp_path / "sparse/report.json").read_text())
    text = page.evaluate("document.body.innerText")
    entry = summary["models"][0]
    assert f"{entry['num_points']:,}" in text
    for stage in entry["seconds"]:
        assert stage in text
    assert "common points" in page.evaluate(
        "document.querySelector('#view_graph svg').getAttribute('aria-label')")
    assert page.complaints() == []


def test_side_files_hold_the_other_points(tmp_path, browser, mgsfm):
    folder = models.write_dense_model(tmp_path / "0", 20000)
    path = tmp_path / "a page #1.html"
    mgsfm("report", input_path=folder, output_path=path, max_size=1,
          side_files=1)
    assert (tmp_path / "a page #1.points1.js").is_file()
    page = browser.open(path.as_uri())
    numbers = "mgsfmPage.view.numPoints()"
    inside = np.reshape(page.evaluate("[...mgsfmPage.data.pointPositions]"),
                        (-1, 3))
    assert len(inside) < 20000
    page.evaluate("document.getElementById('load_points').click()")
    page.wait_for(f"{numbers} === 20000")
    loaded = np.reshape(page.evaluate("[...mgsfmPage.data.pointPositions]"),
                        (-1, 3))
    np.testing.assert_allclose(loaded[:len(inside)], inside, atol=1e-6)
    origin = page.evaluate("mgsfmPage.data.header.origin")
    points = models.read_points(folder)
    for axis in range(3):
        np.testing.assert_allclose(np.sort(loaded[:, axis] + origin[axis]),
                                   np.sort(points[:, axis]), atol=1e-3)
    assert page.complaints() == []


def test_side_files_of_another_page_are_refused(tmp_path, browser, mgsfm):
    folder = models.write_dense_model(tmp_path / "0", 20000)
    path = tmp_path / "a.html"
    mgsfm("report", input_path=folder, output_path=path, max_size=1,
          side_files=1)
    side_file = tmp_path / "a.points1.js"
    side_file.write_text(side_file.read_text().replace('"id":"', '"id":"x'))
    page = browser.open(path.as_uri())
    page.evaluate("document.getElementById('load_points').click()")
    page.wait_for("document.getElementById('load_points').textContent"
                  ".includes('another page')")
    side_file.unlink()
    page = browser.open(path.as_uri())
    page.evaluate("document.getElementById('load_points').click()")
    page.wait_for("document.getElementById('load_points').textContent"
                  ".includes('is missing')")


def test_stays_below_the_limit(tmp_path, mgsfm):
    model = models.make_drive(num_frames=300, points_per_frame=60)
    folder = models.write_model(model, tmp_path / "0")
    sizes = []
    for max_size in (1, 2, 10):
        path = tmp_path / f"{max_size}.html"
        mgsfm("report", input_path=folder, output_path=path,
              max_size=max_size)
        sizes.append(path.stat().st_size)
        assert sizes[-1] <= max_size * 1e6
    assert sizes[0] < sizes[1] < sizes[2]
