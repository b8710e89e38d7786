"""The equations of the units for people, as HTML; ``docs/model.md`` has them with their reasons."""

from __future__ import annotations

__all__ = ["EQUATIONS"]


def _equations(*rows: tuple[str, str]) -> str:
    lines = "\n".join(f"<tr><td>{formula}</td><td>{words}</td></tr>" for formula, words in rows)
    return f'<table class="equations">\n{lines}\n</table>'


_SYMBOLS = (
    "<p>Numbers in brackets are those of the paper. Link-side quantities are those of the joint, motor-side ones those "
    "of the rotor; ℓ is the reduction ratio. For a prismatic joint read m for rad and N for N.m on the link side. "
    "<i>q</i> is the position of a link, κ that of its rotor divided by ℓ, τ<sub>s</sub> the spring torque, "
    "link-side.</p>"
)

_BODY = _equations(
    (
        "V<sub>B</sub> = z q̇ + U<sub>AB</sub><sup>T</sup> V<sub>A</sub>",
        "velocities, from the base on, (29)-(31)",
    ),
    (
        "F*<sub>B</sub> = M<sub>B</sub> V̇<sub>B</sub> + C<sub>B</sub>(ω<sub>B</sub>) V<sub>B</sub> + G<sub>B</sub>",
        "net force of a link, (47), (59)-(62)",
    ),
    (
        "F<sub>B<sub>i</sub></sub> = F*<sub>B<sub>i</sub></sub> + U<sub>B<sub>i</sub>B<sub>i+1</sub></sub> "
        "F<sub>B<sub>i+1</sub></sub>, &nbsp; F<sub>B<sub>n+1</sub></sub> = F<sub>e</sub>, &nbsp; "
        "ID(q, q̇, q̈)<sub>i</sub> = z<sup>T</sup> F<sub>B<sub>i</sub></sub>",
        "forces, from the end effector back, (44)-(46)",
    ),
)

_DRIVE = _equations(
    (
        "D(τ) = atan(c<sub>f</sub> τ) / (c<sub>f</sub> K<sub>f0</sub>) + sgn(τ) (1 − e<sup>−c<sub>w</sub>|τ|/ℓ</sup>) "
        "/ (c<sub>w</sub> ℓ K<sub>w0</sub>)",
        "deformation of the harmonic drive, (2)-(3) solved for it",
    ),
    ("θ<sub>err</sub>(κ) = A sin(2 ℓ κ + φ)", "kinematic error, with A = theta_err_amplitude"),
    (
        "ξ(v) = [f<sub>c</sub> + (f<sub>s</sub> − f<sub>c</sub>) e<sup>−(v/v<sub>s</sub>)²</sup>] tanh(v/ε) + "
        "f<sub>v</sub> v",
        "friction, (54), with tanh for the sign",
    ),
    (
        "lumped: ξ<sub>l</sub> = 0, ξ<sub>m</sub> = ξ(κ̇)/ℓ; &nbsp; split: ξ<sub>l</sub> = ξ(q̇), ξ<sub>m</sub> = "
        "f<sub>cκ</sub> tanh(κ̇/ε)",
        "on the link and on the rotor, (54)-(55)",
    ),
)

EQUATIONS = {
    "trajectory": _equations(
        ("s = (t − t<sub>start</sub>) / T, limited to 0 .. 1", ""),
        (
            "q<sub>d</sub> = q<sub>start</sub> + (q<sub>end</sub> − q<sub>start</sub>) [s − sin(2πs) / 2π]",
            "(57), and its first four derivatives in time",
        ),
    )
    + "<p>The motion starts and ends at rest and is held before and after.</p>",
    "feedforward": _SYMBOLS
    + "<p>Mode 0, <code>inverse</code>: the exact inverse of the plant along the desired motion.</p>"
    + _equations(
        (
            "τ<sub>s</sub> = ID(q<sub>d</sub>, q̇<sub>d</sub>, q̈<sub>d</sub>, F<sub>e,d</sub>) + "
            "ξ<sub>l</sub>(q̇<sub>d</sub>)",
            "torque of the springs; the derivatives of the wrench F<sub>e,d</sub> are taken as zero",
        ),
        (
            "κ<sub>d</sub> = q<sub>d</sub> + D(τ<sub>s</sub>) + θ<sub>err</sub>(κ<sub>d</sub>)",
            "motion of the rotors; κ̇<sub>d</sub> is an output in both modes",
        ),
        (
            "τ<sub>m</sub> = I<sub>m</sub> κ̈<sub>d</sub> + τ<sub>s</sub>/ℓ + ξ<sub>m</sub>(κ̇<sub>d</sub>)",
            "torque of the motors, (27), (56)",
        ),
    )
    + "<p>Mode 1, <code>vdc</code>: virtual decomposition control, from the desired and the measured motion.</p>"
    + _equations(
        ("q̇<sub>r</sub> = q̇<sub>d</sub> + Λ (q<sub>d</sub> − q)", "required velocity, (12)"),
        ("κ̇<sub>r</sub> = q̇<sub>r</sub> + (κ̇<sub>d</sub> − q̇<sub>d</sub>)", "that of the rotors"),
        (
            "F*<sub>B,r</sub> = M<sub>B</sub> V̇<sub>B,r</sub> + C<sub>B</sub> V<sub>B,r</sub> + G<sub>B</sub> + "
            "K<sub>V</sub> (V<sub>B,r</sub> − V<sub>B</sub>)",
            "required net forces, (50)",
        ),
        (
            "τ<sub>t</sub> = (z<sup>T</sup> F<sub>B,r</sub> + ξ<sub>l</sub>) / ℓ + k<sub>vq</sub> (q̇<sub>r</sub> − q̇)",
            "(26)",
        ),
        (
            "τ<sub>m</sub> = τ<sub>t</sub> + k<sub>vκ</sub> (κ̇<sub>r</sub> − κ̇) + ξ<sub>m</sub> + I<sub>m</sub> "
            "κ̈<sub>r</sub>",
            "(27), (56)",
        ),
    )
    + "<p>In both, the dynamics of the links and the drives:</p>"
    + _BODY
    + _DRIVE,
    "controller": _SYMBOLS
    + _equations(
        (
            "τ<sub>e</sub> = K<sub>p</sub> (q<sub>d</sub> − q) + K<sub>v</sub> (v<sub>d</sub> − v)",
            "feedback, link-side, (58)",
        ),
        (
            "v<sub>d</sub> − v = κ̇<sub>d</sub> − κ̇ (velocity = 0), q̇<sub>d</sub> − q̇ (1) or q̇<sub>d</sub> − κ̇ (2)",
            "κ̇ is collocated with the motor; q̇<sub>d</sub> − q̇ is that of (58)",
        ),
        (
            "τ = τ<sub>m</sub> + τ<sub>e</sub>/ℓ, limited to −τ<sub>max</sub> .. τ<sub>max</sub>",
            "torque of the motors",
        ),
    )
    + "<p>With v = q̇ the derivative acts across the spring, and the loop is unstable at useful gains.</p>",
    "estimator": _SYMBOLS
    + _equations(
        ("δ = κ − q − θ<sub>err</sub>(κ)", "deformation of the drive, as measured"),
        (
            "τ̂<sub>f</sub> = tan(c<sub>f</sub> K<sub>f0</sub> [δ − δ<sub>w</sub>(τ)]) / c<sub>f</sub>, &nbsp; "
            "δ<sub>w</sub>(τ) = sgn(τ) (1 − e<sup>−c<sub>w</sub>|τ|</sup>) / (c<sub>w</sub> ℓ K<sub>w0</sub>)",
            "as printed, (2)-(3), with the motor's torque τ at the wave generator",
        ),
        ("D(τ̂<sub>s</sub>) = δ", "consistent: the wave generator carries τ̂<sub>s</sub>/ℓ"),
    )
    + "<p>Both are limited to ± tau_hat_max: a deformation beyond it, or beyond the pole of the tangent, gives the "
    "limit itself.</p>" + _DRIVE,
    "plant": _SYMBOLS
    + "<p>State: q, q̇, κ̇, τ<sub>s</sub>.</p>"
    + _equations(
        (
            "M(q) q̈ + C q̇ + G = τ<sub>s</sub> − ξ<sub>l</sub> − J<sub>q</sub><sup>T</sup> F<sub>e</sub>",
            "links, (9)",
        ),
        ("I<sub>m</sub> κ̈ = τ − τ<sub>s</sub>/ℓ − ξ<sub>m</sub>", "rotors, (10), (56)"),
        (
            "τ̇<sub>s</sub> = [κ̇ (1 − θ′<sub>err</sub>(κ)) − q̇] / D′(τ<sub>s</sub>)",
            "springs: κ = q + D(τ<sub>s</sub>) + θ<sub>err</sub>(κ), differentiated",
        ),
    )
    + _DRIVE
    + "<p>The links are solved by the articulated-body recursion on</p>"
    + _BODY
    + "<p>F<sub>e</sub> is the wrench that the arm exerts on its surroundings, in the frame of the end effector. The "
    "plant starts in static equilibrium under F<sub>e</sub> unless <code>equilibrium</code> is false. Its outputs "
    "depend on the state alone.</p>"
    + _equations(
        (
            "E<sub>kin</sub> = ½ Σ V<sub>B</sub><sup>T</sup> M<sub>B</sub> V<sub>B</sub> + ½ Σ I<sub>m</sub> ℓ κ̇²",
            "links and rotors",
        ),
        ("E<sub>pot</sub> = Σ m g<sup>T</sup> p<sub>com</sub>", "gravity"),
        ("E<sub>spring</sub> = Σ ∫ τ D′(τ) dτ, from 0 to τ<sub>s</sub>", "drives"),
    ),
}
"""Unit to the HTML of its equations."""
