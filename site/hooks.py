# SPDX-License-Identifier: BSD-3-Clause
"""What MkDocs does beyond its configuration.

- The navigation is that of docs/README.md, so that it is written once. A page
  that is not linked there is a warning, hence an error of scripts/site.sh.
  The C++ interface, which Doxygen makes, is added to the reference.
- Links to files outside docs/ become their paths in the repository.
- Tutorials with Python code get a link to their notebook.
"""

import logging
import posixpath
import re
from pathlib import Path

log = logging.getLogger("mkdocs.hooks.mgsfm")

LINK = re.compile(r"\[([^\]]+)\]\(([^)#\s]+\.(?:md|html))(#[^)\s]*)?\)")
OUTWARD_LINK = re.compile(r"\[([^\]]+)\]\((\.\./[^)\s]+)\)")


def links_of(text, folder=""):
    """(title, path) of the links to other pages, each page once."""
    found = {}
    for title, path, _ in LINK.findall(text):
        if "://" not in path:
            path = posixpath.normpath(posixpath.join(folder, path))
            # Names of files keep their letters.
            found.setdefault(path, title if "." in title else
                             title[0].upper() + title[1:])
    return [(title, path) for path, title in found.items()
            if not path.startswith("..")]


def pages_of_section(text, docs):
    """The navigation below one heading of docs/README.md."""
    entries = []
    # Lines such as "Running:" name groups.
    for group in re.split(r"^(?=[A-Z]\w*:$)", text, flags=re.M):
        pages = []
        for title, path in links_of(group):
            folder, name = posixpath.split(path)
            if name == "README.md":
                pages.append(path)
                index = (docs / path).read_text(encoding="utf-8")
                pages += [{title: path} for title, path in
                          links_of(index, folder) if path.startswith(folder)]
            else:
                pages.append({title: path})
        name = re.match(r"([A-Z]\w*):$", group, flags=re.M)
        entries += [{name[1]: pages}] if name else pages
    return entries


def paths_in(entries):
    for entry in entries:
        for value in entry.values() if isinstance(entry, dict) else [entry]:
            if isinstance(value, str):
                yield value
            else:
                yield from paths_in(value)


def on_config(config):
    docs = Path(config["docs_dir"])
    parts = re.split(r"^## (.+)$", (docs / "README.md").read_text(
        encoding="utf-8"), flags=re.M)
    config["nav"] = [{"Home": "README.md"}]
    for title, text in zip(parts[1::2], parts[2::2]):
        config["nav"].append({title: pages_of_section(text, docs)})
        if title == "Reference":
            config["nav"][-1][title].append({"C++": "api/cpp/index.html"})
    known = set(paths_in(config["nav"]))
    for path in sorted(docs.rglob("*.md")):
        name = path.relative_to(docs).as_posix()
        if name not in known:
            log.warning("docs/README.md has no link to %s", name)
    return config


def on_page_markdown(markdown, page, config, files):
    folder = posixpath.dirname(page.file.src_path)

    def name_outward(match):
        path = posixpath.normpath(posixpath.join(folder, match[2]))
        if not path.startswith("../"):
            return match[0]
        return f"{match[1]} (`{path[3:]}` in the repository)"

    markdown = OUTWARD_LINK.sub(name_outward, markdown)
    notebook = f"notebooks/{Path(page.file.src_path).stem}.ipynb"
    if folder == "tutorials" and (Path(config["docs_dir"]) / folder /
                                  notebook).exists():
        title, _, rest = markdown.partition("\n")
        markdown = (f"{title}\n\n[This page as a Jupyter notebook]"
                    f"({notebook})\n{rest}")
    return markdown
