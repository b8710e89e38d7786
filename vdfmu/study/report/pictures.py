"""The pictures of a run, drawn unless the cache has those of the same numbers, texts and sources.

They are kept by the digest of all that they show, which each run has computed before, and of all that draws them. So
what is kept stands for no calculation, and a run whose numbers differ in one bit is drawn.
"""

from __future__ import annotations

import json
from collections.abc import Sequence
from contextlib import suppress
from hashlib import sha256
from importlib.metadata import version
from pathlib import Path

from vdfmu.base.cache import cache_folder, load, store
from vdfmu.base.files import write_whole
from vdfmu.compiler.functions.sources import source_digest
from vdfmu.engine.results.results import Results
from vdfmu.study.report.captions import paper_table, run_caption
from vdfmu.system.scenario import Scenario

PICTURES = {
    4: ("figure_10", "figure_11", "tool"),
    5: ("figure_13", "figure_14", "tool"),
    0: ("torques", "errors", "tool"),
}
"""Table of the paper that a scenario compares with to the names of its pictures."""
SIGNALS = (
    "trajectory.q_d", "plant.q", "plant.kappa", "plant.p_O", "controller.tau", "feedforward.tau_m",
)  # fmt: skip
"""Signals that the pictures show."""


def write_pictures(
    results: Results, scenario: Scenario, folder: Path | str, pictures: Sequence[str] = ("png",)
) -> list[Path]:
    """Write the pictures of a run, which `PICTURES` says by the table in ``scenario.paper["source"]``.

    The folder is made if it is missing. `pictures` are suffixes that `vdfmu.base.style.save` knows.
    """
    paths = [Path(folder, f"{name}.{suffix}") for name in PICTURES[paper_table(scenario)] for suffix in pictures]
    key, cache = picture_key(results, scenario), cache_folder() / "pictures"
    kept = [(path, load(cache / f"{key}_{path.name}")) for path in paths]
    for path, content in kept:
        if content is None:
            from vdfmu.study.report.plots import draw_picture  # takes long to import

            draw_picture(results, scenario, path)
            store(cache / f"{key}_{path.name}", path.read_bytes())
        else:
            with suppress(OSError):  # of which the writing then says more
                path.parent.mkdir(parents=True, exist_ok=True)
            write_whole(path, [content])
    return paths


def picture_key(results: Results, scenario: Scenario) -> str:
    """Return the digest of what decides the pictures: signals, arm, caption, and what draws them."""
    drawing = source_digest("study.report.plots"), version("matplotlib"), version("numpy"), version("pillow")
    shown = scenario.arm.to_dict(looks=False), paper_table(scenario), run_caption(results, scenario, {})
    digest = sha256(json.dumps([drawing, shown]).encode())
    for values in (results.time, *(results[name] for name in SIGNALS)):
        digest.update(repr(values.shape).encode() + values.tobytes())
    return digest.hexdigest()
