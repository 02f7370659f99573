# SPDX-License-Identifier: GPL-3.0-or-later
"""Gloss of materials: how much of the light that they reflect is not diffuse, and whether they are clear glass.

A bake of diffuse light shows metals, mirrors and glass black. This module finds these materials by the weights of their
shaders. A number from an image or a node counts as 0.5.
"""

from __future__ import annotations

import numpy as np

from ...patchnet_addon.surface.gloss import Gloss
from .node_terms import REC709, NotUnderstoodError, Output
from .node_values import NodeValues

_FRESNEL = 0.04  # of glass at normal incidence
_METALS = frozenset({"BSDF_GLOSSY", "BSDF_ANISOTROPIC", "BSDF_METALLIC"})
_HAIR = frozenset({"BSDF_HAIR", "BSDF_HAIR_PRINCIPLED"})  # light along strands depends on the view, rough or not
_CLEAR_ONES = frozenset({"BSDF_GLASS", "BSDF_REFRACTION"})
_NOT_REFLECTING = frozenset({"BSDF_TRANSPARENT", "HOLDOUT", "EMISSION"})
DIFFUSE = Gloss(diffuse=0.8)  # of other shaders, and of materials without nodes


def gloss_of(found: Output, silent: NodeValues) -> Gloss:
    """Gloss of a shader, no mix of others."""
    kind, inputs = found.node.type, found.node.inputs

    def number(name: str) -> float:
        """Evaluate a number; a texture counts as 0.5, and so does a node without a rule."""
        try:
            return silent.number(found.input(name)).middle
        except NotUnderstoodError:
            return 0.5

    def color(name: str) -> float:
        """Mean luminance of a colour; 0.5 if it depends on a node without a rule."""
        try:
            return float(np.dot(silent.constant_color(silent.color(found.input(name))), REC709))
        except NotUnderstoodError:
            return 0.5

    roughness = number("Roughness") if "Roughness" in inputs else 0.0
    if kind == "BSDF_PRINCIPLED":
        base, fresnel = color("Base Color"), 0.08 * number("Specular IOR Level")
        metallic, transmission = (min(max(number(name), 0.0), 1.0) for name in ("Metallic", "Transmission Weight"))
        rest = 1.0 - metallic
        return Gloss(
            diffuse=rest * (1.0 - transmission) * base,
            glossy=metallic * base + rest * fresnel,
            clear=rest * transmission * base * (1.0 - _FRESNEL),
            roughness=roughness,
        )
    if kind in _METALS:
        return Gloss(glossy=color("Color" if "Color" in inputs else "Base Color"), roughness=roughness)
    if kind in _CLEAR_ONES:
        return Gloss(glossy=_FRESNEL, clear=color("Color") * (1.0 - _FRESNEL), roughness=roughness)
    if kind in _HAIR or (kind == "BSDF_TOON" and found.node.component == "GLOSSY"):
        return Gloss(glossy=color("Color") if "Color" in inputs else 0.5)
    return Gloss() if kind in _NOT_REFLECTING else DIFFUSE
