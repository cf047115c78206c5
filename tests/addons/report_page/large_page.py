# SPDX-License-Identifier: BSD-3-Clause
"""Measures pages of large models with software rendering.

  python3 tests/addons/report_page/large_page.py build/release/apps/mgsfm/mgsfm \
      [images] [points] [MODEL DATABASE]

images: a simulated model of 36,000 images; points: one of 5,000,000 points, with
side files; otherwise the page of a model that exists. Prints the time to write
and to open the page, its size, and the frames per second while it turns, with
the processor time per frame, which other programs disturb less. Fails beyond
the limits.
"""

import argparse
import os
import pathlib
import resource
import subprocess
import sys
import tempfile
import time

import browser
import models

NUM_FRAMES, NUM_SENSORS, NUM_POINTS = 9000, 4, 5_000_000
MAX_BYTES, MAX_WRITING_S = 10_000_000, 10.0
MAX_OPENING_S, MIN_FRAMES_PER_S = 5.0, 20.0

# Turns the view once per drawn frame, for two seconds after two of warming up.
# Reading a pixel waits until everything is drawn.
TURN = """new Promise((done) => {
  const {view} = mgsfmPage;
  const gl = view.renderer.getContext();
  const pixel = new Uint8Array(4);
  let start, count = 0;
  const begin = performance.now();
  const turn = () => {
    view.turn(0.02, 0);
    requestAnimationFrame((now) => {
      gl.readPixels(0, 0, 1, 1, gl.RGBA, gl.UNSIGNED_BYTE, pixel);
      if (now - begin > 2000) { start ??= now; ++count; }
      if (start && now - start > 2000) done([count - 1, (now - start) / 1000]);
      else turn();
    });
  };
  turn();
})"""

LOAD_POINTS = """new Promise((done) => {
  const begin = performance.now();
  document.getElementById('load_points').click();
  const check = () => {
    const button = document.getElementById('load_points');
    if (!button) done((performance.now() - begin) / 1000);
    else if (button.disabled) setTimeout(check, 100);
  };
  check();
})"""

PICK = """(() => {
  const begin = performance.now();
  mgsfmPage.view.pickPoint(400, 300);
  return (performance.now() - begin) / 1000;
})()"""


def processor_seconds(pid):
    """Of a process and all below it."""
    children = {}
    for entry in pathlib.Path("/proc").iterdir():
        try:
            fields = (entry / "stat").read_text().rsplit(")", 1)[1].split()
            children.setdefault(int(fields[1]), []).append(
                (int(entry.name), int(fields[11]) + int(fields[12])))
        except (OSError, ValueError, IndexError):
            continue
    total, pending = 0, [pid]
    while pending:
        for child, ticks in children.get(pending.pop(), []):
            total += ticks
            pending.append(child)
    return total / os.sysconf("SC_CLK_TCK")


def turn(running, page):
    before = processor_seconds(os.getpid())
    start = time.monotonic()
    count, seconds = page.evaluate(TURN)
    load = ((processor_seconds(os.getpid()) - before)
            / (time.monotonic() - start))
    print(f"  turned at {count / seconds:.1f} frames per second, "
          f"{1000 * load * seconds / count:.0f} ms of processor time each")
    return count / seconds >= MIN_FRAMES_PER_S


def measure(program, model, folder, picture, **options):
    output = folder / "report.html"
    words = [program, "report", "--input_path", model, "--output_path", output]
    for name, value in options.items():
        words += [f"--{name}", str(value)]
    before = resource.getrusage(resource.RUSAGE_CHILDREN)
    start = time.monotonic()
    subprocess.run(words, check=True, stderr=subprocess.DEVNULL)
    writing_s = time.monotonic() - start
    after = resource.getrusage(resource.RUSAGE_CHILDREN)
    size = output.stat().st_size
    print(f"{size} bytes, written in {writing_s:.2f} s "
          f"({after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime:.2f}"
          " s of processor time)")
    with browser.Browser() as running:
        page = running.open(output.as_uri())
        page.wait_for("Boolean(window.mgsfmPage)")
        print(f"  opened in {page.opening_s:.2f} s")
        is_good = (size <= MAX_BYTES and page.opening_s <= MAX_OPENING_S)
        is_good &= turn(running, page)
        if page.evaluate("Boolean(mgsfmPage.data.header.side_points)"):
            print(f"  loaded side files in {page.evaluate(LOAD_POINTS):.2f} s, "
                  f"{page.evaluate('mgsfmPage.view.numPoints()')} points")
            is_good &= turn(running, page)
            print(f"  found a point in {page.evaluate(PICK):.2f} s")
        if picture:
            page.evaluate("new Promise((done) => setTimeout(done, 3000))")
            page.screenshot(picture)
        complaints = page.complaints()
    for text in complaints:
        print(text)
    return is_good and not complaints, writing_s


def main():
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("program", type=pathlib.Path)
    parser.add_argument("cases", nargs="*", default=["images"],
                        help="images, points, or a model and its database")
    parser.add_argument("--picture", help="PNG file for the last page")
    options = parser.parse_args()
    program = options.program.resolve()
    is_good = True
    with tempfile.TemporaryDirectory() as name:
        folder = pathlib.Path(name)
        if "images" in options.cases:
            drive = models.make_drive(NUM_FRAMES, NUM_SENSORS,
                                      points_per_frame=20)
            print(f"{NUM_FRAMES * NUM_SENSORS} images: ", end="")
            models.write_model(drive, folder / "images")
            is_good &= measure(program, folder / "images", folder,
                               options.picture)[0]
        if "points" in options.cases:
            print(f"{NUM_POINTS} points: ", end="")
            models.write_dense_model(folder / "points", NUM_POINTS)
            is_good &= measure(program, folder / "points", folder,
                               options.picture, side_files=1)[0]
        if options.cases[0] not in ("images", "points"):
            model, database = options.cases
            print(f"{model}: ", end="")
            is_measured_good, writing_s = measure(
                program, model, folder, options.picture,
                database_path=database)
            is_good &= is_measured_good and writing_s <= MAX_WRITING_S
    sys.exit(0 if is_good else 1)


if __name__ == "__main__":
    main()
