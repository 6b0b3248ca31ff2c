"""Compilation of C sources by the machine's compiler or by the ziglang package."""

from __future__ import annotations

import importlib.util
import os
import platform
import shlex
import shutil
import subprocess
import sys
from collections.abc import Sequence
from pathlib import Path
from typing import NamedTuple

from beamdae.errors import BeamdaeError

# Fused multiplications would differ between processors.
CORE_FLAGS = (
    "-std=gnu11",
    "-ffp-contract=off",
    "-fno-tree-vectorize",
    "-fno-semantic-interposition",
    "-fno-math-errno",
    "-fno-trapping-math",
)
_MAX_MESSAGE_LENGTH = 500


class Platform(NamedTuple):
    """Platform of a binary.

    Attributes
    ----------
    name
        Name in FMI 3.0, the folder of the binary.
    fmi2_name
        Folder of the binary in FMI 2.0; "" if FMI 2.0 defines none.
    suffix
        Suffix of shared libraries.
    zig_target
        Target of the compiler of ziglang. The binary for Linux runs with glibc 2.17 and later.
    """

    name: str
    fmi2_name: str
    suffix: str
    zig_target: str


PLATFORMS = {
    x.name: x
    for x in (
        Platform("x86_64-linux", "linux64", ".so", "x86_64-linux-gnu.2.17"),
        Platform("aarch64-linux", "", ".so", "aarch64-linux-gnu.2.17"),
        Platform("x86_64-windows", "win64", ".dll", "x86_64-windows-gnu"),
        Platform("x86_64-darwin", "darwin64", ".dylib", "x86_64-macos"),
        Platform("aarch64-darwin", "", ".dylib", "aarch64-macos"),
    )
}


def current_platform() -> Platform | None:
    """Return the platform of this machine; None if FMUs have no name for it."""
    machine = {"amd64": "x86_64", "arm64": "aarch64"}.get(
        platform.machine().lower(), platform.machine().lower()
    )
    return PLATFORMS.get(f"{machine}-{platform.system().lower()}")


def find_compiler(part: str, target: Platform | None = None) -> list[str]:
    """Return the command of a C compiler for a platform, by default this machine.

    The compiler of this machine ($CC, cc, gcc or clang) is used for its own platform. All other
    platforms require the package ziglang, whose compiler needs no other files.

    Raises
    ------
    BeamdaeError
        If there is none.
    """
    if target in (None, current_platform()):
        candidates = (os.environ.get("CC", ""), "cc", "gcc", "clang")
        for command in filter(None, map(shlex.split, filter(None, candidates))):
            if shutil.which(command[0]):
                return command
    if importlib.util.find_spec("ziglang") is None:
        name = target.name if target else "this machine"
        remedy = ", or pass platforms=() for an FMU with sources only" if target else ""
        raise BeamdaeError(
            f"{part}: there is no C compiler for {name}; install one by "
            f'`pip install "beamdae[fmu]"`{remedy}.'
        )
    command = [sys.executable, "-P", "-m", "ziglang", "cc"]
    return [*command, "-target", target.zig_target] if target else command


def compile_library(
    part: str,
    compiler: Sequence[str],
    flags: Sequence[str],
    sources: Sequence[Path],
    file: Path,
    is_windows: bool = sys.platform == "win32",
) -> None:
    """Compile sources to a shared library, by default for this machine.

    Raises
    ------
    BeamdaeError
        If the compiler fails; with the end of its message.
    """
    position, libraries = ((), ()) if is_windows else (("-fPIC",), ("-lm",))
    names = [str(x) for x in sources]
    options = [*CORE_FLAGS, *flags, *position, "-shared", "-o", str(file)]
    run_compiler(part, [*compiler, *options, *names, *libraries])


def run_compiler(part: str, command: Sequence[str]) -> None:
    """Run a command of the compiler that writes the file after "-o".

    Raises
    ------
    BeamdaeError
        If it fails or writes no file.
    """
    try:
        result = subprocess.run(command, capture_output=True, text=True, check=False)
    except OSError as problem:
        raise BeamdaeError(
            f"{part}: the C compiler {command[0]} cannot be run ({problem.strerror}); "
            "set the environment variable CC to another compiler."
        ) from None
    output = Path(command[command.index("-o") + 1])
    if result.returncode or not output.is_file():
        message = result.stderr.strip()[-_MAX_MESSAGE_LENGTH:] or f"{output.name} is missing"
        raise BeamdaeError(
            f"{part}: the C compiler {command[0]} failed; set the environment variable CC to "
            f"another compiler. Its message ends with: {message}"
        )
