"""Accepted outcomes of a trial, and the rules for its messages."""

import re
import traceback
from collections.abc import Iterable
from dataclasses import dataclass, replace
from pathlib import Path

# In this order: refused with a message, failed with a reason, ran with warnings, ran with finite
# columns, interrupted (by a model file that raises KeyboardInterrupt, or by an exception of the
# user's function `progress`).
ACCEPTED_ENDS = ("refused", "failed", "warned", "ran", "interrupted")

MAX_SENTENCE_LENGTH = 600
# Reasons such as "failed: time limit of 5 s" have no period.
_ENDS_WITHOUT_PERIOD = ("failed", "interrupted")
_ADDRESS = re.compile(r"\bat 0x[0-9a-f]+|\b0x[0-9a-f]{6,}", re.IGNORECASE)
# Messages of CasADi, numpy and SUNDIALS about arguments that beamdae should have refused.
_LIBRARY_MESSAGES = re.compile(
    r"traceback \(most|casadi[/:.]|\.[ch]pp:\d|\bassert(ion)?\b.*failed|wrong number or type of arg"
    r"|possible prototypes|no matching function|\bufunc\b|broadcast together|__array__"
    r"|array element with a sequence|inhomogeneous shape|truth value of an? (array|empty)"
    r"|overflow encountered|invalid value encountered|divide by zero",
    re.IGNORECASE,
)
# Messages of Python, accepted only after the type of an exception of the user's own function.
_PYTHON_MESSAGES = re.compile(
    r"unsupported operand|not supported between|object is not (callable|iterable|subscriptable)"
    r"|has no attribute|unhashable type|unexpected keyword|positional argument|invalid literal"
    r"|cannot convert|must be real number|too large to convert|not enough values|too many values"
    r"|codec can't|surrogates not allowed|recursion depth",
    re.IGNORECASE,
)
_EXCEPTION_TYPE = re.compile(r"\b[A-Z]\w*(Error|Exception)\b[^:]*: ")
_QUOTED = re.compile(r"'(?:[^'\\]|\\.)*'|\"(?:[^\"\\]|\\.)*\"|\((?:[^()]|\([^()]*\))*\)")
_NEXT_SENTENCE = re.compile(r"(?<![.\d])[.!?]\s+[A-Z]")
# Functions raise exceptions of the user's function `progress` unchanged, as documented.
_PROGRESS_CALL = "call_progress"
_MAX_EXCEPTION_LENGTH = 500  # characters of an exception in a table
_MAX_EXCERPT_LENGTH = 120  # characters of unexpected output in a complaint

# Exit codes of beamdae.
EXIT_SUCCESS = 0
EXIT_FAILED = 1
EXIT_USAGE = 2
EXIT_INTERRUPTED = 130


@dataclass(frozen=True)
class TrialOutcome:
    """Outcome of a trial.

    Attributes
    ----------
    ended
        One of `ACCEPTED_ENDS`, or "raised" (another exception), "crashed" (death of the
        interpreter) or "hung" (time limit of the trial).
    text
        Messages, one a line, or the exception.
    output
        Any other text on standard output and standard error.
    files
        Names of files that were left behind.
    """

    ended: str
    text: str = ""
    output: str = ""
    files: tuple[str, ...] = ()


def find_complaint(outcome: TrialOutcome, words: Iterable[str] = (), exempt: bool = False) -> str:
    """Return the first reason why an outcome is not accepted, or an empty text.

    Parameters
    ----------
    outcome
        Outcome to judge.
    words
        A refusal has to name one of these, if there are any.
    exempt
        The trial runs the user's own code, which may print and whose exceptions may be quoted.
    """
    if outcome.ended not in ACCEPTED_ENDS:
        # The exception type and the function precede the colon; the message follows.
        return f"it {outcome.ended} {outcome.text.partition(': ')[0]}".strip()
    lines = outcome.text.splitlines()
    if outcome.ended == "refused" and len(lines) != 1:
        return f"{len(lines)} lines in place of one sentence"
    needs_period = outcome.ended not in _ENDS_WITHOUT_PERIOD
    for line in lines:
        complaint = check_sentence(line, exempt, needs_period)
        if complaint:
            return complaint
    if outcome.ended not in ("ran", "interrupted") and not lines:
        return "no reason is given"
    if (
        outcome.ended == "refused"
        and words
        and not any(is_named(outcome.text, word) for word in words)
    ):
        return "it names neither the part nor the argument"
    if outcome.output.strip() and not exempt:
        return f"output beside the sentence: {_excerpt(outcome.output)}"
    if outcome.files:
        return f"files are left: {', '.join(outcome.files)[:_MAX_EXCERPT_LENGTH]}"
    return ""


def _excerpt(text: str) -> str:
    return " ".join(text.split())[:_MAX_EXCERPT_LENGTH]


def check_sentence(text: str, exempt: bool = False, needs_period: bool = True) -> str:
    """Return the reason why a line is not one sentence for users, or an empty text."""
    if any(not c.isprintable() for c in text):
        return "control characters in the sentence"
    if _ADDRESS.search(text):
        return "a memory address in the sentence"
    quotes_user_code = exempt or _EXCEPTION_TYPE.search(text) is not None
    if not exempt and (
        _LIBRARY_MESSAGES.search(text) or (not quotes_user_code and _PYTHON_MESSAGES.search(text))
    ):
        return "another library's words in the sentence"
    if len(text) > MAX_SENTENCE_LENGTH:
        return f"a sentence of {len(text)} characters"
    if needs_period and not text.endswith("."):
        return "the sentence does not end with a period"
    if not exempt and _NEXT_SENTENCE.search(_QUOTED.sub("", text)):
        return "two sentences"
    return ""


def escape_unprintable(text: str) -> str:
    """Return the text with escape sequences in place of unprintable characters."""
    return "".join(c if c.isprintable() else c.encode("unicode_escape").decode() for c in text)


def is_named(text: str, word: str) -> bool:
    """Return whether the text contains the name of a part, an argument or a file."""
    return re.search(rf"(?<!\w){re.escape(word)}(?!\w)", text) is not None


def outcome_of_exception(error: BaseException) -> TrialOutcome:
    """Return the outcome of an unexpected exception, with the innermost function of beamdae."""
    frames = traceback.extract_tb(error.__traceback__)
    if any(frame.name == _PROGRESS_CALL for frame in frames[:-1]) and (
        "/beamdae/" not in frames[-1].filename
    ):
        return TrialOutcome("interrupted", "progress raised an exception")
    package_frames = [frame for frame in frames if "/beamdae/" in frame.filename]
    where = "code beside beamdae"
    if package_frames:
        where = f"{Path(package_frames[-1].filename).stem}.{package_frames[-1].name}"
    try:
        message = str(error)
    except Exception as another:  # A model file may raise an exception whose __str__ raises.
        message = f"{type(another).__name__} of its text"
    text = f"{type(error).__name__} in {where}: {message}"
    return TrialOutcome("raised", text[:_MAX_EXCEPTION_LENGTH])


def outcome_of_command(code: int, out: str, err: str) -> TrialOutcome:
    """Return the outcome of a command by its exit code and standard error.

    0: it ran, perhaps with warnings. 1, or 130 after an interrupt: a reason is given and computed
    rows are kept. 2: a usage error, one line that begins with "error:", or usage and one line of
    the option parser. Any other exit code is a crash.
    """
    everything = f"{out}\n{err}"
    if "Traceback (most recent call last)" in everything:
        return TrialOutcome("raised", everything.strip().splitlines()[-1])
    if code not in (EXIT_SUCCESS, EXIT_FAILED, EXIT_USAGE, EXIT_INTERRUPTED):
        return TrialOutcome("crashed", f"exit code {code}: {' '.join(err.split())[-200:]}")
    messages, other = _split_messages(err)
    text = "\n".join(messages)
    if code == EXIT_USAGE:
        return TrialOutcome("refused", text, other + out)
    if code in (EXIT_FAILED, EXIT_INTERRUPTED):
        return TrialOutcome("failed" if code == EXIT_FAILED else "interrupted", text, other)
    outcome = TrialOutcome("ran", "", other)
    return replace(outcome, ended="warned", text=text) if messages else outcome


_USAGE = re.compile(r"^(Usage:|Try ')")
# Progress of studies, and of runs that take longer than ten seconds, for example because the
# machine is loaded or code is compiled.
_PROGRESS = re.compile(r"^.+: \S+/\d\S*( s)?, (-:--|[\d:]+) left$")


def remove_progress(err: str) -> str:
    """Return standard error without lines of progress."""
    lines = err.splitlines(keepends=True)
    return "".join(line for line in lines if not _PROGRESS.match(line.rstrip("\n")))


def _split_messages(err: str) -> tuple[list[str], str]:
    """Split standard error into messages without their labels, and other text."""
    messages, other = [], []
    for line in _unbox_lines(remove_progress(err)):
        label, colon, rest = line.partition(": ")
        if colon and label == "Error":
            # The option parser omits the period and may append a hint.
            messages.append(rest.split(". ")[0].rstrip(".") + ".")
        elif colon and label in ("error", "failed", "warning", "interrupted"):
            messages.append(rest.strip())
        elif line.strip() and not _USAGE.match(line):
            other.append(line)
    return messages, "\n".join(other)


def _unbox_lines(err: str) -> list[str]:
    """Return lines of standard error, with the option parser's box joined into one line."""
    lines, inside = [], None
    for line in err.splitlines():
        if line.startswith("╭"):
            inside = []
        elif line.startswith("╰") and inside is not None:
            lines.append(f"Error: {' '.join(inside)}")
            inside = None
        elif inside is not None:
            inside.append(line.strip("│ "))
        else:
            lines.append(line)
    return lines
