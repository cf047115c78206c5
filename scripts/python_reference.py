#!/usr/bin/env python3
# SPDX-License-Identifier: BSD-3-Clause
"""Prints docs/reference/python.md from the package pymgsfm.

    PYTHONPATH=build/release/python scripts/python_reference.py
"""

import enum
import inspect
import re

import pymgsfm

SECTIONS = [
    ("Commands", "commands"), ("Tools", "tools"),
    ("Commands by pycolmap's names", "dialect"), ("Averaging", "averaging"),
    ("Models", "reconstruction"), ("Editing of models", "editing"),
    ("Rigs, frames and images", "scene"), ("Points", "points"),
    ("Cameras", "cameras"), ("Transforms", "geometry"),
    ("Estimators", "estimators"), ("Alignment", "alignment"),
    ("Databases", "database"), ("Options", "options"), ("Errors", "errors"),
]


def code(text):
    return f"```python\n{text}\n```"


def to_markdown(doc):
    """A docstring with lists of its arguments or attributes."""
    lines, is_list = [], False
    for line in doc.split("\n"):
        if re.fullmatch("(Args|Attributes):", line):
            lines += [f"*{line[:-1]}*", ""]
            is_list = True
        elif is_list and re.match(r"  \S", line):
            names, colon, text = line.strip().partition(":")
            names = ", ".join(f"`{name}`" for name in names.split(", "))
            lines.append(f"- {names}{colon}{text}")
        elif is_list and not line.startswith(" ") and line:
            is_list = False
            lines.append(line)
        else:
            lines.append(line[2:] if is_list else line)
    return "\n".join(lines)


class Plain:
    """An annotation that prints without quotes."""

    def __init__(self, annotation):
        text = getattr(annotation, "__forward_arg__", annotation)
        self._text = re.sub("[\"']", "", str(text))

    def __repr__(self):
        return self._text


def with_plain_annotations(found):
    empty = inspect.Signature.empty
    parameters = [part if part.annotation is empty else
                  part.replace(annotation=Plain(part.annotation))
                  for part in found.parameters.values()]
    result = found.return_annotation
    return found.replace(parameters=parameters, return_annotation=(
        empty if result is empty else Plain(result)))


def signature(item, name):
    try:
        text = name + str(with_plain_annotations(inspect.signature(item)))
    except ValueError:  # an exception of the compiled module
        return name
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
    """The public methods and properties that the class or a base of it that is
    not public defines."""
    bases = [base for base in cls.__mro__ if base is cls or (
        base.__module__.startswith("pymgsfm.")
        and base.__name__ not in pymgsfm.__all__)]
    for name, member in [item for base in bases for item in vars(base).items()]:
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
        return f"### `{name}`\n\n{code(repr(item))}\n"
    if item.__name__ not in (name, "InputError", "InternalError"):
        return f"### `{name}`\n\nAnother name of `{item.__qualname__}`.\n"
    if inspect.isclass(item) and issubclass(item, enum.Enum):
        members = ", ".join(f"`{member.name}`" for member in item)
        return (f"### `{name}`\n\n{to_markdown(inspect.getdoc(item))}\n\n"
                f"Values: {members}\n")
    text = f"### `{name}`\n\n{code(signature(item, name))}\n"
    text += f"\n{to_markdown(inspect.getdoc(item) or '')}\n"
    if inspect.isclass(item) and not issubclass(item, Exception):
        for title, doc in own_methods(item):
            text += f"\n{code(title)}\n"
            text += f"\n{to_markdown(doc)}\n" if doc else ""
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
            print(f"{to_markdown(module.__doc__.strip())}\n")
        homes = [module.__name__]
        if module_name == "errors":
            homes.append("pymgsfm._core")
        own = [name for name in vars(module) if name in names
               and getattr(getattr(pymgsfm, name), "__module__",
                           module.__name__) in homes]
        for name in own:
            names.discard(name)
            print(describe(name))
    assert not names, names


if __name__ == "__main__":
    main()
