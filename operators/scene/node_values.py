# SPDX-License-Identifier: GPL-3.0-or-later
"""Colours and numbers of shader trees as a constant times, or affine in, one image."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field, replace

import bpy
import numpy as np

from .images import ImageReader, usable
from .node_links import Input, Output, source

Rgb = tuple[float, float, float]
WHITE: Rgb = (1.0, 1.0, 1.0)


@dataclass(frozen=True)
class TextureUse:
    """An image and how it lies on the surface: uv' = transform (2, 3) of (u, v, 1)."""

    image: bpy.types.Image
    extension: str = "REPEAT"
    transform: tuple[tuple[float, float, float], tuple[float, float, float]] | None = None


@dataclass(frozen=True)
class ColorTerm:
    """factor * texture, or factor alone."""

    factor: Rgb = WHITE
    texture: TextureUse | None = None

    def scaled(self, factor: Rgb) -> ColorTerm:
        """This colour times a constant one."""
        r, g, b = (one * other for one, other in zip(self.factor, factor, strict=True))
        return replace(self, factor=(r, g, b))


@dataclass(frozen=True)
class NumberTerm:
    """scale * channel of a texture + offset; 1 or 0 by `threshold` if there is one. Without texture: offset."""

    offset: float = 1.0
    scale: float = 0.0
    texture: TextureUse | None = None
    channel: str = "A"
    threshold: float | None = None

    @property
    def constant(self) -> bool:
        """Whether it is the same everywhere."""
        return self.texture is None

    def affine(self, scale: float, offset: float) -> NumberTerm:
        """scale * this + offset; after a threshold only the complement is possible."""
        if self.threshold is not None:
            if (scale, offset) == (1.0, 0.0):
                return self
            if (scale, offset) == (-1.0, 1.0):
                turned = replace(self, threshold=None).affine(-1.0, 1.0)
                return replace(turned, threshold=1.0 - self.threshold)
            raise NotUnderstoodError("arithmetic behind an alpha threshold")
        return replace(self, offset=scale * self.offset + offset, scale=scale * self.scale)


class NotUnderstoodError(Exception):
    """A part of a shader tree that has no view of its own here; its message is a noun phrase."""


@dataclass
class NodeValues:
    """Evaluates sockets. `notes` collects noun phrases for whatever was left out."""

    images: ImageReader
    notes: list[str] = field(default_factory=list)

    def color(self, at: Input) -> ColorTerm:
        """A colour input; raises NotUnderstoodError."""
        found = source(at)
        if isinstance(found, Input):
            return ColorTerm(_rgb(found.value))
        rule = _COLOR_RULES.get(found.node.type)
        if rule is None:
            raise NotUnderstoodError(f"node '{found.node.name}'")
        return rule(self, found)

    def number(self, at: Input) -> NumberTerm:
        """A float input; raises NotUnderstoodError."""
        found = source(at)
        if isinstance(found, Input):
            return NumberTerm(_number(found.value))
        rule = _NUMBER_RULES.get(found.node.type)
        if rule is not None:
            return rule(self, found)
        color = self.color(at)  # a colour on a float socket counts by its luminance
        luminance = float(np.dot(color.factor, (0.2126, 0.7152, 0.0722)))
        if color.texture is None:
            return NumberTerm(luminance)
        return NumberTerm(0.0, luminance, color.texture, "Y")

    def constant_number(self, at: Input) -> float:
        """A float input that must not vary; raises NotUnderstoodError if it does."""
        term = self.number(at)
        if not term.constant:
            raise NotUnderstoodError("a texture that drives a factor")
        return term.offset

    def constant_color(self, term: ColorTerm) -> Rgb:
        """The colour's mean over its texture."""
        if term.texture is None:
            return term.factor
        mean = self.images.mean(term.texture.image)
        r, g, b = (float(one * other) for one, other in zip(term.factor, mean, strict=True))
        return r, g, b


def _rgb(value: object) -> Rgb:
    if isinstance(value, float | int):
        return (float(value),) * 3
    r, g, b = (float(each) for each in list(value)[:3])  # type: ignore[call-overload]
    return r, g, b


def _number(value: object) -> float:
    if isinstance(value, float | int):
        return float(value)
    return float(np.dot(_rgb(value), (0.2126, 0.7152, 0.0722)))


def _texture_use(values: NodeValues, output: Output) -> TextureUse:
    node = output.node
    if not usable(node.image):
        name = f"image '{node.image.name}'" if node.image else f"node '{node.name}' without an image"
        raise NotUnderstoodError(f"{name} (missing, empty or tiled)")
    if node.projection != "FLAT":
        raise NotUnderstoodError(f"the {node.projection.lower()} projection of image '{node.image.name}'")
    return TextureUse(node.image, node.extension, _uv_transform(values, output.input("Vector")))


def _uv_transform(
    values: NodeValues, at: Input
) -> tuple[tuple[float, float, float], tuple[float, float, float]] | None:
    """How texture coordinates come from the mesh's UV map; None for the map itself."""
    found = source(at)
    if isinstance(found, Input) or (found.node.type == "TEX_COORD" and found.socket.name == "UV"):
        return None
    if found.node.type in ("UVMAP", "ATTRIBUTE"):
        return None  # by name: nearly always the map that renders
    if found.node.type != "MAPPING":
        raise NotUnderstoodError(f"texture coordinates from node '{found.node.name}'")
    inner = _uv_transform(values, found.input("Vector"))
    matrix = _mapping_matrix(found)
    if inner is not None:
        matrix = matrix @ np.vstack([inner, [0, 0, 1]])
    (a, b, c), (d, e, f) = matrix[:2]
    return (float(a), float(b), float(c)), (float(d), float(e), float(f))


def _mapping_matrix(output: Output) -> np.ndarray:
    """(3, 3) float64 of a Mapping node in the plane of the texture."""
    node = output.node
    offset, rotation, scale = (
        np.array(_rgb(found.value)) if isinstance(found := source(output.input(name)), Input) else None
        for name in ("Location", "Rotation", "Scale")
    ) if node.vector_type in ("POINT", "VECTOR") else (None, None, None)  # fmt: skip
    if node.vector_type == "VECTOR":
        offset = np.zeros(3)
    if offset is None or rotation is None or scale is None or abs(rotation[:2]).max() > 1e-6:
        raise NotUnderstoodError(f"node '{node.name}'")
    cosine, sine = np.cos(rotation[2]), np.sin(rotation[2])
    return np.array(
        [[cosine * scale[0], -sine * scale[1], offset[0]], [sine * scale[0], cosine * scale[1], offset[1]], [0, 0, 1]]
    )


def _image_color(values: NodeValues, output: Output) -> ColorTerm:
    texture = _texture_use(values, output)
    if output.socket.name == "Alpha":
        raise NotUnderstoodError(f"the alpha of image '{texture.image.name}' as a colour")
    return ColorTerm(WHITE, texture)


def _mix_color(values: NodeValues, output: Output) -> ColorTerm:
    node = output.node
    if node.type == "MIX":
        if node.data_type != "RGBA":
            raise NotUnderstoodError(f"node '{node.name}'")
        # Sockets of all data types share names; these are the ones of colours.
        factor, a, b = ("Factor_Float", "A_Color", "B_Color")
        factor_at, a_at, b_at = (
            Input(next(s for s in node.inputs if s.identifier == name), output.groups) for name in (factor, a, b)
        )
    else:
        factor_at, a_at, b_at = (output.input(index) for index in range(3))
    factor_value = values.constant_number(factor_at)
    if node.blend_type not in ("MIX", "MULTIPLY"):
        raise NotUnderstoodError(f"blend mode {node.blend_type.lower()} of node '{node.name}'")
    if factor_value <= 0.0:
        return values.color(a_at)
    first, second = values.color(a_at), values.color(b_at)
    if node.blend_type == "MULTIPLY":
        return _product(values, first, second, factor_value)
    return _blend(values, first, second, factor_value)


def _product(values: NodeValues, first: ColorTerm, second: ColorTerm, factor: float) -> ColorTerm:
    """first * lerp(1, second, factor)."""
    if second.texture is not None and first.texture is None and factor >= 1.0:
        first, second = second, first
    if second.texture is not None:
        values.notes.append(f"image '{second.texture.image.name}' counts by its mean colour")
    r, g, b = (1.0 - factor + factor * each for each in values.constant_color(second))
    return first.scaled((r, g, b))


def _blend(values: NodeValues, first: ColorTerm, second: ColorTerm, factor: float) -> ColorTerm:
    """lerp(first, second, factor)."""
    if factor >= 1.0:
        return second
    for term in (first, second):
        if term.texture is not None:
            values.notes.append(f"image '{term.texture.image.name}' counts by its mean colour")
    pairs = zip(values.constant_color(first), values.constant_color(second), strict=True)
    r, g, b = (a + factor * (b - a) for a, b in pairs)
    return ColorTerm((r, g, b))


def _vertex_color(values: NodeValues, output: Output) -> ColorTerm:
    values.notes.append("vertex colours are left out")
    return ColorTerm()


def _vertex_number(values: NodeValues, output: Output) -> NumberTerm:
    values.notes.append("vertex colours are left out")
    return NumberTerm(1.0)


def _ramp(values: NodeValues, output: Output) -> ColorTerm:
    color = output.node.color_ramp.evaluate(values.constant_number(output.input("Fac")))
    return ColorTerm(_rgb(color))


def _adjusted(values: NodeValues, output: Output) -> ColorTerm:
    values.notes.append(f"node '{output.node.name}' is left out")
    return values.color(output.input("Color"))


def _image_number(values: NodeValues, output: Output) -> NumberTerm:
    texture = _texture_use(values, output)
    return NumberTerm(0.0, 1.0, texture, "A" if output.socket.name == "Alpha" else "Y")


def _separated(values: NodeValues, output: Output) -> NumberTerm:
    node = output.node
    if getattr(node, "mode", "RGB") != "RGB":
        raise NotUnderstoodError(f"node '{node.name}'")
    channel = list(node.outputs).index(output.socket)
    color = values.color(output.input(0))
    if color.texture is None:
        return NumberTerm(color.factor[channel])
    return NumberTerm(0.0, color.factor[channel], color.texture, "RGB"[channel])


def _light_path(values: NodeValues, output: Output) -> NumberTerm:
    """What the camera sees counts."""
    return NumberTerm(1.0 if output.socket.name == "Is Camera Ray" else 0.0)


def _mix_number(values: NodeValues, output: Output) -> NumberTerm:
    if output.node.data_type != "FLOAT":
        raise NotUnderstoodError(f"node '{output.node.name}'")
    inputs = {socket.identifier: socket for socket in output.node.inputs}
    factor, a, b = (Input(inputs[name], output.groups) for name in ("Factor_Float", "A_Float", "B_Float"))
    weight = values.constant_number(factor)
    if weight in (0.0, 1.0):
        return values.number(b if weight else a)
    first, second = values.number(a), values.number(b)
    if second.constant:
        return first.affine(1.0 - weight, weight * second.offset)
    if first.constant:
        return second.affine(weight, (1.0 - weight) * first.offset)
    raise NotUnderstoodError(f"two textures in node '{output.node.name}'")


def _math(values: NodeValues, output: Output) -> NumberTerm:
    node = output.node
    a = values.number(output.input(0))
    if node.operation == "ROUND":
        return _clamped(_step(a, 0.5, above=True), node)
    b = values.number(output.input(1))
    rules: dict[str, Callable[[], NumberTerm]] = {
        "MULTIPLY": lambda: _multiply(values, a, b),
        "ADD": lambda: _add(a, b, 1.0),
        "SUBTRACT": lambda: _add(a, b, -1.0),
        "DIVIDE": lambda: a.affine(1.0 / _constant(b), 0.0),
        "GREATER_THAN": lambda: _compare(a, b, above=True),
        "LESS_THAN": lambda: _compare(a, b, above=False),
    }
    if node.operation not in rules:
        raise NotUnderstoodError(f"node '{node.name}' ({node.operation.lower()})")
    return _clamped(rules[node.operation](), node)


def _clamped(term: NumberTerm, node: bpy.types.Node) -> NumberTerm:
    if node.use_clamp and term.constant:
        return replace(term, offset=min(max(term.offset, 0.0), 1.0))
    return term  # opacity is clamped in the end


def _constant(term: NumberTerm) -> float:
    if not term.constant:
        raise NotUnderstoodError("arithmetic of two textures")
    return term.offset


def _multiply(values: NodeValues, a: NumberTerm, b: NumberTerm) -> NumberTerm:
    if a.constant:
        a, b = b, a
    if b.constant and a.threshold is not None and b.offset != 1.0:
        values.notes.append("the factor of cut-out alpha is left out")
        return a if b.offset > 0.0 else NumberTerm(0.0)
    return a.affine(_constant(b), 0.0)


def _add(a: NumberTerm, b: NumberTerm, sign: float) -> NumberTerm:
    if b.constant:
        return a.affine(1.0, sign * b.offset)
    return b.affine(sign, _constant(a))


def _compare(a: NumberTerm, b: NumberTerm, above: bool) -> NumberTerm:
    if b.constant:
        return _step(a, b.offset, above)
    return _step(b, _constant(a), not above)


def _step(term: NumberTerm, threshold: float, above: bool) -> NumberTerm:
    """1 where the term is at least the threshold (`above`) or below it, else 0."""
    if term.threshold is not None:  # already 0 or 1
        return term if above else term.affine(-1.0, 1.0)
    if term.constant:
        return NumberTerm(float((term.offset >= threshold) == above))
    if above:
        return replace(term, threshold=threshold)
    return replace(term.affine(-1.0, 1.0), threshold=1.0 - threshold)


_COLOR_RULES: dict[str, Callable[[NodeValues, Output], ColorTerm]] = {
    "TEX_IMAGE": _image_color,
    "RGB": lambda values, output: ColorTerm(_rgb(output.socket.default_value)),
    "VALUE": lambda values, output: ColorTerm(_rgb(output.socket.default_value)),
    "MIX": _mix_color,
    "MIX_RGB": _mix_color,
    "VALTORGB": _ramp,
    "VERTEX_COLOR": _vertex_color,
    "ATTRIBUTE": _vertex_color,
    "GAMMA": _adjusted,
    "BRIGHTCONTRAST": _adjusted,
    "HUE_SAT": _adjusted,
    "CURVE_RGB": _adjusted,
}
_NUMBER_RULES: dict[str, Callable[[NodeValues, Output], NumberTerm]] = {
    "TEX_IMAGE": _image_number,
    "VALUE": lambda values, output: NumberTerm(float(output.socket.default_value)),
    "MATH": _math,
    "MIX": _mix_number,
    "SEPARATE_COLOR": _separated,
    "SEPRGB": _separated,
    "VERTEX_COLOR": _vertex_number,
    "ATTRIBUTE": _vertex_number,
    "LIGHT_PATH": _light_path,
}
