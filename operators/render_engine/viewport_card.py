# SPDX-License-Identifier: GPL-3.0-or-later
"""Picture and live heatmap of one viewport on the graphics card.

The picture has a ray a pixel while the view moves, then one sample after the other; the heatmap half the resolution
while the view moves, then bands of rows.
"""

from __future__ import annotations

from contextlib import suppress
from typing import Any, NamedTuple
from weakref import ReferenceType, ref

import bpy
import numpy as np

from ...patchnet_addon.codes.coded_octree import CodedOctree
from ...patchnet_addon.image.colormaps import colormap
from ...patchnet_addon.process.computed import answer
from ...patchnet_addon.runtime.errors import EngineGoneError
from ...patchnet_addon.sampling.pixel_lines import pixel_lines
from ...patchnet_addon.sampling.registry import STRATEGIES
from ...patchnet_addon.sampling.strategy import Strategy
from ...patchnet_addon.tracing.camera import Camera, CameraUnit, camera_in_unit_cube
from ...patchnet_addon.tracing.pixel_filter import EVEN_FOOTPRINT, PixelFilter, rook_places
from ..gpu_view.card_octree import CardOctree, Samples
from ..gpu_view.packing import world_words
from ..gpu_view.shaders import FLOATS
from .viewport_world import WorldBehind, draw_picture

_RAMP = 256
_BAND_ROWS = 64  # decoded between two redraws
_PRIORITY = 1  # kind of a heatmap
_PAPER, _NO_RAY = STRATEGIES["patchnet"], STRATEGIES["patchnet-plus-0"]  # strategies of the card


class CardPicture:
    """Mean of the samples of a view so far; dropping it frees its images.

    done: all samples are there.
    """

    def __init__(self) -> None:
        self.done = False
        self._view: tuple[Any, ...] = ()
        self._images: tuple[Any, Any, Any] | None = None  # of a sample, and of means, the present one last
        self._world: tuple[Any, int] | None = None
        self._background: Any = None
        self._kind: tuple[Any, ...] = ()
        self._first: Samples | None = None  # the single ray that is drawn while the view moves
        self._samples: Samples | None = None
        self._taken = 0  # of the samples; -1 before the first ray

    def look(
        self,
        card: CardOctree,
        view: tuple[Any, ...],
        camera: Camera,
        behind: WorldBehind,
        side: int,
        pixel_filter: PixelFilter,
    ) -> bool:
        """Take one of side x side samples of a view through a pixel filter; returns whether the view has changed.

        view: key of all that the picture depends on, except the world.
        """
        if behind.identity != self._background or self._world is None:
            words, world_side = world_words(behind.world)
            self._world, self._background = (card.device.texture(words), world_side), behind.identity
            self._view = ()
        moved = view != self._view
        if moved:
            self._begin(card, view, camera, (side, pixel_filter))
        if not self.done:
            self._take(card, camera, side)
        return moved

    def draw(self, region: bpy.types.Region, engine: bpy.types.RenderEngine, scene: bpy.types.Scene) -> None:
        """Fill a region, the current one."""
        assert self._images is not None
        draw_picture(self._images[2], region, engine, scene)

    @property
    def status(self) -> str:
        """Status in words."""
        count = 0 if self._samples is None else len(self._samples.places)
        return "Done" if self.done else f"Sample {max(self._taken, 0)} of {count}"

    def _begin(self, card: CardOctree, view: tuple[Any, ...], camera: Camera, kind: tuple[int, PixelFilter]) -> None:
        size = camera.width_px, camera.height_px
        if self._images is None or (self._images[0].width, self._images[0].height) != size:
            first, second, third = (card.device.image(*size, FLOATS) for _ in range(3))
            self._images = first, second, third
        if kind != self._kind:
            side, pixel_filter = kind
            self._first = Samples.of(card.device, pixel_filter, rook_places(1))
            places = np.random.default_rng(0).permutation(rook_places(side))
            self._samples = Samples.of(card.device, pixel_filter, places) if side > 1 else None
            self._kind = kind
        self._view, self._taken, self.done = view, -1, False

    def _take(self, card: CardOctree, camera: Camera, side: int) -> None:
        assert self._images is not None and self._world is not None and self._first is not None
        unit, (seen, other, mean) = camera_in_unit_cube(camera, card.grid), self._images
        if self._taken < 0 or self._samples is None:
            card.draw(unit, (seen, mean, other), self._world, self._first, 0)
        else:
            finest = max(side, EVEN_FOOTPRINT)
            images, footprint = (seen, mean, other), finest / side
            card.draw(unit.finer(finest), images, self._world, self._samples, self._taken, footprint)
        self._images = seen, mean, other
        self._taken += 1
        self.done = self._samples is None or self._taken == len(self._samples.places)


class HeatKind(NamedTuple):
    """Settings of a heatmap.

    kind, most: see `CardOctree.heat`. ramp: name of a colour map. ranked_by: one of the card's strategies.
    """

    kind: int
    most: float
    ramp: str
    ranked_by: Strategy

    @property
    def estimated(self) -> bool:
        """Return whether the heatmap needs the estimator of errors."""
        return self.kind == _PRIORITY and self.ranked_by is _NO_RAY


def strategy_on_card(chosen: Strategy, card: CardOctree) -> tuple[Strategy, str]:
    """Strategy that ranks live priority if `chosen` is the scene's, and a sentence about it.

    The card traces no finer rays, so the estimator without them replaces all strategies but the paper's score.
    """
    if chosen is _PAPER or not card.estimates:
        return _PAPER, _said(_PAPER, chosen, "these weights have no estimator of errors")
    return _NO_RAY, _said(_NO_RAY, chosen, f"{chosen.title} is computed on the CPU only")


def _said(used: Strategy, chosen: Strategy, why: str) -> str:
    return f"Priority by {used.title}" if used is chosen else f"Priority by {used.title}: {why}"


class CardHeat:
    """Heatmap of a view; dropping it frees its images.

    shown: texture to draw over the view, in display colours. done: it has the view's resolution.
    """

    def __init__(self) -> None:
        self.shown: Any = None
        self.done = False
        self._wanted: tuple[Any, ...] = ()
        self._half: _Pass | None = None  # kept while the view moves, when memory grows less with Vulkan
        self._pass: _Pass | None = None
        self._seen: tuple[ReferenceType[CodedOctree], Camera, Strategy] | None = None

    def look(self, card: CardOctree, coded: CodedOctree, view: tuple[Any, ...], camera: Camera, kind: HeatKind) -> None:
        """Continue the heatmap of a view."""
        self._seen = ref(coded), camera, kind.ranked_by
        wanted = view, kind
        if wanted != self._wanted:
            self._wanted, self.done, self._pass = wanted, False, None
            half = camera.with_size(max(camera.width_px // 2, 1), max(camera.height_px // 2, 1))
            if self._half is None or not self._half.fits(card, half, kind):
                self._half = _Pass(card, half, kind)
            self._half.begin(half)
            self._half.decode(half.height_px)
            self.shown = self._half.heat()
        elif not self.done:
            if self._pass is None:
                self._pass = _Pass(card, camera, kind)
                self._pass.begin(camera)
            if self._pass.decode(_BAND_ROWS):
                self.shown, self._pass, self.done = self._pass.heat(), None, True

    def describe_pixel(self, column: int, row: int) -> list[str]:
        """Lines about a pixel of the view, computed by the engine: nothing is read back from the card."""
        if self._seen is None or (coded := self._seen[0]()) is None:
            return []
        _, camera, ranked_by = self._seen
        with suppress(EngineGoneError):
            lines: list[str] = answer(pixel_lines, coded, camera, ranked_by.name, column, row)
            return lines
        return []


class _Pass:
    """Images of a heatmap, and the number of rows decoded so far."""

    def __init__(self, card: CardOctree, camera: Camera, kind: HeatKind) -> None:
        device, size = card.device, (camera.width_px, camera.height_px)
        self.camera: CameraUnit = camera_in_unit_cube(camera, card.grid)
        self._card, self._kind, self._row = card, kind, 0
        self._hits, self._decoded = card.hit_images(self.camera), device.image(*size, FLOATS)
        self._scored = device.image(*size, FLOATS) if kind.estimated else None
        self._made = device.image(*size, FLOATS)
        colors = np.ones((_RAMP, 4), np.float32)
        colors[:, :3] = colormap(np.linspace(0, 1, _RAMP), kind.ramp)
        self._ramp = device.texture(colors.view(np.uint32))

    def fits(self, card: CardOctree, camera: Camera, kind: HeatKind) -> bool:
        """Return whether the images are those of this octree, size and kind."""
        same_size = (self.camera.width_px, self.camera.height_px) == (camera.width_px, camera.height_px)
        return self._card is card and self._kind == kind and same_size

    def begin(self, camera: Camera) -> None:
        """Trace a view, of which no row is decoded then."""
        self.camera, self._row = camera_in_unit_cube(camera, self._card.grid), 0
        self._card.trace(self.camera, self._hits)

    def decode(self, rows: int) -> bool:
        """Decode the next rows; returns whether these are the last."""
        rows = min(rows, self.camera.height_px - self._row)
        self._card.decode(self.camera, self._hits, self._decoded, (self._row, rows))
        first, self._row = max(self._row - 1, 0), self._row + rows
        done = self._row == self.camera.height_px
        if self._scored is not None:  # up to the row before the last one, whose upper neighbors may be missing
            band = first, self._row - first - (0 if done else 1)
            self._card.estimate(self.camera, self._hits, self._decoded, self._scored, band)
        return done

    def heat(self) -> Any:
        """Texture of the heatmap."""
        seen = self._decoded if self._scored is None else self._scored
        self._card.heat(self.camera, self._hits, seen, self._ramp, self._kind[:2], self._made)
        return self._made
