"""Working calls of models, integrators, solutions, studies and sweeps."""

from pathlib import Path
from typing import Any

from robustness.inputs.command_line import GOOD_MODEL
from robustness.inputs.sandbox import (
    KNEE,
    OUTPUT_STEP,
    RUN_TIME_LIMIT,
    T_END,
    Sandbox,
    WorkingCall,
    run_study,
    run_with_integrator,
    run_with_law,
    run_with_part,
    tabulate,
)

import beamdae as bd


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


def _get_table(sandbox: Sandbox, result: bd.results.SweepResults) -> Any:
    return result.table


SWEEP_CALLS: dict[str, WorkingCall] = {
    "sweep": WorkingCall(
        lambda box: {
            "model": box.swing,
            "over": {"mass": [1.0, 2.0]},
            "parameters": {},
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
        writes=True,
    ),
    "sweep measure": WorkingCall(
        lambda box: {"measure": {"parts": lambda model: len(model().parts)}, "jobs": 1},
        _get_table,
        call=lambda box, **arguments: bd.sweep(box.swing, {"mass": [1.0, 2.0]}, **arguments),
    ),
    "sweep values": WorkingCall(
        lambda box: {"mass": [1.0, 2.0], "spin": (1,)},
        _get_table,
        call=lambda box, **over: bd.sweep(box.swing, over, t_end=T_END, integrator=box.integrator),
    ),
    "sweep combinations": WorkingCall(
        lambda box: {"over": [{"mass": 1.0}]}, _get_table, call=_run_decorated_sweep
    ),
    "sweep.plot": WorkingCall(
        lambda box: {"names": "bob.x max", "x": "mass"},
        lambda box, _: None,
        call=lambda box, names, x: _run_sweep(box).plot(names, x=x),
    ),
    "sweep.run": WorkingCall(lambda box: {"mass": 2.0}, tabulate, on=_run_sweep),
}


def _save_and_load(sandbox: Sandbox, path: Any, model: Any) -> Any:
    file = sandbox.solution.save("run.beamdae")
    try:
        return bd.load(path, model)
    finally:
        file.unlink()


SOLUTION_CALLS: dict[str, WorkingCall] = {
    "verify": WorkingCall(
        lambda box: {
            "solution": box.solution,
            "integrator": bd.Radau(1e-4),
            "progress": lambda standing: None,
        }
    ),
    "load": WorkingCall(
        lambda box: {"path": "run.beamdae", "model": box.mech}, call=_save_and_load
    ),
    "Solution.save": WorkingCall(
        lambda box: {"path": "run.beamdae"}, on=lambda box: box.solution, writes=True
    ),
    "Solution.difference": WorkingCall(
        lambda box: {"other": box.solution}, on=lambda box: box.solution
    ),
    "plot": WorkingCall(
        lambda box: {
            "solutions": [box.solution],
            "labels": ["run"],
            "x": "knee.x",
            "data": {"t [s]": [0.0, 0.1], "knee.x [mm]": [0.0, 1.0], "height": [0.0, 1.0]},
            "data_columns": {"height": "knee.y"},
        }
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
        on=lambda box: (box.beam, box.solution)[1],
    ),
    "Solution.observe": WorkingCall(
        lambda box: {"name": "middle", "what": box.bar.at(*KNEE)}, on=lambda box: box.solution
    ),
    "Solution.__getitem__": WorkingCall(
        lambda box: {"name": "bar.angle"}, on=lambda box: box.solution
    ),
    "Solution.step_response": WorkingCall(
        lambda box: {"name": "knee.x", "target": 1.5, "t": 0.0, "band": 0.02},
        on=lambda box: box.solution,
    ),
    "Solution.to_csv": WorkingCall(
        lambda box: {"path": Path("run.csv")}, on=lambda box: box.solution, writes=True
    ),
}

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
    return run_study(sandbox, decorate(_function_returning([sandbox.case(mass=2.0)])))


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


def _model_returning(sandbox: Sandbox, mechanism: Any) -> bd.results.Model:
    return bd.model(t_end=T_END)(_function_returning(mechanism))


def _study_listing(sandbox: Sandbox, cases: Any) -> bd.results.Study:
    return bd.study(output_step=OUTPUT_STEP)(_function_returning(cases))


def _load_written_model(sandbox: Sandbox, path: Any, name: Any) -> bd.results.Model:
    sandbox.folder.mkdir(exist_ok=True)
    (sandbox.folder / "swing.py").write_text(GOOD_MODEL)
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
        Sandbox.run,
    ),
    "Model of": WorkingCall(
        lambda box: {"mass": 1.0, "spin": 1, "stiff": True, "name": "bob", "at": (1.0, 0.0)},
        Sandbox.run,
        call=lambda box, **arguments: box.swing(**arguments),
    ),
    "model": WorkingCall(
        lambda box: {"t_end": T_END, "data": (__file__,)},
        lambda box, decorate: bd.simulate(decorate(box.swing.build), box.integrator),
    ),
    "model defaults": WorkingCall(
        lambda box: {"mass": 1.0, "spin": 1, "name": "bob", "at": (1.0, 0.0)},
        Sandbox.run,
        call=lambda box, **defaults: bd.results.Model(
            box.swing.build, T_END, {"stiff": True, **defaults}
        ),
    ),
    "model returning": WorkingCall(
        lambda box: {"mechanism": box.mech},
        Sandbox.run,
        call=_model_returning,
    ),
    "load_model": WorkingCall(
        lambda box: {"path": "out/swing.py", "name": "swing"}, Sandbox.run, call=_load_written_model
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
        }
    ),
    "simulate sensitivities": WorkingCall(
        lambda box: {"sensitivities": ("mass",), "output_step": OUTPUT_STEP},
        call=lambda box, **arguments: bd.simulate(box.swing, bd.Radau(1e-6), **arguments),
    ),
    "param": WorkingCall(
        lambda box: {"default": 1.0, "unit": "m", "description": "length of the rope"}
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
        on=lambda box: box.swing,
    ),
    "check": WorkingCall(
        lambda box: {
            "model": box.mech,
            "t_end": T_END,
            "predict": False,
            "start": "as drawn",
        }
    ),
    "Equilibrium.to_csv": WorkingCall(
        lambda box: {"path": Path("path.csv")}, on=lambda box: bd.equilibrium(box.mech), writes=True
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
    "Integrator": WorkingCall(_integrator_members, run_with_integrator, call=_make_integrator),
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
        call=lambda box, **values: box.case(**values),
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
        call=_study_listing,
    ),
    "compare": WorkingCall(_compare_arguments),
    "grid": WorkingCall(
        lambda box: {"mass": [1.0, 2.0]},
        lambda box, rows: bd.compare([box.case(**row) for row in rows]),
    ),
}


# Working calls of inputs, sensors, states, blocks of controllers and sampled controllers.


def _sense(sandbox: Sandbox, name: str = "tilt", column: str = "angle") -> bd.results.Sensor:
    return sandbox.mech.sensor(name, sandbox.bar.at(*KNEE), column)


def _drive(sandbox: Sandbox) -> bd.results.Input:
    """Return an input that is the moment on the bar."""
    drive = sandbox.mech.input("drive", 0.5, "N m")
    sandbox.mech.add(bd.Moment("torque", sandbox.bar.at(*KNEE), drive))
    return drive


def _control(sample: bd.results.Sample) -> float:
    sample.state[0] += sample.reads[0]
    return -0.1 * sample.state[0] + 1e-3 * sample.random.normal()


def _controller_arguments(sandbox: Sandbox) -> dict[str, Any]:
    return {
        "name": "pilot",
        "every": 0.002,
        "reads": [_sense(sandbox)],
        "drives": [_drive(sandbox)],
        "law": _control,
        "state": [0.0],
        "delay": 1,
        "seed": 1,
    }


def _run_with_answer(sandbox: Sandbox, answer: Any) -> bd.results.Solution:
    """Simulate with a controller whose law returns this."""
    drive = _drive(sandbox)
    return run_with_part(sandbox, bd.Controller("pilot", 0.002, [], drive, lambda sample: answer))


def _run_with_kept(sandbox: Sandbox, state: Any) -> bd.results.Solution:
    """Simulate with a controller whose law replaces its discrete state by this."""

    def keep(sample: bd.results.Sample) -> float:
        sample.state = state
        return 0.0

    return run_with_part(sandbox, bd.Controller("pilot", 0.002, [], _drive(sandbox), keep, [0.0]))


def _follow(sandbox: Sandbox, rate: Any) -> bd.results.Solution:
    sandbox.mech.state("lag").follows(rate)
    return sandbox.run()


def _input_values(sandbox: Sandbox) -> dict[str, Any]:
    _drive(sandbox)
    return {"inputs": {"drive": 1.0}}


def _simulate_value(sandbox: Sandbox, value: Any) -> bd.results.Solution:
    _drive(sandbox)
    return sandbox.run(inputs={"drive": value})


def _read_table(sandbox: Sandbox, **arguments: Any) -> Any:
    sandbox.folder.mkdir(exist_ok=True)
    (sandbox.folder / "pulse.csv").write_text("t [ms],force [N]\n0,0\n4,1\n10,0\n20,1\n", "utf-8")
    return bd.table_from_csv(**arguments)


CONTROL_CALLS: dict[str, WorkingCall] = {
    "Controller": WorkingCall(_controller_arguments, run_with_part),
    "Controller.law answer": WorkingCall(lambda box: {"answer": 0.5}, call=_run_with_answer),
    "Controller.law state": WorkingCall(lambda box: {"state": [1.0]}, call=_run_with_kept),
    "Mechanism.input": WorkingCall(
        lambda box: {"name": "drive", "default": 0.5, "unit": "N m"},
        run_with_law,
        on=lambda box: box.mech,
    ),
    "Mechanism.sensor": WorkingCall(
        lambda box: {"name": "tilt", "what": box.bar.at(*KNEE), "column": "angle"},
        run_with_law,
        on=lambda box: box.mech,
    ),
    "Mechanism.state": WorkingCall(
        lambda box: {"name": "lag", "rate": _sense(box), "start": 0.1, "unit": "rad", "scale": 1.0},
        run_with_law,
        on=lambda box: box.mech,
    ),
    "State": WorkingCall(
        lambda box: {"name": "lag", "rate": _sense(box), "start": 0.1, "unit": "rad", "scale": 1.0},
        run_with_part,
    ),
    "State.follows": WorkingCall(lambda box: {"rate": _sense(box)}, call=_follow),
    "transfer_function": WorkingCall(
        lambda box: {
            "mechanism": box.mech,
            "name": "filter",
            "value": _sense(box),
            "numerator": [1.0, 4.0],
            "denominator": [1.0, 2.0, 4.0],
            "scale": 1.0,
            "unit": "rad",
        },
        run_with_law,
    ),
    "pid": WorkingCall(
        lambda box: {
            "mechanism": box.mech,
            "name": "servo",
            "error": _sense(box),
            "kp": 1.0,
            "ki": 2.0,
            "kd": 0.1,
            "rate": _sense(box, "turn", "angle_dot"),
            "limits": (-1.0, 1.0),
            "tracking_time": 0.5,
            "scale": 1.0,
            "unit": "rad",
        },
        run_with_law,
    ),
    "pid with a filter": WorkingCall(
        lambda box: {
            "mechanism": box.mech,
            "name": "servo",
            "error": _sense(box),
            "kp": 1.0,
            "kd": 0.1,
            "filter_time": 0.01,
        },
        run_with_law,
    ),
    "simulate inputs": WorkingCall(_input_values, call=lambda box, inputs: box.run(inputs=inputs)),
    "simulate value of an input": WorkingCall(lambda box: {"value": 1.0}, call=_simulate_value),
    "table_from_csv": WorkingCall(
        lambda box: {
            "path": box.folder / "pulse.csv",
            "x": "t",
            "y": "force",
            "kind": "linear",
            "outside": "hold",
            "name": "pulse",
        },
        run_with_law,
        call=_read_table,
    ),
}
