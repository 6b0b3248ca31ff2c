"""The user's C compiler: which it is, and one run of it that cannot hang or change results."""

from __future__ import annotations

import os
import shlex
import shutil
import signal
import subprocess
import tempfile
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from beamdae.errors import shown

FLAGS = ("-shared", "-fPIC", "-O1", "-ffp-contract=off")
# Kernels compile in a second or two; what takes so much longer [s] hangs.
_PATIENCE = 30.0
# What may stand in CC beside compilers: where things are and what is built for, but nothing of how
# numbers are computed. An option not known here may be one of those.
_PLACES = ("-isystem", "-isysroot", "-target", "-I", "-L", "-B")
_HARMLESS = (*_PLACES, "--target=", "--sysroot=", "-fuse-ld=", "-m64", "-pipe", "-w")


class CompilerError(Exception):
    """A compiler that cannot be used; the message says why."""


@dataclass(frozen=True)
class Compiler:
    """A command that compiles, as CC has it."""

    command: tuple[str, ...]

    def build(self, source: str, library: Path) -> None:
        """Compile C to a shared library.

        Raises
        ------
        CompilerError
            If it fails, does not end in half a minute, or leaves nothing.
        """
        with tempfile.TemporaryDirectory(dir=library.parent) as folder:
            code = Path(folder) / "kernel.c"
            code.write_text(source, encoding="utf-8")
            self._run([*self.command, *FLAGS, str(code), "-o", str(library)])
        if not library.is_file() or not library.stat().st_size:
            raise CompilerError(f"{self}: it leaves no library")

    def _run(self, command: Sequence[str]) -> None:
        nothing = subprocess.DEVNULL
        try:
            # A session of its own: what it starts ends with it.
            process = subprocess.Popen(
                command, stdin=nothing, stdout=nothing, stderr=nothing, start_new_session=True
            )
        except OSError as problem:
            raise CompilerError(f"{self}: it cannot be run, {problem.strerror}") from problem
        try:
            code = process.wait(_PATIENCE)
        except subprocess.TimeoutExpired:
            raise CompilerError(f"{self}: it does not end within {_PATIENCE:g} s") from None
        finally:
            _end(process)
        if code:
            raise CompilerError(f"{self}: it ends with code {code}")

    def __str__(self) -> str:
        return f"compiler {shown(shlex.join(self.command))}"


def _end(process: subprocess.Popen[bytes]) -> None:
    """Leave nothing of a process that still runs, and nothing it started."""
    if process.poll() is not None:
        return
    if hasattr(os, "killpg"):
        os.killpg(process.pid, signal.SIGKILL)
    else:
        process.kill()
    process.wait()


def compiler() -> Compiler | None:
    """The compiler that CC names, else cc; None if there is no cc.

    Raises
    ------
    CompilerError
        If CC is no command, or has options that may change results.
    """
    text = os.environ.get("CC", "").strip()
    try:
        words = shlex.split(text) or ["cc"]
    except ValueError:
        raise CompilerError(
            f"CC = {shown(text)}: it is no command, a quote is not closed"
        ) from None
    options, first = words[1:], shutil.which(words[0])
    if first is None:
        if not text:
            return None
        raise CompilerError(f"CC = {shown(text)}: there is no command {shown(words[0])}")
    for before, option in zip(words, options, strict=False):
        if not _is_harmless(before, option):
            raise CompilerError(
                f"CC = {shown(text)}: {shown(option)} may change results, allowed are options of "
                "where things are and what is built for, such as --sysroot=... and -m64"
            )
    return Compiler((first, *options))


def _is_harmless(before: str, option: str) -> bool:
    """Whether a word of CC, after another one, leaves alone how numbers are computed."""
    # After a wrapper such as ccache.
    command = not option.startswith("-") and shutil.which(option) is not None
    return before in _PLACES or command or option.startswith(_HARMLESS)
