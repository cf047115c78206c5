#!/usr/bin/env python3
# SPDX-License-Identifier: BSD-3-Clause
"""Fails if a page of the site has a link, picture or script that leads nowhere,
or loads something from another server.

    scripts/check_site.py build/site/html
"""

import sys
from html.parser import HTMLParser
from pathlib import Path
from urllib.parse import unquote, urlsplit

# A browser loads these with the page. Links that a reader follows may leave.
LOADED = {("script", "src"), ("img", "src"), ("link", "href"),
          ("iframe", "src"), ("source", "src")}


class Page(HTMLParser):
    """The ids of a page, and (tag, attribute, target) of its links."""

    def __init__(self, path):
        super().__init__()
        self.ids = set()
        self.links = []
        self.feed(path.read_text(encoding="utf-8"))

    def handle_starttag(self, tag, attrs):
        attrs = dict(attrs)
        self.ids.update(attrs[key] for key in ("id", "name") if attrs.get(key))
        # Addresses of the page itself, for search engines.
        if tag == "link" and attrs.get("rel") in ("canonical", "edit"):
            return
        self.links += [(tag, key, attrs[key]) for key in ("href", "src")
                       if attrs.get(key)]


def check_link(page_path, link, pages, root):
    """What is wrong with a link, or None."""
    tag, key, target = link
    parts = urlsplit(target)
    if parts.scheme in ("http", "https") or parts.netloc:
        return "is on another server" if (tag, key) in LOADED else None
    if parts.scheme:
        return None
    path = page_path
    if parts.path:
        base = root if parts.path.startswith("/") else page_path.parent
        path = (base / unquote(parts.path).lstrip("/")).resolve()
        if path.is_dir():
            path /= "index.html"
    if not path.exists():
        return "does not exist"
    fragment = unquote(parts.fragment)
    if fragment and path in pages and fragment not in pages[path].ids:
        return "has no such heading"
    return None


def main():
    root = Path(sys.argv[1]).resolve()
    pages = {path: Page(path) for path in sorted(root.rglob("*.html"))}
    api = root / "api"
    num_links, errors = 0, []
    for path, page in pages.items():
        if api in path.parents:
            continue  # Doxygen's own pages
        for link in page.links:
            num_links += 1
            problem = check_link(path, link, pages, root)
            if problem:
                errors.append(f"{path.relative_to(root)}: {link[2]} {problem}")
    print("\n".join(errors), file=sys.stderr, end="\n" if errors else "")
    if errors or num_links == 0:
        sys.exit(1)
    print(f"{len(pages)} pages, {num_links} links lead somewhere")


if __name__ == "__main__":
    main()
