"""Springs, dampers and bushings: closed forms and energy balance."""

import numpy as np
import pytest
from conformance import integrators
from mechanisms import free_ball
from numpy.testing import assert_allclose
from support import NumericEquations

import beamdae as bd

# Errors of the motions below, at the tolerances and steps given there.
every_integrator = integrators(rtol=1e-7, step=1e-3)


def oscillator(damping, stiffness=90.0, mass=2.5, start=0.3):
    """Return a mass on the line of its spring, `start` beyond the free length."""
    mech, _ = free_ball((1.0 + start, 0.0), mass, spring=(stiffness, damping, 1.0))
    spring = mech.part("spring")
    mech.observe("force", spring.force)
    mech.observe("elongation", spring.elongation)
    return mech


@pytest.mark.parametrize("native", [True, False])
def test_observed_force_and_elongation(native, monkeypatch):
    if not native:
        monkeypatch.setenv("BEAMDAE_NATIVE", "off")
    numeric = NumericEquations(oscillator(4.0))
    v = np.array([0.7, 3.0])
    assert_allclose(numeric.observed("elongation", v=v), [0.3], rtol=1e-14)
    # Tension is positive; motion across the spring does not stretch it.
    assert_allclose(numeric.observed("force", v=v), [90.0 * 0.3 + 4.0 * 0.7], rtol=1e-14)
    assert_allclose(numeric.force(v=v), [90.0 * 0.3 + 4.0 * 0.7, 0.0], atol=1e-14)
    assert_allclose(numeric.energies(v=v)[1], 45.0 * 0.09, rtol=1e-14)
    assert_allclose(numeric.energies(v=v)[4], 4.0 * 0.49, rtol=1e-14)


def test_preload_is_the_tension_at_the_free_length():
    mech, block = free_ball((3.0, 4.0), name="block")
    mech.add(bd.Spring("spring", mech.ground.at(0.0, 0.0), block.point, 7.0, preload=10.0))
    assert_allclose(NumericEquations(mech).force(), [6.0, 8.0], rtol=1e-14)


def test_a_spring_of_free_length_zero_is_linear():
    """Its force is k times the vector: the path is an ellipse about the origin."""
    mech, _ = free_ball(mass=2.0, velocity=(1.0, -0.5), spring=(8.0, 0.0, 0.0))
    mech.observe("force", mech.part("spring").force)
    solution = bd.simulate(mech, bd.Radau(rtol=1e-8), t_end=4.0, output_step=0.05)
    wave = 0.5 * np.sin(2.0 * solution.t)
    assert_allclose(solution.q, np.outer(wave, [1.0, -0.5]), atol=1e-7)
    numeric = NumericEquations(mech)
    assert_allclose(numeric.stiffness(), 8.0 * np.eye(2), rtol=1e-14)
    assert_allclose(numeric.observed("force"), [0.0], atol=1e-14)


def test_points_of_a_spring_may_coincide_during_the_motion():
    """The force of a spring between points that pass each other is finite, and energy is kept."""
    mech, _ = free_ball((1.0, 0.0), velocity=(-3.0, 0.0), spring=(2.0,))
    numeric = NumericEquations(mech)
    coinciding = np.zeros(2)
    assert_allclose(numeric.force(coinciding), [0.0, 0.0], atol=1e-14)
    assert np.all(np.isfinite(numeric.stiffness(coinciding)))


@every_integrator
def test_torsion_spring_and_damper_of_two_disks(integrator):
    """Free disks: the relative angle oscillates with the reduced inertia, the mean is uniform."""
    mech = bd.Mechanism()
    disks = [
        mech.add(bd.RigidBody(name, 1.0, inertia, (x, 0.0), angular_velocity=spin))
        for name, inertia, x, spin in (("one", 0.6, 0.0, 1.0), ("other", 0.3, 2.0, -0.4))
    ]
    a, b = (disk.at(*disk.center) for disk in disks)
    mech.observe("shaft", mech.add(bd.TorsionSpring("shaft", a, b, 5.0)).angle)
    mech.add(bd.TorsionSpring("oil", a, b, damping=0.1))
    solution = bd.simulate(mech, integrator, t_end=1.5, output_step=0.01)
    reduced = 0.6 * 0.3 / 0.9
    w, ratio = np.sqrt(5.0 / reduced), 0.1 / (2.0 * np.sqrt(5.0 * reduced))
    damped = w * np.sqrt(1.0 - ratio**2)
    t = solution.t
    twist = -1.4 / damped * np.exp(-ratio * w * t) * np.sin(damped * t)
    assert_allclose(solution.observed.iloc[:, 0], twist, atol=1e-4 * 1.4 / w)
    assert_allclose(solution.q[:, 5] - solution.q[:, 2], twist, atol=1e-4 * 1.4 / w)
    spin = (0.6 * 1.0 - 0.3 * 0.4) / 0.9
    assert_allclose((0.6 * solution.q[:, 2] + 0.3 * solution.q[:, 5]) / 0.9, spin * t, atol=1e-9)
    assert solution.quality.energy_imbalance < 1e-5


def test_bushing_in_the_axes_of_its_first_body():
    mech = bd.Mechanism()
    one = mech.add(bd.RigidBody("one", 1.0, 1.0))
    other = mech.add(bd.RigidBody("other", 1.0, 1.0, center=(2.0, 0.0)))
    joint = bd.Bushing("joint", one.at(1.0, 0.0), other.at(1.0, 0.0), kx=10.0, ky=20.0, ktheta=3.0)
    mech.add(joint)
    mech.observe("force", joint.force)
    mech.observe("displacement", joint.displacement)
    numeric = NumericEquations(mech)
    # Both rotated by 90 degrees, the second one displaced by 0.1 along the axis of the first.
    q = np.array([0.0, 0.0, np.pi / 2, 0.0, 2.1, np.pi / 2])
    assert_allclose(numeric.observed("displacement", q=q), [0.1, 0.0, 0.0], atol=1e-15)
    assert_allclose(numeric.observed("force", q=q), [1.0, 0.0, 0.0], atol=1e-14)
    assert_allclose(numeric.force(q), [0.0, -1.0, 0.0, 0.0, 1.0, 0.0], atol=1e-14)
    assert_allclose(numeric.energies(q)[1], 0.05, rtol=1e-12)


@pytest.mark.slow(reason="a quarter of a second")
def test_law_of_a_spring_counts_as_a_load_unless_its_energy_is_given():
    def run(**settings):
        mech, block = free_ball((1.4, 0.0), name="block")
        mech.add(
            bd.Spring(
                "spring",
                mech.ground.at(0.0, 0.0),
                block.point,
                free_length=1.0,
                law=lambda x, rate: 30.0 * x + 200.0 * x**3 + 0.5 * np.tanh(4.0 * rate),
                **settings,
            )
        )
        return bd.simulate(mech, bd.Radau(rtol=1e-7), t_end=1.0)

    plain, potential = run(), run(energy=lambda x: 15.0 * x**2 + 50.0 * x**4)
    assert_allclose(plain.q, potential.q, atol=1e-12)
    for solution in (plain, potential):
        assert solution.quality.energy_imbalance < 1e-5
    elastic_energy = potential.energies["energy.strain [J]"]
    assert_allclose(elastic_energy.iloc[0], 15.0 * 0.16 + 50.0 * 0.0256, rtol=1e-12)
    assert_allclose(
        plain.energies["energy.dissipated [J]"],
        potential.energies["energy.dissipated [J]"],
        atol=1e-9,
    )
    assert np.all(plain.energies["energy.strain [J]"] == 0.0)
