# SPDX-License-Identifier: GPL-3.0-or-later
"""Light on surfaces in EEVEE is what the media leave of it."""

import math

import pytest

bpy = pytest.importorskip("bpy")

from volumetrics_addon.blender import dimming, items, objects, render  # noqa: E402
from volumetrics_addon.cli.doctor import checks  # noqa: E402
from volumetrics_addon.plan.model import CYCLES, EEVEE  # noqa: E402
from volumetrics_addon.scene.describe import describe_scene  # noqa: E402
from volumetrics_addon.scene.model import Box, Camera, Medium, Point, Scene, Sun, Surface, Volume  # noqa: E402

needs_eevee = pytest.mark.skipif(not all(c.ok for c in checks() if c.name == "EEVEE"), reason="no EGL on this machine")

ABSORPTION = (0.02, 0.1, 0.3)
ALBEDO = (0.8, 0.7, 0.6)
IRRADIANCE = (3.0, 2.5, 2.0)
SKY = (0.1, 0.2, 0.4)


def floor_under_a_slab(sun, sky):
    """Seen straight from above through 4 m of what absorbs."""
    return Scene(Camera((0.0, 0.0, 20.0), (0.0, 0.0, -1.0), math.radians(4.0)),
                 (Sun((0.6, 0.0, -0.8), IRRADIANCE),) if sun else (), SKY if sky else (0.0,) * 3,
                 (Volume(Box((0.0, 0.0, 3.0), (200.0, 200.0, 2.0)), Medium((0.0,) * 3, ABSORPTION)),),
                 (Surface(Box((0.0, 0.0, 0.0), (400.0, 400.0, 0.0)), ALBEDO),))


@needs_eevee
def test_a_coloured_slab_dims_the_sun_on_the_floor_by_beer_and_lambert():
    scene = floor_under_a_slab(sun=True, sky=False)
    rendered = render.render_scene(scene, describe_scene(scene), "slab", EEVEE, 8, 8, 8)
    expected = [a * e * 0.8 / math.pi * math.exp(-s * (4.0 / 0.8 + 4.0)) for a, e, s in zip(ALBEDO, IRRADIANCE, ABSORPTION)]
    assert rendered.images[0].mean(axis=(0, 1)) == pytest.approx(expected, rel=0.03)  # EEVEE's 11-bit floats
    assert any(decision.rule == "dimmed light" for decision in rendered.plan.decisions)


@pytest.mark.either
@needs_eevee
def test_a_coloured_slab_dims_the_sky_on_the_floor_by_the_exponential_integral():
    from scipy.special import expn

    scene = floor_under_a_slab(sun=False, sky=True)
    rendered = render.render_scene(scene, describe_scene(scene), "slab", EEVEE, 8, 8, 8)
    expected = [a * l * 2.0 * expn(3, 4.0 * s) * math.exp(-4.0 * s) for a, l, s in zip(ALBEDO, SKY, ABSORPTION)]
    assert rendered.images[0].mean(axis=(0, 1)) == pytest.approx(expected, rel=0.04)


@pytest.mark.either
@needs_eevee
def test_switched_off_the_floor_is_as_bright_as_without_the_slab_before_the_sun():
    scene = floor_under_a_slab(sun=True, sky=False)
    rendered = render.render_scene(scene, describe_scene(scene), "slab", EEVEE, 8, 8, 8, without=("dimmed light",))
    expected = [a * e * 0.8 / math.pi * math.exp(-4.0 * s) for a, e, s in zip(ALBEDO, IRRADIANCE, ABSORPTION)]
    assert rendered.images[0].mean(axis=(0, 1)) == pytest.approx(expected, rel=0.03)


def test_cycles_dims_by_itself():
    scene = floor_under_a_slab(sun=True, sky=True)
    rendered = render.render_scene(scene, describe_scene(scene), "slab", CYCLES, 4, 4, 4)
    assert not any(decision.rule == "dimmed light" for decision in rendered.plan.decisions)


@pytest.fixture
def collection():
    bpy.ops.wm.read_factory_settings(use_empty=True)
    return bpy.context.scene.collection


def test_a_grey_share_is_factors_of_the_lamp(collection):
    lamp = objects.light(Point((0.0,) * 3, (2.0, 1.0, 0.0)), "lamp", collection)
    dimming.apply(lamp, (0.25, 0.25, 9.0), (1.0,) * 3, collection)  # it has no blue
    assert [getattr(lamp.data, name) for name in dimming.ON_SURFACES] == [0.25] * 3
    assert lamp.data.volume_factor == 1.0 and len(collection.objects) == 1


def test_a_coloured_share_is_a_lamp_for_surfaces_and_one_for_media(collection):
    lamp = objects.light(Point((0.0,) * 3, (4.0, 2.0, 1.0)), "lamp", collection)
    dimming.apply(lamp, (0.5, 0.25, 0.125), (1.0, 3.0, 5.0), collection)
    twin, = (candidate for candidate in collection.objects if candidate != lamp)
    assert [lamp.data.energy * c for c in lamp.data.color] == pytest.approx([2.0, 0.5, 0.125])
    assert [twin.data.energy * c for c in twin.data.color] == pytest.approx([4.0, 6.0, 5.0])
    assert lamp.data.volume_factor == 0.0 and lamp.data.diffuse_factor == 1.0
    assert twin.data.volume_factor == 1.0 and twin.data.diffuse_factor == twin.data.specular_factor == 0.0
    assert twin.matrix_world == lamp.matrix_world


def test_a_black_share_is_no_light(collection):
    lamp = objects.light(Point((0.0,) * 3, (1.0, 1.0, 1.0)), "lamp", collection)
    dimming.apply(lamp, (0.0,) * 3, (1.0, 0.5, 0.25), collection)
    assert lamp.data.energy == 0.0


@pytest.mark.parametrize("values", [{}, {"light": "projector", "gobo": "stained_glass"}, {"dust_strength": 0.5}, {"count": 3}])
def test_lamps_of_an_item_follow_its_extinction(collection, values):
    """From (0, 0, 6) to the target (0, 0, 1) through haze that begins at the lamp."""
    scene = bpy.context.scene
    item = items.add_item(scene, "godray", {"target": (0.0, 0.0, 1.0), "extinction": 0.1, **values}, "Beam")
    lamps = [candidate.data for candidate in item.objects if candidate.type == "LIGHT"]
    socket = items.live_node(item).inputs["Extinction"]
    for extinction in (0.1, 0.3):
        socket.default_value = extinction
        socket.id_data.update_tag()
        bpy.context.view_layer.update()
        for lamp in lamps:
            for name in dimming.ON_SURFACES:
                assert getattr(lamp, name) == pytest.approx(math.exp(-5.0 * extinction), rel=0.02)
            assert lamp.volume_factor == 1.0
    items.remove_item(scene, item)
    assert not bpy.data.lights


def test_sunshine_through_an_opening_is_left_alone(collection):
    item = items.add_item(bpy.context.scene, "godray", {"light": "sun", "irradiance": 2.0, "extinction": 0.3}, "Shaft")
    sun, = (candidate.data for candidate in item.objects if candidate.type == "LIGHT")
    assert sun.diffuse_factor == 1.0 and sun.animation_data is None  # it lights all of the user's scene
