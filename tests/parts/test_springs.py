"""Springs, dampers, forces and gravity: closed forms, virtual work and energy balance."""

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


# Forces on rigid bodies: moments of eccentric forces, energies and powers.


def test_an_eccentric_force_rotates_a_rigid_body():
    mech = bd.Mechanism(gravity=(0.0, -10.0))
    body = mech.add(bd.RigidBody("body", mass=2.0, inertia=0.3, center=(1.0, 1.0)))
    mech.add(bd.Force("push", body.at(1.5, 1.0), (0.0, 4.0)))
    mech.add(bd.Force("thrust", body.at(1.0, 3.0), (3.0, 0.0), axes="body"))
    numeric = NumericEquations(mech)
    quarter = np.array([1.0, 1.0, 0.5 * np.pi])
    # By hand: after a quarter revolution the push at the arm (0, 0.5) has no moment, and the
    # thrust points up at the arm (-2, 0).
    expected = -np.array([0.0, 4.0 + 3.0 - 20.0, -6.0])
    assert_allclose(numeric.force(quarter), expected, atol=1e-14)  # rounding
    assert_allclose(numeric.force(), -np.array([3.0, 4.0 - 20.0, 4.0 * 0.5 - 3.0 * 2.0]))
    assert_allclose(numeric.mass(), np.diag([2.0, 2.0, 0.3]), rtol=1e-15)
    v = np.array([0.3, -0.2, 5.0])
    kinetic, strain, gravity, power, dissipated = numeric.energies(v=v)
    assert_allclose(kinetic, 0.5 * (2.0 * 0.13 + 0.3 * 25.0), rtol=1e-14)
    assert_allclose(gravity, 20.0, rtol=1e-14)
    assert_allclose(power, 4.0 * (-0.2 + 5.0 * 0.5) + 3.0 * (0.3 - 5.0 * 2.0), rtol=1e-14)
    assert (strain, dissipated) == (0.0, 0.0)


# Gravity as a time law: weight is the work of a load.


@integrators(rtol=1e-7, step=1e-3)
def test_a_pendulum_rotates_uniformly_after_gravity_ends(integrator):
    mech = bd.Mechanism(gravity=(0.0, bd.piecewise((0.6, -9.81), 0.0)))
    body = mech.add(bd.RigidBody("body", 2.0, 0.5, center=(1.0, 0.0)))
    mech.add(bd.Revolute("pin", mech.ground.at(0.0, 0.0), body.at(0.0, 0.0)))
    solution = bd.simulate(mech, integrator, t_end=1.2, output_step=0.1)
    assert solution.status.success, solution.status.sentence
    rate = solution.v[:, 2]
    assert_allclose(rate[7:], rate[6], rtol=1e-5)
    # Energy gained until then: work of the weight.
    fall = 2.0 * 9.81 * np.sin(-solution.q[6, 2])
    assert_allclose(0.5 * 2.5 * rate[6] ** 2, fall, rtol=1e-4)
    assert_allclose(solution.energies["energy.work_of_loads [J]"].iloc[-1], fall, rtol=1e-4)
    assert solution.quality.energy_imbalance < 1e-4


def shock_spectrum(frequency, duration):
    """Return the peak of the absolute acceleration of an undamped oscillator, per peak of the base.

    The exact response to a half sine: forced vibration during the pulse, then free vibration.
    """
    w, pulse = 2.0 * np.pi * frequency, np.pi / duration
    t = np.linspace(0.0, duration, 100_001)
    factor = w / (w**2 - pulse**2)
    inside = factor * (w * np.sin(pulse * t) - pulse * np.sin(w * t))
    rate = factor * w * pulse * (np.cos(pulse * t) - np.cos(w * t))
    return max(np.max(np.abs(inside)), np.hypot(inside[-1], rate[-1] / w))


@integrators(rtol=1e-7, step=2e-5)
def test_a_shock_of_the_base_has_the_exact_shock_spectrum(integrator):
    duration, peak = 0.011, 30.0 * 9.81
    mech = bd.Mechanism(gravity=(0.0, -9.81 + bd.half_sine(-peak, duration)))
    frequencies = (25.0, 74.0, 180.0)
    for k, frequency in enumerate(frequencies):
        foot = mech.ground.at(float(k), 0.0)
        mass = mech.add(bd.PointMass(f"mass {k}", 0.5, at=(float(k), 0.2)))
        mech.add(bd.PointOnLine(f"guide {k}", foot, mass.point, (0.0, 1.0)))
        stiffness = 0.5 * (2.0 * np.pi * frequency) ** 2
        spring = mech.add(bd.Spring(f"spring {k}", foot, mass.point, stiffness))
        mech.observe(f"force {k}", spring.force)
        mech.observe(f"mass {k}", bd.acceleration(mass.point))
    run = bd.simulate(mech, integrator, t_end=0.06, start="equilibrium", output_step=5e-5)
    for k, frequency in enumerate(frequencies):
        dynamic = -run[f"force {k}"].to_numpy() / 0.5 - 9.81
        # Rows are 5e-5 s apart, 0.06 rad of the fastest oscillation: 5e-4 of a peak.
        assert_allclose(
            np.abs(dynamic).max() / peak, shock_spectrum(frequency, duration), rtol=1e-3
        )
        # Acceleration relative to the base plus that of the base.
        base = [bd.half_sine(peak, duration).at(t) for t in run.t]
        # Between steps, accelerations are interpolated.
        assert_allclose(run[f"mass {k}.ay"] + base, dynamic, atol=1e-3 * peak)


# ForceLaw: arguments, virtual work and energy balance.


def test_the_law_receives_the_observed_motion():
    """It does virtual work on that motion: forces at the point, moments on the rotation."""
    motions = []
    mech = bd.Mechanism()
    body = mech.add(bd.RigidBody("body", 1.0, 1.0))
    on = body.at(1.0, 0.5)

    def law(body, t):
        motions.append((*body.position, body.angle, *body.velocity, body.rate))
        return (body.position[0], body.velocity[1] + t, 2.0 * body.rate + 3.0 * body.angle)

    load = mech.add(bd.ForceLaw("load", on, law))
    mech.observe("point", on)
    mech.observe("load", load.load)
    assert len(motions[0]) == 6
    numeric = NumericEquations(mech, time=(0.4, 0.4))
    q, v = np.array([0.3, -0.2, 0.7]), np.array([1.0, 0.5, -2.0])
    x, y, angle, _, vy, rate = numeric.observed("point", q=q, v=v)
    expected = np.array([x, vy + 0.4, 2.0 * rate + 3.0 * angle])
    assert_allclose(numeric.observed("load", q=q, v=v), expected, rtol=1e-13)
    arm = np.array([x, y]) - q[:2]
    moment = expected[2] + arm[0] * expected[1] - arm[1] * expected[0]
    assert_allclose(numeric.force(q, v), [-expected[0], -expected[1], -moment], rtol=1e-13)


@integrators(rtol=1e-6, step=1e-3)
def test_coulomb_damped_oscillator_decays_linearly(integrator):
    """The amplitude decreases by 4 mu m g / k per period under Coulomb friction."""
    stiffness, friction, speed = 100.0, 0.8, 1e-3
    mech, block = free_ball((1.2, 0.0), name="block")
    mech.add(bd.Spring("spring", mech.ground.at(0, 0), block.point, stiffness, free_length=1.0))

    def rub(block, t):
        return (-friction * np.tanh(block.velocity[0] / speed), 0.0)

    mech.add(bd.ForceLaw("friction", block.point, rub, dissipative=True))
    period = 2.0 * np.pi / 10.0
    solution = bd.simulate(mech, integrator, t_end=3.0 * period, output_step=0.5 * period)
    assert solution.status.success, solution.status.sentence
    decrement = 2.0 * friction / stiffness * np.arange(7)
    amplitude = (solution.q[:, 0] - 1.0) * (-1.0) ** np.arange(7)
    # Regularization by tanh reduces the decrement by speed / (w A), below 3 %.
    assert_allclose(amplitude, 0.2 - decrement, rtol=0.0, atol=0.03 * decrement[1])
    assert solution.quality.energy_imbalance < 1e-4
    dissipated = 0.5 * stiffness * (0.2**2 - (0.2 - decrement[-1]) ** 2)
    assert_allclose(solution.energies["energy.dissipated [J]"].iloc[-1], dissipated, rtol=5e-3)


@pytest.mark.parametrize("native", [True, False])
def test_numpy_functions_of_symbols(native, monkeypatch):
    """Formulas have the same values in kernels as for numbers."""
    if not native:
        monkeypatch.setenv("BEAMDAE_NATIVE", "off")

    def law(p, t):
        (x, y), (u, v) = p.position, p.velocity
        fx = np.tanh(x) + np.abs(u) ** 1.5 + np.maximum(x, y) * np.minimum(u, v) + np.hypot(x, y)
        fy = np.arctan2(y, x) + np.exp(-(u**2)) * np.log1p(x**2) + np.clip(v, -0.5, 0.5)
        return (fx + np.maximum(u, 0.0) ** 2.5, fy + np.cosh(t) * np.tanh(v / 0.3))

    mech, bob = free_ball((1.0, 0.5), name="bob")
    mech.add(bd.ForceLaw("load", bob.point, law))
    numeric = NumericEquations(mech, time=(0.3, 0.3))
    for seed in range(5):
        q, v = np.random.default_rng(seed).standard_normal((2, 2))

        class At:
            position, velocity = q, v

        assert_allclose(-numeric.force(q, v), law(At, 0.3), rtol=1e-13)


def _tangent_by_components(r):
    length = np.sqrt(r[0] ** 2 + r[1] ** 2)
    return (-r[1] / length, r[0] / length)


LINE = bd.table([-10.0, 10.0], [3.0, -3.0], kind="linear")
QUARTER_TURN = np.array([[0.0, -1.0], [1.0, 0.0]])
VECTOR_LAWS = {
    "array @ vector": lambda r, v: (np.array([-r[1], r[0]]) / np.sqrt(r @ r), lambda e: e @ v),
    "vector @ array": lambda r, v: (np.array([-r[1], r[0]]) / np.sqrt(r @ r), lambda e: v @ e),
    "np.dot": lambda r, v: (np.array([-r[1], r[0]]) / np.hypot(*r), lambda e: np.dot(v, e)),
    "matrix": lambda r, v: (QUARTER_TURN @ r / np.linalg.norm(r), lambda e: np.dot(e, v)),
    "sum": lambda r, v: (np.array([-r[1], r[0]]) * (r @ r) ** -0.5, lambda e: np.sum(e * v)),
    "table": lambda r, v: (
        np.array([-r[1], r[0]]) / np.sqrt(r @ r),
        lambda e: -LINE(v @ e) * np.array([0.0, 1.0 / 0.3]) @ np.array([0.5, 1.0]),
    ),
    "smooth functions": lambda r, v: (
        np.array([-r[1], r[0]]) / np.sqrt(np.maximum(r @ r, 0.0)),
        lambda e: np.tanh((1e6 * v @ v) / 1.0) * e @ v,
    ),
}


@pytest.mark.parametrize("name", VECTOR_LAWS)
def test_regression_vectors_of_a_law_multiply_arrays(name):
    """An array divided by an expression became a matrix of CasADi, whose products failed."""

    def law(point, t):
        direction, product = VECTOR_LAWS[name](point.position, point.velocity)
        return -0.3 * product(direction) * direction

    def law_by_components(point, t):
        ex, ey = _tangent_by_components(point.position)
        speed = point.velocity[0] * ex + point.velocity[1] * ey
        return (-0.3 * speed * ex, -0.3 * speed * ey)

    forces = []
    for each in (law, law_by_components):
        mech = bd.Mechanism()
        bob = mech.add(bd.PointMass("bob", 1.0, at=(1.0, 0.0)))
        mech.add(bd.ForceLaw("drag", bob.point, each))
        forces.append(NumericEquations(mech).force([0.8, 0.4], [0.5, -1.0]))
    assert_allclose(*forces, rtol=1e-13)
