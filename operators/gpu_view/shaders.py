# SPDX-License-Identifier: GPL-3.0-or-later
"""Shaders as data: their sources, and what they read and write; no graphics library."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path

import numpy as np

from ...patchnet_addon.network.kinds import MIXTURE
from ...patchnet_addon.sampling.plus.features import HIGHEST, LOWEST
from ...patchnet_addon.sampling.plus.forms import FAR, FLOOR, SLOPE
from ...patchnet_addon.sampling.plus.weights import HIDDEN as UNITS
from ...patchnet_addon.surface.textures import BLACK, EXTEND, LEAST_BASE, MIRROR, REPEAT
from ...patchnet_addon.tracing.camera import CameraUnit
from .packing import HIDDEN, INPUTS, MAX_WIDTH, PIECE_WORDS, WIDTH, WIDTH_BITS

_FOLDER = Path(__file__).parent
_SPLIT = 4096.0  # origins are multiples of 1 / this, and a rest
_INPUTS = MIXTURE.decoder[0]
CENTRE = (0.5, 0.5)

# What shaders know of the view, as std140 lays it out: rows of four numbers.
VIEW = """
struct View {
  vec4 place_whole; vec4 place_rest; vec4 right; vec4 up; vec4 forward; vec4 camera_up;
  vec4 lens; vec4 sight; vec4 jitter; ivec4 size; ivec4 counts; ivec4 bounds;
};
"""  # lens: shift, side of a pixel at 0, per axial distance. sight: nearest, farthest, whether perspective,
# factor on colours, of heatmaps on the pixel's side behind the patch. right.w: a ray's footprint on textures over the
# pixel's side.
# jitter: place in the pixel; number of the sample; end of a heatmap's ramp, or share of the sample in the mean. size:
# width, height, first row, kind of a heatmap, or pixels across that a sample counts in. counts: nodes above white,
# inputs of the decoder, side of the world's faces, words of coded nodes.
VIEW_NUMBERS, VIEW_SIZE = 48, 36  # floats of it, and where its size stands
_LAYERS = f"""
struct Layer1 {{ vec4 w[{_INPUTS * HIDDEN // 4}]; }};
struct Layer2 {{ vec4 w[{MAX_WIDTH * HIDDEN // 4}]; vec4 b[{HIDDEN}]; }};
struct Layer3 {{ vec4 w[{MAX_WIDTH * HIDDEN // 4}]; }};
struct Layer4 {{ vec4 w[{MAX_WIDTH * HIDDEN // 4}]; }};
"""
_ESTIMATOR = f"""
struct Estimator {{
  vec4 inputs[{len(INPUTS) * (UNITS // 4 + 1)}]; vec4 bias_1[{UNITS // 4}]; vec4 layer_2[{UNITS * UNITS // 4}];
  vec4 bias_2[{UNITS // 4}]; vec4 ends[{UNITS + 1}];
}};
"""
LAYER_BLOCKS = {f"layer_{number}": f"Layer{number}" for number in (1, 2, 3, 4)}

WORDS, FLOATS = "R32UI", "RGBA32F"  # formats of images
_OCTREE = ("nodes", "sides", "ranks")


@dataclass(frozen=True)
class Shader:
    """Compute shader: files, in order; names of textures of floats, and of integers; images by format; blocks.

    group: threads of a group, across and up; tile: pixels that it works at. defines: by name.
    """

    files: tuple[str, ...]
    textures: tuple[str, ...]
    images: Mapping[str, str]
    integers: tuple[str, ...] = ()
    blocks: Mapping[str, str] = field(default_factory=lambda: {"view": "View"})
    group: tuple[int, int] = (8, 8)
    tile: tuple[int, int] = (8, 8)
    defines: Mapping[str, str] = field(default_factory=dict)

    def groups(self, size: tuple[int, int]) -> tuple[int, int]:
        """Groups, across and up, for pixels (across, up)."""
        return -(-size[0] // self.tile[0]), -(-size[1] // self.tile[1])

    @property
    def all_defines(self) -> dict[str, str]:
        """Defines of all shaders, and its own."""
        common = {"WIDTH": f"{WIDTH}u", "WIDTH_BITS": str(WIDTH_BITS), "SPLIT": str(_SPLIT)}
        return common | dict(self.defines)

    @property
    def structs(self) -> str:
        """Structures of its blocks."""
        return VIEW + (_LAYERS if "layer_1" in self.blocks else "") + (_ESTIMATOR if "estimator" in self.blocks else "")

    @property
    def source(self) -> str:
        """Text of all of its files."""
        return "\n".join((_FOLDER / name).read_text(encoding="utf-8") for name in self.files)


HITS = Shader(
    ("tracing.glsl", "light.glsl", "hits_main.glsl"),
    _OCTREE,
    {"out_node": WORDS, "out_entry": FLOATS, "out_seen": FLOATS},
)

PICTURE = Shader(
    ("tracing.glsl", "light.glsl", "color.glsl", "picture_main.glsl"),
    (*_OCTREE, "hues", "bright", "world"),
    {"out_sample": FLOATS},
)
EXACT_PICTURE = replace(
    PICTURE,
    files=("tracing.glsl", "pieces.glsl", *PICTURE.files[1:]),
    textures=(*PICTURE.textures, "first_pieces", *PIECE_WORDS),
    defines={
        "EXACT": "1",
        "LEAST_BASE": f"{LEAST_BASE:.9f}",
        "REPEAT": f"{REPEAT}u",
        "EXTEND": f"{EXTEND}u",
        "MIRROR": f"{MIRROR}u",
        "BLACK": f"{BLACK}u",
    },
)
FILM = Shader(("film_main.glsl",), ("seen", "before", "weights"), {"out_mean": FLOATS})

DECODER = Shader(
    ("tracing.glsl", "light.glsl", "decode.glsl", "decode_main.glsl"),
    (*_OCTREE, "corner_rows", "cells", "codes", "code_ends", "hit_entry", "hit_seen"),
    {"out_decoded": FLOATS},
    integers=("hit_node",),
    blocks={"view": "View", **LAYER_BLOCKS},
    group=(32, 4),
    tile=(8, 4),
    defines={"GROUP_MEMORY": "shared"},  # Blender 5.2 takes the word itself out of sources
)
ESTIMATE = Shader(
    ("tracing.glsl", "estimate_main.glsl"),
    ("nodes", "normals", "hit_entry", "hit_seen", "decoded"),
    {"out_scored": FLOATS},
    integers=("hit_node",),
    blocks={"view": "View", "estimator": "Estimator"},
    defines={
        "GROUP_MEMORY": "shared",
        "UNITS": str(UNITS),
        "FAR": str(FAR),
        "SLOPE": str(SLOPE),
        "FLOOR": f"{FLOOR:.9f}",
        "LOWEST": str(LOWEST),
        "HIGHEST": str(HIGHEST),
    },
)
HEAT = Shader(
    ("tracing.glsl", "light.glsl", "heat_main.glsl"),
    (*_OCTREE, "ramp", "decoded", "hit_seen"),
    {"out_heat": FLOATS},
    integers=("hit_node",),
)
BITS = Shader(("bits_main.glsl",), ("words",), {"out_bits": WORDS})


def view_block(
    camera: CameraUnit,
    *,
    bright: int = 0,
    brightness: float = 1.0,
    decoder: tuple[int, int] = (MAX_WIDTH, 0),
    world_side: int = 0,
    sample: tuple[int, tuple[float, float]] = (0, CENTRE),
    first_row: int = 0,
    heat: tuple[int, float] = (0, 1.0),
    film: tuple[int, float] | None = None,
    footprint: float = 1.0,
) -> np.ndarray:
    """Uniform block (VIEW_NUMBERS,) float32 of a view, some of whose floats are the bits of integers.

    bright: nodes above white. brightness: factor on colours, of a heatmap on the pixel's side behind the patch.
    decoder: its width, and `packing.coded_word_count`. world_side: of the world's faces, 0 where nothing is behind.
    sample: its number, and the place in the pixels that rays go through, [0, 1]^2. first_row: of the band that is
    decoded. heat: kind of a heatmap, and the value at its ramp's end. film: pixels across that a sample counts in, and
    its share in the mean of all so far. footprint: of a ray on textures, over the pixel's side.
    """
    (width, coded_words), (number, jitter), last = decoder, sample, heat if film is None else film
    place, right, up, forward = camera.pose
    # Parallel rays begin in the plane through the cube's middle: so float32 is fine wherever the camera is. Others meet
    # coarser voxels farther away.
    ahead = 0.0 if camera.perspective else float((0.5 - place) @ forward)
    place = place + ahead * forward
    whole = np.round(place * _SPLIT) / _SPLIT
    block = np.zeros((VIEW_NUMBERS // 4, 4), np.float32)
    block[:6, :3] = whole, place - whole, right, up, forward, up / np.linalg.norm(up)
    block[2, 3] = footprint
    block[6] = camera.shift_x, camera.shift_y, camera.side_at_0, camera.side_per_z
    block[7] = camera.nearest - ahead, min(camera.farthest - ahead, 1e30), camera.perspective, brightness
    block[8] = *jitter, number, last[1]
    whole_numbers = block.view(np.int32)
    whole_numbers[9] = camera.width_px, camera.height_px, first_row, last[0]
    whole_numbers[10] = bright, _INPUTS, world_side, coded_words
    whole_numbers[11] = 8, 12, 16, width
    return block.ravel()
