# SPDX-License-Identifier: GPL-3.0-or-later
"""Explanations, in a sentence, of a picture that is empty or black, so that users need not guess."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from ..cells.scales import LUMINANCE_SCALE
from ..octree.octree import Octree
from .camera import PERSPECTIVE, Camera

if TYPE_CHECKING:
    from .hits import Hits

_BLACK = 1.5e-4  # luminance that 8 bits of a picture round to black
_FEW_PIXELS = 4
_BOUNDS_LEVEL = 6
# In an octree's provenance: the materials of its surface if all are black, and why cameras, by name, see only black.
BLACK_SURFACE, BLACK_VIEWS = "black_surface", "black_views"


def why_unseen(octree: Octree, camera: Camera, hits: Hits, brightest: float) -> str | None:
    """Sentence about a picture that shows nothing or is black; None for any other.

    hits: of the camera's pixels. brightest: the largest luminance in the picture.
    """
    name = f"Camera '{camera.name}'"
    if not hits.hit.any():
        return f"{name} sees nothing: {_why_nothing(octree, camera)}"
    if _stands_in_voxels(hits, camera):
        side = octree.grid.side_world / 2.0 ** int(hits.level.max())
        return (
            f"{name} sees nothing but the voxel of side {side:.3g} in which it stands: choose finer voxels, or leave "
            "out objects that lie far from the others"
        )
    if brightest < _BLACK:
        return f"{name} sees only black: {_why_black(octree, camera)}"
    count = int(hits.hit.sum())
    if count <= _FEW_PIXELS < len(hits.hit) / 8:
        pixels = "a single pixel" if count == 1 else f"{count} pixels"
        return f"{name} sees the surface in {pixels} only: it is too far away, or its picture has too few pixels"
    return None


def _why_nothing(octree: Octree, camera: Camera) -> str:
    from .render import first_hits

    whole = first_hits(octree, replace(camera, clip_start=0.0, clip_end=float("inf")))
    if whole.hit.any():
        nearest, farthest = float(whole.z_world[whole.hit].min()), float(whole.z_world[whole.hit].max())
        clipping = f"its clipping range {camera.clip_start:.3g} to {camera.clip_end:.3g}"
        if nearest > camera.clip_end:
            return f"the surface begins at {nearest:.3g}, beyond {clipping}; raise Clip End"
        return (
            f"the surface, between {nearest:.3g} and {farthest:.3g}, lies outside {clipping}; change Clip Start or End"
        )
    corners = _corners(octree)
    from_camera = corners - camera.position_world
    ahead = from_camera @ camera.forward
    if ahead.max() <= 0.0:
        return "the surface is behind it; turn or move it"
    middle = float(ahead[ahead > 0.0].mean())
    size = float(np.linalg.norm(np.ptp(corners, axis=0)))
    if size < float(camera.pixel_side(np.array(middle))):
        return f"the surface, {size:.3g} across at {middle:.3g}, is smaller than a pixel; move it closer or zoom in"
    return "it looks past the surface; turn or move it"


def _stands_in_voxels(hits: Hits, camera: Camera) -> bool:
    """Return whether all rays of a perspective picture end where they begin."""
    if camera.kind != PERSPECTIVE or not hits.hit.all():
        return False
    return bool((hits.z_world <= camera.clip_start * (1.0 + 1e-6)).all())


def _why_black(octree: Octree, camera: Camera) -> str:
    if (measured := octree.provenance.get(BLACK_VIEWS, {}).get(camera.name)) is not None:
        return str(measured)
    if (names := octree.provenance.get(BLACK_SURFACE)) is not None:
        return f"all materials of the surface are black: {names}"
    if int(octree.luminance.max()) < _BLACK * LUMINANCE_SCALE:
        if octree.provenance.get("exposure") == "given":
            return f"nothing is brighter at an exposure of {octree.exposure:.3g}; leave it automatic, or add light"
        if octree.provenance.get("light") == "cycles":
            return "no light of the scene reaches the surface; add light, or look at the lamps' strength and visibility"
        return "the surface itself is black"
    if _enclosed(octree, camera):
        return "it stands inside of something into which no light gets; move it out, or put a lamp there"
    return "no light reaches what is in its view, or its materials are black"


def _enclosed(octree: Octree, camera: Camera) -> bool:
    """Return whether rays into all directions from the camera end on the surface."""
    from .render import first_hits

    ways = [np.eye(3)[axis] * sign for axis in range(3) for sign in (1.0, -1.0)]
    for way in ways:
        at = np.asarray(camera.position_world, np.float64)
        look = Camera.look_at(at, at + way, fov=float(np.radians(90.0)), size_px=(8, 8))
        if not first_hits(octree, look).hit.all():
            return False
    return True


def _corners(octree: Octree) -> np.ndarray:
    """Corners (8, 3) of the surface's box in world units, to the accuracy of a coarse voxel."""
    level = min(_BOUNDS_LEVEL, octree.depth)
    while len(octree.cells(level)) == 0:  # leaves that fit cameras may all be coarser
        level -= 1
    cells = octree.cells(level)
    unit = np.stack([cells.min(axis=0), cells.max(axis=0) + 1]) / 2.0**level
    low, high = octree.grid.to_world(unit)
    return np.array([[x, y, z] for x in (low[0], high[0]) for y in (low[1], high[1]) for z in (low[2], high[2])])


def why_unseen_by(octree: Octree, cameras: Iterable[Camera]) -> list[str]:
    """Sentences of `why_unseen` about all cameras that see nothing, or only black, in their first hits."""
    from .render import first_hits

    seen = [(camera, first_hits(octree, camera)) for camera in cameras]
    found = [why_unseen(octree, camera, hits, float(hits.luminance.max())) for camera, hits in seen]
    return [text for text in found if text is not None]
