"""A joint without gravity and friction."""

from vdfmu.arm.robot import Robot, load_robot, robot_from_dict

ONE = load_robot("planar_2dof").to_dict()


def one_joint() -> Robot:
    """Return a joint without gravity and friction, on a linear spring."""
    data = ONE | {"gravity": [0.0, 0.0, 0.0], "joints": ONE["joints"][:1], "sources": {}}
    robot = robot_from_dict(data)
    still = dict.fromkeys(("f_c", "f_s", "f_v"), 0.0)
    return robot.with_parameters(c_f=1e-9, c_w=1e-9, **still)
