# SPDX-License-Identifier: GPL-3.0-or-later
"""Follow the links of a shader tree through reroutes, muted nodes and groups."""

from __future__ import annotations

from dataclasses import dataclass, replace

import bpy


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
