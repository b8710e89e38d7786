"""A log for `vdfmu identify`, from a record of the public repository.

    python examples/kr300/log.py data.mat c.csv

data.mat is in a folder of data/recorded_trajectories of JonasWeigand/Robot_Identification. Its positions count in
degrees from the start of the record, at 0, -90, 90, 0, 0, 0 degrees as KUKA counts, which are added. Axes 4 to 6 have
no encoder behind the gear.
"""

from argparse import ArgumentParser, RawDescriptionHelpFormatter

import numpy as np
from scipy.io import loadmat

START = np.array([0.0, -90.0, 90.0, 0.0, 0.0, 0.0])
"""Pose at the start of a record [deg]."""
GIVES_WAY = 5.0
"""Difference from it that the feedforward of the record may have [deg]: it lets axis 5 give way by 2.9."""


def main(file, out):
    """Write the log; the exit code is 2 for a record that starts at another pose."""
    data = loadmat(file, squeeze_me=True, struct_as_record=False)
    rec = data["rec"]
    if "ref_dyn" in data:
        motors = np.rad2deg(data["ref_dyn"].phi_r_m_all[0] / data["para"].u)
        if np.abs(motors - START).max() > GIVES_WAY:
            raise SystemExit(f"{file}: expected a start at {START} deg, got {motors.round(1)} deg.")
    columns = {
        "kappa[{}] [deg]": rec.act_pos_mot_deg.T + START,
        "q[{}] [deg]": rec.act_pos_se_deg.T[:, :3] + START[:3],
        "tau[{}] [N.m]": rec.act_torque_abs_nm.T,
    }
    heads = ["time", *(name.format(i) for name, rows in columns.items() for i in range(1, 1 + rows.shape[1]))]
    table = np.column_stack([np.asarray(rec.time_cont, float), *columns.values()])
    np.savetxt(out, table, delimiter=",", header=",".join(heads), comments="", fmt="%.17g")


if __name__ == "__main__":
    parser = ArgumentParser(description=__doc__, formatter_class=RawDescriptionHelpFormatter)
    parser.add_argument("file")
    parser.add_argument("out")
    main(**vars(parser.parse_args()))
