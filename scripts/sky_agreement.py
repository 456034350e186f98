# SPDX-License-Identifier: GPL-3.0-or-later
"""How far the air of this package and Blender's own Sky Texture agree, over the picture of a clear sky.

    python scripts/sky_agreement.py [--size 48] [--ozone 0]

Both see the sun of the presets clear-noon and clear-sunset from 100 m. The texture has an absolute scale and a solar spectrum of
its own, so each channel is compared by its shape, divided by its mean over the sky, and the colour by the ratio blue / red, divided
by that of the sun above the air: 1 in the preset, SUN in the texture (the sun's spectrum outside the air in linear Rec. 709).
"""

from __future__ import annotations

import argparse
import math
import sys
from pathlib import Path

sys.path.insert(0, str(Path(__file__).resolve().parent.parent))

import numpy as np

# Spectral irradiance of the sun above the air at 460 and 615 nm, where the channels of Rec. 709 have their weight: ASTM E490.
SUN = 2.03 / 1.67
TYPES = {"single scattering": ("NISHITA", "SINGLE_SCATTERING"), "multiple scattering": ("MULTIPLE_SCATTERING",)}


def texture(scene, kind: str, stage, width: int, height: int, ozone: float) -> np.ndarray:
    """The picture (height, width, 3) of the world's Sky Texture as the Scene's camera sees it, without the sun's disc."""
    import bpy

    from volumetrics_addon.blender import build, compat, objects, render

    with build.temporary():
        built = bpy.data.scenes.new("Sky")
        built.camera = objects.camera(scene.camera, (0.1, 1e3), "Sky camera", built.collection)
        world = bpy.data.worlds.new("Sky")
        tree = compat.use_nodes(world)
        sky = tree.nodes.new("ShaderNodeTexSky")
        sky.sky_type, sky.sun_disc = kind, False
        sky.sun_elevation = math.radians(stage["sun_elevation"])
        sky.sun_rotation = math.radians(stage["sun_azimuth"])
        sky.altitude, sky.air_density, sky.ozone_density = stage["camera_location"][2], 1.0, ozone
        setattr(sky, "aerosol_density" if hasattr(sky, "aerosol_density") else "dust_density", 1.0)
        background = tree.nodes.new("ShaderNodeBackground")
        tree.links.new(sky.outputs[0], background.inputs[0])
        tree.links.new(background.outputs[0], tree.nodes.new("ShaderNodeOutputWorld").inputs[0])
        built.world = world
        built.render.engine, built.cycles.samples = "CYCLES", 16
        return render.render_built(built, width, height)[0]


def main() -> int:
    arguments = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    arguments.add_argument("--size", type=int, default=48)
    arguments.add_argument("--ozone", type=float, default=0.0)
    options = arguments.parse_args()
    import bpy

    from volumetrics_addon import verify
    from volumetrics_addon.parameters.preset import load
    from volumetrics_addon.reference import sky_tables
    from volumetrics_addon.scene import geometry

    print(f"Blender {bpy.app.version_string}, ozone {options.ozone:g}")
    kinds = bpy.types.ShaderNodeTexSky.bl_rna.properties["sky_type"].enum_items.keys()
    for name in ("clear-noon", "clear-sunset"):
        preset = load(name)
        scene = verify.scene_of(preset)
        width, height = verify.image_size(preset, options.size)
        ours = sky_tables.render(scene, width, height, strata=0).image
        x, y = (a.ravel() + 0.5 for a in np.meshgrid(np.arange(width), np.arange(height)))
        sky = geometry.camera_rays(scene.camera, width, height, x, y)[1][:, 2].reshape(height, width) > 0.01
        for label, names in TYPES.items():
            for kind in (kind for kind in names if kind in kinds):
                theirs = texture(scene, kind, preset.stage, width, height, options.ozone)
                shapes = [image[sky] / image[sky].mean(axis=0) for image in (ours, theirs)]
                rms = np.sqrt(((shapes[0] - shapes[1]) ** 2).mean(axis=0))
                colors = [image[sky].mean(axis=0) for image in (ours, theirs)]
                tint = [color[2] / color[0] for color in colors]
                print(f"{name:13} {label:20} shape RMS r g b {rms[0]:.0%} {rms[1]:.0%} {rms[2]:.0%}   "
                      f"blue / red {tint[0]:.2f} here, {tint[1] / SUN:.2f} there   scale {colors[1][1] / colors[0][1]:.3g}")
    return 0


if __name__ == "__main__":
    sys.exit(main())
