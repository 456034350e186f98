# SPDX-License-Identifier: GPL-3.0-or-later
"""The engines against the references: radiometry first, then every preset."""

import math
from dataclasses import replace

import numpy as np
import pytest

bpy = pytest.importorskip("bpy")

from volumetrics_addon import verify  # noqa: E402
from volumetrics_addon.blender import build, compat, objects, render  # noqa: E402
from volumetrics_addon.parameters.families import FAMILIES  # noqa: E402
from volumetrics_addon.parameters.preset import Preset, load, names  # noqa: E402
from volumetrics_addon.parameters.stage import PROP, STAGE  # noqa: E402
from volumetrics_addon.scene import assemble  # noqa: E402


def preset(family, parameters=None, stage=None, props=()):
    return Preset("test", family, "Test", "", FAMILIES[family].check(parameters or {}), STAGE.check(stage or {}),
                  tuple(PROP.check(values) for values in props))


def blocks():
    return {p.identifier: sorted(b.name for b in getattr(bpy.data, p.identifier))
            for p in bpy.data.bl_rna.properties if p.type == "COLLECTION"}


def test_exr_keeps_what_was_written(tmp_path):
    import OpenEXR

    pixels = np.random.default_rng(0).gamma(0.3, 1.0, (5, 7, 3)).astype(np.float32)
    pixels[0, 0] = (1e-6, 123456.0, 0.0)
    path = tmp_path / "deep" / "image.exr"
    render.write_exr(path, pixels)
    with OpenEXR.File(str(path)) as file:  # a reader nobody here wrote
        channels = file.channels()
        stored = channels["RGB"].pixels if "RGB" in channels else np.stack([channels[c].pixels for c in "RGB"], axis=-1)
    assert stored.dtype == np.float32
    np.testing.assert_array_equal(stored, pixels)
    np.testing.assert_array_equal(render.read_image(path), pixels)
    assert [p.name for p in path.parent.iterdir()] == ["image.exr"]


def test_a_failed_write_leaves_nothing(tmp_path):
    with pytest.raises(RuntimeError, match="on purpose"):
        with render.whole_file(tmp_path / "x.exr") as partial:
            partial.write_bytes(b"half")
            raise RuntimeError("on purpose")
    assert list(tmp_path.iterdir()) == []


def test_rendering_leaves_no_datablock_behind():
    before = blocks()
    chosen = load("theatre-slats")
    render.render(chosen, verify.scene_of(chosen), "cycles", 8, 8, 1)
    assert blocks() == before


def test_seeds_differ_and_repeat():
    chosen = load("theatre-slats")
    scene = verify.scene_of(chosen)
    first, second = (render.render(chosen, scene, "cycles", 16, 16, 4, seed=seed, repeats=2).images for seed in (5, 6))
    np.testing.assert_array_equal(first[1], second[0])
    assert (first[0] != first[1]).any()


def test_samples_are_spread_over_the_pixel_from_the_first_on():
    """A glowing card covers the left quarter of the only pixel and not its centre, where Cycles takes its first sample."""
    chosen = preset("glass", {"location": [0, 500, 0]},
                    {"camera_location": [0, -10, 0], "camera_target": [0, 0, 0], "field_of_view": 90.0},
                    [{"location": [-7.5, 0, 0], "size": [5, 0, 40], "albedo": [0, 0, 0], "emission": [1, 1, 1]}])
    for samples, repeats in ((1, 128), (4, 32)):
        images = render.render(chosen, verify.scene_of(chosen), "cycles", 1, 1, samples, repeats=repeats).images
        means = images.mean(axis=(1, 2, 3))
        # 128 samples: a standard error of sqrt(0.25 * 0.75 / 128) = 0.038, less where they are stratified.
        assert means.mean() == pytest.approx(0.25, abs=4.0 * 0.038)


def grey_card(albedo=0.5):
    return {"location": [0, 0, 0], "size": [40, 40, 0], "albedo": [albedo] * 3}


DOWNWARD = {"camera_location": [0, 0, 5], "camera_target": [0, 0, 0], "field_of_view": 20}


@pytest.mark.parametrize("elevation", [90.0, 30.0])
def test_sun_on_a_grey_card(elevation):
    """Radiance albedo E sin(elevation) / pi, with the medium as good as absent."""
    chosen = preset("cloud", {"location": [100, 100, 50], "extinction": 0.0, "density": "homogeneous"},
                    {**DOWNWARD, "sun_irradiance": 4.0, "sun_color": [1.0, 0.5, 0.25], "sun_elevation": elevation}, [grey_card()])
    image = render.render(chosen, verify.scene_of(chosen), "cycles", 8, 8, 4).images[0]
    expected = 0.5 * 4.0 * math.sin(math.radians(elevation)) / math.pi
    np.testing.assert_allclose(image.mean(axis=(0, 1)), np.array([1.0, 0.5, 0.25]) * expected, rtol=1e-5)


def test_spot_on_a_grey_card():
    """On the axis at distance d: albedo P / (4 pi) / d^2 / pi, whatever the cone."""
    chosen = preset("godray", {"location": [0, 0, 4], "target": [0, 0, 0], "power": 100.0, "cone_angle": 30.0, "blend": 0.1,
                               "extinction": 0.0, "blocker": "none"},
                    {"camera_location": [3, 0, 4], "camera_target": [0, 0, 0], "field_of_view": 1.0}, [grey_card()])
    image = render.render(chosen, verify.scene_of(chosen), "cycles", 8, 8, 4).images[0]
    # The picture spans 0.09 m of the card, over which 1/d^2 and the cosine change by less than 1e-3 and cancel in the mean.
    assert image.mean() == pytest.approx(0.5 * 100 / (4 * math.pi) / 16 / math.pi, rel=3e-4)


def test_beer_lambert_through_a_box():
    chosen = preset("glass", {"shape": "block", "size": [2, 0.5, 2], "location": [0, 0, 0], "color": [0.2, 0.5, 0.9],
                              "distance": 0.25, "refraction": False},
                    {"camera_location": [0, -10, 0], "camera_target": [0, 0, 0], "environment_radiance": 1.0})
    scene = verify.scene_of(chosen)
    # So narrow that the slant of the rays does not count; near enough for float32 to hold the thickness.
    scene = replace(scene, camera=replace(scene.camera, field_of_view=math.radians(0.2)))
    image = render.render(chosen, scene, "cycles", 8, 8, 4).images[0]
    np.testing.assert_allclose(image.mean(axis=(0, 1)), np.array([0.2, 0.5, 0.9]) ** 2, rtol=1e-4)


@pytest.mark.either
@pytest.mark.parametrize("light", ["sun", "spot"])
def test_single_scattering_to_four_digits(light):
    """Homogeneous haze, two million samples: the mean agrees to 4 digits, and the interval is narrow enough to say so."""
    haze = {"extinction": 0.2, "albedo": [0.9, 0.7, 0.5], "g": 0.4}
    if light == "spot":
        chosen = preset("godray", {**haze, "location": [0, 0, 6], "target": [0, 0, 0], "length": 6.0, "blocker": "none",
                                   "blend": 0.5, "cone_angle": 50.0},
                        {"camera_location": [0, -9, 2.5], "camera_target": [0, 0, 2.5], "field_of_view": 20})
    else:
        chosen = preset("cloud", {**haze, "domain": "box", "size": [4, 4, 4], "density": "homogeneous", "phase": "dual_hg"},
                        {"camera_location": [0, -9, 0], "camera_target": [0, 0, 0], "field_of_view": 20, "sun_irradiance": 3.0})
    result = verify.verify(chosen, "cycles", 16, 1024, repeats=8, reference_samples=36)
    low, high = result.comparison.mean_relative_interval
    assert low < 1e-4 and high > -1e-4 and high - low < 1e-3
    assert result.comparison.z_pass_fraction >= 0.9975


# Per preset: samples, repeats, so that the interval of the mean resolves the tolerance in a few seconds.
QUICK = {"cloud": (48, 8), "glass": (32, 8), "fog": (32, 8), "godray": (64, 8), "air": (32, 8)}
# The reference is checked to 0.5 % everywhere and to 0.1 % in single scattering and glass; the noise of these quick
# renders comes on top: a preset fails when its error is beyond the tolerance with 99.9 % confidence, so that the few
# dozen comparisons of a test run raise no false alarm. The README's table states the errors at more samples.
MULTIPLE, SINGLE = 0.005, 0.001


# Optically thick, so that a sample takes seconds: these are verified with the long sweeps.
THICK = {"congestus", "storm", "stratus", "stratocumulus"}
# Their references take half a minute and more: fine gobos, layers of fog among many bodies, air with bodies in it. In water that
# scatters forward a sun is noisy; a low one lights air through many orders.
SLOW = {"underwater-shafts", "forest-shafts", "cathedral-window", "stadium", "two-layer", "city-haze", "light-haze", "amber-bottle",
        "underwater", "lighthouse", "high-altitude", "mars", "dusty-attic",
        "window-shafts", "hazy-city", "golden-hour", "clear-sunset"}
SAMPLES = {"headlights": 1024, "dusty-attic": 512, "forest-shafts": 512}  # narrow beams seen from beside, shafts in dim places
# Of the reference: a path tracer's in a dim room, a narrow beam, a slide; skies come from tables, and are smooth.
RAYS = {"dusty-attic": 256, "lighthouse": 100, "slide-projector": 16, "clear-noon": 4, "clear-sunset": 4}


@pytest.mark.either
@pytest.mark.parametrize("name", [pytest.param(n, marks=pytest.mark.sweep) if n in THICK | SLOW else n for n in names()])
def test_cycles_equals_the_reference(name, tmp_path):
    chosen = load(name)
    samples, repeats = QUICK[chosen.family]
    samples = SAMPLES.get(name, samples)
    result = verify.verify(chosen, "cycles", 32, samples, repeats=repeats, confidence=0.999,
                           reference_samples=RAYS.get(name, 36 if chosen.stage["orders"] > 1 else 16))
    comparison = result.comparison
    low, high = comparison.mean_relative_interval
    tolerance = MULTIPLE if chosen.stage["orders"] > 1 else SINGLE
    if not (low <= tolerance and high >= -tolerance and comparison.z_pass_fraction >= 0.9975):
        verify.write(result, tmp_path)
        pytest.fail(f"{name}: {comparison.mean_relative_error:+.3%} [{low:+.3%}, {high:+.3%}], "
                    f"{comparison.z_pass_fraction:.2%} pass; see {tmp_path}")
    assert high - low < 0.05  # the comparison is worth something


def test_a_wrong_albedo_is_caught():
    """The verification has power: an error of 3 % in the albedo does not pass."""
    truth = load("theatre-slats")
    wrong = truth.changed({"albedo": tuple(0.97 * a for a in truth.parameters["albedo"])})
    reference = verify.reference_of(verify.scene_of(truth), 24, 24)
    result = verify.verify(wrong, "cycles", 24, 128, repeats=4, reference=reference)
    assert not result.passes(0.005)


@pytest.mark.either
@pytest.mark.parametrize("name", ["theatre-spot", "morning-valley"])  # before a black world, and before a sky
def test_what_a_world_does_not_need_changes_no_bit_of_eevee(name, monkeypatch):
    chosen = load(name)
    scene = verify.scene_of(chosen)
    shot = lambda: render.render(chosen, scene, "eevee", 32, 18, 4).images[0]  # noqa: E731
    spare, built = shot(), objects.world

    def start_up(*arguments):
        world, own = built(*arguments), bpy.data.worlds.new("own")
        for path in ("sun_threshold", "use_sun_shadow", "probe_resolution"):
            setattr(world, path, getattr(own, path))
        assert world.use_sun_shadow and int(world.probe_resolution) > 128
        return world

    monkeypatch.setattr(objects, "world", start_up)
    assert np.array_equal(shot(), spare) and spare.mean() > 0.0


@pytest.mark.either
def test_a_bright_uniform_world_is_no_sun_of_eevee():
    """Beyond the 10 that a world's brightness may have by default EEVEE made a sun of the rest: 0.78 of Cycles' light."""
    chosen = load("morning-valley")
    scene = replace(verify.scene_of(chosen), environment=(50.0, 50.0, 50.0))
    light = {engine: render.render(chosen, scene, engine, 32, 18, samples).images[0].mean()
             for engine, samples in (("cycles", 256), ("eevee", 16))}
    assert light["eevee"] == pytest.approx(light["cycles"], rel=0.03)  # measured 1.011


def test_versions_have_one_row_each():
    rows = [row.since for row in compat.TABLE]
    assert rows == sorted(rows) and rows[0] == compat.OLDEST
    assert compat.current() in compat.TABLE


def test_plan_settings_exist_in_this_blender():
    """Every setting of every plan names a property of this Blender: a typo would raise."""
    for name in names():
        chosen = load(name)
        scene = verify.scene_of(chosen)
        for engine in ("cycles", "eevee"):
            with build.temporary():
                from volumetrics_addon.plan.rules import plan

                bodies = assemble.bodies(chosen.family, chosen.parameters, scene.volumes)
                made = plan(scene, bodies, engine, 1, has_null_scattering=compat.current().volume_biased)
                built = build.build(scene, bodies, made, chosen.label)
                assert built.camera is not None and built.world is not None
