"""Build backend: hatchling, with the requirements of `prebuild` for wheels only.

Editable installs are built without machine code and need none of these requirements.
"""

from __future__ import annotations

import tomllib
from pathlib import Path
from typing import Any

from hatchling import build as _hatchling
from hatchling.build import *  # noqa: F403


def get_requires_for_build_wheel(config_settings: dict[str, Any] | None = None) -> list[str]:
    """Return the requirements of hatchling, those of a run of beamdae, and a C compiler."""
    project = tomllib.loads(Path("pyproject.toml").read_text("utf-8"))["project"]
    requirements = _hatchling.get_requires_for_build_wheel(config_settings)
    return [*requirements, *project["dependencies"], *project["optional-dependencies"]["fmu"]]
