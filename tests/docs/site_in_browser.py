#!/usr/bin/env python3
# SPDX-License-Identifier: BSD-3-Clause
"""Opens the built site in Chromium: all formulas are drawn, the search finds
pages, and nothing is loaded from another server.

    tests/docs/site_in_browser.py build/site/html
"""

import functools
import http.server
import json
import sys
import threading
from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]
sys.path.insert(0, str(ROOT / "tests" / "addons" / "report_page"))
from browser import Browser  # noqa: E402


class Server(http.server.ThreadingHTTPServer):
    """Serves a folder at a free port, without messages."""

    def __init__(self, folder):
        class Handler(http.server.SimpleHTTPRequestHandler):
            def log_message(self, *_):
                pass
        super().__init__(("127.0.0.1", 0),
                         functools.partial(Handler, directory=folder))
        threading.Thread(target=self.serve_forever, daemon=True).start()
        self.url = f"http://127.0.0.1:{self.server_port}/"


def check_requests(page, server):
    for event in page.browser.events:
        if event["method"] == "Network.requestWillBeSent":
            url = event["params"]["request"]["url"]
            assert url.startswith((server.url, "data:", "blob:", "about:")), url
        assert event["method"] != "Runtime.exceptionThrown", json.dumps(event)


def check_formulas(browser, server, path):
    """The number of formulas of a page."""
    page = browser.open(server.url + path)
    num_formulas = page.evaluate(
        "document.querySelectorAll('.arithmatex').length")
    num_drawn = page.evaluate(
        "document.querySelectorAll('.arithmatex > .katex, "
        ".arithmatex > .katex-display').length")
    errors = page.evaluate(
        "[...document.querySelectorAll('.katex-error')].map(e => e.title)")
    assert num_drawn == num_formulas and not errors, (path, errors)
    check_requests(page, server)
    return num_formulas


def check_search(browser, server):
    page = browser.open(server.url + "index.html?q=gravity")
    page.wait_for("document.querySelectorAll('.md-search-result__item').length"
                  " > 3")
    links = page.evaluate(
        "[...document.querySelectorAll('.md-search-result__link')]"
        ".map(link => link.href)")
    assert any("gps_and_gravity" in link for link in links), links
    check_requests(page, server)


def main():
    folder = Path(sys.argv[1])
    server = Server(str(folder))
    with Browser() as browser:
        num_formulas = sum(
            check_formulas(browser, server, f"maths/{path.name}")
            for path in sorted((folder / "maths").glob("*.html")))
        check_search(browser, server)
    assert num_formulas > 100
    print(f"{num_formulas} formulas are drawn, and the search finds pages")


if __name__ == "__main__":
    main()
