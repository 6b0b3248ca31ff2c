"""Single changes that could explain Figs. 5a to 5c: `python validation/calibration/gauge_2.py`.

The curves of the figures cannot be recovered, but their axes can: the lowest and the highest
value of all curves of a figure are between the ends of its axis and the next ticks. These six
extremes are the data, with the standard deviation of a uniform distribution over one tick. For each
kind of change, the value that fits them best is found on a grid; a change explains the figures if
chi-square is at most 11.07, which the right one exceeds in 5 % of cases (6 data, one parameter).
"""

import sys
import warnings
from pathlib import Path

import numpy as np
import pandas as pd

import beamdae as bd
from beamdae.errors import BeamdaeError, BeamdaeWarning

RESULTS = Path(__file__).parent / "results"
# Ends and ticks of the axes of Figs. 5a, 5b (strain) and 5c (angular velocity in rad/s).
AXES = ((-1.6e-4, 0.4e-4, 0.4e-4), (-0.5e-4, 0.1e-4, 0.1e-4), (-6.0, 6.0, 2.0))
# Quantile 0.95 of the chi-square distribution with five degrees of freedom.
ACCEPTED = 11.07
T_END = 5.0
METHOD = bd.GeneralizedAlpha(step=1e-3)
HALF_THICKNESS = 0.00125
POSITIONS = np.linspace(0.02, 0.78, 77)


@bd.model(t_end=T_END)
def pendulum(
    strain="nonlinear",
    E=68.95e9,
    thickness=2.0 * HALF_THICKNESS,
    tip_mass=0.060,
    hinge_stiffness=0.0,
    hinge_damping=0.0,
    damping=1e-4,
    air_drag=0.036,
    angle=-0.60,
    radius=0.85,
    gravity=9.81,
):
    """Pendulum of Table 1; with gauges on its lower surface."""
    mech = bd.Mechanism(gravity=(0.0, -gravity))
    alloy = bd.Material(E=E, nu=0.3, rho=2760.0)
    strip = bd.Section.rectangle(alloy, width=0.03, height=thickness, damping=damping)
    arc = bd.Arc(radius=radius, length=0.80, start=(0.0, 0.0), angle=angle)
    beam = mech.add(bd.Beam("beam", arc, strip, 8, strain=strain, frame="tangent"))
    mech.add(bd.PointMass("tip mass", tip_mass, on=beam.end))
    root = mech.ground.at(0.0, 0.0)
    mech.add(bd.Revolute("hinge", root, beam.start))
    if hinge_stiffness or hinge_damping:
        mech.add(bd.TorsionSpring("friction", root, beam.start, hinge_stiffness, hinge_damping))
    mech.add(bd.AirDrag("air", beam, air_drag))
    mech.observe("frame", beam.floating_frame)
    mech.observe("gauge 1", beam.strain(s=0.50, offset=-0.5 * thickness))
    mech.observe("gauge 2", beam.strain(s=0.25, offset=-0.5 * thickness))
    for k, s in enumerate(POSITIONS):
        mech.observe(f"at {k}", beam.strain(s=float(s), offset=-0.5 * thickness))
    return mech


# Values of each parameter of the mechanism; the first one is that of the paper.
CHANGES = {
    "E": 68.95e9 * np.geomspace(0.25, 16.0, 13),
    "thickness": 0.0025 * np.geomspace(0.5, 4.0, 13),
    "tip_mass": np.geomspace(0.003, 0.5, 13),
    "hinge_stiffness": np.geomspace(0.01, 10.0, 13),
    "hinge_damping": np.geomspace(1e-3, 1.0, 10),
    "damping": np.geomspace(1e-5, 1e-2, 7),
    "air_drag": np.geomspace(0.01, 2.0, 9),
    "angle": np.linspace(-1.5, 1.5, 21),
    "radius": np.array([0.5, 0.6, 0.7, 0.85, 1.0, 1.3, 2.0, 5.0, -5.0, -2.0, -1.3, -0.85]),
    "gravity": np.linspace(4.0, 16.0, 9),
}


def simulate(**changes):
    """Return the columns of the nonlinear and the linear model, one after the other."""
    runs = [
        bd.simulate(pendulum(strain=strain, **changes), METHOD, T_END, output_step=0.01)
        for strain in ("nonlinear", "linear")
    ]
    return {name: np.concatenate([x.columns[name] for x in runs]) for name in runs[0].columns}


def chi_square(first, second, rate):
    """Return chi-square of the extremes of both strains and of the angular velocity."""
    total = 0.0
    for values, (start, end, tick) in zip((first, second, rate), AXES, strict=True):
        sigma = tick / 12.0**0.5
        total += ((np.min(values) - start - 0.5 * tick) / sigma) ** 2
        total += ((np.max(values) - end + 0.5 * tick) / sigma) ** 2
    return total


def judge(columns):
    """Return chi-square of the gauges as printed."""
    rate = columns["frame.angle_dot [rad/s]"]
    return chi_square(columns["gauge 1 [-]"], columns["gauge 2 [-]"], rate)


def main():
    warnings.simplefilter("ignore", BeamdaeWarning)
    base = simulate()
    rate, first, second = (
        base[x] for x in ("frame.angle_dot [rad/s]", "gauge 1 [-]", "gauge 2 [-]")
    )
    rows = [("none", "as printed", judge(base), "")]
    gains = np.linspace(0.1, 1.5, 141)
    values = np.array([chi_square(first, gain * second, rate) for gain in gains])
    accepted = gains[values <= values.min() + 3.84]
    rows.append(("gain of gauge 2", gains[values.argmin()], values.min(), span(accepted)))
    offsets = np.linspace(-1e-4, 1e-4, 201)
    values = np.array([chi_square(first, second + x, rate) for x in offsets])
    rows.append(("offset of gauge 2", offsets[values.argmin()], values.min(), ""))
    strains = [base[f"at {k} [-]"] for k in range(len(POSITIONS))]
    values = np.array([chi_square(first, x, rate) for x in strains])
    best = int(values.argmin())
    accepted = POSITIONS[values <= values.min() + 3.84]
    rows.append(("position of gauge 2 [m]", POSITIONS[best], values.min(), span(accepted)))
    similarity = np.corrcoef(strains[best], second)[0, 1]
    values = np.array([chi_square(x, second, rate) for x in strains])
    rows.append(("position of gauge 1 [m]", POSITIONS[values.argmin()], values.min(), ""))
    for name, grid in CHANGES.items():
        values = []
        for value in grid.tolist():
            try:
                values.append(judge(simulate(**{name: value})))
            except BeamdaeError:
                values.append(np.inf)
        best = int(np.argmin(values))
        rows.append((name, grid[best], values[best], ""))
        print(rows[-1], flush=True)
    table = pd.DataFrame(rows, columns=["change", "best value", "chi-square", "95 %"])
    table["explains"] = table["chi-square"] <= ACCEPTED
    RESULTS.mkdir(exist_ok=True)
    table.to_csv(RESULTS / "gauge_2.csv", index=False, float_format="%.4g")
    print(table.to_string(index=False))
    print(f"correlation of the strains at the two places over time: {similarity:.3f}")


def span(values):
    """Return the ends of a set of values as text."""
    return f"{values.min():.3g} .. {values.max():.3g}"


if __name__ == "__main__":
    sys.exit(main())
