"""Copies of mechanisms with other meshes: formulas contain the signals of the copy."""

import threading
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from mechanisms import clamped_beam, rectangle
from numpy.testing import assert_allclose

import beamdae as bd
from beamdae.beams.remeshing import replace_beams

ALLOY = bd.Material(E=6.9e10, nu=0.3, rho=2700.0)
METHOD = bd.GeneralizedAlpha(1e-3)


def sensor_in_law(mech, tip):
    v = mech.sensor("v", tip, "y_dot")
    mech.add(bd.Force("brake", tip, (0.0, -3.0 * v)))


def global_sensor_in_formula(mech, tip):
    global speed
    speed = mech.sensor("v", tip, "y_dot")
    mech.add(bd.ForceLaw("brake", tip, lambda point, t: (0.0, -3.0 * speed - point.velocity[1])))


def work_of_a_damper(mech, tip):
    damper = mech.add(bd.Spring("damper", mech.ground.at(0.3, -1.0), tip, damping=2.0))
    mech.state("work", mech.sensor("power", damper.power), unit="J")


def servo(mech, tip):
    y, v = mech.sensor("y", tip, "y"), mech.sensor("v", tip, "y_dot")
    force = bd.pid(mech, "servo", 0.01 - y, kp=30.0, ki=400.0, kd=4.0, rate=-v, limits=(-5.0, 5.0))
    mech.add(bd.Force("motor", tip, (0.0, force)))


def sampled(mech, tip):
    y = mech.sensor("y", tip, "y")
    u = mech.input("u", unit="N")
    mech.add(bd.Force("motor", tip, (0.0, u)))
    mech.add(bd.Controller("law", 5e-3, [y], [u], lambda sample: -50.0 * sample.reads[0]))


def states(mech, tip):
    position = mech.state("position", start=1.0)
    velocity = mech.state("velocity", lambda velocity, t: -400.0 * position - velocity)
    position.follows(velocity)
    mech.add(bd.Force("pull", tip, (0.0, 2.0 * position)))


def build(add):
    strip = rectangle(0.003, damping=1e-4, material=ALLOY)
    mech, beam = clamped_beam(strip, 2, 0.3, name="rod", gravity=9.81)
    add(mech, beam.end)
    mech.observe("tip", beam.end)
    return mech, beam


SIGNALS = [sensor_in_law, global_sensor_in_formula, work_of_a_damper, servo, sampled, states]


@pytest.mark.parametrize("add", SIGNALS)
def test_regression_copies_contain_their_own_signals(add):
    """Mesh comparisons and `check` of most mechanisms with states failed.

    Formulas of the copy contained the sensors and states of the original mechanism.
    """
    mech, beam = build(add)
    before = bd.simulate(mech, METHOD, t_end=0.02)
    copy = replace_beams(mech, {"rod": beam._with_mesh(beam.mesh)}, "test")
    assert all(copy.parts[name] is not part for name, part in mech.parts.items())
    run = bd.simulate(copy, METHOD, t_end=0.02)
    assert list(run.columns) == list(before.columns)
    for name, values in before.columns.items():
        assert_allclose(run.columns[name], values, rtol=1e-7, atol=1e-9, err_msg=name)
    # The original mechanism still has its own signals.
    again = bd.simulate(mech, METHOD, t_end=0.02)
    assert_allclose(again["tip.y"], before["tip.y"], rtol=1e-9)
    finer = replace(beam.mesh, elements=4)
    run = bd.simulate(
        replace_beams(mech, {"rod": beam._with_mesh(finer)}, "test"), METHOD, t_end=0.02
    )
    assert_allclose(run["tip.y"], before["tip.y"], atol=1e-3 * np.ptp(before["tip.y"]))


LOCK = threading.Lock()


def test_regression_laws_with_locks_and_variables_without_a_value():
    """The message asked for functions where a function contained the lock."""
    lock = threading.Lock()

    def law_with_lock(sample):
        with lock:
            return -sample.reads[0]

    def law_with_global_lock(sample):
        with LOCK:
            return -sample.reads[0]

    def law_without_value(sample):
        return -gain * sample.reads[0]

    def copy_with(law):
        def add(mech, tip):
            u = mech.input("u", unit="N")
            mech.add(bd.Controller("law", 5e-3, [mech.sensor("y", tip, "y")], [u], law))

        mech, beam = build(add)
        return replace_beams(mech, {"rod": beam._with_mesh(beam.mesh)}, "test")

    with pytest.raises(bd.BeamdaeError, match=r"cannot pickle .*lock.*in global variables\.$"):
        copy_with(law_with_lock)
    copy_with(law_with_global_lock)
    copied = copy_with(law_without_value).part("law").law
    gain = 2.0
    assert copied is not law_without_value
    assert law_without_value(SimpleNamespace(reads=[1.0])) == -gain


@pytest.mark.slow(reason="a fifth of a second")
def test_mechanisms_with_compiled_gravity_laws_are_copied():
    """Machine code cannot be copied, and kernels are found by their ids."""
    mech = bd.Mechanism(gravity=(0.0, lambda t: -9.81 + 0.0 * t))
    section = rectangle(0.01)
    beam = mech.add(bd.Beam("beam", bd.Line((0.0, 0.0), (1.0, 0.0)), section))
    mech.add(bd.Weld("clamp", mech.ground.at(0.0, 0.0), beam.start))
    mech.observe("tip", beam.end)
    first = bd.equilibrium(mech)
    again = bd.equilibrium(replace_beams(mech, {}, "test"))
    assert_allclose(again["tip.y"].iloc[-1], first["tip.y"].iloc[-1], rtol=1e-12)


def test_regression_laws_without_a_module_are_copied():
    """Functions of `eval` with own global names have no module."""
    mech = bd.Mechanism()
    section = rectangle(0.01)
    beam = mech.add(bd.Beam("beam", bd.Line((0.0, 0.0), (1.0, 0.0)), section, elements=1))
    gauge = mech.sensor("gauge", beam.end, "y")
    mech.add(bd.Force("push", beam.end, (0.0, gauge)))
    law = eval("lambda point, t: (0.0, 2.0 * t)", {"__builtins__": {}})
    assert law.__module__ is None
    mech.add(bd.ForceLaw("law", beam.end, law))
    copied = replace_beams(mech, {"beam": beam._with_mesh(beam.mesh)}, "test")
    assert bd.equations_of_motion(copied).n == bd.equations_of_motion(mech).n


@pytest.mark.parametrize(
    ("options", "degree"),
    [
        ({"formulation": "exact"}, None),
        ({"formulation": "exact"}, 5),
        ({"formulation": "exact", "nodes": 3}, None),
        ({"frame": "chord"}, None),
        ({"frame": "chord"}, 5),
        ({"frame": "tangent"}, None),
        ({"elements_shape": "straight", "elements": 40}, None),
    ],
)
def test_motions_on_both_meshes_are_equal(options, degree):
    elements = options.pop("elements", 6)
    curve, section = bd.Arc(0.5, 1.0, angle=1.0), rectangle(2e-3, material=ALLOY)
    coarse = bd.Beam("arch", curve, section, elements, **options)
    mesh = coarse.mesh.with_degree(degree) if degree else coarse.mesh.with_divided_elements(2)
    fine = coarse._with_mesh(mesh)
    matrix = coarse._prolongation_to(fine)
    # The neglected angles between axes are up to 0.05 for straight elements, times the amplitude.
    amplitude = 1e-3
    rng = np.random.default_rng(1)
    change = amplitude * rng.standard_normal(len(coarse.coordinates))
    q = coarse.initial_position + change
    other = fine.initial_position + matrix @ change
    for s in np.linspace(0.0, 1.0, 4):
        positions = []
        for beam, coordinates in ((coarse, q), (fine, other)):
            point = beam.kinematics.material_point(float(s))
            values = point.motion(point.operator @ coordinates)
            positions.append(np.array(values[0]).ravel())
        assert positions[0] == pytest.approx(positions[1], abs=1e-4)
