# SPDX-License-Identifier: GPL-3.0-or-later
"""Gloss of materials: how much of the light that they reflect is not diffuse, and whether they are clear glass.

A bake of diffuse light shows metals, mirrors and glass black. This module finds these materials by the weights of their
shaders. A number from an image or a node counts as 0.5.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from .node_terms import REC709, NotUnderstoodError, Output
from .node_values import NodeValues

_SHARP = 0.25  # roughness below which a reflection is sharp and depends on the view
_CLEAR = 0.5  # least transmitted share of light of a clear pane
_FRESNEL = 0.04  # of glass at normal incidence
_METALS = frozenset({"BSDF_GLOSSY", "BSDF_ANISOTROPIC", "BSDF_METALLIC"})
_HAIR = frozenset({"BSDF_HAIR", "BSDF_HAIR_PRINCIPLED"})  # light along strands depends on the view, rough or not
_CLEAR_ONES = frozenset({"BSDF_GLASS", "BSDF_REFRACTION"})
_NOT_REFLECTING = frozenset({"BSDF_TRANSPARENT", "HOLDOUT", "EMISSION"})


@dataclass(frozen=True)
class Gloss:
    """Shares of white light that a surface reflects or transmits, and whether it emits light.

    diffuse, glossy: reflected. clear: transmitted as by a pane. roughness: mean of the glossy and clear parts, weighted
    by share.
    """

    diffuse: float = 0.0
    glossy: float = 0.0
    clear: float = 0.0
    roughness: float = 0.0
    shines: bool = False

    @property
    def is_glossy(self) -> bool:
        """Return whether a bake of diffuse light and emission misses most of its light."""
        other = self.glossy + self.clear
        return other > 0.0 and not self.shines and other >= self.diffuse

    @property
    def is_clear(self) -> bool:
        """Return whether the view through it is clear and sharp."""
        return self.clear >= _CLEAR and self.roughness < _SHARP and self.diffuse < self.clear

    @property
    def is_sharp(self) -> bool:
        """Return whether its reflections are sharp."""
        return self.roughness < _SHARP

    def mixed(self, other: Gloss, weight: float) -> Gloss:
        """Mix with another gloss of that weight."""
        mine, its = (1.0 - weight) * (self.glossy + self.clear), weight * (other.glossy + other.clear)
        rough = (mine * self.roughness + its * other.roughness) / (mine + its) if mine + its > 0.0 else 0.0
        blend = {
            name: (1.0 - weight) * getattr(self, name) + weight * getattr(other, name)
            for name in ("diffuse", "glossy", "clear")
        }
        return Gloss(**blend, roughness=rough)


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
