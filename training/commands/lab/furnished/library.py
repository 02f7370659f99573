# SPDX-License-Identifier: GPL-3.0-or-later
"""Furniture libraries of Sweet Home 3D: zip files (.sh3f) with models (.obj) and a catalogue of their sizes.

Models are unpacked into one folder; textures elsewhere are dropped. A library is for training or for testing, because
models of one source resemble each other. One library is reserved for the tests of others and refused.
"""

from __future__ import annotations

import math
import re
import zipfile
import zlib
from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path, PurePosixPath

from .....patchnet_addon.runtime.errors import FileAccessError, FileFormatError, SettingError

MOST_BYTES = 4 << 30  # all members, unpacked
_ENCRYPTED = 0x1


class LibraryFileError(FileFormatError):
    """A furniture library cannot be read or must not be used."""


@contextmanager
def opened_archive(path: Path) -> Iterator[zipfile.ZipFile]:
    """Open a zip archive; raises LibraryFileError if it is missing, damaged, encrypted or too large."""
    if not path.is_file():
        raise LibraryFileError(f"Furniture library {path} is no file: check its path")
    try:
        with zipfile.ZipFile(path) as archive:
            members = archive.infolist()
            if sum(member.file_size for member in members) > MOST_BYTES:
                raise LibraryFileError(
                    f"Furniture library {path} unpacks to more than a library holds: choose another library"
                )
            if any(member.flag_bits & _ENCRYPTED for member in members):
                raise LibraryFileError(f"Furniture library {path} is encrypted: pack it anew without a password")
            yield archive
    except (zipfile.BadZipFile, zlib.error, EOFError, NotImplementedError) as cause:
        raise LibraryFileError(f"Furniture library {path} is damaged ({cause}): fetch it again") from cause
    except OSError as cause:
        raise FileAccessError.of(cause) or LibraryFileError(
            f"Furniture library {path} cannot be read ({cause}): fetch it again"
        ) from cause


def unpack_folder(archive: zipfile.ZipFile, name: str, folder: Path) -> Path:
    """Unpack the member `name` and the files beside it; returns its path below `folder`.

    For a file in the archive's root, these are the files in the root. `zipfile` keeps members with any names below the
    folder.
    """
    parent = PurePosixPath(name).parent
    for member in archive.infolist():
        if not member.is_dir() and PurePosixPath(member.filename).parent == parent:
            archive.extract(member, folder)
    return folder / name


TRAIN, TEST, FREE = "train", "test", "free"  # FREE: users' libraries
ROLES = {
    "SweetHome3D#BlendSwap-CC-0-Models": TRAIN,
    "SweetHome3D#BlendSwap-CC-BY-Models": TRAIN,
    "SweetHome3D#ScopiaModels": TRAIN,
    "SweetHome3D#ReallusionModels": TEST,
}
_UNTOUCHED = "katorlegaz"


def is_untouched(text: str) -> bool:
    """Return whether a name, in any spelling, is that of the library reserved for the tests of others."""
    return _UNTOUCHED in re.sub(r"[^a-z]", "", text.lower())


def check_touchable(path: Path, *texts: str) -> None:
    """Raise LibraryFileError if the file's name or one of `texts` is that of the reserved library."""
    if any(is_untouched(text) for text in (path.name, *texts)):
        raise LibraryFileError(
            f"{path} is the library KatorLegaz, which is kept for the tests of others and never used here: "
            "choose another library"
        )


def common_role(roles: Iterable[str]) -> str:
    """Role of a scene of several libraries; raises SettingError for libraries of training and of testing together."""
    found = set(roles)
    if {TRAIN, TEST} <= found:
        raise SettingError(
            "A library for testing and one for training are together in a scene, which could serve neither: "
            "compose a scene of each"
        )
    return next((role for role in (TRAIN, TEST) if role in found), FREE)


_ENTRY = re.compile(r"(?ms)^[ \t\f]*(?![#!])((?:\\[^\n]|[^\\=:\s])+)[ \t\f]*[=:]?[ \t\f]*((?:\\.|[^\\\n])*)")
_ESCAPE = re.compile(r"\\(u[0-9a-fA-F]{4}|\n[ \t\f]*|.)", re.DOTALL)
_LETTERS = {"t": "\t", "n": "\n", "r": "\r", "f": "\f"}


def _plain(text: str) -> str:
    return _ESCAPE.sub(lambda found: _letter(found[1]), text)


def _letter(escape: str) -> str:
    if escape[0] == "\n":  # the value continues in the next line
        return ""
    return chr(int(escape[1:], 16)) if len(escape) == 5 else _LETTERS.get(escape, escape)


CATALOGUE = "PluginFurnitureCatalog.properties"
_MOST_PIECES = 100_000
_LARGEST_CM = 10_000.0
Rotation = tuple[float, ...]  # 3 x 3, row-major, in the model's axes: y is up
UPRIGHT: Rotation = (1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0)


@dataclass(frozen=True)
class Piece:
    """Piece of furniture: a model and its entry in the catalogue.

    library: its file, None for pieces built by script (`own_meshes.py`). model: member of the archive. size: width,
    depth and height in metres, with the front towards -y. elevation: height of its bottom above the floor, in metres.
    top: height of the surface for small things, None without. rotation: applied before scaling.
    """

    name: str
    category: str
    tags: str
    model: str
    size: tuple[float, float, float]
    library: Path | None = None
    elevation: float = 0.0
    top: float | None = None
    rotation: Rotation = UPRIGHT
    creator: str = ""
    licence: str = ""
    is_opening: bool = False


@dataclass(frozen=True)
class Library:
    """Furniture library: its catalogue, and the role that its models may have ("train", "test", "free")."""

    path: Path
    name: str
    licence: str
    role: str
    pieces: tuple[Piece, ...]


def read_library(path: Path) -> Library:
    """Read the catalogue of a .sh3f file.

    Pieces by creators of the reserved library are left out. Raises LibraryFileError if the file is missing, damaged or
    the reserved library, or lacks a model of its catalogue.
    """
    check_touchable(path)
    with opened_archive(path) as archive:
        members = set(archive.namelist())
        if CATALOGUE not in members:
            raise LibraryFileError(f"{path} has no {CATALOGUE}: it is not a furniture library (.sh3f)")
        text = archive.read(CATALOGUE).decode("latin-1").replace("\r\n", "\n").replace("\r", "\n")
    # Values by key of a properties file, which is Latin-1 with escapes; a missing value is empty.
    properties = {_plain(key): _plain(value).strip() for key, value in _ENTRY.findall(text)}
    head = {key: properties.get(key, "") for key in ("id", "name", "description", "provider", "license")}
    check_touchable(path, *head.values())
    pieces = []
    for number in range(1, _MOST_PIECES):
        if f"name#{number}" not in properties and f"id#{number}" not in properties:
            break
        piece = _piece(path, properties, number, head["license"])
        if piece.model not in members:
            raise LibraryFileError(
                f"Furniture library {path} has no file {piece.model!r}, the model of {piece.name!r}: fetch it again"
            )
        if piece.model.lower().endswith(".obj") and not is_untouched(piece.creator):
            pieces.append(piece)
    if not pieces:
        raise LibraryFileError(f"Furniture library {path} has no model in the format .obj: choose another library")
    return Library(path, head["name"] or path.stem, head["license"], ROLES.get(head["id"], FREE), tuple(pieces))


def _piece(path: Path, properties: dict[str, str], number: int, licence: str) -> Piece:
    def text(key: str) -> str:
        return properties.get(f"{key}#{number}", "")

    def numbers(key: str, low: float, high: float, default: tuple[float, ...] = (math.nan,)) -> tuple[float, ...]:
        try:
            values = tuple(map(float, text(key).split())) or default
        except ValueError:
            values = ()
        if len(values) != len(default) or not all(low <= value <= high for value in values):  # false for NaN, too
            raise LibraryFileError(
                f"Furniture library {path} has {text(key)!r} as {key} of its piece {number}: fetch it again"
            )
        return values

    width, depth, height = (numbers(key, 1e-3, _LARGEST_CM)[0] for key in ("width", "depth", "height"))
    drop = numbers("dropOnTopElevation", -1.0, _LARGEST_CM, (height,))[0]
    return Piece(
        name=text("name") or text("id"),
        category=text("category"),
        tags=text("tags"),
        model=text("model").removeprefix("/"),
        size=(width / 100.0, depth / 100.0, height / 100.0),
        library=path,
        elevation=numbers("elevation", 0.0, _LARGEST_CM, (0.0,))[0] / 100.0,
        top=None if drop < 0 else drop / 100.0,
        rotation=numbers("modelRotation", -1.001, 1.001, UPRIGHT),
        creator=text("creator"),
        licence=text("license") or licence,
        is_opening=text("doorOrWindow") == "true",
    )


_ENCODING = "latin-1"  # keeps any bytes
_TEXTURES = ("map_", "bump", "disp", "decal", "refl", "norm")


def keep_own_textures(folder: Path) -> None:
    """Remove lines of textures outside `folder` from its .mtl files.

    Some have absolute paths of their creators' disks, which an importer would open here.
    """
    for path in folder.iterdir():
        if path.suffix.lower() == ".mtl":
            kept = [line for line in path.read_text(_ENCODING).splitlines() if not _is_foreign(folder, line)]
            path.write_text("\n".join([*kept, ""]), _ENCODING)


def _is_foreign(folder: Path, line: str) -> bool:
    """Return whether a line is of a texture, and has a path or does not end with the name of a file in the folder."""
    if not line.strip().lower().startswith(_TEXTURES):
        return False
    words = line.split()
    names = (" ".join(words[start:]) for start in range(1, len(words)))  # after options
    return re.search(r"[/\\:]", line) is not None or not any((folder / name).is_file() for name in names)
