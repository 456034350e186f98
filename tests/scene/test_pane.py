# SPDX-License-Identifier: GPL-3.0-or-later
"""What covers a pane: its share of the area, its edges, and the hues of the cells."""

import colorsys
import math
from dataclasses import replace

import numpy as np
import pytest

from volumetrics_addon.parameters.families import FAMILIES
from volumetrics_addon.scene import assemble, pane
from volumetrics_addon.scene.model import Box, Cover, Dielectric, Ellipsoid, Medium, Sheet, Volume

ALBEDO = (0.1, 0.1, 0.1)
DARK = Medium((0.0, 0.0, 0.0), (100.0, 20.0, 300.0))


def plane(cover, width=1.0, height=0.6):
    return Volume(Box((0.0, 0.0, 0.0), (width / 2.0, 0.0, height / 2.0)), DARK, Dielectric(1.5), sheet=Sheet(0.004, cover))


def points(count=300, width=1.0, height=0.6):
    x, z = np.meshgrid((np.arange(count) + 0.5) / count - 0.5, (np.arange(count) + 0.5) / count - 0.5)
    return np.stack([x.ravel() * width, np.zeros(count * count), z.ravel() * height], axis=1)


@pytest.mark.parametrize("pattern", ["dirt", "lead"])
@pytest.mark.parametrize("coverage", [0.0, 0.07, 0.3, 0.8, 1.0])
@pytest.mark.parametrize("softness", [0.0, 1.0])
def test_the_covered_share_is_the_coverage(pattern, coverage, softness):
    """Between pixel centres the ranks are interpolated; that moves the share by less than 0.01."""
    share, _ = pane.looked_up(plane(Cover(pattern, coverage, ALBEDO, 0.1, softness)), points())
    assert share.min() >= 0.0 and share.max() <= 1.0
    assert share.mean() == pytest.approx(coverage, abs=0.01)


def test_ranks_are_even_and_repeat():
    values = pane.picture(Cover("dirt", 0.5, ALBEDO, 0.2, seed=4), 1.0, 0.5)[..., 0]
    counts = np.histogram(values, 10, (0.0, 1.0))[0]
    assert counts.max() - counts.min() <= 2
    assert (pane.picture(Cover("dirt", 0.5, ALBEDO, 0.2, seed=5), 1.0, 0.5)[..., 0] != values).any()


def test_soft_dirt_is_the_ramp_by_hand():
    cover = Cover("dirt", 0.25, ALBEDO, softness=0.8)  # w = 2 * 0.8 * 0.25 = 0.4: opaque up to 0.05, clear from 0.45
    assert pane.share(cover, np.array([0.0, 0.05, 0.15, 0.25, 0.35, 0.45, 1.0])) == pytest.approx([1, 1, 0.75, 0.5, 0.25, 0, 0])


def test_lead_runs_between_cells_and_around_the_pane():
    """At the edge of the pane there is lead; within a cell its number is one, and leads have about equal width."""
    cover = Cover("lead", 0.2, ALBEDO, 0.25, variation=0.5)
    volume = plane(cover)
    rim = np.array([[-0.4999, 0.0, 0.1], [0.4999, 0.0, -0.2], [0.1, 0.0, 0.2999], [0.2, 0.0, -0.2999]])
    assert (pane.looked_up(volume, rim)[0] == 1.0).all()
    values = pane.picture(cover, 1.0, 0.6)
    clear = values[..., 0] > 0.2
    # Neighbouring pixels that are both clear are of one cell.
    across = clear[:, 1:] & clear[:, :-1]
    assert across.any() and (values[:, 1:, 1] == values[:, :-1, 1])[across].all()
    assert len(np.unique(values[clear][:, 1])) >= 4 * 2


def test_absorption_turns_about_grey():
    """A third of a turn moves red to green; no variation leaves it; the sum over channels stays where nothing is cut off."""
    sigma = np.array([3.0, 1.0, 1.5])
    third = pane.turned_absorption(sigma, 1.0, np.array([0.5 + 1.0 / 3.0]))
    assert third[0] == pytest.approx([1.5, 3.0, 1.0])
    assert pane.turned_absorption(sigma, 0.0, np.array([0.1, 0.9])) == pytest.approx(np.array([sigma, sigma]))
    small = pane.turned_absorption(sigma, 0.2, np.linspace(0.0, 1.0, 7))
    assert small.sum(axis=1) == pytest.approx(np.full(7, 5.5)) and (small >= 0.0).all()
    hues = [colorsys.rgb_to_hsv(*np.exp(-row))[0] for row in pane.turned_absorption(sigma, 1.0, np.linspace(0.0, 1.0, 24, False))]
    assert np.ptp(hues) > 0.8


def test_too_many_cells_are_refused():
    with pytest.raises(ValueError, match="coverage_size = 0.001 m is too small for a pane of 1 m.* at least 0.00781 m"):
        plane(Cover("lead", 0.1, ALBEDO, 0.001))


def test_a_pane_is_a_plane_across_its_smallest_size():
    make = assemble.ASSEMBLERS["glass"]
    for size, half in (((2.0, 0.1, 3.0), (1.0, 0.0, 1.5)), ((2.0, 3.0, 0.1), (1.0, 1.5, 0.0)),
                       ((1.0, 1.0, 1.0), (0.5, 0.0, 0.5))):
        volume, = make(FAMILIES["glass"].check({"shape": "sheet", "size": list(size), "thickness": 0.004})).volumes
        assert volume.domain.half == half and volume.sheet == Sheet(0.004) and volume.boundary == Dielectric(1.5)
    dirty, = make(FAMILIES["glass"].check({"shape": "sheet", "coverage_pattern": "dirt", "coverage": 0.2})).volumes
    with pytest.raises(ValueError, match="coverage_size = 0.001 m is too small for a pane of 2 m"):
        make(FAMILIES["glass"].check({"shape": "sheet", "size": [2.0, 0.1, 1.0], "coverage_pattern": "lead",
                                      "coverage_size": 1e-3}))
    assert dirty.sheet.cover == Cover("dirt", 0.2, (0.03, 0.03, 0.035), 0.05, softness=0.5)


def test_what_is_no_pane_is_refused():
    good = plane(None)
    for domain in (Box((0, 0, 0), (1.0, 1.0, 1.0)), Ellipsoid((0, 0, 0), (1.0, 1.0, 1.0))):
        with pytest.raises(ValueError, match="one half size is 0"):
            replace(good, domain=domain)
    with pytest.raises(ValueError, match="only a homogeneous medium that absorbs may be a pane"):
        replace(good, medium=Medium((1.0, 1.0, 1.0), (0.0, 0.0, 0.0)))
    assert math.isclose(pane.size_of(good)[0], 1.0)
