# SPDX-License-Identifier: GPL-3.0-or-later
"""Parameters become the physical description that they name."""

import math

import pytest

from volumetrics_addon.parameters.families import FAMILIES
from volumetrics_addon.parameters.preset import load, names
from volumetrics_addon.scene import assemble
from volumetrics_addon.scene.model import Box, Cone, Ellipsoid, ExponentialHeight, Hull, Scene, Spot


def test_glass_reaches_its_colour_at_its_distance():
    values = FAMILIES["glass"].check({"color": [0.2, 0.5, 1.0], "distance": 0.3})
    medium = assemble.ASSEMBLERS["glass"](values).volumes[0].medium
    for sigma, color in zip(medium.sigma_a, (0.2, 0.5, 1.0)):
        assert math.exp(-sigma * 0.3) == pytest.approx(color, rel=1e-12)
    assert not medium.scatters


def test_cloud_coefficients_and_lobes():
    values = FAMILIES["cloud"].check({"extinction": 0.5, "albedo": [1.0, 0.8, 0.5], "g": 0.8, "g_back": -0.4, "lobe_weight": 0.25})
    medium = assemble.ASSEMBLERS["cloud"](values).volumes[0].medium
    assert medium.sigma_s == pytest.approx((0.5, 0.4, 0.25))
    assert medium.sigma_a == pytest.approx((0.0, 0.1, 0.25))
    assert medium.phase.mean_cosine == pytest.approx(0.75 * 0.8 - 0.25 * 0.4)
    single = assemble.ASSEMBLERS["cloud"]({**values, "phase": "hg"}).volumes[0].medium.phase
    assert single.weight == 0.0 and single.mean_cosine == pytest.approx(0.8)


def test_fog_box_covers_the_scene_and_ends_at_the_cutoff():
    values = FAMILIES["fog"].check({"scale_height": 2.0, "base_height": 1.0, "cutoff": math.exp(-5.0), "margin": 3.0})
    volume = assemble.ASSEMBLERS["fog"](values, assemble.Bounds([(0.0, 0.0, 0.0), (10.0, 4.0, 2.0)])).volumes[0]
    assert isinstance(volume.domain, Box)
    low = [c - h for c, h in zip(volume.domain.center, volume.domain.half)]
    high = [c + h for c, h in zip(volume.domain.center, volume.domain.half)]
    assert low[:2] == pytest.approx([-3.0, -3.0]) and high == pytest.approx([13.0, 7.0, 11.0])
    assert 0.0 < 1.0 - low[2] < 0.2  # just below the base
    assert volume.medium.density == ExponentialHeight(2.0, 1.0)


def test_fog_without_anything_to_fit_to_says_so():
    with pytest.raises(ValueError, match="nothing to fit.*add a camera"):
        assemble.Bounds([])
    with pytest.raises(ValueError, match="bounds"):
        assemble.ASSEMBLERS["fog"](FAMILIES["fog"].defaults(), None)


@pytest.mark.parametrize("blocker, count", [("none", 0), ("slats", 5), ("window", 10)])
def test_godray_blockers_cut_the_beam(blocker, count):
    values = FAMILIES["godray"].check({"blocker": blocker, "blocker_count": 5, "blocker_distance": 1.5})
    item = assemble.ASSEMBLERS["godray"](values)
    assert len(item.surfaces) == count
    spot = item.lights[0]
    assert isinstance(spot, Spot) and isinstance(item.volumes[0].domain, Cone)
    for surface in item.surfaces:
        offset = [c - p for c, p in zip(surface.shape.center, spot.position)]
        assert sum(o * a for o, a in zip(offset, spot.direction)) == pytest.approx(1.5)


def test_light_at_its_own_target_is_refused():
    values = FAMILIES["godray"].check({"location": [1.0, 1.0, 1.0], "target": [1.0, 1.0, 1.0]})
    with pytest.raises(ValueError, match="no direction"):
        assemble.ASSEMBLERS["godray"](values)


def test_sun_direction():
    assert assemble.sun_direction(math.pi / 2, 0.0) == pytest.approx((0.0, 0.0, -1.0), abs=1e-12)
    # Sun low in the east: light travels west.
    assert assemble.sun_direction(0.0, math.pi / 2) == pytest.approx((-1.0, 0.0, 0.0), abs=1e-12)


def test_every_preset_becomes_a_scene():
    shapes = set()
    for name in names():
        preset = load(name)
        scene = assemble.scene(preset.family, preset.parameters, preset.stage, preset.props)
        assert isinstance(scene, Scene) and scene.volumes
        shapes |= {type(volume.domain) for volume in scene.volumes}
    assert shapes == {Box, Ellipsoid, Cone, Hull}
