# SPDX-License-Identifier: GPL-3.0-or-later
"""Small octrees, built node by node from a dictionary of leaves, independent of the engine's builder."""

from dataclasses import replace

import numpy as np

from patchnet.patchnet_addon.cells.leaf_boxes import STEPS
from patchnet.patchnet_addon.codes.brick import nodes_around
from patchnet.patchnet_addon.octree.grid import Grid
from patchnet.patchnet_addon.octree.octree import Octree
from patchnet.patchnet_addon.runtime.kernels import kernel
from patchnet.tests.references.lookups import box_bounds


def plain_key(cell):
    """Morton key of a cell (x, y, z), bit by bit."""
    return sum(((axis >> bit) & 1) << (3 * bit + place) for bit in range(21) for place, axis in enumerate(cell))


def _parent(place):
    level, cell = place
    return level - 1, tuple(axis // 2 for axis in cell)


def octree_from_leaves(leaves, depth, side_world=1.0):
    """Octree of `leaves` {(level, (x, y, z)): (area, luminance, (nx, ny, nz))}; parents hold area-weighted means."""
    nodes = {place: np.array([area, luminance, *normal]) for place, (area, luminance, normal) in leaves.items()}
    for level in range(depth, 0, -1):
        for place in [place for place in nodes if place[0] == level]:
            area, *rest = nodes[place]
            parent = nodes.setdefault(_parent(place), np.zeros(5))
            assert _parent(place) not in leaves, "a leaf has children"
            parent += [area, *(area * np.array(rest))]
        for place in [place for place in nodes if place[0] == level - 1 and place not in leaves]:
            nodes[place][1:] /= nodes[place][0]
    order = sorted(nodes, key=lambda place: (place[0], plain_key(place[1])))
    index = {place: number for number, place in enumerate(order)}
    mask, first = np.zeros(len(order), np.uint8), np.zeros(len(order), np.uint32)
    for place in reversed(order[1:]):
        mask[index[_parent(place)]] |= 1 << plain_key(place[1]) % 8
        first[index[_parent(place)]] = index[place]
    values = np.array([nodes[place] for place in order])
    return Octree(
        grid=Grid((0.0, 0.0, 0.0), side_world, depth),
        level_start=np.searchsorted([level for level, _ in order], np.arange(depth + 2)),
        child_mask=mask,
        first_child=first,
        area_world=values[:, 0].astype(np.float32),
        luminance=np.rint(values[:, 1] * 65535).astype(np.uint16),
        normal=np.rint(values[:, 2:] * 127).astype(np.int8),
    )


def random_octree(seed=0, depth=5, count=300, adaptive=False):
    """Octree of `count` random cells that lie in a shell around a point; `adaptive`: some leaves are coarser."""
    random = np.random.default_rng(seed)
    side = 1 << depth
    directions = random.normal(size=(count, 3))
    directions /= np.linalg.norm(directions, axis=1, keepdims=True)
    centre, radius = random.uniform(0.4, 0.6, 3) * side, random.uniform(0.4, 0.6) * side
    cells = np.unique(np.clip(np.floor(centre + radius * directions), 0, side - 1).astype(int), axis=0)
    leaves = {}
    for cell in cells.tolist():
        level = depth - int(random.choice(4, p=[0.6, 0.15, 0.15, 0.1])) if adaptive else depth
        leaves[max(level, 1), tuple(axis >> (depth - max(level, 1)) for axis in cell)] = None
    for place in list(leaves):  # a coarse leaf swallows what lies below it
        above = place
        while above[0] > 0:
            above = _parent(above)
            if above in leaves:
                del leaves[place]
                break
    for place in leaves:
        normal = random.normal(size=3)
        normal *= random.uniform(0, 1) / np.linalg.norm(normal)
        leaves[place] = (random.uniform(0.1, 1.0), random.uniform(), tuple(normal))
    return octree_from_leaves(leaves, depth)


def with_boxes(octree, seed=0):
    """Octree whose finest leaves have random boxes, some as flat as a box may be."""
    random = np.random.default_rng(seed)
    count = octree.level_start[-1] - octree.level_start[-2]
    ends = np.sort(random.integers(0, STEPS, (2, count, 3)), axis=0)
    return replace(octree, leaf_box=(ends[0] | ends[1] << 4).astype(np.uint8))


def with_sides(octree, seed=0):
    """Octree of which a third of the nodes have random sides."""
    random = np.random.default_rng(seed)
    nodes = np.flatnonzero(random.random(octree.node_count) < 1 / 3).astype(np.uint32)
    light, share = random.integers(0, 256, (2, len(nodes), 6)).astype(np.uint8)
    share[random.random(share.shape) < 0.2] = 0
    light[random.random(share.shape) < 0.2] = 0
    return replace(octree, side_nodes=nodes, side_light=light, side_share=share)


def _filled(octree, node):
    """Mean of what a node covers of the faces of its voxel."""
    leaf = node - octree.level_start[octree.depth]
    if octree.leaf_box is None or leaf < 0:
        return 1.0
    low, high = box_bounds(octree.leaf_box[leaf : leaf + 1])
    x, y, z = (high - low)[0]
    return (x * y + y * z + z * x) / 3


def dense_cells(octree, level):
    """Dense grid (S, S, S, 5), order z, y, x, channel, of the values at a level, by marking every node's cube."""
    side = 1 << level
    grid = np.zeros((side, side, side, 5), np.float32)
    for node_level in range(min(level, octree.depth) + 1):
        first = octree.level_start[node_level]
        width = side >> node_level
        for offset, (x, y, z) in enumerate(octree.cells(node_level).tolist()):
            node = first + offset
            if node_level == level or octree.child_mask[node] == 0:
                values = [_filled(octree, node), octree.luminance[node] / 65535, *(octree.normal[node] / 127)]
                grid[z * width : (z + 1) * width, y * width : (y + 1) * width, x * width : (x + 1) * width] = values
    return grid


def around_voxels(octree: Octree, voxels: np.ndarray) -> np.ndarray:
    """Nodes (N, 27) int32 around voxels (N, 4) level, x, y, z, as `nodes_around` finds them."""
    around = np.empty((len(voxels), 27), np.int32)
    _find_around(octree.nodes, np.asarray(voxels, np.int64), around)
    return around


@kernel
def _find_around(nodes, voxels, around):
    for row in range(len(voxels)):
        nodes_around(nodes, 0, voxels[row, 0], voxels[row, 1:], around[row])
