"""Structures with geometric imperfections against Koiter's asymptotics and closed forms."""

import warnings

import mechanisms
import numpy as np
import pytest
from mechanisms import hinged_beam, rectangle, welded_frame
from numpy.testing import assert_allclose
from test_slender_structures import FORMULATIONS

import beamdae as bd


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


def hinged_arch():
    """Return a hinged arch of 60 degrees and 1 m radius under a downward force at the crown."""
    arc = bd.Arc(-1.0, np.pi / 3.0, start=(-0.5, 0.0), angle=np.pi / 6.0)
    return mechanisms.hinged_arch(arc, rectangle(1e-2), formulation="exact")


@pytest.mark.slow(reason="half a second")
def test_imperfect_statically_indeterminate_arch_has_no_stress():
    # The supports do not move: the imperfection must be compatible with them.
    mech = hinged_arch()
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
    mech = hinged_arch()
    shape = bd.buckling(mech, n=1)
    amplitudes = [1e-5, 1e-4, 1e-3]
    curve = bd.knock_down(mech, shape, amplitudes, to={"crown.y": -0.02})
    assert set(curve.kinds) == {"limit point"}
    drops = 1.0 - curve.table()["knock-down factor [-]"].to_numpy()
    assert_allclose(np.diff(np.log10(drops)), 2.0 / 3.0, atol=0.05)


@pytest.mark.slow(reason="several paths")
def test_knock_down_does_not_warn_of_the_ends_of_its_paths():
    mech = hinged_arch()
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
def test_arguments_are_checked(shape, amplitude, message):
    with pytest.raises(bd.BeamdaeError, match=message):
        bd.imperfect(hinged_column(formulation="exact"), shape, amplitude)
