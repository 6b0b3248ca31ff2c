"""Result files are written atomically, and read back unchanged."""

import csv
import errno
import json
import os
import platform
import stat
import subprocess
import sys
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from numpy.testing import assert_array_equal
from pandas.testing import assert_frame_equal

from beamdae.errors import BeamdaeError
from beamdae.report.page.page_file import write_page
from beamdae.report.pictures import figures as pictures
from beamdae.results.storage import files
from beamdae.results.storage.files import (
    atomic_write,
    escape_cell,
    write_escaped_table,
    write_table,
    write_text,
)

posix = pytest.mark.skipif(os.name != "posix", reason="other systems have no such files")
TABLE = pd.DataFrame({"t [s]": [0.0, 0.5], "tip.x [m]": [-0.1, 1e-300]})


def figure():
    from matplotlib.figure import Figure

    line = Figure()
    line.add_subplot().plot([0, 1], [0, 1])
    return line


WRITERS = {
    "text": lambda folder: write_text(folder / "file.txt", "new"),
    "table": lambda folder: write_table(folder / "file.csv", TABLE, {"model": "new"}),
    "picture": lambda folder: pictures.save_figure(figure(), folder / "file.png"),
    "drawing": lambda folder: pictures.save_figure(figure(), folder / "file.svg"),
    "page": lambda folder: write_page(folder / "file.html", {"title": "new"}),
}


@pytest.fixture(params=WRITERS)
def writer(request):
    return WRITERS[request.param]


def read_folder(folder):
    return {path.name: path.read_bytes() for path in folder.iterdir()}


def make_fail(monkeypatch, where, problem):
    def failing(*_, **__):
        raise problem

    monkeypatch.setattr(os, where, failing)


def test_writers_create_the_folder_and_leave_no_scratch_file(tmp_path, writer):
    path = writer(tmp_path / "deep" / "er")
    metadata = {".json"} if path.suffix == ".csv" else set()
    assert {p.suffix for p in path.parent.iterdir()} == {path.suffix} | metadata
    assert path.stat().st_size > 0


@pytest.mark.slow(reason="a fifth of a second")
@pytest.mark.parametrize(("where", "number"), [("fsync", errno.ENOSPC), ("replace", errno.EACCES)])
def test_the_old_file_stays_if_the_new_one_cannot_be_written(
    tmp_path, monkeypatch, writer, where, number
):
    path = writer(tmp_path)
    for file in tmp_path.iterdir():
        file.write_text("old")
    before = read_folder(tmp_path)
    make_fail(monkeypatch, where, OSError(number, os.strerror(number)))
    name = path.with_suffix(".json").name if path.suffix == ".csv" else path.name
    words = rf"({path.name}|{name}): the file cannot be written: {os.strerror(number)}\.$"
    with pytest.raises(BeamdaeError, match=words):
        writer(tmp_path)
    assert read_folder(tmp_path) == before


def test_an_interrupt_keeps_the_old_file_and_is_raised_again(tmp_path, monkeypatch, writer):
    make_fail(monkeypatch, "replace", KeyboardInterrupt())
    with pytest.raises(KeyboardInterrupt):
        writer(tmp_path)
    assert read_folder(tmp_path) == {}


def test_scratch_files_of_killed_processes_are_removed_by_the_next_one(tmp_path):
    ended = subprocess.Popen([sys.executable, "-S", "-E", "-c", ""])
    ended.wait()
    node = platform.node()
    names = {
        f".{ended.pid}@{node}@aaaaaaaa.scratch": False,
        f".{ended.pid}@{node}@dddddddd.scratch.gif": False,
        f".{os.getpid()}@{node}@bbbbbbbb.scratch": True,
        f".{ended.pid}@elsewhere@cccccccc.scratch": True,
        f".{ended.pid}.scratch": True,
    }
    for name in names:
        (tmp_path / name).write_text("half")
    write_text(tmp_path / "file.txt", "new")
    assert {name: (tmp_path / name).exists() for name in names} == names


def test_a_block_that_fails_keeps_the_old_file(tmp_path):
    path = write_text(tmp_path / "file.txt", "old")

    def write_half(problem):
        with atomic_write(path) as scratch:
            scratch.write_text("half of the n")
            raise problem

    with pytest.raises(ZeroDivisionError):
        write_half(ZeroDivisionError())
    with pytest.raises(BeamdaeError, match=r"file\.txt: the file cannot be written: of its own\.$"):
        write_half(OSError("of its own"))
    assert read_folder(tmp_path) == {"file.txt": b"old"}


def test_a_table_that_cannot_be_written_keeps_the_old_metadata(tmp_path, monkeypatch):
    write_table(tmp_path / "run.csv", TABLE, {"model": "old"})
    before = read_folder(tmp_path)

    def full(*_, **__):
        raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))

    monkeypatch.setattr(files, "_write_columns", full)
    with pytest.raises(BeamdaeError, match=r"run\.csv: the file cannot be written: No space left"):
        write_table(tmp_path / "run.csv", TABLE, {"model": "new"})
    assert read_folder(tmp_path) == before


def test_the_table_is_written_even_if_the_metadata_cannot_be(tmp_path):
    (tmp_path / "run.json").mkdir()
    with pytest.raises(BeamdaeError, match=r"run\.json: the file cannot be written: "):
        write_table(tmp_path / "run.csv", TABLE, {})
    assert_frame_equal(pd.read_csv(tmp_path / "run.csv"), TABLE)


def test_metadata_that_json_cannot_represent_keeps_the_old_table(tmp_path):
    write_table(tmp_path / "run.csv", TABLE, {"model": "old"})
    before = read_folder(tmp_path)
    with pytest.raises(BeamdaeError, match=r"the entry .model. must be a JSON value"):
        write_table(tmp_path / "run.csv", TABLE, {"model": object()})
    assert read_folder(tmp_path) == before


@pytest.mark.skipif(not Path("/dev/full").exists(), reason="there is no /dev/full")
def test_a_full_disk_is_reported_and_a_device_is_not_replaced(monkeypatch):
    # Protects the devices of this machine.
    make_fail(monkeypatch, "replace", AssertionError("a device would be replaced"))
    monkeypatch.setattr(Path, "touch", os.replace)
    with pytest.raises(
        BeamdaeError, match=r"^/dev/full: the file cannot be written: No space left"
    ):
        write_text(Path("/dev/full"), "text")


@posix
def test_a_pipe_is_written_directly(tmp_path):
    os.mkfifo(tmp_path / "pipe")
    reader = os.open(tmp_path / "pipe", os.O_RDONLY | os.O_NONBLOCK)
    try:
        write_text(tmp_path / "pipe", "text")
        assert os.read(reader, 10) == b"text"
    finally:
        os.close(reader)
    assert stat.S_ISFIFO(os.stat(tmp_path / "pipe").st_mode)


SMALL_DISK = """
import sys
from pathlib import Path
import pandas as pd
from beamdae.errors import BeamdaeError
from beamdae.results.storage.files import write_table
folder = Path(sys.argv[1])
write_table(folder / "run.csv", pd.DataFrame({"t [s]": [0.0]}), {})
before = {p.name: p.read_bytes() for p in folder.iterdir()}
try:
    write_table(folder / "run.csv", pd.DataFrame({"t [s]": range(100_000)}), {})
except BeamdaeError as problem:
    print(problem)
assert {p.name: p.read_bytes() for p in folder.iterdir()} == before
"""


@pytest.mark.slow(reason="mounts a file system, starts a process")
@pytest.mark.skipif(os.name != "posix" or os.geteuid() != 0, reason="root alone mounts disks")
def test_a_disk_that_fills_up_keeps_the_old_result(tmp_path):
    mount = f"mount -t tmpfs -o size=64k none '{tmp_path}'"
    can = subprocess.run(["unshare", "-m", "sh", "-c", mount], capture_output=True, text=True)
    if can.returncode:
        pytest.skip(f"nothing can be mounted: {can.stderr.strip()}")
    command = f'{mount} && exec "$0" -c "$1" "{tmp_path}"'
    run = subprocess.run(
        ["unshare", "-m", "sh", "-c", command, sys.executable, SMALL_DISK],
        capture_output=True,
        text=True,
        timeout=120,
    )
    assert run.returncode == 0, run.stderr
    assert run.stdout.endswith("run.csv: the file cannot be written: No space left on device.\n")


@posix
def test_permissions_are_kept_and_new_files_follow_the_umask(tmp_path):
    before = os.umask(0o027)
    try:
        path = write_text(tmp_path / "file.txt", "old")
    finally:
        os.umask(before)
    assert stat.S_IMODE(path.stat().st_mode) == 0o640
    path.chmod(0o604)
    write_text(path, "new")
    assert stat.S_IMODE(path.stat().st_mode) == 0o604


@posix
def test_regression_links_are_replaced_and_their_targets_kept(tmp_path, writer):
    """A link in a results folder was followed, and the file it pointed to was overwritten."""
    path = writer(tmp_path / "there")
    names = [file.name for file in path.parent.iterdir()]
    for name in names:
        (tmp_path / "there" / name).write_text("precious")
        (tmp_path / name).symlink_to(tmp_path / "there" / name)
    writer(tmp_path)
    assert read_folder(tmp_path / "there") == dict.fromkeys(names, b"precious")
    assert not any((tmp_path / name).is_symlink() for name in names)
    assert all((tmp_path / name).read_bytes() != b"precious" for name in names)


@posix
def test_links_to_missing_files_and_pipes_are_replaced_and_links_to_folders_are_kept(tmp_path):
    (tmp_path / "there").mkdir()
    os.mkfifo(tmp_path / "pipe")
    for name, target in (("missing.txt", "there/real.txt"), ("waiting.txt", "pipe")):
        (tmp_path / name).symlink_to(tmp_path / target)
        assert write_text(tmp_path / name, "new").read_text() == "new"
        assert not (tmp_path / name).is_symlink()
    assert not list((tmp_path / "there").iterdir())
    (tmp_path / "folder").symlink_to(tmp_path / "there")
    with pytest.raises(BeamdaeError, match="folder: the file cannot be written: Is a directory"):
        write_text(tmp_path / "folder", "new")
    write_text(tmp_path / "folder" / "inside.txt", "new")
    assert read_folder(tmp_path / "there") == {"inside.txt": b"new"}


@pytest.mark.slow(reason="a quarter of a second")
@posix
def test_links_of_the_system_are_written_directly(tmp_path):
    code = (
        "from pathlib import Path; from beamdae.results.storage.files import write_text; "
        "write_text(Path('/dev/stdout'), 'text')"
    )
    with open(tmp_path / "out.txt", "w") as out:
        subprocess.run([sys.executable, "-c", code], stdout=out, check=True)
    assert read_folder(tmp_path) == {"out.txt": b"text"}


@posix
def test_a_write_protected_file_is_not_replaced(tmp_path, monkeypatch):
    path = write_text(tmp_path / "file.txt", "mine")
    # Root has write access to all files.
    monkeypatch.setattr(os, "access", lambda *_: False)
    with pytest.raises(
        BeamdaeError, match=r"file\.txt: the file cannot be written: Permission denied"
    ):
        write_text(path, "new")
    assert read_folder(tmp_path) == {"file.txt": b"mine"}


def test_a_figure_without_a_suffix_is_written_as_png(tmp_path):
    path = pictures.save_figure(figure(), tmp_path / "picture")
    assert path.read_bytes().startswith(b"\x89PNG")
    assert [p.name for p in tmp_path.iterdir()] == ["picture"]


NAMES = ["Träger.x [m]", "梁.phi [rad]", "a, b", 'the "tip"', "x;y", "emoji 🦾"]


@pytest.mark.slow(reason="starts a process in another locale")
def test_texts_are_utf_8_in_every_locale(tmp_path):
    script = (
        "import sys, pandas as pd\nfrom pathlib import Path\n"
        "from beamdae.results.storage.files import write_table, write_text\n"
        f"names = {NAMES!a}\n"
        "table = pd.DataFrame([range(len(names))], columns=names)\n"
        "write_table(Path('run.csv'), table, {'m': names})\n"
        "write_text(Path('page.html'), ''.join(names) + chr(13) + chr(10) + chr(0xDCFF))\n"
    )
    environment = {**os.environ, "LC_ALL": "C", "PYTHONUTF8": "0", "PYTHONCOERCECLOCALE": "0"}
    subprocess.run([sys.executable, "-c", script], cwd=tmp_path, env=environment, check=True)
    assert list(pd.read_csv(tmp_path / "run.csv", encoding="utf-8")) == NAMES
    assert json.loads((tmp_path / "run.json").read_text(encoding="utf-8"))["m"] == NAMES
    # Line ends are not translated, and characters that UTF-8 cannot encode become escapes.
    assert (tmp_path / "page.html").read_bytes() == "".join(NAMES).encode() + b"\r\n\\udcff"


FORMULAS = ["=1+1", "+45 gauge", "-x", "@SUM(A1)", "\t=1", "\r=1", "'=1", "''@x", "＝1"]  # noqa: RUF001
PLAIN = ["tip", "a=b", "1-2", "'quoted'", "", " =1", "-5", "+1e-3", "-.5", "-inf", "x+y"]


@pytest.mark.parametrize("text", FORMULAS)
def test_formulas_are_escaped(text):
    # A cell has no line breaks.
    assert escape_cell(text) == f"'{text}".replace("\r", " ")


# The unit of numbers without a unit was written as '-.
@pytest.mark.parametrize("value", [*PLAIN, "-", -5, -0.5, None, float("-inf")])
def test_other_cells_are_unchanged(value):
    assert escape_cell(value) is value


def test_an_escaped_table_is_read_back_by_pandas(tmp_path):
    texts = [text for text in FORMULAS if "\r" not in text]
    table = pd.DataFrame(
        {
            "=cmd.x [m]": [-1.5 * k for k in range(len(texts))],
            "-y.count": pd.array([-1] * len(texts), dtype="Int64"),
            "label": texts,
            "settings": ["-5", *["tip"] * (len(texts) - 1)],
        }
    )
    path = write_table(tmp_path / "run.csv", table, {})
    rows = pd.read_csv(path)
    assert list(rows) == ["'=cmd.x [m]", "'-y.count", "label", "settings"]
    # Only texts that look like formulas differ; numbers stay numbers.
    assert rows["'=cmd.x [m]"].dtype == float
    assert (rows["'-y.count"] == -1).all()
    assert rows["settings"].tolist() == table["settings"].tolist()
    expected = [escape_cell(text) for text in texts]
    assert rows["label"].tolist() == expected
    write_escaped_table(tmp_path / "same.csv", table)
    assert_frame_equal(rows, pd.read_csv(tmp_path / "same.csv"))


@pytest.mark.parametrize("rows", [0, 1, 7001])
def test_tables_of_numbers_have_the_text_of_pandas(tmp_path, monkeypatch, rows):
    monkeypatch.setattr(files, "_BLOCK_ROWS", 300)
    random = np.random.default_rng(1)
    numbers = random.standard_normal((rows, 3))
    numbers[::5, 1], numbers[1::5, 1], numbers[2::5, 2] = np.nan, -0.0, np.inf
    numbers[3::5, 2], numbers[4::5, 2] = 5e-324, 1.7976931348623157e308
    # Numbers of every size.
    numbers[:, 0] = random.integers(0, 2**64, rows, dtype=np.uint64).view(float)
    table = pd.DataFrame(numbers, columns=["t [s]", "tip.x [m]", "a, b"])
    text = write_table(tmp_path / "table.csv", table, {}).read_bytes().decode()
    assert text == table.to_csv(index=False)


def test_tables_with_equal_headers_or_without_rows_are_escaped(tmp_path):
    twice = pd.DataFrame([["=1", "=2"]], columns=["=a", "=a"])
    path = write_escaped_table(tmp_path / "twice.csv", twice)
    assert path.read_text() == "'=a,'=a\n'=1,'=2\n"
    assert twice.to_numpy().tolist() == [["=1", "=2"]]
    assert write_escaped_table(path, twice.iloc[:0]).read_text() == "'=a,'=a\n"


def test_missing_values_are_empty_cells(tmp_path):
    table = pd.DataFrame(
        {"count": pd.array([1, None], "Int64"), "is": pd.array([None, True], "boolean")}
    )
    table = table.assign(x=[np.nan, 0.25], text=["a", None])
    path = write_escaped_table(tmp_path / "missing.csv", table, sep=";", decimal=",")
    assert path.read_text() == "count;is;x;text\n1;;;a\n;TRUE;0,25;\n"


def test_cells_are_read_back_unchanged_except_line_breaks(tmp_path):
    texts = ["plain", 'a "word", and more', "two\nlines", ""]
    numbers = np.array([1.0 / 3.0, np.nan, -np.inf, 1e-300])
    columns = {"x, y [m]": numbers, "text": texts, "count": np.arange(4)}
    write_table(tmp_path / "run.csv", columns, {})
    with open(tmp_path / "run.csv", encoding="utf-8", newline="") as file:
        header, *rows = csv.reader(file)
    assert header == list(columns)
    assert [row[1] for row in rows] == [*texts[:2], "two lines", ""]
    assert [row[2] for row in rows] == ["0", "1", "2", "3"]
    assert_array_equal([float(row[0] or "nan") for row in rows], numbers)
    assert rows[1][0] == ""
