"""Rayleigh damping, air drag and Kelvin-Voigt sections: forces and decays in closed form.

Closed forms of nonlinear decays follow from averaging over a period (Krylov & Bogoliubov). Lee,
Kim, Ku & Yoo, J. Sound Vib. 325 (2009) 722, compare proportional and quadratic damping.
"""

from dataclasses import replace
from functools import cache
from typing import NamedTuple

import numpy as np
import pytest
import scipy.linalg as la
from conformance import integrators
from mechanisms import clamped_beam, rectangle
from numpy.testing import assert_allclose
from support import (
    ARC,
    MOTION_VARIANTS,
    REPRESENTATIVE_VARIANTS,
    VARIANTS,
    NumericEquations,
    Variant,
    free_beam,
    parametrize_variants,
    random_state,
)

import beamdae as bd

MASS, STIFFNESS, DRAG, RETARDATION = 0.7, 0.02, 1.4, 0.03
LAWS = {
    "Rayleigh": lambda beam: bd.RayleighDamping("law", beam, MASS, STIFFNESS),
    "drag": lambda beam: bd.AirDrag("law", beam, DRAG),
    "Kelvin-Voigt": None,
}
BARE = list(dict.fromkeys(v._replace(damping=0.0) for v in VARIANTS))
# Other tests cover the element and its tangents in all variants; here, only slow tests do.
every_variant = parametrize_variants(
    BARE, slow=set(BARE) - {v._replace(damping=0.0) for v in REPRESENTATIVE_VARIANTS}
)
# Air drag depends on the motion of the axis, not on the strain measure.
every_motion = pytest.mark.parametrize(
    "variant", [v._replace(damping=0.0) for v in MOTION_VARIANTS], ids=str
)


# Forces ----------------------------------------------------------------------------------------


@cache
def free(variant, law=None, curve=ARC):
    """Return the equations of a free beam whose only damping is `law`."""
    if law == "Kelvin-Voigt":
        variant = variant._replace(damping=RETARDATION)
    mech = free_beam(variant, curve)
    if LAWS.get(law):
        mech.add(LAWS[law](mech.part("beam")))
    return NumericEquations(mech)


def rotate(angle, x, y):
    return np.cos(angle) * x - np.sin(angle) * y, np.sin(angle) * x + np.cos(angle) * y


@pytest.mark.slow(reason="a fifth of a second")
@every_variant
def test_rayleigh_forces_are_mass_times_velocities_and_kelvin_voigt_forces(variant):
    damped, viscous, bare = (free(variant, law) for law in ("Rayleigh", "Kelvin-Voigt", None))
    for seed in range(3):
        q, v, a = random_state(damped, seed)
        of_section = viscous.force(q, v, a) - bare.force(q, v, a)
        expected = MASS * bare.mass(q) @ v + STIFFNESS / RETARDATION * of_section
        # Both sides use the inertia points; rounding errors of forces of order 100.
        assert_allclose(damped.force(q, v, a) - bare.force(q, v, a), expected, atol=1e-12)


@every_motion
def test_drag_of_a_straight_strip_in_rigid_motion(variant):
    length, angle, w, omega = 2.0, 0.4, -3.0, -1.7
    line = bd.Line((0.3, -0.2), (0.3 + length * np.cos(angle), -0.2 + length * np.sin(angle)))
    damped, bare = free(variant, "drag", line), free(variant, None, line)

    def drag(v):
        v = np.concatenate([v, np.zeros(damped.n - 3)])
        return -(damped.force(v=v) - bare.force(v=v))[:3], damped.energies(v=v)[4]

    normal, along = np.array(rotate(angle, 0.0, 1.0)), np.array(rotate(angle, 1.0, 0.0))
    total = -DRAG * abs(w) * w * length
    # Two points integrate polynomials of degree three exactly.
    force, power = drag([*(w * normal), 0.0])
    assert_allclose(force, [*(total * normal), total * length / 2.0], rtol=1e-12)
    assert_allclose(power, -total * w, rtol=1e-12)
    force, power = drag([*(w * along), 0.0])
    assert_allclose([*force, power], 0.0, atol=1e-13)
    force, power = drag([0.0, 0.0, omega])
    moment = -DRAG * abs(omega) * omega * length**4 / 4.0
    assert_allclose(force[2], moment, rtol=1e-12)
    assert_allclose(force[:2], moment * 4.0 / (3.0 * length) * normal, rtol=1e-12)
    assert_allclose(power, -moment * omega, rtol=1e-12)


def test_each_beam_has_its_own_coefficients():
    alike = {name: VARIANTS[0].beam(ARC, name=name) for name in ("one", "two")}

    def resisted_beams(*names):
        mech = bd.Mechanism()
        for name in names:
            beam, share = mech.add(alike[name]), {"one": 1.0, "two": 3.0}[name]
            mech.add(bd.RayleighDamping(f"Rayleigh {name}", beam, share * MASS, share * STIFFNESS))
            mech.add(bd.AirDrag(f"air {name}", beam, share * DRAG))
        return NumericEquations(mech)

    alone = [resisted_beams(name) for name in alike]
    states = [random_state(numeric, seed) for seed, numeric in enumerate(alone)]
    expected = [numeric.force(*state) for numeric, state in zip(alone, states, strict=True)]
    together = resisted_beams(*alike).force(*np.concatenate(states, axis=1))
    assert_allclose(together, np.concatenate(expected), rtol=1e-13)  # rounding errors


# Free flight -----------------------------------------------------------------------------------

LENGTH = 2.0
STRIP_RADIUS = LENGTH / 200.0  # of gyration
STRIP = bd.Section(
    bd.Material(E=60.0, nu=0.3, rho=1.3), area=0.9, second_moment=0.9 * STRIP_RADIUS**2
)


def test_a_falling_strip_reaches_its_terminal_velocity():
    gravity, drag = 9.81, 1.5
    mech = bd.Mechanism(gravity=(0.0, -gravity))
    beam = mech.add(bd.Beam("strip", bd.Line((0.0, 0.0), (LENGTH, 0.0)), STRIP, elements=2))
    mech.add(bd.AirDrag("air", beam, coefficient=drag))
    solution = bd.simulate(mech, bd.Ida(rtol=1e-6), t_end=2.0, output_step=0.05)
    assert solution.status.success, solution.status.sentence
    terminal = np.sqrt(STRIP.rhoA * gravity / drag)
    # rtol = 1e-6 of speeds of order one.
    exact = -terminal * np.tanh(gravity * solution.t / terminal)
    assert_allclose(solution.v[:, 1], exact, rtol=0.0, atol=1e-5)
    assert_allclose(solution.v[-1, 1], -terminal, rtol=1e-3)  # 1 - tanh(7.1) = 1e-6


@pytest.mark.slow(reason="half a second and more")
@pytest.mark.parametrize("frame", ["tangent", "chord"])
def test_momenta_of_a_free_arc_decay_with_the_mass_coefficient(frame):
    """Internal damping has no resultant; the mass term is -MASS times each momentum."""
    variant = Variant("nonlinear", "curved", "reduced", frame, RETARDATION)
    mech = free_beam(variant)
    mech.add(bd.RayleighDamping("law", mech.part("beam"), MASS, STIFFNESS))
    numeric = NumericEquations(mech)
    _, v, _ = random_state(numeric, seed=12)
    solution = bd.simulate(
        replace(numeric.equations, v0=v), bd.Ida(rtol=1e-6), t_end=2.0, output_step=0.1
    )
    assert solution.status.success, solution.status.sentence
    momenta = []
    for q, v in zip(solution.q, solution.v, strict=True):
        x, y, spin = (numeric.mass(q) @ v)[:3]
        momenta.append([x, y, spin + q[0] * y - q[1] * x])
    # Momenta are of order one; the measured error is 3.5e-7.
    expected = np.outer(np.exp(-MASS * solution.t), momenta[0])
    assert_allclose(momenta, expected, rtol=0.0, atol=2e-6)
    # The arc deforms: a twentieth of the energy is exchanged with strains.
    assert solution.energies["energy.strain [J]"].max() > 0.05 * solution.energies.iloc[0, 0]


# Decay of a cantilever -------------------------------------------------------------------------


class Modes(NamedTuple):
    """Natural frequencies [rad/s], mode shapes (columns, v = 1 at the tip) and dual vectors."""

    frequency: np.ndarray
    shapes: np.ndarray
    project: np.ndarray


def cantilever(strain="linear", parts=(), retardation=0.0):
    """Return a straight strip clamped at its start; its floating frame is at rest."""
    section = replace(STRIP, damping=retardation)
    mech, beam = clamped_beam(section, 2, LENGTH, strain=strain, frame="tangent")
    for part, words in parts:
        mech.add(part(part.__name__, beam, **words))
    return NumericEquations(mech)


@cache
def modes():
    numeric = cantilever()
    mass, stiffness = numeric.mass()[3:, 3:], numeric.stiffness()[3:, 3:]
    squares, shapes = la.eigh(stiffness, mass)
    tip = shapes[numeric.index("beam.v6") - 3]
    shapes = np.vstack([np.zeros((3, len(tip))), shapes / tip])
    project = np.hstack([np.zeros((len(tip), 3)), np.linalg.inv(shapes[3:])])
    return Modes(np.sqrt(squares), shapes, project)


def simulate_release(start, periods, steps, **model):
    """Return times, modal coordinates and their rates (one row per time) of a release.

    `steps` is the number per period of the first mode; numerical damping is of third order in the
    step.
    """
    basis = modes()
    equations = cantilever(**model).equations
    amplitude = np.zeros(len(basis.frequency))
    amplitude[: len(start)] = start
    period = 2.0 * np.pi / basis.frequency[0]
    solution = bd.simulate(
        replace(equations, q0=equations.q0 + basis.shapes @ amplitude),
        bd.GeneralizedAlpha(step=period / steps, rho_inf=0.9),
        t_end=periods * period,
        output_step=period / 20.0,
    )
    assert solution.status.success, solution.status.sentence
    eta = (solution.q - equations.q0) @ basis.project.T
    return solution.t, eta, solution.v @ basis.project.T


@pytest.mark.parametrize("formulation", ["floating frame", "exact"])
def test_ratios_of_modes_are_those_of_their_frequencies(formulation):
    """(mass / w + stiffness w) / 2 by Rayleigh damping, and retardation w / 2 by the section."""
    line, mass, stiffness = bd.Line((0.0, 0.0), (LENGTH, 0.0)), 0.02, 0.01

    def eigenvalues(retardation=0.0, **coefficients):
        section = replace(STRIP, damping=retardation)
        mech, beam = clamped_beam(section, 2, line, formulation=formulation)
        mech.add(bd.RayleighDamping("Rayleigh", beam, **coefficients))
        return bd.modes(mech, n=3).eigenvalues

    frequency = np.abs(eigenvalues())
    for found, expected in (
        (eigenvalues(mass=mass), mass / frequency),
        (eigenvalues(stiffness=stiffness), stiffness * frequency),
        (eigenvalues(retardation=stiffness), stiffness * frequency),
    ):
        assert_allclose(np.abs(found), frequency, rtol=1e-8)
        assert_allclose(-found.real / np.abs(found), 0.5 * expected, rtol=1e-6)


def envelope(eta, rate, frequency, ratio):
    """Return the amplitude of a damped oscillation, exp(-ratio frequency t)."""
    damped = frequency * np.sqrt(1.0 - ratio**2)
    return np.hypot(eta, (rate + ratio * frequency * eta) / damped)


RATIO = 0.02
SMALL = 0.01 * STRIP_RADIUS


@cache
def release_with_internal_damping(law, start, strain):
    """Return time, first modal coordinate and envelope of eight periods at the ratio RATIO."""
    frequency = modes().frequency[0]
    coefficient = 2.0 * RATIO / frequency
    model = (
        {"parts": [(bd.RayleighDamping, {"stiffness": coefficient})]}
        if law == "Rayleigh"
        else {"retardation": coefficient}
    )
    t, eta, rate = simulate_release([start], periods=8, steps=200, strain=strain, **model)
    return t, eta[:, 0], envelope(eta[:, 0], rate[:, 0], frequency, RATIO)


@pytest.mark.slow(reason="half a second and more")
@pytest.mark.parametrize("start", [SMALL, STRIP_RADIUS])
def test_regression_both_internal_dampings_agree_at_all_amplitudes(start):
    """Rayleigh damping took the shortening of a bent beam as an axial strain.

    It damped amplitudes of the radius of gyration by 5 % too much, and axial forces in driven beams
    were 100 times too large.
    """
    laws = ("Rayleigh", "Kelvin-Voigt")
    one, other = (release_with_internal_damping(law, start, "nonlinear") for law in laws)
    assert_allclose(one[1], other[1], rtol=0.0, atol=1e-10 * start)
    assert_allclose(one[2], start * np.exp(-RATIO * modes().frequency[0] * one[0]), rtol=1e-3)


# First mode of an Euler-Bernoulli cantilever: root of its frequency equation, and Gauss points.
ROOT = 1.875104068711961
POINTS, WEIGHTS = np.polynomial.legendre.leggauss(20)


def first_mode():
    """Return the first mode at the Gauss points."""
    x = 0.5 * ROOT * (POINTS + 1.0)
    share = (np.cosh(ROOT) + np.cos(ROOT)) / (np.sinh(ROOT) + np.sin(ROOT))
    return 0.5 * (np.cosh(x) - np.cos(x) - share * (np.sinh(x) - np.sin(x)))


def mean(values):
    return 0.5 * WEIGHTS @ values


@pytest.mark.parametrize("start", [0.01, 0.02, 0.04])
def test_drag_decrement_of_a_cantilever_is_proportional_to_its_amplitude(start):
    """A(t) = A0 / (1 + 4 c_eff w A0 t / (3 pi)): 1 / A increases by 8 c_eff / 3 per period.

    Averaging |v| v over a period gives c_eff = c int |phi|^3 ds / (rhoA int phi^2 ds) for the mode
    phi.
    """
    drag = 1.1
    frequency = ROOT**2 * np.sqrt(STRIP.EI / STRIP.rhoA) / LENGTH**2
    effective = drag * mean(np.abs(first_mode()) ** 3) / mean(first_mode() ** 2) / STRIP.rhoA
    parts = [(bd.AirDrag, {"coefficient": drag})]
    t, eta, rate = simulate_release([start], periods=10, steps=200, parts=parts)
    # At the maxima, where velocity and drag vanish. Shear and rotary inertia reduce the true
    # frequency by 2.4e-4.
    amplitude = np.hypot(eta[:, 0], rate[:, 0] / modes().frequency[0])[::20]
    expected = start / (1.0 + 4.0 * effective * frequency * start * t[::20] / (3.0 * np.pi))
    # The step causes an error of 2.5e-4 of the decrement, averaging an error of (c_eff A)^2 < 8e-4.
    # Measured 3.3e-4 and 2.3e-4.
    assert_allclose(np.diff(1.0 / amplitude), 8.0 * effective / 3.0, rtol=5e-4)
    assert_allclose(amplitude, expected, rtol=3e-4)
    assert amplitude[-1] < 0.9 * start


# Energy balance -------------------------------------------------------------------------------

GRAVITY = 9.81


# Standard linear solid: creep, relaxation, complex modulus and section forces in closed form.

SPAN, SHARE, TIME, RAMP, PLACE = 0.3, 0.6, 0.5, 0.1, 0.12
# Light, so that ramps excite vibrations of 1e-4 of the deflection only.
LEAF = rectangle(0.004, material=bd.Material(E=2e9, nu=0.4, rho=1.1))
# Damping of vibrations, which changes slow motions by 1e-4.
DAMPED = replace(LEAF, damping=2e-5)
COMPLIANCE = SPAN**3 / (3.0 * LEAF.EI) + SPAN / LEAF.GA


def solid_leaf(parts=((SHARE, TIME),), section=LEAF, **settings):
    mech, beam = clamped_beam(section, curve=SPAN, **{"elements": 2} | settings)
    for k, (ratio, time) in enumerate(parts):
        solid = mech.add(bd.StandardLinearSolid(f"solid {k}", beam, ratio, time))
        mech.observe(f"share {k}", solid.section_forces(PLACE))
    mech.observe("elastic", beam.section_forces(PLACE))
    mech.observe("tip", beam.end)
    return mech


def ramp(value):
    """Return a law that increases smoothly from 0 to a value in the time RAMP."""
    return bd.piecewise((RAMP, lambda t: 0.5 * value * (1.0 - np.cos(np.pi * t / RAMP))), value)


def decay(t, time):
    """Return exp(-(t - s) / time), averaged over the steps at the times s of a `ramp`."""
    rate = np.pi / RAMP
    average = 0.5 * rate**2 * (1.0 + np.exp(RAMP / time)) / (time**-2 + rate**2)
    return average * np.exp(-t / time)


METHODS = integrators(rtol=1e-5, step=5e-4)


@METHODS
def test_creep_under_a_constant_load(integrator):
    load, mech = -0.02, solid_leaf(section=DAMPED)
    mech.add(bd.Force("load", mech.part("beam").end, (0.0, ramp(load))))
    run = bd.simulate(mech, integrator, t_end=2.0, output_step=0.1)
    late = run.t > 2.0 * RAMP
    t = run.t[late]
    share = SHARE / (1.0 + SHARE) * decay(t, (1.0 + SHARE) * TIME)
    assert_allclose(run["tip.y"][late], load * COMPLIANCE * (1.0 - share), rtol=5e-4)
    # Elastic forces and those of the solid are in equilibrium with the load.
    moment = load * (PLACE - SPAN)
    elastic, total = run["elastic.M"][late], run["elastic.M"][late] + run["share 0.M"][late]
    assert_allclose(total, moment, rtol=5e-4)
    assert_allclose(elastic, moment * (1.0 - share), rtol=5e-4)
    forces = run.section_forces("beam", t[-1])
    assert np.max(forces.error[2]) < 1e-3 * np.max(np.abs(forces.M))
    assert_allclose(
        bd.equilibrium(mech, t=9.0).columns["tip.y [m]"][-1], load * COMPLIANCE, rtol=1e-5
    )


@METHODS
def test_relaxation_at_a_constant_deflection(integrator):
    deflection, mech = 1e-3, solid_leaf(section=DAMPED)
    beam = mech.part("beam")
    ends = mech.ground.at(SPAN, 0.0), beam.end
    drive = mech.add(bd.TranslationalDriver("drive", *ends, ramp(deflection), (0.0, 1.0)))
    mech.observe("drive", drive.reaction)
    run = bd.simulate(mech, integrator, t_end=2.0, output_step=0.1)
    late = run.t > 2.0 * RAMP
    expected = deflection / COMPLIANCE * (1.0 + SHARE * decay(run.t[late], TIME))
    assert_allclose(np.abs(run["drive.F"][late]), expected, rtol=1e-3)


@pytest.mark.parametrize("parts", [((SHARE, 1e-3),), ((0.4, 1e-3), (0.7, 1e-2))], ids=len)
@pytest.mark.parametrize("formulation", ["floating frame", "exact"])
def test_modes_have_the_complex_modulus(parts, formulation):
    """l^2 + w^2 E(l) / E = 0 with E(l) / E = 1 + sum of ratio l time / (1 + l time)."""
    undamped = bd.modes(solid_leaf((), formulation=formulation), n=3, damping=False)
    damped = bd.linearize(solid_leaf(parts, formulation=formulation)).poles
    for frequency in undamped.frequencies:
        denominator = np.poly1d([1.0])
        for _, time in parts:
            denominator *= np.poly1d([time, 1.0])
        modulus = denominator
        for ratio, time in parts:
            modulus += ratio * np.poly1d([time, 0.0]) * (denominator / np.poly1d([time, 1.0]))[0]
        roots = (
            np.poly1d([1.0, 0.0, 0.0]) * denominator + (2.0 * np.pi * frequency) ** 2 * modulus
        ).roots
        for root in roots:
            assert np.min(np.abs(damped - root)) < 1e-6 * abs(root)


def test_loss_factor_of_a_forced_vibration():
    """Far below the natural frequency, the deflection over the force is the complex compliance."""
    time = 0.1
    mech = solid_leaf(((SHARE, time),))
    push = mech.input("push", unit="N")
    mech.add(bd.Force("load", mech.part("beam").end, (0.0, push)))
    peak = 1.0 / (time * np.sqrt(1.0 + SHARE))
    model = bd.linearize(mech, inputs=["push"], outputs=["tip.y"])
    (response,) = model.frequency_response(np.array([peak / (2.0 * np.pi)])).ravel()
    loss = -response.imag / response.real
    assert_allclose(loss, SHARE / (2.0 * np.sqrt(1.0 + SHARE)), rtol=1e-4)


@pytest.mark.parametrize("formulation", ["floating frame", "exact"])
def test_a_prestressed_beam_starts_relaxed(formulation):
    arc = bd.Arc(radius=1.0, length=SPAN)
    settings = {"free_curve": arc, "formulation": formulation}
    with_solid, without = (NumericEquations(solid_leaf(x, **settings)) for x in (((1.0, 1.0),), ()))
    n = without.n
    assert np.max(np.abs(without.force())) > 0.1
    assert_allclose(with_solid.force()[:n], without.force(), atol=1e-9)
    assert_allclose(with_solid.force()[n:], 0.0, atol=1e-9)
