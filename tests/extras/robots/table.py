"""The robots of example-robot-data, imported arm by arm and held against Pinocchio: a table.

``python -m tests.extras.robots.table`` writes it into example_robots.md.
"""

from collections.abc import Iterator
from importlib.metadata import distribution
from pathlib import Path
from typing import NamedTuple

import vdfmu
from tests.extras.robots.conftest import differences, pinocchio_arm
from vdfmu.base.toml_tables import Problems
from vdfmu.extras.robots import import_robot
from vdfmu.extras.robots.chain import tips
from vdfmu.extras.robots.imported import parse_file
from vdfmu.extras.robots.urdf import read_urdf

PAGE = Path(__file__).with_name("example_robots.md")
BEGIN, END = "<!-- begin: made by tests/extras/robots/table.py -->\n", "<!-- end -->\n"
BOUND = 1e-10
"""Largest relative difference that is allowed: inverse dynamics agree to some 1e-15, forward ones to that times the
condition number of the mass matrix, up to 1e4 where a heavy arm carries a light finger."""


class Row(NamedTuple):
    """A file: its arms with their joints, and tips that are refused with the reason."""

    file: str
    arms: list[tuple[str, int]]
    refused: list[tuple[str, str]]


def folder() -> Path:
    data = distribution("example-robot-data").locate_file("cmeel.prefix/share/example-robot-data/robots")
    return Path(str(data))


def rows() -> Iterator[Row]:
    for path in sorted(folder().rglob("*.urdf"), key=lambda path: (path.name, str(path))):
        row = Row(f"{path.parents[1].name}/{path.name}", [], [])
        tree = read_urdf(parse_file(path), path, Problems(""))
        carried = {joint.child for joint in tree.joints}
        root = next((link for link in tree.links if link not in carried), "")
        ends = [tip for _, tip in tips(tree, root)] if root else []
        for tip in ends or [None]:
            try:
                imported = import_robot(path, tip=tip)
            except vdfmu.VdfmuError as error:
                problems = error.problems  # type: ignore[attr-defined]
                first = problems[0].removeprefix(f"{path}: ").partition(". ")[0]
                more = f" (and {len(problems) - 1} more)" if len(problems) > 1 else ""
                row.refused.append((tip or "", first + more))
                continue
            joints = [
                line.partition(": ")[2].partition(", ")[0]
                for line in imported.text.splitlines()
                if line.startswith("# Joint ")
            ]
            inverse, forward = differences(imported.robot, pinocchio_arm(path, joints), 5)
            assert max(inverse, forward) < BOUND, (path.name, tip, inverse, forward)
            row.arms.append((tip or "", imported.robot.n))
        yield row


def table() -> str:
    all_rows = list(rows())
    arms, refused = sum(len(row.arms) for row in all_rows), sum(len(row.refused) for row in all_rows)
    lines = [
        f"{len(all_rows)} files, {arms} arms imported, {refused} refused.", "",
        "| file | arms: tip and joints | refused |", "| --- | --- | --- |",
    ]  # fmt: skip
    for row in all_rows:
        imported = ", ".join(f"{tip} {n}" for tip, n in row.arms)
        reasons = "; ".join(f"{tip}: {reason}" if tip else reason for tip, reason in row.refused)
        lines.append(f"| {row.file} | {imported} | {reasons.replace('<', '&lt;')} |")
    return "\n".join(lines) + "\n"


def parts() -> tuple[str, str, str]:
    before, begin, rest = PAGE.read_text(encoding="utf-8").partition(BEGIN)
    inside, end, after = rest.partition(END)
    assert begin and end
    return before + begin, inside, end + after


if __name__ == "__main__":
    before, _, after = parts()
    PAGE.write_text(before + table() + after, encoding="utf-8")
