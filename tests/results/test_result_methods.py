"""Methods of public result classes: one law, all classes."""

import dataclasses
import inspect

import numpy as np
import pandas as pd
import pytest
from mechanisms import mass_on_rail

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
