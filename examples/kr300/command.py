"""Tables of the commands of the controller of the KR 300, from a record of the public repository.

    python examples/kr300/command.py data.mat a

data.mat is in a folder of data/recorded_trajectories of JonasWeigand/Robot_Identification; a.parquet in this folder has
the rest of that record. Written next to it: a_reference.csv, the recorded reference every 40 ms, and a_command.csv,
`ref_dyn.phi_r_m_all_d1`, speeds of the motors, divided by the ratios, and `tau_ff_all`, torques added to the torques at
the start, at as many of the record's times as lines between them need to be right.
"""

from argparse import ArgumentParser, RawDescriptionHelpFormatter
from pathlib import Path

import numpy as np
from scipy.io import loadmat

HERE = Path(__file__).parent
RIGHT = {"kappa_dot_d": 1e-3, "tau_ff": 0.02}
"""Errors of lines: rad/s and N.m."""


def knots(values, right):
    """Return rows such that lines between them are within `right` of all values (m, k) between."""
    rows, start, m = [0], 0, len(values)
    while start < m - 1:
        end = start + 1
        for last in range(start + 2, min(m, start + 150)):
            share = np.linspace(0.0, 1.0, last - start + 1)[:, None]
            line = values[start] + share * (values[last] - values[start])
            if (np.abs(line - values[start : last + 1]) > right).any():
                break
            end = last
        rows.append(end)
        start = end
    return rows


def write(path, time, columns):
    """Write columns, from name and unit to (m, 6), in addition to time."""
    heads = ["time", *(f"{name.format(i)}{unit}" for name, unit in columns for i in range(1, 7))]
    table = np.column_stack([time, *columns.values()])
    np.savetxt(path, table, delimiter=",", header=",".join(heads), comments="", fmt="%.6g")
    print(f"{path.name}: {len(table)} rows, {path.stat().st_size / 1e3:.0f} kB")


def main(file, record):
    """Write the tables of a record."""
    data = loadmat(file, squeeze_me=True, struct_as_record=False)
    time = np.asarray(data["rec"].time_cont, dtype=float)
    ratios = data["para"].u
    signals = {"kappa_dot_d": data["ref_dyn"].phi_r_m_all_d1 / ratios, "tau_ff": np.array(data["tau_ff_all"].T, float)}
    rows = knots(np.hstack([signals[key] / right for key, right in RIGHT.items()]), 1.0)
    units = {"kappa_dot_d": " [rad/s]", "tau_ff": " [N.m]"}
    columns = {(f"controller.{key}[{{}}]", units[key]): value[rows] for key, value in signals.items()}
    write(HERE / f"{record}_command.csv", time[rows], columns)
    pose = np.array([0, -90, 90, 0, 0, 0])  # degrees at the start, as KUKA counts
    reference = data["rec"].ref_pos_deg.T[::10] + pose
    write(HERE / f"{record}_reference.csv", time[::10], {("q{}", " [deg]"): reference})


if __name__ == "__main__":
    parser = ArgumentParser(description=__doc__, formatter_class=RawDescriptionHelpFormatter)
    parser.add_argument("file")
    parser.add_argument("record", choices=("a", "b"))
    main(**vars(parser.parse_args()))
