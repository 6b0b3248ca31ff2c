"""Figures 5a to 5c: the pendulum's gauges and angular velocity, and its damping laws."""

from __future__ import annotations

import numpy as np
import pandas as pd
from pendulum import pendulum

import beamdae as bd
from pan_liu_2012.axes import FIGURE_5A, FIGURE_5B, FIGURE_5C, fills
from pan_liu_2012.runs import (
    PAPER_SCHEME,
    SCHEME,
    WITNESS,
    observed,
    second_method,
    solved,
    span,
)

# The paper does not state its coefficients. Ours: drag of a flat strip (C_d = 2) of 0.03 m in air
# of 1.2 kg/m^3, c = C_d rho_air width / 2, and a damping ratio of 0.28 percent in the first bending
# mode (8.8 Hz).
DAMPED = {"damping": 1e-4, "air_drag": 0.036}
UNDAMPED = {"damping": 0.0}
LAWS = {
    "undamped": UNDAMPED,
    "Kelvin-Voigt": {"damping": 1e-4},
    "Rayleigh, mass": {"damping": 0.0, "mass_damping": 0.1},
    "Rayleigh, stiffness": {"damping": 0.0, "stiffness_damping": 1e-4},
    "air drag": {"damping": 0.0, "air_drag": 0.036},
}
HALF_THICKNESS = 0.00125
GAUGES = {"gauge 1": 0.50, "gauge 2": 0.25, "gauge 2 at 0.70 m": 0.70}
RATE = "frame.angle_dot [rad/s]"


def run(strain: str, integrator: object = SCHEME, **parameters: object) -> pd.DataFrame:
    """Gauges on both surfaces and the angular velocity of the frame, every 10 ms of 6 s."""
    mechanism = pendulum(strain=strain, **parameters)
    beam = mechanism.part("beam")
    for name, s in GAUGES.items():
        for surface, sign in (("lower", -1.0), ("upper", 1.0)):
            mechanism.observe(f"{name}, {surface}", beam.strain(s, sign * HALF_THICKNESS))
    return observed(mechanism, 6.0, 1e-2, integrator)


def histories() -> dict[str, pd.DataFrame]:
    """Figs. 5a, 5b and 5c."""
    found = {
        f"{strain}, {label}": run(strain, **parameters)
        for label, parameters in (("damped", DAMPED), ("undamped", UNDAMPED))
        for strain in ("nonlinear", "linear")
    }
    tables = {}
    for figure, gauges in {"a": ["gauge 1"], "b": ["gauge 2", "gauge 2 at 0.70 m"]}.items():
        columns = {
            f"{gauge}, {surface}, {label} [-]": run[f"{gauge}, {surface} [-]"]
            for gauge in gauges
            for surface in ("lower", "upper")
            for label, run in found.items()
        }
        tables[f"figure_5{figure}"] = pd.DataFrame(columns)
    tables["figure_5c"] = pd.DataFrame({f"{k} [rad/s]": r[RATE] for k, r in found.items()})
    witness = run("nonlinear", WITNESS, **DAMPED)
    return tables | second_method(
        {
            f"5, {column}": (found["nonlinear, damped"][column], witness[column])
            for column in ("gauge 1, lower [-]", "gauge 2, lower [-]", RATE)
        }
    )


def damping() -> dict[str, pd.DataFrame]:
    """Angular velocity, gauge 1 and energy lost over 6 s under each damping law."""
    columns = {}
    for name, parameters in LAWS.items():
        solution = solved(pendulum(**parameters), 6.0, 1e-2, SCHEME)
        table = solution.table().set_index("t [s]")
        columns[f"angular velocity, {name} [rad/s]"] = table[RATE]
        columns[f"gauge 1, {name} [-]"] = table["gauge 1 [-]"]
        columns[f"energy lost, {name} [J]"] = table["energy.dissipated [J]"]
    return {"damping": pd.DataFrame(columns)}


RADIUS = pendulum.parameters["radius"]
# From the tangent at the root to the chord.
TO_CHORD = 0.5 * pendulum().part("beam").length / RADIUS
# Root tangent [rad] and sign of the curvature: what "0.60 rad" may have meant.
ORIENTATIONS = {
    "tangent 0.60 rad below the horizontal, bending up": (-0.60, 1.0),
    "tangent 0.60 rad above the horizontal, bending up": (0.60, 1.0),
    "tangent 0.60 rad below the horizontal, bending down": (-0.60, -1.0),
    "tangent 0.60 rad above the horizontal, bending down": (0.60, -1.0),
    "chord 0.60 rad below the horizontal, bending up": (-0.60 - TO_CHORD, 1.0),
    "chord 0.60 rad below the horizontal, bending down": (-0.60 + TO_CHORD, -1.0),
    "tangent 0.60 rad from the vertical, bending up": (0.60 - 0.5 * np.pi, 1.0),
    "tangent 0.60 rad from the vertical, bending down": (0.60 - 0.5 * np.pi, -1.0),
}
PLACES = np.round(np.arange(0.02, 0.79, 0.02), 2)


def along(**parameters: object) -> tuple[bd.Mechanism, list[list[str]]]:
    """A pendulum with gauges all along both surfaces, and their names by surface."""
    mechanism = pendulum(**parameters)
    beam = mechanism.part("beam")
    names = []
    for surface in (-1.0, 1.0):
        names.append([f"gauge {surface} {s}" for s in PLACES])
        for name, s in zip(names[-1], PLACES, strict=True):
            mechanism.observe(name, beam.strain(s, surface * HALF_THICKNESS))
    return mechanism, [[f"{name} [-]" for name in row] for row in names]


def strains_along(angle: float, sign: float, strain: str) -> tuple[np.ndarray, np.ndarray]:
    """Strains on the lower and the upper surface, (2, rows, places), and the rate of the frame."""
    mechanism, names = along(angle=angle, radius=sign * RADIUS, strain=strain, **DAMPED)
    found = observed(mechanism, 5.0, 1e-2, PAPER_SCHEME)
    return np.array([found[row].to_numpy() for row in names]), found[RATE].to_numpy()


def hanging(sign: float) -> np.ndarray:
    """Strains at rest, (2, 1, places): a gauge may have been set to zero on the hanging strip."""
    mechanism, names = along(angle=-0.5 * np.pi, radius=sign * RADIUS, mass_damping=8.0)
    last = observed(mechanism, 8.0, 8.0, bd.GeneralizedAlpha(step=1e-2)).iloc[-1]
    return np.array([[last[row].to_numpy(float)] for row in names])


def scan(orientation: str) -> dict[str, pd.DataFrame]:
    """Ranges of the gauges for one orientation, on both surfaces, as they are and tared."""
    angle, sign = ORIENTATIONS[orientation]
    runs = {strain: strains_along(angle, sign, strain) for strain in ("nonlinear", "linear")}
    rest = hanging(sign)
    rates = np.concatenate([rate for _, rate in runs.values()])
    lines = []
    for tared in (False, True):
        for k, surface in enumerate(("lower", "upper")):
            values = {name: (x - tared * rest)[k] for name, (x, _) in runs.items()}
            low = np.min([x.min(axis=0) for x in values.values()], axis=0)
            high = np.max([x.max(axis=0) for x in values.values()], axis=0)
            line: dict[str, object] = {
                "orientation": orientation,
                "surface": surface,
                "zero": "hanging at rest" if tared else "unstrained",
                "angular velocity": span(rates),
                "fills Fig. 5c": bool(fills(rates.min(), rates.max(), FIGURE_5C)),
            }
            for gauge, figure, axis in (
                ("gauge 1", "Fig. 5a", FIGURE_5A),
                ("gauge 2", "Fig. 5b", FIGURE_5B),
            ):
                at = int(np.argmin(np.abs(PLACES - GAUGES[gauge])))
                good = fills(low, high, axis)
                line[f"{gauge} [1e-4]"] = span(np.array([low[at], high[at]]) * 1e4)
                line[f"fills {figure}"] = bool(good[at])
                line[f"would fill {figure} at [m]"] = _stretches(PLACES[good])
            lines.append(line)
    return {"gauge_scan": pd.DataFrame(lines)}


def _stretches(places: np.ndarray) -> str:
    """Places as intervals: '0.06-0.10, 0.66'."""
    if not len(places):
        return "nowhere"
    groups = np.split(places, np.flatnonzero(np.diff(places) > 0.021) + 1)
    return ", ".join(f"{g[0]:.2f}" if len(g) == 1 else f"{g[0]:.2f}-{g[-1]:.2f}" for g in groups)
