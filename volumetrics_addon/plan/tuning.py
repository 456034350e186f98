# SPDX-License-Identifier: GPL-3.0-or-later
"""What a user's own scene does not need: rules that change engine settings and which lamp lights which medium, never materials.

Plain data in, plain data out. Each rule looks at the scene alone and never raises what it finds: the picture is the one that the
scene's own settings converge to, within the error target.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Collection, Iterator, Sequence
from dataclasses import dataclass, replace
from typing import Any

from . import visibility
from .catalogue import RULES, TARGET, Rule
from .model import BLACK_PROBE, EEVEE
from .observed import Cells, Lamp, Medium, Observed

# Ray marching is jittered: with a step of optical depth d at most, one random offset for a whole ray makes a transmittance too
# large by d^2 / 24, the variance of a uniform offset in the exponent. Voxels by measurement, see rules.THICKEST_STEP.
MARCHED_BIAS, VOXEL_BIAS = 1.0 / 24.0, 0.017
FEATURE_STEP = 0.3  # of a feature, at most
MOST_STEPS = 2048  # of a ray, twice what the engine follows by default; a medium that needs more stays as it is
FEWEST_TEXELS, MOST_TEXELS = 64, 256  # of the map of a sky, across; the engine's own choice has 1024 or more
SERIES = 50  # tests of a lamp, below which they do not count with those of others
# Steps whose processor time the octree of an object takes, before each picture: 46 to 390 million, measured on six scenes, and a third
# of that where null scattering then has a third of the variance. Of the steps across a domain's diagonal the ray of the camera takes
# half on average, and that to a lamp as many.
OCTREE = 40.0 * 128.0**3
THINNEST, DEEPEST = 1e-4, 4.0  # optical depths: of what is left out, and of what is sampled by its lamps
MOST_FORWARD = 0.9  # mean cosine of a medium in which aimed rays alone find a lamp
# EEVEE's froxels: cells of the screen, times the steps along the view. No picture gets more than the start-up file has in full HD: with
# four times as many lamps were lost there. FINER: the most where they are so many times finer; an eighth as wide they cost nothing
# beside what each sample has to do anyway, a quarter and a half a part of what fewer samples save.
MOST_FROXELS = 1 << 21
FINER = {8: 1 << 18, 4: MOST_FROXELS, 2: MOST_FROXELS}
PILOTED_FROXELS, LARGEST_POOL = 1 << 24, "1024"  # where a pilot has all its shadows in the largest pool; 40 bytes of memory for each
COARSE = 8  # pixels, of the start-up file's cells: what narrower ones are off is not much above the noise of few samples
FEWER = {8: 8, 4: 8, 2: 4}  # and by what the samples are then divided, at least where the froxels of each cost more than next to nothing
# Times as many steps along the view: with 64 the mean of the picture is up to 1.7 % off, with 192 it is within 0.2 % of that with 256,
# the most that EEVEE takes. They need no more shadows, but on a processor above so many froxels as long as fewer samples save.
DEEPER, DEEP_FROXELS = (3, 2), {8: MOST_FROXELS, 4: MOST_FROXELS, 2: 0}
FEWEST_SAMPLES, MOST_SLICES = 8, 192
LEFT_ERROR = 0.5  # of the error of a scene's cells, in cells half as wide
# Width of EEVEE's map of the world's light, and by how much of the world's light the picture then changes: none where it is black; 95 %
# of the colours of a world of one, which are rounded to 11-bit floats in each map; and of a sky that changes as fast as is allowed.
BLACK, PLAIN, SMOOTH = (BLACK_PROBE, 0.0), (512, 0.006), (512, 0.01)
# Cycles is done with a pixel where the picture of half of its samples differs from that of all by less than the threshold: the sum of
# the channels' differences over the root of their brightness. The difference has the variance of the picture itself, hence the mean
# of a normal variable's amount. QUIETER: by how much less than the whole picture a pixel is then noisy; its square is what the
# picture's variance may grow by. QUIET: the least share of the picture that has to be so.
DIFFERENCE = 3.0 * math.sqrt(2.0 / math.pi)
QUIETER, QUIET = 0.7, 0.3
SEEN = 0.3  # share of the light that a medium takes at most, from which on its cells are more of the error than edges are


@dataclass(frozen=True)
class Change:
    """A property to set: the collection of Blender's data, the name in it, the path below, and the value.

    The path ``excludes`` of an object that is a lamp holds the names of the objects that it no longer lights.
    """

    owner: str
    name: str
    path: str
    value: Any

    def __str__(self) -> str:
        name = f"{self.owner.rstrip('s')} {self.name}: " if self.name else ""
        if self.path == "excludes":
            return f"{name}lights all but {_listed(self.value)}"
        return f"{name}{self.path} = {self.value:g}" if isinstance(self.value, float) else f"{name}{self.path} = {self.value}"


@dataclass(frozen=True)
class Advice:
    """A rule that applies to the scene: what to change, why, and the bound on the picture's relative error."""

    rule: Rule
    changes: tuple[Change, ...]
    reason: str
    bound: float = 0.0


def tune(scene: Observed, error: float = TARGET, without: Collection[str] = ()) -> list[Advice]:
    """The advice for the scene; together it changes the picture by at most the relative ``error``.

    ``without`` names rules that are switched off. Raises ValueError for a name that no rule has and for an error that is not
    above 0.
    """
    if not 0.0 < error < math.inf:
        raise ValueError(f"error must be above 0, got {error:g}; give a relative error such as {TARGET:g}")
    for name in without:
        if name not in RULES:
            raise ValueError(f"there is no rule {name!r}; the rules are {', '.join(RULES)}")
    found: list[Advice] = []
    other = "ray marching" if is_marched(scene) else "longer steps"  # what cannot apply leaves its share to the rest
    rules = [rule for name, rule in RULES.items() if name not in without and name != other and scene.engine in rule.engines]
    for index, rule in enumerate(rules):
        left = error - sum(entry.bound for entry in found)
        shares = sum(later.share for later in rules[index:])
        changes = _FINDERS[rule.name](scene, left * rule.share / shares if rule.share else 0.0)
        if changes is not None:
            found.append(Advice(rule, *changes))
            scene = _after(scene, found[-1])
    return found


Found = tuple[tuple[Change, ...], str, float] | None


def effect(advice: Advice) -> str:
    """What an advice does to the picture, in a few words."""
    if advice.bound:
        return f"changes {100.0 * advice.bound:.2g} % at most"
    return advice.rule.effect


def figures(advice: Advice, engine: str) -> str:
    """The effect and the measured gain of an advice, in a few words."""
    gain = advice.rule.gain.get(engine)
    return effect(advice) + (f", {gain:g} x as fast on {advice.rule.shown_by}" if gain else "")


def _after(scene: Observed, advice: Advice) -> Observed:
    """The scene without what is left out, and with the map of its sky decided on: neither counts for the rules that follow."""
    for change in advice.changes:
        if change.path == "cycles.sampling_method":
            return replace(scene, world="", aimed_sky=change.value != "NONE")
    gone = {change.name for change in advice.changes if change.path == "hide_render"}
    if not gone:
        return scene
    return replace(scene, media=tuple(medium for medium in scene.media if medium.name not in gone),
                   lamps=tuple(lamp for lamp in scene.lamps if lamp.name not in gone))


def _listed(names: Sequence[str]) -> str:
    shown = ", ".join(names[:3])
    return shown if len(names) <= 3 else f"{shown} and {len(names) - 3} more"


# --- what is known of a medium -----------------------------------------------------------------------------------


def optical_depth(medium: Medium) -> float:
    """Bound on the optical depth of the longest way through the medium."""
    thickest = medium.substance.extinction.high
    if thickest == 0.0:
        return 0.0
    return thickest * visibility.diagonal(medium.corners) if medium.corners else math.inf


def is_marched(scene: Observed) -> bool:
    """Whether rays march through textured media as the scene is set."""
    return not scene.null_scattering or bool(scene.settings.get("cycles.volume_biased"))


def taken(medium: Medium) -> float:
    """Bound on the share of light that the medium scatters or absorbs on its way through."""
    return -math.expm1(-optical_depth(medium))


# --- the rules ---------------------------------------------------------------------------------------------------


def _thin(scene: Observed, allowed: float) -> Found:
    """Hidden where it neither dims nor shines: depth tau dims by tau at most, and scatters tau times pi times the peak of its
    phase function (1 + g) / (4 pi (1 - g)^2) of what a white surface sends back."""
    names, total = [], 0.0
    for medium in scene.media:
        substance, depth = medium.substance, optical_depth(medium)
        if not medium.editable or medium.has_surface or medium.moves or substance.emits or not medium.corners or depth > THINNEST:
            continue
        peak = 0.25 * (1.0 + substance.g) / max(1.0 - substance.g, 1e-3) ** 2 if depth else 0.0
        bound = depth * max(1.0, peak)
        if total + bound <= allowed:
            names.append(medium.name)
            total += bound
    if not names:
        return None
    return _hidden(names), f"{_listed(names)}: optical depth {'0' if total == 0.0 else f'below {THINNEST:g}'}", total


def _hidden(names: Sequence[str]) -> tuple[Change, ...]:
    return tuple(Change("objects", name, "hide_render", True) for name in names)


def _unseen(scene: Observed, allowed: float) -> Found:
    """Those that hulls part from the picture, and those that no traced path has met: of n paths 3 / n at most would, all together."""
    parted = _parted(scene, allowed)
    names, total = ([change.name for change in parted[0]], parted[2]) if parted else ([], 0.0)
    met = scene.survey.media if scene.survey and not any(lamp.moves for lamp in scene.lamps) else {}
    left = {medium.name for medium in scene.media} - set(names)
    unmet = [name for name, (paths, count) in met.items() if count == 0 and name in left]
    if unmet and total + at_most(0) / met[unmet[0]][0] <= allowed:
        total += at_most(0) / met[unmet[0]][0]
        names += unmet
    return (_hidden(names), f"{_listed(names)}: outside the picture, and in the way of no light to it", total) if names else None


def _parted(scene: Observed, allowed: float) -> Found:
    view = scene.view
    if view is None or view.moves or scene.has_instances:
        return None
    depth = min((visibility.filled_depth(view, face) for face in scene.faces), default=math.inf)
    lamps = [lamp for lamp in scene.lamps if lamp.power > 0.0]
    names, total = [], 0.0
    seen: list[tuple] | None = None
    for medium in scene.media:
        corners = medium.corners
        if not corners or not medium.editable or medium.moves or medium.has_surface or medium.substance.emits:
            continue
        if _in_picture(scene, corners, depth):
            continue
        if seen is None:  # what is in the picture, as few hulls: found once, and only when a medium is not
            seen = _seen(scene, depth)
        if seen is None:
            return None
        bound = 0.0
        for hulls in seen:
            away = max(visibility.distance(corners, hull) for hull in hulls)
            bound = max(bound, taken(medium) * visibility.solid_angle_share(corners, away))
            if bound > allowed or any(all(_may_shade(lamp, medium, hull, scene) for hull in hulls) for lamp in lamps):
                bound = math.inf
                break
        if total + bound <= allowed:
            names.append(medium.name)
            total += bound
    if not names:
        return None
    return _hidden(names), "", total


def _in_picture(scene: Observed, corners: Sequence, depth: float) -> bool:
    outside = bool(scene.room) and visibility.apart(corners, scene.room)
    return not outside and visibility.in_frame(scene.view, corners, depth)


def _seen(scene: Observed, depth: float) -> list[tuple] | None:
    """Hulls that hold what is in the picture: of all solids together, and of each medium. None where something mirrors the rest."""
    view, result = scene.view, []
    if scene.solids is not None:
        if scene.solids.moves or scene.solids.reflects:
            return None
        if scene.solids.corners:
            result.append(visibility.cut(view, scene.solids.corners, depth))
    for medium in scene.media:
        if not medium.corners:  # a world's is wherever the camera looks
            result.append((visibility.pyramid(view, 0.0, min(depth, view.clip_end)),))
        elif _in_picture(scene, medium.corners, depth):
            result.append(visibility.cut(view, medium.corners, depth))
    return [(*hulls, scene.room) for hulls in result] if scene.room else result


def _may_shade(lamp: Lamp, medium: Medium, hull: Sequence, scene: Observed) -> bool:
    """Whether the medium may be between the lamp and the hull."""
    if lamp.moves:
        return True
    if lamp.kind == "SUN":
        low, high = visibility.bounds([*hull, *medium.corners])
        far = visibility.FAR * math.dist(low, high)
        source = [tuple(p - far * d for p, d in zip(point, lamp.direction)) for point in hull]
        if lamp.radius > 0.0:  # half its angle, in radians: the rays fan out
            spread = far * math.tan(min(lamp.radius, 1.5))
            source = [tuple(p + s * spread for p, s in zip(point, signs))
                      for point in source for signs in visibility.corners((-1.0,) * 3, (1.0,) * 3)]
    else:
        source = visibility.corners(*(tuple(p + sign * lamp.radius for p in lamp.position) for sign in (-1.0, 1.0)))
        if scene.room and visibility.apart(source, scene.room):
            return False  # its light stays outside
    return not visibility.apart(medium.corners, [*hull, *source])


def _bounces(scene: Observed, allowed: float) -> Found:
    present = scene.settings.get("cycles.volume_bounces", 0)
    if present == 0 or not scene.media or scene.has_instances:
        return None
    depth = sum(optical_depth(medium) for medium in scene.media)
    share = max(medium.substance.albedo for medium in scene.media) * -math.expm1(-depth)
    if share >= 1.0:
        return None
    needed = max(0, math.ceil(math.log(allowed) / math.log(share) - 1.0)) if share > 0.0 else 0
    if needed >= present:
        return None
    return ((Change("scenes", "", "cycles.volume_bounces", needed),),
            f"{needed} instead of {present}: of the light, {share:.2g} at most is scattered in each event", share ** (needed + 1))


def _sampling(scene: Observed, allowed: float) -> Found:
    """A material is sampled in one way; a world's medium stays as it is, by the lamps."""
    if scene.has_instances or scene.has_emitters or not scene.lamps:
        return None
    wanted: dict[str, set[str]] = {}
    for medium in scene.media:
        wanted.setdefault(medium.material, set()).add(_samples(scene.lamps, medium))
    chosen = {(medium.material, way) for medium in scene.media for way in wanted[medium.material]
              if medium.corners and medium.editable and len(wanted[medium.material]) == 1 and way not in ("", medium.sampling)}
    if not chosen:
        return None
    reasons = {"EQUIANGULAR": "lamps at points, and media that are not deep: samples where the lamps are near",
               "DISTANCE": "a sun, and lamps that are far: samples by distance alone"}
    return (tuple(Change("materials", material, "cycles.volume_sampling", way) for material, way in sorted(chosen)),
            "; ".join(reason for way, reason in reasons.items() if way in {way for _, way in chosen}), 0.0)


def _samples(lamps: Sequence[Lamp], medium: Medium) -> str:
    """How light that comes straight from the lamps is best sampled in the medium; nothing where that is not known. What lies deep in a
    medium is not where a lamp is near, and no place in it is near to a lamp that is far."""
    kinds = {lamp.kind for lamp in lamps}
    if kinds <= {"POINT", "SPOT"}:
        return "" if medium.substance.textured or optical_depth(medium) > DEEPEST else "EQUIANGULAR"
    if "SUN" not in kinds or not kinds <= {"SUN", "POINT", "AREA"} or len(kinds) == 1 or not medium.corners:
        return ""
    far = 0.5 * visibility.diagonal(medium.corners)
    away = (visibility.box_distance(medium.corners, lamp.position)[0] - lamp.radius for lamp in lamps if lamp.kind != "SUN")
    return "DISTANCE" if not any(lamp.moves for lamp in lamps) and min(away) >= far else ""


def _step(medium: Medium, allowed: float) -> float:
    """The longest step (m) of ray marching whose bias is allowed; 0 where nothing is known."""
    substance = medium.substance
    thickest = substance.extinction.high
    if not substance.textured or not math.isfinite(thickest) or substance.feature <= 0.0 or not medium.corners:
        return 0.0
    deepest = allowed / VOXEL_BIAS if medium.voxels else math.sqrt(allowed / MARCHED_BIAS)
    step = FEATURE_STEP * substance.feature
    return min(step, deepest / thickest) if thickest > 0.0 else step


def _marched_bias(medium: Medium, step: float) -> float:
    depth = medium.substance.extinction.high * step
    return VOXEL_BIAS * depth if medium.voxels else MARCHED_BIAS * depth * depth


def _marching(scene: Observed, allowed: float) -> Found:
    """All textured media together, or none: the scene has one switch. Rates are those of materials, the scene's own is 1."""
    if scene.has_instances:
        return None
    textured = [medium for medium in scene.media if medium.substance.textured]
    steps = [_step(medium, allowed / len(textured)) for medium in textured]
    if not textured or min(steps) == 0.0 or any(medium.shared or not medium.editable or medium.step <= 0.0 for medium in textured):
        return None
    counts = [visibility.diagonal(medium.corners) / step for medium, step in zip(textured, steps)]
    longest = max(counts)
    if longest > MOST_STEPS or scene.paths * sum(counts) > OCTREE * len(textured):
        return None
    changes = [Change("scenes", "", "cycles.volume_biased", True)]
    if scene.settings.get("cycles.volume_step_rate", 1.0) != 1.0:
        changes.append(Change("scenes", "", "cycles.volume_step_rate", 1.0))
    if longest > scene.settings.get("cycles.volume_max_steps", MOST_STEPS):
        changes.append(Change("scenes", "", "cycles.volume_max_steps", math.ceil(longest)))
    changes += _rates(textured, steps)
    return tuple(changes), f"{_listed([m.name for m in textured])}: steps of {min(steps):.3g}, at most {longest:.0f} of them", \
        sum(_marched_bias(medium, step) for medium, step in zip(textured, steps))


def _rates(media: Sequence[Medium], steps: Sequence[float]) -> Iterator[Change]:
    """Of each material the rate that all of its media are content with."""
    rates: dict[str, float] = {}
    for medium, step in zip(media, steps):
        rate = max(1e-3, step / medium.step)
        rates[medium.material] = min(rate, rates.get(medium.material, rate))
    for material, rate in rates.items():
        yield Change("materials", material, "cycles.volume_step_rate", rate)


def _longer(scene: Observed, allowed: float) -> Found:
    """Where media are marched anyway: their own rate, raised to what the density needs."""
    if scene.has_instances:
        return None
    overall = scene.settings.get("cycles.volume_step_rate", 1.0)
    textured = [medium for medium in scene.media if medium.substance.textured and medium.step > 0.0]
    chosen, steps, bound = [], [], 0.0
    for medium in textured:
        step = _step(medium, allowed / len(textured))
        if step > 1.05 * medium.step * medium.step_rate * overall and medium.editable and not medium.shared:
            chosen.append(medium)
            steps.append(step / overall)
            bound += _marched_bias(medium, step)
    if not chosen:
        return None
    return tuple(_rates(chosen, steps)), f"{_listed([m.name for m in chosen])}: steps of {min(steps) * overall:.3g}", bound


def _irradiance(lamp: Lamp, medium: Medium) -> tuple[float, float]:
    """Bounds of the lamp's unshaded irradiance in the medium: least (of lamps that shine all over it) and largest."""
    if not math.isfinite(lamp.power):
        return 0.0, math.inf
    if lamp.kind == "SUN":
        return lamp.power, lamp.power
    nearest, farthest = visibility.box_distance(medium.corners, lamp.position)
    if lamp.kind == "SPOT" and not _meets_cone(lamp, medium):
        return 0.0, 0.0
    nearest = max(nearest - lamp.radius, 0.0)
    peak = lamp.power / math.pi if lamp.kind == "AREA" else lamp.power / (4.0 * math.pi)
    largest = math.inf if nearest == 0.0 else peak / nearest**2
    everywhere = lamp.kind == "POINT"
    return (lamp.power / (4.0 * math.pi) / (farthest + lamp.radius) ** 2 if everywhere else 0.0), largest


def _meets_cone(lamp: Lamp, medium: Medium) -> bool:
    """Whether some of the medium may be in the spot's cone: not where a plane through its tip parts the two."""
    if lamp.cone >= math.pi:
        return True
    low, high = visibility.bounds(medium.corners)
    middle = tuple(0.5 * (l + h) for l, h in zip(low, high))
    radius = 0.5 * math.dist(low, high) + lamp.radius / max(math.sin(0.5 * lamp.cone), 1e-3)
    way = tuple(m - p for m, p in zip(middle, lamp.position))
    away = math.hypot(*way)
    if away <= radius:
        return True
    angle = math.acos(max(-1.0, min(1.0, visibility.dot(way, lamp.direction) / away)))
    return angle - math.asin(radius / away) <= 0.5 * lamp.cone


def at_most(count: int) -> float:
    """Upper bound, with 95 % confidence and more, on the mean of a Poisson count: 3 where nothing was counted."""
    return count + 3.0 + 2.0 * math.sqrt(count)


def _unseen_lamps(scene: Observed, allowed: float) -> Found:
    """First the dimmest, by their unshaded light and a third of the target at most, then those that few tests or none have found.

    Tests of several lamps, drawn in proportion to their light, count as one series: with k of M that get through, all of these lamps
    give at most ``at_most(k)`` / M of their light.
    """
    survey = scene.survey
    if survey is None or not survey.places or not survey.lamps:
        return None
    free = {lamp.name for lamp in scene.lamps if lamp.editable and not lamp.moves}
    total = sum(light * through / tests for light, tests, through in survey.lamps.values() if tests)
    if total <= 0.0:
        return None
    chosen: list[str] = []
    bound = 0.0
    for light, name in sorted((survey.lamps[name][0], name) for name in free):
        if bound + light / total > allowed / 3.0:
            break
        bound += light / total  # unshaded light bounds what a lamp gives
        chosen.append(name)
    heaviest, counted, dim = 0.0, 0, bound  # light for which a test stands, and tests that got through
    for name in sorted(free - set(chosen), key=lambda name: (survey.lamps[name][2], survey.lamps[name][0])):
        light, tests, through = survey.lamps[name]
        if tests < SERIES:
            continue
        together = dim + max(heaviest, light / tests) * at_most(counted + through) / total
        if together <= allowed:
            chosen.append(name)
            heaviest, counted, bound = max(heaviest, light / tests), counted + through, together
    if not chosen or len(chosen) == len(scene.lamps):
        return None
    return _hidden(chosen), f"{len(chosen)} of {len(scene.lamps)} lamps give the picture nothing, or next to nothing: {_listed(chosen)}", bound


def _idle(scene: Observed, allowed: float) -> Found:
    if scene.has_instances or len(scene.lamps) < 2:
        return None
    excluded: dict[str, list[str]] = {}
    total = 0.0
    for medium in scene.media:
        if not medium.corners or medium.moves or not medium.editable:
            continue
        contrast = ((1.0 + medium.substance.g) / max(1.0 - medium.substance.g, 1e-3)) ** 3
        reach = {lamp.name: _irradiance(lamp, medium) for lamp in scene.lamps if not lamp.moves}
        least = sum(low for low, _ in reach.values()) + (math.pi * scene.environment if scene.sky_rate == 0.0 else 0.0)
        dropped = 0.0
        for lamp in sorted(scene.lamps, key=lambda lamp: reach.get(lamp.name, (0.0, math.inf))[1]):
            if lamp.moves or lamp.is_linked or not lamp.editable or lamp.volume_factor == 0.0:
                continue
            low, high = reach[lamp.name]
            least -= low  # what is dropped lights nothing
            bound = (dropped + high) * contrast / least if least > 0.0 else (0.0 if dropped + high == 0.0 else math.inf)
            if bound > allowed:
                break
            dropped += high
            excluded.setdefault(lamp.name, []).append(medium.name)
            total = max(total, bound)
    if not excluded:
        return None
    names = list(excluded)
    if scene.engine == EEVEE:
        # A lamp of EEVEE lights all media or none.
        inside = {medium.name for medium in scene.media}
        names = [name for name in names if inside == set(excluded[name])]
        changes = tuple(Change("lights", name, "volume_factor", 0.0) for name in names)
    else:
        changes = tuple(Change("objects", name, "excludes", tuple(excluded[name])) for name in names)
    return (changes, f"{len(names)} of {len(scene.lamps)} lamps: {_listed(names)}", total) if names else None


def _light_tree(scene: Observed, allowed: float) -> Found:
    several = len(scene.lamps) > 1 or scene.sky_rate > 0.0 and scene.aimed_sky or scene.has_emitters or scene.has_instances
    if several or not scene.settings.get("cycles.use_light_tree"):
        return None
    return (Change("scenes", "", "cycles.use_light_tree", False),), f"{len(scene.lamps)} lamp(s), and a world that no ray is aimed at", 0.0


def _lamp_hits(scene: Observed, allowed: float) -> Found:
    """A ray that is aimed at a lamp and one that hits it by chance share its light by their densities (multiple importance sampling).
    Beside a lamp that is seldom chosen among several the second has a share of what is then very bright; aimed rays carry all of it
    where no surface sends light one way alone."""
    if not scene.media or len(scene.lamps) < 2 or scene.mirrors or scene.has_instances or any(
            medium.substance.g > MOST_FORWARD for medium in scene.media):
        return None
    names = [lamp.name for lamp in scene.lamps if lamp.is_hit and lamp.editable and lamp.kind in ("POINT", "SPOT") and lamp.radius > 0.0]
    if not names:
        return None
    return (tuple(Change("lights", name, "cycles.use_multiple_importance_sampling", False) for name in names),
            f"{len(names)} lamp(s) that aimed rays find: {_listed(names)}", 0.0)


def _sky_rays(scene: Observed, allowed: float) -> Found:
    """A sky this smooth has a bright part of half a steradian or more, which scattered rays find as they are."""
    if not 0.0 < scene.sky_rate <= scene.environment < math.inf or not scene.world or scene.touches:
        return None
    return (Change("worlds", scene.world, "cycles.sampling_method", "NONE"),), \
        f"over a radian the sky changes by {scene.sky_rate / scene.environment:.2g} of its brightest at most", 0.0


def _sky_map(scene: Observed, allowed: float) -> Found:
    """A map of n rows has steps of pi / n: a tenth of the brightest is the most that may change over one."""
    if not 0.0 < scene.sky_rate < math.inf or not math.isfinite(scene.environment) or not scene.world:
        return None
    rows = 10.0 * math.pi * scene.sky_rate / scene.environment
    size = max(FEWEST_TEXELS, 2 ** math.ceil(math.log2(2.0 * rows)))
    if size > MOST_TEXELS:
        return None
    return ((Change("worlds", scene.world, "cycles.sampling_method", "MANUAL"),
             Change("worlds", scene.world, "cycles.sample_map_resolution", size)), f"{size} texels around the horizon are enough", 0.0)


def _sky_probe(scene: Observed, allowed: float) -> Found:
    if scene.probe is None or not scene.sky_rate <= scene.environment < math.inf:
        return None
    width, bound = BLACK if scene.environment == 0.0 else PLAIN if scene.sky_rate == 0.0 else SMOOTH
    world, present = scene.probe
    if present <= width or bound > allowed:
        return None
    return (Change("worlds", world, "probe_resolution", str(width)),), f"{width} instead of {present} pixels across", bound


def _sky_shadows(scene: Observed, allowed: float) -> Found:
    if not scene.sky_shadows:
        return None
    return (Change("worlds", scene.probe[0], "use_sun_shadow", False),), "EEVEE finds no sun in the world", 0.0


def _threshold(scene: Observed, allowed: float) -> Found:
    """Pixels that have less noise than the picture will have take no more samples: a threshold by the noise that a pilot measured."""
    noise = scene.noise
    if noise is None or noise.variance <= 0.0 or noise.brightness <= 0.0 or not scene.settings.get("cycles.use_adaptive_sampling"):
        return None
    deviation = math.sqrt(noise.variance / scene.samples)
    threshold = float(f"{QUIETER * DIFFERENCE * deviation / math.sqrt(noise.brightness):.2g}")
    done = sum(DIFFERENCE * math.sqrt(piece / scene.samples) < threshold for piece in noise.pieces)
    if threshold < 1.05 * own_threshold(scene) or done < QUIET * len(noise.pieces):
        return None
    relative = 3.0 * deviation / noise.brightness  # of a channel
    return ((Change("scenes", "", "cycles.adaptive_threshold", threshold),),
            f"{scene.samples:.0f} samples leave a noise of {100.0 * relative:.2g} %: pixels with {QUIETER:g} of it are done", 0.0)


def own_threshold(scene: Observed) -> float:
    """The noise threshold of adaptive sampling as the scene has it; 0 stands for the engine's choice by the samples."""
    return scene.settings.get("cycles.adaptive_threshold", 0.0) or max(1e-3, 1.0 / max(scene.samples, 1.0))


def _guiding(scene: Observed, allowed: float) -> Found:
    if not scene.settings.get("cycles.use_guiding") or scene.settings.get("cycles.volume_bounces") or scene.has_surfaces:
        return None
    return (Change("scenes", "", "cycles.use_guiding", False),), "light is scattered once, straight from the lamps", 0.0


def _froxels(scene: Observed, allowed: float) -> Found:
    """EEVEE's error of a medium falls with the width of its cells, and not with samples; these are for edges, shadows and the noise
    inside the cells, and an eighth of the start-up file's 64 has less of it than its cells are off."""
    tile, slices, samples = (int(scene.settings.get(f"eevee.{name}", 0)) for name in (
        "volumetric_tile_size", "volumetric_samples", "taa_render_samples"))
    if tile < COARSE or scene.dithers or not any(_shows(scene, medium) for medium in scene.media):
        return None
    finer, deeper = _cells(scene, tile, slices)
    left = max(FEWEST_SAMPLES, samples // FEWER.get(finer, 1))
    piloted = _piloted(scene, tile, slices, finer) if deeper == 1 else None
    if piloted:
        left = FEWEST_SAMPLES
        while left < samples and not _is_closer(scene.cells, left, samples):
            left *= 2
        if left * FEWER[2] > samples:
            return None
        if left * scene.cells.finer_seconds > samples * scene.cells.own_seconds:
            piloted = None
    if piloted:
        finer, deeper = piloted
    elif not finer or left >= samples or finer < max(FEWER) and left * FEWER[finer] > samples:
        return None
    wanted: dict[str, Any] = {"volumetric_tile_size": str(tile // finer), "taa_render_samples": left}
    if deeper > 1:
        wanted["volumetric_samples"] = deeper * slices
    if piloted:
        wanted["shadow_pool_size"] = LARGEST_POOL
    return (tuple(Change("scenes", "", f"eevee.{name}", value) for name, value in wanted.items()),
            f"cells {tile // finer} instead of {tile} pixels wide, and {left} instead of {samples} samples", 0.0)


def _is_closer(cells: Cells, left: int, samples: int) -> bool:
    """Whether finer cells with ``left`` samples have no more error and noise than a scene's own with its own."""
    return cells.noise**2 / left <= (1.0 - LEFT_ERROR**2) * cells.error**2 + cells.noise**2 / samples


def _cells(scene: Observed, tile: int, slices: int) -> tuple[int, int]:
    """How many times finer, 0 where they stay, and how many times more steps."""
    froxels, shown = (pixels * slices / tile**2 for pixels in (scene.pixels, scene.viewport))
    finer = next((times for times, most in FINER.items() if tile % times == 0 and froxels * times**2 <= most
                  and shown * times**2 <= MOST_FROXELS), 0)
    return finer, next((times for times in DEEPER if finer and times * slices <= MOST_SLICES
                        and times * froxels * finer**2 <= DEEP_FROXELS[finer]), 1)


def _piloted(scene: Observed, tile: int, slices: int, finer: int) -> tuple[int, int] | None:
    """The same of cells that a pilot has tried: half as wide where they were not finer, and more steps."""
    still = scene.view is not None and not scene.view.moves and not any(lamp.moves for lamp in scene.lamps)
    if not scene.cells or not still or scene.viewport:
        return None
    finer = finer or 2
    steps = next((times for times in DEEPER if times * slices <= MOST_SLICES
                  and times * scene.pixels * slices / tile**2 * finer**2 <= PILOTED_FROXELS), 0)
    return (finer, steps) if steps else None


def _shows(scene: Observed, medium: Medium) -> bool:
    """Whether the medium is thick enough to be seen, as far as it is known."""
    thickest = medium.substance.extinction.high
    reach = visibility.diagonal(medium.corners) if medium.corners else scene.view.clip_end if scene.view else 0.0
    return math.isfinite(thickest) and -math.expm1(-thickest * reach) >= SEEN


def _passes(scene: Observed, allowed: float) -> Found:
    if not scene.unused_passes:
        return None
    changes = tuple(Change("view_layers", layer, path, False) for layer, path in scene.unused_passes)
    return changes, f"{len(changes)} pass{'' if len(changes) == 1 else 'es'} that nothing reads", 0.0


def _persistent(scene: Observed, allowed: float) -> Found:
    if scene.frames < 2 or scene.settings.get("render.use_persistent_data"):
        return None
    return (Change("scenes", "", "render.use_persistent_data", True),), f"{scene.frames} frames", 0.0


_FINDERS: dict[str, Callable[[Observed, float], Found]] = {
    "bounces": _bounces, "sampling": _sampling, "ray marching": _marching, "longer steps": _longer, "unseen media": _unseen,
    "thin media": _thin, "unseen lamps": _unseen_lamps, "idle lamps": _idle, "light tree": _light_tree,
    "lamp hits": _lamp_hits, "sky rays": _sky_rays, "sky map": _sky_map, "guiding": _guiding,
    "sky probe": _sky_probe, "sky shadows": _sky_shadows, "noise threshold": _threshold, "froxels": _froxels, "passes": _passes,
    "persistent data": _persistent,
}
