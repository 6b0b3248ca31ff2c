"""The spin-up maneuver by every integrator, against an independent computation and a closed form.

The references are those of `pan_liu_2012/dynamic_stiffening.py`: the tip at eight times and at its
peak, and the extension of the beam in steady rotation.
"""

from __future__ import annotations

import sys
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

sys.path.insert(0, str(Path(__file__).parents[2] / "models"))

import numpy as np
from pan_liu_2012.dynamic_stiffening import (
    EXACT,
    EXACT_LARGEST_DEFLECTION,
    EXACT_LARGEST_SHORTENING,
    STEADY_EXTENSION,
)
from spin_up import spin_up

import beamdae as bd
from benchmarks.static_cases import FORMULATIONS
from benchmarks.summary_rows import describe_run, make_row

ELEMENTS = 8
CASE_NAME = "spin-up"
TRANSIENT_TOLERANCE = 1e-3  # relative to the largest displacement
STEADY_TOLERANCE = 1e-4  # relative to the extension
TRANSIENT_RUNS = {
    "Ida rtol 1e-06": bd.Ida(1e-6),
    "Radau rtol 1e-06": bd.Radau(1e-6),
    "GeneralizedAlpha rtol 1e-05": bd.GeneralizedAlpha(rtol=1e-5),
    "GeneralizedAlpha step 0.001": bd.GeneralizedAlpha(1e-3),
}
# The extension is 5e-5 of the length and known to 4 digits.
STEADY_RUNS = {
    "Ida rtol 1e-08": bd.Ida(1e-8),
    "Radau rtol 1e-06": bd.Radau(1e-6),
    "GeneralizedAlpha rtol 1e-06": bd.GeneralizedAlpha(rtol=1e-6),
    "GeneralizedAlpha step 0.001": bd.GeneralizedAlpha(1e-3),
}
_TIP = [f"deformation.{component} [m]" for component in "uv"]


@dataclass(frozen=True)
class SpinUpCase:
    """A formulation and the integrators of the transient and the steady run."""

    formulation: str
    transient: str
    steady: str
    name = CASE_NAME

    def rows(self) -> Iterator[dict[str, Any]]:
        """Yield rows of the worst of the eight times, both peaks and the steady extension."""
        settings = FORMULATIONS[self.formulation]
        # Sampling every 2 ms resolves a peak to 1e-6 of it.
        run = self._run(TRANSIENT_RUNS[self.transient], settings, 20.0, 2e-3)
        tip = run.observed[_TIP].to_numpy()
        reference = EXACT.to_numpy()
        rows = np.searchsorted(run.t, EXACT.index.to_numpy() - 1e-9)
        for k, name in enumerate("uv"):
            worst = int(np.argmax(np.abs(tip[rows, k] - reference[:, k])))
            yield self._row(
                self.transient, run, name, reference[worst, k], tip[rows[worst], k], reference[:, k]
            )
        peaks = {"peak of u": EXACT_LARGEST_SHORTENING, "peak of v": EXACT_LARGEST_DEFLECTION}
        for k, (name, peak) in enumerate(peaks.items()):
            yield self._row(self.transient, run, name, peak, float(tip[:, k].min()), [peak])
        # Damping does not change the steady state.
        run = self._run(STEADY_RUNS[self.steady], {**settings, "damping": 0.5}, 25.0, 0.1)
        computed = run.observed[_TIP[0]].iloc[-1]
        yield self._row(
            self.steady, run, "extension", STEADY_EXTENSION, computed, [STEADY_EXTENSION]
        )

    def _run(
        self, integrator: Any, settings: Mapping[str, Any], t_end: float, output_step: float
    ) -> bd.results.Solution:
        parameters = {k: x for k, x in settings.items() if k != "frame"}
        solution = bd.simulate(
            spin_up(elements=ELEMENTS, **parameters), integrator, t_end, output_step=output_step
        )
        assert solution.status.success, solution.status.sentence
        return solution

    def _row(
        self,
        setting: str,
        run: bd.results.Solution,
        name: str,
        reference: float,
        computed: float,
        references: Any,
    ) -> dict[str, Any]:
        return make_row(
            CASE_NAME,
            f"{self.formulation}, {ELEMENTS} elements, {setting}",
            name,
            reference,
            computed,
            scale=np.max(np.abs(references)),
            digits=10,
            **describe_run(run),
        )


SPIN_UP_CASES = [
    SpinUpCase(formulation, *runs)
    for formulation in FORMULATIONS
    for runs in zip(TRANSIENT_RUNS, STEADY_RUNS, strict=True)
]
