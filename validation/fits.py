"""Fits and designs with known answers: oscillators, a twin of an experiment, a compliant four-bar.

The twin is the pendulum of Pan & Liu (2012) with synthetic records of two strain gauges. The
four-bar has 100 heights of coupler and rocker, optimized so that the middle of the coupler follows
a path, with a limit of the stress at 50 sections at all times. The path and the limit are those of
a reference design, so that a design without deviation exists; it is not unique.
"""

from collections.abc import Callable
from functools import partial
from typing import Any, NamedTuple

import numpy as np

import beamdae as bd

# Errors of fitted values in standard deviations: one of 40 values exceeds 3.5 by chance in 2 %.
MAX_DEVIATION = 3.5
# Largest deviation of a design from its path relative to that of the first design.
MAX_DESIGN_SHARE = 0.05


class Result(NamedTuple):
    """Result of a case.

    Attributes
    ----------
    success
        True if the search has found an answer.
    is_right
        True if the answer is the known one.
    error
        Error of the answer relative to its size; NaN where standard deviations judge it.
    evaluations
        Number of evaluated runs.
    reason
        Status and error.
    """

    success: bool
    is_right: bool
    error: float
    evaluations: int
    reason: str


@bd.model(t_end=1.0)
def _oscillator(stiffness=30.0, damping=0.5, mass=1.0):
    mech = bd.Mechanism()
    body = mech.add(bd.PointMass("body", mass, at=(1.0, 0.0)))
    base = mech.ground.at(0.0, 0.0)
    mech.add(bd.PointOnLine("guide", base, body.point, direction=(1.0, 0.0)))
    spring = bd.Spring("spring", base, body.point, stiffness, damping, free_length=0.8)
    mech.add(spring)
    mech.observe("body", body.point)
    return mech


def _oscillate(t: np.ndarray, stiffness: float, damping: float) -> np.ndarray:
    """Return the position of the oscillator of 1 kg, released 0.2 m from its equilibrium."""
    decay = 0.5 * damping
    omega = np.sqrt(stiffness - decay**2)
    return 0.8 + 0.2 * np.exp(-decay * t) * (np.cos(omega * t) + decay / omega * np.sin(omega * t))


def fit_oscillator() -> Result:
    """Fit stiffness and damping to an exact motion."""
    times, truth = np.linspace(0.0, 1.0, 51), np.array([37.0, 0.8])
    data = {"t [s]": times, "body.x [m]": _oscillate(times, *truth)}
    names, method = ["stiffness", "damping"], bd.Radau(1e-9)
    fit = bd.fit(_oscillator, data, names, method, sigma=1e-4)
    error = float(np.max(np.abs(fit.values / truth - 1.0)))
    return Result(True, error < 1e-5, error, fit.evaluations, fit.status.sentence)


def design_oscillator() -> Result:
    """Find the stiffness of a given motion."""
    times, bounds = np.linspace(0.1, 1.0, 19), {"stiffness": (10.0, 60.0)}
    goal = bd.quantities.SquaredErrors("body.x", times, _oscillate(times, 24.0, 0.5), 1e-3)
    method = bd.Radau(1e-9)
    result = bd.optimize(_oscillator, goal, ["stiffness"], bounds=bounds, integrator=method)
    error = abs(result.parameters["stiffness"] / 24.0 - 1.0)
    return Result(True, error < 1e-4, error, result.evaluations, result.status.sentence)


# True values, and values from which the fits start.
TRUE = {"E": 68.95e9, "tip_mass": 0.060, "damping": 1.0e-3, "air_drag": 0.08, "angle": -0.60}
FIRST = {"E": 66.0e9, "tip_mass": 0.063, "damping": 1.5e-3, "air_drag": 0.05, "angle": -0.62}
BOUNDS = {
    "E": (40e9, 120e9),
    "tip_mass": (0.03, 0.12),
    "damping": (1e-4, 1e-2),
    "air_drag": (0.01, 1.0),
    "angle": (-0.8, -0.4),
}
LOG = ["damping", "air_drag"]
# Gauge 1 has an unknown amplifier; both gauges have the same delay.
SCALE, OFFSET, SHIFT = 1.07, 4e-6, 0.012
NOISE = 1e-6  # standard deviation of strains: a microstrain, as of usual amplifiers
SENSORS = {"scale": ["gauge 1"], "offset": ["gauge 1"], "shift": {"*": (-0.05, 0.05)}}
RECORD_TIMES = np.linspace(0.1, 2.0, 191)
RECORD_METHOD = bd.GeneralizedAlpha(step=2.5e-3)


@bd.model(t_end=2.0)
def pendulum(
    E=68.95e9,
    thickness=0.0025,
    tip_mass=0.060,
    damping=1e-3,
    air_drag=0.05,
    angle=-0.60,
    elements=4,
):
    """Release the curved strip of Table 1 with a tip mass from rest at `angle` [rad]."""
    mech = bd.Mechanism(gravity=(0.0, -9.81))
    alloy = bd.Material(E=E, nu=0.3, rho=2760.0)
    strip = bd.Section.rectangle(alloy, width=0.03, height=thickness, damping=damping)
    arc = bd.Arc(radius=0.85, length=0.80, start=(0.0, 0.0), angle=angle)
    beam = mech.add(bd.Beam("beam", arc, strip, elements, strain="exact"))
    mech.add(bd.PointMass("tip mass", tip_mass, on=beam.end))
    mech.add(bd.Revolute("hinge", mech.ground.at(0.0, 0.0), beam.start))
    mech.add(bd.AirDrag("air", beam, air_drag))
    mech.observe("gauge 1", beam.strain(s=0.50, offset=-0.5 * thickness))
    mech.observe("gauge 2", beam.strain(s=0.25, offset=-0.5 * thickness))
    return mech


def fit_twin(seed: int) -> Result:
    """Fit five parameters of the model and three properties of the gauges to a noisy record."""
    run = bd.simulate(pendulum(**TRUE), RECORD_METHOD, t_end=float(RECORD_TIMES[-1]) + 0.1)
    strain = run.at_times(RECORD_TIMES - SHIFT)
    record = {
        "gauge 1": SCALE * strain["gauge 1"].to_numpy() + OFFSET,
        "gauge 2": strain["gauge 2"].to_numpy(),
    }
    generator = np.random.default_rng(seed)
    data = {x: y + generator.normal(scale=NOISE, size=len(y)) for x, y in record.items()}
    start: dict[str, Any] = {"parameters": FIRST, "bounds": BOUNDS, "log": LOG, **SENSORS}
    fit = bd.fit(
        pendulum, {"t [s]": RECORD_TIMES} | data, list(TRUE), RECORD_METHOD, sigma=NOISE, **start
    )
    truth = np.array([*TRUE.values(), SHIFT, SCALE, OFFSET])
    deviation = float(np.max(np.abs(fit.values - truth) / fit.standard_deviations))
    reason = f"{fit.status.sentence}, {deviation:.2g} standard deviations"
    is_right = deviation <= MAX_DEVIATION
    return Result(fit.status.success, is_right, np.nan, fit.evaluations, reason)


COUNT = 50  # heights of each beam
FIRST_HEIGHT, HEIGHT_RANGE = 1.2e-3, (0.6e-3, 2.4e-3)  # m
DEVIATION = 1e-4  # m, unit of the deviations from the path
CRANK, SIDE = 0.05, 0.2  # m
STROKE = 0.7  # rad
STATIONS = np.linspace(0.02, 0.98, 25)
PATH = ("tracer.x", "tracer.y")
STRESSES = [f"{name} stress {k}" for name in ("rocker", "coupler") for k in range(len(STATIONS))]
TIMES = np.linspace(0.1, 1.0, 19)  # s
# Weight of the changes of height between neighboring points, in units of 0.1 mm. Without it,
# heights between integration points would be arbitrary.
ROUGHNESS_WEIGHT = 2e-2
ROUNDS = 2  # of optimization with a corrected limit, at most
MAX_EVALUATIONS = 120  # of a round


@bd.model(t_end=1.0)
def four_bar(
    coupler: tuple[float, ...] = (FIRST_HEIGHT,) * COUNT,
    rocker: tuple[float, ...] = (FIRST_HEIGHT,) * COUNT,
) -> bd.Mechanism:
    """Compliant four-bar with piecewise linear heights of coupler and rocker."""
    steel = bd.Material.of("steel")
    mech = bd.Mechanism()
    foot, knee, pin = (0.0, 0.0), (0.0, SIDE), (SIDE, SIDE)
    shaft = (SIDE, SIDE - CRANK)
    beams = {}
    for name, line, heights in (
        ("rocker", bd.Line(foot, knee), rocker),
        ("coupler", bd.Line(knee, pin), coupler),
    ):

        def section(s: float, heights: tuple[float, ...] = heights) -> bd.Section:
            height = float(np.interp(s, np.linspace(0.0, SIDE, COUNT), heights))
            return bd.Section.rectangle(steel, width=0.02, height=height, damping=1e-3)

        beams[name] = mech.add(bd.Beam(name, line, section, elements=10, formulation="exact"))
    crank = mech.add(bd.RigidBody.rod("crank", shaft, pin, mass=0.1))
    mech.add(bd.Weld("foot", mech.ground.at(*foot), beams["rocker"].start))
    mech.add(bd.Weld("knee", beams["rocker"].end, beams["coupler"].start))
    mech.add(bd.Revolute("pin", beams["coupler"].end, crank.at(*pin)))
    mech.add(bd.Revolute("shaft", mech.ground.at(*shaft), crank.at(*shaft)))
    base, arm = mech.ground.at(*shaft), crank.at(*shaft)
    mech.add(bd.Driver("motor", base, arm, _turn))
    mech.observe("tracer", beams["coupler"].at(0.5 * SIDE))
    for name, beam in beams.items():
        for k, station in enumerate(STATIONS):
            mech.observe(f"{name} stress {k}", beam.stress(station * SIDE, "top"))
    return mech


def _turn(t: float) -> float:
    return -STROKE * t**2 * (3.0 - 2.0 * t)


def _reference_heights() -> dict[str, tuple[float, ...]]:
    """Return a coupler that is thin in the middle, and a rocker that is thin at its foot."""
    s = np.linspace(0.0, 1.0, COUNT)
    coupler = FIRST_HEIGHT * (1.2 - 0.5 * np.sin(np.pi * s))
    rocker = FIRST_HEIGHT * (0.7 + 0.6 * s)
    return {"coupler": tuple(coupler.tolist()), "rocker": tuple(rocker.tolist())}


def _measure_roughness(coupler: tuple[float, ...], rocker: tuple[float, ...]) -> float:
    """Return the sum of the squared changes of height between neighboring points, in 0.1 mm."""
    return sum(float(np.sum((np.diff(x) / 1e-4) ** 2)) for x in (coupler, rocker))


def _largest_stress(run: bd.results.Solution) -> float:
    return max(float(run[name].abs().max()) for name in STRESSES)


def optimize_heights() -> Result:
    """Optimize the heights of coupler and rocker."""
    method = bd.GeneralizedAlpha(step=0.0125)
    reference = bd.simulate(four_bar(**_reference_heights()), method)
    exact = reference.at_times(TIMES)

    def deviation(run: bd.results.Solution) -> float:
        at = run.at_times(TIMES)
        errors = [at[name].to_numpy() - exact[name].to_numpy() for name in PATH]
        return float(np.max(np.hypot(*errors)))

    path = sum(
        bd.quantities.SquaredErrors(name, TIMES, exact[name].to_numpy(), DEVIATION) for name in PATH
    )
    roughness = ROUGHNESS_WEIGHT * bd.quantities.ParameterFunction(_measure_roughness, "roughness")
    stress = bd.quantities.LargestOf(
        [bd.quantities.SmoothMaximum(name, 100.0) for name in STRESSES], 30.0
    )
    limit = _largest_stress(reference)
    heights: dict[str, tuple[float, ...]] = {}
    # Smooth maxima over time are below the maxima: the ratio of both corrects the limit.
    correction, count = 1.0, 0
    for _ in range(ROUNDS):
        result = bd.optimize(
            four_bar,
            roughness + path,
            ["coupler", "rocker"],
            bd.quantities.at_most(stress, limit * correction),
            {"coupler": HEIGHT_RANGE, "rocker": HEIGHT_RANGE},
            method,
            parameters=heights,
            max_evaluations=MAX_EVALUATIONS,
            tolerance=1e-9,
        )
        count += result.evaluations
        largest = _largest_stress(result.solution)
        if largest <= limit:
            break
        correction = result.constraints[0].value / largest
        heights = dict(result.parameters)
    share = deviation(result.solution) / deviation(bd.simulate(four_bar(), method))
    reason = f"{result.status.sentence}, deviation {share:.2g} of that of the first design"
    is_right = share < MAX_DESIGN_SHARE and largest <= limit
    return Result(True, is_right, share, count, reason)


CASES: dict[str, Callable[[], Result]] = {
    **{f"twin of a pendulum, noise {seed}": partial(fit_twin, seed) for seed in range(5)},
    "oscillator: stiffness and damping": fit_oscillator,
    "oscillator: stiffness of a motion": design_oscillator,
    "compliant four-bar": optimize_heights,
}
