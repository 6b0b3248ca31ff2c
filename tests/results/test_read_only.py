"""Everything that results hand out is read-only or a copy, and runs keep what they began with."""

import numpy as np
import pytest
from handed_out import RESULTS, STRIP, list_changes, run
from mechanisms import clamped_beam

import beamdae as bd


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
