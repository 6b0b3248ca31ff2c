"""Properties of every element variant."""

from __future__ import annotations

from functools import cache

import casadi as ca
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
    assert_derivative,
    finite_differences,
    free_beam,
    parametrize_variants,
    random_state,
)

import beamdae as bd
from beamdae.beams.floating_frame.element import FloatingFrameElement, floating_frame_kernel
from beamdae.beams.floating_frame.kinematics import FloatingFrame
from beamdae.beams.mesh import Mesh
from beamdae.beams.shape_functions import shape_functions
from beamdae.equations.formulations.first_order import FIRST_ORDER, formulate_first_order
from beamdae.equations.formulations.step_equations import StepPrediction, formulate_step
from beamdae.equations.starts.consistent_start import ConsistencySolver

every_variant = parametrize_variants(VARIANTS)
few_variants = pytest.mark.parametrize("variant", REPRESENTATIVE_VARIANTS, ids=str)
# The inertia has separate quadrature points and does not depend on strains.
every_motion = pytest.mark.parametrize("variant", MOTION_VARIANTS, ids=str)
# Numbers of nodes and Gauss points: reduced and full quadrature of each element.
POINTS = [(2, 1), (2, 2), (3, 2), (3, 3), (4, 3), (4, 4)]
KINDS = [
    FloatingFrameElement(nodes, quadrature, strain, damped)
    for nodes, quadrature in POINTS
    for strain in ("nonlinear", "green", "linear", "exact")
    for damped in (False, True)
]


def kind_name(kind):
    damped = "damped" if kind.damped else "undamped"
    return f"{kind.nodes}-{kind.quadrature}-{kind.strain}-{damped}"


every_kind = pytest.mark.parametrize("kind", KINDS, ids=kind_name)
every_shape = pytest.mark.parametrize("shape", ["curved", "straight"])

RHO_A, RHO_I = SOFT_MATERIAL.rho * 0.9, SOFT_MATERIAL.rho * 0.05
EA = SOFT_MATERIAL.E * 0.9


@cache
def create_numeric(variant, elements=2, gravity=(0.0, 0.0)):
    return NumericEquations(free_beam(variant, elements=elements, gravity=gravity))


def element_data(kind, elements, shape, section, gravity):
    """Return element data on ARC in a tangent frame, with the section values `section`."""
    quadrature = "full" if kind.quadrature == kind.nodes else "reduced"
    mesh = Mesh(ARC, elements, kind.nodes, shape)
    any_section = bd.Section(SOFT_MATERIAL, area=0.9, second_moment=0.05)
    frame = FloatingFrame("beam", mesh, any_section, quadrature=quadrature, frame="tangent")
    data = frame.data(gravity)
    data[-8:-2] = np.reshape(section, (6, 1))
    return data


def independent_quadrature(curve, elements, shape, nodes):
    """Return points, tangents and weights [m] of the axis, independently of the mesh."""
    xi, weight = np.polynomial.legendre.leggauss(nodes)
    at, step = np.linspace(-1.0, 1.0, nodes), nodes - 1
    node_points = curve.point(np.linspace(0.0, curve.length, step * elements + 1))
    places, tangents, weights = [], [], []
    for e in range(elements):
        element_points = node_points[step * e : step * e + nodes]
        if shape == "straight":
            chord = element_points[-1] - element_points[0]
            element_points = element_points[0] + np.outer((at + 1.0) / 2.0, chord)
        x, y = (np.polynomial.Polynomial.fit(at, c, step, domain=[-1, 1]) for c in element_points.T)
        slope = np.stack([x.deriv()(xi), y.deriv()(xi)], axis=-1)
        speed = np.linalg.norm(slope, axis=-1, keepdims=True)
        places.append(np.stack([x(xi), y(xi)], axis=-1))
        tangents.append(slope / speed)
        weights.append(weight * speed[:, 0])
    return np.concatenate(places), np.concatenate(tangents), np.concatenate(weights)


# Elastic forces ------------------------------------------------------------------------------


@every_variant
def test_reference_drawing_is_in_equilibrium(variant):
    # Rounding errors only.
    assert_allclose(create_numeric(variant).force(), 0.0, atol=1e-14 * EA)


@every_variant
def test_full_turn_of_the_frame_causes_no_elastic_force(variant):
    numeric = create_numeric(variant)
    for turn in np.linspace(0.0, 2.0 * np.pi, 9):
        q = numeric.equations.q0.copy()
        q[:3] += (3.0 * turn, -7.0 * turn, turn)
        assert_allclose(numeric.force(q), 0.0, atol=1e-9 * EA)
        assert numeric.energies(q)[1] <= 1e-18 * EA


@every_variant
def test_steady_rotation_about_the_origin_gives_centrifugal_forces(variant):
    # At zero deformation, elastic and viscous forces vanish; the sum of the inertial forces is the
    # mass times the acceleration of the center of mass.
    numeric = create_numeric(variant)
    place, _, weight = independent_quadrature(ARC, 2, variant.shape, variant.nodes)
    omega = 1.7
    q, v = numeric.equations.q0, np.zeros(numeric.n)
    v[:3] = omega * np.array([-q[1], q[0], 1.0])
    a = np.zeros(numeric.n)
    a[:2] = -(omega**2) * q[:2]
    expected = -(omega**2) * RHO_A * weight @ place
    # Rounding errors: both sides use the same quadrature.
    assert_allclose(numeric.force(q, v, a)[:2], expected, rtol=1e-12)


@every_variant
def test_static_forces_are_the_gradient_of_strain_and_gravity_energy(variant):
    numeric = create_numeric(variant, gravity=(0.7, -3.0))
    q, _, _ = random_state(numeric, seed=1)
    gradient = finite_differences(lambda x: numeric.energies(x)[1] + numeric.energies(x)[2], q)
    # Rounding errors of energies of order 100, divided by a step of 1e-3.
    assert_allclose(numeric.force(q), gradient, atol=1e-9)


@cache
def energies_of(kind):
    """Return the function of (time, q, v, data) for the three energies of one element."""
    kernel = floating_frame_kernel(kind)
    x = kernel.local
    return ca.Function("energies", [x.time, x.q, x.v, x.data], [ca.densify(kernel.energies)])


@pytest.mark.parametrize(("nodes", "quadrature"), POINTS)
@every_shape
def test_translation_in_nodal_coordinates_is_strainless_in_the_limit(shape, nodes, quadrature):
    """Polynomials (u, v) represent rigid translations exactly only on straight elements."""
    kind = FloatingFrameElement(nodes, quadrature, strain="linear")
    energies = []
    for elements in (1, 2, 4):
        mesh = Mesh(ARC, elements, nodes, shape).in_axes(ARC.start, ARC.angle)
        data = element_data(kind, elements, shape, [60.0, 20.0, 3.0, 1.0, 0.1, 0.0], np.zeros(2))
        total = 0.0
        for e in range(elements):
            alpha = mesh.axis(np.full(nodes, e), np.linspace(-1.0, 1.0, nodes)).angle
            nodal = np.stack([np.cos(alpha), -np.sin(alpha), 0.0 * alpha], axis=-1).ravel()
            q = np.concatenate([np.zeros(3), nodal])
            total += float(energies_of(kind)([0, 0], q, 0.0 * q, data[:, e])[1])
        energies.append(total)
    if shape == "straight" or nodes == 2:
        assert max(energies) < 1e-24  # stiffness times squares of rounded slopes
    else:
        # The order of the strain is nodes - 1, that of the energy twice as high: 5.6 and 5.9 with
        # 4 nodes, 3.6 and 3.9 with 3. At 2 points, slopes of quadratics are better by one order:
        # 6.3 and 6.2.
        orders = np.log2(np.divide(energies[:-1], energies[1:]))
        expected = 4.0 if (nodes, quadrature) == (3, 3) else 6.0
        assert_allclose(orders, expected, atol=0.4)


# Damping -------------------------------------------------------------------------------------


@parametrize_variants(v for v in VARIANTS if v.damping > 0.0)
def test_dissipated_power_matches_the_damping_forces_and_is_never_negative(variant):
    damped = create_numeric(variant)
    undamped = create_numeric(variant._replace(damping=0.0))
    for seed in range(5):
        q, v, a = random_state(damped, seed)
        dissipated = damped.energies(q, v)[4]
        assert dissipated > 0.0
        # Rounding errors of differences of forces of order 100.
        power = v @ (damped.force(q, v, a) - undamped.force(q, v, a))
        assert_allclose(dissipated, power, rtol=1e-11)


@parametrize_variants(v for v in VARIANTS if v.damping == 0.0)
def test_without_damping_nothing_is_dissipated(variant):
    numeric = create_numeric(variant)
    q, v, _ = random_state(numeric, seed=0)
    assert numeric.energies(q, v)[4] == 0.0


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


@every_motion
def test_total_mass_and_first_moments(variant):
    numeric = create_numeric(variant, elements=4)
    mass = numeric.mass()
    place, _, weight = independent_quadrature(ARC, 4, variant.shape, variant.nodes)
    center = RHO_A * weight @ (place - ARC.point(0.0))
    # Rounding errors: both sides use the same quadrature.
    assert_allclose(mass[:2, :2], RHO_A * weight.sum() * np.eye(2), rtol=1e-13, atol=1e-14)
    assert_allclose(mass[:2, 2], (-center[1], center[0]), rtol=1e-12)
    about_start = RHO_A * weight @ ((place - ARC.point(0.0)) ** 2).sum(axis=1)
    assert_allclose(mass[2, 2], about_start + RHO_I * weight.sum(), rtol=1e-12)


@pytest.mark.parametrize("variant", [v for v in MOTION_VARIANTS if v.shape == "curved"], ids=str)
def test_total_mass_is_that_of_the_curve(variant):
    # The relative length error of the interpolated axis of eight elements is 9.2e-8 with 4 nodes
    # and -6.2e-7 with 3 nodes.
    mass = create_numeric(variant, elements=8).mass()
    assert_allclose(mass[0, 0], RHO_A * ARC.length, rtol=1e-7 if variant.nodes == 4 else 7e-7)
    s = np.linspace(0.0, ARC.length, 20001)
    arm = (ARC.point(s) - ARC.point(0.0)).mean(axis=0)
    # The mean over 20 001 points has an error below 1e-4.
    assert_allclose(mass[:2, 2], RHO_A * ARC.length * np.array([-arm[1], arm[0]]), rtol=1e-4)


@every_kind
@every_shape
def test_kernel_is_lagranges_equation_of_its_energies(kind, shape):
    """F = d/dt dT/dv - dT/dq + dV/dq + 1/2 dP/dv with the dissipated power P, quadratic in v."""
    kernel = floating_frame_kernel(kind)
    x = kernel.local
    kinetic, potential = kernel.energies[0], kernel.energies[1] + kernel.energies[2]
    momentum = ca.gradient(kinetic, x.v)
    expected = (
        ca.jtimes(momentum, x.q, x.v)
        + ca.jtimes(momentum, x.v, x.a)
        - ca.gradient(kinetic - potential, x.q)
        + 0.5 * ca.gradient(kernel.powers[1], x.v)
    )
    inputs = [x.time, x.q, x.v, x.a, x.data]
    both = ca.Function("both", inputs, [kernel.force, expected])
    data = element_data(kind, 2, shape, [54.0, 17.0, 3.0, 1.2, 0.1, 0.03], np.array([0.3, -2.0]))
    rng = np.random.default_rng(5)
    for e in range(2):
        q, v, a = rng.standard_normal((3, kind.size))
        force, exact = (np.array(z).ravel() for z in both([0, 0], q, v, a, data[:, e]))
        # Rounding errors: both sides sum the same terms in different order.
        assert_allclose(force, exact, atol=1e-12 * np.abs(exact).max())


@every_kind
@every_shape
def test_kinetic_energy_is_that_of_the_moving_material_points(kind, shape):
    """Velocities are finite differences of the positions r = r0 + A (s0 + A_alpha u)."""
    rhoA, rhoI = 1.2, 0.1
    data = element_data(kind, 1, shape, [54.0, 17.0, 3.0, rhoA, rhoI, 0.0], np.zeros(2))
    place, tangent, weight = independent_quadrature(ARC, 1, shape, kind.nodes)
    to_frame = _rotation(-ARC.angle)
    place, tangent = (place - ARC.start) @ to_frame.T, tangent @ to_frame.T
    rng = np.random.default_rng(6)
    q, v = rng.standard_normal((2, kind.size))
    xi, _ = np.polynomial.legendre.leggauss(kind.nodes)
    row = _lagrange(xi, kind.nodes)

    def points(q):
        nodal = row @ q[3:].reshape(kind.nodes, 3)
        turns = [_rotation(np.arctan2(t[1], t[0])) for t in tangent]
        rotated = np.array([s + A @ u[:2] for s, A, u in zip(place, turns, nodal, strict=True)])
        return q[:2] + rotated @ _rotation(q[2]).T, q[2] + nodal[:, 2]

    h = 1e-5
    (r1, w1), (r0, w0) = points(q + h * v), points(q - h * v)
    speed2 = (((r1 - r0) / (2 * h)) ** 2).sum(axis=1)
    spin2 = ((w1 - w0) / (2 * h)) ** 2
    expected = 0.5 * weight @ (rhoA * speed2 + rhoI * spin2)
    kinetic = energies_of(kind)([0, 0], q, v, data[:, 0])[0]
    assert_allclose(float(kinetic), expected, rtol=1e-8)  # step^2 times order one


def _rotation(angle):
    c, s = np.cos(angle), np.sin(angle)
    return np.array([[c, -s], [s, c]])


def _lagrange(xi, nodes):
    """Return Lagrange functions from a Vandermonde matrix, shape (len(xi), nodes)."""
    at = np.linspace(-1.0, 1.0, nodes)
    return np.vander(xi, nodes) @ np.linalg.inv(np.vander(at, nodes))


@pytest.mark.parametrize("nodes", [2, 3, 4])
def test_shape_functions_interpolate_polynomials_and_their_slopes(nodes):
    xi = np.array([-0.9, -0.2, 0.4, 1.0])
    nodes_xi = np.linspace(-1.0, 1.0, nodes)
    polynomial = np.poly1d([0.7, -1.1, 0.4, 2.0][-nodes:])
    for k in range(nodes):
        # Polynomials of degree nodes - 1 are reproduced to rounding.
        interpolated = shape_functions(nodes, xi, k) @ polynomial(nodes_xi)
        assert_allclose(interpolated, np.polyder(polynomial, k)(xi), atol=1e-12)


# The published matrices ------------------------------------------------------------------------


def published_inertia(place, tangent, weight, rhoA, q, v, a):
    """Return M, Q and M q'' of the appendix of Pan & Liu 2012 for I = 0."""
    quarter = np.array([[0.0, -1.0], [1.0, 0.0]])
    A = _rotation(q[2])
    p, dp, omega = q[3:], v[3:], v[2]
    m_rr, m_rt, m_rp = np.zeros((2, 2)), np.zeros(2), np.zeros((2, len(p)))
    m_tt, m_tp, m_pp = 0.0, np.zeros(len(p)), np.zeros((len(p), len(p)))
    q_r, q_t, q_p = np.zeros(2), 0.0, np.zeros(len(p))
    rows = _lagrange(np.polynomial.legendre.leggauss(len(weight))[0], len(p) // 3)
    for s0, t, w, row in zip(place, tangent, weight, rows, strict=True):
        A_alpha = np.array([[t[0], -t[1]], [t[1], t[0]]])
        N = np.kron(row, np.eye(2, 3))
        s = s0 + A_alpha @ N @ p
        rho = rhoA * w
        m_rr += rho * np.eye(2)
        m_rt += rho * quarter @ A @ s
        m_rp += rho * A @ A_alpha @ N
        m_tt += rho * s @ s
        m_tp += rho * s @ quarter.T @ A_alpha @ N
        m_pp += rho * N.T @ N
        q_r += rho * (-(omega**2) * A @ s + 2 * omega * quarter @ A @ A_alpha @ N @ dp)
        q_t += rho * 2 * omega * s @ A_alpha @ N @ dp
        q_p += rho * N.T @ (-(omega**2) * A_alpha.T @ s + 2 * omega * quarter @ N @ dp)
    matrix = np.block(
        [
            [m_rr, m_rt[:, None], m_rp],
            [m_rt[None, :], np.array([[m_tt]]), m_tp[None, :]],
            [m_rp.T, m_tp[:, None], m_pp],
        ]
    )
    return matrix, np.concatenate([q_r, [q_t], q_p]), matrix @ a


# The inertia does not depend on strains and damping; slow tests check this.
@pytest.mark.parametrize(
    "kind",
    [
        pytest.param(
            kind,
            marks=[] if kind.strain == "green" and not kind.damped else [pytest.mark.slow],
        )
        for kind in KINDS
    ],
    ids=kind_name,
)
@every_shape
def test_inertia_without_rotary_part_equals_the_published_matrices(kind, shape):
    """The matrices are from Pan & Liu, Theor. Appl. Mech. Lett. 2 (2012) 063006, appendix."""
    rhoA = 1.2
    data = element_data(kind, 1, shape, [0.0, 0.0, 0.0, rhoA, 0.0, 0.0], np.zeros(2))[:, 0]
    place, tangent, weight = independent_quadrature(ARC, 1, shape, kind.nodes)
    to_frame = _rotation(-ARC.angle)
    place, tangent = (place - ARC.start) @ to_frame.T, tangent @ to_frame.T
    rng = np.random.default_rng(7)
    for _ in range(3):
        q, v, a = rng.standard_normal((3, kind.size))
        matrix, quadratic, inertia = published_inertia(place, tangent, weight, rhoA, q, v, a)
        kernel = floating_frame_kernel(kind)
        local = np.concatenate([q, v, a, data])
        force = np.array(kernel.force_kernel.function([0, 0], local)).ravel()
        expected = inertia + quadratic
        # Rounding errors: both sides evaluate the same sum.
        assert_allclose(force, expected, atol=1e-10 * np.abs(expected).max())
        # With c_a = 1 and all other factors zero, only dF/da remains.
        tangents = kernel.tangent_kernel(((0,), (1,), (2,)))
        entries = tangents.function([0, 0, 0, 0, 1, 0, 0, 0], local)
        pattern = tangents.outputs[2]
        mass = np.array(ca.DM(pattern, entries[-pattern.nnz() :]))
        assert_allclose(mass, matrix, atol=1e-10 * np.abs(matrix).max())


# Exact Jacobians -------------------------------------------------------------------------------


@every_variant
def test_tangent_is_the_derivative_of_the_force(variant):
    numeric = create_numeric(variant, gravity=(0.7, -3.0))
    q, v, a = random_state(numeric, seed=8)
    assert_derivative(numeric.stiffness(q, v, a), lambda x: numeric.force(x, v, a), q)
    assert_derivative(numeric.damping(q, v, a), lambda x: numeric.force(q, x, a), v)
    assert_derivative(numeric.mass(q, v, a), lambda x: numeric.force(q, v, x), a)


@cache
def driven_mechanism(variant: Variant):
    """Return equations with bodies, joints, a driver and follower loads."""
    mech = bd.Mechanism(gravity=(0.3, -2.0))
    crank = mech.add(bd.RigidBody("crank", mass=1.1, inertia=0.4, center=(0.1, 0.0)))
    beam = mech.add(variant.beam(ARC))
    root, tip = ARC.start, tuple(ARC.point(ARC.length))
    mech.add(bd.PointMass("tip mass", 0.3, on=beam.end))
    mech.add(bd.Revolute("bearing", mech.ground.at(0.0, 0.0), crank.at(0.0, 0.0)))
    mech.add(
        bd.Driver("motor", mech.ground.at(0.0, 0.0), crank.at(0.0, 0.0), law=bd.run_up(2.0, 1.0))
    )
    mech.add(bd.Revolute("pin", crank.at(*root), beam.start))
    mech.add(bd.PointOnLine("guide", crank.at(*tip), beam.end, direction=(0.3, 1.0)))
    mech.add(bd.Force("thrust", beam.at(1.1), (bd.sine(2.0, 1.5), 1.0), axes="body"))
    mech.add(bd.Moment("twist", beam.end, lambda t: 0.5 * np.cos(t)))
    return bd.equations_of_motion(mech)


def _full(pattern, nonzeros):
    matrix = pattern.copy()
    matrix.data = np.array(nonzeros).ravel()
    return matrix.toarray()


@pytest.mark.slow(reason="a fifth of a second")
@pytest.mark.parametrize("form", FIRST_ORDER)
@few_variants
def test_jacobian_of_first_order_forms(variant, form):
    equations = driven_mechanism(variant)
    system = formulate_first_order(equations, form)
    rng = np.random.default_rng(9)
    y, yp = 0.3 * rng.standard_normal((2, system.size))
    y[: equations.n] += equations.q0
    time, c = np.array([0.3, 0.4]), 1.7

    def residual(z):
        return system.residual(time, z, yp + c * (z - y))

    jacobian = _full(system.pattern, system.jacobian(time, y, yp, c))
    assert_derivative(jacobian, residual, y)


@pytest.mark.slow(reason="a fifth of a second")
@pytest.mark.parametrize("stabilized", [False, True], ids=["index3", "stabilized-index2"])
@few_variants
def test_jacobian_of_step_equations(variant, stabilized):
    equations = driven_mechanism(variant)
    step = formulate_step(equations, stabilized)
    rng = np.random.default_rng(10)
    n = equations.n
    x = 0.2 * rng.standard_normal(step.size)
    q_p, q_n = equations.q0 + 0.2 * rng.standard_normal((2, n))
    v_p, a_p = rng.standard_normal((2, n))
    time, at = np.array([0.3, 0.4]), StepPrediction(q_p, v_p, a_p, q_n, np.array([3.0, 5.0, 0.7]))
    whole = _full(step.pattern, step.jacobian(time, at, x))
    # The position corrections r = -G^T eta are separate unknowns of the matrix; eliminate them.
    main_rows, r = slice(step.size), slice(step.size, None)
    jacobian = whole[main_rows, main_rows] - whole[main_rows, r] @ whole[r, main_rows]
    assert_derivative(jacobian, lambda z: step.residual(time, at, z), x)


@pytest.mark.slow(reason="a fifth of a second")
@pytest.mark.parametrize("form", FIRST_ORDER)
def test_packed_states_solve_the_first_order_form(form):
    equations = driven_mechanism(VARIANTS[0])
    time = np.array([0.3, 0.3])
    state = ConsistencySolver(equations).state(time, equations.q0, equations.v0)
    system = formulate_first_order(equations, form)
    y, yp = system.pack(state)
    # The tolerance for closing joints is 1e-12 of the mechanism size; forces are of order ten.
    residual = system.residual(time, y, yp)
    assert_allclose(residual, 0.0, atol=1e-10)
    for unpacked_state, original in zip(system.unpack(y, yp), state, strict=True):
        assert_allclose(unpacked_state, original, rtol=0.0, atol=0.0)


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


def test_invalid_beam_settings_are_rejected():
    section = VARIANTS[0].section
    with pytest.raises(bd.BeamdaeError, match=r"rod: curve must be a Line, Arc.*got 'circle'"):
        bd.Beam("rod", "circle", section)
    with pytest.raises(
        bd.BeamdaeError, match=r"rod: section must be .* a taper or .* returns a Section, got 3"
    ):
        bd.Beam("rod", ARC, 3)
    for words, match in [
        ({"strain": "cubic"}, "'nonlinear', 'green', 'linear', 'exact', got 'cubic'"),
        ({"elements_shape": "curve"}, r"got 'curve' \(did you mean 'curved'\?\)"),
        ({"quadrature": 5}, "quadrature must be one of 'reduced', 'full', got 5"),
        ({"nodes": 5}, "nodes must be one of 2, 3, 4, got 5"),
        ({"continuity": "smooth"}, "continuity must be one of 'cartesian', 'local', got 'smooth'"),
        (
            {"elements_shape": "straight", "continuity": "local"},
            "straight elements meet at kinks; set continuity='cartesian'",
        ),
        ({"frame": "mean"}, "frame must be one of 'tangent', 'chord', got 'mean'"),
        ({"elements": 0}, "elements must be a whole number of at least 1, got 0"),
        ({"elements": 2.5}, "elements must be a whole number of at least 1, got 2.5"),
        ({"velocity": 3.0}, "velocity must be a pair"),
        ({"angular_velocity": np.nan}, "angular_velocity must be finite, got nan"),
    ]:
        with pytest.raises(bd.BeamdaeError, match=f"rod: .*{match}"):
            bd.Beam("rod", ARC, section, **words)
    beam = bd.Beam("rod", ARC, section)
    for s in (-0.1, 2.1, np.nan):
        with pytest.raises(bd.BeamdaeError, match="rod: arc length s must"):
            beam.at(s)
    with pytest.raises(bd.BeamdaeError, match="axes must be one of"):
        beam.deformation(1.0, axes="global")
    with pytest.raises(bd.BeamdaeError, match="offset must be finite"):
        beam.strain(1.0, offset=np.inf)
    with pytest.raises(bd.BeamdaeError, match="the name must be a non-empty string"):
        bd.Beam("", ARC, section)
