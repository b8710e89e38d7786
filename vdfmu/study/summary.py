"""Numbers of a run: tracking and compensation errors, differences to the references, warnings."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
import numpy.typing as npt

from vdfmu.cosim.results import Results
from vdfmu.measure import unit_of
from vdfmu.model import Robot
from vdfmu.study.reference import REFERENCE_OF, Reference

__all__ = [
    "compare", "compare_statistics", "estimation_errors", "implied_gains", "power_bond", "sampling_warnings",
    "tracking_errors",
]  # fmt: skip

Floats = npt.NDArray[np.float64]

_SAMPLING_LIMIT = 0.5


def tracking_errors(results: Results, robot: Robot) -> dict[str, Any]:
    """Position errors in deg (mm for prismatic joints) and torque compensation errors link-side in N m (N).

    The compensation error is the control torque minus the feedforward torque that the controller added to, as the
    paper's Fig. 11(b): ``ell (tau - tau_m)``.
    """
    revolute = np.array([t == "revolute" for t in robot.joint_types])
    error = (results.array("trajectory.q_d") - results.array("plant.q")) * np.where(
        revolute, 180.0 / np.pi, 1e3
    )
    compensation = robot.ell * (results.array("controller.tau") - results.array("controller.tau_m"))
    return {
        "position_units": ["deg" if r else "mm" for r in revolute],
        "torque_units": [unit_of("torque", t) for t in robot.joint_types],
        "rms_position_error_deg": np.sqrt(np.mean(error**2, axis=0)).tolist(),
        "max_position_error_deg": np.max(np.abs(error), axis=0).tolist(),
        "rms_torque_compensation_error_nm": np.sqrt(np.mean(compensation**2, axis=0)).tolist(),
    }


def implied_gains(
    paper: Mapping[str, Any], robot: Robot, values: Mapping[str, Mapping[str, Any]]
) -> dict[str, Any]:
    """Position gains that the paper's errors imply, beside those of the run, link-side [N m/rad, N/m].

    Where the errors change slowly, the torque of Eq. (58) is ``K_p (q_d - q)``: its RMS value over that of the position
    error is K_p.

    Returns
    -------
    dict
        ``implied_gains``: ``K_p_paper`` and ``K_p``, for the joints that both lists of the paper have. Empty where the
        paper has not both, or an error of 0.
    """
    torque, position = (
        paper.get(key, ()) for key in ("rms_torque_compensation_error_nm", "rms_position_error_deg")
    )
    si = [np.pi / 180.0 if joint == "revolute" else 1e-3 for joint in robot.joint_types]
    joints = range(min(len(torque), len(position)))
    if not joints or not all(position[i] for i in joints):
        return {}
    return {
        "implied_gains": {
            "K_p_paper": [torque[i] / (position[i] * si[i]) for i in joints],
            "K_p": [values["controller"][f"K_p[{i + 1}]"] for i in joints],
        }
    }


def compare(results: Results, reference: Reference, robot: Robot) -> dict[str, Any]:
    """Largest absolute differences of link positions [rad or m] and control torques, link-side [N m or N]."""
    position = np.abs(results.array("plant.q") - reference.array("plant.q"))
    torque = np.abs(robot.ell * (results.array("controller.tau") - reference.array("controller.tau")))
    return {
        "name": reference.name,
        "max_position_difference_rad": float(position.max()),
        "max_torque_difference_nm": float(torque.max()),
        "at_s": float(results.time[position.max(axis=1).argmax()]),
    }


def compare_statistics(results: Results, reference: Reference) -> dict[str, float]:
    """Largest relative differences of a joint between the RMS errors of a run and of its reference.

    For loops whose single solutions separate, see `vdfmu.study.run`. Errors as in :func:`tracking_errors`.
    """
    q_d, tau_m = results.array("trajectory.q_d"), reference.array("feedforward.tau_m")
    if reference.name == "sampled-delayed":  # the controller added to the feedforward of one step ago
        tau_m = np.vstack([tau_m[:1], tau_m[:-1]])

    def difference(ours: Floats, theirs: Floats) -> float:
        a, b = (np.sqrt(np.mean(error**2, axis=0)) for error in (ours, theirs))
        return float((np.abs(a - b) / np.maximum(b, np.finfo(float).tiny)).max())

    ours = results.array("controller.tau") - results.array("controller.tau_m")
    return {
        "rms_position_difference": difference(
            q_d - results.array("plant.q"), q_d - reference.array("plant.q")
        ),
        "rms_torque_difference": difference(ours, reference.array("controller.tau") - tau_m),
    }


def estimation_errors(results: Results, master: str) -> dict[str, Any]:
    """RMS of the spring torque and of the estimates' errors, link-side [N m or N].

    A sampled master gives the estimator the plant's signals of the communication point at which its step began, and
    the torque that the step that ended there had.
    """
    late = int(master in REFERENCE_OF)
    true = results.array("plant.tau_s")[: len(results.time) - late]

    def rms(values: Any) -> list[float]:
        return np.sqrt(np.mean(values**2, axis=0)).tolist()

    return {"rms_spring_torque_nm": rms(true)} | {
        f"rms_{name}_error_nm": rms(results.array(f"estimator.{name}")[late:] - true)
        for name in ("tau_f_hat", "tau_s_hat")
    }


def power_bond(results: Results, robot: Robot) -> dict[str, Any]:
    """Energy residual of the coupling at tau and kappa_dot, link-side [J]; printed is the sum of its absolute values.

    Torque and rotor velocity carry power from controller to plant. The plant takes up ``ell tau_in kappa_dot`` with the
    torque that it was given, the controller gives ``ell tau kappa_dot_in`` with the velocity that it was given; with
    exact coupling the two are the same. Each step begins with inputs that are the outputs they read, so the difference
    grows from zero over it, and half of that at the end times the step is the energy that the coupling adds to the
    plant or takes from it (trapezoidal rule). Under error control, which steps between the rows, an estimate.

    Returns
    -------
    dict
        ``power_bond``: for each joint ``residual_energy_j``, the sum over the rows; ``residual_energy_abs_j``, the sum
        of the absolute values; ``exchanged_energy_j``, the same of the energy that the plant took up. Empty where the
        inputs were not recorded, as those inside a container are not.
    """
    needed = ("controller.kappa_dot[1]", "plant.tau[1]")
    if any(name not in results for name in needed):
        return {}
    h = np.diff(results.time)[:, None]
    taken = (robot.ell * results.array("plant.tau") * results.array("plant.kappa_dot"))[1:]
    given = (robot.ell * results.array("controller.tau") * results.array("controller.kappa_dot"))[1:]
    residual = 0.5 * h * (taken - given)
    return {
        "power_bond": {
            "residual_energy_j": residual.sum(axis=0).tolist(),
            "residual_energy_abs_j": np.abs(residual).sum(axis=0).tolist(),
            "exchanged_energy_j": np.abs(h * taken).sum(axis=0).tolist(),
        }
    }


def sampling_warnings(values: Mapping[str, Mapping[str, Any]], robot: Robot, step: float | None) -> list[str]:
    """Warnings on gains that destabilise the sampled loop; `step` None: none does."""
    controller, plant = values["controller"], values["plant"]
    warnings: list[str] = []
    for i in range(1, robot.n + 1) if step is not None else ():
        number = controller[f"K_v[{i}]"] * step / (controller[f"ell[{i}]"] * plant[f"I_m[{i}]"])
        if number > _SAMPLING_LIMIT:
            warnings.append(
                f"Joint {i}: K_v*step/(ell*I_m) = {number:.2g} is above {_SAMPLING_LIMIT}: the sampled loop may be "
                f"unstable. Lower controller.K_v[{i}] or the step."
            )
    if controller["velocity"] == 1:
        warnings.append(
            "controller.velocity = q_dot: the derivative acts across the spring (non-collocated) and is "
            "unstable at the usual gains. kappa_dot is the default."
        )
    return warnings
