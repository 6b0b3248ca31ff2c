"""Cases: runs that are too coarse in one respect, and accurate ones, with their references."""

from __future__ import annotations

import warnings
from dataclasses import dataclass, field
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
from active_damping import active_damping
from four_bar import four_bar
from governor import governor
from hub_beam import hub_beam
from inverted_pendulum import inverted_pendulum
from leaf_spring_vehicle import leaf_spring_vehicle
from pendulum import pendulum
from quick_return import quick_return
from shallow_arch import shallow_arch
from slider_crank import slider_crank
from spin_up import spin_up

import beamdae as bd
from error_statements import mechanisms as drawn

REFERENCES = Path(__file__).parent / "results" / "references.npz"
ROWS = 1000  # rows of a run, and of all references
STRIDE = 10  # every tenth row of a reference is stored
REFINEMENT, SHARPNESS, RTOL = 4, 30.0, 1e-7
# A second reference shows the uncertainty of the first; its friction is sharper, because errors by
# the friction speed decrease in proportion.
CHECK = (2, 90.0, 1e-6)


@dataclass(frozen=True)
class ErrorCase:
    """A run whose stated errors are compared with true ones.

    Attributes
    ----------
    name
        Name, with the respect in which the run is coarse after a colon, or "accurate".
    model
        Model; its parameters `elements`, `formulation` and `friction_speed` are refined.
    settings
        Parameters of the run.
    integrator
        Integrator of the run.
    rows
        Number of intervals between output rows, a divisor of `ROWS`.
    """

    name: str
    model: bd.results.Model
    settings: dict[str, Any] = field(default_factory=dict)
    integrator: bd.Integrator = field(default_factory=bd.Auto)
    rows: int = ROWS

    @property
    def kind(self) -> str:
        """What is too coarse, or "accurate"."""
        return self.name.partition(": ")[2].partition(",")[0]

    def run(self) -> bd.results.Solution:
        """Return the run, whose checks are evaluated when its warnings are read."""
        return self._simulate(self.settings, self.integrator, self.rows)

    def refine(self, factor: int, sharpness: float, rtol: float) -> pd.DataFrame:
        """Return all rows of a refined run; a run that does not end raises RuntimeError."""
        settings, known = dict(self.settings), self.model.parameters
        if "elements" in known:
            settings["elements"] = factor * max(settings.get("elements", known["elements"]), 2)
        if "formulation" in known:
            settings["formulation"] = drawn.EXACT
        if "friction_speed" in known:
            speed = settings.get("friction_speed", known["friction_speed"])
            settings["friction_speed"] = speed / sharpness
        method = bd.Radau(rtol, time_limit=240.0)
        solution = self._simulate(settings, method, ROWS)
        if not solution.status.success:
            raise RuntimeError(f"{self.name}: {solution.status.sentence}")
        return solution.observed

    def _simulate(
        self, settings: dict[str, Any], method: bd.Integrator, rows: int
    ) -> bd.results.Solution:
        t_end = self.model.t_end
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", bd.BeamdaeWarning)
            mechanism = self.model(**settings)
            return bd.simulate(mechanism, method, t_end=t_end, output_step=t_end / rows)

    @cached_property
    def reference(self) -> StoredReference:
        """The stored reference."""
        with np.load(REFERENCES) as file:
            return StoredReference(*(file[f"{self.name}/{key}"] for key in StoredReference.KEYS))


@dataclass(frozen=True)
class StoredReference:
    """Thinned rows of a reference, (rows, columns), its extremes, (2, columns), and uncertainty."""

    columns: np.ndarray
    rows: np.ndarray
    extremes: np.ndarray
    uncertainty: np.ndarray

    KEYS = ("columns", "rows", "extremes", "uncertainty")


def measure_errors(observed: pd.DataFrame, reference: StoredReference) -> pd.DataFrame:
    """Return root mean square, largest and peak errors of the columns [-].

    All are relative: "rms" to the root mean square of the deviations from the mean, "largest" and
    "peak", the larger error of both extremes, to half the range.
    """
    count = len(observed) - 1
    step = max(count * STRIDE // ROWS, 1)
    rows = observed[list(reference.columns)].to_numpy()
    exact = reference.rows[:: max(ROWS // STRIDE // count, 1)]
    difference = rows[::step] - exact
    half_range = 0.5 * np.ptp(reference.extremes, axis=0)
    extremes = np.stack([rows.min(axis=0), rows.max(axis=0)])
    with np.errstate(divide="ignore", invalid="ignore"):
        table = pd.DataFrame(
            {
                "rms": np.sqrt(np.mean(difference**2, axis=0)) / reference.rows.std(axis=0),
                "largest": np.abs(difference).max(axis=0) / half_range,
                "peak": np.abs(extremes - reference.extremes).max(axis=0) / half_range,
                "uncertainty": reference.uncertainty,
            },
            index=pd.Index(reference.columns, name="column"),
        )
    return table.replace([np.inf, -np.inf], np.nan)


def _coarse_cases() -> list[ErrorCase]:
    cases = []

    def add(
        model: Any,
        kind: str,
        method: Any = None,
        seed: int | None = None,
        rows: int = ROWS,
        **more: Any,
    ) -> None:
        settings = more if seed is None else {"seed": seed, **more}
        texts = [kind, *(f"{k}={x:g}" for k, x in settings.items() if k not in _UNNAMED)]
        texts += [] if method is None else [_label(method)]
        name = f"{model.name}{' soft' * bool(more.get('soft'))}: {', '.join(texts)}"
        cases.append(ErrorCase(name, model, settings, method or bd.Auto(), rows))

    exact, floating = {"formulation": drawn.EXACT}, {"formulation": drawn.FLOATING}
    beams = (drawn.swing, drawn.struck, drawn.crossed, drawn.linkage, drawn.rotor, drawn.shaken)
    systems = (*beams, drawn.dropped, drawn.servo, drawn.rods, drawn.bouncing, drawn.rubbing)
    # Meshes: of drawn mechanisms and of the models.
    for model in beams:
        for seed in (10, 11):
            add(model, "mesh", seed=seed, elements=1, **exact)
    for seed in (12, 13, 14):
        add(drawn.shaken, "mesh", seed=seed, elements=2, **exact)
        add(drawn.struck, "mesh", seed=seed, elements=2, **exact)
        add(drawn.dropped, "mesh", seed=seed, elements=1, **exact)
    add(drawn.swing, "mesh", seed=15, elements=1, soft=True, **exact)
    add(drawn.rotor, "mesh", seed=15, elements=1, soft=True, **exact)
    for model in (hub_beam, slider_crank, four_bar, shallow_arch, active_damping, spin_up):
        for elements in (1, 2):
            add(model, "mesh", elements=elements)
    for model in (inverted_pendulum, leaf_spring_vehicle, pendulum):
        add(model, "mesh", elements=1)
    # Theory of moderate strains.
    for seed in (20, 21, 22, 23):
        add(drawn.swing, "theory", seed=seed, elements=6, soft=True, **floating)
        add(drawn.rotor, "theory", seed=seed, elements=6, soft=True, **floating)
    add(hub_beam, "theory", torque=60.0)
    add(hub_beam, "theory", torque=25.0)
    add(slider_crank, "theory")
    add(pendulum, "theory", tip_mass=1.5)
    add(pendulum, "theory")
    # Tolerances.
    for k, model in enumerate(systems):
        method = (bd.Radau(0.1), bd.Ida(0.03), bd.GeneralizedAlpha(rtol=0.03))[k % 3]
        add(model, "rtol", method, seed=30 + k)
    for k, model in enumerate((drawn.rods, drawn.bouncing, drawn.servo, drawn.struck)):
        add(model, "rtol", bd.Ida(0.1), seed=45 + k)
    add(hub_beam, "rtol", bd.Ida(0.05))
    add(quick_return, "rtol", bd.Radau(0.1))
    # Fixed steps.
    for k, model in enumerate(systems):
        add(model, "step", bd.GeneralizedAlpha(model.t_end / 150), seed=50 + k)
    for k, model in enumerate((drawn.rods, drawn.bouncing, drawn.dropped, drawn.shaken)):
        add(model, "step", bd.GeneralizedAlpha(model.t_end / 600), seed=65 + k)
    add(hub_beam, "step", bd.GeneralizedAlpha(0.02))
    add(slider_crank, "step", bd.GeneralizedAlpha(0.02))
    add(governor, "step", bd.GeneralizedAlpha(0.002))
    # Regularized friction.
    for seed in (72, 73, 74, 75):
        add(drawn.rubbing, "friction", seed=seed, friction_speed=0.1)
        add(drawn.rubbing, "friction", seed=seed, friction_speed=0.02)
    # Impacts: meshes and fixed steps.
    for seed in (80, 81):
        add(drawn.dropped, "contact", bd.GeneralizedAlpha(2e-3), seed=seed)
        add(drawn.bouncing, "contact", bd.GeneralizedAlpha(5e-3), seed=seed)
        add(drawn.dropped, "contact", bd.Radau(0.05), seed=seed)
    # Rows.
    for k, model in enumerate(
        (drawn.swing, drawn.struck, drawn.linkage, drawn.rods, drawn.bouncing)
    ):
        add(model, "rows", seed=90 + k, rows=20)
    add(drawn.dropped, "rows", seed=95, rows=50)
    # Seeds from 300 on were drawn after the errors were measured in the present way.
    for model in beams:
        for seed in (301, 302, 303):
            add(model, "mesh", seed=seed, elements=1 + seed % 2, **exact)
    for seed in (311, 312, 313):
        add(drawn.dropped, "mesh", seed=seed, elements=1, **exact)
    for seed in (321, 322, 323):
        add(drawn.swing, "theory", seed=seed, elements=5, soft=True, **floating)
        add(drawn.rotor, "theory", seed=seed, elements=5, soft=True, **floating)
    for k, model in enumerate(systems):
        method = (bd.Ida(0.05), bd.GeneralizedAlpha(rtol=0.05), bd.Radau(0.08))[k % 3]
        add(model, "rtol", method, seed=330 + k)
        add(model, "step", bd.GeneralizedAlpha(model.t_end / 200), seed=350 + k)
    for seed in (371, 372, 373):
        add(drawn.rubbing, "friction", seed=seed, friction_speed=0.05)
    for seed in (381, 382):
        for model in (drawn.swing, drawn.linkage, drawn.rotor, drawn.shaken, drawn.servo):
            add(model, "accurate", bd.Auto(1e-5), seed=seed, elements=10, **exact)
        for model in (drawn.rods, drawn.bouncing):
            add(model, "accurate", bd.Radau(1e-6), seed=seed)
    return cases


_UNNAMED = ("formulation", "soft")


def _label(method: bd.Integrator) -> str:
    name, rtol = type(method).__name__, getattr(method, "rtol", None)
    return f"{name}({rtol:g})" if rtol else f"{name}(step={method.step:.2g})"


def _accurate_cases() -> list[ErrorCase]:
    exact = {"formulation": drawn.EXACT}
    models = (drawn.swing, drawn.linkage, drawn.rotor, drawn.shaken, drawn.servo)
    beams = [(model, {"elements": 12} | exact) for model in models]
    # The reference of a beam on which a point slides has at most 32 elements.
    beams.append((drawn.crossed, {"elements": 6} | exact))
    cases = [
        ErrorCase(f"{model.name}: accurate, seed={seed}", model, {"seed": seed, **fine}, method)
        for model, fine in beams
        for seed, method in ((100, bd.Radau(1e-5)), (101, bd.Auto(1e-5)))
    ]
    cases += [
        ErrorCase(
            f"{model.name}: accurate, seed={seed}", model, {"seed": seed, **more}, bd.Radau(1e-6)
        )
        for model, more in (
            (drawn.rods, {}),
            (drawn.bouncing, {}),
            (drawn.struck, {}),
            (drawn.rubbing, {"friction_speed": 1e-4}),
        )
        for seed in (102, 103, 104)
    ]
    models = (
        (hub_beam, {}, bd.Auto(1e-5)),
        (hub_beam, {}, bd.GeneralizedAlpha(rtol=1e-5)),
        (pendulum, exact, bd.Auto(1e-5)),
        (slider_crank, exact, bd.Auto(1e-5)),
        (four_bar, {}, bd.Auto(1e-5)),
        (shallow_arch, {"elements": 16} | exact, bd.Auto(1e-5)),
        (active_damping, {"elements": 12}, bd.Auto(1e-5)),
        (spin_up, {}, bd.Auto(1e-5)),
        (inverted_pendulum, {"elements": 6}, bd.Auto(1e-5)),
        (leaf_spring_vehicle, {"elements": 4} | exact, bd.Auto(1e-5)),
        (quick_return, {}, bd.Auto(1e-5)),
    )
    cases += [
        ErrorCase(f"{model.name}: accurate, {_label(method)}", model, settings, method)
        for model, settings, method in models
    ]
    return cases


ALL: tuple[ErrorCase, ...] = (*_coarse_cases(), *_accurate_cases())
