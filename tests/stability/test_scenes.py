# SPDX-License-Identifier: GPL-3.0-or-later
"""Every integrator on every scene at the limits: an image without NaN, or a reason. No warning either way."""

import numpy as np
import pytest

from volumetrics_addon.reference import select, single_scattering

from .cases import count
from .scenes import SCENES, light_on_axis

SIZE = 3
# By default an integrator gets one scene in so many, others than the next one, and all those that only some can take.
SHARE = 4
ALWAYS = ("ordinary", "glass", "slab", "fog", "planet")


# Integrators with compiled sums, as they are without numba: further keywords of render.
TWINS = {"single_scattering in NumPy": {}, "path_tracing in NumPy": {"kernel": "numpy"}}
RENDERED = (*select.NAMES, *TWINS)
# Refused, see test_path_tracing: its free flights are as short as the medium is dense anywhere in its domain.
ENDLESS = {("path_tracing in NumPy", "steep height fog"), ("path_tracing in NumPy", "fog of extinction 1e30")}


@pytest.fixture(autouse=True)
def twin(request, monkeypatch):
    if request.node.callspec.params.get("name") in TWINS:
        monkeypatch.setattr(single_scattering, "kernel_of", lambda scene: None)


def module_of(name):
    return select.load(name.split(" ")[0])


def render(name, scene, setting):
    module = module_of(name)
    return module.render(scene, SIZE, SIZE, strata=0, repeats=2, **module.SETTINGS[setting], **TWINS.get(name, {}))


def assert_stable(name, scene, setting):
    """Elements asserted: image and error, or the refusal."""
    module = module_of(name)
    reason = module.applies(scene)
    if reason:
        assert len(reason) > 10
        with pytest.raises(ValueError) as caught:
            render(name, scene, setting)
        assert reason in str(caught.value)
        return 1
    result = render(name, scene, setting)
    image, error = result.image, result.error_estimate
    assert image.shape == error.shape == (SIZE, SIZE, 3)
    assert not np.isnan(image).any() and not np.isnan(error).any(), (image, error)
    assert (image >= 0).all() and (error >= 0).all()
    finite = np.isfinite(image) & np.isfinite(error)
    if light_on_axis(scene):
        # Sampled, the value is finite by chance, and its error knows no bound.
        finite[SIZE // 2, SIZE // 2] = True
    else:
        assert np.isfinite(result.systematic)
    assert finite.all(), (image, error)
    return image.size + error.size


def share_of(name):
    first = RENDERED.index(name)
    scenes = [scene for i, scene in enumerate(SCENES) if (i + first) % SHARE == 0 or scene.startswith(ALWAYS)]
    return [scene for scene in scenes if (name, scene) not in ENDLESS]


@pytest.mark.parametrize("name, scene", [(name, scene) for name in RENDERED for scene in share_of(name)])
def test_scene(name, scene):
    count("scenes", name.split(" ")[0], assert_stable(name, SCENES[scene], 0))


@pytest.mark.sweep
@pytest.mark.parametrize("setting", (0, 1))
@pytest.mark.parametrize("scene", SCENES)
@pytest.mark.parametrize("name", RENDERED)
def test_every_scene(name, scene, setting):
    if (name, scene) in ENDLESS:
        pytest.skip("refused")
    count("scenes", name.split(" ")[0], assert_stable(name, SCENES[scene], setting))


@pytest.mark.parametrize("name", RENDERED)
def test_every_integrator_renders_some_of_them(name):
    """Nothing is covered by refusals alone."""
    assert len(SCENES) > 140
    assert sum(not module_of(name).applies(SCENES[scene]) for scene in share_of(name)) >= 4
