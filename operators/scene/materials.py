# SPDX-License-Identifier: GPL-3.0-or-later
"""Material reader: the view-independent part of Blender materials, that is base colour, opacity and emission."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import NamedTuple, TypeVar

import bpy
import numpy as np

from ...patchnet_addon.surface.gloss import Gloss
from ...patchnet_addon.surface.mesh import Material, Texture
from ..scene_access.blender_version import tree_in_use
from .gloss import DIFFUSE, gloss_of
from .images import ImageReader
from .node_terms import CUT_OUT, ColorTerm, Input, NotUnderstoodError, NumberTerm, Output, Rgb, TextureUse, source
from .node_values import NodeValues

_CLEAR = NumberTerm(0.0)
_DEFAULT_COLOR: Rgb = (0.8, 0.8, 0.8)
_BLACK: Rgb = (0.0, 0.0, 0.0)
_GLOW_IS_MEAN = "the texture of its emission counts by its mean color"
_Term = TypeVar("_Term", ColorTerm, NumberTerm)
_MAX_EMISSION = 1e6  # W/m2; larger values are clamped as mistakes
_HALF = 0.5  # least opacity of a solid surface
_PARTLY, _MUCH = (0.1, 0.9), 0.25  # partly transparent opacities, and the least share of such texels for a note


@dataclass(frozen=True)
class _Surface:
    """Surface of a shader socket: opacity as Cycles' alpha; colours are those of the opaque part.

    glow: emission from a texture, of which `emission` is the mean; None without one, and where shaders are blended.
    """

    base: ColorTerm = ColorTerm(_BLACK)  # noqa: RUF009
    alpha: NumberTerm = NumberTerm(1.0)  # noqa: RUF009
    emission: Rgb = _BLACK
    glow: ColorTerm | None = None
    gloss: Gloss = Gloss()  # noqa: RUF009


class MaterialReading(NamedTuple):
    """Material, and one sentence each on simplifications of its shape and opacity, and of its colours; its gloss.

    A bake takes its colours from Cycles, so `color_note` is for surfaces shown in their own colour.
    """

    material: Material
    note: str | None = None
    color_note: str | None = None
    gloss: Gloss = Gloss()


def read_material(material: bpy.types.Material, images: ImageReader) -> MaterialReading:
    """Read the view-independent part of a material.

    Inputs with unsupported nodes take default values: base colour 0.8, opaque, no emission. A material without an
    output for Cycles is black, as in Cycles.
    """
    name = material.name
    tree = tree_in_use(material)
    if tree is None:
        r, g, b, _ = material.diffuse_color  # its alpha is for viewports
        return MaterialReading(Material(name, base_color=(r, g, b)), gloss=DIFFUSE)
    output = tree.get_output_node("CYCLES") or tree.get_output_node("ALL")
    if output is None:
        note = f"Material '{name}' is black, as in Cycles: no Material Output has Target Cycles or All"
        return MaterialReading(Material(name, base_color=_BLACK), note)
    walk, clear_side = _Walk(images), None
    if output.inputs["Volume"].is_linked:
        walk.values.notes.append("its volume is left out (Refine with Cycles, Passes: Combined renders it)")
    if output.inputs["Volume"].is_linked and not output.inputs["Surface"].is_linked:  # only a volume: no surface
        surface = _Surface(alpha=_CLEAR)
    else:
        surface, clear_side = walk.sides(Input(output.inputs["Surface"]))
        if material.displacement_method != "BUMP" and output.inputs["Displacement"].is_linked:
            walk.values.notes.append("its displacement is left out, unlike that of a Displace modifier")
    glow = surface.glow if surface.base == ColorTerm(_BLACK) else None
    if glow is not None:  # its light is in proportion to the texture, as that of other surfaces to their base color
        surface = replace(surface, base=glow)
    elif surface.glow is not None:
        walk.colors.notes.append(_GLOW_IS_MEAN)
    result = replace(_material(name, surface, walk.colors), glows=glow is not None)
    result = replace(result, base_is_known=not walk.colors.notes, clear_side=clear_side)
    gloss = replace(surface.gloss, shines=max(surface.emission) > 0.0)
    return MaterialReading(result, _simplified(name, walk.values.notes), _simplified(name, walk.colors.notes), gloss)


def _simplified(name: str, notes: list[str]) -> str | None:
    return f"Material '{name}' is simplified: {'; '.join(dict.fromkeys(notes))}" if notes else None


def is_partly_transparent(material: Material) -> bool:
    """Return whether much of a material is partly transparent, more than the soft edges of cut-outs."""
    if material.alpha_threshold is not None:
        return False
    low, high = _PARTLY
    if material.alpha_texture is None:
        own = material.base_texture is not None or max(*material.base_color, *material.emission) > 0.0
        return low < material.alpha < high or (material.alpha == 0.0 and own)  # light is added to what is behind
    alpha = material.alpha * material.alpha_texture.pixels
    partly = np.count_nonzero((alpha > low) & (alpha < high))
    return bool(partly > _MUCH * max(np.count_nonzero(alpha > low), 1))


def at_least_half_opaque(material: Material) -> Material:
    """Leave out what is less than half opaque, as voxels are there or not, and harden soft edges of cut-outs."""
    texture = material.alpha_texture
    if material.alpha_threshold is not None:
        return material
    if texture is None:
        return material if material.alpha >= _HALF else replace(material, alpha=0.0)
    if not is_partly_transparent(material):
        return replace(material, alpha_threshold=_HALF)
    kept = np.where(material.alpha * texture.pixels >= _HALF, texture.pixels, np.float32(0.0))
    return replace(material, alpha_texture=replace(texture, pixels=kept))


def _material(name: str, surface: _Surface, colors: NodeValues) -> Material:
    alpha, base, images = surface.alpha, surface.base, colors.images
    maps = {term.texture.uv_map for term in (alpha, base) if term.texture} - {""}  # "" is nearly always the same map
    of_layer = alpha.texture is not None and alpha.texture.image is None
    if base.texture and alpha.texture and (len(maps) > 1 or of_layer):
        why = "since the opacity uses another UV map or attribute"
        colors.notes.append(f"image '{base.texture.name}' counts by its mean color, {why}")
        base, maps = ColorTerm(colors.constant_color(base)), {alpha.texture.uv_map}
    threshold = alpha.threshold
    opacity = alpha.offset
    texture = None
    if not alpha.constant:
        assert alpha.texture is not None
        pixels = images.channel(alpha.texture, alpha.channel)
        opacity = 1.0
        if (alpha.scale, alpha.offset) != (1.0, 0.0):
            pixels = np.clip(pixels * np.float32(alpha.scale) + np.float32(alpha.offset), 0.0, 1.0)
        if threshold is not None and alpha.levels != CUT_OUT:
            low, high = np.clip(np.array(alpha.levels, np.float32), 0.0, 1.0)
            pixels, threshold = np.where(pixels >= threshold, high, low), None
        texture = _texture(alpha.texture, pixels, images)
    base_texture = None
    if base.texture is not None:
        base_texture = _texture(base.texture, images.color(base.texture), images)
    return Material(
        name=name,
        base_color=base.factor,
        base_texture=base_texture,
        alpha=min(max(opacity, 0.0), 1.0),
        alpha_texture=texture,
        alpha_threshold=None if alpha.constant else threshold,
        emission=surface.emission,
        uv_map=next(iter(maps), ""),
        uv_channel=alpha.channel if of_layer else "",
    )


def _texture(use: TextureUse, pixels: np.ndarray, images: ImageReader) -> Texture:
    """Texture of an image's pixels (H, W, C), or of a layer's."""
    squares = (pixels.shape[1], pixels.shape[0]) if use.closest else None
    return Texture(use.name, images.squares(pixels) if use.closest else pixels, use.wrap, use.transform, squares)


class _Walk:
    """Walk along shaders from the material's output towards the BSDFs.

    values: evaluates opacity and mix factors of shaders. colors: base colour and emission. Each has its own notes,
    gloss has none.
    """

    def __init__(self, images: ImageReader, is_back: bool = False) -> None:
        self.values, self.colors, self._silent = (NodeValues(images, is_back) for _ in range(3))

    def sides(self, at: Input) -> tuple[_Surface, int | None]:
        """Evaluate the surface of a shader input, and the side that is see-through if the other is not: 1 is the back.

        Two visible sides count as the front.
        """
        front = self.surface(at)
        if not (self.values.asks_side or self.colors.asks_side):
            return front, None
        back = _Walk(self.values.images, is_back=True).surface(at)
        clear = [side.alpha.constant and side.alpha.offset < _HALF for side in (front, back)]
        if clear[0] != clear[1]:
            self.values.notes.append("its see-through side is solid in previews and on the graphics card")
            return (front, 1) if clear[1] else (back, 0)
        if front.alpha != back.alpha:
            self.values.notes.append("the opacity of its backs counts as that of its fronts")
        if front.base != back.base:
            self.colors.notes.append("the color of its backs counts as that of its fronts")
        return front, None

    def surface(self, at: Input) -> _Surface:
        """Evaluate the surface of a shader input; unlinked it is black."""
        found = source(at)
        if isinstance(found, Input):
            return _Surface()
        if found.node.type in ("MIX_SHADER", "ADD_SHADER"):
            return self._mix(found) if found.node.type == "MIX_SHADER" else self._add(found)
        return replace(self._shader(found), gloss=gloss_of(found, self._silent))

    def _shader(self, found: Output) -> _Surface:
        node = found.node
        if node.type == "BSDF_PRINCIPLED":
            return self._principled(found)
        if node.type == "EMISSION":
            emission, glow = self._emission(found, "Color", "Strength")
            return _Surface(emission=emission, glow=glow)
        if node.type == "HOLDOUT":
            return _Surface(alpha=_CLEAR)
        if node.type == "BSDF_TRANSPARENT":
            return _Surface(alpha=self._closed(found.input("Color")))
        if "Color" in node.inputs:  # diffuse, glossy, sheen, translucent, glass, ...
            return _Surface(base=self._base(found.input("Color")))
        if "Base Color" in node.inputs:
            return _Surface(base=self._base(found.input("Base Color")))
        if node.bl_idname == "NodeUndefined":
            self.values.notes.append(f"node '{node.name}' belongs to a missing add-on and is black, as in Cycles")
            return _Surface()
        self.colors.notes.append(f"shader '{node.name}' is not supported and counts as gray")
        return _Surface(base=ColorTerm(_DEFAULT_COLOR))

    def _closed(self, at: Input) -> NumberTerm:
        """Opacity of a Transparent shader of that colour."""
        values = self.values
        color = _understood(values, lambda: values.color(at), "its transparency", ColorTerm())
        passed = min(max(sum(color.factor) / 3.0, 0.0), 1.0)
        return NumberTerm(1.0, -passed, color.texture, "MEAN") if color.texture else NumberTerm(1.0 - passed)

    def _principled(self, output: Output) -> _Surface:
        alpha = self._number(self.values, output.input("Alpha"), "opacity", 1.0)
        if alpha.constant and alpha.offset <= 0.0:
            return _Surface(alpha=_CLEAR)
        emission, glow = self._emission(output, "Emission Color", "Emission Strength")
        return _Surface(self._base(output.input("Base Color")), alpha, emission, glow)

    def _base(self, at: Input) -> ColorTerm:
        return _understood(self.colors, lambda: self.colors.color(at), "its base color", ColorTerm(_DEFAULT_COLOR))

    def _number(self, values: NodeValues, at: Input, what: str, default: float) -> NumberTerm:
        return _understood(values, lambda: values.number(at), f"its {what}", NumberTerm(default))

    def _emission(self, output: Output, color: str, strength: str) -> tuple[Rgb, ColorTerm | None]:
        """Mean emission, and the term of one from a texture."""
        factor = self._number(self.colors, output.input(strength), "emission strength", 1.0)
        if not factor.constant:
            self.colors.notes.append("the texture of its emission strength is left out")
            factor = NumberTerm(factor.middle)
        if factor.offset <= 0.0:
            return _BLACK, None
        colors = self.colors
        term = _understood(colors, lambda: colors.color(output.input(color)), "its emission color", ColorTerm())
        r, g, b = (min(max(each * factor.offset, 0.0), _MAX_EMISSION) for each in colors.constant_color(term))
        return (r, g, b), None if term.texture is None else term.scaled((factor.offset,) * 3)

    def _mix(self, output: Output) -> _Surface:
        first, second = self.surface(output.input(1)), self.surface(output.input(2))
        values = self.colors if first.alpha == second.alpha else self.values
        factor = self._number(values, output.input(0), "shader mix", 0.5)
        weight = min(max(factor.middle, 0.0), 1.0)
        if factor.constant and weight in (0.0, 1.0):
            return second if weight else first
        one, two = (1.0 - weight) * first.alpha.middle, weight * second.alpha.middle
        if one > 0.0 < two and first.base != second.base and not (factor.constant and first.alpha == second.alpha):
            self.colors.notes.append("the texture that mixes its shaders is left out")
        surface = self._blend(first, second, two / (one + two) if one + two > 0.0 else weight)
        gloss = first.gloss.mixed(second.gloss, weight)
        return replace(surface, alpha=self._alpha(first.alpha, second.alpha, factor), gloss=gloss)

    def _alpha(self, first: NumberTerm, second: NumberTerm, factor: NumberTerm) -> NumberTerm:
        try:
            return first.mixed(second, factor)
        except NotUnderstoodError:
            self.values.notes.append("one of the two textures of its opacity is left out")
        if factor.constant:
            return second if factor.offset > 0.5 else first
        one, two = (each if each.constant else NumberTerm(1.0) for each in (first, second))
        return one.mixed(two, factor)

    def _blend(self, first: _Surface, second: _Surface, weight: float) -> _Surface:
        """Blend colours with constant weights; of two textures, that of the larger weight is kept."""
        r, g, b = (a + weight * (c - a) for a, c in zip(first.emission, second.emission, strict=True))
        if first.base == second.base or weight in (0.0, 1.0):
            base = second.base if weight else first.base
        elif first.base.texture is None and second.base.texture is None:
            x, y, z = (a + weight * (c - a) for a, c in zip(first.base.factor, second.base.factor, strict=True))
            base = ColorTerm((x, y, z))
        else:
            heavy, light, share = (first, second, 1 - weight) if weight < 0.5 else (second, first, weight)
            base = heavy.base
            if light.base.factor == _BLACK:
                base = base.scaled((share,) * 3)
            else:
                self.colors.notes.append("the mixed shader of the smaller weight is left out")
        glow = first.glow if weight == 0.0 else second.glow if weight == 1.0 else None
        if glow is None and (first.glow or second.glow):
            self.colors.notes.append(_GLOW_IS_MEAN)
        return _Surface(base=base, emission=(r, g, b), glow=glow)

    def _add(self, output: Output) -> _Surface:
        """Add two surfaces, each with weight 1, and what both let through."""
        first, second = self.surface(output.input(0)), self.surface(output.input(1))
        half = first.gloss.mixed(second.gloss, 0.5)
        gloss = Gloss(2.0 * half.diffuse, 2.0 * half.glossy, 2.0 * half.clear, half.roughness)
        r, g, b = (a + c for a, c in zip(first.emission, second.emission, strict=True))
        try:
            alpha = first.alpha.plus(second.alpha).affine(1.0, -1.0)
        except NotUnderstoodError:
            self.values.notes.append("one of the two textures of its opacity is left out")
            alpha = first.alpha
        lesser, base = (first, second.base) if first.base.factor == _BLACK else (second, first.base)
        if lesser.base.factor != _BLACK:
            if lesser.base.texture is None and base.texture is None:
                x, y, z = (a + c for a, c in zip(base.factor, lesser.base.factor, strict=True))
                base = ColorTerm((x, y, z))
            else:
                self.colors.notes.append("one of its added shaders is left out")
        if first.glow or second.glow:
            self.colors.notes.append(_GLOW_IS_MEAN)
        return _Surface(base=base, alpha=alpha, emission=(r, g, b), gloss=gloss)


def _understood(values: NodeValues, read: Callable[[], _Term], what: str, default: _Term) -> _Term:
    try:
        return read()
    except NotUnderstoodError as cause:
        values.notes.append(f"{what} depends on {cause}: the default value is used")
        return default
