# SPDX-License-Identifier: GPL-3.0-or-later
"""Graphics card through EGL and OpenGL 4.3, without Blender or a window (https://pypi.org/project/moderngl)."""

from __future__ import annotations

from typing import Any

import numpy as np

from ....operators.gpu_view.packing import padded
from ....operators.gpu_view.shaders import WORDS, Shader
from ....patchnet_addon.runtime.errors import PatchNetError
from .inputs import imported

_VERSION = 430  # OpenGL version times 100
_EGL: dict[str, Any] = {"backend": "egl"}
_FORMATS = {WORDS: ("r32ui", "uimage2D", 1, "u4"), "RGBA32F": ("rgba32f", "image2D", 4, "f4")}


class EglDevice:
    """`BlenderDevice` by moderngl, for Blender's shaders; raises PatchNetError without OpenGL 4.3."""

    def __init__(self) -> None:
        moderngl = imported("moderngl", "moderngl", "patchnet-blender[bench]")
        try:
            self._context = moderngl.create_context(require=_VERSION, standalone=True, **_EGL)
        except Exception as cause:  # moderngl raises Exception itself
            raise PatchNetError(f"EGL has no OpenGL 4.3 here ({cause}): install a driver with EGL") from cause
        self._nearest = self._context.NEAREST, self._context.NEAREST
        self.name = str(self._context.info["GL_RENDERER"])
        self.version = str(self._context.info["GL_VERSION"])

    def texture(self, words: np.ndarray) -> Any:
        """Texture of words (n, C) uint32."""
        full = padded(words)
        made = self._context.texture((full.shape[1], full.shape[0]), full.shape[2], full.tobytes(), dtype="f4")
        made.filter = self._nearest
        return made

    def image(self, width_px: int, height_px: int, kind: str) -> Any:
        """Image for shader output."""
        _, _, channels, dtype = _FORMATS[kind]
        made = self._context.texture((width_px, height_px), channels, dtype=dtype)
        made.filter = self._nearest
        return made

    def block(self, values: np.ndarray) -> Any:
        """Uniform block of values (n,) float32."""
        return self._context.buffer(np.ascontiguousarray(values, np.float32).tobytes())

    def program(self, shader: Shader) -> Any:
        """Compile a shader; raises PatchNetError."""
        try:
            return self._context.compute_shader(_whole(shader))
        except Exception as cause:  # moderngl raises Exception itself
            raise PatchNetError(f"{shader.files[-1]} does not compile on {self.name}: {cause}") from cause

    def dispatch(self, program: Any, shader: Shader, bound: dict[str, Any], size: tuple[int, int]) -> None:
        """Run a shader over pixels (across, up)."""
        for slot, name in enumerate((*shader.textures, *shader.integers)):
            bound[name].use(slot)
        for slot, name in enumerate(shader.images):
            bound[name].bind_to_image(slot, read=False, write=True)
        for slot, name in enumerate(shader.blocks):
            bound[name].bind_to_uniform_block(slot)
        program.run(*shader.groups(size))
        self._context.memory_barrier()

    def read(self, image: Any, kind: str) -> np.ndarray:
        """Values (H, W) uint32 or (H, W, 4) float32 of an image."""
        _, _, channels, dtype = _FORMATS[kind]
        values = np.frombuffer(image.read(), f"<{dtype}")
        shape = (image.height, image.width) if channels == 1 else (image.height, image.width, channels)
        return values.reshape(shape)

    def finish(self) -> None:
        """Wait for all dispatched work."""
        self._context.finish()


def _whole(shader: Shader) -> str:
    """Source of a shader with the declarations that Blender generates."""
    lines = [f"#define {name} {value}" for name, value in shader.all_defines.items()]
    lines.append(f"layout(local_size_x = {shader.group[0]}, local_size_y = {shader.group[1]}) in;")
    lines.append(shader.structs)
    for slot, (name, struct) in enumerate(shader.blocks.items()):
        lines.append(f"layout(std140, binding = {slot}) uniform {name}_block {{ {struct} {name}; }};")
    for slot, name in enumerate((*shader.textures, *shader.integers)):
        kind = "usampler2D" if name in shader.integers else "sampler2D"
        lines.append(f"layout(binding = {slot}) uniform {kind} {name};")
    for slot, (name, kind) in enumerate(shader.images.items()):
        layout, image, _, _ = _FORMATS[kind]
        lines.append(f"layout(binding = {slot}, {layout}) uniform writeonly {image} {name};")
    return f"#version {_VERSION}\n" + "\n".join(lines) + "\n" + shader.source
