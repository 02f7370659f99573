# SPDX-License-Identifier: GPL-3.0-or-later
"""Read uncompressed multilayer OpenEXR files, which Blender writes but its Python API cannot read.

Format: openexr.com, "OpenEXR File Layout". Blender 4.5 writes all passes in one part, 5.x each in a part of its own.
"""

from __future__ import annotations

import struct
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from ..runtime.errors import FileFormatError

_MAGIC = 20000630
_TILED, _DEEP, _MULTIPART = 0x200, 0x800, 0x1000
_DTYPES: dict[int, np.dtype] = {0: np.dtype("<u4"), 1: np.dtype("<f2"), 2: np.dtype("<f4")}


@dataclass
class _Part:
    """Header of a part: channels by name in the order of the file, size in pixels, first row."""

    channels: dict[str, np.dtype] = field(default_factory=dict)
    width: int = 0
    height: int = 0
    first_row: int = 0
    compression: int = -1


class _Reader:
    """Cursor over the bytes of a file."""

    def __init__(self, data: bytes) -> None:
        self.data = data
        self.at = 0

    def take(self, form: str) -> tuple[int, ...]:
        values = struct.unpack_from("<" + form, self.data, self.at)
        self.at += struct.calcsize("<" + form)
        return values

    def text(self) -> str:
        end = self.data.index(b"\0", self.at)
        value = self.data[self.at : end].decode("utf-8", "replace")
        self.at = end + 1
        return value


def read_exr(path: Path) -> dict[str, np.ndarray]:
    """Channels (H, W) float32 by full name, such as `ViewLayer.Depth.Z`; row 0 is the bottom.

    Raises FileFormatError for other files than uncompressed scan-line EXR.
    """
    try:
        return _read(_Reader(path.read_bytes()))
    except (OSError, ValueError, struct.error) as cause:
        raise FileFormatError(f"{path} is no uncompressed OpenEXR file that can be read ({cause})") from cause


def _read(reader: _Reader) -> dict[str, np.ndarray]:
    magic, version = reader.take("ii")
    if magic != _MAGIC or version & (_TILED | _DEEP):
        raise ValueError("it is foreign, tiled or deep")
    many = bool(version & _MULTIPART)
    parts = _headers(reader, many)
    if any(part.compression != 0 for part in parts):
        raise ValueError("it is compressed")
    offsets = [reader.take(f"{part.height}Q") for part in parts]
    result: dict[str, np.ndarray] = {}
    for part, table in zip(parts, offsets, strict=True):
        result |= _pixels(reader.data, part, table, skip=4 if many else 0)
    return result


def _headers(reader: _Reader, many: bool) -> list[_Part]:
    parts: list[_Part] = []
    while True:
        part = _Part()
        name = reader.text()
        if not name:  # an empty header ends the headers of a multi-part file
            return parts
        while name:
            kind = reader.text()
            (size,) = reader.take("i")
            _attribute(part, name, kind, _Reader(reader.data[reader.at : reader.at + size]))
            reader.at += size
            name = reader.text()
        parts.append(part)
        if not many:
            return parts


def _attribute(part: _Part, name: str, kind: str, value: _Reader) -> None:
    if kind == "chlist":
        while channel := value.text():
            pixel, _, step_x, step_y = value.take("iIii")
            if pixel not in _DTYPES or (step_x, step_y) != (1, 1):
                raise ValueError(f"channel {channel} is of an unknown type or sub-sampled")
            part.channels[channel] = _DTYPES[pixel]
    elif name == "dataWindow":
        left, part.first_row, right, last_row = value.take("iiii")
        part.width, part.height = right - left + 1, last_row - part.first_row + 1
    elif name == "compression":
        (part.compression,) = value.take("B")


def _pixels(data: bytes, part: _Part, table: tuple[int, ...], skip: int) -> dict[str, np.ndarray]:
    """All channels of a part; each row is a chunk: part (in multi-part files), row, bytes, channel after channel."""
    images = {name: np.zeros((part.height, part.width), np.float32) for name in part.channels}
    for offset in table:
        (row,) = struct.unpack_from("<i", data, offset + skip)
        at = offset + skip + 8
        for name, dtype in part.channels.items():
            line = np.frombuffer(data, dtype, part.width, at)
            images[name][part.height - 1 - (row - part.first_row)] = line
            at += line.nbytes
    return images
