# SPDX-License-Identifier: GPL-3.0-or-later
"""A described volume, assembled again, is the volume."""

import math
from dataclasses import replace

import pytest

from volumetrics_addon.bench.scenes import by_name
from volumetrics_addon.parameters.families import FAMILIES
from volumetrics_addon.parameters.preset import load, names
from volumetrics_addon.scene import assemble
from volumetrics_addon.scene.describe import describe, describe_scene
from volumetrics_addon.scene.model import (
    Box, Dust, Ellipsoid, ExponentialAltitude, ExponentialHeight, Grid, Medium, MiePhase, Phase, RayleighPhase, Volume,
)

BOX = Box((0.0, 0.0, 0.0), (1.0, 1.0, 1.0))


def close(a, b):
    if isinstance(a, tuple):
        return len(a) == len(b) and all(map(close, a, b))
    if isinstance(a, float):
        return math.isclose(a, b, rel_tol=1e-12, abs_tol=1e-15)
    return a == b


@pytest.mark.parametrize("name", names())
def test_inverse_of_assembly(name):
    preset = load(name)
    scene = assemble.scene(preset.family, preset.parameters, preset.stage, preset.props)
    assert scene.volumes
    described = describe_scene(scene)
    assert [volume for body in described for volume in body.volumes] == list(scene.volumes)
    for body in described:
        family, values = body.family.name, body.values
        # Position and size of a domain are the Scene's, only the material is described.
        placed = values | {key: preset.parameters[key] for key in ("location", "size", "rotation", "domain", "margin", "cutoff",
                                                               "reach", "ground_albedo")
                           if key in preset.parameters and key in values}
        if preset.family == "godray":
            medium = body.volumes[0].medium
            assert family == ("godray" if medium.glows or isinstance(medium.density, Dust) else "cloud")
            placed |= {"domain": "box"}
        for again, volume in zip(assemble.ASSEMBLERS[family](placed, assemble.Bounds([(0.0, 0.0, 0.0)])).volumes, body.volumes,
                                 strict=True):
            for mine, other in ((again.medium.sigma_s, volume.medium.sigma_s), (again.medium.sigma_a, volume.medium.sigma_a)):
                assert close(mine, other)
            assert again.medium.phase == volume.medium.phase
            assert again.medium.density == volume.medium.density and close(again.medium.ambient, volume.medium.ambient)
            assert again.boundary == volume.boundary and again.sheet == volume.sheet


def test_droplets_and_billows_come_back():
    values = FAMILIES["cloud"].check({"phase": "mie", "droplet_diameter": 7.5, "profile": "anvil", "billow_octaves": 4,
                                      "billow_size": 3.0, "billow_strength": 0.7, "billow_roughness": 0.4, "base": 0.1,
                                      "stretch": 2.0, "wind": (1.0, 2.0, 3.0), "time": 5.0, "evolution": 0.25})
    volume, = assemble.ASSEMBLERS["cloud"](values).volumes
    assert volume.medium.phase == MiePhase(7.5) and volume.medium.density.drift == (5.0, 10.0, 15.0)
    family, described = describe(volume)
    again, = assemble.ASSEMBLERS["cloud"](described | {key: values[key] for key in ("location", "size", "domain")}).volumes
    assert family == "cloud" and again == volume


@pytest.mark.parametrize("medium", [
    Medium((1.0, 1.0, 1.0), (0.0, 0.1, 0.0), Phase(0.0)),
    Medium((1.0, 1.0, 1.0), (0.0, 0.0, 0.0), RayleighPhase()),
    Medium((1.0, 1.0, 1.0), (0.0, 0.0, 0.0), Phase(0.0), ExponentialAltitude((0, 0, -9), 9.0, 1.0)),
])
def test_what_no_family_has_is_refused(medium):
    with pytest.raises(ValueError, match="; |use"):
        describe(Volume(BOX, medium))


def test_voxels_are_a_cloud_that_may_only_absorb():
    """The values of the cloud colour them; the density is the volume's own."""
    for sigma_s, albedo in (((1.0, 0.5, 0.0), (1.0, 0.5, 0.0)), ((0.0,) * 3, (0.0,) * 3)):
        medium = Medium(sigma_s, tuple(1.0 - s for s in sigma_s), Phase(0.3), Grid(None, (0, 0, 0), (1, 1, 1)))
        family, values = describe(Volume(BOX, medium))
        assert family == "cloud" and values["extinction"] == 1.0 and values["albedo"] == albedo and values["g"] == 0.3


def test_ambient_light_and_dust_are_those_of_haze():
    medium = Medium((1.0,) * 3, (0.5,) * 3, Phase(0.2), Dust(0.5, 2.0, 7, (1.0, 2.0, 3.0)), (2.0, 1.0, 0.0))
    family, values = describe(Volume(BOX, medium))
    assert family == "godray" and (values["extinction"], values["g"]) == (1.5, 0.2)
    assert (values["ambient"], values["ambient_color"]) == (2.0, (1.0, 0.5, 0.0))
    assert [values[f"dust_{name}"] for name in ("strength", "size", "seed", "drift", "time")] == [0.5, 2.0, 7, (1.0, 2.0, 3.0), 1.0]
    for other in (replace(medium, density=ExponentialHeight(1.0, 0.0)), replace(medium, phase=Phase(0.2, 0.1, 0.5))):
        with pytest.raises(ValueError, match="ambient light is that of haze with one HG lobe"):
            describe(Volume(BOX, other))


# --- air --------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("name", ["sky-noon", "sky-sunset"])
def test_the_benchmark_skies_are_air(name):
    scene = by_name(name).make()
    air, = describe_scene(scene)
    assert air.family.name == "air" and air.volumes == scene.volumes
    assert air.family.check(air.values) == air.values
    again = assemble.ASSEMBLERS["air"](air.values)
    for mine, other in zip(again.volumes, scene.volumes, strict=True):
        assert close(mine.medium.sigma_s, other.medium.sigma_s) and close(mine.medium.sigma_a, other.medium.sigma_a)
        assert replace(mine.medium, sigma_s=(), sigma_a=()) == replace(other.medium, sigma_s=(), sigma_a=())
        assert mine.domain == other.domain
    assert again.surfaces == scene.surfaces


def test_air_reaches_to_where_the_horizon_leaves_it():
    """From 100 m the ground ends after 36 km, and the line that grazes it is 60 km high after 876 km more."""
    air, = describe_scene(by_name("sky-noon").make())
    assert air.values["reach"] == pytest.approx(math.sqrt(2 * 6.36e6 * 100) + math.sqrt(6.42e6**2 - 6.36e6**2), rel=1e-3)
    low, high = (air.domain.center[2] - air.domain.half[2], air.domain.center[2] + air.domain.half[2])
    assert high == pytest.approx(60_000.0)
    assert low == pytest.approx(math.sqrt(6.36e6**2 - air.values["reach"] ** 2) - 6.36e6, rel=1e-6)  # the ground's drop there


SKY = by_name("sky-noon").make()
MOLECULES, AEROSOL = SKY.volumes


@pytest.mark.parametrize("volumes, message", [
    ((MOLECULES, replace(AEROSOL, domain=Ellipsoid((0.0, 0.0, -6.36e6), (6.5e6,) * 3))), "one planet in one domain"),
    ((MOLECULES, MOLECULES), "molecules and one aerosol"),
    ((replace(MOLECULES, domain=BOX),), "end in a sphere"),
    ((replace(MOLECULES, medium=replace(MOLECULES.medium, sigma_a=(1e-6,) * 3)),), "do not absorb"),
    ((replace(AEROSOL, medium=replace(AEROSOL.medium, phase=Phase(0.8, -0.2, 0.2))),), "one HG lobe"),
    ((replace(AEROSOL, medium=replace(AEROSOL.medium, sigma_s=(1e-6, 1e-6, 2e-6))),), "colour the albedo"),
])
def test_air_that_the_family_has_not(volumes, message):
    with pytest.raises(ValueError, match=message):
        describe_scene(replace(SKY, volumes=volumes))


def test_two_domains_are_two_bodies():
    with pytest.raises(ValueError, match="make a body of each"):
        assemble.body("air", describe_scene(SKY)[0].values, (MOLECULES, replace(AEROSOL, domain=BOX)))
