"""Methods, representations and read-only data of results."""

import dataclasses
import inspect
import re
import warnings
from typing import Any

import numpy as np
import pandas as pd
import pytest
from handed_out import RESULTS, STRIP, list_changes, run
from mechanisms import EARTH, clamped_beam, free_ball, mass_on_rail, rectangle

import beamdae as bd

# Methods besides `table` and `to_csv`, which all results have.
METHODS = {
    "Bode": {"plot", "page"},
    "Boundary": {"plot", "page"},
    "Buckling": {"plot", "page"},
    "Campbell": {"plot", "page"},
    "Equilibrium": {"plot", "page"},
    "EquilibriumSensitivities": set(),
    "Errors": set(),
    "Fit": {"plot", "page"},
    "FrequencyResponse": {"plot", "page"},
    "KnockDown": {"plot", "page"},
    "ModeSensitivities": set(),
    "Modes": {"plot", "page"},
    "Optimization": {"page"},
    "PeriodicMotion": {"plot", "page"},
    "PeriodicSensitivities": set(),
    "ProfileLikelihood": {"plot"},
    "SavedRun": {"plot"},  # A page needs the equations.
    "SectionForces": set(),  # `diagram` plots one of N, Q and M.
    "Sensitivities": set(),
    "Solution": {"plot", "page"},
    "StabilityMargins": set(),
    "SweepResults": {"plot", "page"},
}

# Results without warnings: quantities of another result.
WITHOUT_WARNINGS = {"Errors", "SectionForces"}
OTHER_RESULTS = {"Check", "ExportedFmu", "Gradient"}

NAMES = {"table", "to_csv", "plot", "page"}


def test_every_result_has_a_table_that_can_be_written():
    classes = {name: getattr(bd.results, name) for name in dir(bd.results)}
    methods = {
        name: {x for x in NAMES if hasattr(one, x)}
        for name, one in classes.items()
        if inspect.isclass(one) and hasattr(one, "table")
    }
    assert methods == {name: more | {"table", "to_csv"} for name, more in METHODS.items()}


@pytest.mark.parametrize("name", sorted({*METHODS, *OTHER_RESULTS} - WITHOUT_WARNINGS))
def test_regression_every_result_has_warnings(name):
    """Responses that ended early, boundaries and derivatives had none."""
    result = getattr(bd.results, name)
    names = {field.name for field in dataclasses.fields(result)}
    assert "warnings" in names | set(dir(result))


@pytest.mark.slow(reason="a fifth of a second")
def test_regression_warnings_that_a_call_issues_are_part_of_its_result():
    """A curve that ended at `max_points` had no warning."""

    @bd.model(t_end=1.0)
    def oscillator(frequency=1.0):
        mech, ball = mass_on_rail(name="ball")
        ends = mech.ground.at(-1.0, 0.0), ball.point
        mech.add(bd.Spring("spring", *ends, stiffness=40.0))
        mech.add(bd.Spring("damper", *ends, damping=1.0))
        mech.add(bd.Force("force", ball.point, (bd.sine(1.0, frequency), 0.0)))
        mech.observe("ball", ball.point)
        return mech

    with pytest.warns(bd.BeamdaeWarning, match="maximum of 2 points") as issued:
        curve = bd.frequency_response(
            oscillator, "frequency", (0.5, 1.5), integrator=bd.GeneralizedAlpha(2e-2), max_points=2
        )
    assert [str(x.message) for x in issued] == list(curve.warnings)


@pytest.fixture(scope="module")
def disk():
    """A disk on springs, which rotates about the origin."""
    mech = bd.Mechanism()
    hub = mech.add(bd.RigidBody("hub", mass=2.0, inertia=0.1, center=(0.0, 0.0)))
    pin = hub.at(0.0, 0.0)
    mech.add(bd.Bushing("mount", mech.ground.at(0.0, 0.0), pin, 50.0, 50.0))
    mech.observe("hub", pin)
    return mech


@pytest.fixture(scope="module")
def results(disk):
    run = bd.simulate(disk, bd.GeneralizedAlpha(1e-2), t_end=0.1, output_step=0.01)
    points = (bd.results.BoundaryPoint("cusp", 1.5, 1.5),)
    ok, two = run.status, np.array([1.0, 2.0])
    return {
        "Solution": run,
        "PeriodicMotion": bd.results.PeriodicMotion(run, 0.1),
        "Modes": bd.modes(disk),
        "Campbell": bd.campbell(disk, [1.0, 2.0], 1),
        "KnockDown": bd.results.KnockDown(two, two, ("limit point", ""), 3.0),
        "Boundary": bd.results.Boundary(
            "limit point", "rise", two, two, points, np.zeros(2, int), two[:, None], ok, ("f",)
        ),
        "ProfileLikelihood": bd.results.ProfileLikelihood("E", two, two, 3.84, (0.5, 2.5), {}, ()),
        "FrequencyResponse": bd.results.FrequencyResponse(
            "frequency",
            tuple(bd.results.ResponsePoint(x, 0.1, run, np.ones(1)) for x in (1.0, 2.0)),
            ok,
        ),
    }


CHEAP = (
    *("Solution", "PeriodicMotion", "Modes", "Campbell", "KnockDown", "Boundary"),
    *("ProfileLikelihood", "FrequencyResponse"),
)


@pytest.mark.parametrize("name", CHEAP)
def test_results_write_tables_and_plots(results, name, tmp_path):
    result = results[name]
    path = result.to_csv(tmp_path / "table.csv")
    assert path == tmp_path / "table.csv"
    assert len(pd.read_csv(path)) == len(result.table())
    plot = result.plot(*(["hub.x"] if name == "FrequencyResponse" else []))
    assert plot.save(tmp_path / "plot.png").stat().st_size > 3000
    for wrong in (3, "", "\0"):
        with pytest.raises(bd.BeamdaeError, match="to_csv: path"):
            result.to_csv(wrong)


def test_pictures_show_all_rows_of_the_tables(results):
    for name in CHEAP:
        result = results[name]
        axes = result.plot(*(["hub.x"] if name == "FrequencyResponse" else [])).figure.axes
        if name == "Modes":
            titles = [axis.get_title() for axis in axes]
            assert titles == [result.describe(k) for k in range(len(result.table()))]
        else:
            curves = [line.get_xydata().T for axis in axes for line in axis.lines]
            first, *others = result.table().select_dtypes("number").to_numpy().T
            assert any(np.array_equal(x, (first, y)) for x in curves for y in others), name


@pytest.mark.parametrize("name", CHEAP)
def test_tables_for_spreadsheets_have_the_same_values(results, name, tmp_path):
    result = results[name]
    plain = pd.read_csv(result.to_csv(tmp_path / "plain.csv"))
    for sep, decimal in ((";", ","), (";", "."), ("\t", ","), ("\t", ".")):
        path = result.to_csv(tmp_path / "table.csv", sep=sep, decimal=decimal)
        pd.testing.assert_frame_equal(pd.read_csv(path, sep=sep, decimal=decimal), plain)
        assert decimal == "." or "." not in "".join(path.read_text("utf-8").splitlines()[1:3])
    for signs in ({"sep": "|"}, {"sep": ";", "decimal": ";"}, {"decimal": ","}, {"sep": 3}):
        with pytest.raises(bd.BeamdaeError, match=r"^to_csv: (sep|decimal) "):
            result.to_csv(tmp_path / "table.csv", **signs)


@pytest.mark.parametrize("name", ["Solution", "Modes", "Boundary", "KnockDown"])
def test_pages_are_written(results, name, tmp_path):
    path = results[name].page(tmp_path / "page.html")
    assert path.read_text(encoding="utf-8").startswith("<!DOCTYPE html>")
    with pytest.raises(bd.BeamdaeError, match="page: path"):
        results[name].page(3)


def test_the_page_of_a_saved_run_needs_its_model(results, disk, tmp_path):
    path = results["Solution"].save(tmp_path / "run.beamdae")
    with pytest.raises(bd.BeamdaeError, match="page needs the equations"):
        bd.load(path).page(tmp_path / "page.html")
    assert bd.load(path, disk).page(tmp_path / "page.html").stat().st_size > 10_000


THIN_STRIP = rectangle(0.004, damping=1e-3, material=bd.Material(E=2e9, nu=0.3, rho=1200.0))


def clamped(weight=9.81):
    mech, beam = clamped_beam(THIN_STRIP, 1, 0.3, name="strip", gravity=weight)
    mech.add(bd.Force("push", beam.end, (0.0, bd.sine(0.01, 2.0)), axes="body"))
    mech.observe("tip", beam.end)
    return mech


REPRESENTED = {
    "solution": (lambda: bd.simulate(clamped(), bd.Radau(1e-3), 0.01), r"Solution by Radau.*tip"),
    "mechanism": (clamped, r"Mechanism of 3 parts: strip, clamp, push"),
    "check": (lambda: bd.check(clamped()), r"Check of mechanism: .*; ready to run"),
    "equilibrium": (lambda: bd.equilibrium(clamped()), r"Equilibrium: ok.*load factor 1"),
    "modes": (lambda: bd.modes(clamped(), n=2), r"Modes about reference: 2, [\d.]+ Hz, [\d.]+ Hz"),
    "many modes": (
        lambda: bd.modes(clamped(), n=6),
        r"Modes about reference: 6, .* Hz, .*, \.\.\.",
    ),
    "campbell": (
        lambda: bd.campbell(clamped(weight=0.0), [0.0, 5.0], 2),
        r"Campbell: 2 modes at 2 speeds, 0 to 5 rad/s",
    ),
    "linear model": (
        lambda: bd.linearize(clamped(), inputs=["push"], outputs=["tip"]),
        r"LinearModel about .*inputs: push\.Fx, push\.Fy; outputs: tip\.x, tip\.y, ",
    ),
    "periodic": (lambda: bd.periodic(clamped(), 0.5), r"PeriodicMotion: period 0\.5 s, ok, stable"),
    "section forces": (
        lambda: bd.simulate(clamped(), bd.Radau(1e-3), 0.01).section_forces("strip"),
        r"SectionForces of strip: \d+ sections at 1001 times, 0 to 0\.01 s",
    ),
}


@pytest.mark.parametrize(("make", "pattern"), REPRESENTED.values(), ids=REPRESENTED)
def test_results_are_printed_as_one_short_line(make, pattern):
    text = repr(make())
    assert len(text) < 250
    assert text.isprintable()
    assert re.match(rf"<{pattern}.*>$", text)


def test_long_mechanisms_and_beams_are_abbreviated():
    mech = bd.Mechanism()
    assert repr(mech) == "<Mechanism of 0 parts>"
    for k in range(1000):
        mech.add(bd.PointMass(f"ball {k}", 1.0, at=(0.1 * k, 0.0)))
    assert re.match(r"<Mechanism of 1000 parts: ball 0, .*ball 5, \.\.\.>$", repr(mech))
    beam = bd.Beam("strip", bd.Line((0.0, 0.0), (0.3, 0.0)), THIN_STRIP, elements=2)
    assert repr(beam) == "Beam(name='strip', 0.3 m in 2 elements)"


def test_a_check_is_displayed_as_a_table():
    page = bd.check(clamped())._repr_html_()
    assert "ready to run" in page
    assert page.count("<tr>") == len(str(bd.check(clamped())).splitlines()) - 1


def test_regression_decaying_modes_are_no_vibrations_of_zero_hertz():
    """An overdamped axial mode of a leaf spring was shown as 0 Hz beside vibrations."""
    mech, _mass = mass_on_rail(x=1.0, spring=(100.0, 50.0))
    assert repr(bd.modes(mech)) == "<Modes about reference: 2, decay, decay>"


@pytest.mark.slow(reason="half a second")
@pytest.mark.parametrize("name", list(RESULTS))
def test_writing_into_everything_handed_out_changes_nothing(name, tmp_path):
    with np.errstate(all="ignore"):
        assert list_changes(RESULTS[name](tmp_path)) == []


def test_arrays_of_runs_reject_writing():
    solution = run()
    for name in ("q", "v", "a", "lam", "t", "times"):
        with pytest.raises(ValueError, match="read-only"):
            getattr(solution, name)[...] = 0.0
    with pytest.raises(bd.BeamdaeError, match="it is read-only; change a copy"):
        solution.integrator["rtol"] = 1.0


def test_parameters_are_copied():
    """Neither the caller's list nor the function changes the defaults of a model."""
    points = [0.0, 1.0]

    def bar(at=points):
        mech = bd.Mechanism()
        mech.add(bd.PointMass("bob", 1.0, at=tuple(at)))
        at.append("changed by the function")
        return mech

    model = bd.model(t_end=1.0)(bar)
    points[0] = 5.0
    for _ in range(2):
        mech = model()
        assert mech.parts["bob"].at == (0.0, 1.0)
        assert mech.origin.parameters == {"at": [0.0, 1.0]}
    given = [2.0, 3.0]
    case = bd.Case(model, {"at": given})
    given[0] = 7.0
    assert case.parameters == {"at": [2.0, 3.0]}


def test_laws_keep_the_values_that_they_had_in_the_run():
    """Section forces are recovered after the run, from the same loads."""
    factors = np.array([1.0])
    mech, beam = clamped_beam(STRIP, 2, name="arm")
    mech.add(bd.Force("push", beam.at(0.5), (0.0, lambda t: factors[0] * t)))
    solution = bd.simulate(mech, bd.Radau(1e-3), t_end=0.01, output_step=0.005)
    before = solution.section_forces("arm").M
    factors[0] = 1000.0
    mech.add(bd.Force("late", beam.end, (0.0, 1.0)))
    assert (before == solution.section_forces("arm").M).all()
    assert np.abs(before).max() > 0.0


# Results far from the origin, and limits by rounding.

HEIGHT = 4.0


def falling_device(
    gravity: float = 9.81, guided: bool = True, modulus: float = 22e9, **options: object
) -> bd.Mechanism:
    """Return a box with an elastic board, high above a floor that it does not reach."""
    mech = bd.Mechanism(gravity=(0.0, -gravity))
    box = mech.add(bd.RigidBody.plate("box", (0.7, HEIGHT), 0.12, 0.04, mass=0.25))
    if guided:
        ground = mech.ground.at(0.7, HEIGHT)
        mech.add(bd.Prismatic("guide", ground, box.at(0.7, HEIGHT), direction=(0.0, 1.0)))
    laminate = bd.Material(E=modulus, nu=0.15, rho=1850.0)
    section = rectangle(1.6e-3, 0.03, damping=2e-5, material=laminate)
    line = bd.Line((0.67, HEIGHT), (0.73, HEIGHT))
    board = mech.add(bd.Beam("board", line, section, elements=4, **options))
    screws = mech.add(bd.Weld("screws", box.at(0.67, HEIGHT), board.start))
    mech.add(bd.PointMass("battery", 0.015, on=board.end))
    floor = bd.LineSurface(mech.ground.at(0.0, 0.0))
    bumper = box.at(0.7, HEIGHT - 0.02)
    mech.add(bd.Contact("bumper", bumper, floor, 2e6, restitution=0.5, impact_speed=8.0))
    mech.observe("box", bd.acceleration(box.at(0.7, HEIGHT)))
    mech.observe("clamp", board.stress(0.0, "top"))
    mech.observe("gauge", board.strain(0.005, "top"))
    mech.observe("largest", board.largest_stress())
    mech.observe("screws", screws.reaction_on("b"))
    mech.observe("middle", board.section_forces(0.03))
    return mech


FALLS = {
    "frame": {"strain": "exact"},
    "exact": {"formulation": "exact"},
    "exact, free": {"formulation": "exact", "guided": False},
    "frame, free": {"guided": False},
    "stiff": {"formulation": "exact", "guided": False, "modulus": 22e12},
}

ROUNDING_INTEGRATORS = {"auto": None, "ida": bd.Ida(), "fixed": bd.GeneralizedAlpha(1e-3)}


@pytest.mark.slow(reason="a quarter of a second")
@pytest.mark.parametrize("output_step", [0.05, 5e-3])
@pytest.mark.parametrize("integrator", ROUNDING_INTEGRATORS.values(), ids=ROUNDING_INTEGRATORS)
@pytest.mark.parametrize("options", FALLS.values(), ids=FALLS)
def test_regression_free_fall_has_no_warnings_about_rounding_errors(
    options: dict[str, Any], integrator: object, output_step: float
) -> None:
    """Stresses of 1e-10 Pa had warnings of fast vibrations, long steps, rows and mesh errors."""
    mech = falling_device(**options)
    arguments = {} if integrator is None else {"integrator": integrator}
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        run = bd.simulate(mech, t_end=0.7, output_step=output_step, **arguments)
    stiffness_ratio = options.get("modulus", 22e9) / 22e9
    assert np.max(np.abs(run.columns["clamp [Pa]"])) < 0.1 * stiffness_ratio


@pytest.mark.slow(reason="a quarter of a second")
@pytest.mark.parametrize("force", [1e-3, 1.0])
def test_vibrations_by_small_sudden_loads_have_warnings(force: float) -> None:
    mech = falling_device(strain="exact")
    mech.add(bd.Force("hit", mech.parts["board"].end, (0.0, -force)))
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        run = bd.simulate(mech, bd.Radau(), t_end=0.05, output_step=5e-3)
    assert any("fast vibrations" in x or "output rows" in x for x in run.warnings)


STEEL = bd.Material(E=2e11, nu=0.3, rho=7800.0)
SECTION = rectangle(0.02, damping=1e-5, material=STEEL)

FAR = (100.0, -70.0)
INTEGRATORS = {"radau": bd.Radau(1e-3), "alpha": bd.GeneralizedAlpha(step=5e-3)}


def small_vibration(x, y, start="as drawn", gravity=(0.0, 0.0)):
    """Cantilever with a load of 1 mN, whose tip moves by 1e-7 m."""
    mech = bd.Mechanism(gravity=gravity, start=start)
    line = bd.Line((x, y), (x + 1.0, y))
    beam = mech.add(bd.Beam("beam", line, SECTION, elements=2))
    mech.add(bd.Weld("clamp", mech.ground.at(x, y), beam.start))
    mech.add(bd.Force("load", beam.end, (0.0, bd.sine(1e-3, 3.0))))
    mech.observe("tip", beam.end)
    mech.observe("root", beam.start)
    mech.observe("middle", beam.deflection(0.5))
    return mech


def steady_deflection(x, y):
    """Cantilever in equilibrium under its own weight."""
    return small_vibration(x, y, "equilibrium", (0.0, -9.81))


def crank(x, y, torque=None):
    """Crank that drives a slider, at 20 rad/s or by a torque [N m]."""
    mech = bd.Mechanism(gravity=EARTH)
    arm = mech.add(bd.RigidBody.rod("crank", (x, y), (x + 0.1, y), mass=1.0))
    rod = mech.add(bd.RigidBody.rod("rod", (x + 0.1, y), (x + 0.5, y), mass=1.0))
    slider = mech.add(bd.PointMass("slider", 0.5, at=(x + 0.5, y)))
    pivot = mech.ground.at(x, y)
    mech.add(bd.Revolute("main", pivot, arm.at(x, y)))
    mech.add(bd.Revolute("crank pin", arm.at(x + 0.1, y), rod.at(x + 0.1, y)))
    mech.add(bd.Revolute("wrist pin", rod.at(x + 0.5, y), slider.point))
    mech.add(bd.PointOnLine("guide", pivot, slider.point, direction=(1.0, 0.0)))
    if torque is None:
        mech.add(bd.Driver("motor", pivot, arm.at(x, y), lambda t: 20.0 * t))
    else:
        mech.add(bd.Moment("motor", arm.at(x, y), torque))
    mech.observe("slider", slider.point)
    mech.observe("pivot", arm.at(x, y))
    return mech


MODELS = [small_vibration, steady_deflection, crank]


@pytest.mark.slow(reason="half a second")
@pytest.mark.parametrize("name", INTEGRATORS)
@pytest.mark.parametrize("model", MODELS)
def test_errors_and_warnings_do_not_depend_on_the_origin(model, name):
    runs = [
        bd.simulate(model(*place), INTEGRATORS[name], t_end=0.3, output_step=0.003)
        for place in ((0.0, 0.0), FAR)
    ]
    near, far = (run.errors.table() for run in runs)
    # Rounding errors of positions at 100 m leave a few digits of motions of 1e-7 m.
    np.testing.assert_allclose(near["total"], far["total"], rtol=0.3, atol=1e-3)
    assert len(runs[0].warnings) == len(runs[1].warnings)


@pytest.mark.parametrize("place", [(0.0, 0.0), FAR])
def test_regression_fixed_points_have_no_errors(place):
    """Pivots that moved by the drift of 4e-7 m with fixed steps had errors of 230 %."""
    solution = bd.simulate(
        crank(*place), bd.GeneralizedAlpha(step=5e-3), t_end=0.3, output_step=0.003
    )
    errors = solution.errors.table()["total"]
    pivot = ["pivot.x [m]", "pivot.y [m]", "pivot.x_dot [m/s]", "pivot.y_dot [m/s]"]
    assert (errors[pivot] == 0.0).all()
    assert errors["slider.x_dot [m/s]"] > 0.0


@pytest.mark.parametrize("offset", [0.0, 100.0])
def test_regression_vibrations_far_from_the_origin_need_rows(offset):
    """At 100 m, vibrations of less than 0.1 mm were taken for errors."""
    mech, mass = free_ball((offset + 1e-5, 0.0), name="mass")
    wall = mech.ground.at(offset - 1.0, 0.0)
    mech.add(bd.Spring("spring", wall, mass.point, (2.0 * np.pi * 77.0) ** 2, 0.0, 1.0))
    method = bd.GeneralizedAlpha(step=2e-4)
    (sentence,) = bd.simulate(mech, method, t_end=1.0, output_step=5e-3).row_warnings
    assert sentence.startswith("mass.x")
