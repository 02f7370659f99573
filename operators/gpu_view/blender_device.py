# SPDX-License-Identifier: GPL-3.0-or-later
"""Graphics card by Blender's module `gpu`, which needs a window, or a context as engines and `gpu.init()` have one."""

from __future__ import annotations

from typing import Any

import numpy as np

from ...patchnet_addon.runtime.errors import PatchNetError
from .packing import padded
from .shaders import FLOATS, WORDS, Shader

_TEXTURES = {1: "R32F", 2: "RG32F", 4: "RGBA32F"}
_KINDS = {WORDS: ("UINT_2D", np.uint32, 1), FLOATS: ("FLOAT_2D", np.float32, 4)}


class CardError(PatchNetError):
    """Refusal of the graphics card: the processor can go on."""


class BlenderDevice:
    """`Device` by Blender's own module."""

    def texture(self, words: np.ndarray) -> Any:
        """Texture of words (n, C) uint32; raises CardError."""
        import gpu

        full = padded(words)
        flat = full.reshape(-1).view(np.float32)
        data = gpu.types.Buffer("FLOAT", flat.size, flat)
        return self._made((full.shape[1], full.shape[0]), format=_TEXTURES[full.shape[2]], data=data)

    def image(self, width_px: int, height_px: int, kind: str) -> Any:
        """Image that shaders write; raises CardError."""
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
        """Run a shader over pixels (across, up)."""
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
        """Values (H, W) uint32 or (H, W, 4) float32 of an image."""
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

    @property
    def max_side_px(self) -> int:
        """Longest side of a texture."""
        import gpu

        return int(gpu.capabilities.max_texture_size_get())
