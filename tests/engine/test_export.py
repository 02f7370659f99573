# SPDX-License-Identifier: GPL-3.0-or-later
"""Exported voxels, read back by independent code.

The .vdb tests need a module `openvdb` or `pyopenvdb`: Debian's package python3-openvdb has one for its own Python.
"""

from dataclasses import replace

import numpy as np
import pytest

from patchnet import commands
from patchnet.patchnet_addon.export import vdb
from patchnet.patchnet_addon.export.formats import export_octree
from patchnet.patchnet_addon.octree.file import load_octree, save_octree
from patchnet.patchnet_addon.octree.grid import Grid
from patchnet.patchnet_addon.octree.voxel_cloud import voxel_cloud
from patchnet.patchnet_addon.runtime.errors import SettingError
from patchnet.patchnet_addon.runtime.progress import drain
from patchnet.tests.engine.octree_samples import dense_cells, random_octree

needs_vdb = pytest.mark.skipif(not vdb.vdb_module_name(), reason="this Python has no openvdb module")


@pytest.fixture(scope="module")
def octree():
    """Leaves on several levels, in a cube away from the world's origin."""
    octree = random_octree(seed=5, depth=7, count=900, adaptive=True)
    return replace(octree, grid=Grid((-3.0, 10.0, 2.5), 4.0, 7), exposure=0.5, provenance={"scene": "Höhle"})


def read_ply(path):
    """Vertices of a binary little-endian PLY without faces, by its header alone."""
    types = {"float": "<f4", "uchar": "u1"}
    header, data = path.read_bytes().split(b"end_header\n", 1)
    lines = header.decode("ascii").splitlines()
    assert lines[:2] == ["ply", "format binary_little_endian 1.0"]
    count = next(int(line.split()[2]) for line in lines if line.startswith("element vertex"))
    row = np.dtype([(line.split()[2], types[line.split()[1]]) for line in lines if line.startswith("property")])
    assert len(data) == count * row.itemsize
    return np.frombuffer(data, row)


@pytest.mark.parametrize("colored", [False, True])
@pytest.mark.parametrize("level", [0, 3, 7])
def test_ply(octree, colored, level, tmp_path):
    if colored:
        chroma = np.random.default_rng(1).integers(40, 128, (octree.node_count, 2)).astype(np.uint8)
        octree = replace(octree, chroma=chroma)
    path = tmp_path / "voxels.ply"
    cloud = voxel_cloud(octree, level)
    assert drain(export_octree(octree, path, level)) == len(cloud)
    rows = read_ply(path)
    np.testing.assert_allclose(np.stack([rows[axis] for axis in "xyz"], -1), cloud.centres_world, atol=1e-6)
    np.testing.assert_array_equal(np.stack([rows["n" + axis] for axis in "xyz"], -1), cloud.normal)
    for name, values in (("luminance", cloud.luminance), ("side", cloud.side_world), ("area", cloud.area_world)):
        np.testing.assert_array_equal(rows[f"scalar_{name}"], values)
    values = np.stack([rows[name] for name in ("red", "green", "blue")], axis=-1) / 255
    linear = np.where(values <= 10 / 255, values / 12.92, ((values + 0.055) / 1.055) ** 2.4)
    color = cloud.luminance[:, None] if octree.chroma is None else np.clip(cloud.color, 0, 1)
    np.testing.assert_allclose(linear, np.broadcast_to(color, linear.shape), atol=0.005)


def test_octree_file(octree, tmp_path):
    path = tmp_path / "octree.safetensors"
    drain(export_octree(octree, path))
    np.testing.assert_array_equal(load_octree(path).luminance, octree.luminance)
    drain(export_octree(octree, path, 4))
    np.testing.assert_array_equal(dense_cells(load_octree(path), 4), dense_cells(octree, 4))
    with pytest.raises(SettingError, match="at least level 1"):
        drain(export_octree(octree, path, 0))


def dense_grid(grid, side):
    """Values (side, side, side) of an OpenVDB grid, order x, y, z."""
    values = np.full((side, side, side), np.nan, np.float32)
    grid.copyToArray(values, ijk=(0, 0, 0))
    return values


@needs_vdb
@pytest.mark.parametrize("level", [0, 2, 5, 6, 7])
def test_vdb(octree, level, tmp_path):
    path = tmp_path / "voxels.vdb"
    assert drain(export_octree(octree, path, level)) == len(voxel_cloud(octree, level))
    module = pytest.importorskip(vdb.vdb_module_name())
    grids = {grid.name: grid for grid in module.readAll(str(path))[0]}
    assert set(grids) == {"luminance", "density"}
    expected, side = dense_cells(octree, level).transpose(2, 1, 0, 3), 1 << level
    np.testing.assert_allclose(dense_grid(grids["luminance"], side), expected[..., 1], atol=1e-6)
    for grid in grids.values():
        assert grid.activeVoxelCount() == expected[..., 0].sum()
        centre = grid.transform.indexToWorld((0, 0, 0))
        np.testing.assert_allclose(centre, np.array([-3.0, 10.0, 2.5]) + 4.0 / side / 2, atol=1e-12)
    # Extinction times volume, times 2, is the surface again.
    density = dense_grid(grids["density"], side).sum(dtype=np.float64)
    assert density * (4.0 / side) ** 3 * 2 == pytest.approx(octree.area_world[0], rel=1e-4)


@pytest.mark.skipif(bool(vdb.vdb_module_name()), reason="this Python has an openvdb module")
def test_vdb_is_refused_without_its_module(octree, tmp_path):
    with pytest.raises(SettingError, match="no openvdb module"):
        drain(export_octree(octree, tmp_path / "voxels.vdb"))
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize("name", ["voxels.xyz", "voxels"])
def test_unknown_ending(octree, name, tmp_path):
    with pytest.raises(SettingError, match=r"choose one of \.ply, \.vdb, \.safetensors"):
        drain(export_octree(octree, tmp_path / name))


def test_command(octree, tmp_path, capsys):
    source, out = tmp_path / "octree.safetensors", tmp_path / "new" / "voxels.ply"
    save_octree(octree, source)
    assert commands.main(["export", str(source), "--level", "4", "--out", str(out)]) == 0
    assert len(read_ply(out)) == len(voxel_cloud(octree, 4))
    assert f"{len(voxel_cloud(octree, 4)):,} voxels of level 4" in capsys.readouterr().out
    assert commands.main(["export", str(source), "--level", "9", "--out", str(out)]) == 2
    assert "Level 9 is outside 0 to 7" in capsys.readouterr().err
