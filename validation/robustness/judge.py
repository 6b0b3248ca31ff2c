"""What is right: how an input may end, and what a sentence has to be."""

from __future__ import annotations

import re
import traceback
from collections.abc import Iterable
from dataclasses import dataclass, replace
from pathlib import Path

# How an input may end: refused by a sentence, a result that tells why it is none, one that is
# told with warnings, or one with finite columns; and a command whose file was an interrupt.
RIGHT = ("refused", "failed", "warned", "ran", "interrupted")
# And how it must not: another exception, the end of the interpreter, no end within its limit.
WRONG = ("raised", "crashed", "hung")

LONGEST = 600
# Their reasons have no period: "failed: time limit of 5 s".
_UNFINISHED = ("failed", "interrupted")
_ADDRESS = re.compile(r"\bat 0x[0-9a-f]+|\b0x[0-9a-f]{6,}", re.IGNORECASE)
# What other libraries say when they are given what is none of their business.
_FOREIGN = re.compile(
    r"traceback \(most|casadi[/:.]|\.[ch]pp:\d|\bassert(ion)?\b.*failed|wrong number or type of arg"
    r"|possible prototypes|no matching function|\bufunc\b|broadcast together|__array__"
    r"|array element with a sequence|inhomogeneous shape|truth value of an? (array|empty)"
    r"|overflow encountered|invalid value encountered|divide by zero",
    re.IGNORECASE,
)
# What Python says: of a function of the user's own it may be told, after the type of the error.
_PYTHON = re.compile(
    r"unsupported operand|not supported between|object is not (callable|iterable|subscriptable)"
    r"|has no attribute|unhashable type|unexpected keyword|positional argument|invalid literal"
    r"|cannot convert|must be real number|too large to convert|not enough values|too many values"
    r"|codec can't|surrogates not allowed|recursion depth",
    re.IGNORECASE,
)
_TYPE = re.compile(r"\b[A-Z]\w*(Error|Exception)\b[^:]*: ")
_QUOTED = re.compile(r"'(?:[^'\\]|\\.)*'|\"(?:[^\"\\]|\\.)*\"|\((?:[^()]|\([^()]*\))*\)")
_NEXT_SENTENCE = re.compile(r"(?<![.\d])[.!?]\s+[A-Z]")


@dataclass(frozen=True)
class Seen:
    """What became of an input.

    Attributes
    ----------
    ended
        One of `RIGHT` or `WRONG`.
    text
        The sentences that were told, a line each, or the exception.
    output
        What else came to standard output and standard error.
    files
        What was left behind.
    """

    ended: str
    text: str = ""
    output: str = ""
    files: tuple[str, ...] = ()


def complaint(seen: Seen, words: Iterable[str] = (), exempt: bool = False) -> str:
    """Why that is not right; nothing if it is.

    A refusal is one sentence that names one of `words`, if there are any; `exempt` is one about
    code of the user's own, which may print and whose exceptions may be repeated.
    """
    if seen.ended not in RIGHT:
        # What was raised, and where, comes before what it says.
        return f"it {seen.ended} {seen.text.partition(': ')[0]}".strip()
    lines = seen.text.splitlines()
    if seen.ended == "refused" and len(lines) != 1:
        return f"{len(lines)} lines in place of one sentence"
    found = (not_a_sentence(line, exempt, seen.ended not in _UNFINISHED) for line in lines)
    first = next(filter(None, found), "")
    if first:
        return first
    if seen.ended not in ("ran", "interrupted") and not lines:
        return "no reason is told"
    if seen.ended == "refused" and words and not any(names(seen.text, word) for word in words):
        return "it names neither the part nor the argument"
    if seen.output.strip() and not exempt:
        return f"output beside the sentence: {' '.join(seen.output.split())[:120]}"
    if seen.files:
        return f"files are left: {', '.join(seen.files)[:120]}"
    return ""


def not_a_sentence(text: str, exempt: bool = False, whole: bool = True) -> str:
    """Why a line is not one sentence for users; `whole` ones end with a period."""
    if any(not c.isprintable() for c in text):
        return "control characters in the sentence"
    if _ADDRESS.search(text):
        return "a memory address in the sentence"
    own = exempt or _TYPE.search(text) is not None
    if not exempt and (_FOREIGN.search(text) or (not own and _PYTHON.search(text))):
        return "another library's words in the sentence"
    if len(text) > LONGEST:
        return f"a sentence of {len(text)} characters"
    if whole and not text.endswith("."):
        return "the sentence does not end with a period"
    if not exempt and _NEXT_SENTENCE.search(_QUOTED.sub("", text)):
        return "two sentences"
    return ""


def printable(text: str) -> str:
    """The text with what no file or terminal takes told by its code."""
    return "".join(c if c.isprintable() else c.encode("unicode_escape").decode() for c in text)


def names(text: str, word: str) -> bool:
    """Whether a sentence names a part, an argument or a file."""
    return re.search(rf"(?<!\w){re.escape(word)}(?!\w)", text) is not None


def raised(problem: BaseException) -> Seen:
    """An exception nobody should have seen, with the function of beamdae it came out of."""
    frames = traceback.extract_tb(problem.__traceback__)
    own = [f for f in frames if "/beamdae/" in f.filename]
    where = f"{Path(own[-1].filename).stem}.{own[-1].name}" if own else "code beside beamdae"
    try:
        message = str(problem)
    except Exception as another:  # One whose text is an error as well.
        message = f"{type(another).__name__} of its text"
    return Seen("raised", f"{type(problem).__name__} in {where}: {message}"[:500])


def command_seen(code: int, out: str, err: str) -> Seen:
    """What a command came to: its exit code tells how it ended, standard error why.

    0: it ran, perhaps with warnings; 1 and, after an interrupt, 130: it tells a reason and keeps
    what was computed; 2: a mistake, one line that begins with "error:", or the option parser's
    usage with one line. Anything else is an end that nobody foresaw.
    """
    everything = f"{out}\n{err}"
    if "Traceback (most recent call last)" in everything:
        return Seen("raised", everything.strip().splitlines()[-1])
    if code not in (0, 1, 2, 130):
        return Seen("crashed", f"exit code {code}: {' '.join(err.split())[-200:]}")
    told, other = _sentences(err)
    if code == 2:
        return Seen("refused", "\n".join(told), other + out)
    if code in (1, 130):
        return Seen("failed" if code == 1 else "interrupted", "\n".join(told), other)
    found = Seen("ran", "", other)
    return replace(found, ended="warned", text="\n".join(told)) if told else found


_USAGE = re.compile(r"^(Usage:|Try ')")
_PROGRESS = re.compile(r"^\d+ of \d+ runs, ")


def _sentences(err: str) -> tuple[list[str], str]:
    """The lines told to the user without their labels, and what else there is."""
    told, other = [], []
    for line in _unboxed(err):
        label, colon, rest = line.partition(": ")
        if colon and label == "Error":
            # The option parser leaves the period out, and may add a hint.
            told.append(rest.split(". ")[0].rstrip(".") + ".")
        elif colon and label in ("error", "failed", "warning", "interrupted"):
            told.append(rest.strip())
        elif line.strip() and not _USAGE.match(line) and not _PROGRESS.match(line):
            other.append(line)
    return told, "\n".join(other)


def _unboxed(err: str) -> list[str]:
    """Lines of standard error; the box of the option parser's message is one line."""
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
