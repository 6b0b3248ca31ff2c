"""Stability and critical points of slender structures, against closed forms."""

import numpy as np
import pytest
from mechanisms import (
    clamped_beam,
    free_ball,
    hinged_beam,
    lee_frame,
    portal_points,
    rectangle,
    welded_frame,
)
from numpy.testing import assert_allclose

import beamdae as bd


def column(height, length=1.0, elements=8, axes="inertial"):
    """Return a cantilever column under a compressive force of EI / L^2."""
    section = rectangle(height)
    mech, beam = clamped_beam(section, elements, (0.0, length), name="column", formulation="exact")
    mech.add(bd.Force("press", beam.end, (0.0, -section.EI / length**2), axes=axes))
    mech.observe("tip", beam.end)
    return mech


def arch_under_pressure(height, radius=0.2, elements=12, **options):
    """Return a hinged semicircular arch under the follower pressure EI / R^3."""
    section = rectangle(height)
    arc = bd.Arc(radius, np.pi * radius, start=(radius, 0.0), angle=0.5 * np.pi)
    options = options or {"formulation": "exact"}
    mech, arch = hinged_beam(section, elements, arc, name="arch", **options)
    mech.add(bd.Revolute("left", mech.ground.at(-radius, 0.0), arch.end))
    pressure = (0.0, section.EI / radius**3)
    mech.add(bd.DistributedForce("pressure", arch, pressure, axes="section"))
    return mech


@pytest.mark.parametrize(("height", "elements"), [(1e-2, 4), (3e-3, 5), (1e-3, 5)])
def test_a_largest_pressure_is_no_branch_point_whatever_the_control(height, elements):
    # The pressure follows the sections of a coarse mesh, which feel no potential exactly.
    mech = arch_under_pressure(height, elements=elements, strain="green")
    by_load = bd.equilibrium(mech, to=16.0)
    by_arc = bd.equilibrium(mech, to=16.0, control="arc length", max_points=80)
    branch, limit = by_arc.critical[:2]
    assert (branch.kind, limit.kind) == ("branch point", "limit point")
    (point,) = by_load.critical
    assert point.kind == "branch point"
    assert point.factor == pytest.approx(branch.factor, rel=1e-6)
    assert not by_load.status.success
    assert by_load.factors[-1, 0] == pytest.approx(limit.factor, rel=1e-4)
    assert by_load.unstable[-1] == 1


EULER = 0.25 * np.pi**2 * np.array([1.0, 9.0, 25.0])


@pytest.mark.parametrize("height", [1e-2, 1e-3, 1e-4])
@pytest.mark.parametrize("control", ["load", "arc length"])
def test_column_passes_all_branch_points(control, height):
    path = bd.equilibrium(column(height), to=100.0, control=control)
    assert path.status.success
    assert [point.kind for point in path.critical] == ["branch point"] * 3
    # Compression and shear lower the third load by (5 pi h / L)^2 / 48 (1 + 2.6 * 1.2) at most.
    assert_allclose([point.factor for point in path.critical], EULER, rtol=2e-3)
    assert path.unstable[-1] == 3


@pytest.mark.slow(reason="one second")
def test_displacement_control_finds_many_branch_points_in_one_step():
    # A step compresses the column by 5 %; it buckles from 2e-7 on.
    path = bd.equilibrium(column(1e-3), to={"tip.y": 0.5})
    assert path.status.success
    factors = [point.factor for point in path.critical[:4]]
    assert {point.kind for point in path.critical} == {"branch point"}
    assert_allclose(factors, 0.25 * np.pi**2 * np.array([1.0, 9.0, 25.0, 49.0]), rtol=1e-3)
    assert len(path.critical) == path.unstable[-1]


@pytest.mark.slow(reason="a fifth of a second")
def test_arc_length_ends_where_points_are_recomputed():
    """The end of the last step may lie on either side of the target in the last digit."""
    for elements in (4, 8):
        path = bd.equilibrium(column(1e-2, elements=elements), to=49.3, control="arc length")
        assert path.status.success
        assert path.factor == pytest.approx(49.3)


@pytest.mark.parametrize(
    "elements", [4, 8, pytest.param(16, marks=pytest.mark.slow(reason="one second"))]
)
@pytest.mark.parametrize("slenderness", [1e1, 1e3, 1e5])
def test_strip_rolls_up_at_any_slenderness(slenderness, elements):
    section = rectangle(1.0 / slenderness)
    mech, strip = clamped_beam(section, elements, name="strip", formulation="exact")
    mech.add(bd.Moment("roll", strip.end, 2.0 * np.pi * section.EI))
    mech.observe("tip", strip.end)
    path = bd.equilibrium(mech)
    assert path.status.success
    # A closed circle; rounding is 1e-16 (L / h)^2.
    tip = [path.columns[f"tip.{axis} [m]"][-1] for axis in "xy"]
    assert_allclose(tip, 0.0, atol=1e-5)


@pytest.mark.slow(reason="a path of a hundred points")
def test_path_of_lees_frame_passes_limit_points_and_reversals_by_arc_length():
    path = bd.equilibrium(
        lee_frame(10, formulation="exact"), to={"ld.y": 30.0}, control="arc length"
    )
    assert [point.kind for point in path.critical] == ["limit point"] * 2
    # Beyond the limit load the displacement reverses twice.
    steps = np.diff(path.columns["ld.y [m]"])
    assert np.count_nonzero(np.diff(np.sign(steps))) == 2
    with pytest.warns(bd.BeamdaeWarning, match="to continue where a displacement reverses"):
        bd.equilibrium(lee_frame(5, formulation="exact"), to={"ld.y": 30.0})


def swaying_portal(side):
    """Return a clamped portal frame of 1 m in floating frames, with EI / L^2 on both columns."""
    section = rectangle(1e-2)
    mech, (left, _beam, right) = welded_frame(portal_points(), section, 8)
    mech.add(bd.Force("first", left.end, (side * section.EI, -section.EI)))
    mech.add(bd.Force("second", right.start, (0.0, -section.EI)))
    return mech


@pytest.mark.slow(reason="one second")
def test_regression_portal_of_default_strain_ends_in_few_points():
    """A portal frame ran for 264 s and ended at the load factor -1.9e6."""
    path = bd.equilibrium(swaying_portal(0.0), to=20.0)
    (point,) = path.critical
    # Bazant & Cedolin: k L / tan(k L) = -6.
    assert point.factor == pytest.approx(7.379, rel=1e-3)
    path = bd.equilibrium(swaying_portal(0.01), to=20.0)
    # With exact strains, the path ends at 8.98 instead of 8.44, also near a limit point.
    assert "use control='arc length'" in path.status.sentence
    assert 7.0 < path.factor < 20.0
    assert len(path.q) < 200


@pytest.mark.slow(reason="a quarter of a second")
@pytest.mark.parametrize("formulation", ["exact", "floating frame"])
def test_fine_mesh_is_free_only_without_a_clamp(formulation):
    """The lowest stiffness of a fine mesh is 1e-11 of the largest; rounding errors are 1e-16."""

    def find_equilibrium(clamped):
        build = clamped_beam if clamped else hinged_beam
        return bd.equilibrium(build(rectangle(), 64, bd.Arc(2.0, 1.0), formulation=formulation)[0])

    cantilever = find_equilibrium(clamped=True)
    assert cantilever.stable
    assert not cantilever.free
    with pytest.warns(bd.BeamdaeWarning, match="this coordinate can move without stiffness"):
        pendulum = find_equilibrium(clamped=False)
    assert pendulum.free.startswith("beam.")
    assert not pendulum.stable
    assert pendulum.unstable[-1] == 0


def test_regression_states_without_steady_value_are_not_told_to_add_a_spring():
    """A work integrator was a coordinate without stiffness that needs a spring or a joint."""
    mech, mass = free_ball((1.0, 0.0), name="mass")
    for k in range(2):
        mech.add(bd.Spring(f"spring {k}", mech.ground.at(0.0, k), mass.point, 10.0))
    mech.state("work", rate=0.0)
    with pytest.warns(bd.BeamdaeWarning, match=r"work\.value: the rate of this state"):
        bd.equilibrium(mech)


# Stability of structures of different sizes in one model, which only the ground connects.


@pytest.mark.parametrize("damping", [0.0, 1e-5])
@pytest.mark.parametrize("formulation", ["exact", "floating frame"])
@pytest.mark.parametrize("ratio", [10.0, 1e4, 1e-4])
def test_regression_flutter_of_a_column_does_not_depend_on_another_one(ratio, formulation, damping):
    """From 1:1000 on, the twelve slowest modes were those of the other column."""

    def beck(lengths):
        mech = bd.Mechanism()
        for k, length in enumerate(lengths):
            section = rectangle(length / 100, length / 20, damping=damping)
            foot = 2.0 * k * max(lengths)
            line = bd.Line((foot, 0.0), (foot, length))
            column = mech.add(bd.Beam(f"column {k}", line, section, 4, formulation=formulation))
            mech.add(bd.Weld(f"clamp {k}", mech.ground.at(foot, 0.0), column.start))
            if k == 0:
                force = (0.0, -section.EI / length**2)
                mech.add(bd.Force("push", column.end, force, axes="body"))
        return mech

    alone, beside = (bd.equilibrium(beck(lengths), to=25.0) for lengths in ([1.0], [1.0, ratio]))
    assert [point.kind for point in beside.critical] == ["flutter point"]
    # The load of Beck's column is 20.05 EI / l^2 without damping; material damping halves it.
    assert_allclose(beside.critical[0].factor, 20.05 if not damping else 10.93, rtol=2e-3)
    assert_allclose(beside.critical[0].factor, alone.critical[0].factor, rtol=1e-5)
    assert beside.unstable[-1] == 2
