"""Fixtures of tests that compile into a new cache."""

import pytest

from beamdae import errors
from beamdae.native import llvm


@pytest.fixture
def cache(tmp_path, monkeypatch):
    """A new cache, and a process that has not warned yet."""
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "cache"))
    monkeypatch.delenv("BEAMDAE_NATIVE", raising=False)
    monkeypatch.setattr(errors, "_issued_messages", set())
    return tmp_path / "cache" / "beamdae"


@pytest.fixture
def builds(monkeypatch):
    """Modules that LLVM compiles for this machine."""
    compile_module, modules = llvm.compile_module, []

    def compile_and_record(ir, level):
        modules.append(ir)
        return compile_module(ir, level)

    monkeypatch.setattr(llvm, "compile_module", compile_and_record)
    return modules
