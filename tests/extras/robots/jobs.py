"""Commands that hostile surroundings are tried with."""

from pathlib import Path

from tests.hostile.jobs import Job


def _urdf(folder: Path) -> None:
    """Write an arm of two joints, and a file of an arm that was imported before."""
    links = "".join(
        f'<link name="l{i}"><inertial><origin xyz="0 0 0.2"/><mass value="2"/><inertia ixx="0.1" iyy="0.1" izz="0.01" '
        f'ixy="0" ixz="0" iyz="0"/></inertial></link><joint name="j{i}" type="revolute"><parent link="l{i - 1}"/>'
        f'<child link="l{i}"/><axis xyz="0 1 0"/><origin xyz="0 0 0.4"/>'
        '<limit lower="-2" upper="2" effort="50" velocity="2"/></joint>'
        for i in (1, 2)
    )
    (folder / "arm.urdf").write_text(f'<robot name="arm"><link name="l0"/>{links}</robot>')
    (folder / "arm.toml").write_text("# before\n")


JOBS = {
    "robot import": Job(("robot", "import", "arm.urdf", "--overwrite", "-o", "arm.toml"), (_urdf,)),
    "robot reach": Job(("robot", "reach", "planar_2dof", "--overwrite", "-o", "out/reach.toml")),
}
