# SPDX-License-Identifier: GPL-3.0-or-later
"""Picture of one viewport on the graphics card: a ray a pixel while the view moves, then one sample after the other."""

from __future__ import annotations

from typing import Any

import bpy
import numpy as np

from ...patchnet_addon.tracing.camera import Camera, camera_in_unit_cube
from ..gpu_view.card_octree import CardOctree
from ..gpu_view.packing import world_words
from ..gpu_view.shaders import CENTRE, FLOATS
from .viewport_world import WorldBehind, draw_picture


class CardPicture:
    """Mean of the samples of a view so far; dropping it frees its images.

    done: all samples are there.
    """

    def __init__(self) -> None:
        self.done = False
        self._view: tuple[Any, ...] = ()
        self._means: tuple[Any, Any] | None = None
        self._world: tuple[Any, int] | None = None
        self._background: Any = None
        self._places = np.empty((0, 2))
        self._samples = 0  # taken of _places; -1 before the single ray that is drawn while the view moves

    def look(self, card: CardOctree, view: tuple[Any, ...], camera: Camera, behind: WorldBehind, side: int) -> bool:
        """Take one of side x side samples of a view; returns whether the view has changed.

        view: key of all that the picture depends on, except the world.
        """
        if behind.identity != self._background or self._world is None:
            words, world_side = world_words(behind.world)
            self._world, self._background = (card.device.texture(words), world_side), behind.identity
            self._view = ()
        moved = view != self._view
        if moved:
            self._begin(card, view, camera, side)
        if not self.done:
            self._take(card, camera, side)
        return moved

    def draw(self, engine: bpy.types.RenderEngine, scene: bpy.types.Scene) -> None:
        """Fill the current region."""
        assert self._means is not None
        draw_picture(self._means[0], engine, scene)

    @property
    def status(self) -> str:
        """Status in words."""
        return "Done" if self.done else f"Sample {max(self._samples, 0)} of {len(self._places)}"

    def _begin(self, card: CardOctree, view: tuple[Any, ...], camera: Camera, side: int) -> None:
        size = camera.width_px, camera.height_px
        if self._means is None or (self._means[0].width, self._means[0].height) != size:
            self._means = card.device.image(*size, FLOATS), card.device.image(*size, FLOATS)
        grid = np.stack(np.meshgrid(np.arange(side), np.arange(side)), axis=-1).reshape(-1, 2)[side == 1 :]
        self._places = np.random.default_rng(0).permutation((grid + 0.5) / side)
        self._view, self._samples, self.done = view, -1, False

    def _take(self, card: CardOctree, camera: Camera, side: int) -> None:
        from ...patchnet_addon.sampling.adaptive import EVEN_FOOTPRINT

        assert self._means is not None and self._world is not None
        unit, (mean, other) = camera_in_unit_cube(camera, card.grid), self._means
        if self._samples < 0:
            card.draw(unit, (mean, other), self._world, 0, CENTRE)
        else:
            x, y = self._places[self._samples]
            finer = unit.finer(max(side, EVEN_FOOTPRINT))
            card.draw(finer, (mean, other), self._world, self._samples, (float(x), float(y)))
        self._means = other, mean
        self._samples += 1
        self.done = self._samples == len(self._places)
