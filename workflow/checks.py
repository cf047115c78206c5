# SPDX-License-Identifier: BSD-3-Clause
"""Checks the configuration of the workflow before its first job."""
import difflib
import os
import re
import shlex
import shutil
import sqlite3
import subprocess

MATCHERS = ("sequential_matcher", "exhaustive_matcher", "spatial_matcher",
            "vocab_tree_matcher")
# The least value of numbers.
NUMBERS = {"num_images": 0, "num_clusters": 0, "images_per_shard": 1,
           "images_per_match_shard": 1, "images_per_cluster": 1, "threads": 1}
FLAGS = ("adjusts_extended", "keeps_features", "shares_calibration")
TEXTS = ("mgsfm", "images", "work", "database", "extends", "color_path")
# The commands that get the flags of an entry.
COMMANDS = {"extraction_options": ["feature_extractor"],
            "rig_options": ["rig_configurator"],
            "matcher_options": ["{matcher}"],
            "verification_options": ["{matcher}", "matches_importer"],
            "vocabulary_options": ["vocab_tree_builder"],
            "partition_options": ["mapper"],
            "prior_options": ["mapper", "model_merger"],
            "mapper_options": ["mapper"],
            "join_options": ["model_merger"]}
# Flags that the rules set.
RESERVED = {"database_path", "output_path", "image_list_path", "num_threads",
            "shard", "shard_path", "match_list_path", "output_pairs_path",
            "vocab_tree_path", "input_path", "existing_path", "cluster_path",
            "graph",
            "partition", "max_memory"}
SESSION_KEYS = ("images", "vehicle", "extraction_options")


def is_number(value):
    return isinstance(value, (int, float)) and not isinstance(value, bool)


def nearest(name, names):
    """A hint, or all names if none is near."""
    near = difflib.get_close_matches(name, names, 1)
    return f"did you mean '{near[0]}'?" if near else \
        "use one of " + ", ".join(sorted(names))


def flags_of(options):
    return [word[2:].split("=")[0] for word in shlex.split(options)
            if re.match(r"--[A-Za-z]", word)]


class Checker:
    """Collects one line per fault: key, value and remedy."""

    def __init__(self, config, defaults):
        self.config = config
        self.defaults = defaults
        self.faults = []
        self.flags = {}  # of each command

    def fault(self, key, value, remedy):
        self.faults.append(f"{key}: {value!r}: {remedy}")

    def check_keys(self):
        for key in self.config.keys() - self.defaults.keys():
            self.fault(key, self.config[key],
                       "there is no such entry; " + nearest(key, self.defaults))

    def check_values(self):
        for key, least in NUMBERS.items():
            value = self.config[key]
            if not isinstance(value, int) or isinstance(value, bool) or \
                    value < least:
                self.fault(key, value, f"give a whole number of at least {least}")
        for key in TEXTS:
            if not isinstance(self.config[key], str):
                self.fault(key, self.config[key], 'give a text, "" for none')
        for key in FLAGS:
            if not isinstance(self.config[key], bool):
                self.fault(key, self.config[key], "give true or false")
        if self.config["matcher"] not in MATCHERS:
            self.fault("matcher", self.config["matcher"],
                       nearest(str(self.config["matcher"]), MATCHERS))
        if not str(self.config["work"]).strip("/"):
            self.fault("work", self.config["work"], "name a folder for results")

    def check_resources(self):
        given, known = self.config["resources"], self.defaults["resources"]
        if not isinstance(given, dict):
            self.fault("resources", given, "give NAME: [base, per image]")
            return
        for key, value in given.items():
            if key not in known:
                self.fault(f"resources.{key}", value, nearest(key, known))
            elif not (isinstance(value, list) and len(value) == 2 and
                      all(is_number(n) and n >= 0 for n in value)):
                self.fault(f"resources.{key}", value,
                           "give [base, per image], two numbers of at least 0")

    def program_flags(self, command):
        """The flags of a command; empty if the program does not tell."""
        if command not in self.flags:
            text = subprocess.run(
                [self.config["mgsfm"], command, "--help_all"],
                capture_output=True, text=True, check=False).stdout
            self.flags[command] = set(re.findall(r"^ +--(\S+)", text, re.M))
        return self.flags[command]

    def check_options(self, key, options, commands):
        try:
            flags = flags_of(options) if isinstance(options, str) else None
        except ValueError:
            flags = None
        if flags is None:
            self.fault(key, options, "give flags as one text with paired quotes")
            return
        for flag in flags:
            if flag.split(".")[-1] in RESERVED:
                self.fault(key, "--" + flag, "the workflow sets it; remove it")
                continue
            for command in commands:
                known = self.program_flags(command)
                if known and flag not in known:
                    self.fault(key, "--" + flag, f"{command} has no such flag; "
                               + nearest(flag, known))

    def check_program(self):
        if shutil.which(str(self.config["mgsfm"])) is None:
            self.fault("mgsfm", self.config["mgsfm"],
                       "there is no such program; install it, or give its path")
            return
        matcher = self.config["matcher"]
        for key, commands in COMMANDS.items():
            self.check_options(key, self.config[key], [
                c.format(matcher=matcher) for c in commands
                if matcher in MATCHERS or "{" not in c])

    def check_folder(self, key, path):
        if not any(files for _, _, files in os.walk(str(path),
                                                    followlinks=True)):
            self.fault(key, path, "there is no such folder with images")

    def check_database(self, key, path):
        try:
            with sqlite3.connect(f"file:{path}?mode=ro", uri=True) as database:
                if database.execute("SELECT 1 FROM images LIMIT 1").fetchone():
                    return
        except sqlite3.Error:
            pass
        self.fault(key, path, "this is no database with images")

    def check_session(self, name, session):
        key = f"sessions.{name}"
        if not re.fullmatch(r"[^/\s]+", str(name)) or not \
                isinstance(session, dict) or "images" not in session:
            self.fault(key, session, "give a name without slashes and blanks, "
                       "and {images: FOLDER}")
            return
        for entry in session.keys() - set(SESSION_KEYS):
            self.fault(f"{key}.{entry}", session[entry],
                       nearest(entry, SESSION_KEYS))
        self.check_folder(f"{key}.images", session["images"])
        self.check_options(f"{key}.extraction_options",
                           session.get("extraction_options", ""),
                           COMMANDS["extraction_options"])

    def check_input(self):
        if self.config["database"]:
            self.check_database("database", self.config["database"])
            return
        sessions = self.config["sessions"]
        if not isinstance(sessions, dict):
            self.fault("sessions", sessions, "give NAME: {images: FOLDER}")
        elif sessions:
            for name, session in sessions.items():
                self.check_session(name, session)
        else:
            self.check_folder("images", self.config["images"])

    def check_extension(self):
        folder = self.config["extends"]
        if not folder:
            return
        if self.config["database"] or not self.config["sessions"]:
            self.fault("extends", folder, "list the new drives under sessions, "
                       "without database")
        self.check_database("extends", os.path.join(folder, "database.db"))
        if not os.path.isdir(os.path.join(folder, "model", "0")):
            self.fault("extends", folder, "it holds no model/0; give the work "
                       "folder of a finished workflow")
        if os.path.realpath(folder) == os.path.realpath(self.config["work"]):
            self.fault("extends", folder, "choose another folder for work")


def find_faults(config, defaults, files_are_local):
    """One line per fault of a configuration. Files in an object store are not
    looked for."""
    checker = Checker(config, defaults)
    checker.check_keys()
    checker.check_values()
    checker.check_resources()
    if files_are_local and not checker.faults:
        checker.check_program()
        checker.check_input()
        checker.check_extension()
    return checker.faults
