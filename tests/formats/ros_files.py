# SPDX-License-Identifier: BSD-3-Clause
"""Recordings of ROS, written from the definitions of their formats:
https://wiki.ros.org/Bags/Format/2.0, https://mcap.dev/spec, the schema of
rosbag2_storage_sqlite3, and the messages of sensor_msgs, nav_msgs and
tf2_msgs."""
import bz2
import ctypes
import dataclasses
import sqlite3
import struct
import zlib

import numpy


# ------------------------------------------------------------------ compression
def lz4(data):
    library = ctypes.CDLL("liblz4.so.1")
    library.LZ4F_compressFrameBound.restype = ctypes.c_size_t
    library.LZ4F_compressFrame.restype = ctypes.c_size_t
    bound = library.LZ4F_compressFrameBound(ctypes.c_size_t(len(data)), None)
    output = ctypes.create_string_buffer(bound)
    size = library.LZ4F_compressFrame(output, ctypes.c_size_t(bound), data,
                                      ctypes.c_size_t(len(data)), None)
    return output.raw[:size]


def zstd(data):
    library = ctypes.CDLL("libzstd.so.1")
    library.ZSTD_compressBound.restype = ctypes.c_size_t
    library.ZSTD_compress.restype = ctypes.c_size_t
    bound = library.ZSTD_compressBound(ctypes.c_size_t(len(data)))
    output = ctypes.create_string_buffer(bound)
    size = library.ZSTD_compress(output, ctypes.c_size_t(bound), data,
                                 ctypes.c_size_t(len(data)), 3)
    return output.raw[:size]


CODECS = {"": bytes, "none": bytes, "bz2": bz2.compress, "lz4": lz4,
          "zstd": zstd}


# --------------------------------------------------------------------- messages
class Serializer:
    """Values of a message in ROS 1's format or CDR (little or big endian)."""

    def __init__(self, encoding, big_endian=False):
        self.is_cdr = encoding == "cdr"
        self.order = ">" if big_endian else "<"
        self.bytes = b""

    def add(self, kind, *values):
        size = struct.calcsize(kind)
        for value in values:
            if self.is_cdr:
                self.bytes += bytes(-len(self.bytes) % size)
            self.bytes += struct.pack(self.order + kind, value)
        return self

    def data(self, data):
        self.add("I", len(data)).bytes += data
        return self

    def text(self, text):
        return self.data(text.encode() + (b"\0" if self.is_cdr else b""))

    def header(self, time_ns, frame):
        if not self.is_cdr:
            self.add("I", 0)
        self.add("I", time_ns // 10**9, time_ns % 10**9)
        return self.text(frame)

    def done(self):
        if not self.is_cdr:
            return self.bytes
        return bytes([0, self.order == "<", 0, 0]) + self.bytes


def image(encoding, time_ns, frame, name, pixels, row_padding=0,
          big_endian=False, **kwargs):
    """`pixels` are the rows as the camera sends them."""
    rows = pixels.reshape(len(pixels), -1)
    if rows.dtype == numpy.uint16:
        rows = rows.astype(">u2" if big_endian else "<u2")
    height, width = pixels.shape[:2]
    data = b"".join(row.tobytes() + bytes(row_padding) for row in rows)
    message = Serializer(encoding, **kwargs).header(time_ns, frame)
    message.add("I", height, width).text(name).add("B", big_endian)
    return message.add("I", len(data) // height).data(data).done()


def compressed_image(encoding, time_ns, frame, kind, data):
    return Serializer(encoding).header(time_ns, frame).text(kind).data(
        data).done()


def camera_info(encoding, frame, size, model, distortion, K, R=None, P=None,
                binning=(0, 0), crop=(0, 0, 0, 0)):
    message = Serializer(encoding).header(0, frame)
    message.add("I", size[1], size[0]).text(model)
    message.add("I", len(distortion)).add("d", *distortion)
    message.add("d", *K, *(R or [1, 0, 0, 0, 1, 0, 0, 0, 1]))
    message.add("d", *(P or [0] * 12)).add("I", *binning, *crop)
    return message.add("B", 0).done()


def transforms(encoding, items, time_ns=0):
    """Items are (parent, child, translation, quaternion x y z w)."""
    message = Serializer(encoding).add("I", len(items))
    for parent, child, translation, quaternion in items:
        message.header(time_ns, parent).text(child)
        message.add("d", *translation, *quaternion)
    return message.done()


def nav_sat_fix(encoding, time_ns, position, status=0):
    message = Serializer(encoding).header(time_ns, "gps")
    message.add("b", status).add("H", 1).add("d", *position)
    return message.add("d", *[0] * 9).add("B", 0).done()


def odometry(encoding, time_ns, child, position, quaternion):
    message = Serializer(encoding).header(time_ns, "odom").text(child)
    message.add("d", *position, *quaternion).add("d", *[0] * 36)
    return message.add("d", *[0] * 42).done()


def imu(encoding, time_ns, frame, orientation, angular_velocity, acceleration):
    """A measurement that is None has the covariance -1."""
    message = Serializer(encoding).header(time_ns, frame)
    for value, size in ((orientation, 4), (angular_velocity, 3),
                        (acceleration, 3)):
        message.add("d", *([0.0] * size if value is None else value))
        message.add("d", -1.0 if value is None else 0.0, *[0.0] * 8)
    return message.done()


@dataclasses.dataclass
class Message:
    topic: str
    type: str  # "sensor_msgs/Image"
    time_ns: int  # of the recorder
    data: bytes

    def ros2_type(self):
        return self.type.replace("/", "/msg/")


def split(items, size):
    return [items[i:i + size] for i in range(0, len(items), size)]


def topics_of(messages):
    return list(dict.fromkeys((m.topic, m.type) for m in messages))


# ------------------------------------------------------------------------ ROS 1
def bag_record(fields, data):
    header = b"".join(
        struct.pack("<I", len(name) + 1 + len(value)) + name.encode() + b"=" +
        value for name, value in fields.items())
    return (struct.pack("<I", len(header)) + header +
            struct.pack("<I", len(data)) + data)


def bag_time(time_ns):
    return struct.pack("<II", time_ns // 10**9, time_ns % 10**9)


def bag_connection(number, topic, kind):
    fields = {"topic": topic, "type": kind, "md5sum": "*",
              "message_definition": ""}
    data = b"".join(
        struct.pack("<I", len(name) + 1 + len(value)) +
        f"{name}={value}".encode() for name, value in fields.items())
    return bag_record({"op": b"\7", "conn": struct.pack("<I", number),
                       "topic": topic.encode()}, data)


def write_ros1_bag(path, messages, compression="none", chunk_size=4,
                   codec=None, header_size=4096):
    """Returns the place of each chunk."""
    topics = topics_of(messages)
    head = b"#ROSBAG V2.0\n"
    body, infos, places, known = b"", b"", [], set()
    for chunk in split(messages, chunk_size):
        content, index = b"", {}
        for message in chunk:
            number = topics.index((message.topic, message.type))
            if number not in known:
                content += bag_connection(number, *topics[number])
                known.add(number)
            index.setdefault(number, []).append(
                (message.time_ns, len(content)))
            content += bag_record({"op": b"\2",
                                   "conn": struct.pack("<I", number),
                                   "time": bag_time(message.time_ns)},
                                  message.data)
        place = len(head) + header_size + len(body)
        places.append(place)
        body += bag_record({"op": b"\5", "compression": compression.encode(),
                            "size": struct.pack("<I", len(content))},
                           (codec or CODECS[compression])(content))
        for number, entries in index.items():
            body += bag_record(
                {"op": b"\4", "ver": struct.pack("<I", 1),
                 "conn": struct.pack("<I", number),
                 "count": struct.pack("<I", len(entries))},
                b"".join(bag_time(time) + struct.pack("<I", offset)
                         for time, offset in entries))
        times = [message.time_ns for message in chunk]
        infos += bag_record(
            {"op": b"\6", "ver": struct.pack("<I", 1),
             "chunk_pos": struct.pack("<Q", place),
             "start_time": bag_time(min(times)),
             "end_time": bag_time(max(times)),
             "count": struct.pack("<I", len(index))},
            b"".join(struct.pack("<II", number, len(entries))
                     for number, entries in index.items()))
    fields = {"op": b"\3",
              "index_pos": struct.pack("<Q", len(head) + header_size +
                                       len(body)),
              "conn_count": struct.pack("<I", len(topics)),
              "chunk_count": struct.pack("<I", len(places))}
    padding = header_size - len(bag_record(fields, b""))
    connections = b"".join(bag_connection(i, *topic)
                           for i, topic in enumerate(topics))
    path.write_bytes(head + bag_record(fields, b" " * padding) + body +
                     connections + infos)
    return places


# ------------------------------------------------------------------------- MCAP
def mcap_record(kind, content):
    return struct.pack("<BQ", kind, len(content)) + content


def mcap_text(text):
    return struct.pack("<I", len(text)) + text.encode()


def write_mcap(path, messages, encoding="cdr", compression="", chunk_size=4,
               codec=None):
    """Without chunks if chunk_size is 0. Returns the place of each chunk."""
    topics = topics_of(messages)
    names = {t: t[1].replace("/", "/msg/") if encoding == "cdr" else t[1]
             for t in topics}
    magic = b"\x89MCAP0\r\n"
    schema_encoding = "ros2msg" if encoding == "cdr" else "ros1msg"
    definitions = b"".join(
        mcap_record(3, struct.pack("<H", i + 1) + mcap_text(names[topic]) +
                    mcap_text(schema_encoding) + struct.pack("<I", 0)) +
        mcap_record(4, struct.pack("<HH", i, i + 1) + mcap_text(topic[0]) +
                    mcap_text(encoding) + struct.pack("<I", 0))
        for i, topic in enumerate(topics))
    data = magic + mcap_record(1, mcap_text("ros2") + mcap_text("test"))
    indices, places, counts, is_defined = b"", [], {}, False
    for chunk in split(messages, chunk_size or 1):
        content, channels = b"" if is_defined else definitions, {}
        is_defined = True
        for message in chunk:
            channel = topics.index((message.topic, message.type))
            channels.setdefault(channel, []).append(
                (message.time_ns, len(content)))
            counts[channel] = counts.get(channel, 0) + 1
            content += mcap_record(
                5, struct.pack("<HIQQ", channel, 0, message.time_ns,
                               message.time_ns) + message.data)
        if chunk_size == 0:
            data += content
            continue
        places.append(len(data))
        times = [message.time_ns for message in chunk]
        stored = (codec or CODECS[compression])(content)
        record = mcap_record(
            6, struct.pack("<QQQI", min(times), max(times), len(content),
                           zlib.crc32(content)) + mcap_text(compression) +
            struct.pack("<Q", len(stored)) + stored)
        data += record
        offsets = b""
        for channel, entries in channels.items():
            offsets += struct.pack("<HQ", channel, len(data))
            array = b"".join(struct.pack("<QQ", *entry) for entry in entries)
            data += mcap_record(7, struct.pack("<HI", channel, len(array)) +
                                array)
        indices += mcap_record(
            8, struct.pack("<QQQQI", min(times), max(times), places[-1],
                           len(record), len(offsets)) + offsets +
            struct.pack("<Q", len(data) - places[-1] - len(record)) +
            mcap_text(compression) +
            struct.pack("<QQ", len(stored), len(content)))
    data += mcap_record(15, struct.pack("<I", 0))
    counted = b"".join(struct.pack("<HQ", *item) for item in counts.items())
    times = [message.time_ns for message in messages]
    summary = definitions + indices + mcap_record(
        11, struct.pack("<QHIIIIQQI", len(messages), len(topics), len(topics),
                        0, 0, len(places), min(times), max(times),
                        len(counted)) + counted)
    path.write_bytes(data + summary + mcap_record(
        2, struct.pack("<QQI", len(data), 0, 0)) + magic)
    return places


# ------------------------------------------------------------------------- db3
def write_db3(path, messages, compression="", page_size=4096):
    """As rosbag2, with single messages compressed."""
    topics = topics_of(messages)
    database = sqlite3.connect(path)
    database.execute(f"PRAGMA page_size = {page_size}")
    database.executescript(
        "CREATE TABLE topics(id INTEGER PRIMARY KEY, name TEXT NOT NULL, type "
        "TEXT NOT NULL, serialization_format TEXT NOT NULL, "
        "offered_qos_profiles TEXT NOT NULL); CREATE TABLE messages(id INTEGER "
        "PRIMARY KEY, topic_id INTEGER NOT NULL, timestamp INTEGER NOT NULL, "
        "data BLOB NOT NULL); CREATE INDEX timestamp_idx ON messages "
        "(timestamp ASC);")
    for i, (topic, kind) in enumerate(topics):
        database.execute("INSERT INTO topics VALUES (?, ?, ?, 'cdr', '')",
                         (i + 1, topic, kind.replace("/", "/msg/")))
    for message in messages:
        number = topics.index((message.topic, message.type)) + 1
        database.execute(
            "INSERT INTO messages(topic_id, timestamp, data) VALUES (?, ?, ?)",
            (number, message.time_ns, CODECS[compression](message.data)))
    database.commit()
    database.close()


# ------------------------------------------------------------------------- PNG
def read_png(path):
    """An image without palette and interlacing; BGR if it has colors."""
    data = path.read_bytes()
    assert data[:8] == b"\x89PNG\r\n\x1a\n"
    position, packed = 8, b""
    while position < len(data):
        size, kind = struct.unpack(">I4s", data[position:position + 8])
        content = data[position + 8:position + 8 + size]
        if kind == b"IHDR":
            width, height, depth, color = struct.unpack(">IIBB", content[:10])
        if kind == b"IDAT":
            packed += content
        position += size + 12
    step = {0: 1, 2: 3}[color] * depth // 8
    stride = width * step
    raw = zlib.decompress(packed)
    above = [0] * (stride + step)
    rows = []
    for y in range(height):
        line = raw[y * (stride + 1):(y + 1) * (stride + 1)]
        row = [0] * (stride + step)
        for i, value in enumerate(line[1:], step):
            a, b, c = row[i - step], above[i], above[i - step]
            near = min((abs(b - c), 0, a), (abs(a - c), 1, b),
                       (abs(a + b - 2 * c), 2, c))[2]
            row[i] = (value + (0, a, b, (a + b) // 2, near)[line[0]]) % 256
        rows.append(row[step:])
        above = row
    pixels = numpy.array(rows, numpy.uint8)
    if depth == 16:
        pixels = pixels.view(">u2").astype(numpy.uint16)
    pixels = pixels.reshape(height, width, -1)
    return pixels[..., ::-1] if color == 2 else pixels[..., 0]
