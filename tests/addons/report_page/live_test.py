# SPDX-License-Identifier: BSD-3-Clause
"""The live view of a mapper run in the browser."""

import json
import re
import signal
import subprocess
import time
import urllib.request

import pytest

TIMEOUT_S = 120


@pytest.fixture(scope="module")
def drive(mgsfm, tmp_path_factory):
    folder = tmp_path_factory.mktemp("drive")
    mgsfm("simulate", preset="standard", rig="kitti360", num_frames=240,
          output_path=folder)
    return folder / "database.db"


class LiveMapper:
    """A running mapper with a live view."""

    def __init__(self, program, database, output, *options):
        self.process = subprocess.Popen(
            [program, "mapper", "--database_path", database, "--output_path",
             output, "--live_port", "0", "--num_threads", "1", *options],
            stderr=subprocess.PIPE, text=True)
        self.url = None
        for line in self.process.stderr:
            found = re.search(r"http://127\.0\.0\.1:\d+/", line)
            if found:
                self.url = found[0]
                break

    def __enter__(self):
        return self

    def __exit__(self, *_):
        self.process.kill()
        self.process.wait()
        self.process.stderr.close()

    def end(self):
        text = self.process.stderr.read()
        return self.process.wait(TIMEOUT_S), text


def wait_for(page, condition, mapper=None):
    end = time.monotonic() + TIMEOUT_S
    while not page.evaluate(condition):
        assert time.monotonic() < end, f"never true: {condition}"
        if mapper:
            assert mapper.process.poll() is None, f"too late: {condition}"
        time.sleep(0.02)


def files_without_times(folder):
    """The files of a run but its report and pages, which have times."""
    return {path.relative_to(folder): path.read_bytes()
            for path in sorted(folder.rglob("*")) if path.is_file()
            and path.name not in ("report.json", "report.html")}


def complaints(page, url):
    return [text for text in page.complaints() if not text.startswith(url)]


def test_the_model_grows_and_the_final_page_follows(
        drive, browser, mgsfm, program, tmp_path):
    with LiveMapper(program, drive, tmp_path / "live") as mapper:
        page = browser.open(mapper.url)
        wait_for(page, "!document.getElementById('live').hidden", mapper)
        wait_for(page, "document.getElementById('live').innerText"
                       ".includes('view graph')", mapper)
        wait_for(page, "Boolean(window.mgsfmPage)", mapper)
        assert page.evaluate("mgsfmPage.data.numFrames") == 240
        assert page.evaluate("mgsfmPage.data.header.num_points") > 0
        # At the end, the report takes the place of the live view.
        wait_for(page, "Boolean(document.getElementById('live')?.hidden && "
                       "window.mgsfmPage)")
        exit_code, _ = mapper.end()
        assert exit_code == 0
    assert page.evaluate("document.querySelector('#run h2').innerText") == "Run"
    assert complaints(page, mapper.url) == []
    mgsfm("mapper", database_path=drive, output_path=tmp_path / "plain")
    assert (files_without_times(tmp_path / "live")
            == files_without_times(tmp_path / "plain"))


def stages_of(url):
    """The stages of the states of a run until it ends."""
    stages = set()
    while True:
        try:
            with urllib.request.urlopen(url + "state", timeout=5) as answer:
                state = json.load(answer)
        except OSError:
            return stages
        stages.add(state["stage"])
        # The line of progress is that of the stage.
        assert not state["progress"] or (
            state["progress"].startswith(state["stage"]))
        if state["finished"]:
            return stages
        time.sleep(0.01)


def test_stages_have_one_name(drive, program, tmp_path):
    with LiveMapper(program, drive, tmp_path / "out") as mapper:
        stages = stages_of(mapper.url) - {"", "report page"}
        _, log = mapper.end()
    report = json.loads((tmp_path / "out" / "report.json").read_text())
    of_report = {*report["seconds"], *report["models"][0]["seconds"]}
    assert stages <= of_report
    assert {"rotation averaging", "translation averaging",
            "bundle adjustment"} <= stages
    for stage in of_report:
        assert re.search(rf" {stage}: [\d.]+ s\n", log)
    assert log.rstrip().endswith(str(tmp_path / "out" / "0" / "report.html"))


@pytest.mark.parametrize("size", [(1440, 900), (1024, 768), (390, 844)])
def test_the_view_of_a_run_is_above_the_fold(
        drive, browser, program, pictures, tmp_path, size):
    with LiveMapper(program, drive, tmp_path / "out") as mapper:
        page = browser.open(mapper.url)
        page.send("Emulation.setDeviceMetricsOverride", width=size[0],
                  height=size[1], deviceScaleFactor=1, mobile=size[0] < 500)
        wait_for(page, "Boolean(window.mgsfmPage)", mapper)
        top, bottom = page.evaluate("""(() => {
            const box = document.getElementById('stage').getBoundingClientRect();
            return [box.top, box.bottom]; })()""")
        page.screenshot(pictures(f"live_{size[0]}.png"))
        assert top < 0.4 * size[1]
        assert bottom <= size[1]
        assert page.evaluate(
            "document.documentElement.scrollWidth") == size[0]


def test_an_interrupted_run_leaves_its_last_state(
        drive, browser, program, tmp_path):
    # It lasts until the browser, which may be slow, shows a model.
    with LiveMapper(program, drive, tmp_path / "out",
                    "--BundleAdjustment.function_tolerance", "0") as mapper:
        page = browser.open(mapper.url)
        wait_for(page, "Boolean(window.mgsfmPage)", mapper)
        mapper.process.send_signal(signal.SIGINT)
        exit_code, text = mapper.end()
    assert exit_code == -signal.SIGINT
    assert "nothing was written" in text
    assert not (tmp_path / "out").exists()
    wait_for(page, "document.getElementById('live_stage').innerText"
                   ".includes('ended')")
    assert page.evaluate("mgsfmPage.data.numFrames") == 240


def test_a_port_in_use_is_one_line(drive, program, tmp_path):
    with LiveMapper(program, drive, tmp_path / "out") as mapper:
        port = mapper.url.rstrip("/").rsplit(":", 1)[1]
        second = subprocess.run(
            [program, "mapper", "--database_path", drive, "--output_path",
             tmp_path / "second", "--live_port", port],
            capture_output=True, text=True, check=False)
    assert second.returncode == 1
    assert second.stderr.count("\n") == 1
    assert port in second.stderr and "--live_port" in second.stderr
    assert not (tmp_path / "second").exists()
