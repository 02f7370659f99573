# SPDX-License-Identifier: GPL-3.0-or-later
"""Furniture libraries of Sweet Home 3D: zip files (.sh3f) with models (.obj) and a catalogue of their sizes.

They are unpacked into one folder alone, and of their textures only those are kept that lie beside a model. Libraries
are for training or for testing: models of one source resemble each other, so what is tested with must come from another
source than what is learned; and one is touched by nobody here.
"""

from __future__ import annotations

import re
import zipfile
import zlib
from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from itertools import count, takewhile
from pathlib import Path, PurePosixPath

from ....patchnet_addon.runtime.errors import FileAccessError, FileFormatError, SettingError

CATALOGUE = "PluginFurnitureCatalog.properties"
MOST_BYTES = 4 << 30  # of all members, unpacked
TRAIN, TEST, FREE = "train", "test", "free"  # FREE: libraries of users, which know best
ROLES = {
    "SweetHome3D#BlendSwap-CC-0-Models": TRAIN,
    "SweetHome3D#BlendSwap-CC-BY-Models": TRAIN,
    "SweetHome3D#ScopiaModels": TRAIN,
    "SweetHome3D#ReallusionModels": TEST,
}
_UNTOUCHED = "katorlegaz"
Rotation = tuple[float, ...]  # 3 x 3 by rows, of the model's own axes: y is up
UPRIGHT: Rotation = (1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0)


class LibraryFileError(FileFormatError):
    """A furniture library cannot be read, or must not be used."""


@dataclass(frozen=True)
class Piece:
    """Piece of furniture: a model and what the catalogue says of it.

    library: file that it is from, None for what a script builds (`own_meshes.py`). model: its member of the archive.
    size: width, depth and height in metres, with the front towards -y. elevation: of its lower end above the floor, in
    metres. top: height at which things stand on it, None where nothing does. rotation: to be made before it is scaled.
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


@contextmanager
def opened_archive(path: Path) -> Iterator[zipfile.ZipFile]:
    """Open a zip archive; raises LibraryFileError if it is missing, damaged or unpacks to too much."""
    if not path.is_file():
        raise LibraryFileError(f"Furniture library {path} is no file: check its path")
    try:
        with zipfile.ZipFile(path) as archive:
            if sum(member.file_size for member in archive.infolist()) > MOST_BYTES:
                raise LibraryFileError(f"Furniture library {path} unpacks to more than a library holds: it is not used")
            yield archive
    except (zipfile.BadZipFile, zlib.error, EOFError, NotImplementedError) as cause:
        raise LibraryFileError(f"Furniture library {path} is damaged ({cause}): fetch it again") from cause
    except OSError as cause:
        raise FileAccessError.of(cause) or LibraryFileError(
            f"Furniture library {path} cannot be read ({cause}): fetch it again"
        ) from cause


def unpack_folder(archive: zipfile.ZipFile, name: str, folder: Path) -> Path:
    """Unpack the files that lie beside the member `name`, itself too; returns its path, which `zipfile` keeps below
    `folder`.

    Files in the archive's root are unpacked alone with their like, never the whole archive.
    """
    parent = PurePosixPath(name).parent
    for member in archive.infolist():
        if not member.is_dir() and PurePosixPath(member.filename).parent == parent:
            archive.extract(member, folder)
    return Path(archive.extract(name, folder))


def common_role(roles: Iterable[str]) -> str:
    """Role of a scene of several libraries; raises SettingError where one is for training and one for testing."""
    found = set(roles)
    if {TRAIN, TEST} <= found:
        raise SettingError(
            "A library for testing and one for training are together in a scene, which could serve neither: "
            "compose a scene of each"
        )
    return next((role for role in (TRAIN, TEST) if role in found), FREE)


def is_untouched(text: str) -> bool:
    """Tell whether a name is that of the library that is kept for the tests of others, however it is spelled."""
    return _UNTOUCHED in re.sub(r"[^a-z]", "", text.lower())


def read_properties(data: bytes) -> dict[str, str]:
    """Values by key of a properties file, which is Latin-1 with escapes; a backslash at a line's end continues it."""
    text = re.sub(r"\\\r?\n[ \t]*", "", data.decode("latin-1"))
    lines = (line.strip() for line in text.splitlines())
    pairs = (line.partition("=") for line in lines if not line.startswith(("#", "!")))
    return {_plain(key.strip()): _plain(value.strip()) for key, _, value in pairs}


def _plain(text: str) -> str:
    def letter(found: re.Match[str]) -> str:
        escape = found[1]
        return chr(int(escape[1:], 16)) if len(escape) == 5 else {"t": "\t", "n": "\n"}.get(escape, escape)

    return re.sub(r"\\(u[0-9a-fA-F]{4}|.)", letter, text)


def read_library(path: Path) -> Library:
    """Read the catalogue of a .sh3f file.

    Pieces by creators of the library that is not touched are left out. Raises LibraryFileError if the file is missing,
    damaged or not to be touched, or if a model that the catalogue names is not in it.
    """
    _check_touchable(path, [path.name])
    with opened_archive(path) as archive:
        members = set(archive.namelist())
        if CATALOGUE not in members:
            raise LibraryFileError(f"{path} has no {CATALOGUE}: it is not a furniture library (.sh3f)")
        properties = read_properties(archive.read(CATALOGUE))
    head = {key: properties.get(key, "") for key in ("id", "name", "description", "provider", "license")}
    _check_touchable(path, head.values())
    numbers = takewhile(lambda number: {f"name#{number}", f"id#{number}"} & properties.keys(), count(1))
    every = [_piece(path, properties, number, head["license"]) for number in numbers]
    for piece in every:
        if piece.model not in members:
            raise LibraryFileError(
                f"Furniture library {path} has no file {piece.model!r}, the model of {piece.name!r}: fetch it again"
            )
    pieces = tuple(piece for piece in every if piece.model.lower().endswith(".obj") and not is_untouched(piece.creator))
    if not pieces:
        raise LibraryFileError(f"Furniture library {path} has no model in the format .obj: choose another library")
    return Library(path, head["name"] or path.stem, head["license"], ROLES.get(head["id"], FREE), pieces)


def _check_touchable(path: Path, texts: Iterable[str]) -> None:
    if any(map(is_untouched, texts)):
        raise LibraryFileError(
            f"{path} is the library KatorLegaz, which is kept for the tests of others and never used here: "
            "choose another library"
        )


def _piece(path: Path, properties: dict[str, str], number: int, licence: str) -> Piece:
    def text(key: str) -> str:
        return properties.get(f"{key}#{number}", "")

    def numbers(key: str, default: tuple[float, ...] = (), low: float = 0.001, high: float = 10_000.0) -> list[float]:
        try:
            values = [float(word) for word in text(key).split()] or list(default)
        except ValueError:
            values = []
        if len(values) != max(len(default), 1) or not all(low <= value <= high for value in values):  # of nan, too
            raise LibraryFileError(
                f"Furniture library {path} has {text(key)!r} as {key} of its piece {number}: fetch it again"
            )
        return values

    (width,), (depth,), (height,) = (numbers(key) for key in ("width", "depth", "height"))
    (drop,) = numbers("dropOnTopElevation", (height,), low=-1.0)
    (elevation,) = numbers("elevation", (0.0,), low=0.0)
    return Piece(
        name=text("name") or text("id"),
        category=text("category"),
        tags=text("tags"),
        model=text("model").removeprefix("/"),
        size=(width / 100.0, depth / 100.0, height / 100.0),
        library=path,
        elevation=elevation / 100.0,
        top=None if drop < 0 else drop / 100.0,
        rotation=tuple(numbers("modelRotation", UPRIGHT, low=-1.001, high=1.001)),
        creator=text("creator"),
        licence=text("license") or licence,
        is_opening=text("doorOrWindow") == "true",
    )


_ENCODING = "latin-1"  # which reads any bytes and writes the same
_TEXTURES = ("map_", "bump", "disp", "decal", "refl", "norm")


def keep_own_textures(folder: Path) -> None:
    """Take lines with textures that are not in `folder` out of its .mtl files.

    Some name files on the disks of their creators, which an importer would look for on this one.
    """
    for path in (path for path in folder.iterdir() if path.suffix.lower() == ".mtl"):
        lines = path.read_text(_ENCODING).splitlines()
        kept = [line for line in lines if not line.strip().lower().startswith(_TEXTURES) or _is_there(folder, line)]
        path.write_text("\n".join([*kept, ""]), _ENCODING)


def _is_there(folder: Path, line: str) -> bool:
    """Tell whether the end of a line, after its options, is the name of a file in the folder."""
    words = line.split()[1:]
    names = (" ".join(words[start:]) for start in range(len(words)))
    return any(Path(name).name == name and (folder / name).is_file() for name in names)
