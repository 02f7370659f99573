# SPDX-License-Identifier: GPL-3.0-or-later
"""Gloss of a material: shares of light that it reflects and transmits."""

from __future__ import annotations

from dataclasses import dataclass

_SHARP = 0.25  # roughness below which a reflection is sharp and depends on the view
_CLEAR = 0.5  # least transmitted share of light of a clear pane


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
