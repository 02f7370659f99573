# SPDX-License-Identifier: GPL-3.0-or-later
"""Picture metrics against values computed by hand, regions of pictures, EXR files."""

import struct
from pathlib import Path

import numpy as np
import pytest

from patchnet.patchnet_addon.image.comparison import (
    MAX_PSNR_DB,
    REGIONS,
    Guides,
    compare,
    mean_ratio,
    picture_psnr,
    regions,
)
from patchnet.patchnet_addon.image.exr import read_exr
from patchnet.patchnet_addon.runtime.errors import FileFormatError

SIZE = 24


def flat(value: float) -> np.ndarray:
    return np.full((SIZE, SIZE), value, np.float32)


def guides(**changed: np.ndarray) -> Guides:
    normal = np.zeros((SIZE, SIZE, 3), np.float32)
    normal[..., 2] = 1.0
    plain = {"coverage": flat(1), "other_coverage": flat(1), "depth": flat(5), "albedo": flat(0.5), "normal": normal}
    return Guides(**(plain | changed))


def test_psnr_and_ratio_by_hand() -> None:
    assert picture_psnr(flat(0.6), flat(0.5)) == pytest.approx(20.0, abs=1e-4)
    assert picture_psnr(flat(0.5), flat(0.5)) == MAX_PSNR_DB
    assert picture_psnr(flat(1.0), flat(7.0)) == MAX_PSNR_DB, "both are clamped at 1"
    half = np.arange(SIZE) < SIZE // 2
    picture = np.where(half, 0.6, 0.5) * np.ones((SIZE, 1))
    assert picture_psnr(picture, flat(0.5)) == pytest.approx(20.0 + 10 * np.log10(2), abs=1e-4)
    assert picture_psnr(picture, flat(0.5), np.tile(half, (SIZE, 1))) == pytest.approx(20.0, abs=1e-4)
    assert mean_ratio(flat(0.25), flat(0.5)) == pytest.approx(0.5)
    assert mean_ratio(flat(0.25), flat(0.0)) is None


def test_regions_are_what_they_are_called() -> None:
    left = np.zeros((SIZE, SIZE), bool)
    left[:, : SIZE // 2] = True
    edge = np.s_[:, SIZE // 2]
    bent = guides().normal.copy()
    bent[left] = (1.0, 0.0, 0.0)
    slope = 1.0 / (0.1 + 0.02 * np.arange(SIZE, dtype=np.float32))[None, :] * np.ones((SIZE, 1), np.float32)
    cases = {
        "silhouettes": (flat(0.5), guides(coverage=left.astype(np.float32), other_coverage=left.astype(np.float32))),
        "creases": (flat(0.5), guides(normal=bent)),
        "shadows": (np.where(left, 0.1, 0.5).astype(np.float32), guides()),
        "textures": (np.where(left, 0.1, 0.5).astype(np.float32), guides(albedo=np.where(left, 0.16, 0.8))),
        "smooth": (flat(0.5), guides(depth=slope)),
    }
    for name, (picture, layers) in cases.items():
        masks = regions(picture, layers)
        assert tuple(masks) == REGIONS
        assert masks[name][edge].all(), name
        assert sum(mask.astype(int) for mask in masks.values()).max() == 1
        assert sum(mask.astype(int) for mask in masks.values()).min() == 1
    masks = regions(flat(0.5), guides(depth=np.where(left, 5.0, 9.0)))
    assert masks["silhouettes"][edge].all(), "depth jumps"
    assert not masks["silhouettes"][:, 0].any()


def test_shares_of_the_error_add_up() -> None:
    rng = np.random.default_rng(3)
    reference = rng.random((SIZE, SIZE)).astype(np.float32)
    report = compare(reference * 0.9, reference, guides(albedo=rng.random((SIZE, SIZE))))
    assert sum(region["error"] for region in report["regions"].values()) == pytest.approx(1.0)
    assert sum(region["pixels"] for region in report["regions"].values()) == pytest.approx(1.0)
    assert report["mean_ratio"] == pytest.approx(0.9, abs=1e-6)
    none_covered = compare(flat(0.1), flat(0.1), guides(coverage=flat(0.0)))
    assert none_covered["psnr_where_both_hit_db"] is None


def exr(channels: dict[str, np.ndarray], compression: int = 0) -> bytes:
    """A scan-line file of 32-bit channels, as the format's description says."""

    def attribute(name: str, kind: str, value: bytes) -> bytes:
        return name.encode() + b"\0" + kind.encode() + b"\0" + struct.pack("<i", len(value)) + value

    height, width = next(iter(channels.values())).shape
    names = sorted(channels)
    listed = b"".join(name.encode() + b"\0" + struct.pack("<iIii", 2, 0, 1, 1) for name in names) + b"\0"
    header = struct.pack("<ii", 20000630, 2) + attribute("channels", "chlist", listed)
    header += attribute("compression", "compression", bytes([compression]))
    header += attribute("dataWindow", "box2i", struct.pack("<iiii", 0, 0, width - 1, height - 1)) + b"\0"
    rows = [
        struct.pack("<ii", row, 4 * width * len(names))
        + b"".join(channels[name][height - 1 - row].astype("<f4").tobytes() for name in names)
        for row in range(height)
    ]
    start = len(header) + 8 * height
    offsets = [start + sum(len(before) for before in rows[:row]) for row in range(height)]
    return header + struct.pack(f"<{height}Q", *offsets) + b"".join(rows)


def test_exr_files_are_read(tmp_path: Path) -> None:
    rng = np.random.default_rng(1)
    channels = {name: rng.random((3, 5)).astype(np.float32) for name in ("Layer.Combined.R", "Layer.Depth.Z")}
    path = tmp_path / "a.exr"
    path.write_bytes(exr(channels))
    read = read_exr(path)
    assert set(read) == set(channels)
    for name, values in channels.items():
        np.testing.assert_array_equal(read[name], values)


@pytest.mark.parametrize("damage", [lambda data: data[:60], lambda data: data[:-9], lambda data: b"x" + data[1:]])
def test_damaged_exr_files_are_one_sentence(tmp_path: Path, damage) -> None:
    path = tmp_path / "a.exr"
    path.write_bytes(damage(exr({"A": np.zeros((3, 5), np.float32)})))
    with pytest.raises(FileFormatError, match=r"a\.exr"):
        read_exr(path)


def test_compressed_exr_files_are_refused(tmp_path: Path) -> None:
    path = tmp_path / "a.exr"
    path.write_bytes(exr({"A": np.zeros((3, 5), np.float32)}, compression=3))
    with pytest.raises(FileFormatError, match="compressed"):
        read_exr(path)
