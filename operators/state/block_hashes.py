# SPDX-License-Identifier: GPL-3.0-or-later
"""Hashes of one original data-block: its geometry and its appearance in light, without its name."""

from __future__ import annotations

from typing import NamedTuple

import bpy
import numpy as np

from ..scene_access.frames import fcurves
from ..scene_access.own import is_own
from .digest import Digest, names, values_of

LAMPS = frozenset({"LIGHT", "LIGHT_PROBE"})
# Types whose contents `Digest` hashes.
_WHOLE = (bpy.types.Image, bpy.types.NodeTree, bpy.types.Text, bpy.types.Collection, bpy.types.Curve)
_SKIPPED_OF_DATA = names("name name_full materials texspace_location texspace_size is_editmode")
# Of hair and points: `Digest.geometry` hashes these as arrays.
_SKIPPED_OF_STRANDS = _SKIPPED_OF_DATA | names("points curves position_data curve_offset_data normals attributes")
_OF_OBJECTS = (
    "type", "parent_type", "parent_bone", "instance_type", "instance_faces_scale", "use_instance_faces_scale",
    "use_instance_vertices_rotation", "show_instancer_for_render", "hide_render", "visible_camera",
    "is_holdout", "is_shadow_catcher", "pass_index",
)  # fmt: skip
OBJECT_RAYS = (
    "visible_diffuse", "visible_glossy", "visible_transmission", "visible_volume_scatter", "visible_shadow",
)  # fmt: skip
_REFERRED = ("parent", "instance_collection", "data")
# Modifiers whose result can differ between frames without keyframes, and geometry nodes in those of type NODES.
_MOVES_BY_ITSELF = frozenset(
    {"CLOTH", "SOFT_BODY", "FLUID", "OCEAN", "WAVE", "DYNAMIC_PAINT", "PARTICLE_SYSTEM", "MESH_CACHE",
     "MESH_SEQUENCE_CACHE", "BUILD", "EXPLODE"}
)  # fmt: skip
_MOVING_NODES = frozenset(
    {"GeometryNodeInputSceneTime", "GeometryNodeSimulationInput", "GeometryNodeSimulationOutput", "GeometryNodeBake",
     "GeometryNodeInputActiveCamera"}
)  # fmt: skip
FILMS = frozenset({"SEQUENCE", "MOVIE"})  # sources of images
_POSITION = "position"
_KEYFRAME_VALUES = ("co", "handle_left", "handle_right")
GLOSS_MOVED = "the camera that gloss is seen from moved"


class Part(NamedTuple):
    """Hash of a part of a data-block's contents, and session_uids of the data-blocks that it refers to."""

    text: str
    references: tuple[int, ...]


class OwnDigest(Digest):
    """Hash of one data-block without its name; data-blocks that it refers to are listed."""

    def __init__(self) -> None:
        super().__init__()
        self.references: list[bpy.types.ID] = []

    def block(self, block: bpy.types.ID | None) -> None:
        """List a data-block, unless it shows results."""
        if block is None or not passed_over(block):
            self.text(block is not None)
        if block is not None and not passed_over(block):
            self.references.append(block)

    def part(self) -> Part:
        """Hash and references so far."""
        return Part(self.hexdigest(), tuple(block.session_uid for block in self.references))


class BlockReader:
    """Reader that hashes data-blocks; `animated` is whether the last one changes by itself from frame to frame.

    keys: with keyframes and drivers, and not their present values alone.
    """

    def __init__(self, *, keys: bool = True) -> None:
        self._keys = keys
        self.animated = False

    def parts(self, block: bpy.types.ID) -> tuple[Part, Part, tuple[list[bpy.types.ID], list[bpy.types.ID]]]:
        """Hash one data-block and, separately, its appearance in light; with the data-blocks that both refer to."""
        self.animated = False
        main, look = OwnDigest(), OwnDigest()
        if isinstance(block, bpy.types.Object):
            self._object(block, main, look)
        elif isinstance(block, bpy.types.Mesh):
            _mesh(block, main, look)
        else:
            _other(block, main)
            self.animated = getattr(block, "source", "") in FILMS
        if self._keys:
            self._animation(block, main)
        return main.part(), look.part(), (main.references, look.references)

    def _object(self, item: bpy.types.Object, surface: OwnDigest, light: OwnDigest) -> None:
        # Blender computes the world matrix from these; right after an undo it is outdated.
        for matrix in (item.matrix_basis, item.matrix_parent_inverse):
            surface.text(_rows(matrix))
        surface.text(*(getattr(item, name) for name in _OF_OBJECTS), tuple(item.color))
        for name in _REFERRED:
            (light if name == "data" and item.type in LAMPS else surface).block(getattr(item, name))
        for modifier in item.modifiers:
            surface.modifier(modifier, depth=2)
            self.animated |= modifier.type in _MOVES_BY_ITSELF
            self.animated |= modifier.type == "NODES" and _moves(modifier.node_group, set())
        if item.type == "MESH" and len(item.modifiers) and len(item.vertex_groups):
            weights = [(vertex.index, at.group, at.weight) for vertex in item.data.vertices for at in vertex.groups]
            surface.array("weights", np.array(weights, np.float64))
        for constraint in item.constraints:
            surface.struct(constraint, depth=2)
        for system in item.particle_systems:
            surface.particles(system)
            self.animated = True
        self.animated |= item.rigid_body is not None
        for bone in item.pose.bones if item.pose else ():
            surface.text(bone.name, _rows(bone.matrix_basis))
            for constraint in bone.constraints:
                surface.struct(constraint, depth=2)
        light.text(*(getattr(item, name) for name in OBJECT_RAYS))
        light.block(item.light_linking.receiver_collection)
        light.block(item.light_linking.blocker_collection)
        for slot in item.material_slots:
            light.block(slot.material)

    def _animation(self, block: bpy.types.ID, digest: OwnDigest) -> None:
        for owner in (block, getattr(block, "node_tree", None), getattr(block, "shape_keys", None)):
            data = getattr(owner, "animation_data", None)
            if data is None or not (data.action or len(data.drivers) or len(data.nla_tracks)):
                continue
            curves = list(fcurves(data))
            self.animated |= len(data.drivers) > 0 or len(data.nla_tracks) > 0 or not all(map(_is_constant, curves))
            for curve in curves:
                digest.text(curve.data_path, curve.array_index, curve.mute, curve.extrapolation)
                for name in _KEYFRAME_VALUES:
                    digest.array(name, values_of(curve.keyframe_points, name, 2, np.float32))
            for driver in data.drivers:
                digest.text(driver.data_path, driver.array_index)
                digest.struct(driver.driver, depth=3)


def _other(block: bpy.types.ID, digest: OwnDigest) -> None:
    if isinstance(block, _WHOLE):
        digest.contents(block)
        return
    strands = isinstance(block, bpy.types.Curves | bpy.types.PointCloud)
    digest.struct(block, _SKIPPED_OF_STRANDS if strands else _SKIPPED_OF_DATA, depth=2)
    if (tree := getattr(block, "node_tree", None)) is not None:
        digest.contents(tree)
    if hasattr(block, "attributes"):
        digest.geometry(block)
    if isinstance(block, bpy.types.Volume | bpy.types.CacheFile):
        digest.file(bpy.path.abspath(block.filepath, library=block.library))


def _mesh(data: bpy.types.Mesh, surface: OwnDigest, light: OwnDigest) -> None:
    """Hash geometry for the surface, and all other attributes for the light."""
    if _POSITION in data.attributes:  # not in a mesh without vertices
        surface.attribute(data.attributes[_POSITION])
    surface.faces(data)
    surface.block(data.shape_keys)
    light.geometry(data, without=_POSITION)


def _moves(tree: bpy.types.NodeTree | None, met: set[bpy.types.NodeTree]) -> bool:
    """Return whether a tree of geometry nodes can differ between frames without keyframes; met: trees to pass over."""
    if tree is None or tree in met:
        return False
    met.add(tree)
    return any(node.bl_idname in _MOVING_NODES or _moves(getattr(node, "node_tree", None), met) for node in tree.nodes)


def _is_constant(curve: bpy.types.FCurve) -> bool:
    """Return whether a curve has one value at all frames."""
    heights = np.stack([values_of(curve.keyframe_points, name, 2, np.float32) for name in _KEYFRAME_VALUES]).ravel()[
        1::2
    ]
    return curve.mute or (len(curve.modifiers) == 0 and (heights == heights[:1]).all())


def may_appear(item: bpy.types.Object) -> bool:
    """Return whether an object that is not rendered has keyframes or a driver of that."""
    data = item.animation_data if item.hide_render else None
    return data is not None and any(curve.data_path == "hide_render" for curve in (*fcurves(data), *data.drivers))


def passed_over(block: bpy.types.ID) -> bool:
    """Return whether a data-block shows results, or exists only while a job runs."""
    return is_own(block) or block.is_runtime_data


def place_of_gloss(scene: bpy.types.Scene) -> str:
    """32 hex digits over the place of a scene's active camera; "no camera" without one.

    Cycles bakes gloss as seen from the position of a perspective camera, whatever its rotation, and as seen from the
    direction of an orthographic one. Objects that the camera follows are part of the surface, except other cameras.
    """
    item = scene.camera
    if item is None or item.type != "CAMERA":
        return "no camera"
    digest, local = Digest(), item.matrix_basis
    from_afar = item.data.type == "ORTHO"
    digest.text(from_afar, tuple(local.col[2].xyz.normalized() if from_afar else local.translation))
    for constraint in item.constraints:
        digest.struct(constraint, depth=2)
    while item.parent is not None:
        digest.text(item.parent.name_full, item.parent_type, item.parent_bone, _rows(item.matrix_parent_inverse))
        item = item.parent
        digest.text(_rows(item.matrix_basis))
    return digest.hexdigest()


def _rows(matrix: object) -> tuple[tuple[float, ...], ...]:
    return tuple(tuple(row) for row in matrix)  # type: ignore[attr-defined]
