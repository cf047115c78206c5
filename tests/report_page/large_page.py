# SPDX-License-Identifier: BSD-3-Clause
"""Measures the page of a simulated model of 36,000 images.

  python3 tests/report_page/large_page.py build/release/apps/mgsfm/mgsfm

Prints the time to write and to open it, its size, and the frames per second
while it turns with software rendering. Fails beyond the limits.
"""

import pathlib
import subprocess
import sys
import tempfile
import time

import browser
import models

NUM_FRAMES, NUM_SENSORS = 9000, 4
MAX_BYTES, MAX_OPENING_S, MIN_FRAMES_PER_S = 10_000_000, 5.0, 20.0

# Turns the view once per drawn frame, for two seconds after one of warming up.
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
      if (now - begin > 1000) { start ??= now; ++count; }
      if (start && now - start > 2000) done(1000 * (count - 1) / (now - start));
      else turn();
    });
  };
  turn();
})"""


def main():
    program = pathlib.Path(sys.argv[1]).resolve()
    with tempfile.TemporaryDirectory() as folder:
        path = pathlib.Path(folder)
        models.write_model(
            models.make_drive(NUM_FRAMES, NUM_SENSORS, points_per_frame=20),
            path / "0")
        start = time.monotonic()
        subprocess.run([program, "report", "--input_path", path / "0",
                        "--output_path", path / "report.html"], check=True)
        print(f"written in {time.monotonic() - start:.2f} s")
        size = (path / "report.html").stat().st_size
        with browser.Browser() as running:
            page = running.open((path / "report.html").as_uri())
            frames_per_s = page.evaluate(TURN)
            if len(sys.argv) > 2:
                page.screenshot(sys.argv[2])
            complaints = page.complaints()
    print(f"{NUM_FRAMES * NUM_SENSORS} images: {size} bytes, opened in "
          f"{page.opening_s:.2f} s, {frames_per_s:.1f} frames per second")
    is_good = (size <= MAX_BYTES and page.opening_s <= MAX_OPENING_S
               and frames_per_s >= MIN_FRAMES_PER_S and not complaints)
    sys.exit(0 if is_good else 1)


if __name__ == "__main__":
    main()
