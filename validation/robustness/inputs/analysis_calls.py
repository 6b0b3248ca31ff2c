"""Working calls of analyses: modes, periodic motions, equilibria, section forces, refined runs."""

import math
from dataclasses import replace
from pathlib import Path
from typing import Any

import casadi as ca
from handed_out import shaken
from robustness.inputs.sandbox import (
    KNEE,
    OUTPUT_STEP,
    RUN_TIME_LIMIT,
    T_END,
    Sandbox,
    WorkingCall,
    tabulate,
)

import beamdae as bd


def _spinning_disk(sandbox: Sandbox) -> bd.Mechanism:
    """Return a disk on an axle with a small body on springs, which may spin steadily."""
    mech = bd.Mechanism()
    disk = mech.add(bd.RigidBody("bar", 1.0, 0.1))
    bob = mech.add(bd.RigidBody("bob", 0.5, 0.01))
    hub = disk.at(0.0, 0.0)
    mech.add(bd.Revolute("hinge", mech.ground.at(0.0, 0.0), hub))
    mech.add(bd.Bushing("cross", hub, bob.at(0.0, 0.0), 100.0, 200.0, 10.0))
    return mech


def _pushed_bar(sandbox: Sandbox) -> bd.Mechanism:
    sandbox.mech.add(bd.Force("push", sandbox.bar.at(*KNEE), (0.0, 0.0)))
    return sandbox.mech


def _pushed_bar_angle(sandbox: Sandbox) -> bd.results.LinearModel:
    return bd.linearize(_pushed_bar(sandbox), "equilibrium", outputs=["knee.x"])


MODE_CALLS: dict[str, WorkingCall] = {
    "modes": WorkingCall(
        lambda box: {"model": box.mech, "about": "reference", "n": 3, "damping": True, "t": 0.0},
        tabulate,
    ),
    "modes about": WorkingCall(
        lambda box: {"about": {"bar.angle": -1.0}},
        tabulate,
        model=lambda box: box.mech,
    ),
    "rotation": WorkingCall(
        lambda box: {"speed": 1.0, "center": (0.0, 0.0)},
        lambda box, about: bd.modes(_spinning_disk(box), about=about).table(),
    ),
    "Solution.at": WorkingCall(
        lambda box: {"t": 0.005},
        lambda box, at: bd.modes(box.mech, at),
        on=lambda box: box.solution,
    ),
    "Modes.mac": WorkingCall(
        lambda box: {"other": bd.modes(box.mech, about="equilibrium")},
        on=lambda box: bd.modes(box.mech, about="equilibrium"),
    ),
    "campbell": WorkingCall(
        lambda box: {
            "model": _spinning_disk(box),
            "speeds": [0.0, 1.0],
            "n": 2,
            "center": (0.0, 0.0),
            "damping": True,
            "multiples": (1, 2),
        },
        tabulate,
    ),
    "linearize": WorkingCall(
        lambda box: {
            "model": _pushed_bar(box),
            "about": "equilibrium",
            "inputs": ["push"],
            "outputs": ["knee"],
            "t": 0.0,
        }
    ),
    "LinearModel.frequency_response": WorkingCall(
        lambda box: {"frequencies": [0.0, 1.0]}, on=lambda box: bd.linearize(_pushed_bar(box))
    ),
    "LinearModel.state_space": WorkingCall(
        lambda box: {"every": 0.01}, on=lambda box: bd.linearize(_pushed_bar(box))
    ),
    "bode": WorkingCall(
        lambda box: {"model": bd.linearize(_pushed_bar(box)), "frequencies": [1.0, 2.0]},
        lambda box, result: (result.table(), result.peak_table()),
    ),
    "bode between": WorkingCall(
        lambda box: {"between": (0.5, 2.0)},
        lambda box, result: result.plot(),
        model=lambda box: bd.linearize(_pushed_bar(box)),
    ),
    "margins": WorkingCall(
        lambda box: {"model": _pushed_bar_angle(box), "at": "push.Fy", "controller": [2.0]},
        tabulate,
    ),
    "margins every": WorkingCall(
        lambda box: {"every": 0.01, "delay": 1},
        tabulate,
        call=lambda box, every, delay: bd.margins(
            _pushed_bar_angle(box), "push.Fy", every=every, delay=delay
        ),
    ),
    "Modes.animate": WorkingCall(
        lambda box: {"mode": 1, "path": Path("out/mode.gif"), "frames": 2},
        on=lambda box: bd.modes(box.mech, about="equilibrium"),
    ),
    "Campbell.plot": WorkingCall(
        lambda box: {}, on=lambda box: bd.campbell(_spinning_disk(box), [0.0, 1.0])
    ),
}

_PERIOD = 0.01


def _shaken_bar(sandbox: Sandbox) -> bd.Mechanism:
    """Return the hinged bar on a spring and damper, excited by a harmonic moment."""
    mech, hinge = sandbox.mech, sandbox.mech.parts["hinge"]
    mech.add(bd.TorsionSpring("spring", hinge.a, hinge.b, 1e4))
    mech.add(bd.TorsionSpring("damper", hinge.a, hinge.b, damping=100.0))
    mech.add(bd.Moment("shaking", sandbox.bar.at(0.0, 0.0), bd.sine(1.0, frequency=1.0 / _PERIOD)))
    return mech


def _shaken_model(sandbox: Sandbox) -> bd.results.Model:
    """Return a model of an excited oscillator with the frequency as parameter."""

    @bd.model(t_end=_PERIOD)
    def shaken(frequency=100.0, name="bob"):
        mech = bd.Mechanism()
        bob = mech.add(bd.PointMass(name, 1.0, at=(1.0, 0.0)))
        mech.add(bd.PointOnLine("rail", mech.ground.at(1.0, 0.0), bob.point, (1.0, 0.0)))
        mech.add(bd.Spring("spring", mech.ground.at(0.0, 0.0), bob.point, 1e4, 100.0))
        mech.add(bd.Force("shaking", bob.point, (bd.sine(1.0, frequency=frequency), 0.0)))
        mech.observe("bob", bob.point)
        return mech

    return shaken


def _response(sandbox: Sandbox) -> bd.results.FrequencyResponse:
    return bd.frequency_response(
        _shaken_model(sandbox), "frequency", (100.0, 101.0), step=0.5, settle=1
    )


def _self_excited(sandbox: Sandbox) -> bd.ConstrainedSystem:
    """Return van der Pol's oscillator."""
    t, x, v = (ca.SX.sym(name) for name in "txv")
    force = (1.0 - x**2) * v - x
    return bd.ConstrainedSystem(t, x, v, mass=[1.0], force=force, q0=[2.0], v0=[0.0])


PERIODIC_CALLS: dict[str, WorkingCall] = {
    "periodic": WorkingCall(
        lambda box: {
            "model": _shaken_bar(box),
            "period": _PERIOD,
            "integrator": box.integrator,
            "start": {"bar.angle": 0.0},
            "t_start": 0.0,
            "settle": 1,
            "tolerance": 1e-3,
        },
        lambda box, motion: motion.amplitudes(),
    ),
    "periodic of unknown period": WorkingCall(
        lambda box: {"period_guess": 6.0},
        lambda box, motion: motion.amplitudes(),
        model=_self_excited,
    ),
    "frequency_response": WorkingCall(
        lambda box: {
            "model": _shaken_model(box),
            "parameter": "frequency",
            "between": (100.0, 101.0),
            "period": lambda frequency: 1.0 / frequency,
            "integrator": replace(box.integrator, time_limit=1.0),
            "step": 0.5,
            "max_step": 1.0,
            "settle": 1,
            "tolerance": 1e-3,
            "max_points": 4,
            "t_start": 0.0,
            "start": "as drawn",
            "partial": "raise",
            "parameters": {},
            "progress": lambda standing: None,
        },
        tabulate,
    ),
    "FrequencyResponse.plot": WorkingCall(
        lambda box: {"column": "bob.x [m]", "x": "bob.x_dot"},
        on=_response,
    ),
    "FrequencyResponse.peaks": WorkingCall(
        lambda box: {"column": "bob.x [m]"},
        on=_response,
    ),
}


def _bar_on_torsion_spring(sandbox: Sandbox) -> bd.Mechanism:
    """Return the bar on a torsion spring with a transverse force."""
    foot = sandbox.mech.ground.at(0.0, 0.0)
    sandbox.mech.add(bd.TorsionSpring("spring", foot, sandbox.bar.at(0.0, 0.0), 10.0))
    sandbox.mech.add(bd.Force("push", sandbox.bar.at(*KNEE), (0.0, 1.0)))
    return sandbox.mech


def _column() -> bd.Mechanism:
    """Return a clamped column of one element under its compressive load."""
    mech = bd.Mechanism()
    section = bd.Section.rectangle(bd.Material.of("steel"), width=0.02, height=0.002)
    column = mech.add(bd.Beam("column", bd.Line((0.0, 0.0), (0.0, 1.0)), section, 1))
    mech.add(bd.Weld("clamp", mech.ground.at(0.0, 0.0), column.start))
    mech.add(bd.Force("press", column.end, (0.0, -section.EI)))
    return mech


def _truss() -> bd.results.Model:
    """Return a model of a truss that snaps through, with the rise as parameter."""

    @bd.model(t_end=T_END)
    def truss(rise=0.2):
        mech = bd.Mechanism()
        crown = mech.add(bd.PointMass("crown", 1.0, at=(0.0, rise)))
        for name, x in (("left", -1.0), ("right", 1.0)):
            mech.add(bd.Spring(name, mech.ground.at(x, 0.0), crown.point, 1000.0))
        mech.add(bd.Force("press", crown.point, (0.0, -1.0)))
        mech.observe("crown", crown.point)
        return mech

    return truss


STATIC_CALLS: dict[str, WorkingCall] = {
    "equilibrium": WorkingCall(
        lambda box: {
            "model": box.mech,
            "loads": ["gravity"],
            "to": [0.5, 1.0],
            "control": "load",
            "step": 0.5,
            "switch": 0,
            "max_points": 20,
            "t": 0.0,
            "start": {"bar.angle": -1.0},
            "partial": "raise",
        },
        tabulate,
    ),
    "buckling": WorkingCall(
        lambda box: {"model": _column(), "n": 1, "loads": ["press"], "t": 0.0, "start": None},
        tabulate,
    ),
    "imperfect": WorkingCall(
        lambda box: {
            "model": _column(),
            "shape": bd.buckling(_column(), n=1).shapes[0],
            "amplitude": 1e-3,
        },
        lambda box, result: bd.equations_of_motion(result),
    ),
    "imperfect measured": WorkingCall(
        lambda box: {"shape": {"column": bd.Arc(100.0, 1.0, angle=0.5 * math.pi)}},
        lambda box, result: bd.equations_of_motion(result),
        model=lambda box: _column(),
    ),
    "knock_down": WorkingCall(
        lambda box: {
            "model": _column(),
            "shape": bd.buckling(_column(), n=1),
            "amplitudes": [1e-3],
        },
        tabulate,
        call=lambda box, **arguments: bd.knock_down(to=0.5, step=0.5, **arguments),
    ),
    "boundary": WorkingCall(
        lambda box: {
            "model": _truss(),
            "kind": "limit point",
            "by": ("rise", "load"),
            "values": (0.2, 0.3),
            "number": 1,
            "step": 0.5,
            "max_points": 4,
            "parameters": {},
        },
        tabulate,
        call=lambda box, **arguments: bd.boundary(to={"crown.y": 0.0}, **arguments),
    ),
    "equilibrium displaced": WorkingCall(
        lambda box: {"to": {"knee.x": 0.1}, "switch": 0},
        tabulate,
        model=_bar_on_torsion_spring,
    ),
    "Equilibrium.at": WorkingCall(lambda box: {"row": 0}, on=lambda box: bd.equilibrium(box.mech)),
    "equilibrium switched": WorkingCall(
        lambda box: {"to": {"knee.x": 0.1}, "switch": [1, -1], "max_points": 20},
        tabulate,
        model=_bar_on_torsion_spring,
    ),
    "equilibrium over the time": WorkingCall(
        lambda box: {"over": "t", "from_": 0.0, "to": 1.0},
        tabulate,
        model=lambda box: box.mech,
    ),
    "Equilibrium.__getitem__": WorkingCall(
        lambda box: {"name": "knee.x"}, on=lambda box: bd.equilibrium(box.mech)
    ),
    "Equilibrium.plot": WorkingCall(
        lambda box: {"name": "knee", "x": "knee.x"},
        call=lambda box, name, x: bd.equilibrium(box.mech).plot(name, x=x),
    ),
    "modes about a path": WorkingCall(
        lambda box: {"about": bd.equilibrium(box.mech)}, model=lambda box: box.mech
    ),
}


def _section_forces(sandbox: Sandbox, **arguments: Any) -> bd.results.SectionForces:
    """Return section forces of a falling beam."""
    beam = sandbox.beam
    solution = sandbox.run()
    return solution.section_forces(**{"beam": beam, **arguments})


def _cantilever(sandbox: Sandbox) -> bd.Mechanism:
    """Return the mechanism with a clamped beam."""
    beam = sandbox.beam
    sandbox.mech.add(bd.Weld("clamp", sandbox.mech.ground.at(*beam.start.point), beam.start))
    return sandbox.mech


def _loaded_cantilever(sandbox: Sandbox) -> bd.results.Equilibrium:
    """Return the equilibrium of a clamped beam under its weight."""
    return bd.equilibrium(_cantilever(sandbox), loads=["gravity"], step=1.0)


SECTION_FORCE_CALLS: dict[str, WorkingCall] = {
    "Solution.section_forces": WorkingCall(
        lambda box: {"beam": "beam", "t": [0.0, OUTPUT_STEP], "s": [0.0, 0.5]},
        tabulate,
        call=_section_forces,
    ),
    "Solution.diagram": WorkingCall(
        lambda box: {"beam": "beam", "what": "M", "t": OUTPUT_STEP},
        on=lambda box: (box.beam, box.run())[1],
    ),
    "Equilibrium.section_forces": WorkingCall(
        lambda box: {"beam": "beam", "s": [0.0, 0.5]},
        tabulate,
        on=_loaded_cantilever,
    ),
    "Equilibrium.diagram": WorkingCall(
        lambda box: {"beam": "beam", "what": "M"}, on=_loaded_cantilever
    ),
    "SectionForces.stress": WorkingCall(lambda box: {"offset": "top"}, on=_section_forces),
    "SectionForces.safety": WorkingCall(lambda box: {"yield_stress": 235e6}, on=_section_forces),
    "SectionForces.diagram": WorkingCall(
        lambda box: {"what": "M", "t": OUTPUT_STEP}, on=_section_forces
    ),
}

_ACCURACY = 0.1


def _refine_arguments(sandbox: Sandbox) -> dict[str, Any]:
    return {
        "model": sandbox.mech,
        "accuracy": _ACCURACY,
        "accuracy_columns": ["knee"],
        "integrator": bd.Radau(time_limit=RUN_TIME_LIMIT),
        "t_end": T_END,
        "output_step": OUTPUT_STEP,
        "start": "as drawn",
        "progress": lambda t: None,
    }


_SENSITIVITY_METHOD = bd.GeneralizedAlpha(OUTPUT_STEP, time_limit=RUN_TIME_LIMIT)


def _sensitivities(sandbox: Sandbox) -> bd.results.Sensitivities:
    return bd.sensitivities(sandbox.swing, "mass", _SENSITIVITY_METHOD, output_step=OUTPUT_STEP)


def _equilibrium_sensitivities(sandbox: Sandbox) -> bd.results.EquilibriumSensitivities:
    return bd.equilibrium_sensitivities(sandbox.swing, "mass")


def _mode_sensitivities(sandbox: Sandbox) -> bd.results.ModeSensitivities:
    return bd.mode_sensitivities(sandbox.swing, "mass", "equilibrium")


def _periodic_sensitivities(sandbox: Sandbox) -> bd.results.PeriodicSensitivities:
    return bd.periodic_sensitivities(shaken, "stiffness", 0.1, bd.Radau(1e-6), settle=1)


def _optimization(sandbox: Sandbox) -> bd.results.Optimization:
    return bd.optimize(
        sandbox.swing, bd.quantities.Mass(), "mass", (), {"mass": (0.5, 2.0)}, max_evaluations=2
    )


_FIT_DATA = {"t [s]": [0.001, 0.002, 0.004, 0.01], "bob.y": [0.5, 0.4999, 0.4995, 0.499]}


def _fit(sandbox: Sandbox) -> bd.results.Fit:
    return bd.fit(
        sandbox.swing, _FIT_DATA, "mass", _SENSITIVITY_METHOD, sigma=1e-3, max_evaluations=1
    )


def _get_label(sandbox: Sandbox, quantity: Any) -> str:
    return quantity.label


def _fit_from_several_starts(sandbox: Sandbox, **options: Any) -> bd.results.Fit:
    return bd.fit(sandbox.swing, _FIT_DATA, "mass", _SENSITIVITY_METHOD, sigma=1e-3, **options)


EXPORT_CALLS: dict[str, WorkingCall] = {
    "export_fmu": WorkingCall(
        lambda box: {
            "model": box.swing,
            "path": "swing.fmu",
            "communication_step": OUTPUT_STEP,
            "integrator": bd.Radau(),
            "inputs": [],
            "outputs": ["bob"],
            "parameters": ["mass"],
            "fmi": 2,
            "start": "as drawn",
            "t_end": T_END,
            "platforms": [],
            "real_time": None,
        },
        writes=True,
    ),
}

SENSITIVITY_CALLS: dict[str, WorkingCall] = {
    "sensitivities": WorkingCall(
        lambda box: {
            "model": box.swing,
            "by": ["mass"],
            "integrator": _SENSITIVITY_METHOD,
            "t_end": T_END,
            "output_step": OUTPUT_STEP,
            "parameters": {"spin": 1},
            "start": {"bob.angle": -1.0},
            "estimate_error": False,
        },
        tabulate,
    ),
    "Sensitivities.to_csv": WorkingCall(
        lambda box: {"path": "derivatives.csv"}, on=_sensitivities, writes=True
    ),
    "Sensitivities.sensitivity": WorkingCall(
        lambda box: {"column": "bob.y", "parameter": "mass"}, on=_sensitivities
    ),
    "Sensitivities.at_times": WorkingCall(
        lambda box: {"times": [0.0, 0.005]}, tabulate, on=_sensitivities
    ),
    "equilibrium_sensitivities": WorkingCall(
        lambda box: {
            "model": box.swing,
            "by": ["mass"],
            "loads": ["gravity"],
            "to": 1.0,
            "control": "load",
            "step": 0.5,
            "switch": 0,
            "max_points": 10,
            "t": 0.0,
            "start": {"bob.angle": -1.5},
            "parameters": {"spin": 1},
        },
        lambda box, result: (result.table(), result.critical_table()),
    ),
    "EquilibriumSensitivities.sensitivity": WorkingCall(
        lambda box: {"column": "bob.y", "parameter": "mass"}, on=_equilibrium_sensitivities
    ),
    "EquilibriumSensitivities.derivative": WorkingCall(
        lambda box: {"function": lambda path: path.factors[-1], "parameter": "mass"},
        on=_equilibrium_sensitivities,
    ),
    "EquilibriumSensitivities.to_csv": WorkingCall(
        lambda box: {"path": "derivatives.csv"}, on=_equilibrium_sensitivities, writes=True
    ),
    "mode_sensitivities": WorkingCall(
        lambda box: {
            "model": box.swing,
            "by": ["mass"],
            "about": "equilibrium",
            "n": 1,
            "damping": True,
            "t": 0.0,
            "parameters": {"spin": 1},
        },
        tabulate,
    ),
    "ModeSensitivities.sensitivity": WorkingCall(
        lambda box: {"column": "frequency", "parameter": "mass"}, on=_mode_sensitivities
    ),
    "ModeSensitivities.to_csv": WorkingCall(
        lambda box: {"path": "derivatives.csv"}, on=_mode_sensitivities, writes=True
    ),
    "periodic_sensitivities": WorkingCall(
        lambda box: {
            "model": shaken,
            "by": ["stiffness"],
            "period": 0.1,
            "integrator": bd.Radau(1e-6),
            "start": {"bob.x": 1.0},
            "t_start": 0.0,
            "settle": 1,
            "tolerance": 1e-4,
            "period_guess": None,
            "parameters": {"damping": 50.0},
        },
        tabulate,
    ),
    "PeriodicSensitivities.sensitivity": WorkingCall(
        lambda box: {"column": "bob.x", "parameter": "stiffness"},
        on=_periodic_sensitivities,
    ),
    "PeriodicSensitivities.to_csv": WorkingCall(
        lambda box: {"path": "derivatives.csv"},
        on=_periodic_sensitivities,
        writes=True,
    ),
    "fit": WorkingCall(
        lambda box: {
            "model": box.swing,
            "data": {"one": _FIT_DATA, "two": _FIT_DATA},
            "data_columns": {"bob.y": "bob.y"},
            "by": ["mass"],
            "integrator": _SENSITIVITY_METHOD,
            "sigma": {"bob.y": 1e-3},
            "parameters": {"spin": 1},
            "experiments": {"two": {"spin": 2}},
            "bounds": {"mass": (0.5, 2.0)},
            "log": ["mass"],
            "scale": ["bob.y"],
            "offset": [("one", "bob.y")],
            "shift": {"bob.y": (-0.001, 0.001)},
            "start": {"bob.angle": -1.0},
            "max_evaluations": 2,
            "seed": 0,
            "jobs": 1,
            "partial": "raise",
        },
        tabulate,
    ),
    "fit of several starts": WorkingCall(
        lambda box: {
            "bounds": {"mass": (0.5, 2.0)},
            "max_evaluations": 1,
            "starts": 2,
            "seed": 1,
            "folder": "fit",
            "jobs": 1,
            "progress": lambda standing: None,
        },
        tabulate,
        call=_fit_from_several_starts,
        writes=True,
    ),
    "Fit.to_csv": WorkingCall(lambda box: {"path": "fit.csv"}, on=_fit, writes=True),
    "Fit.page": WorkingCall(lambda box: {"path": "fit.html"}, on=_fit, writes=True),
    "Fit.prediction": WorkingCall(lambda box: {"column": "bob.y", "experiment": ""}, on=_fit),
    "Fit.profile": WorkingCall(lambda box: {"name": "mass", "max_points": 1}, tabulate, on=_fit),
    "gradient": WorkingCall(
        lambda box: {
            "model": box.swing,
            "objective": bd.quantities.EndValue("bob.y")
            + 0.1 * bd.quantities.SmoothMaximum("bob.x"),
            "by": ["mass"],
            "integrator": _SENSITIVITY_METHOD,
            "t_end": T_END,
            "parameters": {"spin": 1},
            "start": {"bob.angle": -1.0},
            "estimate_error": False,
        },
        lambda box, result: result.array,
    ),
    "optimize": WorkingCall(
        lambda box: {
            "model": box.swing,
            "objective": bd.quantities.EndValue("bob.y") + bd.quantities.EndValue("bob.x"),
            "by": ["mass"],
            "subject_to": [bd.quantities.at_most(bd.quantities.Mass(), 3.0)],
            "bounds": {"mass": (0.5, 2.0)},
            "integrator": _SENSITIVITY_METHOD,
            "t_end": T_END,
            "parameters": {"spin": 1},
            "start": {"bob.angle": -1.0},
            "method": "SLSQP",
            "max_evaluations": 3,
            "tolerance": 1e-6,
            "starts": 2,
            "seed": 0,
            "progress": lambda *numbers: None,
            "partial": "raise",
        },
        lambda box, result: (result.table(), result.history()),
    ),
    "Optimization.page": WorkingCall(
        lambda box: {"path": "designs.html"}, on=_optimization, writes=True
    ),
    "Optimization.to_csv": WorkingCall(
        lambda box: {"path": "designs.csv"}, on=_optimization, writes=True
    ),
    "at_most": WorkingCall(
        lambda box: {"quantity": bd.quantities.Frequency(1), "limit": 2.0},
        _get_label,
    ),
    "at_least": WorkingCall(
        lambda box: {"quantity": bd.quantities.EndValue("bob.y"), "limit": 2.0},
        _get_label,
    ),
    "LargestOf": WorkingCall(
        lambda box: {
            "quantities": [bd.quantities.Mass(), bd.quantities.EndValue("bob.y")],
            "exponent": 20.0,
        },
        _get_label,
    ),
    "Mass": WorkingCall(lambda box: {}, _get_label),
}

REFINEMENT_CALLS: dict[str, WorkingCall] = {
    "simulate accuracy": WorkingCall(_refine_arguments),
    "simulate accuracy beam": WorkingCall(
        lambda box: {
            "accuracy": _ACCURACY,
            "accuracy_columns": "end",
            "integrator": bd.Radau(time_limit=RUN_TIME_LIMIT),
            "t_end": T_END,
            "output_step": OUTPUT_STEP,
            "start": {"bar.angle": -1.0},
        },
        model=_cantilever,
    ),
    **{
        f"{name} accuracy": WorkingCall(
            lambda box, columns=columns: {"accuracy": 0.05, "accuracy_columns": columns},
            call=call,
        )
        for name, columns, call in (
            ("equilibrium", "knee", lambda box, **x: bd.equilibrium(box.mech, **x)),
            (
                "buckling",
                ["load factor of mode 1"],
                lambda box, **x: bd.buckling(_column(), n=1, **x),
            ),
            ("modes", ["frequency 1"], lambda box, **x: bd.modes(_column(), n=1, **x)),
            ("linearize", None, lambda box, **x: bd.linearize(_pushed_bar(box), **x)),
            (
                "bode",
                None,
                lambda box, **x: bd.bode(bd.linearize(_pushed_bar(box)), [1.0, 2.0], **x),
            ),
            ("periodic", "knee", lambda box, **x: bd.periodic(_shaken_bar(box), _PERIOD, **x)),
            (
                "frequency_response",
                None,
                lambda box, **x: bd.frequency_response(
                    _shaken_model(box),
                    "frequency",
                    (100.0, 101.0),
                    period=lambda frequency: 1.0 / frequency,
                    max_points=4,
                    **x,
                ),
            ),
        )
    },
}
