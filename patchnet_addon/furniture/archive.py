# SPDX-License-Identifier: GPL-3.0-or-later
"""Zip archives of strangers: looked at before anything is unpacked, and unpacked into one folder alone."""

from __future__ import annotations

import zipfile
import zlib
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path, PurePosixPath

from ..runtime.errors import FileAccessError, FileFormatError

MOST_MEMBERS = 50_000
MOST_BYTES = 4 << 30  # of all members, unpacked
MOST_MEMBER_BYTES = 512 << 20
_MOST_RATIO = 200  # unpacked over packed; models and pictures of real libraries stay below 30
_FREE_BYTES = 1 << 20  # members that are this small may be packed as tightly as they like
_ENCRYPTED, _IS_LINK, _LINK_MASK = 0x1, 0o120000, 0o170000


class LibraryFileError(FileFormatError):
    """A furniture library cannot be read, or must not be used."""


@contextmanager
def opened_archive(path: Path) -> Iterator[zipfile.ZipFile]:
    """Open a zip archive whose members all have harmless names and sizes.

    Raises LibraryFileError if it is missing, damaged, unpacks to too much, or has a member that would leave its folder.
    """
    if not path.is_file():
        raise LibraryFileError(f"Furniture library {path} is no file: check its path")
    try:
        with zipfile.ZipFile(path) as archive:
            _check(path, archive.infolist())
            yield archive
    except (zipfile.BadZipFile, zlib.error, EOFError, NotImplementedError) as cause:
        raise LibraryFileError(f"Furniture library {path} is damaged ({cause}): fetch it again") from cause
    except OSError as cause:
        raise FileAccessError.of(cause) or LibraryFileError(
            f"Furniture library {path} cannot be read ({cause}): fetch it again"
        ) from cause


def _check(path: Path, members: list[zipfile.ZipInfo]) -> None:
    if len(members) > MOST_MEMBERS or sum(member.file_size for member in members) > MOST_BYTES:
        raise LibraryFileError(f"Furniture library {path} unpacks to more than a library holds: it is not used")
    for member in members:
        if not is_harmless(member.filename) or (member.external_attr >> 16) & _LINK_MASK == _IS_LINK:
            raise LibraryFileError(
                f"Furniture library {path} has the member {member.filename!r}, which would leave its folder: "
                "it is not used"
            )
        tight = member.file_size > max(_FREE_BYTES, _MOST_RATIO * member.compress_size)
        if tight or member.file_size > MOST_MEMBER_BYTES:
            raise LibraryFileError(
                f"Furniture library {path} has the member {member.filename!r}, which unpacks to "
                f"{member.file_size:,} bytes: it is not used"
            )
        if member.flag_bits & _ENCRYPTED:
            raise LibraryFileError(f"Furniture library {path} is encrypted: unpack and pack it anew without a password")


def is_harmless(name: str) -> bool:
    """Tell whether a member's name stays below the folder that it is unpacked to, on every system."""
    parts = PurePosixPath(name).parts
    return bool(parts) and not name.startswith("/") and ".." not in parts and not set(name) & set("\\:\0")


def unpack_folder(archive: zipfile.ZipFile, name: str, folder: Path) -> Path:
    """Unpack the files that lie beside the member `name`, itself too; returns its path below `folder`.

    Files in the archive's root are unpacked alone with their like, never the whole archive.
    """
    parent = PurePosixPath(name).parent
    for member in archive.infolist():
        if not member.is_dir() and PurePosixPath(member.filename).parent == parent:
            archive.extract(member, folder)
    return folder / name
