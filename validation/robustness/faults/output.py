"""Faults of output: closed streams, read-only folders, full disks, unusual names."""

from __future__ import annotations

import csv
import re
import signal

from robustness.faults.bench import (
    Bench,
    CommandResult,
    drop_privileges,
    expect,
    expect_code,
    expect_exit,
    expect_no_traceback,
    mount_small_disk,
)
from robustness.faults.damaged_studies import STUDY_TIME_LIMIT, write_study


def _run_with_streams(bench: Bench, line: str) -> CommandResult:
    """Run a shell line and check that it keeps its results and shows no traceback."""
    result = expect_no_traceback(bench.run_in_shell(line))
    expect(bool(bench.table_text), "the table is empty")
    expect(not bench.list_files("results/*.tmp"), "scratch files stay")
    return result


def closed_pipe(bench: Bench) -> None:
    """`| true` loses no results."""
    result = _run_with_streams(bench, "set -o pipefail; BEAMDAE run model.py --no-estimate | true")
    expect_code(result, 0, 128 + signal.SIGPIPE)


def pipe_closed_after_one_line(bench: Bench) -> None:
    """`| head -1` loses no results and causes no message."""
    result = _run_with_streams(bench, "BEAMDAE run model.py --no-estimate | head -1")
    expect(result.messages == "", f"unexpected message: {result.error_tail}")


def closed_standard_output(bench: Bench) -> None:
    """`>&-` loses no results."""
    result = _run_with_streams(bench, "BEAMDAE run model.py --no-estimate >&-")
    expect_code(result, 0, 1)


def full_standard_output(bench: Bench) -> None:
    """`>/dev/full` loses no results and causes at most one message."""
    result = _run_with_streams(bench, "BEAMDAE run model.py --no-estimate >/dev/full")
    expect(len(result.messages.splitlines()) <= 1, f"more than one message: {result.error_tail}")


def closed_standard_error(bench: Bench) -> None:
    """`2>&-` loses no results."""
    result = _run_with_streams(bench, "BEAMDAE run model.py --no-estimate 2>&-")
    expect_code(result, 0)


def closed_standard_input(bench: Bench) -> None:
    """`<&-` has no effect."""
    expect(
        _run_with_streams(bench, "BEAMDAE run model.py --no-estimate <&-").code == 0, "it failed"
    )


def all_streams_closed(bench: Bench) -> None:
    """A command without any stream saves its results."""
    _run_with_streams(bench, "BEAMDAE run model.py --no-estimate <&- >&- 2>&-")


def usage_error_without_standard_error(bench: Bench) -> None:
    """A usage error with standard error closed keeps its exit code."""
    result = expect_no_traceback(bench.run_in_shell("BEAMDAE run nowhere.py 2>&-"))
    expect_code(result, 2)


def list_into_closed_pipe(bench: Bench) -> None:
    """`beamdae list | true` ends without a message."""
    result = expect_no_traceback(bench.run_in_shell("BEAMDAE list . | true"))
    expect(result.messages == "", f"unexpected message: {result.error_tail}")


def study_into_closed_pipe(bench: Bench) -> None:
    """A study whose output pipe is closed is completed."""
    write_study(bench)
    expect_no_traceback(
        bench.run_in_shell(
            "BEAMDAE compare study.py --workers 2 2>&1 | true", time_limit=STUDY_TIME_LIMIT
        )
    )
    expect((bench.folder / "results/few/report.html").is_file(), "no page was written")


def read_only_results_folder(bench: Bench) -> None:
    """A read-only folder is a usage error, reported before the run."""
    locked = bench.folder / "locked"
    locked.mkdir()
    locked.chmod(0o555)
    command = bench.command("run", "model.py", "--out", "locked")
    expect_exit(bench.finish(bench.start(drop_privileges(command))), 2)


def table_is_a_folder(bench: Bench) -> None:
    """A folder with the name of the table is reported."""
    (bench.folder / "results" / "arm.csv").mkdir(parents=True)
    expect_exit(bench.run("run", "model.py", "--no-estimate"), 1, 2)


def picture_is_a_folder(bench: Bench) -> None:
    """A folder with the name of the picture is reported, and the table is kept."""
    (bench.folder / "results" / "arm.png").mkdir(parents=True)
    result = expect_exit(bench.run("run", "model.py", "--no-estimate"), 1, 2)
    expect(result.code == 2 or bool(bench.table_text), "no table was written")


def page_is_a_folder(bench: Bench) -> None:
    """A folder with the name of a study's page is reported, before the runs or with tables kept."""
    write_study(bench)
    (bench.folder / "results/few/report.html").mkdir(parents=True)
    result = expect_exit(bench.run("compare", "study.py", time_limit=STUDY_TIME_LIMIT), 1, 2)
    table = bench.folder / "results/few/cases.csv"
    expect(result.code == 2 or table.is_file(), "no table was written")


def full_disk(bench: Bench) -> None:
    """A full disk is reported, and no truncated table remains."""
    with mount_small_disk(bench.folder / "disk", 16):
        expect_exit(bench.run("run", "model.py", "--quiet", "--out", "disk"), 1, 2)
        table = bench.folder / "disk" / "arm.csv"
        whole = not table.exists() or table.read_text().endswith("\n")
        expect(whole, "half a table stays under its name")


def full_disk_of_a_study(bench: Bench) -> None:
    """A study on a full disk ends with a message."""
    write_study(bench)
    with mount_small_disk(bench.folder / "results", 64):
        expect_exit(
            bench.run("compare", "study.py", "--workers", "2", time_limit=STUDY_TIME_LIMIT), 1, 2
        )


def names_that_lead_out_of_the_folder(bench: Bench) -> None:
    """Parameter values cannot place files outside the results folder."""
    more = ("--set", "label=../../../escaped", "--workers", "2")
    expect_exit(bench.run("compare", "model.py", *more, time_limit=STUDY_TIME_LIMIT), 0, 1)
    expect(not list(bench.folder.parent.glob("*escaped*")), "files were written elsewhere")
    expect(
        bench.list_files("*") == ["model.py", "results"], f"files beside: {bench.list_files('*')}"
    )


def study_named_by_a_path(bench: Bench) -> None:
    """A study whose name contains separators is refused, or stays in its folder."""
    write_study(bench)
    path = bench.folder / "study.py"
    path.write_text(path.read_text() + "\nfew = bd.results.Study('../../escaped', few.cases)\n")
    expect_exit(bench.run("compare", "study.py", time_limit=STUDY_TIME_LIMIT), 0, 2)
    expect(not (bench.folder.parent / "escaped").exists(), "files were written elsewhere")


_NUMBER = re.compile(r"[-+]?(\d|inf|nan|\.)", re.IGNORECASE)


def formulas_in_tables(bench: Bench) -> None:
    """No cell of a CSV file is a spreadsheet formula."""
    for label in ("=1+1", "@SUM(1)", "+1+1", "-1+1", "=cmd|' /C calc'!A0"):
        result = bench.run("run", "model.py", "--no-estimate", "--set", f"label={label}")
        expect_exit(result, 0, 2)
        if result.code == 2:
            # The name was refused.
            continue
        with (bench.folder / "results" / "arm.csv").open(newline="") as file:
            cells = {cell for row in csv.reader(file) for cell in row}
        formulas = [c for c in cells if c[:1] in "=+-@\t" and c and not _NUMBER.match(c)]
        computed = [c for c in cells if c.startswith(("+1", "-1+"))]
        expect(not formulas + computed, f"cells such as {(formulas + computed)[:1]}")


def formulas_in_cases(bench: Bench) -> None:
    """No cell of a study's tables is a spreadsheet formula."""
    more = ("--set", "label==1+1", "--workers", "2")
    expect_exit(bench.run("compare", "model.py", *more, time_limit=STUDY_TIME_LIMIT), 0, 1)
    for path in bench.folder.glob("results/*/**/*.csv"):
        with path.open(newline="") as file:
            formulas = [c for row in csv.reader(file) for c in row if c.startswith(("=", "@"))]
        expect(not formulas, f"{path.name} has cells such as {formulas[:1]}")


def control_characters(bench: Bench) -> None:
    """Names cannot send control characters to the terminal."""
    result = bench.run("run", "model.py", "--no-estimate", "--set", "label=a\x1b[31m\x07b")
    expect_exit(result, 0, 2)
    for character in ("\x1b", "\x07"):
        expect(character not in result.out + result.err, "a control character reaches the terminal")


def markup_on_the_page(bench: Bench) -> None:
    """Names are escaped on the page of a study."""
    more = ("--set", "label=</script><script>alert(1)</script>", "--workers", "2")
    expect_exit(bench.run("compare", "model.py", *more, time_limit=STUDY_TIME_LIMIT), 0, 1, 2)
    for page in bench.folder.glob("results/*/report.html"):
        expect(
            "<script>alert(1)" not in page.read_text(), "a name is executed as a script on the page"
        )


def markup_on_the_screen(bench: Bench) -> None:
    """Names are not interpreted as markup in the terminal."""
    result = bench.run("run", "model.py", "--no-estimate", "--set", "label=[/bold][red]tip[/red]")
    expect_exit(result, 0, 2)
    expect("[/bold][red]" in result.out + result.err, "a name is interpreted as markup")


FAULTS = (
    closed_pipe,
    pipe_closed_after_one_line,
    closed_standard_output,
    full_standard_output,
    closed_standard_error,
    closed_standard_input,
    all_streams_closed,
    usage_error_without_standard_error,
    list_into_closed_pipe,
    study_into_closed_pipe,
    read_only_results_folder,
    table_is_a_folder,
    picture_is_a_folder,
    page_is_a_folder,
    full_disk,
    names_that_lead_out_of_the_folder,
    study_named_by_a_path,
    formulas_in_tables,
    control_characters,
    markup_on_the_page,
    markup_on_the_screen,
)
# Slow, or similar to one of the faults above.
SLOW = (
    formulas_in_cases,
    full_disk_of_a_study,
)
