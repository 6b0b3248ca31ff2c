"""The cases of validation/tolerances, their references and the table of error over rtol."""

import numpy as np
import pandas as pd
import pytest
from numpy.testing import assert_allclose
from tolerances import error_tables as wide
from tolerances.cases import CASES, WIDE
from tolerances.mechanisms import STEEL, cantilever
from tolerances.modal import solve_small_vibrations
from tolerances.random_cases import random_case, random_cases
from tolerances.references import SUMMARY
from tolerances.tolerance_case import FOLDER

import beamdae as bd

BY_NAME = {case.name: case for case in WIDE}


def test_every_case_has_a_reference_of_its_rows_and_columns():
    assert WIDE[: len(CASES)] == CASES
    assert len({case.name for case in WIDE}) == len(WIDE)
    for case in WIDE:
        stored = case.load_reference(("t [s]", *case.columns, *case.reactions))
        assert stored.shape[0] == case.rows
        assert_allclose(stored[:, 0], case.times, rtol=1e-8)
        assert np.all(np.isfinite(stored))
        assert np.all(np.ptp(case.reference, axis=0) > 0.0)


def test_two_methods_agree_on_every_reference():
    apart = wide.reference_uncertainties(SUMMARY)
    assert set(apart.index) == set(BY_NAME)
    # What a step leaves of undamped modes in an angle is known less well by the second method:
    # generalized-alpha where the beam bends far (Radau settles to 5e-7), Radau at its tightest
    # where the beam moves 0.05 mm.
    assert apart.pop("cantilever_10N") < 5e-4
    assert apart.pop("cantilever_30mm") < 3e-5
    assert apart.max() < 1e-5


def test_references_end_at_published_numbers():
    known = pd.read_csv(SUMMARY)
    ends = known[known["method 2"] == "published, at the end"].set_index(["case", "column"])
    published = [case for case in WIDE if case.published]
    assert len(published) == 4
    for case in published:
        for column, value in case.published.items():
            apart = abs(case.load_reference((column,))[-1, 0] - value)
            told = ends.loc[(case.name, column), "disagreement"]
            size = 0.5 * np.ptp(case.load_reference((column,)))
            # Nine digits are stored, SUNDIALS prints five.
            assert apart < (1e-4 if case.name == "spring_slider_crank" else 3e-6) * size
            assert told == pytest.approx(apart / size, abs=1e-7, rel=0.1)


@pytest.mark.parametrize("case", [case for case in WIDE if case.exact], ids=lambda c: c.name)
def test_closed_forms_are_what_is_stored(case):
    # Nine digits of numbers up to 2.
    assert_allclose(case.reference, case.exact(case.times), rtol=0.0, atol=5.1e-9)


def test_small_vibrations_go_on_about_the_static_deflection_of_the_beam():
    times = np.linspace(0.0, 400.0, 5)
    columns = solve_small_vibrations(cantilever(damping=1e-4), times)
    section = bd.Section.rectangle(STEEL, width=0.02, height=0.01)
    deflection = 0.1 / (3.0 * section.EI) + 0.1 / section.GA
    # Cubic elements are exact for a load at the end; after 400 s nothing moves any more.
    assert_allclose(columns["tip.y [m]"][[0, -1]], [0.0, deflection], rtol=1e-6, atol=1e-15)
    assert columns["root.M [N m]"][-1] == pytest.approx(-0.1, rel=1e-6)


def test_random_mechanisms_are_those_of_their_seeds():
    first, again, other = (random_case(seed) for seed in (9, 9, 10))
    built = [case.model(**case.parameters) for case in (first, again, other)]
    described = [[(part.name, type(part)) for part in mech.parts.values()] for mech in built]
    starts = [bd.equations_of_motion(mech).q0 for mech in built]
    assert described[0] == described[1]
    assert_allclose(starts[0], starts[1], rtol=0.0)
    assert len(starts[2]) != len(starts[0]) or np.any(starts[2] != starts[0])


def test_random_cases_are_many_of_all_kinds():
    cases = list(random_cases())
    assert len(cases) >= 60
    assert {case.bound for case in cases} == {30.0, 100.0}
    for case in cases:
        assert case.reference.shape == (case.rows, len(case.columns))
        assert np.all(np.isfinite(case.reference))


def test_a_line_tells_error_over_rtol_and_how_the_run_ended():
    case = BY_NAME["arevalo"]
    (line,) = wide.error_rows([case], ["Radau"], [1e-4])
    solution = case.run(bd.Radau(1e-4))
    assert line["r"] == pytest.approx(case.errors(solution).max() / 1e-4)
    assert line["status"] == "ok"
    assert line["steps"] == solution.statistics.steps
    shown = wide.pivot_errors(pd.DataFrame([line]))
    assert float(shown.loc[("arevalo", 100.0), ("Radau", "1e-04")]) == pytest.approx(
        line["r"], rel=1e-2
    )


def test_references_are_small():
    assert sum(file.stat().st_size for file in FOLDER.iterdir()) < 1.5e6
