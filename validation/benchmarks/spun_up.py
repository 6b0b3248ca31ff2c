"""The spin-up manoeuvre by every integrator, against an independent computation and a closed form.

The data are those of `pan_liu_2012/manoeuvre.py`: a tip known at eight times and at its peak, and
the extension of the beam that turns steadily.
"""

from __future__ import annotations

import sys
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

sys.path.insert(0, str(Path(__file__).parents[2] / "models"))

import numpy as np
from pan_liu_2012.manoeuvre import EXACT, EXACT_PEAK, STEADY_EXTENSION
from spin_up import spin_up

import beamdae as bd
from benchmarks.bent_beams import FORMULATIONS

ELEMENTS, SPIN_UP = 8, "spin-up"
# Of largest displacements, and of the extension.
TRANSIENT, STEADY = 1e-3, 1e-4
TRANSIENT_RUNS = {
    "Ida rtol 1e-06": bd.Ida(1e-6),
    "Radau rtol 1e-06": bd.Radau(1e-6),
    "GeneralizedAlpha rtol 1e-05": bd.GeneralizedAlpha(rtol=1e-5),
    "GeneralizedAlpha step 0.001": bd.GeneralizedAlpha(1e-3),
}
# An extension of 5e-5 of the length, to 4 digits.
STEADY_RUNS = {
    "Ida rtol 1e-08": bd.Ida(1e-8),
    "Radau rtol 1e-06": bd.Radau(1e-6),
    "GeneralizedAlpha rtol 1e-06": bd.GeneralizedAlpha(rtol=1e-6),
    "GeneralizedAlpha step 0.001": bd.GeneralizedAlpha(1e-3),
}
_TIP = [f"deformation.{component} [m]" for component in "uv"]


@dataclass(frozen=True)
class SpunUp:
    """A formulation and an integrator of each of the two runs."""

    formulation: str
    transient: str
    steady: str
    name = SPIN_UP

    def rows(self) -> Iterator[dict[str, Any]]:
        """The worst of the times known, both peaks, and the steady extension."""
        words = FORMULATIONS[self.formulation]
        # Every 2 ms a peak is met to 1e-6 of it.
        run = self._run(TRANSIENT_RUNS[self.transient], words, 20.0, 2e-3)
        tip = run.observed[_TIP].to_numpy()
        known = EXACT.to_numpy()
        at = np.searchsorted(run.t, EXACT.index.to_numpy() - 1e-9)
        for k, name in enumerate("uv"):
            worst = int(np.argmax(np.abs(tip[at, k] - known[:, k])))
            yield self._row(
                self.transient, run, name, known[worst, k], tip[at[worst], k], known[:, k]
            )
        for k, name in ((0, "peak of u"), (1, "peak of v")):
            peak = EXACT_PEAK[1 - k]
            yield self._row(self.transient, run, name, peak, float(tip[:, k].min()), [peak])
        # Damping leaves what does not change as it is.
        run = self._run(STEADY_RUNS[self.steady], {**words, "damping": 0.5}, 25.0, 0.1)
        ours = run.observed[_TIP[0]].iloc[-1]
        yield self._row(self.steady, run, "extension", STEADY_EXTENSION, ours, [STEADY_EXTENSION])

    def _run(
        self, integrator: Any, words: Mapping[str, Any], t_end: float, output_step: float
    ) -> bd.Solution:
        given = {k: x for k, x in words.items() if k != "frame"}
        solution = bd.simulate(
            spin_up(elements=ELEMENTS, **given), integrator, t_end, output_step=output_step
        )
        assert solution.status.success, solution.status.sentence
        return solution

    def _row(
        self, setting: str, run: bd.Solution, name: str, known: float, ours: float, all_known: Any
    ) -> dict[str, Any]:
        error = abs(ours - known)
        return {
            "case": SPIN_UP,
            "setting": f"{self.formulation}, {ELEMENTS} elements, {setting}",
            "quantity": name,
            "published": f"{known:.10g}",
            "ours": f"{ours:.10g}",
            "error": f"{error:.2e}",
            "relative": f"{error / np.max(np.abs(all_known)):.2e}",
            "steps": run.statistics.steps,
            "drift": f"{run.quality.max_position_drift:.1e}",
            "energy imbalance": f"{run.quality.energy_imbalance:.1e}",
            "ended": "",
        }


SPUN_UP = [
    SpunUp(formulation, *runs)
    for formulation in FORMULATIONS
    for runs in zip(TRANSIENT_RUNS, STEADY_RUNS, strict=True)
]
