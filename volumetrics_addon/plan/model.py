# SPDX-License-Identifier: GPL-3.0-or-later
"""A plan: engine settings and what is left out, each decision with its reason."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any

CYCLES, EEVEE = "cycles", "eevee"
ENGINES = (CYCLES, EEVEE)
BLACK_PROBE = 128  # width of EEVEE's map of a black world, the narrowest there is: any gives the same picture


@dataclass(frozen=True)
class Decision:
    """One named rule that applied, and why."""

    rule: str
    effect: str
    reason: str


@dataclass
class Plan:
    """Settings by path below the Blender scene, settings of each body's material, and the decisions behind them.

    ``unit``: metres in one unit of the Blender scene. ``channels_apart``: red, green and blue are three renders in grey.
    ``compositor_fog``: the media are no volumes but a pass of the compositor. ``without``: rules that are switched off.
    """

    engine: str
    samples: int
    settings: dict[str, Any] = field(default_factory=dict)
    volume_settings: list[dict[str, Any]] = field(default_factory=list)
    decisions: list[Decision] = field(default_factory=list)
    light_enclosure: bool = False
    unit: float = 1.0
    channels_apart: bool = False
    compositor_fog: bool = False
    without: frozenset[str] = frozenset()

    def may(self, rule: str) -> bool:
        """Whether the rule is switched on."""
        return rule not in self.without

    def decide(self, rule: str, effect: str, reason: str) -> None:
        self.decisions.append(Decision(rule, effect, reason))
