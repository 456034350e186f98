# SPDX-License-Identifier: GPL-3.0-or-later
"""Preset files: what is read, what is refused and in which words, and that a written preset reads the same."""

import math
import os
import time
import tomllib
from pathlib import Path

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from volumetrics_addon.parameters import preset as presets
from volumetrics_addon.parameters.families import FAMILIES
from volumetrics_addon.parameters.model import ParameterError
from volumetrics_addon.parameters.preset import MAX_BYTES, MAX_DOTS, MAX_PROPS, Preset, PresetError, load, parse, to_toml
from volumetrics_addon.parameters.stage import PROP, STAGE

FIXTURES = sorted((Path(__file__).parent / "fixtures").glob("format-*.toml"))
NAME = Path("folder/odd.toml")
HEAD = b'format = 1\nfamily = "cloud"\n'


def refused(data, *words):
    """The message of the refusal, which names the file and every one of the words."""
    with pytest.raises(PresetError) as caught:
        parse(data, NAME)
    message = str(caught.value)
    assert message.startswith(f"{NAME}: ") and len(message) < 600
    for word in words:
        assert word in message, f"{word!r} is missing in: {message}"
    return message


# --- what is read ----------------------------------------------------------------------------------------------


def test_the_presets_that_come_with_the_package():
    names = presets.names()
    assert len(names) >= 8 and names == sorted(set(names))
    loaded = [load(name) for name in names]
    for family in FAMILIES:
        assert sum(preset.family == family for preset in loaded) >= 2, family
    assert len({preset.label for preset in loaded}) == len(loaded)
    for preset in loaded:
        assert preset.description.endswith(".")
        assert parse(to_toml(preset).encode(), Path(f"{preset.name}.toml")) == preset


def test_smallest_preset_is_its_family_at_the_defaults():
    for family, group in FAMILIES.items():
        preset = parse(f'format = 1\nfamily = "{family}"'.encode(), NAME)
        assert preset == Preset("odd", family, "odd", "", group.defaults(), STAGE.defaults(), ())


def test_there_is_a_fixture_of_every_family():
    assert {load(path).family for path in FIXTURES} == set(FAMILIES)


@pytest.mark.parametrize("path", FIXTURES, ids=lambda path: path.stem)
def test_preset_files_of_earlier_formats_still_load(path):
    """Each fixture has every key of its time, none at the default of its time."""
    preset, written = load(path), tomllib.loads(path.read_text(encoding="utf-8"))
    assert (preset.label, preset.description) == (written["label"], written["description"])
    tables = [(preset.parameters, written["parameters"]), (preset.stage, written["stage"]),
              *zip(preset.props, written["props"], strict=True)]
    for values, table in tables:
        for key, value in table.items():
            assert values[key] == (tuple(value) if isinstance(value, list) else value), key
    assert len(written["parameters"]) >= 7 and len(written["stage"]) >= 12 and len(written["props"]) == 2


def test_line_ends_byte_order_mark_and_unicode():
    text = 'format = 1\r\nfamily = "fog"\r\nlabel = "Brume d’été 霧"\r\n'
    for data in (text.encode(), text.encode("utf-8-sig")):
        assert parse(data, NAME).label == "Brume d’été 霧"


def test_code_in_strings_stays_text(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    for text in ("__import__('os').system('touch ran')", "$(touch ran)", "`touch ran`", "%s%n{0}", "../../etc/passwd",
                 "\\u0041\\", '"""', "'''"):
        data = HEAD + f"label = {presets._toml(text)}\ndescription = {presets._toml(text)}".encode()
        preset = parse(data, NAME)
        assert preset.label == preset.description == text
    refused(HEAD + b'[parameters]\nextinction = "__import__(\'os\').abort()"', "extinction", "write a number")
    assert list(tmp_path.iterdir()) == []


def test_numbers_as_toml_writes_them():
    preset = parse(HEAD + b"[parameters]\nextinction = 1e-3\nseed = 0x1f\nnoise_size = 1_000\nalbedo = [0, 1.0, 5e-1]", NAME)
    assert preset.parameters["extinction"] == 1e-3 and preset.parameters["seed"] == 31
    assert preset.parameters["noise_size"] == 1000.0 and preset.parameters["albedo"] == (0.0, 1.0, 0.5)


# --- what is refused -------------------------------------------------------------------------------------------


@pytest.mark.parametrize(("where", "data"), [
    ("top level", HEAD + b"colour = 1"), ("top level", HEAD + b"[paramters]"), ("top level", HEAD + b'"" = 1'),
    ("parameters", HEAD + b"[parameters]\ndensty = 1"), ("parameters", HEAD + b"[parameters.extinction_]\na = 1"),
    ("stage", HEAD + b"[stage]\nsun = 1"), ("props[1]", HEAD + b"[[props]]\n[[props]]\ncolour = 1"),
    ("parameters", b'format = 1\nfamily = "glass"\n[parameters]\nextinction = 1'),
])
def test_unknown_keys_at_every_level(where, data):
    assert "known" in refused(data, where, "unknown key")


@pytest.mark.parametrize("family", FAMILIES)
def test_every_parameter_is_checked_where_it_stands(family):
    """A value of a wrong type, NaN, the infinities and what lies beyond the limits, for each key of each table."""
    count = 0
    for title, group in (("[parameters]", FAMILIES[family]), ("[stage]", STAGE), ("[[props]]", PROP)):
        for parameter in group.parameters:
            words = ["{}", "1979-05-27", '"no such value"', "[1.0, 2.0]", "0x" + "f" * 5000]
            if parameter.kind == "path":
                words[2] = f'"{"x" * 1001}"'
            if parameter.kind not in ("bool", "choice", "path"):
                low, high = parameter.minimum, parameter.maximum
                numbers = ["nan", "-nan", "inf", "-inf", "true", repr(low - abs(low) - 1), repr(high + abs(high) + 1)]
                words += numbers if parameter.kind in ("float", "int") else [f"[0.5, {word}, 0.5]" for word in numbers]
            for word in words:
                data = f'format = 1\nfamily = "{family}"\n{title}\n{parameter.name} = {word}'
                message = refused(data.encode(), f"{parameter.name} = ", parameter.limits, "; ")
                assert title.strip("[]") in message
                count += 1
    assert count > 200


@pytest.mark.parametrize("data", [
    b"", b'family = "cloud"', b'format = 2\nfamily = "cloud"', b'format = 0\nfamily = "cloud"',
    b'format = true\nfamily = "cloud"', b'format = 1.0\nfamily = "cloud"', b'format = "1"\nfamily = "cloud"',
    b'format = [1]\nfamily = "cloud"', b'format = 0x' + b"f" * 9000, b"[format]\na = 1",
])
def test_format_version(data):
    refused(data, "format = ", "reads format = 1", "update Volumetrics")


@pytest.mark.parametrize("word", ['"clouds"', '"Cloud"', '""', "1", "true", "[]", "{}", '["cloud"]', "0x" + "f" * 9000])
def test_unknown_family(word):
    refused(f"format = 1\nfamily = {word}".encode(), "family = ", "cloud, glass, fog, godray")
    refused(b"format = 1", "family = None")


@pytest.mark.parametrize(("data", "words"), [
    (b"parameters = 1", ("parameters = 1", "[parameters]")), (b"stage = []", ("stage = []", "[stage]")),
    (b"[[parameters]]", ("parameters", "[parameters]")), (b"props = 1", ("props = 1", "[[props]]")),
    (b"[props]\nsize = [1, 1, 1]", ("props", "[[props]]")), (b"props = [{}, 3]", ("props[1] = 3", "[[props]]")),
    (b"label = 1", ("label", "write it in quotes")), (b'label = "' + b"x" * 81 + b'"', ("label", "80", "shorten it")),
    (b'label = "\\u001b[2J"', ("label", "'\\x1b[2J'", "control characters")), (b"label = '''a\nb'''", ("label", "line breaks")),
    (b'description = "' + b"x" * 501 + b'"', ("description", "500")),
])
def test_tables_and_texts_of_a_wrong_type(data, words):
    refused(HEAD + data, *words)


@pytest.mark.parametrize(("data", "words"), [
    ("format = 1\nfamily = 'fog'\nlabel = 'é'".encode("latin-1"), ("byte 35", "UTF-8")),
    ("format = 1".encode("utf-16"), ("byte 0", "UTF-8")), ("format = 1".encode("utf-16-le"), ("not valid TOML",)),
    (b"\x00" * 100, ("not valid TOML",)), (b"\x89PNG\r\n\x1a\n", ("byte 0", "UTF-8")),
    (b"\xed\xa0\x80", ("UTF-8",)), (HEAD + b"label = 'a\x01b'", ("not valid TOML", "line 3")),
    (HEAD + b"x = ", ("not valid TOML",)), (HEAD + b"format = 1", ("not valid TOML",)),
    (HEAD + b"[stage]\n[stage]", ("not valid TOML",)), (b"import bpy\n", ("not valid TOML", "line 1")),
    (b"{}", ("not valid TOML",)), (HEAD + b"x = 010", ("not valid TOML",)), (HEAD + b"x = 1e", ("not valid TOML",)),
])
def test_files_that_are_not_toml(data, words):
    refused(data, *words)


DEEP = {
    "arrays": b"x = " + b"[" * 100_000,
    "closed arrays": b"x = " + b"[" * 40_000 + b"]" * 40_000,
    "inline tables": b"x = " + b"{a=" * 30_000,
    "dotted key": b"x" + b".x" * 60_000 + b" = 1",
    "dotted table": b"[" + b".".join([b"x"] * 60_000) + b"]",
    "many dotted keys": b"[x]\n" + b"".join(b"k%d" % i + b".x" * (MAX_DOTS - 1) + b" = 1\n" for i in range(400)),
    "value below a parameter": b"[parameters]\nextinction" + b".x" * (MAX_DOTS - 1) + b" = 1",
    "digits": b"[parameters]\nextinction = " + b"9" * 100_000,
    "hexadecimal digits": b"[parameters]\nextinction = 0x" + b"f" * 100_000,
    "hexadecimal digits in a colour": b"[parameters]\nalbedo = [1, 1, 0x" + b"f" * 100_000 + b"]",
    "digits of a fraction": b"[parameters]\nextinction = -0." + b"9" * 100_000,
    "exponent": b"[parameters]\nextinction = 1e" + b"9" * 100_000,
    "keys": b"[parameters]\n" + b"".join(b"k%d=1\n" % i for i in range(12_000)),
    "long key": b"x" * 120_000 + b" = 1",
    "long string": b'label = "' + b"x" * 120_000 + b'"',
    "tables": b"[[props]]\n" * 12_000,
}


@pytest.mark.parametrize("what", DEEP)
def test_hostile_files_are_refused_quickly(what):
    data = HEAD + DEEP[what]
    assert len(data) <= MAX_BYTES
    start = time.perf_counter()
    refused(data)
    assert time.perf_counter() - start < 5.0  # measured 0.5 s at most; without MAX_DOTS the dotted keys take minutes


def test_number_of_props_has_a_limit():
    assert len(parse(HEAD + b"[[props]]\n" * MAX_PROPS, NAME).props) == MAX_PROPS
    refused(HEAD + b"[[props]]\n" * (MAX_PROPS + 1), f"{MAX_PROPS + 1} props", f"at most {MAX_PROPS}")


# --- what a path may lead to -----------------------------------------------------------------------------------


def refused_path(path, *words):
    with pytest.raises(PresetError) as caught:
        load(path)
    message = str(caught.value)
    assert message.startswith(f"{path}: ")
    for word in words:
        assert word in message, message


def test_missing_directory_and_dangling_link(tmp_path):
    refused_path(tmp_path / "missing.toml", "no such file", "check the path")
    refused_path(tmp_path / "no" / "folder.toml", "no such file")
    (tmp_path / "folder.toml").mkdir()
    refused_path(tmp_path / "folder.toml", "not a file")
    (tmp_path / "loop.toml").symlink_to(tmp_path / "loop.toml")
    refused_path(tmp_path / "loop.toml")
    refused_path(tmp_path / ("x" * 300 + ".toml"))


def test_fifo_and_device_do_not_hang(tmp_path):
    os.mkfifo(tmp_path / "pipe.toml")
    refused_path(tmp_path / "pipe.toml", "not a file")
    (tmp_path / "zero.toml").symlink_to("/dev/zero")
    refused_path(tmp_path / "zero.toml", "not a file")


def test_large_file_is_refused_without_reading(tmp_path, monkeypatch):
    path = tmp_path / "large.toml"
    with path.open("wb") as file:
        file.truncate(100 << 20)

    def read(*arguments, **options):
        raise AssertionError("the file was opened")

    monkeypatch.setattr(Path, "open", read)
    refused_path(path, str(100 << 20), str(MAX_BYTES))


def test_file_that_grows_while_it_is_read(tmp_path, monkeypatch):
    path = tmp_path / "growing.toml"
    path.write_bytes(HEAD + b"#" * MAX_BYTES)
    real = Path.stat

    def stat(self, **options):
        result = real(self, **options)
        return os.stat_result((*result[:6], 10, *result[7:])) if self == path else result

    monkeypatch.setattr(Path, "stat", stat)
    refused_path(path, "grew beyond", str(MAX_BYTES))


def test_unreadable_file(tmp_path, monkeypatch):
    """Root reads everything, so the refusal of the system is played."""
    path = tmp_path / "secret.toml"
    path.write_bytes(HEAD)

    def refuse(*arguments, **options):
        raise PermissionError(13, "Permission denied", str(path))

    monkeypatch.setattr(Path, "open", refuse)
    refused_path(path, "Permission denied", "check its permissions")


@pytest.mark.parametrize("name", ["cumulos", "", "Cumulus", "cumulus ", "../presets/cumulus", "cumulus.tom", "x" * 5000, "\0"])
def test_unknown_name_is_told_the_known(name):
    with pytest.raises(PresetError, match="known: .*cumulus, .*tea-glass.*path of a .toml file") as caught:
        load(name)
    assert len(str(caught.value)) < 200 + len(", ".join(presets.names()))  # what was asked for is cut


def test_names_follow_the_folder(tmp_path, monkeypatch):
    monkeypatch.setattr(presets, "directory", lambda: tmp_path)
    assert presets.names() == []
    (tmp_path / "b.toml").write_bytes(HEAD)
    (tmp_path / "a.toml").write_bytes(HEAD)
    (tmp_path / "c.txt").write_bytes(HEAD)
    assert presets.names() == ["a", "b"] and load("a").name == "a"


def test_a_file_is_relative_to_the_preset(tmp_path):
    data = b'format = 1\nfamily = "godray"\n[parameters]\ngobo_image = "pictures/leaf.png"'
    (tmp_path / "slide.toml").write_bytes(data)
    preset = load(tmp_path / "slide.toml")
    assert preset.parameters["gobo_image"] == str(tmp_path / "pictures" / "leaf.png")
    (tmp_path / "other").mkdir()
    (tmp_path / "other" / "slide.toml").write_text(to_toml(preset), encoding="utf-8")
    assert load(tmp_path / "other" / "slide.toml") == preset


# --- what is written -------------------------------------------------------------------------------------------


def values_of(parameter):
    number = st.floats(parameter.minimum, parameter.maximum) if parameter.minimum is not None else None
    match parameter.kind:
        case "bool":
            return st.booleans()
        case "choice":
            return st.sampled_from([name for name, _ in parameter.choices])
        case "path":
            return st.just("") | texts(1, 500).map(lambda text: os.path.abspath("/" + text))
        case "int":
            return st.integers(int(parameter.minimum), int(parameter.maximum))
        case "float":
            return number
        case "color" | "vector":
            return st.tuples(number, number, number)


def group_values(group):
    return st.fixed_dictionaries({parameter.name: values_of(parameter) for parameter in group.parameters})


def texts(least, most):
    return st.text(st.characters(exclude_categories=["Cs", "Cc"]), min_size=least, max_size=most).filter(
        lambda text: text.count(".") < MAX_DOTS)


PRESETS = st.sampled_from(sorted(FAMILIES)).flatmap(lambda family: st.builds(
    Preset, st.just("odd"), st.just(family), texts(1, 80), texts(0, 500), group_values(FAMILIES[family]),
    group_values(STAGE), st.lists(group_values(PROP), max_size=3).map(tuple)))


@settings(max_examples=60, deadline=None)
@given(PRESETS)
def test_written_presets_read_back_exactly(preset):
    assert parse(to_toml(preset).encode("utf-8"), NAME) == preset


@pytest.mark.parametrize("family", FAMILIES)
def test_the_largest_preset_fits_into_a_file(family):
    """Every value of the longest form, and as many props as are allowed."""

    def long(parameter):
        match parameter.kind:
            case "bool":
                return not parameter.default
            case "choice":
                return max((name for name, _ in parameter.choices), key=len)
            case "path":
                return "/" + "\U0001f32b" * int(parameter.maximum - 1)
            case "int":
                return int(parameter.maximum)
        value = math.nextafter(parameter.minimum, math.inf) if parameter.minimum else 1.2345678901234567e-07
        return value if parameter.kind == "float" else (value,) * 3

    groups = [{p.name: long(p) for p in group.parameters} for group in (FAMILIES[family], STAGE, PROP)]
    preset = Preset("odd", family, '"' * 80, "\U0001f32b" * 500, groups[0], groups[1], (groups[2],) * MAX_PROPS)
    data = to_toml(preset).encode()
    assert len(data) < MAX_BYTES
    assert parse(data, NAME) == preset


def test_only_what_differs_is_written():
    text = to_toml(parse(HEAD + b"[parameters]\nextinction = 0.25", NAME))
    assert text.splitlines() == ["format = 1", 'family = "cloud"', 'label = "odd"', 'description = ""', "",
                                 "[parameters]", "extinction = 0.25", "", "[stage]"]


def test_changed_checks_what_changes():
    preset = load("tea-glass")
    other = preset.changed({"ior": 1.4}, {"exposure": 1})
    assert other.parameters == {**preset.parameters, "ior": 1.4} and other.stage["exposure"] == 1.0
    assert preset.parameters["ior"] == 1.5 and other.name == preset.name
    for parameters, stage in (({"ior": 0.5}, {}), ({"extinction": 1.0}, {}), ({}, {"orders": 0})):
        with pytest.raises(ParameterError):
            preset.changed(parameters, stage)
