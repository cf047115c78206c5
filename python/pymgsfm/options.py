# SPDX-License-Identifier: BSD-3-Clause
"""Options of commands, with the names of docs/reference/options.md."""

from __future__ import annotations

import os
from dataclasses import dataclass
from typing import Any, Dict, Iterator, List, Mapping, Tuple, Union

import numpy as np

from . import _core
from .errors import InputError

OptionValue = Union[bool, int, float, str]


@dataclass(frozen=True)
class OptionInfo:
    """The documentation of one option.

    Attributes:
      name: With the group, as in "Tracks.min_track_length".
      range: In interval notation; "" if unbounded.
      choices: The valid values of a choice; else empty.
    """

    name: str
    default: OptionValue
    unit: str
    range: str
    choices: List[str]
    help: str


class OptionGroup:
    """The options of one group of a command, as attributes.

    Assigning an unknown name or a value out of its range raises InputError.
    """

    def __init__(self, command: str, prefix: str = "") -> None:
        object.__setattr__(self, "_command", command)
        object.__setattr__(self, "_prefix", prefix)
        object.__setattr__(self, "_values", {})
        infos = {}
        groups: Dict[str, OptionGroup] = {}
        for entry in _core.list_options(command):
            info = OptionInfo(**entry)
            if not info.name.startswith(prefix):
                continue
            group, dot, _ = info.name[len(prefix):].partition(".")
            if not dot:
                infos[group] = info
            elif group not in groups:
                groups[group] = OptionGroup(command, prefix + group + ".")
        object.__setattr__(self, "_infos", infos)
        object.__setattr__(self, "_groups", groups)

    def info(self, name: str) -> OptionInfo:
        """The documentation of an option of this group."""
        if name not in self._infos:
            _core.parse_option(self._command, self._prefix + name, "")
        return self._infos[name]  # type: ignore[no-any-return]

    def changed(self) -> Dict[str, OptionValue]:
        """The options that were set, by their names within this group."""
        values = dict(self._values)
        for name, group in self._groups.items():
            for key, value in group.changed().items():
                values[f"{name}.{key}"] = value
        return values

    def update(self, values: Mapping[str, Any]) -> None:
        """Sets options from a flat or nested dict."""
        for name, value in flatten(values):
            group, _, rest = name.partition(".")
            if rest and group in self._groups:
                self._groups[group].update({rest: value})
            else:
                setattr(self, name, value)

    def __getattr__(self, name: str) -> Any:
        if name.startswith("_"):
            raise AttributeError(name)
        if name in self._groups:
            return self._groups[name]
        if name in self._values:
            return self._values[name]
        if name not in self._infos:
            raise AttributeError(f"{self._command} has no option "
                                 f"{self._prefix}{name}")
        return self._infos[name].default

    def __setattr__(self, name: str, value: Any) -> None:
        if name in self._groups:
            raise InputError(f"{self._prefix}{name} is a group of options")
        self._values[name] = _core.parse_option(
            self._command, self._prefix + name, to_text(name, value))

    def __dir__(self) -> List[str]:
        return [*super().__dir__(), *self._infos, *self._groups]

    def __eq__(self, other: object) -> bool:
        return (isinstance(other, OptionGroup)
                and self._command == other._command
                and self._prefix == other._prefix
                and self.changed() == other.changed())

    def __repr__(self) -> str:
        return f"<options {self._command} {self._prefix}{self.changed()}>"

    def __reduce__(self) -> Tuple[Any, ...]:
        return (_restore, (type(self), self._command, self._prefix,
                           self.changed()))


class Options(OptionGroup):
    """All options of a command, such as Options("mapper").

    Groups are attributes: options.Tracks.min_track_length = 2.
    """

    def __init__(self, command: str, values: Mapping[str, Any] = {},
                 prefix: str = "") -> None:
        if command not in _core.command_names():
            raise InputError(f"unknown command '{command}'; it is one of "
                             + ", ".join(_core.command_names()))
        super().__init__(command, prefix)
        self.update(values)


OptionsLike = Union[OptionGroup, Mapping[str, Any], None]


def with_group_name(options: OptionsLike) -> OptionsLike:
    """The options of a group of a command by their names in the command."""
    if isinstance(options, OptionGroup) and options._prefix:
        return {options._prefix[:-1]: options.changed()}
    return options


def _restore(kind: Any, command: str, prefix: str,
             values: Mapping[str, OptionValue]) -> Any:
    group = kind(command, prefix=prefix)
    group.update(values)
    return group


def to_text(name: str, value: Any) -> str:
    """The text that the option of the command line would have."""
    if isinstance(value, (bool, np.bool_)):
        return "true" if value else "false"
    if isinstance(value, (int, np.integer)):
        return str(int(value))
    if isinstance(value, (float, np.floating)):
        return repr(float(value))
    if isinstance(value, (str, os.PathLike)):
        return str(os.fspath(value))
    if isinstance(value, (list, tuple, np.ndarray)):
        return ",".join(to_text(name, item) for item in value)
    raise InputError(f"option {name} cannot be a {type(value).__name__}")


def flatten(values: Mapping[str, Any],
            prefix: str = "") -> Iterator[Tuple[str, Any]]:
    """The names and values of a nested dict. None keeps the default."""
    for name, value in values.items():
        if isinstance(value, Mapping):
            yield from flatten(value, f"{prefix}{name}.")
        elif value is not None:
            yield prefix + name, value


def to_texts(*sources: OptionsLike) -> List[Tuple[str, str]]:
    """Names and texts of the options of all sources.

    Raises InputError if an option is given twice.
    """
    texts: Dict[str, str] = {}
    for source in sources:
        values = (source.changed() if isinstance(source, OptionGroup)
                  else source or {})
        for name, value in flatten(values):
            if name in texts:
                raise InputError(f"option {name} is given twice")
            texts[name] = to_text(name, value)
    return list(texts.items())
