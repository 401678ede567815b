"""Settings on the command line: texts are taken as they are written; what cannot be read is one sentence of ours."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any

import pytest
from hydra.core.override_parser.overrides_parser import OverridesParser
from hydra.core.override_parser.types import QuotedString
from omegaconf import OmegaConf

from omnilab.errors import ConfigError
from omnilab.runner.config import Settings, literal
from omnilab.runner.overrides.command_line import for_hydra
from omnilab.runner.overrides.setting_types import may_have_settings
from omnilab.runner.registry import discover
from omnilab.runner.run_folder import find_runs, load_run
from omnilab_recordings import Folder

WORLD = Path(__file__).parents[1] / "box_world.yaml"
MAP = [
    "experiment=map", f"sensor.world={WORLD}", "sensor.size=32", "sensor.samples=1", "study.step_m=1.5",
    "descriptor.offsets=32", "descriptor.angles=60", "~sinks.rerun", "~sinks.mcap",
]  # fmt: skip
TEXTS = [
    "/data/été", "日本", "/d/run=3", "a=b=c", "a(b)", "a (copy)", "a b", "[x]", "{x}", "{a: 1}", "{", "a]", "a;b",
    "a&b", "a!b", "a#b", "a^b|c<d>", "it's", "'", '"', 'say "x"', "a\tb", "a\nb", "C:\\x\\y", "\\", "a\\", "a'\\", "a\\'b",
    "1e3", "1_000", "007", "10", "-5", "3.50", "true", "True", "nan", "inf", "0x10", ".", "..", "a:b", "a@b", "%20", "+x", "-x",
    "é" * 500, "e\u0301", "🦊", "a\u202eb", "(?P<x>-?\\d+)_(?P<y>[^_]+)", "**/*.{png,jpg}"[:8], "$HOME", "${x}", "a${b}c",
    "${", "${}", "${no.such}", "${a b}", "~x", "a~", "x/~/y", "null_island", "foo(1)", "choice", "*",
]  # fmt: skip


@pytest.fixture(scope="module")
def registry():
    return discover()


@pytest.fixture
def read(registry):
    """`read(text, *options)`: what sensor.path becomes of `sensor.path=text`."""

    def read(text, *options):
        *_, word = for_hydra([*options, f"sensor.path={text}"], registry)
        value = OverridesParser.create().parse_override(word).value()
        value = value.text if isinstance(value, QuotedString) else value
        config = OmegaConf.create({"seed": 7, "sensor": OmegaConf.structured(Folder)})
        OmegaConf.update(config, "sensor.path", value)
        return OmegaConf.to_object(config)["sensor"].path

    return read


# ------------------------------------------------------------------------------------------------------- texts
@pytest.mark.parametrize("options", [[], ["-m"]], ids=["alone", "sweep"])
@pytest.mark.parametrize("text", TEXTS)
def test_a_text_is_taken_as_it_is_written(read, text, options):
    if options and "," in text:
        pytest.skip("a comma parts the values of a sweep")
    assert read(text, *options) == text


@pytest.mark.parametrize(
    ("written", "text"),
    [("'a b'", "a b"), ('"a,b"', "a,b"), ("'it\\'s'", "it's"), (r"a\,b", "a,b"), (r"a\ b", "a b"), (" a ", "a"),
     ("${seed}", "7"), ("x/${seed}/${y}", "x/7/${y}"), (r"\${seed}", "${seed}"), ("${oc.env:OMNILAB_TEST}", "set"),
     ("'${seed}'", "7"), ("'[x]'", "[x]"), ("''", ""), ("", "")],
)  # fmt: skip
def test_what_was_right_before_is(read, monkeypatch, written, text):
    monkeypatch.setenv("OMNILAB_TEST", "set")
    assert read(written) == text


@pytest.mark.parametrize(
    ("written", "below"), [("~", ""), ("~/data", "data"), ("'~/data'", "data"), ("~/été=3", "été=3"), ("~/a b", "a b")]
)
def test_the_home_folder(read, monkeypatch, written, below):
    monkeypatch.setenv("HOME", "/home/me")
    assert read(written) == str(Path("/home/me") / below)


def test_values_that_hydra_takes_are_handed_on_unchanged(registry):
    words = [
        "experiment=grid", "sensor=mirror", "disturbance=[light,blur]", "disturbances.light.gain=0.7", "~sinks.rerun",
        "~sink@sinks.mcap", "+descriptor@descriptors.a=radon", "study.step_m=null", "sensor.circle_px=[31.5,31.5,32]",
        "sensor.path=/data/x-1_2.3", "study.scenarios=[open,walls]", "++study.tests.path=DIR", "sinks={}", "seed=1_0",
        "hydra.run.dir=logs/x", "hydra/launcher=basic", "sensor.world=room", "cache=off", "map=null", "sensor.variant=null",
    ]  # fmt: skip
    assert for_hydra(words, registry) == words
    swept = [
        "seed=1,2", "sensor.world=room,office", "study.step_m=choice(0.2,0.4)", "seed=range(1,4)", "experiment=glob(*)",
        "descriptor=radon,hog", "study.extent_m=[1.0,2.0],[3.0,4.0]", "sensor.world='a,b'", "sensor.world=choice(a,b)",
    ]  # fmt: skip
    assert for_hydra(["-m", *swept], registry) == ["--multirun", *swept]


def test_settings_of_settings():
    @dataclass
    class Inner:
        size: int = 1

    for cls, expected in [(Inner, True), (Inner | None, True), (dict[str, int], True), (dict, True), (Any, True),
                          (int, False), (int | None, False), (list[float], False), (str, False)]:  # fmt: skip
        assert may_have_settings([cls]) == expected
    assert may_have_settings([int, Inner])


def test_commas_are_a_sweep_with_m_also_among_odd_texts(registry):
    def values(text):
        *_, word = for_hydra(["-m", f"sensor.path={text}"], registry)
        return [
            v.text if isinstance(v, QuotedString) else v
            for v in OverridesParser.create().parse_override(word).value().list
        ]

    assert values("/a/été,/b/run=3,c") == ["/a/été", "/b/run=3", "c"]
    assert values("1e3,007") == ["1e3", "007"]
    assert values("été,'a,b'") == ["été", "a,b"]
    assert values("été,{a,b}") == ["été", "{a,b}"]


@pytest.mark.parametrize("text", ["a,b", "été,日本"])
def test_a_comma_without_m_is_asked_about_unless_the_file_is_there(registry, read, tmp_path, monkeypatch, text):
    monkeypatch.chdir(tmp_path)
    with pytest.raises(ConfigError, match="has a comma: for a sweep give -m, for one text with a comma") as asked:
        for_hydra([f"sensor.path={text}"], registry)
    advice = str(asked.value).rpartition(': "')[2].removesuffix('"')
    assert read(advice.removeprefix("sensor.path=")) == text
    (tmp_path / text).mkdir()
    assert read(text) == text


def test_lists_of_texts(registry):
    (word,) = for_hydra(["study.scenarios=[/a/été.yaml,'x,y',b=c]"], registry)
    assert [str(v) for v in OverridesParser.create().parse_override(word).value()] == ["/a/été.yaml", "x,y", "b=c"]


def test_options_may_stand_anywhere_and_have_short_names(registry):
    assert for_hydra(["seed=1", "-m", "study.step_m=1", "-cd", "."], registry) == [
        "--multirun", "--config-dir", ".", "seed=1", "study.step_m=1",
    ]  # fmt: skip
    assert for_hydra(["-c", "job", "seed=1"], registry) == ["--cfg", "job", "seed=1"]
    assert for_hydra(["--info"], registry) == ["--info", "all"]


# ------------------------------------------------------------------------------------------------------- whole runs
ODD = "run=3 é 日本 (copy) [x] ${y}"


@pytest.mark.slow
def test_a_run_in_a_folder_of_an_odd_name_can_be_repeated(omnilab_here, tmp_path, monkeypatch):
    """Its name is in the working folder, in the settings, and in the folder of runs."""
    world = tmp_path / ODD / ODD / "world=1.yaml"
    world.parent.mkdir(parents=True)
    world.write_text(WORLD.read_text())
    monkeypatch.chdir(tmp_path / ODD)
    result = omnilab_here(*MAP, f"sensor.world={ODD}/world=1.yaml", f"logs=logs {ODD}")
    assert result.rc == 0, result.stderr
    run = load_run(Path(f"logs {ODD}") / "latest")
    assert run.config["sensor"]["world"] == f"{ODD}/world=1.yaml"
    repeated = omnilab_here("repeat", str(run.folder))
    assert repeated.rc == 0, repeated.stderr
    swept = omnilab_here("-m", *MAP, f"sensor.world={ODD}/world=1.yaml", f"logs=swept {ODD}", "seed=1,2")
    assert swept.rc == 0, swept.stderr
    assert [run.state for run in find_runs(f"swept {ODD}")] == ["done", "done"]


def omnilab_here(*arguments):
    """The command, in the folder that the test went to last."""
    return omnilab_here(*arguments)


# ------------------------------------------------------------------------------------------------------- files
def test_what_a_file_says_is_inserted_nowhere():
    for text in ["${oc.env:HOME}", "\\${x}", "a\\\\${", "$", "{x}", "${a:${b}}", "\\"]:
        config = OmegaConf.merge(OmegaConf.structured(Settings), literal({"logs": text}))
        assert OmegaConf.to_object(config).logs == text
    assert literal({"a": ["${x}", 3, None, {"b": "${y}"}]}) == {"a": ["\\${x}", 3, None, {"b": "\\${y}"}]}
