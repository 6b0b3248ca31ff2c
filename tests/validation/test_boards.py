"""Cases of the scoreboard with a short run: no verdict is worse than the stored one."""

import pytest
import scoreboard

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
        marks = [] if row.seconds < 0.1 else [pytest.mark.slow(reason="0.1 to 3 s")]
        yield pytest.param(
            row.board, row.case, row.verdict, id=f"{row.board}: {row.case}", marks=marks
        )


@pytest.mark.parametrize(("board", "case", "verdict"), list(short_cases()))
def test_no_verdict_is_worse_than_the_stored_one(board, case, verdict):
    for outcome in scoreboard.run_case(ATTEMPTS[board], case):
        order = scoreboard.VERDICTS.index
        assert order(outcome.verdict) <= order(verdict), outcome.reason
