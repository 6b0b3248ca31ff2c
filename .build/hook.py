"""Hook of hatchling that adds prebuilt machine code to wheels, but not to editable installs."""

from __future__ import annotations

import os
import platform
import subprocess
import sys
import tempfile
from pathlib import Path
from typing import Any

from hatchling.builders.hooks.plugin.interface import BuildHookInterface

_PREBUILD = Path(__file__).with_name("prebuild.py")
_WHEEL_FOLDER = "beamdae/native/prebuilt"


class PrebuiltObjectsHook(BuildHookInterface):
    """Hook that runs `prebuild.py` in a separate process and adds its files to the wheel.

    Wheels built on systems other than Linux on x86-64 contain no objects.
    """

    def initialize(self, version: str, build_data: dict[str, Any]) -> None:
        """Compile the objects into a temporary folder."""
        is_enabled = os.environ.get("BEAMDAE_NATIVE") != "off"
        if version == "editable" or not is_enabled or not _is_supported():
            return
        self._folder = tempfile.TemporaryDirectory()
        # Keep the output of the program out of the standard output of the build.
        subprocess.run(
            [sys.executable, str(_PREBUILD), self._folder.name], check=True, stdout=sys.stderr
        )
        build_data["force_include"][self._folder.name] = _WHEEL_FOLDER
        # The objects import no more of the C library than memset and mathematical functions, all
        # older than this version of it.
        build_data |= {"pure_python": False, "tag": "py3-none-manylinux_2_17_x86_64"}

    def finalize(self, version: str, build_data: dict[str, Any], artifact_path: str) -> None:
        """Remove the temporary folder."""
        if hasattr(self, "_folder"):
            self._folder.cleanup()


def _is_supported() -> bool:
    return sys.platform == "linux" and platform.machine() == "x86_64"
