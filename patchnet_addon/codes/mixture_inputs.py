# SPDX-License-Identifier: GPL-3.0-or-later
"""Inputs of the luminance mixture's decoder, gathered from octree and codes (methods 11.1)."""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from ..network.kinds import CHILDREN, CODE_SIZE, CORNERS, MIXED
from ..network.mixture_decode import MixtureInputs
from ..octree.nodes import Nodes
from ..octree.octree import LUMINANCE_SCALE, POPCOUNT
from ..runtime.kernels import device, kernel
from ..runtime.threads import run_parts
from .axis_luminance import AxisLuminance, child_along, seen_along
from .coded_octree import CodedOctree
from .corner_rows import corner_row
from .patches import OCTANTS

if TYPE_CHECKING:
    from ..tracing.render import Hits


class NearbyLuminance(NamedTuple):
    """Luminances that are mixed, and what finds them: those of the octree, along the axes, and around corners."""

    nodes: Nodes
    luminance: np.ndarray
    axis: AxisLuminance
    corner: np.ndarray
    rows: np.ndarray

    @classmethod
    def of(cls, coded: CodedOctree) -> NearbyLuminance:
        """Luminances of an octree with codes of a mixture."""
        assert coded.corner_luminance is not None
        octree = coded.octree
        return cls(octree.nodes, octree.luminance, coded.axis_luminance, coded.corner_luminance, coded.corner_rows)


@device
def write_nearby(nearby, node, row, direction, covered, luminances, start, step):  # type: ignore[no-untyped-def]
    """Write the coverage of a voxel's eight children along a direction, and the 17 luminances that are mixed.

    row: of its corners. Number k is written at start + k * step of `covered` and `luminances`, which are flat.
    """
    scale = np.float32(1.0 / LUMINANCE_SCALE)
    mask, child = np.int64(nearby.nodes.child_mask[node]), np.int64(nearby.nodes.first_child[node])
    for octant in range(CHILDREN):
        share, light = np.float32(0), np.float32(0)
        if (mask >> octant) & 1:
            share, light = child_along(nearby.nodes, nearby.luminance, nearby.axis, child, direction)
            child += 1
        covered[start + octant * step] = share
        luminances[start + octant * step] = light
    luminances[start + CHILDREN * step] = np.float32(nearby.luminance[node]) * scale
    for corner in range(CORNERS):
        light = np.float32(nearby.corner[corner_row(nearby.rows, row, corner)]) * scale
        luminances[start + (CHILDREN + 1 + corner) * step] = light


def nearby_of(coded: CodedOctree, nodes: np.ndarray, rows: np.ndarray, direction: np.ndarray) -> tuple[np.ndarray, ...]:
    """Coverage (N, 8) of children and luminances (N, 17), float32, for coded nodes (N,) and directions (N, 3).

    rows: (N,) of the nodes in `corner_rows`.
    """
    covered, luminances = np.empty((len(nodes), CHILDREN), np.float32), np.empty((len(nodes), MIXED), np.float32)
    along = np.ascontiguousarray(direction, np.float32)
    whole = np.ascontiguousarray(nodes, np.int64), np.ascontiguousarray(rows, np.int64)
    run_parts(_write_all, len(nodes), NearbyLuminance.of(coded), *whole, along, covered, luminances)
    return covered, luminances


@kernel
def _write_all(first, last, nearby, nodes, rows, direction, covered, luminances):  # type: ignore[no-untyped-def]
    for index in range(first, last):
        write_nearby(nearby, nodes[index], rows[index], direction[index], covered[index], luminances[index], 0, 1)


def mixture_inputs_reference(coded: CodedOctree, pixels: np.ndarray, hits: Hits) -> MixtureInputs:
    """Inputs for some pixels (M,) of hits with look-ahead, in NumPy."""
    octree, node = coded.octree, hits.node[pixels]
    corners = coded.corners_of(coded.rows_of(node))  # (M, 8)
    assert coded.corner_luminance is not None
    corner_codes = coded.codes[corners].astype(np.float32)
    entry, direction = (array[pixels].astype(np.float32) for array in (hits.entry_voxel, hits.direction))
    shares = np.where(OCTANTS == 1, entry[:, None], 1 - entry[:, None]).prod(axis=-1)  # (M, 8)
    mask = octree.child_mask[node].astype(np.int64)
    there = mask[:, None] >> np.arange(8) & 1 == 1
    place = POPCOUNT[mask[:, None] & ((1 << np.arange(8)) - 1)]
    child = np.where(there, octree.first_child[node].astype(np.int64)[:, None] + place, 0)  # (M, 8)
    axis, inner = coded.axis_luminance, child < len(coded.axis_luminance.luminance)
    coverage = np.where(inner[..., None], axis.coverage[octree.child_mask[child]], 1) * there[..., None]
    of_leaf = np.repeat(octree.luminance[child][..., None], axis.luminance.shape[1], axis=2)
    shown = np.where(inner[..., None], axis.luminance[np.where(inner, child, 0)], of_leaf) / LUMINANCE_SCALE
    covered, light = seen_along(coverage.astype(np.float32), shown.astype(np.float32), direction)
    own = octree.luminance_float(node)[:, None]
    around = coded.corner_luminance[corners] / LUMINANCE_SCALE
    return MixtureInputs(
        codes=np.einsum("mo,moc->mc", shares, corner_codes).reshape(-1, CODE_SIZE),
        corner_codes=corner_codes,
        entry=entry,
        direction=direction,
        up=hits.up[pixels].astype(np.float32),
        ratio=hits.ratio[pixels].astype(np.float32),
        covered=covered,
        luminances=np.concatenate([light, own, around], axis=1).astype(np.float32),
    )
