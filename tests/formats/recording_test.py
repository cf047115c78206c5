# SPDX-License-Identifier: BSD-3-Clause
"""Recordings of ROS 1 and 2, whole and damaged."""
import json
import pathlib
import sqlite3
import struct
import subprocess
import sys

import numpy
import pytest
import ros_files as ros
from numpy.testing import assert_allclose

T0 = 1_700_000_000_000_000_000
STEP = 100_000_000  # 10 Hz
RNG = numpy.random.default_rng(0)
PIXELS = {(camera, i): RNG.integers(0, 256, (24, 32, 3), numpy.uint8)
          for camera in ("left", "right") for i in range(8)}
# One gray pixel.
SMALL_PNG = bytes.fromhex(
    "89504e470d0a1a0a0000000d49484452000000010000000108000000003a7e9b55"
    "0000000a49444154789c6360000000020001e221bc330000000049454e44ae426082")
# Of a camera that was calibrated with OpenCV.
K = [400.0, 0, 15.5, 0, 410.0, 11.5, 0, 0, 1]
D = [-0.1, 0.02, 0.001, -0.002, 0.0]
# Writers: extension, encoding of messages, and a function.
WRITERS = {
    **{f"bag_{c}": (".bag", "ros1",
                    lambda path, m, c=c: ros.write_ros1_bag(path, m, c))
       for c in ("none", "bz2", "lz4")},
    **{f"mcap_{c or 'none'}": (
        ".mcap", "cdr",
        lambda path, m, c=c: ros.write_mcap(path, m, "cdr", c))
       for c in ("", "lz4", "zstd")},
    "mcap_without_chunks": (".mcap", "cdr",
                            lambda path, m: ros.write_mcap(
                                path, m, chunk_size=0)),
    "mcap_ros1": (".mcap", "ros1",
                  lambda path, m: ros.write_mcap(path, m, "ros1", "lz4")),
    "db3": (".db3", "cdr", ros.write_db3),
    "db3_zstd": (".db3", "cdr",
                 lambda path, m: ros.write_db3(path, m, "zstd")),
}


def name_of(time_ns):
    return f"{time_ns // 10**9:06}.{time_ns % 10**9:09}"


def image_message(camera, time_ns, pixels, encoding, name="bgr8",
                  stamp_ns=None, **kwargs):
    return ros.Message(
        f"/{camera}/image_raw", "sensor_msgs/Image", time_ns + 5_000_000,
        ros.image(encoding, time_ns if stamp_ns is None else stamp_ns,
                  f"{camera}_optical", name, pixels, **kwargs))


def drive_messages(encoding, times=None):
    """Two cameras with lenses, their frames, and a topic that nobody wants."""
    messages = [ros.Message("/tf_static", "tf2_msgs/TFMessage", T0,
                            ros.transforms(encoding, [
                                ("base", "left_optical", (0, 0.3, 0),
                                 (0, 0, 0, 1)),
                                ("/base", "right_mount", (0, -0.2, 0),
                                 (0, 0, 0.7071067811865476,
                                  0.7071067811865476)),
                                ("right_mount", "right_optical", (0.1, 0, 0),
                                 (0, 0, 0, 1))]))]
    for i in range(8):
        for camera in ("left", "right"):
            time_ns = T0 + i * STEP if times is None else times[camera][i]
            if time_ns is None:
                continue
            messages.append(ros.Message(
                f"/{camera}/camera_info", "sensor_msgs/CameraInfo", time_ns,
                ros.camera_info(encoding, f"{camera}_optical", (32, 24),
                                "plumb_bob", D, K)))
            messages.append(image_message(camera, time_ns,
                                          PIXELS[camera, i], encoding))
        messages.append(ros.Message("/scan", "sensor_msgs/PointCloud2",
                                    T0 + i * STEP, b"not read"))
    return messages


@pytest.fixture
def importer(request, tmp_path):
    """Imports a recording; returns the folder and what is printed."""
    program = request.config.getoption("--program").resolve()

    def call(path, *words, fails=False, output="out"):
        done = subprocess.run(
            list(map(str, [program, "recording_importer", "--recording_path",
                           path, "--output_path", tmp_path / output,
                           *words])),
            capture_output=True, text=True, check=False)
        assert done.returncode == (1 if fails else 0), done.stderr
        return tmp_path / output, done.stderr
    return call


def images_of(folder):
    return {str(path.relative_to(folder / "images")): path
            for path in (folder / "images").rglob("*.*")}


def expect_images(folder, expected):
    """`expected` has pixels by camera and time."""
    images = images_of(folder)
    assert set(images) == {f"{camera}/{name_of(time)}.png"
                           for camera, time in expected}
    for (camera, time), pixels in expected.items():
        read = ros.read_png(images[f"{camera}/{name_of(time)}.png"])
        assert numpy.array_equal(read, pixels)


def all_images(keep=lambda camera, i: True):
    return {(camera, T0 + i * STEP): pixels
            for (camera, i), pixels in PIXELS.items() if keep(camera, i)}


@pytest.mark.parametrize("writer", WRITERS)
def test_whole_recordings(writer, importer, mgsfm, tmp_path):
    extension, encoding, write = WRITERS[writer]
    path = tmp_path / f"drive{extension}"
    write(path, drive_messages(encoding))

    listed = mgsfm("recording_importer", "--recording_path", path)
    for line in ("8   sensor_msgs/Image  /left/image_raw",
                 "1   tf2_msgs/TFMessage  /tf_static",
                 "8   sensor_msgs/PointCloud2  /scan"):
        count, kind, topic = line.split()
        assert any(words[0] == count and words[2:] == [kind, topic]
                   for words in map(str.split, listed.splitlines())), listed

    folder, log = importer(path, "--sampling", "all")
    assert "WARN" not in log.upper(), log
    expect_images(folder, all_images())
    rig = json.loads((folder / "rig_config.json").read_text())[0]["cameras"]
    assert [camera["image_prefix"] for camera in rig] == ["left/", "right/"]
    for camera in rig:
        assert camera["camera_model_name"] == "OPENCV"
        assert_allclose(camera["camera_params"],
                        [400, 410, 16, 12, *D[:4]])
    # The right camera is 0.5 m to the right of the left one, plus 0.1 m along
    # its mount, which is turned by 90 degrees about z.
    assert_allclose(rig[1]["cam_from_rig_rotation"],
                    [numpy.sqrt(0.5), 0, 0, -numpy.sqrt(0.5)], atol=1e-12)
    assert_allclose(rig[1]["cam_from_rig_translation"], [0.4, 0, 0],
                    atol=1e-12)


@pytest.mark.parametrize("codec", ("bz2", "lz4"))
def test_bags_of_rosbag(codec, importer):
    """Written by rosbag 1.15 of Debian 12, whose LZ4 is its own: two images."""
    path = pathlib.Path(__file__).parent / f"rosbag_{codec}.bag"
    pixels = numpy.arange(24 * 32).reshape(24, 32)
    expect_images(importer(path, "--sampling", "all")[0],
                  {("left", T0 + 1000 * i): pixels * (i + 1) % 256
                   for i in range(2)})


def test_parts_and_folders(importer, tmp_path):
    messages = drive_messages("cdr")
    folder = tmp_path / "parts"
    folder.mkdir()
    ros.write_mcap(folder / "drive_0.mcap", messages[:20])
    ros.write_db3(folder / "drive_1.db3", messages[20:])
    expect_images(importer(folder, "--sampling", "all")[0], all_images())


def test_a_second_run_continues(importer, tmp_path):
    path = tmp_path / "drive.bag"
    ros.write_ros1_bag(path, drive_messages("ros1"))
    folder, _ = importer(path, "--sampling", "all")
    missing = folder / "images" / "left" / f"{name_of(T0)}.png"
    missing.unlink()
    _, log = importer(path, "--sampling", "all")
    assert missing.exists() and "15 were already there" in log
    _, log = importer(path, "--sampling", "rate", fails=True)
    assert "of other settings" in log


def bayer(encoding):
    """One color seen through a pattern."""
    plane = {"r": 200, "g": 120, "b": 40}
    pattern = encoding[6:10]
    return numpy.array([[plane[pattern[2 * (y % 2) + x % 2]]
                         for x in range(16)] for y in range(12)], numpy.uint8)


@pytest.mark.parametrize("encoding", ("ros1", "cdr"))
def test_encodings(encoding, importer, tmp_path):
    """All encodings keep their values, whatever the padding of rows."""
    gray = RNG.integers(0, 256, (12, 16), numpy.uint8)
    deep = RNG.integers(0, 65536, (12, 16), numpy.uint16)
    color = RNG.integers(0, 256, (12, 16, 3), numpy.uint8)
    deep_color = RNG.integers(0, 65536, (12, 16, 3), numpy.uint16)
    alpha = numpy.dstack([color, gray])
    cases = {"mono8": (gray, gray), "8UC1": (gray, gray),
             "mono16": (deep, deep), "16UC1": (deep, deep),
             "bgr8": (color, color), "rgb8": (color[..., ::-1], color),
             "bgra8": (alpha, color),
             "rgba8": (alpha[..., [2, 1, 0, 3]], color),
             "bgr16": (deep_color, deep_color),
             "rgb16": (deep_color[..., ::-1], deep_color)}
    messages, expected = [], {}
    for i, (name, (sent, _)) in enumerate(cases.items()):
        messages.append(image_message(name, T0 + i, sent, encoding, name,
                                      row_padding=6,
                                      big_endian=sent.dtype == numpy.uint16))
        expected[name, T0 + i] = cases[name][1]
    path = tmp_path / "drive.mcap"
    ros.write_mcap(path, messages, encoding)
    expect_images(importer(path, "--sampling", "all")[0], expected)


def test_bayer_patterns_and_yuv(importer, tmp_path):
    messages = []
    names = [f"bayer_{p}{bits}" for p in ("rggb", "bggr", "gbrg", "grbg")
             for bits in (8, 16)]
    for i, name in enumerate(names):
        sent = bayer(name)
        if name.endswith("16"):
            sent = sent.astype(numpy.uint16) * 257
        messages.append(image_message(name, T0 + i, sent, "cdr", name))
    # Y = 81, U = 90, V = 240 is pure red in ITU-R BT.601.
    for i, (name, pair) in enumerate((("yuv422", [90, 81, 240, 81]),
                                      ("yuv422_yuy2", [81, 90, 81, 240]))):
        sent = numpy.array(pair * 8 * 12, numpy.uint8).reshape(12, 16, 2)
        messages.append(image_message(name, T0 + 20 + i, sent, "cdr", name))
    path = tmp_path / "drive.mcap"
    ros.write_mcap(path, messages)
    images = images_of(importer(path, "--sampling", "all")[0])
    for name, image in images.items():
        pixels = ros.read_png(image)
        if name.startswith("bayer"):
            scale = 257 if "16" in name.split("/")[0][-2:] else 1
            assert_allclose(pixels, numpy.broadcast_to(
                numpy.array([40, 120, 200]) * scale, pixels.shape))
        else:
            assert_allclose(pixels, numpy.broadcast_to([0, 0, 255],
                                                       pixels.shape), atol=2)
    assert len(images) == 10


def test_compressed_images_are_copied(importer, tmp_path):
    """The topic without compression is preferred if there are both."""
    size = (b"\xff\xc0\0\x11\x08" + struct.pack(">HH", 24, 32) +
            b"\3\1\x22\0\2\x11\1\3\x11\1")
    files = [b"\xff\xd8" + size + RNG.bytes(100),
             b"\x89PNG\r\n\x1a\n" + RNG.bytes(100)]
    messages = [ros.Message("/front/image_raw/compressed",
                            "sensor_msgs/CompressedImage", T0 + i,
                            ros.compressed_image("cdr", T0 + i, "front",
                                                 "jpeg", data))
                for i, data in enumerate(files)]
    path = tmp_path / "drive.mcap"
    ros.write_mcap(path, messages)
    folder, _ = importer(path, "--sampling", "all")
    for i, (data, extension) in enumerate(zip(files, ("jpg", "png"))):
        image = folder / "images" / "front" / f"{name_of(T0 + i)}.{extension}"
        assert image.read_bytes() == data

    messages.append(image_message("front", T0, PIXELS["left", 0], "cdr"))
    messages.append(ros.Message("/depth/image_raw", "sensor_msgs/Image", T0,
                                messages[-1].data))
    ros.write_mcap(path, messages)
    folder, log = importer(path, "--sampling", "all", output="both")
    expect_images(folder, {("front", T0): PIXELS["left", 0]})
    assert "left out: " in log and "/depth/image_raw" in log
    _, log = importer(path, "--image_topics",
                      "/front/image_raw/compressed,/depth/image_raw",
                      "--sampling", "all", output="chosen")
    assert {name.split("/")[0] for name in images_of(tmp_path / "chosen")} == {
        "front", "depth"}


def test_big_endian_messages(importer, tmp_path):
    messages = [image_message("left", T0, PIXELS["left", 0], "cdr")]
    messages[0].data = (b"\0\0\0\0" + ros.image(
        "cdr", T0, "left", "bgr8", PIXELS["left", 0])[4:])
    sent = ros.Serializer("cdr", big_endian=True).header(T0, "left")
    sent.add("I", 24, 32).text("bgr8").add("B", 0).add("I", 96)
    messages[0].data = sent.data(PIXELS["left", 0].tobytes()).done()
    path = tmp_path / "drive.db3"
    ros.write_db3(path, messages)
    expect_images(importer(path, "--sampling", "all")[0],
                  {("left", T0): PIXELS["left", 0]})


def test_headers_without_time(importer, tmp_path):
    """One image without a stamp is enough: two clocks do not mix."""
    messages = [image_message("left", T0 + i * STEP, PIXELS["left", i], "ros1",
                              stamp_ns=0 if i == 2 else None)
                for i in range(4)]
    path = tmp_path / "drive.bag"
    ros.write_ros1_bag(path, messages)
    folder, log = importer(path, "--sampling", "all")
    expect_images(folder, {("left", T0 + i * STEP + 5_000_000):
                           PIXELS["left", i] for i in range(4)})
    assert "/left/image_raw" in log and "1 of 4 images have no time" in log


def test_sampling_by_rate_pairs_the_nearest_images(importer, tmp_path):
    """Dropped messages, and stamps with jitter."""
    jitter = [3, -8, 5, 0, 8, -2, 7, -6]
    times = {"left": [T0 + i * STEP for i in range(8)],
             "right": [T0 + i * STEP + jitter[i] * 10**6 for i in range(8)]}
    times["right"][4] = None
    path = tmp_path / "drive.bag"
    ros.write_ros1_bag(path, drive_messages("ros1", times), "bz2")
    folder, log = importer(path, "--sampling", "rate", "--rate", "5")
    expected = {("left", times["left"][i]): PIXELS["left", i]
                for i in range(0, 8, 2)}
    expected.update({("right", times["right"][i]): PIXELS["right", i]
                     for i in (0, 2, 6)})
    expect_images(folder, expected)
    assert "frame_max_time_difference_s 0.05" in log


def test_sampling_by_motion_skips_a_standing_camera(importer, tmp_path):
    noise = RNG.normal(0, 200, (184, 404))
    scene = sum(noise[y:y + 180, x:x + 400] for y in range(5)
                for x in range(5)) / 25 + 128
    scene = scene.clip(0, 255).astype(numpy.uint8)
    shifts = [0, 0, 0, 8, 16, 24, 32, 40]
    messages = [image_message("left", T0 + i * STEP,
                              scene[:, shift:shift + 320], "cdr", "mono8")
                for i, shift in enumerate(shifts)]
    path = tmp_path / "drive.mcap"
    ros.write_mcap(path, messages, compression="zstd")
    folder, _ = importer(path)
    indices = sorted(i for i in range(8) if (
        folder / "images/left" / f"{name_of(T0 + i * STEP)}.png").exists())
    # 4 % of 320 pixels are 12.8; an image up to 1.5 times as far is taken.
    moved = [shifts[i] for i in indices]
    assert indices[0] == 0
    assert all(12.8 <= b - a <= 1.5 * 12.8 + 8
               for a, b in zip(moved, moved[1:])), indices
    assert len(indices) >= 3


@pytest.mark.parametrize("writer", ("bag_none", "bag_bz2", "bag_lz4",
                                    "mcap_none", "mcap_lz4", "mcap_zstd",
                                    "mcap_without_chunks"))
def test_recordings_cut_short(writer, importer, tmp_path):
    """Each place of the cut gives the images of all whole chunks before it."""
    extension, encoding, write = WRITERS[writer]
    path = tmp_path / f"drive{extension}"
    messages = drive_messages(encoding)
    places = write(path, messages)
    whole = path.read_bytes()
    for i, share in enumerate((0.95, 0.6, 0.35)):
        end = int(share * len(whole))
        path.write_bytes(whole[:end])
        folder, log = importer(path, "--sampling", "all", output=f"out{i}")
        assert "has no index" in log
        num_whole = max(0, sum(place < end for place in places or []) - 1)
        certain = sum("image_raw" in message.topic
                      for message in messages[:4 * num_whole])
        images = images_of(folder)
        assert len(images) >= max(certain, 1)
        expected = all_images()
        for name, image in images.items():
            camera, stem = name[:-4].split("/")
            time = int(stem.replace(".", ""))
            assert numpy.array_equal(ros.read_png(image),
                                     expected[camera, time])


@pytest.mark.parametrize("writer", ("bag_bz2", "bag_lz4", "mcap_none",
                                    "mcap_lz4", "mcap_zstd"))
def test_broken_chunks_lose_their_messages(writer, importer, tmp_path):
    extension, encoding, write = WRITERS[writer]
    path = tmp_path / f"drive{extension}"
    messages = drive_messages(encoding)
    places = write(path, messages)
    data = bytearray(path.read_bytes())
    for offset in range(200, 220):
        data[places[2] + offset] ^= 0x5a
    path.write_bytes(data)
    folder, log = importer(path, "--sampling", "all")
    assert f"the chunk at byte {places[2]} is damaged" in log
    assert str(path) in log and "image_raw" in log
    lost = {m.data for m in messages[8:12]}
    times = [m for m in messages if "image_raw" in m.topic]
    assert len(images_of(folder)) == sum(m.data not in lost for m in times)


@pytest.mark.parametrize("kind", ("bag", "mcap"))
def test_unknown_compression_is_an_error(kind, importer, tmp_path):
    path = tmp_path / f"drive.{kind}"
    write = ros.write_ros1_bag if kind == "bag" else ros.write_mcap
    encoding = "ros1" if kind == "bag" else "cdr"
    write(path, drive_messages(encoding), compression="brotli", codec=bytes)
    _, log = importer(path, fails=True)
    assert f"{path}" in log and "brotli" in log and "convert" in log


def test_errors_name_file_topic_and_remedy(importer, tmp_path):
    path = tmp_path / "drive.bag"
    ros.write_ros1_bag(path, [image_message("left", T0, PIXELS["left", 0],
                                            "ros1", "32FC1")])
    folder, log = importer(path, "--sampling", "all", fails=True)
    assert "/left/image_raw" in log and "32FC1" in log and "image_topics" in log
    assert not folder.exists()

    ros.write_ros1_bag(path, drive_messages("ros1"))
    for words, expected in (
            (("--image_topics", "/none"), "/none"),
            (("--image_topics", "/scan"), "PointCloud2"),
            (("--position_topic", "/none"), "/none")):
        _, log = importer(path, *words, fails=True, output=words[1][1:])
        assert expected in log and "drive.bag" in log

    ros.write_mcap(tmp_path / "web.mcap", drive_messages("cdr"), "protobuf")
    _, log = importer(tmp_path / "web.mcap", "--image_topics",
                      "/left/image_raw", fails=True, output="web")
    assert "protobuf" in log

    for name, content in (("empty.bag", b""), ("text.mcap", b"text"),
                          ("old.bag", b"#ROSBAG V1.2\n"),
                          ("whole.db3.zstd", ros.zstd(b"SQLite")),
                          ("short.bag", b"#ROSBAG V2.0\n\1")):
        (tmp_path / name).write_bytes(content)
        _, log = importer(tmp_path / name, fails=True)
        assert name in log and ";" in log
    _, log = importer(tmp_path / "missing.bag", fails=True)
    assert "missing.bag" in log


def test_damaged_messages_are_skipped(importer, tmp_path):
    messages = [image_message("left", T0 + i * STEP, PIXELS["left", i], "cdr")
                for i in range(4)]
    messages[1].data = messages[1].data[:10]
    messages[2].data = messages[2].data[:100]
    messages.append(ros.Message(
        "/b/compressed", "sensor_msgs/CompressedImage", T0,
        ros.compressed_image("cdr", T0, "b", "jpeg", b"")))
    messages.append(ros.Message(
        "/b/compressed", "sensor_msgs/CompressedImage", T0,
        ros.compressed_image("cdr", T0 + 1, "b", "png", SMALL_PNG)))
    path = tmp_path / "drive.mcap"
    ros.write_mcap(path, messages)
    folder, log = importer(path, "--sampling", "all")
    images = images_of(folder)
    assert images.pop(f"b/{name_of(T0 + 1)}.png").read_bytes() == SMALL_PNG
    assert set(images) == {f"left/{name_of(T0 + i * STEP)}.png"
                           for i in (0, 3)}
    assert "/left/image_raw" in log and "damaged message" in log


def test_databases_cut_short_or_unclosed(importer, tmp_path):
    path = tmp_path / "drive.db3"
    ros.write_db3(path, drive_messages("cdr"))
    whole = path.read_bytes()
    path.write_bytes(whole[:len(whole) // 2])
    _, log = importer(path, fails=True)
    assert str(path) in log and ".recover" in log
    path.write_bytes(whole)
    database = sqlite3.connect(path)
    database.execute("PRAGMA journal_mode = WAL")
    database.execute("UPDATE topics SET name = '/a' WHERE id = 1")
    database.commit()
    _, log = importer(path, fails=True)
    assert f"{path}-wal" in log and "wal_checkpoint" in log
    database.close()


def test_lenses(importer, tmp_path):
    """Fisheye, rational, rectified, reduced and missing calibrations."""
    P = [300, 0, 14, -60, 0, 310, 10, 0, 0, 0, 1, 0]
    fisheye, rational = [0.1, 0.2, 0.3, 0.4], [1, 2, 3, 4, 5, 6, 7, 8]
    wide_K = [800.0, 0, 31.5, 0, 820.0, 23.5, 0, 0, 1]
    cases = {
        "a/image_raw": dict(model="equidistant", distortion=fisheye, K=K),
        "b/image_raw": dict(model="rational_polynomial", distortion=rational,
                            K=K),
        "c/image_rect": dict(model="plumb_bob", distortion=D, K=K, P=P),
        "d/image_raw": dict(model="plumb_bob", distortion=[0.0] * 5, K=wide_K,
                            size=(64, 48), binning=(2, 2)),
        "e/image_raw": dict(model="plumb_bob", distortion=D, K=[0.0] * 9),
        "f/image_raw": dict(model="plumb_bob", distortion=D, K=K,
                            size=(64, 48)),
    }
    messages = []
    for name, values in cases.items():
        topic = "/" + name
        messages.append(ros.Message(
            topic.rsplit("/", 1)[0] + "/camera_info", "sensor_msgs/CameraInfo",
            T0, ros.camera_info("ros1", topic, **{"size": (32, 24), **values})))
        messages.append(ros.Message(
            topic, "sensor_msgs/Image", T0,
            ros.image("ros1", T0, topic, "bgr8", PIXELS["left", 0])))
    path = tmp_path / "drive.bag"
    ros.write_ros1_bag(path, messages)
    folder, log = importer(path, "--sampling", "all")
    cameras = {camera["image_prefix"][0]: (camera.get("camera_model_name"),
                                           camera.get("camera_params"))
               for camera in json.loads(
                   (folder / "rig_config.json").read_text())[0]["cameras"]}
    start = [400, 410, 16, 12]
    assert cameras["a"] == ("OPENCV_FISHEYE", start + fisheye)
    assert cameras["b"] == ("FULL_OPENCV", start + rational)
    assert cameras["c"] == ("PINHOLE", [300, 310, 14.5, 10.5])
    # The corner of the first pixel stays where it is.
    assert cameras["d"] == ("PINHOLE", [400, 410, 16, 12])
    assert cameras["e"] == cameras["f"] == (None, None)
    assert "'/e/camera_info' has no calibration" in log
    assert "64 x 48" in log and "32 x 24" in log


def test_the_first_camera_is_the_reference(importer, tmp_path):
    """Gravity has its axes, also if others have more images, and nothing else
    is known of the cameras."""
    messages = [m for m in imu_messages("ros1", 0.0)
                if "right" not in m.topic and "camera_info" not in m.topic]
    messages += [image_message("front", T0 + i * STEP // 2,
                               PIXELS["right", i % 8], "ros1")
                 for i in range(16)]
    path = tmp_path / "drive.bag"
    ros.write_ros1_bag(path, messages)
    folder, log = importer(path, "--sampling", "all", "--image_topics",
                           "/left/image_raw,/front/image_raw")
    assert (folder / "gravity.txt").exists(), log
    assert json.loads((folder / "rig_config.json").read_text()) == [
        {"cameras": [{"image_prefix": "left/", "ref_sensor": True},
                     {"image_prefix": "front/"}]}]


def test_rectification_that_is_no_rotation(importer, tmp_path):
    """Poses and gravity of rectified images need it, those of an IMU do not."""
    messages = imu_messages("ros1", 0.0)
    P = [*K[:3], 0.0, *K[3:6], 0.0, *K[6:], 0.0]
    for message in messages:
        message.topic = message.topic.replace("image_raw", "image_rect")
        if message.topic == "/left/camera_info":
            message.data = ros.camera_info(
                "ros1", "left_optical", (32, 24), "plumb_bob", D, K,
                R=[2.0, 0, 0, 0, 1, 0, 0, 0, 1], P=P)
    path = tmp_path / "drive.bag"
    ros.write_ros1_bag(path, messages)
    words = ("--sampling", "all", "--imu_topic", "/imu")
    folder, log = importer(path, *words)
    warnings = [line for line in log.splitlines() if "no rotation" in line]
    assert len(warnings) == 2, log
    assert "'left'" in warnings[0] and "pose of 'right'" in warnings[0]
    assert "/left/camera_info" in warnings[1]
    assert "gravity_axes to imu" in warnings[1]
    assert not (folder / "gravity.txt").exists()
    left, right = json.loads(
        (folder / "rig_config.json").read_text())[0]["cameras"]
    assert "camera_params" in left
    assert "cam_from_rig_rotation" not in right
    folder, log = importer(path, *words, "--gravity_axes", "imu", output="imu")
    assert (folder / "gravity.txt").exists(), log


def test_positions(importer, tmp_path):
    """GPS as it is; odometry at the first camera."""
    messages = drive_messages("cdr")
    for i in range(4):
        messages.append(ros.Message(
            "/fix", "sensor_msgs/NavSatFix", T0 + i, ros.nav_sat_fix(
                "cdr", T0 + i * STEP, (49.0, 8.4 + 1e-5 * i, 110.5),
                status=-1 if i == 2 else 0)))
        messages.append(ros.Message(
            "/odom", "nav_msgs/Odometry", T0 + i, ros.odometry(
                "cdr", T0 + i * STEP, "base", (1.0 * i, 0, 0),
                (0, 0, 1, 0))))
    path = tmp_path / "drive.mcap"
    ros.write_mcap(path, messages)
    folder, _ = importer(path, "--sampling", "all")
    read = numpy.loadtxt(folder / "positions.txt")
    assert_allclose(read[:, 0], [1.7e9, 1.7e9 + 0.1, 1.7e9 + 0.3], atol=1e-6)
    assert_allclose(read[:, 1:4], [[49, 8.4 + 1e-5 * i, 110.5]
                                   for i in (0, 1, 3)], atol=1e-9)
    folder, _ = importer(path, "--sampling", "all", "--position_topic",
                         "/odom", output="odometry")
    read = numpy.loadtxt(folder / "positions.txt")
    # The body is turned by 180 degrees; the camera is 0.3 m to its left.
    assert_allclose(read[:, 1:4], [[i, -0.3, 0] for i in range(4)], atol=1e-9)
    folder, _ = importer(path, "--sampling", "all", "--position_topic",
                         "none", output="none")
    assert not (folder / "positions.txt").exists()


def odom_in_map(seconds):
    """Drifts at constant velocity, so that it is linear between transforms."""
    return numpy.array([0.5, -0.25, 0.125]) * seconds


def body_in_odom(seconds):
    """On a circle, looking along it: position, and rotation about z."""
    return (numpy.array([5 * numpy.sin(seconds), -5 * numpy.cos(seconds), 0]),
            seconds)


def tf_messages(encoding, parent="map"):
    """odom in the map at 2 Hz from 0.2 s on, the body in odom at 20 Hz."""
    messages = drive_messages(encoding)
    for i in range(17):
        seconds = 0.05 * i
        position, angle = body_in_odom(seconds)
        items = [("/odom", "base", position,
                  (0, 0, numpy.sin(angle / 2), numpy.cos(angle / 2)))]
        time_ns = T0 + i * STEP // 2
        if i in (4, 14):
            items.append((parent, "odom", odom_in_map(seconds), (0, 0, 0, 1)))
        messages.append(ros.Message("/tf", "tf2_msgs/TFMessage", time_ns,
                                    ros.transforms(encoding, items, time_ns)))
    return messages


def camera_in_odom(seconds):
    """The left camera is 0.3 m along y of the body."""
    position, angle = body_in_odom(seconds)
    return position + 0.3 * numpy.array([-numpy.sin(angle), numpy.cos(angle),
                                         0])


@pytest.mark.parametrize("encoding", ("ros1", "cdr"))
def test_positions_of_tf(encoding, importer, tmp_path):
    """The chain from the map to the first camera, at the times of the body."""
    path = tmp_path / ("drive.bag" if encoding == "ros1" else "drive.mcap")
    write = ros.write_ros1_bag if encoding == "ros1" else ros.write_mcap
    write(path, tf_messages(encoding))
    words = ("--sampling", "all", "--position_topic", "/tf")
    for name, more, in_map, first, last in (
            ("map", (), True, 4, 14), ("base", ("--body_frame", "base"), True,
                                       4, 14),
            ("odom", ("--world_frame", "odom"), False, 0, 16)):
        folder, log = importer(path, *words, *more, output=name)
        assert "WARN" not in log.upper(), log
        assert f"ref_images_path {folder / 'positions.txt'}" in log
        read = numpy.loadtxt(folder / "positions.txt")
        seconds = 0.05 * numpy.arange(first, last + 1)
        assert_allclose(read[:, 0] - T0 / 1e9, seconds, atol=1e-6)
        expected = [camera_in_odom(s) + in_map * odom_in_map(s)
                    for s in seconds]
        # Times in double precision are accurate to 0.2 us.
        assert_allclose(read[:, 1:4], expected, atol=1e-6)

    # Older bags have another name of the type, and drivers write NaN.
    messages = [message for message in tf_messages(encoding)
                if message.topic != "/tf_static"] + [
        ros.Message(topic, "tf/tfMessage", T0, ros.transforms(encoding, items))
        for topic, items in (
            ("/tf_static", [("base", "left_optical", (0, 0.3, 0),
                             (0, 0, 0, 1))]),
            ("/tf2", [("odom", "base", (numpy.nan, 0, 0), (0, 0, 0, 1)),
                      ("odom", "base", (0, 1, 0), (0, 0, 0, 1))]))]
    other = tmp_path / f"other{path.suffix}"
    write(other, messages)
    folder, log = importer(other, "--sampling", "all", "--position_topic",
                           "/tf2", output="older")
    assert "damaged" not in log
    assert_allclose(numpy.loadtxt(folder / "positions.txt")[1:4], (0, 1.3, 0))

    # Above a frame that nothing fixes to the camera, positions are its own.
    folder, log = importer(path, *words, "--body_frame", "odom", output="other")
    assert "does not connect the frame 'odom'" in log
    read = numpy.loadtxt(folder / "positions.txt")
    assert_allclose(read[:, 1:4], [odom_in_map(s) for s in (0.2, 0.7)],
                    atol=1e-9)


def test_tf_that_does_not_tell_is_an_error(importer, tmp_path):
    path = tmp_path / "drive.bag"
    ros.write_ros1_bag(path, tf_messages("ros1"))
    topic = ("--position_topic", "/tf")
    cases = [(path, (*topic, "--body_frame", "imu"), ("'imu'", "base, map")),
             (path, (*topic, "--world_frame", "utm"), ("'utm'", "base, map")),
             (path, ("--world_frame", "map"), ("position_topic to",)),
             (path, ("--position_topic", "/tf_static"), ("'/tf_static'",
                                                         "position_topic"))]
    two = tmp_path / "two.bag"
    ros.write_ros1_bag(two, tf_messages("ros1") + [
        message for message in tf_messages("ros1", "utm")
        if message.topic == "/tf"])
    cases.append((two, topic, ("'map'", "'utm'")))
    cycle = tmp_path / "cycle.bag"
    ros.write_ros1_bag(cycle, tf_messages("ros1", "base"))
    cases.append((cycle, topic, ("cycle",)))
    apart = tmp_path / "apart.bag"
    ros.write_ros1_bag(apart, drive_messages("ros1") + [
        ros.Message("/tf", "tf2_msgs/TFMessage", T0, ros.transforms(
            "ros1", [(parent, child, (0, 0, 0), (0, 0, 0, 1))], T0 + time_ns))
        for parent, child, time_ns in (("map", "odom", 0),
                                       ("odom", "base", 1000))])
    cases.append((apart, topic, ("above 'base'", "world_frame")))
    dark = tmp_path / "dark.bag"
    ros.write_ros1_bag(dark, [m for m in tf_messages("ros1")
                              if "image_raw" not in m.topic] + [
        ros.Message("/left/image_raw", "sensor_msgs/Image", T0, b"short")])
    cases.append((dark, topic, ("no image that can be read",)))
    for i, (file, words, expected) in enumerate(cases):
        folder, log = importer(file, "--sampling", "all", *words, fails=True,
                               output=f"out{i}")
        assert not folder.exists()
        lines = [line for line in log.splitlines() if line.strip()]
        assert len(lines) == 1 and file.name in log, log
        for text in expected:
            assert text in log, log


def rotation_of(vector):
    """The rotation by an angle-axis vector."""
    angle = numpy.linalg.norm(vector)
    x, y, z = vector / max(angle, 1e-300)
    cross = numpy.array([[0, -z, y], [z, 0, -x], [-y, x, 0]])
    return (numpy.eye(3) + numpy.sin(angle) * cross +
            (1 - numpy.cos(angle)) * cross @ cross)


def quaternion_of(vector):
    """x, y, z, w of the same."""
    half = numpy.linalg.norm(vector) / 2
    return (*(vector * (numpy.sinc(half / numpy.pi) / 2)), numpy.cos(half))


# An IMU that turns steadily, and its mounting in the frame of the camera.
TURN = numpy.array([0.5, -1.1, 0.7])  # rad/s
MOUNT = numpy.array([1.2, 0.4, -0.3])


def gravity_of(seconds):
    return -(rotation_of(MOUNT) @ rotation_of(TURN * seconds).T)[:, 2]


def imu_messages(encoding, noise, orientation=None, is_mounted=True,
                 gravity=9.81, change=lambda i, force: force,
                 phase=lambda i: 0.01 * i):
    """At 100 Hz from 1 s before the first image to 1.5 s after it. At the
    phase of a message, steady turns would be in its attitude; None loses it."""
    messages = drive_messages(encoding)
    if is_mounted:
        messages[0].data = ros.transforms(encoding, [
            ("base", "left_optical", (0, 0.3, 0), (0, 0, 0, 1)),
            ("left_optical", "imu", (1, 2, 3), quaternion_of(MOUNT)),
            ("base", "right_optical", (0, 0, 0), (0, 0, 0, 1))])
    rng = numpy.random.default_rng(1)
    for i in range(-100, 150):
        seconds = phase(i)
        if seconds is None:
            continue
        force = change(i, [0, 0, gravity] + rng.normal(0, noise, 3))
        time_ns = T0 + i * STEP // 10
        messages.append(ros.Message("/imu", "sensor_msgs/Imu", time_ns, ros.imu(
            encoding, time_ns, "imu", orientation and orientation(seconds),
            TURN, rotation_of(TURN * seconds).T @ force)))
    return messages


def angles_deg(read):
    expected = [gravity_of(0.1 * i) for i in range(8)]
    return numpy.degrees(numpy.arccos(numpy.clip(
        (read[:, 1:] * expected).sum(axis=1), -1, 1)))


@pytest.mark.parametrize("encoding", ("ros1", "cdr"))
def test_gravity_by_acceleration(encoding, importer, tmp_path):
    """The error is that of the mean, and the stated one."""
    path = tmp_path / ("drive.bag" if encoding == "ros1" else "drive.mcap")
    write = ros.write_ros1_bag if encoding == "ros1" else ros.write_mcap
    words = ("--sampling", "all", "--gravity_window_s", "0.4")
    for noise in (0.0, 2.0):
        write(path, imu_messages(encoding, noise))
        folder, log = importer(path, *words, output=f"out{noise}")
        assert "WARN" not in log.upper(), log
        assert f"gravity_path {folder / 'gravity.txt'}" in log
        read = numpy.loadtxt(folder / "gravity.txt")
        assert_allclose(read[:, 0] - T0 / 1e9, 0.1 * numpy.arange(8), atol=1e-6)
        expected_deg = numpy.degrees(noise / 9.81 / numpy.sqrt(41))
        assert angles_deg(read).max() < 3.5 * expected_deg + 0.01
        stated_deg = float(log.split("standard deviation ")[1].split()[0])
        assert abs(stated_deg - expected_deg) < 0.5 * expected_deg + 0.01


def test_means_end_at_gaps(importer, tmp_path):
    """Nothing measures the turns in gaps of ten intervals, nor gives a message
    that is alone in one a mean."""
    def phase(i):
        lost = 22 < i < 58 and i != 40
        return None if lost else 0.01 * i + (2 if i > 40 else 0)

    path = tmp_path / "drive.bag"
    ros.write_ros1_bag(path, imu_messages("ros1", 0.0, phase=phase))
    folder, _ = importer(path, "--sampling", "all", "--gravity_window_s", "1")
    read = numpy.loadtxt(folder / "gravity.txt")
    images = [0, 1, 2, 6, 7]
    assert_allclose(read[:, 0] - T0 / 1e9, 0.1 * numpy.array(images), atol=1e-6)
    expected = [gravity_of(phase(10 * i)) for i in images]
    assert_allclose(read[:, 1:], expected, atol=1e-4)


def half_turn(x, y, z, w):
    """The product of the quaternion (1, 0, 0, 0) and this one."""
    return (w, -z, y, -x)


def test_gravity_by_orientation(importer, tmp_path):
    """Unless it contradicts the acceleration, or is one for all times."""
    cases = (("right", lambda s: quaternion_of(TURN * s), "orientation in", 0.1),
             ("one", lambda s: (0, 0, 0, 1), "mean acceleration", 8),
             ("down", lambda s: half_turn(*quaternion_of(TURN * s)),
              "mean acceleration", 8))
    for name, orientation, expected, tolerance_deg in cases:
        path = tmp_path / f"{name}.bag"
        ros.write_ros1_bag(path, imu_messages("ros1", 2.0, orientation))
        folder, log = importer(path, "--sampling", "all", "--gravity_window_s",
                               "0.4", output=name)
        assert expected in log, log
        read = numpy.loadtxt(folder / "gravity.txt")
        assert angles_deg(read).max() < tolerance_deg


def test_single_messages_do_not_count(importer, tmp_path):
    """Without a quantity, or with numbers that no sensor measures."""
    def orientation(seconds):
        return ((0, 0, 0, 0) if seconds < -0.95 else
                quaternion_of(TURN * seconds))

    for value in (numpy.nan, 1e18, 1e300):
        def change(i, force):
            return [value] * 3 if i == -20 else force
        for name, turned in (("mean", None), ("orientation", orientation)):
            path = tmp_path / "drive.bag"
            ros.write_ros1_bag(path, imu_messages("ros1", 0.0, turned,
                                                  change=change))
            folder, log = importer(path, "--sampling", "all",
                                   "--gravity_window_s", "0.4",
                                   output=f"{name}{value}")
            assert f"by the {name}" in log
            read = numpy.loadtxt(folder / "gravity.txt")
            assert angles_deg(read).max() < 0.01


def test_acceleration_without_gravity(importer, tmp_path):
    """Only the orientation tells. A large deviation causes a warning."""
    path = tmp_path / "drive.bag"
    words = ("--sampling", "all", "--gravity_window_s", "0.4")
    ros.write_ros1_bag(path, imu_messages(
        "ros1", 0.3, lambda s: quaternion_of(TURN * s), gravity=0))
    folder, log = importer(path, *words)
    assert "by the orientation in /imu, unknown standard deviation" in log
    assert "WARN" not in log.upper()
    assert angles_deg(numpy.loadtxt(folder / "gravity.txt")).max() < 0.1
    ros.write_ros1_bag(path, imu_messages("ros1", 0.3, gravity=0))
    folder, log = importer(path, *words, output="none")
    assert not (folder / "gravity.txt").exists()
    assert "instead of 9.81 m/s^2; set imu_topic" in log
    ros.write_ros1_bag(path, imu_messages(
        "ros1", 0.3, change=lambda i, force: force + [3 * (i // 40 % 2), 0, 0]))
    _, log = importer(path, *words, output="noisy")
    assert "deviation of more than 5 deg; change gravity_window_s" in log


def test_gravity_of_a_second_run(importer, tmp_path):
    """Its options do not invalidate images, and no old file remains."""
    path = tmp_path / "drive.bag"
    ros.write_ros1_bag(path, imu_messages("ros1", 0.0))
    words = ("--sampling", "all")
    folder, log = importer(path, *words)
    assert "--body_calibration" not in log
    text = (folder / "gravity.txt").read_text()
    assert text.startswith("# SECONDS GX GY GZ in the axes of the camera 'left'")
    _, log = importer(path, *words, "--gravity_axes", "imu")
    assert "16 were already there" in log and "--body_calibration FILE" in log
    text = (folder / "gravity.txt").read_text()
    assert "in the axes of the frame 'imu'" in text
    importer(path, *words, "--imu_topic", "none")
    assert not (folder / "gravity.txt").exists()


def test_memory_of_imu_messages(request, tmp_path):
    """At most what docs/guides/recordings.md states: 0.6 kB for each."""
    num = 40_000
    imu = ros.imu("ros1", 0, "imu", (0, 0, 0, 1), TURN, [0, 0, 9.81])
    messages = imu_messages("ros1", 0.0)[:30]
    for i in range(num):
        time_ns = T0 + (i - num // 2) * STEP // 40
        data = imu[:4] + ros.bag_time(time_ns) + imu[12:]
        messages.append(ros.Message("/imu", "sensor_msgs/Imu", time_ns, data))
    path = tmp_path / "drive.bag"
    ros.write_ros1_bag(path, messages, chunk_size=500)
    # A small process between, as its peak counts for its children.
    code = ("import os, subprocess, sys; process = subprocess.Popen(sys.argv["
            "1:]); print(os.wait4(process.pid, 0)[2].ru_maxrss)")

    def peak_bytes(topic):
        done = subprocess.run(
            list(map(str, [
                sys.executable, "-c", code,
                request.config.getoption("--program").resolve(),
                "recording_importer", "--recording_path", path,
                "--output_path", tmp_path / topic[-3:], "--sampling", "all",
                "--imu_topic", topic])),
            capture_output=True, text=True, check=True)
        return 1024 * int(done.stdout)

    assert peak_bytes("/imu") - peak_bytes("none") < 600 * num


def test_axes_of_gravity(importer, tmp_path):
    """Without tf, only those of the IMU are known."""
    path = tmp_path / "drive.bag"
    ros.write_ros1_bag(path, imu_messages("ros1", 0.0, is_mounted=False))
    words = ("--sampling", "all")
    folder, log = importer(path, *words)
    assert not (folder / "gravity.txt").exists()
    assert "'imu'" in log and "'left_optical'" in log and "/imu" in log
    assert "gravity_axes" in log and "body_calibration" in log
    assert "WARN" not in log.upper(), log
    _, log = importer(path, *words, "--imu_topic", "/imu", output="named")
    assert "WARN" in log.upper()
    folder, log = importer(path, *words, "--gravity_axes", "imu", output="imu")
    assert "WARN" not in log.upper(), log
    read = numpy.loadtxt(folder / "gravity.txt")
    read[:, 1:] = read[:, 1:] @ rotation_of(MOUNT).T
    assert angles_deg(read).max() < 0.01
    folder, log = importer(path, *words, "--imu_topic", "none", output="none")
    assert "WARN" not in log.upper(), log
