# SPDX-License-Identifier: GPL-3.0-or-later
"""PatchNet's file format: safetensors with kind, schema version, JSON metadata and checksums in the header.

Files are replaced atomically (`replace.py`). Reading maps a file into memory; each error is one sentence with file and
cause. Why this module does not use the safetensors library: docs/developers.md.
"""

from __future__ import annotations

import hashlib
import json
import math
import os
import zlib
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from .errors import FileFormatError
from .file_kinds import arrays_kind, with_article
from .replace import replaced_file

SCHEMA_VERSION = 1
_FORMAT = "patchnet"
_MAX_HEADER_BYTES = 16 << 20
_ALIGNMENT = 64
_DTYPES = {
    "BOOL": "?", "U8": "u1", "I8": "i1", "U16": "<u2", "I16": "<i2", "F16": "<f2",
    "U32": "<u4", "I32": "<i4", "F32": "<f4", "U64": "<u8", "I64": "<i8", "F64": "<f8",
}  # fmt: skip
_DTYPE_NAMES = {np.dtype(code): name for name, code in _DTYPES.items()}


@dataclass(frozen=True)
class FileHeader:
    """Header of a file.

    kind: content of the file, such as "octree", "codes" or "weights". metadata: plain JSON values. arrays: dtype and
    shape of each array. data_start: offset of the arrays in bytes.
    """

    kind: str
    schema_version: int
    metadata: dict[str, Any]
    arrays: dict[str, tuple[np.dtype, tuple[int, ...]]]
    data_start: int
    _offsets: dict[str, int]
    _checksums: dict[str, int]


def write_arrays(path: str | Path, arrays: Mapping[str, np.ndarray], metadata: dict[str, Any], kind: str) -> None:
    """Write named arrays and JSON `metadata` to a PatchNet file.

    Raises OutputError if the file cannot be written or a file of another kind exists there, which then stays unchanged.
    """
    path = Path(path)
    # Largest items first: every array then starts at a multiple of its item size.
    names = sorted(arrays, key=lambda name: (-arrays[name].dtype.itemsize, name))
    contiguous = {name: np.asarray(arrays[name], arrays[name].dtype.newbyteorder("<"), order="C") for name in names}
    header = _header_bytes(contiguous, metadata, kind)
    with replaced_file(path, arrays_kind(kind)) as file:
        file.write(len(header).to_bytes(8, "little"))
        file.write(header)
        for array in contiguous.values():
            file.write(_bytes_of(array).data)


def read_arrays(
    path: str | Path, kind: str, error: type[FileFormatError] = FileFormatError
) -> tuple[dict[str, np.ndarray], dict[str, Any]]:
    """Arrays and metadata of a PatchNet file, the arrays mapped into memory copy-on-write.

    Every array is compared with its checksum, which reads the whole file. Raises `error` if the file is missing,
    truncated, damaged, of another kind, program or newer version.
    """
    path = Path(path)
    header = read_header(path, error)
    if header.kind != kind:
        raise error(f"{path} is a PatchNet {header.kind} file where {with_article(kind)} file is needed")
    try:
        # Copy-on-write: read-only arrays are another type for numba, which would compile kernels again.
        mapped = np.asarray(np.memmap(path, np.uint8, mode="c"))
    except OSError as cause:
        raise error(f"{path} cannot be read: {cause.strerror or cause}") from cause
    raw = {}
    for name, (dtype, shape) in header.arrays.items():
        start = header.data_start + header._offsets[name]
        raw[name] = mapped[start : start + math.prod(shape) * dtype.itemsize]
    for name, values in raw.items():
        if zlib.crc32(values.data) != header._checksums[name]:
            raise error(f"{path} is damaged: the data of '{name}' differs from its checksum; create the file anew")
    arrays = {name: raw[name].view(dtype).reshape(shape) for name, (dtype, shape) in header.arrays.items()}
    return arrays, header.metadata


def read_header(path: str | Path, error: type[FileFormatError] = FileFormatError) -> FileHeader:
    """Kind, version, metadata and array shapes of a PatchNet file without its data; errors as `read_arrays`."""
    path = Path(path)
    try:
        with path.open("rb") as file:
            size = os.fstat(file.fileno()).st_size
            length = int.from_bytes(file.read(8), "little")
            if size < 10 or not 2 <= length <= _MAX_HEADER_BYTES:
                raise error(f"{path} is not a PatchNet file: it does not begin with a safetensors header")
            text = file.read(length)
    except FileNotFoundError as cause:
        raise error(f"{path} does not exist") from cause
    except OSError as cause:
        raise error(f"{path} cannot be read: {cause.strerror or cause}") from cause
    if not text.startswith(b"{"):
        raise error(f"{path} is not a PatchNet file: it does not begin with a safetensors header")
    if len(text) < length:
        raise error(f"{path} is truncated: it ends within its header; create the file anew")
    try:
        return _parse_header(json.loads(text), path, 8 + length, size, error)
    except (ValueError, TypeError, KeyError, AttributeError, RecursionError) as cause:
        raise error(f"{path} is damaged: its header cannot be read; create the file anew") from cause


def content_hash(arrays: Mapping[str, np.ndarray]) -> str:
    """Hash (32 hex digits) of names, types, shapes and values of arrays; the same on every machine."""
    digest = hashlib.blake2b(digest_size=16)
    for name in sorted(arrays):
        array = np.asarray(arrays[name], arrays[name].dtype.newbyteorder("<"), order="C")
        digest.update(f"{name}:{_DTYPE_NAMES[array.dtype]}:{array.shape};".encode())
        digest.update(_bytes_of(array).data)
    return digest.hexdigest()


def _bytes_of(array: np.ndarray) -> np.ndarray:
    return array.reshape(-1).view(np.uint8)


def _canonical(value: Any) -> str:
    return json.dumps(value, sort_keys=True, separators=(",", ":"), allow_nan=False)


def _header_bytes(arrays: dict[str, np.ndarray], metadata: dict[str, Any], kind: str) -> bytes:
    """JSON header, padded with spaces to align the data."""
    header: dict[str, Any] = {}
    end = 0
    for name, array in arrays.items():
        begin, end = end, end + array.nbytes
        header[name] = {
            "dtype": _DTYPE_NAMES[array.dtype], "shape": list(array.shape), "data_offsets": [begin, end]
        }  # fmt: skip
    header["__metadata__"] = {
        "format": _FORMAT,
        "kind": kind,
        "schema_version": str(SCHEMA_VERSION),
        "metadata": _canonical(metadata),
        "checksums": _canonical({name: zlib.crc32(_bytes_of(array).data) for name, array in arrays.items()}),
    }
    header["__metadata__"]["header_checksum"] = str(zlib.crc32(_canonical(header).encode()))
    text = json.dumps(header).encode()
    return text + b" " * (-(8 + len(text)) % _ALIGNMENT)


def _parse_header(
    header: dict[str, Any], path: Path, data_start: int, size: int, error: type[FileFormatError]
) -> FileHeader:
    """Check the parsed JSON; raises ValueError, TypeError or KeyError for anything unexpected."""
    own = header.get("__metadata__") or {}
    if own.get("format") != _FORMAT:
        raise error(f"{path} is not a PatchNet file: it is a safetensors file of another program")
    version = int(own["schema_version"])
    if version > SCHEMA_VERSION:
        raise error(
            f"{path} was written by a newer PatchNet (file version {version}, this one reads up to {SCHEMA_VERSION}): "
            "update PatchNet or create the file anew"
        )
    checksum = int(own.pop("header_checksum"))
    if checksum != zlib.crc32(_canonical(header).encode()):
        raise ValueError("header checksum")
    del header["__metadata__"]
    arrays, offsets, end = {}, {}, 0
    for name, entry in sorted(header.items(), key=lambda item: item[1]["data_offsets"]):
        dtype, shape = np.dtype(_DTYPES[entry["dtype"]]), tuple(int(extent) for extent in entry["shape"])
        begin, stop = entry["data_offsets"]
        if begin != end or min(shape, default=0) < 0 or stop - begin != math.prod(shape) * dtype.itemsize:
            raise ValueError(name)
        arrays[name], offsets[name], end = (dtype, shape), begin, stop
    if data_start + end != size:
        state = "truncated" if data_start + end > size else "damaged"
        raise error(f"{path} is {state}: it has {size} bytes and should have {data_start + end}; create the file anew")
    checksums = {name: int(json.loads(own["checksums"])[name]) for name in arrays}
    return FileHeader(own["kind"], version, json.loads(own["metadata"]), arrays, data_start, offsets, checksums)
