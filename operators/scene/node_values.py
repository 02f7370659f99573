# SPDX-License-Identifier: GPL-3.0-or-later
"""Values of sockets of a shader tree, by the rules of their nodes."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field, replace

import bpy
import numpy as np

from .color_rules import COLOR_RULES, is_missing, texture_use
from .images import ImageReader
from .node_links import Input, Output, source
from .node_terms import MISSING, REC709, ColorTerm, NodeEvaluator, NotUnderstoodError, NumberTerm, Rgb, number, rgb


@dataclass
class NodeValues:
    """Evaluator of sockets; `notes` collects noun phrases for whatever was left out."""

    images: ImageReader
    notes: list[str] = field(default_factory=list)

    def color(self, at: Input) -> ColorTerm:
        """Evaluate a colour input; raises NotUnderstoodError."""
        found = source(at)
        if isinstance(found, Input):
            return ColorTerm(rgb(found.value))
        rule = COLOR_RULES.get(found.node.type)
        if rule is None:
            raise NotUnderstoodError(f"node '{found.node.name}'")
        return rule(self, found)

    def number(self, at: Input) -> NumberTerm:
        """Evaluate a float input; raises NotUnderstoodError."""
        found = source(at)
        if isinstance(found, Input):
            return NumberTerm(number(found.value))
        rule = NUMBER_RULES.get(found.node.type)
        if rule is not None:
            return rule(self, found)
        color = self.color(at)  # a colour on a float socket counts by its luminance
        luminance = float(np.dot(color.factor, REC709))
        if color.texture is None:
            return NumberTerm(luminance)
        return NumberTerm(0.0, luminance, color.texture, "Y")

    def constant_number(self, at: Input) -> float:
        """Evaluate a float input that must not vary; raises NotUnderstoodError if it does."""
        term = self.number(at)
        if not term.constant:
            raise NotUnderstoodError("a texture that drives a factor")
        return term.offset

    def constant_color(self, term: ColorTerm) -> Rgb:
        """Mean of the colour over its texture."""
        if term.texture is None:
            return term.factor
        mean = self.images.mean(term.texture.image)
        r, g, b = (float(one * other) for one, other in zip(term.factor, mean, strict=True))
        return r, g, b


def _vertex_number(values: NodeEvaluator, output: Output) -> NumberTerm:
    values.notes.append("vertex colors are left out")
    return NumberTerm(1.0)


def _image_number(values: NodeEvaluator, output: Output) -> NumberTerm:
    if is_missing(values, output.node):
        return NumberTerm(1.0 if output.socket.name == "Alpha" else number(MISSING))
    texture = texture_use(values, output)
    return NumberTerm(0.0, 1.0, texture, "A" if output.socket.name == "Alpha" else "Y")


def _separated(values: NodeEvaluator, output: Output) -> NumberTerm:
    node = output.node
    if getattr(node, "mode", "RGB") != "RGB":
        raise NotUnderstoodError(f"node '{node.name}'")
    channel = list(node.outputs).index(output.socket)
    color = values.color(output.input(0))
    if color.texture is None:
        return NumberTerm(color.factor[channel])
    return NumberTerm(0.0, color.factor[channel], color.texture, "RGB"[channel])


def _light_path(values: NodeEvaluator, output: Output) -> NumberTerm:
    """Evaluate a light path node as the camera sees it."""
    return NumberTerm(1.0 if output.socket.name == "Is Camera Ray" else 0.0)


def _mix_number(values: NodeEvaluator, output: Output) -> NumberTerm:
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


def _math(values: NodeEvaluator, output: Output) -> NumberTerm:
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


def _multiply(values: NodeEvaluator, a: NumberTerm, b: NumberTerm) -> NumberTerm:
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


NUMBER_RULES: dict[str, Callable[[NodeEvaluator, Output], NumberTerm]] = {
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
