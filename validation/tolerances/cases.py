"""Cases of the tolerance study: models, compared columns, stored references, the error measure."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
from hub_beam import hub_beam
from pendulum import pendulum
from slider_crank import slider_crank
from spin_up import spin_up

import beamdae as bd
from tolerances import mechanisms as m

FOLDER = Path(__file__).parent / "references"
UNDAMPED, DAMPED = 100.0, 30.0


@dataclass(frozen=True)
class ToleranceCase:
    """A model whose positions and angles are compared with a stored reference.

    Attributes
    ----------
    columns
        Observed positions and angles the promise is about.
    parameters
        Of the model, where they are not its defaults.
    bound
        The promised error over rtol: 30 for damped models, 100 for undamped ones.
    t_end
        End time [s]; None: that of the model.
    reactions
        Observed forces and moments, compared as well, but told of separately.
    rows
        Output times, from 0 to the end.
    fine_step
        The step of generalized-alpha for the reference [s].
    exact
        The compared columns and reactions at given times in closed form, where there is one.
    singular
        Passes a position in which its constraints depend on each other.
    """

    name: str
    model: bd.Model
    columns: tuple[str, ...]
    parameters: dict[str, Any] = field(default_factory=dict)
    bound: float = UNDAMPED
    t_end: float | None = None
    reactions: tuple[str, ...] = ()
    rows: int = 201
    fine_step: float = 5e-5
    exact: Callable[[np.ndarray], np.ndarray] | None = None
    singular: bool = False

    @property
    def duration(self) -> float:
        """End time [s]."""
        return self.model.t_end if self.t_end is None else self.t_end

    @property
    def times(self) -> np.ndarray:
        """Times of the rows [s]."""
        return np.linspace(0.0, self.duration, self.rows)

    def run(self, integrator: Any) -> bd.Solution:
        """Solve the case with rows at the times of the reference."""
        t_end = self.duration
        mechanism = self.model(**self.parameters)
        return bd.simulate(mechanism, integrator, t_end=t_end, output_step=t_end / (self.rows - 1))

    def observed(self, solution: bd.Solution, columns: tuple[str, ...] | None = None) -> np.ndarray:
        """The compared columns, (rows, columns); `columns` are others to take instead."""
        return solution.observed[list(columns or self.columns)].to_numpy()

    @property
    def reference(self) -> np.ndarray:
        """The stored reference, (rows, columns)."""
        return self.stored(self.columns)

    def stored(self, columns: tuple[str, ...]) -> np.ndarray:
        """Columns of the stored reference, (rows, columns)."""
        return pd.read_csv(FOLDER / f"{self.name}.csv")[list(columns)].to_numpy()

    def errors(self, solution: bd.Solution, reference: np.ndarray | None = None) -> np.ndarray:
        """Largest error of each column over the run, relative to its amplitude.

        The amplitude is half the range of the reference, the smallest of the usual definitions.
        """
        reference = self.reference if reference is None else reference
        return deviations(self.observed(solution), reference)

    def reaction_errors(self, solution: bd.Solution) -> np.ndarray:
        """The same of the reactions."""
        return deviations(self.observed(solution, self.reactions), self.stored(self.reactions))


def deviations(rows: np.ndarray, reference: np.ndarray) -> np.ndarray:
    """Largest deviation of each column relative to half the range of the reference."""
    amplitude = 0.5 * np.ptp(reference, axis=0)
    return np.max(np.abs(rows - reference), axis=0) / amplitude


HUB = ("tip.x [m]", "tip.y [m]", "hub.angle [rad]")
PENDULUM = ("tip.x [m]", "tip.y [m]", "frame.angle [rad]")
SLIDER = ("slider.x [m]", "rod frame.angle [rad]")
CASES = (
    ToleranceCase("hub_beam", hub_beam, HUB, rows=501),
    ToleranceCase("pendulum_damped", pendulum, PENDULUM, bound=DAMPED, rows=501),
    ToleranceCase(
        "pendulum_undamped", pendulum, PENDULUM, {"damping": 0.0}, rows=501, fine_step=2e-5
    ),
    ToleranceCase("slider_crank_tangent", slider_crank, SLIDER, rows=501),
    ToleranceCase("slider_crank_chord", slider_crank, SLIDER, {"frame": "chord"}, rows=501),
)

FOUR_BAR = ("middle.x [m]", "middle.y [m]", "rocker.angle [rad]")
DOUBLE = ("upper end.x [m]", "upper end.y [m]", "lower end.x [m]", "lower end.y [m]")
TIP = ("tip.x [m]", "tip.y [m]", "tip.angle [rad]")
# Along the beam the tip moves by the square of the deflection: nothing but rounding to compare.
BENT = ("tip.y [m]", "tip.angle [rad]")
ROOT = ("root.M [N m]",)
LOOP = ("crank.angle [rad]", "coupler.angle [rad]", "rocker.angle [rad]")
CASE, FAST = ToleranceCase, {"frequency": 10.0}

HUB_BEAMS = (
    CASE("hub_slow", hub_beam, HUB, {"frequency": 0.1}, t_end=5.0),
    CASE("hub_fast", hub_beam, HUB, FAST, t_end=0.5),
    CASE("hub_fast_damped", hub_beam, HUB, FAST | {"damping": 1e-5}, DAMPED, 0.5),
    CASE("hub_strong", hub_beam, HUB, {"torque": 50.0}, t_end=1.0),
    CASE("hub_weak", hub_beam, HUB, {"torque": 2.0}, t_end=1.0),
)
SLIDERS = (
    CASE("flexible_crank", slider_crank, SLIDER, {"crank": "flexible"}, t_end=1.5),
    CASE(
        "flexible_crank_damped",
        slider_crank,
        SLIDER,
        {"crank": "flexible", "damping": 1e-4},
        DAMPED,
        1.5,
    ),
)
LOOPS = (
    CASE("four_bar", m.four_bar, FOUR_BAR),
    CASE("four_bar_damped", m.four_bar, FOUR_BAR, {"damping": 1e-4}, DAMPED),
    CASE("parallelogram", m.parallelogram, LOOP, t_end=1.0),
    CASE(
        "double_four_bar", m.double_four_bar, ("top.x [m]", "top.y [m]", "bar.x [m]"), singular=True
    ),
)
STRIPS = (
    CASE("pendulum_no_tip_mass", pendulum, PENDULUM, {"tip_mass": 0.0}, DAMPED, 2.0),
    CASE(
        "pendulum_no_tip_mass_undamped",
        pendulum,
        PENDULUM,
        {"tip_mass": 0.0, "damping": 0.0},
        t_end=1.0,
    ),
    CASE(
        "double_strips_damped",
        m.double_strip_pendulum,
        DOUBLE,
        {"upper_damping": 1e-4, "lower_damping": 1e-4},
        DAMPED,
    ),
    CASE("double_strips", m.double_strip_pendulum, DOUBLE, t_end=0.6),
    CASE(
        "thin_strip_damped", m.strip_pendulum, PENDULUM, {"height": 5e-4, "damping": 1e-4}, DAMPED
    ),
    CASE("thin_strip", m.strip_pendulum, PENDULUM, {"height": 5e-4}, t_end=0.5),
    CASE(
        "thick_strip_damped", m.strip_pendulum, PENDULUM, {"height": 0.01, "damping": 1e-4}, DAMPED
    ),
    CASE("thick_strip", m.strip_pendulum, PENDULUM, {"height": 0.01}),
    CASE(
        "mixed_damping",
        m.double_strip_pendulum,
        DOUBLE,
        {"upper_height": 0.02, "lower_damping": 1e-3},
    ),
    CASE("spin_up", spin_up, TIP, t_end=20.0),
    CASE("spin_up_damped", spin_up, TIP, {"damping": 1e-2}, DAMPED, 20.0),
)
THICK = {"width": 0.03, "height": 0.03, "force": 1.0}
LIGHT = {"width": 0.01, "height": 0.003, "force": 0.05, "start": 0.1, "alloy": True}
CANTILEVERS = (
    CASE("cantilever_small", m.cantilever, BENT, {"force": 0.1}, t_end=0.5, reactions=ROOT),
    CASE(
        "cantilever_small_damped",
        m.cantilever,
        BENT,
        {"force": 0.1, "damping": 1e-4},
        DAMPED,
        0.5,
        ROOT,
    ),
    CASE("cantilever_10N", m.cantilever, BENT, {"force": 10.0}, t_end=0.5, reactions=ROOT),
    CASE(
        "cantilever_10N_damped",
        m.cantilever,
        BENT,
        {"force": 10.0, "damping": 1e-4},
        DAMPED,
        0.5,
        ROOT,
    ),
    CASE("cantilever_30mm", m.cantilever, BENT, THICK, t_end=0.2, reactions=ROOT),
    CASE(
        "cantilever_30mm_damped",
        m.cantilever,
        BENT,
        THICK | {"damping": 1e-4},
        DAMPED,
        0.2,
        ROOT,
    ),
    CASE("step_on_beam", m.cantilever, BENT, LIGHT, t_end=0.6, reactions=ROOT),
    CASE(
        "step_on_beam_damped",
        m.cantilever,
        BENT,
        LIGHT | {"damping": 1e-3},
        DAMPED,
        0.6,
        ROOT,
    ),
    CASE(
        "step_on_tip_mass",
        m.cantilever,
        BENT,
        LIGHT | {"tip_mass": 1e-3, "damping": 1e-4},
        DAMPED,
        0.6,
        ROOT,
    ),
)
WIDE = (*CASES, *HUB_BEAMS, *SLIDERS, *LOOPS, *STRIPS, *CANTILEVERS)
