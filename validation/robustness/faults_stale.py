"""Faults of studies started again: what changed since, and studies of which little succeeds."""

from __future__ import annotations

from robustness.bench import Bench, expect, told
from robustness.faults_studies import RUN, cases, done, results, trajectories, write_study


def _stale(bench: Bench, change) -> None:
    """A second start after the change does not tell the numbers of the first."""
    done(bench, 0)
    before = set(trajectories(bench).values())
    change()
    done(bench, 0)
    used = {bench.folder / "results" / "few" / t for t in cases(bench)["trajectory"]}
    after = {path.read_text() for path in used}
    expect(not before & after, "results of the old model are told as those of the new one")


def _replaced(bench: Bench, old: str, new: str):
    path = bench.folder / "study.py"
    return lambda: path.write_text(path.read_text().replace(old, new))


def constant_changed(bench: Bench) -> None:
    """A constant of the study's file."""
    write_study(bench)
    _stale(bench, _replaced(bench, "LENGTH = 1.0", "LENGTH = 2.0"))


def imported_module_changed(bench: Bench) -> None:
    """A module beside the file."""
    bench.write("sizes.py", "LENGTH = 1.0\n")
    write_study(bench)
    _replaced(bench, "LENGTH = 1.0", "from sizes import LENGTH")()
    _stale(bench, lambda: bench.write("sizes.py", "LENGTH = 2.0\n"))


def late_import_changed(bench: Bench) -> None:
    """A module that is imported by name while the model is built."""
    bench.write("sizes.py", "LENGTH = 1.0\n")
    write_study(
        bench, "global LENGTH; LENGTH = __import__('importlib').import_module('sizes').LENGTH"
    )
    _stale(bench, lambda: bench.write("sizes.py", "LENGTH = 2.0\n"))


def data_file_changed(bench: Bench) -> None:
    """A data file that is read as the study's file is imported."""
    bench.write("length.txt", "1.0")
    write_study(bench)
    read = "LENGTH = float(Path(__file__).with_name('length.txt').read_text())"
    _replaced(bench, "LENGTH = 1.0", read)()
    _stale(bench, lambda: bench.write("length.txt", "2.0"))


def data_of_the_function_changed(bench: Bench) -> None:
    """A data file that is read while the model is built."""
    path = bench.write("length.txt", "1.0")
    write_study(bench, f"global LENGTH; LENGTH = float(Path({str(path)!r}).read_text())")
    _stale(bench, lambda: bench.write("length.txt", "2.0"))


def environment_changed(bench: Bench) -> None:
    """A global of the file that follows the environment."""
    bench.env["LENGTH"] = "1.0"
    write_study(bench)
    _replaced(bench, "LENGTH = 1.0", "LENGTH = float(os.environ['LENGTH'])")()
    _stale(bench, lambda: bench.env.update(LENGTH="2.0"))


def global_of_another_file_changed(bench: Bench) -> None:
    """A global of the model's file that the study's file sets."""
    write_study(bench)
    text = (bench.folder / "study.py").read_text()
    model, study = text.split("@bd.study", 1)
    bench.write("swinging.py", model)
    head = "import beamdae as bd\nimport swinging\nfrom swinging import swing\n"
    bench.write("study.py", f"{head}swinging.LENGTH = 1.5\n\n@bd.study{study}")
    _stale(bench, _replaced(bench, "LENGTH = 1.5", "LENGTH = 2.5"))


def all_cases_fail(bench: Bench) -> None:
    """Each case is a row with its reason, and the exit code is 1."""
    write_study(bench, "if LENGTH: raise ValueError('no arm')")
    told(bench.run(*RUN, limit=100.0), 1)
    ended = cases(bench)
    expect((ended["status"] == "failed").all(), "not all cases failed")
    expect(ended["reason"].str.contains("no arm").all(), "the reason is missing")
    expect((results(bench) / "report.html").is_file(), "no page was written")


def one_group_fails(bench: Bench) -> None:
    """A group without a success is told, and the others are measured."""
    write_study(bench, "if mass == 2.0: raise ValueError('no arm')")
    ran = told(bench.run(*RUN, limit=100.0), 1)
    ended = cases(bench)
    expect((ended["status"][ended["mass"] == 1.0] == "ok").all(), "other cases did not end")
    expect("no arm" in ran.err, "the reason is not told")


def all_errors_below_resolution(bench: Bench) -> None:
    """Cases better than the reference are marked, and told without numbers."""
    settings = "references=(bd.Radau(1e-2), bd.GeneralizedAlpha(1e-2)), time_limit=20.0"
    write_study(bench, settings=settings)
    _replaced(bench, "bd.Ida(1e-4), bd.GeneralizedAlpha(1e-3)", "bd.Radau(1e-7), bd.Ida(1e-7)")()
    done(bench, 0)
    expect((cases(bench)["status"] == "ok").all(), "not all cases ended")


def nothing_moves(bench: Bench) -> None:
    """Columns at rest have no errors relative to their range, and that is told in a sentence."""
    write_study(bench)
    _replaced(bench, "(0.0, -9.81)", "(0.0, 0.0)")()
    told(bench.run(*RUN, limit=100.0), 0, 1)


def nothing_observed(bench: Bench) -> None:
    """Cases that observe nothing cannot be compared, and that is told in a sentence."""
    write_study(bench)
    _replaced(bench, "    mech.observe(", "    0 and mech.observe(")()
    told(bench.run(*RUN, limit=100.0), 0, 1, 2)


FAULTS = (
    constant_changed,
    imported_module_changed,
    data_of_the_function_changed,
    global_of_another_file_changed,
    all_cases_fail,
    one_group_fails,
    nothing_moves,
)
# Slow, or much like one of those.
SLOW = (
    late_import_changed,
    environment_changed,
    data_file_changed,
    all_errors_below_resolution,
    nothing_observed,
)
