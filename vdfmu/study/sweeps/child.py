"""The process of a worker of a parameter study; see `vdfmu.study.sweeps.worker`. Argument: its temporary folder."""

from __future__ import annotations

import logging
import os
import pickle
import sys
import tempfile
from pathlib import Path

from vdfmu.base.errors import StorageError
from vdfmu.base.process import Parent, contained


def _main(folder: str) -> None:
    parent = Parent()
    requests = parent.requests()
    from vdfmu.study.sweeps.job import Bench

    logging.getLogger("vdfmu").addHandler(logging.NullHandler())
    # the worker removes it, whatever ends this process
    tempfile.tempdir = os.environ["TMPDIR"] = folder
    job = pickle.loads(next(requests))
    bench = Bench(job, Path(folder))
    try:
        parent.reply(job.together)
        for request in requests:
            try:
                answer = bench.run(*pickle.loads(request))
            except StorageError as error:
                answer = {"disk": str(error)}
            parent.reply(answer)
    finally:
        bench.close()


if __name__ == "__main__":
    contained(_main, *sys.argv[1:])
