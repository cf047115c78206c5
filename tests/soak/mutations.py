#!/usr/bin/env python3
# SPDX-License-Identifier: BSD-3-Clause
"""Runs commands on damaged copies of valid files.

Every run must end with exit code 0, 1 or 2 within limits of time and memory. A
run that fails prints one line and writes no output; a model or database that a
run writes must be readable, and no input may change. Prints a count for each
command, and the command line and inputs of each run that breaks a rule; exit
code 1 if there is one.

  tests/soak/mutations.py build/release/apps/mgsfm/mgsfm --num_runs 50
"""

import argparse
import hashlib
import pathlib
import random
import re
import resource
import shutil
import sqlite3
import struct
import subprocess
import sys
import tempfile

# "  0.12 info    text", or the last line.
OWN_LINE = re.compile(r" *[\d.]+ (debug|info|warning|error) |mgsfm: ")
SOURCE = pathlib.Path(__file__).resolve().parents[2]
CPU_SECONDS = 60
MEMORY = 4 << 30
NUMBERS = ["nan", "-1", "0", "1e308", "-1e308", "1e-320", "2147483648", "-2147483649",
           "18446744073709551616", "4294967295", "", "x", "1e999", "0x10", "1,5"]
WORDS = [0, 1, 0x7F, 0xFF, 0x7FFF, 0xFFFF, 2**31 - 1, 2**31, 2**32 - 1, 2**63 - 1, 2**64 - 1]


def parse_arguments():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("program", type=pathlib.Path)
    parser.add_argument("--num_runs", type=int, default=50, help="per command")
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--only", default="", help="names of commands begin like this")
    parser.add_argument("--keep", type=pathlib.Path, help="folder for the inputs of failures")
    return parser.parse_args()


# ---------------------------------------------------------------- mutations


def change_bytes(rng, data):
    data = bytearray(data)
    for _ in range(rng.choice([1, 1, 2, 8, 40])):
        data[rng.randrange(len(data))] = rng.randrange(256)
    return bytes(data)


def truncate(rng, data):
    return data[: rng.randrange(len(data))]


def set_word(rng, data):
    size = rng.choice([2, 4, 8])
    if len(data) < size:
        return b""
    at = rng.randrange(len(data) - size + 1)
    if rng.random() < 0.5:
        at = min(at // 8 * 8, len(data) - size)
    word = (rng.choice(WORDS) & (2 ** (8 * size) - 1)).to_bytes(size, "little")
    if size == 8 and rng.random() < 0.4:
        word = struct.pack("<d", float(rng.choice(["nan", "inf", "-1e300", "1e-310"])))
    return data[:at] + word + data[at + size :]


def move_block(rng, data):
    first, last = sorted(rng.randrange(len(data) + 1) for _ in range(2))
    last = min(last, first + rng.choice([1, 16, 256, 5000]))
    at = rng.randrange(len(data) + 1)
    kind = rng.randrange(3)
    if kind == 0:
        return data[:first] + data[last:]
    if kind == 1:
        return data[:at] + data[first:last] * rng.choice([1, 2, 50]) + data[at:]
    return data[:first] + bytes(last - first) + data[last:]


def set_number(rng, data):
    numbers = list(re.finditer(rb"-?\d+(\.\d+)?(e[-+]?\d+)?", data))
    if not numbers:
        return change_bytes(rng, data)
    found = rng.choice(numbers[: rng.choice([5, 50, len(numbers)])])
    return data[: found.start()] + rng.choice(NUMBERS).encode() + data[found.end() :]


def change_lines(rng, data):
    lines = data.split(b"\n")
    i, j = rng.randrange(len(lines)), rng.randrange(len(lines))
    kind = rng.randrange(4)
    if kind == 0:
        del lines[i]
    elif kind == 1:
        lines.insert(j, lines[i])
    elif kind == 2:
        lines[i], lines[j] = lines[j], lines[i]
    else:
        words = lines[i].split(b" ")
        words.insert(rng.randrange(len(words) + 1), rng.choice(words))
        lines[i] = b" ".join(words)
    return b"\n".join(lines)


def change_file(rng, path):
    data = path.read_bytes()
    if not data:
        return
    is_text = b"\0" not in data[:4000]
    changes = [change_bytes, truncate, move_block]
    changes += [set_number] * 4 + [change_lines] * 3 if is_text else [set_word] * 4
    for _ in range(rng.choice([1, 1, 1, 2, 4])):
        if data:
            data = rng.choice(changes)(rng, data)
    path.write_bytes(data)


def change_rows(rng, path):
    """Valid pages with unusual rows: most damaged pages are refused at once."""
    database = sqlite3.connect(path)
    names = "SELECT name FROM sqlite_master WHERE type = 'table' AND name != 'sqlite_sequence'"
    tables = [row[0] for row in database.execute(names)]
    for _ in range(rng.choice([1, 1, 2, 4])):
        table = rng.choice(tables)
        columns = [row[1] for row in database.execute(f"PRAGMA table_info({table})")]
        rows = [row[0] for row in database.execute(f"SELECT rowid FROM {table}")]
        if not rows:
            continue
        column, row = rng.choice(columns), rng.choice(rows)
        sql = f"SELECT {column} FROM {table} WHERE rowid = ?"
        old = database.execute(sql, (row,)).fetchone()[0]
        values = [None, -1, 0, 2, 2**31, 2**62, -(2**63), 1e300, old]
        values += ["", "a\0b", "../x", "x" * 5000, b"", b"\xff" * 24, bytes(24)]
        if isinstance(old, bytes) and old:
            values += [change_bytes(rng, old), truncate(rng, old), set_word(rng, old)] * 5
        if isinstance(old, int):
            values += [old + 1, old - 1, -old] * 3
        place = (row,)
        where = "rowid = ?"
        if rng.random() < 0.1:
            where, place = "1", ()
        try:
            if rng.random() < 0.2:
                database.execute(f"DELETE FROM {table} WHERE {where}", place)
            else:
                sql = f"UPDATE {table} SET {column} = ? WHERE {where}"
                database.execute(sql, (rng.choice(values), *place))
        except sqlite3.Error:
            pass
    database.commit()
    database.close()


def damage(rng, paths):
    """Changes one or two of the files, or removes one."""
    for path in rng.sample(paths, min(len(paths), rng.choice([1, 1, 2]))):
        if rng.random() < 0.03:
            path.unlink()
        elif path.suffix == ".db" and rng.random() < 0.7:
            change_rows(rng, path)
        else:
            change_file(rng, path)


# --------------------------------------------------------------- valid files

CASES = {
    # name: (damaged files, arguments; the output is `out` or in it)
    "database_merger": (
        ["shards/*.db"],
        "database_merger --database_path shards/0.db,shards/1.db --merged_database_path out.db",
    ),
    "database_merger matches": (
        ["shards/*.db"],
        "database_merger --database_path features.db,shards/m0.db,shards/m1.db "
        "--merged_database_path out.db",
    ),
    "database_merger sessions": (
        ["drive/database.db", "other.db", "sessions.txt"],
        "database_merger --database_list_path sessions.txt --merged_database_path out.db",
    ),
    "exhaustive_matcher": (
        ["features.db"],
        "exhaustive_matcher --database_path features.db --shard 1/2 --shard_path out.db",
    ),
    "vocab_tree_builder": (
        ["features.db"],
        "vocab_tree_builder --database_path features.db --vocab_tree_path out "
        "--num_visual_words 64",
    ),
    "vocab_tree_matcher": (
        ["tree.bin"],
        "vocab_tree_matcher --database_path features.db --VocabTree.vocab_tree_path tree.bin "
        "--output_pairs_path out.txt",
    ),
    "matches_importer": (
        ["pairs.txt"],
        "matches_importer --database_path features.db --match_list_path pairs.txt "
        "--match_type pairs --shard 1/2 --shard_path out.db",
    ),
    "mapper": (["drive/database.db"], "mapper --database_path drive/database.db --output_path out"),
    "mapper extends": (
        ["model/*"],
        "mapper --database_path drive/database.db --output_path out --input_path model",
    ),
    "model_merger": (
        ["parts/*/*"],
        "model_merger --input_path1 parts/0 --input_path2 parts/1 --output_path out",
    ),
    "model_merger graph": (
        ["maps/**/*", "drive/database.db"],
        "model_merger --graph 1 --input_path maps --database_path drive/database.db "
        "--output_path out",
    ),
    "model_splitter": (
        ["model/*"],
        "model_splitter --input_path model --output_path out --num_overlap_frames 3",
    ),
    "model_aligner": (
        ["model/*", "positions.txt"],
        "model_aligner --input_path model --output_path out --ref_images_path positions.txt "
        "--ref_is_gps 0",
    ),
    "model_aligner database": (
        ["drive/database.db"],
        "model_aligner --input_path model --output_path out --database_path drive/database.db",
    ),
    "model_aligner plane": (
        ["text/*"],
        "model_aligner --input_path text --output_path out --alignment_type plane",
    ),
    "model_aligner model": (
        ["text/*"],
        "model_aligner --input_path model --output_path out --ref_model_path text",
    ),
    "model_cropper": (
        ["model/*"],
        "model_cropper --input_path model --output_path out --boundary 0,0.5",
    ),
    "image_deleter": (
        ["model/*", "names.txt"],
        "image_deleter --input_path model --output_path out --image_names_path names.txt",
    ),
    "import nvm": (
        ["model.nvm"],
        "model_converter --input_path model.nvm --output_path out --image_path images",
    ),
    "import bundler": (
        ["b.bundle.out", "b.list.txt"],
        "model_converter --input_path b.bundle.out --output_path out --image_path images",
    ),
    "import nerfstudio": (
        ["nerf/*"],
        "model_converter --input_path nerf/transforms.json --output_path out",
    ),
    "import tum": (
        ["path.tum", "drive/timestamps.txt"],
        "model_converter --input_path path.tum --input_type tum --output_path out "
        "--rig_config_path model --database_path drive/database.db "
        "--image_timestamps_path drive/timestamps.txt",
    ),
    "import kitti": (
        ["path.kitti"],
        "model_converter --input_path path.kitti --input_type kitti --output_path out "
        "--rig_config_path model --database_path drive/database.db",
    ),
    "feature_importer": (
        ["features.h5"],
        "feature_importer --database_path out.db --import_path features.h5",
    ),
    "point_triangulator": (
        ["model/*"],
        "point_triangulator --database_path drive/database.db --input_path model "
        "--output_path out",
    ),
    "bundle_adjuster": (["model/*"], "bundle_adjuster --input_path model --output_path out"),
    "report": (["model/*"], "report --input_path model --output_path out.html"),
    "model_evaluator": (
        ["model/*", "text/*"],
        "model_evaluator --input_path model --gt_path text --json out.json --svg_path out.svg",
    ),
    "image_splitter": (
        ["panoramas/*"],
        "image_splitter --image_path panoramas --output_path out --max_image_size 32",
    ),
    "calibration": (
        ["rig.yaml"],
        "mapper --database_path drive/database.db --output_path out --calibration_path rig.yaml",
    ),
}


def panorama(seed):
    rng = random.Random(seed)
    return b"P6 128 64 255\n" + bytes(rng.randrange(256) for _ in range(128 * 64 * 3))


def nerfstudio(folder):
    frames = []
    for i in range(4):
        matrix = [[1, 0, 0, i], [0, 1, 0, 0], [0, 0, 1, 0], [0, 0, 0, 1]]
        frames.append(f'{{"file_path": "images/{i}.png", "transform_matrix": {matrix}}}')
    intrinsics = '"camera_model": "OPENCV", "fl_x": 90, "fl_y": 90, "cx": 50, "cy": 40, '
    intrinsics += '"w": 100, "h": 80, "k1": 0.01, "k2": 0, "p1": 0, "p2": 0.001'
    folder.mkdir()
    text = f'{{{intrinsics}, "ply_file_path": "points.ply", "frames": [{", ".join(frames)}]}}'
    (folder / "transforms.json").write_text(text)
    header = "ply\nformat ascii 1.0\nelement vertex 2\n"
    header += "".join(f"property float {axis}\n" for axis in "xyz")
    (folder / "points.ply").write_text(f"{header}end_header\n1 2 3\n4 5 6\n")


class Sandbox:
    def __init__(self, program, folder):
        self.program = program.resolve()
        self.folder = folder

    def run(self, arguments, folder):
        def limit():
            resource.setrlimit(resource.RLIMIT_CPU, (CPU_SECONDS, CPU_SECONDS))
            resource.setrlimit(resource.RLIMIT_AS, (MEMORY, MEMORY))
            resource.setrlimit(resource.RLIMIT_CORE, (0, 0))

        command = [self.program, *arguments.split(), "--num_threads", "1"]
        return subprocess.run(
            command, cwd=folder, capture_output=True, preexec_fn=limit, timeout=20 * CPU_SECONDS
        )

    def prepare(self):
        """The valid files of all cases."""
        folder = self.folder / "valid"
        folder.mkdir()
        for name in ("shards", "panoramas"):
            (folder / name).mkdir()
        nerfstudio(folder / "nerf")
        for i in range(3):
            (folder / f"panoramas/{i}.ppm").write_bytes(panorama(i))
        shutil.copy(SOURCE / "tests/fuzz/corpus/hloc/features", folder / "features.h5")
        drive = "--num_frames 12 --num_points_per_frame 60 --prior_sigma 0.1"
        images = "--image_path panoramas --SiftExtraction.max_num_features 60"
        for line in [
            f"simulate --output_path drive {drive}",
            f"simulate --output_path other {drive} --random_seed 1",
            "mapper --database_path drive/database.db --output_path maps/0",
            "mapper --database_path drive/database.db --output_path mapped",
            "model_converter --input_path mapped/0 --output_path text --output_type txt",
            "model_splitter --input_path mapped/0 --output_path parts --num_overlap_frames 3",
            "model_converter --input_path mapped/0 --output_path path.tum --output_type tum "
            "--image_timestamps_path drive/timestamps.txt",
            "model_converter --input_path mapped/0 --output_path path.kitti --output_type kitti",
            "model_converter --input_path mapped/0 --output_path rig.yaml --output_type kalibr",
            "simulate --output_path mono --rig mono --num_frames 6 --num_points_per_frame 60",
            f"feature_extractor --database_path features.db {images}",
            f"feature_extractor --database_path shards/0.db --shard 1/2 {images}",
            f"feature_extractor --database_path shards/1.db --shard 2/2 {images}",
            "exhaustive_matcher --database_path features.db --shard 1/2 --shard_path shards/m0.db",
            "exhaustive_matcher --database_path features.db --shard 2/2 --shard_path shards/m1.db",
            "exhaustive_matcher --database_path features.db --output_pairs_path pairs.txt",
            "vocab_tree_builder --database_path features.db --vocab_tree_path tree.bin "
            "--num_visual_words 64",
        ]:
            result = self.run(line, folder)
            if result.returncode != 0:
                sys.exit(f"{line}: {result.stderr.decode()}")
        (folder / "other/database.db").rename(folder / "other.db")
        (folder / "sessions.txt").write_text("drive/database.db\ta/\tvan\nother.db\tb/\tcar\n")
        (folder / "mapped/0").rename(folder / "model")
        shutil.copytree(folder / "parts/0", folder / "maps/1/0")
        self.write_text_files(folder)
        return folder

    def write_text_files(self, folder):
        rows = sqlite3.connect(folder / "drive/database.db").execute(
            "SELECT name, image_id FROM images ORDER BY name"
        )
        names = [row[0] for row in rows]
        (folder / "names.txt").write_text("\n".join(names[:5]) + "\n")
        lines = [f"{name} {i} {i * i * 0.1} {i % 3}" for i, name in enumerate(names)]
        (folder / "positions.txt").write_text("\n".join(lines) + "\n")
        # Files of other programs need the sizes of the images.
        (folder / "images/cam0").mkdir(parents=True)
        for i in range(6):
            (folder / f"images/cam0/{i:06}.png").write_bytes(b"P5 64 48 255\n" + bytes(64 * 48))
        for kind, path in (("nvm", "model.nvm"), ("bundler", "b")):
            line = "model_converter --input_path mono/truth --output_path "
            result = self.run(f"{line}{path} --output_type {kind}", folder)
            if result.returncode != 0:
                sys.exit(f"{kind}: {result.stderr.decode()}")


def hash_files(folder, pattern="*"):
    return {
        str(path.relative_to(folder)): hashlib.sha256(path.read_bytes()).digest()
        for path in folder.rglob(pattern)
        if path.is_file()
    }


def is_output(name):
    return name.split("/")[0] in {"out", "out.db", "out.txt", "out.html", "out.json", "out.svg"}


def is_continued(arguments):
    """Whether the next run continues with what a failed one has written."""
    commands = ("feature_importer", "image_splitter")
    return arguments.startswith(commands) or "shard_path" in arguments


def problem_of_messages(code, err):
    if code not in (0, 1, 2):
        return f"exit code {code}: {err[-500:]}"
    foreign = [line for line in err.splitlines() if not OWN_LINE.match(line)]
    if foreign:
        return f"prints messages of others: {foreign[:3]}"
    if code == 1:
        last = err[err.find("mgsfm: ") :]
        if "mgsfm: " not in err or last.count("\n") != 1 or len(last) > 1000:
            return f"not one line of message: {err[-800:]}"
    return ""


def problem_of(sandbox, name, arguments, folder, is_valid):
    """What a run does wrong, or '', and its exit code."""
    before = hash_files(folder)
    try:
        result = sandbox.run(arguments, folder)
    except subprocess.TimeoutExpired:
        return "hangs", -1
    code, err = result.returncode, result.stderr.decode(errors="replace")
    problem = problem_of_messages(code, err)
    if problem:
        return problem, code
    if is_valid:
        return "" if code == 0 else f"fails on valid files: {err[-300:]}", code
    after = hash_files(folder)
    for path, content in before.items():
        if after.get(path) != content:
            return f"{path} has changed", code
    new = [path for path in after if path not in before]
    strange = [path for path in new if not is_output(path)]
    if strange:
        return f"writes {strange}", code
    if code == 1 and new and not is_continued(arguments):
        return f"fails, but writes {new}: {err[-300:]}", code
    if code == 0 and not new:
        return "succeeds without output", code
    if code != 0:
        return "", code
    for model in [path.parent for path in (folder / "out").rglob("images.bin")]:
        check = sandbox.run(f"model_analyzer --path {model}", folder)
        if check.returncode != 0:
            return f"writes a model that cannot be read: {check.stderr.decode()[-400:]}", code
    return "", code


def attack(sandbox, name, num_runs, rng, keep):
    patterns, arguments = CASES[name]
    valid = sandbox.folder / "valid"
    num_problems, codes = 0, {}
    for i in range(num_runs + 1):
        folder = sandbox.folder / "run"
        shutil.rmtree(folder, ignore_errors=True)
        shutil.copytree(valid, folder)
        # The first run is that on valid files.
        if i > 0:
            files = [p for pattern in patterns for p in sorted(folder.glob(pattern)) if p.is_file()]
            damage(rng, files)
        problem, code = problem_of(sandbox, name, arguments, folder, i == 0)
        if i > 0:
            codes[code] = codes.get(code, 0) + 1
        if problem:
            num_problems += 1
            print(f"{name}, run {i}: {problem}", flush=True)
            if keep:
                shutil.copytree(folder, keep / f"{name.replace(' ', '_')}_{i}", dirs_exist_ok=True)
    counts = ", ".join(f"{codes[code]} with exit code {code}" for code in sorted(codes))
    print(f"{name}: {num_runs} damaged inputs, {counts}", flush=True)
    return num_problems


def main():
    arguments = parse_arguments()
    with tempfile.TemporaryDirectory() as folder:
        sandbox = Sandbox(arguments.program, pathlib.Path(folder))
        sandbox.prepare()
        num_problems = 0
        for name in CASES:
            if name.startswith(arguments.only):
                rng = random.Random(f"{arguments.seed} {name}")
                num_problems += attack(sandbox, name, arguments.num_runs, rng, arguments.keep)
    sys.exit(1 if num_problems else 0)


if __name__ == "__main__":
    main()
