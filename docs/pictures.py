"""Draw what the documentation explains with drawings, for light and dark schemes: ``python docs/pictures.py``."""

from __future__ import annotations

import re
import sys
from html import escape
from pathlib import Path

import numpy as np

ROOT = Path(__file__).resolve().parents[1]
sys.path.insert(0, str(ROOT))
from vdfmu.arm.equations.kinematics import joint_placements  # noqa: E402
from vdfmu.arm.robot import load_robot  # noqa: E402

_STYLE = """
svg { font: 15px system-ui, "DejaVu Sans", Arial, sans-serif; color: #24292f; --card: #fff; --part: #d5dbe3;
  --x: #c62828; --y: #1a7f37; --z: #0b5cad; --soft: #57606a; --motor: #fde8c8; --link: #d8e8fb; }
@media (prefers-color-scheme: dark) { svg { color: #e6edf3; --card: #1f232b; --part: #4a5568;
  --x: #ff8a80; --y: #56d364; --z: #79b8ff; --soft: #aab4c0; --motor: #5a4520; --link: #23405f; } }
text { fill: currentColor; text-anchor: middle; } .left { text-anchor: start; } .end { text-anchor: end; }
.soft { fill: var(--soft); font-size: 13px; } .bold { font-weight: 600; }
path, circle, rect { stroke: currentColor; fill: none; stroke-width: 1.6; stroke-linejoin: round; }
.card { fill: var(--card); } .motor { fill: var(--motor); } .link { fill: var(--link); } .plain { fill: var(--part); }
.body { stroke: var(--part); stroke-width: 14; stroke-linecap: round; }
.joint { stroke: var(--soft); stroke-width: 17; }
.x { stroke: var(--x); } .y { stroke: var(--y); } .z { stroke: var(--z); } .dash { stroke-dasharray: 5 5; }
text.z { stroke: none; fill: var(--z); }
"""
_SMALL = re.compile(r"_(\w)")


def _page(width: int, height: int, title: str, parts: list[str]) -> str:
    head = (
        f'<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 {width} {height}" width="{width}" height="{height}" '
        f'role="img" aria-label="{escape(title)}">'
    )
    tip = '<marker id="tip" viewBox="0 0 10 10" refX="9" refY="5" markerWidth="7" markerHeight="7" orient="auto">'
    defs = f'<defs>{tip}<path d="M0 0L10 5L0 10z" style="fill:context-stroke;stroke:none"/></marker></defs>'
    card = f'<rect class="card" style="stroke:none" width="{width}" height="{height}" rx="6"/>'
    return "\n".join([head, f"<style>{_STYLE}</style>", defs, card, *parts, "</svg>", ""])


def _text(x: float, y: float, text: str, kind: str = "") -> str:
    """Text with subscripts, ``q_d``."""
    small = r'<tspan dy="4" font-size="70%">\1</tspan><tspan dy="-4">&#8203;</tspan>'
    return f'<text x="{x:.4g}" y="{y:.4g}" class="{kind}">{_SMALL.sub(small, escape(text))}</text>'


def _line(*points: tuple[float, float], kind: str = "", tip: bool = False) -> str:
    path = " ".join(f"{'ML'[k > 0]}{x:.4g} {y:.4g}" for k, (x, y) in enumerate(points))
    end = ' marker-end="url(#tip)"' if tip else ""
    return f'<path d="{path}" class="{kind}"{end}/>'


def _box(x: float, y: float, width: float, height: float, kind: str, *lines: str) -> str:
    top = y + height / 2 + 15 - 10 * len(lines)
    texts = [_text(x + width / 2, top + 20 * k, line, "soft" if k else "bold") for k, line in enumerate(lines)]
    box = f'<rect x="{x}" y="{y}" width="{width}" height="{height}" rx="5" class="{kind}"/>'
    return "\n".join([box, *texts])


_LABELS = (
    ("{I}, {B_1}", -52, 6), None, ("{B_2}", -30, 28), ("{B_3}, {B_4}", -66, -6), None, ("{B_5}", -6, -24),
    ("{B_6} = {O}", 30, 48),
)  # fmt: skip
"""Name of a frame, or of two with one origin, and where it stands beside the origin [px]."""


def arm() -> str:
    """Return the paper's arm with its frames, in a pose that shows all of them."""
    robot = load_robot("manipulator_6dof")
    q = np.radians([20.0, 48.0, -24.0, 25.0, -62.0, 25.0])
    a, e = np.radians([-98.0, 24.0])  # azimuth and elevation of the eye
    right = np.array([-np.sin(a), np.cos(a), 0.0])
    up = np.array([-np.sin(e) * np.cos(a), -np.sin(e) * np.sin(a), np.cos(e)])

    def at(point: np.ndarray) -> tuple[float, float]:
        return 140.0 + 590.0 * float(right @ point), 450.0 - 590.0 * float(up @ point)

    poses = [(np.zeros(3), np.eye(3))]
    for R_AB, p_AB in joint_placements(robot, q):
        p, R = poses[-1]
        poses.append((p + R @ p_AB, R @ R_AB))
    points = [at(p) for p, _ in poses]
    parts = [_line(points[i], points[i + 1], kind="body") for i in range(6)]
    parts += [_line(at(p - 0.03 * R[:, 2]), at(p + 0.03 * R[:, 2]), kind="joint") for p, R in poses[1:]]
    for i, (p, R) in enumerate(poses):
        length = 0.12 if i else 0.16
        for k, kind in enumerate("xyz"):
            tip = at(p + length * R[:, k])
            parts.append(_line(points[i], tip, kind=kind if i else f"{kind} dash", tip=True))
            if i and k == 2:
                aside = {1: -16, 4: -18}.get(i, 8)  # px, beside a link that runs along the axis
                parts.append(_text(tip[0] + aside, tip[1] + (12 if aside > 0 else -6), f"z_{i}", "z"))
        if i:
            x, y = at(p + R @ robot.centroid[i - 1])
            parts.append(f'<circle cx="{x:.4g}" cy="{y:.4g}" r="5" class="card"/>')
            parts.append(_line((x - 5, y), (x + 5, y)) + _line((x, y - 5), (x, y + 5)))
        if label := _LABELS[i]:
            parts.append(_text(points[i][0] + label[1], points[i][1] + label[2], label[0], "bold"))
    for k, i in enumerate((1, 2, 4, 5), 1):
        size = f"l_{k} = {np.linalg.norm(robot.offset[i]):g} m"
        (x1, y1), (x2, y2) = points[i], points[i + 1]
        along, below = (0.56, 30) if i < 5 else (0.25, -16)
        parts.append(_text(x1 + along * (x2 - x1) + 10, y1 + along * (y2 - y1) + below, size, "soft left"))
    axes = "Axes: x red, y green, z blue; those of {I} dashed"
    for k, line in enumerate((axes, "z_i is the axis of joint i", "Crossed circles: centres of mass")):
        parts.append(_text(372, 410 + 22 * k, line, "soft left"))
    return _page(720, 480, "The paper's arm with its frames", parts)


def loop() -> str:
    """Return the closed loop with the names of its signals, as ssp/system.toml connects it."""
    out, back = 806, 250
    return _page(820, 290, "The loop: Trajectory, Feedforward, PDController and Plant with the signals between them", [
        _box(14, 130, 136, 64, "plain", "Trajectory", "desired motion"),
        _box(236, 26, 140, 64, "plain", "Feedforward", "model of the arm"),
        _box(420, 130, 144, 64, "motor", "PDController", "feedback"),
        _box(646, 130, 134, 64, "link", "Plant", "the arm itself"),
        _line((150, 162), (420, 162), tip=True), _text(368, 154, "q_d, q̇_d"),
        _line((190, 162), (190, 58), (236, 58), tip=True), _text(180, 50, "q_d and 4 derivatives", "end"),
        _line((376, 58), (492, 58), (492, 130), tip=True), _text(436, 50, "τ_m, κ̇_d"),
        _line((564, 162), (646, 162), tip=True), _text(603, 154, "τ"), _text(603, 182, "motor side", "soft"),
        _line((780, 162), (out, 162), (out, back), (306, back), (306, 90), tip=True),
        _line((492, back), (492, 194), tip=True), _text(650, back - 8, "q, q̇, κ̇"),
        _line((713, 62), (713, 130), kind="dash", tip=True), _text(713, 34, "F_e, wrench at the tool"),
        _text(713, 54, "(not connected: 0)", "soft"),
        _text(14, 278, "q: links, κ: rotors divided by the gear ratio, d: desired; one for each joint", "soft left"),
    ])  # fmt: skip


def joint() -> str:
    """Return one flexible joint: motor, ratio, spring, link."""
    spring = [(440, 100), *((452 + 12 * k, 86 + 28 * (k % 2)) for k in range(8)), (548, 100), (580, 100)]
    return _page(760, 240, "A flexible joint: motor, rotor, ratio, spring and link with their angles and torques", [
        _text(180, 26, "motor side", "soft"), _text(560, 26, "link side", "soft"),
        _line((344, 14), (344, 178), kind="dash"),
        _box(20, 66, 84, 68, "plain", "motor"), _box(150, 66, 110, 68, "motor", "rotor", "J_r"),
        _box(302, 66, 84, 68, "plain", "ℓ : 1", "ratio"), _box(580, 66, 150, 68, "link", "link", "and the arm"),
        _line((104, 100), (150, 100), tip=True), _text(127, 90, "τ"),
        _line((260, 100), (302, 100)), _text(281, 90, "τ_s/ℓ"), _line((386, 100), (440, 100)), _text(412, 90, "τ_s"),
        _line(*spring), _text(500, 72, "spring"), _text(205, 56, "angle ℓκ"),
        _text(412, 126, "κ"), _text(566, 126, "q"),
        _text(205, 164, "friction ξ_m", "soft"), _text(655, 164, "friction ξ_l", "soft"),
        _text(175, 214, "I_m κ̈ = τ − τ_s/ℓ − ξ_m,  I_m = J_r ℓ"), _text(460, 214, "κ − q = D(τ_s)"),
        _text(650, 214, "M q̈ + … = τ_s − ξ_l"),
    ])  # fmt: skip


def packages() -> str:
    """Return the packages of vdfmu and its extras: each may import from all below it."""
    above = [
        ("extras", "identification, tuning, control laws, learning, eFMI"),
        ("cli", "commands"),
        ("study", "runs, sweeps, pages"),
        ("system", "scenario, SSP, scipy reference"),
        ("arm", "robots, equations, drives, units, motions"),
    ]
    parts = [_box(110, 14 + 62 * k, 500, 50, "plain", *lines) for k, lines in enumerate(above)]
    parts += [
        _box(110, 324, 240, 50, "motor", "engine", "reads, runs and checks FMUs"),
        _box(370, 324, 240, 50, "link", "compiler", "a numpy class becomes an FMU"),
        _box(110, 386, 500, 50, "plain", "base", "errors, files, processes, units of measurement"),
        _line((60, 30), (60, 422), tip=True), _text(52, 230, "imports", "soft end"),
    ]  # fmt: skip
    return _page(
        720, 450, "The extras, and the seven packages: cli, study, system, arm, engine beside compiler, base", parts
    )


PICTURES = {"frames": arm, "loop": loop, "joint": joint, "packages": packages}
"""File in docs/images to what draws it."""


if __name__ == "__main__":
    for name, drawn in PICTURES.items():
        (ROOT / "docs" / "images" / f"{name}.svg").write_text(drawn(), encoding="utf-8")
