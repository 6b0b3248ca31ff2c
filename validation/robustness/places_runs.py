"""Public names in small working calls: models, integrators, studies, results."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import beamdae as bd
from beamdae.studies.execution.case_run import Limits
from robustness.places import MECHANISMS, NUMBERS, VARIANTS
from robustness.places_modes import MODES
from robustness.places_parts import PARTS
from robustness.places_periodic import PERIODIC
from robustness.places_solutions import SOLUTIONS, deep
from robustness.places_statics import STATICS
from robustness.places_stresses import STRESSES
from robustness.places_sweeps import SWEEPS
from robustness.places_systems import SYSTEMS
from robustness.world import (
    OUTPUT_STEP,
    T_END,
    TIME_LIMIT,
    Base,
    World,
    done,
    integrated,
    itself,
)

_LIMITS = {"max_step": None, "max_steps": 1000, "time_limit": TIME_LIMIT}
_OWN = ("method", "label", "order", "accuracy")


def _own_integrator(world: World, **members: Any) -> bd.Integrator:
    """An integrator of a user's own, one member of which says something else."""
    answers = {
        name: property(lambda self, value=value: value)
        for name, value in members.items()
        if name in _OWN
    }
    result = members["integrate"]
    answers["integrate"] = lambda self, *a, **more: result
    return type("Odd", (bd.GeneralizedAlpha,), answers)(2e-3)


def _own_members(world: World) -> dict[str, Any]:
    like = bd.GeneralizedAlpha(2e-3)
    return {name: getattr(like, name) for name in _OWN} | {"integrate": world.solution}


def _study(world: World) -> dict[str, Any]:
    return {
        "references": (bd.Radau(1e-5), bd.GeneralizedAlpha(5e-4)),
        "columns": ("bob.x [m]",),
        "t_end": T_END,
        "output_step": OUTPUT_STEP,
        "repetitions": 1,
        "over": None,
        "errors": None,
    }


def _studied(world: World, decorate: Any) -> Any:
    def few() -> list[bd.Case]:
        return [world.case(mass=2.0)]

    return done(world, decorate(few))


def _swing_of(world: World, build: Any, t_end: Any, parameters: Any) -> Any:
    return bd.Model(build, t_end, parameters)


def _compared(world: World) -> dict[str, Any]:
    return {
        "cases": [world.case(mass=2.0)],
        "reference": world.case(),
        "columns": ("bob.x [m]",),
        "t_end": T_END,
        "output_step": OUTPUT_STEP,
        "progress": None,
    }


def _ran(world: World, model: Any) -> bd.Solution:
    return world.run(model)


def _returning(mechanism: Any) -> bd.Model:
    def swing() -> Any:
        return mechanism

    return bd.model(t_end=T_END)(swing)


def _listing(cases: Any) -> bd.Study:
    def few() -> Any:
        return cases

    return bd.study(output_step=OUTPUT_STEP)(few)


def _loaded(world: World, path: Any, name: Any) -> bd.Model:
    world.write_model()
    return bd.load_model(path, name)


MODELS: dict[str, Base] = {
    "Model": Base(
        lambda w: {
            "build": w.swing.build,
            "t_end": T_END,
            "parameters": w.swing.parameters,
            "data": (__file__,),
        },
        _ran,
    ),
    "Model of": Base(
        lambda w: {"mass": 1.0, "spin": 1, "stiff": True, "name": "bob", "at": (1.0, 0.0)},
        _ran,
        lambda w, **given: w.swing(**given),
    ),
    "model": Base(
        lambda w: {"t_end": T_END, "data": (__file__,)},
        lambda w, decorate: bd.simulate(decorate(w.swing.build), w.integrator),
    ),
    "model defaults": Base(
        lambda w: {"mass": 1.0, "spin": 1, "name": "bob", "at": (1.0, 0.0)},
        _ran,
        lambda w, **defaults: bd.Model(w.swing.build, T_END, {"stiff": True, **defaults}),
    ),
    "model returning": Base(
        lambda w: {"mechanism": w.mech},
        _ran,
        lambda w, mechanism: _returning(mechanism),
    ),
    "load_model": Base(lambda w: {"path": "out/swing.py", "name": "swing"}, _ran, _loaded),
    "simulate": Base(
        lambda w: {
            "model": w.mech,
            "integrator": w.integrator,
            "t_end": T_END,
            "output_step": OUTPUT_STEP,
            "progress": lambda t: None,
            "start": "as drawn",
            "accept_changes": False,
        },
        itself,
    ),
    "check": Base(lambda w: {"model": w.mech, "t_end": T_END, "predict": False}, itself),
    "Equilibrium.to_csv": Base(
        lambda w: {"path": Path("path.csv")},
        itself,
        lambda w, path: deep(w, bd.equilibrium(w.mech).to_csv, path),
    ),
}

INTEGRATING: dict[str, Base] = {
    "Auto": Base(lambda w: {"rtol": 1e-3, **_LIMITS}, integrated),
    "GeneralizedAlpha": Base(
        lambda w: {
            "step": 2e-3,
            "rho_inf": 0.8,
            "formulation": "index3",
            "start": "cured",
            "newton_tolerance": 1e-7,
            "linear_solver": "auto",
            "time_limit": TIME_LIMIT,
            "family": "hht",
        },
        integrated,
    ),
    "GeneralizedAlpha adaptive": Base(
        lambda w: {"rtol": 1e-3, "max_steps": 1000, "time_limit": TIME_LIMIT, "step": 1e-3},
        integrated,
        lambda w, **given: bd.GeneralizedAlpha(**given),
    ),
    "Ida": Base(
        lambda w: {
            "rtol": 1e-3,
            "formulation": "ggl",
            "error_control": "positions",
            "max_order": 2,
            "linear_solver": "auto",
            **_LIMITS,
        },
        integrated,
    ),
    "Integrator": Base(_own_members, integrated, _own_integrator),
    "Radau": Base(
        lambda w: {
            "rtol": 1e-3,
            "error_control": "positions",
            "linear_solver": "auto",
            **_LIMITS,
        },
        integrated,
    ),
}

RESULTS: dict[str, Base] = {
    "Case": Base(
        lambda w: {"model": w.swing, "parameters": {"mass": 2.0}, "integrator": w.integrator},
        lambda w, case: case.solve(T_END, OUTPUT_STEP),
    ),
    "Case parameters": Base(
        lambda w: {"mass": 2.0, "spin": 1, "at": (1.0, 0.0)},
        lambda w, case: done(w, bd.Study("few", (case,), output_step=OUTPUT_STEP)),
        lambda w, **values: w.case(**values),
    ),
    "Study": Base(
        lambda w: {"name": "few", "cases": (w.case(mass=2.0),), "limits": Limits(10.0)} | _study(w),
        done,
    ),
    "study": Base(
        lambda w: {**_study(w), "time_limit": 10.0, "memory_limit": 4.0, "patience": 5.0}, _studied
    ),
    "study listing": Base(
        lambda w: {"cases": [w.case(mass=2.0)]},
        done,
        lambda w, cases: _listing(cases),
    ),
    "compare": Base(_compared, itself),
    "grid": Base(
        lambda w: {"mass": [1.0, 2.0]},
        lambda w, rows: bd.compare([w.case(**row) for row in rows]),
        lambda w, **lists: bd.grid(**lists),
    ),
}


BASES: dict[str, Base] = PARTS | VARIANTS | NUMBERS | MECHANISMS | SYSTEMS
BASES |= MODELS | INTEGRATING | RESULTS | SOLUTIONS | STATICS | STRESSES | PERIODIC | MODES | SWEEPS

# What beamdae makes and users do not; as an argument each is met above.
NOT_CALLED = {
    "Joint": "base class of joints",
    "Animation": "what animate gives",
    "BeamRange": "a row of Solution.validity",
    "Frame": "what bd.frame gives",
    "PeriodicMotion": "what periodic gives",
    "ResponsePoint": "a point of FrequencyResponse",
    "BeamdaeError": "what users are told by",
    "BeamdaeWarning": "what users are warned by",
    "Campbell": "what campbell gives",
    "Check": "what check gives",
    "CriticalPoint": "a row of Equilibrium.critical",
    "EquationsOfMotion": "what equations_of_motion gives",
    "Plot": "what plot gives",
    "Sweep": "what sweep decorates",
    "SweepResults": "what sweep gives",
    "SavedRun": "what load gives",
}
# Arguments users do not give.
_TOLD = ("Solution", "Equilibrium", "SectionForces", "FrequencyResponse", "Modes", "LinearModel")
NOT_GIVEN = {name: {"*"} for name in _TOLD}
