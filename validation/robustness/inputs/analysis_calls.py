"""Working calls of analyses: modes, periodic motions, equilibria, section forces, certificates."""

from __future__ import annotations

import math
from dataclasses import replace
from pathlib import Path
from typing import Any

import casadi as ca

import beamdae as bd
from robustness.inputs.sandbox import (
    KNEE,
    OUTPUT_STEP,
    RUN_TIME_LIMIT,
    T_END,
    Sandbox,
    WorkingCall,
    return_result,
)


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


MODE_CALLS: dict[str, WorkingCall] = {
    "modes": WorkingCall(
        lambda box: {"model": box.mech, "about": "reference", "n": 3, "damping": True, "t": 0.0},
        lambda box, result: result.table(),
    ),
    "modes about": WorkingCall(
        lambda box: {"about": {"bar.angle": -1.0}},
        lambda box, result: result.table(),
        lambda box, about: bd.modes(box.mech, about=about),
    ),
    "rotation": WorkingCall(
        lambda box: {"speed": 1.0, "center": (0.0, 0.0)},
        lambda box, about: bd.modes(_spinning_disk(box), about=about).table(),
    ),
    "Solution.at": WorkingCall(
        lambda box: {"t": 0.005},
        lambda box, at: bd.modes(box.mech, at),
        lambda box, t: box.solution.at(t),
    ),
    "Modes.mac": WorkingCall(
        lambda box: {"other": bd.modes(box.mech)},
        return_result,
        lambda box, other: bd.modes(box.mech).mac(other),
    ),
    "campbell": WorkingCall(
        lambda box: {
            "model": _spinning_disk(box),
            "speeds": [0.0, 1.0],
            "n": 2,
            "center": (0.0, 0.0),
            "damping": True,
        },
        lambda box, result: result.table(),
    ),
    "linearize": WorkingCall(
        lambda box: {
            "model": _pushed_bar(box),
            "about": "equilibrium",
            "inputs": ["push"],
            "outputs": ["knee"],
            "t": 0.0,
        },
        return_result,
    ),
    "LinearModel.frequency_response": WorkingCall(
        lambda box: {"frequencies": [0.0, 1.0]},
        return_result,
        lambda box, frequencies: bd.linearize(_pushed_bar(box)).frequency_response(frequencies),
    ),
    "draw_modes": WorkingCall(lambda box: {"modes": bd.modes(box.mech)}, return_result),
    "animate_mode": WorkingCall(
        lambda box: {
            "modes": bd.modes(box.mech),
            "mode": 1,
            "path": Path("out/mode.gif"),
            "frames": 2,
        },
        return_result,
    ),
    "draw_campbell": WorkingCall(
        lambda box: {"diagram": bd.campbell(_spinning_disk(box), [0.0, 1.0])}, return_result
    ),
}


_PERIOD = 0.01


def _shaken_bar(sandbox: Sandbox) -> bd.Mechanism:
    """Return the hinged bar on a spring and damper, excited by a harmonic moment."""
    mech, hinge = sandbox.mech, sandbox.mech.parts["hinge"]
    mech.add(bd.TorsionSpring("spring", hinge.a, hinge.b, 1e4))
    mech.add(bd.TorsionDamper("damper", hinge.a, hinge.b, 100.0))
    mech.add(bd.Moment("shaking", sandbox.bar.at(0.0, 0.0), bd.sine(1.0, frequency=1.0 / _PERIOD)))
    return mech


def _shaken_model(sandbox: Sandbox) -> bd.Model:
    """Return a model of an excited oscillator with the frequency as parameter."""

    @bd.model(t_end=_PERIOD)
    def shaken(frequency=100.0, name="bob"):
        mech = bd.Mechanism()
        bob = mech.add(bd.PointMass(name, 1.0, at=(1.0, 0.0)))
        mech.add(bd.PointOnLine("rail", mech.ground.at(1.0, 0.0), bob.point, (1.0, 0.0)))
        mech.add(bd.SpringDamper("spring", mech.ground.at(0.0, 0.0), bob.point, 1e4, 100.0))
        mech.add(bd.Force("shaking", bob.point, (bd.sine(1.0, frequency=frequency), 0.0)))
        mech.observe("bob", bob.point)
        return mech

    return shaken


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
            "begin": 0.0,
            "settle": 1,
            "tolerance": 1e-3,
        },
        lambda box, motion: motion.amplitudes(),
    ),
    "periodic of unknown period": WorkingCall(
        lambda box: {"period_guess": 6.0},
        lambda box, motion: motion.amplitudes(),
        lambda box, **arguments: bd.periodic(_self_excited(box), **arguments),
    ),
    "frequency_response": WorkingCall(
        lambda box: {
            "model": _shaken_model(box),
            "parameter": "frequency",
            "between": (100.0, 101.0),
            "period": lambda frequency: 1.0 / frequency,
            "integrator": replace(box.integrator, time_limit=1.0),
            "step": 0.5,
            "longest_step": 1.0,
            "settle": 1,
            "tolerance": 1e-3,
            "most_points": 4,
            "begin": 0.0,
            "partial": "raise",
        },
        lambda box, response: response.table(),
    ),
    "FrequencyResponse.plot": WorkingCall(
        lambda box: {"column": "bob.x [m]"},
        return_result,
        lambda box, column: bd.frequency_response(
            _shaken_model(box), "frequency", (100.0, 101.0), step=0.5, settle=1
        ).plot(column),
    ),
    "FrequencyResponse.peaks": WorkingCall(
        lambda box: {"column": "bob.x [m]"},
        return_result,
        lambda box, column: bd.frequency_response(
            _shaken_model(box), "frequency", (100.0, 101.0), step=0.5, settle=1
        ).peaks(column),
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


def _truss() -> bd.Model:
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
            "most_points": 20,
            "t": 0.0,
            "start": {"bar.angle": -1.0},
            "partial": "raise",
        },
        lambda box, result: result.table(),
    ),
    "buckling": WorkingCall(
        lambda box: {"model": _column(), "modes": 1, "loads": ["press"], "t": 0.0, "start": None},
        lambda box, result: result.table(),
    ),
    "imperfect": WorkingCall(
        lambda box: {
            "model": _column(),
            "shape": bd.buckling(_column(), modes=1).shapes[0],
            "amplitude": 1e-3,
        },
        lambda box, result: bd.equations_of_motion(result),
    ),
    "imperfect measured": WorkingCall(
        lambda box: {"shape": {"column": bd.Arc(100.0, 1.0, angle=0.5 * math.pi)}},
        lambda box, result: bd.equations_of_motion(result),
        lambda box, shape: bd.imperfect(_column(), shape),
    ),
    "knock_down": WorkingCall(
        lambda box: {
            "model": _column(),
            "shape": bd.buckling(_column(), modes=1),
            "amplitudes": [1e-3],
        },
        lambda box, result: result.table(),
        lambda box, **arguments: bd.knock_down(to=0.5, step=0.5, **arguments),
    ),
    "boundary": WorkingCall(
        lambda box: {
            "model": _truss(),
            "kind": "limit point",
            "by": ("rise", "load"),
            "values": (0.2, 0.3),
            "number": 1,
            "step": 0.5,
            "most_points": 4,
        },
        lambda box, result: result.table(),
        lambda box, **arguments: bd.boundary(to={"crown.y": 0.0}, **arguments),
    ),
    "equilibrium displaced": WorkingCall(
        lambda box: {"to": {"knee.x": 0.1}, "switch": 0},
        lambda box, result: result.table(),
        lambda box, **arguments: bd.equilibrium(_bar_on_torsion_spring(box), **arguments),
    ),
    "Equilibrium.at": WorkingCall(
        lambda box: {"row": 0}, return_result, lambda box, row: bd.equilibrium(box.mech).at(row)
    ),
    "equilibrium switched": WorkingCall(
        lambda box: {"to": {"knee.x": 0.1}, "switch": [1, -1], "most_points": 20},
        lambda box, result: result.table(),
        lambda box, **arguments: bd.equilibrium(_bar_on_torsion_spring(box), **arguments),
    ),
    "Equilibrium.__getitem__": WorkingCall(
        lambda box: {"name": "knee.x"},
        return_result,
        lambda box, name: bd.equilibrium(box.mech)[name],
    ),
    "Equilibrium.plot": WorkingCall(
        lambda box: {"name": "knee"},
        return_result,
        lambda box, name: bd.equilibrium(box.mech).plot(name),
    ),
    "modes about a path": WorkingCall(
        lambda box: {"about": bd.equilibrium(box.mech)},
        return_result,
        lambda box, about: bd.modes(box.mech, about=about),
    ),
}


def _section_forces(sandbox: Sandbox, **arguments: Any) -> bd.SectionForces:
    """Return section forces of a falling beam."""
    beam = sandbox.beam
    solution = sandbox.run()
    return solution.section_forces(**{"beam": beam, **arguments})


def _cantilever(sandbox: Sandbox) -> bd.Mechanism:
    """Return the mechanism with a clamped beam."""
    beam = sandbox.beam
    sandbox.mech.add(bd.Weld("clamp", sandbox.mech.ground.at(*beam.start.point), beam.start))
    return sandbox.mech


def _loaded_cantilever(sandbox: Sandbox) -> bd.Equilibrium:
    """Return the equilibrium of a clamped beam under its weight."""
    return bd.equilibrium(_cantilever(sandbox), loads=["gravity"], step=1.0)


SECTION_FORCE_CALLS: dict[str, WorkingCall] = {
    "Solution.section_forces": WorkingCall(
        lambda box: {"beam": "beam", "t": [0.0, OUTPUT_STEP], "s": [0.0, 0.5]},
        lambda box, forces: forces.table(),
        lambda box, **arguments: _section_forces(box, **arguments),
    ),
    "Solution.diagram": WorkingCall(
        lambda box: {"beam": "beam", "what": "M", "t": OUTPUT_STEP},
        return_result,
        lambda box, **arguments: (box.beam, box.run())[1].diagram(**arguments),
    ),
    "Equilibrium.section_forces": WorkingCall(
        lambda box: {"beam": "beam", "s": [0.0, 0.5]},
        lambda box, forces: forces.table(),
        lambda box, **arguments: _loaded_cantilever(box).section_forces(**arguments),
    ),
    "Equilibrium.diagram": WorkingCall(
        lambda box: {"beam": "beam", "what": "M"},
        return_result,
        lambda box, **arguments: _loaded_cantilever(box).diagram(**arguments),
    ),
    "SectionForces.stress": WorkingCall(
        lambda box: {"offset": "top"},
        return_result,
        lambda box, offset: _section_forces(box).stress(offset),
    ),
    "SectionForces.safety": WorkingCall(
        lambda box: {"yield_stress": 235e6},
        return_result,
        lambda box, yield_stress: _section_forces(box).safety(yield_stress),
    ),
    "SectionForces.diagram": WorkingCall(
        lambda box: {"what": "M", "t": OUTPUT_STEP},
        return_result,
        lambda box, **arguments: _section_forces(box).diagram(**arguments),
    ),
}


_ACCURACY = 0.1


def _show_certificate(sandbox: Sandbox, certificate: Any) -> Any:
    """Use each view of a certificate and return its solution."""
    certificate.budget, certificate.facts(), certificate._repr_html_(), repr(certificate)
    return certificate.solution if isinstance(certificate, bd.Certificate) else None


def _certify_arguments(sandbox: Sandbox) -> dict[str, Any]:
    return {
        "model": sandbox.mech,
        "accuracy": _ACCURACY,
        "columns": ["knee"],
        "t_end": T_END,
        "output_step": OUTPUT_STEP,
        "start": "as drawn",
        "time_limit": RUN_TIME_LIMIT,
        "progress": lambda t: None,
        "partial": "raise",
    }


CERTIFICATE_CALLS: dict[str, WorkingCall] = {
    "certify": WorkingCall(_certify_arguments, _show_certificate),
    "certify beam": WorkingCall(
        lambda box: {
            "accuracy": _ACCURACY,
            "columns": "end",
            "t_end": T_END,
            "output_step": OUTPUT_STEP,
            "start": {"bar.angle": -1.0},
            "time_limit": RUN_TIME_LIMIT,
        },
        _show_certificate,
        lambda box, **arguments: bd.certify(_cantilever(box), **arguments),
    ),
    "certify_equilibrium": WorkingCall(
        lambda box: {
            "model": _cantilever(box),
            "accuracy": _ACCURACY,
            "columns": ["end"],
            "loads": ["gravity"],
            "step": 1.0,
        },
        _show_certificate,
    ),
    "certify_modes": WorkingCall(
        lambda box: {
            "model": _cantilever(box),
            "accuracy": _ACCURACY,
            "n": 1,
            "about": "reference",
        },
        _show_certificate,
    ),
    "certify_periodic": WorkingCall(
        lambda box: {
            "model": _shaken_bar(box),
            "period": _PERIOD,
            "accuracy": _ACCURACY,
            "columns": ["knee"],
            "integrator": box.integrator,
            "settle": 1,
            "tolerance": 1e-3,
        },
        _show_certificate,
    ),
}
