#!/usr/bin/env python3
# SPDX-License-Identifier: BSD-3-Clause
"""Prints docs/reference/python.md from the package pymgsfm.

    PYTHONPATH=build/release/python scripts/python_reference.py
"""

import inspect

import pymgsfm

SECTIONS = [
    ("Commands", "commands"), ("Averaging", "averaging"),
    ("Models", "reconstruction"), ("Transforms", "geometry"),
    ("Options", "options"), ("Errors", "errors"),
]


def indent(text):
    return "\n".join("    " + line if line else "" for line in text.split("\n"))


def signature(item, name):
    try:
        text = str(inspect.signature(item))
    except ValueError:  # an exception of the compiled module
        return name
    text = name + text.replace("'", "")
    if len(text) <= 76:
        return text
    # One parameter per line; commas within brackets separate none.
    parameters, depth = [""], 0
    head, _, rest = text.partition("(")
    body, _, result = rest.rpartition(")")
    for letter in body:
        depth += (letter in "([{") - (letter in ")]}")
        if letter == "," and depth == 0:
            parameters.append("")
        else:
            parameters[-1] += letter
    lines = ",\n".join("    " + parameter.strip() for parameter in parameters)
    return f"{head}(\n{lines}){result}"


def own_methods(cls):
    """The public methods and properties that the class itself defines."""
    for name, member in vars(cls).items():
        if name.startswith("_"):
            continue
        if isinstance(member, property):
            yield name, inspect.getdoc(member)
        elif isinstance(member, (staticmethod, classmethod)) or inspect.isfunction(member):
            yield signature(getattr(cls, name), name), inspect.getdoc(
                getattr(cls, name))


def describe(name):
    item = getattr(pymgsfm, name)
    if not callable(item):
        return f"### `{name}`\n\n    {item!r}\n"
    text = f"### `{name}`\n\n{indent(signature(item, name))}\n"
    text += f"\n{indent(inspect.getdoc(item) or '')}\n"
    if inspect.isclass(item) and not issubclass(item, Exception):
        lines = [f"{title}" + (f"\n{indent(doc)}" if doc else "")
                 for title, doc in own_methods(item)]
        if lines:
            text += "\n" + indent("\n".join(lines)) + "\n"
    return text


def main():
    print("# Python\n\nMade by `scripts/python_reference.py` from the "
          "package itself; do not edit. The [guide](../guides/python.md)\n"
          "explains how the parts work together.\n")
    names = {name for name in pymgsfm.__all__ if not name.startswith("__")}
    for title, module_name in SECTIONS:
        module = inspect.importlib.import_module("pymgsfm." + module_name)
        print(f"## {title}\n")
        if module.__doc__:
            print(f"{indent(module.__doc__.strip())}\n")
        own = [name for name in vars(module) if name in names
               and getattr(getattr(pymgsfm, name), "__module__",
                           module.__name__) in (module.__name__,
                                                "pymgsfm._core")]
        for name in own:
            names.discard(name)
            print(describe(name))
    assert not names, names


if __name__ == "__main__":
    main()
