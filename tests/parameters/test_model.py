# SPDX-License-Identifier: GPL-3.0-or-later
"""Declarations: what is accepted, what is refused, and that every declared parameter is complete."""

import math
from dataclasses import replace

import pytest
from hypothesis import given
from hypothesis import strategies as st

from volumetrics_addon.parameters.families import FAMILIES
from volumetrics_addon.parameters.model import KINDS, Group, Parameter, ParameterError, shown
from volumetrics_addon.parameters.stage import PROP, STAGE

FLOAT = Parameter("density", "float", 1.0, "A number.", unit="1/m", minimum=0.0, maximum=5.0)
OPEN = Parameter("distance", "float", 1.0, "Above nought.", unit="m", minimum=0.0, exclusive_minimum=True)
FREE = Parameter("offset", "float", 0.0, "Any number.")
INT = Parameter("seed", "int", 0, "A whole number.", minimum=0, maximum=99)
BOOL = Parameter("refraction", "bool", True, "Yes or no.")
CHOICE = Parameter("domain", "choice", "box", "One of two.", choices=(("box", "Box"), ("cone", "Cone")))
COLOR = Parameter("albedo", "color", (1.0, 1.0, 1.0), "A colour.", minimum=0.0, maximum=1.0)
VECTOR = Parameter("size", "vector", (1.0, 1.0, 1.0), "A size.", unit="m", minimum=0.1, maximum=1e6)
TEXT = Parameter("label", "text", "", "A name.", maximum=10)
PATH = Parameter("image", "path", "", "A file.", maximum=30)
EVERY_KIND = (FLOAT, INT, BOOL, CHOICE, COLOR, VECTOR, TEXT, PATH)

GROUPS = (*FAMILIES.values(), STAGE, PROP)
DECLARED = [pytest.param(group, parameter, id=f"{group.name}.{parameter.name}")
            for group in GROUPS for parameter in group.parameters]

# Ratios, cosines and exponents: no unit belongs to them.
DIMENSIONLESS = {"g", "g_back", "lobe_weight", "mie_g", "octave_extinction", "octave_phase", "octave_contribution", "fill", "softness", "base",
                 "noise_detail", "noise_roughness", "noise_strength", "billow_strength", "billow_roughness", "stretch", "evolution",
                 "cutoff", "ior", "strength", "coverage", "coverage_softness", "color_variation", "blend", "blocker_fill", "gobo_softness",
                 "gobo_scale", "max_opacity", "edge", "aspect", "dust_strength"}

HUGE = 10**400  # beyond float
ENDLESS = 1 << 20000  # beyond what Python writes in decimal


def test_every_kind_is_exercised():
    assert sorted(parameter.kind for parameter in EVERY_KIND) == sorted(KINDS)


# --- accepted -------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(("parameter", "value", "canonical"), [
    (FLOAT, 2, 2.0), (FLOAT, 0, 0.0), (FLOAT, 5.0, 5.0), (FLOAT, 5e-324, 5e-324),
    (OPEN, 5e-324, 5e-324), (FREE, -1e308, -1e308),
    (INT, 0, 0), (INT, 99, 99),
    (BOOL, False, False), (CHOICE, "cone", "cone"), (TEXT, "ten letters"[:10], "ten letter"), (TEXT, "", ""),
    (COLOR, [0, 1, 0.5], (0.0, 1.0, 0.5)), (COLOR, (1, 1, 1), (1.0, 1.0, 1.0)), (VECTOR, [0.1, 1e6, 1], (0.1, 1e6, 1.0)),
])
def test_canonical_form(parameter, value, canonical):
    result = parameter.check(value)
    assert result == canonical and type(result) is type(canonical)
    if isinstance(canonical, tuple):
        assert all(type(component) is float for component in result)
    assert parameter.check(result) == result


@pytest.mark.parametrize(("parameter", "word", "value"), [
    (FLOAT, "2.5", 2.5), (FLOAT, "1e-3", 1e-3), (FLOAT, " 3 ", 3.0), (INT, "7", 7),
    (BOOL, "true", True), (BOOL, "False", False), (CHOICE, "cone", "cone"), (TEXT, "fog", "fog"),
    (PATH, "/a/b.png", "/a/b.png"), (PATH, "", ""),
    (COLOR, "0.1,0.2,0.3", (0.1, 0.2, 0.3)), (COLOR, "0, 1 ,1e-2", (0.0, 1.0, 0.01)), (VECTOR, "1,2,3", (1.0, 2.0, 3.0)),
])
def test_words_of_the_command_line(parameter, word, value):
    result = parameter.parse(word)
    assert result == value and type(result) is type(value)


def test_a_file_on_the_command_line_is_relative_to_the_working_directory(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    assert PATH.check("b.png") == "b.png"
    assert replace(PATH, maximum=1000).parse("a/b.png") == str(tmp_path / "a" / "b.png")


@given(st.floats(allow_nan=False, allow_infinity=False), st.integers())
def test_every_finite_number_is_free(number, whole):
    assert FREE.check(number) == number
    assert FREE.parse(repr(number)) == number
    if abs(whole) < 2**1023:
        assert FREE.check(whole) == float(whole)


# --- refused --------------------------------------------------------------------------------------------------

REFUSED = [
    (FLOAT, -1e-300), (FLOAT, 5.000001), (FLOAT, math.nan), (FLOAT, math.inf), (FLOAT, -math.inf), (FLOAT, HUGE),
    (FLOAT, -HUGE), (FLOAT, ENDLESS), (FLOAT, True), (FLOAT, "1"), (FLOAT, None), (FLOAT, [1.0]), (FLOAT, 1j),
    (OPEN, 0.0), (OPEN, -0.0), (OPEN, 0), (FREE, HUGE), (FREE, math.nan),
    (INT, -1), (INT, 100), (INT, 1.0), (INT, True), (INT, "1"), (INT, HUGE), (INT, ENDLESS), (INT, math.nan),
    (BOOL, 1), (BOOL, 0.0), (BOOL, "true"), (BOOL, None), (BOOL, ENDLESS),
    (CHOICE, "sphere"), (CHOICE, "Box"), (CHOICE, ""), (CHOICE, 0), (CHOICE, ["box"]), (CHOICE, {}), (CHOICE, ENDLESS),
    (COLOR, [1.0, 1.0]), (COLOR, [1.0] * 4), (COLOR, 1.0), (COLOR, "1,1,1"), (COLOR, [0.5, 1.5, 0.5]),
    (COLOR, [0.5, math.nan, 0.5]), (COLOR, [True, 1, 1]), (COLOR, [0, 0, "0"]), (COLOR, [0, 0, [0]]),
    (COLOR, [0, HUGE, 0]), (COLOR, ENDLESS), (COLOR, {"r": 1}),
    (VECTOR, [1.0, 0.05, 1.0]), (VECTOR, [math.inf] * 3),
    (PATH, "/" * 31), (PATH, "a\0b"), (PATH, 1), (PATH, ["a"]),
    (TEXT, "eleven long"), (TEXT, "two\nlines"), (TEXT, "\x1b[2J"), (TEXT, "\x7f"), (TEXT, "\x85"), (TEXT, 1), (TEXT, None), (TEXT, ENDLESS),
]


@pytest.mark.parametrize(("parameter", "value"), REFUSED, ids=[f"{p.name}-{shown(value)[:30]}" for p, value in REFUSED])
def test_message_names_value_limit_and_remedy(parameter, value):
    with pytest.raises(ParameterError) as caught:
        parameter.check(value)
    message = str(caught.value)
    head, _, remedy = message.partition("); ")
    assert head == f"{parameter.name} = {shown(value)} is not allowed (allowed: {parameter.limits}"
    assert remedy.split()[0] in {"write", "choose", "bring", "shorten", "take"}
    assert len(message) < 400


def test_every_kind_is_refused_something():
    assert {parameter.kind for parameter, _ in REFUSED} == set(KINDS)


@pytest.mark.parametrize(("parameter", "word"), [
    (FLOAT, ""), (FLOAT, "one"), (FLOAT, "nan"), (FLOAT, "inf"), (FLOAT, "1e400"), (FLOAT, "6"), (FLOAT, "0x10"),
    (INT, "1.0"), (INT, "1e2"), (INT, "9" * 5000), (INT, "100"), (BOOL, "yes"), (BOOL, "1"), (BOOL, ""),
    (CHOICE, "sphere"), (COLOR, "1,1"), (COLOR, "1;1;1"), (COLOR, "1,1,x"), (COLOR, "1,1,"), (COLOR, "1,1,2"),
    (COLOR, "nan,0,0"), (VECTOR, "1"), (TEXT, "eleven long"),
])
def test_refused_words_name_limit_and_remedy(parameter, word):
    with pytest.raises(ParameterError) as caught:
        parameter.parse(word)
    message = str(caught.value)
    assert message.startswith(f"{parameter.name} = ") and parameter.limits in message and "; " in message
    assert len(message) < 400


@pytest.mark.parametrize(("parameter", "limits"), [
    (FLOAT, ">= 0 and <= 5 1/m"), (OPEN, "> 0 m"), (FREE, "any number"), (INT, ">= 0 and <= 99"), (BOOL, "true or false"),
    (CHOICE, "one of 'box', 'cone'"), (COLOR, "three numbers, each >= 0 and <= 1"),
    (VECTOR, "three numbers, each >= 0.1 and <= 1e+06 m"), (TEXT, "one line of at most 10 characters"),
])
def test_limits_in_words(parameter, limits):
    assert parameter.limits == limits


def test_shown_is_short_for_everything():
    deep = []
    for _ in range(100_000):
        deep = [deep]
    for value in ("x" * 1000, ENDLESS, [ENDLESS], deep, list(range(1000)), math.nan, None):
        assert 0 < len(shown(value)) <= 80
    assert shown(0.5) == "0.5" and shown("a'b") == '"a\'b"'


# --- groups ---------------------------------------------------------------------------------------------------


def test_group_fills_in_defaults_and_keeps_order():
    group = Group("g", "G", "A group.", (FLOAT, INT, COLOR))
    assert group.check({}) == {"density": 1.0, "seed": 0, "albedo": (1.0, 1.0, 1.0)} == group.defaults()
    assert list(group.check({"albedo": [0, 0, 0], "density": 2})) == ["density", "seed", "albedo"]
    assert group["seed"] is INT
    with pytest.raises(KeyError):
        group["sead"]


@pytest.mark.parametrize("key", ["sead", "", "Density", "density ", "__class__", "x" * 10_000])
def test_group_refuses_unknown_keys_and_names_the_known(key):
    with pytest.raises(ParameterError, match="known keys: albedo, density, seed") as caught:
        Group("g", "G", "A group.", (FLOAT, INT, COLOR)).check({key: 1.0})
    assert shown(key) in str(caught.value) and len(str(caught.value)) < 200


def test_a_declaration_that_contradicts_itself_does_not_load():
    with pytest.raises(ParameterError):
        Parameter("density", "float", 6.0, "Default beyond the limit.", maximum=5.0)
    with pytest.raises(AssertionError):
        Parameter("density", "number", 6.0, "No such kind.")
    with pytest.raises(AssertionError):
        Parameter("domain", "choice", "box", "No choices.")
    with pytest.raises(AssertionError):
        Group("g", "G", "Twice.", (FLOAT, FLOAT))


# --- the declared parameters -----------------------------------------------------------------------------------


def test_there_are_families_with_parameters():
    assert list(FAMILIES) == ["cloud", "glass", "fog", "godray", "air"]
    assert all(name == group.name for name, group in FAMILIES.items())
    assert len(DECLARED) >= 60
    assert all(group.live for group in FAMILIES.values())


@pytest.mark.parametrize(("group", "parameter"), DECLARED)
def test_declared_parameter_is_complete(group, parameter):
    assert parameter.name.isidentifier() and parameter.name == parameter.name.lower()
    assert parameter.description.endswith(".") and parameter.description[0].isupper()
    assert 10 <= len(parameter.description) <= 160
    assert parameter.check(parameter.default) == parameter.default
    if parameter.kind in ("bool", "choice", "path"):
        assert parameter.minimum is None and (parameter.maximum is None) == (parameter.kind != "path")
        return
    assert parameter.minimum < parameter.maximum
    low, high = parameter.soft_range
    assert parameter.minimum <= low < high <= parameter.maximum
    components = parameter.default if isinstance(parameter.default, tuple) else (parameter.default,)
    assert all(low <= component <= high for component in components)
    if parameter.kind == "vector":
        assert parameter.unit
    if parameter.kind == "float":
        assert bool(parameter.unit) != (parameter.name in DIMENSIONLESS)


@pytest.mark.parametrize(("group", "parameter"), DECLARED)
def test_limits_themselves_are_allowed_and_what_lies_beyond_is_not(group, parameter):
    if parameter.kind in ("bool", "choice", "text", "path"):
        for name, label in parameter.choices:
            assert parameter.check(name) == name and label
        return
    step = 1 if parameter.kind == "int" else 0.0
    form = (lambda x: (x, x, x)) if parameter.kind in ("color", "vector") else lambda x: x
    number = int if parameter.kind == "int" else float
    for limit, away in ((parameter.minimum, -math.inf), (parameter.maximum, math.inf)):
        assert parameter.check(form(number(limit))) == form(number(limit))
        beyond = number(limit) + math.copysign(step, away) if step else math.nextafter(limit, away)
        with pytest.raises(ParameterError):
            parameter.check(form(number(beyond)))


def test_every_dimensionless_name_is_declared():
    assert DIMENSIONLESS <= {parameter.name for group in GROUPS for parameter in group.parameters}
