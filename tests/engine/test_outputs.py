# SPDX-License-Identifier: GPL-3.0-or-later
"""Outputs never replace inputs, foreign files or files of another kind."""

import json
import os
import zipfile
from pathlib import Path

import numpy as np
import pytest

from patchnet.patchnet_addon.runtime import file_kinds
from patchnet.patchnet_addon.runtime.errors import OutputError
from patchnet.patchnet_addon.runtime.file_kinds import FileKind
from patchnet.patchnet_addon.runtime.files import write_arrays
from patchnet.patchnet_addon.runtime.outputs import check_outputs, check_room
from patchnet.patchnet_addon.runtime.replace import replaced_file
from patchnet.training import file_kinds as lab_kinds

RECORD = {"frame": 1, "content": "", "file": "", "files": {}, "summary": {}}


def arrays(kind: str):
    return lambda path: write_arrays(path, {"a": np.arange(3)}, {}, kind)


def text(content: str):
    return lambda path: path.write_text(content)


def beginning(content: bytes):
    return lambda path: path.write_bytes(content + bytes(100))


def archive(member: str):
    def make(path: Path) -> None:
        with zipfile.ZipFile(path, "w") as file:
            file.writestr(member, "")

    return make


# A file of each kind, as small as can be.
MAKERS = {
    "octree": ("a.safetensors", file_kinds.OCTREE, arrays("octree")),
    "codes": ("a.safetensors", file_kinds.CODES, arrays("codes")),
    "weights": ("a.safetensors", lab_kinds.WEIGHTS, arrays("weights")),
    "samples": ("a.samples.safetensors", lab_kinds.SAMPLES, arrays("samples")),
    "png": ("a.png", file_kinds.PNG, beginning(b"\x89PNG\r\n\x1a\n")),
    "exr": ("a.exr", file_kinds.EXR, beginning(b"\x76\x2f\x31\x01")),
    "svg": ("a.svg", lab_kinds.SVG, text("<?xml version='1.0'?>\n<svg></svg>")),
    "ply": ("a.ply", file_kinds.PLY, text("ply\nformat ascii 1.0\n")),
    "vdb": ("a.vdb", file_kinds.VDB, beginning(b" BDV\0\0\0\0")),
    "blend": ("a.blend", file_kinds.BLEND, beginning(b"\x28\xb5\x2f\xfd")),
    "report": ("report.json", file_kinds.REPORT, text(json.dumps({"versions": {"patchnet": "0.1.0"}}))),
    "record": ("frame.json", file_kinds.FRAME_RECORD, text(json.dumps(RECORD))),
    "checkpoint": ("checkpoint.pt", lab_kinds.CHECKPOINT, archive("checkpoint/data.pkl")),
    "log": ("log.jsonl", lab_kinds.TRAINING_LOG, text('{"step": 50, "coverage": 0.1}\n')),
}
FOREIGN = {
    "script": text("import os\n"),
    "settings": text('{"frame": 1, "versions": "patchnet", "step": []}'),
    "list": text('["step", "patchnet"]'),
    "document": archive("word/document.xml"),
    "other program's arrays": beginning((2).to_bytes(8, "little") + b"{}"),
    "zeros": beginning(b""),
}


@pytest.mark.parametrize("name", MAKERS)
def test_a_kind_replaces_its_own_and_no_other(name: str, tmp_path: Path) -> None:
    filename, kind, make = MAKERS[name]
    path = tmp_path / filename
    make(path)
    check_outputs({path: kind})
    for other, (_, other_kind, _) in MAKERS.items():
        if other != name:
            with pytest.raises(OutputError, match=f"is not {other_kind.title}, so it is not replaced"):
                check_outputs({path: other_kind})


@pytest.mark.parametrize("name", MAKERS)
@pytest.mark.parametrize("foreign", FOREIGN)
def test_foreign_files_stay_whatever_their_ending(name: str, foreign: str, tmp_path: Path) -> None:
    filename, kind, _ = MAKERS[name]
    path = tmp_path / filename
    FOREIGN[foreign](path)
    before = path.read_bytes()
    with pytest.raises(OutputError, match="is not replaced"), replaced_file(path, kind) as file:
        file.write(b"new")
    assert path.read_bytes() == before and os.listdir(tmp_path) == [filename]


def test_empty_files_hold_nothing_but_their_name(tmp_path: Path) -> None:
    for name in ("a.ply", "__init__.py"):
        (tmp_path / name).touch()
    check_outputs({tmp_path / "a.ply": file_kinds.PLY})
    with pytest.raises(OutputError, match=r"is not a \.ply file"):
        check_outputs({tmp_path / "__init__.py": file_kinds.PLY})


def test_nothing_that_is_read_is_replaced(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    folder = tmp_path / "folder"
    folder.mkdir()
    source = folder / "a.safetensors"
    arrays("octree")(source)
    (tmp_path / "link.safetensors").symlink_to(source)
    (tmp_path / "hard.safetensors").hardlink_to(source)
    (tmp_path / "way").symlink_to(folder)
    monkeypatch.chdir(folder)
    other = tmp_path / "other.safetensors"
    arrays("octree")(other)
    check_outputs({other: file_kinds.OCTREE}, [source, tmp_path / "missing", Path("bad\0name")])
    for spelled in (
        source,
        Path("a.safetensors"),
        Path("../folder/./a.safetensors"),
        tmp_path / "link.safetensors",
        tmp_path / "hard.safetensors",
        tmp_path / "way" / "a.safetensors",
    ):
        with pytest.raises(OutputError, match=r"is an input|is the same file as"):
            check_outputs({spelled: file_kinds.OCTREE}, [source])
        with pytest.raises(OutputError, match="and would be replaced"):
            check_outputs({source: file_kinds.OCTREE}, [spelled])


def refused(path: Path, match: str, *, folder: Path | None = None, kind: FileKind = file_kinds.PNG) -> None:
    with pytest.raises(OutputError, match=match):
        check_outputs({path: kind}, folder=folder)


def test_what_is_in_the_way_is_named(tmp_path: Path) -> None:
    file = tmp_path / "file"
    file.write_text("mine")
    (tmp_path / "lost").symlink_to(tmp_path / "nowhere")
    (tmp_path / "a.png").mkdir()
    refused(file / "a.png", f"{file} is a file, and the output needs a folder", folder=file)
    refused(file / "Eye" / "a.png", f"{file} is a file, and a folder is needed")
    refused(tmp_path / "lost" / "a.png", "lost is a file, and a folder is needed")
    refused(tmp_path / "a.png", "a.png is a folder, and a .png picture cannot replace it")
    if os.name == "posix":
        refused(Path("/dev/null"), "/dev/null is not a regular file")
    assert sorted(os.listdir(tmp_path)) == ["a.png", "file", "lost"]


@pytest.mark.skipif(not Path("/proc/self").is_dir(), reason="there is no folder here that not even root can write")
def test_folders_that_cannot_be_written_are_named() -> None:
    refused(Path("/proc/self/a.png"), "Folder /proc/self cannot be written")
    refused(Path("/proc/self/new/a.png"), "Folder /proc/self cannot be written")


def test_write_protected_files_stay(tmp_path: Path) -> None:
    path = tmp_path / "a.ply"
    path.write_text("ply\n")
    path.chmod(0o444)
    refused(path, "write-protected", kind=file_kinds.PLY)


def test_what_comes_during_the_work_stays(tmp_path: Path) -> None:
    path = tmp_path / "a.ply"
    with pytest.raises(OutputError, match=r"is not a \.ply file"), replaced_file(path, file_kinds.PLY) as file:
        file.write(b"ply\n")
        path.write_text("somebody's notes")
    assert path.read_text() == "somebody's notes" and os.listdir(tmp_path) == ["a.ply"]


def test_room_on_the_disk(tmp_path: Path) -> None:
    check_room(tmp_path / "new" / "folder", 1000, "The voxels")
    with pytest.raises(
        OutputError, match=r"The voxels need about .* and .*folder has .*: make room, or choose another"
    ):
        check_room(tmp_path / "new" / "folder", 1e18, "The voxels")
    assert not (tmp_path / "new").exists()
