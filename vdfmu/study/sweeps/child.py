"""The process of a worker of a parameter study; see `vdfmu.study.sweeps.worker`. Argument: its temporary folder."""

from __future__ import annotations

import json
import logging
import os
import pickle
import struct
import sys
import tempfile
from pathlib import Path
from typing import Any, BinaryIO

from vdfmu.base.errors import StorageError
from vdfmu.base.process import private_pipes

SIZE = struct.Struct("<Q")
"""Length of the message that follows: pickled for the process, JSON from it."""


def _main() -> None:
    requests, replies = private_pipes()
    from vdfmu.study.sweeps.job import Bench

    logging.getLogger("vdfmu").addHandler(logging.NullHandler())
    # the worker removes it, whatever ends this process
    tempfile.tempdir = os.environ["TMPDIR"] = folder = sys.argv[1]
    job = _read(requests)
    bench = Bench(job, Path(folder))
    try:
        _write(replies, job.together)
        while (message := _read(requests)) is not None:
            try:
                answer = bench.run(*message)
            except StorageError as error:
                answer = {"disk": str(error)}
            _write(replies, answer)
    finally:
        bench.close()


def _read(stream: BinaryIO) -> Any:
    """Return the next message; None at the end."""
    head = stream.read(SIZE.size)
    return pickle.loads(stream.read(SIZE.unpack(head)[0])) if len(head) == SIZE.size else None


def _write(descriptor: int, message: Any) -> None:
    content = json.dumps(message, default=lambda value: value.tolist()).encode()
    content = SIZE.pack(len(content)) + content
    while content:
        content = content[os.write(descriptor, content) :]


if __name__ == "__main__":
    _main()
