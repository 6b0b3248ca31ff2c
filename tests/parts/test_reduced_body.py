"""Bodies by Craig-Bampton reduction beside beams of the same bar, and closed forms."""

import numpy as np
import pytest
import scipy.linalg as la
from conformance import integrators
from finite_elements import straight_bar
from hypothesis import given
from hypothesis import strategies as st
from mechanisms import ALLOY, EARTH, rectangle
from numpy.testing import assert_allclose
from support import NumericEquations

import beamdae as bd

LENGTH, ELEMENTS = 1.0, 20
RECTANGLE = rectangle(0.01, material=ALLOY)
# Without shear deformation, as the finite elements.
BAR = bd.Section(ALLOY, RECTANGLE.area, RECTANGLE.second_moment, shear_coefficient=1e3, height=0.01)
END = {"reduced": lambda body: body.at(ELEMENTS), "beam": lambda body: body.end}
START = {"reduced": lambda body: body.at(0), "beam": lambda body: body.start}


def reduced_bar(modes=8, angle=0.0, interface=(0, ELEMENTS), **settings):
    model = straight_bar(BAR, LENGTH, ELEMENTS, angle)
    return bd.ReducedBody.from_matrices("bar", *model, interface, modes, **settings)


def beam_bar(angle=0.0, **settings):
    end = (LENGTH * np.cos(angle), LENGTH * np.sin(angle))
    line = bd.Line((0.0, 0.0), end)
    return bd.Beam("bar", line, BAR, elements=4, strain="linear", **settings)


def mechanism(kind, support=None, gravity=0.0, **settings):
    mech = bd.Mechanism(gravity=(0.0, -gravity))
    body = mech.add({"reduced": reduced_bar, "beam": beam_bar}[kind](**settings))
    if support is not None:
        mech.add(support("support", mech.ground.at(0.0, 0.0), START[kind](body)))
    mech.observe("tip", END[kind](body))
    return mech


@pytest.mark.parametrize("support", [None, bd.Weld, bd.Revolute], ids=["free", "clamped", "pinned"])
def test_frequencies_converge_to_those_of_a_beam_with_the_number_of_modes(support):
    free = 3 if support is None else 1 if support is bd.Revolute else 0
    exact = bd.modes(mechanism("beam", support), n=6).frequencies[free]
    errors = []
    for modes in (2, 4, 8):
        mech = mechanism("reduced", support, modes=modes)
        computed = bd.modes(mech, n=6).frequencies[free]
        errors.append(abs(computed / exact - 1.0))
    assert errors[0] > 5.0 * errors[1] > 25.0 * errors[2]
    assert errors[2] < 2e-5


def test_static_deflection_is_that_of_the_finite_elements_with_any_number_of_modes():
    load = -3.0
    for modes in (0, 6):
        mech = mechanism("reduced", bd.Weld, modes=modes, angle=0.4)
        mech.add(
            bd.Force(
                "load", mech.part("bar").at(ELEMENTS), (-load * np.sin(0.4), load * np.cos(0.4))
            )
        )
        body = mech.part("bar")
        # The moment at the clamp, by the curvature of the first element.
        turn = np.kron(
            np.eye(2), [[np.cos(0.4), np.sin(0.4), 0], [-np.sin(0.4), np.cos(0.4), 0], [0, 0, 1]]
        )
        h = LENGTH / ELEMENTS
        curvature = np.array([0.0, -6.0 / h**2, -4.0 / h, 0.0, 6.0 / h**2, -2.0 / h]) @ turn
        row = np.zeros((1, 3 * (ELEMENTS + 1)))
        row[0, :6] = BAR.EI * curvature * RECTANGLE.height / 2.0 / BAR.second_moment
        mech.observe("stress", body.recover(row, ["root"]))
        columns = bd.equilibrium(mech).columns
        deflection = np.hypot(
            columns["tip.x [m]"] - np.cos(0.4), columns["tip.y [m]"] - np.sin(0.4)
        )[-1]
        assert_allclose(deflection, abs(load) * LENGTH**3 / (3.0 * BAR.EI), rtol=1e-4)
        stress = abs(load) * LENGTH * RECTANGLE.height / 2.0 / BAR.second_moment
        assert_allclose(abs(columns["stress.root [Pa]"][-1]), stress, rtol=1e-4)


@integrators(rtol=1e-6, step=2e-4, slow=("ida", "alpha stabilized", "alpha adaptive"))
def test_swinging_pendulum_beside_a_beam(integrator):
    settings = {"support": bd.Revolute, "gravity": 9.81}
    reduced = mechanism("reduced", modes=4, damping=1e-5, **settings)
    runs = [
        bd.simulate(mech, integrator, t_end=0.4, output_step=0.05)
        for mech in (reduced, mechanism("beam", **settings))
    ]
    for column in ("tip.x", "tip.y"):
        assert_allclose(runs[0][column], runs[1][column], atol=2e-5)
    balance = runs[0].energies.iloc[-1]
    assert abs(balance["energy.imbalance [J]"]) < 1e-4 * balance["energy.kinetic [J]"]


def test_stretch_of_a_spinning_bar():
    """At the speed w, half a bar of length a becomes longer by rho w^2 a^3 / (3 E)."""
    speed, mech = 300.0, mechanism("reduced", modes=12)
    numeric, body = NumericEquations(mech), mech.part("bar")
    v = np.zeros(numeric.n)
    v[2] = speed
    modal = -np.linalg.solve(numeric.stiffness(v=v)[3:, 3:], numeric.force(v=v)[3:])
    half = LENGTH / 2.0
    stretch = ALLOY.rho * speed**2 * half**3 / (3.0 * ALLOY.E)
    assert_allclose(body.shapes[3 * ELEMENTS] @ modal, stretch, rtol=3e-3)


def test_inertia_of_a_rigid_motion_is_that_of_the_bar():
    numeric = NumericEquations(mechanism("reduced", angle=0.7))
    v = np.zeros(numeric.n)
    v[:3] = 0.4, -1.1, 2.0
    mass = BAR.rhoA * LENGTH
    inertia = mass * LENGTH**2 / 12.0 + BAR.rhoI * LENGTH
    kinetic = 0.5 * mass * (0.4**2 + 1.1**2) + 0.5 * inertia * 2.0**2
    assert_allclose(numeric.energies(v=v)[0], kinetic, rtol=1e-9)


def closed_truss(nodes):
    """Return the stiffness matrix of bars of 1e4 N/m from node to node, back to the first."""
    stiffness = np.zeros((nodes.size, nodes.size))
    for a in range(len(nodes)):
        b = (a + 1) % len(nodes)
        row = np.zeros(nodes.shape)
        row[b] = (nodes[b] - nodes[a]) / np.linalg.norm(nodes[b] - nodes[a])
        row[a] = -row[b]
        stiffness += 1e4 * np.outer(row, row)
    return stiffness


def test_particles_of_a_truss():
    nodes = np.array([(0.0, 0.0), (1.0, 0.0), (0.0, 1.0)])
    stiffness = closed_truss(nodes)
    body = bd.ReducedBody.from_matrices("truss", np.eye(6), stiffness, nodes, [0, 1])
    mech = bd.Mechanism()
    mech.add(body)
    exact = np.sqrt(np.linalg.eigvalsh(stiffness)[3:]) / (2.0 * np.pi)
    assert_allclose(bd.modes(mech).frequencies[3:], exact, rtol=1e-9)
    with pytest.raises(bd.BeamdaeError, match="without an angle"):
        bd.Moment("moment", body.at(2), 1.0)


TWO = straight_bar(BAR, LENGTH, 2)
HELD = TWO[1] + np.diag([1e9, *np.zeros(8)])
TURNING = TWO[0] - np.diag([0, 0, 1, 0, 0, 1, 0, 0, 1])
ERRORS = {
    "dimensions": (lambda: (TWO[0].ravel(), *TWO[1:], [0]), "mass must be a matrix .* rows by"),
    "complex": (lambda: (1j * TWO[0], *TWO[1:], [0]), "mass must be a matrix of finite real"),
    "negative stiffness": (lambda: (TWO[0], -TWO[1], TWO[2], [0]), "singular or negative"),
    "negative mass": (lambda: (TURNING, *TWO[1:], [0]), "mass must be positive for all motions"),
    "rotary inertia": (
        lambda: (np.diag([1, 1, 0, 2, 2, 0, 1, 1, 0]), *TWO[1:], [0, 2]),
        "add the missing mass or rotary inertia, pass fewer modes",
    ),
    "directions": (
        lambda: (np.diag([1, 2, 0, 2, 2, 0, 2, 1, 0]), *TWO[1:], [0]),
        r"the same positive mass in both directions, got 5 kg at \(0.6, 0\) m and 5 kg at \(0.4, 0",
    ),
    "size": (lambda: (TWO[0][:5, :5], *TWO[1:], [0]), "mass must be a square matrix"),
    "symmetry": (lambda: (TWO[0], np.triu(TWO[1]), TWO[2], [0]), "stiffness must be a symmetric"),
    "supports": (lambda: (TWO[0], HELD, TWO[2], [0]), "stiffness must be that of the free body"),
    "mass": (lambda: (np.zeros((9, 9)), *TWO[1:], [0]), "mass must be the same positive mass"),
    "nodes": (lambda: (*TWO[:2], [(0.0, 0.0)], [0]), "nodes must be at least two points"),
    "twice": (lambda: (*TWO, [0, 0]), "interface must contain different nodes"),
    "no node": (lambda: (*TWO, [3]), "interface must be"),
}


@pytest.mark.parametrize("name", ERRORS)
def test_wrong_matrices_are_one_sentence(name):
    make, sentence = ERRORS[name]
    with pytest.raises(bd.BeamdaeError, match=sentence):
        bd.ReducedBody.from_matrices("bar", *make())


def test_rigid_shapes_are_rejected():
    rigid = np.tile([1.0, 0.0, 0.0], 3)[:, None]
    with pytest.raises(bd.BeamdaeError, match="contain no rigid motion"):
        bd.ReducedBody("bar", *TWO, rigid)


def test_negative_stiffness_and_mass_of_shapes_are_rejected():
    shapes = bd.ReducedBody.from_matrices("bar", *TWO, [0]).shapes
    with pytest.raises(bd.BeamdaeError, match="stiffness must not be negative for any shape"):
        bd.ReducedBody("bar", TWO[0], -TWO[1], TWO[2], shapes)
    with pytest.raises(bd.BeamdaeError, match="mass must be positive for all motions"):
        bd.ReducedBody("bar", TURNING, *TWO[1:], shapes)


@pytest.mark.parametrize("angle", [0.0, 0.3, 0.4, 1.0])
def test_a_mechanism_in_the_body_is_rejected(angle):
    """Rounding decided whether a node between two collinear bars had a stiffness."""
    turn = np.array([[np.cos(angle), np.sin(angle)], [-np.sin(angle), np.cos(angle)]])
    nodes = np.array([(0.0, 0.0), (1.0, 0.0), (2.0, 0.0), (0.0, 1.0)]) @ turn
    stiffness = closed_truss(nodes)
    with pytest.raises(bd.BeamdaeError, match="the stiffness is singular or negative"):
        bd.ReducedBody.from_matrices("truss", np.eye(8), stiffness, nodes, [0, 2, 3])


@pytest.mark.parametrize("modes", [2, 5, 10, 12, 100])
@pytest.mark.parametrize("elements", [3, 6, 12])
def test_lumped_masses_have_no_rotary_inertia(elements, modes):
    _, stiffness, nodes = straight_bar(BAR, LENGTH, elements, 0.3)
    share = BAR.rhoA * LENGTH / elements * np.array([0.5, *np.ones(elements - 1), 0.5])
    inertia = np.array([1e-6, *np.zeros(elements - 1), 1e-6])  # at joints
    masses = np.stack([share, share, inertia], axis=1).ravel()
    mech = bd.Mechanism()
    mech.add(
        bd.ReducedBody.from_matrices("bar", np.diag(masses), stiffness, nodes, [0, elements], modes)
    )
    # Rotations without inertia follow the displacements.
    a, b = np.flatnonzero(masses), np.flatnonzero(masses == 0.0)
    to_a = np.linalg.solve(stiffness[np.ix_(b, b)], stiffness[np.ix_(b, a)])
    condensed = stiffness[np.ix_(a, a)] - stiffness[np.ix_(a, b)] @ to_a
    exact = np.sqrt(la.eigvalsh(condensed, np.diag(masses[a]))[3]) / (2.0 * np.pi)
    rtol = 1e-8 if modes > 2 * elements else 1e-2
    assert_allclose(bd.modes(mech, n=4).frequencies[3], exact, rtol=rtol)


@pytest.mark.parametrize("size", [1e-6, 1e-3, 1e3, 1e5])
def test_bodies_of_any_size(size):
    """Similar bodies of one material have frequencies in inverse proportion to their size."""
    frequencies = []
    for factor in (1.0, size):
        section = rectangle(0.01 * factor, 0.02 * factor, material=ALLOY)
        mech = bd.Mechanism()
        mech.add(
            bd.ReducedBody.from_matrices("bar", *straight_bar(section, factor, 8, 0.3), [0, 8])
        )
        frequencies.append(factor * bd.modes(mech, n=6).frequencies[3:])
    assert_allclose(frequencies[1], frequencies[0], rtol=1e-6)


# Mass, center and inertia of rigid bodies from their shapes.

STEEL = {"density": 7850.0, "thickness": 0.01}
L_SHAPE = [(0.0, 0.0), (0.3, 0.0), (0.3, 0.1), (0.1, 0.1), (0.1, 0.2), (0.0, 0.2)]
places = st.tuples(st.floats(-10.0, 10.0), st.floats(-10.0, 10.0))


def test_rod():
    rod = bd.RigidBody.rod("rod", (1.0, 2.0), (4.0, 6.0), density=7850.0, area=1e-4)
    assert_allclose(rod.mass, 7850.0 * 5.0 * 1e-4, rtol=1e-15)
    assert_allclose(rod.inertia, rod.mass * 25.0 / 12.0, rtol=1e-15)
    assert rod.center == (2.5, 4.0)
    assert bd.RigidBody.rod("rod", (1.0, 2.0), (4.0, 6.0), mass=3.0).inertia == 6.25


def test_disk():
    disk = bd.RigidBody.disk("disk", (1.0, -1.0), 0.2, **STEEL, angular_velocity=3.0)
    assert_allclose(disk.mass, 7850.0 * 0.01 * np.pi * 0.04, rtol=1e-15)
    assert_allclose(disk.inertia, disk.mass * 0.02, rtol=1e-15)
    assert (disk.center, disk.angular_velocity) == ((1.0, -1.0), 3.0)


@given(center=places, angle=st.floats(-7.0, 7.0), sizes=st.tuples(*[st.floats(0.01, 5.0)] * 2))
def test_a_plate_is_the_polygon_of_its_corners(center, angle, sizes):
    plate = bd.RigidBody.plate("plate", center, *sizes, angle=angle, mass=2.0)
    polygon = bd.RigidBody.polygon("plate", plate.shape, mass=2.0)
    assert_allclose(plate.inertia, 2.0 * (sizes[0] ** 2 + sizes[1] ** 2) / 12.0, rtol=1e-14)
    # Rounding error of the coordinates, 2e-15 m, in plates of 0.01 m.
    assert_allclose(polygon.inertia, plate.inertia, rtol=1e-9)
    assert_allclose(polygon.center, center, atol=1e-13)


def test_a_polygon_is_the_sum_of_its_rectangles():
    whole = bd.RigidBody.polygon("angle", L_SHAPE, **STEEL)
    parts = [
        bd.RigidBody.plate("a", (0.15, 0.05), 0.3, 0.1, **STEEL),
        bd.RigidBody.plate("b", (0.05, 0.15), 0.1, 0.1, **STEEL),
    ]
    mass = sum(part.mass for part in parts)
    center = sum(part.mass * np.array(part.center) for part in parts) / mass
    apart = [np.sum((np.array(part.center) - center) ** 2) for part in parts]
    inertia = sum(p.inertia + p.mass * d for p, d in zip(parts, apart, strict=True))
    # Rounding error.
    assert_allclose(whole.mass, mass, rtol=1e-13)
    assert_allclose(whole.center, center, rtol=1e-13)
    assert_allclose(whole.inertia, inertia, rtol=1e-13)


@given(turn=st.floats(-7.0, 7.0), by=places, first=st.integers(0, 5), backwards=st.booleans())
def test_a_polygon_has_the_same_mass_properties_at_any_place_and_orientation(
    turn, by, first, backwards
):
    reference = bd.RigidBody.polygon("angle", L_SHAPE, **STEEL)
    c, s = np.cos(turn), np.sin(turn)
    outline = np.roll(L_SHAPE, first, axis=0)[:: -1 if backwards else 1] @ [(c, s), (-s, c)] + by
    body = bd.RigidBody.polygon("angle", outline, **STEEL)
    # Rounding error of the coordinates, 2e-15 m, relative to 0.1 m.
    assert_allclose((body.mass, body.inertia), (reference.mass, reference.inertia), rtol=1e-11)
    center = np.array(reference.center) @ [(c, s), (-s, c)] + by
    assert_allclose(body.center, center, atol=1e-13)


def test_polygons_of_any_size():
    for scale in (1e-6, 1e6):
        body = bd.RigidBody.polygon("angle", scale * np.array(L_SHAPE), mass=1.0)
        reference = bd.RigidBody.polygon("angle", L_SHAPE, mass=1.0)
        assert_allclose(body.inertia, reference.inertia * scale**2, rtol=1e-13)


def test_a_shape_is_the_outline_of_the_body():
    mech = bd.Mechanism(gravity=EARTH)
    body = mech.add(bd.RigidBody.polygon("angle", L_SHAPE, **STEEL))
    mech.add(bd.Revolute("hinge", mech.ground.at(0.0, 0.2), body.at(0.0, 0.2)))
    assert [place.point for place in body.draw([], 13).places] == L_SHAPE
    solution = bd.simulate(mech, bd.Radau(rtol=1e-6), t_end=0.5)
    assert solution.quality.energy_imbalance < 1e-5
    assert bd.equations_of_motion(mech).length == pytest.approx(np.hypot(0.3, 0.2))
