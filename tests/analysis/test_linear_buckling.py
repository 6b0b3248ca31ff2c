"""Linear buckling loads, and structures with geometric imperfections, against closed forms."""

import warnings

import mechanisms
import numpy as np
import pytest
from mechanisms import (
    STEEL,
    clamped_beam,
    hinged_arch,
    hinged_beam,
    hinged_body,
    portal_points,
    rectangle,
    welded_frame,
)
from numpy.testing import assert_allclose
from test_slender_structures import FORMULATIONS

import beamdae as bd

KINDS = ["exact", "floating frame"]


def column(height=2e-3, elements=8, formulation="exact", axes="inertial", sign=-1.0):
    """Return a cantilever column under a force of EI / L^2, downwards by default."""
    section = rectangle(height)
    mech, beam = clamped_beam(section, elements, (0.0, 1.0), name="column", formulation=formulation)
    mech.add(bd.Force("press", beam.end, (0.0, sign * section.EI), axes=axes))
    return mech


def portal():
    """Return a portal frame with clamped feet and rigid corners, EI / L^2 on each column."""
    section = rectangle(2e-3)
    mech, beams = welded_frame(portal_points(), section, 6, formulation="exact")
    for side, point in (("left", beams[0].end), ("right", beams[1].end)):
        mech.add(bd.Force(f"on the {side}", point, (0.0, -section.EI)))
    return mech


@pytest.mark.parametrize("formulation", KINDS)
@pytest.mark.parametrize("height", [1e-2, 1e-3, 1e-4])
def test_column_has_the_loads_of_euler(height, formulation):
    result = bd.buckling(column(height, formulation=formulation), n=3)
    # ((2 k - 1) pi / 2)^2; compression and shear lower the third load by up to 1e-3 at 10 mm, and
    # the mesh of floating frames raises it by 1e-6.
    assert_allclose(
        result.factors, ((np.arange(3) + 0.5) * np.pi) ** 2, rtol=2e-3 if height == 1e-2 else 3e-5
    )
    assert result.warnings == ()
    assert all(name.startswith("column.") for name in result.moves)


def test_shapes_are_those_of_euler():
    result = bd.buckling(column(), n=1)
    positions = {f"column.x{k}": 1.0 - np.cos(0.5 * np.pi * k / 24) for k in range(25)}
    names = bd.equations_of_motion(column()).q_names
    shape = dict(zip(names, result.shapes[0], strict=True))
    expected = np.array(list(positions.values()))
    computed = np.array([shape[name] for name in positions])
    assert_allclose(computed / computed[-1], expected, atol=1e-4)


def test_portal_sways_at_the_load_of_theory():
    # Sway, feet clamped, corners rigid: k cot k = -6 for equal members.
    result = bd.buckling(portal(), n=2)
    k = np.sqrt(result.factors[0])
    assert k / np.tan(k) == pytest.approx(-6.0, rel=2e-3)


@pytest.mark.parametrize("rise", [0.1, 0.3])
def test_factors_of_an_arch_are_near_the_first_critical_point(rise):
    # The arch bends before it buckles, by a fifth of its rise.
    radius = (0.25 + rise**2) / (2.0 * rise)
    angle = 2.0 * np.arcsin(0.5 / radius)
    arc = bd.Arc(radius, radius * angle, start=(1.0, 0.0), angle=np.pi - 0.5 * angle)
    mech = hinged_arch(arc, rectangle(2e-3), formulation="exact")
    with pytest.warns(bd.BeamdaeWarning, match="displacements before buckling"):
        result = bd.buckling(mech, n=1)
    path = bd.equilibrium(mech, to=40.0, control="arc length", max_points=20)
    assert result.factors[0] == pytest.approx(path.critical[0].factor, rel=0.2)


def test_few_factors_are_those_among_many():
    # Matrices are sparse if few factors are requested, and dense otherwise.
    mech = column(elements=32)
    few, many = (bd.buckling(mech, n=n).factors for n in (3, 150))
    assert len(many) > 3
    assert_allclose(few, many[:3], rtol=1e-7)


@pytest.mark.parametrize("formulation", KINDS)
def test_regression_signs_of_symmetric_shapes_do_not_depend_on_rounding(formulation):
    # Both ends rotate equally far; the one that rounding made larger chose the sign.
    section = rectangle(2e-3)
    mech, beam = hinged_beam(section, 8, name="column", formulation=formulation)
    mech.add(bd.PointOnLine("roller", mech.ground.at(0.0, 0.0), beam.end))
    mech.add(bd.Force("press", beam.end, (-section.EI, 0.0)))
    result = bd.buckling(mech, n=3)
    for shape in result.shapes / bd.equations_of_motion(mech).position_scales:
        first = np.flatnonzero(np.abs(shape) >= (1.0 - 1e-6) * np.max(np.abs(shape)))[0]
        assert shape[first] == pytest.approx(1.0, abs=1e-6)


def test_tension_does_not_buckle():
    with pytest.warns(bd.BeamdaeWarning, match="0 of 2 buckling loads; under reversed loads"):
        result = bd.buckling(column(sign=1.0), n=2)
    assert len(result) == 0
    (warning,) = result.warnings
    assert warning.startswith("buckling: the structure has 0 of 2 buckling loads; under reversed")
    assert "factor 2.467" in warning


def test_zero_loads_are_the_reason_for_no_buckling_loads():
    with pytest.warns(bd.BeamdaeWarning, match="0 of 2 buckling loads; all scaled loads are zero"):
        result = bd.buckling(column(sign=0.0), n=2)
    assert result.reason.startswith("all scaled loads are zero at t = 0 s")
    assert bd.buckling(column(), n=2).reason == ""


def test_displacements_before_buckling_are_warned_of():
    # A transverse force bends the column before it buckles.
    mech = column()
    mech.add(bd.Force("wind", mech.parts["column"].end, (0.05, 0.0)))
    result = bd.buckling(mech, n=1)
    assert any("displacements before buckling are not negligible" in x for x in result.warnings)


@pytest.mark.parametrize("tilt", [1e-16, 1e-9, 1e-7, 1e-5, 1e-4])
def test_regression_tilts_of_rounding_are_no_displacements_before_buckling(tilt):
    """A column drawn by cos(pi / 2) had a warning of a limit point at 1.2 times the factor."""
    strip = rectangle(5e-3)
    mech, _ = clamped_beam(strip, 8, (tilt, 1.0), name="column", gravity=9.81, formulation="exact")
    result = bd.buckling(mech, n=1)
    assert result.warnings == ()
    # Timoshenko & Gere: q L^3 = 7.837 EI; linear buckling of the tilted column is 0.3 % lower.
    load = 9.81 * STEEL.rho * 0.02 * 5e-3
    assert_allclose(result.factors * load, 7.837 * strip.EI, rtol=3e-3)


@pytest.mark.parametrize("rise", [3.5e-3, 4e-3, 4.5e-3, 5e-3, 6e-3, 9e-3])
def test_regression_factors_of_shallow_arches_are_compared_with_the_path(rise):
    """Factors from the equilibrium at half the load agreed by chance where they were 5 % unsafe."""
    span = 0.4
    curve = bd.Curve(lambda x: rise * np.sin(np.pi * x / span), x=(0.0, span))
    mech = hinged_arch(curve, rectangle(2e-3), 6, 100.0, strain="exact")
    true = bd.equilibrium(mech, to={"crown.y": 0.2 * rise}).critical[0].factor
    result = bd.buckling(mech, n=1)
    if abs(result.factors[0] / true - 1.0) <= 0.03:
        assert rise == 4.5e-3
        assert result.warnings == ()
        return
    (warning,) = result.warnings
    printed = float(warning.partition("of the path is at ")[2].partition(",")[0])
    assert printed == pytest.approx(true, rel=1e-4)


def test_follower_loads_are_warned_of():
    result = bd.buckling(column(axes="body"), n=2)
    assert any("may flutter" in warning for warning in result.warnings)


def test_loads_scale_by_name():
    mech = column()
    mech.add(bd.Force("more", mech.parts["column"].end, (0.0, -1.0)))
    alone = bd.buckling(mech, n=1, loads=["press"])
    section = rectangle(2e-3)
    expected = 0.25 * np.pi**2 - 1.0 / section.EI
    assert alone.factors[0] == pytest.approx(expected, rel=1e-5)
    assert alone.loads == ("press",)


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ({"n": 0}, "n must be"),
        ({"loads": [["press"], ["gravity"]]}, "gravity.*no part"),
        ({"loads": ["pres"]}, "loads contain 'pres', but no part has this name"),
        ({"loads": []}, "loads must be one list of names, got 0 stages"),
    ],
)
def test_arguments_are_checked(arguments, message):
    with pytest.raises(bd.BeamdaeError, match=f"^buckling: .*{message}"):
        bd.buckling(column(), **arguments)


def test_a_mechanism_has_no_buckling_load():
    mech, body = hinged_body(1.0, 0.1, (0.0, 1.0), name="bob")
    mech.add(bd.Force("press", body.at(0.0, 1.0), (0.0, -1.0)))
    with pytest.raises(bd.BeamdaeError, match=r"bob\.angle can move without stiffness"):
        bd.buckling(mech)


# Structures with geometric imperfections against Koiter's asymptotics and closed forms.


def roorda_frame(**options):
    """Return a right-angle frame of two hinged members of 1 m, the column under EI / L^2."""
    section = rectangle(1e-3)
    points = [(0.0, 0.0), (0.0, 1.0), (1.0, 1.0)]
    mech, (column, _) = welded_frame(points, section, 8, (bd.Revolute, bd.Revolute), **options)
    mech.add(bd.Force("press", column.end, (0.0, -section.EI)))
    mech.observe("corner", column.end)
    return mech


def hinged_column(**options):
    """Return a hinged column of 1 m under EI / L^2."""
    section = rectangle(2e-3)
    mech, column = hinged_beam(section, 8, name="column", **options)
    mech.add(bd.PointOnLine("head", mech.ground.at(0.0, 0.0), column.end))
    mech.add(bd.Force("press", column.end, (-section.EI, 0.0)))
    mech.observe("middle", column.at(0.5))
    return mech


def corner_rotation(path):
    return path.columns["corner.angle [rad]"] - 0.5 * np.pi


@pytest.mark.slow(reason="several seconds")
@FORMULATIONS
def test_knock_down_of_roordas_frame(options):
    # W. T. Koiter, in: Recent Progress in Applied Mechanics, Almqvist & Wiksell (1967), 337: the
    # branch is P / P1 = 1 - 0.3805 phi in the rotation phi of the corner. An imperfection with the
    # rotation e lowers the limit load to the root of (1 - p)^2 = 4 * 0.3805 e p.
    mech = roorda_frame(**options)
    buckling = bd.buckling(mech, n=1)
    assert buckling.factors[0] == pytest.approx(13.886, rel=1e-4)
    for amplitude, tolerance in ((1e-3, 0.03), (1e-4, 0.01)):
        sign = -1.0 if corner_rotation(unloaded(mech, buckling, amplitude))[-1] < 0.0 else 1.0
        frame = bd.imperfect(mech, buckling, sign * amplitude)
        rotation = corner_rotation(bd.equilibrium(frame, to=1e-9))[0]
        path = bd.equilibrium(frame, to={"corner.angle": 0.5 * np.pi + 0.1})
        (limit,) = path.critical
        assert limit.kind == "limit point"
        expected = np.roots([1.0, -2.0 - 4.0 * 0.3805 * rotation, 1.0]).min()
        # The next term of the asymptotic expansion is of order sqrt(e) = 0.045 and 0.014.
        drop = 1.0 - limit.factor / buckling.factors[0]
        assert drop == pytest.approx(1.0 - expected, rel=tolerance)
        # The opposite imperfection has no limit point on this side.
        other = bd.imperfect(mech, buckling, -sign * amplitude)
        path = bd.equilibrium(other, to={"corner.angle": 0.5 * np.pi - 0.05})
        assert path.critical == ()


def unloaded(mech, shape, amplitude):
    return bd.equilibrium(bd.imperfect(mech, shape, amplitude), to=1e-9)


@pytest.mark.slow(reason="one second")
@FORMULATIONS
def test_bow_of_a_column_grows_as_in_theory(options):
    mech = hinged_column(**options)
    mode = bd.buckling(mech, n=1)
    bow = bd.imperfect(mech, mode.shapes[0], amplitude=1e-4)
    path = bd.equilibrium(bow, to=0.9 * np.pi**2)
    middle = np.abs(path.columns["middle.y [m]"])
    # Perry: e / (1 - P / P_E). Compression lowers P_E by 3e-6, with ten times the effect at the
    # end.
    assert_allclose(middle, 1e-4 / (1.0 - path.factors[:, 0] / np.pi**2), rtol=1e-4)
    assert path.stable


@pytest.mark.slow(reason="half a second")
def test_measured_curve_is_the_unloaded_shape():
    mech = hinged_column(formulation="exact")
    x = np.linspace(0.0, 1.0, 41)
    points = np.stack([x, 2e-3 * np.sin(np.pi * x)], axis=-1)
    measured = {"column": bd.Curve(points=points)}
    full = bd.equilibrium(bd.imperfect(mech, measured), to=1e-9)
    # Curvatures of a cubic spline have errors at the ends.
    assert full.columns["middle.y [m]"][-1] == pytest.approx(2e-3, rel=1e-3)
    half = bd.equilibrium(bd.imperfect(mech, measured, amplitude=1e-3), to=1e-9)
    assert half.columns["middle.y [m]"][-1] == pytest.approx(1e-3, rel=1e-3)


def arch_of_60_degrees():
    """Return a hinged arch of 60 degrees and 1 m radius under a downward force at the crown."""
    arc = bd.Arc(-1.0, np.pi / 3.0, start=(-0.5, 0.0), angle=np.pi / 6.0)
    return mechanisms.hinged_arch(arc, rectangle(1e-2), formulation="exact")


@pytest.mark.slow(reason="half a second")
def test_imperfect_statically_indeterminate_arch_has_no_stress():
    # The supports do not move: the imperfection must be compatible with them.
    mech = arch_of_60_degrees()
    mode = bd.buckling(mech, n=1)
    amplitude = 1e-4
    arch = bd.imperfect(mech, mode, amplitude)
    path = bd.equilibrium(arch, to=1e-9)
    forces = path.section_forces("arch").table()
    # Forces are of second order in the amplitude, relative to EA and EI / R.
    section = rectangle(1e-2)
    assert np.max(np.abs(forces["M [N m]"])) < 10.0 * amplitude**2 * section.EI * 100.0
    assert np.max(np.abs(forces["N [N]"])) < 100.0 * amplitude**2 * section.EA
    moved = np.max(np.abs(path.q[0] - bd.equations_of_motion(mech).q0))
    assert moved > 0.5 * amplitude


@pytest.mark.slow(reason="several seconds")
def test_knock_down_curve_of_an_arch():
    # The branch of a symmetric arch is unstable and symmetric: the limit load of an imperfect arch
    # falls with the amplitude to the power 2/3 (Koiter 1945).
    mech = arch_of_60_degrees()
    shape = bd.buckling(mech, n=1)
    amplitudes = [1e-5, 1e-4, 1e-3]
    curve = bd.knock_down(mech, shape, amplitudes, to={"crown.y": -0.02})
    assert set(curve.kinds) == {"limit point"}
    drops = 1.0 - curve.table()["knock-down factor [-]"].to_numpy()
    assert_allclose(np.diff(np.log10(drops)), 2.0 / 3.0, atol=0.05)


@pytest.mark.slow(reason="several paths")
def test_knock_down_does_not_warn_of_the_ends_of_its_paths():
    mech = arch_of_60_degrees()
    sideways, symmetric = bd.buckling(mech, n=2).shapes
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        # The paths pass branch points, and load control ends at the limit points.
        curve = bd.knock_down(mech, symmetric, [1e-4, 2e-4], to=100.0)
    assert curve.kinds == ("branch point",) * 2
    # A path that ends before a limit point has no critical point.
    with pytest.warns(bd.BeamdaeWarning, match="no critical point: .*control='arc length'"):
        bd.knock_down(mech, sideways, [1e-3], to=100.0)
    with pytest.warns(bd.BeamdaeWarning, match="no critical point; choose"):
        bd.knock_down(mech, sideways, [1e-3], to=1e-3)


@pytest.mark.parametrize(
    ("shape", "amplitude", "message"),
    [
        (np.zeros(3), 1e-3, "shape must be the 75 real coordinates"),
        (np.zeros(75), 1e-3, "the shape bends no beam"),
        (np.ones(75), None, "pass amplitude"),
        ({"colum": bd.Line((0.0, 0.0), (0.0, 1.0))}, None, "no beam has this name"),
        ({"column": 3.0}, None, "curve must be"),
        ({"column": bd.Line((0.0, 0.0), (0.0, 2.0))}, None, "must differ by at most 1 %"),
    ],
)
def test_arguments_of_imperfections_are_checked(shape, amplitude, message):
    with pytest.raises(bd.BeamdaeError, match=message):
        bd.imperfect(hinged_column(formulation="exact"), shape, amplitude)
