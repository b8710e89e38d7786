"""The summary of a run of a scenario of the paper."""

from typing import Any

TRACKING: dict[str, Any] = {
    "scenario": "two_joint", "robot": "manipulator_6dof", "friction": "lumped", "backend": "python",
    "algorithm": "gauss-seidel", "step": 0.001, "stop": 30.0, "tolerance": 1e-7, "steps": 30000, "wall_s": 6.774,
    "real_time_factor": 4.4287, "position_units": ["deg"] * 3, "torque_units": ["N.m"] * 3,
    "rms_position_error_deg": [4.55149e-3, 1.22387e-2, 1.59958e-8],
    "max_position_error_deg": [5.01096e-3, 1.36230e-2, 2.57374e-8],
    "rms_torque_compensation_error_nm": [1.58905e-1, 4.27694e-1, 2.83864e-7],
    "paper": {
        "source": "Table 5, joints 1 and 2", "rms_position_error_deg": [0.0456, 0.0227],
        "max_position_error_deg": [0.2, 0.2], "rms_torque_compensation_error_nm": [0.1173, 0.2981],
    },
    "reference": {
        name: {"name": full, "max_position_difference_rad": position, "max_torque_difference_nm": torque}
        for name, full, position, torque in (
            ("sampled", "sampled-delayed", 1.234e-8, 5.678e-5), ("continuous", "continuous", 3.2e-6, 2.3e-2),
        )
    },
    "warnings": ["Joint 1: K_v*step is [bold]above[/bold] 0.5."], "parameters": {"controller.K_p[1]": "1500"},
}  # fmt: skip
