"""Hashes of values that are the same in every process, whatever the values are."""

from __future__ import annotations

import hashlib
from types import ModuleType
from typing import Any

import cloudpickle
import numpy as np

from beamdae.studies.store.contents import FingerprintError, parts_of, plain


def digest(value: Any) -> str:
    """Hash of a value: equal for equal values, in every process.

    Raises
    ------
    FingerprintError
        If the value, or a part of it, has no contents to tell it by: a lock, a generator, an open
        file, a pickle with an address in it.
    """
    return _Walk().digest(value).hex()


def parameter_digest(value: Any) -> str:
    """`digest` of a value that goes to another process, and has to be the same there.

    Raises
    ------
    FingerprintError
        See `digest`; also where its copy is told apart from it.
    """
    found = digest(value)
    if not isinstance(value, (bool, int, float, str, bytes, type(None), np.ndarray)):
        try:
            copy = cloudpickle.loads(cloudpickle.dumps(value))
        except Exception as problem:  # Whatever objects do when they are pickled.
            raise FingerprintError(value) from problem
        if digest(copy) != found:
            raise FingerprintError(value)
    return found


class _Walk:
    """One way through a value and all it refers to; cycles are told by their length."""

    def __init__(self) -> None:
        self._above: dict[int, int] = {}
        # With the values, for their addresses are theirs as long as they live.
        self._known: dict[tuple[int, bool], tuple[bytes, Any]] = {}
        self._in_module = False

    def digest(self, value: Any) -> bytes:
        text = plain(value)
        if text is not None:
            return hashlib.sha256(text).digest()
        in_module = self._in_module
        key = (id(value), in_module)
        if key in self._known:
            return self._known[key][0]
        if id(value) in self._above:
            above = len(self._above) - self._above[id(value)]
            return hashlib.sha256(b"cycle %d" % above).digest()
        self._above[id(value)] = len(self._above)
        self._in_module = in_module or isinstance(value, ModuleType)
        try:
            found = self._content(value)
        except RecursionError:
            raise FingerprintError(value) from None
        finally:
            del self._above[id(value)]
            self._in_module = in_module
        self._known[key] = (found, value)
        return found

    def _content(self, value: Any) -> bytes:
        kind, parts = parts_of(value)
        digests = []
        for name, part in parts:
            try:
                digests.append(hashlib.sha256(name.encode()).digest() + self.digest(part))
            except FingerprintError as problem:
                if self._in_module:
                    # Of all a module has, it is not known what is used; what is beside this counts.
                    digests.append(f"{name} {problem.kind}".encode())
                    continue
                problem.inside.append(name)
                raise
        if isinstance(value, (set, frozenset)):
            digests.sort()
        return hashlib.sha256(b"\0".join([kind.encode(), *digests])).digest()
