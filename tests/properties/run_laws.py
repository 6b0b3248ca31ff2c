"""Properties of simulations of random mechanisms."""

from dataclasses import replace
from random import Random

import numpy as np
from hypothesis import assume
from properties.drawings import Drawing
from properties.mechanism_state import MechanismState
from properties.state_laws import consistent_state

import beamdae as bd

T_END, RTOL = 0.5, 1e-4
# Longer runs are rejected as examples.
LIMITS = {"max_steps": 4000}
INTEGRATORS = (
    bd.Ida(RTOL, **LIMITS),
    bd.Radau(RTOL, **LIMITS),
    bd.GeneralizedAlpha(rtol=RTOL, **LIMITS),
)


def distant_points(drawing: Drawing, mech: bd.Mechanism) -> dict[str, bd.results.Attachment]:
    """Return a distant point of each body."""
    points = {}
    for body in drawing.bodies:
        part = mech.part(body.name)
        if body.kind == "particle":
            points[body.name] = part.point
        elif body.kind == "reduced":
            points[body.name] = part.at(body.node(1.0))
        else:
            points[body.name] = part.end if body.is_beam else part.at(*body.point(1.0))
    return points


def build_with_observations(drawing: Drawing) -> bd.Mechanism:
    """Build the mechanism and observe a distant point of each body."""
    mech = drawing.mechanism()
    for name, point in distant_points(drawing, mech).items():
        mech.observe(name, point)
    return mech


def position_columns(solution: bd.results.Solution) -> dict[str, np.ndarray]:
    """Return the columns of positions and angles."""
    quantities = ("x", "y", "angle")
    columns = solution.columns.items()
    return {k: c for k, c in columns if k.split(".")[-1].split(" ")[0] in quantities}


def max_relative_difference(one: bd.results.Solution, other: bd.results.Solution) -> float:
    """Return the largest difference of a column over half its range, or 1 % of the widest."""
    here, there = position_columns(one), position_columns(other)
    half = {name: 0.5 * np.ptp(column) for name, column in there.items()}
    widest = max(half.values())
    worst = 0.0
    for name, column in there.items():
        size = max(half[name], 1e-2 * widest, 1e-9)
        worst = max(worst, float(np.max(np.abs(here[name] - column)) / size))
    return worst


class ReferenceRun:
    """Accurate run of a predictable motion; chaotic and singular examples are rejected."""

    def __init__(self, drawing: Drawing) -> None:
        self.mech = build_with_observations(drawing)
        consistent_state(drawing)
        self.run = bd.simulate(self.mech, bd.Radau(1e-3 * RTOL, **LIMITS), T_END)
        # A driver can request positions that a linkage cannot reach.
        assume(self.run.status.success)
        assume(not self.run.singular_positions)
        assume(self.growth() < 100.0)

    def growth(self) -> float:
        """Return the amplification of a small perturbation of the initial velocities."""
        e = self.run.equations
        rng = np.random.default_rng(0)
        v0 = self.run.v[0] + RTOL * np.max(np.abs(self.run.v / e.position_scales)) * (
            e.position_scales * rng.standard_normal(e.n)
        )
        pushed = replace(e, v0=v0)
        other = bd.simulate(pushed, bd.Radau(1e-3 * RTOL, **LIMITS), T_END)
        return max_relative_difference(other, self.run) / RTOL if other.status.success else np.inf


def require_completed(run: bd.results.Solution) -> bd.results.Solution:
    """Return a run that reached its end; reject the example if it exceeded a limit."""
    assume(run.status.kind != "limited")
    assert run.status.success, f"{run.integrator['integrator']}: {run.status.sentence}"
    return run


def check_integrator_agreement(drawing: Drawing, rng: Random) -> None:
    motion = ReferenceRun(drawing)
    assert motion.run.quality.energy_imbalance <= RTOL
    for method in INTEGRATORS:
        run = require_completed(bd.simulate(motion.mech, method, T_END))
        off = max_relative_difference(run, motion.run) / RTOL
        assert off <= 100.0, f"{method.method}: off by {off:.0f} rtol"
        imbalance = run.quality.energy_imbalance / RTOL
        assert imbalance <= 100.0, f"{method.method}: energy off by {imbalance:.0f} rtol"


def check_momentum_conservation(drawing: Drawing, rng: Random) -> None:
    """Momentum is constant to 10 rtol of the total momentum of all coordinates."""
    motion = ReferenceRun(drawing)
    state = MechanismState(motion.mech)
    for method in INTEGRATORS:
        run = require_completed(bd.simulate(motion.mech, method, T_END))
        rows = range(0, len(run.t), 50)
        momentum = np.array([state.momentum(run.q[k], run.v[k]) for k in rows])
        size = max(np.sum(np.abs(state.mass(q=run.q[k]) @ run.v[k])) for k in rows)
        off = np.max(np.abs(momentum - momentum[0]))
        assert off <= 10.0 * RTOL * size, f"{method.method}: off by {off:.2g} of {size:.2g}"


def check_continuation(drawing: Drawing, rng: Random) -> None:
    motion = ReferenceRun(drawing)
    method, row = rng.choice(INTEGRATORS), 1e-3 * T_END
    first = require_completed(
        bd.simulate(motion.mech, method, rng.choice(range(200, 800)) * row, row)
    )
    later = require_completed(bd.simulate(motion.mech, method, T_END, row, start=first))
    assert later.t[0] == first.trajectory.end
    whole = first.followed_by(later)
    off = max_relative_difference(whole, motion.run) / RTOL
    assert off <= 100.0, f"{method.method}: off by {off:.0f} rtol"
    assert whole.quality.energy_imbalance <= 100.0 * RTOL


RUN_LAWS = {
    "integrators": (check_integrator_agreement, {"damped": True}),
    "momentum of runs": (check_momentum_conservation, {"damped": True, "free": True}),
    "going on": (check_continuation, {"damped": True}),
}
