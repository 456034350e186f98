# SPDX-License-Identifier: GPL-3.0-or-later
"""The path tracer against Mitsuba 3's ``volpath``: an independent implementation, in single precision.

Some cases run live in Mitsuba's scalar variant. For the others it needs more paths than a test has time for, and its means
are stored; they were made in its compiled variant by

    DRJIT_LIBLLVM_PATH=/path/to/libLLVM.so python tests/reference/test_mitsuba.py
"""

import math

import numpy as np
import pytest

from volumetrics_addon.reference import path_tracing
from volumetrics_addon.scene.model import Box, Camera, Ellipsoid, Medium, Phase, Point, Scene, Spot, Sun, Volume, normalized

mitsuba = pytest.importorskip("mitsuba", reason="needs Mitsuba 3: pip install mitsuba")

SIZE, REPEATS = 6, 8
VIEW = math.radians(14.0)
CUBE, BALL = Box((0.0, 0.0, 0.0), (1.0, 1.0, 1.0)), Ellipsoid((0.0, 0.0, 0.0), (1.0, 1.0, 1.0))
SKY = "uniform environment"
SUN = Sun(normalized((1.0, 1.0, -1.0)), (3.0, 3.0, 3.0))
# Out of the camera's sight, where distance sampling alone has the least trouble with it.
POINT = Point((0.7, 0.6, 0.8), (40.0, 40.0, 40.0))
SPOT = Spot((0.1, 0.2, 0.85), normalized((-0.1, -0.2, -1.0)), (40.0, 40.0, 40.0), 0.8, 0.0)

MANY = 100_000
# shape, light, sigma_t, albedo, g, orders, paths per pixel of ours and (0: stored) of Mitsuba, sharpness of the comparison
CASES = {
    "cube, environment": (CUBE, SKY, 4.0, 0.9, 0.5, MANY, 150, 120, 0.01),
    "cube, sun": (CUBE, SUN, 4.0, 0.9, 0.5, MANY, 500, 450, 0.01),
    "sphere, environment, thin": (BALL, SKY, 1.0, 0.999, 0.5, MANY, 50, 64, 0.01),
    "cube, point light inside, once": (CUBE, POINT, 1.0, 0.9, 0.5, 1, 50, 1000, 0.03),
    "sphere, spot light inside, once": (BALL, SPOT, 2.0, 0.999, 0.5, 1, 100, 2000, 0.03),
    "sphere, sun, thick": (BALL, SUN, 16.0, 0.999, 0.5, MANY, 400, 0, 0.01),
    # Distance sampling has infinite variance next to the light: Mitsuba's own error is what limits these.
    "cube, point light inside": (CUBE, POINT, 1.0, 0.9, 0.5, MANY, 400, 0, 0.05),
    "sphere, spot light inside": (BALL, SPOT, 2.0, 0.999, 0.5, MANY, 400, 0, 0.12),
}
STORED_PATHS = 1 << 12  # per pixel and repeat
# Mean over the image and its standard error.
STORED = {
    "sphere, sun, thick": (0.442766, 0.00097),
    "cube, point light inside": (0.157315, 0.0033),
    "sphere, spot light inside": (0.0615617, 0.003),
}
ERRORS = 4.0


def ours(case):
    shape, light, sigma_t, albedo, g, orders, samples, _, _ = CASES[case]
    medium = Medium((albedo * sigma_t,) * 3, ((1.0 - albedo) * sigma_t,) * 3, Phase(g))
    scene = Scene(Camera((0.0, -4.0, 0.0), (0.0, 1.0, 0.0), VIEW), () if light is SKY else (light,),
                  (1.0,) * 3 if light is SKY else (0.0,) * 3, (Volume(shape, medium),), (), orders)
    return path_tracing.render(scene, SIZE, SIZE, repeats=REPEATS, strata=1, samples=samples).repeats.mean(axis=(1, 2, 3))


def emitter(light):
    match light:
        case Sun():
            return {"type": "directional", "direction": list(light.direction), "irradiance": light.irradiance[0]}
        case Point():
            return {"type": "point", "position": list(light.position), "intensity": light.power[0] / (4.0 * math.pi)}
        case Spot():
            target = [p + d for p, d in zip(light.position, light.direction)]
            edge = math.degrees(light.cone_angle / 2.0)
            return {"type": "spot", "intensity": light.power[0] / (4.0 * math.pi), "cutoff_angle": edge,
                    "beam_width": 0.9999 * edge,
                    "to_world": mitsuba.ScalarTransform4f().look_at(list(light.position), target, [0, 1, 0])}
    return {"type": "constant", "radiance": 1.0}


def theirs(case, samples):
    """Means of the repeats, in the variant of Mitsuba that is set."""
    shape, light, sigma_t, albedo, g, orders, *_ = CASES[case]
    scene = mitsuba.load_dict({
        "type": "scene", "light": emitter(light),
        "integrator": {"type": "volpath", "max_depth": -1 if orders == MANY else orders + 1, "rr_depth": 64},
        "sensor": {"type": "perspective", "fov": math.degrees(VIEW),
                   "to_world": mitsuba.ScalarTransform4f().look_at([0, -4, 0], [0, 0, 0], [0, 0, 1]),
                   "film": {"type": "hdrfilm", "width": SIZE, "height": SIZE, "rfilter": {"type": "box"}}},
        "body": {"type": "cube" if shape is CUBE else "sphere", "bsdf": {"type": "null"},
                 "interior": {"type": "homogeneous", "albedo": albedo, "sigma_t": sigma_t,
                              "phase": {"type": "hg", "g": g}}}})
    return np.array([np.array(mitsuba.render(scene, spp=samples, seed=seed)).mean(dtype=float) for seed in range(REPEATS)])


def mean_and_error(means):
    return means.mean(), means.std(ddof=1) / math.sqrt(len(means))


@pytest.mark.parametrize("case", CASES)
def test_mean_radiance(case):
    """Within four combined standard errors, which are sharp enough to see half of ``sharpness`` (relative)."""
    *_, live, sharpness = CASES[case]
    mean, error = mean_and_error(ours(case))
    if live:
        mitsuba.set_variant("scalar_rgb")  # needs no LLVM
    reference, spread = mean_and_error(theirs(case, live)) if live else STORED[case]
    both = math.hypot(error, spread)
    assert abs(mean - reference) < ERRORS * both
    assert abs(mean / reference - 1.0) < sharpness
    assert both < sharpness * reference / 2.0


def test_cases_run_live_and_stored():
    live = {case for case in CASES if CASES[case][-2]}
    assert len(live) >= 5 and set(CASES) - live == set(STORED)


if __name__ == "__main__":
    mitsuba.set_variant("llvm_ad_rgb")
    for name in CASES:
        if not CASES[name][-2]:
            numbers = mean_and_error(theirs(name, STORED_PATHS))
            print(f'    "{name}": ({numbers[0]:.6g}, {numbers[1]:.2g}),', flush=True)
