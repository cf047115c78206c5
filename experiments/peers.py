# SPDX-License-Identifier: BSD-3-Clause
"""External methods: other programs that map the same database.

A peer is a command with placeholders. Its output counts as a model if it is in
COLMAP's format, binary or text, in {output} or a sub-folder; the largest model
is evaluated.
"""
import dataclasses
import os
import re
import shlex
import shutil
import subprocess

PLACEHOLDERS = ("database", "output", "images", "threads")
REQUIRED = ("database", "output")
COLMAP_OPTIONS = (
    "--Mapper.num_threads {threads} --Mapper.extract_colors 0 "
    "--Mapper.ba_refine_focal_length 0 --Mapper.ba_refine_extra_params 0 "
    "--Mapper.init_min_tri_angle 4 --Mapper.init_max_forward_motion 1")


@dataclasses.dataclass(frozen=True)
class Peer:
    """An external method; `words` is its command, not yet filled in."""

    name: str
    words: tuple
    version: str = "unknown version"

    def command(self, values):
        """The words, with {placeholders} replaced by `values`."""
        return [re.sub(r"\{(\w+)\}", lambda match: str(values[match[1]]), word)
                for word in self.words]


def known_peer(name, program, command, options=""):
    """A peer with COLMAP's command line."""
    return Peer(name, tuple(shlex.split(
        f"{program} {command} --database_path {{database}} "
        f"--output_path {{output}} --image_path {{images}} {options}")))


KNOWN = {peer.name: peer for peer in (
    known_peer("colmap", "colmap", "mapper", COLMAP_OPTIONS),
    known_peer("glomap", "glomap", "mapper"),
    known_peer("colmap_global", "colmap", "global_mapper"),
)}


def environment():
    """The environment of a peer, which must not look for a display."""
    return {**os.environ, "QT_QPA_PLATFORM": "offscreen"}


def output_of(*command):
    """The text that a command prints, whatever its exit code."""
    done = subprocess.run(command, capture_output=True, text=True,
                          env=environment(), check=False)
    return done.stdout + done.stderr


def program_version(program):
    """The first line with a version in the help of a program, or None."""
    if shutil.which(program) is None:
        return None
    for line in output_of(program, "-h").splitlines():
        if re.search(r"\d+\.\d+", line):
            return line.strip()
    return "unknown version"


def find_installed():
    """{name: Peer with version} of the known peers on this machine."""
    found = {}
    for name, peer in KNOWN.items():
        program, command = peer.words[:2]
        version = program_version(program)
        if version and command in output_of(program, "help"):
            found[name] = dataclasses.replace(peer, version=version)
    return found


def parse_external(text):
    """The Peer of NAME='command {database} {output}'; throws ValueError."""
    name, equals, command = text.partition("=")
    if not equals or not re.fullmatch(r"[A-Za-z0-9][\w.-]*", name):
        raise ValueError(f"'{text}' is not "
                         "NAME='command {database} {output}'")
    try:
        words = tuple(shlex.split(command))
    except ValueError as error:
        raise ValueError(f"command of {name}: {error}") from None
    used = re.findall(r"\{(\w+)\}", command)
    for word in REQUIRED:
        if word not in used:
            raise ValueError(f"the command of {name} does not use {{{word}}}")
    for word in used:
        if word not in PLACEHOLDERS:
            raise ValueError(
                f"the command of {name} uses {{{word}}}; there are "
                + ", ".join(f"{{{p}}}" for p in PLACEHOLDERS))
    return Peer(name, words, "given by --external")


def check_programs(peers):
    """Ends with one line if the program of a given peer is missing."""
    for peer in peers:
        if shutil.which(peer.words[0]) is None:
            raise SystemExit(f"no program {peer.words[0]} for --external "
                             f"{peer.name}")
