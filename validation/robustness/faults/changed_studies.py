"""Faults of restarted studies: changed sources, and studies with few successful cases."""

from __future__ import annotations

from robustness.faults.bench import Bench, expect, expect_exit
from robustness.faults.damaged_studies import (
    RUN,
    STUDY_TIME_LIMIT,
    read_cases,
    read_trajectories,
    results_folder,
    run_few,
    write_study,
)


def _expect_recomputed(bench: Bench, change) -> None:
    """Check that a restart after the change does not report trajectories of the first run."""
    run_few(bench, 0)
    before = set(read_trajectories(bench).values())
    change()
    run_few(bench, 0)
    used = {bench.folder / "results" / "few" / t for t in read_cases(bench)["trajectory"]}
    after = {path.read_text() for path in used}
    expect(not before & after, "results of the old model are reported for the new one")


def _replacement(bench: Bench, old: str, new: str):
    path = bench.folder / "study.py"
    return lambda: path.write_text(path.read_text().replace(old, new))


def constant_changed(bench: Bench) -> None:
    """A constant of the study's file changes."""
    write_study(bench)
    _expect_recomputed(bench, _replacement(bench, "LENGTH = 1.0", "LENGTH = 2.0"))


def imported_module_changed(bench: Bench) -> None:
    """A module next to the file changes."""
    bench.write("sizes.py", "LENGTH = 1.0\n")
    write_study(bench)
    _replacement(bench, "LENGTH = 1.0", "from sizes import LENGTH")()
    _expect_recomputed(bench, lambda: bench.write("sizes.py", "LENGTH = 2.0\n"))


def late_import_changed(bench: Bench) -> None:
    """A module changes that is imported by name while the model is built."""
    bench.write("sizes.py", "LENGTH = 1.0\n")
    write_study(
        bench, "global LENGTH; LENGTH = __import__('importlib').import_module('sizes').LENGTH"
    )
    _expect_recomputed(bench, lambda: bench.write("sizes.py", "LENGTH = 2.0\n"))


def data_file_changed(bench: Bench) -> None:
    """A data file changes that is read when the study's file is imported."""
    bench.write("length.txt", "1.0")
    write_study(bench)
    read = "LENGTH = float(Path(__file__).with_name('length.txt').read_text())"
    _replacement(bench, "LENGTH = 1.0", read)()
    _expect_recomputed(bench, lambda: bench.write("length.txt", "2.0"))


def data_file_of_the_function_changed(bench: Bench) -> None:
    """A data file changes that is read while the model is built."""
    path = bench.write("length.txt", "1.0")
    write_study(bench, f"global LENGTH; LENGTH = float(Path({str(path)!r}).read_text())")
    _expect_recomputed(bench, lambda: bench.write("length.txt", "2.0"))


def environment_changed(bench: Bench) -> None:
    """A global variable of the file that depends on the environment changes."""
    bench.env["LENGTH"] = "1.0"
    write_study(bench)
    _replacement(bench, "LENGTH = 1.0", "LENGTH = float(os.environ['LENGTH'])")()
    _expect_recomputed(bench, lambda: bench.env.update(LENGTH="2.0"))


def global_of_another_file_changed(bench: Bench) -> None:
    """The study's file changes a global variable of the model's file."""
    write_study(bench)
    text = (bench.folder / "study.py").read_text()
    model, study = text.split("@bd.study", 1)
    bench.write("swinging.py", model)
    head = "import beamdae as bd\nimport swinging\nfrom swinging import swing\n"
    bench.write("study.py", f"{head}swinging.LENGTH = 1.5\n\n@bd.study{study}")
    _expect_recomputed(bench, _replacement(bench, "LENGTH = 1.5", "LENGTH = 2.5"))


def all_cases_fail(bench: Bench) -> None:
    """Each case has a row with its reason, and the exit code is 1."""
    write_study(bench, "if LENGTH: raise ValueError('no arm')")
    expect_exit(bench.run(*RUN, time_limit=STUDY_TIME_LIMIT), 1)
    ended = read_cases(bench)
    expect((ended["status"] == "failed").all(), "not all cases failed")
    expect(ended["reason"].str.contains("no arm").all(), "the reason is missing")
    expect((results_folder(bench) / "report.html").is_file(), "no page was written")


def one_group_fails(bench: Bench) -> None:
    """A group without success is reported, and the others are measured."""
    write_study(bench, "if mass == 2.0: raise ValueError('no arm')")
    result = expect_exit(bench.run(*RUN, time_limit=STUDY_TIME_LIMIT), 1)
    ended = read_cases(bench)
    expect((ended["status"][ended["mass"] == 1.0] == "ok").all(), "other cases did not end")
    expect("no arm" in result.err, "the reason is not reported")


def errors_below_resolution(bench: Bench) -> None:
    """Cases more accurate than the reference are marked and listed without errors."""
    settings = "references=(bd.Radau(1e-2), bd.GeneralizedAlpha(1e-2)), time_limit=20.0"
    write_study(bench, settings=settings)
    _replacement(bench, "bd.Ida(1e-4), bd.GeneralizedAlpha(1e-3)", "bd.Radau(1e-7), bd.Ida(1e-7)")()
    run_few(bench, 0)
    expect((read_cases(bench)["status"] == "ok").all(), "not all cases ended")


def system_at_rest(bench: Bench) -> None:
    """Columns at rest have no relative errors; a message says so."""
    write_study(bench)
    _replacement(bench, "(0.0, -9.81)", "(0.0, 0.0)")()
    expect_exit(bench.run(*RUN, time_limit=STUDY_TIME_LIMIT), 0, 1)


def no_observables(bench: Bench) -> None:
    """Cases without observables cannot be compared; a message says so."""
    write_study(bench)
    _replacement(bench, "    mech.observe(", "    0 and mech.observe(")()
    expect_exit(bench.run(*RUN, time_limit=STUDY_TIME_LIMIT), 0, 1, 2)


FAULTS = (
    constant_changed,
    imported_module_changed,
    data_file_of_the_function_changed,
    global_of_another_file_changed,
    all_cases_fail,
    one_group_fails,
    system_at_rest,
)
# Slow, or similar to one of the faults above.
SLOW = (
    late_import_changed,
    environment_changed,
    data_file_changed,
    errors_below_resolution,
    no_observables,
)
