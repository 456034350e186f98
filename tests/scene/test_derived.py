# SPDX-License-Identifier: GPL-3.0-or-later
"""What the handles mean physically, against closed forms worked out by hand and against the physics of the references."""

import math

import pytest

from volumetrics_addon.parameters.families import FAMILIES
from volumetrics_addon.physics.atmosphere import optical_depth
from volumetrics_addon.physics.transmittance import exp2_fog, exp_fog, height_optical_depth
from volumetrics_addon.scene.derived import Quantity, derived, text


def of(family, **values):
    return {q.label: q.value for q in derived(family, FAMILIES[family].check(values))}


def about(value, digits=6):
    return pytest.approx(value, rel=10.0**-digits)


def test_fog():
    shown = of("fog", extinction=0.05, scale_height=3.0, cutoff=0.002)
    assert shown["Visibility at the base"] == about(78.2404601)  # ln 50 / 0.05
    assert shown["Height of the fog"] == about(18.6438243)  # 3 ln 500
    assert shown["Optical depth straight up"] == about(0.1497)  # 0.05 * 3 * 0.998
    assert shown["Transmittance over 100 m"] == about(0.00673794700)  # exp(-5)
    assert of("fog", visibility=100.0)["Extinction at the base"] == about(0.0391202301)


def test_two_layers_and_a_slab_of_fog():
    shown = of("fog", extinction=0.05, scale_height=3.0, second_extinction=0.01, second_scale_height=30.0, cutoff=0.002)
    assert shown["Visibility at the base"] == about(65.2003834)  # ln 50 / 0.06
    assert shown["Height of the fog"] == about(186.438243)
    up = sum(float(height_optical_depth(0.0, 1.0, 186.438243, sigma, height)) for sigma, height in ((0.05, 3.0), (0.01, 30.0)))
    assert shown["Optical depth straight up"] == about(up) == about(0.4494)
    slab = of("fog", profile="slab", slab_height=8.0, extinction=0.25, second_extinction=3.0)
    assert slab["Optical depth straight up"] == about(2.0) and slab["Height of the fog"] == 8.0
    assert slab["Transmittance over 100 m"] == about(math.exp(-25.0))


def test_patches_and_depth_fogs():
    patch = of("fog", profile="patch", size=(20.0, 14.0, 3.0), extinction=0.5)
    assert patch["Height of the fog"] == 3.0 and patch["Optical depth, densest"] == about(1.5)
    linear = of("fog", profile="linear", start=20.0, end=100.0, far_color=(0.6, 0.7, 0.8), far_radiance=0.5)
    assert (linear["Half hidden at"], linear["98 % hidden at"]) == about((60.0, 98.4))
    assert linear["Radiance far away"] == about((0.3, 0.35, 0.4))
    for profile, transmittance in (("exp", exp_fog), ("exp2", exp2_fog)):
        shown = of("fog", profile=profile, start=20.0, extinction=0.01)
        assert shown["Density"] == 0.01
        for label, left in (("Half hidden at", 0.5), ("98 % hidden at", 0.02)):
            assert float(transmittance(shown[label] - 20.0, 0.01)) == about(left)


def test_glass():
    # At 0.2 m and twice as strong: over the 0.1 m of the ball just this colour.
    shown = of("glass", color=(0.5, 0.25, 0.1), distance=0.2, strength=2.0, ior=1.5, size=(0.1, 0.2, 0.3))
    assert shown["Absorption"] == about((6.93147181, 13.8629436, 23.0258509))
    assert shown["Depth of 1/e"] == about((0.144269504, 0.0721347520, 0.0434294482))
    assert shown["Transmittance, thinnest way"] == about((0.5, 0.25, 0.1))
    assert shown["Reflectance face on"] == about(0.04)
    shell = of("glass", shape="shell", thickness=0.005, color=(0.5, 0.25, 0.1), distance=0.01, refraction=False)
    assert shell["Transmittance, two walls"] == about((0.5, 0.25, 0.1)) and "Reflectance face on" not in shell
    pane = of("glass", shape="sheet", thickness=0.01, color=(0.5, 0.25, 0.1), distance=0.01)
    assert pane["Transmittance face on"] == about((0.5, 0.25, 0.1))
    # Coefficients of pure water, 1/m (Pope and Fry): an 8 m pool keeps 12 % of red and 92 % of blue.
    water = of("glass", swatch="water", shape="block", size=(8.0, 8.0, 8.0))
    assert water["Transmittance, thinnest way"] == about((0.12061, 0.63636, 0.92238), 4)


def test_cloud():
    shown = of("cloud", extinction=0.04, size=(100.0, 50.0, 25.0), g=0.8, g_back=-0.2, lobe_weight=0.25, albedo=(0.99, 0.9, 0.5))
    assert shown["Mean free path"] == about(25.0)
    assert shown["Mean cosine"] == about(0.55)
    assert shown["Transport mean free path"] == about(55.5555556)  # 25 / 0.45
    assert shown["Optical depth, densest, x y z"] == about((4.0, 2.0, 1.0))
    assert shown["Mean events of a path"] == about((100.0, 10.0, 2.0))
    assert of("cloud", phase="hg", g=0.5)["Mean cosine"] == 0.5
    assert "Mean cosine" not in of("cloud", phase="mie")
    clear = of("cloud", extinction=0.0, albedo=(1.0, 1.0, 1.0))
    assert clear["Mean free path"] == math.inf and clear["Mean events of a path"] == (math.inf,) * 3


def test_godray():
    common = {"location": (0.0, 0.0, 5.0), "target": (0.0, 0.0, 0.0), "power": 400.0 * math.pi, "color": (1.0, 0.5, 0.25),
              "extinction": 0.1, "length": 4.0}
    spot = of("godray", cone_angle=40.0, **common)
    assert spot["Beam's radius at the end"] == about(1.45588094)  # 4 tan 20 deg
    assert spot["Intensity"] == about((100.0, 50.0, 25.0))
    assert spot["Visibility in the haze"] == about(39.1202301)
    assert spot["Optical depth of the beam"] == about(0.4)
    assert spot["Irradiance at the target"] == about((2.68128018, 1.34064009, 0.670320046))  # 4 exp(-0.4)
    projector = common | {"light": "projector", "near": 1.0, "horizontal_fov": 90.0, "vertical_fov": 60.0}
    linear = of("godray", falloff="linear", **projector)
    assert (linear["Beam's width at the end"], linear["Beam's height at the end"]) == about((8.0, 4.61880215))
    assert linear["Optical depth of the beam"] == about(0.3)
    assert linear["Irradiance at the target"][0] == about(14.8163644)  # 100 / 5 exp(-0.3)
    assert of("godray", far=4.5, **projector)["Irradiance at the target"] == (0.0, 0.0, 0.0)
    assert "Irradiance at the target" not in of("godray", **(common | {"target": common["location"]}))  # the lamp itself


def test_sunlight_through_an_opening():
    # Down a slope of 3 in 4: from 6 m to a floor at 3 m it goes 5 m.
    common = {"light": "sun", "location": (0.0, 0.0, 6.0), "target": (8.0, 0.0, 0.0), "irradiance": 4.0, "color": (1.0, 0.5, 0.25),
              "extinction": 0.1, "length": 20.0}
    shaft = of("godray", floor_height=3.0, **common)
    assert shaft["Length of the shaft"] == about(5.0) and shaft["Optical depth of the shaft"] == about(0.5)
    assert shaft["Irradiance at its end"] == about((2.42612264, 1.21306132, 0.60653066))  # 4 exp(-0.5)
    assert of("godray", shaft_end="length", **common)["Optical depth of the shaft"] == about(2.0)
    assert of("godray", floor_height=7.0, **common)["Length of the shaft"] == math.inf  # never there


def test_air():
    shown = of("air", rayleigh_scattering=0.0331, rayleigh_color=(0.2, 0.4, 1.0), rayleigh_scale_height=8500.0, thickness=60000.0,
               mie_extinction=0.004, mie_scale_height=1200.0)
    # In quadrature, from the ground straight up to the top of the air.
    molecules = float(optical_depth(6.36e6, 1.0, 60000.0, 0.0331e-3, 8500.0, 6.36e6))
    assert shown["Molecules straight up"] == about((0.2 * molecules, 0.4 * molecules, molecules))
    assert shown["Aerosol straight up"] == about(0.0048)
    assert shown["Overhead sun kept"] == about(tuple(math.exp(-share * molecules - 0.0048) for share in (0.2, 0.4, 1.0)))
    assert shown["Visibility at the ground"] == about(226.91548e3)  # ln 50 / (0.4 * 0.0331 + 0.004) km
    assert shown["Air hides 1 - 1/e after"] == about((94161.96, 58004.64, 26954.18), 5)


@pytest.mark.parametrize("quantity, words", [
    (Quantity("", 25.0, "m"), "25 m"), (Quantity("", 78240.0, "m"), "78.2 km"), (Quantity("", 0.0125, "m"), "12.5 mm"),
    (Quantity("", (0.02, 0.005, 0.1), "m"), "20, 5, 100 mm"), (Quantity("", math.inf, "m"), "unlimited"),
    (Quantity("", (math.inf, 2000.0, 5000.0), "m"), "unlimited, 2, 5 km"), (Quantity("", (0.25,) * 3), "0.25"),
    (Quantity("", 0.0331e-3, "1/m"), "0.0331 1/km"), (Quantity("", 0.0, "1/m"), "0 1/m"),
    (Quantity("", 1.0 / (1.0 - 0.999)), "1000"),
    (Quantity("", 6.1e-6), "6.1e-06"), (Quantity("", 14.8163644, "W/m2"), "14.8 W/m2"), (Quantity("", 0.0, "m"), "0 m"),
])
def test_text(quantity, words):
    assert text(quantity) == words


@pytest.mark.parametrize("family", FAMILIES)
def test_the_limits_of_every_parameter(family):
    """Numbers at all of them, and words."""
    group, tried = FAMILIES[family], 0
    for parameter in group.parameters:
        if parameter.kind in ("text", "path"):
            continue
        extremes = [name for name, _ in parameter.choices] or [True, False]
        if parameter.kind not in ("choice", "bool"):
            numbers = parameter.minimum, parameter.maximum
            extremes = [(n,) * 3 for n in numbers] if parameter.kind in ("color", "vector") else \
                [int(n) if parameter.kind == "int" else n for n in numbers]
        for value in extremes:
            quantities = derived(family, group.check({parameter.name: value}))
            assert len(quantities) >= 3
            for quantity in quantities:
                parts = quantity.value if isinstance(quantity.value, tuple) else (quantity.value,)
                assert not any(math.isnan(part) for part in parts) and text(quantity), (parameter.name, value, quantity)
            tried += 1
    assert tried >= 2 * (len(group.parameters) - 2)
