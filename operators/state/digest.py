# SPDX-License-Identifier: GPL-3.0-or-later
"""Hash over Blender's data: properties as RNA enumerates them, node trees, images, arrays of geometry.

It is equal in every process that opens the same file, and changes with everything that a render can show. Properties
that only the interface shows are left out where they are known; unknown properties count.
"""

from __future__ import annotations

import hashlib
import os
from functools import cache
from typing import Any

import bpy
import numpy as np

from ..scene_access.blender_version import NODES_ARE_OPTIONAL

_IMAGE_KEYS = (
    "source", "alpha_mode", "generated_type", "generated_width", "generated_height", "use_half_precision",
    "use_deinterlace",
)  # fmt: skip
# Data type of an attribute that Cycles evaluates -> key of its values, their width and type.
ATTRIBUTE_KINDS: dict[str, tuple[str, int, type]] = {
    "FLOAT": ("value", 1, np.float32), "FLOAT2": ("vector", 2, np.float32), "FLOAT_VECTOR": ("vector", 3, np.float32),
    "FLOAT_COLOR": ("color", 4, np.float32), "BYTE_COLOR": ("color", 4, np.float32), "INT": ("value", 1, np.int32),
    "INT8": ("value", 1, np.int32), "BOOLEAN": ("value", 1, np.bool_), "QUATERNION": ("value", 4, np.float32),
    "FLOAT4": ("vector", 4, np.float32),
}  # fmt: skip
_ATTRIBUTES = ATTRIBUTE_KINDS | {
    "INT32_2D": ("value", 2, np.int32), "INT16_2D": ("value", 2, np.int16), "FLOAT4X4": ("value", 16, np.float32),
}  # fmt: skip
_OF_POINTS = {"co": 4, "weight": 1, "tilt": 1, "radius": 1}
_OF_BEZIER_POINTS = {"co": 3, "handle_left": 3, "handle_right": 3, "tilt": 1, "radius": 1}
_CORNERS = ".corner_vert"
_DEPTH = 6
# Modifiers whose UV coordinates and colours at corners differ in their last bits at each evaluation: Blender sums the
# values at a vertex in an order that depends on memory addresses.
_UNSTEADY = frozenset({"BEVEL"})


def names(text: str) -> frozenset[str]:
    """Split a text into its words."""
    return frozenset(text.split())


_SKIPPED = names(
    """rna_type original session_uid id_data id_type is_evaluated preview users animation_data asset_data
    override_library library_weak_reference use_extra_user use_fake_user is_library_indirect is_embedded_data is_missing
    is_editable is_runtime_data tag depsgraph node_tree bindcode execution_time info is_outdated"""
)
if not NODES_ARE_OPTIONAL:
    _SKIPPED |= {"use_nodes"}
# Of nodes: their appearance in the editor; sockets are hashed separately.
_SKIPPED_OF_NODES = names(
    """location location_absolute width width_hidden height dimensions select show_options show_preview show_texture
    hide label parent color color_tag use_custom_color inputs outputs internal_links"""
)
# Of modifiers: their appearance in the interface. Inputs of geometry nodes are hashed separately.
_SKIPPED_OF_MODIFIERS = names(
    "name show_expanded show_in_editmode show_on_cage is_active use_pin_to_last persistent_uid properties node_warnings"
)


class Digest:
    """Incremental hash; a data-block adds its contents once, and only its name after that."""

    def __init__(self) -> None:
        self._hash = hashlib.blake2b(digest_size=16)
        self._texts: list[str] = []  # not hashed yet
        self._met: set[int] = set()  # by address: evaluated copies share their original's name

    def hexdigest(self) -> str:
        """32 hex digits."""
        self._flush()
        return self._hash.hexdigest()

    def text(self, *values: Any) -> None:
        """Plain values, by their repr."""
        self._texts.append(repr(values))

    def array(self, name: str, values: np.ndarray | None) -> None:
        """Hash an array with its type and shape."""
        if values is None:
            self.text(name, None)
            return
        self.text(name, values.dtype.str, values.shape)
        self._flush()
        self._hash.update(np.ascontiguousarray(values).reshape(-1).view(np.uint8).data)

    def _flush(self) -> None:
        self._hash.update(";".join((*self._texts, "")).encode("utf-8", "surrogatepass"))
        self._texts.clear()

    def block(self, block: bpy.types.ID | None) -> None:
        """Hash a data-block: its name, and its contents if it is new here."""
        if block is None:
            self.text(None)
            return
        self.text(type(block).__name__, block.name_full)
        if block.as_pointer() in self._met:
            return
        self._met.add(block.as_pointer())
        self.contents(block)

    def contents(self, block: bpy.types.ID) -> None:
        """Hash the contents of a data-block."""
        if isinstance(block, bpy.types.Image):
            self._image(block)
        elif isinstance(block, bpy.types.NodeTree):
            self._tree(block)
        elif isinstance(block, bpy.types.Text):
            self.text(block.as_string())
        elif isinstance(block, bpy.types.Object):
            self.text(tuple(map(tuple, block.matrix_world)), block.type)
        elif isinstance(block, bpy.types.Collection):
            for item in block.all_objects:
                self.block(item)
            for entry in (*block.collection_children, *block.collection_objects):
                self.text(entry.light_linking.link_state)
        elif isinstance(block, bpy.types.Curve):
            self._curve(block)
        elif hasattr(block, "attributes"):
            self.geometry(block)
        elif not isinstance(block, bpy.types.Scene | bpy.types.Library):
            self.struct(block)
            self.block(getattr(block, "node_tree", None))

    def struct(self, owner: bpy.types.bpy_struct, skipped: frozenset[str] = frozenset(), depth: int = _DEPTH) -> None:
        """Hash all properties, those of nested settings too."""
        self.text(owner.bl_rna.identifier)
        for key, kind, is_array in _properties_of(type(owner)):  # type: ignore[arg-type]
            if key in skipped:
                continue
            try:
                value = getattr(owner, key)
            except (AttributeError, ValueError, RuntimeError, TypeError):
                continue  # not readable in this state
            self.text(key)
            self._value(kind, is_array, value, depth)

    def modifier(self, modifier: bpy.types.Modifier, depth: int = _DEPTH) -> None:
        """Hash a modifier, with its inputs of geometry nodes."""
        self.struct(modifier, _SKIPPED_OF_MODIFIERS, depth)
        if modifier.type != "NODES" or modifier.node_group is None:
            return
        inputs = getattr(getattr(modifier, "properties", None), "inputs", None)
        if inputs is None:  # custom properties until Blender 5.1
            for key in sorted(modifier.keys()):
                self.text(key)
                self._input(modifier[key])
            return
        for socket in inputs.bl_rna.properties:  # of each node group others: not for `_properties_of`
            if socket.type == "POINTER" and socket.identifier != "rna_type":
                given = getattr(inputs, socket.identifier)
                self.text(socket.identifier)
                for prop in given.bl_rna.properties:
                    if prop.identifier != "rna_type":
                        self._input(getattr(given, prop.identifier))

    def particles(self, system: bpy.types.ParticleSystem) -> None:
        """Hash a particle system, with combed hair."""
        self.text(system.name, system.seed)
        self.block(system.settings)
        for particle in system.particles if system.is_edited else ():
            self.array("hair", values_of(particle.hair_keys, "co_local", 3, np.float32))

    def _input(self, value: Any) -> None:
        if isinstance(value, bpy.types.ID):
            self.block(value)
        else:
            plain = value is None or isinstance(value, bool | int | float | str)
            self.text(value if plain else tuple(value))

    def _value(self, kind: str, is_array: bool, value: Any, depth: int) -> None:
        if kind == "POINTER":
            if isinstance(value, bpy.types.ID):
                self.block(value)
            elif value is not None and depth > 0:
                self.struct(value, depth=depth - 1)
        elif kind == "COLLECTION":
            for item in value if depth > 0 else ():
                if item is None or isinstance(item, bpy.types.ID):  # slots may be empty
                    self.block(item)
                else:
                    self.struct(item, depth=depth - 1)
        elif is_array:
            rows = tuple(value)
            plain = not rows or isinstance(rows[0], bool | int | float)
            self.text(rows if plain else tuple(map(tuple, rows)))
        else:
            self.text(sorted(value) if isinstance(value, set) else value)

    def _tree(self, tree: bpy.types.NodeTree) -> None:
        for node in tree.nodes:
            self.text(node.bl_idname, node.name)
            self.struct(node, _SKIPPED_OF_NODES)
            self.block(getattr(node, "node_tree", None))
            for socket in (*node.inputs, *node.outputs):
                self.text(socket.identifier)
                self._input(getattr(socket, "default_value", None))
        for link in tree.links:
            ends = link.from_node.name, link.from_socket.identifier, link.to_node.name, link.to_socket.identifier
            self.text(*ends, link.is_muted)

    def _image(self, image: bpy.types.Image) -> None:
        self.text(*(getattr(image, key) for key in _IMAGE_KEYS))
        self.text(tuple(image.generated_color), image.colorspace_settings.name)
        if image.source == "GENERATED" or image.is_dirty:  # painted, or made by a script
            pixels = np.empty(len(image.pixels), np.float32)
            image.pixels.foreach_get(pixels)
            self.array("pixels", pixels)
        for packed in image.packed_files:
            content = packed.packed_file.data if packed.packed_file else None
            self.text(hashlib.blake2b(content or b"", digest_size=16).hexdigest())
        if not image.packed_files and image.source != "GENERATED":
            for number in [tile.number for tile in image.tiles]:
                name = image.filepath.replace("<UDIM>", str(number))
                self.file(bpy.path.abspath(name, library=image.library))

    def _curve(self, curve: bpy.types.Curve) -> None:
        """Hash settings, and the points of all splines as arrays, which is faster than point by point."""
        self.struct(curve, names("splines materials"))
        for spline in curve.splines:
            self.struct(spline, names("points bezier_points"))
            for points, widths in ((spline.points, _OF_POINTS), (spline.bezier_points, _OF_BEZIER_POINTS)):
                for key, width in widths.items():
                    self.array(key, values_of(points, key, width, np.float32))
        for material in curve.materials:
            self.block(material)

    def file(self, path: str) -> None:
        """Hash an external file by its size and time; a missing file counts, too."""
        try:
            state = os.stat(path)
        except OSError:
            self.text(path, None)
            return
        self.text(path, state.st_size, state.st_mtime_ns)

    def geometry(self, data: Any, without: str = "") -> None:
        """Hash the attributes of a mesh, hair or points, `without` one, and faces, but no selection of Edit Mode."""
        for attribute in data.attributes:
            if attribute.name.startswith(".") or attribute.name == without or attribute.data_type not in _ATTRIBUTES:
                continue
            self.attribute(attribute)
        self.faces(data)
        for material in data.materials:
            self.block(material)

    def attribute(self, attribute: bpy.types.Attribute) -> None:
        """Values of an attribute of a supported type."""
        key, width, dtype = _ATTRIBUTES[attribute.data_type]
        self.array(f"{attribute.name} {attribute.domain}", values_of(attribute.data, key, width, dtype))

    def faces(self, data: Any) -> None:
        """Hash the vertex indices of a mesh's faces and where each begins, or the first points of strands of hair."""
        if isinstance(data, bpy.types.Curves) and len(data.curves):  # without any, offsets cannot be read
            self.array("strands", values_of(data.curve_offset_data, "value", 1, np.int32))
        if not isinstance(data, bpy.types.Mesh):
            return
        self.array("loops", vertices_of_corners(data))
        self.text(len(data.polygons))
        if len(data.loops) != 3 * len(data.polygons):  # else all are triangles: this is slow
            self.array("polygons", values_of(data.polygons, "loop_start", 1, np.int32))


def composed(*parts: object) -> str:
    """Key (32 hex digits) of hashes and other values."""
    digest = Digest()
    digest.text(*parts)
    return digest.hexdigest()


def origin_of_corners(item: bpy.types.Object) -> str:
    """32 hex digits over the user's own mesh and the modifiers of an evaluated object; "" where values are steady.

    It replaces unsteady corner values in hashes, so that a scene has the same key in each process, and a stopped bake
    can resume in another one.
    """
    if not any(modifier.type in _UNSTEADY for modifier in item.modifiers):
        return ""
    digest = Digest()
    digest.block(item.original.data)
    for modifier in item.modifiers:
        digest.modifier(modifier)
    return digest.hexdigest()


def vertices_of_corners(mesh: bpy.types.Mesh) -> np.ndarray:
    """(L,) int32 vertex of each corner of a mesh's faces."""
    corners = mesh.attributes.get(_CORNERS)  # the same as of `loops`, many times faster
    return values_of(*((corners.data, "value") if corners else (mesh.loops, "vertex_index")), 1, np.int32)


@cache  # listing properties takes longer than reading values
def _properties_of(kind: type[bpy.types.bpy_struct]) -> list[tuple[str, str, bool]]:
    """Identifier and type of each hashed property of a type, and whether it is an array."""
    return [
        (prop.identifier, prop.type, getattr(prop, "is_array", False))
        for prop in kind.bl_rna.properties
        if prop.identifier not in _SKIPPED and not prop.identifier.startswith("bl_")
    ]


def values_of(items: Any, key: str, width: int, dtype: type) -> np.ndarray:
    """Values of one property of all items of a collection: (len(items) * width,)."""
    values: np.ndarray = np.empty(len(items) * width, dtype)
    if len(items):
        items.foreach_get(key, values)
    return values
