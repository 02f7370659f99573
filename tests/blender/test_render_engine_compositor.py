# SPDX-License-Identifier: GPL-3.0-or-later
"""Passes of the engine in the compositor and in files of File Output nodes."""

from pathlib import Path

import bpy
import numpy as np
import pytest

from patchnet.operators.render_engine.passes import PASSES
from patchnet.patchnet_addon.image.exr import read_exr
from patchnet.tests.blender.engine_scene import build_for_engine, exact_passes, rendered

# Later a node group, which several scenes may use.
_TREE_OF_SCENE = "compositing_node_group" not in bpy.types.Scene.bl_rna.properties
_SOCKETS = {"VALUE": "FLOAT"}  # what a File Output node calls them
_LETTERS = {1: "V", 3: "XYZ", 4: "RGBA"}  # by the number of channels, in its files


@pytest.fixture
def scene(registered: None, weights: Path, tmp_path: Path) -> bpy.types.Scene:
    return build_for_engine(weights, tmp_path)


@pytest.fixture
def layers(scene: bpy.types.Scene) -> bpy.types.Node:
    """The compositor's node with the passes of the scene's view layer, and the picture that it ends in."""
    bpy.context.view_layer.update_render_passes()
    if _TREE_OF_SCENE:
        scene.use_nodes = True
        tree = scene.node_tree
        tree.nodes.clear()
        end = tree.nodes.new("CompositorNodeComposite")
    else:
        tree = bpy.data.node_groups.new("Compositing", "CompositorNodeTree")
        scene.compositing_node_group = tree
        tree.interface.new_socket("Image", in_out="OUTPUT", socket_type="NodeSocketColor")
        end = tree.nodes.new("NodeGroupOutput")
    node = tree.nodes.new("CompositorNodeRLayers")
    node.scene = scene
    tree.links.new(node.outputs["Image"], end.inputs["Image"])
    return node


def socket_name(name: str) -> str:
    """Name of a pass in the compositor."""
    return "Image" if name == "Combined" else name


def write_passes(layers: bpy.types.Node, folder: Path) -> None:
    """A File Output node with a layer for each of the passes, into `folder`/nodes*.exr."""
    tree = layers.id_data
    node = tree.nodes.new("CompositorNodeOutputFile")
    exact_passes(node.format)
    if _TREE_OF_SCENE:
        node.base_path = str(folder / "nodes")
        node.layer_slots.clear()
    else:
        node.directory, node.file_name = str(folder), "nodes"
    for item in PASSES:
        socket = layers.outputs[socket_name(item.name)]
        if _TREE_OF_SCENE:
            node.layer_slots.new(item.name)
        else:
            node.file_output_items.new(_SOCKETS.get(socket.type, socket.type), item.name)
        tree.links.new(socket, node.inputs[item.name])


def test_files_of_nodes_hold_the_passes(scene: bpy.types.Scene, layers: bpy.types.Node, tmp_path: Path) -> None:
    write_passes(layers, tmp_path)
    own = rendered(scene)
    (path,) = tmp_path.glob("nodes*.exr")
    found = read_exr(path)
    for item in PASSES:
        letters = _LETTERS[len(item.channels)]
        written = np.stack([found[f"{item.name}.{letter}"] for letter in letters], axis=-1)
        assert np.array_equal(written, own[item.name]), item.name
        assert np.ptp(written[..., :3]) > 0.0, item.name
