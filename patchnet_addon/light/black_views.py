# SPDX-License-Identifier: GPL-3.0-or-later
"""Reason why the whole surface in a camera's view was baked black."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np

from ..octree.grid import Grid
from ..runtime.bounds import MAX_DEPTH
from ..runtime.progress import Progress, Steps, drain
from ..runtime.quantities import named_list
from ..surface.mesh import Fragments, ShadingFn
from ..surface.scene_mesh import SceneMesh
from ..surface.textures import LEAST_BASE
from ..tracing.camera import Camera
from .chosen_surfels import ChosenSurfels

if TYPE_CHECKING:
    from .light_cells import LightCells

_DARK = 1e-5  # of the brightest light: black in any picture
_LIT = 1e-3  # of the light on the other side
_MOST_CAMERAS, _SIZE_PX = 16, (48, 36)


def black_views(
    source: SceneMesh,
    grid: Grid,
    cameras: Sequence[Camera],
    chosen: ChosenSurfels,
    light: LightCells,
    shade: ShadingFn,
    *,
    lookahead: int,
    without_gloss: bool,
    lost: Sequence[str] = (),
) -> Steps[dict[str, str]]:
    """Reason for each camera, by name, whose whole surface in view is black; none for others.

    Only the first cameras are asked. chosen: the baked surfels of the source, in the octree's grid. light: of their
    cells, shade: of fragments. lookahead: levels, of the weights in use. without_gloss: no gloss was baked. lost:
    sentences about what else was not baked.
    """
    from .seen_cells import seen_cells

    reasons: dict[str, str] = {}
    radiance = light.radiance[: len(chosen.surfels)]
    brightest = float(radiance.max(initial=0.0))
    starts, _ = _spans(chosen.surfels["leaf"])
    order = np.argsort(starts)
    starts = starts[order]
    for number, camera in enumerate(cameras[:_MOST_CAMERAS]):
        yield Progress(number, len(cameras[:_MOST_CAMERAS]), "Looking for light")
        steps = seen_cells(chosen.nodes, grid, [camera.with_size(*_SIZE_PX)], lookahead=lookahead)
        # Rays of a large picture's thumbnail may end above its leaves.
        first, last = (
            np.bincount(np.searchsorted(starts, ends), minlength=len(starts) + 1) for ends in _spans(drain(steps).cells)
        )
        mine = order[np.cumsum(first - last)[:-1] > 0]
        mine = mine[chosen.surfels["pixels"][mine] > 0.0]
        if len(mine) and radiance[mine].max() <= _DARK * brightest:
            reasons[camera.name] = _reason(source, chosen, mine, shade, lost, without_gloss)
    return reasons


def _spans(cells: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """First key of the deepest level in cells (n,) as in `SeenCells`, and the first one behind them."""
    below = np.uint64(3) * (np.uint64(MAX_DEPTH) - (cells & np.uint64(31)))
    keys = cells >> np.uint64(5)
    return keys << below, (keys + np.uint64(1)) << below


def _reason(
    source: SceneMesh,
    chosen: ChosenSurfels,
    mine: np.ndarray,
    shade: ShadingFn,
    lost: Sequence[str],
    without_gloss: bool,
) -> str:
    """Reason why surfels (n,) are black."""
    surfels = chosen.surfels[mine]
    names = source.objects_of(surfels["triangle"])
    material = chosen.surface.material[mine]
    base = chosen.surface.base[mine, 0]
    shows_gloss_alone = np.array([gloss.is_glossy for gloss in source.gloss], bool)[material] & without_gloss
    if np.mean((base <= LEAST_BASE) | ~chosen.surface.is_filtered[mine] | shows_gloss_alone) > 0.5:
        return _black_material(source, names, material, without_gloss, lost)
    objects = named_list(name for name, _ in Counter(names.tolist()).most_common())
    own, other = _both_sides(source, surfels, shade)
    if np.median(other) > 0.0 and np.median(own) <= _LIT * np.median(other):
        return f"light falls on the other side of {objects} alone, in Cycles too"
    return f"no light of the scene reaches {objects}; add light, or look at the lamps' strength and visibility"


def _both_sides(source: SceneMesh, surfels: np.ndarray, shade: ShadingFn) -> tuple[np.ndarray, np.ndarray]:
    """Luminance (n,) of surfels on their side, and on the other."""
    lights = np.zeros((len(surfels), 2))
    for batch in source.batches():
        local = surfels["triangle"] - batch.first_triangle
        for leaf_level in np.unique(surfels["leaf"] & np.uint64(31)).tolist():
            here = (local >= 0) & (local < len(batch)) & ((surfels["leaf"] & np.uint64(31)) == leaf_level)
            own = surfels[here]
            places = np.stack([own["one"], own["two"]], axis=1)
            keys, area = own["leaf"] >> np.uint64(5), own["area"].astype(np.float64)
            fragments = Fragments(keys, local[here].astype(np.int32), places, area, level=int(leaf_level))
            lights[here] = shade(batch, fragments).sides[..., 0]
    side, rows = surfels["side"].astype(int), np.arange(len(surfels))
    return lights[rows, side], lights[rows, 1 - side]


def _black_material(
    source: SceneMesh, names: np.ndarray, materials: np.ndarray, without_gloss: bool, lost: Sequence[str]
) -> str:
    """Reason why the surface is black that most of what is seen belongs to. materials: (n,), names: their objects.

    lost: sentences about what was not baked.
    """
    number, _ = Counter(materials.tolist()).most_common(1)[0]
    material, owner = source.materials[number], names[np.flatnonzero(materials == number)[0]]
    why = ", in Cycles too"
    if source.gloss[number].is_glossy and without_gloss:
        why = " without its gloss; choose Gloss: Automatic"
    elif notes := [text for text in source.warnings if text.startswith("Material") and f"'{material.name}'" in text]:
        why = f": {notes[0]}"
    elif any(f"of material '{material.name}'" in text for text in lost):
        why = " without what depends on the view or on whole objects"
    elif max(*material.base_color, *material.emission) <= 0.0:
        why = "; give it a color"
    return f"the material '{source.material_names[number]}' of '{owner}' is black{why}"
