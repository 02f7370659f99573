# SPDX-License-Identifier: GPL-3.0-or-later
"""Terms of sockets of a shader tree: a constant times, or affine in, an image or layer; links between sockets.

Links lead through reroutes, muted nodes and groups.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import bpy
import numpy as np

from ...patchnet_addon.surface.chroma import BLUE, GREEN, RED

REC709 = (RED, GREEN, BLUE)
Rgb = tuple[float, float, float]
WHITE: Rgb = (1.0, 1.0, 1.0)
MISSING: Rgb = (1.0, 0.0, 1.0)  # color of a missing image in Cycles
Transform = tuple[tuple[float, float, float], tuple[float, float, float]]
CUT_OUT = (0.0, 1.0)


@dataclass(frozen=True)
class TextureUse:
    """Image and its mapping: uv' = transform (2, 3) of (u, v, 1); wrap: the node's `extension`.

    uv_map: name of the UV map or attribute, "" for the one that renders. closest: texels are squares of one colour.
    straight: colours are not multiplied by alpha, as Cycles reads an image whose alpha is used, too. Without an image
    it is the number itself that layer `uv_map` holds, in [0, 1].
    """

    image: bpy.types.Image | None
    wrap: str = "REPEAT"
    transform: Transform | None = None
    uv_map: str = ""
    closest: bool = False
    straight: bool = False

    @property
    def name(self) -> str:
        """Name of the image or layer."""
        return self.image.name if self.image else self.uv_map


@dataclass(frozen=True)
class ColorTerm:
    """Colour term: factor * texture, or factor alone."""

    factor: Rgb = WHITE
    texture: TextureUse | None = None

    def scaled(self, factor: Rgb) -> ColorTerm:
        """Scale this colour by a constant one."""
        r, g, b = (one * other for one, other in zip(self.factor, factor, strict=True))
        return replace(self, factor=(r, g, b))


@dataclass(frozen=True)
class NumberTerm:
    """Number term: scale * channel of a texture + offset, or offset alone.

    With a threshold it is levels[1] where that reaches it, and levels[0] elsewhere.
    """

    offset: float = 1.0
    scale: float = 0.0
    texture: TextureUse | None = None
    channel: str = "A"
    threshold: float | None = None
    levels: tuple[float, float] = CUT_OUT

    @property
    def constant(self) -> bool:
        """Return whether it has no texture."""
        return self.texture is None

    @property
    def middle(self) -> float:
        """Value of the term where its texture is 0.5, or between its two levels."""
        return self.offset + 0.5 * self.scale if self.threshold is None else 0.5 * sum(self.levels)

    def affine(self, scale: float, offset: float) -> NumberTerm:
        """Affine map of this term: scale * this + offset."""
        if scale == 0.0:
            return NumberTerm(offset)
        if self.threshold is None:
            return replace(self, offset=scale * self.offset + offset, scale=scale * self.scale)
        low, high = (scale * level + offset for level in self.levels)
        if (low, high) != CUT_OUT[::-1]:
            return replace(self, levels=(low, high))
        complement = replace(self, threshold=None).affine(-1.0, 1.0)
        return replace(complement, threshold=1.0 - self.threshold, levels=CUT_OUT)

    def plus(self, other: NumberTerm) -> NumberTerm:
        """Sum of two terms; raises NotUnderstoodError for two textures."""
        if other.constant:
            return self.affine(1.0, other.offset)
        if self.constant:
            return other.affine(1.0, self.offset)
        alike = (self.texture, self.channel) == (other.texture, other.channel)
        if not alike or self.threshold is not None or other.threshold is not None:
            raise NotUnderstoodError("a sum of two textures")
        return replace(self, offset=self.offset + other.offset, scale=self.scale + other.scale)

    def mixed(self, other: NumberTerm, weight: NumberTerm) -> NumberTerm:
        """Mix with another term of that weight; raises NotUnderstoodError for a product of two textures."""
        if self == other:
            return self
        if weight.constant:
            share = min(max(weight.offset, 0.0), 1.0)
            return self.affine(1.0 - share, 0.0).plus(other.affine(share, 0.0))
        if self.constant and other.constant:
            return weight.affine(other.offset - self.offset, self.offset)
        raise NotUnderstoodError("a product of two textures")


class NotUnderstoodError(Exception):
    """Unsupported part of a shader tree; the message is a noun phrase."""


def rgb(value: object) -> Rgb:
    """Socket's value as a colour."""
    if isinstance(value, float | int):
        return (float(value),) * 3
    r, g, b = (float(each) for each in list(value)[:3])  # type: ignore[call-overload]
    return r, g, b


def number(value: object) -> float:
    """Socket's value as a number; a colour counts by its luminance."""
    if isinstance(value, float | int):
        return float(value)
    return float(np.dot(rgb(value), REC709))


@dataclass(frozen=True)
class Input:
    """Input socket and the group nodes, outermost first, inside which it lies."""

    socket: bpy.types.NodeSocket
    groups: tuple[bpy.types.Node, ...] = ()

    @property
    def value(self) -> object:
        """Socket's own value, which counts if nothing is linked."""
        return getattr(self.socket, "default_value", None)


@dataclass(frozen=True)
class Output:
    """Output socket that computes a value: its node is no reroute, no group and not muted."""

    node: bpy.types.Node
    socket: bpy.types.NodeSocket
    groups: tuple[bpy.types.Node, ...]

    def input(self, key: str | int) -> Input:
        """Input of the node by its key."""
        return Input(self.node.inputs[key], self.groups)


def source(start: Input) -> Output | Input:
    """Follow the links behind an input to the output that computes it, or to the unlinked input whose value counts."""
    at = start
    while True:
        link = next((link for link in at.socket.links if not link.is_muted), None)
        if link is None:
            return at
        step = _behind(Output(link.from_node, link.from_socket, at.groups))
        if step is None:
            return Output(link.from_node, link.from_socket, at.groups)
        at = step


def _behind(output: Output) -> Input | None:
    """Input that an output only passes on, or None if its node computes something."""
    node = output.node
    if node.type == "REROUTE":
        return output.input(0)
    if node.mute:
        passed = next((link.from_socket for link in node.internal_links if link.to_socket == output.socket), None)
        return Input(passed, output.groups) if passed else None
    if node.type == "GROUP" and node.node_tree:
        inner = next(
            (each for each in node.node_tree.nodes if each.type == "GROUP_OUTPUT" and each.is_active_output), None
        )
        return inner and replace(Input(_same(inner.inputs, output.socket)), groups=(*output.groups, node))
    if node.type == "GROUP_INPUT" and output.groups:
        outer = output.groups[-1]
        return Input(_same(outer.inputs, output.socket), output.groups[:-1])
    return None


def _same(sockets: bpy.types.bpy_prop_collection, like: bpy.types.NodeSocket) -> bpy.types.NodeSocket:
    return next(socket for socket in sockets if socket.identifier == like.identifier)
