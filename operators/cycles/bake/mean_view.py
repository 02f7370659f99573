# SPDX-License-Identifier: GPL-3.0-or-later
"""Mean over all views of diffuse light that depends on the view, in copies of materials.

A bake sees a surface from above. Nodes that depend on the angle of view use an oblique one. A rough diffuse surface and
sheen, which are brightest at grazing angles, are replaced by smooth diffuse surfaces that reflect as much on average.
The specular layer and the coat of a Principled BSDF, which dim what is below them, reflect as much from above as they
do on average.
"""

from __future__ import annotations

import operator
from collections.abc import Callable

import bpy

from ...scene.layer_names import all_nodes
from ...scene_access.blender_version import tree_in_use

_BY_ANGLE = ("LAYER_WEIGHT", "FRESNEL")
# Inputs by type of node: colour and roughness of diffuse light; colour, roughness and weights of sheen.
_ROUGH = {"BSDF_DIFFUSE": ("Color", "Roughness"), "BSDF_PRINCIPLED": ("Base Color", "Diffuse Roughness")}
_SHEEN = {
    "BSDF_SHEEN": ("Color", "Roughness"),
    "BSDF_PRINCIPLED": ("Sheen Tint", "Sheen Roughness", "Sheen Weight", "Alpha"),
}
_ROUGH_LOSS = 1.0 / 6.0  # of light on a surface of roughness 1 that meets it again
# Mean albedo of sheen: of roughness 1, and the exponent of roughness; measured in Cycles, within 0.02.
_ALBEDO = {"MICROFIBER": (0.447, 1.9), "ASHIKHMIN": (0.46, 1.3)}
_COAT = 0.0853, 0.0132  # for `_mean_fresnel`: loss by roughness, and share of roughness 1
_SPECULAR = {"GGX": _COAT, "MULTI_GGX": (0.0427, 0.1144)}


def needs_mean_view(tree: bpy.types.NodeTree, gloss: bool) -> bool:
    """Return whether `use_mean_view` changes anything in a tree or in a group of it."""
    return any(
        node.type in _BY_ANGLE or _is_by_view(node) or (not gloss and (_dims_by_view(node) or _has_coat(node)))
        for node in all_nodes(tree)
    )


def nodes_by_view(material: bpy.types.Material) -> tuple[str, ...]:
    """Names of shaders whose diffuse light depends on the view."""
    tree = tree_in_use(material)
    return () if tree is None else tuple(node.name for node in all_nodes(tree) if _is_by_view(node))


def use_mean_view(tree: bpy.types.NodeTree, gloss: bool) -> None:
    """Replace what depends on the view in a tree by its mean; groups in it are left to the caller.

    gloss: layers are baked themselves, as seen from above, and dim as much. The mean cosine of the angle of view is
    2/3.
    """
    for node in list(tree.nodes):
        if node.type in _BY_ANGLE and not node.inputs["Normal"].is_linked:
            tree.links.new(_oblique_normal(tree), node.inputs["Normal"])
        if _is_rough(node):
            _make_smooth(tree, node)
        if _has_sheen(node):
            _make_sheen_diffuse(tree, node)
        if not gloss and _dims_by_view(node):
            _use_mean_specular(tree, node)
        if not gloss and _has_coat(node):
            _use_mean_coat(tree, node)


def _is_by_view(node: bpy.types.Node) -> bool:
    return _is_rough(node) or _has_sheen(node)


def _is_rough(node: bpy.types.Node) -> bool:
    return node.type in _ROUGH and _is_set(node, _ROUGH[node.type][1])


def _has_sheen(node: bpy.types.Node) -> bool:
    return node.type == "BSDF_SHEEN" or (node.type == "BSDF_PRINCIPLED" and _is_set(node, "Sheen Weight"))


def _dims_by_view(node: bpy.types.Node) -> bool:
    """Return whether a specular layer dims what is below it."""
    return (
        node.type == "BSDF_PRINCIPLED"
        and _is_set(node, "Specular IOR Level")
        and not any(_is_all(node.inputs[name]) for name in ("Metallic", "Transmission Weight"))
    )


def _is_all(weight: bpy.types.NodeSocket) -> bool:
    return not weight.is_linked and weight.default_value >= 1.0


def _has_coat(node: bpy.types.Node) -> bool:
    return node.type == "BSDF_PRINCIPLED" and _is_set(node, "Coat Weight")


def _is_set(node: bpy.types.Node, name: str) -> bool:
    return node.inputs[name].is_linked or node.inputs[name].default_value > 0.0


def _make_smooth(tree: bpy.types.NodeTree, node: bpy.types.Node) -> None:
    """Make a rough diffuse surface smooth, and its colour c darker: c (1 - lost) / (1 - c lost)."""
    color, roughness = (node.inputs[name] for name in _ROUGH[node.type])
    share = _computed(tree, "VectorMath", "MULTIPLY", _source(tree, roughness), (_ROUGH_LOSS,) * 3)
    lost = _computed(tree, "VectorMath", "MULTIPLY", _source(tree, color), share)
    once = _computed(tree, "VectorMath", "SUBTRACT", _source(tree, color), lost)
    again = _computed(tree, "VectorMath", "SUBTRACT", (1.0,) * 3, lost)
    tree.links.new(_computed(tree, "VectorMath", "DIVIDE", once, again), color)
    _clear(tree, roughness)


def _make_sheen_diffuse(tree: bpy.types.NodeTree, node: bpy.types.Node) -> None:
    """Mix what is below the sheen of a shader with a diffuse surface; their share is weight times mean albedo."""
    color, roughness, *weights = (node.inputs[name] for name in _SHEEN[node.type])
    most, exponent = _ALBEDO[node.distribution if node.type == "BSDF_SHEEN" else "MICROFIBER"]
    diffuse, mix = tree.nodes.new("ShaderNodeBsdfDiffuse"), tree.nodes.new("ShaderNodeMixShader")
    share = _computed(tree, "Math", "POWER", _source(tree, roughness), exponent)
    share = _computed(tree, "Math", "MULTIPLY", share, most)
    for weight in weights:
        share = _computed(tree, "Math", "MULTIPLY", share, _source(tree, weight))
    tree.links.new(share, mix.inputs[0])
    for target in [link.to_socket for link in node.outputs[0].links]:
        tree.links.new(mix.outputs[0], target)
    if weights:
        tree.links.new(node.outputs[0], mix.inputs[1])
        _clear(tree, weights[0])
    tree.links.new(diffuse.outputs[0], mix.inputs[2])
    tree.links.new(_source(tree, color), diffuse.inputs["Color"])
    for link in node.inputs["Normal"].links:
        tree.links.new(link.from_socket, diffuse.inputs["Normal"])


class _Number:
    """Number in a tree, a constant or the output of a node; sums, products, quotients and powers are such, too."""

    def __init__(self, tree: bpy.types.NodeTree, value: bpy.types.NodeSocket | float) -> None:
        self.tree, self.value = tree, value

    def __add__(self, other: _Number | float) -> _Number:
        return self._with("ADD", operator.add, other)

    def __mul__(self, other: _Number | float) -> _Number:
        return self._with("MULTIPLY", operator.mul, other)

    def __truediv__(self, other: _Number | float) -> _Number:
        return self._with("DIVIDE", operator.truediv, other)

    def __pow__(self, other: _Number | float) -> _Number:
        return self._with("POWER", operator.pow, other)

    def _with(self, operation: str, fold: Callable[[float, float], float], other: _Number | float) -> _Number:
        term = other.value if isinstance(other, _Number) else other
        if isinstance(self.value, float) and isinstance(term, float):
            return _Number(self.tree, fold(self.value, term))
        return _Number(self.tree, _computed(self.tree, "Math", operation, self.value, term))

    @property
    def is_computed(self) -> bool:
        """Whether it is the output of a node."""
        return not isinstance(self.value, float)

    @property
    def vector(self) -> bpy.types.NodeSocket | tuple[float, ...]:
        return (self.value,) * 3 if isinstance(self.value, float) else self.value


def _use_mean_specular(tree: bpy.types.NodeTree, node: bpy.types.Node) -> None:
    """Tint the specular layer, whose reflectance from above is F0 times tint, by what it reflects on average."""
    ior, level, roughness = _inputs(tree, node, "IOR", "Specular IOR Level", "Roughness")
    root = (ior + -1.0) / (ior + 1.0)
    normal = root * root * level * 2.0
    if normal.value == 0.0:
        return
    tint, more = node.inputs["Specular Tint"], _mean_fresnel(normal, roughness, *_SPECULAR[node.distribution])
    less, more = more * -1.0 + 1.0, more / normal
    if tint.is_linked or less.is_computed:
        tinted = _computed(tree, "VectorMath", "MULTIPLY_ADD", _source(tree, tint), less.vector, more.vector)
        tree.links.new(tinted, tint)
    else:
        tint.default_value = (*(channel * less.value + more.value for channel in tint.default_value[:3]), 1.0)


def _use_mean_coat(tree: bpy.types.NodeTree, node: bpy.types.Node) -> None:
    """Raise the index of a coat so that it reflects from above as on average, and tint it for its mean depth."""
    ior, roughness = _inputs(tree, node, "Coat IOR", "Coat Roughness")
    square, tint = ior * ior, node.inputs["Coat Tint"]
    depth = square * ((((square**-1.0) * -1.0 + 1.0) ** 0.5) * -2.0 + 2.0)
    tree.links.new(_computed(tree, "VectorMath", "POWER", _source(tree, tint), depth.vector), tint)
    root = (ior + -1.0) / (ior + 1.0)
    normal = root * root
    mean = (_mean_fresnel(normal, roughness, *_COAT) * (normal * -1.0 + 1.0) + normal) ** 0.5
    raised = (mean + 1.0) / (mean * -1.0 + 1.0)
    if raised.is_computed:
        tree.links.new(raised.value, node.inputs["Coat IOR"])
    else:
        node.inputs["Coat IOR"].default_value = raised.value


def _mean_fresnel(normal: _Number, roughness: _Number, loss: float, rough: float) -> _Number:
    """Share E of the light that a layer lets through from above that it reflects in a mean view.

    normal: its reflectance F0 from above. E = 0.1923 F0^(1/3) (1 - F0)^4 loss^(roughness^2) + rough F0^(1/2)
    roughness^4, fitted to Diffuse Color of balls in Cycles: the light below errs by at most 0.0012 for F0 of 0.015 to
    0.1, and by 0.008 for 0.005 to 0.2. `test_layers_dim_as_the_mean_of_all_views` compares.
    """
    square = roughness * roughness
    smooth = normal ** (1.0 / 3.0) * ((normal * -1.0 + 1.0) ** 4.0) * 0.1923 * (_Number(normal.tree, loss) ** square)
    return smooth + normal**0.5 * rough * square * square


def _inputs(tree: bpy.types.NodeTree, node: bpy.types.Node, *names: str) -> list[_Number]:
    sockets = [node.inputs[name] for name in names]
    return [_Number(tree, each.links[0].from_socket if each.is_linked else each.default_value) for each in sockets]


def _source(tree: bpy.types.NodeTree, socket: bpy.types.NodeSocket) -> bpy.types.NodeSocket:
    """Output that an input is linked to, or one of its constant value."""
    if socket.is_linked:
        return socket.links[0].from_socket
    constant = tree.nodes.new("ShaderNodeRGB" if socket.type == "RGBA" else "ShaderNodeValue").outputs[0]
    constant.default_value = socket.default_value
    return constant


def _clear(tree: bpy.types.NodeTree, socket: bpy.types.NodeSocket) -> None:
    for link in list(socket.links):
        tree.links.remove(link)
    socket.default_value = 0.0


def _oblique_normal(tree: bpy.types.NodeTree) -> bpy.types.NodeSocket:
    """Direction whose cosine to the normal is 2/3: the normal and 1.118 times a unit vector across it."""
    normal = tree.nodes.new("ShaderNodeNewGeometry").outputs["Normal"]
    across = _computed(tree, "VectorMath", "CROSS_PRODUCT", normal, (0.48, 0.6, 0.64))
    across = _computed(tree, "VectorMath", "NORMALIZE", across)
    both = _computed(tree, "VectorMath", "MULTIPLY_ADD", across, (1.118,) * 3, normal)
    return _computed(tree, "VectorMath", "NORMALIZE", both)


def _computed(
    tree: bpy.types.NodeTree, kind: str, operation: str, *inputs: bpy.types.NodeSocket | tuple[float, ...] | float
) -> bpy.types.NodeSocket:
    """Output of a new node "Math" or "VectorMath"."""
    node = tree.nodes.new(f"ShaderNode{kind}")
    node.operation = operation
    for value, target in zip(inputs, node.inputs, strict=False):
        if isinstance(value, bpy.types.NodeSocket):
            tree.links.new(value, target)
        else:
            target.default_value = value
    return node.outputs[0]
