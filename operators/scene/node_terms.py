# SPDX-License-Identifier: GPL-3.0-or-later
"""Terms that sockets of a shader tree evaluate to: a constant times, or affine in, one image; links between sockets.

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


@dataclass(frozen=True)
class TextureUse:
    """Image and its mapping: uv' = transform (2, 3) of (u, v, 1); wrap: the node's `extension`.

    uv_map: name of the UV map or attribute, "" for the one that renders. closest: texels are squares of one colour.
    """

    image: bpy.types.Image
    wrap: str = "REPEAT"
    transform: Transform | None = None
    uv_map: str = ""
    closest: bool = False


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
    """Number term: scale * channel of a texture + offset, or offset alone; 1 or 0 by `threshold` if there is one."""

    offset: float = 1.0
    scale: float = 0.0
    texture: TextureUse | None = None
    channel: str = "A"
    threshold: float | None = None

    @property
    def constant(self) -> bool:
        """Return whether it has no texture."""
        return self.texture is None

    def affine(self, scale: float, offset: float) -> NumberTerm:
        """Affine map of this term: scale * this + offset; after a threshold only the complement is possible."""
        if self.threshold is not None:
            if (scale, offset) == (1.0, 0.0):
                return self
            if (scale, offset) == (-1.0, 1.0):
                turned = replace(self, threshold=None).affine(-1.0, 1.0)
                return replace(turned, threshold=1.0 - self.threshold)
            raise NotUnderstoodError("arithmetic after an alpha threshold")
        return replace(self, offset=scale * self.offset + offset, scale=scale * self.scale)


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
