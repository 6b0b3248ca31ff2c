"""Linear models against the nonlinear equations they are of."""

from dataclasses import replace

import numpy as np
import pytest
from numpy.testing import assert_allclose
from scipy.signal import StateSpace, lsim

import beamdae as bd

ALLOY = bd.Material(E=68.95e9, nu=0.3, rho=2760.0)
STRIP = bd.Section.rectangle(ALLOY, width=0.03, height=0.0025, damping=1e-3)


def mount(push=0.0):
    """A mass on a sliding foot that a driver shakes, with a spring and a damper between."""
    mech = bd.Mechanism(gravity=(0.0, -9.81))
    foot = mech.add(bd.RigidBody("foot", 0.5, 0.1, center=(0.0, 0.0)))
    mech.add(bd.Prismatic("rail", mech.ground.at(0.0, 0.0), foot.at(0.0, 0.0), (0.0, 1.0)))
    mech.add(
        bd.TranslationalDriver(
            "shaker", mech.ground.at(0, 0), foot.at(0, 0), law=0.0, direction=(0.0, 1.0)
        )
    )
    load = mech.add(bd.RigidBody("load", 2.0, 0.1, center=(0.0, 1.0)))
    mech.add(bd.Prismatic("column", foot.at(0.0, 1.0), load.at(0.0, 1.0), (0.0, 1.0)))
    ends = (foot.at(0.0, 0.0), load.at(0.0, 1.0))
    mech.add(bd.SpringDamper("leg", *ends, 200.0, 3.0))
    mech.add(bd.Force("push", load.at(0.0, 1.0), (0.0, push)))
    mech.observe("load", load.at(0.0, 1.0))
    mech.observe("foot", foot.at(0.0, 0.0))
    mech.observe("shaker", mech.part("shaker").reaction)
    return mech


def strip(push=0.0):
    mech = bd.Mechanism(gravity=(0.0, -9.81))
    arc = bd.Arc(radius=0.85, length=0.8, start=(0.0, 0.0), angle=-0.6)
    beam = mech.add(bd.Beam("beam", arc, STRIP, elements=2))
    mech.add(bd.PointMass("tip mass", 0.06, on=beam.end))
    root = mech.add(bd.Weld("root", mech.ground.at(0.0, 0.0), beam.start))
    mech.add(bd.Force("push", beam.end, (0.0, push)))
    mech.observe("tip", beam.end)
    mech.observe("forces", beam.section_forces(0.4))
    mech.observe("root", root.reaction)
    return mech


def test_a_shaken_mass_has_the_transfer_function_of_its_equation():
    """m y'' + c (y' - u') + k (y - u) = F; the driver bears M u'' + m y'' besides the weight."""
    model = bd.linearize(mount(), about="equilibrium")
    assert [x.header for x in model.inputs] == [
        "shaker.travel_ddot [m/s^2]",
        "push.Fx [N]",
        "push.Fy [N]",
    ]
    assert len(model.states) == 4
    f = np.array([0.3, 1.0, 5.0])
    s = 2j * np.pi * f
    m, c, k = 2.0, 3.0, 200.0
    own = m * s**2 + c * s + k
    found = model.frequency_response(f)
    outputs = [x.name for x in model.outputs]
    load, force = outputs.index("load.y"), outputs.index("shaker.F")
    assert_allclose(found[:, load, 2], 1.0 / own, rtol=1e-9)
    by_u = (c * s + k) / own
    assert_allclose(found[:, load, 0], by_u / s**2, rtol=1e-9)
    # The sign is that of the force on the foot.
    assert_allclose(np.abs(found[:, force, 0]), np.abs(0.5 + m * by_u), rtol=1e-9)
    assert_allclose(found[:, force, 2], -(c * s + k) / own, rtol=1e-9)
    assert_allclose(model.output_values[force], 2.5 * 9.81, rtol=1e-9)


def test_eigenvalues_of_a_are_the_modes():
    model, found = bd.linearize(strip()), bd.modes(strip(), n=3)
    values = np.linalg.eigvals(model.A)
    upper = sorted(values[values.imag > 0.0], key=abs)[:3]
    # Rounding beside the fastest modes, which are 1e6 times as fast.
    assert_allclose(upper, found.eigenvalues, rtol=2e-5)


@pytest.mark.slow(reason="a run of a curved beam")
def test_the_answer_to_a_small_step_is_that_of_the_nonlinear_run():
    model = bd.linearize(strip(), about="equilibrium")
    force = 1e-4
    rested = bd.equations_of_motion(strip(), "equilibrium")
    stepped = replace(bd.equations_of_motion(strip(force)), q0=rested.q0, v0=0.0 * rested.v0)
    run = bd.simulate(stepped, bd.Radau(1e-10), 0.3, output_step=2e-3)
    assert run.status.success
    _, known, _ = lsim(model.state_space(), np.tile([0.0, force], (len(run.t), 1)), run.t)
    for k, named in enumerate(model.outputs):
        moved = run.columns[named.header] - model.output_values[k]
        size = np.max(np.abs(known[:, k]))
        assert_allclose(moved, known[:, k], rtol=0.0, atol=1e-3 * size, err_msg=named.header)


def test_a_model_is_ready_for_scipy_and_told_by_name():
    model = bd.linearize(mount(), inputs=["push"], outputs=["load"])
    a, b, c, d = model
    assert isinstance(model.state_space(), StateSpace)
    assert (a.shape, b.shape, c.shape, d.shape) == ((2, 2), (2, 2), (6, 2), (6, 2))
    assert [x.header for x in model.states] == ["load.y [m]", "load.y_dot [m/s]"]
    assert_allclose(a, [[0.0, 1.0], [-100.0, -1.5]], rtol=1e-9)
    assert_allclose(b[:, 1], [0.0, 0.5], atol=1e-12)


def test_a_skate_is_a_state_less():
    """A sled pushed sideways at its center: it does not move; ahead it does."""
    mech = bd.Mechanism()
    body = mech.add(bd.RigidBody("sled", 2.0, 0.1, center=(0.0, 0.0)))
    mech.add(bd.Skate("blade", body.at(0.0, 0.0), (1.0, 0.0)))
    mech.add(bd.Force("push", body.at(0.0, 0.0), (0.0, 0.0)))
    mech.observe("sled", body.at(0.0, 0.0))
    model = bd.linearize(mech)
    assert len(model.states) == 5
    response = model.frequency_response([1.0])[0]
    names = [x.name for x in model.outputs]
    assert_allclose(response[names.index("sled.x"), 0], -0.5 / (2.0 * np.pi) ** 2, rtol=1e-12)
    assert_allclose(response[names.index("sled.y"), 1], 0.0, atol=1e-15)


def test_a_skate_that_travels_turns_its_way():
    """Off at speed v: a turn of phi carries it aside by v phi, y' = v phi."""
    mech = bd.Mechanism()
    body = mech.add(bd.RigidBody("sled", 2.0, 0.1, velocity=(3.0, 0.0)))
    mech.add(bd.Skate("blade", body.at(0.0, 0.0), (1.0, 0.0)))
    mech.add(bd.Moment("helm", body.at(0.0, 0.0), 0.0))
    mech.observe("sled", body.at(0.0, 0.0))
    run = bd.simulate(mech, bd.Radau(1e-8), 0.1)
    model = bd.linearize(mech, about=run.at(0.0))
    names, w = [x.name for x in model.outputs], 2.0 * np.pi
    response = model.frequency_response([1.0])[0][:, 0]
    turn = -1.0 / (0.1 * w**2)
    assert_allclose(response[names.index("sled.angle")], turn, rtol=1e-9)
    assert_allclose(response[names.index("sled.y")], 3.0 * turn / (1j * w), rtol=1e-9)


def test_states_and_outputs_turn_with_a_rotation():
    """Of a body that turns: an observer who turns as well sees no Coriolis force of a spring."""
    mech = bd.Mechanism()
    disk = mech.add(bd.RigidBody("disk", 1.0, 0.3))
    mech.add(bd.Revolute("axle", mech.ground.at(0.0, 0.0), disk.at(0.0, 0.0)))
    mech.add(bd.Moment("motor", disk.at(0.0, 0.0), 0.0))
    model = bd.linearize(mech, about=bd.rotation(4.0))
    assert_allclose(model.A, [[0.0, 1.0], [0.0, 0.0]], atol=1e-12)
    assert_allclose(model.B, [[0.0], [1.0 / 0.3]], rtol=1e-12)


@pytest.mark.parametrize(
    ("settings", "told"),
    [
        ({"inputs": ["puhs"]}, "did you mean 'push'"),
        ({"inputs": "push"}, "inputs must be names"),
        ({"inputs": ["rail"]}, "no input 'rail'"),
        ({"outputs": ["lode"]}, "did you mean 'load'"),
        ({"outputs": [3]}, "no output 3"),
        ({"about": "down"}, "about"),
    ],
)
def test_mistakes_are_told(settings, told):
    with pytest.raises(bd.BeamdaeError, match=told):
        bd.linearize(mount(), **settings)
