# SPDX-License-Identifier: GPL-3.0-or-later
"""Octrees on the graphics card: those that are there or on their way, and why the CPU draws others instead.

Blender's module `gpu` needs a window, or a context as engines and `gpu.init()` have one.
"""

from __future__ import annotations

from functools import cache
from typing import Any
from weakref import ReferenceType, WeakKeyDictionary, ref

import bpy
import numpy as np

from ...patchnet_addon.codes.coded_octree import CodedOctree
from ...patchnet_addon.octree.octree import Octree
from ...patchnet_addon.runtime.errors import EngineGoneError, PatchNetError
from ...patchnet_addon.runtime.progress import Steps
from ...patchnet_addon.runtime.quantities import bytes_text
from ..properties.preferences import VIEWPORT_AUTO, VIEWPORT_CPU, preferences
from ..scene_access.window_state import Part
from .card_octree import CardOctree
from .packing import card_bytes, code_bytes, fits_card, padded
from .shaders import BITS, FLOATS, VIEW_NUMBERS, VIEW_SIZE, WORDS, Shader

_TEXTURES = {1: "R32F", 2: "RG32F", 4: "RGBA32F"}
_KINDS = {WORDS: ("UINT_2D", np.uint32, 1), FLOATS: ("FLOAT_2D", np.float32, 4)}
_GIB = 1 << 30
_SOFTWARE = ("llvmpipe", "lavapipe", "softpipe", "swrast", "swiftshader", "software", "basic render", "gdi generic")
_UNTRIED = ("METAL",)
_CHOOSE = "Viewport Device: GPU in the preferences tries it"


class CardError(PatchNetError):
    """Refusal of the graphics card: the processor can go on."""


class BlenderDevice:
    """Graphics library, by Blender's own module."""

    def texture(self, words: np.ndarray) -> Any:
        """Texture of words (n, C) uint32; raises CardError."""
        import gpu

        full = padded(words)
        flat = full.reshape(-1).view(np.float32)
        data = gpu.types.Buffer("FLOAT", flat.size, flat)
        return self._made((full.shape[1], full.shape[0]), format=_TEXTURES[full.shape[2]], data=data)

    def image(self, width_px: int, height_px: int, kind: str) -> Any:
        """Image that shaders write, of a format of `shaders.py`; raises CardError."""
        return self._made((width_px, height_px), format=kind)

    def _made(self, size: tuple[int, int], **values: Any) -> Any:
        import gpu

        try:
            return gpu.types.GPUTexture(size, **values)
        except (RuntimeError, ValueError, MemoryError) as cause:
            raise CardError(f"{self.name} has no room for a texture of {size[0]} x {size[1]}: {cause}") from cause

    def block(self, values: np.ndarray) -> Any:
        """Uniform block of values (n,) float32."""
        import gpu

        flat = np.ascontiguousarray(values, np.float32)
        return gpu.types.GPUUniformBuf(gpu.types.Buffer("FLOAT", flat.size, flat))

    def program(self, shader: Shader) -> Any:
        """Compile a shader; raises CardError."""
        import gpu

        info = gpu.types.GPUShaderCreateInfo()
        info.typedef_source(shader.structs)
        for name, value in shader.all_defines.items():
            info.define(name, value)
        for slot, (name, struct) in enumerate(shader.blocks.items()):
            info.uniform_buf(slot, struct, name)
        for slot, name in enumerate((*shader.textures, *shader.integers)):
            info.sampler(slot, "UINT_2D" if name in shader.integers else "FLOAT_2D", name)
        for slot, (name, kind) in enumerate(shader.images.items()):
            info.image(slot, kind, _KINDS[kind][0], name, qualifiers={"WRITE"})
        info.local_group_size(*shader.group, 1)
        info.compute_source(shader.source)
        try:
            return gpu.shader.create_from_info(info)
        except Exception as cause:  # Blender raises Exception itself
            raise CardError(f"{shader.files[-1]} does not compile on {self.name}: {cause}") from cause

    def dispatch(self, program: Any, shader: Shader, bound: dict[str, Any], size: tuple[int, int]) -> None:
        """Run a shader over pixels (across, up), with textures, images and blocks by their names."""
        import gpu

        program.bind()
        for name in (*shader.textures, *shader.integers):
            program.uniform_sampler(name, bound[name])
        for name in shader.images:
            program.image(name, bound[name])
        for name in shader.blocks:
            program.uniform_block(name, bound[name])
        gpu.compute.dispatch(program, *shader.groups(size), 1)

    def read(self, image: Any, kind: str) -> np.ndarray:
        """Values (H, W) uint32 or (H, W, 4) float32 of an image; waits for what was dispatched."""
        _, dtype, channels = _KINDS[kind]
        data = image.read()
        shape = (image.height, image.width) if channels == 1 else (image.height, image.width, channels)
        data.dimensions = int(np.prod(shape))  # NumPy reads buffers of one dimension alone in 4.5
        return np.frombuffer(data, dtype).reshape(shape).copy()

    @property
    def name(self) -> str:
        """Name of the card, and the library that drives it."""
        import gpu

        return f"{gpu.platform.renderer_get()} ({gpu.platform.backend_type_get()})"


class _Card:
    """An octree on its way to the card.

    octree: once all of it is there. reason: why it will never be. chosen: preferences that it was begun with. coded:
    whether its codes can be decoded; no_codes: why they never will. steps: that bring it; codes: those that were begun,
    and the steps that bring them.
    """

    def __init__(self, octree: Octree, chosen: tuple[str, float]) -> None:
        self.octree: CardOctree | None = None
        self.reason, self.no_codes, self.coded, self.chosen = "", "", False, chosen
        self.steps = self._bring(octree)
        self.codes: tuple[ReferenceType[CodedOctree], Steps[None]] | None = None

    @property
    def coming(self) -> bool:
        """Whether the octree is on its way."""
        return self.octree is None and not self.reason

    def bring_codes(self, coded: CodedOctree) -> Steps[None]:
        """Bring codes of the octree, which is there; raises CardError."""
        assert self.octree is not None
        wanted = card_bytes(coded.octree) + code_bytes(coded)
        if wanted > self.chosen[1] * _GIB:
            raise CardError(f"Look-ahead needs {bytes_text(wanted)} of graphics memory")
        if not fits_card(coded.weights):
            raise CardError("These weights have no decoder on the graphics card")
        yield from self.octree.upload_codes(coded)
        yield from self.octree.compile("hits", "decoder", "heat", *(("estimate",) if self.octree.estimates else ()))
        self.coded = True

    def _bring(self, octree: Octree) -> Steps[None]:
        device, (viewport, gib) = BlenderDevice(), self.chosen
        if reason := _against(viewport):
            raise CardError(reason)
        if card_bytes(octree) > gib * _GIB:  # voxels alone
            octree = octree.without_pieces()
        wanted = card_bytes(octree)
        if wanted > gib * _GIB:
            raise CardError(f"the octree needs {bytes_text(wanted)} of graphics memory, {gib:g} GiB are allowed")
        if not same_bits():
            raise CardError(f"{device.name} changes bits of textures")
        card = CardOctree(device, octree)
        yield from card.upload(octree)
        yield from card.compile("picture", "film")
        self.octree = card


_cards = Part("cards", WeakKeyDictionary[Octree, _Card])


def card_of(context: bpy.types.Context, octree: Octree) -> CardOctree | None:
    """Octree on the card, None while it is on its way there, or where the CPU draws; works for a moment."""
    values = preferences(context)
    chosen = values.viewport, values.card_gib
    card = _cards().get(octree)
    if card is None or card.chosen != chosen:
        card = _cards()[octree] = _Card(octree, chosen)
    if card.coming:
        try:
            next(card.steps, None)
        except EngineGoneError:
            _cards()[octree] = _Card(octree, chosen)
        except CardError as error:
            card.reason = str(error)
    return card.octree


def codes_on_card(coded: CodedOctree) -> tuple[bool, str]:
    """Whether codes are there, too, of an octree that is on the card, and why they never will; works for a moment.

    Others than before are brought anew.
    """
    card = _cards()[coded.octree]
    if card.codes is None or card.codes[0]() is not coded:
        card.codes, card.coded, card.no_codes = (ref(coded), card.bring_codes(coded)), False, ""
    try:
        next(card.codes[1], None)
    except EngineGoneError:
        card.codes = None  # they are begun anew
    except CardError as error:
        card.no_codes = str(error)
    return card.coded, card.no_codes


def is_there(octree: Octree) -> bool:
    """Return whether an octree is on the card."""
    card = _cards().get(octree)
    return card is not None and card.octree is not None


def is_coming(octree: Octree) -> bool:
    """Return whether an octree is on its way to the card."""
    card = _cards().get(octree)
    return card is not None and card.coming


def why_cpu(octree: Octree) -> str:
    """Sentence why viewports show an octree by the CPU, empty where they do not or none has been looked at."""
    card = _cards().get(octree)
    return f"Viewport by the CPU: {card.reason}" if card is not None and card.reason else ""


def give_up(octree: Octree, reason: str) -> None:
    """Free an octree on the card, and let the CPU draw it from now on."""
    card = _cards().get(octree)
    if card is not None:
        card.octree, card.reason, card.no_codes = None, reason, reason


def free_coming() -> None:
    """Free what is on its way, which holds its octree until it is there."""
    for octree, card in list(_cards().items()):
        if card.coming or (card.codes is not None and not (card.coded or card.no_codes)):
            del _cards()[octree]


def _against(viewport: str) -> str:
    """Reason against this computer's graphics card, empty for none."""
    import gpu

    if viewport == VIEWPORT_CPU:
        return "chosen in the preferences"
    name, backend = gpu.platform.renderer_get(), gpu.platform.backend_type_get()
    if viewport == VIEWPORT_AUTO and any(word in name.lower() for word in _SOFTWARE):
        return f"{name} is no graphics card. {_CHOOSE}"
    if viewport == VIEWPORT_AUTO and backend in _UNTRIED:
        return f"it is untested with {backend.capitalize()}. {_CHOOSE}"
    return ""


@cache
def same_bits() -> bool:
    """Return whether textures give back the bits of all words: all exponents, those of no numbers, of tiny ones."""
    exponents = np.arange(512, dtype=np.uint32) << 23  # with both signs
    words = (exponents[:, None] | np.array([0, 1, 0x400001, 0x7FFFFF], np.uint32)).reshape(-1, 1)
    device, side = BlenderDevice(), len(words)
    image = device.image(side, 1, WORDS)
    view = np.zeros(VIEW_NUMBERS, np.float32)
    view.view(np.int32)[VIEW_SIZE : VIEW_SIZE + 2] = side, 1
    bound = {"words": device.texture(words), "out_bits": image, "view": device.block(view)}
    device.dispatch(device.program(BITS), BITS, bound, (side, 1))
    return np.array_equal(device.read(image, WORDS).ravel(), words.ravel())
