# SPDX-License-Identifier: GPL-3.0-or-later
"""The whole street: a preset is rendered, compared with its reference, and its error stated."""

from __future__ import annotations

import json
from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from .blender import compat, render
from .blender.text import text_mask
from .compare.png import write_png
from .compare.report import report_picture
from .compare.statistics import Comparison, Estimate, compare
from .parameters.preset import Preset
from .plan.model import CYCLES, EEVEE
from .plan.rules import bakes_light, compositor_loss_allowed, eevee_lights, is_baked, light_resolution
from .reference import depth_air, depth_fog, light_balance
from .reference.depth_air import SLICES
from .reference.result import Result
from .reference.select import integrator
from .scene import assemble
from .scene.bake import voxelized
from .scene.model import ExponentialAltitude, Phase, Scene

# Default tolerances of the mean relative error; EEVEE approximates, so its error is stated and by default not judged.
TOLERANCE = {CYCLES: 0.005, EEVEE: None}
REPEATS = 8
MANY_PATHS = 1e9  # of the camera: what is done once no longer counts
REFERENCE_SAMPLES = 16


@dataclass(frozen=True)
class Verification:
    """One preset, one engine, one stated error."""

    preset: Preset
    engine: str
    comparison: Comparison
    render: np.ndarray
    reference: Result
    render_seconds: float
    samples: int
    repeats: int
    notes: tuple[str, ...]

    def passes(self, tolerance: float | None) -> bool:
        """Whether the mean relative error is within the tolerance; Cycles' pixels have to pass the Z-test too."""
        if tolerance is None:
            return True
        if self.engine == CYCLES:
            return self.comparison.passes(tolerance)
        error = self.comparison.mean_relative_error
        return error is not None and abs(error) <= tolerance

    def to_json(self) -> dict:
        import bpy

        return {
            "preset": self.preset.name,
            "family": self.preset.family,
            "engine": self.engine,
            "blender": bpy.app.version_string,
            "width": self.render.shape[1],
            "height": self.render.shape[0],
            "samples": self.samples,
            "repeats": self.repeats,
            "render_seconds": round(self.render_seconds, 3),
            "reference": {
                "integrator": self.reference.integrator,
                "seconds": round(self.reference.seconds, 3),
                "evaluations": self.reference.evaluations,
                "systematic_error": self.reference.systematic,
            },
            "comparison": self.comparison.to_json(),
            "notes": list(self.notes),
        }


def scene_of(preset: Preset, engine: str = CYCLES, paths: float = MANY_PATHS) -> Scene:
    """The preset's Scene as the engine shows it in a picture of so many camera paths.

    Noise is in voxels, or as Blender evaluates it; fog is a volume, or made in the compositor where that loses little.
    """
    scene = assemble.scene(preset.family, preset.parameters, preset.stage, preset.props)
    if preset.parameters.get("realisation") == "automatic" and scene.depth_fog is None and _composites(scene, preset.family, engine):
        scene = replace(scene, depth_fog=assemble.depth_fog(preset.family, preset.parameters))
    return replace(scene, volumes=tuple(
        voxelized(volume, preset.parameters["resolution"]) if is_baked(preset.parameters, volume, engine, paths)
        else compat.as_evaluated(volume) for volume in scene.volumes))


def _composites(scene: Scene, family: str, engine: str) -> bool:
    """Whether the compositor loses less than the engine's volume: for fog by an estimate, for air by what was measured.

    EEVEE's volume of air is 17 % to 58 % too dark, the compositor 2 % to 8 % (clear skies).
    """
    if family == "air":
        return engine == EEVEE and not depth_air.applies(scene)
    if engine == CYCLES and max(scene.environment) > 0.0:
        return False  # the sky's light is sampled: an estimate below what Cycles allows would take minutes
    return depth_fog.loss(scene) <= compositor_loss_allowed(engine)


def image_size(preset: Preset, size: int) -> tuple[int, int]:
    """Width and height of a picture whose longer side is ``size``, at the stage's aspect."""
    aspect = preset.stage["aspect"]
    width, height = (size, size / aspect) if aspect >= 1.0 else (size * aspect, size)
    return max(1, round(width)), max(1, round(height))


def reference_of(scene: Scene, width: int, height: int, *, repeats: int = 8, samples: int = REFERENCE_SAMPLES, seed: int = 1,
                 progress: Callable[[float], None] | None = None) -> Result:
    """The best reference image of the scene, with its error; about ``samples`` stratified rays per pixel and repeat."""
    strata = max(1, round(samples**0.5))
    return integrator(scene).render(scene, width, height, repeats=repeats, strata=strata, seed=seed, progress=progress)


def verify(preset: Preset, engine: str, size: int, samples: int, *, repeats: int = REPEATS, seed: int = 0,
           reference_samples: int = REFERENCE_SAMPLES, reference_repeats: int = REPEATS,
           reference: Result | None = None, confidence: float = 0.95, quiet: bool = True,
           progress: Callable[[str, float], None] | None = None) -> Verification:
    """Render the preset, compare it with its reference and state the error."""
    report = progress or (lambda stage, share: None)
    width, height = image_size(preset, size)
    scene = scene_of(preset, engine, width * height * samples * repeats)
    rendered = render.render(preset, scene, engine, width, height, samples, repeats=repeats, seed=seed, quiet=quiet,
                             progress=lambda share: report(engine, share))
    if reference is None:
        reference = reference_of(scene, width, height, repeats=reference_repeats, samples=reference_samples,
                                 progress=lambda share: report("reference", share))
    count = len(rendered.images)
    measured = Estimate.from_repeats(rendered.images, samples) if count > 1 else Estimate.exact(rendered.images[0])
    comparison = compare(measured, Estimate.from_repeats(reference.repeats, independent_pixels=True),
                         confidence)
    return Verification(preset, engine, comparison, rendered.images.mean(axis=0), reference, rendered.seconds, samples,
                        count, tuple(explain(scene, engine, preset)))


def explain(scene: Scene, engine: str, preset: Preset) -> list[str]:
    """Why an engine's error is what it is, in the engine's own terms."""
    if scene.depth_fog is not None:
        if any(isinstance(volume.medium.density, ExponentialAltitude) for volume in scene.volumes):
            return [f"the air is made in the compositor: {SLICES} slices along each ray, bodies cast no shadow into it"]
        return ["the fog is made in the compositor: no shafts, and no light through its sides"] if scene.depth_fog.is_physical else []
    if engine == CYCLES:
        return []
    notes = []
    if any(volume.sheet for volume in scene.volumes):
        notes.append("EEVEE blends panes over what is behind: they mirror the world alone, and their shadows are grey")
    elif scene.is_dielectric:
        notes.append("EEVEE traces refraction in screen space; reflections inside the body come from closed forms")
    elif any(volume.medium.scatters for volume in scene.volumes):
        baked = [bool(bakes_light(scene, volume, preset.parameters)) for volume in scene.volumes]
        if all(baked):
            notes.append("EEVEE stores the medium in froxels of 11-bit floats")
            voxels = max(light_resolution(volume, preset.parameters) for volume in scene.volumes)
            notes.append(f"EEVEE shows all orders of scattering as light baked on {voxels} voxels")
        else:
            notes.append("EEVEE stores the medium in froxels of 11-bit floats and marches shadows through them")
        if scene.orders > 1 and not all(baked):
            notes.append(f"EEVEE scatters once where the scene follows {scene.orders} orders")
        phases = {volume.medium.phase for volume in scene.volumes}
        one_lobe = len(phases) == 1 and all(isinstance(phase, Phase) and phase.weight == 0.0 for phase in phases)
        if not one_lobe and not all(baked):
            notes.append("EEVEE has one HG lobe, here with the mean cosine of the phase function")
        if note := eevee_lights(scene.lights):
            notes.append(note)
        if any(baked) or preset.parameters.get("eevee_light") == "scatter" or light_balance.applies(scene):
            if scene.surfaces:
                notes.append("EEVEE does not dim the light that reaches surfaces through the medium")
            if max(scene.environment) > 0.0 and not all(baked):
                notes.append("EEVEE lights the medium from the environment without shadow")
        else:
            notes.append("EEVEE does not dim light on its way to surfaces, nor the sky's: lamps and sky have the share that arrives, one "
                         "for the whole picture")
    return notes


def write(verification: Verification, folder: Path) -> dict[str, Path]:
    """EXR of render and reference, report picture and JSON in ``folder``; each file appears whole or not at all."""
    stem = f"{verification.preset.name}-{verification.engine}"
    paths = {kind: folder / name for kind, name in (
        ("render", f"{stem}.exr"), ("reference", f"{verification.preset.name}-reference.exr"),
        ("report", f"{stem}.png"), ("json", f"{stem}.json"))}
    folder.mkdir(parents=True, exist_ok=True)
    render.write_exr(paths["render"], verification.render)
    render.write_exr(paths["reference"], verification.reference.image)
    write_png(paths["report"], picture(verification))
    with render.whole_file(paths["json"]) as partial:
        partial.write_text(json.dumps(verification.to_json(), indent=2) + "\n", encoding="utf-8")
    return paths


def picture(verification: Verification) -> np.ndarray:
    """Render, reference and signed error side by side with the numbers."""
    import bpy

    preset = verification.preset
    lines = [
        f"{'Cycles' if verification.engine == CYCLES else 'EEVEE'}, Blender {bpy.app.version_string}, "
        f"{verification.repeats} x {verification.samples} samples in {verification.render_seconds:.1f} s",
        f"reference: {verification.reference.integrator.replace('_', ' ')} in {verification.reference.seconds:.1f} s",
        *verification.notes,
    ]
    return report_picture(verification.render, verification.reference.image, verification.comparison, preset.label, lines,
                          text_mask, preset.stage["exposure"])
