"""References for a co-simulation: a system of units solved by scipy, without FMI and without a master.

Three references say what the answer is (times in communication points t_k, step h, inputs held over a step):

- ``sampled``: an output that depends on a connected input is that of the step from t_k, computed from everything at
  t_k; its readers have it in the same step. An ordered master must give this.
- ``sampled-delayed``: every unit sees the others' outputs one sample late. Other sampled masters must give this.
- ``continuous``: no sampling but that of the units' own sampled states. Both tend to this as the step shrinks.

They are assembled from the wiring and the units' own functions: outputs and right-hand sides are the traced ones,
compiled where the compiler is installed, which the tests hold against plain numpy, or plain numpy where a unit cannot
be traced. The solvers are scipy's, not ours. A solution is kept in the cache by all that decides it.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from hashlib import sha256
from itertools import islice

import numpy as np
import numpy.typing as npt
import scipy

from vdfmu.base.arrays import Floats
from vdfmu.base.cache import cache_folder, load, store
from vdfmu.base.errors import UsageError
from vdfmu.compiler.functions.sources import source_digest
from vdfmu.system.package.description import SystemDescription
from vdfmu.system.reference.compiled import runs, sources
from vdfmu.system.reference.solution import ContinuousReference, SampledReference
from vdfmu.system.reference.wired import WiredUnits

BLOCK = 1024
"""Rows of a stretch: what is held in memory of a long run."""
_KEPT = 2**24
"""Most bytes of a solution that is kept."""


@dataclass(frozen=True)
class Reference:
    """Solution on the communication points: `t` (m,), and the outputs, ``unit.group``, (m, size) each.

    Row k holds the outputs of the step that ends at t_k, as the rows of a co-simulation do; row 0 those at the start.
    """

    name: str
    t: Floats
    signals: dict[str, Floats]

    def __getitem__(self, name: str) -> Floats:
        """Values (m, size) of ``unit.group``."""
        return self.signals[name]


def reference_blocks(
    name: str,
    description: SystemDescription,
    *,
    step: float,
    stop: float,
    substeps: int = 1,
    groups: Sequence[str] | None = None,
    progress: Callable[[int, int], None] | None = None,
) -> Iterator[Reference]:
    """Compute one of the three references in stretches of `BLOCK` communication points, the last of what is left.

    Parameters
    ----------
    name : "sampled", "sampled-delayed" or "continuous"
    description : SystemDescription
        Units, connections and values.
    step, stop : float [s]
    substeps : int
        Equal steps in each step, over each of which a sampled reference holds outputs.
    groups : sequence of str, optional
        Outputs, ``unit.group``; default all.
    progress : callable, optional
        Called with the number of finished steps and their total.

    Raises
    ------
    UsageError
        For an unknown name, or a system with an algebraic loop or an FMU of another tool.
    VdfmuError
        If scipy finds no solution.
    """
    if name not in ("sampled", "sampled-delayed", "continuous"):
        raise UsageError(f"no reference {name!r}; there are sampled, sampled-delayed and continuous.")
    system = WiredUnits(description)
    m = round(stop / step)
    t: Floats = step * np.arange(m + 1, dtype=np.float64)
    times: Floats = step / substeps * np.arange(m * substeps + 1, dtype=np.float64)
    places, where = system.shown(groups)
    solution = (
        ContinuousReference(system) if name == "continuous" else SampledReference(system, name == "sampled-delayed")
    )
    files = sources(system, solution.lists)
    system.start()
    small = files is not None and t.size * places.size * t.itemsize <= _KEPT
    key = _key(f"{name} {substeps}", system, files, times, places) if files and small else ""
    path = cache_folder() / "references" / key if key else None
    kept = load(path) if path is not None else None
    if kept is None:
        solved = solution.solve(times, runs(system, solution.lists, files))
        rows = (system.memory[places] for _ in islice(solved, 0, None, substeps))
    else:
        rows = iter(np.frombuffer(kept).reshape(t.size, places.size))
    blocks: list[Floats] = []
    for first in range(0, m + 1, BLOCK):
        block = np.array(list(islice(rows, BLOCK)))
        if path is not None and kept is None:
            blocks.append(block)
        signals = {group: block[:, columns] for group, columns in where.items()}
        yield Reference(name, t[first : first + BLOCK], signals)
        if progress is not None:
            progress(min(first + BLOCK, m), m)
    if path is not None and blocks:
        store(path, np.concatenate(blocks).tobytes())


def reference(name: str, description: SystemDescription, *, step: float, stop: float) -> Reference:
    """Compute one of the three references as a whole; see :func:`reference_blocks`."""
    blocks = list(reference_blocks(name, description, step=step, stop=stop))
    signals = {key: np.concatenate([block.signals[key] for block in blocks]) for key in blocks[0].signals}
    return Reference(name, np.concatenate([block.t for block in blocks]), signals)


def _key(name: str, system: WiredUnits, files: Mapping[str, bytes], t: Floats, places: npt.NDArray[np.intp]) -> str:
    """Return the digest of what decides a solution: what is calculated, from which values and signals, and by whom."""
    digest = sha256(repr((name, scipy.__version__, source_digest("system.reference"))).encode())
    arrays = [system.memory, t, places]
    for place, course in system.outside:
        arrays += [np.array([place, course.held]), course.t, course.values]
    for content in (*files.values(), *(array.tobytes() for array in arrays)):
        digest.update(f"\n{len(content)}\n".encode())
        digest.update(content)
    return digest.hexdigest()
