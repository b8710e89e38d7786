"""Runs a program in GALEC: statement by statement it becomes one of Python, without any knowledge of what wrote it."""

import math
import re
from collections.abc import Callable
from typing import Any

import numpy as np

from tests.extras.efmi.efmu import Efmu, Rows


class Vector(list[Any]):
    """An array, counted from 1."""

    def __getitem__(self, place: Any) -> Any:
        return super().__getitem__(place - 1)

    def __setitem__(self, place: Any, value: Any) -> None:
        super().__setitem__(place - 1, value)


def _conditional(condition: Any, then: float, other: float) -> float:
    return then if condition else other


def _copied(value: Any) -> Any:
    return Vector(value) if isinstance(value, Vector) else value


FUNCTIONS: dict[str, Callable[..., Any]] = {
    **{name: getattr(math, name) for name in "sqrt exp sin cos tan asin acos atan atan2 sinh cosh tanh".split()},
    "real": float, "sign": lambda x: float(np.sign(x)), "absolute": abs, "ln": math.log,
    "min": lambda a, b: float(np.fmin(a, b)), "max": lambda a, b: float(np.fmax(a, b)),
    "roundDown": np.floor, "roundUp": np.ceil, "realRemainderTowardsZero": math.fmod, "isFinite": math.isfinite,
    "Vector": Vector, "conditional": _conditional, "copied": _copied,
}  # fmt: skip


class Program:
    """A program and its variables."""

    def __init__(self, efmu: Efmu) -> None:
        self.efmu, self.signals = efmu, set[str]()
        self.variables: dict[str, Any] = {}
        for kind, name, size in re.findall(r"^    (?:\w+ )?(Real|Integer|Boolean) ('[^']+'|\w+)(?:\[(\d+)\])?;$",
                                           efmu.program, re.MULTILINE):  # fmt: skip
            zero = {"Real": 0.0, "Integer": 0, "Boolean": False}[kind]
            self.variables[name] = Vector([zero] * int(size)) if size else zero
        self._methods = {
            name: compile(
                python_of(re.search(rf"method {name}\n(.*?)end {name};", efmu.program, re.S)[1]), name, "exec"
            )  # type: ignore[index]
            for name in ("Startup", "Recalibrate", "DoStep")
        }

    def call(self, method: str) -> set[str]:
        """Call a method; return the error signals."""
        self.signals.clear()
        local = FUNCTIONS | {"V": self.variables, "signals": self.signals}
        with np.errstate(all="ignore"):
            exec(self._methods[method], local)
        return self.signals

    def run(self, inputs: Rows, steps: int) -> Rows:
        """Return the outputs of each step, for the inputs of each."""
        self.call("Startup")
        outputs = self.efmu.names("output")
        series: dict[str, list[Any]] = {name: [] for name in outputs}
        for k in range(steps):
            for name, values in inputs.items():
                numbers = np.ravel(values[k]).tolist()
                self.variables[name] = Vector(numbers) if self.efmu.is_array(name) else numbers[0]
            assert not self.call("DoStep")
            for name in outputs:
                series[name].append(np.array(self.variables[name], dtype=float, ndmin=1))
        return {name: np.array(values) for name, values in series.items()}


def python_of(text: str) -> str:
    lines, depth = ["pass"], 0
    text = re.sub(r"\(if (.*?) then (.*?) else (.*)\);", r"conditional(\1, \2, \3);", text.partition("algorithm\n")[2])
    statements = re.split(r"(?<=;)|(?<=\bthen)\s|(?<=\bloop)\s", text)
    for statement in filter(None, (s.strip().rstrip(";") for s in statements)):
        if statement in ("end if", "end for"):
            depth -= 1
            continue
        line = re.sub(r"self\.('[^']+'|\w+)", lambda m: f"V[{m[1]!r}]", statement)
        line = re.sub(r":= (V\['.*?'\]|V\[\".*?\"\])$", r":= copied(\1)", line)  # arrays are values
        line = re.sub(r"\{(.*)\}", r"Vector([\1])", line)
        line = line.replace(":=", "=").replace("<>", "!=").replace("^", "**")
        line = re.sub(r"\btrue\b", "True", re.sub(r"\bfalse\b", "False", line))
        line = re.sub(r"^signal (\w+)$", r'signals.add("\1")', line)
        line = re.sub(r"^for i in (.*):(.*) loop$", r"for i in range(\1, \2 + 1):", re.sub(r" then$", ":", line))
        lines.append("    " * depth + line)
        depth += line.endswith(":")
    return "\n".join(lines)
