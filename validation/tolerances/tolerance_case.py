"""A case of the tolerance study: model, compared columns, stored reference, the error measure."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd

import beamdae as bd

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
    exact
        The compared columns and reactions at given times in closed form, where there is one.
    published
        Published values of columns at the end.
    small
        Moves little enough for the modes of the linearized equations to tell the motion.
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
    exact: Callable[[np.ndarray], np.ndarray] | None = None
    published: dict[str, float] | None = None
    small: bool = False
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

    def select_columns(
        self, solution: bd.Solution, columns: tuple[str, ...] | None = None
    ) -> np.ndarray:
        """The compared columns, (rows, columns); `columns` are others to take instead."""
        return solution.observed[list(columns or self.columns)].to_numpy()

    @property
    def reference(self) -> np.ndarray:
        """The stored reference, (rows, columns)."""
        return self.load_reference(self.columns)

    def load_reference(self, columns: tuple[str, ...]) -> np.ndarray:
        """Columns of the stored reference, (rows, columns)."""
        return pd.read_csv(FOLDER / f"{self.name}.csv")[list(columns)].to_numpy()

    def errors(self, solution: bd.Solution, reference: np.ndarray | None = None) -> np.ndarray:
        """Largest error of each column over the run, relative to its amplitude.

        The amplitude is half the range of the reference, the smallest of the usual definitions.
        """
        reference = self.reference if reference is None else reference
        return relative_deviations(self.select_columns(solution), reference)

    def reaction_errors(self, solution: bd.Solution) -> np.ndarray:
        """The same of the reactions."""
        return relative_deviations(
            self.select_columns(solution, self.reactions), self.load_reference(self.reactions)
        )


def relative_deviations(rows: np.ndarray, reference: np.ndarray) -> np.ndarray:
    """Largest deviation of each column relative to half the range of the reference."""
    amplitude = 0.5 * np.ptp(reference, axis=0)
    return np.max(np.abs(rows - reference), axis=0) / amplitude
