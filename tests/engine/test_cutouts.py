# SPDX-License-Identifier: GPL-3.0-or-later
"""Cut-out surfaces: leaves against alpha rasterised point by point and against the reference."""

from dataclasses import dataclass, replace

import numpy as np
import pytest

from patchnet.patchnet_addon.cells.morton import morton_decode, morton_encode
from patchnet.patchnet_addon.octree.accumulate import LeafSums
from patchnet.patchnet_addon.octree.grid import Grid
from patchnet.patchnet_addon.octree.voxelize import clip_batch
from patchnet.patchnet_addon.surface.mesh import Material, Texture, TriangleBatch, TriangleMesh
from patchnet.patchnet_addon.surface.shading import albedo_shade, opacity_shade
from patchnet.patchnet_addon.surface.textures import TextureTable
from patchnet.patchnet_addon.surface.triangles import triangle_areas_and_normals
from patchnet.tests.references.clip import piece_reference
from patchnet.tests.references.footprint import bilinear_reference, footprint_reference

from .mesh_samples import in_batches, leaves_of

UPRIGHT = np.array([(0.03, 0.05, 0.11), (0.9, 0.0, 0.0), (0.0, 0.87, 0.0)])  # origin and two edges
TILTED = np.array([(0.15, 0.08, 0.07), (0.7, 0.2, 0.3), (-0.1, 0.6, 0.55)])


def foliage(size: int, seed: int = 0) -> np.ndarray:
    """Opacity (size, size) of seven leaves, a disc and a thin stem, with soft edges of two texels; it tiles."""
    rng = np.random.default_rng(seed)
    y, x = (np.mgrid[0:size, 0:size] + 0.5) / size
    shapes = [(*rng.random(2), rng.uniform(0.06, 0.16), rng.uniform(0, np.pi), 3.0) for _ in range(7)]
    opacity = np.clip((0.012 - abs(x - 0.4)) * size / 2 + 0.5, 0, 1)
    for centre_x, centre_y, radius, angle, flatness in [*shapes, (0.7, 0.3, 0.1, 0.0, 1.0)]:
        dx, dy = x - centre_x, y - centre_y
        dx, dy = dx - np.rint(dx), dy - np.rint(dy)
        along, across = np.cos(angle) * dx + np.sin(angle) * dy, np.cos(angle) * dy - np.sin(angle) * dx
        opacity = np.maximum(opacity, np.clip((radius - np.hypot(along, flatness * across)) * size / 2 + 0.5, 0, 1))
    return opacity.astype(np.float32)


@dataclass(frozen=True)
class Quad:
    """A quad under a tiled texture. place: (3, 3) origin and edges. split: pairs of triangles along a side."""

    place: np.ndarray
    texels: int
    depth: int
    threshold: float | None = 0.5
    tiles: float = 1.0
    split: int = 1
    wrap: str = "REPEAT"
    transform: tuple | None = None

    @property
    def alpha(self) -> np.ndarray:
        return foliage(self.texels)

    def mesh(self) -> TriangleMesh:
        texture = Texture("leaves", self.alpha[..., None], self.wrap, self.transform)
        material = Material("leaves", (1.0, 1.0, 1.0), alpha_texture=texture, alpha_threshold=self.threshold)
        lines = np.linspace(0, 1, self.split + 1)
        low, high = lines[:-1], lines[1:]
        triangles = [
            triangle
            for i, j in np.ndindex(self.split, self.split)
            for triangle in (
                [(low[i], low[j]), (high[i], low[j]), (high[i], high[j])],
                [(low[i], low[j]), (high[i], high[j]), (low[i], high[j])],
            )
        ]
        st = np.array(triangles)
        corners = self.place[0] + st @ self.place[1:]
        uvs = (st * self.tiles).astype(np.float32)
        return TriangleMesh(in_batches(corners, (), uvs), (material,))

    @property
    def grid(self) -> Grid:
        return Grid((0.0, 0.0, 0.0), 1.0, self.depth)

    def voxelized(self) -> LeafSums:
        mesh = self.mesh()
        (leaves,) = leaves_of(mesh, self.grid, albedo_shade(mesh))
        return leaves

    def opacity(self, st: np.ndarray) -> np.ndarray:
        """Opacity (n,) at points (n, 2) of the quad, as a renderer finds it."""
        uv = st * self.tiles
        if self.transform is not None:
            uv = np.column_stack([uv, np.ones(len(uv))]) @ np.array(self.transform).T
        values = bilinear_reference(self.alpha[..., None], uv, self.wrap)[:, 0]
        return values if self.threshold is None else (values >= self.threshold).astype(float)

    def points(self, samples: int) -> tuple[np.ndarray, float]:
        """Points (n, 2) of the quad on a lattice of `samples` along a voxel, seen along z, and the area of each."""
        side = samples << self.depth
        x, y = np.meshgrid(*[(np.arange(side) + 0.5) / side] * 2)
        st = (np.column_stack([x.ravel(), y.ravel()]) - self.place[0, :2]) @ np.linalg.inv(self.place[1:, :2])
        normal = np.cross(*self.place[1:])
        inside = ((st >= 0) & (st <= 1)).all(axis=1)
        return st[inside], float(np.linalg.norm(normal) / abs(normal[2])) / side**2

    def keys(self, st: np.ndarray) -> np.ndarray:
        """Voxels (n,) of points."""
        return morton_encode(np.floor((self.place[0] + st @ self.place[1:]) * 2.0**self.depth).astype(int))

    def rasterised(self, samples: int = 32) -> tuple[np.ndarray, np.ndarray]:
        """Voxels that the quad meets and the opaque area in each, by dense points."""
        st, area = self.points(samples)
        keys = self.keys(st).astype(np.int64)
        met = np.flatnonzero(np.bincount(keys))
        return met.astype(np.uint64), np.bincount(keys, self.opacity(st))[met] * area

    def near_coverage(self, reach_world: float, samples: int) -> np.ndarray:
        """Voxels within `reach_world` of something opaque, along the axes."""
        st, _ = self.points(samples)
        points = self.place[0] + st[self.opacity(st) > 0] @ self.place[1:]
        near = np.zeros(((1 << self.depth) + 2,) * 3, bool)
        for step in (np.array(list(np.ndindex(3, 3, 3))) - 1) * reach_world:
            x, y, z = np.floor((points + step) * 2.0**self.depth).astype(int).T + 1
            near[x, y, z] = True
        return morton_encode(np.argwhere(near[1:-1, 1:-1, 1:-1]))


TURNED = ((0.0, -1.5, 0.25), (2.0, 0.0, -0.5))
# Voxels of 0.3 to 70 texels; leaves, stems and discs of a few voxels, and far below a voxel.
QUADS = {
    "voxels of 4 texels": Quad(UPRIGHT, 64, 4),
    "voxels of 2 texels": Quad(UPRIGHT, 64, 5),
    "voxels of half a texel": Quad(UPRIGHT, 32, 6),
    "voxels of a quarter texel": Quad(UPRIGHT, 12, 6),
    "tilted": Quad(TILTED, 64, 5),
    "tilted, 338 triangles": Quad(TILTED, 64, 5, split=13),
    "tilted, 800 triangles, small voxels": Quad(TILTED, 32, 6, split=20),
    "repeated": Quad(TILTED, 128, 4, tiles=4.0),
    "mirrored": Quad(TILTED, 100, 4, tiles=3.0, split=2, wrap="MIRROR"),
    "extended": Quad(TILTED, 37, 5, tiles=2.5, wrap="EXTEND"),
    "clipped": Quad(TILTED, 128, 5, tiles=1.3, split=3, wrap="CLIP"),
    "turned on the quad": Quad(TILTED, 48, 5, transform=TURNED),
    "voxels of 70 texels": Quad(UPRIGHT, 256, 2, wrap="CLIP"),
}


def on_reference(quad: Quad, samples: int) -> tuple[np.ndarray, np.ndarray, np.ndarray, LeafSums]:
    """Voxels, rasterised area and the octree's area, in voxel faces."""
    keys, expected = quad.rasterised(samples)
    leaves = quad.voxelized()
    every = np.union1d(keys, leaves.keys)
    areas = np.zeros((2, len(every)))
    areas[0, np.searchsorted(every, keys)] = expected
    areas[1, np.searchsorted(every, leaves.keys)] = leaves.sums.area
    return every, *(areas * 4.0**quad.depth), leaves


@pytest.mark.parametrize("threshold", [0.5, None], ids=["cut", "soft"])
@pytest.mark.parametrize("name", QUADS)
def test_leaves_are_where_rasterised_alpha_is(name: str, threshold: float | None) -> None:
    """A lattice of n points along a voxel knows the area left of an edge to 1/2n faces, and four edges meet here
    (two of the leaf, two of the quad). The engine's raster has squares of at most a quarter of a voxel, of which an
    edge cuts about four and is wrong by a fraction of each."""
    quad = replace(QUADS[name], threshold=threshold)
    samples = max(24, int(2.5 * quad.texels * quad.tiles / 2**quad.depth))
    every, expected, found, leaves = on_reference(quad, samples)
    error = abs(found - expected)
    assert error.max() < 2.0 / samples + 0.05
    assert error.mean() < 0.007
    assert found.sum() == pytest.approx(expected.sum(), rel=0.015), "area is conserved"
    assert (found[expected > 0.05] > 0).all(), "no leaf is missing where there is coverage"
    assert found[expected == 0].max(initial=0) < 0.08
    near = quad.near_coverage(0.3 * 2.0**-quad.depth, samples // 2)
    assert np.isin(leaves.keys, near).all(), "gaps stay empty"
    assert quad.depth < 4 or np.isin(every, leaves.keys).mean() < 0.9, "there are gaps"


def test_opacity_alone_is_that_of_the_lit_surface() -> None:
    quad = Quad(TILTED, 64, 7)
    mesh = quad.mesh()
    opaque = TriangleMesh.from_arrays(mesh.parts[0].corners_world + [0.0, 0.0, 0.2], (Material("M", alpha=0.5),))
    both = TriangleMesh(
        (*mesh.parts, replace(opaque.parts[0], materials=np.ones(len(opaque.parts[0]), np.int32))),
        (*mesh.materials, *opaque.materials),
    )
    (exact,) = leaves_of(both, quad.grid, albedo_shade(both))
    (found,) = leaves_of(both, quad.grid, opacity_shade(both))
    np.testing.assert_array_equal(found.keys, exact.keys)
    np.testing.assert_array_equal(found.sums.area, exact.sums.area)
    assert (found.sums.light == 0).all()


@pytest.mark.parametrize("wrap", ["REPEAT", "EXTEND", "MIRROR", "CLIP"])
@pytest.mark.parametrize("threshold", [0.4, None])
@pytest.mark.parametrize("depth", [2, 4])
def test_kernel_equals_the_plain_twin(wrap: str, threshold: float | None, depth: int) -> None:
    rng = np.random.default_rng(depth)
    count = 24
    alpha = np.clip(np.kron(rng.random((11, 9)), np.ones((2, 3))) * 1.6 - 0.3, 0, 1).astype(np.float32)[..., None]
    base = Texture("base", rng.random((22, 27, 3)).astype(np.float32), wrap, TURNED)
    leaf = Texture("A", alpha, wrap, TURNED)
    material = Material("M", (1.0, 1.0, 1.0), base, alpha_texture=leaf, alpha_threshold=threshold)
    uvs = rng.uniform(-0.5, 1.5, (count, 3, 2)) * rng.choice([0.02, 0.3, 1.0, 9.0], (count, 1, 1))
    batch = TriangleBatch(rng.random((count, 3, 3)), uvs.astype(np.float32), np.zeros(count, np.int32), 0)
    mesh = TriangleMesh((batch,), (material,))
    grid = Grid((0.0, 0.0, 0.0), 1.0, depth)
    table = TextureTable.from_materials(mesh.materials)
    chains = table.chains
    levels = [chains.texels[start : start + h * w].reshape(h, w, 2).astype(float) for start, h, w in chains.levels]
    areas, _ = triangle_areas_and_normals(batch.corners_world)
    (fragments,) = clip_batch(batch, grid, areas, grid.depth)
    luminance, opacity, *_ = albedo_shade(mesh)(batch, fragments)
    chosen = rng.permutation(np.flatnonzero(fragments.area_world > 1e-9))[:120]
    cells = morton_decode(fragments.keys)
    for index in chosen:
        triangle = fragments.triangle[index]
        piece = piece_reference(batch.corners_world[triangle] * 2.0**depth, tuple(cells[index]))
        weights = np.array([weights for _, weights in piece])
        uv = np.column_stack([weights @ batch.uvs[triangle].astype(float), np.ones(len(weights))])
        expected, coverage = footprint_reference(levels, uv @ np.array(TURNED).T, wrap, threshold)
        assert opacity[index] == pytest.approx(coverage, abs=2e-5)
        if expected is not None and coverage > 0.01:
            assert luminance[index] == pytest.approx(expected / coverage, abs=2e-3)
