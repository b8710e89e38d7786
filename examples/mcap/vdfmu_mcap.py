"""MCAP for vdfmu: a format of results for Foxglove and PlotJuggler, and a reader of logs of ROS 2.

A file of results has a topic for each component and a message of ROS 2 (CDR) for each communication point. The
definition of a message is in the file: ``time`` in s, then an array for each group of signals with its unit,
``float64[2] q  # rad``. The time of a message is in ns after the first row. Names follow ROS, in small letters.
The metadata record ``vdfmu`` has the signals of vdfmu and the summary.
"""

from __future__ import annotations

import json
import logging
import os
import re
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from mcap.reader import make_reader
from mcap.writer import Writer
from mcap_ros2.decoder import DecoderFactory

from vdfmu import Results, VdfmuError
from vdfmu.plugin import Format, Recorded, Signal

HEAD = b"\0\1\0\0"
"""Begin of a message: CDR, little endian."""
TYPES = {"real": ("float64", "<f8"), "integer": ("int32", "<i4"), "boolean": ("bool", "u1")}
ROWS = 4096
"""Rows that are written at a time."""

# ---------------------------------------------------------------------- results of runs


def mcap() -> Format:
    """Return the format, for the group ``vdfmu.formats`` of entry points."""
    return Format(lambda: None, write, read)


def topics(signals: Sequence[Signal]) -> Iterator[tuple[str, str, np.dtype, dict[str, list[Signal]]]]:
    """Yield topic, definition and layout of a message, and signals by field."""
    groups: dict[tuple[str, str], list[Signal]] = {}
    for signal in signals:
        groups.setdefault((re.sub(r"\[[\d,]+\]$", "", signal.name), signal.kind), []).append(signal)
    components = list(dict.fromkeys(name.partition(".")[0] for name, _ in groups)) or ["time"]
    for component, topic in zip(components, ros_names(components), strict=True):
        keys = [key for key in groups if key[0].partition(".")[0] == component]
        keys.sort(key=lambda key: list(TYPES).index(key[1]))  # the largest first, so that no padding is needed
        names = ros_names([name.partition(".")[2] or "value" for name, _ in keys], taken=["time"])
        lines, layout, fields = ["float64 time  # s"], [("head", "V4"), ("time", "<f8")], {}
        for name, key in zip(names, keys, strict=True):
            fields[name] = groups[key]
            units = ", ".join(dict.fromkeys(signal.unit for signal in groups[key]))
            lines.append(f"{TYPES[key[1]][0]}[{len(groups[key])}] {name}  # {units}")
            layout.append((name, f"({len(groups[key])},){TYPES[key[1]][1]}"))
        yield topic, "\n".join(lines), np.dtype(layout), fields


def ros_names(names: Sequence[str], taken: Sequence[str] = ()) -> list[str]:
    """Return a name of ROS for each, all different: small letters, digits and single underscores."""
    unique: list[str] = []
    for name in names:
        legal = re.sub(r"[^a-z0-9]+", "_", name.lower()).strip("_")
        legal = (legal if re.match("[a-z]", legal) else f"x{legal}")[:200]
        k, base = 1, legal
        while legal in (*taken, *unique):
            k += 1
            legal = f"{base}_{k}"
        unique.append(legal)
    return unique


def write(results: Recorded, path: Path) -> None:
    """Write results to a file, atomically."""
    part = path.with_name(f"{path.name}.part")
    try:
        with open(part, "wb") as file:
            write_messages(results, Writer(file))
        os.replace(part, path)
    except OSError as error:
        raise VdfmuError(f"{path}: cannot be written: {error.strerror or error}. Free space there.") from None
    finally:
        part.unlink(missing_ok=True)


def write_messages(results: Recorded, writer: Writer) -> None:
    """Write definitions, messages and metadata."""
    writer.start("ros2", "vdfmu")
    channels, kinds, layouts = [], [], []
    for topic, text, layout, fields in topics(results.signals):
        kinds.append(topic.title().replace("_", ""))
        kinds[-1] += "X" * kinds[:-1].count(kinds[-1])  # of a_1 and a1
        schema = writer.register_schema(f"vdfmu/msg/{kinds[-1]}", "ros2msg", text.encode())
        channels.append(writer.register_channel(f"/{topic}", "cdr", schema))
        layouts.append((layout, fields))
    for block in results.blocks(ROWS):
        stamps = np.rint((block.time - results.time[0]) * 1e9).astype(np.int64).tolist()
        messages = [as_messages(block, layout, fields) for layout, fields in layouts]
        for stamp, *row in zip(stamps, *messages, strict=True):
            for channel, message in zip(channels, row, strict=True):
                writer.add_message(channel, stamp, message, stamp)
    facts = {"signals": results.signals, "summary": results.summary}
    writer.add_metadata("vdfmu", {"json": json.dumps(facts, default=str)})
    writer.finish()


def as_messages(block: Recorded, layout: np.dtype, fields: Mapping[str, list[Signal]]) -> list[bytes]:
    """Return a message for each row."""
    rows = np.zeros(len(block), layout)
    rows["head"], rows["time"] = np.void(HEAD), block.time
    for name, signals in fields.items():
        rows[name] = block.data[signals[0].kind][:, [signal.column for signal in signals]]
    text, size = rows.tobytes(), layout.itemsize
    return [text[i : i + size] for i in range(0, len(text), size)]


def read(path: Path) -> Recorded:
    """Read a file that `write` wrote."""
    texts: dict[str, list[bytes]] = {}
    try:
        with open(path, "rb") as file:
            reader = make_reader(file, validate_crcs=True)
            facts = next((each.metadata["json"] for each in reader.iter_metadata() if each.name == "vdfmu"), None)
            if facts is None:
                raise VdfmuError(f"{path}: expected results of vdfmu, with the metadata vdfmu, got none.")
            for _, channel, message in reader.iter_messages():
                texts.setdefault(channel.topic, []).append(message.data)
        header = json.loads(facts)
        signals = [Signal(*each) for each in header["signals"]]
        time, columns = np.empty(0), {}
        for topic, _, layout, fields in topics(signals):
            rows = np.frombuffer(b"".join(texts.get(f"/{topic}", [])), layout)
            time = rows["time"].copy()
            columns |= {s.name: rows[name][:, i] for name, group in fields.items() for i, s in enumerate(group)}
        data = {}
        for kind in TYPES:
            of_kind = [signal for signal in signals if signal.kind == kind]
            shape = len(time), max((signal.column + 1 for signal in of_kind), default=0)
            data[kind] = np.zeros(shape, np.float64 if kind == "real" else np.int32)
            for signal in of_kind:
                data[kind][:, signal.column] = columns[signal.name]
        return Recorded(time, signals, data, header["summary"])
    except VdfmuError:
        raise
    except Exception as error:  # mcap raises many kinds of errors for a damaged file
        raise VdfmuError(f"cannot read {path}: {getattr(error, 'strerror', None) or error}") from None


# ---------------------------------------------------------------------- logs


def read_log(path: Path) -> Results | dict[str, tuple[np.ndarray, np.ndarray, str]]:
    """Return columns of a log, for the group ``vdfmu.logs`` of entry points: name to times [s], numbers and unit.

    Messages are of ROS 2 or JSON. Their time is that of their header if they have one, otherwise that of the log.
    """
    decoders, rows, unread = DecoderFactory(), {}, {}
    try:
        with open(path, "rb") as file:
            reader = make_reader(file, validate_crcs=True)
            if any(each.name == "vdfmu" for each in reader.iter_metadata()):
                return Results.read(path)
            for schema, channel, message in reader.iter_messages():
                is_json = channel.message_encoding == "json"
                decode = json.loads if is_json else decoders.decoder_for(channel.message_encoding, schema)
                if decode is None:
                    unread[channel.topic] = channel.message_encoding
                    continue
                fields = dict(numbers("", decode(message.data)))
                stamp = 10**9 * int(fields.get("header.stamp.sec", 0))
                stamp += int(fields.get("header.stamp.nanosec", fields.get("header.stamp.nsec", 0)))
                for name, value in fields.items():
                    rows.setdefault(f"{channel.topic}.{name}", []).append((stamp or message.log_time, value))
    except VdfmuError:
        raise
    except Exception as error:  # mcap raises many kinds of errors for a damaged file
        raise VdfmuError(f"{path}: expected an MCAP file, got unreadable data: {error}") from None
    for topic, encoding in unread.items():
        logging.getLogger("vdfmu").warning("%s: not read, its encoding is %s", topic, encoding)
    if not rows:
        got = ", ".join(f"{topic} in {encoding}" for topic, encoding in unread.items()) or "none"
        raise VdfmuError(f"{path}: expected messages of ROS 2 (cdr, ros2msg) or json, got {got}.")
    first = min(each[0][0] for each in rows.values())
    return {
        name: (np.array([stamp - first for stamp, _ in each]) * 1e-9, np.array([x for _, x in each], float), "")
        for name, each in rows.items()
    }


def numbers(name: str, value: Any, labels: Sequence[str] = ()) -> Iterator[tuple[str, float]]:
    """Yield the numbers in a message; elements of arrays have the names in the message, or else numbers from 1."""
    members = value if isinstance(value, Mapping) else {k: getattr(value, k) for k in getattr(value, "__slots__", ())}
    if members:
        labels = members.get("name", ())
        for key, member in members.items():
            yield from numbers(f"{name}.{key}" if name else str(key), member, labels)
    elif isinstance(value, (int, float)):
        yield name, value
    elif hasattr(value, "__len__") and not isinstance(value, (str, bytes)):
        named = labels if len(labels) == len(value) and not isinstance(labels, str) else range(1, len(value) + 1)
        for label, each in zip(named, value, strict=True):
            yield from numbers(f"{name}[{label}]", each)
