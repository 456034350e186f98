# SPDX-License-Identifier: GPL-3.0-or-later
"""The error of an engine over the range of every parameter, one at a time, around a base preset of each family.

    python scripts/sweep_parameters.py [FAMILY ...] [--engine cycles|eevee] [--only NAME,NAME] [--limit MINUTES]
    python scripts/sweep_parameters.py --plot [--out docs/sweeps]

A number takes five values around its base, within the range of its slider; a choice takes all of them. Where the declaration
says that a parameter has no effect beside the base's values, the parameter that enables it is set as well. Each picture is
compared with the reference; samples grow until the 95 % interval of the mean error is narrow, or the time of a value is spent.
Results go to FAMILY.json, a line a parameter, and are not measured again; a value that raises leaves its message. ``--plot``
draws FAMILY-ENGINE.png and writes the table ``sweeps.md`` beside the folder from these files alone.
"""

from __future__ import annotations

import argparse
import fcntl
import hashlib
import json
import math
import pickle
import sys
import time
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

sys.path.insert(0, str(Path(__file__).resolve().parent.parent))

from volumetrics_addon.parameters.families import FAMILIES  # noqa: E402
from volumetrics_addon.parameters.model import Group, Parameter  # noqa: E402
from volumetrics_addon.parameters.preset import Preset, load  # noqa: E402
from volumetrics_addon.plan.model import CYCLES, ENGINES  # noqa: E402

WORDS = ("text", "path")  # have no range
POINTS = 5
SPREAD = 16.0  # a number that spans decades goes from a sixteenth of its base to sixteen times that
TOLERANCE = 0.005
GOAL = 0.0018  # standard error of a mean, relative, that is enough; half of it where the error comes out above the tolerance
REPEATS = 8
EEVEE_SAMPLES = 16  # its pictures are repeatable, and their noise is part of their error
TURNS = (-45.0, 10.0, 30.0, 60.0, 135.0)  # degrees
COSINES = (-0.9, -0.4, 0.0, 0.5, 0.95)  # mean cosines of a phase function
SHARES = (0.05, 0.25, 0.5, 0.75, 1.0)  # of a colour's largest component
REFERENCES = Path("out/references")  # what the references were, so that a second engine has them at once


@dataclass(frozen=True)
class Base:
    """What a family is swept around. ``values``: where the rule for a parameter's values says too little; ``beside``: what has to
    be set for a parameter to have an effect, beyond what is declared."""

    preset: str
    size: int = 14
    parameters: Mapping[str, Any] = field(default_factory=dict)
    stage: Mapping[str, Any] = field(default_factory=dict)
    props: bool = True
    values: Mapping[str, tuple] = field(default_factory=dict)
    beside: Mapping[str, Mapping[str, Any]] = field(default_factory=dict)
    seconds: float = 1.5  # of one core, for reference and render each
    samples: int = 16


BARE, COMPOSITOR = {"blocker": "none"}, {"realisation": "compositor"}
# Parameters of a godray that are seen better without bars in the beam; so are those that need a projector.
UNBLOCKED = ("light", "location", "target", "cone_angle", "blend", "frustum", "horizontal_fov", "vertical_fov", "roll", "near", "far",
             "falloff", "gobo", "extinction", "albedo", "g", "length", "domain")
BASES = {
    "cloud": Base(
        "cumulus", 14, {"extinction": 0.04, "noise_detail": 2.0, "billow_octaves": 2, "resolution": 64}, {"orders": 6},
        props=False, values={
                "location": ((0.0, 0.0, 350.0), (90.0, -60.0, 320.0), (-150.0, 200.0, 380.0)), "fill": (0.1, 0.35, 0.5, 0.75, 1.2),
                "base": (0.0, 0.04, 0.08, 0.3, 1.0), "wind": ((0.0, 0.0, 0.0), (10.0, -4.0, 1.0), (-30.0, 8.0, 0.0)),
                "resolution": (16, 32, 64, 128), "octaves": (1, 2, 4, 6), "light_resolution": (8, 16, 32, 64),
                "billow_strength": (-1.0, 0.0, 0.35, 0.75, 1.5), "time": (0.0, 5.0, 60.0), "seed": (0, 11, 77, 9999),
                "evolution": (0.0, 0.3, 1.0, 10.0), "stretch": (0.3, 1.0, 2.0, 5.0), "noise_detail": (0.0, 1.5, 2.0, 4.0, 8.0),
                "extinction": (0.0, 0.0025, 0.01, 0.04, 0.16)},
        beside={"wind": {"time": 4.0}, "time": {"wind": (8.0, 2.0, 0.0)}, "representation": {}}),
    "glass": Base("emerald-sphere", 16, values={
        "location": ((0.0, 0.0, 0.06), (0.03, 0.02, 0.07), (-0.06, -0.05, 0.1)), "strength": (0.0, 0.3, 1.0, 3.0, 10.0)},
        beside={"rotation": {"shape": "block"}}),
    "fog": Base("morning-valley", 14, values={
        "visibility": (0.0, 20.0, 80.0, 300.0, 2000.0), "slab_height": (0.5, 2.0, 4.0, 12.0, 60.0),
        "base_height": (-3.0, -1.0, 0.0, 1.0, 4.0), "second_extinction": (0.0, 0.002, 0.01, 0.04),
        "cutoff": (1e-5, 2e-3, 0.02, 0.1, 0.5), "location": ((0.0, 0.0, 1.5), (6.0, -8.0, 1.0), (-4.0, 5.0, 3.0)),
        "far_radiance": (0.0, 0.1, 0.5, 2.0), "start": (0.0, 5.0, 20.0, 60.0), "end": (25.0, 50.0, 100.0, 400.0),
        "cutoff_distance": (10.0, 40.0, 80.0, 1e6), "wind": ((0.0, 0.0, 0.0), (0.5, 0.3, 0.0), (-4.0, 1.0, 0.0)),
        "time": (0.0, 2.0, 60.0)},
        beside={name: COMPOSITOR for name in ("start", "cutoff_distance", "max_opacity", "sun_tint")}
        | {"wind": {"time": 3.0}, "time": {"wind": (0.4, 0.1, 0.0)}}),
    "godray": Base("theatre-slats", 14, values={
        "location": ((-3.8, 1.0, 7.6), (-2.0, 0.0, 6.5), (3.0, 2.0, 8.5)),
        "target": ((0.3, 0.6, 0.0), (-1.5, 0.0, 0.5), (2.0, 1.5, 1.0)),
        "power": (0.0, 65.0, 6500.0, 650000.0), "cone_angle": (2.0, 15.0, 38.0, 70.0, 110.0), "count": (1, 2, 4, 8),
        "horizontal_fov": (1.0, 15.0, 30.0, 60.0, 110.0), "vertical_fov": (1.0, 15.0, 30.0, 60.0, 110.0),
        "near": (0.0, 0.3, 1.0, 3.0, 6.0), "far": (3.0, 6.0, 9.0, 1e6), "gobo_count": (1, 2, 5, 12),
        "gobo_resolution": (8, 32, 64, 160), "gobo_drift_right": (-1.0, 0.0, 0.3), "gobo_drift_up": (-1.0, 0.0, 0.3),
        "gobo_time": (0.0, 0.7, 4.0), "spacing": (0.3, 1.4, 4.0), "dust_strength": (0.0, 0.5, 1.0, 2.0), "dust_time": (0.0, 2.0, 60.0),
        "dust_drift": ((0.0, 0.0, 0.0), (0.3, 0.2, 0.1), (-1.0, 0.0, 0.4)), "ambient": (0.0, 0.1, 1.0, 5.0),
        "blocker_count": (1, 2, 4, 9, 32), "blocker_distance": (0.4, 0.8, 1.6, 3.0, 6.0), "gobo_seed": (0, 1, 77),
        "extinction": (0.0, 0.005, 0.02, 0.07, 0.28)},
        beside={name: BARE for name in UNBLOCKED}
        | {"dust_drift": {"dust_time": 2.0}, "dust_time": {"dust_drift": (0.3, 0.2, 0.1)}, "ambient_color": {"ambient": 0.5}}
        | {"spacing": {"count": 3}, "gobo_drift_right": {"gobo_time": 1.0}, "gobo_drift_up": {"gobo_time": 1.0},
           "gobo_time": {"gobo": "water", "gobo_drift_right": 0.2}, "gobo_seed": {"gobo": "leaves"}}),
    "air": Base("clear-noon", 10, stage={"orders": 1}, seconds=20.0, samples=2, values={
        "reach": (2e5, 9e5, 2e6), "planet_radius": (1e6, 3.4e6, 6.36e6, 2e7), "thickness": (3e4, 6e4, 1e5),
        "base_height": (-1000.0, 0.0, 50.0), "mie_g": (-0.5, 0.0, 0.4, 0.76, 0.95)},
        # Air that is still half as dense where its domain ends shows the facets of that ball.
        beside={"rayleigh_scale_height": {"thickness": 300000.0}}),
}


# --- what is swept ---------------------------------------------------------------------------------------------


def base_of(family: str) -> Preset:
    base = BASES[family]
    preset = load(base.preset).changed(base.parameters, base.stage)
    return preset if base.props else replace(preset, props=())


def enabled(group: Group, name: str, values: Mapping[str, Any], special: Mapping[str, Mapping[str, Any]]) -> dict[str, Any]:
    """What to set beside ``values`` so that the parameter has an effect."""
    changes = dict(special.get(name, {}))
    while group[name].when:
        name, *effective = group[name].when
        changes = {**special.get(name, {}), **changes}
        value = changes.get(name, values[name])
        if value not in effective if effective else not value:
            parameter = group[name]
            changes[name] = effective[0] if effective else parameter.default or True if parameter.kind == "bool" else \
                parameter.default or BASES[group.name].values.get(name, spread(parameter, parameter.soft_range[1]))[-2]
    return changes


def spread(parameter: Parameter, base: Any) -> tuple:
    """Values of a parameter: all choices, or POINTS numbers around the base, the base among them."""
    low, high = parameter.soft_range
    match parameter.kind:
        case "choice":
            return tuple(name for name, _ in parameter.choices)
        case "bool":
            return (False, True)
        case "color":
            largest = max(base)
            return tuple(tuple(max(parameter.minimum, rounded(share * part / largest)) for part in base) for share in SHARES)
        case "vector":  # a size
            return tuple(tuple(rounded(factor * part) for part in base) for factor in (0.5, 0.8, 1.0, 1.25, 2.0))
    if parameter.unit == "deg" and high - low >= 360.0:
        return TURNS
    if parameter.minimum == -parameter.maximum and parameter.maximum < 1.0:
        return tuple(sorted({base, *COSINES}))
    decades = parameter.unit not in ("", "deg") or high > 4.0
    if decades and low >= 0.0 and base > 0.0 and high / max(low, base / SPREAD) > SPREAD:
        low, high = max(low, base / SPREAD), min(high, base * SPREAD)
        steps = [low, math.sqrt(low * base), base, math.sqrt(base * high), high]
    else:
        steps = [low + (high - low) * i / (POINTS - 1) for i in range(POINTS)]
    if parameter.kind == "int":
        return tuple(sorted({base, *map(round, steps)}))
    return tuple(sorted({base, *(rounded(step) for step in steps if not math.isclose(step, base, rel_tol=1e-9))}))


def rounded(value: float) -> float:
    return float(f"{value:.3g}")


def cases(family: str) -> Iterator[tuple[Parameter, dict[str, Any], tuple]]:
    """Every parameter of the family with what is set beside it, and its values."""
    preset, base = base_of(family), BASES[family]
    for parameter in preset.group.parameters:
        if parameter.kind in WORDS:
            continue
        beside = enabled(preset.group, parameter.name, preset.parameters, base.beside)
        values = base.values.get(parameter.name) or spread(parameter, {**preset.parameters, **beside}[parameter.name])
        yield parameter, {name: value for name, value in beside.items() if value != preset.parameters[name]}, values


# --- one value -------------------------------------------------------------------------------------------------


class Meter:
    """Renders and references of one family and engine; pictures that were measured once are not measured again."""

    def __init__(self, family: str, engine: str):
        self.base, self.engine, self.known = BASES[family], engine, {}

    def __call__(self, preset: Preset) -> list:
        """[mean relative error, low, high of its 95 % interval], or None for each where the reference is black."""
        key = repr(sorted(preset.parameters.items()))
        if key not in self.known:
            self.known[key] = self._measure(preset)
        return self.known[key]

    def _measure(self, preset: Preset) -> list:
        from volumetrics_addon import verify
        from volumetrics_addon.blender import render
        from volumetrics_addon.compare.statistics import Estimate, compare

        width, height = verify.image_size(preset, self.base.size)
        scene = verify.scene_of(preset, self.engine)

        def reference(samples: int) -> Estimate:
            result = verify.reference_of(scene, width, height, repeats=REPEATS, samples=samples)
            return Estimate.from_repeats(result.repeats, independent_pixels=True)

        def picture(samples: int) -> Estimate:
            images = render.render(preset, scene, self.engine, width, height, samples, repeats=REPEATS).images
            return Estimate.from_repeats(images, samples) if len(images) > 1 else Estimate.exact(images[0])

        path = REFERENCES / f"{hashlib.sha256(pickle.dumps((scene, width, height))).hexdigest()[:20]}.pickle"
        for closer in (1.0, 0.5):
            if path.exists() and closer == 1.0:
                truth = pickle.loads(path.read_bytes())
            else:
                truth = self._until(reference, 4, closer)
                path.parent.mkdir(parents=True, exist_ok=True)
                path.write_bytes(pickle.dumps(truth))
            if self.engine == CYCLES:
                shown = self._until(picture, self.base.samples, closer)
            elif closer == 1.0:
                shown = picture(EEVEE_SAMPLES)
            comparison = compare(shown, truth)
            error = comparison.mean_relative_error
            if error is None:
                return [None, None, None]
            low, high = comparison.mean_relative_interval
            if self.engine != CYCLES or abs(error) < TOLERANCE or wrong((error, low, high)):
                break
        return [rounded(value) for value in (error, low, high)]

    def _until(self, estimate: Any, samples: int, closer: float) -> Any:
        """The estimate with as many samples as its noise asks for and the time allows, from one with few."""
        start, goal = time.process_time(), GOAL * closer
        first = estimate(samples)
        noise = first.mean_standard_error / max(abs(first.mean_value), 1e-300)
        more = min((noise / goal) ** 2, self.base.seconds / closer**2 / max(time.process_time() - start, 1e-3))
        return estimate(round(samples * more)) if noise > goal and more > 1.5 else first


# --- records ---------------------------------------------------------------------------------------------------


@dataclass
class Record:
    """The results of a family: by parameter what was set beside it, its values, and by engine a result for each of them."""

    path: Path

    def read(self) -> dict[str, Any]:
        return json.loads(self.path.read_text(encoding="utf-8")) if self.path.exists() else {"parameters": {}}

    def add(self, header: Mapping[str, Any], name: str, beside: Mapping[str, Any], values: tuple, run: str, value: Any,
            result: Any) -> None:
        """Write one result; other processes may write to the same file."""
        self.path.parent.mkdir(parents=True, exist_ok=True)
        REFERENCES.mkdir(parents=True, exist_ok=True)
        with open(REFERENCES / f"{self.path.stem}.lock", "w") as lock:
            fcntl.flock(lock, fcntl.LOCK_EX)
            data = {**self.read(), **header}
            mine = data["parameters"].get(name)
            asked = {"beside": dict(beside), "values": list(values)}
            if mine is None or not same({key: mine[key] for key in asked}, asked):
                data["parameters"][name] = mine = asked
            mine.setdefault(run, [None] * len(values))[values.index(value)] = result
            lines = ",\n".join(f"  {json.dumps(key)}: {json.dumps(entry)}" for key, entry in data["parameters"].items())
            head = "".join(f" {json.dumps(key)}: {json.dumps(entry)},\n" for key, entry in data.items() if key != "parameters")
            partial = self.path.with_suffix(".partial")
            partial.write_text(f'{{\n{head} "parameters": {{\n{lines}\n }}\n}}\n', encoding="utf-8")
            partial.replace(self.path)

    def has(self, name: str, beside: Mapping[str, Any], values: tuple, run: str, value: Any) -> bool:
        mine = self.read()["parameters"].get(name)
        return (mine is not None and run in mine and same([mine["beside"], mine["values"]], [dict(beside), list(values)])
                and mine[run][values.index(value)] is not None)


def same(a: Any, b: Any) -> bool:
    """Equal as JSON, which knows no tuples."""
    return json.dumps(a) == json.dumps(b)


def sweep(family: str, engine: str, folder: Path, only: set[str], deadline: float, outer: bool) -> bool:
    """Measure what is not yet recorded; False where the time ran out before that."""
    import bpy

    run = f"{engine} {'.'.join(map(str, bpy.app.version[:2]))}"
    record, meter, preset = Record(folder / f"{family}.json"), Meter(family, engine), base_of(family)
    base = BASES[family]
    header = {"preset": base.preset, "base": {**base.parameters, **base.stage}, "pixels": base.size}
    for parameter, beside, values, value in ordered(family, outer):
        if only and parameter.name not in only or record.has(parameter.name, beside, values, run, value):
            continue
        if time.monotonic() > deadline:
            return False
        start, cpu = time.monotonic(), time.process_time()
        try:
            result = meter(preset.changed({**beside, parameter.name: value}))
        except (ValueError, RuntimeError, MemoryError) as error:
            result = str(error)
        record.add(header, parameter.name, beside, values, run, value, result)
        mark = "  <--" if isinstance(result, str) or wrong(result) else ""
        print(f"{family} {run} {parameter.name} = {value}: {result}  {time.monotonic() - start:.0f} s, "
              f"{time.process_time() - cpu:.0f} of a core{mark}", flush=True)
    return True


def ordered(family: str, outer: bool) -> Iterator[tuple[Parameter, dict[str, Any], tuple, Any]]:
    """Cases with a value each: first and last, the middle and choices, or the others."""
    for parameter, beside, values in cases(family):
        first = values if parameter.kind == "choice" else {values[0], values[len(values) // 2], values[-1]}
        for value in values:
            if (value in first) == outer:
                yield parameter, beside, values, value


def wrong(result: Sequence) -> bool:
    """Whether the interval excludes errors within the tolerance."""
    return result[0] is not None and (result[1] > TOLERANCE or result[2] < -TOLERANCE)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("families", nargs="*", metavar="FAMILY", help=", ".join(BASES))
    parser.add_argument("--engine", choices=ENGINES, default=CYCLES)
    parser.add_argument("--only", type=lambda text: set(text.split(",")), default=set(), metavar="NAME,NAME",
                        help="only these parameters")
    parser.add_argument("--limit", type=float, default=math.inf, metavar="MINUTES",
                        help="stop after this time; the next run goes on")
    parser.add_argument("--out", type=Path, default=Path("docs/sweeps"))
    parser.add_argument("--plot", action="store_true", help="draw what is recorded")
    arguments = parser.parse_args()
    if arguments.plot:
        import sweep_plots

        sweep_plots.write(arguments.out)
        return
    deadline = time.monotonic() + 60.0 * arguments.limit
    for outer in (True, False):
        for family in arguments.families or BASES:
            if not sweep(family, arguments.engine, arguments.out, arguments.only, deadline, outer):
                print("time is up")
                return


if __name__ == "__main__":
    main()
