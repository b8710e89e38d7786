"""The KR 300 compared with its records: tables, figures and pages with measured and simulated curves, and both arms.

    python examples/kr300/compare.py
    python examples/kr300/compare.py results/no_integrator controller.f_n=0

The robot and the time constants of its controller were fitted to record A. Nothing was fitted to record B, so it tests
the prediction. A wrong robot runs under the same controller: half the masses, half the friction, springs ten times as
stiff. A number that both robots predict equally well does not test the arm. The records in Parquet need pyarrow. They
are corrected for torque offsets and for the delay of the encoders behind the gears, as `vdfmu identify` finds them in
A, and for the constant difference between the encoders of each axis, which count from their start. Axes 4 to 6 have no
encoders behind their gears, so the motor's position is shown.
"""

from argparse import ArgumentParser, RawDescriptionHelpFormatter
from pathlib import Path

import numpy as np
from matplotlib.lines import Line2D
from scipy.signal import butter, sosfiltfilt

import vdfmu
from vdfmu import Results
from vdfmu.base.option import read_settings
from vdfmu.engine.results.results import Signal
from vdfmu.extras.identify.fit import identify
from vdfmu.extras.identify.log import read_log
from vdfmu.extras.pictures import style
from vdfmu.study.report.page import write_report
from vdfmu.study.report.shown_run import ShownRun

HERE = Path(__file__).parent
MOVES = 0.02
"""Lowest speed [rad/s] of the reference of a moving axis."""
FILE_LAW = {"controller.f_n": 0.0, "controller.T": 1e-4, "controller.T_q": 0.0, "controller.K_p": 572.958}
"""The law of the public repository."""


def wrong_arm(robot):
    """Return the robot with half the masses, half the friction and springs ten times as stiff."""
    half = {name: 0.5 * getattr(robot, name) for name in ("mass", "inertia", "f_c", "f_s", "f_v")}
    return robot.with_parameters(**half, **{name: 10.0 * getattr(robot, name) for name in ("K_f0", "K_w0")})


def simulated(name, robot, **options):
    """Run the scenario with the reference and the commands of a record."""
    trajectory = vdfmu.load_motion(HERE / f"{name}_reference.csv", robot).unit()
    inputs = HERE / f"{name}_command.csv"
    return vdfmu.run("kr300", robot=robot, inputs=inputs, units={"trajectory": trajectory}, reference=False, **options)


def corrections(robot):
    """Return torque offsets (6,) [N.m] and delays of the encoders behind the gears (6,) [s], identified from A."""
    identified = identify(read_log(HERE / "a.parquet", robot), vdfmu.load_robot(HERE / "nominal.toml"))
    values = dict(zip(identified.names, identified.values, strict=True))
    return [[values.get(f"{name}[{i}]", 0.0) for i in range(1, 7)] for name in ("tau_0", "delay_q")]


def measured(name, robot, run, constants, delays):
    """Return times of a record, and the signals of the run, and of the record, at these."""
    log = read_log(HERE / f"{name}.parquet", robot)
    rows = np.searchsorted(run.time, log.t - 1e-9)
    here = {key: run[key][rows] for key in ("trajectory.q_d", "plant.q", "plant.kappa", "controller.tau")}
    late = np.stack([np.interp(log.t + d, log.t, q) for d, q in zip(delays, log.q.T, strict=True)], axis=1)
    seen = np.isfinite(log.q).all(axis=0)
    q = np.where(seen, late, log.kappa)
    here["plant.q"] = np.where(seen, here["plant.q"], here["plant.kappa"])
    between = np.mean(log.kappa - q - here["plant.kappa"] + here["plant.q"], axis=0)
    there = {
        "trajectory.q_d": here["trajectory.q_d"],
        "plant.q": q,
        "plant.kappa": log.kappa - np.where(seen, between, 0.0),
        "controller.tau": log.tau - constants,
    }
    return log.t, here, there


def results_of(time, signals, summary):
    """Return results with signals (m, 6)."""
    units = {"controller.tau": "N.m"}
    listed = [(f"{key}[{i}]", units.get(key, "rad")) for key in signals for i in range(1, 7)]
    rows = [Signal(name, "real", unit, column) for column, (name, unit) in enumerate(listed)]
    return Results(time, rows, {"real": np.hstack(list(signals.values()))}, summary)


def rms(values):
    """Return root mean squares of columns."""
    return np.sqrt(np.mean(values**2, axis=0))


def errors(here, there):
    """Return tracking errors, torques and deflections: simulated and measured (m, 6)."""
    rows = [(s["trajectory.q_d"] - s["plant.q"], s["controller.tau"], s["plant.kappa"] - s["plant.q"])
            for s in (here, there)]  # fmt: skip
    return list(zip(*rows, strict=True))


def table(name, arm, wrong, file):
    """Print measured values, predictions, and residuals of the arm and the wrong arm; *moving*: below 20 Hz, in motion.

    Arms and file's law are pairs of simulated and measured signals.
    """
    (e, e_there), (tau, tau_there), (bent, bent_there) = errors(*arm)
    (e_wrong, _), (tau_wrong, _), (bent_wrong, bent_there_wrong) = errors(*wrong)
    (e_file, _), *_ = errors(*file)
    bends = 1e6 * np.stack([rms(bent_there - bent_there.mean(axis=0)), rms(bent - bent_there),
                            rms(bent_wrong - bent_there_wrong)])  # fmt: skip
    slow = sosfiltfilt(butter(4, 20.0, fs=250.0, output="sos"), tau_there - tau, axis=0)
    moves = np.abs(np.gradient(arm[0]["trajectory.q_d"], 0.004, axis=0)) > MOVES
    print(
        f"{name}       tracking error, RMS [mrad]  residual, %    torque, residual, %     deflection, residual [urad]"
    )
    print("axis measured     arm   wrong    file    arm  wrong  [N.m]    arm  wrong moving   measured    arm  wrong")
    for i in range(6):
        line = f"{i + 1:4}" + "".join(f"{1e3 * rms(each)[i]:8.3f}" for each in (e_there, e, e_wrong, e_file))
        line += "".join(f"{100 * rms(each - e_there)[i] / rms(e_there)[i]:7.1f}" for each in (e, e_wrong))
        line += f"{rms(tau_there)[i]:7.2f}"
        line += "".join(f"{100 * rms(each - tau_there)[i] / rms(tau_there)[i]:7.1f}" for each in (tau, tau_wrong))
        line += f"{100 * rms(slow[moves[:, i], i]) / rms(tau_there[moves[:, i], i]):7.1f}"
        print(line + ("{:11.0f}{:7.0f}{:7.0f}".format(*bends[:, i]) if i < 3 else ""))


@style.styled
def draw(path, name, time, here, there):
    """Draw tracking errors, torques and deflections, measured and simulated."""
    quantities = (("Tracking error", "rad"), ("Torque", "N.m"), ("Deflection", "rad"))
    measured, simulated = ({"color": style.COLORS[k], "linewidth": width} for k, width in ((1, 0.7), (0, 1.2)))
    looks = {"measured": measured, "simulated": simulated}
    handles = [Line2D([], [], label=label, **look) for label, look in looks.items()]
    figure = style.new_figure(f"KUKA KR 300, record {name}", "", width=17.0, height=7.4, legend=handles)
    for row, ((quantity, unit), (run, record)) in enumerate(zip(quantities, errors(here, there), strict=True)):
        for i in range(3 if quantity == "Deflection" else 6):
            panel = figure.add_subplot(3, 6, 6 * row + i + 1)
            for values, look in zip((record, run), looks.values(), strict=True):
                style.curve(panel, time, values[:, i], **look)
            style.dress(panel, f"Axis {i + 1}", quantity if i == 0 else "", unit, time)
            if row == 2 or (i > 2 and row == 1):  # the last of its column
                panel.set_xlabel("Time [s]")
    style.save(figure, Path(path))


def main(folder, *changes):
    """Compare both records; `changes`: controller.f_n=0 and so on."""
    settings = read_settings(changes, "changes", "COMPONENT.VARIABLE=VALUE")
    robot = vdfmu.load_robot("kr300_6dof")
    constants, delays = corrections(robot)
    folder = Path(folder)
    for name in ("a", "b"):
        run = simulated(name, robot, out=folder / f"kr300_{name}", overwrite=True, parameters=settings)
        variants = (wrong_arm(robot), settings), (robot, FILE_LAW)
        runs = run, *(simulated(name, arm, out=False, parameters=changed) for arm, changed in variants)
        compared = [measured(name, robot, each, constants, delays) for each in runs]
        table(name.upper(), *(each[1:] for each in compared))
        time, here, there = compared[0]
        draw(folder / f"kr300_{name}.png", name.upper(), time, here, there)
        facts = {key: run.summary[key] for key in ("robot", "joints", "arm", "vdfmu")}
        shown = [
            ShownRun("simulated", run, run.summary | {"scenario": "simulated"}, folder / f"kr300_{name}/system.ssp"),
            ShownRun("measured", results_of(time, there, {}), facts, Path()),
        ]
        write_report(shown, folder / f"kr300_{name}.html")
    print(f"Written to {folder}: kr300_a.html, kr300_a.png, kr300_b.html, kr300_b.png")


if __name__ == "__main__":
    parser = ArgumentParser(description=__doc__, formatter_class=RawDescriptionHelpFormatter)
    parser.add_argument("folder", nargs="?", default="results")
    parser.add_argument("changes", nargs="*", help="controller.f_n=0 and so on")
    options = parser.parse_args()
    main(options.folder, *options.changes)
