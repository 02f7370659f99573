# SPDX-License-Identifier: GPL-3.0-or-later
"""Furniture libraries: wrong and malicious files are refused before unpacking."""

from pathlib import Path

import pytest

from patchnet.tests.furniture_library import CATALOGUE, CUBE, write_library
from patchnet.training.commands.lab.furnished import library
from patchnet.training.commands.lab.furnished.library import (
    LibraryFileError,
    keep_own_textures,
    opened_archive,
    read_library,
    unpack_folder,
)


@pytest.mark.parametrize(
    ("extra", "why"),
    [
        ("width#1=wide", "'wide' as width"),
        ("depth#1=nan", "'nan' as depth"),
        ("height#1=0", "'0' as height"),
        ("height#1=1e9", "as height"),
        ("modelRotation#1=1 2 3", "as modelRotation"),
        ("modelRotation#1=9 0 0 0 1 0 0 0 1", "as modelRotation"),
        ("model#1=/../secret.obj", "has no file '../secret.obj'"),
        ("model#1=cubes/none.obj", "has no file 'cubes/none.obj', the model of 'Table'"),
    ],
)
def test_wrong_catalogues(tmp_path: Path, extra: str, why: str) -> None:
    with pytest.raises(LibraryFileError, match=why):
        read_library(write_library(tmp_path / "wrong.sh3f", extra=extra))


def test_files_that_are_no_libraries(tmp_path: Path) -> None:
    with pytest.raises(LibraryFileError, match="is no file"):
        read_library(tmp_path / "none.sh3f")
    with pytest.raises(LibraryFileError, match="no model in the format"):
        read_library(write_library(tmp_path / "empty.sh3f", ()))
    with pytest.raises(LibraryFileError, match=f"has no {CATALOGUE}"):
        read_library(write_library(tmp_path / "zip.sh3f", without=[CATALOGUE]))
    good = write_library(tmp_path / "good.sh3f").read_bytes()
    damaged = tmp_path / "damaged.sh3f"
    for wrong in (b"", b"no zip at all", good[: len(good) // 2], good[:60] + bytes(40) + good[100:]):
        damaged.write_bytes(wrong)
        with pytest.raises(LibraryFileError, match=r"damaged\.sh3f"):
            read_library(damaged)


def test_bombs_are_refused(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(library, "MOST_BYTES", 4 << 20)
    path = write_library(tmp_path / "a.sh3f", files={"cubes/bomb.obj": "0" * (4 << 20)})
    with pytest.raises(LibraryFileError, match="unpacks to more than a library holds"):
        read_library(path)


def test_only_the_models_folder_is_unpacked(tmp_path: Path) -> None:
    path = write_library(tmp_path / "a.sh3f", files={"other/x.txt": "x", "cubes/below/y.txt": "y"})
    with opened_archive(path) as archive:
        model = unpack_folder(archive, "cubes/cube1.obj", tmp_path / "out")
    assert model.read_text() == CUBE
    assert {file.parent for file in (tmp_path / "out").rglob("*") if file.is_file()} == {tmp_path / "out" / "cubes"}


def test_only_textures_beside_the_model_stay(tmp_path: Path) -> None:
    """Also behind options, and with spaces in their names."""
    (tmp_path / "my wood.jpg").touch()
    (tmp_path / "wood.jpg").touch()
    (tmp_path / "below").mkdir()
    (tmp_path / "below" / "x.png").touch()
    good = ["newmtl a", "Kd 1 1 1", "map_Kd my wood.jpg", "  map_Bump -bm 0.5 my wood.jpg"]
    wrong = ["map_Kd /etc/passwd", "map_Kd ../x.png", "MAP_d C:/x.png", "bump none.png", "map_Kd below/x.png", "map_Kd"]
    wrong += ["map_Kd /home/my wood.jpg", "map_Kd C:\\my wood.jpg"]  # their last words are the name of a file
    (tmp_path / "a.MTL").write_text("\n".join([*good[:2], *wrong, *good[2:]]))
    keep_own_textures(tmp_path)
    assert (tmp_path / "a.MTL").read_text().splitlines() == good
