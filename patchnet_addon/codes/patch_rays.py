# SPDX-License-Identifier: GPL-3.0-or-later
"""Ray-traced patches: coverage and luminance of a patch by 64x64 parallel rays (methods 7.16, 7.17).

All rays of a viewport are parallel, so every fine cube has the same hexagonal outline. Cubes are drawn front to back
into 64 rows of 64 bits: a cube's outline covers one interval of a row of pixel centres, and its free bits see this cube
first. The result equals 4096 rays that each stop at their first cube, about ten times faster than tracing them cell by
cell. A finest leaf is drawn as its box, with the box's outline (methods 4.1d). So the exact oracle renders coverage and
luminance of each pixel (methods 9): the limit of any network with this look-ahead.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from ..cells.leaf_box_kernels import box_side
from ..cells.leaf_boxes import STEPS
from ..cells.scales import LUMINANCE_SCALE
from ..directional.node_kernels import luminance_along
from ..directional.node_light import NodeLight
from ..octree.octree import Nodes, Octree
from ..runtime.bounds import DEFAULT_LOOKAHEAD, LOOKAHEAD
from ..runtime.kernels import array_device, device, kernel
from ..runtime.progress import Progress, Steps
from ..runtime.threads import run_parts
from ..runtime.vectors import count_ones
from .brick import check_nodes, empty_brick, fill_brick
from .prediction import Prediction

if TYPE_CHECKING:
    from ..tracing.hits import Hits

_CHUNK = 16384  # pixels
VIEWPORT_PX = 64


class PatchRays(NamedTuple):
    """Centre rays of N viewports, grouped by voxel.

    level (G,) int32 and cell (G, 3) int32 name the voxels; rays group_start[g] to group_start[g + 1] belong to voxel g.
    entry_voxel: (N, 3) float32 a point of the centre ray, in units of the voxel, [0, 1]^3 inside.
    direction, up: (N, 3) float32, orthonormal, in the octree's axes. ratio: (N,) float32, side of the viewport over the
    voxel's side.
    """

    level: np.ndarray
    cell: np.ndarray
    group_start: np.ndarray
    entry_voxel: np.ndarray
    direction: np.ndarray
    up: np.ndarray
    ratio: np.ndarray


def render_patches(
    octree: Octree, rays: PatchRays, lookahead: int = DEFAULT_LOOKAHEAD
) -> tuple[np.ndarray, np.ndarray]:
    """Coverage (N,) and mean luminance over the rays that hit (N,), both float32; luminance 0 where none hits.

    lookahead: levels between the voxels and the drawn cubes. Raises SettingError for an octree of more than 2^31 nodes.
    """
    check_nodes(octree.node_count)
    count = len(rays.ratio)
    coverage, luminance = np.zeros(count, np.float32), np.zeros(count, np.float32)
    run_parts(_render, len(rays.level), octree.nodes, octree.light, rays, lookahead, coverage, luminance)
    return coverage, luminance


class PatchRay(NamedTuple):
    """Centre ray of one viewport: entry_voxel, direction and up (3,), and ratio, as in `PatchRays`."""

    entry_voxel: np.ndarray
    direction: np.ndarray
    up: np.ndarray
    ratio: float


# Projection of a brick's cells onto the pixels of a viewport: pixels to the right and up per cell along each axis;
# pixel of the brick's lowest corner; half width and height of a cell's outline; the three slabs whose intersection it
# is: slope, half width, and the share of each side of a cell in that.
_PROJECTION = np.dtype(
    [("right", "f8", 3), ("up", "f8", 3), ("corner_u", "f8"), ("corner_v", "f8"), ("width", "f8"), ("height", "f8")]
    + [("slope", "f8", 3), ("half", "f8", 3), ("share", "f8", (3, 3))]
)


class Viewport(NamedTuple):
    """Scratch to render patches.

    projection: (1,) `_PROJECTION`. taken: (64,) uint64, a bit for each pixel that shows a cell.
    """

    projection: np.ndarray
    taken: np.ndarray


@array_device
def empty_viewport():
    """Allocate a viewport."""
    return Viewport(np.empty(1, _PROJECTION), np.empty(VIEWPORT_PX, np.uint64))


@device
def _set_view(ray, lookahead, view):
    """Fill `view`, a `_PROJECTION`, for a `PatchRay`."""
    direction, up = ray.direction, ray.up
    side = float(1 << lookahead)
    scale = 64.0 / (side * ray.ratio)
    right = (
        direction[1] * up[2] - direction[2] * up[1],
        direction[2] * up[0] - direction[0] * up[2],
        direction[0] * up[1] - direction[1] * up[0],
    )
    view.corner_u = view.corner_v = 31.5
    for axis in range(3):
        view.right[axis], view.up[axis] = right[axis] * scale, up[axis] * scale
        view.corner_u -= side * (ray.entry_voxel[axis] + 1.0) * view.right[axis]
        view.corner_v -= side * (ray.entry_voxel[axis] + 1.0) * view.up[axis]
    view.width = 0.5 * (abs(view.right[0]) + abs(view.right[1]) + abs(view.right[2]))
    view.height = 0.5 * (abs(view.up[0]) + abs(view.up[1]) + abs(view.up[2]))
    for axis in range(3):
        a_u, a_v = view.right[axis], view.up[axis]
        if abs(a_v) < 1e-9:  # this slab bounds only rows, like the outline's height
            view.slope[axis], view.half[axis] = 0.0, 1e9
            view.share[axis, :] = 1e9
            continue
        view.slope[axis], view.half[axis] = a_u / a_v, 0.0
        for other in range(3):
            view.share[axis, other] = 0.5 * abs(a_u * view.up[other] - a_v * view.right[other]) / abs(a_v)
            view.half[axis] += view.share[axis, other]


@device
def _draw_box(view, boxes, row, centre_u, centre_v, rows):
    """Draw the box of a leaf whose cell is centred on a pixel position into the free bits of `rows`, as `_draw`."""
    height, w0, w1, w2 = 0.0, 0.0, 0.0, 0.0
    for axis in range(3):
        side = box_side(boxes, row, axis) / STEPS
        shift = (np.int64(boxes[row, axis]) & 15) / STEPS + 0.5 * side - 0.5
        centre_u += shift * view.right[axis]
        centre_v += shift * view.up[axis]
        height += 0.5 * side * abs(view.up[axis])
        w0 += side * view.share[0, axis]
        w1 += side * view.share[1, axis]
        w2 += side * view.share[2, axis]
    return _draw(view, (height, w0, w1, w2), centre_u, centre_v, rows)


@device
def _draw(view, outline, centre_u, centre_v, rows):
    """Draw an outline centred on a pixel position into the free bits of `rows` (64,) uint64; returns the number of bits
    taken.

    outline: half height, and half widths of the three slabs.
    """
    height, w0, w1, w2 = outline
    first = max(0, int(np.ceil(centre_v - height)))
    last = min(63, int(np.floor(centre_v + height)))
    m0, m1, m2 = view.slope[0], view.slope[1], view.slope[2]
    taken = np.int64(0)
    for row in range(first, last + 1):
        dv = row - centre_v
        low = centre_u + max(m0 * dv - w0, max(m1 * dv - w1, m2 * dv - w2))
        high = centre_u + min(m0 * dv + w0, min(m1 * dv + w1, m2 * dv + w2))
        if low > 63.0 or high < 0.0:
            continue
        left, right = int(np.ceil(max(low, 0.0))), int(np.floor(min(high, 63.0)))
        if left > right:
            continue
        bits = (np.uint64(0xFFFFFFFFFFFFFFFF) >> np.uint64(63 - right + left)) << np.uint64(left)
        free = bits & ~rows[row]
        rows[row] |= bits
        taken += count_ones(free)
    return taken


@device
def render_patch(nodes, light, brick, ray, lookahead, viewport):
    """Coverage and mean luminance (65535 = 1) of a `Brick` around a `PatchRay`; light: `NodeLight` of the nodes.

    viewport: `Viewport` to draw in; previous contents are discarded.

    Along parallel rays, a cell can only hide cells further along each axis in the direction's sign: this order of
    blocks and cells is front to back.
    """
    cells, counts, direction = brick.nodes, brick.counts, ray.direction
    view, rows = viewport.projection[0], viewport.taken
    first_boxed, boxes = nodes.first_boxed, nodes.boxes
    _set_view(ray, lookahead, view)
    rows[:] = 0
    flip_x, flip_y, flip_z = direction[0] < 0, direction[1] < 0, direction[2] < 0
    mask = (1 << lookahead) - 1
    flip = mask * (int(flip_x) + (int(flip_y) << lookahead) + (int(flip_z) << 2 * lookahead))
    side = float(1 << lookahead)
    right, up, height, width = view.right, view.up, view.height, view.width
    cube = height, view.half[0], view.half[1], view.half[2]
    hit, total = 0, 0.0
    for turn in range(27):
        bx, by, bz = turn % 3, turn // 3 % 3, turn // 9
        bx, by, bz = 2 - bx if flip_x else bx, 2 - by if flip_y else by, 2 - bz if flip_z else bz
        block = bx + 3 * by + 9 * bz
        if counts[block] == 0:
            continue
        block_u = view.corner_u + side * (bx * right[0] + by * right[1] + bz * right[2])
        block_v = view.corner_v + side * (bx * up[0] + by * up[1] + bz * up[2])
        middle_u = block_u + 0.5 * side * (right[0] + right[1] + right[2])
        middle_v = block_v + 0.5 * side * (up[0] + up[1] + up[2])
        if abs(middle_u - 31.5) > 31.5 + side * width or abs(middle_v - 31.5) > 31.5 + side * height:
            continue
        for slot in range(cells.shape[1]):
            cell = slot ^ flip
            node = cells[block, cell]
            if node < 0:
                continue
            x = (cell & mask) + 0.5
            y = ((cell >> lookahead) & mask) + 0.5
            z = (cell >> 2 * lookahead) + 0.5
            centre_u = block_u + x * right[0] + y * right[1] + z * right[2]
            centre_v = block_v + x * up[0] + y * up[1] + z * up[2]
            if abs(centre_u - 31.5) > 31.5 + width or abs(centre_v - 31.5) > 31.5 + height:
                continue
            if node >= first_boxed:
                taken = _draw_box(view, boxes, node - first_boxed, centre_u, centre_v, rows)
            else:
                taken = _draw(view, cube, centre_u, centre_v, rows)
            hit += taken
            if taken:
                seen = luminance_along(light, np.int64(node), direction[0], direction[1], direction[2])
                total += taken * float(seen)
        if hit == 4096:
            break
    return hit / 4096.0, total / max(hit, 1)


@kernel
def _render(
    first: int, last: int, nodes: Nodes, light: NodeLight, rays: PatchRays, lookahead: int, coverage: np.ndarray,
    luminance: np.ndarray,
) -> None:  # fmt: skip
    for group in range(first, last):
        brick = empty_brick(lookahead)
        viewport = empty_viewport()
        fill_brick(nodes, 0, rays.level[group], rays.cell[group], lookahead, brick)
        for at in range(rays.group_start[group], rays.group_start[group + 1]):
            ray = PatchRay(rays.entry_voxel[at], rays.direction[at], rays.up[at], rays.ratio[at])
            sigma, mean = render_patch(nodes, light, brick, ray, lookahead, viewport)
            coverage[at], luminance[at] = sigma, mean / LUMINANCE_SCALE


def exact_prediction(octree: Octree, hits: Hits, lookahead: int = DEFAULT_LOOKAHEAD) -> Steps[Prediction]:
    """Coverage and luminance of every pixel by 64x64 rays through its patch (methods 7.16, 7.17).

    lookahead: levels between a voxel and its patch's cells, 1 to 3: those of the compared weights. Raises SettingError
    for others.

    Pixels without look-ahead keep their preview, as in `predict`, so that their priority is 0 (methods 4.1b).
    """
    LOOKAHEAD.check(lookahead)
    ahead = octree.look_ahead(lookahead)
    look_ahead = hits.hit & ahead[np.maximum(hits.node, 0)]
    pixels = np.flatnonzero(look_ahead)
    pixels = pixels[np.argsort(hits.node[pixels], kind="stable")]  # a voxel's pixels share its brick
    coverage = np.ones(len(look_ahead), np.float32)
    luminance = hits.luminance.astype(np.float32)
    for start in range(0, len(pixels), _CHUNK):
        here = pixels[start : start + _CHUNK]
        coverage[here], seen = render_patches(octree, _patch_rays(hits, here), lookahead)
        luminance[here] = np.where(coverage[here] > 0, seen, luminance[here])
        yield Progress(start + len(here), len(pixels), "Rendering patches")
    return Prediction(coverage, luminance, look_ahead)


def _patch_rays(hits: Hits, pixels: np.ndarray) -> PatchRays:
    """Viewports of pixels (M,) sorted by node."""
    first = np.flatnonzero(np.diff(hits.node[pixels], prepend=-1))
    return PatchRays(
        level=hits.level[pixels[first]],
        cell=hits.cell[pixels[first]],
        group_start=np.append(first, len(pixels)),
        entry_voxel=hits.entry_voxel[pixels],
        direction=hits.direction[pixels],
        up=hits.up[pixels],
        ratio=hits.ratio[pixels],
    )
