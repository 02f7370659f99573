# SPDX-License-Identifier: GPL-3.0-or-later
"""Gloss of materials: how much of the light that they reflect is not diffuse, and whether they are clear glass.

A bake of diffuse light shows metals, mirrors and glass black. This module finds these materials by the weights of their
shaders. A value from an image or a node counts as 0.5, so that no image is read.
"""

from __future__ import annotations

from dataclasses import dataclass

import bpy
import numpy as np

from ..scene_access.blender_version import tree_in_use
from .images import ImageReader
from .node_terms import REC709, Input, NotUnderstoodError, Output, source
from .node_values import NodeValues

_SHARP = 0.25  # roughness below which a reflection is sharp and depends on the view
_CLEAR = 0.5  # least transmitted share of light of a clear pane
_FRESNEL = 0.04  # of glass at normal incidence
_METALS = frozenset({"BSDF_GLOSSY", "BSDF_ANISOTROPIC", "BSDF_METALLIC"})
_HAIR = frozenset({"BSDF_HAIR", "BSDF_HAIR_PRINCIPLED"})  # light along strands depends on the view, rough or not
_CLEAR_ONES = frozenset({"BSDF_GLASS", "BSDF_REFRACTION"})


@dataclass(frozen=True)
class Gloss:
    """Shares of white light that a surface reflects, transmits or emits.

    diffuse, glossy: reflected. clear: transmitted as by a pane. shine: emitted, in any unit. roughness: mean of the
    glossy and clear parts, weighted by share.
    """

    diffuse: float = 0.0
    glossy: float = 0.0
    clear: float = 0.0
    shine: float = 0.0
    roughness: float = 0.0

    @property
    def is_glossy(self) -> bool:
        """Return whether a bake of diffuse light and emission misses most of its light."""
        other = self.glossy + self.clear
        return other > 0.0 and self.shine <= 0.0 and other >= self.diffuse

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
            for name in ("diffuse", "glossy", "clear", "shine")
        }
        return Gloss(**blend, roughness=rough)


def read_gloss(material: bpy.types.Material, images: ImageReader) -> Gloss:
    """Read the gloss of a material; one without nodes is diffuse."""
    tree = tree_in_use(material)
    if tree is None:
        return Gloss(diffuse=0.8)
    output = tree.get_output_node("CYCLES") or tree.get_output_node("ALL")
    if output is None:
        return Gloss()
    return _Walk(images).surface(Input(output.inputs["Surface"]))


class _Walk:
    """Walk along shaders from the material's output."""

    def __init__(self, images: ImageReader) -> None:
        self._values = NodeValues(images)

    def surface(self, at: Input) -> Gloss:
        """Evaluate a shader input."""
        found = source(at)
        if isinstance(found, Input):
            return Gloss()
        kind = found.node.type
        if kind == "MIX_SHADER":
            weight = min(max(self._number(found.input(0)), 0.0), 1.0)
            return self.surface(found.input(1)).mixed(self.surface(found.input(2)), weight)
        if kind == "ADD_SHADER":
            half = self.surface(found.input(0)).mixed(self.surface(found.input(1)), 0.5)
            return Gloss(2.0 * half.diffuse, 2.0 * half.glossy, 2.0 * half.clear, 2.0 * half.shine, half.roughness)
        if kind == "BSDF_PRINCIPLED":
            return self._principled(found)
        if kind == "EMISSION":
            return Gloss(shine=self._color(found.input("Color")) * self._number(found.input("Strength")))
        if kind in _METALS:
            name = "Color" if "Color" in found.node.inputs else "Base Color"
            return Gloss(glossy=self._color(found.input(name)), roughness=self._roughness(found))
        if kind in _CLEAR_ONES:
            passes = self._color(found.input("Color")) * (1.0 - _FRESNEL)
            return Gloss(glossy=_FRESNEL, clear=passes, roughness=self._roughness(found))
        if kind in _HAIR or (kind == "BSDF_TOON" and found.node.component == "GLOSSY"):
            return Gloss(glossy=self._color(found.input("Color")) if "Color" in found.node.inputs else 0.5)
        if kind in ("BSDF_TRANSPARENT", "HOLDOUT"):
            return Gloss()
        return Gloss(diffuse=0.8)

    def _principled(self, found: Output) -> Gloss:
        base = self._color(found.input("Base Color"))
        metallic, transmission = (
            min(max(self._number(found.input(name)), 0.0), 1.0) for name in ("Metallic", "Transmission Weight")
        )
        fresnel = 0.08 * self._number(found.input("Specular IOR Level"))
        rest = 1.0 - metallic
        return Gloss(
            diffuse=rest * (1.0 - transmission) * base,
            glossy=metallic * base + rest * fresnel,
            clear=rest * transmission * base * (1.0 - _FRESNEL),
            shine=self._color(found.input("Emission Color")) * self._number(found.input("Emission Strength")),
            roughness=self._roughness(found),
        )

    def _roughness(self, found: Output) -> float:
        return self._number(found.input("Roughness")) if "Roughness" in found.node.inputs else 0.0

    def _number(self, at: Input) -> float:
        """Evaluate a number; a texture counts as 0.5, and so does a node without a rule."""
        try:
            term = self._values.number(at)
        except NotUnderstoodError:
            return 0.5
        return float(term.offset + 0.5 * term.scale * (not term.constant))

    def _color(self, at: Input) -> float:
        """Mean luminance of a colour; 0.5 if it depends on a node without a rule."""
        try:
            return float(np.dot(self._values.constant_color(self._values.color(at)), REC709))
        except NotUnderstoodError:
            return 0.5
