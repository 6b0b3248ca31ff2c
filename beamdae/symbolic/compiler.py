"""The C compiler: which one CC names, and runs of it that neither hang nor change results."""

from __future__ import annotations

import os
import re
import shlex
import shutil
import signal
import subprocess
from contextlib import suppress
from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path
from typing import IO

FLAGS = ("-shared", "-fPIC", "-O1", "-ffp-contract=off")
# Kernels take a second or two; a compiler that takes so much longer [s] hangs.
_PATIENCE = 15.0
# Of CC the command is taken and what it is to compile for and with: these change no operation.
# How to compute is for FLAGS to say, and no list of what must not be said there is complete.
_PLACES = re.compile(
    r"-m(32|64)|--?target=.+|--sysroot=.+|--gcc-(toolchain|install-dir)=.+|-fuse-ld=.+"
    r"|-pipe|-(isystem|isysroot|I|L|B).+"
)
_PLACES_APART = ("-isystem", "-isysroot", "-target", "-arch", "-I", "-L", "-B")


class CompilerError(Exception):
    """A compiler that cannot be used; the message names it and says why."""


@dataclass(frozen=True)
class Compiler:
    """A command that compiles, from CC."""

    command: tuple[str, ...]

    def __str__(self) -> str:
        return " ".join(self.command)

    def build(self, source: Path, library: Path) -> None:
        """Compile a C file to a shared library.

        Raises
        ------
        CompilerError
            If it fails, takes too long or leaves nothing.
        """
        # No pipe: children that outlive the compiler would keep it open.
        messages = source.with_suffix(".txt")
        with messages.open("wb") as file:
            code = _run([*self.command, *FLAGS, str(source), "-o", str(library)], file)
        if code is None:
            raise CompilerError(
                f"{self}: it was stopped, a kernel took it more than {_PATIENCE:g} s"
            )
        if code != 0:
            said = messages.read_text(encoding="utf-8", errors="replace").split("\n", 1)[0].strip()
            raise CompilerError(f"{self}: it cannot compile kernels ({said or f'code {code}'})")
        if not library.is_file() or not library.stat().st_size:
            raise CompilerError(f"{self}: it leaves no library")


def compiler() -> Compiler | None:
    """The compiler CC names, else cc; None where CC names none and there is no cc.

    Raises
    ------
    CompilerError
        If CC is no command, or has a flag that may change results.
    """
    text = os.environ.get("CC", "").strip()
    try:
        words = shlex.split(text) or ["cc"]
    except ValueError:
        raise CompilerError(f"CC={text}: a quote in it is not closed") from None
    program = shutil.which(words[0])
    if program is None:
        if not text:
            return None
        raise CompilerError(f"CC={text}: there is no program {words[0]}")
    for before, word in pairwise(words):
        if not _is_harmless(before, word):
            raise CompilerError(
                f"CC={text}: {word} may change results, allowed are the compiler, wrappers such "
                "as ccache, and flags of the target and of folders (-m64, --target=, --sysroot=, "
                "-isystem and the like)"
            )
    return Compiler((program, *words[1:]))


def _is_harmless(before: str, word: str) -> bool:
    """Whether a word of CC after another one leaves alone how numbers are computed."""
    if word.startswith("-"):
        return bool(_PLACES.fullmatch(word)) or word in _PLACES_APART
    return before in _PLACES_APART or shutil.which(word) is not None


def _run(command: list[str], messages: IO[bytes]) -> int | None:
    """The exit code of a command, or None if it had to be stopped with all it started."""
    nothing = subprocess.DEVNULL
    try:
        process = subprocess.Popen(
            command,
            stdin=nothing,
            stdout=nothing,
            stderr=messages,
            start_new_session=True,
        )
    except OSError as problem:
        raise CompilerError(f"{command[0]}: it cannot be run, {problem.strerror}") from problem
    try:
        return process.wait(_PATIENCE)
    except subprocess.TimeoutExpired:
        return None
    finally:
        # An interrupt does not reach its session either.
        if process.returncode is None:
            _stop(process)


def _stop(process: subprocess.Popen[bytes]) -> None:
    with suppress(ProcessLookupError):
        if hasattr(os, "killpg"):
            os.killpg(process.pid, signal.SIGKILL)
        else:
            process.kill()
    # What waits for a disk dies later.
    with suppress(subprocess.TimeoutExpired):
        process.wait(1.0)
