# SPDX-License-Identifier: GPL-3.0-or-later
"""Error of baked light with and without denoising, by what is seen there: smooth light, shadows, contact, texture."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np

from ...patchnet_addon.lightmap.atlas import MIN_OPACITY, Atlas
from ...patchnet_addon.lightmap.denoise import Cells, Texels
from ...patchnet_addon.lightmap.denoised_atlas import cells_of, divisor, placed_texels
from ...patchnet_addon.surface.mesh import MeshSource
from ...patchnet_addon.surface.textures import TextureTable

REGIONS = ("all", "smooth", "shadow edges", "contact shadows", "textures")
_NEAR, _CONTACT = 2.5, 3.0  # texels within which light is compared, and another surface is looked for
_STEP = 0.4  # of the light in reach, above which it is a shadow's edge
_BLOCK = 16  # texels of a block's side
_MOST = 600  # texels that one is compared with


@dataclass(frozen=True)
class RegionError:
    """Squared error of luminance in a region, the mean over its surface by area and opacity.

    share: of the surface. noisy, denoised: errors before and after. reference_noise: of what both are compared with.
    rivals: errors of other atlases, by what they are called.
    """

    region: str
    share: float
    noisy: float
    denoised: float
    reference_noise: float
    rivals: dict[str | int, float] = field(default_factory=dict)

    @property
    def ratio(self) -> float:
        """Denoised error over that before; 0 where there was none."""
        return self.denoised / self.noisy if self.noisy > 0.0 else 0.0

    def as_json(self) -> dict[str, Any]:
        """Plain JSON values."""
        return vars(self) | {"ratio": self.ratio}


def errors_by_region(
    noisy: Atlas, denoised: Atlas, reference: Atlas, source: MeshSource, rivals: Mapping[str | int, Atlas] | None = None
) -> list[RegionError]:
    """Errors of atlases against one of many more paths, on the same charts, wherever that one has light.

    A texel is in contact if another surface stands on its plane within three texels; at a shadow's edge if light within
    two and a half changes by more than 40 %; textured if its material has a base texture; else smooth. The reference
    knows its noise.
    """
    blank = noisy.noise if noisy.noise is not None else np.zeros(len(noisy.texels), np.float32)
    placed = placed_texels(replace(noisy, noise=blank), source)
    order, cells = cells_of(placed.texels.points, placed.texels.size, reference.charts.texel_world, np.zeros(3))
    place, albedo, area = placed.place[order], divisor(placed.base[order, 0]), placed.area[order].astype(np.float64)
    texels = Texels(*(column[order] for column in placed.texels))
    known, truth = reference.texels[place, 1] > MIN_OPACITY, _shown(reference, place)
    light = np.where(known, truth / albedo, np.nan)
    regions = _regions(texels, light, cells, TextureTable.from_materials(source.materials))
    area *= np.clip(reference.texels[place, 1], 0.0, 1.0)  # of gaps nothing is seen
    assert reference.noise is not None
    squares = {"reference_noise": (reference.noise[place] / np.maximum(reference.texels[place, 1], MIN_OPACITY)) ** 2}
    atlases = {"noisy": noisy, "denoised": denoised}
    squares |= {name: (_shown(each, place) - truth) ** 2 for name, each in atlases.items()}
    others = {name: (_shown(each, place) - truth) ** 2 for name, each in (rivals or {}).items()}
    found = []
    for region, chosen in regions.items():
        if chosen.any():
            means = {name: float(np.average(each[chosen], weights=area[chosen])) for name, each in squares.items()}
            beside = {name: float(np.average(each[chosen], weights=area[chosen])) for name, each in others.items()}
            found.append(RegionError(region, float(area[chosen].sum() / area[known].sum()), **means, rivals=beside))
    return found


def _shown(atlas: Atlas, place: np.ndarray) -> np.ndarray:
    """Luminance (n,) of the surface at texels (n,), which atlases hold weighed by opacity."""
    return np.asarray(atlas.texels[place, 0] / np.maximum(atlas.texels[place, 1], MIN_OPACITY))


def in_blocks(source: MeshSource, texel_world: float, share: float, seed: int = 0) -> np.ndarray:
    """(T,) bool: triangles whose centres lie in a random share of cubes of 16 texels, to be looked at as wholes."""
    rng, chosen = np.random.default_rng(seed), np.zeros(source.triangle_count, bool)
    side = _BLOCK * texel_world
    counts = np.ceil((source.bounds_world[1] - source.bounds_world[0]) / side).astype(np.int64) + 1
    taken = rng.random(tuple(counts)) < share
    for batch in source.batches():
        centre = batch.corners_world.mean(axis=1) - source.bounds_world[0]
        x, y, z = np.clip((centre / side).astype(np.int64), 0, counts - 1).T
        chosen[batch.first_triangle : batch.first_triangle + len(batch)] = taken[x, y, z]
    return chosen


def _regions(texels: Texels, light: np.ndarray, cells: Cells, table: TextureTable) -> dict[str, np.ndarray]:
    """(N,) bool of each of REGIONS; none has texels whose `light` (N,) is not known, NaN."""
    known = np.isfinite(light)
    low, high, contact = (np.zeros(len(light)) for _ in range(3))
    for cell in range(len(cells.around)):
        mine = np.arange(cells.first[cell], cells.first[cell + 1])
        mine = mine[known[mine]]
        if not len(mine):
            continue
        near = np.concatenate([np.arange(cells.first[c], cells.first[c + 1]) for c in cells.around[cell] if c >= 0])
        near = near[:: -(-len(near) // _MOST)]
        apart = texels.points[near][None] - texels.points[mine][:, None]
        size = texels.size[mine][:, None]
        distance = np.linalg.norm(apart, axis=2)
        cosine = texels.normals[mine] @ texels.normals[near].T
        height = (apart * texels.normals[mine][:, None]).sum(axis=2)
        same = (cosine > 0.9) & (texels.material[near][None] == texels.material[mine][:, None])
        same &= (distance < _NEAR * size) & (np.abs(height) < 0.3 * size) & known[near][None]
        there, own = light[near][None], light[mine]
        low[mine] = np.minimum(np.where(same, there, np.inf).min(axis=1), own)
        high[mine] = np.maximum(np.where(same, there, -np.inf).max(axis=1), own)
        contact[mine] = ((distance < _CONTACT * size) & (cosine < 0.7) & (height > 0.1 * size)).any(axis=1)
    touches = (contact > 0.0) & known
    edge = (high - low > _STEP * high) & ~touches & known
    textured = (table.materials.chain[texels.material // 2] >= 0) & ~touches & ~edge & known
    smooth = known & ~(touches | edge | textured)
    return dict(zip(REGIONS, (known, smooth, edge, touches, textured), strict=True))
