# SPDX-License-Identifier: GPL-3.0-or-later
"""How far each realisation of glass is from Beer-Lambert and Fresnel, by optical depth, angle and size, in both engines.

    python scripts/glass_residual.py [--engines cycles,eevee] [--samples 16384] [--only ball,sheet]

Under uniform light of radiance 1 a camera sees what a body mirrors and lets through, R + T. A row is a ball 2 units wide or a
plate one unit thick, hit at an angle to its normal; the optical depth is that along the normal, over the diameter of a ball and
over both walls of a shell. Expected is the integrator of glass over the pixel, which tests compare with closed forms. Printed
is the relative deviation. Uniform light hides where EEVEE sends the light: see the errors of the presets for that.
"""

from __future__ import annotations

import argparse
import math
import sys
from pathlib import Path

sys.path.insert(0, str(Path(__file__).resolve().parent.parent))

import bpy  # noqa: E402
import numpy as np  # noqa: E402

from volumetrics_addon import verify  # noqa: E402
from volumetrics_addon.blender import compat, items, mesh_glass, objects, render, settings  # noqa: E402
from volumetrics_addon.parameters.families import FAMILIES  # noqa: E402
from volumetrics_addon.parameters.preset import Preset  # noqa: E402
from volumetrics_addon.parameters.stage import STAGE  # noqa: E402
from volumetrics_addon.plan.rules import plan  # noqa: E402
from volumetrics_addon.reference import dielectric  # noqa: E402
from volumetrics_addon.scene.assemble import body  # noqa: E402

PLATE, BALL = {"size": (60.0, 1.0, 60.0), "thickness": 1.0}, {"size": (2.0, 2.0, 2.0), "thickness": 0.2}
# Name: the values of the family glass, and the length along the normal on which the optical depth counts.
REALISATIONS = {
    "block": ({**PLATE, "shape": "block"}, 1.0),
    "thin pane": ({**PLATE, "shape": "sheet"}, 1.0),
    "ball": ({**BALL, "shape": "sphere"}, 2.0),
    "shell": ({**BALL, "shape": "shell"}, 0.4),
    "mesh, a slab": ({**PLATE, "shape": "block"}, 1.0),
    "mesh, a ball": ({**BALL, "shape": "sphere"}, 2.0),
    "mesh, a ball, unaided": ({**BALL, "shape": "sphere"}, 2.0),
    "thin pane, straight": ({**PLATE, "shape": "sheet", "refraction": False}, 1.0),
    "block, straight": ({**PLATE, "shape": "block", "refraction": False}, 1.0),
    "ball, straight": ({**BALL, "shape": "sphere", "refraction": False}, 2.0),
}
DEPTHS, ANGLES, SIZES = (0.1, 0.3, 1.0, 3.0), (0.0, 30.0, 60.0, 75.0), (1e-3, 1e-2, 0.1, 1.0)
DEPTH, ANGLE, SIZE = 1.0, 30.0, 0.1  # of the columns that vary something else
PIXELS = 5  # along a side, where Blender makes at least 4; the one in the middle counts
EEVEE_SAMPLES = 16


def preset(name: str, depth: float, angle: float, size: float) -> Preset:
    """The realisation with a unit of ``size`` m, and a camera whose middle ray meets it at the angle (degrees)."""
    values, length = REALISATIONS[name]
    radians = math.radians(angle)
    values = {key: tuple(size * v for v in value) if key == "size" else size * value if key == "thickness" else value
              for key, value in values.items()}
    values |= {"location": (0.0, 0.0, 0.0), "color": (math.exp(-1.0),) * 3, "distance": size * length / depth, "ior": 1.5}
    if "sphere" == values["shape"] or "shell" == values["shape"]:
        across = size * math.sin(radians)
        eye, target = (across, -10.0 * size, 0.0), (across, 0.0, 0.0)
    else:
        eye, target = (-10.0 * size * math.sin(radians), -10.0 * size * math.cos(radians), 0.0), (0.0, 0.0, 0.0)
    stage = {"camera_location": eye, "camera_target": target, "field_of_view": 1.0, "environment_radiance": 1.0}
    return Preset("residual", "glass", name, "", FAMILIES["glass"].check(values), STAGE.check(stage))


def middle(image: np.ndarray) -> float:
    return float(image[PIXELS // 2, PIXELS // 2].mean())


def expected(chosen: Preset) -> float:
    """Exact rays without noise; bodies without a surface have their path alone."""
    scene = verify.scene_of(chosen)
    return middle(dielectric.render(scene, PIXELS, PIXELS, repeats=4, strata=6).image)


class OwnMesh:
    """A mesh of glass in a scene of its own: measured once, then seen at every depth, angle and size."""

    def __init__(self, name: str):
        bpy.ops.wm.read_factory_settings(use_empty=True)
        self.scene = bpy.context.scene
        if name.startswith("mesh, a ball"):
            bpy.ops.mesh.primitive_ico_sphere_add(subdivisions=6, radius=1.0)
            for polygon in bpy.context.object.data.polygons:
                polygon.use_smooth = True
        else:
            bpy.ops.mesh.primitive_grid_add(x_subdivisions=60, y_subdivisions=60, size=60.0, rotation=(math.pi / 2.0, 0.0, 0.0))
            solid = bpy.context.object.modifiers.new("thickness", "SOLIDIFY")
            solid.thickness, solid.offset = 1.0, 0.0
        self.object = bpy.context.object
        bpy.context.view_layer.update()
        mesh_glass.apply(self.scene, self.object, {"ior": 1.5, "color": (math.exp(-1.0),) * 3, "distance": 1.0})
        if name.endswith("unaided"):  # in EEVEE too a Glass BSDF with a volume inside, as Cycles has it
            tree = self.object.active_material.node_tree
            node = next(n for n in tree.nodes if n.bl_idname == "ShaderNodeGroup")
            output = next(n for n in tree.nodes if n.bl_idname == "ShaderNodeOutputMaterial" and n.target == "EEVEE")
            tree.links.remove(output.inputs["Thickness"].links[0])
            for part in ("Surface", "Volume"):
                tree.links.new(node.outputs[f"Cycles {part}"], output.inputs[part])
        self.scene.world = objects.world((1.0, 1.0, 1.0), "world")

    def picture(self, chosen: Preset, engine: str, samples: int) -> float:
        values, unit = chosen.parameters, chosen.parameters["size"][0] / REALISATIONS[chosen.label][0]["size"][0]
        self.object.scale = (unit,) * 3
        sockets = {socket.name: socket for socket in items.live_node_of([self.object]).inputs}
        sockets["Distance"].default_value = values["distance"]
        scene = verify.scene_of(chosen)
        self.scene.camera = objects.camera(scene.camera, (1e-3 * unit, 200.0 * unit), "camera", self.scene.collection)
        wanted = plan(scene, [body("glass", values, scene.volumes)], engine, samples,
                      has_null_scattering=compat.current().volume_biased)
        settings.apply(self.scene, wanted.settings)
        self.scene.render.engine = "CYCLES" if engine == "cycles" else compat.current().eevee
        return middle(render.render_built(self.scene, PIXELS, PIXELS)[0])


def picture(chosen: Preset, engine: str, samples: int) -> float:
    return middle(render.render(chosen, verify.scene_of(chosen), engine, PIXELS, PIXELS, samples).images[0])


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--engines", default="cycles,eevee")
    parser.add_argument("--samples", type=int, default=16384, help="of Cycles")
    parser.add_argument("--only", default="", help="realisations whose names contain one of these")
    arguments = parser.parse_args()
    columns = [(f"depth {d:g}", d, ANGLE, SIZE) for d in DEPTHS] + [(f"{a:g} deg", DEPTH, a, SIZE) for a in ANGLES if a != ANGLE]
    columns += [(f"{1e3 * s:g} mm", DEPTH, ANGLE, s) for s in SIZES if s != SIZE]
    print(f"Blender {bpy.app.version_string}. Depth {DEPTH:g}, {ANGLE:g} deg and a unit of {1e3 * SIZE:g} mm but for what a "
          "column names.\n")
    print("| realisation | engine | " + " | ".join(label for label, *_ in columns) + " |")
    print("|---" * (len(columns) + 2) + "|")
    for name in REALISATIONS:
        if not any(word in name for word in arguments.only.split(",")):
            continue
        shots = [preset(name, *numbers) for _, *numbers in columns]
        truth = [expected(shot) for shot in shots]
        own = OwnMesh(name) if name.startswith("mesh") else None
        for engine in arguments.engines.split(","):
            samples = arguments.samples if engine == "cycles" else EEVEE_SAMPLES
            seen = [(own.picture if own else picture)(shot, engine, samples) for shot in shots]
            cells = [f"{value / true - 1.0:+.1%}" for value, true in zip(seen, truth)]
            print(f"| {name} | {'Cycles' if engine == 'cycles' else 'EEVEE'} | " + " | ".join(cells) + " |", flush=True)


if __name__ == "__main__":
    main()
