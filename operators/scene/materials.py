# SPDX-License-Identifier: GPL-3.0-or-later
"""Material reader: the view-independent part of Blender materials, that is base colour, opacity and emission."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import TypeVar

import bpy
import numpy as np

from ...patchnet_addon.surface.mesh import Material, Texture
from ..scene_access.blender_version import tree_in_use
from .images import ImageReader
from .node_links import Input, Output, source
from .node_terms import ColorTerm, NotUnderstoodError, NumberTerm, Rgb
from .node_values import NodeValues

_DEFAULT_COLOR: Rgb = (0.8, 0.8, 0.8)
_BLACK: Rgb = (0.0, 0.0, 0.0)
_Term = TypeVar("_Term", ColorTerm, NumberTerm)
_MAX_EMISSION = 1e6  # W/m2; more can only be a mistake


@dataclass(frozen=True)
class _Surface:
    """Surface that a shader socket shows; `transparent` surfaces show nothing of their own."""

    base: ColorTerm = ColorTerm(_BLACK)  # noqa: RUF009
    alpha: NumberTerm = NumberTerm(1.0)  # noqa: RUF009
    emission: Rgb = _BLACK
    transparent: bool = False


def read_material(material: bpy.types.Material, images: ImageReader) -> tuple[Material, str | None]:
    """Read the view-independent part of a material, and one sentence if something in it had to be simplified.

    What is not understood takes its default value: base colour 0.8, opaque, no emission.
    """
    name = material.name
    tree = tree_in_use(material)
    if tree is None:
        r, g, b, alpha = material.diffuse_color
        return Material(name, base_color=(r, g, b), alpha=alpha), None
    walk = _Walk(NodeValues(images))
    output = _output(tree)
    only_volume = output is not None and output.inputs["Volume"].is_linked and not output.inputs["Surface"].is_linked
    if output is None or only_volume:  # a mist box is no wall
        surface = _Surface(transparent=True, alpha=NumberTerm(0.0))
    else:
        surface = walk.surface(Input(output.inputs["Surface"]))
        if material.displacement_method != "BUMP" and output.inputs["Displacement"].is_linked:
            walk.values.notes.append("its displacement moves no voxels, unlike a Displace modifier")
    result = _material(name, surface, images)
    notes = list(dict.fromkeys(walk.values.notes))
    return result, f"Material '{name}' is simplified: {'; '.join(notes)}" if notes else None


def _output(tree: bpy.types.NodeTree) -> bpy.types.Node | None:
    return tree.get_output_node("CYCLES") or tree.get_output_node("ALL")


def _material(name: str, surface: _Surface, images: ImageReader) -> Material:
    alpha, base = surface.alpha, surface.base
    threshold = alpha.threshold
    opacity = alpha.offset
    texture = None
    if not alpha.constant:
        assert alpha.texture is not None
        pixels = images.channel(alpha.texture.image, alpha.channel)
        opacity = 1.0
        if (alpha.scale, alpha.offset) != (1.0, 0.0):
            pixels = np.clip(pixels * np.float32(alpha.scale) + np.float32(alpha.offset), 0.0, 1.0)
        texture = Texture(alpha.texture.image.name, pixels, alpha.texture.wrap, alpha.texture.transform)
    base_texture = None
    if base.texture is not None:
        pixels = images.color(base.texture.image)
        base_texture = Texture(base.texture.image.name, pixels, base.texture.wrap, base.texture.transform)
    return Material(
        name=name,
        base_color=base.factor,
        base_texture=base_texture,
        alpha=min(max(opacity, 0.0), 1.0),
        alpha_texture=texture,
        alpha_threshold=None if alpha.constant else threshold,
        emission=surface.emission,
    )


class _Walk:
    """Walk along shaders from the material's output towards the BSDFs."""

    def __init__(self, values: NodeValues) -> None:
        self.values = values

    def surface(self, at: Input) -> _Surface:
        """Evaluate a shader input to what it shows; unlinked it is black."""
        found = source(at)
        if isinstance(found, Input):
            return _Surface()
        node = found.node
        if node.type == "BSDF_PRINCIPLED":
            return self._principled(found)
        if node.type == "EMISSION":
            return _Surface(emission=self._emission(found, "Color", "Strength"))
        if node.type in ("BSDF_TRANSPARENT", "HOLDOUT"):
            return _Surface(alpha=NumberTerm(0.0), transparent=True)
        if node.type == "MIX_SHADER":
            return self._mix(found)
        if node.type == "ADD_SHADER":
            return self._add(self.surface(found.input(0)), self.surface(found.input(1)))
        if "Color" in node.inputs:  # diffuse, glossy, sheen, translucent, glass, ...
            return _Surface(base=self._base(found.input("Color")))
        if "Base Color" in node.inputs:
            return _Surface(base=self._base(found.input("Base Color")))
        self.values.notes.append(f"shader '{node.name}' is taken as gray")
        return _Surface(base=ColorTerm(_DEFAULT_COLOR))

    def _principled(self, output: Output) -> _Surface:
        return _Surface(
            base=self._base(output.input("Base Color")),
            alpha=self._number(output.input("Alpha"), "opacity", 1.0),
            emission=self._emission(output, "Emission Color", "Emission Strength"),
        )

    def _base(self, at: Input) -> ColorTerm:
        return self._understood(lambda: self.values.color(at), "its base color", ColorTerm(_DEFAULT_COLOR))

    def _number(self, at: Input, what: str, default: float) -> NumberTerm:
        return self._understood(lambda: self.values.number(at), f"its {what}", NumberTerm(default))

    def _emission(self, output: Output, color: str, strength: str) -> Rgb:
        factor = self._number(output.input(strength), "emission strength", 1.0)
        if not factor.constant:
            self.values.notes.append("the texture of its emission strength is left out")
            factor = NumberTerm(factor.offset + 0.5 * factor.scale)
        if factor.offset <= 0.0:
            return _BLACK
        term = self._understood(lambda: self.values.color(output.input(color)), "its emission color", ColorTerm())
        if term.texture is not None:
            self.values.notes.append("the texture of its emission counts by its mean color")
        r, g, b = (min(max(each * factor.offset, 0.0), _MAX_EMISSION) for each in self.values.constant_color(term))
        return r, g, b

    def _understood(self, read: Callable[[], _Term], what: str, default: _Term) -> _Term:
        try:
            return read()
        except NotUnderstoodError as cause:
            self.values.notes.append(f"{what} depends on {cause}, so that the default value counts")
            return default

    def _mix(self, output: Output) -> _Surface:
        factor = self._number(output.input(0), "shader mix", 0.5)
        first, second = self.surface(output.input(1)), self.surface(output.input(2))
        if factor.constant and factor.offset <= 0.0:
            return first
        if factor.constant and factor.offset >= 1.0:
            return second
        if first.transparent and second.transparent:
            return first
        if first.transparent:
            return replace(second, alpha=self._alpha(second.alpha, factor))
        if second.transparent:
            return replace(first, alpha=self._alpha(first.alpha, factor.affine(-1.0, 1.0)))
        if not factor.constant:
            self.values.notes.append("the texture that mixes its shaders is left out")
        return self._blend(first, second, factor.offset if factor.constant else 0.5)

    def _alpha(self, alpha: NumberTerm, factor: NumberTerm) -> NumberTerm:
        if alpha.constant and alpha.offset == 1.0:
            return factor
        if factor.constant:
            alpha, factor = factor, alpha
        if not alpha.constant:
            self.values.notes.append("one of the two textures of its opacity is left out")
            return factor
        return factor.affine(alpha.offset, 0.0) if factor.threshold is None else factor

    def _blend(self, first: _Surface, second: _Surface, weight: float) -> _Surface:
        """Blend two surfaces with constant weights; of two textures the heavier one stays."""
        r, g, b = (a + weight * (c - a) for a, c in zip(first.emission, second.emission, strict=True))
        if first.base.texture is None and second.base.texture is None:
            x, y, z = (a + weight * (c - a) for a, c in zip(first.base.factor, second.base.factor, strict=True))
            base = ColorTerm((x, y, z))
        else:
            heavy, light, share = (first, second, 1 - weight) if weight < 0.5 else (second, first, weight)
            base = heavy.base
            if light.base.factor == _BLACK:
                base = base.scaled((share,) * 3)
            else:
                self.values.notes.append("the lesser of its mixed shaders is left out")
        return replace(first if weight < 0.5 else second, base=base, emission=(r, g, b))

    def _add(self, first: _Surface, second: _Surface) -> _Surface:
        """Add two surfaces in full."""
        r, g, b = (a + c for a, c in zip(first.emission, second.emission, strict=True))
        if first.transparent:
            return replace(second, emission=(r, g, b))
        if second.transparent:
            return replace(first, emission=(r, g, b))
        lesser, base = (first, second.base) if first.base.factor == _BLACK else (second, first.base)
        if lesser.base.factor != _BLACK:
            if lesser.base.texture is None and base.texture is None:
                x, y, z = (a + c for a, c in zip(base.factor, lesser.base.factor, strict=True))
                base = ColorTerm((x, y, z))
            else:
                self.values.notes.append("one of its added shaders is left out")
        return replace(first, base=base, emission=(r, g, b))
