# SPDX-License-Identifier: GPL-3.0-or-later
"""Octree on the graphics card, and its passes; the graphics library is a `BlenderDevice`, or one of a bench."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np

from ...patchnet_addon.codes.coded_octree import CodedOctree
from ...patchnet_addon.octree.octree import Octree
from ...patchnet_addon.octree.pieces import Pieces
from ...patchnet_addon.process.computed import computed
from ...patchnet_addon.runtime.progress import Progress, Steps
from ...patchnet_addon.sampling.patchnet_plus import estimators_fit
from ...patchnet_addon.sampling.plus.weights import estimators_of
from ...patchnet_addon.tracing.camera import CameraUnit
from ...patchnet_addon.tracing.pixel_filter import PixelFilter
from .packing import (
    CODED_WORDS,
    OCTREE_WORDS,
    PIECE_WORDS,
    coded_word_count,
    estimator_block,
    film_words,
    layer_blocks,
    packed,
)
from .shaders import (
    DECODER,
    ESTIMATE,
    EXACT_PICTURE,
    FILM,
    FLOATS,
    HEAT,
    HITS,
    LAYER_BLOCKS,
    PICTURE,
    WORDS,
    Shader,
    view_block,
)

SHADERS = {"picture": PICTURE, "film": FILM, "hits": HITS, "decoder": DECODER, "estimate": ESTIMATE, "heat": HEAT}

_FINER = 1 / 8  # sides of the rays behind a patch over a pixel's, of weights that look two levels ahead


class HitImages(NamedTuple):
    """Images of the hits of a view: see `hits_main.glsl`."""

    node: Any
    entry: Any
    seen: Any


class Samples(NamedTuple):
    """Samples of all pixels of a picture, one after the other, through a pixel filter.

    places: (n, 2) in the pixels, [0, 1]^2. weights: texture of `packing.film_words`. across: pixels that a sample
    counts in. shares: (n,) of each in the mean of all up to it.
    """

    places: np.ndarray
    weights: Any
    across: int
    shares: np.ndarray

    @staticmethod
    def of(device: Any, pixel_filter: PixelFilter, places: np.ndarray) -> Samples:
        """Upload the weights of samples."""
        words, totals = film_words(pixel_filter, places)
        return Samples(places, device.texture(words), 2 * pixel_filter.radius + 1, totals / np.cumsum(totals))


class CardOctree:
    """Textures of an octree, and of its codes where they are asked for; dropping it frees them.

    nbytes: of its textures. grid: of the octree. exact: rays of pictures end on the surface where leaves have pieces.
    estimates: weights of the codes have an estimator of errors.
    """

    def __init__(self, device: Any, octree: Octree) -> None:
        """Nothing is there before `upload`, which lets go of the octree."""
        self.device, self.grid, self.nbytes = device, octree.grid, 0
        self.exact = octree.pieces is not None
        self._brightness = 1.0 / octree.exposure
        self._bright = 0 if octree.bright_nodes is None else len(octree.bright_nodes)
        self._bound: dict[str, Any] = {}
        self._programs: dict[str, tuple[Shader, Any]] = {}
        self._coded_words = self._width = 0
        self.estimates = False

    def upload(self, octree: Octree) -> Steps[None]:
        """Pack and upload one texture after the other: all that pictures need."""
        for name in OCTREE_WORDS:
            if name != "first_pieces" or self.exact:
                yield from self._add(name, octree)
        for name in PIECE_WORDS if self.exact else ():
            yield from self._add(name, octree.pieces)

    def upload_codes(self, coded: CodedOctree) -> Steps[None]:
        """Pack and upload what the decoder needs beside that; codes of weights that `packing.fits_card` has."""
        for name in CODED_WORDS:
            yield from self._add(name, coded)
        for name, values in zip(LAYER_BLOCKS, layer_blocks(coded.weights), strict=True):
            self._bound[name] = self.device.block(values)
        self._coded_words, self._width = coded_word_count(coded), coded.weights.kind.width
        self.estimates = estimators_fit(coded.weights)
        if self.estimates:
            self._bound["estimator"] = self.device.block(estimator_block(estimators_of(coded.weights)))

    def _add(self, name: str, source: Octree | Pieces | CodedOctree | None) -> Steps[None]:
        """Let the engine pack a texture, and upload it."""
        words = yield from computed(packed, source, name, at=Progress(len(self._bound), 0, "Uploading the octree"))
        before = self._bound.pop(name, None)
        self._bound[name] = self.device.texture(words)
        self.nbytes += words.nbytes if before is None else 0

    def compile(self, *names: str) -> Steps[None]:
        """Compile shaders that are not there, of SHADERS; raises PatchNetError."""
        for number, name in enumerate(name for name in names if name not in self._programs):
            yield Progress(number, len(names), "Compiling shaders")
            shader = EXACT_PICTURE if name == "picture" and self.exact else SHADERS[name]
            self._programs[name] = shader, self.device.program(shader)

    def hit_images(self, camera: CameraUnit) -> HitImages:
        """Images for the hits of a view of that size."""
        size = camera.width_px, camera.height_px
        return HitImages(*(self.device.image(*size, kind) for kind in (WORDS, FLOATS, FLOATS)))

    def trace(self, camera: CameraUnit, hits: HitImages) -> None:
        """Write the first hits of all pixels of a view."""
        bound = {f"out_{name}": image for name, image in hits._asdict().items()}
        self._run("hits", view_block(camera), bound, (camera.width_px, camera.height_px))

    def decode(self, camera: CameraUnit, hits: HitImages, decoded: Any, band: tuple[int, int] | None = None) -> None:
        """Write coverage, luminance, whether there is look-ahead, and the score of hits' pixels into an image.

        band: first row and number of rows; all of them where it is None.
        """
        first, rows = (0, camera.height_px) if band is None else band
        bound = {f"hit_{name}": image for name, image in hits._asdict().items()} | {"out_decoded": decoded}
        view = view_block(camera, decoder=(self._width, self._coded_words), first_row=first)
        self._run("decoder", view, bound, (camera.width_px, rows))

    def estimate(
        self, camera: CameraUnit, hits: HitImages, decoded: Any, scored: Any, band: tuple[int, int] | None = None
    ) -> None:
        """Copy what is decoded into another image, with the error to be expected as score; only where it `estimates`.

        band: as in `decode`; rows beside it must be decoded, too.
        """
        first, rows = (0, camera.height_px) if band is None else band
        bound = {f"hit_{name}": image for name, image in hits._asdict().items()}
        bound |= {"decoded": decoded, "out_scored": scored}
        self._run("estimate", view_block(camera, first_row=first), bound, (camera.width_px, rows))

    def draw(
        self,
        camera: CameraUnit,
        images: tuple[Any, Any, Any],
        world: tuple[Any, int],
        samples: Samples,
        number: int,
        footprint: float = 1.0,
    ) -> None:
        """Write the mean of a sample, by its number, and of those before it in each pixel.

        images: of the sample, of the mean before, and of that which is written. world: texture of
        `packing.world_words` and the side of its faces. footprint: of a ray on textures over that on voxels.
        """
        seen, before, mean = images
        size = camera.width_px, camera.height_px
        x, y = samples.places[number]
        view = view_block(
            camera,
            bright=self._bright,
            brightness=self._brightness,
            world_side=world[1],
            sample=(number, (float(x), float(y))),
            film=(samples.across, float(samples.shares[number])),
            footprint=footprint,
        )
        self._run("picture", view, {"out_sample": seen, "world": world[0]}, size)
        self._run("film", view, {"seen": seen, "before": before, "weights": samples.weights, "out_mean": mean}, size)

    def heat(
        self, camera: CameraUnit, hits: HitImages, decoded: Any, ramp: Any, kind: tuple[int, float], heat: Any
    ) -> None:
        """Write a heatmap of a view that is decoded, as a screen shows it, into an image.

        ramp: texture of 256 colours. kind: 1 priority, 2 coverage, 3 predicted luminance, 4 level; value at its end.
        """
        view = view_block(camera, heat=kind, brightness=_FINER)
        bound = {"hit_node": hits.node, "hit_seen": hits.seen, "decoded": decoded, "ramp": ramp, "out_heat": heat}
        self._run("heat", view, bound, (camera.width_px, camera.height_px))

    def _run(self, name: str, view: np.ndarray, bound: dict[str, Any], size: tuple[int, int]) -> None:
        shader, program = self._programs[name]
        bound = self._bound | bound | {"view": self.device.block(view)}
        self.device.dispatch(program, shader, bound, size)
