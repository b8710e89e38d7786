"""Style of all figures: size, colours, panels, and reproducible files.

Figures are drawn with matplotlib's objects on an Agg canvas, without pyplot, a display or the user's settings.
"""

from __future__ import annotations

import contextlib
import functools
import io
import math
import textwrap
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any, ParamSpec

import matplotlib.style
import numpy as np
from matplotlib.artist import Artist
from matplotlib.axes import Axes
from matplotlib.axis import Axis
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from matplotlib.layout_engine import ConstrainedLayoutEngine
from matplotlib.lines import Line2D
from matplotlib.ticker import ScalarFormatter
from PIL import Image

from vdfmu.base.arrays import Floats, extremes
from vdfmu.base.errors import UsageError
from vdfmu.base.files import write_whole
from vdfmu.base.measure import fitted, spaced
from vdfmu.base.page import LIGHT

P = ParamSpec("P")
DPI = 150
WIDTH = 8.0
"""Width of a figure [in]."""
COLORS = LIGHT
DASHES = ("-", "--", "-.", ":")
BACK: dict[str, Any] = {"color": COLORS[5], "linewidth": 3.2}
ON_TOP: dict[str, Any] = {"color": "#000000", "linewidth": 1.1, "linestyle": (0, (5, 3))}
"""Line styles of two curves that may coincide: a wide one, and a dashed one on top."""
_GREY = "#555555"
_MARGIN = 0.1
_CAPTION_CHARACTERS = 15.6  # characters per inch
_RC: dict[str, Any] = {
    "font.family": "DejaVu Sans",  # comes with matplotlib
    "font.size": 10.0, "axes.titlesize": 10.0, "axes.labelsize": 10.0, "legend.fontsize": 10.0,
    "axes.titlelocation": "left", "axes.titleweight": "bold",
    "axes.titley": 1.0,  # otherwise matplotlib measures everything below the title
    "axes.edgecolor": _GREY, "axes.linewidth": 0.8, "axes.grid": True, "axes.axisbelow": True,
    "axes.xmargin": 0.0, "axes.ymargin": 0.08, "axes.spines.top": False, "axes.spines.right": False,
    "grid.color": "#DDDDDD", "grid.linewidth": 0.7, "lines.linewidth": 1.6, "lines.solid_capstyle": "round",
    "legend.frameon": False, "svg.hashsalt": "vdfmu",
    **{f"{axis}tick.labelsize": 9.0 for axis in "xy"}, **{f"{axis}tick.color": _GREY for axis in "xy"},
    **{f"{axis}tick.labelcolor": "black" for axis in "xy"},
    **{f"figure.constrained_layout.{axis}_pad": 0.06 for axis in "hw"},
    **{f"figure.constrained_layout.{axis}space": 0.03 for axis in "hw"},
}  # fmt: skip


_PAPER: dict[str, Any] = _RC | {
    "font.size": 8.0,
    "axes.titlesize": 8.0,
    "axes.labelsize": 8.0,
    "legend.fontsize": 8.0,
    "xtick.labelsize": 8.0,
    "ytick.labelsize": 8.0,
    "axes.linewidth": 0.6,
    "grid.linewidth": 0.5,
    "lines.linewidth": 1.0,
    "legend.handlelength": 1.6,
    "legend.columnspacing": 1.0,
    "legend.borderaxespad": 0.1,
    "legend.labelspacing": 0.2,
    "figure.constrained_layout.h_pad": 0.02,
    "figure.constrained_layout.w_pad": 0.02,
}


_SERIF: dict[str, Any] = _PAPER | {"font.family": "STIXGeneral", "mathtext.fontset": "stix"}
"""Serif font as in most papers; it comes with matplotlib."""


def styled(draw: Callable[P, Figure], look: dict[str, Any] = _RC) -> Callable[P, Figure]:
    """Make a function draw its figure in the style of this module."""

    @functools.wraps(draw)
    def wrapper(*args: P.args, **kwargs: P.kwargs) -> Figure:
        with matplotlib.style.context(["default", look]):
            return draw(*args, **kwargs)

    return wrapper


def paper(draw: Callable[P, Figure]) -> Callable[P, Figure]:
    """Make a function draw its figure with 8 pt text and thin lines; its argument `serif` chooses the font."""

    @functools.wraps(draw)
    def wrapper(*args: P.args, **kwargs: P.kwargs) -> Figure:
        look = _SERIF if kwargs.get("serif") else _PAPER
        figure = styled(draw, look)(*args, **kwargs)
        setattr(figure, "look", look)  # noqa: B010, which a figure of matplotlib does not have
        return figure

    return wrapper


def blank(width: float, height: float) -> Figure:
    """Return a figure of `width` by `height` [in] without title and caption; see `paper`."""
    figure = _Picture(figsize=(width, height), dpi=2 * DPI, layout="constrained")
    FigureCanvasAgg(figure)
    return figure


def new_figure(
    title: str, caption: str, *, height: float, width: float = WIDTH, legend: Sequence[Artist] = ()
) -> Figure:
    """Return a figure of `width` by `height` [in] with space for panels between title and legend, and a caption."""
    figure = _Picture(figsize=(width, height), dpi=DPI)
    FigureCanvasAgg(figure)
    left = _MARGIN / width
    figure.text(left, 1.0 - _MARGIN / height, title, va="top", fontsize=12.0, fontweight="bold")
    above = _MARGIN + 0.25
    if legend:
        figure.legend(
            handles=list(legend), loc="upper left", bbox_to_anchor=(left, 1.0 - above / height), ncols=len(legend),
            borderaxespad=0.0, borderpad=0.2, handlelength=3.0,
        )  # fmt: skip
        above += 0.3
    lines = [line for text in caption.splitlines() for line in textwrap.wrap(text, round(_CAPTION_CHARACTERS * width))]
    figure.text(left, _MARGIN / height, "\n".join(lines), va="bottom", fontsize=8.2, color=_GREY, linespacing=1.3)
    below = _MARGIN + 0.16 * len(lines) + 0.02
    figure.set_layout_engine(ConstrainedLayoutEngine(rect=(0.0, below / height, 1.0, 1.0 - (above + below) / height)))
    return figure


def dress(axes: Axes, title: str, quantity: str, unit: str, time: Floats | None = None) -> None:
    """Set a panel's title, its y label with unit and, for curves over time, the limits of the x axis.

    Very small or large values get a prefixed unit, or a power of ten in the label. If values are constant, the axis
    starts at 0. A logarithmic axis covers three to nine whole decades.
    """
    axes.set_title(title)
    low, high = axes.dataLim.intervaly
    largest = float(max(abs(low), abs(high)))
    if axes.get_yscale() == "log":
        top = math.ceil(math.log10(high))
        bottom = math.floor(math.log10(max(low, 1e-8 * high)))
        axes.set_ylim(10.0 ** min(bottom, top - 3), 10.0**top)
    else:
        if high - low < 1e-6 * largest < math.inf:
            axes.set_ylim(min(0.0, 1.1 * low), max(0.0, 1.1 * high))
        unit = fit_axis(axes.yaxis, unit, largest)
    axes.set_ylabel(" ".join(part for part in (quantity, f"[{unit}]" if unit else "") if part))
    if time is not None and len(time) and time[-1] > time[0]:
        axes.set_xlim(float(time[0]), float(time[-1]))


def fit_axis(axis: Axis, unit: str, largest: float) -> str:
    """Scale a linear axis to a suitable unit for values up to `largest`, and return the unit."""
    fit, exponent = fitted(unit, largest)
    formatter = ScalarFormatter(useOffset=False)
    formatter.set_scientific(exponent != 0)
    if exponent:
        formatter.set_powerlimits((exponent, exponent))
    axis.set_major_formatter(formatter)
    axis.get_offset_text().set_visible(False)
    return spaced(fit) if fit or not exponent else rf"$10^{{{exponent}}}$ {spaced(unit)}".strip()


def label_time(panels: Sequence[Axes], columns: int) -> None:
    """Label times and "Time [s]" only below the lowest panel of each column. `panels` are in order of rows."""
    for axes in panels[:-columns]:
        axes.tick_params(labelbottom=False)
    for axes in panels[-columns:]:
        axes.set_xlabel("Time [s]")


def legend_beside(axes: Axes, handles: Sequence[Artist]) -> None:
    """Put a legend to the right of a panel, in columns of 14 entries."""
    axes.legend(
        handles=list(handles), loc="upper left", bbox_to_anchor=(1.01, 1.0), ncols=math.ceil(len(handles) / 14),
        borderaxespad=0.0, handlelength=1.8,
    )  # fmt: skip


def joint_look(i: int) -> dict[str, Any]:
    """Return colour and dashes of joint `i`, from 0, the same in every panel."""
    return {"color": COLORS[i % len(COLORS)], "linestyle": DASHES[i // len(COLORS) % len(DASHES)]}


def joint_handles(joints: Sequence[int]) -> list[Line2D]:
    """Return the entries of a legend of joints."""
    return [Line2D([], [], label=f"Joint {i + 1}", **joint_look(i)) for i in joints]


def curve(axes: Axes, time: Floats, values: Floats, **look: Any) -> Line2D:
    """Draw one thinned curve."""
    return axes.plot(*thin(time, values), **look)[0]


def thin(time: Floats, values: Floats) -> tuple[Floats, Floats]:
    """Thin more than 2000 points to the first, the last, and the extremes of 1000 equal intervals."""
    rows = extremes(values, 1000) if len(values) > 2000 else slice(None)
    return time[rows], values[rows]


class _Picture(Figure):
    """A figure that notebooks show without pyplot. Drawing makes the ticks, so it sets the `look` again."""

    look: dict[str, Any] = _RC

    def _repr_png_(self) -> bytes:
        stream = io.BytesIO()
        with matplotlib.style.context(["default", self.look]):
            _png(self, stream)
        return stream.getvalue()


def save(figure: Figure, path: Path) -> Path:
    """Write a figure as PNG, SVG or PDF by its suffix, and make its folder. The bytes are reproducible.

    UsageError for other suffixes; UsageError or VdfmuError if the file cannot be written.
    """
    write = _WRITERS.get(path.suffix.lower())
    if write is None:
        raise UsageError(f"{path}: expected a picture {', '.join(_WRITERS)}, got {path.suffix or 'no suffix'}.")
    stream = io.BytesIO()
    with matplotlib.style.context(["default", getattr(figure, "look", _RC)]):
        write(figure, stream)
    with contextlib.suppress(OSError):  # the write reports it
        path.parent.mkdir(parents=True, exist_ok=True)
    write_whole(path, [stream.getvalue()])
    return path


def _png(figure: Figure, stream: io.BytesIO) -> None:
    # savefig would draw everything twice; RGB, since figures are opaque
    canvas = FigureCanvasAgg(figure)
    canvas.draw()
    image = Image.fromarray(np.asarray(canvas.buffer_rgba()))
    image.convert("RGB").save(stream, "png", compress_level=3, dpi=(figure.dpi, figure.dpi))


_WRITERS: dict[str, Callable[[Figure, io.BytesIO], None]] = {
    ".png": _png,
    ".svg": functools.partial(Figure.savefig, format="svg", metadata={"Date": None}),
    ".pdf": functools.partial(Figure.savefig, format="pdf", metadata={"CreationDate": None}),
}
