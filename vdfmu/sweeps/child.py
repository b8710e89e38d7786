"""The process of a worker of a parameter study; see `vdfmu.sweeps.worker`."""

from __future__ import annotations

import logging
import os
import pickle
import struct
from pathlib import Path
from typing import Any, BinaryIO

from vdfmu.process import private_pipes
from vdfmu.temporary import temporary_folder

SIZE = struct.Struct("<Q")
"""Length of the pickled message that follows."""


def _main() -> None:
    requests, replies = private_pipes()
    from vdfmu.sweeps.job import Bench

    logging.getLogger("vdfmu").addHandler(logging.NullHandler())
    with temporary_folder("vdfmu_sweep_") as folder:
        job = _read(requests)
        bench = Bench(job, Path(folder))
        try:
            _write(replies, job.together)
            while (message := _read(requests)) is not None:
                _write(replies, bench.run(*message))
        finally:
            bench.close()


def _read(stream: BinaryIO) -> Any:
    """Return the next message; None at the end."""
    head = stream.read(SIZE.size)
    return pickle.loads(stream.read(SIZE.unpack(head)[0])) if len(head) == SIZE.size else None


def _write(descriptor: int, message: Any) -> None:
    content = pickle.dumps(message)
    content = SIZE.pack(len(content)) + content
    while content:
        content = content[os.write(descriptor, content) :]


if __name__ == "__main__":
    _main()
