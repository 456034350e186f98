# SPDX-License-Identifier: GPL-3.0-or-later
"""``volumetrics``: list, show, render, verify, tour, plan, integrators, bench, fit-phase, table, doctor.

Exit codes: 0 done, 1 an error was measured above the tolerance or a target was missed, 2 bad usage or a bad preset, 3 something is missing on
this machine or the engine failed, 130 interrupted.
"""

from __future__ import annotations

import argparse
import functools
import json
import math
import os
import sys
import tempfile
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from ..parameters.families import FAMILIES
from ..parameters.model import Group, Parameter, ParameterError
from ..parameters.preset import Preset, load, names, to_toml
from ..parameters.stage import STAGE
from ..plan.catalogue import TARGET
from ..plan.model import CYCLES, EEVEE, ENGINES
from ..scene import derived

OK, WORSE, USAGE, FAILED, INTERRUPTED = 0, 1, 2, 3, 130
SIZE, SAMPLES = 64, {CYCLES: 64, EEVEE: 16}


class Progress:
    """One line on stderr that is rewritten, or nothing when quiet or not on a terminal."""

    def __init__(self, quiet: bool):
        self.enabled = not quiet and sys.stderr.isatty()

    def __call__(self, what: str, share: float) -> None:
        if self.enabled:
            filled = round(24 * share)
            sys.stderr.write(f"\r\x1b[K{what:<28} [{'#' * filled}{'.' * (24 - filled)}] {share:4.0%}")
            sys.stderr.flush()

    def clear(self) -> None:
        if self.enabled:
            sys.stderr.write("\r\x1b[K")
            sys.stderr.flush()


def option(group: Group, parameter: Parameter) -> str:
    return f"--{group.name}.{parameter.name.replace('_', '-')}"


def _whole(minimum: int, maximum: int) -> Callable[[str], int]:
    def parse(text: str) -> int:
        try:
            value = int(text)
        except ValueError:
            value = minimum - 1
        if not minimum <= value <= maximum:
            raise argparse.ArgumentTypeError(f"{text} is not allowed; give a whole number from {minimum} to {maximum}")
        return value

    return parse


_size = _whole(1, 8192)


def _tolerance(text: str) -> float:
    try:
        value = float(text.removesuffix("%")) / (100.0 if text.endswith("%") else 1.0)
    except ValueError:
        value = 0.0
    if not 0.0 < value < float("inf"):
        raise argparse.ArgumentTypeError(f"{text} is not allowed; give a positive fraction such as 0.005 or 0.5%")
    return value


def _seconds(text: str) -> float:
    number, unit = (text[:-1], text[-1]) if text[-1:] in ("s", "m", "h") else (text, "s")
    try:
        value = float(number) * {"s": 1.0, "m": 60.0, "h": 3600.0}[unit]
    except ValueError:
        value = 0.0
    if not 0.0 < value < math.inf:
        raise argparse.ArgumentTypeError(f"{text} is not allowed; give a time above 0 in seconds, such as 60, 60s, 5m or 2h")
    return value


def _image_options(engine: str | None) -> argparse.ArgumentParser:
    image = argparse.ArgumentParser(add_help=False)
    image.add_argument("--engine", choices=ENGINES, default=engine,
                       help="(cycles; for a .blend file its own)" if engine is None else None)
    image.add_argument("--samples", type=_whole(1, 1 << 24), metavar="N",
                       help=f"samples per pixel and repeat (Cycles {SAMPLES[CYCLES]}, EEVEE {SAMPLES[EEVEE]})")
    image.add_argument("--size", type=_size, metavar="N", help="pixels along the longer side")
    image.add_argument("--seed", type=_whole(0, 1 << 30), metavar="N", default=0, help="seed of the first repeat (0)")
    image.add_argument("--engine-output", action="store_true", help="show what the engine prints")
    return image


def parser(program: str) -> argparse.ArgumentParser:
    top = argparse.ArgumentParser(prog=program, description="Volumetric lighting presets with stated errors.",
                                  epilog="exit codes: 0 done, 1 worse than the tolerance or the target, 2 bad usage or preset, "
                                         "3 missing library or failed engine, 130 interrupted")
    commands = top.add_subparsers(dest="command", required=True, metavar="COMMAND")

    common = argparse.ArgumentParser(add_help=False)
    common.add_argument("--json", action="store_true", help="write JSON to standard output")
    common.add_argument("--quiet", action="store_true", help="no progress and no messages but errors")

    changes = argparse.ArgumentParser(add_help=False)
    for group in (*FAMILIES.values(), STAGE):
        section = changes.add_argument_group(f"{group.label.lower()} parameters")
        for parameter in group.parameters:
            section.add_argument(option(group, parameter), dest=f"{group.name}.{parameter.name}", metavar="VALUE",
                                 help=f"{parameter.description} Allowed: {parameter.limits}.".replace("%", "%%"))

    commands.add_parser("list", parents=[common], help="the presets that come with the package")
    show = commands.add_parser("show", parents=[common, changes],
                               help="a preset's parameters with units and limits, and what follows from them")
    show.add_argument("preset", help="name of a preset, or a .toml file")
    show.add_argument("--toml", action="store_true", help="write it as a preset file")

    render = commands.add_parser("render", parents=[common, _image_options(None), changes],
                                 help="render a preset or a .blend file to linear 32-bit EXR, to an error or within a time")
    render.add_argument("preset", help="name of a preset, a .toml file, or a .blend file: its scene, camera and settings")
    render.add_argument("--out", type=Path, help="the EXR to write (NAME-ENGINE.exr); a .png beside it shows it, "
                        "a .json has the figures")
    render.add_argument("--error", type=_tolerance, metavar="E", help="render until the relative RMSE, noise and bias, is below this "
                        "with 95 %% confidence, such as 0.01 or 1%%; what was interrupted goes on where it stopped")
    render.add_argument("--time", type=_seconds, metavar="T", help="the best picture within a time, or the longest that --error may "
                        "take, such as 60s, 5m or 2h")
    render.add_argument("--round-samples", type=_whole(1, 1 << 23), metavar="N",
                        help="with --error or --time: samples of each of the renders that are averaged, instead of what a pilot finds")
    render.add_argument("--max-samples", type=_whole(1, 1 << 24), metavar="N",
                        help="with --error or --time: limit of all samples of a pixel")
    render.add_argument("--frame", type=_whole(-1048574, 1048574), metavar="N", help="frame of a .blend file (its current one)")
    render.add_argument("--plan", type=_tolerance, nargs="?", const=TARGET, metavar="E", help="leave out of a .blend file what changes its "
                        "picture by no more than this (0.2%%), see the command plan; the file stays as it is")
    render.add_argument("--no-denoise", dest="denoise", action="store_false",
                        help="with --error or --time: leave the noise in the picture, also where a denoised one is closer to the truth")
    render.add_argument("--no-allocate", dest="allocate", action="store_false",
                        help="with --error or --time: equally many samples for every pixel, also where the noise is in few places")
    render.add_argument("--without", action="append", default=[], metavar="RULE", help="switch off a rule of the plan; may be repeated")
    render.add_argument("--force", action="store_true", help="render again although nothing has changed, and from the beginning")

    verify = commands.add_parser("verify", parents=[common, _image_options(CYCLES), changes],
                                 help="render, compare with the reference and state the error")
    verify.add_argument("preset", nargs="+", help="names of presets, or .toml files; 'all' for every preset")
    verify.add_argument("--repeats", type=_whole(2, 1 << 16), metavar="N",
                        help="independent renders with consecutive seeds (8)")
    verify.add_argument("--reference-samples", type=_whole(1, 1 << 16), metavar="N",
                        help="rays per pixel and repeat of the reference (16)")
    verify.add_argument("--tolerance", type=_tolerance, help="largest mean relative error, such as 0.005 or 0.5%% "
                        "(Cycles 0.5%%, EEVEE: stated but not judged)")
    verify.add_argument("--out", type=Path, default=Path("out"), help="folder for EXR, JSON and the report picture (out)")

    tour = commands.add_parser("tour", parents=[common], help="one preset of each family in Cycles with its error")
    tour.add_argument("--out", type=Path, default=Path("out"), help="folder for the contact sheet (out)")
    tour.add_argument("--size", type=_size, metavar="N", default=112, help="pixels along the longer side (112)")

    plan = commands.add_parser("plan", parents=[common],
                               help="what a scene does not need: each rule with its reason, its bound and its gain")
    plan.add_argument("file", help="a .blend file, or a preset")
    plan.add_argument("--scene", metavar="NAME", help="of the scenes in the file (the one that is shown)")
    plan.add_argument("--engine", choices=ENGINES, help="plan for this engine (the scene's own, for a preset Cycles)")
    plan.add_argument("--size", type=_size, metavar="N", help="of a preset's picture: pixels along the longer side (512)")
    plan.add_argument("--samples", type=_whole(1, 1 << 24), metavar="N", help="of a preset's picture")
    plan.add_argument("--error", type=_tolerance, help="what all rules together may change, such as 0.2%% (0.2%%)")
    plan.add_argument("--without", action="append", default=[], metavar="RULE", help="switch a rule off; may be repeated")
    plan.add_argument("--pilot", action="store_true",
                      help="render small pictures that tell the noise, for the noise threshold; in EEVEE large ones of few samples, which "
                           "tell whether froxels may be finer")
    plan.add_argument("--out", type=Path, metavar="FILE.blend", help="apply the plan and save the file under this name")

    commands.add_parser("integrators", parents=[common], help="every integrator of the field that is here, with its bias")

    bench = commands.add_parser("bench", parents=[common],
                                help="every rival over the same scenes: run time against error, as CSV, charts and a table")
    bench.add_argument("scene", nargs="*", help="names of benchmark scenes (all of them)")
    bench.add_argument("--rivals", metavar="NAME,NAME", help="only these: integrators, cycles, eevee")
    bench.add_argument("--size", type=_size, metavar="N", default=48, help="pixels along each side (48)")
    bench.add_argument("--seed", type=_whole(0, 1 << 30), metavar="N", default=0, help="seed of the random rivals (0)")
    bench.add_argument("--limit", type=_seconds, metavar="SECONDS", default=60.0,
                       help="a rival stops at its first setting slower than this (60)")
    bench.add_argument("--out", type=Path, default=Path("bench"), help="folder of bench.csv, charts, summary and truths (bench); "
                       "what it holds already is not measured again")

    fit = commands.add_parser("fit-phase", parents=[common],
                              help="the two lobes of a cloud nearest to a measured phase function or to water droplets")
    fit.add_argument("table", nargs="?", type=Path, help="text file with two columns: angle in degrees, 0 forward, and value")
    fit.add_argument("--droplet", type=float, metavar="MICROMETRES", help="diameter of water droplets instead")
    fit.add_argument("--logarithmic", action="store_true", help="fit the logarithm: where the values span decades")
    fit.add_argument("--keep-mean-cosine", action="store_true", help="the fit has the mean cosine of what is given, exactly")

    table = commands.add_parser("table", parents=[common], help="Markdown tables for the documentation")
    table.add_argument("what", choices=("presets", "parameters", "integrators", "rules"))
    table.add_argument("--from", dest="source", type=Path, default=Path("out"), help="folder of verify's JSON files (out)")

    commands.add_parser("doctor", parents=[common], help="what this machine has and what is missing")
    return top


def main(argv: Sequence[str] | None = None, program: str = "volumetrics") -> int:
    """Run one command; returns the exit code."""
    try:
        arguments = parser(program).parse_args(argv)
    except SystemExit as stop:  # argparse has printed help or its message
        return stop.code if isinstance(stop.code, int) else USAGE
    progress = Progress(getattr(arguments, "quiet", False))
    try:
        with _own_output():
            return COMMANDS[arguments.command](arguments, progress)
    except ValueError as error:  # PresetError, ParameterError, values that contradict one another
        return _fail(progress, error, USAGE)
    except ImportError as error:
        from .doctor import import_remedy

        return _fail(progress, f"{error}\n  remedy: {import_remedy(error)}\n  see also: {program} doctor", FAILED)
    except (OSError, RuntimeError) as error:
        return _fail(progress, error, FAILED)
    except KeyboardInterrupt as stop:
        return _fail(progress, str(stop) or "interrupted; nothing half-written is left", INTERRUPTED)


@contextmanager
def _own_output() -> Iterator[None]:
    """Standard output for this program alone: what Blender writes there from below Python goes to standard error."""
    python_output = sys.stdout
    try:
        direct = python_output.fileno() == 1
    except (AttributeError, OSError):  # there is none, or it is captured
        direct = False
    if not direct:
        yield
        return
    python_output.flush()
    descriptor = os.dup(1)
    os.dup2(2, 1)
    try:
        with open(descriptor, "w", encoding=python_output.encoding, errors=python_output.errors, closefd=False) as sys.stdout:
            yield
    finally:
        sys.stdout = python_output
        os.dup2(descriptor, 1)
        os.close(descriptor)


def _fail(progress: Progress, message: object, code: int) -> int:
    progress.clear()
    print(f"volumetrics: {message}", file=sys.stderr)
    return code


def _say(arguments: argparse.Namespace, text: str) -> None:
    if not arguments.quiet and not arguments.json:
        print(text, flush=True)


def make_folder(folder: Path) -> None:
    """The folder, made and written to: better to fail before the render than after it. Raises OSError."""
    folder.mkdir(parents=True, exist_ok=True)
    with tempfile.TemporaryFile(dir=folder):
        pass


def changed(arguments: argparse.Namespace, preset: Preset) -> Preset:
    """The preset with the values given on the command line."""
    changes: dict[str, dict[str, Any]] = {preset.family: {}, STAGE.name: {}}
    for group in (*FAMILIES.values(), STAGE):
        for parameter in group.parameters:
            text = getattr(arguments, f"{group.name}.{parameter.name}")
            if text is None:
                continue
            if group.name not in changes:
                raise ParameterError(f"{option(group, parameter)} does not belong to {preset.name}, which is a "
                                     f"{preset.family}; use the options --{preset.family}.*")
            changes[group.name][parameter.name] = parameter.parse(text)
    return preset.changed(changes[preset.family], changes[STAGE.name])


def _list(arguments: argparse.Namespace, progress: Progress) -> int:
    presets = [load(name) for name in names()]
    if arguments.json:
        print(json.dumps([{"name": p.name, "family": p.family, "label": p.label, "description": p.description}
                          for p in presets], indent=2))
        return OK
    for preset in presets:
        print(f"{preset.name:<20} {preset.family:<8} {preset.description}")
    return OK


def _show(arguments: argparse.Namespace, progress: Progress) -> int:
    preset = changed(arguments, load(arguments.preset))
    quantities = derived.derived(preset.family, preset.parameters)
    if arguments.toml:
        print(to_toml(preset), end="")
    elif arguments.json:
        print(json.dumps({"name": preset.name, "family": preset.family, "label": preset.label,
                          "description": preset.description, "parameters": preset.parameters, "stage": preset.stage,
                          "props": list(preset.props), "derived": [_quantity(quantity) for quantity in quantities]}, indent=2))
    else:
        print(f"{preset.label} ({preset.family})\n{preset.description}")
        for group, values in ((preset.group, preset.parameters), (STAGE, preset.stage)):
            print(f"\n{group.label}")
            for parameter in group.parameters:
                print(f"  {parameter.name:<22} {_shown(values[parameter.name]):<26} {parameter.limits}")
        print("\nWhat follows from them")
        for quantity in quantities:
            print(f"  {quantity.label:<30} {derived.text(quantity)}")
        if preset.props:
            print(f"\n{len(preset.props)} props")
    return OK


def _quantity(quantity: derived.Quantity) -> dict[str, Any]:
    """As JSON, which knows no infinity: null."""
    finite = lambda part: part if math.isfinite(part) else None  # noqa: E731
    value = quantity.value
    return {"label": quantity.label, "value": list(map(finite, value)) if isinstance(value, tuple) else finite(value),
            "unit": quantity.unit}


def _shown(value: Any) -> str:
    return ", ".join(f"{v:g}" for v in value) if isinstance(value, tuple) else f"{value:g}" if isinstance(value, float) else str(value)


def _render(arguments: argparse.Namespace, progress: Progress) -> int:
    from . import render

    return render.run(arguments, progress, functools.partial(_say, arguments))


def _verify(arguments: argparse.Namespace, progress: Progress) -> int:
    from .. import verify

    chosen = names() if arguments.preset == ["all"] else arguments.preset
    presets = [changed(arguments, load(name)) for name in chosen]
    make_folder(arguments.out)
    tolerance = arguments.tolerance if arguments.tolerance is not None else verify.TOLERANCE[arguments.engine]
    results, code = [], OK
    for preset in presets:
        result = verify.verify(
            preset, arguments.engine, arguments.size or SIZE, arguments.samples or SAMPLES[arguments.engine],
            repeats=arguments.repeats or verify.REPEATS, seed=arguments.seed,
            reference_samples=arguments.reference_samples or verify.REFERENCE_SAMPLES, quiet=not arguments.engine_output,
            progress=lambda what, share, name=preset.name: progress(f"{name}: {what}", share))
        paths = verify.write(result, arguments.out)
        progress.clear()
        passed = result.passes(tolerance)
        code = code if passed else WORSE
        results.append({**result.to_json(), "tolerance": tolerance, "passed": passed,
                        "files": {kind: str(path) for kind, path in paths.items()}})
        verdict = _verdict(result.comparison.mean_relative_error, tolerance, passed)
        _say(arguments, f"{preset.name:<18} {arguments.engine:<7} {summary(results[-1])}  {verdict}".rstrip())
        for note in result.notes:
            _say(arguments, f"{'':<18} - {note}")
    if arguments.json:
        print(json.dumps(results, indent=2))
    else:
        _say(arguments, f"reports in {arguments.out}")
    return code


def _verdict(error: float | None, tolerance: float | None, passed: bool) -> str:
    if tolerance is None:
        return ""
    if passed:
        return "ok"
    within = error is not None and abs(error) <= tolerance
    return "WORSE: too few pixels pass" if within else f"WORSE than {100.0 * tolerance:g}%"


def summary(result: dict) -> str:
    """One line: mean error with its interval, RMSE without noise, pixels passing."""
    c = result["comparison"]
    if c["mean_relative_error"] is None:
        return f"reference is black, mean difference {c['mean_difference']:.3g}"
    low, high = c["mean_relative_interval"] or (float("nan"),) * 2
    interval = f"[{low:+.3%}, {high:+.3%}]"
    return (f"mean error {c['mean_relative_error']:+.3%} {interval}  rmse {c['rmse_denoised']:.2%}  "
            f"pixels passing {c['z_pass_fraction']:.2%}  render {result['render_seconds']:.1f} s")


# One preset of each family for the first picture, with the samples of render and reference: under two minutes in all.
TOUR = (("cumulus", 24, 9), ("emerald-sphere", 64, 16), ("morning-valley", 32, 4), ("theatre-slats", 48, 4),
        ("clear-noon", 8, 4))
TOUR_REPEATS = 4


def _tour(arguments: argparse.Namespace, progress: Progress) -> int:
    from .. import verify
    from ..blender.text import text_mask
    from ..compare.png import write_png
    from ..compare.report import contact_sheet, display

    make_folder(arguments.out)
    cells, results = [], []
    for name, samples, reference_samples in TOUR:
        preset = load(name)
        report = lambda what, share, name=name: progress(f"{name}: {what}", share)  # noqa: E731
        result = verify.verify(preset, CYCLES, arguments.size, samples, repeats=TOUR_REPEATS, reference_samples=reference_samples,
                               reference_repeats=TOUR_REPEATS, progress=report)
        progress.clear()
        figures = result.to_json()
        results.append(figures)
        _say(arguments, f"{name:<18} {summary(figures)}")
        c = result.comparison
        low, high = c.mean_relative_interval
        cells.append((display(result.render, preset.stage["exposure"]), preset.label,
                      [f"{preset.group.label}, {result.render_seconds:.1f} s",
                       f"mean error {c.mean_relative_error:+.2%} [{low:+.2%}, {high:+.2%}]"]))
    path = arguments.out / "tour.png"
    write_png(path, contact_sheet(cells, text_mask, "Volumetrics: Cycles against its references"))
    if arguments.json:
        print(json.dumps({"sheet": str(path), "results": results}, indent=2))
    _say(arguments, f"contact sheet: {path}")
    return OK


def _plan_of_preset(arguments: argparse.Namespace) -> int:
    from ..plan.catalogue import PRESET_RULES
    from ..plan.rules import check_names

    for option in ("scene", "error", "out"):
        if getattr(arguments, option) is not None:
            raise ParameterError(f"--{option} is not allowed with a preset, whose plan follows from its parameters; give a .blend file")
    if arguments.pilot:
        raise ParameterError("--pilot is not allowed with a preset, whose samples are asked for; give a .blend file")
    preset, engine = load(arguments.file), arguments.engine or CYCLES
    check_names(arguments.without)
    from .. import verify
    from ..blender import render

    width, height = verify.image_size(preset, arguments.size or 512)
    samples = arguments.samples or SAMPLES[engine]
    plan = render.plan_of(preset, verify.scene_of(preset, engine, width * height * samples), engine, width, height, samples,
                          arguments.without)
    rules = [(decision, PRESET_RULES[decision.rule]) for decision in plan.decisions]
    if arguments.json:
        print(json.dumps({"preset": preset.name, "engine": engine, "rules": [
            {**vars(decision), "guarantee": rule.guarantee, "gain": rule.gain.get(engine), "shown_by": rule.shown_by or None,
             "switch": rule.switch or None} for decision, rule in rules]}, indent=2))
        return OK
    _say(arguments, f"{preset.label} in {engine}, {width} x {height}, {samples} samples")
    for decision, rule in rules:
        gain = f", {rule.gain[engine]:g} x as fast on {rule.shown_by}" if engine in rule.gain else ""
        off = {"": "", "--without": f"; off with --without '{rule.name}'"}.get(rule.switch, f"; off with {rule.switch}")
        _say(arguments, f"\n  {decision.rule}: {decision.effect}{gain}\n    {decision.reason}\n    leaves out {rule.leaves_out}; "
                        f"{rule.guarantee}{off}")
    return OK


def _plan(arguments: argparse.Namespace, progress: Progress) -> int:
    if not arguments.file.endswith(".blend"):
        return _plan_of_preset(arguments)
    for option_name in ("size", "samples"):
        if getattr(arguments, option_name) is not None:
            raise ParameterError(f"--{option_name} is for presets; a .blend file is planned for its own resolution and samples")
    from ..plan import tuning
    from ..plan.catalogue import CLOSER, RULES

    if arguments.out is not None and arguments.out.suffix != ".blend":
        raise ParameterError(f"--out {arguments.out} is not allowed; the plan is saved in a Blender file, end the name with .blend")
    from ..blender import compat, files
    from ..blender import tuning as of_scene

    scene = files.open_scene(Path(arguments.file), arguments.scene, arguments.engine)
    target = arguments.error or tuning.TARGET
    advice = of_scene.plan(scene, target, arguments.without, pilot=arguments.pilot)
    if arguments.out is not None:
        of_scene.apply(scene, advice)
        files.save(arguments.out)
    engine = compat.engine_of(scene)
    bound = sum(found.bound for found in advice)
    if arguments.json:
        print(json.dumps({"file": str(arguments.file), "scene": scene.name, "engine": engine, "target": target, "bound": bound,
                          "rules": [{"rule": found.rule.name, "reason": found.reason, "bound": found.bound,
                                     "gain": found.rule.gain.get(engine), "shown_by": found.rule.shown_by or None,
                                     "changes": [vars(change) for change in found.changes]} for found in advice],
                          "saved": str(arguments.out) if arguments.out else None}, indent=2))
        return OK
    closer = [found.rule.name for found in advice if found.rule.effect == CLOSER]
    _say(arguments, f"{scene.name} in {engine}: the plan changes the picture by {bound:.2%} at most, of {target:.2%} allowed"
                    + (f", but for what brings it closer ({', '.join(closer)})" if closer else ""))
    for found in advice:
        _say(arguments, f"\n  {found.rule.name}: {tuning.figures(found, engine)}")
        _say(arguments, f"    {found.reason}")
        _say(arguments, f"    leaves out {found.rule.leaves_out}")
        for change in found.changes:
            _say(arguments, f"    {change}")
    idle = [rule.name for rule in RULES.values() if engine in rule.engines and rule.name not in {found.rule.name for found in advice}]
    if idle:
        off = [name for name in idle if name in arguments.without]
        _say(arguments, "\n  nothing to do for: " + ", ".join(name + (" (off)" if name in off else "") for name in idle))
    if arguments.out is not None:
        _say(arguments, f"\nsaved as {arguments.out}; Restore in the panel takes it back")
    return OK


def _table(arguments: argparse.Namespace, progress: Progress) -> int:
    from . import tables

    made = {"presets": lambda: tables.presets(arguments.source), "parameters": tables.parameters, "integrators": tables.integrators,
            "rules": tables.rules}
    print(made[arguments.what]())
    return OK


def _integrators(arguments: argparse.Namespace, progress: Progress) -> int:
    from ..reference import select

    modules = {name: select.load(name) for name in select.NAMES}
    if arguments.json:
        print(json.dumps([{"name": name, "summary": select.summary(module), "bias": module.BIAS,
                           "settings": list(module.SETTINGS)} for name, module in modules.items()], indent=2))
        return OK
    for name, module in modules.items():
        print(f"{name:<22} {select.summary(module)}")
        print(f"{'':<22} bias: {module.BIAS}")
    return OK


def _bench(arguments: argparse.Namespace, progress: Progress) -> int:
    from ..bench import rivals, run, scenes, summary

    benches = [scenes.by_name(name) for name in arguments.scene] or list(scenes.SCENES)
    chosen = [rivals.rival(name.strip()) for name in arguments.rivals.split(",")] if arguments.rivals else \
        [rivals.rival(name) for name in rivals.names()]
    make_folder(arguments.out)

    def say(text: str) -> None:
        progress.clear()
        _say(arguments, text)

    rows = run.measure(benches, chosen, arguments.size, arguments.out, limit=arguments.limit, seed=arguments.seed,
                       progress=progress, say=say)
    charts: list[Path] = []
    try:
        charts = _charts(benches, rows, arguments)
    except ImportError as error:  # the measurements are worth more than their pictures
        say(str(error))
    text = summary.summary(rows)
    (arguments.out / "summary.md").write_text(text, encoding="utf-8")
    progress.clear()
    if arguments.json:
        print(json.dumps({"rows": [vars(row) for row in rows], "charts": [str(path) for path in charts]}, indent=2))
    _say(arguments, f"\n{text}\n{'charts, ' if charts else ''}bench.csv and summary.md in {arguments.out}")
    return OK


def _charts(benches: Sequence[Any], rows: Sequence[Any], arguments: argparse.Namespace) -> list[Path]:
    """A chart for each scene and one of all; their files. Raises ImportError without matplotlib."""
    from ..bench import chart, run

    files, sheet = [], []
    for bench in benches:
        mine = [row for row in rows if row.scene == bench.name]
        if mine:
            truth = run.truth_of(bench, bench.make(), arguments.size, arguments.size, arguments.out, mine[0].digest)
            files.append(arguments.out / f"{bench.name}.png")
            chart.chart(mine, bench.title, files[-1], truth.image)
            sheet.append((bench.title, mine))
    if sheet:
        files.append(arguments.out / "bench.png")
        chart.overview(sheet, files[-1])
    return files


def _fit_phase(arguments: argparse.Namespace, progress: Progress) -> int:
    from . import fit

    values = fit.fit(arguments.table, arguments.droplet, arguments.logarithmic, arguments.keep_mean_cosine)
    print(json.dumps(values, indent=2) if arguments.json else fit.described(values))
    return OK


def _doctor(arguments: argparse.Namespace, progress: Progress) -> int:
    from . import doctor

    results = doctor.checks()
    if arguments.json:
        print(json.dumps(doctor.to_json(results), indent=2))
    else:
        for check in results:
            mark = "ok     " if check.ok else "MISSING" if check.required else "without"
            print(f"{mark} {check.name}: {check.detail}")
            if check.remedy:
                print(f"        {check.remedy}")
    return OK if all(check.ok for check in results if check.required) else FAILED


COMMANDS: dict[str, Callable[[argparse.Namespace, Progress], int]] = {
    "list": _list, "show": _show, "render": _render, "verify": _verify, "tour": _tour, "plan": _plan,
    "integrators": _integrators, "bench": _bench, "fit-phase": _fit_phase, "table": _table, "doctor": _doctor,
}


def console() -> int:
    """Entry point of the installed command."""
    return main()
