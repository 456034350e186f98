# SPDX-License-Identifier: GPL-3.0-or-later
"""A planet's air in the engines: altitude, ground, one object for two media, the unit of length, the error of a sky."""

import math
from dataclasses import replace

import numpy as np
import pytest

bpy = pytest.importorskip("bpy")

from volumetrics_addon import verify  # noqa: E402
from volumetrics_addon.bench.rivals import rival  # noqa: E402
from volumetrics_addon.bench.scenes import by_name  # noqa: E402
from volumetrics_addon.blender import build, compat, items, objects  # noqa: E402
from volumetrics_addon.blender.render import render_scene  # noqa: E402
from volumetrics_addon.cli.doctor import checks  # noqa: E402
from volumetrics_addon.parameters.preset import load  # noqa: E402
from volumetrics_addon.physics.atmosphere import optical_depth, top_distance  # noqa: E402
from volumetrics_addon.plan.rules import plan  # noqa: E402
from volumetrics_addon.reference import select  # noqa: E402
from volumetrics_addon.scene.describe import describe_scene  # noqa: E402
from volumetrics_addon.scene.model import Box, Camera, Ellipsoid, Surface  # noqa: E402
from volumetrics_addon.scene.units import scaled, scaled_body  # noqa: E402

RADIUS = 6.36e6
EARTH = Ellipsoid((0.0, 0.0, -RADIUS), (RADIUS,) * 3)
needs_eevee = pytest.mark.skipif(not all(c.ok for c in checks() if c.name == "EEVEE"), reason="no EGL on this machine")


def made(scene, engine, **options):
    bodies = describe_scene(scene)
    return plan(scene, bodies, engine, 4, has_null_scattering=compat.current().volume_biased, **options), bodies


# --- the ground -----------------------------------------------------------------------------------------------


def ground_points(eye):
    """World positions (n, 3) in float32 of the ground's vertices, and its faces."""
    data, placement = objects.mesh(EARTH, "ground", eye)
    try:
        points = np.array([v.co for v in data.vertices], np.float32).astype(float)
        faces = [tuple(face.vertices) for face in data.polygons]
        volume = sum(face.area * face.normal.dot(face.center) for face in data.polygons) / 3.0
        return points @ np.array(placement)[:3, :3].T + np.array(placement.translation), faces, volume
    finally:
        bpy.data.meshes.remove(data)


@pytest.mark.parametrize("eye", [(0.0, 0.0, 1.7), (3000.0, -4000.0, 900.0)])
def test_facets_lie_below_the_ground_by_a_small_share_of_their_distance(eye):
    points, faces, _ = ground_points(eye)
    centers = np.array([points[list(face)].mean(axis=0) for face in faces])
    distance = np.linalg.norm(centers - np.array(eye), axis=1)
    # h = |p| - R in the form that keeps its digits.
    altitude = lambda p: (np.einsum("ni,ni->n", p, p) + 2 * RADIUS * p[:, 2]) / (  # noqa: E731
        np.linalg.norm(p + (0, 0, RADIUS), axis=1) + RADIUS)
    sagitta = -altitude(centers)
    near = distance < 1e6
    assert near.sum() > 10_000
    assert sagitta.max() > 0.0 and (sagitta[near] >= -1e-3 * np.maximum(1.0, 1e-4 * distance[near])).all()  # float32 of the mesh
    # Two chords of growth 0.05: (0.05 d)^2 / (8 R) each, and the first disk of 64 m.
    assert (sagitta[near] <= 2.2 * (0.05 * distance[near]) ** 2 / (8 * RADIUS) + 1e-3 + 1e-7 * distance[near]).all()
    assert (sagitta[near] < 1e-4 * distance[near] + 1e-3).all()


def test_the_ground_is_closed_and_faces_outwards():
    points, faces, volume = ground_points((0.0, 0.0, 2.0))
    edges = {}
    for face in faces:
        for a, b in zip(face, (*face[1:], face[0])):
            edges[a, b] = edges.get((a, b), 0) + 1
    assert set(edges.values()) == {1} and all((b, a) in edges for a, b in edges)
    # Around the mesh's own origin, on its surface: still the whole volume.
    assert volume == pytest.approx(4 * math.pi / 3 * RADIUS**3, rel=5e-3)


def test_an_eye_far_away_sees_an_ordinary_sphere():
    for eye in ((0.0, 0.0, RADIUS), None):
        data, placement = objects.mesh(EARTH, "far", eye)
        assert tuple(placement.translation) == EARTH.center
        bpy.data.meshes.remove(data)


# --- one object, cut to what is seen ---------------------------------------------------------------------------


def test_two_media_are_one_object():
    scene = by_name("sky-noon").make()
    planned, bodies = made(scene, "cycles")
    with build.temporary():
        built = build.build(scene, bodies, planned, "sky")
        volumes = [o for o in built.objects if o.type == "MESH" and any(
            n.bl_idname == "ShaderNodeGroup" for n in o.material_slots[0].material.node_tree.nodes)]
        assert len(volumes) == 1 and len(scene.volumes) == 2
        size = np.array(volumes[0].dimensions)
        assert size[0] == size[1] < 2e6 and size[2] < 2e5  # not the planet
        assert built.camera.data.clip_end > 1e6


def test_the_panel_adds_and_removes_air():
    scene = bpy.data.scenes.new("user")
    before = {kind: len(getattr(bpy.data, kind)) for kind in ("objects", "meshes", "materials", "node_groups")}
    preset = load("clear-noon")
    item = items.add_item(scene, "air", preset.parameters, preset.label, 8)
    assert [o.name for o in item.objects] == ["Clear noon", "Clear noon ground"]
    node = items.live_node(item)
    assert len(node.inputs) == len(preset.group.live)
    items.remove_item(scene, item)
    assert {kind: len(getattr(bpy.data, kind)) for kind in before} == before
    bpy.data.scenes.remove(scene)


# --- altitude ---------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("elevation", [0.0, 3.0, 40.0])
@pytest.mark.parametrize("height", [8500.0, 1200.0])
def test_transmittance_against_the_closed_form(elevation, height):
    """A bright wall behind air that absorbs: L = exp(-tau), tau in float64. Its depth is 0.02 and 0.1 towards the zenith."""
    scene = by_name("sky-noon").make()
    volume = scene.volumes[1]
    air = replace(volume.medium, sigma_s=(0.0,) * 3, density=replace(volume.medium.density, scale_height=height))
    c, s = math.cos(math.radians(elevation)), math.sin(math.radians(elevation))
    eye = (0.0, 0.0, 50.0)
    wall = Surface(Box((0.0, 1.5e6 * c, 1.5e6 * s), (8e5, 10.0, 8e5)), (0.0,) * 3, (1.0,) * 3)
    for absorption in (0.02 / height, 0.1 / height):
        grey = replace(volume, medium=replace(air, sigma_a=(absorption,) * 3))
        one = replace(scene, volumes=(grey,), lights=(), orders=1, camera=Camera(eye, (0.0, c, s), math.radians(0.02)),
                      surfaces=(*scene.surfaces, wall))
        image = render_scene(one, describe_scene(one), "tau", "cycles", 4, 4, 64, repeats=8).images
        mu = s if elevation else 0.0
        tau = optical_depth(RADIUS + eye[2], mu, top_distance(RADIUS + eye[2], mu, RADIUS + 60e3), absorption, height, RADIUS)
        mean = image.mean(axis=(1, 2, 3))
        error = mean.std(ddof=1) / math.sqrt(len(mean))
        # Ray marching in steps of up to two scale heights: measured -0.8 % to +0.01 % of a small depth, 0.02 % of a large one.
        assert abs(mean.mean() - math.exp(-tau)) < 4.0 * error + (1e-3 + 3e-4 * tau) * math.exp(-tau), f"{mean.mean()} {math.exp(-tau)}"


# --- unit of length ---------------------------------------------------------------------------------------------


def images(scene, bodies, engine, **options):
    return render_scene(scene, bodies, "unit", engine, 12, 12, options.pop("samples", 4), **options).images


def test_cycles_renders_the_same_picture_in_kilometres():
    scene = replace(by_name("sky-noon").make(), orders=2)
    bodies = describe_scene(scene)
    here = images(scene, bodies, "cycles", samples=32, repeats=6).mean(axis=(1, 2))
    there = images(scaled(scene, 1e-3), [scaled_body(b, 1e-3) for b in bodies], "cycles", samples=32, repeats=6,
                   seed=100).mean(axis=(1, 2))
    error = np.hypot(here.std(axis=0, ddof=1), there.std(axis=0, ddof=1)) / math.sqrt(6)
    assert (abs(here.mean(axis=0) - there.mean(axis=0)) < 5.0 * error).all()
    assert (error < 0.02 * here.mean(axis=0)).all()  # the comparison is worth something


@pytest.mark.either
@needs_eevee
def test_eevee_renders_the_same_picture_in_another_unit():
    """Exactly the same in units twice apart, but for a pixel of the ground here and there: the shadow of a planet's mesh is biased
    by lengths of EEVEE's own. In metres EEVEE shows two thirds less than in its own unit."""
    scene = scaled(replace(by_name("sky-noon").make(), orders=1), 2.0**-16)
    bodies = describe_scene(scene)
    here = images(scene, bodies, "eevee", samples=1)
    there = images(scaled(scene, 0.5), [scaled_body(b, 0.5) for b in bodies], "eevee", samples=1)
    same = np.isclose(here, there, rtol=1e-3).all(axis=-1)
    assert same.mean() >= 0.98 and here.min() > 0.0  # measured: 143 of 144 pixels


def test_only_thin_media_change_the_unit():
    assert made(by_name("sky-noon").make(), "cycles")[0].unit == 1.0
    planned, _ = made(by_name("sky-noon").make(), "eevee")
    assert planned.unit == 1e5
    assert "unit of length" in {decision.rule for decision in planned.decisions}
    for name in ("street-lamp", "valley-fog", "thin-cloud"):
        assert made(by_name(name).make(), "eevee")[0].unit == 1.0


# --- the picture ------------------------------------------------------------------------------------------------


@pytest.mark.either
@pytest.mark.parametrize("name", ["sky-noon", "sky-sunset"])
def test_cycles_single_scattering_is_exact(name):
    """Every channel: where molecules and aerosol mix in one material, Cycles gives all channels one mixture (-16 % of red)."""
    scene = replace(by_name(name).make(), orders=1)
    truth = select.load("sky_single_scattering").render(scene, 12, 12, strata=0, order=32).image
    settings = {"cycles.pixel_filter_type": "GAUSSIAN", "cycles.filter_width": 0.01}
    means = images(scene, describe_scene(scene), "cycles", samples=64, repeats=8, settings=settings).mean(axis=(1, 2))
    error = means.std(axis=0, ddof=1) / math.sqrt(len(means))
    expected = truth.mean(axis=(0, 1))
    assert (error < 0.01 * expected).all()
    assert (abs(means.mean(axis=0) - expected) < 4.5 * error + 0.002 * expected).all()


@pytest.mark.parametrize("engine", ["cycles", "eevee"])
@pytest.mark.parametrize("name", ["sky-noon", "sky-sunset"])
def test_the_engines_are_on_the_sky_charts(name, engine):
    assert rival(engine).applies(by_name(name).make()) == ""


@pytest.mark.either
@needs_eevee
def test_eevee_shows_a_sky():
    """Single scattering without the air's dimming of the ground: measured -33 % of eight orders, blue above the horizon."""
    preset = load("clear-noon")
    scene = verify.scene_of(preset)
    image = images(scene, describe_scene(scene), "eevee", samples=1)[0]
    above = image[:4].mean(axis=(0, 1))
    assert above[2] > 1.5 * above[0] > 0.0
