"""Files that are read again: damage, limits, and the origin of results."""

import hashlib
import json
import os
import pickle
import tracemalloc
import zipfile
from concurrent.futures import ProcessPoolExecutor
from dataclasses import fields
from datetime import UTC, datetime
from multiprocessing import get_context
from pathlib import Path

import numpy as np
import pytest
from conformance import JOINTS, LOADS, NONHOLONOMIC
from mechanisms import EARTH, free_ball, hinged_body, symbols
from numpy.testing import assert_allclose, assert_array_equal
from support import ARC, SOFT_MATERIAL
from test_files import posix

import beamdae as bd
from beamdae.errors import FileContentError
from beamdae.results.storage.checkpoint import Checkpoint
from beamdae.results.storage.documents import checksum


def falling():
    mech, _ = free_ball((0.0, 2.0), gravity=9.81)
    return mech


@pytest.fixture(scope="module")
def run():
    return bd.simulate(falling(), bd.Radau(1e-3), 0.5, output_step=0.1)


def rewrite_run(path, change):
    """Change content and arrays of a saved run, and write it with the right checksum."""
    with np.load(path) as archive:
        arrays = dict(archive)
    content = json.loads(arrays.pop("document").tobytes())
    del content["checksum"]
    change(content, arrays)
    content["checksum"] = checksum(content, arrays)
    arrays["document"] = np.frombuffer(json.dumps(content).encode(), np.uint8)
    with open(path, "wb") as file:
        np.savez(file, **arrays)
    return path


# Size ----------------------------------------------------------------------------------------
@posix
@pytest.mark.parametrize("read", [bd.load, Checkpoint.read])
def test_regression_devices_pipes_and_folders_are_not_read(tmp_path, read):
    """/dev/zero filled the memory, and a pipe without a writer was waited for."""
    os.mkfifo(tmp_path / "pipe")
    (tmp_path / "link").symlink_to(tmp_path / "pipe")
    for path in (Path("/dev/zero"), tmp_path / "pipe", tmp_path / "link"):
        with pytest.raises(bd.BeamdaeError, match="cannot be read: not a regular file; "):
            read(path)
    with pytest.raises(bd.BeamdaeError, match="cannot be read: Is a directory; "):
        read(tmp_path)


def test_regression_compressed_archives_are_refused_before_they_are_unpacked(tmp_path):
    """3 MB were unpacked to 3.2 GB, of which this file is a hundredth."""
    path = tmp_path / "a.run"
    with open(path, "wb") as file:
        np.savez_compressed(file, document=np.zeros(4_000_000))
    tracemalloc.start()
    with pytest.raises(bd.BeamdaeError, match="the arrays must not be compressed; simulate"):
        bd.load(path)
    assert tracemalloc.get_traced_memory()[1] < 1e6
    tracemalloc.stop()


def test_arrays_are_not_larger_than_their_header_says(tmp_path):
    path = tmp_path / "a.run"
    header = {"descr": "<f8", "fortran_order": False, "shape": (10**13,)}
    with zipfile.ZipFile(path, "w") as archive, archive.open("document.npy", "w") as member:
        np.lib.format.write_array_header_1_0(member, header)
        member.write(bytes(80))
    with pytest.raises(bd.BeamdaeError, match="the file is not a complete saved run"):
        bd.load(path)


@pytest.mark.parametrize(
    "text",
    [b"[" * 100_000, b'"' + b'\\"' * 1_000_000, b'{"t": ' + b"9" * 5000 + b"}", b"\xff\xfe", b"3"],
    ids=["nesting", "text", "digits", "binary", "number"],
)
def test_files_of_other_content_are_refused(tmp_path, text):
    path = tmp_path / "end.json"
    path.write_bytes(text)
    with pytest.raises(FileContentError, match="the file is not a complete saved run; simulate"):
        Checkpoint.read(path)


# Schema --------------------------------------------------------------------------------------
RUNS = {
    "status": (
        lambda c, a: c["run"]["status"].update(kind="splendid"),
        "run.status.kind: invalid enum value 'splendid'",
    ),
    "steps": (
        lambda c, a: c["run"]["statistics"].update(steps="many"),
        "run.statistics.steps: expected int, got str",
    ),
    "numbers": (
        lambda c, a: c["table"].update({"t [s]": [10**9, 6]}),
        r"table\[\.\.\.\]: must be the first number and the shape of an array",
    ),
    "places": (
        lambda c, a: c["table"].update({"t [s]": [1, [6]]}),
        r"table\[\.\.\.\]: must be the first number and the shape of an array",
    ),
    "control": (lambda c, a: c.update(label="\x1b[2J"), "must not contain control characters"),
    "missing": (lambda c, a: c["run"].pop("events"), "run: object missing required field events"),
    "version": (lambda c, a: c.update(version=2), r"version must be \d, got 2"),
}


@pytest.mark.parametrize("name", RUNS)
def test_regression_runs_with_wrong_content_are_refused_when_they_are_loaded(tmp_path, run, name):
    """Some raised an IndexError, and some of those only at `.quality`."""
    change, words = RUNS[name]
    path = rewrite_run(run.save(tmp_path / "a.run"), change)
    for model in (None, falling()):
        with pytest.raises(FileContentError, match=words) as caught:
            bd.load(path, model)
        assert str(caught.value).startswith(f"{path}: ")
        assert str(caught.value).endswith("; simulate and save the run again.")


def test_runs_with_the_same_content_are_read(tmp_path, run):
    path = rewrite_run(run.save(tmp_path / "a.run"), lambda content, arrays: None)
    assert_array_equal(bd.load(path, falling()).q, run.q)


def test_runs_with_other_content_than_their_checksum_are_refused(tmp_path, run):
    path = run.save(tmp_path / "a.run")
    with np.load(path) as archive:
        arrays = dict(archive)
    arrays["numbers"][0] += 1e-9
    with open(path, "wb") as file:
        np.savez(file, **arrays)
    with pytest.raises(FileContentError, match=r"has changed since it was written \(wrong check"):
        bd.load(path)


CHECKPOINTS = {
    "huge": ({"t": 10**400}, "the content: integer value out of range|t: .*out of range"),
    "large": ({"t": 1e80}, "t must not exceed 1e"),
    "names": ({"q": {"ball.x": 1.0}}, "q and v must have the same names"),
    "text": ({"q": {"ball.x": "1"}}, r"q\[\.\.\.\]: expected float, got str"),
    "events": ({"events": "bounce"}, "events: expected array, got str"),
    "gap": (
        {"frozen_gaps": {"hold": {"event": ""}}},
        r"frozen_gaps\[\.\.\.\]: object missing required field offsets",
    ),
    "part": (
        {"inactive": ["ball"]},
        "'ball': an earlier run switched this part, but the model has",
    ),
    "unknown": ({"inactive": ["x"]}, "'x': an earlier run switched this part, but the model has"),
}


@pytest.mark.parametrize("name", CHECKPOINTS)
def test_regression_checkpoints_with_wrong_content_are_refused(tmp_path, name):
    """Large numbers ended in an OverflowError, and unknown parts were ignored."""
    change, words = CHECKPOINTS[name]
    mech = falling()
    push = mech.add(bd.Force("push", mech.parts["ball"].point, (1.0, 0.0)))
    mech.when("ball.y", 1.9, "down", bd.deactivate(push), "passed")
    run = bd.simulate(mech, bd.Radau(1e-3), 0.1)
    path = run.save(tmp_path / "end.run")
    with np.load(path) as archive:
        arrays = {key: archive[key] for key in archive.files}
    content = json.loads(arrays.pop("document").tobytes())
    content["checkpoint"] |= change
    content.pop("checksum")
    content["checksum"] = checksum(content, arrays)
    document = np.frombuffer(json.dumps(content).encode(), np.uint8)
    with open(path, "wb") as stream:
        np.savez(stream, document=document, **arrays)
    with pytest.raises(bd.BeamdaeError, match=words):
        bd.simulate(mech, bd.Radau(1e-3), 0.2, start=path)


def test_checkpoints_that_were_read_cannot_be_changed(tmp_path, run):
    checkpoint = Checkpoint.read(run.save(tmp_path / "end.json"))
    with pytest.raises(bd.BeamdaeError, match="it is read-only"):
        checkpoint.q["ball.x"] = 1.0
    assert checkpoint == Checkpoint.of(run)


@posix
def test_hashes_and_outlines_of_pipes_do_not_wait(tmp_path):
    from beamdae.cli.commands.list import Outline, read_outline
    from beamdae.studies.file_reads import digest_file

    os.mkfifo(tmp_path / "pipe")
    (tmp_path / "file").write_bytes(b"content")
    assert digest_file(str(tmp_path / "pipe")) is None
    assert read_outline(tmp_path / "pipe") == Outline({})
    assert digest_file(str(tmp_path / "file")) == hashlib.sha256(b"content").hexdigest()


EVERYTHING = JOINTS | NONHOLONOMIC | LOADS


def provenance_of(mech):
    """Return the equations in the metadata of a run, as in its JSON file."""
    metadata = bd.simulate(mech, bd.Radau(1e-3), t_end=1e-6).metadata()
    return json.loads(json.dumps(metadata))["equations"]


def mechanism(stiffness=3.0):
    mech = bd.Mechanism(gravity=EARTH)
    disk = mech.add(bd.RigidBody("disk", mass=1.3, inertia=0.7, center=(0.5, 0.4)))
    beam = mech.add(bd.Beam("beam", ARC, bd.Section.circle(SOFT_MATERIAL, 0.1), elements=2))
    mech.add(bd.Spring("spring", disk.at(0.5, 0.4), beam.end, stiffness))
    return mech, disk, beam


@pytest.mark.parametrize("make", EVERYTHING.values(), ids=EVERYTHING)
def test_every_part_is_described_in_json(make):
    mech, disk, beam = mechanism()
    part = mech.add(make(mech, disk, beam))
    parts = provenance_of(mech)["parts"]
    assert list(parts) == list(mech.parts)
    assert parts[part.name]["class"] == type(part).__name__
    assert len(parts[part.name]) > 1


def test_each_object_is_described_once():
    provenance = provenance_of(mechanism()[0])
    assert provenance["gravity"] == [0.0, -9.81]
    beam = provenance["parts"]["beam"]
    assert beam["curve"] == {
        "class": "Arc",
        "radius": 1.6,
        "length": 2.0,
        "start": [0.3, -0.2],
        "angle": 0.4,
    }
    assert beam["section"]["material"]["E"] == SOFT_MATERIAL.E
    assert beam["mesh"]["elements"] == 2
    assert "curve" not in beam["mesh"]
    spring = provenance["parts"]["spring"]
    assert spring["stiffness"] == 3.0
    assert spring["a"] == {"body": "disk", "at": [0.5, 0.4]}


def test_other_parameters_have_another_hash():
    one, same, other = (provenance_of(mechanism(k)[0])["identity"] for k in (3.0, 3.0, 3.1))
    assert one == same != other


@pytest.mark.slow(reason="a fifth of a second")
def test_metadata_contain_time_parts_and_hash(tmp_path):
    before = datetime.now(UTC).replace(microsecond=0)
    run = bd.simulate(mechanism()[0], bd.Radau(1e-3), t_end=0.01)
    metadata = json.loads(run.to_csv(tmp_path / "a.csv").with_suffix(".json").read_text())
    assert before <= datetime.fromisoformat(metadata["written"]) <= datetime.now(UTC)
    assert metadata["equations"]["parts"]["disk"]["mass"] == 1.3
    assert len(metadata["equations"]["identity"]) == 64


def test_laws_and_long_lists_are_abbreviated():
    mech = bd.Mechanism()
    points = [(np.cos(x), np.sin(x)) for x in np.linspace(0.0, 6.0, 40)]
    plate = mech.add(bd.RigidBody.polygon("plate", points, density=7800.0, thickness=0.01))
    mech.add(bd.Force("push", plate.at(0.0, 0.0), (lambda t: t, 2.0)))
    parts = provenance_of(mech)["parts"]
    assert parts["plate"]["shape"] == "40 entries"
    assert parts["push"]["law"] == ["function", 2.0]


# Saved and pickled runs, and differences between runs.


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
def bouncing_run():
    solution = bd.simulate(bouncing(), bd.Radau(1e-6), t_end=0.4, output_step=0.01)
    assert [record.name for record in solution.event_records] == ["caught"]
    return solution


def assert_same_tables(loaded, bouncing_run):
    assert (loaded.status, loaded.statistics) == (bouncing_run.status, bouncing_run.statistics)
    assert list(loaded.table()) == list(bouncing_run.table())
    # Exactly equal: the same numbers are evaluated by the same functions.
    assert_array_equal(loaded.table(), bouncing_run.table())
    assert_array_equal(loaded.coordinates(), bouncing_run.coordinates())
    assert loaded.summary() == bouncing_run.summary()
    assert loaded.warnings == bouncing_run.warnings


def assert_same_solution(loaded, bouncing_run):
    assert_same_tables(loaded, bouncing_run)
    times = np.linspace(0.0, 0.4, 77)
    assert_array_equal(loaded.at_times(times).q, bouncing_run.at_times(times).q)
    assert loaded.events.equals(bouncing_run.events)
    assert loaded.metadata() == bouncing_run.metadata()
    names = [
        f.name for f in fields(bouncing_run) if f.name not in ("equations", "trajectory", "made_by")
    ]
    for name in {*names} - {"t", "event_records", "loaded_versions"}:
        assert getattr(loaded, name) == getattr(bouncing_run, name), name
    assert loaded.versions == bouncing_run.versions


def test_table_of_a_saved_run_has_the_versions_of_the_run(bouncing_run, tmp_path, monkeypatch):
    old = {"beamdae": "0.0.1", "numpy": "1.0"}
    with monkeypatch.context() as patch:
        patch.setattr("beamdae.results.run_data.installed_versions", lambda: old)
        path = bouncing_run.save(tmp_path / "ball.run")
    for model in (None, bouncing()):
        table = bd.load(path, model).to_csv(tmp_path / "ball.csv")
        assert json.loads(table.with_suffix(".json").read_text())["versions"] == old
    again = bd.load(bd.load(path, bouncing()).save(tmp_path / "again.run"))
    assert again.metadata()["versions"] == old


def test_with_its_model_a_saved_run_is_the_solution(bouncing_run, tmp_path):
    assert_same_solution(
        bd.load(bouncing_run.save(tmp_path / "ball.run"), bouncing()), bouncing_run
    )


@pytest.mark.slow(reason="starts processes")
def test_runs_are_pickled(bouncing_run):
    with ProcessPoolExecutor(1, mp_context=get_context("spawn")) as pool:
        text = pool.submit(repr, bouncing_run).result()
    assert text == repr(bouncing_run)
    loaded = pickle.loads(pickle.dumps(bouncing_run))
    assert loaded.label == bouncing_run.label
    assert_same_solution(loaded, bouncing_run)
    extended = bouncing_run.observe("height", bouncing_run.equations.mechanism.parts["ball"].point)
    assert_array_equal(pickle.loads(pickle.dumps(extended))["height"], extended["height"])


def test_a_saved_run_keeps_its_requested_start(tmp_path):
    mech, _ = hinged_body(1.0, 0.1, (1.0, 0.0), name="bob", start={"bob.angle": 0.3})
    bouncing_run = bd.simulate(mech, bd.Radau(1e-3), t_end=0.01)
    loaded = bd.load(bouncing_run.save(tmp_path / "a.run"), mech)
    assert loaded.start == bouncing_run.start
    assert "0.3" in loaded.start.request


def test_a_run_of_equations_is_saved_but_not_pickled(tmp_path):

    t, q, v = symbols(1)
    system = bd.ConstrainedSystem(t=t, q=q, v=v, mass=[1.0], force=-q, q0=[1.0], v0=[0.0])
    bouncing_run = bd.simulate(system, bd.Radau(1e-6), t_end=0.5)
    loaded = bd.load(bouncing_run.save(tmp_path / "a.run"), system)
    assert_array_equal(loaded.q, bouncing_run.q)
    with pytest.raises(bd.BeamdaeError, match=r"cannot be pickled; save it with solution\.save"):
        pickle.dumps(bouncing_run)


def test_an_unfinished_run_is_saved(tmp_path):
    mech = bouncing()
    bouncing_run = bd.simulate(mech, bd.Radau(1e-6, max_steps=5), t_end=0.4)
    assert not bouncing_run.status.success
    path = bouncing_run.save(tmp_path / "a.run")
    assert bd.load(path).status == bd.load(path, mech).status == bouncing_run.status


def test_damaged_files_and_runs_of_other_models_are_rejected(bouncing_run, tmp_path):
    path = bouncing_run.save(tmp_path / "a.run")
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
        bouncing_run.save(3)


def test_files_with_pickled_objects_are_rejected(tmp_path):
    path = tmp_path / "a.run"
    with open(path, "wb") as file:
        np.savez(file, document=np.array([{"format": "saved run"}], dtype=object))
    with pytest.raises(bd.BeamdaeError, match=r"a\.run: the file is not a complete saved run"):
        bd.load(path)


def run_fall(t_end, method, step=0.01):
    mech, _ = free_ball((0.0, 2.0), gravity=9.81)
    return bd.simulate(mech, method, t_end, step)


def test_differences_cover_the_common_time(tmp_path):
    long = run_fall(1.0, bd.Radau(1e-8))
    short = run_fall(0.5, bd.GeneralizedAlpha(step=1e-3), 0.003)
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
def test_times_outside_a_run_are_rejected(bouncing_run, tmp_path, times):
    with pytest.raises(bd.BeamdaeError, match="at_times: times must"):
        bouncing_run.at_times(times)


def test_a_saved_run_is_not_interpolated(bouncing_run, tmp_path):
    saved_run = bd.load(bouncing_run.save(tmp_path / "a.run"))
    for times in ([0.1, 0.5], [0.0, 0.005], [-1.0]):
        with pytest.raises(bd.BeamdaeError, match=r"a\.run has no rows at some of the times"):
            saved_run.at_times(np.array(times))
    assert list(saved_run.at_times(saved_run.times[3:7])["ball.y"].index) == list(
        saved_run.times[3:7]
    )


def test_invalid_differences_are_rejected(bouncing_run):
    fall = run_fall(0.3, bd.Radau(1e-3))
    with pytest.raises(bd.BeamdaeError, match="other must be a solution or a saved run"):
        bouncing_run.difference("a")
    with pytest.raises(bd.BeamdaeError, match=r"only one of the runs has the column 'push\.F"):
        bouncing_run.difference(fall, "push")
    late = bd.simulate(fall.equations, bd.Radau(1e-3), 0.6, start=fall)
    early = run_fall(0.2, bd.Radau(1e-3))
    with pytest.raises(bd.BeamdaeError, match=r"no output time of this run \(0\.3 to 0\.6 s\)"):
        late.difference(early)
