"""Properties of every element variant."""

from functools import cache

import numpy as np
import pytest
from numpy.testing import assert_allclose
from support import (
    ARC,
    MOTION_VARIANTS,
    REPRESENTATIVE_VARIANTS,
    SOFT_MATERIAL,
    VARIANTS,
    NumericEquations,
    Variant,
    directional_derivative,
    finite_differences,
    free_beam,
    parametrize_variants,
    random_state,
)

import beamdae as bd

every_variant = parametrize_variants(VARIANTS)
# The inertia has separate quadrature points and does not depend on strains.
every_motion = pytest.mark.parametrize("variant", MOTION_VARIANTS, ids=str)

RHO_A, RHO_I = SOFT_MATERIAL.rho * 0.9, SOFT_MATERIAL.rho * 0.05
EA = SOFT_MATERIAL.E * 0.9


@cache
def create_numeric(variant, elements=2, gravity=(0.0, 0.0)):
    return NumericEquations(free_beam(variant, elements=elements, gravity=gravity))


# Elastic forces ------------------------------------------------------------------------------


@every_variant
def test_full_turn_of_the_frame_causes_no_elastic_force(variant):
    numeric = create_numeric(variant)
    for turn in np.linspace(0.0, 2.0 * np.pi, 9):
        q = numeric.equations.q0.copy()
        q[:3] += (3.0 * turn, -7.0 * turn, turn)
        assert_allclose(numeric.force(q), 0.0, atol=1e-9 * EA)
        assert numeric.energies(q)[1] <= 1e-18 * EA


# Damping -------------------------------------------------------------------------------------


@parametrize_variants(v for v in VARIANTS if v.damping > 0.0)
def test_rigid_motion_is_not_damped(variant):
    numeric = create_numeric(variant)
    q, v, _ = random_state(numeric, seed=3)
    v[3:] = 0.0
    assert numeric.energies(q, v)[4] == 0.0


# Inertia -------------------------------------------------------------------------------------


@every_motion
def test_mass_matrix_is_symmetric_positive_definite_and_free_of_velocity(variant):
    numeric = create_numeric(variant)
    q, v, a = random_state(numeric, seed=4)
    mass = numeric.mass(q, v, a)
    # Rounding errors of sums of order one.
    assert_allclose(mass, mass.T, atol=1e-14)
    assert_allclose(mass, numeric.mass(q, 5.0 * v, -a), atol=1e-14)
    assert np.linalg.eigvalsh(mass)[0] > 0.0


@pytest.mark.parametrize("variant", [v for v in MOTION_VARIANTS if v.shape == "curved"], ids=str)
def test_inertia_of_rigid_motions_is_that_of_the_curve(variant):
    # The relative length error of the interpolated axis of eight elements is 9.2e-8 with 4 nodes
    # and -6.2e-7 with 3 nodes.
    mass = create_numeric(variant, elements=8).mass()
    assert_allclose(mass[0, 0], RHO_A * ARC.length, rtol=1e-7 if variant.nodes == 4 else 7e-7)
    s = np.linspace(0.0, ARC.length, 20001)
    arm = ARC.point(s) - ARC.point(0.0)
    x, y = arm.mean(axis=0)
    about_start = RHO_A * (arm**2).sum(axis=1).mean() + RHO_I
    # Means over 20 001 points have errors below 1e-4.
    assert_allclose(
        mass[:3, 2], ARC.length * np.array([-RHO_A * y, RHO_A * x, about_start]), rtol=1e-4
    )


def test_forces_are_lagranges_equation_of_the_energies():
    """F = d/dt (M v) - dT/dq + dV/dq, with the energies T and V."""
    for variant in {v._replace(damping=0.0): v for v in REPRESENTATIVE_VARIANTS}:
        numeric = create_numeric(variant, gravity=(0.7, -3.0))
        q, v, a = random_state(numeric, seed=5)
        mass = numeric.mass(q)
        momentum_rate = directional_derivative(lambda x, n=numeric, v=v: n.mass(x) @ v, q, v)
        kinetic = finite_differences(lambda x, n=numeric, v=v: n.energies(x, v)[0], q)
        potential = finite_differences(lambda x, n=numeric: n.energies(x)[[1, 2]].sum(), q)
        # Rounding errors of energies of order 100, divided by a step of 1e-3.
        expected = mass @ a + momentum_rate - kinetic + potential
        assert_allclose(numeric.force(q, v, a), expected, rtol=1e-9, atol=1e-9)
        assert_allclose(numeric.energies(q, v)[0], 0.5 * v @ mass @ v, rtol=1e-12)


def _rotation(angle):
    c, s = np.cos(angle), np.sin(angle)
    return np.array([[c, -s], [s, c]])


# Exact Jacobians -------------------------------------------------------------------------------


# Observables of a beam ---------------------------------------------------------------------------


def _cantilever(variant, curve, elements=3, displacements=False):
    """Return a beam whose section forces (and displacements) at three sections are observed."""
    mech = bd.Mechanism()
    beam = mech.add(variant.beam(curve, elements))
    for s in (0.0, 0.35, 1.0):
        at = s * curve.length
        mech.observe(f"forces {s}", beam.section_forces(at))
        if displacements:
            mech.observe(f"strain {s}", beam.strain(at, offset=0.1))
            for axes in ("inertial", "frame", "local"):
                mech.observe(f"{axes} {s}", beam.deformation(at, axes))
            mech.observe(f"at {s}", beam.at(at))
    return NumericEquations(mech)


def _set_nodes(numeric, field):
    """Return coordinates with (u, v, phi) = `field`(s) at the free nodes of the beam."""
    q = numeric.equations.q0.copy()
    beam = numeric.mechanism.part("beam")
    for i, s in enumerate(beam.mesh.node_arc_lengths):
        for name, value in zip(("u", "v", "phi"), field(s), strict=True):
            if f"beam.{name}{i}" in numeric.equations.q_names:
                q[numeric.index(f"beam.{name}{i}")] = value
    return q


tangent_variants = parametrize_variants(v for v in VARIANTS if v.frame == "tangent")


@parametrize_variants(v for v in VARIANTS if v.frame == "tangent" and v.strain == "linear")
def test_section_forces_of_a_bent_cantilever_are_exact(variant):
    """Tip loads H, P and M on a straight Timoshenko cantilever: cubic for P, quadratic for M.

    An element represents the degree nodes - 1. At its reduced points, slopes are exact for one
    degree more: with displacements exact at the nodes, 3 nodes suffice for P and 2 nodes for M.
    """
    degree = min(3, variant.nodes - (variant.quadrature == "full"))
    length, angle, H = 2.0, 0.7, 0.8
    P, M = 0.02 if degree == 3 else 0.0, 0.01 if degree >= 2 else 0.0
    line = bd.Line((0.1, 0.2), (0.1 + length * np.cos(angle), 0.2 + length * np.sin(angle)))
    numeric = _cantilever(variant, line, displacements=True)
    x = variant.section

    def field(s):
        phi = P / x.EI * (length * s - s**2 / 2) + M / x.EI * s
        v = P / x.EI * (length * s**2 / 2 - s**3 / 6) + P / x.GA * s + M / x.EI * s**2 / 2
        return H / x.EA * s, v, phi

    q = _set_nodes(numeric, field)
    for share in (0.0, 0.35, 1.0):
        s = share * length
        kappa = -(P * (length - s) + M) / x.EI
        # Rounding errors only.
        assert_allclose(numeric.observed(f"forces {share}", q=q), (H, P, x.EI * kappa), atol=1e-11)
        assert_allclose(
            numeric.observed(f"strain {share}", q=q), [H / x.EA + 0.1 * kappa], atol=1e-13
        )
        if degree >= variant.nodes and share == 0.35:
            continue  # no node at this section
        u, v, phi = field(s)
        c, sn = np.cos(angle), np.sin(angle)
        assert_allclose(numeric.observed(f"local {share}", q=q), (u, v, phi), atol=1e-13)
        assert_allclose(numeric.observed(f"frame {share}", q=q), (u, v, phi), atol=1e-13)
        inertial = (c * u - sn * v, sn * u + c * v)
        assert_allclose(numeric.observed(f"inertial {share}", q=q), (*inertial, phi), atol=1e-13)
        place = line.point(s) + inertial
        assert_allclose(numeric.observed(f"at {share}", q=q)[:3], (*place, angle + phi), atol=1e-13)


@tangent_variants
def test_uniform_stretch_and_twist_of_a_straight_beam(variant):
    """u = e s, v = g s and phi = 0: axial strain e (+ (e^2 + g^2)/2), shear strain g."""
    quadratic = variant.strain in ("nonlinear", "green")
    line, x = bd.Line((0.0, 0.0), (2.0, 0.0)), variant.section
    numeric = _cantilever(variant, line)
    e, g = 0.03, 0.02
    q = _set_nodes(numeric, lambda s: (e * s, g * s, 0.0))
    axial = e + (0.5 * (e**2 + g**2) if quadratic else 0.0)
    for share in (0.0, 0.35, 1.0):
        # Rounding errors of linear fields.
        assert_allclose(
            numeric.observed(f"forces {share}", q=q), (x.EA * axial, x.GA * g, 0.0), atol=1e-12
        )
    v = np.zeros(numeric.n)
    rate = 0.5
    v[3:] = rate * (q - numeric.equations.q0)[3:]
    stretched = rate * (e + (e**2 + g**2 if quadratic else 0.0))
    expected = (x.EA * (axial + variant.damping * stretched), x.GA * g * (1 + rate * x.damping), 0)
    assert_allclose(numeric.observed("forces 0.35", q=q, v=v), expected, atol=1e-12)


@parametrize_variants(v for v in VARIANTS if v.frame == "tangent" and v.shape == "curved")
def test_inflated_arc_has_uniform_axial_strain(variant):
    """v = w (towards the center) along an arc: only eps11 = -w/R, with Green + (w/R)^2/2."""
    numeric = _cantilever(variant, ARC, elements=6)
    w = 0.04
    q = _set_nodes(numeric, lambda s: (0.0, w, 0.0))
    axial = -w / ARC.radius
    axial += 0.5 * axial**2 if variant.strain == "green" else 0.0
    expected = (variant.section.EA * axial, 0.0, 0.0)
    # The relative curvature error of the interpolated axis is 0.1 (h/R)^2 = 4e-3.
    assert_allclose(numeric.observed("forces 1.0", q=q), expected, atol=6e-3 * abs(expected[0]))


@pytest.mark.parametrize("variant", [v for v in MOTION_VARIANTS if v.frame == "tangent"], ids=str)
def test_deformation_axes_differ_by_the_rotation_of_the_frame(variant):
    numeric = _cantilever(variant, ARC, displacements=True)
    q, _, _ = random_state(numeric, seed=11)
    for share in (0.35, 1.0):
        local, frame, inertial = (
            numeric.observed(f"{axes} {share}", q=q) for axes in ("local", "frame", "inertial")
        )
        # Rounding errors only.
        assert_allclose(_rotation(q[2]) @ frame[:2], inertial[:2], atol=1e-13)
        assert_allclose(np.linalg.norm(local[:2]), np.linalg.norm(frame[:2]), atol=1e-13)
        assert local[2] == frame[2] == inertial[2]
        # Deformation is the position minus the position on the rigid beam.
        rigid = q[:2] + _rotation(q[2] - ARC.angle) @ (ARC.point(share * 2.0) - ARC.start)
        assert_allclose(numeric.observed(f"at {share}", q=q)[:2], rigid + inertial[:2], atol=1e-13)


def test_rigid_rotation_has_no_green_strain_but_one_by_eq_5():
    """A parabola is used because the terms missing in eq. (5) cancel on an arc."""
    turn, curve = 0.3, bd.Parabola(span=2.0, rise=0.5, start=ARC.start)
    stretch = {}
    for strain in ("nonlinear", "green", "linear"):
        mech = bd.Mechanism()
        beam = mech.add(Variant(strain, "curved", "reduced", "tangent", 0.0).beam(curve, 16))
        mech.observe("axial", beam.strain(1.8, 0.0))
        numeric = NumericEquations(mech)
        s = np.linspace(0.0, curve.length, beam.mesh.node_count)[1:]
        displacement = (curve.point(s) - ARC.start) @ (_rotation(turn) - np.eye(2)).T
        angle = curve.tangent_angle(s)
        along = np.cos(angle) * displacement[:, 0] + np.sin(angle) * displacement[:, 1]
        across = -np.sin(angle) * displacement[:, 0] + np.cos(angle) * displacement[:, 1]
        q = numeric.equations.q0.copy()
        q[3:] = np.stack([along, across, 0.0 * s + turn], axis=-1).ravel()
        stretch[strain] = numeric.observed("axial", q=q)[0]
    # Interpolation error 2e-6; without quadratic terms, the strain is cos(turn) - 1.
    assert abs(stretch["green"]) < 1e-5
    assert_allclose(stretch["linear"], np.cos(turn) - 1.0, atol=1e-5)
    assert abs(stretch["nonlinear"]) > 1e-3
