# SPDX-License-Identifier: GPL-3.0-or-later
"""Seconds to an error for every cloud, against the same look made the usual way, in one run.

    python scripts/bench_clouds.py [--size 48] [--error 0.1] [--limit 60] [--ways full,octaves,usual] [--out out/clouds.csv] [PRESET ...]

Ours: the plan's settings and representation, in full and by octaves, and in full with nodes and with voxels. The usual way: the
same noise as nodes in a Principled Volume with one lobe of the same mean cosine, Cycles' stock settings, 12 bounces. Each is
measured against path tracing on its own density, at pixel centres, with samples doubled until the error is reached or the limit
passed. Seconds are those of all processors together, which other work on the machine changes little; they hold the building of
the scene, the baking of voxels and the start of the engine. The bias is the mean relative error of all pixels at the last setting.
"""

from __future__ import annotations

import argparse
import csv
import sys
import time
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

sys.path.insert(0, str(Path(__file__).resolve().parent.parent))

import bpy  # noqa: E402

from volumetrics_addon import verify  # noqa: E402
from volumetrics_addon.bench.rivals import CENTRES  # noqa: E402
from volumetrics_addon.blender import build, compat, render  # noqa: E402
from volumetrics_addon.blender.nodes import Tree, socket_of  # noqa: E402
from volumetrics_addon.parameters.preset import Preset, load, names  # noqa: E402
from volumetrics_addon.reference import path_tracing  # noqa: E402
from volumetrics_addon.reference.result import Result  # noqa: E402
from volumetrics_addon.scene import bake  # noqa: E402
from volumetrics_addon.scene.assemble import body  # noqa: E402
from volumetrics_addon.scene.model import Scene  # noqa: E402

TRUTH = {"repeats": 8, "strata": 0, "samples": 192, "seed": 99}
# What Blender's start-up file has, with the bounces that tutorials set.
STOCK = {"cycles.max_bounces": 12, "cycles.volume_bounces": 12, "cycles.diffuse_bounces": 4, "cycles.sample_clamp_indirect": 10.0,
         "cycles.light_sampling_threshold": 0.01, "cycles.use_light_tree": True}


@dataclass(frozen=True)
class Way:
    """One way to render a preset: its Scene, what is changed in the preset, and whether the material is the usual one."""

    name: str
    changes: dict
    usual: bool = False


WAYS = {way.name: way for way in (
    Way("full", {}), Way("octaves", {"scattering": "octaves"}), Way("nodes", {"representation": "procedural"}),
    Way("voxels", {"representation": "baked"}), Way("usual", {"representation": "procedural"}, True))}


def principled(material: bpy.types.Material, mean_cosine: float) -> None:
    """Replace Cycles' shader of the group by a Principled Volume with the same density and colour."""
    node = next(n for n in material.node_tree.nodes if n.bl_idname == "ShaderNodeGroup")
    tree = node.node_tree
    leave = next(n for n in tree.nodes if n.bl_idname == "NodeGroupOutput")
    scatter = next(n for n in tree.nodes if n.bl_idname == "ShaderNodeVolumeScatter")
    density, color = (socket_of(scatter.inputs, key).links[0].from_socket for key in ("Density", "Color"))
    shader = Tree(tree).node("ShaderNodeVolumePrincipled", {"Color": color, "Density": density, "Anisotropy": mean_cosine})
    output = next(s for s in leave.inputs if s.name == "Cycles Volume")
    tree.links.new(shader.outputs[0], output)


def render_usual(preset: Preset, scene: Scene, size: tuple[int, int], samples: int) -> np.ndarray:
    """The usual way: built as ours, with the usual shader and settings."""
    bodies = [body(preset.family, preset.parameters, scene.volumes)]
    plan = render.make_plan(scene, bodies, "cycles", samples, has_null_scattering=compat.current().volume_biased)
    plan.settings.update(STOCK | CENTRES["cycles"])
    if compat.current().volume_biased:
        plan.settings["cycles.volume_biased"] = False
    plan.volume_settings = [{"volume_step_rate": 1.0} for _ in plan.volume_settings]
    with build.temporary():
        built = build.build(scene, bodies, plan, preset.label)
        material = next(o.material_slots[0].material for o in built.objects if o.display_type == "BOUNDS")
        phase = scene.volumes[0].medium.phase
        mean = getattr(phase, "mean_cosine", None)
        principled(material, 0.86 if mean is None else mean)
        return render.render_built(built, *size)[0]


def shoot(way: Way, preset: Preset, size: tuple[int, int], samples: int) -> tuple[Scene, np.ndarray, float]:
    """The scene as it was shown, its image, and the processor time in seconds."""
    bake._baked.cache_clear()  # every picture pays for its voxels
    start = time.process_time()
    scene = verify.scene_of(preset, paths=size[0] * size[1] * samples)
    if way.usual:
        image = render_usual(preset, scene, size, samples)
    else:
        image = render.render_scene(scene, [body(preset.family, preset.parameters, scene.volumes)], preset.label, "cycles", *size,
                                    samples, settings=CENTRES["cycles"]).images[0]
    return scene, image, time.process_time() - start


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("presets", nargs="*", default=[name for name in names() if load(name).family == "cloud"])
    parser.add_argument("--size", type=int, default=48)
    parser.add_argument("--error", type=float, default=0.1, help="relative RMSE that counts as reached")
    parser.add_argument("--limit", type=float, default=60.0, help="seconds of one picture after which a way stops")
    parser.add_argument("--ways", default=",".join(WAYS))
    parser.add_argument("--out", type=Path, default=Path("out/clouds.csv"))
    arguments = parser.parse_args()
    arguments.out.parent.mkdir(parents=True, exist_ok=True)
    with open(arguments.out, "w", newline="", encoding="utf-8") as file:
        writer = csv.writer(file)
        writer.writerow(("preset", "way", "samples", "seconds", "rmse", "bias", "truth_error"))
        for name in arguments.presets:
            size = verify.image_size(load(name), arguments.size)
            truths: dict[type, Result] = {}  # by the density: noise or voxels
            for way in map(WAYS.__getitem__, arguments.ways.split(",")):
                preset = load(name).changed(way.changes)
                samples, last = 4, None
                while True:
                    scene, image, seconds = shoot(way, preset, size, samples)
                    density = type(scene.volumes[0].medium.density)
                    if density not in truths:
                        truths[density] = path_tracing.render(scene, *size, **TRUTH)
                    truth = truths[density]
                    mean = truth.image.mean()
                    doubt = float(np.sqrt(np.mean(truth.error_estimate**2)) / mean)
                    # The truth's own variance is taken off.
                    squared = np.mean((image - truth.image) ** 2) / mean**2 - doubt**2
                    rmse, bias = float(np.sqrt(max(squared, 0.0))), float((image - truth.image).mean() / mean)
                    writer.writerow((name, way.name, samples, f"{seconds:.2f}", f"{rmse:.4f}", f"{bias:+.4f}", f"{doubt:.4f}"))
                    file.flush()
                    last = f"{name:15} {way.name:8} {samples:5} samples {seconds:7.1f} s  rmse {rmse:7.2%}  bias {bias:+7.2%}"
                    if rmse <= arguments.error or seconds > arguments.limit or samples >= 4096:
                        break
                    # At once to where the noise would be low enough, if all of it is noise.
                    samples = min(4096, max(2 * samples, min(16 * samples, int(samples * (rmse / arguments.error) ** 2))))
                print(last + ("" if rmse <= arguments.error else "  NOT REACHED"), flush=True)
    print(arguments.out)


if __name__ == "__main__":
    main()
