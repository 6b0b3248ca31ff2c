"""Equilibrium paths against closed-form solutions: limit points, branch points, flutter."""

import numpy as np
import pytest
from mechanisms import (
    cantilever,
    clamped_beam,
    free_ball,
    hinged_arch,
    hinged_beam,
    hinged_body,
    rectangle,
    truss,
)
from numpy.testing import assert_allclose

import beamdae as bd

STIFFNESS, RISE = 1000.0, 0.2


def truss_load(y, rise=RISE):
    """Return the load at the height y: 2 k (L0 - L) y / L."""
    free_length, length = np.hypot(1.0, rise), np.hypot(1.0, y)
    return 2.0 * STIFFNESS * (free_length - length) * y / length


# The derivative of the load with respect to y vanishes where L^3 = L0.
HEIGHT = np.sqrt(np.hypot(1.0, RISE) ** (2.0 / 3.0) - 1.0)
LIMIT = truss_load(HEIGHT)


def test_path_of_a_truss_passes_both_limit_points():
    for control in ("displacement", "arc length"):
        path = bd.equilibrium(truss(), to={"crown.y": -0.25}, control=control)
        assert path.status.success
        kinds, rows, factors, moves, _ = zip(*path.critical, strict=True)
        assert kinds == ("limit point",) * 2
        assert moves == ("crown.y",) * 2
        # Tolerance for the rounding of the interpolation at a limit point.
        assert_allclose(factors, [LIMIT, -LIMIT], rtol=1e-11)
        y = path.columns["crown.y [m]"]
        assert_allclose(y[list(rows)], [HEIGHT, -HEIGHT], rtol=1e-7)
        assert_allclose(path.factors[:, 0], truss_load(y), rtol=1e-9, atol=1e-9)
        assert y[-1] == pytest.approx(-0.25, abs=1e-14)
        between = (np.abs(y) < 0.999 * HEIGHT).nonzero()[0]
        assert np.all(path.unstable[between] == 1)
        assert np.all(path.unstable[: rows[0]] == 0)
        assert path.stable


def test_path_ends_at_the_limit_load_under_load_control():
    with pytest.warns(bd.BeamdaeWarning, match=r"last converged load factor: 3\.019"):
        path = bd.equilibrium(truss(), to=4.0)
    assert path.status.kind == "failed"
    assert "use control='arc length' to continue past the maximum" in path.status.sentence
    # The last step is a millionth of the largest.
    assert path.factor == pytest.approx(LIMIT, rel=1e-6)
    assert np.all(np.diff(path.factors[:, 0]) > 0.0)


@pytest.mark.parametrize("factor", [1.001, 2.0, 10.0, 30.0, 300.0, 3000.0])
@pytest.mark.parametrize("is_single", [False, True])
def test_load_steps_of_any_size_end_at_the_limit_point(factor, is_single):
    # Steps that lead to the path after the snap-through are shortened.
    to = factor * LIMIT
    path = bd.equilibrium(truss(), to=to, step=to if is_single else None)
    assert path.status.kind == "failed"
    assert 1.0 - 1e-4 < path.factor / LIMIT < 1.0
    assert path.columns["crown.y [m]"][-1] > HEIGHT


@pytest.mark.parametrize("factor", [125.0, 1000.0])
@pytest.mark.parametrize("rise", [0.05, 0.01, 0.001])
def test_regression_the_first_step_by_arc_length_is_short_if_the_path_is_curved(rise, factor):
    """Steps of twice the rise ended beyond both limit points, with no critical point or note."""
    limit = truss_load(np.sqrt(np.hypot(1.0, rise) ** (2.0 / 3.0) - 1.0), rise)
    path = bd.equilibrium(truss(rise=rise), to=factor * limit, control="arc length")
    assert path.status.success
    assert [point.kind for point in path.critical] == ["limit point"] * 2
    assert_allclose([point.factor for point in path.critical], [limit, -limit], rtol=1e-6)


def test_an_interrupted_path_is_returned():
    calls = []

    @bd.model(t_end=1.0)
    def model(load=1.0):
        calls.append(load)
        if len(calls) == 20:
            raise KeyboardInterrupt
        return truss(load=load)

    path = bd.equilibrium(model, over="load", to=2.0, step=0.1, partial="return")
    assert path.status.kind == "interrupted"
    assert 1.0 < path.factor < 2.0
    heights = path.columns["crown.y [m]"]
    assert_allclose(truss_load(heights), path.factors[:, 0], rtol=1e-9)


@pytest.mark.parametrize("load", [1e2, 1e4])
def test_stiffening_structures_have_no_jumps(load):
    section = rectangle(1e-3)
    mech, strip = clamped_beam(section, 4, name="strip", formulation="exact")
    mech.add(bd.Weld("right", mech.ground.at(1.0, 0.0), strip.end))
    mech.add(bd.Force("push", strip.at(0.5), (0.0, -section.EI)))
    for step in (0.1 * load, load):
        path = bd.equilibrium(mech, to=load, step=step)
        assert path.status.success
        assert not path.warnings


def test_run_from_the_limit_point_snaps_through():
    path = bd.equilibrium(truss(load=LIMIT), to={"crown.y": 0.05})
    begin = path.at(path.critical[0].row)
    run = bd.simulate(truss(load=1.001 * LIMIT, damping=60.0), bd.Radau(1e-6), 20.0, start=begin)
    assert run.columns["crown.y [m]"][0] == pytest.approx(HEIGHT, rel=1e-7)
    below = bd.equilibrium(truss(load=1.001 * LIMIT), to=1.0, start={"crown.y": -0.3})
    assert below.stable
    assert run.q[-1] == pytest.approx(below.q[-1], abs=1e-6)
    assert truss_load(below.q[-1][1]) == pytest.approx(1.001 * LIMIT, rel=1e-9)


@pytest.mark.slow(reason="a path of 360 points")
@pytest.mark.parametrize("elements", [3, 6])
def test_regression_rounding_after_a_branch_point_is_no_extremum_of_the_load(elements):
    """The path ended with the status "failed": "an extremum without a critical mode"."""
    length, height = 0.3, 1e-3
    section = rectangle(height)
    mech, strip = hinged_beam(section, elements, length, name="strip", formulation="exact")
    right = mech.ground.at(length, 0.0)
    mech.add(bd.PointOnLine("right", right, strip.end, direction=(1.0, 0.0)))
    mech.add(bd.Force("press", strip.end, (-(np.pi**2) * section.EI / length**2, 0.0)))
    mech.observe("end", strip.end)
    path = bd.equilibrium(mech, to={"end.x": 0.9995 * length}, control="arc length", switch=1)
    assert path.status.success
    # Euler's load, and its growth by half the shortening of an inextensible elastica.
    shortening = 5e-4 - (np.pi * height / length) ** 2 / 12.0
    assert_allclose(path.factor, 1.0 + 0.5 * shortening, atol=1e-4)


def rigid_column():
    """Return a rigid column on a torsion spring; it buckles at P = k / L."""
    mech, stiffness, length = bd.Mechanism(), 10.0, 2.0
    foot, top = mech.ground.at(0.0, 0.0), (0.0, length)
    bar = mech.add(bd.RigidBody("bar", 1.0, 0.1, (0.0, 0.5 * length)))
    mech.add(bd.Revolute("hinge", foot, bar.at(0.0, 0.0)))
    mech.add(bd.TorsionSpring("spring", foot, bar.at(0.0, 0.0), stiffness))
    mech.add(bd.Force("press", bar.at(*top), (0.0, -stiffness / length)))
    mech.observe("top", bar.at(*top))
    return mech


@pytest.mark.parametrize("side", [1, -1])
def test_column_switches_to_the_buckled_path(side):
    path = bd.equilibrium(rigid_column(), to=1.3, switch=side)
    (branch,) = path.critical
    assert branch[0] == "branch point"
    assert branch.factor == pytest.approx(1.0, abs=1e-10)
    bent = slice(branch.row + 1, None)
    angle = path.columns["top.angle [rad]"]
    assert_allclose(path.factors[bent, 0], angle[bent] / np.sin(angle[bent]), rtol=1e-9)
    assert np.all(path.unstable[bent] == 0)
    assert np.sign(angle[-1]) == side * np.sign(
        bd.equilibrium(rigid_column(), to=1.3, switch=1).q[-1, 2]
    )


def test_equal_columns_have_a_branch_point_of_two_modes():
    mech, section = bd.Mechanism(), rectangle(0.002)
    for name, x in (("left", 0.0), ("right", 0.3)):
        line = bd.Line((x, 0.0), (x, 1.0))
        beam = mech.add(bd.Beam(name, line, section, elements=4))
        mech.add(bd.Weld(f"{name} foot", mech.ground.at(x, 0.0), beam.start))
        mech.add(bd.Force(f"{name} load", beam.end, (0.0, -section.EI)))
    path = bd.equilibrium(mech, to=3.0, control="arc length")
    assert [x.description for x in path.critical] == ["branch point of 2 modes"] * 2
    assert_allclose([x.factor for x in path.critical], 0.25 * np.pi**2, rtol=1e-4)


@pytest.mark.parametrize("deviation", [0.0, 1e-12, 1e-9])
@pytest.mark.parametrize(
    "settings",
    [
        {"to": 1.5, "step": 0.25},
        {"to": [0.5, 1.0, 1.5], "step": 0.2},
        {"to": 1.25, "control": "arc length"},
        {"to": {"sled.y": -1.5}, "step": 0.25},
    ],
)
@pytest.mark.parametrize("count", [1, 2, 3])
def test_regression_steps_that_end_at_the_critical_load_pass_it(count, settings, deviation):
    """The tangent was singular at a sample of the path, or halfway between two."""
    mech = bd.Mechanism()
    sled = mech.add(bd.RigidBody("sled", 1.0, 0.1, (0.0, 0.0)))
    mech.add(bd.Prismatic("rail", mech.ground.at(0.0, 0.0), sled.at(0.0, 0.0), (0.0, 1.0)))
    mech.add(bd.Spring("bed", mech.ground.at(0.0, -9.0), sled.at(0.0, 0.0), float(count)))
    mech.observe("sled", sled.at(0.0, 0.0))
    for k in range(count):
        foot, stiffness = sled.at(k, 0.0), 1.0 + (2.0 * (k % 2) - 1.0) * deviation
        bar = mech.add(bd.RigidBody(f"bar {k}", 1.0, 0.1, (k, 0.5)))
        mech.add(bd.Revolute(f"hinge {k}", foot, bar.at(k, 0.0)))
        mech.add(bd.TorsionSpring(f"spring {k}", foot, bar.at(k, 0.0), stiffness))
        mech.add(bd.Force(f"press {k}", bar.at(k, 1.0), (0.0, -1.0)))
    path = bd.equilibrium(mech, **settings)
    assert path.status.success
    assert [point.kind for point in path.critical] == ["branch point"] * count
    assert_allclose([point.factor for point in path.critical], 1.0, atol=2.0 * deviation + 1e-7)
    assert path.unstable[-1] == count


@pytest.mark.slow(reason="a fifth of a second")
def test_unstable_ends_of_load_control_warn():
    with pytest.warns(bd.BeamdaeWarning, match="since the branch point at load factor 1, where"):
        path = bd.equilibrium(rigid_column(), to=1.3)
    assert "switch=1" in path.instability
    assert path.instability in path.warnings
    (branch,) = path.critical
    assert path.at(branch.row).instability == ""
    assert path.at(branch.row + 1).instability != ""
    # Returns to stable equilibria; prescribes a displacement; follows the crossing path.
    assert bd.equilibrium(rigid_column(), to=[1.3, 0.5]).instability == ""
    unloaded = bd.equilibrium(truss(), to={"crown.y": 0.1})
    assert unloaded.unstable[-1] == 1
    assert unloaded.instability == ""
    assert bd.equilibrium(rigid_column(), to=1.3, switch=1).instability == ""


def leaning_bar():
    """Return an upright bar of length 1 with a side spring: P = 10 cos(angle) is unstable."""
    mech, bob = free_ball((0.0, 1.0), name="bob")
    mech.add(bd.Distance("rod", mech.ground.at(0.0, 0.0), bob.point))
    mech.add(bd.Spring("side", mech.ground.at(-50.0, 1.0), bob.point, 10.0))
    mech.add(bd.Force("push", bob.point, (0.0, -1.0)))
    return mech


@pytest.mark.slow(reason="a fifth of a second")
def test_regression_unstable_ends_by_arc_length_warn_if_no_critical_point_shows_them():
    with pytest.warns(bd.BeamdaeWarning, match="unstable in 1 direction since the branch point at"):
        path = bd.equilibrium(leaning_bar(), to={"bob.x": 0.5}, switch=1)
    assert "where the path switches; simulate" in path.instability
    assert path.factor < path.critical[0].factor
    # The branch point that the path passes is visible.
    for control in ("arc length", "displacement"):
        path = bd.equilibrium(leaning_bar(), to={"bob.x": 0.5}, control=control)
        assert path.unstable[-1] == 1
        assert path.critical
        assert path.instability == ""


@pytest.mark.slow(reason="half a second")
def test_regression_unstable_ends_at_the_load_of_a_path_by_arc_length_warn():
    """The end was returned as the equilibrium under the load, in silence."""
    span, rise = 0.4, 0.012
    radius = (0.25 * span**2 + rise**2) / (2.0 * rise)
    half = np.arcsin(0.5 * span / radius)
    curve = bd.Arc(radius, 2.0 * radius * half, start=(0.5 * span, 0.0), angle=np.pi - half)
    mech = hinged_arch(curve, rectangle(), 2, 100.0, at=0.52, formulation="exact")
    with pytest.warns(bd.BeamdaeWarning, match="unstable in 2 directions since the limit point at"):
        path = bd.equilibrium(mech, to=0.9, control="arc length")
    assert path.status.success
    assert path.instability in path.warnings
    # The load is reached before the limit point.
    assert bd.equilibrium(mech, to=0.5, control="arc length").instability == ""


@pytest.mark.parametrize(
    ("wind", "settings"),
    [(1.0, {"loads": ["wind"], "control": "arc length"}), (0.0, {"loads": []})],
)
def test_regression_paths_that_begin_unstable_warn(wind, settings):
    mech, rod = hinged_body(1.0, 0.1, (0.0, 1.0), name="rod", gravity=9.81)
    mech.add(bd.Force("wind", rod.at(0.0, 1.0), (wind, 0.0)))
    with pytest.warns(bd.BeamdaeWarning, match="unstable in 1 direction from the beginning"):
        bd.equilibrium(mech, **settings)


TALL = 3.0
# The tall truss buckles sideways where L^3 = L0 (L^2 - 1).
LENGTHS = np.roots([1.0, -np.hypot(1.0, TALL), 0.0, np.hypot(1.0, TALL)])
SIDEWAYS = np.sort(truss_load(np.sqrt(LENGTHS[LENGTHS > 1.0] ** 2 - 1.0), TALL))


def branch_factors(path):
    return [one.factor for one in path.critical if one.kind == "branch point"]


@pytest.mark.slow(reason="half a second and more")
@pytest.mark.parametrize("settings", [{}, {"control": "arc length", "step": 0.3}])
def test_tall_truss_has_four_branch_points(settings):
    path = bd.equilibrium(truss(rise=TALL), to={"crown.y": -3.5}, **settings)
    low, high = SIDEWAYS
    # A limit point and a branch point passed in one step are both reported.
    assert_allclose(branch_factors(path), [low, high, -high, -low], rtol=1e-7)
    assert len(path.critical) == 6


@pytest.mark.slow(reason="half a second and more")
@pytest.mark.parametrize("step", [0.1, 0.2, 0.3, 0.5, 0.7])
def test_closed_secondary_path_is_left_by_a_second_switch(step):
    arguments = {"model": truss(rise=TALL), "to": {"crown.y": -3.5}, "step": step}
    low = SIDEWAYS[0]
    with pytest.warns(bd.BeamdaeWarning, match=r"the path is closed.*switch=\[1, 1\]"):
        around = bd.equilibrium(**arguments, switch=1)
    assert around.status.kind == "failed"
    # At branch points of this path, the load factor turns and no eigenvalue changes sign.
    assert_allclose(branch_factors(around), [low, -low, low], rtol=1e-7)
    through = bd.equilibrium(**arguments, switch=[1, 1])
    assert through.status.success
    assert through.stable
    assert_allclose(branch_factors(through), [low, -low], rtol=1e-7)
    secondary = slice(through.critical[0].row + 1, through.critical[1].row)
    x, y = (through.columns[f"crown.{k} [m]"][secondary] for k in "xy")
    assert np.all(np.abs(x) > 1e-3)
    # Horizontal forces of the springs are in balance, relative to their stiffness.
    pulls = [(1.0 - np.hypot(1.0, TALL) / np.hypot(x - foot, y)) * (x - foot) for foot in (-1, 1)]
    assert_allclose(np.sum(pulls, axis=0), 0.0, atol=1e-9)


@pytest.mark.parametrize("unit", [1e-6, 1e-3, 1e3, 1e6])
def test_regression_paths_of_point_masses_on_springs_do_not_depend_on_the_unit_of_length(unit):
    """Their characteristic length was 1 m: small trusses left the path, large ones did not end."""

    def solve(unit, **arguments):
        mech = truss(TALL * unit, STIFFNESS / unit, span=unit)
        path = bd.equilibrium(mech, to={"crown.y": -3.5 * unit}, control="arc length", **arguments)
        assert path.status.success, path.status.sentence
        return path

    for arguments in ({}, {"switch": [1, 1]}):
        path, reference = (solve(x, **arguments) for x in (unit, 1.0))
        assert [x.kind for x in path.critical] == [x.kind for x in reference.critical]
        factors = [[x.factor for x in one.critical] for one in (path, reference)]
        assert_allclose(*factors, rtol=1e-6)


def test_path_exports_a_table_and_files(tmp_path):
    path = bd.equilibrium(truss(), to={"crown.y": -0.25})
    table = path.table()
    assert list(table.columns) == [
        "load factor [-]",
        "crown.x [m]",
        "crown.y [m]",
        "unstable directions [-]",
        "point",
    ]
    assert (table["point"] == "limit point").sum() == 2
    assert path.to_csv(tmp_path / "path.csv").read_text().startswith("load factor [-],crown.x [m]")
    assert '"kind": "limit point"' in (tmp_path / "path.json").read_text()
    assert len(path.coordinates()) == len(table)
    with pytest.warns(bd.BeamdaeWarning, match="stopped at the maximum of 3 points"):
        short = bd.equilibrium(truss(), to={"crown.y": -0.25}, max_points=3)
    assert short.status.kind == "limited"
    assert len(short.q) == 3


def test_path_has_a_repr_and_columns():
    path = bd.equilibrium(truss(), to={"crown.y": -0.25})
    assert repr(path).startswith("<Equilibrium: ok, reached the end; ")
    assert "limit point at 3.01915" in repr(path)
    heights = path["crown.y"]
    assert heights.index.name == "load factor [-]"
    assert_allclose(truss_load(heights.to_numpy()), heights.index, rtol=1e-9, atol=1e-9)
    assert list(path["crown"].columns) == ["crown.x [m]", "crown.y [m]"]
    with pytest.raises(bd.BeamdaeError, match=r"Equilibrium: there is no column 'crwn'.*crown"):
        path["crwn"]
    with pytest.raises(bd.BeamdaeError, match="Equilibrium: there is no column 3"):
        path.plot(3)


@pytest.mark.slow(reason="a fifth of a second")
def test_plot_is_dashed_where_the_path_is_unstable(tmp_path):
    path = bd.equilibrium(truss(), to={"crown.y": -0.25})
    plot = path.plot()
    (axis,) = plot.figure.axes
    first, between, last, *marks = axis.lines
    rows = [one.row for one in path.critical]
    assert [x.is_dashed() for x in (first, between, last)] == [False, True, False]
    assert_allclose(between.get_xdata(), path.columns["crown.y [m]"][rows[0] : rows[1] + 1])
    assert_allclose([x.get_ydata()[0] for x in marks], [LIMIT, -LIMIT], rtol=1e-9)
    assert plot.save(tmp_path / "path.png").stat().st_size > 5000
    assert len(path.plot("crown").figure.axes) == 2
    (axis,) = path.plot("crown.x", x="crown.y").figure.axes
    assert_allclose(axis.lines[1].get_xydata().T[0], between.get_xdata())
    assert_allclose(axis.lines[1].get_ydata(), path["crown.x"].iloc[rows[0] : rows[1] + 1])
    assert axis.get_aspect() == 1.0
    with pytest.raises(bd.BeamdaeError, match=r"Equilibrium.plot: 'crown' selects several columns"):
        path.plot("crown.x", x="crown")


def test_regression_the_load_factor_is_plotted_over_the_only_column_that_changes():
    """The figure had no axes."""
    path = bd.equilibrium(truss(), to=0.1)
    (axis,) = path.plot(x="crown.y").figure.axes
    assert (axis.get_xlabel(), axis.get_ylabel()) == ("crown.y [m]", "load factor [-]")
    assert_allclose(axis.lines[0].get_xdata(), path["crown.y"])


def test_regression_paths_whose_loads_are_zero_have_a_note():
    """A path of eleven equal points was stable at the load factor 1, without a word."""

    def hang(force):
        mech, bob = free_ball((1.0, 0.0), name="bob")
        mech.add(bd.Spring("x", mech.ground.at(0.0, 0.0), bob.point, 10.0))
        mech.add(bd.Spring("y", mech.ground.at(1.0, 1.0), bob.point, 10.0))
        mech.add(bd.Force("push", bob.point, (mech.input("force", default=force), 0.0)))
        return mech

    with pytest.warns(bd.BeamdaeWarning, match="because all scaled loads are zero at t = 0 s"):
        assert bd.equilibrium(hang(0.0)).status.success
    assert not bd.equilibrium(hang(1e-9)).warnings


@pytest.mark.parametrize("ratio", [1.0, 1e2, 1e4, 1e-4])
@pytest.mark.parametrize("height", [0.2, 0.3])
def test_regression_arc_length_does_not_depend_on_the_size_of_other_trusses(ratio, height):
    """From 1:1000 on, the limit points of the small truss were skipped or called branch points."""
    mech = bd.Mechanism()
    for k, (size, load, rise) in enumerate([(1.0, 1.0, 0.2), (ratio, 0.7, height)]):
        middle = 3.0 * k * max(1.0, ratio)
        crown = mech.add(bd.PointMass(f"crown {k}", 1.0, at=(middle, rise * size)))
        for side in (-1.0, 1.0):
            foot = mech.ground.at(middle + side * size, 0.0)
            mech.add(bd.Spring(f"bar {k} {side:+g}", foot, crown.point, 1000.0))
        mech.add(bd.Force(f"load {k}", crown.point, (0.0, -load * size)))
    path = bd.equilibrium(mech, to=6.0, control="arc length")
    assert path.status.success
    # Two springs k of length l from +-1 to (0, y): F = 2 k y (1 - l / sqrt(1 + y^2)).
    y = np.linspace(0.0, 0.2, 100001)
    limit = np.max(2000.0 * y * (np.sqrt(1.04 / (1.0 + y**2)) - 1.0))
    other = limit / 0.7
    signs = {
        0.2: [limit, -limit, other, -limit, limit, -other, limit, -limit],
        0.3: [limit, -limit],
    }
    assert [point.kind for point in path.critical] == ["limit point"] * len(signs[height])
    assert_allclose([point.factor for point in path.critical], signs[height], rtol=1e-6)


@pytest.mark.slow(reason="half a second")
def test_regression_strains_of_a_bent_beam_are_the_suspected_cause_of_a_limit_point():
    """The remedy was the arc length, although exact strains reach the whole load."""

    def bend(**settings):
        section = rectangle(0.003, 0.04)
        mech = cantilever(4, 0.3, section, (-1000.0, -300.0), name="leaf", **settings)
        return bd.equilibrium(mech)

    # A second formulation, and a second mesh of floating frames.
    assert bend(strain="exact").status.success
    assert bend(formulation="exact").status.success
    failed = bend(strain="green")
    assert not failed.status.success
    (sentence,) = failed.errors.sentences()
    assert 'strain="exact" of leaf' in sentence


@pytest.mark.parametrize("control", ["displacement", "arc length"])
@pytest.mark.parametrize(
    ("height", "kinds"),
    [
        # Branch points that vanish at 0.001448, and limit points that vanish at 0.005004.
        (0.001445, ["limit point", "branch point", "branch point", "limit point"]),
        (0.001455, ["limit point", "limit point"]),
        (0.00496, ["limit point", "limit point"]),
        (0.005003, ["limit point", "limit point"]),
        (0.00502, []),
    ],
)
def test_regression_pairs_of_critical_points_within_one_step_are_found(height, kinds, control):
    # Counts are equal at both ends of the step: only runs with small steps found these points.
    arch = bd.load_model("example:shallow_arch")(height=height)
    target = {"crown.y": -0.02}
    coarse = bd.equilibrium(arch, to=target, control=control, max_points=300)
    fine = bd.equilibrium(arch, to=target, step=1.5e-4)
    assert [point.kind for point in coarse.critical] == kinds
    factors = [point.factor for point in fine.critical]
    assert [point.factor for point in coarse.critical] == pytest.approx(factors, rel=1e-5)


@pytest.mark.parametrize("options", [{"formulation": "exact"}, {"strain": "exact"}])
@pytest.mark.parametrize("number", [1, 2, -2])
def test_paths_switch_where_two_columns_buckle_at_once(number, options):
    """Both critical points of a double branch point lead to crossing paths."""
    mech, section = bd.Mechanism(), rectangle(0.01)
    for name, x in (("left", 0.0), ("right", 1.0)):
        line = bd.Line((x, 0.0), (x, 1.0))
        beam = mech.add(bd.Beam(name, line, section, 4, **options))
        mech.add(bd.Weld(f"{name} clamp", mech.ground.at(x, 0.0), beam.start))
        mech.add(bd.Force(f"{name} load", beam.end, (0.0, -section.EI)))
        mech.observe(name, beam.end)
    path = bd.equilibrium(mech, to=3.0, switch=number)
    assert path.status.success
    assert_allclose([point.factor for point in path.critical], np.pi**2 / 4.0, rtol=1e-4)
    assert max(abs(path["left.x"].iloc[-1]), abs(path["right.x"].iloc[-1] - 1.0)) > 0.5
