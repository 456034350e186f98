# SPDX-License-Identifier: GPL-3.0-or-later
"""Text that Blender draws, for reports."""

import numpy as np
import pytest

bpy = pytest.importorskip("bpy")

from volumetrics_addon.blender.text import text_mask  # noqa: E402


def test_text_is_drawn_inside_its_mask():
    mask = text_mask("ÅÉ|gjpq_ −0.43 %", 20)
    assert mask.shape[0] == 29
    assert mask.min() == 0.0 and 0.9 < mask.max() <= 1.0
    assert 0.05 < mask.mean() < 0.4
    # Nothing touches the border, so nothing is cut off.
    assert (
        not mask[0].any() and not mask[-1].any() and not mask[:, 0].any() and not mask[:, -1].any()
    )


def test_text_stands_upright_on_its_baseline():
    mask = text_mask("L", 40)
    rows = np.flatnonzero(mask.max(axis=1) > 0.5)
    # The foot of an L is its widest row and stands 0.35 sizes above the lower edge.
    assert rows[-1] == mask.shape[0] - 15
    assert np.argmax(mask.sum(axis=1)) > rows.mean()
    assert np.argmax(mask.sum(axis=0)) < mask.shape[1] / 2


def test_text_grows_with_its_length_and_size():
    assert text_mask("mm", 20).shape[1] > 1.5 * text_mask("m", 20).shape[1]
    assert text_mask("m", 40).shape[1] > 1.5 * text_mask("m", 20).shape[1]
    assert not text_mask("", 20).any()


def test_symbols_of_the_report_have_glyphs():
    missing = text_mask("\ue000", 30)
    for symbol in "−±×·…⁻⁰¹²³⁴⁵⁶⁷⁸⁹∞":
        assert not np.array_equal(text_mask(symbol, 30), missing), symbol
        assert text_mask(symbol, 30).any(), symbol


def test_text_leaves_no_datablock():
    def counts():
        return {
            name: len(getattr(bpy.data, name))
            for name, prop in bpy.data.bl_rna.properties.items()
            if prop.type == "COLLECTION"
        }

    before = counts()
    assert before["images"] >= 0 and len(before) > 20
    text_mask("text", 20)
    assert counts() == before


def test_text_refuses():
    with pytest.raises(ValueError, match="one line"):
        text_mask("two\nlines", 20)
    with pytest.raises(ValueError, match="size_px must be > 0, got 0"):
        text_mask("text", 0)
