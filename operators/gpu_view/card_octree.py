# SPDX-License-Identifier: GPL-3.0-or-later
"""Octree on the graphics card, and its passes; the graphics library is a `Device`: Blender's, or one of a bench."""

from __future__ import annotations

from itertools import chain
from typing import Any, NamedTuple, Protocol

import numpy as np

from ...patchnet_addon.codes.coded_octree import CodedOctree
from ...patchnet_addon.octree.octree import Octree
from ...patchnet_addon.runtime.progress import Progress, Steps
from ...patchnet_addon.tracing.camera import CameraUnit
from .packing import coded_word_count, coded_words, layer_blocks, octree_words, rank_words
from .shaders import CENTRE, FLOATS, HITS, LAYER_BLOCKS, PICTURE, WORDS, Shader, decoder, view_block


class Device(Protocol):
    """Graphics library."""

    def texture(self, words: np.ndarray) -> Any:
        """Texture of words (n, C) uint32."""

    def image(self, width_px: int, height_px: int, kind: str) -> Any:
        """Image that shaders write, of a format of `shaders.py`."""

    def block(self, values: np.ndarray) -> Any:
        """Uniform block of values (n,) float32."""

    def program(self, shader: Shader) -> Any:
        """Compile a shader; raises PatchNetError with the compiler's words."""

    def dispatch(self, program: Any, shader: Shader, bound: dict[str, Any], size: tuple[int, int]) -> None:
        """Run a thread for each of size (across, up), with textures, images and blocks by their names."""

    def read(self, image: Any, kind: str) -> np.ndarray:
        """Values (H, W) uint32 or (H, W, 4) float32 of an image; waits for what was dispatched."""


class HitImages(NamedTuple):
    """Images of the hits of a view: see `hits_main.glsl`."""

    node: Any
    entry: Any
    seen: Any


class CardOctree:
    """Textures of an octree, and of its codes where there are any; dropping it frees them."""

    def __init__(self, device: Device, octree: Octree, coded: CodedOctree | None = None) -> None:
        """Prepare `upload`, which has to run first; coded: only of weights that `packing.fits_card` has."""
        self.device, self.octree, self.nbytes = device, octree, 0
        self._coded = coded
        self._bound: dict[str, Any] = {}
        self._programs: dict[str, tuple[Shader, Any]] = {}
        self.bright = 0 if octree.bright_nodes is None else len(octree.bright_nodes)
        self.width = coded.weights.kind.width if coded is not None else 0

    def upload(self) -> Steps[None]:
        """Bring one texture after the other onto the card."""
        octree, coded = self.octree, self._coded
        textures = [octree_words(octree), [("ranks", rank_words(octree, coded))]]
        for name, words in chain(*textures, coded_words(coded) if coded is not None else ()):
            self._bound[name] = self.device.texture(words)
            self.nbytes += words.nbytes
            yield Progress(len(self._bound), 0, "Uploading the octree")
        if coded is not None:
            for name, values in zip(LAYER_BLOCKS, layer_blocks(coded.weights), strict=True):
                self._bound[name] = self.device.block(values)

    def compile(self) -> Steps[None]:
        """Compile one shader after the other; raises PatchNetError."""
        shaders = {"picture": PICTURE, "hits": HITS}
        if self._coded is not None:
            shaders["decoder"] = decoder(coded_word_count(self._coded))
        for number, (name, shader) in enumerate(shaders.items()):
            self._programs[name] = shader, self.device.program(shader)
            yield Progress(number + 1, len(shaders), "Compiling shaders")

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
        view = view_block(camera, width=self.width, first_row=first)
        self._run("decoder", view, bound, (camera.width_px, rows))

    def draw(
        self,
        camera: CameraUnit,
        means: tuple[Any, Any],
        world: tuple[Any, int],
        samples: int = 0,
        jitter: tuple[float, float] = CENTRE,
    ) -> None:
        """Write the mean of one more sample in each pixel and of those before it.

        means: images, that of the samples before, and that which is written. world: texture of `packing.world_words`
        and the side of its faces. samples: before this one. jitter: place in the pixel, [0, 1]^2.
        """
        view = view_block(camera, bright=self.bright, world_side=world[1], samples=samples, jitter=jitter)
        bound = {"before": means[0], "out_mean": means[1], "world": world[0]}
        self._run("picture", view, bound, (camera.width_px, camera.height_px))

    def _run(self, name: str, view: np.ndarray, bound: dict[str, Any], size: tuple[int, int]) -> None:
        shader, program = self._programs[name]
        bound = self._bound | bound | {"view": self.device.block(view)}
        self.device.dispatch(program, shader, bound, size)
