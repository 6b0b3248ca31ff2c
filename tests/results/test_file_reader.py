"""Limits, schema and checksums of saved runs, checkpoints and records."""

from __future__ import annotations

import hashlib
import json
import os
import shutil
import tracemalloc
import zipfile
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from numpy.testing import assert_array_equal
from test_files import posix

import beamdae as bd
from beamdae.errors import FileContentError
from beamdae.results.storage import reader
from beamdae.results.storage.checkpoint import Checkpoint
from beamdae.results.storage.reader import checksum
from beamdae.studies.case import Case
from beamdae.studies.store.store import Store
from beamdae.studies.store.trajectory_csv import (
    format_trajectory,
    parse_trajectory,
)
from beamdae.studies.tasks import Task

# Files written before saved runs had a checksum.
GOLDEN = Path(__file__).parent / "golden"


def falling():
    mech = bd.Mechanism(gravity=(0.0, -9.81))
    ball = mech.add(bd.PointMass("ball", 1.0, at=(0.0, 2.0)))
    mech.observe("ball", ball.point)
    return mech


@pytest.fixture(scope="module")
def run():
    return bd.simulate(falling(), bd.Radau(1e-3), 0.5, output_step=0.1)


def rewrite_run(path, change):
    """Change content and arrays of a saved run, and write it with the right checksum."""
    with np.load(path) as archive:
        arrays = dict(archive)
    content = json.loads(arrays.pop("told").tobytes())
    content.pop("checksum", None)
    change(content, arrays)
    content["checksum"] = checksum(content, arrays)
    arrays["told"] = np.frombuffer(json.dumps(content).encode(), np.uint8)
    with open(path, "wb") as file:
        np.savez(file, **arrays)
    return path


# Files of earlier versions -------------------------------------------------------------------


def test_saved_runs_without_checksum_are_read(tmp_path):
    run = bd.load(GOLDEN / "bouncing.run")
    assert run.status.success
    assert run["ball.y"].iloc[-1] == pytest.approx(0.1, abs=1e-6)
    assert run.metadata()["versions"]["numpy"] == "2.4.6"


def test_checkpoints_of_version_3_are_read():
    checkpoint = Checkpoint.read(GOLDEN / "bouncing.json")
    assert checkpoint.t == 0.4
    assert list(checkpoint.frozen_gaps) == ["hold"]


def test_records_without_further_checks_are_read(tmp_path):
    @bd.model(t_end=0.1)
    def swing():
        return falling()

    task = Task("key", Case(swing, {}, bd.Radau()), 0.1, 0.01, name="one")
    store = Store(tmp_path)
    for path in (store.record_path(task), store.rows_path(task)):
        path.parent.mkdir(exist_ok=True)
        shutil.copy(GOLDEN / f"record{path.suffix}", path)
    outcome, problem = store.load(task)
    assert problem == ""
    assert outcome.values["steps"] == 200
    assert outcome.table.shape == (11, 15)
    assert len(outcome.frames["t"]) == 120


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


@pytest.mark.slow(reason="half a second and more")
def test_regression_an_archive_is_refused_before_it_is_unpacked(tmp_path):
    """3 MB were unpacked to 3.2 GB, of which this file is a hundredth."""
    path = tmp_path / "a.run"
    header = {"descr": "<f8", "fortran_order": False, "shape": (400_000_000,)}
    with (
        zipfile.ZipFile(path, "w", zipfile.ZIP_DEFLATED) as archive,
        archive.open("told.npy", "w") as member,
    ):
        np.lib.format.write_array_header_1_0(member, header)
        for _ in range(70):
            member.write(bytes(1_000_000))
    tracemalloc.start()
    with pytest.raises(bd.BeamdaeError, match=r"unpacks to 70000128 bytes, but at most 100 times"):
        bd.load(path)
    assert tracemalloc.get_traced_memory()[1] < 1e6
    tracemalloc.stop()


def test_the_sizes_of_an_array_and_its_header_must_agree(tmp_path):
    path = tmp_path / "a.run"
    header = {"descr": "<f8", "fortran_order": False, "shape": (10**9,)}
    with zipfile.ZipFile(path, "w") as archive, archive.open("told.npy", "w") as member:
        np.lib.format.write_array_header_1_0(member, header)
        member.write(bytes(80))
    with pytest.raises(bd.BeamdaeError, match="'told' has 208 bytes, but its header allows 80000"):
        bd.load(path)


def test_constant_arrays_are_saved_such_that_they_can_be_read(tmp_path, monkeypatch, run):
    monkeypatch.setattr(reader, "_MAX_BYTES_OF_ANY_COMPRESSION", 0)
    monkeypatch.setattr(reader, "_MAX_COMPRESSION", 1.01)
    path = run.save(tmp_path / "a.run")
    with zipfile.ZipFile(path) as archive:
        assert {x.compress_type for x in archive.infolist()} == {zipfile.ZIP_STORED}
    assert_array_equal(bd.load(path).table(), run.table())


@pytest.mark.parametrize(
    ("text", "words"),
    [
        (b"[" + b",".join([b"[]"] * 2_000_001) + b"]", "2000002 lists and objects, but at most"),
        (b"[" * 101 + b"]" * 101, "101 levels of nesting, but at most 100 are allowed"),
        (b'["' + b"]" * 200 + b'"' + b"," + b"[" * 101, "102 levels of nesting"),
        (b"[" + b"1," * 10_000_000 + b"1]", "10000001 values, but at most 10000000"),
        (b'{"t": 1, "u": 2, "t": 3}', "the field 't' occurs twice in one object"),
        (b'"' + b'\\"' * 1_000_000, "not a complete checkpoint"),
        (b'{"t": ' + b"9" * 5000 + b"}", "not a complete checkpoint"),
        (b"\xff\xfe", "not a complete checkpoint"),
    ],
    ids=["lists", "nesting", "brackets in text", "values", "twice", "text", "digits", "binary"],
)
def test_regression_json_has_limits(tmp_path, text, words):
    """90 MB of lists took 40 s."""
    path = tmp_path / "end.json"
    path.write_bytes(text)
    with pytest.raises(FileContentError, match=words):
        Checkpoint.read(path)


# Schema --------------------------------------------------------------------------------------


def drop_last_row(content, arrays):
    arrays["v"] = arrays["v"][:-1]


def swap_times(content, arrays):
    arrays["t"] = arrays["t"][::-1].copy()
    arrays["table"][0], arrays["coordinates"][0] = arrays["t"], arrays["t"]


RUNS = {
    "more nodes": (
        lambda c, a: a.update(nodes=np.append(a["nodes"], 9.0)),
        r"q must have the shape \(\d+, 2\), got ",
    ),
    "fewer rows": (drop_last_row, r"v must have the shape \(\d+, 2\), got "),
    "nan": (lambda c, a: a["q"].fill(np.nan), "q must contain only finite numbers"),
    "falling times": (swap_times, "t must ascend"),
    "jump": (lambda c, a: a["nodes"].sort() or a["nodes"].__imul__(-1), "nodes must ascend"),
    "scaled": (lambda c, a: a["q"].__imul__(3.0), "coordinates must be the coordinates and vel"),
    "floats": (lambda c, a: a.update(ends=a["ends"] * 1.0), "ends must be an array of integers"),
    "halves": (lambda c, a: a.update(q0=a["q0"].astype("f4")), "q0 must be an array of 8-byte fl"),
    "ends": (lambda c, a: a["ends"].__imul__(2), "ends must begin with 0 and end with"),
    "stages": (lambda c, a: c["plain"].update({"per step": [7]}), "per step must divide the num"),
    "count": (lambda c, a: c["plain"].update({"per step": []}), "per step must equal the number"),
    "status": (
        lambda c, a: c["plain"]["status"].update(kind="failed"),
        "beside.status must equal plain.status status, 'failed', got 'ok'",
    ),
    "steps": (
        lambda c, a: c["plain"]["statistics"].update(steps=-1),
        "plain.statistics.steps must be a whole number of at least 0, got -1",
    ),
    "end": (
        lambda c, a: c["beside"]["result"].update(last_time=9.0),
        "beside.result.last_time must equal the last of nodes, 0.5, got 9.0",
    ),
    "headers": (lambda c, a: c["table"].pop(), r"table must have the shape \(9, rows\)|table must"),
    "same headers": (
        lambda c, a: c["table"].__setitem__(1, "t [s]"),
        "table must be different headers that begin with 't ",
    ),
    "control": (lambda c, a: c.update(label="\x1b[2J"), "label must be a text without control"),
    "missing": (lambda c, a: c["plain"].pop("events"), "plain.events is missing"),
    "extra": (lambda c, a: c.update(more=1), "more is not a field of this file, only format"),
    "member": (lambda c, a: a.update(more=np.zeros(3)), "more is not an array of a saved run"),
    "version": (lambda c, a: c.update(version=2.0), "version must be one of 1, 2, got 2.0"),
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
    arrays["a"][0, 0] += 1e-9
    with open(path, "wb") as file:
        np.savez(file, **arrays)
    with pytest.raises(FileContentError, match=r"has changed since it was written \(wrong check"):
        bd.load(path)


CHECKPOINTS = {
    "huge": ({"t": 10**400}, "t must be a finite number, got 1000000"),
    "large": ({"t": 1e80}, "t must be a number that is allowed as an initial condition"),
    "pair": ({"states": {"ball.x": [1.0]}}, "states.ball.x must be a list with 2 entries, got a "),
    "text": (
        {"states": {"ball.x": ["1", 2.0]}},
        "states.ball.x.0 must be a finite number, got '1'",
    ),
    "events": ({"events": "bounce"}, "events must be a list, got 'bounce'"),
    "due": ({"due": {"a": "sideways"}}, "due.a must be one of 'up', 'down', got 'sideways'"),
    "gap": ({"found": {"hold": {"found": [0.0], "event": ""}}}, "found.hold.since is missing"),
    "sign": ({"sides": {"a": 2}}, "sides.a must be one of -1, 0, 1, got 2"),
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
    path = run.checkpoint(tmp_path / "end.json")
    content = json.loads(path.read_text()) | change
    content.pop("checksum")
    path.write_text(json.dumps(content | {"checksum": checksum(content)}))
    with pytest.raises(bd.BeamdaeError, match=words):
        bd.simulate(mech, bd.Radau(1e-3), 0.2, start=path)


# Trajectories of records ---------------------------------------------------------------------


def test_trajectories_are_parsed_exactly_or_refused():
    table = pd.DataFrame(
        {"=a": [0.1 + 0.2, -1e-17, 1e300, np.inf], "b": [np.nan, -np.inf, -0.0, 1e22]},
        pd.Index([0.0, 1e-5, 0.5, 1.0], name="t [s]"),
    )
    text = format_trajectory(table)
    parsed = parse_trajectory(text, "t [s]", ["=a", "b"])
    pd.testing.assert_frame_equal(parsed, table, check_exact=True)
    empty = table.iloc[:, :0]
    assert parse_trajectory(format_trajectory(empty), "t [s]", []).shape == (4, 0)
    for columns in (["=a", "c"], ["=a"]):
        with pytest.raises(ValueError, match="headers"):
            parse_trajectory(text, "t [s]", columns)
    for cell in ("x", "1.2.3", "-", ".", "e5", "1e", "1_0", "0x1", "--1", "1-2", "1e5e5", "1 2"):
        wrong = text.replace(b"1e+300", cell.encode())
        assert wrong != text
        with pytest.raises(ValueError, match="not numbers"):
            parse_trajectory(wrong, "t [s]", ["=a", "b"])
    for wrong in (text.replace(b",1e+300", b""), text + b"1.0\n", text + b"\n", text[:-1] + b","):
        with pytest.raises(ValueError, match="one cell per column"):
            parse_trajectory(wrong, "t [s]", ["=a", "b"])
    for wrong in (text[:-1], text + b"1", text.replace(b"1.0,", b"1..0,")):
        with pytest.raises(ValueError, match=r"one cell per column|not numbers"):
            parse_trajectory(wrong, "t [s]", ["=a", "b"])


@posix
def test_hashes_and_outlines_of_pipes_do_not_wait(tmp_path):
    from beamdae.cli.model_files.outline import Outline, read_outline
    from beamdae.studies.store.file_hashes import digest_file

    os.mkfifo(tmp_path / "pipe")
    (tmp_path / "file").write_bytes(b"content")
    assert digest_file(str(tmp_path / "pipe")) is None
    assert read_outline(tmp_path / "pipe") == Outline()
    assert digest_file(str(tmp_path / "file")) == hashlib.sha256(b"content").hexdigest()


@posix
def test_regression_linked_folders_of_results_are_refused(tmp_path):
    (tmp_path / "elsewhere").mkdir()
    (tmp_path / "results").mkdir()
    (tmp_path / "results" / "outcomes").symlink_to(tmp_path / "elsewhere")

    @bd.model(t_end=0.1)
    def swing():
        return falling()

    task = Task("key", Case(swing, {}, bd.Radau()), 0.1, 0.01, name="one")
    with pytest.raises(bd.BeamdaeError, match="outcomes: the path must be a folder, but is a link"):
        Store(tmp_path / "results").load(task)
