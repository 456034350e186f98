# SPDX-License-Identifier: GPL-3.0-or-later
"""``volumetrics render``: a preset or a .blend file, at so many samples or to an error, and not again if unchanged."""

from __future__ import annotations

import argparse
import json
import math
from collections.abc import Callable
from pathlib import Path
from typing import Any

from ..parameters.families import FAMILIES
from ..parameters.model import ParameterError
from ..parameters.preset import Preset, load
from ..parameters.stage import STAGE
from ..plan.effort import TYPICAL_ROUND
from ..plan.model import CYCLES, Decision
from ..plan.rules import check_names
from . import main as command

SIZE = 512  # of a preset's picture, along its longer side


def run(arguments: argparse.Namespace, progress: Any, say: Callable[[str], None]) -> int:
    """Render what the arguments name; returns the exit code."""
    targeted = arguments.error is not None or arguments.time is not None
    _check(arguments, targeted)
    preset = _preset(arguments)
    engine = arguments.engine or (CYCLES if preset else None)
    name = preset.name if preset else Path(arguments.preset).stem
    out = arguments.out or Path(f"{name}-{engine}.exr" if engine else f"{name}.exr")
    if out.suffix.lower() != ".exr":
        raise ParameterError(f"--out {out} is not allowed; the picture is linear EXR, end the name with .exr")
    from ..blender import converge

    command.make_folder(out.parent)
    checkpoint = converge.checkpoint_path(out.absolute())
    if arguments.force:
        checkpoint.unlink(missing_ok=True)
    subject = _OfPreset(arguments, preset) if preset else _OfBlend(arguments)
    request = {"digest": subject.digest, **{option: getattr(arguments, option) for option in (
        "error", "time", "samples", "round_samples", "max_samples", "denoise", "allocate")}}
    if not arguments.force and (known := _unchanged(out, request)):
        if arguments.json:
            print(json.dumps({**known, "unchanged": True}, indent=2))
        say(f"{out} is unchanged, not rendered again (--force renders it)\n{_told(out, known)}")
        return _code(known)

    def say_over(text: str) -> None:
        progress.clear()
        say(text)

    subject.open()
    figures, image = (_converged if targeted else _sampled)(arguments, subject, checkpoint, progress, say_over)
    figures = {"preset" if preset else "blend": name if preset else str(subject.path), "engine": subject.engine,
               "width": image.shape[1], "height": image.shape[0], "seed": arguments.seed, "exr": str(out),
               "png": str(out.with_suffix(".png")), **figures}
    _write(out, image, subject.exposure, figures, request, subject.files)
    progress.clear()
    if arguments.json:
        print(json.dumps({**figures, "unchanged": False}, indent=2))
    say(_told(out, figures))
    for note in figures.get("notes", ()):
        say(f"  - {note}")
    return _code(figures)


def _check(arguments: argparse.Namespace, targeted: bool) -> None:
    if targeted and arguments.samples is not None:
        raise ParameterError("--samples contradicts --error and --time, from which the samples follow; leave it out, or limit "
                             "them with --max-samples")
    for name in ("round_samples", "max_samples"):
        if not targeted and getattr(arguments, name) is not None:
            raise ParameterError(f"--{name.replace('_', '-')} belongs to --error or --time; give one of them, or --samples")
    if not targeted and not arguments.denoise:
        raise ParameterError("--no-denoise belongs to --error or --time; pictures of so many samples are not denoised")
    if not targeted and not arguments.allocate:
        raise ParameterError("--no-allocate belongs to --error or --time; otherwise all pixels have equally many samples")
    if arguments.round_samples and arguments.max_samples and arguments.round_samples > arguments.max_samples:
        raise ParameterError(f"--round-samples {arguments.round_samples} is above --max-samples {arguments.max_samples}; lower it")


def _preset(arguments: argparse.Namespace) -> Preset | None:
    """The preset with its changes; None for a .blend file."""
    if Path(arguments.preset).suffix.lower() != ".blend":
        if arguments.plan is not None:
            raise ParameterError("--plan is for .blend files; a preset is built by its plan, see volumetrics plan")
        check_names(arguments.without)
        if arguments.frame is not None:
            raise ParameterError("--frame is for .blend files; a preset's time is a parameter, see volumetrics show")
        return command.changed(arguments, load(arguments.preset))
    for group in (*FAMILIES.values(), STAGE):
        for parameter in group.parameters:
            if getattr(arguments, f"{group.name}.{parameter.name}") is not None:
                raise ParameterError(f"{command.option(group, parameter)} is for presets; a .blend file has its own values")
    if arguments.without and arguments.plan is None:
        raise ParameterError("--without switches off rules of --plan; give both for a .blend file")
    if not Path(arguments.preset).is_file():
        raise ParameterError(f"{arguments.preset}: there is no such file; check the path")
    return None


# --- what is rendered -----------------------------------------------------------------------------------------------


class _OfPreset:
    """A preset's picture. ``digest``: of all that determines its pixels but the samples."""

    def __init__(self, arguments: argparse.Namespace, preset: Preset):
        from .. import verify
        from ..blender import identity

        self.arguments, self.source, self.engine = arguments, preset, arguments.engine or CYCLES
        self.exposure = preset.stage["exposure"]
        self.width, self.height = verify.image_size(preset, arguments.size or SIZE)
        known = identity.of_preset(preset, self.engine, self.width, self.height, arguments.seed)
        self.digest = self.pixels = identity.digest(preset=known, without=sorted(arguments.without)) if arguments.without else known
        self.prepare = None
        self.own_samples = command.SAMPLES[self.engine]
        self.files: dict[str, str] = {}
        self.notes: list[str] = []

    def open(self) -> None:
        pass

    def shoot(self, samples: int | None, progress: Callable[[float], None]) -> tuple[Any, float, Any]:
        """Image, seconds and decisions of a picture of so many samples, or of its own."""
        from .. import verify
        from ..blender import render

        samples = samples or self.own_samples
        scene = verify.scene_of(self.source, self.engine, self.width * self.height * samples)
        made = render.render(self.source, scene, self.engine, self.width, self.height, samples, seed=self.arguments.seed,
                             quiet=not self.arguments.engine_output, without=self.arguments.without, progress=progress)
        return made.images[0], made.seconds, made.plan.decisions


class _OfBlend:
    """The picture of a .blend file's active scene. ``digest``: of the file and what is asked of it, known before it is opened;
    ``files``: the files it uses, with their digests; ``pixels``: of all of it."""

    exposure = 0.0

    def __init__(self, arguments: argparse.Namespace):
        from ..blender import identity

        self.arguments, self.path = arguments, Path(arguments.preset).absolute()
        self.engine, self.files, self.pixels = arguments.engine, {}, ""
        self.digest = identity.of_blend(self.path, arguments.engine, arguments.frame, arguments.size, arguments.seed)
        if arguments.plan is not None:
            self.digest = identity.digest(blend=self.digest, plan=arguments.plan, without=sorted(arguments.without))
        self.planned: list[Decision] = []
        self.notes: list[str] = []

    def open(self) -> None:
        """Raises ValueError for a file that Blender cannot open."""
        from ..blender import compat, files, identity, stage

        self.source = files.open_scene(self.path, engine=self.arguments.engine, frame=self.arguments.frame,
                                       quiet=not self.arguments.engine_output)
        self.engine = self.arguments.engine or compat.engine_of(self.source)
        self.width, self.height = stage.size_of(self.source, self.arguments.size)
        self.own_samples = own_samples(self.source, self.engine)
        self.exposure = self.source.view_settings.exposure
        self.files = identity.externals()
        self.pixels = identity.digest(file=self.digest, files=self.files)

    def shoot(self, samples: int | None, progress: Callable[[float], None]) -> tuple[Any, float, Any]:
        import time

        from ..blender import stage

        start = time.perf_counter()
        with stage.of_scene(self.source, self.engine, not self.arguments.engine_output, rounds=False,
                            prepare=self.prepare and (lambda scene: self.prepare(
                                # of a single picture EEVEE's pilot takes as long as what follows saves
                                scene, samples or self.own_samples, pilot=self.engine == CYCLES))) as on:
            image = on.shoot(self.width, self.height, samples or self.own_samples, self.arguments.seed)
        self.notes = [on.missing_shadows] if on.missing_shadows else []
        progress(1.0)
        return image, time.perf_counter() - start, [*self.planned, *on.decisions]

    @property
    def prepare(self) -> Callable[..., None] | None:
        """What applies the plan that was asked for, for a picture of so many samples."""
        return None if self.arguments.plan is None else self._plan

    def _plan(self, scene: Any, samples: int = TYPICAL_ROUND, pilot: bool = False) -> None:
        from ..blender import tuning
        from ..plan.tuning import effect

        tuning.restore(scene)
        advice = tuning.plan(scene, self.arguments.plan, self.arguments.without, samples=samples, pixels=self.width * self.height,
                             pilot=pilot)
        tuning.apply(scene, advice)
        self.own_samples = own_samples(scene, self.engine)  # a rule may have set them
        self.planned = [Decision(found.rule.name, effect(found), found.reason) for found in advice]


def own_samples(scene: Any, engine: str) -> int:
    """What the scene's settings give a picture of it."""
    return scene.cycles.samples if engine == CYCLES else scene.eevee.taa_render_samples


# --- how ------------------------------------------------------------------------------------------------------------


def _sampled(arguments: argparse.Namespace, subject: Any, checkpoint: Path, progress: Any,
             say: Any) -> tuple[dict[str, Any], Any]:
    image, seconds, decisions = subject.shoot(arguments.samples, lambda share: progress(subject.engine, share))
    return {"samples": arguments.samples or subject.own_samples, "seconds": seconds,
            "decisions": [vars(decision) for decision in decisions], "notes": subject.notes}, image


def _converged(arguments: argparse.Namespace, subject: Any, checkpoint: Path, progress: Any,
             say: Any) -> tuple[dict[str, Any], Any]:
    from ..blender import converge

    result = converge.render(
        subject.source, subject.engine, subject.width, subject.height, error=arguments.error, seconds=arguments.time,
        seed=arguments.seed, round_samples=arguments.round_samples, most_samples=arguments.max_samples, checkpoint=checkpoint,
        digest=subject.pixels, prepare=subject.prepare, without=() if arguments.plan is not None else arguments.without,
        denoise=arguments.denoise, allocate=arguments.allocate, quiet=not arguments.engine_output, progress=progress, say=say)
    figures = result.to_json()
    figures["decisions"] = [*map(vars, getattr(subject, "planned", ())), *figures["decisions"]]
    return {"target": {"error": arguments.error, "seconds": arguments.time}, **figures}, result.image


# --- what is kept beside the picture ----------------------------------------------------------------------------------


def _write(out: Path, image: Any, exposure: float, figures: dict[str, Any], request: dict[str, Any],
           files: dict[str, str]) -> None:
    """Picture, preview and figures; each file appears whole or not at all, the figures last."""
    from ..blender import identity, render
    from ..compare.png import write_png
    from ..compare.report import display

    sidecar = out.with_suffix(".json")
    sidecar.unlink(missing_ok=True)  # it is of the picture that is now replaced
    render.write_exr(out.absolute(), image)
    write_png(out.with_suffix(".png"), display(image, exposure))
    with render.whole_file(sidecar) as partial:
        kept = {**figures, "request": request, "files": files, "exr_digest": identity.of_file(out)}
        partial.write_text(json.dumps(kept, indent=2) + "\n", encoding="utf-8")


def _unchanged(out: Path, request: dict[str, Any]) -> dict[str, Any] | None:
    """The figures of the picture that is there, if it is the answer to this very request."""
    from ..blender import identity

    try:
        known = json.loads(out.with_suffix(".json").read_text(encoding="utf-8"))
        if known["request"] == request and known["exr_digest"] == identity.of_file(out) and out.with_suffix(".png").exists() \
                and identity.of_files(known["files"]) == known["files"]:
            return known
    except (OSError, ValueError, KeyError, TypeError):  # there is none, or another command's
        pass
    return None


def _code(figures: dict[str, Any]) -> int:
    return command.OK if figures.get("reached", True) else command.WORSE


def _told(out: Path, figures: dict[str, Any]) -> str:
    """One line on the picture and its error."""
    head = f"{out} and {out.with_suffix('.png').name} ({figures['width']} x {figures['height']}, "
    if "upper_bound" not in figures:
        return f"{head}{figures['samples']} samples, {figures['seconds']:.1f} s)"
    cost = f"{figures['rounds']} x {figures['samples']}" if figures["engine"] == CYCLES else f"{figures['samples']}"
    shared = f" on average, in {len(figures['regions'])} rectangles" if figures.get("regions") else ""
    bias = figures["bias"]
    parts = f"noise {_share(figures['noise'])}"
    if denoised := figures["denoised"]:
        parts = (f"denoised {_share(denoised['value'])}, below {_share(denoised['upper'])} (mean {denoised['mean_change']:+.2%}), of a "
                 f"noise of {_share(figures['noise'])}")
    if bias:
        low, high = bias["interval"]
        seen = f"bias {_share(bias['value'])}" if bias["value"] else "no bias seen"
        parts += (f", {seen}, below {_share(bias['upper'])} (mean {bias['mean']:+.2%} [{low:+.2%}, {high:+.2%}]) against "
                  f"{bias['against']} on {bias['width']} x {bias['height']} pixels")
    return (f"{head}{cost} samples{shared}, {figures['seconds']:.1f} s)\n"
            f"relative RMSE {_share(figures['relative_error'])}, below {_share(figures['upper_bound'])} with "
            f"{figures['confidence']:.0%} confidence: {parts}")


def _share(value: float | None) -> str:
    return "unknown" if value is None or not math.isfinite(value) else f"{value:.2%}" if value >= 1e-3 else f"{value:.2g}"
