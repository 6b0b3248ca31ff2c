"""Working calls of inputs, sensors, states, blocks of controllers and sampled controllers."""

from __future__ import annotations

from typing import Any

from robustness.inputs.sandbox import (
    KNEE,
    Sandbox,
    WorkingCall,
    run_with_law,
    run_with_part,
)

import beamdae as bd


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
