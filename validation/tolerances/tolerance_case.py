"""A case of the tolerance study: model, compared columns, stored reference, error measure."""

from __future__ import annotations

import json
from collections.abc import Callable
from dataclasses import dataclass, field
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np

import beamdae as bd

FOLDER = Path(__file__).parent / "references"
REFERENCES = FOLDER / "references.json"
STORED_DIGITS = 9  # significant digits of the stored references
# Guaranteed error over rtol.
UNDAMPED = 100.0
DAMPED = 30.0


@dataclass(frozen=True)
class ToleranceCase:
    """A model whose observed columns are compared with a stored reference.

    Attributes
    ----------
    columns
        Observed positions and angles.
    parameters
        Parameters of the model that differ from its defaults.
    bound
        Guaranteed error over rtol: 30 for damped models, 100 for undamped ones.
    t_end
        End time [s]; None: the end time of the model.
    beams
        Beams whose deflection in the middle is observed as "<beam> bend", in addition to what the
        model observes.
    deflections
        Observed displacements and rotations of beams relative to a body or to their undeformed
        shape; their errors are listed separately.
    rates
        Observed velocities and angular velocities; their errors are listed separately.
    reactions
        Observed forces and moments; their errors are listed separately.
    rows
        Number of output times from 0 to the end.
    exact
        Closed form of all compared columns at given times, if one exists.
    published
        Published values of columns at the end.
    small
        True if the modes of the linearized equations represent the motion.
    """

    name: str
    model: bd.results.Model
    columns: tuple[str, ...]
    parameters: dict[str, Any] = field(default_factory=dict)
    bound: float = UNDAMPED
    t_end: float | None = None
    reactions: tuple[str, ...] = ()
    rows: int = 201
    exact: Callable[[np.ndarray], np.ndarray] | None = None
    published: dict[str, float] | None = None
    small: bool = False
    beams: tuple[str, ...] = ()
    deflections: tuple[str, ...] = ()
    rates: tuple[str, ...] = ()

    @property
    def compared(self) -> tuple[str, ...]:
        """All compared columns."""
        return self.columns + self.deflections + self.rates + self.reactions

    @property
    def duration(self) -> float:
        """End time [s]."""
        return self.model.t_end if self.t_end is None else self.t_end

    @property
    def times(self) -> np.ndarray:
        """Times of the rows [s]."""
        return np.linspace(0.0, self.duration, self.rows)

    def build(self) -> Any:
        """Build the mechanism with all compared columns."""
        mechanism = self.model(**self.parameters)
        for name in self.beams:
            beam = mechanism.part(name)
            bend = beam.deformation(0.5 * beam.length, axes="frame")
            mechanism.observe(f"{name} bend", bend)
        return mechanism

    def run(self, integrator: Any) -> bd.results.Solution:
        """Simulate the case with output at the times of the reference."""
        t_end = self.duration
        return bd.simulate(
            self.build(), integrator, t_end=t_end, output_step=t_end / (self.rows - 1)
        )

    def select_columns(
        self, solution: bd.results.Solution, columns: tuple[str, ...] | None = None
    ) -> np.ndarray:
        """Return observed columns, (rows, columns); defaults to the compared ones."""
        return solution.observed[list(columns or self.columns)].to_numpy()

    @property
    def reference(self) -> np.ndarray:
        """The stored reference, (rows, columns)."""
        return self.load_reference(self.columns)

    def load_reference(self, columns: tuple[str, ...]) -> np.ndarray:
        """Return columns of the stored reference, (rows, columns)."""
        table = load_references()[self.name]
        return np.stack([table[name] for name in columns], axis=-1)

    def reference_rounding(self, columns: tuple[str, ...]) -> np.ndarray:
        """Return the rounding error of columns of the stored reference relative to the amplitude.

        A column whose range is a small part of its values has fewer significant digits.
        """
        reference = self.load_reference(columns)
        largest = np.max(np.abs(reference), axis=0)
        unit = 10.0 ** (np.floor(np.log10(largest)) + 1 - STORED_DIGITS)
        return 0.5 * unit / (0.5 * np.ptp(reference, axis=0))

    def errors(
        self,
        solution: bd.results.Solution,
        reference: np.ndarray | None = None,
        columns: tuple[str, ...] | None = None,
    ) -> np.ndarray:
        """Return the largest error of each column over the run, relative to its amplitude.

        The amplitude is half the range of the reference, the smallest of the usual definitions.
        Defaults to positions and angles and to the stored reference.
        """
        columns = self.columns if columns is None else columns
        reference = self.load_reference(columns) if reference is None else reference
        return relative_deviations(self.select_columns(solution, columns), reference)


@cache
def load_references() -> dict[str, dict[str, list[float]]]:
    """Return the stored references: the values of each column by case."""
    table: dict[str, dict[str, list[float]]] = json.loads(REFERENCES.read_text("utf-8"))
    return table


def relative_deviations(rows: np.ndarray, reference: np.ndarray) -> np.ndarray:
    """Return the largest deviation of each column relative to half the reference range."""
    amplitude = 0.5 * np.ptp(reference, axis=0)
    return np.max(np.abs(rows - reference), axis=0) / amplitude
