# SPDX-License-Identifier: GPL-3.0-or-later
"""Pieces of leaves: the triangles in each, with the light of both their sides (methods 7.2k).

A ray that reaches a leaf is tested against its pieces, so that it ends on the surface and not on a box around it. Base
colour is looked up where the ray ends; a piece holds the light that falls on it, by which that colour is multiplied.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import NamedTuple

import numpy as np

from ..surface.hit_textures import MATERIAL_OF, NO_TEXTURES, HitTextures

PIECES_VERSION = 2  # of the arrays of files
MOST_PIECES = 32  # of a leaf; with more, as of a bush far away, it stays a box
NO_PIECES = np.uint32(0xFFFFFFFF)  # first piece of a leaf without pieces
LAST, HOLES, TRIANGLE = np.uint32(1 << 31), np.uint32(1 << 30), np.uint32((1 << 30) - 1)
MANTISSA, EXPONENT_BIAS = 512.0, 15  # of packed light, up to 2^16


class Pieces(NamedTuple):
    """Pieces of an octree's leaves, p of them, and their t triangles.

    triangle: (p,) uint32, index of the triangle; the highest bit is set for the last piece of a leaf, the one below for
    triangles that a ray may pass. light: (p, 2) uint32, of front and back before exposure and without base colour, as
    `packed_light`. corners: (t, 9) float32 in the octree's cube. uvs: (t, 8) float32, those of the corners, half the
    logarithm to base 2 of the triangle's area of UV coordinates over that in the cube, and its material, in columns
    that `hit_textures.py` names. textures: base
    colours and opacity of the materials.
    """

    triangle: np.ndarray
    light: np.ndarray
    corners: np.ndarray
    uvs: np.ndarray
    textures: HitTextures

    @property
    def nbytes(self) -> int:
        """Bytes of all arrays."""
        return sum(array.nbytes for array in (*self[:-1], *self.textures))


NONE = Pieces(
    np.empty(0, np.uint32),
    np.empty((0, 2), np.uint32),
    np.empty((0, 9), np.float32),
    np.empty((0, 8), np.float32),
    NO_TEXTURES,
)


def piece_arrays(pieces: Pieces) -> dict[str, np.ndarray]:
    """Arrays of a file, which has no records: these are rows of bytes."""
    own = pieces._asdict() | pieces.textures._asdict()
    del own["textures"]
    return {
        f"piece_{name}": array
        if array.dtype.names is None
        else array.view(np.uint8).reshape(len(array), array.dtype.itemsize)
        for name, array in own.items()
    }


def pieces_of(arrays: Mapping[str, np.ndarray]) -> Pieces | None:
    """Pieces of a file's arrays; None if one is missing, or of another type or shape."""
    found = {}
    for name, like in (*NONE._asdict().items(), *NO_TEXTURES._asdict().items()):
        if name == "textures":
            continue
        array = arrays.get(f"piece_{name}", np.empty(0, np.void))
        if like.dtype.names is not None and array.ndim == 2 and array.shape[1] == like.dtype.itemsize:
            array = np.ascontiguousarray(array).view(like.dtype)[:, 0]
        if array.dtype != like.dtype or array.shape[1:] != like.shape[1:]:
            return None
        found[name] = array
    textures = HitTextures(**{name: found.pop(name) for name in HitTextures._fields})
    return Pieces(**found, textures=textures)


def are_consistent(pieces: Pieces, first: np.ndarray) -> bool:
    """Return whether no ray can leave the arrays. first: (l,) uint32, first pieces of the leaves."""
    count, triangles, textures = len(pieces.triangle), len(pieces.corners), pieces.textures
    if len(pieces.light) != count or len(pieces.uvs) != triangles:
        return False
    material, materials, chains, levels = (
        pieces.uvs[:, MATERIAL_OF],
        textures.materials,
        textures.chains,
        textures.levels,
    )
    ends = levels[:, 0] + levels[:, 1] * levels[:, 2]
    return bool(
        ((first < count) | (first == NO_PIECES)).all()
        and (count == 0 or pieces.triangle[-1] & LAST)
        and (pieces.triangle & TRIANGLE < max(triangles, 1)).all()
        and ((material >= 0) & (material < len(materials))).all()
        and all((materials[name] < len(chains)).all() for name in ("chain", "color_chain"))
        and ((chains["first"] >= 0) & (chains["level_count"] > 0)).all()
        and (chains["first"] + chains["level_count"] <= len(levels)).all()
        and ((levels[:, 0] >= 0) & (levels[:, 1:] > 0).all(axis=1) & (ends <= len(textures.texels))).all()
    )
