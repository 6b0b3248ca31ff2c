"""Modes against eigenvalues of dense first-order matrices."""

import re
from pathlib import Path

import numpy as np
import pytest
from mechanisms import EARTH, hinged_body, rectangle
from numpy.testing import assert_allclose
from scipy.linalg import lstsq, null_space

import beamdae as bd
from beamdae.analysis.linear_dynamics.linearization import linearize_about

SOFT = bd.Material(E=1e8, nu=0.3, rho=1000.0)
STRIP = rectangle(0.01, damping=2e-4, material=SOFT)
FORMULATIONS = ("floating frame", "exact")


def arch(formulation):
    """Return an arch on two hinges, with a mass suspended from it by a spring and a damper."""
    mech = bd.Mechanism(gravity=EARTH)
    arc = bd.Arc(radius=0.6, length=0.8, start=(0.0, 0.0), angle=-0.66)
    beam = mech.add(bd.Beam("arch", arc, STRIP, elements=2, formulation=formulation))
    for name, s, end in (("left", 0.0, beam.start), ("right", 0.8, beam.end)):
        mech.add(bd.Revolute(name, mech.ground.at(*arc.point(s)), end))
    x, y = arc.point(0.3)
    bob = mech.add(bd.PointMass("bob", 0.02, at=(x, y - 0.2)))
    mech.add(bd.Spring("wire", beam.at(0.3), bob.point, 20.0, 0.05))
    return mech


def arm(formulation, has_driver=True, offset=0.1):
    """Return a curved, damped beam on a hub."""
    mech, hub = hinged_body(1.0, 0.01, name="hub")
    arc = bd.Arc(radius=0.5, length=0.6, start=(offset, 0.0), angle=0.3)
    beam = mech.add(bd.Beam("beam", arc, STRIP, elements=2, formulation=formulation))
    mech.add(bd.Weld("root", hub.at(offset, 0.0), beam.start))
    if has_driver:
        mech.add(bd.Driver("motor", mech.ground.at(0.0, 0.0), hub.at(0.0, 0.0), law=0.0))
    return mech


def redundant_arm(formulation):
    mech = arm(formulation)
    mech.redundant = "minimum norm"
    mech.add(bd.Revolute("pin", mech.part("hub").at(0.1, 0.0), mech.part("beam").start))
    return mech


def sled(formulation):
    """Return a sled on a knife edge with a flexible tail and a soft bushing to the ground."""
    mech = bd.Mechanism()
    body = mech.add(bd.RigidBody("sled", 0.2, 0.01))
    line = bd.Line((0.0, 0.0), (0.5, 0.1))
    beam = mech.add(bd.Beam("tail", line, STRIP, elements=2, formulation=formulation))
    mech.add(bd.Weld("hitch", body.at(0.0, 0.0), beam.start))
    mech.add(bd.Skate("blade", body.at(0.0, 0.0), (1.0, 0.0)))
    ends = mech.ground.at(-0.3, 0.0), body.at(-0.3, 0.0)
    mech.add(bd.Bushing("tether", *ends, 30.0, 50.0, 0.0, 0.1, 0.2, 0.0))
    return mech


def falling_arm(formulation):
    """Return the arm without a driver, which falls under its weight."""
    mech = arm(formulation, has_driver=False)
    mech.gravity = np.array([0.0, -9.81])
    return mech


CASES = {
    "at rest": (arch, "equilibrium"),
    "rotating": (arm, bd.rotation(15.0)),
    "rotating freely": (lambda x: arm(x, has_driver=False), bd.rotation(15.0)),
    "redundant": (redundant_arm, "reference"),
    "nonholonomic": (sled, "reference"),
    "in motion": (falling_arm, None),
}


def with_marks(case):
    slow = case != "nonholonomic"
    return pytest.param(case, marks=[pytest.mark.slow(reason="one is enough")] if slow else [])


def model_and_state(case, formulation):
    make, about = CASES[case]
    mech = make(formulation)
    return mech, about or bd.simulate(mech, bd.Radau(1e-6), 0.1).at(0.07)


def dense_eigenvalues(lin):
    """Return the eigenvalues of q' = v, M v' + C v + K q + H lam = 0 under the constraints."""
    tangent, e = lin.tangent, lin.equations
    stiffness, damping, mass = (
        x.toarray() for x in (tangent.stiffness, tangent.damping, tangent.mass)
    )
    by_q, by_v = tangent.position_jacobian.toarray(), tangent.velocity_jacobian.toarray()
    zeros = np.zeros_like(by_q)
    holonomic = ~lin.linearized_equations.nonholonomic
    rows = [np.hstack([by_q, by_v]), np.hstack([zeros, by_q])[holonomic]]
    scales = np.concatenate([e.position_scales, 30.0 * e.position_scales])
    states = scales[:, None] * null_space(np.vstack(rows) * scales)
    left_basis = null_space(tangent.reactions.toarray().T).T
    one, zero = np.eye(e.n) / e.position_scales[:, None], np.zeros((e.n, e.n))
    by_rates = np.block([[one, zero], [left_basis @ np.hstack([zero, mass])]])
    by_states = np.block([[zero, one], [-left_basis @ np.hstack([stiffness, damping])]])
    # Inverted about a shift, so that rounding of fast modes does not enter slow ones.
    shift = 30.0
    shifted = lstsq((by_states - shift * by_rates) @ states, by_rates @ states)[0]
    return shift + 1.0 / np.linalg.eigvals(shifted)


@pytest.mark.parametrize("formulation", FORMULATIONS)
@pytest.mark.parametrize("case", [with_marks(case) for case in CASES])
def test_modes_match_dense_eigenvalues(case, formulation):
    mech, about = model_and_state(case, formulation)
    lin = linearize_about("modes", mech, about)
    modes = bd.modes(mech, about, n=6)
    expected = dense_eigenvalues(lin)
    for value, kind in zip(modes.eigenvalues, modes.kinds, strict=True):
        if kind == "free motion":
            # The error of a double zero is the square root of rounding.
            assert np.min(np.abs(expected)) < 1e-3
            continue
        assert_allclose(expected[np.argmin(np.abs(expected - value))], value, rtol=1e-8)
    # No eigenvalue is missing.
    lowest = np.sort(np.abs(expected[(expected.imag >= 0.0) & (np.abs(expected) > 1e-3)]))
    nonzero = np.abs(modes.eigenvalues[[kind != "free motion" for kind in modes.kinds]])
    assert_allclose(lowest[: len(nonzero)], nonzero, rtol=1e-8)


@pytest.mark.parametrize("formulation", FORMULATIONS)
@pytest.mark.parametrize("case", [with_marks(case) for case in CASES])
def test_shapes_satisfy_the_linearized_equations(case, formulation):
    mech, about = model_and_state(case, formulation)
    modes = bd.modes(mech, about, n=6)
    tangent = modes._linearization.tangent
    for value, shape in zip(modes.eigenvalues, modes.shapes, strict=True):
        inertia = value**2 * (tangent.mass @ shape)
        force = inertia + value * (tangent.damping @ shape) + tangent.stiffness @ shape
        h = tangent.reactions.toarray()
        unbalanced = force - h @ np.linalg.lstsq(h, force, rcond=None)[0]
        assert np.max(np.abs(unbalanced)) <= 1e-6 * max(
            np.max(np.abs(tangent.stiffness @ shape)), 1.0
        )
        gap = tangent.position_jacobian @ shape + value * (tangent.velocity_jacobian @ shape)
        assert np.max(np.abs(gap)) <= 1e-7 * max(1.0, abs(value)) * np.max(np.abs(shape))


@pytest.mark.slow(reason="all models about several states")
@pytest.mark.parametrize("path", sorted(Path("models").glob("*.py")), ids=lambda path: path.stem)
def test_every_model_has_modes_or_a_clear_error(path):
    model = bd.load_model(path)
    run = bd.simulate(model, t_end=0.02, output_step=0.01)
    for about in ("equilibrium", bd.rotation(2.0), run.at(0.013)):
        try:
            bd.modes(model, about, n=4)
        except bd.BeamdaeError as error:
            # Some mechanisms rotate or fall forever, and weight does not rotate with the frame.
            if not re.search("no equilibrium was found|do not rotate with", str(error)):
                raise
    modes = bd.modes(model, n=4)
    equations = modes._linearization.equations
    free = equations.n - equations.m
    assert len(modes) >= min(4, free)
    # A complex pair is one mode, and two real eigenvalues of a damped degree of freedom are two.
    n_pairs = np.count_nonzero(modes.eigenvalues.imag > 0.0)
    assert len(modes) + n_pairs <= 2 * free - len(equations.states)
    assert np.all(np.isfinite(modes.eigenvalues))
    assert free or any("there are no modes" in x for x in modes.warnings)
