"""Critical loads of validation/benchmarks: references, and paths beside the scoreboard."""

import numpy as np
import pytest
from benchmarks.critical_loads.case import BRANCH, LIMIT, CriticalLoad, stiffness
from benchmarks.critical_loads.cases import CASES
from benchmarks.critical_loads.curved_structures import BentStructure, sine_arch, sine_arch_loads
from benchmarks.critical_loads.frame_stability import BeamStiffness, Column, divergence_loads
from scipy.optimize import brentq
from scipy.special import jv, yv

SLENDER = 1e5
# Their references integrate along the structure.
SLOW_GROUPS = {"arch", "bent frame", "own weight", "tapered", "follower load"}
# Other meshes and slenderness than those of the scoreboard, on which paths were wrong.
OTHER_PATHS = [
    ("column, clamped, free", 1e5, 32, "exact"),
    ("column, hinged, hinged", 1e5, 16, "floating frame"),
    ("column, hinged, hinged", 1e1, 8, "floating frame, Green's strain"),
    ("ring, quarter, central pressure", 1e4, 8, "floating frame"),
    # Rounding of positions, of differences of forces, and of constraints moved these loads.
    ("frame, portal, hinged, sway", 1e5, 4, "exact"),
    ("frame, portal, hinged, stiff beam", 1e1, 32, "exact"),
    ("frame, column with cross-arm on springs", 1e3, 32, "exact"),
    ("follower load, Reut", 1e4, 16, "floating frame"),
    # Samples were so close to the branch point that rounding moved them along the critical mode:
    # the errors were 4.6e-4 and 4.9e-5, six and seventeen times the tolerance.
    ("column, hinged, half of the load at mid-height", 1e5, 4, "exact"),
    ("arch, 180 degrees, hinged, load at the crown", 1e4, 16, "exact"),
    # Two modes become critical together: bisection had errors of 1e-5, or passed two more points.
    ("ring, whole, fluid pressure", 1e3, 16, "exact"),
    ("ring, whole, fluid pressure", 1e2, 32, "floating frame"),
]


@pytest.mark.parametrize(
    "case",
    [
        pytest.param(
            case,
            id=name,
            marks=[pytest.mark.slow(reason="shooting")] if case.group in SLOW_GROUPS else [],
        )
        for name, case in CASES.items()
        if case.published is not None
    ],
)
def test_reference_of_slender_structure_matches_published_load(case):
    loads = case.reference(SLENDER, "exact")
    assert loads[0].load == pytest.approx(case.published, rel=case.digits)


@pytest.mark.slow(reason="0.5 to 3 s each")
@pytest.mark.parametrize(("name", "slenderness", "elements", "formulation"), OTHER_PATHS)
def test_path_has_the_exact_critical_points(name, slenderness, elements, formulation):
    rows = list(CASES[name].rows(slenderness, elements, formulation))
    assert rows
    assert all(row["verdict"] == "ok" for row in rows), rows


@pytest.mark.slow(reason="half a second and more")
def test_loads_of_thin_column_are_not_lost_in_rounding():
    # L / h = 1e5: eigenvalues of the stiffness alone gave errors of 1e-3, and 32 elements were
    # stable beyond both loads.
    case = CASES["column, clamped, free"]
    path = case.solve(SLENDER, 16, "exact")
    loads = [point.load for point in case.reference(SLENDER, "exact")]
    assert [point.factor for point in path.critical] == pytest.approx(loads, rel=1e-7)
    assert path.unstable[-1] == len(loads)


@pytest.mark.slow(reason="a quarter of a second")
def test_regression_step_that_ends_at_a_branch_point_is_shortened():
    # The fourth of ten load steps ends at the branch point, 4 EI / R^3. With a tangent from there,
    # which rounding determines, up to 24 more steps were taken, or none converged.
    path = CASES["ring, quarter, dead pressure"].solve(SLENDER, 4, "floating frame")
    assert path.status.success
    assert len(path.q) <= 14
    assert [point.kind for point in path.critical] == ["branch point"]


@pytest.mark.slow(reason="paths of thin structures, a second each")
@pytest.mark.parametrize("slenderness", [1e6, 1e8])
@pytest.mark.parametrize("formulation", ["exact", "floating frame"])
@pytest.mark.parametrize(
    ("name", "elements"),
    [("column, clamped, free", 8), ("column, clamped, free", 32), ("follower load, Beck", 8)],
)
def test_regression_no_column_is_too_thin(name, elements, formulation, slenderness):
    # Rounding of the axial stiffness changed the loads by 1e-2 at L / h = 1e6, where 32 elements
    # gave 2.16 instead of 2.467, and Beck's column fluttered 4 % early. 2e-6: 8 elements.
    case = CASES[name]
    path = case.solve(slenderness, elements, formulation)
    loads = [point.load for point in case.reference(slenderness, "exact")]
    assert [point.factor for point in path.critical] == pytest.approx(loads, rel=2e-6)
    assert path.notes == ()


@pytest.mark.slow(reason="one path, 4 to 8 s")
def test_regression_interpolated_branch_points_are_not_corrected():
    # Rounding moved corrected points along the critical mode: the largest error was 8e-4 to 1.1e-3.
    rows = list(CASES["truss, von Mises, rise of 4 heights"].rows(1e5, 32, "exact"))
    assert max(row["relative"] for row in rows) < 1e-4


@pytest.mark.slow(reason="a fifth of a second")
def test_rows_tell_missed_and_invented_points_and_wrong_kinds(monkeypatch):
    case = CASES["rigid bars, two bars, dead load"]
    first, second = case.reference(1e1, "exact")

    def verdicts(*expected):
        monkeypatch.setattr(type(case), "expected", lambda *_: expected)
        return [row["verdict"] for row in case.rows(1e1, 4, "exact")]

    assert verdicts(first, second) == ["ok", "ok"]
    assert verdicts(first, second, CriticalLoad(BRANCH, 3.5)) == ["ok", "ok", "missed", "unstable"]
    assert verdicts(second) == ["invented", "ok", "unstable"]
    assert verdicts(CriticalLoad(LIMIT, first.load), second) == ["kind", "ok"]
    assert verdicts(CriticalLoad(BRANCH, 1.001 * first.load), second) == ["load", "ok"]


def test_shear_column_follows_haringx_and_engesser():
    # A short hinged column: Haringx with the stretch of the axis, and Engesser for Green's strains.
    beam, euler = stiffness(10.0), np.pi**2
    case = CASES["column, hinged, hinged"]
    factor = 1.0 / beam.GA - 1.0 / beam.EA
    haringx = brentq(lambda P: P * (1.0 + factor * P) - euler, 0.0, 2.0 * euler, xtol=1e-12)
    assert case.reference(10.0, "exact")[0].load == pytest.approx(haringx, rel=1e-10)
    compressed = euler / (1.0 + euler / beam.GA)
    stretch = brentq(lambda e: 0.5 * (1.0 - e * e) - compressed / beam.EA, 0.9, 1.0, xtol=1e-14)
    engesser = stretch * compressed
    assert case.reference(10.0, "green")[0].load == pytest.approx(engesser, rel=1e-10)


@pytest.mark.slow(reason="a fifth of a second")
def test_tapered_column_matches_bessel_functions():
    # EI = EI_0 (1 - c s): M = -P w leads to Bessel functions of order 1 of 2 k sqrt(1 - c s) / c.
    c = 0.8
    column = Column(bending=lambda s: (1.0 - c * s,) * 3)
    (load,) = divergence_loads(column, BeamStiffness(1e12, 1e12), 5.0)

    def condition(P):
        # w from the head: w (head) = 0, and w' = 0 at the foot, with u = 1 - c s.
        k = 2.0 * np.sqrt(P) / c
        top = np.sqrt(1.0 - c)
        a, b = yv(1, k * top), -jv(1, k * top)
        # d/du (sqrt(u) Z_1(k sqrt(u))) = k Z_0(k sqrt(u)) / 2.
        return a * jv(0, k) + b * yv(0, k)

    assert load == pytest.approx(brentq(condition, 1.2, 2.5, xtol=1e-12), rel=1e-8)


@pytest.mark.slow(reason="traces a path by shooting")
def test_shooting_agrees_with_shallow_arch_theory():
    slenderness, rise = 1e2, 3.0
    structure = BentStructure(lambda s: sine_arch(s, rise), drop=lambda s: 0.3 * rise / s)
    (state,) = structure.trace(slenderness)
    theory = sine_arch_loads(slenderness, rise)[0]
    # The theory neglects squares of the slope, 7e-4 here.
    assert state.kind == theory.kind
    assert state.load == pytest.approx(theory.load, rel=1e-3)
