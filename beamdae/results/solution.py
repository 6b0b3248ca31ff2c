"""Results of a run: states at the output times, a table, statistics and an energy ledger."""

from __future__ import annotations

import json
from dataclasses import asdict, dataclass, field
from functools import cache, cached_property
from pathlib import Path
from typing import Any

import casadi as ca
import numpy as np
import pandas as pd

from beamdae.equations.equations_of_motion import EquationsOfMotion
from beamdae.equations.formulations import State
from beamdae.errors import BeamdaeError
from beamdae.results.trajectory import Trajectory, accumulate, interpolate
from beamdae.symbolic.compiled import evaluate_rows

Array = np.ndarray
MX = ca.MX

ENERGIES = ("kinetic", "strain", "gravity")
WORKS = ("work of loads", "work of drivers", "dissipated")


@dataclass(frozen=True)
class Status:
    """How a run ended: whether it reached its end, and a sentence with the reason."""

    success: bool
    message: str


@dataclass(frozen=True)
class Statistics:
    """What a run cost.

    Attributes
    ----------
    steps, rejected_steps
        Accepted steps; attempts given up (error test or Newton).
    residual_calls, jacobian_calls, factorizations, solves
        Calls of the compiled residual and Jacobian, LU factorizations and solutions.
    newton_failures
        Newton iterations that did not converge with the Jacobian of an earlier step, which is then
        renewed, or for good. IDA does not tell: for it these are Jacobians renewed within a step.
    setup_time, wall_time
        Building and compiling; integration alone [s].
    """

    steps: int = 0
    rejected_steps: int = 0
    residual_calls: int = 0
    jacobian_calls: int = 0
    factorizations: int = 0
    solves: int = 0
    newton_failures: int = 0
    setup_time: float = 0.0
    wall_time: float = 0.0


@dataclass(frozen=True)
class Quality:
    """How well a run keeps its promises, over all its steps.

    Attributes
    ----------
    max_residual
        Largest |F + G^T lam| relative to the largest constraint, applied or elastic force.
    max_position_drift, max_velocity_drift
        Largest |g| [m or rad] and |g_dot| [m/s or rad/s].
    energy_imbalance
        Largest |energy - work of loads - work of drivers + dissipated - start| relative to the
        largest energy turned over.
    """

    max_residual: float
    max_position_drift: float
    max_velocity_drift: float
    energy_imbalance: float


@dataclass(frozen=True)
class Solution:
    """Result of one run.

    Attributes
    ----------
    t
        Output times reached (k,) [s].
    q, v, a, lam
        Rows at these times.
    status
        Whether it reached the end, and a sentence.
    integrator
        Settings of the integrator, including what "auto" came to.
    """

    equations: EquationsOfMotion
    trajectory: Trajectory = field(repr=False)
    t: Array
    status: Status
    statistics: Statistics
    integrator: dict[str, Any]
    model: dict[str, Any] = field(default_factory=dict)

    @cached_property
    def _output(self) -> tuple[Array, State]:
        return self.trajectory.at(self.t)

    @property
    def q(self) -> Array:
        """Coordinates at the output times, (k, n)."""
        return self._output[1].q

    @property
    def v(self) -> Array:
        """Velocities at the output times, (k, n)."""
        return self._output[1].v

    @property
    def a(self) -> Array:
        """Accelerations at the output times, (k, n)."""
        return self._output[1].a

    @property
    def lam(self) -> Array:
        """Multipliers at the output times, (k, m)."""
        return self._output[1].lam

    @cached_property
    def observed(self) -> pd.DataFrame:
        """The observed columns at the output times."""
        e = self.equations
        headers = [header for o in e.observables for header in o.headers]
        if not headers:
            return pd.DataFrame(index=range(len(self.t)))
        times, state = self._output
        symbols = _symbols(e)
        function = ca.Function(
            "observed", list(symbols), [ca.densify(e.observed(*symbols[:3], *symbols[4:]))]
        )
        return pd.DataFrame(
            evaluate_rows(function, times, *state[:3], e.p, state.lam), columns=headers
        )

    @cached_property
    def _diagnosis(self) -> tuple[list[Array], list[Array]]:
        """By segment: energies (k, 3) and accumulated works (k, 3); and the quality values."""
        e = self.equations
        symbols = _symbols(e)
        time, q, v, a, p, lam = symbols
        energies = e.energies(time, q, v, p)
        reaction, force = e.reaction(time, q, p, lam), e.force(time, q, v, a, p)
        norms = ca.vertcat(
            _largest(force + reaction),
            _largest(reaction),
            _largest(e.force(time, q, v, MX.zeros(e.n), p)),
            _largest(e.level(0, time, q, v, a, p)),
            _largest(e.level(1, time, q, v, a, p)),
        )
        power = ca.vertcat(energies[3], e.driver_power(time, q, p, lam), energies[4])
        function = ca.Function(
            "diagnosis", list(symbols), [ca.densify(ca.vertcat(energies[:3], power, norms))]
        )
        rows: list[Array] = []
        works: list[Array] = []
        start = np.zeros(3)
        for segment in self.trajectory.segments:
            values = evaluate_rows(
                function, segment.times, *segment.state[:3], e.p, segment.state.lam
            )
            if rows:
                # A law whose rate jumps at a breakpoint changes the velocities at once.
                start = start + np.array([0.0, values[0, 0] - rows[-1][-1, 0], 0.0])
            work = start + accumulate(segment.t, values[:, 3:6])
            start = work[-1]
            rows.append(values)
            works.append(work)
        return rows, works

    @cached_property
    def ledger(self) -> pd.DataFrame:
        """Energies and works [J] at the output times; `imbalance` is what the books are off by."""
        rows, works = self._diagnosis
        which = self.trajectory.which(self.t)
        # By segment: at a breakpoint powers jump, and a spline through the kink would ring.
        books = [
            interpolate(segment.t, np.hstack([row[:, :3], work]), self.t[which == k])
            for k, (segment, row, work) in enumerate(
                zip(self.trajectory.segments, rows, works, strict=True)
            )
        ]
        table = pd.DataFrame(np.concatenate(books), columns=[*ENERGIES, *WORKS])
        table["imbalance"] = _imbalance(table.to_numpy(), np.append(rows[0][0, :3], np.zeros(3)))
        return table.rename(columns=lambda name: f"energy.{name.replace(' ', '_')} [J]")

    @cached_property
    def drift(self) -> pd.DataFrame:
        """Largest |g| and |g_dot| over the joints at the output times."""
        e = self.equations
        times, state = self._output
        symbols = _symbols(e)
        levels = [_largest(e.level(k, *symbols[:5])) for k in (0, 1)]
        function = ca.Function("drift", list(symbols), [ca.densify(ca.vertcat(*levels))])
        rows = evaluate_rows(function, times, *state[:3], e.p, state.lam)
        return pd.DataFrame(rows, columns=["drift.position", "drift.velocity"])

    @cached_property
    def quality(self) -> Quality:
        """Largest residual, drift and energy imbalance over all steps."""
        rows, works = self._diagnosis
        values, work = np.concatenate(rows), np.concatenate(works)
        residual, reaction, force, position, velocity = np.max(values[:, 6:], axis=0)
        books = np.hstack([values[:, :3], work])
        turnover = max(
            np.max(values[:, :2].sum(axis=1)), np.max(np.abs(work)), np.ptp(values[:, 2])
        )
        return Quality(
            float(residual / max(reaction, force, np.finfo(float).tiny)),
            float(position),
            float(velocity),
            float(
                np.max(np.abs(_imbalance(books, books[0]))) / max(turnover, np.finfo(float).tiny)
            ),
        )

    def table(self) -> pd.DataFrame:
        """Time, observed quantities and the energy ledger; headers carry units."""
        time = pd.DataFrame({"t [s]": self.t})
        return pd.concat([time, self.observed, self.ledger], axis=1)

    def coordinates(self) -> pd.DataFrame:
        """Time, all coordinates, velocities and multipliers, named by part."""
        e = self.equations
        names = [*e.q_names, *(f"{n}_dot" for n in e.q_names), *(f"lam.{n}" for n in e.lam_names)]
        frame = pd.DataFrame(np.hstack([self.q, self.v, self.lam]), columns=names)
        frame.insert(0, "t [s]", self.t)
        return frame

    def summary(self) -> dict[str, Any]:
        """Status, statistics and quality as plain values."""
        return {
            "success": self.status.success,
            "status": self.status.message,
            "last_time": self.trajectory.end,
            **asdict(self.statistics),
            **asdict(self.quality),
        }

    def to_csv(self, path: str | Path) -> Path:
        """Write the table as CSV, and settings, versions and statistics as JSON beside it.

        Returns the path of the CSV file.

        Raises
        ------
        BeamdaeError
            If the folder cannot be written.
        """
        path = Path(path)
        if path.suffix == ".json":
            raise BeamdaeError(f"{path}: the table is CSV, .json is for what is written beside it.")
        sidecar = {
            "model": self.model,
            "integrator": self.integrator,
            "result": self.summary(),
            "versions": versions(),
        }
        try:
            path.parent.mkdir(parents=True, exist_ok=True)
            self.table().to_csv(path, index=False)
            path.with_suffix(".json").write_text(json.dumps(sidecar, indent=2) + "\n")
        except OSError as problem:
            raise BeamdaeError(f"{path}: it cannot be written, {problem.strerror}.") from problem
        return path


@cache
def versions() -> dict[str, str]:
    """Versions of beamdae and of what its numbers depend on."""
    from importlib.metadata import version

    names = ("beamdae", "casadi", "scikit-sundae", "numpy", "scipy")
    return {name: version(name) for name in names}


def _symbols(e: EquationsOfMotion) -> tuple[MX, ...]:
    vectors = (MX.sym(name, e.n) for name in ("q", "v", "a"))
    return (MX.sym("time", 2), *vectors, MX.sym("p", len(e.p)), MX.sym("lam", e.m))


def _largest(x: MX) -> MX:
    return ca.norm_inf(x) if x.numel() else MX(0)


def _imbalance(books: Array, start: Array) -> Array:
    signs = np.array([1.0, 1.0, 1.0, -1.0, -1.0, 1.0])
    return (books[:, :6] - start[:6]) @ signs
