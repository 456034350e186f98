# SPDX-License-Identifier: GPL-3.0-or-later
"""Open Image Denoise on a picture in memory, as the compositor has it."""

from __future__ import annotations

import tempfile
from pathlib import Path

import bpy
import numpy as np

from . import build, compat, render


def denoised(image: np.ndarray) -> np.ndarray:
    """The picture (height, width, 3), linear and >= 0, without what looks like noise; row 0 at the top, float64.

    Open Image Denoise (Afra, 2024) with the colour alone, in full quality. The same picture gives the same result.
    Raises RenderError where the compositor writes nothing.
    """
    height, width = image.shape[:2]
    with build.temporary(), tempfile.TemporaryDirectory(prefix="volumetrics") as folder:
        noisy = bpy.data.images.new("Volumetrics noisy", width, height, float_buffer=True, is_data=True)
        rgba = np.ones((height, width, 4), np.float32)
        rgba[..., :3] = image[::-1]
        noisy.pixels.foreach_set(rgba.ravel())
        scene = bpy.data.scenes.new("Volumetrics denoising")
        scene.camera = bpy.data.objects.new("Volumetrics camera", bpy.data.cameras.new("Volumetrics camera"))
        scene.collection.objects.link(scene.camera)
        settings = scene.render
        settings.engine, settings.use_sequencer, settings.use_compositing = "CYCLES", False, True
        settings.resolution_x, settings.resolution_y, settings.resolution_percentage = width, height, 100
        settings.compositor_device, settings.compositor_precision = "CPU", "FULL"
        settings.dither_intensity, settings.use_stamp = 0.0, False
        scene.view_layers[0].use = False  # nothing is rendered
        compat.select_exr(settings.image_settings)
        tree = compat.compositing_tree(scene)
        source = tree.nodes.new("CompositorNodeImage")
        source.image = noisy
        denoise = tree.nodes.new("CompositorNodeDenoise")
        tree.links.new(source.outputs["Image"], denoise.inputs["Image"])
        for node in tree.nodes:
            if node.bl_idname in ("CompositorNodeComposite", "NodeGroupOutput"):
                tree.links.new(denoise.outputs["Image"], node.inputs[0])
        path = Path(folder) / "denoised.exr"
        settings.filepath, settings.use_file_extension = str(path), True
        with render.silenced(True):
            bpy.ops.render.render(write_still=True, scene=scene.name)
        if not path.exists():
            raise render.RenderError("the compositor wrote no denoised picture")
        return render.read_image(path)
