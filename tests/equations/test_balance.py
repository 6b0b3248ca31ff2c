"""The books of a run, row by row, in machine code and as plain Python."""

import numpy as np
import pytest
from hub_beam import hub_beam
from numpy.testing import assert_array_equal

from beamdae.equations import measures
from beamdae.simulation import as_equations


@pytest.fixture(scope="module")
def books():
    """Books of a hub beam, the same in plain Python, and more states than are taken at once."""
    equations = as_equations("simulate", hub_beam(elements=2))
    keep = measures.balance_rows(equations)
    run = measures.plan_balance(equations.structure).buffers(False, equations.p)
    count = 2 * len(run.times) + 3
    random = np.random.default_rng(0)
    sizes = (equations.n, equations.n, equations.n, equations.m)
    state = [random.normal(size=(count, size)) for size in sizes]
    state[0] = equations.q0 + 1e-3 * state[0]
    t = np.linspace(0.0, 1.0, count)
    return keep, run, np.column_stack([t, np.full(count, 0.5)]), state


def test_rows_do_not_depend_on_those_beside_them(books):
    keep, _, times, state = books
    together = keep(times, *state)
    some = [0, 1, len(times) // 2, len(times) - 1]
    alone = [keep(times[k : k + 1], *(x[k : k + 1] for x in state))[0] for k in some]
    assert_array_equal(together[some], alone)
    assert len(np.unique(together[:, 0])) == len(times)


def test_machine_code_and_plain_python_keep_the_same_books(books):
    keep, run, times, state = books
    run.n_rows = count = 7
    run.times[:count] = times[:count]
    run.states[:count] = np.hstack(state)[:count]
    measures.evaluate_balance(run)
    found = keep(times[:count], *(x[:count] for x in state))
    # Sums of tens of numbers, each row in the same order.
    off = np.abs(found - run.results[:count]).max(axis=0)
    assert (off <= 1e-14 * np.abs(found).max(axis=0)).all()
