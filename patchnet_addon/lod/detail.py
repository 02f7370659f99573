# SPDX-License-Identifier: GPL-3.0-or-later
"""Level of detail that a picture needs, block by block, so that all that it shows has look-ahead (methods 4.1b)."""

from __future__ import annotations

import numba
import numpy as np

from ..cells.contract import MAX_LEVELS, fitting_level, has_lookahead
from ..cells.morton_kernels import cell_key
from ..octree.grid import Grid
from ..runtime.bounds import DEFAULT_LOOKAHEAD
from ..runtime.kernels import kernel, serial_kernel
from ..runtime.progress import Progress, Steps
from ..tracing.camera import Camera, CameraUnit, camera_in_unit_cube
from ..tracing.traverse import first_seen, pixel_ray

_ROWS_PER_STEP = 64
# Beside its centre, four rays with the footprint of a patch's voxels look through the gaps of each pixel.
FINE_OFFSETS = ((-0.25, -0.25), (0.25, -0.25), (-0.25, 0.25), (0.25, 0.25))


def needed_levels(
    child_mask: np.ndarray,
    first_child: np.ndarray,
    grid: Grid,
    camera: Camera,
    needed: np.ndarray,
    pixels: np.ndarray,
    *,
    lookahead: int = DEFAULT_LOOKAHEAD,
) -> Steps[None]:
    """Raise `needed` (8^b,) uint8, by block of level b, to the level of leaves that look-ahead takes where rays hit.

    pixels: (8^b,) uint32 grows by the number of pixels whose centre ray stops in each block.

    child_mask, first_child: the octree so far, as `Octree` holds them. lookahead: levels, of the weights in use. A
    pixel's centre ray asks for the voxel that stops it and for its neighbours, which its patches show; rays with the
    footprint of the patch's voxels ask for what they hit themselves, and so for what the gaps of the coarse picture
    show.
    """
    unit = camera_in_unit_cube(camera, grid)
    block_level = (len(needed).bit_length() - 1) // 3
    for first in range(0, camera.height_px, _ROWS_PER_STEP):
        last = min(first + _ROWS_PER_STEP, camera.height_px)
        for offset, levels, margin in [((0.0, 0.0), 0, 1), *((offset, lookahead, 0) for offset in FINE_OFFSETS)]:
            rows = (first, last)
            cell, level, wanted, _ = _hits(child_mask, first_child, unit, rows, offset, levels, lookahead)
            _request(cell, level, wanted, margin, block_level, needed)
            if margin:
                _count(cell, level, wanted, block_level, pixels)
        yield Progress(last, camera.height_px, "Finding detail")


def lookahead_share(
    child_mask: np.ndarray,
    first_child: np.ndarray,
    grid: Grid,
    camera: Camera,
    *,
    lookahead: int = DEFAULT_LOOKAHEAD,
) -> float:
    """Share of the pixels that hit the octree whose voxel has descendants `lookahead` levels down; 1 without hits."""
    unit = camera_in_unit_cube(camera, grid)
    _, _, wanted, ahead = _hits(child_mask, first_child, unit, (0, camera.height_px), (0.0, 0.0), 0, lookahead)
    return float(ahead[wanted > 0].mean()) if (wanted > 0).any() else 1.0


def _hits(
    child_mask: np.ndarray,
    first_child: np.ndarray,
    unit: CameraUnit,
    rows: tuple[int, int],
    offset: tuple[float, float],
    finer: int,
    lookahead: int,
) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """Cells (R, 3) int32 that rays hit, their levels and the levels of leaves needed there, and their look-ahead.

    Levels (R,) uint8; those of leaves are what look-ahead takes there, 0 for a miss. (R,) bool: is there look-ahead?
    offset: from the pixels' centres, in pixels. finer: levels that the rays' footprint is finer than the pixel.
    """
    count = (rows[1] - rows[0]) * unit.width_px
    cell, level, wanted = np.zeros((count, 3), np.int32), np.zeros(count, np.uint8), np.zeros(count, np.uint8)
    ahead = np.zeros(count, np.bool_)
    _trace(
        child_mask, first_child, unit.frame, unit.lens, unit.perspective, unit.width_px, unit.height_px, rows[0],
        offset, finer, lookahead, cell, level, wanted, ahead,
    )  # fmt: skip
    return cell, level, wanted, ahead


@kernel
def _trace(
    child_mask,
    first_child,
    frame,
    lens,
    perspective,
    width,
    height,
    first_row,
    offset,
    finer,
    lookahead,
    cell,
    level,
    wanted,
    ahead,
):  # type: ignore[no-untyped-def]
    for row in numba.prange(len(wanted) // width):
        stack = np.empty(MAX_LEVELS, np.int64)
        found = np.empty(3, np.int64)
        ray_o = np.empty(3, np.float64)
        ray_d = np.empty(3, np.float64)
        shrink = 1.0 / (1 << finer)
        for column in range(width):
            x = 2.0 * (column + 0.5 + offset[0]) / width - 1.0
            y = 2.0 * (first_row + row + 0.5 + offset[1]) / height - 1.0
            speed = pixel_ray(frame, lens, perspective, x, y, ray_o, ray_d)
            hit, depth, t = first_seen(child_mask, first_child, ray_o, ray_d, speed, lens, shrink, stack, found)
            if hit >= 0:
                ray = row * width + column
                pixel = lens[2] + lens[3] * t * speed
                level[ray] = depth
                wanted[ray] = fitting_level(pixel) + lookahead
                ahead[ray] = has_lookahead(child_mask, first_child, hit, lookahead)
                for axis in range(3):
                    cell[ray, axis] = found[axis]


@serial_kernel
def _request(cell, level, wanted, margin, block_level, needed):  # type: ignore[no-untyped-def]
    """Raise `needed` in all blocks that a cell meets, or one of those `margin` cells around it."""
    blocks = np.int64(1) << block_level
    low = np.empty(3, np.int64)
    high = np.empty(3, np.int64)
    for ray in range(len(wanted)):
        if wanted[ray] <= block_level:  # nothing was hit, or the coarsest leaves do
            continue
        deeper = np.int64(level[ray]) - block_level
        for axis in range(3):
            first = np.int64(cell[ray, axis]) - margin
            last = np.int64(cell[ray, axis]) + margin
            if deeper >= 0:
                first, last = first >> deeper, last >> deeper
            else:
                first, last = first << -deeper, ((last + 1) << -deeper) - 1
            low[axis] = max(first, 0)
            high[axis] = min(last, blocks - 1)
        for z in range(low[2], high[2] + 1):
            for y in range(low[1], high[1] + 1):
                for x in range(low[0], high[0] + 1):
                    block = cell_key(x, y, z)
                    needed[block] = max(needed[block], wanted[ray])


@serial_kernel
def _count(cell, level, wanted, block_level, pixels):  # type: ignore[no-untyped-def]
    """Add one to the block of each cell; one that is larger than a block counts in its first."""
    for ray in range(len(wanted)):
        if wanted[ray] == 0:
            continue
        deeper = np.int64(level[ray]) - block_level
        x, y, z = np.int64(cell[ray, 0]), np.int64(cell[ray, 1]), np.int64(cell[ray, 2])
        if deeper >= 0:
            block = cell_key(x >> deeper, y >> deeper, z >> deeper)
        else:
            block = cell_key(x, y, z) << np.uint64(-3 * deeper)
        pixels[block] += np.uint32(1)
