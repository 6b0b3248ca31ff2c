"""Saved and pickled runs, and differences between runs."""

import json
import pickle
from concurrent.futures import ProcessPoolExecutor
from dataclasses import fields
from multiprocessing import get_context

import numpy as np
import pytest
from mechanisms import free_ball, hinged_body, symbols
from numpy.testing import assert_allclose, assert_array_equal

import beamdae as bd


def bouncing(law=9.81):
    """Return a falling ball that an event catches by activating a joint."""
    mech, ball = free_ball((0.0, 0.3), gravity=law)
    mech.add(bd.Force("push", ball.point, (0.0, lambda t: 0.2 * t)))
    hold = mech.add(bd.Revolute("hold", mech.ground.at(0.0, 0.3), ball.point))
    mech.deactivate(hold)
    mech.observe("push", hold.reaction)
    mech.when("ball.y", 0.1, "down", do=bd.activate(hold, as_is=True), name="caught")
    return mech


@pytest.fixture(scope="module")
def run():
    solution = bd.simulate(bouncing(), bd.Radau(1e-6), t_end=0.4, output_step=0.01)
    assert [record.name for record in solution.event_records] == ["caught"]
    return solution


def assert_same_tables(loaded, run):
    assert (loaded.status, loaded.statistics) == (run.status, run.statistics)
    assert list(loaded.table()) == list(run.table())
    # Exactly equal: the same numbers are evaluated by the same functions.
    assert_array_equal(loaded.table(), run.table())
    assert_array_equal(loaded.coordinates(), run.coordinates())
    assert loaded.summary() == run.summary()
    assert loaded.warnings == run.warnings


def assert_same_solution(loaded, run):
    assert_same_tables(loaded, run)
    times = np.linspace(0.0, 0.4, 77)
    assert_array_equal(loaded.at_times(times).q, run.at_times(times).q)
    assert loaded.events.equals(run.events)
    assert loaded.metadata() == run.metadata()
    names = [f.name for f in fields(run) if f.name not in ("equations", "trajectory", "made_by")]
    for name in {*names} - {"t", "event_records", "loaded_versions"}:
        assert getattr(loaded, name) == getattr(run, name), name
    assert loaded.versions == run.versions


def test_table_of_a_saved_run_has_the_versions_of_the_run(run, tmp_path, monkeypatch):
    old = {"beamdae": "0.0.1", "numpy": "1.0"}
    with monkeypatch.context() as patch:
        patch.setattr("beamdae.results.run_data.installed_versions", lambda: old)
        path = run.save(tmp_path / "ball.run")
    for model in (None, bouncing()):
        table = bd.load(path, model).to_csv(tmp_path / "ball.csv")
        assert json.loads(table.with_suffix(".json").read_text())["versions"] == old
    again = bd.load(bd.load(path, bouncing()).save(tmp_path / "again.run"))
    assert again.metadata()["versions"] == old


def test_with_its_model_a_saved_run_is_the_solution(run, tmp_path):
    assert_same_solution(bd.load(run.save(tmp_path / "ball.run"), bouncing()), run)


@pytest.mark.slow(reason="starts processes")
def test_runs_are_pickled(run):
    with ProcessPoolExecutor(1, mp_context=get_context("spawn")) as pool:
        text = pool.submit(repr, run).result()
    assert text == repr(run)
    loaded = pickle.loads(pickle.dumps(run))
    assert loaded.label == run.label
    assert_same_solution(loaded, run)
    extended = run.observe("height", run.equations.mechanism.parts["ball"].point)
    assert_array_equal(pickle.loads(pickle.dumps(extended))["height"], extended["height"])


def test_a_saved_run_keeps_its_requested_start(tmp_path):
    mech, _ = hinged_body(1.0, 0.1, (1.0, 0.0), name="bob", start={"bob.angle": 0.3})
    run = bd.simulate(mech, bd.Radau(1e-3), t_end=0.01)
    loaded = bd.load(run.save(tmp_path / "a.run"), mech)
    assert loaded.start == run.start
    assert "0.3" in loaded.start.request


def test_a_run_of_equations_is_saved_but_not_pickled(tmp_path):

    t, q, v = symbols(1)
    system = bd.ConstrainedSystem(t=t, q=q, v=v, mass=[1.0], force=-q, q0=[1.0], v0=[0.0])
    run = bd.simulate(system, bd.Radau(1e-6), t_end=0.5)
    loaded = bd.load(run.save(tmp_path / "a.run"), system)
    assert_array_equal(loaded.q, run.q)
    with pytest.raises(bd.BeamdaeError, match=r"cannot be pickled; save it with solution\.save"):
        pickle.dumps(run)


def test_an_unfinished_run_is_saved(tmp_path):
    mech = bouncing()
    run = bd.simulate(mech, bd.Radau(1e-6, max_steps=5), t_end=0.4)
    assert not run.status.success
    path = run.save(tmp_path / "a.run")
    assert bd.load(path).status == bd.load(path, mech).status == run.status


def test_damaged_files_and_runs_of_other_models_are_rejected(run, tmp_path):
    path = run.save(tmp_path / "a.run")
    with pytest.raises(bd.BeamdaeError, match="the file contains a run of a model with other"):
        bd.load(path, bouncing(9.82))
    with pytest.raises(
        bd.BeamdaeError, match=r"b\.run: the saved run cannot be read: No such file"
    ):
        bd.load(tmp_path / "b.run")
    content = path.read_bytes()
    for wrong in (content[:2000], b"", b"PK", b"t,x\n1,2\n", b"\x93NUMPY"):
        path.write_bytes(wrong)
        with pytest.raises(
            bd.BeamdaeError, match=r"a\.run: the file is not a complete saved run; simulate"
        ):
            bd.load(path)
    # Damages the directory of the zip archive: compression, encryption, checksum.
    entry = content.index(b"PK\x01\x02")
    for place in (6, 8, 10, 16):
        path.write_bytes(content[: entry + place] + b"\x63" + content[entry + place + 1 :])
        with pytest.raises(
            bd.BeamdaeError, match=r"a\.run: the (file is not a complete saved run|arrays must not)"
        ):
            bd.load(path)
    with open(path, "wb") as file:
        content = b'{"format": "saved run", "version": 2}'
        np.savez(file, document=np.frombuffer(content, np.uint8))
    with pytest.raises(bd.BeamdaeError, match=r"version must be \d, got 2; simulate"):
        bd.load(path)
    with pytest.raises(bd.BeamdaeError, match="save: path must be the path of a file, got 3"):
        run.save(3)


def test_files_with_pickled_objects_are_rejected(tmp_path):
    path = tmp_path / "a.run"
    with open(path, "wb") as file:
        np.savez(file, document=np.array([{"format": "saved run"}], dtype=object))
    with pytest.raises(bd.BeamdaeError, match=r"a\.run: the file is not a complete saved run"):
        bd.load(path)


def falling(t_end, method, step=0.01):
    mech, _ = free_ball((0.0, 2.0), gravity=9.81)
    return bd.simulate(mech, method, t_end, step)


def test_differences_cover_the_common_time(tmp_path):
    long = falling(1.0, bd.Radau(1e-8))
    short = falling(0.5, bd.GeneralizedAlpha(step=1e-3), 0.003)
    difference = long.difference(short)
    assert list(difference) == list(long.columns)
    assert difference.index.name == "t [s]"
    assert_allclose(difference.index[[0, -1]], [0.0, 0.5])
    # Both methods are exact for constant acceleration.
    assert_allclose(difference["ball.y [m]"], 0.0, atol=1e-9)
    assert_allclose(short.difference(long, "ball")["ball.y [m]"], 0.0, atol=1e-9)
    saved_run = bd.load(short.save(tmp_path / "short.run"))
    assert_allclose(saved_run.difference(long, "ball.y"), 0.0, atol=1e-9)
    with pytest.raises(bd.BeamdaeError, match=r"short\.run has no rows at some of the times"):
        long.difference(saved_run)
    assert_array_equal(short.difference(saved_run), 0.0)


@pytest.mark.parametrize("times", [[0.0, 0.5], [-0.1, 0.1], [0.2, 0.1], [], [np.nan], 3, "now"])
def test_times_outside_a_run_are_rejected(run, tmp_path, times):
    with pytest.raises(bd.BeamdaeError, match="at_times: times must"):
        run.at_times(times)


def test_a_saved_run_is_not_interpolated(run, tmp_path):
    saved_run = bd.load(run.save(tmp_path / "a.run"))
    for times in ([0.1, 0.5], [0.0, 0.005], [-1.0]):
        with pytest.raises(bd.BeamdaeError, match=r"a\.run has no rows at some of the times"):
            saved_run.at_times(np.array(times))
    assert list(saved_run.at_times(saved_run.times[3:7])["ball.y"].index) == list(
        saved_run.times[3:7]
    )


def test_invalid_differences_are_rejected(run):
    fall = falling(0.3, bd.Radau(1e-3))
    with pytest.raises(bd.BeamdaeError, match="other must be a solution or a saved run"):
        run.difference("a")
    with pytest.raises(bd.BeamdaeError, match=r"only one of the runs has the column 'push\.F"):
        run.difference(fall, "push")
    late = bd.simulate(fall.equations, bd.Radau(1e-3), 0.6, start=fall)
    early = falling(0.2, bd.Radau(1e-3))
    with pytest.raises(bd.BeamdaeError, match=r"no output time of this run \(0\.3 to 0\.6 s\)"):
        late.difference(early)
