"""Cases of the tolerance study: models, compared columns, stored references, the error measure."""

from __future__ import annotations

from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
from hub_beam import hub_beam
from pendulum import pendulum
from slider_crank import slider_crank

import beamdae as bd

FOLDER = Path(__file__).parent / "references"
ROWS = 501


@dataclass(frozen=True)
class ToleranceCase:
    """A model whose tip position and frame angle are compared with a stored reference.

    `bound` is the promised error over rtol: 30 for damped models, 100 for undamped ones.
    `fine_step` is the step of generalized-alpha for the reference.
    """

    name: str
    model: bd.Model
    columns: tuple[str, ...]
    parameters: dict[str, Any] = field(default_factory=dict)
    bound: float = 100.0
    fine_step: float = 5e-5

    def run(self, integrator: Any) -> bd.Solution:
        """Solve the case with rows at the times of the reference."""
        t_end = self.model.t_end
        mechanism = self.model(**self.parameters)
        return bd.simulate(mechanism, integrator, t_end=t_end, output_step=t_end / (ROWS - 1))

    def observed(self, solution: bd.Solution) -> np.ndarray:
        """The compared columns, (rows, columns)."""
        return solution.observed[list(self.columns)].to_numpy()

    @property
    def reference(self) -> np.ndarray:
        """The stored reference, (ROWS, columns)."""
        return pd.read_csv(FOLDER / f"{self.name}.csv")[list(self.columns)].to_numpy()

    def errors(self, solution: bd.Solution, reference: np.ndarray | None = None) -> np.ndarray:
        """Largest error of each column over the run, relative to its amplitude.

        The amplitude is half the range of the reference, the smallest of the usual definitions.
        """
        reference = self.reference if reference is None else reference
        amplitude = 0.5 * np.ptp(reference, axis=0)
        return np.max(np.abs(self.observed(solution) - reference), axis=0) / amplitude


PENDULUM = ("tip.x [m]", "tip.y [m]", "frame.angle [rad]")
SLIDER = ("slider.x [m]", "rod frame.angle [rad]")
CASES = (
    ToleranceCase("hub_beam", hub_beam, ("tip.x [m]", "tip.y [m]", "hub.angle [rad]")),
    ToleranceCase("pendulum_damped", pendulum, PENDULUM, bound=30.0),
    ToleranceCase("pendulum_undamped", pendulum, PENDULUM, {"damping": 0.0}, fine_step=2e-5),
    ToleranceCase("slider_crank_tangent", slider_crank, SLIDER),
    ToleranceCase("slider_crank_chord", slider_crank, SLIDER, {"frame": "chord"}),
)
