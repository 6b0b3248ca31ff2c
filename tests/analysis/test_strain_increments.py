"""Newton's method in strains: equilibria of beams at any slenderness, and finite displacements."""

import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal

import beamdae as bd
from beamdae.analysis.statics.path_controls import DisplacementControl
from beamdae.analysis.statics.strain_increments import StrainIncrements

STEEL = bd.Material.of("steel")
WIDTH = 0.02


def bending_stiffness(height):
    """Return EI of the strip."""
    return STEEL.E * WIDTH * height**3 / 12.0


def cantilever(height, elements, *, moment=0.0, force=0.0, gravity=0.0, **kind):
    """Return a strip of 1 m with an end moment [EI/L], a tip force [EI/L^2] and its weight."""
    mech = bd.Mechanism(gravity=(0.0, -gravity))
    section = bd.Section.rectangle(STEEL, width=WIDTH, height=height)
    line = bd.Line((0.0, 0.0), (1.0, 0.0))
    kind = kind or {"formulation": "exact"}
    beam = mech.add(bd.Beam("strip", line, section, elements, **kind))
    mech.add(bd.Weld("clamp", mech.ground.at(0.0, 0.0), beam.start))
    if moment:
        mech.add(bd.Moment("moment", beam.end, moment * bending_stiffness(height)))
    if force:
        mech.add(bd.Force("force", beam.end, (0.0, -force * bending_stiffness(height))))
    mech.observe("tip", beam.end)
    return mech


def two_beams():
    """Return two welded curved beams of different meshes, and strains observed on them."""
    mech = bd.Mechanism()
    section = bd.Section.rectangle(STEEL, width=WIDTH, height=0.01)
    arc = bd.Arc(radius=0.5, length=0.4)
    end = tuple(arc.point(arc.length))
    line = bd.Line(end, (end[0] - 0.3, end[1] + 0.2))
    kind = {"formulation": "exact"}
    first = mech.add(bd.Beam("first", arc, section, 3, **kind))
    second = mech.add(bd.Beam("second", line, section, 2, nodes=3, **kind))
    mech.add(bd.Revolute("hinge", first.end, second.start))
    for name, beam in (("first gauge", first), ("second gauge", second)):
        mech.observe(name, beam.strain(s=0.17, offset=0.003))
    return bd.equations_of_motion(mech)


def test_displacements_add_the_linear_increments_of_strains():
    e, random = two_beams(), np.random.default_rng(1)
    increments = StrainIncrements.of(e)
    q = increments.displace(e.q0, 0.5 * random.standard_normal(e.n))
    change = random.standard_normal(e.n)
    displaced = increments.displace(q, change)
    assert np.max(np.abs(displaced - q - change)) > 0.1
    for observable in e.observables:
        gauge = DisplacementControl(e, observable, 0, np.zeros(2))
        expected = gauge.value(q, 0.0) + gauge.gradient(q, 0.0)[0] @ change
        assert gauge.value(displaced, 0.0) == pytest.approx(expected, rel=1e-13)
    assert_allclose(increments.difference(q, displaced), change, atol=1e-13)


@pytest.mark.parametrize("frame", ["tangent", "chord"])
def test_displacements_in_a_floating_frame_add_the_linear_increments_of_strains(frame):
    mech, random = bd.Mechanism(), np.random.default_rng(3)
    section = bd.Section.rectangle(STEEL, width=WIDTH, height=0.01)
    arc = bd.Arc(radius=0.5, length=0.4, angle=0.3)
    mech.add(bd.Beam("arc", arc, section, 3, strain="exact", frame=frame))
    e = bd.equations_of_motion(mech)
    increments = StrainIncrements.of(e)
    (axis,) = increments.frame_axes

    def strains(q):
        w, phi = axis._nodal(q)
        return (1.0 + axis._derivative(w)) * np.exp(-1j * axis._at_points(phi))

    q = increments.displace(e.q0, 0.1 * random.standard_normal(e.n))
    change, h = 0.1 * random.standard_normal(e.n), 1e-5
    displaced = increments.displace(q, change)
    linear = (strains(q + h * change) - strains(q - h * change)) / (2.0 * h)
    assert_allclose(strains(displaced), strains(q) + linear, rtol=0.0, atol=1e-9)
    assert np.max(np.abs(strains(q + change) - strains(displaced))) > 0.1
    assert_allclose(increments.difference(q, displaced), change, atol=1e-13)


def test_displacements_are_linear_to_first_order():
    e, random = two_beams(), np.random.default_rng(2)
    increments, change = StrainIncrements.of(e), random.standard_normal(e.n)
    errors = [
        np.max(np.abs(increments.displace(e.q0, h * change) - e.q0 - h * change))
        for h in (1e-3, 5e-4)
    ]
    assert errors[0] / errors[1] == pytest.approx(4.0, rel=0.01)


def test_regression_a_change_of_zero_moves_nothing():
    # Integrated positions instead of displacements changed axial strains by 3e-14: 1e-4 of the
    # buckling load at L/h = 1e5.
    e, random = two_beams(), np.random.default_rng(4)
    increments = StrainIncrements.of(e)
    q = increments.displace(e.q0, 0.5 * random.standard_normal(e.n))
    assert_array_equal(increments.displace(q, np.zeros(e.n)), q)


@pytest.mark.parametrize("height", [1e-2, 1e-3, 1e-4, 1e-5])
@pytest.mark.parametrize("elements", [4, 8])
def test_roll_up_takes_few_iterations_at_any_slenderness(elements, height):
    # In positions instead of strains, up to 41 points and 456 iterations were needed.
    path = bd.equilibrium(cantilever(height, elements, moment=2.0 * np.pi))
    assert path.status.success
    assert len(path.q) == 11
    assert path.settings["iterations"] <= 40
    # A closed circle, up to rounding of the axial stiffness.
    assert_allclose([path.columns[f"tip.{axis} [m]"][-1] for axis in "xy"], 0.0, atol=1e-5)


def test_own_weight_takes_as_many_steps_on_every_mesh():
    paths = [bd.equilibrium(cantilever(1e-4, n, gravity=9.81)) for n in (8, 16)]
    assert all(path.status.success for path in paths)
    assert len(paths[0].q) == len(paths[1].q) <= 20


@pytest.mark.slow(reason="four paths of a thin strip, 1 s")
def test_regression_steps_in_a_floating_frame_follow_the_path():
    # With linear increments and steps limited by iterations, 93 and 109 points were needed.
    for kind in ({"strain": "exact"}, {"strain": "green"}):
        paths = [bd.equilibrium(cantilever(1e-4, n, gravity=9.81, **kind)) for n in (8, 32)]
        assert all(path.status.success for path in paths)
        limit = 20 if kind["strain"] == "exact" else 60
        assert max(len(path.q) for path in paths) <= limit


def test_thin_strip_bends_like_the_elastica():
    # Its bending stiffness is 1e-11 of the axial stiffness: on this mesh, the lowest eigenvalue of
    # the stiffness is below rounding. Mattiasson, Int. J. Numer. Methods Eng. 17 (1981) 145.
    path = bd.equilibrium(cantilever(1e-5, 32, force=10.0))
    assert path.status.success
    assert len(path.q) == 11
    assert path.columns["tip.x [m]"][-1] == pytest.approx(1.0 - 0.55500, abs=1e-5)
    assert path.columns["tip.y [m]"][-1] == pytest.approx(-0.81061, abs=1e-5)
