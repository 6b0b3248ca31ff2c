"""Everything that results hand out is read-only or a copy, and runs keep what they began with."""

import pickle
from copy import deepcopy

import numpy as np
import pytest
from robustness.handed_out import list_changes
from robustness.writes import RESULTS, STRIP, run

import beamdae as bd
from beamdae.read_only import ReadOnlyDict, copy_containers, read_only


@pytest.mark.slow(reason="half a second")
@pytest.mark.parametrize("name", list(RESULTS))
def test_writing_into_everything_handed_out_changes_nothing(name, tmp_path):
    with np.errstate(all="ignore"):
        assert list_changes(RESULTS[name](tmp_path)) == []


@pytest.mark.slow(reason="half a second and more")
def test_the_walk_finds_shared_memory():
    """The walk itself can fail: an array and a table that are not protected."""
    result = run()
    vars(result)["t"] = result.t.copy()
    assert {".t", ".table()"} <= set(list_changes(result))


def test_regression_a_table_scaled_by_its_reader():
    solution = run()
    first = solution.observed
    first["tip.y [m]"] *= 1000.0
    again = solution.observed
    assert (first["tip.y [m]"] == 1000.0 * again["tip.y [m]"]).all()
    assert (solution["tip.y"].to_numpy() == again["tip.y [m]"].to_numpy()).all()


def test_arrays_of_runs_reject_writing():
    solution = run()
    for name in ("q", "v", "a", "lam", "t", "times"):
        with pytest.raises(ValueError, match="read-only"):
            getattr(solution, name)[...] = 0.0
    with pytest.raises(bd.BeamdaeError, match="it is read-only; change a copy"):
        solution.integrator["rtol"] = 1.0


def test_copies_are_protected_too():
    solution = run()
    for other in (pickle.loads(pickle.dumps(solution)), solution.at_times([0.0, 0.05])):
        assert not other.t.flags.writeable
        assert not other.trajectory.intervals[0].rows.q.flags.writeable


def test_read_only_values():
    array, table = np.zeros(3), {"a": [1, {"b": np.zeros(2)}]}
    view = read_only(array)
    array[0] = 1.0
    assert view[0] == 1.0
    assert read_only(view) is view
    protected = read_only(table)
    assert protected == {"a": (1, protected["a"][1])}
    assert not protected["a"][1]["b"].flags.writeable
    entries = (1, (2.0, "x"))
    assert read_only(entries) is entries
    again = pickle.loads(pickle.dumps(protected))
    assert type(again) is ReadOnlyDict
    for change in (lambda d: d.clear(), lambda d: d.pop("a"), lambda d: d.update(b=1)):
        with pytest.raises(bd.BeamdaeError, match="read-only"):
            change(protected)
    assert protected.copy() | {"b": 2} == dict(protected, b=2)


def test_copies_of_containers():
    endless = [1.0]
    endless.append(endless)
    values = {"a": [np.zeros(2)], "b": ({"c": 1},), "d": endless}
    copied = copy_containers(values)
    values["a"][0][:] = 1.0
    values["b"][0]["c"] = 2
    assert copied["a"][0].tolist() == [0.0, 0.0]
    assert copied["b"] == ({"c": 1},)
    assert copied["d"] is not endless
    assert copied["d"][1] is copied["d"]


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


def test_regression_quantities_of_copied_mechanisms_can_be_rebuilt():
    """Protecting the copy gave the same arrays in two places different views, so that observables
    kept the coordinates of the old mesh and certificates of flexible models failed."""
    mech = bd.Mechanism()
    beam = mech.add(bd.Beam("beam", bd.Line((0.0, 0.0), (1.0, 0.0)), STRIP))
    mech.observe("tip", beam.end)
    quantity = mech.observables["tip"]
    assert quantity.can_be_rebuilt
    assert deepcopy(quantity).can_be_rebuilt


def test_laws_keep_the_values_that_they_had_in_the_run():
    """Section forces are recovered after the run, from the same loads."""
    factors = np.array([1.0])
    mech = bd.Mechanism()
    beam = mech.add(bd.Beam("arm", bd.Line((0.0, 0.0), (1.0, 0.0)), STRIP, elements=2))
    mech.add(bd.Weld("clamp", mech.ground.at(0.0, 0.0), beam.start))
    mech.add(bd.Force("push", beam.at(0.5), (0.0, lambda t: factors[0] * t)))
    solution = bd.simulate(mech, bd.Radau(1e-3), t_end=0.01, output_step=0.005)
    before = solution.section_forces("arm").M
    factors[0] = 1000.0
    mech.add(bd.Force("late", beam.end, (0.0, 1.0)))
    assert (before == solution.section_forces("arm").M).all()
    assert np.abs(before).max() > 0.0
