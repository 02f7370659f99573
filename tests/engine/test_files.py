# SPDX-License-Identifier: GPL-3.0-or-later
"""Our file format: round trips, damage, errors of one sentence, atomic replacement."""

import json
import os

import numpy as np
import pytest
from safetensors.numpy import load_file, save_file

from patchnet.patchnet_addon.runtime.errors import OctreeFileError, PatchNetError
from patchnet.patchnet_addon.runtime.files import content_hash, read_arrays, write_arrays

ARRAYS = {
    "mask": np.arange(7, dtype=np.uint8),
    "flags": np.array([True, False, True]),
    "normal": np.arange(-6, 6, dtype=np.int8).reshape(4, 3),
    "codes": np.linspace(-1, 1, 10).astype(np.float16).reshape(2, 5),
    "area": np.array([1.5, np.inf, -0.0]),
    "first": np.arange(5, dtype=np.uint32)[::2],
    "empty": np.zeros((0, 3), np.float32),
    "scalar": np.array(3, np.int64),
}
METADATA = {"scene": "Höhle", "depth": 9, "nested": {"list": [1, 2.5, None, True]}}


@pytest.fixture
def file(tmp_path):
    path = tmp_path / "scene.safetensors"
    write_arrays(path, ARRAYS, METADATA, "octree")
    return path


def read(path, **settings):
    return read_arrays(path, "octree", OctreeFileError, **settings)


def test_round_trip(file):
    arrays, metadata = read(file)
    assert metadata == METADATA
    assert arrays.keys() == ARRAYS.keys()
    for name, array in ARRAYS.items():
        assert type(arrays[name]) is np.ndarray
        assert arrays[name].dtype == array.dtype
        assert arrays[name].flags.aligned
        np.testing.assert_array_equal(arrays[name], array)


def test_any_safetensors_reader_reads_it(file):
    foreign_view = load_file(file)
    for name, array in ARRAYS.items():
        np.testing.assert_array_equal(foreign_view[name], array)


def test_file_can_be_replaced_while_it_is_mapped(file):
    arrays, _ = read(file)
    write_arrays(file, {"mask": np.zeros(2, np.uint8)}, {}, "octree")
    np.testing.assert_array_equal(arrays["mask"], ARRAYS["mask"])
    assert len(read(file)[0]["mask"]) == 2


def test_every_truncation_and_what_is_appended_is_noticed(file, tmp_path):
    whole = file.read_bytes()
    cut = tmp_path / "cut.safetensors"
    for content in (*(whole[:length] for length in range(len(whole))), whole + b"\0"):
        cut.write_bytes(content)
        with pytest.raises(OctreeFileError, match=r"cut\.safetensors is (truncated|damaged|not a PatchNet file)"):
            read(cut)


def test_no_bit_flip_changes_what_is_read(file, tmp_path):
    whole = bytearray(file.read_bytes())
    flipped = tmp_path / "flipped.safetensors"
    random = np.random.default_rng(0)
    header_end = 8 + int.from_bytes(whole[:8], "little")
    places = [*range(8 * 8), *random.integers(64, 8 * header_end, 500), *range(8 * header_end, 8 * len(whole))]
    for bit in places:
        copy = whole.copy()
        copy[bit // 8] ^= 1 << (bit % 8)
        flipped.write_bytes(copy)
        try:
            arrays, metadata = read(flipped)
        except OctreeFileError as caught:
            assert str(flipped) in str(caught)
            continue
        # A flip in the header may be without effect, as one that turns an escaped letter into its other case.
        assert bit < 8 * header_end
        assert metadata == METADATA
        assert content_hash(arrays) == content_hash(ARRAYS)


def _with_header(path, change):
    whole = path.read_bytes()
    length = int.from_bytes(whole[:8], "little")
    header = json.loads(whole[8 : 8 + length])
    change(header)
    text = json.dumps(header).encode()
    path.write_bytes(len(text).to_bytes(8, "little") + text + whole[8 + length :])


@pytest.mark.parametrize(
    ("change", "sentence"),
    [
        (lambda header: header["__metadata__"].update(schema_version="2"), "newer PatchNet"),
        (lambda header: header["__metadata__"].update(schema_version="x"), "damaged"),
        (lambda header: header["__metadata__"].pop("header_checksum"), "damaged"),
        (lambda header: header["mask"].update(dtype="F8"), "damaged"),
        (lambda header: header["mask"].update(shape=[10**30]), "damaged"),
        (lambda header: header["mask"].update(data_offsets=[0, 10**30]), "damaged"),
        (lambda header: header.pop("mask"), "damaged"),
    ],
)
def test_damaged_header(file, change, sentence):
    _with_header(file, change)
    with pytest.raises(OctreeFileError, match=sentence):
        read(file)


def test_missing_folder_and_wrong_kind(file, tmp_path):
    with pytest.raises(OctreeFileError, match="does not exist"):
        read(tmp_path / "none.safetensors")
    with pytest.raises(OctreeFileError, match="cannot be read"):
        read(tmp_path)
    with pytest.raises(OctreeFileError, match="octree file where a codes file is needed"):
        read_arrays(file, "codes", OctreeFileError)


@pytest.mark.parametrize(
    "content", [b"", b"PK\x03\x04", b"BLENDER-v405" * 50, b"\0" * 500, b"\x20" + b"\0" * 7 + b"[" * 32]
)
def test_foreign_file(tmp_path, content):
    path = tmp_path / "foreign.safetensors"
    path.write_bytes(content)
    with pytest.raises(OctreeFileError, match="not a PatchNet file"):
        read(path)


def test_safetensors_of_another_program(tmp_path):
    path = tmp_path / "other.safetensors"
    save_file({"mask": np.zeros(3, np.float32)}, path)
    with pytest.raises(OctreeFileError, match="another program"):
        read(path)


def test_failed_writing_keeps_the_good_file(file, tmp_path, monkeypatch):
    before = file.read_bytes()

    def full(descriptor):
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(os, "fsync", full)
    with pytest.raises(PatchNetError, match=r"scene\.safetensors cannot be written: No space left"):
        write_arrays(file, {"mask": np.zeros(2, np.uint8)}, {}, "octree")
    assert file.read_bytes() == before
    assert [path.name for path in tmp_path.iterdir()] == [file.name]
