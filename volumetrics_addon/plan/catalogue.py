# SPDX-License-Identifier: GPL-3.0-or-later
"""Every rule by which something is left out of a user's own scene: when it applies, what it costs and what it brings.

``share`` is the part of the error target that a rule may spend; a rule without one changes no expected value. ``gain`` is the
measured ratio of processor seconds at equal error on the scene named beside it (``scripts/bench_plan.py``), by engine.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

from .model import CYCLES, ENGINES

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
    by_default: bool = True


RULES = {rule.name: rule for rule in (
    Rule("thin media",
         "a medium's optical depth is next to nothing, or nothing",
         "the medium",
         "its optical depth, times the peak of its phase function for its light: relative to a white surface in the same light",
         engines=ENGINES, share=0.05),
    Rule("unseen media",
         "a medium is outside the picture, between no lamp and anything seen, and nothing seen mirrors or refracts",
         "the medium",
         "(1 - exp(-optical depth)) of the solid angle in which it is seen from what is in the picture",
         engines=ENGINES, share=0.3),
    Rule("idle lamps",
         "a lamp gives a medium next to nothing of its light, or a spot turns away from it",
         "the lamp among the lights of that medium; surfaces keep it",
         "the largest irradiance of these lamps over the least of the others that nothing shades, times the phase function's contrast",
         engines=ENGINES, share=0.15),
    Rule("bounces",
         "the albedo and the optical depth of all media together are bounded",
         "scattering events in media beyond the number that carries the light",
         "(albedo (1 - exp(-optical depth)))^(bounces + 1) of the scattered light, at most",
         share=0.15),
    Rule("sampling",
         "a medium is lit by lamps alone and scatters once, or its world samples by the lamps alone",
         "the technique that the medium's lights do not need",
         "unbiased"),
    Rule("ray marching",
         "the density is textured, its largest value and its smallest feature are known, and the engine has null-scattering",
         "the octree of majorants, built before each picture, and the events that come to nothing",
         "(extinction x step)^2 / 24 of the light, for voxels 1.7 % of extinction x step",
         share=0.35),
    Rule("longer steps",
         "the density is textured, its largest value and its smallest feature are known, and the steps are shorter than these need",
         "steps of ray marching",
         "(extinction x step)^2 / 24 of the light, for voxels 1.7 % of extinction x step",
         share=0.35),
    Rule("light tree",
         "at most two lamps",
         "the light tree, which costs more than it finds",
         "unbiased"),
    Rule("guiding",
         "nothing scatters more than once",
         "path guiding",
         "unbiased"),
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
