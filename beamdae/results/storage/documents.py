"""Documents: regular files in JSON with a format, a version and checked fields."""

from __future__ import annotations

import csv
import errno
import hashlib
import json
import math
import os
import re
import stat
import struct
import zipfile
import zlib
from collections.abc import Iterator, Mapping
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass, fields, replace
from io import BufferedReader
from pathlib import Path
from typing import Any, BinaryIO, Generic, TypeVar, cast

import msgspec
import numpy as np

from beamdae.errors import BeamdaeError, FileContentError, require_valid_path, short_repr
from beamdae.memory import require_memory

_MAX_BYTES = 4_000_000_000
# Exceptions of NumPy, zipfile, JSON and of functions that evaluate damaged content.
_CONTENT_ERRORS = (
    *(ArithmeticError, AttributeError, EOFError, LookupError, MemoryError, OSError),
    *(RuntimeError, SyntaxError, TypeError, ValueError, zipfile.BadZipFile, zlib.error),
    *(struct.error, csv.Error),
)


Array = np.ndarray
_T = TypeVar("_T")

# A record with an animation of 100 000 sections has 10 MB.
_MAX_JSON_BYTES = 100_000_000
# Control characters would be executed by a terminal; line breaks and tabs are part of messages.
_CONTROL_CHARACTER = re.compile(r"\x7f|(?<!\\)(?:\\\\)*\\(?:u00[0189][0-9a-f]|[bf])")
_CHECKSUM = "checksum"
_CONTENT, _NUMBERS = "document", "numbers"  # arrays of the JSON text, and of all other numbers


class ContentError(Exception):
    """Raised for content that is not allowed; the message names the field and what is allowed."""


@dataclass(frozen=True)
class FileKind:
    """Kind of a result file, for messages.

    Attributes
    ----------
    name
        Name of the kind, such as "saved run".
    remedy
        Advice if the file cannot be used, such as "run the model again from the start".
    """

    name: str
    remedy: str

    def error(self, path: Path, problem: str) -> FileContentError:
        """Return the error for the file at `path`."""
        return FileContentError(path, problem, self.remedy)

    @contextmanager
    def errors_of(self, path: Path) -> Iterator[None]:
        """Convert errors of reading or evaluating the content of a file to FileContentError."""
        try:
            yield
        except ContentError as problem:
            raise self.error(path, str(problem)) from None
        except BeamdaeError:
            raise
        except _CONTENT_ERRORS as problem:
            message = f"the file is not a complete {self.name}"
            raise self.error(path, message) from problem


@contextmanager
def open_regular_file(path: str | Path) -> Iterator[BufferedReader]:
    """Open a regular file for reading; links are followed.

    Raises
    ------
    OSError
        If the file cannot be opened, or is a device, a pipe, a socket or a folder.
    """
    _require_regular(os.stat(path).st_mode)
    # Opening a pipe that has no writer would wait; the file may be replaced after `stat`.
    flags = os.O_RDONLY | getattr(os, "O_NONBLOCK", 0) | getattr(os, "O_BINARY", 0)
    with os.fdopen(os.open(path, flags), "rb") as stream:
        _require_regular(os.fstat(stream.fileno()).st_mode)
        yield stream


def _require_regular(mode: int) -> None:
    if stat.S_ISDIR(mode):
        raise IsADirectoryError(errno.EISDIR, os.strerror(errno.EISDIR))
    if not stat.S_ISREG(mode):
        raise OSError(errno.EINVAL, "not a regular file")


@contextmanager
def open_result(path: Path, kind: FileKind, most: float = math.inf) -> Iterator[BufferedReader]:
    """Open a regular file of at most `most` bytes for reading.

    Raises
    ------
    FileContentError
        If the file cannot be opened, is not a regular file, or has more than `most` bytes.
    """
    require_valid_path(path)
    with ExitStack() as files:
        try:
            stream = files.enter_context(open_regular_file(path))
        except OSError as problem:
            why = problem.strerror or problem
            raise kind.error(path, f"the {kind.name} cannot be read: {why}") from None
        size = os.fstat(stream.fileno()).st_size
        if size > most:
            raise kind.error(
                path, f"the {kind.name} has {size} bytes, but at most {most} bytes are allowed"
            )
        yield stream


def read_bytes(path: Path, kind: FileKind, most: int = _MAX_BYTES) -> bytes:
    """Return the content of a regular file, see `open_result`."""
    with open_result(path, kind, most) as stream, kind.errors_of(path):
        # Files that grow while they are read are truncated, and fail their checksum.
        return stream.read(most)


@dataclass(frozen=True)
class Format(Generic[_T]):
    """Format of documents.

    Attributes
    ----------
    kind
        Kind of the files, for messages.
    version
        Number of the format; other versions are not read.
    content
        Type of the content.
    """

    kind: FileKind
    version: int
    content: type[_T]

    def write(self, content: _T) -> bytes:
        """Return the text of a document without arrays."""
        return self._encode(content)[0]

    def read(self, path: Path) -> _T:
        """Return the content of the document at `path`.

        Raises
        ------
        FileContentError
            If the file cannot be read, is no document of this format and version, has changed since
            it was written, or a field has a wrong type.
        """
        raw = read_bytes(path, self.kind, _MAX_JSON_BYTES)
        with self.kind.errors_of(path):
            return self._decode(raw, {})

    def write_archive(self, stream: BinaryIO, content: _T) -> None:
        """Write an archive of the document and of the numbers of its arrays."""
        text, arrays = self._encode(content)
        members: dict[str, Any] = {_CONTENT: np.frombuffer(text, np.uint8), **arrays}
        np.savez(stream, **members)

    def read_archive(self, path: Path) -> _T:
        """Return the content of the archive at `path`; for errors, see `read`."""
        with open_result(path, self.kind) as stream, self.kind.errors_of(path):
            with zipfile.ZipFile(stream) as archive:
                members = archive.infolist()
            if any(x.compress_type != zipfile.ZIP_STORED for x in members):
                raise ContentError("the arrays must not be compressed")
            size = float(sum(x.file_size for x in members))
            require_memory("load", f"{path} with {size:g} bytes", size, "free memory")
            stream.seek(0)
            with np.load(stream, allow_pickle=False) as archive:
                arrays = {name: archive[name] for name in archive.files}
            return self._decode(arrays.pop(_CONTENT).tobytes(), arrays)

    def _encode(self, content: _T) -> tuple[bytes, dict[str, Array]]:
        """Return the text, in which arrays are lists [first number, *shape], and the numbers."""
        blocks: list[Array] = []
        size = 0

        def encode(value: Any) -> Any:
            nonlocal size
            if isinstance(value, np.ndarray):
                blocks.append(np.asarray(value, float).ravel())
                size += value.size
                return [size - value.size, *value.shape]
            if isinstance(value, np.generic):
                return value.item()
            return {field.name: getattr(value, field.name) for field in fields(value)}

        header = {"format": self.kind.name, "version": self.version}
        plain = json.loads(json.dumps(header | encode(content), default=encode))
        arrays = {_NUMBERS: np.concatenate(blocks)} if blocks else {}
        document = {**plain, _CHECKSUM: checksum(plain, arrays)}
        return f"{json.dumps(document)}\n".encode(), arrays

    def _decode(self, raw: bytes, arrays: Mapping[str, Array]) -> _T:
        plain = json.loads(raw)
        if not isinstance(plain, dict) or plain.get("format") != self.kind.name:
            raise ValueError(raw)
        expected, version = plain.pop(_CHECKSUM, ""), plain.get("version")
        if version != self.version:
            raise ContentError(f"version must be {self.version}, got {short_repr(version)}")
        if expected != checksum(plain, arrays):
            raise ContentError("the content has changed since it was written (wrong checksum)")
        if _CONTROL_CHARACTER.search(json.dumps(plain)):
            raise ContentError("the content must not contain control characters")

        def read_array(_: type, place: Any) -> Array:
            try:
                first, *shape = place
                return arrays[_NUMBERS][first : first + math.prod(shape)].reshape(shape)
            except (LookupError, TypeError, ValueError):
                raise ValueError("must be the first number and the shape of an array") from None

        try:
            # Decoding does not call the function __init__, which makes data read-only.
            content: Any = msgspec.convert(plain, self.content, dec_hook=read_array)
        except msgspec.ValidationError as problem:
            what, _, where = str(problem).replace("`", "").partition(" - at ")
            field = where.removeprefix("$").removeprefix(".") or "the content"
            raise ContentError(f"{field}: {what[:1].lower()}{what[1:]}") from None
        return cast("_T", replace(content))


def checksum(content: Any, arrays: Mapping[str, Array] | None = None) -> str:
    """Return a hash of JSON content and arrays, independent of the layout of the file."""
    digest = hashlib.sha256(json.dumps(content, sort_keys=True).encode())
    for name, array in sorted((arrays or {}).items()):
        digest.update(f"\n{name} {array.dtype.str} {array.shape}\n".encode())
        digest.update(np.ascontiguousarray(array).reshape(-1).view(np.uint8).data)
    return digest.hexdigest()


def as_plain(value: Any) -> Any:
    """Return a value as JSON has it: arrays become lists."""
    return json.loads(json.dumps(value, default=lambda x: x.tolist()))
