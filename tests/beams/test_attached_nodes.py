"""Element ends at the attachments of a beam, frames with rigid corners, and closed rings."""

import warnings

import numpy as np
import pytest
from mechanisms import EARTH, clamped_beam, hinged_beam, rectangle
from numpy.testing import assert_allclose
from support import ARC, SOFT_MATERIAL, NumericEquations

import beamdae as bd

STRIP = rectangle(0.01, damping=1e-3)
LINE = bd.Line((0.0, 0.0), (1.0, 0.0))
PIVOT = 0.3
formulations = pytest.mark.parametrize("formulation", ["floating frame", "exact"])


def arm(elements, formulation="floating frame"):
    """Return an arm that swings about a pivot with a spring between its ends."""
    mech = bd.Mechanism(gravity=EARTH)
    beam = mech.add(bd.Beam("arm", LINE, STRIP, elements=elements, formulation=formulation))
    pivot = (mech.ground.at(PIVOT, 0.0), beam.at(PIVOT))
    mech.add(bd.Revolute("pivot", *pivot))
    mech.add(bd.TorsionSpring("spring", *pivot, 20.0))
    mech.add(bd.PointMass("tip mass", 0.5, on=beam.end))
    mech.observe("tip", beam.end)
    mech.observe("start", beam.start)
    return mech


@pytest.mark.slow(reason="half a second")
@formulations
def test_regression_an_arm_with_its_pivot_inside_an_element(formulation):
    """With 4 elements of equal length, the motion was off by 0.2 %, now by 2e-6."""
    integrator = bd.Radau(1e-7)
    columns = ["tip.x [m]", "tip.y [m]", "tip.angle [rad]", "start.y [m]"]

    def run(elements):
        motion = bd.simulate(arm(elements, formulation), integrator, 0.5).columns
        return np.array([motion[name] for name in columns])

    fine = run(20)  # equal lengths with an element end at the pivot
    half_range = 0.5 * np.ptp(fine, axis=1)[:, None]
    error = {
        name: np.max(np.abs(run(elements) - fine) / half_range)
        for name, elements in (("placed", 4), ("given", np.linspace(0.0, 1.0, 5)))
    }
    assert error["placed"] < 1e-5
    assert error["given"] > 1e-3


@formulations
@pytest.mark.parametrize("elements", [1, 2, 5, 8])
def test_regression_a_clamp_inside_an_element(elements, formulation):
    """The deflection of the tip was off by 7 % with 8 elements of equal length."""
    mech = bd.Mechanism()
    beam = mech.add(bd.Beam("beam", LINE, STRIP, elements=elements, formulation=formulation))
    mech.add(bd.Weld("clamp", mech.ground.at(0.37, 0.0), beam.at(0.37)))
    force, span = 1e-3 * STRIP.EI, 0.63
    mech.add(bd.Force("load", beam.end, (0.0, force)))
    mech.observe("tip", beam.end)
    deflection = bd.equilibrium(mech).columns["tip.y [m]"][-1]
    expected = force * (span**3 / (3.0 * STRIP.EI) + span / STRIP.GA)
    assert deflection == pytest.approx(expected, rel=1e-6)


def mesh_of(attach, elements=4, **settings):
    """Return the mesh of a beam after assembly with the parts that `attach` adds."""
    mech, beam = clamped_beam(STRIP, elements, LINE, **settings)
    attach(mech, beam)
    bd.equations_of_motion(mech)
    return beam.mesh


ATTACHED = {
    "mass": lambda m, b: bd.PointMass("p", 1.0, on=b.at(0.3)),
    "force": lambda m, b: bd.Force("p", b.at(0.3), (0.0, 1.0)),
    "moment": lambda m, b: bd.Moment("p", b.at(0.3), 1.0),
    "joint": lambda m, b: bd.PointOnLine("p", m.ground.at(0.3, 0.0), b.at(0.3)),
    "spring": lambda m, b: bd.Spring("p", m.ground.at(0.3, 1.0), b.at(0.3), 1.0),
    "contact": lambda m, b: bd.Contact("p", b.at(0.3), bd.LineSurface(m.ground.at(0, -1)), 1.0),
    "law": lambda m, b: bd.ForceLaw("p", b.at(0.3), lambda p, t: (0.0, t)),
}


@pytest.mark.parametrize("make", ATTACHED.values(), ids=ATTACHED)
def test_parts_at_fixed_points_get_an_element_end(make):
    mesh = mesh_of(lambda mech, beam: mech.add(make(mech, beam)))
    assert 0.3 in mesh.bounds
    assert mesh.element_lengths.max() <= 0.25
    assert mesh.elements == 5  # two up to the attachment, three beyond


NOT_ATTACHED = {
    "observed point": lambda m, b: m.observe("p", b.at(0.3)),
    "moving force": lambda m, b: m.add(bd.MovingForce("p", b, (0.0, 1.0), speed=1.0)),
    "distributed force": lambda m, b: m.add(bd.DistributedForce("p", b, (0.0, 1.0))),
    "slider": lambda m, b: m.add(
        bd.SlidingOnBeam("p", m.add(bd.PointMass("bead", 1.0, at=(0.3, 0.0))).point, b)
    ),
    "mass at an element end": lambda m, b: m.add(bd.PointMass("p", 1.0, on=b.at(0.5))),
    "mass at an element end but for rounding": lambda m, b: m.add(
        bd.PointMass("p", 1.0, on=b.at(0.5 + 1e-12))
    ),
}


@pytest.mark.parametrize("attach", NOT_ATTACHED.values(), ids=NOT_ATTACHED)
def test_other_parts_keep_elements_of_equal_length(attach):
    mesh = mesh_of(attach)
    assert mesh.bounds is None
    assert mesh.elements == 4


def test_attachments_close_to_each_other_share_an_element_end():
    def attach(mech, beam):
        for k, s in enumerate((0.3, 0.3 + 1e-6, 1.0 - 1e-6)):
            mech.add(bd.Moment(f"moment {k}", beam.at(s), 1.0))

    with warnings.catch_warnings():
        warnings.simplefilter("error")
        mesh = mesh_of(attach)
    assert mesh.elements == 5
    assert mesh.element_lengths.min() > 0.1


@pytest.mark.parametrize(("elements", "springs", "is_divided"), [(4, 10, True), (4, 40, False)])
def test_many_attachments_act_like_a_distributed_load(elements, springs, is_divided):
    def attach(mech, beam):
        for k, s in enumerate(np.linspace(0.0, 1.0, springs + 2)[1:-1]):
            at = (mech.ground.at(s, -0.1), beam.at(s))
            mech.add(bd.Spring(f"spring {k}", *at, 1e3))

    with warnings.catch_warnings():
        warnings.simplefilter("error")
        mesh = mesh_of(attach, elements)
    assert (mesh.bounds is not None) == is_divided


def observed_before_and_after(observe):
    """Return columns of an equilibrium, observed before the other parts are added and after."""
    columns = []
    for comes_first in (True, False):
        mech, beam = clamped_beam(STRIP, 3, LINE, gravity=9.81)
        clamp = mech.part("clamp")
        spring = mech.add(bd.Spring("spring", mech.ground.at(0.8, 0.5), beam.at(0.8), 50.0))
        parts = {"mech": mech, "beam": beam, "clamp": clamp, "spring": spring}
        if comes_first:
            mech.observe("it", observe(**parts))
        mech.add(bd.PointMass("mass", 2.0, on=beam.at(0.41)))
        if not comes_first:
            mech.observe("it", observe(**parts))
        columns.append(bd.equilibrium(mech).columns)
        assert beam.mesh.elements > 3
    return columns


QUANTITIES = {
    "section": lambda beam, **_: beam.at(0.55),
    "floating frame": lambda beam, **_: beam.floating_frame,
    "strain": lambda beam, **_: beam.strain(0.55, "top"),
    "stress": lambda beam, **_: beam.stress(0.55, "top"),
    "section forces": lambda beam, **_: beam.section_forces(0.55),
    "deformation": lambda beam, **_: beam.deformation(0.55),
    "deflection": lambda beam, **_: beam.deflection(0.55),
    "relative": lambda beam, **_: bd.relative_displacement(beam.at(0.55), beam.start),
    "reaction": lambda clamp, **_: clamp.reaction_on("b"),
    "spring": lambda spring, **_: spring.force,
    "stretch": lambda spring, **_: spring.elongation,
}


@pytest.mark.parametrize("observe", QUANTITIES.values(), ids=QUANTITIES)
def test_observables_do_not_depend_on_the_order_of_the_parts(observe):
    before, after = observed_before_and_after(observe)
    for name in after:
        assert_allclose(before[name], after[name], rtol=1e-12, err_msg=name)


@pytest.mark.parametrize(
    ("start", "is_divided"),
    [
        ({"beam.v3": 1e-3}, False),
        ({"beam.phi12_dot": 1e-3}, False),
        ({"beam.theta": 0.1, "beam.theta_dot": 1.0}, True),
        ("equilibrium", True),
    ],
)
def test_starts_that_name_coordinates_of_nodes_keep_the_mesh(start, is_divided):
    mech = bd.Mechanism(start=start)
    beam = mech.add(bd.Beam("beam", LINE, STRIP, elements=4))
    mech.add(bd.Revolute("pivot", mech.ground.at(0.3, 0.0), beam.at(0.3)))
    mech.add(bd.TorsionSpring("spring", mech.ground.at(0.3, 0.0), beam.at(0.3), 10.0))
    bd.equations_of_motion(mech)
    assert (beam.mesh.bounds is not None) == is_divided


@pytest.mark.slow(reason="a fifth of a second")
def test_impacts_on_gaps_of_beams_divided_later():
    """The gap is a quantity of the coordinates before the beam is divided."""
    mech = bd.Mechanism(gravity=EARTH)
    beam = mech.add(bd.Beam("beam", LINE, STRIP, elements=2))
    mech.add(bd.Revolute("pivot", mech.ground.at(0.0, 0.0), beam.start))
    mech.add(bd.PointMass("mass", 0.1, on=beam.at(0.3)))
    gap = bd.LineSurface(mech.ground.at(0.0, -0.01)).gap(beam.at(0.8))
    mech.when(gap, 0.0, "down", bd.impact(gap, restitution=0.5), name="bounce")
    # Impacts follow each other faster and faster after the first one, at 0.0409 s.
    solution = bd.simulate(mech, bd.Radau(1e-5), 0.041)
    assert beam.mesh.elements == 3
    assert solution.status.success, solution.status.sentence
    assert len(solution.events) == 1


@pytest.mark.slow(reason="a fifth of a second")
def test_parts_added_after_the_first_assembly_keep_the_mesh():
    """The equations of earlier runs refer to its coordinates."""
    mech = arm(4)
    first = bd.simulate(mech, bd.Radau(1e-4), 0.1)
    beam = mech.part("arm")
    mesh = beam.mesh
    mech.add(bd.PointMass("late", 0.1, on=beam.at(0.6)))
    bd.simulate(mech, bd.Radau(1e-4), 0.1)
    assert beam.mesh is mesh
    assert np.isfinite(first.observe("late", beam.strain(0.6, "top")).columns["late [-]"]).all()


@pytest.mark.slow(reason="a fifth of a second")
@pytest.mark.parametrize("nodes", [4, 3, 2])
@pytest.mark.parametrize(
    ("kind", "elements"), [("force", 4), ("force", 8), ("clamp", 4), ("clamp", 16)]
)
def test_errors_of_attachments_inside_given_elements_are_stated(kind, elements, nodes):
    bounds = np.linspace(0.0, 1.0, elements + 1)
    s = 0.4 * bounds[elements // 2] + 0.6 * bounds[elements // 2 + 1]

    def bend(elements, nodes):
        if kind == "force":
            mech, beam = hinged_beam(STRIP, elements, nodes=nodes)
            mech.add(bd.PointOnLine("right", mech.ground.at(1.0, 0.0), beam.end))
            mech.add(bd.Force("it", beam.at(s), (0.0, 1e-3 * STRIP.EI)))
        else:
            mech = bd.Mechanism()
            beam = mech.add(bd.Beam("beam", LINE, STRIP, elements=elements, nodes=nodes))
            mech.add(bd.Weld("it", mech.ground.at(s, 0.0), beam.at(s)))
            mech.add(bd.Force("load", beam.end, (0.0, 1e-3 * STRIP.EI)))
        mech.observe("tip", beam.end)
        mech.observe("middle", beam.at(s))
        return bd.equilibrium(mech)

    name = {"force": "middle.y [m]", "clamp": "tip.y [m]"}[kind]
    given, fine = bend(bounds, nodes), bend(np.sort(np.append(bounds, s)), 4)
    error = abs(given.columns[name][-1] / fine.columns[name][-1] - 1.0)
    stated = given.errors.table()["total"][name]
    assert error / 3.0 - 1e-4 < stated < 3.0 * error + 1e-4


@pytest.mark.slow(reason="a fifth of a second")
@formulations
def test_equal_lengths_given_as_ends_or_as_a_number_are_equivalent(formulation):
    columns = [
        bd.simulate(arm(elements, formulation), bd.Radau(1e-7), 0.2).columns
        for elements in (10, np.linspace(0.0, 1.0, 11))
    ]
    for name in columns[0]:
        # Both differ by rounding, which changes the steps within the tolerance.
        assert_allclose(*(c[name] for c in columns), atol=1e-5 * np.ptp(columns[0][name]))


@pytest.mark.slow(reason="half a second")
def test_moving_forces_pass_elements_of_different_lengths():
    """The deflection under a slow force is the static deflection a^2 b^2 / (3 EI L)."""
    strip = rectangle(0.01, damping=0.02)
    mech, beam = hinged_beam(strip, [0.0, 0.1, 0.35, 0.42, 0.8, 1.0])
    mech.add(bd.PointOnLine("right", mech.ground.at(1.0, 0.0), beam.end))
    force = 1e-3 * strip.EI
    mech.add(bd.MovingForce("wheel", beam, (0.0, -force), speed=0.05))
    for s in (0.35, 0.42, 0.8):
        mech.observe(f"at {s}", beam.at(s))
    columns = bd.simulate(mech, bd.Radau(1e-5), 20.0, output_step=0.2).columns
    for s in (0.35, 0.42, 0.8):
        deflection = -columns[f"at {s}.y [m]"][round(s / 0.05 / 0.2)]
        static = force * (s * (1.0 - s)) ** 2 / (3.0 * strip.EI)
        assert deflection == pytest.approx(static, rel=5e-3)  # inertia, and shear of 2e-4


def test_section_forces_of_a_beam_divided_at_its_attachments():
    mech, beam = clamped_beam(STRIP, 2, LINE)
    force = 1e-3 * STRIP.EI
    mech.add(bd.Force("load", beam.at(0.37), (0.0, -force)))
    forces = bd.equilibrium(mech).section_forces(beam)
    expected = force * np.maximum(0.37 - forces.s, 0.0)
    assert_allclose(np.ravel(forces.M), expected, atol=1e-6 * force)
    assert_allclose(np.ravel(forces.strained[2]), expected, atol=1e-6 * force)


# Frames with rigid corners, closed rings, and beams welded from several bodies.

SLENDER = rectangle(0.001, 0.002)


def static_displacement(mech):
    """Return a function that maps an observable to its change under small loads."""
    numeric = NumericEquations(mech)
    stiffness, joint = numeric.stiffness(), numeric.constraint_matrix()
    assert np.linalg.matrix_rank(joint) == numeric.m
    saddle = np.block([[stiffness, joint.T], [joint, np.zeros((numeric.m, numeric.m))]])
    right = np.concatenate([-numeric.force(), np.zeros(numeric.m)])
    # Axial stiffness is 1e7 times the bending stiffness; scaling limits rounding errors.
    diagonal = np.sqrt(np.abs(np.diag(saddle)))
    scale = np.where(diagonal > 0.0, diagonal, 1.0)
    solution = np.linalg.solve(saddle / np.outer(scale, scale), right / scale) / scale
    q = numeric.equations.q0 + solution[: numeric.n]
    return lambda name: numeric.observed(name, q=q) - numeric.observed(name)


def test_sway_of_a_portal_frame():
    """Slope deflection: P h^3 (4 + 6 k) / (24 EI (1 + 6 k)), k the beam's I / l over a column's."""
    height, span, load = 1.0, 2.0, 1e-3
    stiff = rectangle(0.001, 0.004)
    mech = bd.Mechanism()
    corners = {"A": (0.0, 0.0), "B": (0.0, height), "C": (span, height), "D": (span, 0.0)}
    members = [("A", "B"), ("B", "C", stiff), ("D", "C")]
    portal = bd.frame(mech, "portal", corners, members, SLENDER, elements=1)
    for foot in "AD":
        mech.add(bd.Weld(f"clamp {foot}", mech.ground.at(*corners[foot]), portal.corners[foot]))
    mech.add(bd.Force("wind", portal.corners["B"], (load, 0.0)))
    mech.observe("B", portal.corners["B"])
    mech.observe("C", portal.beams["D", "C"].end)
    k = 2.0 * height / span
    expected = load * height**3 * (4.0 + 6.0 * k) / (24.0 * SLENDER.EI * (1.0 + 6.0 * k))
    change = static_displacement(mech)
    # Axial and shear flexibility contribute a few times (0.001 / 1)^2.
    assert_allclose([change("B")[0], change("C")[0]], expected, rtol=1e-5)


def test_points_without_a_member_are_reported():
    points = {"A": (0.0, 0.0), "B": (1.0, 0.0), "C": (1.0, 1.0)}
    with pytest.warns(bd.BeamdaeWarning, match="portal: no member uses point 'C', so the frame"):
        portal = bd.frame(bd.Mechanism(), "portal", points, ["AB"], SLENDER, elements=1)
    assert list(portal.corners) == ["A", "B"]


def test_star_of_three_members():
    """A star of three clamped arms turns by M / (3 * 4 EI / l), in any order of the arms."""
    turns = np.radians([90.0, 210.0, 330.0])
    points = {f"P{k}": (np.cos(t), np.sin(t)) for k, t in enumerate(turns)} | {"O": (0.0, 0.0)}
    for members in (
        [("O", "P0"), ("O", "P1"), ("P2", "O")],
        [("P2", "O"), ("P0", "O"), ("O", "P1")],
    ):
        mech = bd.Mechanism()
        star = bd.frame(mech, "star", points, members, SLENDER, elements=1)
        assert [n for n in mech.parts if "-" not in n] == ["star O", "star O 2"]
        for k in range(3):
            mech.add(bd.Weld(f"clamp {k}", mech.ground.at(*points[f"P{k}"]), star.corners[f"P{k}"]))
        mech.add(bd.Moment("moment", star.corners["O"], 1e-3))
        mech.observe("O", star.corners["O"])
        # Shear flexibility contributes a few times (0.001 / 1)^2.
        assert_allclose(static_displacement(mech)("O")[2], 1e-3 / (12.0 * SLENDER.EI), rtol=1e-4)


@pytest.mark.parametrize("bodies", [2, 4, 8])
def test_pinched_ring(bodies):
    """Shortening along the loads and growth across them by Castigliano (Timoshenko)."""
    radius, load = 0.5, 1e-3
    section = rectangle(0.05, 0.01)
    mech = bd.Mechanism()
    # The ring starts at its lowest point.
    hoop = bd.Arc(radius=radius, length=2.0 * np.pi * radius, start=(0.0, -radius))
    ring = bd.welded_beams(mech, "ring", hoop, section, bodies, closed=True, elements=32 // bodies)
    assert f"ring {bodies} to ring 1" in mech.parts
    mech.add(bd.Weld("bottom", mech.ground.at(0.0, -radius), ring[0].start))
    mech.add(bd.Force("load", ring[bodies // 2].start, (0.0, -load)))
    mech.observe("top", ring[bodies // 2].start)
    quarter = ring[0].length * bodies / 4.0
    for side, turns in (("right", 1.0), ("left", 3.0)):
        k, s = divmod(turns * quarter, ring[0].length)
        mech.observe(side, ring[round(k)].at(s) if bodies < 4 else ring[round(k)].start)
    change = static_displacement(mech)
    bend, x = load * radius**3 / section.EI, section
    stretch = np.pi * load * radius / 4.0 * (1.0 / x.EA + 1.0 / x.GA)
    approach = bend * (np.pi / 4.0 - 2.0 / np.pi) + stretch
    growth = bend * (2.0 / np.pi - 0.5) + load * radius / 2.0 * (1.0 / x.GA - 1.0 / x.EA)
    # Discretization error with 8 elements per quarter: 7e-7.
    assert_allclose(-change("top")[1], approach, rtol=1e-6)
    assert_allclose(change("right")[0] - change("left")[0], growth, rtol=2e-6)


SECTION = bd.Section(SOFT_MATERIAL, area=0.9, second_moment=0.05)


def weld_rod(bodies, **settings):
    mech = bd.Mechanism()
    return mech, bd.welded_beams(mech, "rod", ARC, SECTION, bodies, **settings)


def test_one_body_is_a_single_beam():
    mech, (beam,) = weld_rod(1, elements=3, strain="linear")
    assert list(mech.parts) == ["rod"]
    assert beam.mesh.elements == 3
    assert beam.kinematics.strain == "linear"
    assert beam.curve is ARC


def test_bodies_are_parts_of_the_curve_in_order():
    mech, beams = weld_rod(3, elements=2, frame="chord")
    assert list(mech.parts) == ["rod 1", "rod 2", "rod 3", "rod 1 to rod 2", "rod 2 to rod 3"]
    assert [beam.mesh.elements for beam in beams] == [2, 2, 2]
    assert {beam.kinematics.frame for beam in beams} == {"chord"}
    assert_allclose(
        [beam.length for beam in beams], ARC.length / 3.0, rtol=1e-14
    )  # rounding errors
    ends = [beams[0].start.point, *(beam.end.point for beam in beams)]
    assert_allclose(ends, ARC.point(np.linspace(0.0, ARC.length, 4)), atol=1e-14)


@pytest.mark.slow(reason="three equilibria")
def test_static_deflection_does_not_depend_on_the_number_of_bodies():
    """The load is so small that quadratic strains do not matter."""
    tips = []
    for bodies in (1, 2, 4):
        mech, beams = weld_rod(bodies, elements=8 // bodies)
        mech.add(bd.Weld("clamp", mech.ground.at(*ARC.start), beams[0].start))
        mech.add(bd.Force("load", beams[-1].end, (0.0, -1e-6)))
        mech.observe("tip", beams[-1].end)
        tips.append(bd.equilibrium(mech).table()[["tip.x [m]", "tip.y [m]"]].iloc[-1])
    displacements = np.array(tips) - ARC.point(ARC.length)
    # The elements are the same, and separate frames change nothing in the linear limit. Quadratic
    # strains contribute 1e-8.
    assert_allclose(displacements[1:], displacements[[0, 0]], rtol=1e-7)


@pytest.mark.parametrize("bodies", [0, -1, 2.5])
def test_invalid_number_of_bodies_is_rejected(bodies):
    with pytest.raises(bd.BeamdaeError, match="rod: bodies must be a whole number of at least 1"):
        weld_rod(bodies)
