# SPDX-License-Identifier: GPL-3.0-or-later
"""Batches against patches that are encoded, and augmentation against the transformed scene (methods 7.20)."""

import numpy as np
import pytest

from patchnet.patchnet_addon.codes.brick import OCTANTS
from patchnet.patchnet_addon.codes.patch_rays import PatchRays, render_patches
from patchnet.patchnet_addon.octree.octree import Octree
from patchnet.patchnet_addon.runtime.progress import drain
from patchnet.tests.engine.octree_samples import with_boxes
from patchnet.tests.references.codes import corner_blocks_reference
from patchnet.tests.references.lookups import node_at
from patchnet.tests.references.networks import joined_blocks
from patchnet.tests.training.procedural import octree_from_leaves, spheres_and_slats
from patchnet.training.data.augmentation import Augmentation, cube_symmetries
from patchnet.training.data.batches import Batch, gather_batch
from patchnet.training.data.forest import concatenate
from patchnet.training.data.samples import Samples, SampleSettings, draw_samples

DEPTH = 6


@pytest.fixture(scope="module")
def octree() -> Octree:
    return spheres_and_slats(DEPTH, seed=5)


@pytest.fixture(scope="module")
def boxed(octree: Octree) -> Octree:
    return with_boxes(octree)


def drawn(octree: Octree, lookahead: int) -> Samples:
    settings = SampleSettings(views=4, min_level=3, held_out=0.0, seed=2, lookahead=lookahead)
    return drain(draw_samples(octree, 256, settings))


def rays_of(voxel: np.ndarray, views: np.ndarray) -> PatchRays:
    """Rays of voxels (V, 4) and stored views (V, R, 12)."""
    signed = (views[..., 3:9].view(np.int16) / 32767.0).reshape(-1, 6)
    return PatchRays(
        voxel[:, 0].astype(np.int32), voxel[:, 1:].astype(np.int32), np.arange(len(voxel) + 1) * views.shape[1],
        (views[..., :3] / 65535.0).reshape(-1, 3), signed[:, :3], signed[:, 3:], (views[..., 9] / 65535.0).ravel(),
    )  # fmt: skip


def assert_seen(octree: Octree, voxel: np.ndarray, views: np.ndarray, lookahead: int = 2) -> None:
    """Coverage and luminance of stored views are those of their rays."""
    coverage, luminance = render_patches(octree, rays_of(voxel, views), lookahead)
    np.testing.assert_allclose(coverage, views[..., 10].ravel() / 4096, atol=3 / 4096)
    np.testing.assert_allclose(luminance, views[..., 11].ravel() / 65535, atol=1e-3)


def patches(batch: Batch, voxels: int, side: int = 4) -> np.ndarray:
    """Patches (V, 8, S, S, S, 5) of corners, put together from a batch's blocks."""
    return joined_blocks(batch.blocks[batch.rows], side).reshape(voxels, 8, *(2 * side,) * 3, 5)


@pytest.mark.parametrize("lookahead", [1, 2, 3])
def test_patches_are_those_that_are_encoded(octree: Octree, boxed: Octree, lookahead: int) -> None:
    """Of octrees side by side, some with boxes in leaves."""
    samples = drawn(octree, lookahead)
    other, another = spheres_and_slats(4, seed=8), with_boxes(spheres_and_slats(4, seed=9), seed=1)
    count = len(samples.voxel)
    for trees in ([other, octree, another], [another, boxed, other]):
        none = Augmentation.none(count)
        batch = gather_batch(concatenate(trees), np.ones(count, int), samples.voxel, samples.views, none, lookahead)
        found = patches(batch, count, 1 << lookahead)
        for row in range(0, count, 5):
            level, *cell = samples.voxel[row].astype(int)
            wanted = corner_blocks_reference(trees[1], level, np.array(cell) + OCTANTS, lookahead)
            np.testing.assert_allclose(found[row], wanted, atol=1e-6)


def test_samples_see_boxes(boxed: Octree) -> None:
    boxes = drain(draw_samples(boxed, 64, SampleSettings(views=4, min_level=DEPTH - 2, held_out=0.0, seed=2)))
    assert_seen(boxed, boxes.voxel[:8], boxes.views[:8])


def matrix_of(symmetry: int) -> np.ndarray:
    """Symmetry of the cube as a matrix (3, 3) that acts on column vectors."""
    symmetries = cube_symmetries()
    return np.eye(3)[symmetries.axis[symmetry]] * symmetries.sign[symmetry][:, None]


def moved_octree(octree: Octree, symmetry: int, gain: float, offset: float) -> Octree:
    """The scene turned about the cube's centre, with luminance gain * L + offset, built anew from its leaves."""
    matrix = matrix_of(symmetry)
    leaves = octree.level(DEPTH)
    side = 1 << DEPTH
    cells = np.rint(((octree.cells(DEPTH) + 0.5 - side / 2) @ matrix.T) + side / 2 - 0.5).astype(int)
    normal = octree.normal_float(leaves) @ matrix.T
    return octree_from_leaves(cells, gain * octree.luminance_float(leaves) + offset, normal, DEPTH)


@pytest.mark.parametrize("symmetry", [7, 18, 41])
def test_augmentation_is_exact(octree: Octree, symmetry: int) -> None:
    """Turning a finest-level sample equals drawing it in the turned scene."""
    samples = drawn(octree, 2)
    at = np.flatnonzero(samples.voxel[:, 0] == DEPTH - 2)[:12]
    voxel, views = samples.voxel[at], samples.views[at]
    remap = np.tile(np.array([[0.6, 0.3, symmetry % 2, 1.0]], np.float32), (len(at), 1))
    augmentation = Augmentation(np.full(len(at), symmetry, np.int32), remap)
    batch = gather_batch(concatenate([octree]), np.zeros(len(at), int), voxel, views, augmentation)
    found = patches(batch, len(at))
    matrix = matrix_of(symmetry)
    side = 1 << (DEPTH - 2)
    for row in range(len(at)):
        plain = gather_batch(
            concatenate([octree]), np.zeros(1, int), voxel[row : row + 1], views[row : row + 1], Augmentation.none(1)
        )
        seen = plain.coverage[0] > 0
        gain, offset = linear_map(plain.blocks, batch.blocks, batch, row)
        assert (gain < 0) == (symmetry % 2 == 1)
        scene = moved_octree(octree, symmetry, gain, offset)
        cell = np.rint((voxel[row, 1:] + 0.5 - side / 2) @ matrix.T + side / 2 - 0.5).astype(int)
        np.testing.assert_allclose(found[row], corner_blocks_reference(scene, DEPTH - 2, cell + OCTANTS), atol=1e-4)
        rays = PatchRays(
            np.array([DEPTH - 2]), cell[None], np.array([0, views.shape[1]]),
            batch.entry[row], batch.direction[row], batch.up[row], batch.ratio[row],
        )  # fmt: skip
        coverage, luminance = render_patches(scene, rays)
        np.testing.assert_allclose(coverage, batch.coverage[row], atol=4 / 4096)
        np.testing.assert_allclose(luminance[seen], batch.luminance[row][seen], atol=2e-3)


def linear_map(plain: np.ndarray, moved: np.ndarray, batch: Batch, row: int) -> tuple[float, float]:
    """Gain and offset of luminance that a voxel's blocks were given, from the extremes and the mean of both."""
    rows = np.unique(batch.rows[8 * row : 8 * row + 8])
    before = np.sort(plain.reshape(-1, 5)[plain.reshape(-1, 5)[:, 0] > 0][:, 1])
    cells = moved[rows].reshape(-1, 5)
    after = np.sort(cells[cells[:, 0] > 0][:, 1])
    assert after[0] >= -1e-6
    assert after[-1] <= 1 + 1e-6
    spread = before[-1] - before[0]
    rising = (after[-1] - after[0]) / spread
    falls = abs(after.mean() - (after[0] + rising * (before.mean() - before[0]))) > 1e-4 * max(spread, 1e-3)
    gain = -rising if falls else rising
    return float(gain), float(after[-1] - gain * before[0] if falls else after[0] - gain * before[0])


@pytest.mark.parametrize("lookahead", [1, 2, 3])
def test_samples_are_what_rays_see(octree: Octree, lookahead: int) -> None:
    """Stored coverage and luminance are those of the stored rays; centre rays meet their voxel first."""
    samples = drawn(octree, lookahead)
    assert samples.voxel[:, 0].max() <= DEPTH - lookahead
    views = samples.views.shape[1]
    signed = samples.views[..., 3:9].view(np.int16) / 32767.0
    assert_seen(octree, samples.voxel, samples.views, lookahead)
    np.testing.assert_allclose(np.linalg.norm(signed[..., :3], axis=-1), 1, atol=1e-4)
    np.testing.assert_allclose((signed[..., :3] * signed[..., 3:]).sum(-1), 0, atol=1e-4)
    for row in range(0, len(samples.voxel), 3):
        level, *cell = samples.voxel[row].astype(int)
        others = np.array(cell) + np.stack(np.meshgrid(*[[-1, 0, 1]] * 3), -1).reshape(-1, 3)
        others = others[(node_at(octree, level, others) >= 0) & (others != cell).any(1)]
        for view in range(views):
            entry = cell + samples.views[row, view, :3] / 65535.0
            before = entry - np.linspace(0.02, 4, 400)[:, None] * signed[row, view, :3]
            inside = (before[:, None] > others + 1e-2) & (before[:, None] < others + 1 - 1e-2)
            assert not inside.all(-1).any()


def test_held_out_parts_share_no_cell_with_the_rest() -> None:
    octree = spheres_and_slats(7, seed=6)
    drawn = drain(draw_samples(octree, 4000, SampleSettings(views=2, min_level=5, held_out=0.2, seed=3)))
    assert 0.005 < drawn.held_out.mean() < 0.5
    reach = []
    for held in (False, True):
        voxel = drawn.voxel[drawn.held_out == held].astype(int)
        covered = np.zeros((1 << 7,) * 3, bool)
        for level, x, y, z in np.unique(voxel, axis=0):
            side = 1 << (7 - level)
            low = (np.array([x, y, z]) - 1) * side
            covered[tuple(slice(max(0, a), a + 3 * side) for a in low)] = True
        reach.append(covered)
    assert not (reach[0] & reach[1]).any()
