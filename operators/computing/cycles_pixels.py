# SPDX-License-Identifier: GPL-3.0-or-later
"""Pixels of a view that Cycles renders, and the picture of them over the octree's."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np

from ...patchnet_addon.image.background import Ground
from ...patchnet_addon.runtime.progress import Progress, Steps
from ...patchnet_addon.sampling.adaptive import Pace, in_batches
from ...patchnet_addon.sampling.pixel_buffers import PixelBuffers
from ...patchnet_addon.sampling.predicted import PREDICTED, PREVIEW
from ...patchnet_addon.surface.scene_mesh import SceneMesh
from ...patchnet_addon.surface.textures import luminance
from ...patchnet_addon.tracing.camera import Camera
from ...patchnet_addon.tracing.pixel_filter import EVEN_FOOTPRINT
from ...patchnet_addon.tracing.pixel_means import PixelMeans
from ..settings.cycles_settings import REFERENCE_FACTOR, CyclesSettings
from .views import View

REFINED, COMPOSITED, OVER_UNREFINED, FULL = "refined_octree", "composited", "composited_over_unrefined", "full"
OWN_SIDE = 4  # of the octree's rays in pixels that Cycles does not render
# Triangles of a box, by its corners in Blender's order.
_SIDES = np.array([[0, 1, 2], [0, 2, 3], [4, 6, 5], [4, 7, 6], [0, 4, 5], [0, 5, 1],
                   [3, 2, 6], [3, 6, 7], [0, 3, 7], [0, 7, 4], [1, 5, 6], [1, 6, 2]])  # fmt: skip


class Chosen(NamedTuple):
    """Pixels to render: mask (H, W) bool, row 0 at the bottom.

    depth_world: of the nearest surface in all pixels, infinite without one.
    """

    mask: np.ndarray
    depth_world: float


@dataclass(eq=False)
class Renders:
    """Cycles pictures, (H, W, 4) float32, linear unexposed light and alpha, and their wall seconds.

    pixels: the chosen pixels, empty elsewhere. seconds: of these, with reading the scene; sync_seconds: of reading
    alone. full: the whole picture with the same samples and seed, in full_seconds, with reading the scene. reference:
    with more samples and another seed.
    """

    pixels: np.ndarray
    seconds: float = 0.0
    sync_seconds: float = 0.0
    full: np.ndarray | None = None
    full_seconds: float = 0.0
    reference: np.ndarray | None = None


def shown_light(light: np.ndarray, exposure: float, colored: bool) -> np.ndarray:
    """Linear light (H, W, 3), or with alpha (H, W, 4), as the octree shows it: exposed, in [0, 1], (H, W) unless
    `colored`."""
    light = light[..., :3]
    return np.clip(np.float32(exposure) * (light if colored else luminance(light)), 0.0, 1.0).astype(np.float32)


def squared_errors(
    buffers: PixelBuffers, mask: np.ndarray, renders: Renders, exposure: float, octree: tuple[np.ndarray, np.ndarray]
) -> dict[str, np.ndarray]:
    """Squared luminance errors (H, W) float64 against the reference, by name of the picture.

    octree: (P,) luminance of the view's refined picture, and of the octree's own rays below the pixels of Cycles. All
    errors include the noise of the reference.
    """
    assert renders.reference is not None and renders.full is not None
    reference, cycles, full = (
        shown_light(light, exposure, False) for light in (renders.reference, renders.pixels, renders.full)
    )
    refined, own = (buffers.picture(luminance) for luminance in octree)
    shown = buffers.picture(buffers.shown)
    pictures = {
        PREVIEW: buffers.picture(buffers.preview),
        OVER_UNREFINED: np.where(mask, cycles, shown),
        REFINED: refined,
        COMPOSITED: np.where(mask, cycles, own),
        FULL: full,
    }
    if buffers.shows_predicted:
        pictures[PREDICTED] = shown
    return {name: (picture.astype(np.float64) - reference) ** 2 for name, picture in pictures.items()}


class WantedSurface(NamedTuple):
    """Surface of a scene, and its parts that only Cycles shows correctly.

    shown, wanted: of each material, whether it is visible, and whether only Cycles shows it correctly. boxes: (B, 8, 3)
    corners around objects without a surface.
    """

    source: SceneMesh
    shown: np.ndarray
    wanted: np.ndarray
    boxes: np.ndarray


def wanted_pixels(surface: WantedSurface, camera: Camera) -> Chosen:
    """Pixels of a camera that only Cycles shows correctly: their nearest surface is wanted, or lies behind a box."""
    from ...patchnet_addon.tracing.seen_triangles import Sight

    sight, around = Sight(camera), Sight(camera)
    wanted = [np.zeros(0, bool)]
    for batch in surface.source.batches():
        sight.add(batch.corners_world, surface.shown[batch.materials], batch.first_triangle)
        wanted.append(surface.wanted[batch.materials])
    seen = sight.seen.triangle
    mask: np.ndarray = (seen >= 0) & np.concatenate(wanted)[seen]
    sides = surface.boxes[:, _SIDES].reshape(-1, 3, 3)
    around.add(sides, np.ones(len(sides), bool), 0)
    surfaces, boxes = sight.seen.depth, around.seen.depth
    mask |= (boxes < surfaces) | any(_is_in(box, camera) for box in surface.boxes)
    return Chosen(mask, float(min(surfaces.min(), boxes.min())))


def _is_in(box: np.ndarray, camera: Camera) -> bool:
    """Return whether a camera is inside of a box (8, 3), which then covers its whole picture."""
    edges = box[[4, 3, 1]] - box[0]
    share = np.linalg.lstsq(edges.T, camera.position_world - box[0], rcond=None)[0]
    return bool(((share >= 0.0) & (share <= 1.0)).all())


@dataclass(frozen=True, eq=False)
class CyclesView:
    """View with pixels rendered by Cycles.

    priority: (H, W) float32, the ranking after pixels that only Cycles shows correctly. mask: (H, W) bool, the rendered
    pixels. preview: the unrefined picture. composited: pixels of Cycles over the octree's own rays. preview,
    composited, full: (H, W), or (H, W, 3) in colour, linear, exposed, in [0, 1], over black; `full` is by Cycles alone,
    None unless `compare` is set. alphas: of these three, by name, (H, W). ground: background of the pictures.
    errors: name -> (H, W) absolute luminance error against the reference; empty without one. report: figures.
    warnings: pixels beyond the budget.
    """

    camera: Camera
    priority: np.ndarray
    mask: np.ndarray
    preview: np.ndarray
    composited: np.ndarray
    full: np.ndarray | None
    errors: dict[str, np.ndarray]
    report: dict[str, Any]
    alphas: dict[str, np.ndarray]
    ground: Ground
    warnings: tuple[str, ...] = ()


def _own_rays(view: View, pixels: np.ndarray) -> Steps[PixelMeans]:
    """Means over OWN_SIDE x OWN_SIDE rays, as in renders of the engine, in pixels (N,) of all P; 0 in the others."""
    from ...patchnet_addon.tracing.supersample import supersample_pixels

    octree, camera = view.octree, view.camera
    count = camera.pixel_count
    own = PixelMeans(np.zeros(count, np.float32), np.zeros((count, 3), np.float32), np.zeros(count, np.float32))

    def take(batch: np.ndarray, side: int) -> None:
        means = supersample_pixels(octree, camera, batch, side, finer=EVEN_FOOTPRINT)
        own.luminance[batch], own.colors[batch], own.coverage[batch] = means

    yield from in_batches([(OWN_SIDE, pixels)], Pace(), take)
    return own


def composited(view: View, mask: np.ndarray, renders: Renders, settings: CyclesSettings) -> Steps[CyclesView]:
    """View of which Cycles has rendered the pixels of `mask`, with errors of all pictures where these are known."""
    buffers, camera, exposure = view.buffers, view.camera, view.octree.exposure
    own = yield from _own_rays(view, np.flatnonzero(~mask))
    if settings.compare:
        yield Progress(0, 1, f"{camera.name}: measuring Cycles' pictures")
    score = np.nan_to_num(np.maximum(view.ranking.priority, 0.0))
    priority = buffers.picture(np.where(buffers.active, score, np.float32(0.0)))
    total, held = (float(priority[where].sum(dtype=np.float64)) for where in (..., mask))
    report: dict[str, Any] = {
        "budget": settings.budget,
        "samples": settings.samples,
        "light": settings.light,
        "pixels_share": float(mask.mean()),
        "priority_share": held / total if total > 0 else 0.0,
        "seconds": {"pixels": renders.seconds, "of_that_reading_the_scene": renders.sync_seconds},
        "unrefined": buffers.unrefined,
    }
    errors: dict[str, np.ndarray] = {}
    if renders.reference is not None:
        squared = squared_errors(buffers, mask, renders, exposure, (view.refined.luminance, own.luminance))
        active = buffers.picture(buffers.active)
        report["mse"] = {
            name: float(values[active].mean()) if active.any() else 0.0 for name, values in squared.items()
        }
        errors = {name: np.sqrt(values) for name, values in squared.items()}
    color = buffers.shown_color
    colored = color is not None
    preview = buffers.picture(buffers.shown if color is None else color)
    others = np.minimum(buffers.picture(own.colors if colored else own.luminance), np.float32(1.0))
    cycles = shown_light(renders.pixels, exposure, colored)
    composited = np.where(mask[..., None] if colored else mask, cycles, others)
    full = None
    alphas = {
        "preview": buffers.picture(buffers.shown_alpha),
        "composited": np.where(mask, renders.pixels[..., 3], buffers.picture(own.coverage)),
    }
    if renders.full is not None:
        full, alphas["full"] = shown_light(renders.full, exposure, colored), renders.full[..., 3]
        report["seconds"]["full"] = renders.full_seconds
        report["reference_samples"] = REFERENCE_FACTOR * settings.samples
    ground = Ground(camera, view.background, exposure)
    return CyclesView(camera, priority, mask, preview, composited, full, errors, report, alphas, ground)
