# SPDX-License-Identifier: GPL-3.0-or-later
"""Every rule by which something is left out: when it applies, what it costs and what it brings.

RULES are those for a user's own scene, in the order in which they are tried; PRESET_RULES those by which a preset is built;
TARGET_RULES those of a render to an error or within a time.
``share`` weighs the part of the error target that a rule may spend: of what the rules before it have left, its share of theirs
together that are still to come; a rule without one changes no expected value. ``gain`` is the
measured ratio of processor seconds at equal error on the scene named beside it, by engine: ``scripts/bench_plan.py`` for a user's
own scenes. ``switch`` says how a rule of presets is switched off; those of a user's own scene all are by name.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

from .model import CYCLES, EEVEE, ENGINES

LEAST_PIXELS = 1024  # of a picture that is denoised: fewer tell too little of its error
SAME, CLOSER = "same picture", "closer than before"
TARGET = 0.002  # relative error that the rules may add together, where nobody asks for another


@dataclass(frozen=True)
class Rule:
    """One named rule, in words that stand in the panel and on the command line."""

    name: str
    condition: str
    leaves_out: str
    guarantee: str
    engines: tuple[str, ...] = (CYCLES,)
    share: float = 0.0
    gain: Mapping[str, float] = field(default_factory=dict)
    shown_by: str = ""
    switch: str = ""
    effect: str = SAME  # on the picture, beside its bound


RULES = {rule.name: rule for rule in (
    Rule("thin media",
         "a medium's optical depth is next to nothing, or nothing",
         "the medium",
         "its optical depth, times the peak of its phase function for its light: relative to a white surface in the same light",
         engines=ENGINES, share=0.05, gain={CYCLES: 7.1}, shown_by="leftovers"),
    Rule("unseen media",
         "a medium is outside the picture, between no lamp and anything seen, and nothing seen mirrors or refracts; or no light path "
         "from the picture meets it",
         "the medium",
         "(1 - exp(-optical depth)) of the solid angle in which it is seen from what is in the picture; or 3 in as many paths as were "
         "traced, with 95 % confidence",
         engines=ENGINES, share=0.3),
    Rule("unseen lamps",
         "there are several lamps, nothing moves, and no light path from the picture leads to some of them",
         "the lamps that light nothing in the picture",
         "3 in as many tests as were made of such paths, with 95 % confidence, of what the lamps would give without obstacles",
         engines=ENGINES, share=0.5, gain={CYCLES: 5.4}, shown_by="rooms"),
    Rule("idle lamps",
         "a lamp gives a medium next to nothing of its light, or a spot turns away from it",
         "the lamp among the lights of that medium; surfaces keep it",
         "the largest irradiance of these lamps over the least of the others that nothing shades, times the phase function's contrast",
         engines=ENGINES, share=0.05),
    Rule("bounces",
         "the albedo and the optical depth of all media together are bounded",
         "scattering events in media beyond the number that carries the light",
         "(albedo (1 - exp(-optical depth)))^(bounces + 1) of the scattered light, at most",
         share=0.1),
    Rule("sampling",
         "media that have no texture and an optical depth of 4 at most are lit by lamps at points and spots alone; or media are lit by a "
         "sun and by lamps that are farther away than half of their diagonal",
         "of samples by distance and by lamps those that such lamps do not need",
         "unbiased", gain={CYCLES: 1.2}, shown_by="noise-cube"),
    Rule("ray marching",
         "the density is textured, its largest value and its smallest feature are known, the engine has null-scattering, and the picture "
         "is so small or has so few samples that the steps of its rays are fewer than the octree's evaluations",
         "the octree of majorants, built before each picture, and the events that come to nothing",
         "(extinction x step)^2 / 24 of the light, for voxels 1.7 % of extinction x step",
         share=0.25, gain={CYCLES: 8.4}, shown_by="noise-cube, 48 pixels wide"),
    Rule("longer steps",
         "the density is textured, its largest value and its smallest feature are known, and the steps are shorter than these need",
         "steps of ray marching",
         "(extinction x step)^2 / 24 of the light, for voxels 1.7 % of extinction x step",
         share=0.25),
    Rule("sky rays",
         "the world is a procedural texture that changes by no more than its brightest over a radian, and no face of a medium's box lies "
         "in another's or in a surface",
         "rays aimed at the sky, and the map of its brightness that aims them: scattered rays come upon it by themselves",
         "unbiased", gain={CYCLES: 2.8}, shown_by="forest"),
    Rule("light tree",
         "one lamp at most, and a world of one colour or one that no ray is aimed at",
         "the light tree, which costs more than it finds",
         "unbiased", gain={CYCLES: 1.16}, shown_by="bottle"),
    Rule("lamp hits",
         "there are media and several lamps, at points or spots, and nothing mirrors or refracts",
         "rays that come upon such a lamp by chance: few of them, and so bright that they are most of the noise",
         "unbiased: the rays that are aimed at the lamps carry all of their light", gain={CYCLES: 1.6}, shown_by="foggy-street"),
    Rule("sky map",
         "the world is a procedural texture that changes slowly with direction",
         "most of the map of its brightness, made before each picture and looked up for each sample",
         "unbiased", gain={CYCLES: 1.2}, shown_by="forest"),
    Rule("sky probe",
         "the world is of one colour, or a procedural texture that changes by no more than its brightest over a radian, and too dim for "
         "EEVEE to find a sun in it",
         "most of the map of the world's light, which is drawn before each picture",
         "none for a black world; 0.6 % of the world's light for one colour, 1 % for a texture, measured",
         engines=(EEVEE,), share=0.3, gain={EEVEE: 1.6}, shown_by="spot-haze, 48 pixels wide"),
    Rule("sky shadows",
         "the world is too dim for EEVEE to find a sun in it",
         "the shadow maps of that sun, which are drawn all the same",
         "the picture is the same",
         engines=(EEVEE,), gain={EEVEE: 1.2}, shown_by="cathedral, 48 pixels wide"),
    Rule("guiding",
         "nothing scatters more than once",
         "path guiding",
         "unbiased"),
    Rule("noise threshold",
         "adaptive sampling is on, a pilot of a 64th of the samples at most was rendered, which no octree makes slow, and by its noise "
         "the threshold is too low for the samples to reach it, and three tenths of the picture are less noisy than the rest",
         "samples of pixels that have less noise than the picture, by a higher threshold of adaptive sampling",
         "a fifth more noise at most; the mean stays within 0.05 %, measured",
         effect="a fifth more noise at most", gain={CYCLES: 1.2}, shown_by="spot-haze, 256 samples, 96 pixels wide"),
    Rule("froxels",
         "a medium is seen, the cells of the screen that EEVEE keeps it in would not be too many if they were finer, in the picture and "
         "in the viewport, and nothing is blurred, traced or lets light through; above 960 x 540 pixels a pilot was rendered too, "
         "camera and lamps stand still, and shadows have memory",
         "samples: cells that are a half, a quarter or an eighth as wide are closer with a quarter or an eighth of them",
         "closer than before to what ever finer cells and more samples come to, measured: on all scenes of the benchmark 48 pixels wide, "
         "at 480 pixels not where edges need the samples (cathedral 4 % instead of 3 %), which a pilot tells",
         engines=(EEVEE,), effect=CLOSER, gain={EEVEE: 4.0}, shown_by="foggy-street, 48 pixels wide"),
    Rule("passes",
         "a pass is rendered that neither the compositor nor the file has use for",
         "the pass",
         "the picture is the same",
         engines=ENGINES),
    Rule("persistent data",
         "more than one frame is rendered",
         "loading the scene again for every frame, in exchange for memory",
         "the picture is the same"),
)}

TARGET_RULES = {rule.name: rule for rule in (
    Rule("denoising",
         f"an error or a time is asked for, the picture has {LEAST_PIXELS} pixels, and its noise alone misses the target",
         "samples: each half of the rounds is denoised, the picture is their mean",
         "measured, with 95 % confidence: each is compared with the other half, and taken only where it is closer",
         gain={CYCLES: 2.8}, shown_by="foggy-street, 160 pixels wide", switch="--no-denoise"),
    Rule("allocation",
         "an error or a time is asked for, the picture takes ten seconds or more, and a pilot tells that its noise is in few places",
         "samples where there is little noise: a round is rendered in rectangles with samples of their own",
         "unbiased: the pilot's random numbers are not the picture's; taken where it gains 1.2 in measured seconds",
         gain={CYCLES: 2.2}, shown_by="foggy-street, 160 pixels wide", switch="--no-allocate"),
)}

BY_NAME = "--without"
PRESET_RULES = {rule.name: rule for rule in (
    Rule("compositor fog",
         "the scene has nothing of a fog but what its depth tells, by an estimate along rays",
         "the volume; a pass of the compositor stands for it",
         "0.2 % of the mean in Cycles, 5 % in EEVEE", engines=ENGINES, switch="--fog.realisation volume"),
    Rule("channels apart",
         "lobes of different colours mix in one medium",
         "nothing: three renders in grey",
         "exact, where the engines mix the lobes by their mean", engines=ENGINES, switch=BY_NAME),
    Rule("octaves",
         "the preset's scattering is by octaves",
         "orders of scattering beyond a dozen",
         "-11 % to -17 % where the optical depth is above 10, 2 % where clouds are thin",
         gain={CYCLES: 5.3}, shown_by="cumulus", switch="--cloud.scattering full"),
    Rule("bounces",
         "always",
         "events beyond the orders that the stage follows, and interfaces beyond 64",
         "the picture is the same", switch="--stage.orders N"),
    Rule("ray marching",
         "the medium is heterogeneous, and the engine has null-scattering",
         "the octree of majorants, and the events that come to nothing",
         "0.2 %, measured for each kind of density", gain={CYCLES: 9.6}, shown_by="morning-valley", switch=BY_NAME),
    Rule("null-scattering",
         "the medium is a fog, and the picture has more camera paths than those from which its octree pays",
         "steps of ray marching",
         "unbiased: +0.09 % [-0.04 %, +0.22 %] on morning-valley", gain={CYCLES: 2.1}, shown_by="morning-valley", switch=BY_NAME),
    Rule("representation",
         "the density is noise",
         "evaluations of noise at every step, where voxels are quicker to bake and look up",
         "what voxels lose is the reference's too", gain={CYCLES: 18.8}, shown_by="cumulus", switch="--cloud.representation procedural"),
    Rule("voxels",
         "the density is baked",
         "noise in the engine",
         "what voxels lose is the reference's too", switch="--cloud.representation procedural"),
    Rule("analytic path",
         "the medium is homogeneous",
         "steps and octrees: free paths have a closed form",
         "the picture is the same"),
    Rule("screen tracing",
         "nothing refracts",
         "EEVEE's ray tracing in screen space",
         "the picture is the same", engines=(EEVEE,), switch=BY_NAME),
    Rule("light enclosure",
         "a lamp of EEVEE stands beside a medium",
         "nothing: an empty volume is added",
         "shadows of the medium on itself, else 24 % too dark or 17 % too bright", engines=(EEVEE,), switch=BY_NAME),
    Rule("dimmed light",
         "lamps or the sky of EEVEE shine through media onto what the picture shows",
         "the light that the media take on its way, as a share of each lamp's and the sky's light",
         "exact in the mean of each light, not in its pattern: 2 % to 5 % instead of 10 % to 60 %", engines=(EEVEE,), switch=BY_NAME),
    Rule("unit of length",
         "a coefficient is below 1e-4 per metre in EEVEE",
         "nothing: the scene is built smaller",
         "what 11-bit floats lose, 5 % and more", engines=(EEVEE,), switch=BY_NAME),
    Rule("baked light",
         "EEVEE scatters once, and the scene follows more orders",
         "EEVEE's own scattering",
         "-1 % to +6 % instead of -48 % to 0 %", engines=(EEVEE,), switch="--cloud.eevee-light scatter"),
)}
