"""Results as MCAP, which Foxglove and PlotJuggler plot: a topic for each unit, a message for each communication point.

Messages are those of ROS 2 (CDR), and the file has their definitions: ``time`` in s and an array for each group of
signals, with its unit behind it: ``float64[2] q  # rad``. Their time is in ns after that of the first row. Names are
those of ROS, in small letters. The metadata record ``vdfmu`` has the signals' own, and the summary with the copies.
"""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from types import ModuleType
from typing import Any

import numpy as np
from numpy.typing import NDArray

from vdfmu.base.errors import UsageError
from vdfmu.base.files import replacing
from vdfmu.base.unpack import imported
from vdfmu.engine.results.formats import Format
from vdfmu.engine.results.recorded import (
    Recorded,
    Signal,
    from_arrays,
    from_facts,
    grouped,
    legal_names,
    no_rows,
    to_facts,
)

_HEAD = b"\0\1\0\0"
"""Of a message: CDR, low bytes first."""
_TYPES = {"real": ("float64", "<f8"), "integer": ("int32", "<i4"), "boolean": ("bool", "u1")}
_BLOCK = 4096


def needed() -> tuple[ModuleType, ...]:
    """Return mcap's reader and writer, and the decoder of ROS 2; UsageError if one is not installed."""
    return imported("MCAP", "mcap-ros2-support", "mcap", "mcap.reader", "mcap.writer", "mcap_ros2.decoder")


def _topics(signals: list[Signal]) -> Iterator[tuple[str, str, np.dtype[Any], list[tuple[str, list[Signal]]]]]:
    """Yield topic, definition, layout of a message, and its fields with their signals."""
    groups = grouped(signals)
    components = list(dict.fromkeys(name.partition(".")[0] for name, _ in groups)) or ["time"]
    for component, topic in zip(components, legal_names(components, (), 200, ros=True), strict=True):
        own = [(key, each) for key, each in groups.items() if key[0].partition(".")[0] == component]
        own.sort(key=lambda item: ("real", "integer", "boolean").index(item[0][1]))  # so that no gaps align them
        names = legal_names([key[0].partition(".")[2] or "value" for key, _ in own], ("time",), 200, ros=True)
        lines, layout = ["float64 time  # s"], [("head", "V4"), ("time", "<f8")]
        for name, ((_, kind), each) in zip(names, own, strict=True):
            units = ", ".join(dict.fromkeys(s.unit for s in each))
            lines.append(f"{_TYPES[kind][0]}[{len(each)}] {name}  # {units}")
            layout.append((name, f"({len(each)},){_TYPES[kind][1]}"))
        yield topic, "\n".join(lines), np.dtype(layout), list(zip(names, (e for _, e in own), strict=True))


def write_mcap(results: Recorded, path: Path) -> None:
    """Write the signals that copy no other, and the summary."""
    mcap = needed()[1]
    signals, facts = to_facts(results)
    topics = list(_topics(signals))
    try:
        with replacing(path) as file:
            writer = mcap.Writer(file)
            writer.start("ros2", "vdfmu")
            channels: list[int] = []
            kinds: list[str] = []
            for topic, text, _, _ in topics:
                kinds.append(topic.title().replace("_", ""))
                kinds[-1] += "X" * kinds[:-1].count(kinds[-1])  # a_1 and a1
                schema = writer.register_schema(f"vdfmu/msg/{kinds[-1]}", "ros2msg", text.encode())
                channels.append(writer.register_channel(f"/{topic}", "cdr", schema))
            for block in results.blocks(_BLOCK):
                stamps = np.rint((block.time - results.time[0]) * 1e9).astype(np.int64).tolist()
                messages = [_messages(block, layout, fields) for _, _, layout, fields in topics]
                for stamp, *row in zip(stamps, *messages, strict=True):
                    for channel, message in zip(channels, row, strict=True):
                        writer.add_message(channel, stamp, message, stamp)
            writer.add_metadata("vdfmu", {"json": facts})
            writer.finish()
    except OSError as error:
        raise no_rows(path, error) from None


def _messages(block: Recorded, layout: np.dtype[Any], fields: list[tuple[str, list[Signal]]]) -> list[bytes]:
    rows = np.zeros(len(block), layout)
    rows["head"], rows["time"] = _HEAD, block.time
    for name, members in fields:
        rows[name] = block.data[members[0].kind][:, [s.column for s in members]]
    text, size = rows.tobytes(), layout.itemsize
    return [text[i : i + size] for i in range(0, len(text), size)]


def read_mcap(path: Path) -> Recorded:
    """Read what `write_mcap` wrote."""
    mcap = needed()[0]
    texts: dict[str, list[bytes]] = {}
    try:
        with open(path, "rb") as file:
            reader = mcap.make_reader(file, validate_crcs=True)
            text = next((each.metadata["json"] for each in reader.iter_metadata() if each.name == "vdfmu"), None)
            if text is None:
                raise UsageError(f"{path}: expected results that vdfmu wrote, with the metadata vdfmu; there is none.")
            for _, channel, message in reader.iter_messages():
                texts.setdefault(channel.topic, []).append(message.data)
        signals, summary = from_facts(text)
        time, arrays = np.empty(0), dict[str, NDArray[Any]]()
        for topic, _, layout, fields in _topics(signals):
            rows = np.frombuffer(b"".join(texts.get(f"/{topic}", [])), layout)
            time = rows["time"]
            arrays |= {members[0].name: rows[name] for name, members in fields}
        ordered = [arrays[members[0].name] for members in grouped(signals).values()]
        return from_arrays(np.array(time), signals, ordered, summary)
    except UsageError:
        raise
    except Exception as error:  # mcap has many kinds for a file that is damaged
        raise UsageError(f"cannot read {path}: {getattr(error, 'strerror', None) or error}") from None


FORMAT = Format(needed, write_mcap, read_mcap)
