"""Extensions printed in `.docs/develop/extend.md` satisfy the laws of their kind."""

import os
import re
import subprocess
import sys
from pathlib import Path

import pytest

HERE = Path(__file__).parent
# Tests that run over everything conformance lists.
LAWS = (
    "parts/test_joints.py",
    "properties/test_catalog_laws.py",
    "beams/test_kinematics.py",
    "integrators/test_integrators.py",
    "integrators/test_breakpoints.py",
)
MIN_TESTS = {"rod": 8, "dashpot": 2, "exact": 8, "bathe": 10}


@pytest.mark.slow
def test_printed_extensions_satisfy_every_law_of_their_kind(tmp_path):
    page = (HERE.parent / ".docs" / "develop" / "extend.md").read_text()
    blocks = re.findall(r"```python\n(.*?)```", page, re.S)
    assert len(blocks) == 5
    (tmp_path / "extension.py").write_text("\n\n".join(blocks))
    paths = [tmp_path, HERE, *(Path(p) for p in sys.path if p)]
    environment = os.environ | {"PYTHONPATH": os.pathsep.join(map(str, paths))}
    command = [sys.executable, "-m", "pytest", "-p", "extension", "-p", "no:cacheprovider", "-vv"]
    command += ["-m", "slow or not slow", "-n", "0", "-k", " or ".join(MIN_TESTS)]
    command += [*(str(HERE / file) for file in LAWS)]
    run = subprocess.run(
        command, capture_output=True, text=True, env=environment, cwd=HERE.parent, timeout=300
    )
    assert run.returncode == 0, run.stdout[-4000:] + run.stderr[-2000:]
    for name, min_count in MIN_TESTS.items():
        passed_tests = [
            line for line in run.stdout.splitlines() if name in line and "PASSED" in line
        ]
        assert len(passed_tests) >= min_count, f"{name}: {len(passed_tests)} laws"
