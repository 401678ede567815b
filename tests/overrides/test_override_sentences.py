"""What cannot be composed is one sentence of ours, never the text of a library."""

from __future__ import annotations

import re

import pytest
from hydra.errors import HydraException

from omnilab.errors import ConfigError, OmnilabError
from omnilab.runner.hydra_app import experiment
from omnilab.runner.overrides.command_line import for_hydra
from omnilab.runner.overrides.compose_errors import EXTRAS, sentence
from omnilab.runner.registry import discover

FOREIGN = re.compile(
    r"hydra\.cc|Lexer|mismatched input|extraneous|no viable|full_key|object_type|DictConfig|ListConfig|in struct|Optional\["
    r"|defaults list|Config search path|could not be converted|token recognition|usage:|\bError merging|provider=|merge "
)


@pytest.fixture(scope="module")
def registry():
    return discover()


# --------------------------------------------------------------------------------------- before Hydra reads them
@pytest.mark.parametrize(
    ("words", "told"),
    [
        (["sensor.path"], "'sensor.path' has no value; settings are given as NAME=VALUE"),
        (["seed=1", "grid"], "'grid' is no setting; did you mean experiment=grid?"),
        ([""], "'' has no value"),
        (["="], "'' is no name of a setting"),
        (["+"], "'+' has no value"),
        (["~"], "'~' is no name of a setting"),
        (["été=3"], "'été' is no name of a setting; give NAME=VALUE, such as sensor.size=250"),
        (["a..b=1"], "'a..b' is no name of a setting"),
        (["/sensor=mirror"], "'/sensor' is no name of a setting"),
        (["sensor:=3"], "'sensor:' is no name of a setting"),
        (["sensor.size =3"], "write sensor.size=3"),
        (["study.extent_m[0]=3"], "is part of a list, which is set as a whole; give study.extent_m=[VALUE,VALUE]"),
        (["study.extent_m.0=3"], "study.extent_m has none of its own; it takes a list such as [1.0,2.0] or null"),
        (["sensor.size.x=3"], "'sensor.size.x' is not a setting: sensor.size has none of its own; it takes a whole number"),
        (["sensor.size=[1"], "sensor.size=[1 cannot be read: it has 1 '[' and 0 ']'; sensor.size takes a whole number"),
        (["study.extent_m={a:1"], "it has 1 '{' and 0 '}'"),
        (["seed='1"], "seed='1 cannot be read: a ' is not closed"),
        (["seed=range(1,x)"], "seed=range(1,x) cannot be read; seed takes a whole number"),
        (["-m", "seed=choice()"], "seed=choice() cannot be read"),
        (["-m", "seed=range(3,1)"], "is a sweep over nothing; give a range whose end lies beyond its start"),
        (["descriptor=été"], "descriptor 'été' does not exist; there is fourier_phase, fourier_signature"),
        (["+descriptor@descriptors.a=été"], "descriptor 'été' does not exist"),
        (["disturbance=[blur,[light]]"], "is no list of names; give disturbance=[NAME,NAME] of blur, "),
        (["disturbance=[blur,3]"], "is no list of names"),
        (["disturbance=[null]"], "is no list of names"),
        (["hydra.run.dir="], "hydra.run.dir= names no folder; give hydra.run.dir=DIR"),
        (["sensor.path=/data/\udcff"], "/data/\udcff holds bytes that are no text in UTF-8; rename the file"),
        (["--foo"], "'--foo' is no option; there is --multirun, --run, --cfg"),
        (["-x", "seed=1"], "'-x' is no option"),
        (["--experimental-rerun", "x"], "'--experimental-rerun' is no option"),
        (["--cfg"], "--cfg takes job or hydra or all after it"),
        (["--cfg", "jobs"], "--cfg jobs: --cfg takes job, hydra, all (did you mean job?)"),
        (["--info", "seed=1"], "--info takes all, config, defaults"),
        (["--multirun=3"], "--multirun stands alone"),
        (["--run", "-m"], "--run and --multirun do not go together; give one of them"),
        (["--resolve"], "give --cfg job --resolve"),
        (["--config-dir", "/nowhere"], "--config-dir /nowhere: there is no such folder"),
        (["--shell-completion"], "--shell-completion takes install=bash"),
    ],
    ids=lambda value: " ".join(value) if isinstance(value, list) else "",
)  # fmt: skip
def test_before_hydra(registry, words, told):
    with pytest.raises(ConfigError) as refused:
        for_hydra(words, registry)
    assert told in str(refused.value)
    assert not FOREIGN.search(str(refused.value))


# --------------------------------------------------------------------------------------- what Hydra refuses
COMPOSED = [
    (["seed=1.5"], "seed=1.5 does not fit: seed takes a whole number"),
    (["seed=foo(1)"], "seed takes a whole number"),
    (["seed=null"], "seed takes a whole number"),
    (["seed={a:1}"], "seed takes a whole number"),
    (["study.step_m=wide"], "study.step_m takes a number or null"),
    (["study.step_m=true"], "study.step_m takes a number or null"),
    (["study.queries=5"], "study.queries takes random or rest"),
    (["sensor.color=maybe"], "sensor.color takes true or false"),
    (["study.extent_m=3"], "study.extent_m takes a list such as [1.0,2.0] or null"),
    (["study.extent_m=[1,two]"], "study.extent_m takes a list such as [1.0,2.0] or null"),
    (["study.extent_m=[1,[2]]"], "study.extent_m takes a list such as [1.0,2.0] or null"),
    (["study.extent_m={a:1}"], "study.extent_m takes a list such as [1.0,2.0] or null"),
    (["sensor.path=null", "experiment=recorded_grid"], "sensor.path takes a text"),
    (["sinks=null"], "sinks takes components by name; ~sinks.NAME leaves one out"),
    (["hydra.job.num=x"], "hydra.job.num=x does not fit"),
    (["speed=3"], "(did you mean seed?)"),
    (["study.stp_m=1"], "(did you mean step_m?)"),
    (["sensor.SIZE=3"], "(did you mean size?)"),
    (["hydra.foo=1"], "'hydra.foo' is not a setting of Hydra; omnilab --cfg hydra shows"),
    (["sinks.foo.x=1"], "there is nothing called 'foo' in sinks; add it first, with +sink@sinks.foo=NAME"),
    (["disturbances.blur.sigma_px=1"], "add it first, with disturbance=blur"),
    (["study.conditions.noon.x=1", "experiment=changes"], "if study.conditions.noon takes any names, give +study."),
    (["localizer.x=1", "~localizer"], "no localizer is chosen; give localizer="),
    (["+seed=1"], "give seed=VALUE without the +"),
    (["+descriptor=radon"], "give descriptor=NAME without the +"),
    (["+experiment=grid"], "give experiment=NAME without the +"),
    (["descriptor@descriptors.a=radon"], "add it, with +descriptor@descriptors.a=NAME"),
    (["descriptor@foo=radon"], "'descriptor@foo' is no place for a descriptor; give descriptor=NAME"),
    (["+descriptor@foo=radon"], "'foo' is not a setting of a run"),
    (["sensr/x=mirror"], "'sensr/x' is not"),
    (["sensor=[a]"], "sensor 'a' does not exist; there is "),
    (["sensor=5"], "sensor=5 is no name; give sensor="),
    (["sensor=null"], "sensor=null names nothing; what is chosen there is left out by ~sensor"),
    (["sensor=???"], "no sensor is chosen; give sensor="),
    (["descriptor=../radon"], "(did you mean descriptor=radon?)"),
    (["experiment=experiment/grid"], "experiment 'experiment/grid' does not exist"),
    (["~nothing"], "there is no nothing to leave out"),
    (["~sinks.nothing"], "there is no sinks.nothing to leave out"),
    (["~sensor=folder"], "~sensor=folder: folder is not what is chosen as sensor"),
    (["~sinks.rerun=3"], "give ~sinks.rerun"),
    (["~descriptor.angles"], "a setting is never left out; without ~descriptor.angles it has its default"),
    (["seed=1,2"], "seed=1,2 is several values; for a sweep over them give -m"),
    (["disturbance=blur,light"], "for a list disturbance=[blur,light]"),
    (["seed=range(1,3)"], "seed=range(1,3) is a sweep; give -m before it"),
    (["-m", "seed=interval(1,2)"], "interval(...) has no single values to run"),
    (["seed=${x}"], "seed=${x} cannot be filled in: there is no setting x"),
    (["seed=${sed}"], "there is no setting sed (did you mean seed?)"),
    (["seed=${seed}"], "it would insert itself"),
    (["seed=${sensor}"], "what it names does not fit there"),
    (["seed=${a b}"], "what it names does not fit there"),
    (["seed=${foo:1}"], "nothing is called foo; oc.env is"),
    (["seed=${oc.env:OMNILAB_NOT_SET}"], "the environment variable OMNILAB_NOT_SET, which is not set; set it"),
    (["hydra.run.dir=${x}"], "there is no setting x"),
    (["logs="], "names no folder; give logs=DIR"),
    (["~experiment"], "give experiment=NAME or study=NAME"),
    (["hydra/launcher=foo"], "hydra/launcher 'foo' does not exist; there is basic"),
    (["--config-name", "foo"], "leave it out, and choose a recipe with experiment=NAME"),
    (["--config-path", "/nowhere"], "give --config-dir DIR for recipes of your own"),
    (["study.extent_m=???"], "study.extent_m is not set and has no default; give study.extent_m=VALUE"),
]


@pytest.mark.parametrize(
    "part", [slice(3, None, 8), pytest.param(slice(None), marks=pytest.mark.slow)], ids=["some", "all"]
)
def test_what_hydra_refuses(tmp_path, monkeypatch, capsys, part):
    monkeypatch.chdir(tmp_path)
    registry, wrong = discover(), []
    for words, told in COMPOSED[part]:
        try:
            experiment([*words], registry)
            wrong.append(f"{words} ran")
        except OmnilabError as refused:
            if told not in str(refused) or FOREIGN.search(str(refused)) or "\n" in str(refused):
                wrong.append(f"{words}: {refused}")
    assert not wrong, "\n".join(wrong)
    assert capsys.readouterr() == ("", "")
    assert not [path for path in tmp_path.rglob("*") if path.is_file()]


@pytest.mark.parametrize(("name", "extra"), EXTRAS.items())
def test_a_launcher_that_is_not_installed_is_told_by_its_extra(name, extra):
    """As Hydra says it, for some are installed here."""
    group = "hydra/sweeper" if name == "optuna" else "hydra/launcher"
    said = HydraException(f"Could not find '{group}/{name}'\n\nAvailable options in '{group}':\n\tbasic")
    assert sentence(said, discover("none")).startswith(
        f"{group}={name} needs packages that are not installed; pip install 'omnilab[{extra}]', or in a clone:"
    )


@pytest.mark.parametrize(
    ("text", "told"),
    [
        ("foo: 1\n", "experiment/mine: 'foo' is not a setting of a run"),
        ("study: {step_m: wide}\ndefaults: [override /study: grid]\n", "experiment/mine: study.step_m takes a number or null"),
        ("defaults: [override /descriptor: nope]\n", "descriptor 'nope' does not exist"),
        ("a: [1\n", "mine.yaml, line 3, is no YAML; correct it"),
        ("seed: ${x}\n", "seed=${x} cannot be filled in: there is no setting x"),
    ],
    ids=["setting", "type", "component", "yaml", "insertion"],
)  # fmt: skip
def test_a_recipe_of_ones_own(tmp_path, monkeypatch, text, told):
    (tmp_path / "experiment").mkdir()
    (tmp_path / "experiment" / "mine.yaml").write_text("# @package _global_\n" + text)
    monkeypatch.chdir(tmp_path)
    with pytest.raises(OmnilabError) as refused:
        experiment(["--config-dir", ".", "experiment=mine"], discover())
    assert told in str(refused.value)
    assert not FOREIGN.search(str(refused.value))


def test_a_sweep_that_matches_nothing_is_said(omnilab_here):
    result = omnilab_here("-m", "experiment=glob(zz*)")
    assert (result.rc, result.stdout) == (1, "")
    assert result.stderr == (
        "omnilab: the sweep has no job: one of its values, such as glob(...), matches nothing; correct that one\n"
    )


def test_failed_plugins_are_mentioned_with_sinks_that_are_not_there(omnilab_here, tmp_path, monkeypatch):
    (tmp_path / "broken.py").write_text("import nowhere_to_be_found")
    monkeypatch.setenv("OMNILAB_PLUGINS", "broken.py")
    result = omnilab_here("sinks.mine.live=true")
    assert result.stderr.splitlines()[-1].endswith("; not loaded: broken (omnilab plugins -v says why)")
