"""A package adds a reader of logs: that of ``docs/plugins.md``."""

import numpy as np
import pytest

import vdfmu
from tests.added import command, write_acme
from tests.extras.identify.recorded import T, motion


@pytest.mark.heavy
def test_a_log_is_identified(tmp_path):
    acme = write_acme(tmp_path / "acme")
    kappa, q, tau = motion(vdfmu.load_robot("planar_2dof"), T)
    table = np.hstack([T[:, None], q, kappa, tau])
    table.tofile(tmp_path / "log.blog")
    names = "t [s],q[1] [rad],q[2] [rad],kappa[1] [rad],kappa[2] [rad],tau[1] [N.m],tau[2] [N.m]"
    np.savetxt(tmp_path / "log.csv", table, delimiter=",", header=names, comments="", fmt="%.17g")
    blog, csv = (command(tmp_path, acme, "identify", name, "--robot", "acme_2") for name in ("log.blog", "log.csv"))
    assert blog.returncode == 0, blog.stderr
    assert "I_m[1]" in blog.stdout
    assert blog.stdout == csv.stdout  # the same numbers, to the bit, in another file
