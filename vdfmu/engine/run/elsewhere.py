"""The hook by which components run elsewhere, on other machines say: what `Simulator` asks of a federation."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any, Protocol

from vdfmu.base.errors import CosimError
from vdfmu.engine.fmu.messages import MessageBox
from vdfmu.engine.masters.exchange import Exchange
from vdfmu.engine.plan.checked import Checked
from vdfmu.engine.run.isolated import Limits


class Elsewhere(Protocol):
    """Components of a run and their stepper; for the methods see `vdfmu.engine.run.isolated.Isolated`."""

    exchange: Exchange

    @property
    def pressed(self) -> Callable[[], bool]: ...  # noqa: D102
    @pressed.setter
    def pressed(self, asked: Callable[[], bool]) -> None: ...
    def load(self) -> None: ...  # noqa: D102
    def initialize(self, *arguments: Any) -> None: ...  # noqa: D102
    def couple(self, *arguments: Any) -> Elsewhere: ...  # noqa: D102
    def advance(self, time: float, step: float, stop: float) -> None: ...  # noqa: D102
    def facts(self) -> dict[str, Any]: ...  # noqa: D102
    def notes(self) -> list[str]: ...  # noqa: D102
    def close(self) -> CosimError | None: ...  # noqa: D102


Making = Callable[[Checked, Mapping[str, Path], MessageBox, Path, Limits], Elsewhere]
"""Makes them from a checked system, the folders of its FMUs, the box for messages, a temporary folder and limits."""


class Division(Protocol):
    """Chooses the algorithm, given the wanted one, the components that run here, and what makes them.

    It is what `simulate`, `run_system` and `Simulator` take as `federation`: all that they know of running elsewhere.
    """

    def algorithm(self, wanted: str | None) -> str: ...  # noqa: D102
    def apart(self, checked: Checked) -> tuple[Checked, Making]: ...  # noqa: D102
