"""Run everything that must not get worse, print one line a board, and compare with stored values.

    python validation/scoreboard.py                full boards (about an hour of processor time)
    python validation/scoreboard.py --quick        a fixed sample of each (about three minutes)
    python validation/scoreboard.py --only modes   one board; may be repeated
    python validation/scoreboard.py --store        renew the values of the cases that were run
    python validation/scoreboard.py --seed 7       other samples of robustness; --all: all trials

The exit code is 1 if a line is worse than its cases in scoreboard.csv: one has a worse verdict (one
that is not stored, if it is not right), the worst digits are less by more than 0.3, or a case
takes over ten times as long and over 30 s longer.
"""

import argparse
import os
import sys
import tempfile
import time
import warnings
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import asdict, dataclass, replace
from functools import cache, partial
from importlib import import_module
from importlib.util import find_spec
from pathlib import Path
from pkgutil import resolve_name
from types import ModuleType
from typing import Any

HERE = Path(__file__).parent
_FOLDERS = (".", "models", "tests", "validation", "validation/record", "validation/performance")
sys.path[:0] = [str(HERE.parent / folder) for folder in _FOLDERS]

import numpy as np
import pandas as pd
from robustness import isolation

import beamdae as bd

STORED = HERE / "scoreboard.csv"
MAX_LOST_DIGITS = 0.3
# Processor times differ by machine, and contain compilation where the cache is empty.
MAX_TIME_RATIO, MAX_ADDED_TIME = 10.0, 30.0  # [-], [s]
RIGHT, WRONG, MISSED, FALSE = VERDICTS = ("right", "wrong", "missed", "false")
_HEADER = f"{'board':<20}{'cases':>6}{'right':>6}{'wrong':>6}{'missed':>7}{'false':>6}"
_HEADER += f"{'digits':>7}{'seconds':>8}{'count':>9}"


@dataclass(frozen=True)
class Outcome:
    """Outcome of a case.

    Attributes
    ----------
    case
        Name of the case.
    verdict
        One of `VERDICTS`: "missed" is an answer or a statement that is not given, "false" one that
        should not be given, "wrong" another answer than expected.
    digits
        Decimal digits of the worst value of the case; NaN where values have none.
    count
        Unit-free cost, such as steps; NaN if there is none.
    seconds
        Processor time [s].
    reason
        Reason for a verdict other than "right".
    """

    case: str
    verdict: str
    digits: float = np.nan
    count: float = np.nan
    seconds: float = np.nan
    reason: str = ""


@dataclass(frozen=True)
class Board:
    """A board: its cases by name, and the function that runs one in a worker process.

    Attributes
    ----------
    name
        Name of the board.
    cases
        Function that returns the names of all cases.
    attempt
        Maps the name of a case to its outcomes, of which there may be several.
    quick
        Number of cases of `--quick`, spread evenly over all.
    time_limit
        Processor time limit of a case [s].
    label
        Label of the line; defaults to the name.
    draw
        Function of a seed that returns the names to run in place of all cases, or None.
    """

    name: str
    cases: Callable[[], Sequence[str]]
    attempt: Callable[[str], Outcome | list[Outcome]]
    quick: int
    time_limit: float = 600.0
    label: str = ""
    draw: Callable[[int], Sequence[str]] | None = None

    def select(self, quick: bool, seed: int | None = 0) -> list[str]:
        """Return the names to run; without a seed, those of all cases."""
        names = list(self.cases() if self.draw is None or seed is None else self.draw(seed))
        if not quick or len(names) <= self.quick:
            return names
        return [names[(2 * k + 1) * len(names) // (2 * self.quick)] for k in range(self.quick)]


def count_digits(error: float) -> float:
    """Return the decimal digits of a relative error, from 0 to 16."""
    return float(np.clip(-np.log10(max(error, 1e-16)), 0.0, 16.0))


@cache
def _load_cases(place: str) -> dict[str, Any]:
    """Return the cases of a place "module:name" by name: a dictionary, a tuple, or a function."""
    cases = resolve_name(place)
    cases = cases() if callable(cases) else cases
    return cases if isinstance(cases, dict) else {case.name: case for case in cases}


def _judge_case(place: str, judge: Callable[[str, Any], Outcome], name: str) -> Outcome:
    return judge(name, _load_cases(place)[name])


def _case_board(
    name: str, place: str, judge: Callable[[str, Any], Outcome], quick: int, **settings: Any
) -> Board:
    """Return the board of the cases of a place, each of which `judge` runs by name and case."""
    cases, attempt = partial(_load_cases, place), partial(_judge_case, place, judge)
    return Board(name, cases, attempt, quick, **settings)


def _judge_structure(name: str, case: Any) -> Outcome:
    rows = list(case.all_rows())
    verdicts = {"missed": MISSED, "ended": MISSED, "invented": FALSE, "ok": RIGHT}
    departures = [row for row in rows if row["verdict"] != "ok"]
    worst = [verdicts.get(row["verdict"], WRONG) for row in rows]
    digits = [count_digits(row["relative"]) for row in rows if "relative" in row]
    verdict = next((x for x in (MISSED, FALSE, WRONG) if x in worst), RIGHT)
    reason = str(departures[0]) if departures else ""
    return Outcome(name, verdict, min(digits, default=np.nan), len(rows), reason=reason)


def _judge_statement(name: str, case: Any) -> Outcome:
    from error_statements.cases import compare, read_statement

    solution = case.run()
    result = compare(case, solution, read_statement(solution))
    return _report(name, result, solution.statistics.steps)


def _judge_errors(name: str, compare: Callable[[], Any]) -> Outcome:
    result = compare()
    return _report(name, result, result.wrong)


def _report(name: str, result: Any, count: float) -> Outcome:
    verdict = WRONG if result.verdict == "size" else result.verdict
    reason = f"true {result.largest:.2g}, stated {result.stated:.2g}, columns {result.wrong}"
    reason += f", named {result.named}, within a factor of two {result.sized}"
    return Outcome(name, verdict, count=count, reason=reason)


_RTOL = 1e-4


def _judge_tolerance(name: str, case: Any) -> Outcome:
    from tolerances.references import measure_errors

    solution = case.run(bd.Auto(_RTOL))
    steps = solution.statistics.steps
    if not solution.status.success:
        return Outcome(name, MISSED, count=steps, reason=solution.status.sentence)
    table = measure_errors(case, solution)
    # A reference does not decide about errors within its uncertainty.
    is_outside = (table["error"] - table["uncertainty"] > case.bound * _RTOL).any()
    reason = f"{table['error'].idxmax()}: error over rtol {table['error'].max() / _RTOL:.3g}"
    digits = count_digits(table["error"][list(case.columns)].max())
    return Outcome(name, WRONG if is_outside else RIGHT, digits, steps, reason=reason)


# Largest error of the record [half the range] that needs no warning.
_RECORD_ERROR = 0.01
_RECORD_SETTINGS = ("Auto", "Auto exact")


def _list_mechanisms() -> list[str]:
    import record

    return [f"{name}, {setting}" for name in record.all_names() for setting in _RECORD_SETTINGS]


@cache
def _load_record_references() -> dict[str, Any]:
    import record
    import scorer

    return scorer.read_references(record.REFERENCES)


def _try_mechanism(name: str) -> Outcome:
    import record
    import scorer

    mechanism, _, setting = name.partition(", ")
    problem = record.load_problem(mechanism)
    table, information = record.run_tool("beamdae", problem, setting, 8)
    steps = information.get("steps", len(table))
    if not information["success"]:
        return Outcome(name, MISSED, count=steps, reason=information["reason"])
    reference = _load_record_references()[mechanism]
    error = scorer.score_columns(*reference, table)["error"].max()
    has_warned = bool(information.get("warnings"))
    verdict = RIGHT if error <= _RECORD_ERROR else WRONG if has_warned else MISSED
    reason = f"error {error:.2g} of half the range, {'with a' if has_warned else 'no'} warning"
    return Outcome(name, verdict, count_digits(error), steps, reason=reason)


def _judge_benchmark(name: str, case: Any) -> Outcome:
    errors = case.errors()
    quantity, error = max(errors.items(), key=lambda item: item[1])
    verdict = RIGHT if error <= case.tolerance else WRONG
    reason = f"{quantity}: {error:.1e} instead of {case.tolerance:g}"
    return Outcome(name, verdict, count_digits(error), len(errors), reason=reason)


def _judge_fit(name: str, fit: Callable[[], Any]) -> Outcome:
    result = fit()
    verdict = MISSED if not result.success else RIGHT if result.is_right else WRONG
    digits = np.nan if np.isnan(result.error) else count_digits(result.error)
    return Outcome(name, verdict, digits, result.evaluations, reason=result.reason)


def _list_studies() -> dict[str, ModuleType]:
    from pan_liu_2012.run import STUDIES

    return {study.__name__: study for study in STUDIES}


def _try_study(name: str) -> list[Outcome]:
    """Judge the claims of a study; a claim is right if its verdict is the stored one."""
    from pan_liu_2012.run import judge_study, read_tables

    stored = read_tables()
    expected = stored["summary"].set_index("name")["verdict"]
    return [
        Outcome(
            row["name"],
            RIGHT if row["verdict"] == expected[row["name"]] else WRONG,
            reason=f"{row['verdict']}: {row['ours']}",
        )
        for _, row in judge_study(_list_studies()[name], stored).iterrows()
    ]


def _load_trials(module: str) -> ModuleType:
    return import_module(f"robustness.{module}")


def _list_trials(module: str) -> list[str]:
    names: list[str] = _load_trials(module).list_names()
    return names


def _draw_trials(module: str, size: int, seed: int) -> list[str]:
    """Return names of a sample; a module may have its own function for it."""
    draw = getattr(_load_trials(module), "draw_names", None)
    return draw(size, seed) if draw else isolation.draw_sample(_list_trials(module), size, seed)


def _try_trial(module: str, name: str) -> list[Outcome]:
    """Return the outcomes of a trial; those that cannot be judged are left out."""
    complaints = _load_trials(module).try_name(name)
    return [
        Outcome(name, WRONG if complaint else RIGHT, reason=complaint)
        for complaint in complaints
        if complaint is not None
    ]


def _trial_board(name: str, module: str, size: int, quick: int, time_limit: float) -> Board:
    """Return the board of the trials of a module, of which samples of `size` are run."""
    cases, attempt = partial(_list_trials, module), partial(_try_trial, module)
    return Board(name, cases, attempt, quick, time_limit, draw=partial(_draw_trials, module, size))


def _has_peer() -> bool:
    return find_spec("exudyn") is not None


_PEER_RESULTS = HERE / "performance" / "results" / "beside_exudyn.csv"
# Largest processor time relative to the peer's for the same elements and steps.
_MAX_PEER_RATIO = 0.5


def _list_peer_runs() -> list[str]:
    return list(pd.read_csv(_PEER_RESULTS)["run"])


def _time_beside_peer(name: str) -> Outcome:
    table = pd.read_csv(_PEER_RESULTS)
    if _has_peer():
        import benchmark

        peer = benchmark.start_exudyn(sys.executable)
        with peer:
            table = benchmark.compare_with_exudyn(peer, rounds=4)
    ratio = float(table.set_index("run")["ratio"][name])
    verdict = RIGHT if ratio <= _MAX_PEER_RATIO else WRONG
    return Outcome(name, verdict, count=ratio, reason=f"{ratio:.2g} times the peer's time")


_LOADS, _ERRORS = "benchmarks.critical_loads.cases:CASES", "error_statements"
BOARDS = (
    _case_board("critical loads", _LOADS, _judge_structure, quick=8, time_limit=900.0),
    _case_board("error statements", f"{_ERRORS}.cases:ALL", _judge_statement, quick=28),
    _case_board("errors of equilibria", f"{_ERRORS}.statics:list_cases", _judge_errors, quick=6),
    _case_board("errors of modes", f"{_ERRORS}.modes:list_cases", _judge_errors, quick=6),
    _case_board("errors of motions", f"{_ERRORS}.periodic:list_cases", _judge_errors, quick=6),
    _case_board("tolerances", "tolerances.cases:ALL", _judge_tolerance, quick=18),
    Board("record", _list_mechanisms, _try_mechanism, quick=10),
    _case_board("equilibria", "benchmarks.static_cases:STATIC_CASES", _judge_benchmark, quick=6),
    _case_board("modes", "benchmarks.modes:MODE_CASES", _judge_benchmark, quick=4),
    _case_board(
        "periodic motions", "benchmarks.periodic_motions:PERIODIC_CASES", _judge_benchmark, quick=3
    ),
    _case_board(
        "section forces", "benchmarks.section_forces:SECTION_FORCE_CASES", _judge_benchmark, quick=4
    ),
    _case_board("fits and designs", "fits:CASES", _judge_fit, quick=3, time_limit=1800.0),
    Board("claims of the paper", _list_studies, _try_study, quick=2, time_limit=3600.0),
    _trial_board("bad inputs", "inputs.catalog", 300, 60, 60.0),
    _trial_board("hostile files", "files", 160, 40, 60.0),
    _trial_board("random mechanisms", "mechanisms", 6, 2, 600.0),
    _trial_board("random paths", "paths", 60, 5, 120.0),
    _trial_board("faults", "faults", 6, 3, 600.0),
    _trial_board("interrupts", "interrupts", 6, 3, 400.0),
    Board(
        "times beside peer",
        _list_peer_runs,
        _time_beside_peer,
        quick=2,
        label="" if _has_peer() else "peer (stored times)",
    ),
)


def run_case(attempt: Callable[[str], Outcome | list[Outcome]], name: str) -> list[Outcome]:
    """Return the outcomes of a case; an exception is an outcome as well."""
    begin = time.process_time()
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", bd.BeamdaeWarning)
            answer = attempt(name)
    except Exception as error:
        answer = Outcome(name, MISSED, reason=f"{type(error).__name__}: {error}")
    outcomes = answer if isinstance(answer, list) else [answer]
    share = (time.process_time() - begin) / max(len(outcomes), 1)
    return [replace(outcome, seconds=share) for outcome in outcomes]


def run_board(
    board: Board, pool: isolation.ProcessPool, quick: bool, seed: int | None
) -> list[Outcome]:
    """Return the outcomes of a board in the order of its cases."""
    names, answers = board.select(quick, seed), {}
    attempt = partial(run_case, board.attempt)
    for name, answer in pool.run_trials(attempt, names, board.time_limit):
        if answer is None or answer is ...:
            ended = "crashed" if answer is None else f"took over {board.time_limit:g} s"
            answer = [Outcome(name, MISSED, seconds=board.time_limit, reason=f"it {ended}")]
        answers[name] = answer
    return [outcome for name in names for outcome in answers[name]]


def tabulate(board: str, outcomes: Iterable[Outcome]) -> pd.DataFrame:
    """Return outcomes as rows of scoreboard.csv."""
    rows = pd.DataFrame([asdict(x) for x in outcomes], columns=list(Outcome.__annotations__))
    rows.insert(0, "board", board)
    return rows


def summarize(rows: pd.DataFrame) -> dict[str, float]:
    """Return the line of a board."""
    counts = {verdict: int((rows["verdict"] == verdict).sum()) for verdict in VERDICTS}
    sums = rows[["seconds", "count"]].sum(min_count=1)
    return {"cases": len(rows), **counts, "digits": rows["digits"].min(), **sums}


def format_line(name: str, line: dict[str, float]) -> str:
    """Return the line of a board as text."""
    text = f"{name:<20}{line['cases']:>6}{line['right']:>6}{line['wrong']:>6}"
    text += f"{line['missed']:>7}{line['false']:>6}"
    for value, width, digits in (
        (line["digits"], 7, ".1f"),
        (line["seconds"], 8, ".0f"),
        (line["count"], 9, ".0f" if line["count"] >= 10.0 else ".2f"),
    ):
        text += f"{'-' if np.isnan(value) else format(value, digits):>{width}}"
    return text


def find_losses(rows: pd.DataFrame, stored: pd.DataFrame) -> list[str]:
    """Return sentences on what is worse than the stored rows of the same cases of a board.

    A case that is not stored counts as right before: a study that crashes has no stored name.
    """
    both = rows.merge(stored, "left", ["board", "case"], suffixes=("", " stored"))
    before = both["verdict stored"].fillna(RIGHT)
    # A case that becomes worse is a loss, even if another one becomes better.
    is_worse = both["verdict"].map(VERDICTS.index) > before.map(VERDICTS.index)
    losses = []
    if is_worse.any():
        pairs = ((x, (before == x).sum(), (both["verdict"] == x).sum()) for x in VERDICTS)
        losses += [f"{x} {then} -> {now}" for x, then, now in pairs if then != now]
        losses = losses or [f"worse cases {is_worse.sum()}"]
    known = both[both["digits stored"].notna()]
    now, then = known["digits"].min(), known["digits stored"].min()
    if now < then - MAX_LOST_DIGITS:
        losses.append(f"digits {then:.1f} -> {now:.1f}")
        is_worse |= both.index == known["digits"].idxmin()
    is_slower = both["seconds"] > both["seconds stored"] * MAX_TIME_RATIO + MAX_ADDED_TIME
    if is_slower.any():
        slowest = both.loc[both["seconds"].where(is_slower).idxmax()]
        losses.append(f"seconds {slowest['seconds stored']:.1f} -> {slowest['seconds']:.0f}")
        is_worse |= is_slower
    if not losses:
        return []
    cases = (f"  {x.case}: {x.verdict}, {x.reason}" for x in both[is_worse].itertuples())
    return [f"{rows['board'].iloc[0]}: {', '.join(losses)}", *cases]


def read_stored(path: Path) -> pd.DataFrame:
    """Return the stored rows; none if there is no file."""
    if not path.exists():
        return pd.DataFrame(columns=["board", *Outcome.__annotations__])
    return pd.read_csv(path, converters={"reason": str})


def store(rows: pd.DataFrame, stored: pd.DataFrame, path: Path, quick: bool) -> None:
    """Write the rows in place of those of the same boards or, if `quick`, of the same cases."""
    keys = ["board", "case"] if quick else ["board"]
    is_new = stored.set_index(keys).index.isin(rows.set_index(keys).index)
    table = pd.concat([x for x in (stored[~is_new], rows) if len(x)])
    order = {board.name: k for k, board in enumerate(BOARDS)}
    table = table.sort_values("board", key=lambda x: x.map(order), kind="stable")
    # Reasons of right cases would change with every run.
    table["reason"] = table["reason"].where(table["verdict"] != RIGHT, "")
    table.to_csv(path, index=False, float_format="%.3g")


def run_boards(
    boards: Iterable[Board], quick: bool, workers: int, seed: int | None = 0
) -> Iterator[tuple[Board, pd.DataFrame | str]]:
    """Yield the rows of each board, or the reason why it failed."""
    with isolation.ProcessPool(workers) as pool, warnings.catch_warnings():
        warnings.simplefilter("ignore", bd.BeamdaeWarning)
        for board in boards:
            try:
                yield board, tabulate(board.name, run_board(board, pool, quick, seed))
            except Exception as error:  # A board that fails is a line, not the end.
                yield board, f"failed: {type(error).__name__}: {error}"


def main() -> int:
    """Run and print the boards, and return the exit code."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--quick", action="store_true", help="a fixed sample of each board")
    names = [board.name for board in BOARDS]
    parser.add_argument("--only", action="append", choices=names, help="this board only")
    parser.add_argument("--store", action="store_true", help="renew the stored values")
    parser.add_argument("--cases", action="store_true", help="print each case that is not right")
    parser.add_argument("--workers", type=int, default=1, help="number of processes")
    parser.add_argument("--seed", type=int, default=0, help="seed of the samples of robustness")
    parser.add_argument("--all", action="store_true", help="all trials of robustness")
    options = parser.parse_args()
    boards = [board for board in BOARDS if not options.only or board.name in options.only]
    losses: list[str] = []
    seed = None if options.all else options.seed
    print(_HEADER, flush=True)
    for board, rows in run_boards(boards, options.quick, options.workers, seed):
        label = board.label or board.name
        if isinstance(rows, str):
            print(f"{label:<20}{rows}", flush=True)
            losses.append(f"{board.name}: {rows}")
            continue
        print(format_line(label, summarize(rows)), flush=True)
        if options.cases:
            for row in rows[rows["verdict"] != RIGHT].itertuples():
                print(f"  {row.case}: {row.verdict}, {row.reason}")
        if options.store:
            store(rows, read_stored(STORED), STORED, options.quick)
        else:
            losses += find_losses(rows, read_stored(STORED))
    if not options.store or losses:
        print(*(["worse than stored:", *losses] if losses else ["nothing is worse"]), sep="\n")
    return 1 if losses else 0


if __name__ == "__main__":
    # Trials that are killed leave files behind, which are deleted with this folder.
    with tempfile.TemporaryDirectory(prefix="scoreboard-") as scratch:
        os.environ["TMPDIR"] = scratch
        sys.exit(main())
