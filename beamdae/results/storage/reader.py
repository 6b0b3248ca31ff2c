"""Bounded reading of result files: regular files, JSON, and zip archives of NumPy arrays.

Files may come from others. Sizes are therefore compared with limits before anything is unpacked or
allocated, the content is compared with a schema, and nothing in a file is executed.
"""

from __future__ import annotations

import errno
import hashlib
import json
import math
import os
import re
import stat
import struct
import warnings
import zipfile
import zlib
from collections import Counter
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass
from io import BufferedReader
from pathlib import Path
from typing import Any, BinaryIO

import numpy as np

from beamdae.errors import FileContentError, require_valid_path, short_repr
from beamdae.memory import require_memory
from beamdae.results.storage.schema import ArrayHeader, ArrayRule, FieldError, Rule

Array = np.ndarray

# Limits of JSON content. A checkpoint of 100 000 coordinates has 10 MB and as many lists; the
# content is parsed within 3 s at these limits.
_MAX_JSON_BYTES = 200_000_000
_MAX_JSON_CONTAINERS = 2_000_000  # lists and objects
_MAX_JSON_VALUES = 10_000_000
_MAX_JSON_DEPTH = 100
_NOT_BRACKETS = bytes(k for k in range(256) if chr(k) not in "[]{}")
_DEPTH_CHANGES = np.array(
    [{"[": 1, "{": 1, "]": -1, "}": -1}.get(chr(k), 0) for k in range(256)], np.int8
)
# Possessive, and also matches a string without an end, so that the search takes linear time.
_JSON_STRING = re.compile(rb'"[^"\\]*+(?:\\.[^"\\]*+)*+"?+', re.DOTALL)

_MAX_TABLE_BYTES = 4_000_000_000  # of a CSV file
MAX_ARCHIVE_BYTES = 4_000_000_000  # larger archives have directories in another format
# Deflate compresses constant arrays by 1000:1, states and tables of a moving mechanism by 1 to 10.
# `is_compression_allowed` is part of the format: `save_run` does not compress other arrays.
_MAX_COMPRESSION = 100.0
_MAX_BYTES_OF_ANY_COMPRESSION = 64_000_000
_MAX_ARCHIVE_MEMBERS = 64
_MAX_DIRECTORY_BYTES = 64_000
_END_OF_ARCHIVE = struct.Struct("<4sHHHHIIH")  # of the last record, without a comment
_ARCHIVE_SIGNATURE = b"PK\x03\x04"
_END_SIGNATURE = b"PK\x05\x06"
_LARGE_ARCHIVE = struct.Struct("<4sIQI")  # in front of the last record of archives in zip64 format
_LARGE_SIGNATURE = b"PK\x06\x07"
_IS_ENCRYPTED = 1
_CHUNK_BYTES = 1_000_000  # unpacked at once
_ARRAY_SUFFIX = ".npy"
# Exceptions that NumPy and zipfile raise for damaged archives.
_ARCHIVE_ERRORS = (
    *(AttributeError, EOFError, KeyError, MemoryError, OSError, OverflowError, RuntimeError),
    *(SyntaxError, TypeError, ValueError, Warning),
    *(struct.error, zipfile.BadZipFile, zlib.error),
)


@dataclass(frozen=True)
class FileKind:
    """Kind of a result file, for messages.

    Attributes
    ----------
    name
        Name of the kind, such as "checkpoint".
    remedy
        Advice if the file cannot be used, such as "run the model again from the start".
    """

    name: str
    remedy: str

    def error(self, path: Path, problem: str) -> FileContentError:
        """Return the error for the file at `path`."""
        return FileContentError(path, problem, self.remedy)

    def incomplete(self, path: Path) -> FileContentError:
        """Return the error for a truncated file, or a file of another kind."""
        return self.error(path, f"the file is not a complete {self.name}")


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


def is_archive(path: Path) -> bool:
    """Return True for a regular file that begins like a zip archive, such as a saved run."""
    try:
        with open_regular_file(path) as stream:
            return stream.read(len(_ARCHIVE_SIGNATURE)) == _ARCHIVE_SIGNATURE
    except (OSError, ValueError):
        return False


def _require_regular(mode: int) -> None:
    if stat.S_ISDIR(mode):
        raise IsADirectoryError(errno.EISDIR, os.strerror(errno.EISDIR))
    if not stat.S_ISREG(mode):
        raise OSError(errno.EINVAL, "not a regular file")


@contextmanager
def _open_bounded(path: Path, kind: FileKind, most: int) -> Iterator[tuple[BinaryIO, int]]:
    """Yield the file and its size [bytes], at most `most`."""
    require_valid_path(path)
    try:
        with open_regular_file(path) as stream:
            size = os.fstat(stream.fileno()).st_size
            if size > most:
                raise kind.error(
                    path, f"the {kind.name} has {size} bytes, but at most {most} bytes are allowed"
                )
            yield stream, size
    except OSError as problem:
        why = problem.strerror or problem
        raise FileContentError(
            path, f"the {kind.name} cannot be read: {why}", kind.remedy
        ) from None


def read_bytes(path: Path, kind: FileKind, most: int = _MAX_TABLE_BYTES) -> bytes:
    """Return the content of a regular file of at most `most` bytes.

    Raises
    ------
    FileContentError
        If the file cannot be read, is not a regular file, or has more than `most` bytes.
    """
    with _open_bounded(path, kind, most) as (stream, size):
        # Files that grow while they are read are truncated, and fail their checksum.
        return stream.read(size)


def read_json(path: Path, kind: FileKind) -> Any:
    """Return the content of a JSON file, see `parse_json`.

    Raises
    ------
    FileContentError
        If the file cannot be read, is not a regular file, or `parse_json` rejects its content.
    """
    return parse_json(path, kind, read_bytes(path, kind, _MAX_JSON_BYTES))


def parse_json(path: Path, kind: FileKind, raw: bytes) -> Any:
    """Return the content of JSON text of limited size and nesting, without duplicate keys.

    Raises
    ------
    FileContentError
        If the text is not JSON, exceeds a limit, or contains an object with duplicate keys.
    """
    require_json_limits(path, kind, raw)

    def build_object(entries: list[tuple[str, Any]]) -> dict[str, Any]:
        content = dict(entries)
        if len(content) < len(entries):
            name, _ = Counter(name for name, _ in entries).most_common(1)[0]
            raise kind.error(path, f"the field {short_repr(name)} occurs twice in one object")
        return content

    try:
        return json.loads(raw, object_pairs_hook=build_object)
    except FileContentError:
        raise
    except (ValueError, RecursionError, MemoryError):
        raise kind.incomplete(path) from None


def require_json_limits(path: Path, kind: FileKind, raw: bytes) -> None:
    """Raise FileContentError if JSON text is too large or too deeply nested to be read."""
    containers, depth = _measure_nesting(raw)
    for what, count, most in (
        ("bytes", len(raw), _MAX_JSON_BYTES),
        ("lists and objects", containers, _MAX_JSON_CONTAINERS),
        ("values", containers + raw.count(b","), _MAX_JSON_VALUES),
        ("levels of nesting", depth, _MAX_JSON_DEPTH),
    ):
        if count > most:
            raise kind.error(
                path, f"the {kind.name} has {count} {what}, but at most {most} are allowed"
            )


def _measure_nesting(raw: bytes) -> tuple[int, int]:
    """Return an upper bound of the number of lists and objects, and the depth of nesting.

    The depth is 0 if the number exceeds its limit.
    """
    begins = raw.count(b"[") + raw.count(b"{")
    ends = raw.count(b"]") + raw.count(b"}")
    if max(begins, ends) > _MAX_JSON_CONTAINERS:
        return max(begins, ends), 0
    # Strings contain brackets too, such as the units of headers.
    brackets = _JSON_STRING.sub(b"", raw).translate(None, _NOT_BRACKETS)
    changes = _DEPTH_CHANGES[np.frombuffer(brackets, np.uint8)]
    return begins, int(np.max(np.cumsum(changes, dtype=np.int64), initial=0))


def require_content(path: Path, kind: FileKind, rule: Rule, content: Any) -> None:
    """Raise FileContentError with the name of the field if `content` violates a rule."""
    with translate_field_errors(path, kind):
        rule(content)


@contextmanager
def translate_field_errors(path: Path, kind: FileKind) -> Iterator[None]:
    """Convert a `FieldError` to a FileContentError with the path of the file."""
    try:
        yield
    except FieldError as problem:
        raise kind.error(path, str(problem)) from None


def checksum(content: Any, arrays: Mapping[str, Array] | None = None, **layout: Any) -> str:
    """Return a hash of JSON content and arrays, independent of the layout of the file.

    `layout` contains further arguments of `json.dumps`, which formats the content to be hashed.
    """
    digest = hashlib.sha256(json.dumps(content, **layout).encode())
    for name, array in sorted((arrays or {}).items()):
        digest.update(f"\n{name} {array.dtype.str} {array.shape}\n".encode())
        digest.update(np.ascontiguousarray(array).data)
    return digest.hexdigest()


def is_compression_allowed(unpacked: int, packed: int) -> bool:
    """Return True if `open_archive` accepts the compression of an archive; sizes in bytes."""
    return unpacked <= max(_MAX_BYTES_OF_ANY_COMPRESSION, _MAX_COMPRESSION * packed)


@dataclass(frozen=True)
class Archive:
    """Zip archive of NumPy arrays, whose sizes have been checked.

    Attributes
    ----------
    path, kind
        Path and kind of the file.
    headers
        Headers of the arrays by name.
    """

    path: Path
    kind: FileKind
    headers: dict[str, ArrayHeader]
    _file: zipfile.ZipFile

    def read_array(self, name: str) -> Array:
        """Return the array of this name; a damaged file raises FileContentError."""
        with self.translate_errors(), self._file.open(name + _ARRAY_SUFFIX) as member:
            header = self.headers[name]
            member.read(header.size)
            # The array is writable, unlike an array of `bytes`.
            data = bytearray(header.array_bytes)
            for first in range(0, len(data), _CHUNK_BYTES):
                chunk = member.read(min(_CHUNK_BYTES, len(data) - first))
                data[first : first + len(chunk)] = chunk
                if len(chunk) < min(_CHUNK_BYTES, len(data) - first):
                    raise EOFError
            # Reads to the end of the member, where its checksum is compared.
            if member.read(1):
                raise self.kind.incomplete(self.path)
            values = np.frombuffer(data, header.dtype)
            if header.is_fortran:
                return values.reshape(header.shape[::-1]).T
            return values.reshape(header.shape)

    def read_arrays(self, rules: Mapping[str, ArrayRule]) -> dict[str, Array]:
        """Read the arrays of `rules`, which must be all arrays of the archive, and check them."""
        sizes: dict[str, int] = {}
        with translate_field_errors(self.path, self.kind):
            for name in rules:
                if name not in self.headers:
                    raise FieldError("is missing", name)
            for name in self.headers:
                if name not in rules:
                    raise FieldError(f"is not an array of a {self.kind.name}", name)
                rules[name].check_header(name, self.headers[name], sizes)
            arrays = {name: self.read_array(name) for name in rules}
            for name, rule in rules.items():
                rule.check_values(name, arrays[name])
        return arrays

    @contextmanager
    def translate_errors(self) -> Iterator[None]:
        """Convert errors of NumPy and zipfile to a FileContentError."""
        try:
            yield
        except (FileContentError, FieldError):
            raise
        except _ARCHIVE_ERRORS:
            raise self.kind.incomplete(self.path) from None


@contextmanager
def open_archive(path: Path, kind: FileKind) -> Iterator[Archive]:
    """Open an archive of NumPy arrays after comparing its sizes with the limits.

    Before an array is allocated, the sizes in the directory of the archive are compared with the
    size of the file, the shapes in the headers of the arrays and the available memory.

    Raises
    ------
    FileContentError
        If the file cannot be read, is not a regular file or a complete archive of arrays, contains
        Python objects, has more than 4 GB, or unpacks to more than 64 MB and more than 100 times
        its size.
    BeamdaeError
        If the arrays need more memory than is available.
    """
    with _open_bounded(path, kind, MAX_ARCHIVE_BYTES) as (stream, size):
        try:
            if not _has_small_directory(stream, size):
                raise kind.incomplete(path)
            file = zipfile.ZipFile(stream)
            members = file.infolist()
            unpacked = sum(member.file_size for member in members)
            packed = sum(member.compress_size for member in members)
        except _ARCHIVE_ERRORS as problem:
            raise kind.incomplete(path) from problem
        names = {member.filename for member in members}
        is_plain = all(
            member.filename.endswith(_ARRAY_SUFFIX)
            and member.compress_type in (zipfile.ZIP_STORED, zipfile.ZIP_DEFLATED)
            and not member.flag_bits & _IS_ENCRYPTED
            for member in members
        )
        if len(names) < len(members) or len(names) > _MAX_ARCHIVE_MEMBERS or not is_plain:
            raise kind.incomplete(path)
        if packed > size or not is_compression_allowed(unpacked, size):
            raise kind.error(
                path,
                f"the {kind.name} has {size} bytes and unpacks to {unpacked} bytes, but at most "
                f"{_MAX_COMPRESSION:g} times the size of the file are allowed",
            )
        require_memory("load", f"{path} with {unpacked} bytes", float(unpacked), "free memory")
        archive = Archive(path, kind, {}, file)
        for member in members:
            with archive.translate_errors(), file.open(member) as opened:
                header = _read_header(opened)
            name = member.filename.removesuffix(_ARRAY_SUFFIX)
            if header.dtype.hasobject:
                raise kind.error(path, f"{short_repr(name)} contains Python objects, not numbers")
            if header.array_bytes + header.size != member.file_size:
                raise kind.error(
                    path,
                    f"{short_repr(name)} has {member.file_size} bytes, but its header allows "
                    f"{header.array_bytes + header.size}",
                )
            archive.headers[name] = header
        yield archive


def _has_small_directory(stream: BinaryIO, size: int) -> bool:
    """Return True if the last record describes a directory of at most 64 kB."""
    tail_size = _END_OF_ARCHIVE.size + _LARGE_ARCHIVE.size
    if size < tail_size:
        return False
    stream.seek(size - tail_size)
    tail = stream.read(tail_size)
    end = _END_OF_ARCHIVE.unpack(tail[_LARGE_ARCHIVE.size :])
    stream.seek(0)
    return (
        end[0] == _END_SIGNATURE
        and end[5] <= _MAX_DIRECTORY_BYTES
        and not tail.startswith(_LARGE_SIGNATURE)
    )


def _read_header(member: Any) -> ArrayHeader:
    read: dict[tuple[int, int], Callable[..., Any]] = {
        (1, 0): np.lib.format.read_array_header_1_0,
        (2, 0): np.lib.format.read_array_header_2_0,
    }
    with warnings.catch_warnings():
        # Warnings about unusual headers become errors.
        warnings.simplefilter("error")
        shape, is_fortran, dtype = read[np.lib.format.read_magic(member)](member)
    if any(size < 0 for size in shape) or math.prod(shape) > MAX_ARCHIVE_BYTES * _MAX_COMPRESSION:
        raise ValueError
    return ArrayHeader(tuple(map(int, shape)), dtype, is_fortran, member.tell())
