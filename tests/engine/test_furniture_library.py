# SPDX-License-Identifier: GPL-3.0-or-later
"""Furniture libraries: what is read, and what is refused before anything is unpacked."""

from pathlib import Path

import pytest

from patchnet.commands.lab.furnished import library
from patchnet.commands.lab.furnished.library import (
    FREE,
    TEST,
    TRAIN,
    UPRIGHT,
    LibraryFileError,
    common_role,
    keep_own_textures,
    opened_archive,
    read_library,
    read_properties,
    unpack_folder,
)
from patchnet.patchnet_addon.runtime.errors import SettingError
from patchnet.tests.furniture_library import CATALOGUE, CUBE, FURNITURE, write_library


def test_catalogue_is_read(tmp_path: Path) -> None:
    extra = "modelRotation#1=0 0 1 0 1 0 -1 0 0\ndropOnTopElevation#2=-1\nelevation#2=50\nlicense#2=Other"
    found = read_library(write_library(tmp_path / "cubes.sh3f", extra=extra))
    assert (found.name, found.role, found.licence) == ("Cubes", FREE, "CC © test")
    assert [piece.name for piece in found.pieces] == [row[0] for row in FURNITURE]
    table, chair = found.pieces[:2]
    assert table.size == (1.5, 0.8, 0.75) and table.top == 0.75 and table.elevation == 0.0
    assert table.rotation == (0, 0, 1, 0, 1, 0, -1, 0, 0) and chair.rotation == UPRIGHT
    assert chair.top is None and chair.elevation == 0.5 and chair.licence == "Other" and table.licence == "CC © test"
    assert table.model == "cubes/cube1.obj" and table.creator == "A | tester"


def test_properties_of_java() -> None:
    text = b"# note\n! note\n a = b\\\n   c \r\nkey\\ x:v\\u00e9\\t1\nempty\nlast#1=x=y"
    assert read_properties(text) == {"a": "bc", "key x": "v\xe9\t1", "empty": "", "last#1": "x=y"}


def test_roles_are_by_id_and_are_not_mixed(tmp_path: Path) -> None:
    for identity, role in (("SweetHome3D#ScopiaModels", TRAIN), ("SweetHome3D#ReallusionModels", TEST)):
        assert read_library(write_library(tmp_path / "a.sh3f", identity=identity)).role == role
    assert (common_role([TRAIN, FREE]), common_role([FREE, TEST]), common_role([FREE])) == (TRAIN, TEST, FREE)
    with pytest.raises(SettingError, match="together"):
        common_role([TRAIN, TEST])


def test_untouched_library_is_not_even_opened(tmp_path: Path) -> None:
    with pytest.raises(LibraryFileError, match="kept for the tests of others"):
        read_library(tmp_path / "KatorLegaz.sh3f")  # there is none
    renamed = write_library(tmp_path / "other.sh3f", identity="SweetHome3D#Kator_LegazModels")
    with pytest.raises(LibraryFileError, match="kept for the tests of others"):
        read_library(renamed)


def test_pieces_of_its_creators_are_left_out_of_other_libraries(tmp_path: Path) -> None:
    path = write_library(tmp_path / "a.sh3f", extra="creator#2=Somebody, Kator Legaz & others")
    assert [piece.name for piece in read_library(path).pieces] == [row[0] for row in FURNITURE if row[0] != "Chair"]


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
    (tmp_path / "below").mkdir()
    (tmp_path / "below" / "x.png").touch()
    good = ["newmtl a", "Kd 1 1 1", "map_Kd my wood.jpg", "  map_Bump -bm 0.5 my wood.jpg"]
    wrong = ["map_Kd /etc/passwd", "map_Kd ../x.png", "MAP_d C:/x.png", "bump none.png", "map_Kd below/x.png", "map_Kd"]
    (tmp_path / "a.MTL").write_text("\n".join([*good[:2], *wrong, *good[2:]]))
    keep_own_textures(tmp_path)
    assert (tmp_path / "a.MTL").read_text().splitlines() == good
