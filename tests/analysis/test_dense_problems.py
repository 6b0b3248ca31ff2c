"""Modes against eigenvalues of dense matrices of coordinates and velocities at once."""

import re
from pathlib import Path

import numpy as np
import pytest
from numpy.testing import assert_allclose
from scipy.linalg import lstsq, null_space

import beamdae as bd
from beamdae.analysis.linear_dynamics.linearization import linearize_about

SOFT = bd.Material(E=1e8, nu=0.3, rho=1000.0)
STRIP = bd.Section.rectangle(SOFT, width=0.02, height=0.01, damping=2e-4)
FORMULATIONS = ("floating frame", "exact")


def arch(formulation):
    """On two hinges, with a mass on a spring and a damper hung from it."""
    mech = bd.Mechanism(gravity=(0.0, -9.81))
    arc = bd.Arc(radius=0.6, length=0.8, start=(0.0, 0.0), angle=-0.66)
    beam = mech.add(bd.Beam("arch", arc, STRIP, elements=2, formulation=formulation))
    for name, s, end in (("left", 0.0, beam.start), ("right", 0.8, beam.end)):
        mech.add(bd.Revolute(name, mech.ground.at(*arc.point(s)), end))
    x, y = arc.point(0.3)
    bob = mech.add(bd.PointMass("bob", 0.02, at=(x, y - 0.2)))
    mech.add(bd.SpringDamper("wire", beam.at(0.3), bob.point, 20.0, 0.05))
    return mech


def arm(formulation, driven=True, offset=0.1):
    """On a hub, bent and damped."""
    mech = bd.Mechanism()
    hub = mech.add(bd.RigidBody("hub", 1.0, 0.01))
    arc = bd.Arc(radius=0.5, length=0.6, start=(offset, 0.0), angle=0.3)
    beam = mech.add(bd.Beam("beam", arc, STRIP, elements=2, formulation=formulation))
    mech.add(bd.Revolute("axle", mech.ground.at(0.0, 0.0), hub.at(0.0, 0.0)))
    mech.add(bd.Weld("root", hub.at(offset, 0.0), beam.start))
    if driven:
        mech.add(bd.Driver("motor", mech.ground.at(0.0, 0.0), hub.at(0.0, 0.0), law=0.0))
    return mech


def twice_held(formulation):
    mech = arm(formulation)
    mech.redundant = "minimum norm"
    mech.add(bd.Revolute("pin", mech.part("hub").at(0.1, 0.0), mech.part("beam").start))
    return mech


def sled(formulation):
    """A flexible tail behind a knife edge, held by a soft bushing."""
    mech = bd.Mechanism()
    body = mech.add(bd.RigidBody("sled", 0.2, 0.01))
    line = bd.Line((0.0, 0.0), (0.5, 0.1))
    beam = mech.add(bd.Beam("tail", line, STRIP, elements=2, formulation=formulation))
    mech.add(bd.Weld("hitch", body.at(0.0, 0.0), beam.start))
    mech.add(bd.Skate("blade", body.at(0.0, 0.0), (1.0, 0.0)))
    ends = mech.ground.at(-0.3, 0.0), body.at(-0.3, 0.0)
    mech.add(bd.Bushing("tether", *ends, 30.0, 50.0, 0.0, 0.1, 0.2, 0.0))
    return mech


def passing(formulation):
    """The same arm some time after it was let go."""
    mech = arm(formulation, driven=False)
    mech.gravity = np.array([0.0, -9.81])
    return mech


CASES = {
    "at rest": (arch, "equilibrium"),
    "turning": (arm, bd.rotation(15.0)),
    "turning freely": (lambda x: arm(x, driven=False), bd.rotation(15.0)),
    "redundant": (twice_held, "reference"),
    "nonholonomic": (sled, "reference"),
    "on the way": (passing, None),
}


def marked(case):
    slow = case != "nonholonomic"
    return pytest.param(case, marks=[pytest.mark.slow(reason="one is enough")] if slow else [])


def state(case, formulation):
    make, about = CASES[case]
    mech = make(formulation)
    return mech, about or bd.simulate(mech, bd.Radau(1e-6), 0.1).at(0.07)


def dense_eigenvalues(lin):
    """Of q' = v, M v' + C v + K q + H lam = 0 for all (q, v) that satisfy the constraints."""
    own, e = lin.tangent, lin.equations
    stiffness, damping, mass = (x.toarray() for x in (own.stiffness, own.damping, own.mass))
    held, rates, moving = own.held.toarray(), own.held_rates.toarray(), lin.nonholonomic
    none = np.zeros_like(held)
    rows = [np.hstack([held, rates]), np.hstack([none, held])[~moving]]
    scales = np.concatenate([e.position_scales, 30.0 * e.position_scales])
    states = scales[:, None] * null_space(np.vstack(rows) * scales)
    left = null_space(own.reactions.toarray().T).T
    one, zero = np.eye(e.n) / e.position_scales[:, None], np.zeros((e.n, e.n))
    by_rates = np.block([[one, zero], [left @ np.hstack([zero, mass])]])
    by_states = np.block([[zero, one], [-left @ np.hstack([stiffness, damping])]])
    # Fast modes would leave their rounding in slow ones: those nearest to the shift are exact.
    shift = 30.0
    shifted = lstsq((by_states - shift * by_rates) @ states, by_rates @ states)[0]
    return shift + 1.0 / np.linalg.eigvals(shifted)


@pytest.mark.parametrize("formulation", FORMULATIONS)
@pytest.mark.parametrize("case", [marked(case) for case in CASES])
def test_modes_are_eigenvalues_of_dense_matrices(case, formulation):
    mech, about = state(case, formulation)
    lin = linearize_about("modes", mech, about)
    found = bd.modes(mech, about, n=6)
    known = dense_eigenvalues(lin)
    for value, kind in zip(found.eigenvalues, found.kinds, strict=True):
        if kind == "free motion":
            # A double zero is off by the root of rounding.
            assert np.min(np.abs(known)) < 1e-3
            continue
        assert_allclose(known[np.argmin(np.abs(known - value))], value, rtol=1e-8)
    # None is left out.
    lowest = np.sort(np.abs(known[(known.imag >= 0.0) & (np.abs(known) > 1e-3)]))
    moving = np.abs(found.eigenvalues[[kind != "free motion" for kind in found.kinds]])
    assert_allclose(lowest[: len(moving)], moving, rtol=1e-8)


@pytest.mark.parametrize("formulation", FORMULATIONS)
@pytest.mark.parametrize("case", [marked(case) for case in CASES])
def test_shapes_satisfy_the_linearized_equations(case, formulation):
    mech, about = state(case, formulation)
    found = bd.modes(mech, about, n=6)
    own = found._linearization.tangent
    for value, shape in zip(found.eigenvalues, found.shapes, strict=True):
        inertia = value**2 * (own.mass @ shape)
        force = inertia + value * (own.damping @ shape) + own.stiffness @ shape
        h = own.reactions.toarray()
        left = force - h @ np.linalg.lstsq(h, force, rcond=None)[0]
        assert np.max(np.abs(left)) <= 1e-6 * max(np.max(np.abs(own.stiffness @ shape)), 1.0)
        gap = own.held @ shape + value * (own.held_rates @ shape)
        assert np.max(np.abs(gap)) <= 1e-7 * max(1.0, abs(value)) * np.max(np.abs(shape))


@pytest.mark.slow(reason="all models, by several states")
@pytest.mark.parametrize("path", sorted(Path("models").glob("*.py")), ids=lambda path: path.stem)
def test_every_model_has_modes_or_one_sentence(path):
    model = bd.load_model(path)
    run = bd.simulate(model, t_end=0.02, output_step=0.01)
    for about in ("equilibrium", bd.rotation(2.0), run.at(0.013)):
        try:
            bd.modes(model, about, n=4)
        except bd.BeamdaeError as problem:
            # Nothing in between: what turns or falls without end, and weight, which does not turn.
            if not re.search("no equilibrium was found|do not turn with", str(problem)):
                raise
    found = bd.modes(model, n=4)
    free = found._linearization.equations.n - found._linearization.equations.m
    assert len(found) == min(4, free)
    assert np.all(np.isfinite(found.eigenvalues))
    assert free or "nothing vibrates" in found.warnings[0]
