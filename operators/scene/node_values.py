# SPDX-License-Identifier: GPL-3.0-or-later
"""Values of sockets of a shader tree, by the rules of their nodes."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from .color_rules import COLOR_RULES
from .images import ImageReader
from .node_links import Input, source
from .node_terms import REC709, ColorTerm, NotUnderstoodError, NumberTerm, Rgb, number, rgb
from .number_rules import NUMBER_RULES


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
