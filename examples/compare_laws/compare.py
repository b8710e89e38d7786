"""Tune control laws in the same way, run them on arms along motions with mismatches, and rank them.

    python compare.py --arms ur5e_6dof --laws controller,my_law.py --mismatch none,payload --motions circle

Every law is tuned on every arm by the same search: the same number of evaluations, the same seed, the same cost on the
plant that it is designed for, the same smallest modulus margin. After Ctrl-C, the same command resumes.
"""

from __future__ import annotations

import argparse
import csv
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from cells import MISMATCHES, MOTIONS, Arm
from laws import LAWS, Law, load_law

import vdfmu
from vdfmu.extras.tune import tune
from vdfmu.system.scenario import load_scenario
from vdfmu.system.scenario.values import system_values

ARMS = ("manipulator_6dof", "ur5e_6dof", "panda_7dof", "scara_4dof", "kr300_6dof")
OFF = 0.05  # tool error above which an arm has left its path, as a fraction of its length
LEAST, CLOSE = 1e-6, 1.05  # errors below this one are equally good [m], and laws within this ratio
Row = dict[str, Any]


@dataclass(frozen=True)
class Of:
    """A measure of a run: a function of the results."""

    name: str
    robot: Any
    least: float = 0.0
    """Required margin."""
    signals = ("trajectory.q_d", "plant.p_O")

    @property
    def loops(self) -> bool:
        """Whether the run is linearised for it."""
        return self.name in ("missing", "modulus", "unstable")

    def __call__(self, results: Any) -> float:
        """Return the measure; `missing` is the difference from the required modulus margin."""
        if self.loops:
            poses = results.summary["loops"]
            if poses.lacking or not poses.seconds:
                return np.nan
            if self.name == "unstable":
                return float(poses.loops.growth(0.0, float(results.time[-1])).unstable)
            modulus = float(poses.loops.modulus.min())
            return self.least - modulus if self.name == "missing" else modulus
        wanted = vdfmu.dynamics.forward_kinematics(self.robot, results["trajectory.q_d"])[0]
        error = np.linalg.norm(results["plant.p_O"] - wanted, axis=1)
        return float(error.max() if self.name == "peak" else np.sqrt(np.mean(error**2)))


def tuned(arm: Arm, law: Law, options: argparse.Namespace) -> Any:
    """Return the result of the search of a law on an arm."""
    start = {f"controller.{name}": value for name, value in arm.start_of(law).items()}
    return tune(
        arm.tuning, {f"controller.{name}": f"*log({low}, {high})" for name, (low, high) in law.vary.items()},
        Of("rms", arm.robot), limit={"margin": Of("missing", arm.robot, options.margin)}, together=True,
        parameters=start, units={"controller": law.unit}, method="global", seed=options.seed,
        evaluations=options.evaluations, workers=options.workers, out=arm.folder / law.name / "tune",
    )  # fmt: skip


def cells(arm: Arm, law: Law, values: dict[str, Any], options: argparse.Namespace) -> Iterator[Row]:
    """Run the cells of a law on an arm, a study for each motion and loop, and yield their rows."""
    for motion in options.motions:
        for loop in dict.fromkeys(MISMATCHES[name].loop for name in options.mismatch):
            path = arm.write(motion, law, values, loop)
            names = [name for name in options.mismatch if MISMATCHES[name].loop == loop]
            settings = [arm.differences(path, MISMATCHES[name], options.seed) for name in names]
            scenario = load_scenario(path)
            values_of = {f"{c}.{v.name}": v.start for c, table in scenario.resolved.tables.items() for v in table}
            values_of |= {f"{c}.{name}": x for c, each in system_values(scenario).items() for name, x in each.items()}
            targets = list(dict.fromkeys(target for each in settings for target in each))
            usual = {target: values_of.get(target, values_of.get(f"{target}[1]")) for target in targets}
            points = path.with_suffix(".csv")
            with points.open("w", newline="") as file:
                csv.writer(file).writerows([targets, *((usual | each).values() for each in settings)])
            study = vdfmu.sweep(
                path, sample=points, workers=options.workers,
                measure={name: Of(name, arm.robot) for name in ("rms", "peak", "modulus", "unstable")},
                out=arm.folder / law.name / f"{motion}_{loop}",
            )  # fmt: skip
            for name, row in zip(names, study.table().to_pylist(), strict=True):
                about = {"arm": arm.folder.name, "law": law.name, "motion": motion, "mismatch": name}
                yield about | {"verdict": verdict(row, arm.length), "scenario": path, "point": row["point"]} | row


def verdict(row: Row, length: float) -> str:
    """Return the verdict of a cell."""
    if row["failed"]:
        return "unstable" if "unstable" in row["failed"] else "failed"
    if row["unstable"] == 1.0:
        return "unstable"
    if row["peak"] > OFF * length:
        return "off the path"
    return "not judged" if np.isnan(row["unstable"]) else "no margin" if row["modulus"] == 0.0 else "stable"


def ranked(rows: Sequence[Row], laws: Sequence[str], cells_of_a_law: int) -> list[tuple[int, float, str]]:
    """Return (cells that are not stable, error relative to the best law, law), the best law first.

    The best law has the fewest such cells, then the smallest error. Errors are compared by their geometric mean over
    the cells in which both laws are stable.
    """
    good: dict[str, dict[tuple[str, str], float]] = {law: {} for law in laws}
    for row in rows:
        if row["verdict"] in ("stable", "not judged"):
            good[row["law"]][row["arm"], row["motion"]] = np.log(max(row["rms"], LEAST))

    def ratio(law: str, other: str) -> float:
        common = good[law].keys() & good[other].keys()
        return float(np.exp(np.mean([good[law][c] - good[other][c] for c in common]))) if common else np.inf

    most = max(map(len, good.values()))
    best = [law for law in laws if len(good[law]) == most]
    first = min(best, key=lambda law: np.prod([ratio(law, other) for other in best]))
    order = [(cells_of_a_law - len(good[law]), ratio(law, first), law) for law in laws]
    return sorted(order, key=lambda each: (each[0], each[2] != first, each[1]))


def words(rows: Sequence[Row], searches: dict[tuple[str, str], Any], options: argparse.Namespace) -> Iterator[str]:
    """Yield the lines of the summary, in Markdown."""
    laws = list(dict.fromkeys(law for _, law in searches))
    number = len(options.arms) * len(options.motions)
    yield f"{len(rows)} cells, {options.evaluations} evaluations, seed {options.seed}, margin {options.margin:g}."
    yield from ("", "### RMS tool error, relative to the best law of the row [cells that are not stable]", "")
    yield f"| | {' | '.join(f'`{law}`' for law in laws)} | best |"
    yield f"| --- |{' ---: |' * len(laws)} --- |"
    for mismatch in options.mismatch:
        order = ranked([row for row in rows if row["mismatch"] == mismatch], laws, number)
        texts = {
            law: (f"{mean:.3g}" if np.isfinite(mean) else "") + f" [{bad}]" * bool(bad) for bad, mean, law in order
        }
        best = [law for bad, mean, law in order if bad == order[0][0] and mean <= CLOSE]
        yield f"| {mismatch} | {' | '.join(texts[law].strip() for law in laws)} | {', '.join(best)} |"
    yield from ("", "### Not stable", "")
    broken: dict[tuple[str, str, str], list[str]] = {}
    for row in rows:
        if row["verdict"] not in ("stable", "not judged"):
            broken.setdefault((row["mismatch"], row["verdict"], row["law"]), []).append(f"{row['arm']} {row['motion']}")
    yield from (f"- {name}, {why}: `{law}` on {', '.join(cells)}." for (name, why, law), cells in broken.items())
    yield from ("", "### RMS tool error [mm] of the tuned motion, before and after the search", "")
    yield f"| law | {' | '.join(options.arms)} |"
    yield f"| --- |{' --- |' * len(options.arms)}"
    for law in laws:
        pairs = [searches[arm, law] for arm in options.arms]
        texts = [f"{1e3 * t.before.cost[0]:.3g} → {1e3 * t.after.cost[0]:.3g}" if t.after.feasible
                 else "no values keep the margin" for t in pairs]  # fmt: skip
        yield f"| `{law}` | {' | '.join(texts)} |"


def main(arguments: Sequence[str] | None = None) -> list[Row]:
    """Run the comparison and return its rows."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    for name, names, text in (
        ("laws", tuple(LAWS), "names, or Python files with a LAW"), ("arms", ARMS, "names or TOML files"),
        ("mismatch", tuple(MISMATCHES), "names"), ("motions", MOTIONS, "names"),
    ):  # fmt: skip
        parser.add_argument(f"--{name}", default=names, type=lambda each: each.split(","), help=f"{text}; default all")
    parser.add_argument("--evaluations", type=int, default=24, help="of the search of each law on each arm")
    parser.add_argument(
        "--margin", type=float, default=0.5, help="least modulus margin on the plant that a law is designed for"
    )
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--workers", type=int)
    parser.add_argument("--out", type=Path, default=Path("results/compare_laws"))
    options = parser.parse_args(arguments)
    for name, names in (("mismatch", MISMATCHES), ("motions", MOTIONS)):
        if unknown := [each for each in getattr(options, name) if each not in names]:
            parser.error(f"--{name}: must be some of {', '.join(names)}, got {', '.join(unknown)}.")
    laws = [load_law(name) for name in options.laws]
    arms = [Arm(name, options.out) for name in options.arms]
    rows: list[Row] = []
    searches: dict[tuple[str, str], Any] = {}
    for name, arm in zip(options.arms, arms, strict=True):
        for law in laws:
            searches[name, law.name] = result = tuned(arm, law, options)
            if result.after.feasible:
                values = {key.partition(".")[2]: np.asarray(x).tolist() for key, x in result.parameters.items()}
                rows += cells(arm, law, arm.start_of(law) | values, options)
    text = "\n".join(words(rows, searches, options)) + "\n"
    (options.out / "summary.md").write_text(text)
    print(text)
    return rows


if __name__ == "__main__":
    main()
