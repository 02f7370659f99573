# SPDX-License-Identifier: GPL-3.0-or-later
"""Reasons for empty and black pictures."""

import re
from dataclasses import replace

import numpy as np
import pytest

from patchnet.patchnet_addon.octree.octree import Octree
from patchnet.patchnet_addon.surface.mesh import TriangleMesh
from patchnet.patchnet_addon.tracing.camera import ORTHOGRAPHIC, Camera
from patchnet.patchnet_addon.tracing.empty_view import BLACK_SURFACE, BLACK_VIEWS, why_unseen
from patchnet.patchnet_addon.tracing.render import first_hits
from patchnet.tests.engine.mesh_samples import box, even, octree_of

SIZE = (24, 16)


def cube(tone: float = 0.5, **provenance: object) -> Octree:
    """A cube of side 2 around the origin, of one luminance."""
    mesh = TriangleMesh.from_arrays(box((-1, -1, -1), (1, 1, 1)))
    return octree_of(mesh, even(tone), 5, exposure=1.0, provenance=provenance)


def look(position=(0.0, -6.0, 0.0), target=(0.0, 0.0, 0.0), **others) -> Camera:
    camera = Camera.look_at(np.array(position, float), np.array(target, float), size_px=SIZE, name="Eye")
    return replace(camera, **others)


def why(octree: Octree, camera: Camera) -> str | None:
    hits = first_hits(octree, camera)
    return why_unseen(octree, camera, hits, float(hits.luminance.max()))


def test_a_picture_that_shows_something_needs_no_words() -> None:
    assert why(cube(), look()) is None
    assert why(cube(), look(kind=ORTHOGRAPHIC, half_x=2.0, half_y=2.0)) is None


@pytest.mark.parametrize(
    ("camera", "said"),
    [
        (look(clip_end=4.0), r"the surface begins at 5, beyond its clipping range 0 to 4; raise Clip End$"),
        (look(clip_start=9.0, clip_end=20.0), r"lies outside its clipping range 9 to 20; change Clip Start or End$"),
        (look(target=(0.0, -12.0, 0.0)), r"the surface is behind it; turn or move it$"),
        (look(target=(6.0, -1.0, 0.0)), r"it looks past the surface; turn or move it$"),
        (
            replace(look(position=(0.7, -9e4, 0.4), target=(0.0, 0.0, 0.0)), shift_x=0.01),
            r"the surface, 3\.\d+ across at 9e\+04, is smaller than a pixel; move it closer or zoom in$",
        ),
    ],
    ids=["too far", "too near", "behind", "past", "tiny"],
)
def test_why_a_camera_sees_nothing(camera: Camera, said: str) -> None:
    sentence = why(cube(), camera)
    assert sentence is not None and sentence.startswith("Camera 'Eye' sees nothing: ")
    assert re.search(said, sentence), sentence


@pytest.mark.parametrize(
    ("provenance", "said"),
    [
        ({BLACK_SURFACE: "'Coal'"}, "all materials of the surface are black: 'Coal'"),
        ({BLACK_VIEWS: {"Eye": "the material 'Coal' of 'Heap' is black"}}, "the material 'Coal' of 'Heap' is black"),
        ({BLACK_VIEWS: {"Other": "it is dark"}, "light": "two-lights"}, "the surface itself is black"),
        ({"light": "cycles"}, "no light of the scene reaches the surface"),
        ({"light": "cycles", "exposure": "given"}, "nothing is brighter at an exposure of 1;"),
        ({"light": "two-lights"}, "the surface itself is black"),
    ],
)
def test_why_a_picture_is_black(provenance: dict, said: str) -> None:
    sentence = why(cube(0.0, **provenance), look())
    assert sentence is not None and sentence.startswith(f"Camera 'Eye' sees only black: {said}")


def test_black_around_a_camera_and_black_in_its_view() -> None:
    octree = cube(0.0)
    octree.luminance[octree.level(5)][-1] = 65535  # somewhere it is bright
    inside = why(octree, look((0.0, 0.0, 0.1), (-1.0, -0.5, 0.0)))
    assert inside == (
        "Camera 'Eye' sees only black: it stands inside of something into which no light gets; move it out, or put a "
        "lamp there"
    )
    outside = why(octree, look((-6.0, -5.0, -4.0)))
    assert outside is not None and outside.endswith("no light reaches what is in its view, or its materials are black")


def test_a_camera_within_a_voxel_and_one_that_is_far_away() -> None:
    sentence = why(cube(), look((-0.99, 0.5, 0.5), (-1.5, 0.5, 0.5), clip_start=1e-4))
    assert sentence is not None and "nothing but the voxel of side 0.0625 in which it stands" in sentence
    sentence = why(cube(), look((0.0, -30.0, 0.0)).with_size(25, 17))
    assert sentence is not None and "it is too far away, or its picture has too few pixels" in sentence
