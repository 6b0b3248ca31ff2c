"""Working calls of models, integrators, solutions, studies and sweeps."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import beamdae as bd
from robustness.inputs.sandbox import (
    KNEE,
    OUTPUT_STEP,
    RUN_TIME_LIMIT,
    T_END,
    Sandbox,
    WorkingCall,
    return_result,
    run_study,
    run_with_integrator,
    write_two_folders_down,
)


def _function_returning(values: Any) -> Any:
    def few() -> Any:
        return values

    return few


def _run_decorated_sweep(sandbox: Sandbox, over: Any) -> bd.results.SweepResults:
    return bd.sweep(sandbox.swing, integrator=sandbox.integrator, t_end=T_END)(
        _function_returning(over)
    )()


def _run_sweep(sandbox: Sandbox) -> bd.results.SweepResults:
    return bd.sweep(sandbox.swing, {"mass": [1.0, 2.0]}, integrator=sandbox.integrator, t_end=T_END)


def _sweep_into_folder(sandbox: Sandbox, folder: Any, **arguments: Any) -> bd.results.SweepResults:
    results: list[bd.results.SweepResults] = []
    write_two_folders_down(
        sandbox, lambda path: results.append(bd.sweep(**arguments, folder=path)), folder
    )
    return results[0]


def _get_table(sandbox: Sandbox, result: bd.results.SweepResults) -> Any:
    return result.table


def _plot_sweep(sandbox: Sandbox, names: Any, x: Any) -> None:
    _run_sweep(sandbox).plot(names, x=x)


SWEEP_CALLS: dict[str, WorkingCall] = {
    "sweep": WorkingCall(
        lambda box: {
            "model": box.swing,
            "over": {"mass": [1.0, 2.0]},
            "of": ("bob.x",),
            "outputs": {"rows": lambda run: len(run.t)},
            "integrator": box.integrator,
            "t_end": T_END,
            "output_step": OUTPUT_STEP,
            "start": "as drawn",
            "time_limit": 10.0,
            "measure": None,
            "folder": "sweep",
            "jobs": 1,
            "scheduler": None,
            "progress": lambda standing: None,
            "partial": "raise",
        },
        _get_table,
        _sweep_into_folder,
    ),
    "sweep measure": WorkingCall(
        lambda box: {"measure": {"parts": lambda model: len(model().parts)}, "jobs": 1},
        _get_table,
        lambda box, **arguments: bd.sweep(box.swing, {"mass": [1.0, 2.0]}, **arguments),
    ),
    "sweep values": WorkingCall(
        lambda box: {"mass": [1.0, 2.0], "spin": (1,)},
        _get_table,
        lambda box, **over: bd.sweep(box.swing, over, t_end=T_END, integrator=box.integrator),
    ),
    "sweep combinations": WorkingCall(
        lambda box: {"over": [{"mass": 1.0}]}, _get_table, _run_decorated_sweep
    ),
    "sweep.plot": WorkingCall(
        lambda box: {"names": "bob.x max", "x": "mass"}, lambda box, _: None, _plot_sweep
    ),
    "sweep.run": WorkingCall(
        lambda box: {"mass": 2.0},
        lambda box, run: run.table(),
        lambda box, **arguments: _run_sweep(box).run(**arguments),
    ),
}


SOLUTION_CALLS: dict[str, WorkingCall] = {
    "verify": WorkingCall(
        lambda box: {
            "solution": box.solution,
            "integrator": bd.Radau(1e-4),
            "progress": lambda standing: None,
        },
        return_result,
    ),
    "load": WorkingCall(
        lambda box: {"path": "run.beamdae", "model": box.mech},
        return_result,
        lambda box, **arguments: _save_and_load(box, **arguments),
    ),
    "Solution.save": WorkingCall(
        lambda box: {"path": "run.beamdae"},
        return_result,
        lambda box, path: write_two_folders_down(box, box.solution.save, path),
    ),
    "Solution.difference": WorkingCall(
        lambda box: {"other": box.solution},
        return_result,
        lambda box, other: box.solution.difference(other),
    ),
    "plot": WorkingCall(
        lambda box: {
            "solutions": [box.solution],
            "labels": ["run"],
            "x": "knee.x",
            "data": {"t [s]": [0.0, 0.1], "knee.x [mm]": [0.0, 1.0], "height": [0.0, 1.0]},
            "data_columns": {"height": "knee.y"},
        },
        return_result,
    ),
    "Solution.animate": WorkingCall(
        lambda box: {
            "path": box.folder / "run.gif",
            "speed": 1.0,
            "frames": 3,
            "color": "M",
            "trail": True,
            "scale": 2.0,
        },
        return_result,
        lambda box, **settings: (box.beam, box.solution)[1].animate(**settings),
    ),
    "Solution.observe": WorkingCall(
        lambda box: {"name": "middle", "what": box.bar.at(*KNEE)},
        return_result,
        lambda box, **arguments: box.solution.observe(**arguments),
    ),
    "Solution.__getitem__": WorkingCall(
        lambda box: {"name": "bar.angle"}, return_result, lambda box, name: box.solution[name]
    ),
    "Solution.step_response": WorkingCall(
        lambda box: {"name": "knee.x", "target": 1.5, "t": 0.0, "band": 0.02},
        return_result,
        lambda box, **arguments: box.solution.step_response(**arguments),
    ),
    "Solution.to_csv": WorkingCall(
        lambda box: {"path": Path("run.csv")},
        return_result,
        lambda box, path: write_two_folders_down(box, box.solution.to_csv, path),
    ),
}


def _save_and_load(sandbox: Sandbox, path: Any, model: Any) -> Any:
    file = sandbox.solution.save("run.beamdae")
    try:
        return bd.load(path, model)
    finally:
        file.unlink()


_LIMITS = {"max_step": None, "max_steps": 1000, "time_limit": RUN_TIME_LIMIT}
_INTEGRATOR_MEMBERS = ("method", "label", "order", "accuracy")


def _make_integrator(sandbox: Sandbox, **members: Any) -> bd.Integrator:
    """Return an integrator of a user's class that overrides members with constant values."""
    answers = {
        name: property(lambda self, value=value: value)
        for name, value in members.items()
        if name in _INTEGRATOR_MEMBERS
    }
    result = members["integrate"]
    answers["integrate"] = lambda self, *a, **more: result
    return type("Odd", (bd.GeneralizedAlpha,), answers)(2e-3)


def _integrator_members(sandbox: Sandbox) -> dict[str, Any]:
    like = bd.GeneralizedAlpha(2e-3)
    return {name: getattr(like, name) for name in _INTEGRATOR_MEMBERS} | {
        "integrate": sandbox.solution
    }


def _study_arguments(sandbox: Sandbox) -> dict[str, Any]:
    return {
        "references": (bd.Radau(1e-5), bd.GeneralizedAlpha(5e-4)),
        "columns": ("bob.x [m]",),
        "t_end": T_END,
        "output_step": OUTPUT_STEP,
        "repetitions": 1,
        "over": None,
    }


def _run_decorated_study(sandbox: Sandbox, decorate: Any) -> Any:
    def few() -> list[bd.Case]:
        return [sandbox.case(mass=2.0)]

    return run_study(sandbox, decorate(few))


def _compare_arguments(sandbox: Sandbox) -> dict[str, Any]:
    return {
        "cases": [sandbox.case(mass=2.0)],
        "reference": sandbox.case(),
        "columns": ("bob.x [m]",),
        "t_end": T_END,
        "output_step": OUTPUT_STEP,
        "progress": None,
        "partial": "raise",
    }


def _run_model(sandbox: Sandbox, model: Any) -> bd.results.Solution:
    return sandbox.run(model)


def _model_returning(mechanism: Any) -> bd.results.Model:
    def swing() -> Any:
        return mechanism

    return bd.model(t_end=T_END)(swing)


def _study_listing(cases: Any) -> bd.results.Study:
    def few() -> Any:
        return cases

    return bd.study(output_step=OUTPUT_STEP)(few)


def _load_written_model(sandbox: Sandbox, path: Any, name: Any) -> bd.results.Model:
    sandbox.write_model()
    return bd.load_model(path, name)


def _close_view(box: Sandbox, live: bd.results.LiveView) -> str:
    live.close()
    return live.url


MODEL_CALLS: dict[str, WorkingCall] = {
    "Model": WorkingCall(
        lambda box: {
            "build": box.swing.build,
            "t_end": T_END,
            "parameters": box.swing.parameters,
            "data": (__file__,),
        },
        _run_model,
    ),
    "Model of": WorkingCall(
        lambda box: {"mass": 1.0, "spin": 1, "stiff": True, "name": "bob", "at": (1.0, 0.0)},
        _run_model,
        lambda box, **arguments: box.swing(**arguments),
    ),
    "model": WorkingCall(
        lambda box: {"t_end": T_END, "data": (__file__,)},
        lambda box, decorate: bd.simulate(decorate(box.swing.build), box.integrator),
    ),
    "model defaults": WorkingCall(
        lambda box: {"mass": 1.0, "spin": 1, "name": "bob", "at": (1.0, 0.0)},
        _run_model,
        lambda box, **defaults: bd.results.Model(
            box.swing.build, T_END, {"stiff": True, **defaults}
        ),
    ),
    "model returning": WorkingCall(
        lambda box: {"mechanism": box.mech},
        _run_model,
        lambda box, mechanism: _model_returning(mechanism),
    ),
    "load_model": WorkingCall(
        lambda box: {"path": "out/swing.py", "name": "swing"}, _run_model, _load_written_model
    ),
    "simulate": WorkingCall(
        lambda box: {
            "model": box.mech,
            "integrator": box.integrator,
            "t_end": T_END,
            "output_step": OUTPUT_STEP,
            "progress": lambda t: None,
            "start": "as drawn",
            "accept_changes": False,
            "partial": "raise",
            "keep_steps": True,
            "sensitivities": None,
        },
        return_result,
    ),
    "simulate sensitivities": WorkingCall(
        lambda box: {"sensitivities": ("mass",), "output_step": OUTPUT_STEP},
        return_result,
        lambda box, **arguments: bd.simulate(box.swing, bd.Radau(1e-6), **arguments),
    ),
    "param": WorkingCall(
        lambda box: {"default": 1.0, "unit": "m", "description": "length of the rope"},
        return_result,
    ),
    "Model.view": WorkingCall(
        lambda box: {
            "ranges": {"mass": (1.0, 2.0)},
            "t_end": T_END,
            "time_limit": 1.0,
            "port": 0,
            "browser": False,
        },
        _close_view,
        lambda box, **settings: box.swing.view(**settings),
    ),
    "check": WorkingCall(
        lambda box: {
            "model": box.mech,
            "t_end": T_END,
            "predict": False,
            "start": "as drawn",
        },
        return_result,
    ),
    "Equilibrium.to_csv": WorkingCall(
        lambda box: {"path": Path("path.csv")},
        return_result,
        lambda box, path: write_two_folders_down(box, bd.equilibrium(box.mech).to_csv, path),
    ),
}

INTEGRATOR_CALLS: dict[str, WorkingCall] = {
    "Auto": WorkingCall(lambda box: {"rtol": 1e-3, **_LIMITS}, run_with_integrator),
    "GeneralizedAlpha": WorkingCall(
        lambda box: {
            "step": 2e-3,
            "rho_inf": 0.8,
            "formulation": "index3",
            "start": "cured",
            "newton_tolerance": 1e-7,
            "time_limit": RUN_TIME_LIMIT,
            "family": "hht",
        },
        run_with_integrator,
    ),
    "GeneralizedAlpha adaptive": WorkingCall(
        lambda box: {"rtol": 1e-3, "max_steps": 1000, "time_limit": RUN_TIME_LIMIT, "step": 1e-3},
        run_with_integrator,
        lambda box, **arguments: bd.GeneralizedAlpha(**arguments),
    ),
    "Ida": WorkingCall(
        lambda box: {
            "rtol": 1e-3,
            "formulation": "ggl",
            "error_control": "positions",
            "max_order": 2,
            **_LIMITS,
        },
        run_with_integrator,
    ),
    "Integrator": WorkingCall(_integrator_members, run_with_integrator, _make_integrator),
    "Radau": WorkingCall(
        lambda box: {
            "rtol": 1e-3,
            "error_control": "positions",
            **_LIMITS,
        },
        run_with_integrator,
    ),
}

STUDY_CALLS: dict[str, WorkingCall] = {
    "Case": WorkingCall(
        lambda box: {
            "model": box.swing,
            "parameters": {"mass": 2.0},
            "integrator": box.integrator,
            "start": "as drawn",
        },
        lambda box, case: case.solve(T_END, OUTPUT_STEP),
    ),
    "Case parameters": WorkingCall(
        lambda box: {"mass": 2.0, "spin": 1, "at": (1.0, 0.0)},
        lambda box, case: run_study(box, bd.results.Study("few", (case,), output_step=OUTPUT_STEP)),
        lambda box, **values: box.case(**values),
    ),
    "Study": WorkingCall(
        lambda box: (
            {"name": "few", "cases": (box.case(mass=2.0),), "time_limit": 10.0}
            | _study_arguments(box)
        ),
        run_study,
    ),
    "study": WorkingCall(
        lambda box: {
            **_study_arguments(box),
            "time_limit": 10.0,
        },
        _run_decorated_study,
    ),
    "study listing": WorkingCall(
        lambda box: {"cases": [box.case(mass=2.0)]},
        run_study,
        lambda box, cases: _study_listing(cases),
    ),
    "compare": WorkingCall(_compare_arguments, return_result),
    "grid": WorkingCall(
        lambda box: {"mass": [1.0, 2.0]},
        lambda box, rows: bd.compare([box.case(**row) for row in rows]),
        lambda box, **lists: bd.grid(**lists),
    ),
}
