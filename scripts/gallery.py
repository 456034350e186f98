# SPDX-License-Identifier: GPL-3.0-or-later
"""Every cloud lit from the front, from the side, from behind and at sunset, on one sheet to be judged by eye.

    python scripts/gallery.py --out out/clouds.png [--engine reference|cycles|eevee] [--size 300] [--samples 64] [PRESET ...]

``reference`` is the path tracer, on the very voxels that the engines render; quickest where numba is installed.
"""

from __future__ import annotations

import argparse
import sys
import time
from pathlib import Path

import numpy as np

sys.path.insert(0, str(Path(__file__).resolve().parent.parent))

from volumetrics_addon import verify  # noqa: E402
from volumetrics_addon.blender import render  # noqa: E402
from volumetrics_addon.blender.text import text_mask  # noqa: E402
from volumetrics_addon.compare.png import write_png  # noqa: E402
from volumetrics_addon.compare.report import contact_sheet, display  # noqa: E402
from volumetrics_addon.parameters.preset import Preset, load, names  # noqa: E402
from volumetrics_addon.reference import path_tracing  # noqa: E402

SKY = {"environment_color": (0.36, 0.58, 1.0)}
# Azimuths are from where the cameras look: they stand to the south.
LIGHTS = {
    "front": SKY | {"sun_azimuth": 205.0, "sun_elevation": 40.0, "sun_irradiance": 8.0, "environment_radiance": 0.45},
    "side": SKY | {"sun_azimuth": 100.0, "sun_elevation": 35.0, "sun_irradiance": 8.0, "environment_radiance": 0.45},
    "back": SKY | {"sun_azimuth": 20.0, "sun_elevation": 32.0, "sun_irradiance": 8.0, "environment_radiance": 0.45},
    "sunset": {"sun_azimuth": 60.0, "sun_elevation": 5.0, "sun_irradiance": 6.0, "sun_color": (1.0, 0.5, 0.22),
               "environment_color": (0.55, 0.6, 1.0), "environment_radiance": 0.25},
}


def picture(preset: Preset, engine: str, size: int, samples: int) -> np.ndarray:
    scene = verify.scene_of(preset)
    width, height = verify.image_size(preset, size)
    if engine == "reference":
        return path_tracing.render(scene, width, height, repeats=1, strata=1, samples=samples, seed=1).image
    return render.render(preset, scene, engine, width, height, samples).images[0]


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("presets", nargs="*", default=[name for name in names() if load(name).family == "cloud"])
    parser.add_argument("--out", type=Path, default=Path("out/clouds.png"))
    parser.add_argument("--engine", choices=("reference", "cycles", "eevee"), default="reference")
    parser.add_argument("--size", type=int, default=300)
    parser.add_argument("--samples", type=int, default=64)
    arguments = parser.parse_args()
    cells = []
    for name in arguments.presets:
        start = time.perf_counter()
        preset = load(name)
        shown = [display(picture(preset.changed({}, light), arguments.engine, arguments.size, arguments.samples),
                         preset.stage["exposure"]) for light in LIGHTS.values()]
        height = min(image.shape[0] for image in shown)
        rows = [np.concatenate([image[:height] for image in pair], axis=1) for pair in (shown[:2], shown[2:])]
        cells.append((np.concatenate(rows), preset.label, ["lit from the front, from the side,", "from behind, at sunset"]))
        print(f"{name}: {time.perf_counter() - start:.0f} s", flush=True)
        arguments.out.parent.mkdir(parents=True, exist_ok=True)
        write_png(arguments.out, contact_sheet(cells, text_mask, f"Clouds, {arguments.engine}"))
    print(arguments.out)


if __name__ == "__main__":
    main()
