# SPDX-License-Identifier: GPL-3.0-or-later
"""Share of an octree's leaves with fine light, and its noise, as a bake notes them in the octree's file."""

from __future__ import annotations

from ..octree.octree import Octree

FINE_LIGHT, LIGHT_NOISE = "fine_light", "light_noise"
WANTED_NOISE = "wanted_noise"  # the threshold, where Max Samples ended the bake before it was reached


def fine_light_values(octree: Octree) -> dict[str, float]:
    """Share of the leaves with fine light, and the noise of the cameras' pictures; empty without a bake."""
    return {name: octree.provenance[name] for name in (FINE_LIGHT, LIGHT_NOISE) if name in octree.provenance}


def fine_light_text(octree: Octree) -> str:
    """Share of fine light and its noise in words; "" without a bake."""
    values = fine_light_values(octree)
    if FINE_LIGHT not in values:
        return ""
    share, noise = values[FINE_LIGHT], f"; noise {noise_text(octree)}" if LIGHT_NOISE in values else ""
    if WANTED_NOISE in octree.provenance:
        noise += f", above {_percent(octree.provenance[WANTED_NOISE])}: raise Max Samples"
    if share >= 1.0:
        return f"Fine light everywhere{noise}"
    return f"Fine light on {_percent(min(share, 0.99))} of the voxels, those that cameras see{noise}"


def noise_text(octree: Octree) -> str:
    """Noise of an octree's baked light in percent."""
    return _percent(octree.provenance.get(LIGHT_NOISE, 0.0))


def _percent(share: float) -> str:
    return f"{share:.0%}" if share >= 0.1 else f"{100.0 * share:.2g}%"
