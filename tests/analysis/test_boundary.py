"""Critical loads as a function of a parameter, against closed forms."""

import warnings

import mechanisms
import numpy as np
import pytest
from mechanisms import clamped_beam, hinged_arch, hinged_beam, rectangle
from numpy.testing import assert_allclose, assert_array_equal
from scipy.optimize import brentq

import beamdae as bd

STIFFNESS = 1000.0
SECTION = rectangle(1e-3)


@bd.model(t_end=1.0)
def truss(rise=0.2, support=200.0, supported=False):
    """Von Mises truss, whose crown a spring may support."""
    mech = mechanisms.truss(rise, STIFFNESS)
    if supported:
        # Long enough to remain vertical.
        foot = mech.ground.at(0.0, rise - 50.0)
        mech.add(bd.Spring("support", foot, mech.part("crown").point, support))
    return mech


def truss_limit(rise):
    """Return the limit load, where L^3 = L0."""
    free_length = np.hypot(1.0, rise)
    height = np.sqrt(free_length ** (2.0 / 3.0) - 1.0)
    length = np.hypot(1.0, height)
    return 2.0 * STIFFNESS * (free_length - length) * height / length


@pytest.mark.slow(reason="one second")
def test_limit_load_of_a_truss_over_its_rise():
    curve = bd.boundary(
        truss, "limit point", ("rise", "load"), (0.2, 0.5), step=0.5, to={"crown.y": 0.0}
    )
    assert curve.status.success
    assert curve.values[[0, -1]].tolist() == [0.2, 0.5]
    # Newton's method ends with corrections of 1e-9.
    assert_allclose(curve.factors, truss_limit(curve.values), rtol=1e-9)
    assert curve.special == ()
    assert list(curve.table()) == ["rise", "load factor [-]", "unstable directions [-]"]
    assert np.all(curve.unstable == 0)
    assert repr(curve).startswith("<Boundary of the limit point: ok, reached the end; ")
    assert curve.q.shape == (len(curve.values), 2)


@pytest.mark.slow(reason="follows a curve")
def test_boundary_does_not_warn_of_the_end_of_its_first_path():
    by, values = ("rise", "load"), (3.0, 2.9)
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        # The path passes the branch point and ends at the limit point.
        curve = bd.boundary(truss, "branch point", by, values, step=1.0, to=1e4)
    assert curve.status.success


@pytest.mark.slow(reason="one second")
def test_limit_and_branch_of_a_tall_truss_meet_at_a_hilltop():
    # The branch is at L^3 = L0 (L^2 - 1), the limit at L^3 = L0: both at L^2 = 2, L0 = 2 sqrt(2).
    by, settings = ("rise", "load"), {"to": {"crown.y": 0.0}, "step": 0.2}
    with pytest.warns(bd.BeamdaeWarning, match="limit points lie on unstable paths"):
        limits = bd.boundary(truss, "limit point", by, (2.4, 3.0), **settings)
    assert_allclose(limits.factors, truss_limit(limits.values), rtol=1e-9)
    # Taller trusses buckle sideways before their limit load.
    assert_array_equal(limits.unstable, np.where(limits.values > np.sqrt(7.0), 1, 0))
    assert "on unstable paths" in repr(limits)
    branches = bd.boundary(truss, "branch point", by, (3.0, 2.0), **settings)
    for curve, count in ((limits, 1), (branches, 2)):
        assert curve.status.success
        assert len(curve.special) == count
        hilltop = curve.special[-1]
        assert hilltop.kind == "hilltop"
        # Interpolated over 1e-3 of a step.
        assert hilltop.value == pytest.approx(np.sqrt(7.0), rel=1e-7)
        assert hilltop.factor == pytest.approx(2.0 * STIFFNESS, rel=1e-7)
    # L0 = L^3 / (L^2 - 1) is smallest at L^2 = 3: two branch points merge.
    turning = branches.special[0]
    assert turning.kind == "turning point"
    assert turning.value == pytest.approx(np.sqrt(27.0 / 4.0 - 1.0), rel=1e-7)
    height = np.sqrt(2.0)
    load = 2.0 * STIFFNESS * (np.sqrt(27.0 / 4.0) / np.sqrt(3.0) - 1.0) * height
    assert turning.factor == pytest.approx(load, rel=1e-7)


@pytest.mark.slow(reason="one second")
@pytest.mark.parametrize("number", [1, 2])
def test_limit_points_of_a_supported_truss_merge_at_a_cusp(number):
    # The stiffness 2 k (1 - L0 / L^3) + c is smallest at y = 0, where it vanishes for
    # L0 = 1 + c / (2 k). There, the support carries the load c * rise.
    rise = np.sqrt((1.0 + 0.1) ** 2 - 1.0)
    support = 200.0

    @bd.model(t_end=1.0)
    def supported(rise=0.6):
        return truss(rise=rise, support=support, supported=True)

    curve = bd.boundary(
        supported,
        "limit point",
        ("rise", "load"),
        (0.6, 0.1),
        number=number,
        step=0.1,
        to={"crown.y": -0.6},
    )
    assert curve.status.success
    (cusp,) = curve.special
    assert cusp.kind == "cusp"
    assert cusp.value == pytest.approx(rise, rel=1e-7)
    assert cusp.factor == pytest.approx(support * rise, rel=1e-7)
    # The curve returns along the other limit point.
    assert curve.values[[0, -1]].tolist() == [0.6, 0.6]
    path = bd.equilibrium(supported(), to={"crown.y": -0.6})
    expected = [point.factor for point in path.critical]
    assert_allclose(np.sort(curve.factors[[0, -1]]), np.sort(expected), rtol=1e-8)


@pytest.mark.slow(reason="two seconds")
@pytest.mark.parametrize(
    ("formulation", "height"), [("exact", 1e-3), ("floating frame", 1e-3), ("exact", 1e-5)]
)
def test_buckling_load_over_the_stiffness_of_a_support(formulation, height):
    @bd.model(t_end=1.0)
    def column(spring=1.0):
        section = rectangle(height)
        mech, beam = clamped_beam(section, 8, (0.0, 1.0), name="column", formulation=formulation)
        mech.add(bd.Force("press", beam.end, (0.0, -section.EI)))
        # Long enough to remain horizontal.
        wall = mech.ground.at(1000.0, 1.0)
        mech.add(bd.Spring("side", beam.end, wall, spring * section.EI))
        return mech

    def buckling_load(k):
        # Timoshenko & Gere: tan u = u - u^3 / k, u^2 = P L^2 / EI.
        return brentq(lambda u: k * np.sin(u) - (k * u - u**3) * np.cos(u), 1.57, 4.493) ** 2

    by = ("spring", "load")
    curve = bd.boundary(column, "branch point", by, (0.5, 30.0), step=0.2, to=20.0)
    assert curve.status.success
    # Mesh and compression.
    assert_allclose(curve.factors, [buckling_load(k) for k in curve.values.tolist()], rtol=1e-5)


@pytest.mark.slow(reason="several seconds")
def test_shallow_arch_snaps_only_above_a_cusp():
    @bd.model(t_end=1.0)
    def arch(rise=0.01):
        curve = bd.Parabola(span=1.0, rise=rise)
        return hinged_arch(curve, rectangle(1e-2), 4, 1000.0, formulation="exact")

    def count_limits(rise):
        path = bd.equilibrium(arch(rise=rise), to={"crown.y": -0.01})
        return len(path.critical)

    by, to = ("rise", "load"), {"crown.y": -0.01}
    curve = bd.boundary(arch, "limit point", by, (0.01, 0.004), step=0.2, to=to)
    (cusp,) = curve.special
    assert cusp.kind == "cusp"
    # Two radii of gyration, h / sqrt(3), for a half sine under a load like a half sine.
    assert cusp.value == pytest.approx(1e-2 / np.sqrt(3.0), rel=0.05)
    assert [count_limits((1.0 + d) * cusp.value) for d in (-0.01, 0.01)] == [0, 2]


@pytest.mark.slow(reason="several seconds")
def test_cusp_of_a_thin_arch():
    """Differences of nearly straight shapes are accurate to 1e-6 of the strains only."""

    @bd.model(t_end=1.0)
    def arch(rise=1e-2, height=1e-2):
        curve = bd.Parabola(span=1.0, rise=rise)
        return hinged_arch(curve, rectangle(height), 4, formulation="exact")

    cusps = []
    for height in (1e-3, 1e-5):
        values, to = (height, 0.4 * height), {"crown.y": -height}
        parameters, by = {"height": height}, ("rise", "load")
        curve = bd.boundary(arch, "limit point", by, values, parameters=parameters, step=0.2, to=to)
        assert curve.status.success
        (cusp,) = curve.special
        assert cusp.kind == "cusp"
        cusps.append((cusp.value / height, cusp.factor / height))
    # Shear and the slope of the arch change the ratios by (h / L)^2.
    assert_allclose(cusps[1], cusps[0], rtol=2e-5)


@pytest.mark.slow(reason="several seconds")
def test_branch_point_of_an_arch_over_its_opening():
    """The motion in the mode was kept, although it contains a part of symmetric motions."""

    @bd.model(t_end=1.0)
    def arch(angle=1.2):
        curve = bd.Arc(-1.0, 2.0 * angle, start=(-np.sin(angle), 0.0), angle=angle)
        return hinged_arch(curve, SECTION, formulation="exact")

    by, to = ("angle", "load"), {"crown.y": 0.1}
    curve = bd.boundary(arch, "branch point", by, (1.2, 0.8), step=0.1, to=to)
    assert curve.status.success
    # At least ten steps; twice as many if they are limited by its curvature.
    assert len(curve.values) <= 20
    path = bd.equilibrium(arch(angle=0.8), to=to)
    first = next(point.factor for point in path.critical if point.kind == "branch point")
    assert curve.factors[-1] == pytest.approx(first, rel=1e-7)


@pytest.mark.slow(reason="several seconds")
def test_flutter_load_of_a_column_with_damped_material():
    @bd.model(t_end=1.0)
    def column(damping=1e-2):
        section = rectangle(1e-2, damping=damping)
        mech, beam = clamped_beam(section, 4, (0.0, 1.0), name="column", formulation="exact")
        mech.add(bd.Force("press", beam.end, (0.0, -section.EI), axes="body"))
        return mech

    by = ("damping", "load")
    curve = bd.boundary(column, "flutter point", by, (1e-2, 1e-5), step=0.5, to=25.0)
    assert curve.status.success
    # Vanishing damping halves the load of Beck's column, to 10.94 (Bolotin & Zhinzher, Int. J.
    # Solids Struct. 5 (1969) 965); compression and shear.
    assert curve.factors[-1] == pytest.approx(10.94, rel=1e-3)
    assert np.all(np.diff(curve.factors) < 0.0)


@pytest.mark.slow(reason="several seconds")
def test_flutter_load_over_damping():
    # Equal dampers c: 41/28 + c^2 / 2, see test_equilibrium_sensitivities.
    ziegler = bd.model(t_end=1.0)(mechanisms.ziegler)
    by = ("damping", "load")
    curve = bd.boundary(ziegler, "flutter point", by, (1.0, 0.01), step=0.1, to=3.0)
    assert curve.status.success
    # Bisection to 1e-8; growth up to a fraction of the frequency counts as rounding.
    assert_allclose(curve.factors, 41.0 / 28.0 + 0.5 * curve.values**2, rtol=1e-6)
    assert np.all(curve.unstable == 0)


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ({"model": truss()}, "must be a model function.*decorate .* with bd.model"),
        ({"kind": "limit"}, "kind must be"),
        ({"by": ("rise", "height")}, "by must be"),
        ({"by": ("rize", "load")}, "'rize', which is not a numeric parameter of truss"),
        ({"values": (0.2, 0.2)}, "values must be"),
        ({"number": 3}, "has 1 of 3 points of the kind 'limit point'"),
        ({"loads": []}, "got 0 stages"),
        ({"step": 0.0}, "step must be"),
    ],
)
def test_arguments_are_checked(arguments, message):
    settings = {
        "model": truss,
        "kind": "limit point",
        "by": ("rise", "load"),
        "values": (0.2, 0.4),
        "to": {"crown.y": 0.0},
    }
    if "loads" in arguments:
        settings["to"] = 1.0
    with pytest.raises(bd.BeamdaeError, match=message):
        bd.boundary(**(settings | arguments))


@pytest.mark.slow(reason="follows a curve")
def test_curve_ends_where_no_model_exists():
    @bd.model(t_end=1.0)
    def limited(rise=0.2):
        if rise > 0.3:
            raise bd.BeamdaeError("limited: rise must be at most 0.3.")
        return truss(rise=rise)

    by, to = ("rise", "load"), {"crown.y": 0.0}
    curve = bd.boundary(limited, "limit point", by, (0.2, 0.4), step=0.2, to=to)
    assert curve.status.kind == "failed"
    assert "rise must be at most 0.3" in curve.status.sentence
    assert curve.values[-1] == pytest.approx(0.3, abs=1e-3)
    short = bd.boundary(truss, "limit point", by, (0.2, 0.4), step=0.05, max_points=3, to=to)
    assert short.status.kind == "limited"
    assert len(short.values) == 3


@pytest.mark.slow(reason="follows a curve")
def test_branch_points_end_where_symmetry_ends():
    @bd.model(t_end=1.0)
    def column(moment=0.0):
        mech, beam = clamped_beam(SECTION, 4, (0.0, 1.0), name="column")
        mech.add(bd.Force("press", beam.end, (0.0, -SECTION.EI)))
        mech.add(bd.Moment("bend", beam.end, moment * SECTION.EI))
        return mech

    by, settings = ("moment", "load"), {"step": 0.2, "to": 4.0, "loads": ["press"]}
    curve = bd.boundary(column, "branch point", by, (0.0, 0.01), **settings)
    assert curve.status.kind == "failed"
    assert "loses its symmetry" in curve.status.sentence
    assert curve.values[-1] < 1e-4


@bd.model(t_end=1.0)
def braced_column(stiffness=600.0):
    """Column with hinged ends and a spring in the middle; EI = 4.725 N m^2, 1 m."""
    section = rectangle(0.003, 0.03, material=bd.Material(70e9, 0.3, 2700.0))
    mech, column = hinged_beam(section, 4, name="column", formulation="exact")
    mech.add(bd.PointOnLine("guide", mech.ground.at(1.0, 0.0), column.end, (1.0, 0.0)))
    mech.add(bd.Force("press", column.end, (-10.0, 0.0)))
    mech.add(bd.Bushing("brace", mech.ground.at(0.5, 0.0), column.at(0.5), ky=stiffness))
    return mech


@pytest.mark.slow(reason="a second")
def test_regression_two_branch_points_of_a_column_are_no_hilltop():
    """Rounding errors of the axial motion in bending modes counted as work of the load."""
    by = ("stiffness", "load")
    curve = bd.boundary(braced_column, "branch point", by, (700.0, 800.0), step=0.5, to=18.3)
    (point,) = curve.special
    assert point.kind == "double branch point"
    # With a brace of 16 pi^2 EI / L^3, the column buckles in one or two half waves.
    assert point.value == pytest.approx(16.0 * np.pi**2 * 4.725, rel=2e-3)
    assert point.factor == pytest.approx(0.4 * np.pi**2 * 4.725, rel=2e-3)


def test_boundary_with_other_parameters():
    settings = {"to": {"crown.y": -0.6}, "step": 1.0}
    arguments = "limit point", ("rise", "load"), (0.6, 0.55)
    changes = {"support": 100.0, "supported": True}
    curve = bd.boundary(truss, *arguments, parameters=changes, **settings)

    @bd.model(t_end=1.0)
    def supported(rise=0.6):
        return truss(rise=rise, **changes)

    assert_allclose(curve.factors, bd.boundary(supported, *arguments, **settings).factors)
    with pytest.raises(bd.BeamdaeError, match="contains 'rise', the parameter to follow; omit it"):
        bd.boundary(truss, *arguments, parameters={"rise": 0.2}, **settings)
