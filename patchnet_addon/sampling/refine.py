# SPDX-License-Identifier: GPL-3.0-or-later
"""Refine by a budget: the active pixels with the highest scores take the reference (methods 3, 7.25)."""

from __future__ import annotations

import numpy as np

from .pixel_buffers import PixelBuffers


def priority(buffers: PixelBuffers, score: np.ndarray) -> np.ndarray:
    """(P,): scores times importance."""
    return score if buffers.importance is None else score * buffers.importance


def refinement_order(buffers: PixelBuffers, score: np.ndarray) -> np.ndarray:
    """(A,) int64 indices of the active pixels, first refined first; ties go by a fixed hash of the index.

    Pixels of importance 0 come last, after the `refinable` ones.
    """
    order = np.argsort(pixel_hash(len(score)))
    order = order[buffers.active[order]]
    order = order[np.argsort(-priority(buffers, score)[order], kind="stable")]
    if buffers.importance is not None:
        order = order[np.argsort(buffers.importance[order] <= 0, kind="stable")]
    return order


def refinable(buffers: PixelBuffers) -> int:
    """Count the active pixels of positive importance."""
    if buffers.importance is None:
        return int(np.count_nonzero(buffers.active))
    return int(np.count_nonzero(buffers.active & (buffers.importance > 0)))


def refined_count(buffers: PixelBuffers, budget: float, active: int) -> int:
    """Count the `active` pixels that a budget X in [0, 1] refines: round(X |A|), without importance 0."""
    return min(round(budget * active), refinable(buffers))


def refined_mask(buffers: PixelBuffers, order: np.ndarray, budget: float) -> np.ndarray:
    """(P,) bool: pixels that a budget in [0, 1] refines, of the active ones in their `order` (A,)."""
    mask = np.zeros(len(buffers.preview), bool)
    mask[order[: refined_count(buffers, budget, len(order))]] = True
    return mask


def refined_picture(buffers: PixelBuffers, mask: np.ndarray) -> np.ndarray:
    """(P,) float32: the reference where `mask` (P,) is set, `shown` elsewhere; the view needs its reference."""
    assert buffers.reference is not None
    return np.where(mask, buffers.reference, buffers.shown)


def pixel_hash(count: int) -> np.ndarray:
    """(count,) uint64: the finaliser of SplitMix64 applied to the pixels' indices; a permutation, so without ties."""
    value = np.arange(1, count + 1, dtype=np.uint64) * np.uint64(0x9E3779B97F4A7C15)
    value = (value ^ (value >> np.uint64(30))) * np.uint64(0xBF58476D1CE4E5B9)
    value = (value ^ (value >> np.uint64(27))) * np.uint64(0x94D049BB133111EB)
    return value ^ (value >> np.uint64(31))
