# SPDX-License-Identifier: GPL-3.0-or-later
"""Octree, codes and weights as words of textures; NumPy alone.

A texture holds the bits of uint32 words as floats, since Blender uploads no integers. Bytes: 8 a node, 2 for its hue,
half a one for what finds codes and sides, 24 for sides, 52 a corner, 12 a coded voxel; with codes 4 for its normal;
with pieces 4 a node, 12 a piece, 72 a triangle of them and 4 a texel.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np

from ...patchnet_addon.cells.leaf_boxes import WHOLE
from ...patchnet_addon.codes.coded_octree import CodedOctree
from ...patchnet_addon.image.cube_map import CubeMap
from ...patchnet_addon.network.weights import Weights
from ...patchnet_addon.octree.octree import Octree
from ...patchnet_addon.octree.pieces import NO_PIECES, Pieces
from ...patchnet_addon.sampling.plus.forms import CENTRE, FORMS, WINDOW, Kind, Plane
from ...patchnet_addon.sampling.plus.weights import HIDDEN as UNITS
from ...patchnet_addon.sampling.plus.weights import Estimators
from ...patchnet_addon.surface.chroma import GRAY_SHARE
from ...patchnet_addon.surface.hit_textures import DETAIL
from ...patchnet_addon.tracing.pixel_filter import PixelFilter, splat_of

BOXED, SIDED, BRIGHT, PIECED = (1 << bit for bit in (24, 25, 26, 27))  # flags of a node
WIDTH_BITS = 14
WIDTH = 1 << WIDTH_BITS  # of all textures
HIDDEN, MAX_WIDTH = 80, 78  # outputs of a layer on the card, filled up; most inputs of one but the first
_RANKED = 32  # nodes a word of bits
FORM = FORMS["plus-0"]  # of the error estimator
_NEAR = (
    (Kind.DIFFERENCE, Plane.LUMINANCE),
    (Kind.DIFFERENCE, Plane.PATCH),
    (Kind.VALUE, Plane.HIT),
    (Kind.SLOPE, Plane.DEPTH),
    (Kind.ANGLE, Plane.NORMAL_X),
    (Kind.VALUE, Plane.COVERAGE),
)
_HERE = (
    (Kind.VALUE, Plane.LUMINANCE),
    (Kind.DIFFERENCE, Plane.OPEN),
    (Kind.VALUE, Plane.COSINE),
    (Kind.VALUE, Plane.RATIO),
    (Kind.VALUE, Plane.CHILDREN),
    (Kind.VALUE, Plane.LOOK_AHEAD),
    (Kind.SCALE, Plane.LUMINANCE),
)
# Inputs of the estimator as `estimate_main.glsl` makes them: of each place in the window, then of the pixel itself.
INPUTS = [(*near, place) for place in WINDOW for near in _NEAR] + [(*here, CENTRE) for here in _HERE]


def node_words(octree: Octree) -> np.ndarray:
    """Words (n, 2) uint32 of nodes: first child, or of a leaf its box; children 8 bits, luminance 16, flags."""
    words = np.empty((octree.node_count, 2), np.uint32)
    words[:, 0] = np.where(octree.child_mask == 0, np.uint32(WHOLE), octree.first_child)
    words[:, 1] = octree.child_mask
    words[:, 1] |= octree.luminance.astype(np.uint32) << np.uint32(8)
    if octree.leaf_box is not None:
        finest, box = words[octree.level_start[octree.depth] :], octree.leaf_box.astype(np.uint32)
        finest[:, 0] = box[:, 0] | box[:, 1] << 8 | box[:, 2] << 16
        finest[:, 1] |= BOXED
    for nodes, flag in ((octree.side_nodes, SIDED), (octree.bright_nodes, BRIGHT)):
        if nodes is not None:
            words[nodes, 1] |= np.uint32(flag)
    if octree.pieces is not None:
        words[(octree.child_mask == 0) & (octree.first_child != NO_PIECES), 1] |= np.uint32(PIECED)
    return words


def hue_words(octree: Octree) -> np.ndarray:
    """Words (n / 2, 1) uint32: the hues of two nodes each, shares of red and blue; gray where there is no colour."""
    hues = np.full((octree.node_count + 1 & ~1, 2), GRAY_SHARE, np.uint8)
    if octree.chroma is not None:
        hues[: octree.node_count] = octree.chroma
    return hues.reshape(-1, 4).view(np.uint32)


def side_words(octree: Octree) -> np.ndarray:
    """Words (3 s, 2) uint32, for each axis of a node with sides: roots and shares of both faces, and their hues."""
    if octree.side_light is None or octree.side_share is None:
        return np.zeros((1, 2), np.uint32)
    rows = len(octree.side_light)
    words = np.full((rows, 3, 2, 4), GRAY_SHARE, np.uint8)
    words[:, :, 0, :2] = octree.side_light.reshape(rows, 3, 2)
    words[:, :, 0, 2:] = octree.side_share.reshape(rows, 3, 2)
    if octree.side_chroma is not None:
        words[:, :, 1] = octree.side_chroma.reshape(rows, 3, 4)
    return words.view(np.uint32).reshape(-1, 2)


def bright_words(octree: Octree) -> np.ndarray:
    """Words (b, 4) uint32 of nodes above white, ascending: node, and the colour as floats."""
    if octree.bright_nodes is None or octree.bright_colors is None or not len(octree.bright_nodes):
        return np.zeros((1, 4), np.uint32)
    colors = np.ascontiguousarray(octree.bright_colors, np.float32).view(np.uint32)
    return np.column_stack([octree.bright_nodes, colors]).astype(np.uint32)


def world_words(world: CubeMap | np.ndarray | None) -> tuple[np.ndarray, int]:
    """Words (6 S^2, 2) uint32 of a world's faces, half floats, and S; one colour (3,) has faces of one texel."""
    if world is None:
        return np.zeros((1, 2), np.uint32), 0
    faces = world.faces if isinstance(world, CubeMap) else np.broadcast_to(world, (6, 1, 1, 3)).astype(np.float16)
    texels = np.zeros((faces.size // 3, 4), np.float16)
    texels[:, :3] = faces.reshape(-1, 3)
    return texels.view(np.uint32), faces.shape[1]


def film_words(pixel_filter: PixelFilter, places: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Words (n K, 1) uint32 of samples at places (n, 2) in their pixels, and their totals (n,).

    Floats: weight of each sample in the K pixels around, the lowest row first.
    """
    splat = splat_of(pixel_filter, places)
    weights = (splat.weights / splat.total[:, None])[:-1].T.astype(np.float32)
    return np.ascontiguousarray(weights).view(np.uint32).reshape(-1, 1), weights.sum(axis=1)


def rank_words(octree: Octree, coded: CodedOctree | None) -> np.ndarray:
    """Words (n / 32, 4) uint32 of 32 nodes each: how many coded ones are before, which are; the same of sides."""
    words = np.zeros((-(-octree.node_count // _RANKED), 4), np.uint32)
    if coded is not None:
        bits = coded.nodes.bits.view(np.uint32)[: len(words)]
        words[: len(bits), 1] = bits
    if octree.side_nodes is not None:
        nodes = octree.side_nodes.astype(np.int64)
        np.bitwise_or.at(words[:, 3], nodes >> 5, np.uint32(1) << (nodes & 31).astype(np.uint32))
    for column in (0, 2):
        ones = np.unpackbits(np.ascontiguousarray(words[:, column + 1]).view(np.uint8)).reshape(-1, _RANKED)
        counts = ones.sum(axis=1, dtype=np.uint32)
        words[:, column] = np.cumsum(counts, dtype=np.uint32) - counts
    return words


def coded_word_count(coded: CodedOctree) -> int:
    """How many words of `rank_words` may name coded nodes; those behind have none."""
    return 2 * len(coded.nodes.bits)


def fits_card(weights: Weights) -> bool:
    """Return whether the decoder of these weights is one that the shaders have: a mixture, no wider than MAX_WIDTH."""
    return weights.kind.mixes and weights.kind.width <= MAX_WIDTH


def layer_blocks(weights: Weights) -> list[np.ndarray]:
    """Uniform blocks of the four layers, flat float32: for each input 80 weights; the second has all biases, too."""
    blocks: list[np.ndarray] = []
    biases = []
    for matrix, bias in weights.decoder:
        block = np.zeros((MAX_WIDTH if blocks else matrix.shape[1], HIDDEN), np.float32)
        block[: matrix.shape[1], : len(matrix)] = matrix.T
        blocks.append(block.ravel())
        biases.append(np.pad(bias.astype(np.float32), (0, HIDDEN - len(bias))))
    blocks[1] = np.concatenate([blocks[1], *biases])
    return blocks


def estimator_block(estimators: Estimators) -> np.ndarray:
    """Uniform block, flat float32, of the estimator: what INPUTS meet, the second layer, the last.

    An input has UNITS weights, its share in the scale, and its linear term; 0 where FORM has no such feature.
    """
    (first, second, last), skip = estimators.networks[FORM.name]
    inputs = np.zeros((len(INPUTS), UNITS + 4), np.float32)
    for column, feature in enumerate(FORM.features):
        row = inputs[INPUTS.index((feature.kind, feature.plane, feature.place))]
        row[:UNITS], row[UNITS], row[UNITS + 1] = first[0][:, column], feature.share, skip[column]
    ends = np.zeros((UNITS + 1, 4), np.float32)
    ends[:-1, :2], ends[-1, :2] = last[0].T, last[1]
    return np.concatenate([inputs.ravel(), first[1], second[0].T.ravel(), second[1], ends.ravel()])


def corner_words(pieces: Pieces) -> np.ndarray:
    """Words (3 t, 4) uint32: corners of triangles as floats; beside the first their UVs' detail, then the material."""
    words = np.zeros((len(pieces.corners), 3, 4), np.float32)
    words[..., :3] = pieces.corners.reshape(-1, 3, 3)
    words[:, :2, 3] = pieces.uvs[:, DETAIL:]
    return words.view(np.uint32).reshape(-1, 4)


def chain_words(pieces: Pieces) -> np.ndarray:
    """Words (3 K, 4) uint32 of mip chains: first level, their number, wrap mode and detail; rows of the transform."""
    chains = pieces.textures.chains
    words = np.zeros((len(chains), 3, 4), np.uint32)
    words[:, 0] = _record_words(chains, ("first", "level_count", "wrap", "detail"))
    words[:, 1:, :3] = chains["transform"].view(np.uint32)
    return words.reshape(-1, 4)


def material_words(pieces: Pieces) -> np.ndarray:
    """Words (2 M, 4) uint32 of materials: both chains, whether it reflects, threshold or -1; colour and opacity."""
    materials = pieces.textures.materials.copy()
    materials["threshold"] = np.nan_to_num(materials["threshold"], nan=-1.0)
    return _record_words(
        materials, ("chain", "color_chain", "reflects", "threshold"), ("red", "green", "blue", "opacity")
    )


def _record_words(records: np.ndarray, *rows: tuple[str, ...]) -> np.ndarray:
    """Words (n r, 4) uint32 of records (n,): for each of them r rows of up to four fields, whole numbers or floats."""
    floats = np.zeros((len(records), len(rows), 4), np.float32)
    for row, names in enumerate(rows):
        for column, name in enumerate(names):
            part = floats if records[name].dtype.kind == "f" else floats.view(np.int32)
            part[:, row, column] = records[name]
    return floats.view(np.uint32).reshape(-1, 4)


def padded(words: np.ndarray) -> np.ndarray:
    """Words (rows, WIDTH, C) of a texture that holds words (n, C)."""
    count, channels = words.shape
    rows = max(-(-count // WIDTH), 1)
    if count == rows * WIDTH:
        return words.reshape(rows, WIDTH, channels)
    full = np.zeros((rows * WIDTH, channels), np.uint32)
    full[:count] = words
    return full.reshape(rows, WIDTH, channels)


# What packs the textures of an octree, of its pieces and of its codes, by name, as words (n, C) uint32. Only an octree
# with pieces has first ones; codes bring ranks of their own.
OCTREE_WORDS: dict[str, Callable[[Octree], np.ndarray]] = {
    "nodes": node_words,
    "hues": hue_words,
    "sides": side_words,
    "bright": bright_words,
    "ranks": lambda octree: rank_words(octree, None),
    "first_pieces": lambda octree: octree.first_child.reshape(-1, 1),
}
PIECE_WORDS: dict[str, Callable[[Pieces], np.ndarray]] = {
    "pieces": lambda pieces: pieces.triangle.reshape(-1, 1),
    "lights": lambda pieces: pieces.light,
    "corners": corner_words,
    "uvs": lambda pieces: _bits(pieces.uvs[:, :DETAIL]).reshape(-1, 2),  # floats
    "texels": lambda pieces: pieces.textures.texels.reshape(-1, 1),
    "mips": lambda pieces: np.pad(pieces.textures.levels, ((0, 0), (0, 1))).astype(np.uint32),
    "chains": chain_words,
    "materials": material_words,
}
CODED_WORDS: dict[str, Callable[[CodedOctree], np.ndarray]] = {
    "codes": lambda coded: _bits(coded.codes[:, :8]),  # halves, the first eight of each corner
    "code_ends": lambda coded: _bits(coded.codes[:, 8:]),  # the other two
    "cells": lambda coded: np.ascontiguousarray(coded.corner_cells).reshape(-1, 4),
    "corner_rows": lambda coded: coded.corner_rows.reshape(-1, 1),
    "normals": lambda coded: _bits(np.pad(coded.octree.normal, ((0, 0), (0, 1)))),  # x, y and z as signed bytes
    "ranks": lambda coded: rank_words(coded.octree, coded),
}
_WORDS: dict[type, dict[str, Callable[[Any], np.ndarray]]] = {
    Octree: OCTREE_WORDS, Pieces: PIECE_WORDS, CodedOctree: CODED_WORDS
}  # fmt: skip


def packed(source: Octree | Pieces | CodedOctree, name: str) -> np.ndarray:
    """Words of a texture by its name."""
    return _WORDS[type(source)][name](source)


def _bits(values: np.ndarray) -> np.ndarray:
    return np.ascontiguousarray(values).view(np.uint32)


def card_bytes(octree: Octree) -> int:
    """Bytes that an octree takes on the card, about."""
    sides = 0 if octree.side_nodes is None else 24 * len(octree.side_nodes)
    pieces = 0
    if octree.pieces is not None:
        found = octree.pieces
        pieces = (
            4 * octree.node_count + 12 * len(found.triangle) + 72 * len(found.corners) + found.textures.texels.nbytes
        )
    return 11 * octree.node_count + sides + pieces


def code_bytes(coded: CodedOctree) -> int:
    """Bytes that codes take beside it, about."""
    return 52 * len(coded.codes) + 12 * coded.coded_count + 4 * coded.octree.node_count
