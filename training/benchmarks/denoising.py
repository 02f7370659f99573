# SPDX-License-Identifier: GPL-3.0-or-later
"""Error of baked light with and without denoising, by what is seen there: smooth light, shadows, contact, texture."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from ...patchnet_addon.lightmap.atlas import Atlas
from ...patchnet_addon.lightmap.denoise import Cells, Texels
from ...patchnet_addon.lightmap.denoised_atlas import Placed, cells_of, placed_texels
from ...patchnet_addon.surface.mesh import MeshSource
from ...patchnet_addon.surface.textures import TextureTable

REGIONS = ("all", "smooth", "shadow edges", "contact shadows", "textures")
_NEAR, _CONTACT = 2.5, 3.0  # texels within which light is compared, and another surface is looked for
_STEP = 0.4  # of the light in reach, above which it is a shadow's edge
_MOST = 600  # texels that one is compared with


@dataclass(frozen=True)
class RegionError:
    """Squared error of luminance in a region, the mean over its surface.

    share: of all texels. noisy, denoised: errors before and after. reference_noise: of what both are compared with.
    """

    region: str
    share: float
    noisy: float
    denoised: float
    reference_noise: float

    @property
    def ratio(self) -> float:
        """Denoised error over that before; 0 where there was none."""
        return self.denoised / self.noisy if self.noisy > 0.0 else 0.0

    def as_json(self) -> dict[str, Any]:
        """Plain JSON values."""
        return vars(self) | {"ratio": self.ratio}


def errors_by_region(noisy: Atlas, denoised: Atlas, reference: Atlas, source: MeshSource) -> list[RegionError]:
    """Errors of two atlases against a third one of many more paths, with its noise, on the same charts.

    A texel is in contact if another surface stands within three texels of it; at a shadow's edge if light within two
    and a half changes by more than 40 %; textured if its material has a base texture; else smooth.
    """
    placed = placed_texels(reference, source)
    order, cells = cells_of(placed.texels.points, placed.texels.size, reference.charts.texel_world, np.zeros(3))
    placed = Placed(placed.place[order], placed.albedo[order], Texels(*(column[order] for column in placed.texels)))
    regions = _regions(placed.texels, cells, TextureTable.from_materials(source.materials))
    place, area = placed.place, placed.texels.size.astype(np.float64) ** 2
    assert reference.noise is not None
    squares = (
        (noisy.texels[place, 0] - reference.texels[place, 0]) ** 2,
        (denoised.texels[place, 0] - reference.texels[place, 0]) ** 2,
        reference.noise[place] ** 2,
    )
    return [
        RegionError(
            name, float(chosen.mean()), *(float(np.average(each[chosen], weights=area[chosen])) for each in squares)
        )
        for name, chosen in regions.items()
        if chosen.any()
    ]


def _regions(texels: Texels, cells: Cells, table: TextureTable) -> dict[str, np.ndarray]:
    """(N,) bool of each of REGIONS."""
    low, high, contact = (np.empty(len(texels.size)) for _ in range(3))
    for cell in range(len(cells.around)):
        near = np.concatenate([np.arange(cells.first[c], cells.first[c + 1]) for c in cells.around[cell] if c >= 0])
        near = near[:: -(-len(near) // _MOST)]
        mine = np.arange(cells.first[cell], cells.first[cell + 1])
        apart = texels.points[near][None] - texels.points[mine][:, None]
        size = texels.size[mine][:, None]
        distance = np.linalg.norm(apart, axis=2)
        cosine = texels.normals[mine] @ texels.normals[near].T
        height = np.abs((apart * texels.normals[mine][:, None]).sum(axis=2))
        same = (cosine > 0.9) & (texels.material[near][None] == texels.material[mine][:, None])
        same &= (distance < _NEAR * size) & (height < 0.3 * size)
        light, own = texels.light[near, 0][None], texels.light[mine, 0]
        low[mine] = np.minimum(np.where(same, light, np.inf).min(axis=1), own)
        high[mine] = np.maximum(np.where(same, light, -np.inf).max(axis=1), own)
        contact[mine] = ((distance < _CONTACT * size) & (cosine < 0.7)).any(axis=1)
    touches = contact > 0.0
    edge = (high - low > _STEP * high) & ~touches
    textured = (table.materials.chain[texels.material] >= 0) & ~touches & ~edge
    smooth = ~(touches | edge | textured)
    return dict(zip(REGIONS, (np.ones(len(low), bool), smooth, edge, touches, textured), strict=True))
