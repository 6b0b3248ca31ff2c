"""Definitions of studies, their events and their progress."""

import sys

import numpy as np
import pytest
from mechanisms import hinged_body
from numpy.testing import assert_allclose
from study_models import swing
from study_runs import SerialPool, run_study

import beamdae as bd

ALPHA = bd.GeneralizedAlpha(step=5e-3)
REFERENCES = (bd.Ida(rtol=1e-6), bd.GeneralizedAlpha(step=1e-3))


# Names ----------------------------------------------------------------------------------------
INVALID_NAMES = [
    "../x",
    "/etc/x",
    "..",
    ".",
    ".hidden",
    "a/b",
    "a\\b",
    "x" * 300,
    "a\nb",
    "a\0b",
    "CON",
]


INVALID_NAMES += ["nul.txt", "com1", "", " a", "a ", "a.", "a:b", "\u202ea", "\ud800", "é" * 100]


@pytest.mark.parametrize("name", INVALID_NAMES)
def test_regression_names_that_are_no_folder_names_are_rejected(name):
    """Such names used to write outside of --out."""
    with pytest.raises(bd.BeamdaeError, match="study: the name must be a valid folder name"):
        bd.results.Study(name, (bd.Case(swing),))

    def build(mass=1.0):
        return swing()

    build.__name__ = name
    with pytest.raises(bd.BeamdaeError, match="model: build: the name must be a valid folder name"):
        bd.model(t_end=1.0)(build)


@pytest.mark.parametrize("name", ["a", "hub_beam_compare_x=0.5", "größe", "梁", "Con2", "a.b c"])
def test_folder_names_are_accepted(name):
    assert bd.results.Study(name, (bd.Case(swing),)).name == name


# Wrong arguments --------------------------------------------------------------------------------
CASE = bd.Case(swing)


class WithoutRepr:
    def __repr__(self):
        raise RuntimeError


WRONG_CASES = [
    lambda: bd.Case(swing, integrator="ida"),
    lambda: bd.Case(swing, integrator=bd.Ida),
    lambda: bd.Case(swing, integrator=None),
    lambda: bd.Case(None),
    lambda: bd.Case(lambda: None),
    lambda: bd.Case(swing()),
    lambda: bd.Case(swing, [1, 2]),
    lambda: bd.Case(swing, None),
    lambda: bd.Case(swing, "mass=1"),
    lambda: bd.Case(swing, {1: 2.0}),
    lambda: bd.Case(swing, WithoutRepr()),
    lambda: bd.Case(swing, start="equilibrum"),
    lambda: bd.Case(swing, start=3.0),
]


WRONG_STUDIES = [
    {"name": None},
    {"name": 5},
    {"cases": None},
    {"cases": CASE},
    {"cases": (CASE, None)},
    {"cases": "abc"},
    {"cases": {1}},
    {"cases": ()},
    {"references": bd.Ida(1e-6)},
    {"references": (bd.Ida(1e-6),)},
    {"references": (bd.Ida(1e-6), ALPHA, bd.Radau(1e-6))},
    {"references": ("ida", "radau")},
    {"references": "ab"},
    {"references": (bd.Ida, bd.Radau)},
    {"references": (bd.Ida(1e-6), None)},
    {"columns": "q"},
    {"columns": 5},
    {"columns": None},
    {"columns": [1, 2]},
    {"t_end": "x"},
    {"t_end": [1.0]},
    {"t_end": -1.0},
    {"t_end": float("nan")},
    {"t_end": 10**400},
    {"output_step": 0.0},
    {"time_limit": "x"},
    {"time_limit": {"time": 5.0}},
    {"repetitions": 1.5},
    {"repetitions": "two"},
    {"repetitions": None},
    {"repetitions": float("inf")},
    {"repetitions": 0},
    {"over": 5},
    {"over": ["mass"]},
    {"over": "elements"},
    {"over": "mass"},
    {"references": (bd.Ida(1e-6), bd.Ida(1e-7))},
    {"cases": (bd.Case(swing, {"mas": 1.0}),)},
]


@pytest.mark.parametrize("create", WRONG_CASES)
def test_regression_wrong_cases_are_rejected(create):
    with pytest.raises(bd.BeamdaeError, match=r"^Case(: model| of swing: \w+) must be .*got .*\.$"):
        create()


@pytest.mark.parametrize("settings", WRONG_STUDIES)
def test_regression_wrong_studies_are_rejected(settings):
    valid = {"name": "made", "cases": (CASE,), "references": REFERENCES}
    with pytest.raises(bd.BeamdaeError, match=r"^(made|study|swing): .*\.$") as error:
        bd.results.Study(**(valid | settings))
    assert "\n" not in str(error.value)


def create_listing(result):
    def listing():
        return result() if callable(result) else result

    return listing


@pytest.mark.parametrize(
    ("function", "message"),
    [
        (create_listing(None), "listing: cases must be a list of at least one Case, got None"),
        (create_listing(5), "listing: cases must be a list of at least one Case, got 5"),
        (create_listing([]), "listing: cases must be a list of at least one Case, got "),
        (
            create_listing([1]),
            "listing: cases must be a list of at least one Case, but one entry is 1",
        ),
        (
            create_listing(lambda: (1 / 0 for _ in "a")),
            "listing: creating the cases failed: ZeroDivisionErr",
        ),
        (
            create_listing(lambda: sys.exit(3)),
            r"listing: creating the cases failed: the function called sys.exit\(3\)",
        ),
        (lambda x: [CASE], "creating the cases failed: TypeError"),
        (5, "study: the decorated object must be a function, got 5"),
        (None, "study: the decorated object must be a function, got None"),
    ],
)
def test_regression_wrong_study_functions_are_rejected(function, message):
    with pytest.raises(bd.BeamdaeError, match=message):
        bd.study()(function)


def test_study_function_may_be_a_generator():
    @bd.study()
    def listing():
        yield from (CASE, CASE)

    assert len(listing.cases) == 2


@pytest.mark.parametrize("value", ["x", -1.0, 0, float("nan"), [1.0], 10**400])
def test_wrong_limits_are_rejected(value):
    with pytest.raises(bd.BeamdaeError, match="study: time_limit must"):
        bd.study(time_limit=value)


@pytest.mark.parametrize("value", [5, None, "abc", b"abc", {"a": 1}, WithoutRepr()])
def test_grids_of_values_that_are_not_lists_are_rejected(value):
    with pytest.raises(bd.BeamdaeError, match="grid: mass must be a list of values, got "):
        bd.grid(mass=value)


def test_huge_grids_are_rejected():
    with pytest.raises(bd.BeamdaeError, match="at most 1000000 combinations of mass, size, got"):
        bd.grid(mass=range(10_000), size=range(10_000))
    assert len(bd.grid(mass=(m for m in range(3)), size=np.arange(2))) == 6
    assert bd.grid() == [{}]


@pytest.mark.parametrize(
    ("settings", "message"),
    [
        ({"columns": "q"}, "columns must be a list of names"),
        ({"columns": 5}, "columns must be a list of names"),
        ({"reference": 5}, "reference must be a Case or a Solution"),
        ({"t_end": "x"}, "t_end must be a number"),
        ({"output_step": -1}, "output_step must be positive"),
        ({"progress": 5}, "progress must be a function"),
        ({"progress": lambda t: None}, "progress must be a function that accepts 2 arguments"),
    ],
)
def test_wrong_comparisons_are_rejected_before_the_first_run(settings, message):
    with pytest.raises(bd.BeamdaeError, match=f"compare: {message}"):
        bd.compare([CASE], **settings)


@bd.model(t_end=1.0)
def pendulum(turn=2.6, length=1.0):
    """It passes its lowest point, and stops between two output times."""
    mech, bob = hinged_body(1.0, 0.01, (length, 0.0), name="bob", gravity=9.81)
    mech.observe("bob", bob.at(length, 0.0))
    mech.when("bob.x", 0.0, "down", "record", "bottom")
    mech.when("bob.angle", -turn, "down", "stop", "caught")
    return mech


FINE = bd.Radau(rtol=1e-9)


def test_rows_contain_events():
    cases = [bd.Case(pendulum, {"turn": turn}, FINE) for turn in (2.6, 4.0)]
    assert list(bd.compare(cases)["events"]) == ["bottom, caught", "bottom"]


@pytest.mark.slow(reason="half a second")
def test_regression_summaries_of_sweeps_name_the_runs_that_events_stopped():
    """A sweep whose runs were stopped by events said that they "reached the end time"."""
    results = bd.sweep(pendulum, {"turn": [2.6, 4.0]}, of="bob.x", integrator=FINE)
    assert "2 cases, 1 reached the end time, 1 stopped by an event" in repr(results)
    results = bd.sweep(pendulum, {"turn": [2.5, 2.6]}, of="bob.x", integrator=FINE)
    assert repr(results).endswith("2 cases, 2 stopped by an event>")


@pytest.mark.slow(reason="two seconds")
def test_sweeps_and_cases_start_from_a_state():
    start = {"bob.angle": -1.0}
    results = bd.sweep(pendulum, {"length": [0.5, 1.0]}, of="bob.x", integrator=FINE, start=start)
    for length in (0.5, 1.0):
        case = bd.Case(pendulum, {"length": length}, FINE, start)
        exact = bd.simulate(pendulum(length=length), FINE, 1.0, 2.5e-3, start=start)
        assert_allclose(results.run(length=length)["bob.x"], exact["bob.x"], atol=1e-8)
        assert_allclose(case.solve(1.0, 2.5e-3)["bob.x"], exact["bob.x"], atol=1e-8)
    assert results.run(length=1.0)["bob.x"].iloc[0] == pytest.approx(np.cos(1.0))
    with pytest.raises(bd.BeamdaeError, match="start is an option of runs"):
        bd.sweep(pendulum, {"length": [1.0]}, start=start, measure={"zero": lambda model: 0.0})


def test_cases_with_different_starts_have_different_references_and_names():
    drawn, lifted = bd.Case(pendulum), bd.Case(pendulum, start={"bob.angle": 0.5})
    again = bd.Case(pendulum, start={"bob.angle": 0.5})
    assert lifted.group == "pendulum from {'bob.angle': 0.5}"
    assert bd.Case(pendulum, start="equilibrium").group == "pendulum from equilibrium"
    assert bd.Case(pendulum, start=bd.rotation(3.0)).group.startswith("pendulum from Rotation(")
    assert lifted.mechanism_fingerprint() == again.mechanism_fingerprint()
    assert lifted.mechanism_fingerprint() != drawn.mechanism_fingerprint()


@pytest.mark.slow(reason="half a second")
def test_progress_reports_the_remaining_time(tmp_path):
    reports = []
    cases = tuple(bd.Case(swing, {}, x) for x in (bd.GeneralizedAlpha(5e-3), bd.Ida(rtol=1e-3)))
    study = bd.results.Study("progress", cases, references=REFERENCES)
    run_study(study, tmp_path, SerialPool(), reports.append)
    assert reports[0].remaining_time is None
    assert all(report.remaining_time >= 0.0 for report in reports[1:])
    assert reports[-1].remaining_time == 0.0
