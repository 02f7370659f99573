# SPDX-License-Identifier: GPL-3.0-or-later
"""Random shapes: primitives, curves, text, metaballs, damaged meshes, their attributes and modifiers."""

from __future__ import annotations

from collections.abc import Sequence
from random import Random
from typing import Any

import bmesh
import bpy
from mathutils import Vector

from ....operators.demo_scene.geometry import add_object
from .materials import COLORS, UVS, VALUES, plain_material

_PRIMITIVES: dict[str, tuple[str, dict[str, Any]]] = {
    "Cube": ("cube", {"size": 1.6}),
    "Ball": ("icosphere", {"subdivisions": 3, "radius": 0.9}),
    "Sphere": ("uvsphere", {"u_segments": 16, "v_segments": 8, "radius": 0.9}),
    "Cone": ("cone", {"cap_ends": True, "segments": 12, "radius1": 0.9, "radius2": 0.2, "depth": 1.6}),
    "Tube": ("cone", {"cap_ends": False, "segments": 16, "radius1": 0.8, "radius2": 0.8, "depth": 1.6}),
    "Sheet": ("grid", {"x_segments": 4, "y_segments": 4, "size": 1.0}),
    "Monkey": ("monkey", {}),
}


def new_ground(rng: Random, own: Random) -> None:
    """Add a ground sheet or slab, or a room of six walls, most of the time. own: stream of its colour."""
    kind = rng.choices(("sheet", "slab", "room", "none"), (5, 2, 1, 2))[0]
    if kind == "none":
        return
    mesh = _primitive("Sheet" if kind == "sheet" else "Cube")
    item = _linked("Ground", mesh)
    mesh.materials.append(plain_material("Ground", [own.uniform(0.3, 0.8) for _ in range(3)]))
    if kind == "sheet":
        item.scale = (6.0, 6.0, 1.0)
    elif kind == "slab":
        item.scale, item.location = (7.0, 7.0, 0.25), (0.0, 0.0, -0.2)
    else:
        item.scale, item.location = (9.0, 9.0, 6.0), (0.0, 0.0, 4.8)
        mesh.flip_normals()


def new_shape(rng: Random, number: int, materials: Sequence[bpy.types.Material]) -> bpy.types.Object:
    """Add an object of a random kind with materials, attributes and modifiers, at the origin."""
    kind = rng.choices((*_PRIMITIVES, "Curve", "Text", "Metaball"), (4, 3, 2, 2, 2, 4, 2, 2, 1, 1))[0]
    name = f"{kind} {number}"
    if kind in _PRIMITIVES:
        item = _linked(name, _primitive(kind))
        _add_attributes(rng, item.data)
        _damage(rng, item.data)
    else:
        item = _linked(name, {"Curve": _curve, "Text": _text, "Metaball": _metaball}[kind](rng, name))
    for material in rng.sample(materials, rng.randint(min(1, len(materials)), len(materials))):
        item.data.materials.append(material)
    if kind in _PRIMITIVES:
        for polygon in item.data.polygons if len(item.data.materials) > 1 else ():
            polygon.material_index = rng.randint(0, 1)
    if kind != "Metaball":
        _add_modifiers(rng, item)
    return item


def _linked(name: str, data: bpy.types.ID) -> bpy.types.Object:
    data.name = name
    return add_object(bpy.context.scene.collection, name, data)


def _primitive(kind: str) -> bpy.types.Mesh:
    mesh, shape = bpy.data.meshes.new(kind), bmesh.new()
    shape.loops.layers.uv.new(UVS[0])
    operator, values = _PRIMITIVES[kind]
    getattr(bmesh.ops, f"create_{operator}")(shape, calc_uvs=True, **values)
    shape.to_mesh(mesh)
    shape.free()
    return mesh


def _curve(rng: Random, name: str) -> bpy.types.Curve:
    """A bevelled arc in space, or a filled outline."""
    curve = bpy.data.curves.new(name, "CURVE")
    curve.dimensions = rng.choice(("3D", "2D"))
    spline = curve.splines.new("BEZIER")
    spline.bezier_points.add(3)
    for point, (x, y) in zip(spline.bezier_points, ((-1, -1), (1, -1), (1, 1), (-1, 1)), strict=True):
        point.co = (x * rng.uniform(0.4, 1), y * rng.uniform(0.4, 1), rng.uniform(-0.5, 0.5))
        point.handle_left_type = point.handle_right_type = "AUTO"
    spline.use_cyclic_u = curve.dimensions == "2D" or rng.random() < 0.5
    curve.bevel_depth = 0.2 if curve.dimensions == "3D" else 0.0
    curve.extrude = rng.choice((0.0, 0.2))
    return curve


def _text(rng: Random, name: str) -> bpy.types.Curve:
    text = bpy.data.curves.new(name, "FONT")
    text.body, text.size, text.align_x, text.align_y = rng.choice(("Ab", "8", "O")), 2.4, "CENTER", "CENTER"
    text.extrude, text.bevel_depth = rng.choice((0.0, 0.2)), rng.choice((0.0, 0.03))
    return text


def _metaball(rng: Random, name: str) -> bpy.types.MetaBall:
    ball = bpy.data.metaballs.new(name)
    ball.resolution = ball.render_resolution = 0.2
    for _ in range(2):
        ball.elements.new(type=rng.choice(("BALL", "CUBE"))).co = [rng.uniform(-0.5, 0.5) for _ in range(3)]
    return ball


def _add_attributes(rng: Random, mesh: bpy.types.Mesh) -> None:
    """Attributes and UV maps that materials may ask for; some objects lack them."""
    if rng.random() < 0.6:
        colors = mesh.color_attributes.new(COLORS, *rng.choice((("FLOAT_COLOR", "POINT"), ("BYTE_COLOR", "CORNER"))))
        for value in colors.data:
            value.color = [rng.random() for _ in range(4)]
    if rng.random() < 0.5:
        values = mesh.attributes.new(VALUES, "FLOAT", rng.choice(("POINT", "FACE", "CORNER")))
        for value in values.data:
            value.value = rng.random()
    if rng.random() < 0.4:
        other = mesh.uv_layers.new(name=UVS[1])
        for value in other.uv:
            value.vector = 2.0 * value.vector + Vector((0.3, 0.1))
        mesh.uv_layers[UVS[1]].active_render = rng.random() < 0.5
    if rng.random() < 0.1 and mesh.uv_layers:
        mesh.uv_layers.remove(mesh.uv_layers[0])


def _damage(rng: Random, mesh: bpy.types.Mesh) -> None:
    """Smooth shading, normals of users, and faults that meshes have: flipped, open, with fins."""
    if rng.random() < 0.4:
        mesh.shade_smooth()
    fault = rng.choices(("", "flipped", "some flipped", "open", "fin", "normals"), (12, 2, 1, 2, 1, 1))[0]
    if fault == "flipped":
        mesh.flip_normals()
    elif fault == "normals":
        mesh.normals_split_custom_set_from_vertices([(0.0, 0.0, 1.0)] * len(mesh.vertices))
    elif fault:
        shape = bmesh.new()
        shape.from_mesh(mesh)
        shape.faces.ensure_lookup_table()
        some = [shape.faces[index] for index in rng.sample(range(len(shape.faces)), max(1, len(shape.faces) // 5))]
        if fault == "some flipped":
            bmesh.ops.reverse_faces(shape, faces=some)
        elif fault == "open":
            bmesh.ops.delete(shape, geom=some, context="FACES")
        else:
            edge = some[0].edges[0]
            top = shape.verts.new(edge.verts[0].co * 1.6)
            shape.faces.new((*edge.verts, top))
        shape.to_mesh(mesh)
        shape.free()


_MODIFIERS: dict[str, dict[str, Any]] = {
    "SUBSURF": {"levels": 1, "render_levels": 2},
    "SOLIDIFY": {"thickness": 0.15},
    "MIRROR": {"use_bisect_axis": (True, False, False)},
    "ARRAY": {"count": 2, "relative_offset_displace": (1.2, 0.1, 0.0)},
    "BEVEL": {"width": 0.1, "segments": 2},
    "DISPLACE": {"strength": 0.2},
    "WIREFRAME": {"thickness": 0.15},
    "DECIMATE": {"ratio": 0.5},
    "EDGE_SPLIT": {},
    "SIMPLE_DEFORM": {"deform_method": "TWIST", "angle": 0.8},
    "NODES": {},
}
_FOR_CURVES = ("SUBSURF", "SOLIDIFY", "ARRAY", "BEVEL", "DECIMATE", "NODES")


def _add_modifiers(rng: Random, item: bpy.types.Object) -> None:
    """Add at most two modifiers, some of which renders or viewports alone show."""
    for _ in range(rng.choices((0, 1, 2), (5, 3, 1))[0]):
        kind = rng.choice(tuple(_MODIFIERS) if item.type == "MESH" else _FOR_CURVES)
        modifier = item.modifiers.new(kind.title(), kind)
        for name, value in _MODIFIERS[kind].items():
            setattr(modifier, name, value)
        if kind == "NODES":
            modifier.node_group = _instancing_nodes(rng, item.name)
        modifier.show_viewport, modifier.show_render = rng.choices(
            ((True, True), (False, True), (True, False)), (8, 1, 1)
        )[0]


def _instancing_nodes(rng: Random, name: str) -> bpy.types.NodeTree:
    """Geometry nodes that put cubes on the points of what comes in, or join it with a scaled instance of itself."""
    tree = bpy.data.node_groups.new(f"Nodes of {name}", "GeometryNodeTree")
    for way in ("INPUT", "OUTPUT"):
        tree.interface.new_socket("Geometry", in_out=way, socket_type="NodeSocketGeometry")
    given, result = tree.nodes.new("NodeGroupInput").outputs[0], tree.nodes.new("NodeGroupOutput").inputs[0]
    joined, points = tree.nodes.new("GeometryNodeJoinGeometry"), tree.nodes.new("GeometryNodeInstanceOnPoints")
    line, cube = tree.nodes.new("GeometryNodeMeshLine"), tree.nodes.new("GeometryNodeMeshCube")
    cube.inputs["Size"].default_value = (0.3, 0.3, 0.3)
    line.inputs["Count"].default_value, line.inputs["Offset"].default_value = 3, (0.7, 0.0, 0.6)
    points.inputs["Scale"].default_value = (rng.uniform(0.4, 0.8),) * 3
    tree.links.new(line.outputs[0], points.inputs["Points"])
    tree.links.new(rng.choice((cube.outputs[0], given)), points.inputs["Instance"])
    last = points.outputs[0]
    if rng.random() < 0.3:
        realized = tree.nodes.new("GeometryNodeRealizeInstances")
        tree.links.new(last, realized.inputs[0])
        last = realized.outputs[0]
    tree.links.new(last, joined.inputs[0])
    tree.links.new(given, joined.inputs[0])
    tree.links.new(joined.outputs[0], result)
    return tree
