"""Scoreboard of validation: no verdict of a short case is worse; a worse value is refused."""

import pytest
import scoreboard


@pytest.mark.slow
def test_worse_values_are_refused(monkeypatch, tmp_path, capsys):
    path = tmp_path / "scoreboard.csv"
    modes = next(x for x in scoreboard.BOARDS if x.name == "modes")
    names = list(modes.cases())[:2]
    board = scoreboard.Board("modes", lambda: names, modes.attempt, quick=2)
    broken = scoreboard.Board("broken", lambda: ["no number"], int, quick=1)
    monkeypatch.setattr(scoreboard, "BOARDS", (board, broken))
    monkeypatch.setattr(scoreboard, "STORED", path)
    monkeypatch.setattr("sys.argv", ["scoreboard.py", "--store"])
    assert scoreboard.main() == 0
    rows = scoreboard.read_stored(path)
    assert list(rows["verdict"]) == ["right", "right", "missed"]
    assert rows["reason"].iloc[-1].startswith("ValueError")
    # Worst digits of a board may decrease by less than 0.3.
    assert not scoreboard.find_losses(rows[:2], rows.assign(digits=rows["digits"] + 0.2))
    losses = scoreboard.find_losses(rows[:2], rows.assign(digits=rows["digits"] + 0.4))
    assert losses[0].startswith("modes: digits ")
    # Machines differ, but not tenfold.
    assert not scoreboard.find_losses(rows[:2], rows.assign(seconds=0.2 * rows["seconds"]))
    losses = scoreboard.find_losses(rows[:2].assign(seconds=200.0), rows.assign(seconds=2.0))
    assert losses[0] == "modes: seconds 2.0 -> 200"
    # What becomes better is no loss.
    assert not scoreboard.find_losses(rows[:2], rows.assign(verdict="false"))
    rows.assign(verdict="right").to_csv(path, index=False)
    monkeypatch.setattr("sys.argv", ["scoreboard.py"])
    capsys.readouterr()
    assert scoreboard.main() == 1
    lines = capsys.readouterr().out.splitlines()
    assert lines[-2] == "broken: right 1 -> 0, missed 0 -> 1"
    assert lines[-1].startswith("  no number: missed, ValueError")


BOARDS = (
    *("critical loads", "tolerances", "record"),
    *("equilibria", "modes", "periodic motions", "section forces"),
    *("errors of equilibria", "errors of modes", "errors of motions"),
)
STORED = scoreboard.read_stored(scoreboard.STORED)
ATTEMPTS = {board.name: board.attempt for board in scoreboard.BOARDS}


def short_cases():
    cases = STORED[STORED["board"].isin(BOARDS) & (STORED["seconds"] < 3.0)]
    for row in cases.itertuples():
        marks = [] if row.seconds < 0.1 else [pytest.mark.slow]
        yield pytest.param(
            row.board, row.case, row.verdict, id=f"{row.board}: {row.case}", marks=marks
        )


@pytest.mark.parametrize(("board", "case", "verdict"), list(short_cases()))
def test_no_verdict_is_worse_than_the_stored_one(board, case, verdict):
    for outcome in scoreboard.run_case(ATTEMPTS[board], case):
        order = scoreboard.VERDICTS.index
        assert order(outcome.verdict) <= order(verdict), outcome.reason
