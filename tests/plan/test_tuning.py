# SPDX-License-Identifier: GPL-3.0-or-later
"""Rules for a user's own scene, on plain data, against literal numbers."""

import math
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy import stats

from volumetrics_addon.plan import tuning, visibility
from volumetrics_addon.plan.catalogue import RULES
from volumetrics_addon.plan.observed import Cells, Lamp, Medium, Noise, Observed, Range, Solids, Substance, Survey, View

HAZE = Substance(Range(0.05, 0.05), 0.8, 0.0, False, False, 0.0)
CLOUD = Substance(Range(0.0, 2.0), 0.9, 0.5, False, True, 0.5)
SEEN = View((0.0, -10.0, 0.0), (1.0, 0.0, 0.0), (0.0, 0.0, 1.0), (0.0, -1.0, 0.0), (-0.4, -0.3), (0.4, 0.3), 1000.0)


def box(center=(0.0, 0.0, 0.0), half=1.0):
    return visibility.corners(tuple(c - half for c in center), tuple(c + half for c in center))


def medium(name="haze", substance=HAZE, center=(0.0, 0.0, 0.0), half=1.0, **changes):
    return Medium(name, f"{name} material", substance, box(center, half), step=0.2 * half, **changes)


def lamp(name="lamp", position=(0.0, 0.0, 3.0), power=100.0, kind="POINT", **changes):
    return Lamp(name, kind, power, position, **changes)


def scene(*media, lamps=(lamp(),), engine="cycles", view=SEEN, environment=0.0, frames=1, settings=None, **changes):
    return Observed(engine, {"cycles.volume_bounces": 12, "cycles.volume_biased": False, "cycles.use_light_tree": True} | (settings or {}),
                    view, media, tuple(lamps), environment=environment, frames=frames, **changes)


def advice(observed, rule, error=0.002):
    return next((found for found in tuning.tune(observed, error) if found.rule.name == rule), None)


def changes(found):
    return {(change.name, change.path): change.value for change in found.changes}


def allowed(rule, error=0.002):
    """What a rule may spend where none before it has spent anything."""
    other = "ray marching" if rule == "longer steps" else "longer steps"  # a scene is marched already, or it is not
    rules = [entry for entry in RULES.values() if "cycles" in entry.engines and entry.name != other]
    shares = [later.share for later in rules[rules.index(RULES[rule]):]]
    return error * shares[0] / sum(shares)


@pytest.mark.parametrize("error", [0.0, -0.1, math.inf, math.nan])
def test_an_error_that_is_none_is_refused(error):
    with pytest.raises(ValueError, match="above 0"):
        tuning.tune(scene(medium()), error)


def test_unknown_rules_are_refused_and_known_ones_switched_off():
    with pytest.raises(ValueError, match="no rule 'speed'"):
        tuning.tune(scene(medium()), without=("speed",))
    names = {found.rule.name for found in tuning.tune(scene(medium()))}
    assert "bounces" in names
    assert {found.rule.name for found in tuning.tune(scene(medium()), without=("bounces",))} == names - {"bounces"}


@pytest.mark.parametrize("error", [1e-3, 2e-3, 0.05])
def test_the_bounds_together_stay_below_the_target(error):
    crowded = scene(medium("cloud", CLOUD), medium("wisp", replace(HAZE, extinction=Range(1e-7, 1e-7))), medium(),
                    medium("far", center=(300.0, 0.0, 0.0)),
                    lamps=[lamp(), *(lamp(f"far {i}", (500.0 + i, 0.0, 0.0)) for i in range(20))], settings={"cycles.volume_bounces": 1000})
    found = tuning.tune(crowded, error)
    assert sum(entry.bound for entry in found) <= error * (1.0 + 1e-12)  # rounded
    assert {"thin media", "idle lamps", "bounces", "ray marching"} <= {entry.rule.name for entry in found}


# --- bounces ----------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("albedo, sigma, error", [(0.8, 0.05, 0.002), (0.5, 5.0, 0.01), (0.99, 0.2, 0.002)])
def test_bounces_are_the_fewest_that_the_bound_allows(albedo, sigma, error):
    """A path of n + 2 events has survived n + 1 times; the chance of each is albedo (1 - exp(-sigma times the diagonal))."""
    substance = Substance(Range(sigma, sigma), albedo, 0.0, False, False, 0.0)
    share = albedo * (1.0 - math.exp(-sigma * 2.0 * math.sqrt(3.0)))
    expected = next(n for n in range(1000) if share ** (n + 1) <= allowed("bounces", error))
    found = advice(scene(medium(substance=substance), settings={"cycles.volume_bounces": 1000}), "bounces", error)
    assert changes(found) == {("", "cycles.volume_bounces"): expected}
    assert found.bound == pytest.approx(share ** (expected + 1))


def test_bounces_are_never_raised_nor_lowered_where_nothing_is_known():
    assert advice(scene(medium(), settings={"cycles.volume_bounces": 1}), "bounces") is None
    assert advice(scene(medium(substance=Substance())), "bounces") is None
    world = Medium("World", "World", replace(HAZE, albedo=1.0))
    assert advice(scene(world), "bounces") is None
    assert advice(scene(medium(), has_instances=True), "bounces") is None


def test_media_that_overlap_count_together():
    thin = replace(HAZE, extinction=Range(0.02, 0.02))
    one = advice(scene(medium(substance=thin)), "bounces")
    four = advice(scene(*(medium(f"haze {i}", thin) for i in range(4))), "bounces")
    assert changes(four)[("", "cycles.volume_bounces")] > changes(one)[("", "cycles.volume_bounces")]


# --- media that are left out ------------------------------------------------------------------------------------


def test_nothing_and_next_to_nothing_are_left_out():
    empty, thin = replace(HAZE, extinction=Range(0.0, 0.0)), replace(HAZE, extinction=Range(1e-5, 1e-5))
    found = advice(scene(medium("empty", empty), medium("thin", thin), medium()), "thin media")
    assert changes(found) == {("empty", "hide_render"): True, ("thin", "hide_render"): True}
    assert found.bound == pytest.approx(1e-5 * 2.0 * math.sqrt(3.0))


@pytest.mark.parametrize("change", [{"moves": True}, {"has_surface": True}, {"editable": False}])
def test_media_that_may_be_needed_stay(change):
    empty = replace(HAZE, extinction=Range(0.0, 0.0))
    assert advice(scene(medium("empty", empty, **change)), "thin media") is None


def test_thin_fire_stays():
    assert advice(scene(medium("fire", replace(HAZE, extinction=Range(0.0, 0.0), emits=True))), "thin media") is None


def test_a_medium_off_camera_is_left_out():
    found = advice(scene(medium("seen"), medium("aside", center=(300.0, 0.0, 0.0))), "unseen media")
    assert changes(found) == {("aside", "hide_render"): True}
    share = 1.0 - math.exp(-0.05 * 2.0 * math.sqrt(3.0))
    # Seen from what is in the picture: the box in the middle, cut by the frame, 298 m away at least.
    assert 0.0 < found.bound <= share * 0.5 * (1.0 - math.cos(math.asin(math.sqrt(3.0) / 297.0)))


def test_a_medium_off_camera_that_shades_the_picture_stays():
    lamps = [lamp("sun", kind="SUN", direction=(-1.0, 0.0, 0.0))]
    aside = medium("aside", center=(300.0, 0.0, 0.0))
    assert advice(scene(medium("seen"), aside, lamps=lamps), "unseen media") is None
    assert advice(scene(medium("seen"), aside, lamps=[lamp(position=(600.0, 0.0, 0.0))]), "unseen media") is None
    # With the sun from the other side its shadow falls away from the picture.
    assert advice(scene(medium("seen"), aside, lamps=[replace(lamps[0], direction=(1.0, 0.0, 0.0))]), "unseen media")


def test_what_mirrors_may_show_a_medium_off_camera():
    aside = medium("aside", center=(300.0, 0.0, 0.0))
    floor = Solids(box((0.0, 0.0, -2.0)))
    assert advice(scene(medium("seen"), aside, solids=floor), "unseen media")
    assert advice(scene(medium("seen"), aside, solids=replace(floor, reflects=True)), "unseen media") is None
    assert advice(scene(medium("seen"), aside, solids=replace(floor, moves=True)), "unseen media") is None


def test_a_wall_that_fills_the_picture_hides_what_is_behind():
    behind = medium("behind", center=(0.0, 200.0, 0.0))
    wall = tuple((x, 5.0, z) for x, z in ((-20.0, -20.0), (20.0, -20.0), (20.0, 20.0), (-20.0, 20.0)))
    assert advice(scene(medium("seen"), behind), "unseen media") is None
    found = advice(scene(medium("seen"), behind, faces=(wall,)), "unseen media")
    assert changes(found) == {("behind", "hide_render"): True}


def test_outside_a_closed_room_nothing_counts_and_lamps_there_do_not_shine_in():
    room = box((0.0, -10.0, 0.0), 4.0)
    outside = medium("outside", center=(0.0, 100.0, 0.0))
    found = advice(scene(medium("seen", center=(0.0, -8.0, 0.0)), outside, room=room, lamps=[
        lamp(position=(0.0, -10.0, 3.0)), lamp("street", (0.0, 200.0, 0.0))]), "unseen media")
    assert changes(found) == {("outside", "hide_render"): True}


@pytest.mark.parametrize("change", [{"view": None}, {"view": replace(SEEN, moves=True)}, {"has_instances": True}])
def test_without_a_camera_that_stays_all_media_stay(change):
    assert advice(scene(medium("seen"), medium("aside", center=(300.0, 0.0, 0.0)), **change), "unseen media") is None


# --- lamps ------------------------------------------------------------------------------------------------------


def test_far_lamps_are_excluded_up_to_the_target():
    """Irradiance goes as 1 / d^2: the nearest a far lamp comes against the farthest of the near one."""
    far = lamp("far", (400.0, 0.0, 0.0))
    found = advice(scene(medium(), lamps=[lamp(), far]), "idle lamps")
    assert changes(found) == {("far", "excludes"): ("haze",)}
    near_least = 1.0 / (1.0 + 1.0 + 4.0**2)  # to the farthest corner from (0, 0, 3)
    assert found.bound == pytest.approx((1.0 / 399.0**2) / near_least)
    assert advice(scene(medium(), lamps=[lamp(), replace(far, power=1e5)]), "idle lamps") is None


def test_forward_scattering_asks_for_more_distance():
    """HG's largest over its smallest value is ((1 + g) / (1 - g))^3: 343 at 0.75."""
    far = lamp("far", (400.0, 0.0, 0.0))
    forward = replace(HAZE, g=0.75)
    assert advice(scene(medium(substance=forward), lamps=[lamp(), far]), "idle lamps", 0.01) is None
    found = advice(scene(medium(substance=forward), lamps=[lamp(), replace(far, position=(4000.0, 0.0, 0.0))]), "idle lamps", 0.01)
    assert found.bound == pytest.approx(343.0 * (1.0 / 3999.0**2) * 18.0)


def test_a_spot_that_turns_away_gives_nothing():
    spot = lamp("spot", (0.0, 0.0, 5.0), kind="SPOT", cone=math.radians(40.0), direction=(0.0, 0.0, 1.0))
    found = advice(scene(medium(), lamps=[lamp(), spot]), "idle lamps")
    assert changes(found) == {("spot", "excludes"): ("haze",)} and found.bound == 0.0
    assert advice(scene(medium(), lamps=[lamp(), replace(spot, direction=(0.0, 0.0, -1.0))]), "idle lamps") is None
    # 40 degrees to the side the cone's edge, 20 degrees from its axis, still meets the ball around the box of half angle 20.3.
    aside = (math.sin(math.radians(40.0)), 0.0, -math.cos(math.radians(40.0)))
    assert advice(scene(medium(), lamps=[lamp(), replace(spot, direction=aside)]), "idle lamps") is None


@pytest.mark.parametrize("change", [{"moves": True}, {"is_linked": True}, {"editable": False}, {"volume_factor": 0.0}])
def test_lamps_that_are_the_users_affair_stay(change):
    assert advice(scene(medium(), lamps=[lamp(), replace(lamp("far", (400.0, 0.0, 0.0)), **change)]), "idle lamps") is None


def test_what_is_not_known_to_shine_excludes_nobody():
    """A lamp of unknown strength, a sky that may be dark where the medium is: neither is light to count on."""
    far = lamp("far", (400.0, 0.0, 0.0))
    unknown = lamp("nodes", power=math.inf)
    assert advice(scene(medium(), lamps=[far, unknown]), "idle lamps") is None
    assert advice(scene(medium(), lamps=[far], environment=1.0, sky_rate=1.0), "idle lamps") is None
    near = {change.name for change in advice(scene(medium(), lamps=[far, unknown, lamp()]), "idle lamps").changes}
    assert near == {"far"}


def test_the_last_lamp_is_never_excluded():
    assert advice(scene(medium(), lamps=[lamp("far", (400.0, 0.0, 0.0))]), "idle lamps") is None
    assert advice(scene(medium(), lamps=[lamp("a", (400.0, 0.0, 0.0)), lamp("b", (400.0, 0.0, 1.0))]), "idle lamps") is None


def test_in_eevee_a_lamp_lights_all_media_or_none():
    far = lamp("far", (400.0, 0.0, 0.0))
    found = advice(scene(medium(), lamps=[lamp(), far], engine="eevee"), "idle lamps")
    assert found.changes == (tuning.Change("lights", "far", "volume_factor", 0.0),)
    beside = medium("beside", center=(390.0, 0.0, 0.0))
    assert advice(scene(medium(), beside, lamps=[lamp(), far], engine="eevee"), "idle lamps") is None


# --- steps ------------------------------------------------------------------------------------------------------


def test_steps_of_marching_follow_feature_and_depth():
    found = advice(scene(medium("cloud", CLOUD)), "ray marching")
    step = min(0.3 * 0.5, math.sqrt(24.0 * allowed("ray marching")) / 2.0)
    assert changes(found) == {("", "cycles.volume_biased"): True, ("cloud material", "cycles.volume_step_rate"): pytest.approx(step / 0.2)}
    assert found.bound == pytest.approx((2.0 * step) ** 2 / 24.0)


@pytest.mark.parametrize("substance", [replace(CLOUD, feature=0.0), replace(CLOUD, extinction=Range(0.0, math.inf)), HAZE])
def test_media_whose_density_is_not_known_are_not_marched(substance):
    assert advice(scene(medium("cloud", substance)), "ray marching") is None
    assert advice(scene(medium("cloud", substance), medium("other", CLOUD)), "ray marching") is None or substance is HAZE


def test_long_ways_take_more_steps_than_the_engines_own_most():
    """The diagonal of 2 sqrt 3 x 40 in steps of 0.1095: 1265, where the engine stops at 1024."""
    step = math.sqrt(24.0 * allowed("ray marching")) / 2.0
    found = advice(scene(medium("cloud", CLOUD, half=40.0), settings={"cycles.volume_max_steps": 1024}), "ray marching")
    assert changes(found)[("", "cycles.volume_max_steps")] == math.ceil(80.0 * math.sqrt(3.0) / step) == 1265


def test_a_huge_domain_with_fine_features_is_not_marched():
    assert advice(scene(medium("cloud", CLOUD, half=1000.0)), "ray marching") is None


def test_marching_pays_where_its_steps_are_fewer_than_the_octrees_evaluations():
    """40 x 128^3 steps for each object; of the diagonal of 2 sqrt 3 in steps of 0.1095, as many as there are paths."""
    step = math.sqrt(24.0 * allowed("ray marching")) / 2.0
    most = 40.0 * 128.0**3 / (2.0 * math.sqrt(3.0) / step)
    assert advice(scene(medium("cloud", CLOUD), paths=0.99 * most), "ray marching")
    assert advice(scene(medium("cloud", CLOUD), paths=1.01 * most), "ray marching") is None


@pytest.mark.parametrize("settings", [{"cycles.volume_biased": True}, {}])
def test_marched_media_get_longer_steps_and_never_shorter_ones(settings):
    marched = scene(medium("cloud", CLOUD, step_rate=0.05), settings=settings, null_scattering=bool(settings))
    found = advice(marched, "longer steps")
    step = min(0.3 * 0.5, math.sqrt(24.0 * allowed("longer steps")) / 2.0)
    assert changes(found) == {("cloud material", "cycles.volume_step_rate"): pytest.approx(step / 0.2)}
    assert advice(replace(marched, media=(medium("cloud", CLOUD, step_rate=1.0),)), "longer steps") is None


def test_media_that_share_a_material_get_the_shorter_steps():
    a, b = medium("small", CLOUD), medium("large", CLOUD, half=2.0)
    found = advice(scene(a, replace(b, material=a.material)), "ray marching")
    step = min(0.3 * 0.5, math.sqrt(24.0 * allowed("ray marching") / 2.0) / 2.0)
    assert changes(found)[(a.material, "cycles.volume_step_rate")] == pytest.approx(step / 0.4)


# --- sampling and the rest --------------------------------------------------------------------------------------


@pytest.mark.parametrize("lamps", [[lamp(), lamp("b")], [lamp(), lamp("spot", kind="SPOT", cone=1.0)]])
def test_lamps_at_points_are_sampled_by_themselves(lamps):
    found = advice(scene(medium(), lamps=lamps), "sampling")
    assert found.changes == (tuning.Change("materials", "haze material", "cycles.volume_sampling", "EQUIANGULAR"),)
    assert advice(scene(medium(), lamps=lamps, environment=1.0), "sampling")  # direct light of the lamps alone is sampled so
    world = Medium("World", "World", HAZE, sampling="EQUIANGULAR")
    for other in (scene(world, lamps=lamps), scene(medium(), lamps=[lamp(position=(0.0, 0.0, 1.5)), lamp(kind="SUN")]),
                  scene(medium("cloud", CLOUD), lamps=lamps), scene(medium(), lamps=[*lamps, lamp(kind="AREA")]), scene(medium(), lamps=lamps, has_emitters=True),
                  scene(medium(), lamps=lamps, has_instances=True), scene(medium(), lamps=[])):
        assert advice(other, "sampling") is None


def test_deep_media_are_not_sampled_by_their_lamps():
    """The diagonal 2 sqrt 3 of extinction 1.15 is an optical depth of 3.98; a material of a shallow and a deep medium stays."""
    shallow, deep = (medium(name, replace(HAZE, extinction=Range(sigma, sigma))) for name, sigma in (("shallow", 1.15), ("deep", 1.16)))
    assert changes(advice(scene(shallow, deep), "sampling")) == {("shallow material", "cycles.volume_sampling"): "EQUIANGULAR"}
    assert advice(scene(shallow, replace(deep, material=shallow.material)), "sampling") is None


def test_a_sun_and_far_lamps_are_sampled_by_distance():
    """The box reaches from -1 to 1, half of its diagonal is sqrt 3: a lamp is far from 2.74 on, with its radius."""
    sun = lamp("sun", kind="SUN")
    for substance in (HAZE, CLOUD):
        found = advice(scene(medium("m", substance), lamps=[sun, lamp(position=(0.0, 0.0, 2.74))]), "sampling")
        assert changes(found) == {("m material", "cycles.volume_sampling"): "DISTANCE"}
    for lamps in ([sun], [sun, lamp(position=(0.0, 0.0, 2.73))], [sun, lamp(position=(0.0, 0.0, 2.74), radius=0.1)],
                  [sun, lamp(position=(0.0, 0.0, 9.0), kind="SPOT", cone=1.0)], [sun, lamp(position=(0.0, 0.0, 9.0), moves=True)]):
        assert advice(scene(medium("cloud", CLOUD), lamps=lamps), "sampling") is None
    near = medium("near", CLOUD, center=(0.0, 0.0, 4.0))
    both = scene(medium("cloud", CLOUD), replace(near, material="cloud material"), lamps=[sun, lamp(position=(0.0, 0.0, 2.74))])
    assert advice(both, "sampling") is None  # of one material, and for one of them the lamp is not far


def test_lamps_that_aimed_rays_find_are_hit_by_no_others():
    bulb, spot = lamp("bulb", radius=0.1, is_hit=True), lamp("spot", kind="SPOT", radius=0.2, cone=1.0, is_hit=True)
    others = [lamp("point", is_hit=True), lamp("aimed", radius=0.1), lamp("linked file", radius=0.1, is_hit=True, editable=False),
              lamp("sun", kind="SUN", radius=0.01, is_hit=True), lamp("area", kind="AREA", radius=1.0, is_hit=True)]
    found = advice(scene(medium(), lamps=[bulb, spot, *others], mirrors=False), "lamp hits")
    assert changes(found) == {(name, "cycles.use_multiple_importance_sampling"): False for name in ("bulb", "spot")}
    assert found.bound == 0.0 and {change.owner for change in found.changes} == {"lights"}
    forward = medium("beam", replace(HAZE, g=0.95))
    pair = [bulb, spot]
    for needed in (scene(medium(), lamps=pair, mirrors=True), scene(lamps=pair, mirrors=False), scene(medium(), lamps=others, mirrors=False),
                   scene(forward, lamps=pair, mirrors=False), scene(medium(), lamps=pair, mirrors=False, has_instances=True),
                   scene(medium(), lamps=[bulb], mirrors=False)):
        assert advice(needed, "lamp hits") is None


def test_no_ray_is_aimed_at_a_smooth_sky():
    smooth = scene(environment=2.0, sky_rate=1.9, world="World", touches=False)
    assert changes(advice(smooth, "sky rays")) == {("World", "cycles.sampling_method"): "NONE"}
    assert advice(smooth, "sky map") is None  # which nobody looks up any more
    assert "sky map" in {found.rule.name for found in tuning.tune(smooth, without=("sky rays",))}
    for change in ({"sky_rate": 2.1}, {"sky_rate": 0.0}, {"environment": math.inf, "sky_rate": math.inf}, {"world": ""},
                   {"touches": True}):
        assert advice(replace(smooth, **change), "sky rays") is None


def test_the_map_of_a_sky_is_as_fine_as_it_changes():
    """Brightness 2 that changes by 0.5 a radian: over a row of pi / n by a tenth of 2 where n = 10 pi 0.5 / 2 = 7.9."""
    found = advice(scene(environment=2.0, sky_rate=0.5, world="World"), "sky map")
    assert changes(found) == {("World", "cycles.sampling_method"): "MANUAL", ("World", "cycles.sample_map_resolution"): 64}
    finer = advice(scene(environment=2.0, sky_rate=5.0, world="World"), "sky map")  # n = 78.5, twice as many across: 157
    assert changes(finer)[("World", "cycles.sample_map_resolution")] == 256
    for change in ({"sky_rate": 50.0}, {"sky_rate": math.inf}, {"sky_rate": 0.0}, {"world": ""}, {"environment": math.inf}):
        assert advice(scene(**{"environment": 2.0, "sky_rate": 5.0, "world": "World"} | change), "sky map") is None


UNEVEN = (0.0,) * 3 + (1.0 / 1.8,) * 7  # variance over brightness: three tenths are dark
ADAPTIVE = {"cycles.use_adaptive_sampling": True, "cycles.adaptive_threshold": 0.01}


def test_the_threshold_is_that_of_pixels_with_less_noise():
    """Cycles' own criterion, drawn: pixels of brightness 0.3, 0.6 and 0.9 whose samples have a deviation of 1 in each channel; of 256
    samples the sum of |all - every other| over the root of the brightness."""
    draws = np.random.default_rng(3).normal((0.3, 0.6, 0.9), 1.0, (2000, 256, 3))
    difference = np.abs(draws.mean(axis=1) - draws[:, ::2].mean(axis=1)).sum(axis=-1).mean() / math.sqrt(1.8)
    noisy = scene(settings=ADAPTIVE, samples=256.0, noise=Noise(1.0, 1.8, UNEVEN))
    found = advice(noisy, "noise threshold")
    assert changes(found) == {("", "cycles.adaptive_threshold"): pytest.approx(0.7 * difference, rel=0.05)}
    assert tuning.effect(found) == "a fifth more noise at most"
    assert "noise of 10 %" in found.reason  # of one channel: 1 / 16 over 0.6
    assert advice(replace(noisy, samples=4.0 * 256.0), "noise threshold").changes[0].value == pytest.approx(0.35 * difference, rel=0.05)


@pytest.mark.parametrize("change", [
    {"noise": Noise(1.0, 1.8, UNEVEN[1:])}, {"noise": None}, {"noise": Noise(0.0, 1.8, UNEVEN)}, {"noise": Noise(1.0, 0.0, UNEVEN)},
    {"samples": 1e6}, {"engine": "eevee"},
    {"settings": {**ADAPTIVE, "cycles.use_adaptive_sampling": False}}, {"settings": {**ADAPTIVE, "cycles.adaptive_threshold": 0.1}}])
def test_a_threshold_is_only_raised_and_only_by_what_was_measured(change):
    assert advice(replace(scene(settings=ADAPTIVE, samples=256.0, noise=Noise(1.0, 1.8, UNEVEN)), **change), "noise threshold") is None


def test_a_threshold_of_nothing_stands_for_the_engines_choice():
    """1 / 256 for 256 samples, 0.001 at least."""
    by_engine = scene(settings={**ADAPTIVE, "cycles.adaptive_threshold": 0.0}, samples=256.0)
    assert tuning.own_threshold(by_engine) == 1.0 / 256.0
    assert tuning.own_threshold(replace(by_engine, samples=4096.0)) == 0.001


def test_the_probe_of_a_sky_is_as_wide_as_it_needs():
    black = scene(engine="eevee", probe=("World", 1024))
    found = advice(black, "sky probe")
    assert found.changes == (tuning.Change("worlds", "World", "probe_resolution", "128"),) and found.bound == 0.0
    plain, smooth = replace(black, environment=2.0), replace(black, environment=2.0, sky_rate=2.0)
    for other, bound in ((plain, 0.006), (smooth, 0.01)):
        assert advice(other, "sky probe") is None  # within the usual 0.2 %
        assert advice(other, "sky probe", error=0.99 * bound) is None
        found = advice(other, "sky probe", error=bound)
        assert changes(found) == {("World", "probe_resolution"): "512"} and found.bound == bound
    for change in ({"sky_rate": 2.1}, {"environment": math.inf, "sky_rate": math.inf}, {"probe": None}, {"probe": ("World", 512)},
                   {"engine": "cycles"}):
        assert advice(replace(smooth, **change), "sky probe", error=0.1) is None


def test_no_shadows_of_a_sun_that_the_sky_does_not_have():
    dim = scene(engine="eevee", probe=("World", 1024), sky_shadows=True)
    found = advice(dim, "sky shadows")
    assert found.changes == (tuning.Change("worlds", "World", "use_sun_shadow", False),) and found.bound == 0.0
    assert advice(replace(dim, sky_shadows=False), "sky shadows") is None
    assert advice(replace(dim, engine="cycles"), "sky shadows") is None


START_UP = {"eevee.volumetric_tile_size": "8", "eevee.volumetric_samples": 64, "eevee.taa_render_samples": 64}


@pytest.mark.parametrize("width, height, tile, samples, slices", [
    (48, 27, "1", 8, 192),  # 82,944 froxels of 64 steps, below 2^18
    (160, 90, "2", 8, 192),  # of one pixel they would be 921,600, above it; 691,200 with 192 steps
    (320, 180, "2", 8, 128),  # 921,600 of 64 steps; twice as many are below 2^21
    (480, 270, "2", 8, 64),  # 2,073,600, just below it
    (960, 540, "4", 16, 64),
])
def test_froxels_are_finer_where_their_number_stays_small(width, height, tile, samples, slices):
    found = advice(scene(medium(half=4.0), engine="eevee", settings=START_UP, pixels=width * height, dithers=False), "froxels")
    expected = {("", "eevee.volumetric_tile_size"): tile, ("", "eevee.taa_render_samples"): samples}
    assert changes(found) == expected | ({("", "eevee.volumetric_samples"): slices} if slices != 64 else {})
    assert tuning.figures(found, "eevee").startswith("closer than before")


def test_froxels_stay_where_nothing_is_known_of_their_error():
    haze = medium(half=4.0)  # its diagonal is 13.9: 1 - exp(-0.05 x 13.9) = 0.5 of the light
    known = scene(haze, engine="eevee", settings=START_UP, pixels=480 * 270, dithers=False)
    air = Medium("World", "World", replace(HAZE, extinction=Range(0.001, 0.001)))  # 0.63 of the light over 1000 m
    assert advice(known, "froxels") and advice(replace(known, media=(air,)), "froxels")
    few = {**START_UP, "eevee.taa_render_samples": 8}
    for change in ({"dithers": True}, {"media": ()}, {"media": (medium(half=1.0),)}, {"pixels": 1280 * 720}, {"pixels": 1920 * 1080}, {"settings": few},
                   {"media": (medium("unknown", Substance()),)}, {"settings": {**START_UP, "eevee.volumetric_tile_size": "4"}},
                   {"engine": "cycles"}, {"media": (replace(air, substance=HAZE),), "view": None}):
        assert advice(replace(known, **change), "froxels") is None, change
    shown = advice(replace(known, viewport=500.0 * 800.0), "froxels")  # 6.4 million of 2 pixels, 1.6 million of 4
    assert changes(shown) == {("", "eevee.volumetric_tile_size"): "4", ("", "eevee.taa_render_samples"): 16}
    assert advice(replace(known, viewport=1500.0 * 900.0), "froxels") is None
    twelve = {**START_UP, "eevee.taa_render_samples": 12}
    assert changes(advice(replace(known, settings=twelve, pixels=48 * 27), "froxels"))["", "eevee.taa_render_samples"] == 8  # never fewer
    # where froxels take time an eighth of the samples pays for them
    assert advice(replace(known, settings={**twelve, "eevee.taa_render_samples": 63}), "froxels") is None


def test_a_pilot_tells_whether_large_pictures_may_have_finer_froxels():
    """By the noise that n samples have: 0.3 / sqrt(n), against three quarters of the squared error of the cells and the noise of 64."""
    haze, full_hd = medium(half=4.0), {"engine": "eevee", "settings": START_UP, "pixels": 1920 * 1080, "dithers": False}
    known = scene(haze, **full_hd, view=SEEN, cells=Cells(0.13, 0.3, 1.0, 8.0))
    found = advice(known, "froxels")  # 0.3^2 / 8 = 0.0113 < 0.75 x 0.13^2 + 0.3^2 / 64 = 0.0141
    assert changes(found) == {("", "eevee.volumetric_tile_size"): "4", ("", "eevee.taa_render_samples"): 8,
                              ("", "eevee.volumetric_samples"): 128, ("", "eevee.shadow_pool_size"): "1024"}
    noisier = advice(replace(known, cells=Cells(0.08, 0.3, 1.0, 4.0)), "froxels")  # 0.0113 > 0.0062 > 0.0056 of 16 samples
    assert changes(noisier)["", "eevee.taa_render_samples"] == 16
    for change in ({"cells": None}, {"cells": Cells(0.04, 0.3, 1.0, 1.0)}, {"cells": Cells(0.13, 0.3, 1.0, 8.1)}, {"viewport": 800.0 * 600.0}, {"pixels": 2560 * 1440},
                   {"view": replace(SEEN, moves=True)}, {"lamps": (replace(lamp("a"), moves=True),)}, {"dithers": True}):
        assert advice(replace(known, **change), "froxels") is None, change
    # where nothing has to be tried, a pilot changes nothing; else it may add steps where they are quick, and keeps edges their samples
    small, wide = replace(known, pixels=160 * 90), replace(known, pixels=480 * 270)
    plain = changes(advice(replace(wide, cells=None), "froxels"))
    assert changes(advice(small, "froxels")) == changes(advice(replace(small, cells=None), "froxels"))
    assert changes(advice(wide, "froxels")) == plain | {("", "eevee.volumetric_samples"): 192, ("", "eevee.shadow_pool_size"): "1024"}
    assert changes(advice(replace(wide, cells=Cells(0.13, 0.3, 1.0, 8.1)), "froxels")) == plain
    assert advice(replace(wide, cells=Cells(0.04, 0.3, 1.0, 1.0)), "froxels") is None


def test_settings_that_bring_nothing_are_switched_off():
    assert changes(advice(scene(medium()), "light tree")) == {("", "cycles.use_light_tree"): False}
    assert advice(scene(medium(), lamps=[lamp("a"), lamp("b")]), "light tree") is None
    assert advice(scene(medium(), environment=1.0, sky_rate=1.0), "light tree") is None
    assert advice(scene(medium(), environment=1.0, sky_rate=1.0, aimed_sky=False), "light tree")
    assert advice(scene(medium(), environment=1.0, sky_rate=1.0, world="World", touches=False), "light tree")  # after sky rays
    assert advice(scene(medium(), has_emitters=True), "light tree") is None
    guided = {"cycles.use_guiding": True, "cycles.volume_bounces": 0}
    assert changes(advice(scene(medium(), settings=guided), "guiding")) == {("", "cycles.use_guiding"): False}
    assert advice(scene(medium(), settings=guided, has_surfaces=True), "guiding") is None
    assert changes(advice(scene(frames=24), "persistent data")) == {("", "render.use_persistent_data"): True}
    assert advice(scene(), "persistent data") is None
    assert advice(scene(unused_passes=(("Layer", "use_pass_z"),), engine="eevee"), "passes").changes == (
        tuning.Change("view_layers", "Layer", "use_pass_z", False),)


def test_a_scene_that_needs_all_it_has_gets_no_advice():
    assert tuning.tune(scene(settings={"cycles.volume_bounces": 0, "cycles.use_light_tree": False})) == []


# --- lamps that no light path finds -----------------------------------------------------------------------------


def surveyed(counts, **changes):
    return scene(medium(), lamps=[lamp(name) for name in counts], survey=Survey(counts, 1000), **changes)


def test_lamps_that_no_test_finds_are_left_out_as_one_series():
    """Two lamps with a hundredth of the light each, none of 600 tests for the two together got through: 3 in 600 of 0.02."""
    found = advice(surveyed({"seen": (0.98, 12, 12), "a": (0.01, 300, 0), "b": (0.01, 300, 0)}), "unseen lamps")
    assert changes(found) == {("a", "hide_render"): True, ("b", "hide_render"): True}
    assert found.bound == pytest.approx(3.0 / 600.0 * 0.02 / 0.98)


def test_few_tests_are_no_proof():
    assert advice(surveyed({"seen": (0.9, 12, 12), "a": (0.1, 40, 0)}), "unseen lamps", 0.05) is None
    assert advice(surveyed({"seen": (0.9, 12, 12), "a": (0.1, 60, 0)}), "unseen lamps") is None


def test_lamps_that_some_tests_find_are_counted():
    """Of 10000 tests 4 got through: at most 4 + 3 + 2 x 2 = 11."""
    found = advice(surveyed({"seen": (0.9, 12, 12), "a": (0.1, 10000, 4)}), "unseen lamps")
    assert found.bound == pytest.approx(11.0 / 10000.0 * 0.1 / (0.9 + 4.0 / 10000.0 * 0.1))


def test_dim_lamps_are_left_out_by_their_unshaded_light():
    found = advice(surveyed({"seen": (1.0, 12, 12), "dim": (1e-4, 12, 12), "away": (0.0, 0, 0)}), "unseen lamps")
    assert changes(found) == {("dim", "hide_render"): True, ("away", "hide_render"): True}
    assert found.bound == pytest.approx(1e-4 / 1.0001)


def test_a_lamp_is_always_left_and_none_where_nothing_is_lit():
    assert advice(surveyed({"a": (1.0, 12, 12)}), "unseen lamps") is None
    assert advice(surveyed({"a": (1.0, 6000, 0), "b": (1.0, 6000, 0)}), "unseen lamps") is None
    assert advice(scene(medium(), survey=Survey({"lamp": (0.0, 0, 0)}, 0)), "unseen lamps") is None


def test_media_that_no_path_meets_are_left_out_together():
    hidden, seen = medium("hidden", CLOUD), medium("seen", CLOUD)
    counts = {"hidden": (8000, 0), "seen": (8000, 1)}
    found = advice(scene(hidden, seen, survey=Survey({}, 100, counts)), "unseen media")
    assert changes(found) == {("hidden", "hide_render"): True} and found.bound == pytest.approx(3.0 / 8000.0)
    both = advice(scene(hidden, seen, survey=Survey({}, 100, {"hidden": (8000, 0), "seen": (8000, 0)})), "unseen media")
    assert len(both.changes) == 2 and both.bound == pytest.approx(3.0 / 8000.0)  # the same paths
    assert advice(scene(hidden, survey=Survey({}, 100, {"hidden": (800, 0)})), "unseen media") is None
    assert advice(scene(hidden, lamps=[lamp(moves=True)], survey=Survey({}, 100, counts)), "unseen media") is None


@given(st.integers(0, 2000))
def test_the_bound_of_a_count_is_not_below_the_exact_one(count):
    """Garwood's upper limit of a Poisson mean: half the 95 % quantile of chi-square with 2 k + 2 degrees of freedom."""
    assert tuning.at_most(count) >= stats.chi2.ppf(0.95, 2 * count + 2) / 2.0
