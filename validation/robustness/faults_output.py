"""Faults of where results go: closed streams, folders and disks that take nothing, odd names."""

from __future__ import annotations

import csv
import re

from robustness.bench import (
    Bench,
    Ran,
    expect,
    no_traceback,
    small_disk,
    told,
    unprivileged,
)
from robustness.faults_studies import write_study


def _streams(bench: Bench, line: str) -> Ran:
    """The line ends without a traceback, and the results are there."""
    ran = no_traceback(bench.shell(line))
    expect(bool(bench.rows), "the table is empty")
    expect(not bench.left("results/*.tmp"), "scratch files stay")
    return ran


def nobody_reads(bench: Bench) -> None:
    """`| true` takes no results with it."""
    ran = _streams(bench, "set -o pipefail; BEAMDAE run model.py --no-estimate | true")
    expect(ran.code in (0, 141), f"exit code {ran.code}, {ran.last}")


def one_line_is_read(bench: Bench) -> None:
    """`| head -1` takes no results with it, and nothing is told of it."""
    ran = _streams(bench, "BEAMDAE run model.py --no-estimate | head -1")
    expect(ran.err == "", f"something is told: {ran.last}")


def closed_output(bench: Bench) -> None:
    """`>&-` takes no results with it."""
    ran = _streams(bench, "BEAMDAE run model.py --no-estimate >&-")
    expect(ran.code in (0, 1), f"exit code {ran.code}, {ran.last}")


def full_output(bench: Bench) -> None:
    """`>/dev/full` takes no results with it, and is told in one sentence at most."""
    ran = _streams(bench, "BEAMDAE run model.py --no-estimate >/dev/full")
    expect(len(ran.err.splitlines()) <= 1, f"more than a sentence: {ran.last}")


def closed_errors(bench: Bench) -> None:
    """`2>&-` takes no results with it."""
    ran = _streams(bench, "BEAMDAE run model.py --no-estimate 2>&-")
    expect(ran.code == 0, f"exit code {ran.code}")


def closed_input(bench: Bench) -> None:
    """`<&-` changes nothing."""
    expect(_streams(bench, "BEAMDAE run model.py --no-estimate <&-").code == 0, "it failed")


def everything_closed(bench: Bench) -> None:
    """A command without any stream keeps its results."""
    _streams(bench, "BEAMDAE run model.py --no-estimate <&- >&- 2>&-")


def nobody_reads_a_mistake(bench: Bench) -> None:
    """A mistake with standard error closed has its exit code all the same."""
    ran = no_traceback(bench.shell("BEAMDAE run nowhere.py 2>&-"))
    expect(ran.code == 2, f"exit code {ran.code}")


def nobody_reads_a_list(bench: Bench) -> None:
    """`beamdae list | true` ends without a word."""
    ran = no_traceback(bench.shell("BEAMDAE list . | true"))
    expect(ran.err == "", f"something is told: {ran.last}")


def nobody_reads_a_study(bench: Bench) -> None:
    """A study whose output nobody reads is finished."""
    write_study(bench)
    no_traceback(bench.shell("BEAMDAE compare study.py --workers 2 2>&1 | true", limit=100.0))
    expect((bench.folder / "results/few/report.html").is_file(), "no page was written")


def read_only_folder(bench: Bench) -> None:
    """A folder that allows no files is a mistake, told before the work."""
    locked = bench.folder / "locked"
    locked.mkdir()
    locked.chmod(0o555)
    command = bench.command("run", "model.py", "--out", "locked")
    told(bench.finish(bench.start(unprivileged(bench, command))), 2)


def table_is_a_folder(bench: Bench) -> None:
    """A folder by the name of the table is told in a sentence."""
    (bench.folder / "results" / "arm.csv").mkdir(parents=True)
    told(bench.run("run", "model.py", "--no-estimate"), 1, 2)


def picture_is_a_folder(bench: Bench) -> None:
    """A folder by the name of the picture is told in a sentence, before the run or after it."""
    (bench.folder / "results" / "arm.png").mkdir(parents=True)
    ran = told(bench.run("run", "model.py", "--no-estimate"), 1, 2)
    expect(ran.code == 2 or bool(bench.rows), "no table was written")


def page_is_a_folder(bench: Bench) -> None:
    """A folder by the name of a study's page is told in a sentence, and the tables are kept."""
    write_study(bench)
    (bench.folder / "results/few/report.html").mkdir(parents=True)
    told(bench.run("compare", "study.py", limit=100.0), 1, 2)
    expect((bench.folder / "results/few/cases.csv").is_file(), "no table was written")


def full_disk(bench: Bench) -> None:
    """A full disk is told in one sentence, and no half of a file stays."""
    with small_disk(bench.folder / "disk", 16):
        told(bench.run("run", "model.py", "--no-estimate", "--out", "disk"), 1, 2)
        table = bench.folder / "disk" / "arm.csv"
        whole = not table.exists() or table.read_text().endswith("\n")
        expect(whole, "half a table stays under its name")


def full_disk_of_a_study(bench: Bench) -> None:
    """A study on a full disk ends with a sentence."""
    write_study(bench)
    with small_disk(bench.folder / "results", 64):
        told(bench.run("compare", "study.py", "--workers", "2", limit=100.0), 1, 2)


def relative_names(bench: Bench) -> None:
    """Values of parameters do not lead out of the results folder."""
    more = ("--set", "label=../../../escaped", "--workers", "2")
    told(bench.run("compare", "model.py", *more, limit=100.0), 0, 1)
    expect(not list(bench.folder.parent.glob("*escaped*")), "files were written elsewhere")
    expect(bench.left("*") == ["model.py", "results"], f"files beside: {bench.left('*')}")


def study_named_by_a_path(bench: Bench) -> None:
    """A study whose name has separators is refused, or stays in its folder."""
    write_study(bench)
    path = bench.folder / "study.py"
    path.write_text(path.read_text() + "\nfew = bd.Study('../../escaped', few.cases)\n")
    told(bench.run("compare", "study.py", limit=100.0), 0, 2)
    expect(not (bench.folder.parent / "escaped").exists(), "files were written elsewhere")


_NUMBER = re.compile(r"[-+]?(\d|inf|nan|\.)", re.IGNORECASE)


def formulas_in_tables(bench: Bench) -> None:
    """No cell of a CSV is what a spreadsheet would compute."""
    for label in ("=1+1", "@SUM(1)", "+1+1", "-1+1", "=cmd|' /C calc'!A0"):
        ran = bench.run("run", "model.py", "--no-estimate", "--set", f"label={label}")
        told(ran, 0, 2)
        if ran.code == 2:
            # Refused as a name.
            continue
        with (bench.folder / "results" / "arm.csv").open(newline="") as file:
            cells = {cell for row in csv.reader(file) for cell in row}
        begin = [c for c in cells if c[:1] in "=+-@\t" and c and not _NUMBER.match(c)]
        computed = [c for c in cells if c.startswith(("+1", "-1+"))]
        expect(not begin + computed, f"cells such as {(begin + computed)[:1]}")


def formulas_in_cases(bench: Bench) -> None:
    """No cell of the tables of a study is what a spreadsheet would compute."""
    more = ("--set", "label==1+1", "--workers", "2")
    told(bench.run("compare", "model.py", *more, limit=100.0), 0, 1)
    for path in bench.folder.glob("results/*/**/*.csv"):
        with path.open(newline="") as file:
            begin = [c for row in csv.reader(file) for c in row if c.startswith(("=", "@"))]
        expect(not begin, f"{path.name} has cells such as {begin[:1]}")


def control_characters(bench: Bench) -> None:
    """Names cannot make the terminal do anything."""
    ran = bench.run("run", "model.py", "--no-estimate", "--set", "label=a\x1b[31m\x07b")
    told(ran, 0, 2)
    for sign in ("\x1b", "\x07"):
        expect(sign not in ran.out + ran.err, "a control character reaches the terminal")


def markup_on_the_page(bench: Bench) -> None:
    """Names are text on the page of a study."""
    more = ("--set", "label=</script><script>alert(1)</script>", "--workers", "2")
    told(bench.run("compare", "model.py", *more, limit=100.0), 0, 1, 2)
    for page in bench.folder.glob("results/*/report.html"):
        expect("<script>alert(1)" not in page.read_text(), "a name is a program on the page")


def markup_on_the_screen(bench: Bench) -> None:
    """Names are text on the screen."""
    ran = bench.run("run", "model.py", "--no-estimate", "--set", "label=[/bold][red]tip[/red]")
    told(ran, 0, 2)
    expect("[/bold][red]" in ran.out + ran.err, "a name is taken for markup")


FAULTS = (
    nobody_reads,
    one_line_is_read,
    closed_output,
    full_output,
    closed_errors,
    closed_input,
    everything_closed,
    nobody_reads_a_mistake,
    nobody_reads_a_list,
    nobody_reads_a_study,
    read_only_folder,
    table_is_a_folder,
    picture_is_a_folder,
    page_is_a_folder,
    full_disk,
    relative_names,
    study_named_by_a_path,
    formulas_in_tables,
    control_characters,
    markup_on_the_page,
    markup_on_the_screen,
)
# Slow, or much like one of those.
SLOW = (
    formulas_in_cases,
    full_disk_of_a_study,
)
