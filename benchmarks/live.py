"""What a live view costs the run that it shows."""

from __future__ import annotations

import statistics
import subprocess
import sys
import time

import vdfmu
from benchmarks.report import Report, Table
from benchmarks.system import packed
from vdfmu.compiler.c.compile import native_available
from vdfmu.engine.masters.observer import Observer
from vdfmu.study.report.content import arm_of
from vdfmu.system.scenario import load_scenario

TITLE = "What a live view costs the run that it shows"
_CLIENT = """
import sys, viser
from websockets.sync.client import connect
with connect(sys.argv[1], subprotocols=["viser-v" + viser.__version__], max_size=None) as socket:
    print("open", flush=True)
    for message in socket:
        pass
"""
"""Takes all that a browser would be sent, and does nothing with it."""


def run(report: Report, quick: bool) -> None:
    """Time the steps of the tracking run without a view, with one, and with one that a client looks at, in turns."""
    if not native_available():
        report.say("live: left out, since it needs the compiler of native FMUs.")
        return
    scenario = load_scenario("tracking")
    stop, rounds = (10.0, 5) if quick else (100.0, 15)
    with (
        packed(scenario, "native") as package,
        vdfmu.LiveView(arm=arm_of(scenario.arm, {}), say=report.say) as alone,
        vdfmu.LiveView(arm=arm_of(scenario.arm, {}), say=report.say) as watched,
        vdfmu.Simulator(package) as simulator,
    ):
        address = watched.address.replace("http", "ws")
        client = subprocess.Popen([sys.executable, "-c", _CLIENT, address], stdout=subprocess.PIPE)
        try:
            assert client.stdout is not None
            client.stdout.readline()
            cases: dict[str, Observer | None] = {
                "no view": None, "a view": alone, "a view and a client": watched,
            }  # fmt: skip
            walls: dict[str, list[float]] = {name: [] for name in cases}
            processor: dict[str, list[float]] = {name: [] for name in cases}
            for _ in range(rounds):
                for name, observer in cases.items():
                    began = time.process_time()
                    results = simulator.run(stop=stop, step=1e-3, observer=observer)
                    processor[name].append(time.process_time() - began)
                    walls[name].append(results.summary["wall_s"])
        finally:
            client.kill()
            client.wait()
    table = Table(
        "live",
        f"The tracking run to {stop:g} s, native FMUs, {rounds} rounds in turns",
        [
            ("run", ""),
            ("processor [s]", ".3f"),
            ("more [%]", ".1f"),
            ("steps, wall [s]", ".3f"),
            ("more [%]", ".1f"),
        ],
        notes=["Processor time is that of the process that runs; more is the median of the rounds."],
    )
    for name in cases:
        row: list[float] = []
        for times in (processor, walls):
            ratio = statistics.median(a / b for a, b in zip(times[name], times["no view"], strict=True))
            row += [min(times[name]), 100.0 * (ratio - 1.0)]
        table.add(name, *row)
        report.facts[name] = dict(
            zip(("processor_s", "processor_more", "wall_s", "wall_more"), row, strict=True)
        )
    report.show(table)
