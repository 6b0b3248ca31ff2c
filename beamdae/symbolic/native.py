"""Machine code for kernels: compiled once where there is a C compiler, cached for later runs.

The code performs the same operations in the same order as CasADi's virtual machine, without
contraction, so results are the same to the last bit; the kernels alone are about six times as
fast. They depend on the element type alone, so a handful of files serve all models. Without a
compiler or a writable cache, or with BEAMDAE_NATIVE=off in the environment, the virtual machine is
used.
"""

from __future__ import annotations

import hashlib
import os
import shlex
import shutil
import subprocess
import sys
import tempfile
from pathlib import Path

import casadi as ca

_FLAGS = ("-shared", "-fPIC", "-O1", "-ffp-contract=off")


def native(function: ca.Function) -> ca.Function:
    """The function as machine code, or as it is where that cannot be had."""
    command = shlex.split(os.environ.get("CC", "cc")) or ["cc"]
    compiler = shutil.which(command[0])
    if compiler is None or os.environ.get("BEAMDAE_NATIVE", "on") == "off":
        return function
    generator = ca.CodeGenerator(f"{function.name()}.c")
    generator.add(function)
    source = generator.dump()
    command[0] = compiler
    recipe = "\n".join([source, *command, *_FLAGS, sys.platform])
    name = f"{function.name()}-{hashlib.sha256(recipe.encode()).hexdigest()[:24]}.so"
    try:
        library = cache_folder() / name
        if not library.exists():
            _compile(command, source, library)
        return ca.external(function.name(), str(library))
    except (OSError, RuntimeError, subprocess.SubprocessError):
        return function


def cache_folder() -> Path:
    """Where compiled kernels are kept: beamdae/ in the user's cache folder."""
    root = os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache"
    return Path(root) / "beamdae"


def _compile(command: list[str], source: str, library: Path) -> None:
    library.parent.mkdir(parents=True, exist_ok=True)
    with tempfile.TemporaryDirectory(dir=library.parent) as folder:
        code, built = Path(folder) / "kernel.c", Path(folder) / library.name
        code.write_text(source)
        build = [*command, *_FLAGS, str(code), "-o", str(built)]
        subprocess.run(build, check=True, capture_output=True, timeout=60)
        # Renaming is atomic: another process sees the whole library or none.
        os.replace(built, library)
