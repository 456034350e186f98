# SPDX-License-Identifier: GPL-3.0-or-later
"""Every preset of a family on one sheet, to be judged by eye: clouds in four lights, the others on their own stage.

    python scripts/gallery.py [--family cloud,glass,fog,godray,air] [--engine cycles|eevee|reference] [--size 240] [--seconds S]
                              [--out docs] [PRESET ...]

Writes clouds.png, glass.png, fog.png, shafts.png and air.png. A picture gets as many samples as its seconds of one core allow,
and Cycles' denoiser where this Blender has one. ``reference`` is the path tracer, on the very voxels that the engines render;
for clouds it is the quickest where numba is installed.
"""

from __future__ import annotations

import argparse
import sys
import time
from collections.abc import Iterator
from pathlib import Path

import numpy as np

sys.path.insert(0, str(Path(__file__).resolve().parent.parent))

from volumetrics_addon import verify  # noqa: E402
from volumetrics_addon.blender import render  # noqa: E402
from volumetrics_addon.blender.text import text_mask  # noqa: E402
from volumetrics_addon.compare.png import write_png  # noqa: E402
from volumetrics_addon.compare.report import contact_sheet, display  # noqa: E402
from volumetrics_addon.parameters.families import FAMILIES  # noqa: E402
from volumetrics_addon.parameters.preset import Preset, load, names  # noqa: E402
from volumetrics_addon.plan.model import CYCLES, EEVEE  # noqa: E402
from volumetrics_addon.reference import path_tracing  # noqa: E402
from volumetrics_addon.scene.assemble import bodies  # noqa: E402

SHEETS = {"cloud": "clouds", "glass": "glass", "fog": "fog", "godray": "shafts", "air": "air"}
ENGINE_NAMES = {CYCLES: "Cycles", EEVEE: "EEVEE", "reference": "path tracing"}
SKY = {"environment_color": (0.36, 0.58, 1.0)}
# Azimuths are from where the cameras look: they stand to the south.
LIGHTS = {
    "front": SKY | {"sun_azimuth": 205.0, "sun_elevation": 40.0, "sun_irradiance": 8.0, "environment_radiance": 0.45},
    "side": SKY | {"sun_azimuth": 100.0, "sun_elevation": 35.0, "sun_irradiance": 8.0, "environment_radiance": 0.45},
    "back": SKY | {"sun_azimuth": 20.0, "sun_elevation": 32.0, "sun_irradiance": 8.0, "environment_radiance": 0.45},
    "sunset": {"sun_azimuth": 60.0, "sun_elevation": 5.0, "sun_irradiance": 6.0, "sun_color": (1.0, 0.5, 0.22),
               "environment_color": (0.55, 0.6, 1.0), "environment_radiance": 0.25},
}
SECONDS = (6.0, 240.0)  # of others and of clouds
FEW, MOST = 2, 4096  # samples of the first try, whose time decides, and of a picture


def picture(preset: Preset, engine: str, size: int, seconds: float) -> np.ndarray:
    """The preset on its stage, with as many samples as take these seconds of processor time."""
    scene = verify.scene_of(preset)
    width, height = verify.image_size(preset, size)

    def shoot(samples: int, **settings: object) -> np.ndarray:
        if engine == "reference":
            return path_tracing.render(scene, width, height, repeats=1, strata=1, samples=samples, seed=1).image
        shown = bodies(preset.family, preset.parameters, scene.volumes)
        return render.render_scene(scene, shown, preset.label, engine, width, height, samples, settings=settings).images[0]

    start = time.process_time()
    shown = shoot(FEW)
    samples = min(MOST, int(FEW * seconds / max(time.process_time() - start, 1e-3)))
    settings = {"cycles.use_denoising": True} if engine == CYCLES and _denoises() else {}
    return shoot(max(FEW, samples), **settings) if samples > FEW or settings else shown


def _denoises() -> bool:
    import _cycles

    return bool(getattr(_cycles, "with_openimagedenoise", False))


def cells(family: str, presets: list[Preset], engine: str, size: int, seconds: float) -> Iterator[tuple]:
    """A cell of the sheet for each preset."""
    for preset in presets:
        start = time.perf_counter()
        if family == "cloud":
            shown = [display(picture(preset.changed({}, light), engine, size, seconds / len(LIGHTS)), preset.stage["exposure"])
                     for light in LIGHTS.values()]
            height = min(image.shape[0] for image in shown)
            rows = [np.concatenate([image[:height] for image in pair], axis=1) for pair in (shown[:2], shown[2:])]
            yield np.concatenate(rows), preset.label, ["lit from the front, from the side,", "from behind, at sunset"]
        else:
            yield display(picture(preset, engine, size, seconds), preset.stage["exposure"]), preset.label, [preset.name]
        print(f"{preset.name}: {time.perf_counter() - start:.0f} s", flush=True)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("presets", nargs="*", metavar="PRESET", help="only these")
    parser.add_argument("--family", type=lambda text: text.split(","), default=list(FAMILIES))
    parser.add_argument("--out", type=Path, default=Path("docs"))
    parser.add_argument("--engine", choices=tuple(ENGINE_NAMES), help="path tracing for clouds, Cycles for the others")
    parser.add_argument("--size", type=int, default=240)
    parser.add_argument("--seconds", type=float, help="of one core, for a preset (a cloud's four pictures 240, others 6)")
    arguments = parser.parse_args()
    arguments.out.mkdir(parents=True, exist_ok=True)
    for family in arguments.family:
        presets = [preset for preset in map(load, arguments.presets or names()) if preset.family == family]
        engine = arguments.engine or ("reference" if family == "cloud" else CYCLES)
        path, done = arguments.out / f"{SHEETS[family]}.png", []
        for cell in cells(family, presets, engine, arguments.size, arguments.seconds or SECONDS[family == "cloud"]):
            done.append(cell)
            write_png(path, contact_sheet(done, text_mask, f"{FAMILIES[family].label}, {ENGINE_NAMES[engine]}"))
        if done:
            print(path)


if __name__ == "__main__":
    main()
