# SPDX-License-Identifier: GPL-3.0-or-later
"""Every difference between Blender versions that the package meets, in one table."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

import bpy

from ..plan.model import CYCLES, EEVEE
from ..scene.model import NoiseShape, Volume

OLDEST = (4, 5, 0)


@dataclass(frozen=True)
class Version:
    """What one range of Blender versions does."""

    since: tuple[int, int, int]
    eevee: str  # identifier of the EEVEE engine
    exr_settings: tuple[tuple[str, str], ...]  # image settings that select one EXR, in this order
    use_nodes: bool  # materials, worlds and lights have to be told to use nodes
    homogeneous_flag: bool  # materials declare a homogeneous volume; later versions find out by themselves
    learns: bool  # Cycles learns from a render's samples where rays scatter in media, see plan.effort.learned_samples
    volume_biased: bool  # ray marching is an option beside unbiased null-scattering; before, it is the only way
    cell_hash: str  # random points of the Voronoi texture, see scene.model.NoiseShape
    compositing_group: bool  # the compositor's nodes are a node group that scenes use; before, a tree of the scene's own


TABLE = (
    Version((4, 5, 0), "BLENDER_EEVEE_NEXT", (("file_format", "OPEN_EXR"),), True, True, False, False, "lookup3", False),
    Version((5, 0, 0), "BLENDER_EEVEE", (("media_type", "IMAGE"), ("file_format", "OPEN_EXR")), False, False, True, True, "pcg3d", True),
)


def current() -> Version:
    """The row of the running Blender. Raises RuntimeError below the oldest supported version."""
    running = tuple(bpy.app.version)
    rows = [row for row in TABLE if row.since <= running]
    if not rows:
        raise RuntimeError(f"Blender {bpy.app.version_string} is too old; Volumetrics needs "
                           f"{'.'.join(map(str, OLDEST[:2]))} or newer")
    return rows[-1]


def engine_of(scene: bpy.types.Scene) -> str:
    """The engine that the scene is made for. Raises ValueError for one without samples."""
    known = {"CYCLES": CYCLES, current().eevee: EEVEE}
    if scene.render.engine not in known:
        raise ValueError(f"the scene's engine is {scene.render.engine}, which has no samples; choose Cycles or EEVEE")
    return known[scene.render.engine]


def use_nodes(datablock: Any) -> Any:
    """The node tree of a material, world or light, made and emptied."""
    if current().use_nodes:
        datablock.use_nodes = True
    tree = datablock.node_tree
    tree.nodes.clear()
    return tree


def select_exr(image_settings: Any) -> None:
    """Linear 32-bit float EXR without loss."""
    for name, value in current().exr_settings:
        setattr(image_settings, name, value)
    image_settings.color_mode = "RGB"
    image_settings.color_depth = "32"
    image_settings.exr_codec = "ZIP"


def as_evaluated(volume: Volume) -> Volume:
    """The volume with the random points that this Blender's textures have."""
    density = volume.medium.density
    if not isinstance(density, NoiseShape):
        return volume
    return replace(volume, medium=replace(volume.medium, density=replace(density, cell_hash=current().cell_hash)))


# Node types of a compositor that does nothing.
PLAIN_COMPOSITING = {"CompositorNodeRLayers", "CompositorNodeComposite", "CompositorNodeViewer", "NodeGroupOutput", "NodeGroupInput"}


def present_compositing_tree(scene: bpy.types.Scene) -> Any:
    """The compositor's node tree where the scene has one in use, or None."""
    if current().compositing_group:
        return scene.compositing_node_group
    return scene.node_tree if scene.use_nodes else None


def compositing_state(scene: bpy.types.Scene) -> bool:
    """Whether the scene has compositor nodes in use, for ``restore_compositing``."""
    return present_compositing_tree(scene) is not None


def compositing_tree(scene: bpy.types.Scene) -> Any:
    """The compositor's node tree, made where there is none: Render Layers linked to the output."""
    present = present_compositing_tree(scene)
    if present is not None:
        return present
    if current().compositing_group:
        tree = bpy.data.node_groups.new("Compositing", "CompositorNodeTree")
        tree.interface.new_socket("Image", in_out="OUTPUT", socket_type="NodeSocketColor")
        scene.compositing_node_group = tree
        output = tree.nodes.new("NodeGroupOutput")
    else:
        scene.use_nodes = True
        tree = scene.node_tree
        tree.nodes.clear()
        output = tree.nodes.new("CompositorNodeComposite")
    layers = tree.nodes.new("CompositorNodeRLayers")
    layers.scene = scene
    tree.links.new(layers.outputs["Image"], output.inputs[0])
    return tree


def restore_compositing(scene: bpy.types.Scene, state: bool) -> None:
    """Take away compositor nodes that were made for a scene that had none in use."""
    if state:
        return
    if current().compositing_group:
        tree, scene.compositing_node_group = scene.compositing_node_group, None
        if tree is not None and tree.users == 0:
            bpy.data.node_groups.remove(tree)
    elif scene.node_tree is not None:
        scene.node_tree.nodes.clear()
        scene.use_nodes = False
