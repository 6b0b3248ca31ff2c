"""Cases of the tolerance study: models, compared columns, stored references, error measure.

`cases.csv` lists the cases: five of published models ("paper"), the set with which default settings
were chosen ("wide"), and one that was written afterwards ("new"). The middle of an undamped beam
after a step of loads is not compared where no second method resolves its vibration; cantilevers
have two elements for the same reason.
"""

import json
from collections.abc import Callable
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from pkgutil import resolve_name
from typing import Any

import numpy as np
import pandas as pd
from benchmarks import systems
from tolerances.flexible_mechanisms import CRANK_END
from tolerances.mechanisms import double_four_bar_motion, kepler_motion

import beamdae as bd

FOLDER = Path(__file__).parent
REFERENCES = FOLDER / "references" / "references.json"
STORED_DIGITS = 9  # significant digits of the stored references

# Closed forms of all compared columns at given times, and published values at the end.
CLOSED_FORMS: dict[str, Callable[[np.ndarray], np.ndarray]] = {
    "arevalo": systems.arevalo_motion,
    "period_two": systems.released_pendulum_motion,
    "iftomm_pendulum": systems.iftomm_motion,
    "free_particle": systems.free_particle_motion,
    "double_four_bar": double_four_bar_motion,
    "double_four_bar_long": double_four_bar_motion,
    "kepler": kepler_motion,
}
PUBLISHED = {
    "car_axis": systems.CAR_AXIS_END,
    "iftomm_pendulum": systems.IFTOMM_END,
    "spring_slider_crank": systems.SPRING_SLIDER_CRANK_END,
    "ivp_crank": CRANK_END,
}


@dataclass(frozen=True)
class ToleranceCase:
    """A model whose observed columns are compared with a stored reference.

    Attributes
    ----------
    set
        "paper", "wide" or "new".
    model
        Model function.
    parameters
        Parameters of the model that differ from its defaults.
    duration
        End time [s].
    rows
        Number of output times from 0 to the end.
    bound
        Guaranteed error over rtol: 30 for damped models, 100 for undamped ones.
    columns
        Observed positions and angles.
    deflections
        Observed displacements and rotations of beams relative to a body or to their undeformed
        shape; their errors are listed separately.
    rates
        Observed velocities and angular velocities; their errors are listed separately.
    reactions
        Observed forces and moments; their errors are listed separately.
    beams
        Beams whose deflection in the middle is observed as "<beam> bend", in addition to what the
        model observes.
    modal
        True if the modes of the linearized equations represent the motion.
    """

    name: str
    set: str
    model: bd.results.Model
    parameters: dict[str, Any]
    duration: float
    rows: int
    bound: float
    columns: tuple[str, ...]
    deflections: tuple[str, ...]
    rates: tuple[str, ...]
    reactions: tuple[str, ...]
    beams: tuple[str, ...]
    modal: bool

    @property
    def exact(self) -> Callable[[np.ndarray], np.ndarray] | None:
        """Closed form of all compared columns at given times, if one exists."""
        return CLOSED_FORMS.get(self.name)

    @property
    def published(self) -> dict[str, float]:
        """Published values of columns at the end."""
        return PUBLISHED.get(self.name, {})

    @property
    def compared(self) -> tuple[str, ...]:
        """All compared columns."""
        return self.columns + self.deflections + self.rates + self.reactions

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
        return relative_deviations(solution.observed[list(columns)].to_numpy(), reference)


@cache
def load_references() -> dict[str, dict[str, list[float]]]:
    """Return the stored references: the values of each column by case."""
    table: dict[str, dict[str, list[float]]] = json.loads(REFERENCES.read_text("utf-8"))
    return table


def relative_deviations(rows: np.ndarray, reference: np.ndarray) -> np.ndarray:
    """Return the largest deviation of each column relative to half the reference range."""
    amplitude = 0.5 * np.ptp(reference, axis=0)
    return np.max(np.abs(rows - reference), axis=0) / amplitude


def _read_cases() -> tuple[ToleranceCase, ...]:
    table, cases = pd.read_csv(FOLDER / "cases.csv", dtype=str, keep_default_na=False), []
    for row in table.to_dict("records"):
        model = resolve_name(row["model"])
        names = (row[x] for x in ("columns", "deflections", "rates", "reactions", "beams"))
        cases.append(
            ToleranceCase(
                row["case"],
                row["set"],
                model,
                json.loads(row["parameters"] or "{}"),
                float(row["t_end"] or model.t_end),
                int(row["rows"]),
                float(row["bound"]),
                *(tuple(filter(None, x.split("; "))) for x in names),
                modal=row["modal"] == "yes",
            )
        )
    return tuple(cases)


ALL = _read_cases()
CASES = tuple(case for case in ALL if case.set == "paper")
