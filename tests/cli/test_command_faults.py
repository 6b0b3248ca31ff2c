"""Commands that end early: closed streams, interrupts, models that exit, unusual options."""

import os
import signal
import time
from pathlib import Path

import pandas as pd
import pytest
from command_line import invoke
from study_runs import run_serially
from terminals import process, shell

MODEL = '''
import os
import signal
import sys

import beamdae as bd


def send_signal(number=signal.SIGINT):
    os.kill(os.getpid(), number)


@bd.model(t_end=0.02)
def arm(mass=2.0, note=""):
    """A bob on a hinge."""
    mech = bd.Mechanism(gravity=(0.0, -9.81))
    bob = mech.add(bd.RigidBody("bob", mass, inertia=0.1, center=(1.0, 0.0)))
    mech.add(bd.Revolute("hinge", mech.ground.at(0.0, 0.0), bob.at(0.0, 0.0)))
    mech.observe("tip", bob.at(1.0, 0.0))
    # building
    return mech


# importing
'''


def has_no_traceback(errors):
    return "Traceback" not in errors and "ignored" not in errors


ALL_FILES = {"arm.csv", "arm.json", "arm.html", "arm.png"}

# Standard streams that are closed or not read.

CLOSED = {
    "reader gone": ("| true", 0, 0),
    "no output": (">&-", 0, 0),
    "full disk": (">/dev/full", 2, 1),
    "no errors": ("2>&- >/dev/null", 0, 0),
    "neither": (">&- 2>&-", 0, 0),
    "nothing at all": ("<&- >&- 2>&-", 0, 0),
    "full disk for errors": (">/dev/full 2>/dev/full", 2, 0),
}


@pytest.mark.slow(reason="starts processes")
@pytest.mark.parametrize(("streams", "code", "lines"), CLOSED.values(), ids=CLOSED)
def test_files_are_written_whatever_the_streams(here, streams, code, lines):
    got, _, errors = shell("{beamdae} run model.py " + streams)
    assert (got, len(errors.splitlines())) == (code, lines), errors
    assert has_no_traceback(errors)
    assert {p.name for p in Path("results").iterdir()} == ALL_FILES


@pytest.mark.slow(reason="starts processes")
@pytest.mark.parametrize("command", ["check model.py", "list .", "--help", "--version", "run gone"])
def test_every_command_exits_quietly_without_a_reader(here, command):
    code = 2 if "gone" in command else 0
    for streams in ("| true", ">&-", ">&- 2>&-"):
        got, _, errors = shell(f"{{beamdae}} {command} {streams}")
        assert got == code, errors
        assert has_no_traceback(errors)
    got, _, errors = shell(f"{{beamdae}} {command} >/dev/full")
    assert got == 2
    assert len(errors.splitlines()) == 1


@pytest.mark.slow(reason="runs a study in processes")
def test_page_and_pictures_of_a_study_without_a_reader(here):
    code, _, errors = shell("{beamdae} compare model.py | true")
    assert (code, has_no_traceback(errors)) == (0, True), errors
    names = {path.name for path in Path("results/arm_compare").iterdir()}
    assert {"report.html", "work_precision.png", "cases.csv"} <= names


# Interrupts, which the process sends to itself at a chosen moment.

AT_STEP = """
from beamdae.integrators.radau.stepper import RadauStepper
calls, advance = [], RadauStepper.advance
def interrupt(self, most):
    calls.append(None)
    if len(calls) in {at}:
        send_signal()
    return advance(self, 1)
RadauStepper.advance = interrupt
"""
WHILE_WRITING = """
from beamdae.results.storage import files
write = files._write_columns
def interrupt(*arguments, **options):
    send_signal()
    return write(*arguments)
files._write_columns = interrupt
"""
# A signal within half a second after another one is ignored.
WHILE_DRAWING = """
import time
from matplotlib.backends.backend_agg import FigureCanvasAgg
def interrupt(self, *arguments, **settings):
    time.sleep(0.6)
    send_signal()
FigureCanvasAgg.print_png = interrupt
"""
# A run that took steps can be resumed.
RESUMABLE_FILES = ALL_FILES | {"arm.run"}
# Lines of the model that interrupt the run, the files left, and a part of the message.
# The pilot run takes 21 steps, and the main run 156 (calls 22 to 177).
MOMENTS = {
    "importing": ("send_signal()", set(), "interrupted"),
    "pilot run": (AT_STEP.format(at="{5}"), ALL_FILES, "of the pilot run"),
    "integrating": (AT_STEP.format(at="{100}"), RESUMABLE_FILES, "interrupted at t = 0"),
    "integrating with IDA": (
        AT_STEP.format(at="{150}").replace("radau.stepper", "ida.ida").replace("Radau", "Ida"),
        RESUMABLE_FILES,
        "interrupted at t = 0",
    ),
    "integrating, twice": (
        AT_STEP.format(at="{100, 101}"),
        RESUMABLE_FILES,
        "interrupted at t = 0",
    ),
    "integrating, then writing": (
        AT_STEP.format(at="{100}") + WHILE_WRITING,
        RESUMABLE_FILES,
        "interrupted at t = 0",
    ),
    "writing": (WHILE_WRITING, ALL_FILES, "interrupted; the results so far are in"),
    "drawing": (
        WHILE_DRAWING,
        ALL_FILES - {"arm.png"},
        "interrupted; the results so far are in",
    ),
    "integrating, then drawing": (
        AT_STEP.format(at="{100}") + WHILE_DRAWING,
        RESUMABLE_FILES - {"arm.png"},
        "interrupted at t = 0",
    ),
}


@pytest.mark.slow(reason="starts processes")
@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM, signal.SIGHUP])
@pytest.mark.parametrize(("lines", "files", "words"), MOMENTS.values(), ids=MOMENTS)
def test_an_interrupted_run_keeps_its_results(here, lines, files, words, number):
    if number != signal.SIGINT:
        # The others skip the files after the one being written.
        files = files - ({"arm.png"} if lines == WHILE_DRAWING else {"arm.png", "arm.html"})
    lines = lines.replace("send_signal()", f"send_signal({int(number)})")
    Path("model.py").write_text(MODEL.replace("# importing", lines), encoding="utf-8")
    method = "ida" if "IdaStepper" in lines else "radau"
    command = process("run", "model.py", "--rtol", "1e-9", "--integrator", method, "--t-end", "0.5")
    _, errors = command.communicate(timeout=120)
    assert command.returncode == 128 + number, errors
    (line,) = errors.splitlines()
    assert words in line
    assert {path.name for path in Path().glob("results/*") if path.stat().st_size} == files
    if files:
        assert line.endswith("; the results so far are in results/arm.csv")
        assert len(pd.read_csv("results/arm.csv")) >= 1


@pytest.mark.slow(reason="starts processes")
def test_interrupt_while_building_ends_the_run(here):
    Path("model.py").write_text(MODEL.replace("# building", "send_signal()"), encoding="utf-8")
    for name in ("run", "check"):
        command = process(name, "model.py")
        _, errors = command.communicate(timeout=60)
        assert (command.returncode, has_no_traceback(errors)) == (130, True)
        assert errors.startswith("interrupted")
    assert not Path("results").exists()


DISCARDING = """
class Incomplete:
    def __del__(self, abort=os.abort):
        abort()

sys.incomplete = Incomplete()

class Callback:
    def __del__(self):
        send_signal()

Callback()
"""


@pytest.mark.slow(reason="starts processes")
@pytest.mark.parametrize("name", ["run", "check"])
def test_regression_incomplete_objects_do_not_crash_an_interrupted_command(here, name):
    """The exception of an interrupt was discarded with a traceback; objects crashed at the end."""
    Path("model.py").write_text(MODEL.replace("# importing", DISCARDING), encoding="utf-8")
    command = process(name, "model.py")
    _, errors = command.communicate(timeout=60)
    assert (command.returncode, errors) == (130, "interrupted\n")


@pytest.mark.slow(reason="starts a process")
def test_files_that_a_model_left_open_are_complete(here):
    lines = "file = open('log.txt', 'w')\nfile.write('written')"
    Path("model.py").write_text(MODEL.replace("# importing", lines), encoding="utf-8")
    assert shell("{beamdae} check model.py")[0] == 0
    assert Path("log.txt").read_text() == "written"


@pytest.mark.slow(reason="starts processes")
def test_interrupt_in_the_second_run_keeps_the_first(here):
    lines = """
import beamdae.accuracy.runs as runs
again = runs._repeat
def interrupt(*arguments, **options):
    send_signal()
    return again(*arguments, **options)
runs._repeat = interrupt
"""
    Path("model.py").write_text(MODEL.replace("# importing", lines), encoding="utf-8")
    command = process("run", "model.py")
    output, errors = command.communicate(timeout=60)
    assert command.returncode == 130, errors
    assert "interrupted; the results so far are in" in errors
    assert "the results so far are in results/arm.csv" in errors
    assert "error" not in output.split("observed")[1].splitlines()[0]
    assert Path("results/arm.png").exists()


@pytest.mark.slow(reason="runs a study in processes")
@pytest.mark.skipif(os.name != "posix", reason="groups of processes are POSIX")
def test_a_study_resumes_after_an_interrupt_of_its_process_group(here):
    command = process("compare", "model.py", "--t-end", "2", start_new_session=True)
    first = command.stderr.readline()
    # The worker processes are about to start.
    time.sleep(0.3)
    os.killpg(command.pid, signal.SIGINT)
    _, errors = command.communicate(timeout=60)
    assert ": 0/8, " in first
    assert (command.returncode, has_no_traceback(errors)) == (130, True), errors
    assert " of 8 runs done; run the same command again to resume" in errors
    assert Path("results/arm_compare/report.html").exists()


@pytest.mark.slow(reason="starts worker processes")
@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
def test_regression_a_swallowed_interrupt_ends_a_study_before_it_starts(here, number):
    swallowed = f"try:\n    send_signal({int(number)})\nexcept BaseException:\n    pass"
    Path("model.py").write_text(MODEL.replace("# importing", swallowed), encoding="utf-8")
    code, output, errors = shell("{beamdae} compare model.py")
    assert (code, output) == (128 + number, "")
    assert errors.startswith("interrupted before any table was written")
    assert not Path("results").exists()


@pytest.mark.slow(reason="starts a process")
def test_regression_an_interrupt_that_a_library_swallows_is_reported_once(here):
    """The drawing was reported as a result, and the interrupt was printed again."""
    lines = """
import beamdae.report.pictures.drawing as drawing
create = drawing.create_drawing
def interrupt(*arguments):
    try:
        send_signal()
    except BaseException:
        pass
    return create(*arguments)
drawing.create_drawing = interrupt
"""
    Path("model.py").write_text(MODEL.replace("# importing", lines), encoding="utf-8")
    code, _, errors = shell("{beamdae} draw model.py")
    assert code == 130
    assert errors == "interrupted; the results so far are in results/arm_drawing.png\n"


# Models that exit.


# Options.


@pytest.mark.slow(reason="a fifth of a second")
def test_a_run_at_its_time_limit_keeps_its_results(here):
    result = invoke("run", "model.py", "--t-end", "9", "--time-limit", "1e-9")
    assert result.exit_code == 1, result.output
    assert "reached the time limit of 1e-09 s" in result.stderr
    assert Path("results/arm.csv").exists()


@pytest.mark.slow(reason="starts processes")
def test_listing_does_not_execute_scripts(here):
    """`list` executed a script without a guard for 120 s, also after SIGTERM."""
    Path("script.py").write_text(MODEL.replace("# importing", "import time\ntime.sleep(600)"))
    code, output, _ = shell("{beamdae} list .")
    assert code == 0
    assert "model.py" in output


# Studies.


@pytest.fixture
def serial(monkeypatch):
    run_serially(monkeypatch)


FAILING = "mech.add(bd.Moment('m', on=bob.at(0.0, 0.0), law=lambda t: t * (0.0105 - t) ** 0.5))"


@pytest.mark.slow(reason="runs studies")
@pytest.mark.usefixtures("serial")
@pytest.mark.parametrize("over", [None, "elements"])
def test_a_study_whose_cases_all_fail_has_a_table_and_a_page(here, over):
    study = f"""
@bd.study(over={over!r})
def failing():
    return [bd.Case(arm, {{"elements": n}}, bd.Ida(1e-3)) for n in (1, 2)]
"""
    source = MODEL.replace("# building", FAILING).replace("mass=2.0", "mass=2.0, elements=1")
    Path("model.py").write_text(source + study, encoding="utf-8")
    for _ in range(2):
        result = invoke("compare", "model.py")
        assert result.exit_code == 1, result.output
        assert "failed: arm" in result.stderr
        assert " and 1 other: " in result.stderr
        assert Path("results/failing/report.html").exists()
        assert set(pd.read_csv("results/failing/cases.csv")["status"]) == {"failed"}
        assert not list(Path("results/failing").glob("*.png"))


# Encodings.

LOCALES = {
    "C": {"LC_ALL": "C"},
    "C without UTF-8": {"LC_ALL": "C", "PYTHONUTF8": "0", "PYTHONCOERCECLOCALE": "0"},
    "ascii": {"PYTHONIOENCODING": "ascii"},
    "latin-1": {"PYTHONIOENCODING": "latin-1"},
}


@pytest.mark.slow(reason="starts processes")
@pytest.mark.parametrize("locale", LOCALES.values(), ids=LOCALES)
def test_output_in_every_encoding(here, locale):
    source = MODEL.replace("A bob on a hinge", "Ein Bogen µ 梁")
    Path("model.py").write_text(source, encoding="utf-8")
    for arguments in (["list", "model.py"], ["run", "model.py", "--t-end", "0.01"], ["--help"]):
        command = process(*arguments, environment=locale, text=False)
        output, errors = command.communicate(timeout=60)
        assert (command.returncode, errors) == (0, b"")
        # Boxes are drawn with characters of the encoding.
        assert b"\\u25" not in output
