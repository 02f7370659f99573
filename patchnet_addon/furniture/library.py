# SPDX-License-Identifier: GPL-3.0-or-later
"""Furniture libraries of Sweet Home 3D: zip files (.sh3f) with models (.obj) and a catalogue of their sizes."""

from __future__ import annotations

import math
from dataclasses import dataclass
from pathlib import Path

from .archive import LibraryFileError, is_harmless, opened_archive
from .policy import check_touchable, is_untouched, role_of
from .properties import read_properties

CATALOGUE = "PluginFurnitureCatalog.properties"
_MOST_PIECES = 100_000
_LARGEST_CM = 10_000.0
Rotation = tuple[float, ...]  # 3 x 3 by rows, of the model's own axes: y is up
UPRIGHT: Rotation = (1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0)


@dataclass(frozen=True)
class Piece:
    """Piece of furniture: a model and what the catalogue says of it.

    library: file that it is from, None for what a script builds (`own_pieces.py`). model: its member of the archive.
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


def read_library(path: Path) -> Library:
    """Read the catalogue of a .sh3f file.

    Pieces by creators of the library that is not touched are left out. Raises LibraryFileError if the file is missing,
    damaged, dangerous to unpack or not to be touched, or if a model that the catalogue names is not in it.
    """
    check_touchable(path)
    with opened_archive(path) as archive:
        members = set(archive.namelist())
        if CATALOGUE not in members:
            raise LibraryFileError(f"{path} has no {CATALOGUE}: it is not a furniture library (.sh3f)")
        properties = read_properties(archive.read(CATALOGUE))
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
    return Library(path, head["name"] or path.stem, head["license"], role_of(head["id"]), tuple(pieces))


def _piece(path: Path, properties: dict[str, str], number: int, licence: str) -> Piece:
    def text(key: str) -> str:
        return properties.get(f"{key}#{number}", "")

    def number_of(key: str, low: float, default: float | None = None) -> float:
        try:
            value = float(text(key)) if text(key) or default is None else default
        except ValueError:
            value = math.nan
        if not low <= value <= _LARGEST_CM:  # false for what is no number, too
            raise LibraryFileError(
                f"Furniture library {path} has {text(key)!r} as {key} of its piece {number}: fetch it again"
            )
        return value

    model = text("model").removeprefix("/")
    if not is_harmless(model):
        raise LibraryFileError(f"Furniture library {path} has {model!r} as model of its piece {number}: fetch it again")
    size = (number_of("width", 1e-3), number_of("depth", 1e-3), number_of("height", 1e-3))
    drop = number_of("dropOnTopElevation", -1.0, size[2])
    return Piece(
        name=text("name") or text("id"),
        category=text("category"),
        tags=text("tags"),
        model=model,
        size=(size[0] / 100.0, size[1] / 100.0, size[2] / 100.0),
        library=path,
        elevation=number_of("elevation", 0.0, 0.0) / 100.0,
        top=None if drop < 0 else drop / 100.0,
        rotation=_rotation(path, text("modelRotation"), number),
        creator=text("creator"),
        licence=text("license") or licence,
        is_opening=text("doorOrWindow") == "true",
    )


def _rotation(path: Path, text: str, number: int) -> Rotation:
    if not text:
        return UPRIGHT
    try:
        values = tuple(float(word) for word in text.split())
    except ValueError:
        values = ()
    if len(values) != 9 or not all(math.isfinite(value) and abs(value) <= 1.001 for value in values):
        raise LibraryFileError(
            f"Furniture library {path} has {text!r} as modelRotation of its piece {number}: fetch it again"
        )
    return values
