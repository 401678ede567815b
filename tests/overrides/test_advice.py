"""Advice in sentences: every command and setting that one proposes exists, and typical ones are followed to their end."""

from __future__ import annotations

import ast
import re
from dataclasses import fields
from pathlib import Path

import pytest

from omnilab.api import KINDS, Report
from omnilab.errors import OmnilabError
from omnilab.runner import hydra_app
from omnilab.runner.cli import COMMANDS
from omnilab.runner.config import Run
from omnilab.runner.registry import DICTS, discover

ROOT = Path(__file__).parents[2]
SLOTS = "|".join(KINDS)
NO_COMMANDS = {"reads", "map", "tells", "import"}  # omnilab reads, the omnilab map, from omnilab import


# ------------------------------------------------------------------------------------------------------- all
def texts():
    """File, line and text of every text in the sources but docstrings; {} for what it fills in."""
    for file in sorted([*ROOT.glob("omnilab/**/*.py"), *ROOT.glob("plugins/*/omnilab_*/**/*.py")]):
        nodes = list(ast.walk(ast.parse(file.read_text(encoding="utf-8"))))
        skipped = {id(node.value) for node in nodes if isinstance(node, ast.Expr)}  # docstrings
        skipped |= {id(part) for node in nodes if isinstance(node, ast.JoinedStr) for part in node.values}
        for node in nodes:
            if id(node) not in skipped and (text := text_of(node)):
                yield f"{file.relative_to(ROOT)}:{node.lineno}", text


def text_of(node):
    match node:
        case ast.Constant(value=str(text)):
            return text
        case ast.JoinedStr(values=parts):
            return "".join(text_of(part) for part in parts)
        case ast.FormattedValue():
            return "{}"
    return ""


def test_what_sentences_propose_exists():
    registry, wrong, found = discover(), set(), 0
    settings = {
        kind: {f.name for c in registry.components.values() if c.kind == kind for f in fields(c.cls)} for kind in KINDS
    }
    settings |= {plural: settings[kind] for plural, kind in DICTS.items()}
    options = {text for _, text in texts() if re.fullmatch(r"--[a-z-]+", text)}  # as parsers declare them
    commands = {*COMMANDS, *registry.commands, *NO_COMMANDS}
    known = {
        rf"\b({SLOTS})\.(\w+)(?==)": lambda m: m[2] in settings[m[1]],
        rf"\b({'|'.join(DICTS)})\.\w+\.(\w+)(?==)": lambda m: m[2] in settings[m[1]],
        rf"(?<![\w.@])({SLOTS})=([a-z]\w*)\b": lambda m: m[2] in registry.names(m[1]),
        rf"\+({SLOTS})@(\w+)\.": lambda m: m[2] == KINDS[m[1]].plural,
        r"\bexperiment=([a-z]\w*)": lambda m: m[1] in registry.recipes,
        r"\bomnilab ([a-z]\w*)(?!\w*(=| \d+$))": lambda m: m[1] in commands,  # not what files begin with
        r"(?:\bgive|\bwith|\bor|\band) (--[a-z][\w-]+)": lambda m: m[1] in options,
        r"\bgive (map|logs|seed|threads|cache|cache_gb)=": lambda m: m[1] in {f.name for f in fields(Run)},
    }
    for where, text in texts():
        for pattern, exists in known.items():
            for match in re.finditer(pattern, text):
                found += 1
                if not exists(match):
                    wrong.add(f"{where}: {match[0]} in: {text[:150]}")
    assert not wrong, "\n".join(sorted(wrong))
    assert found > 100, "the patterns find what sentences propose"


# ------------------------------------------------------------------------------------------------------- followed
FOLLOWED = [  # what is given; what the advice says, as a pattern; what is given then, with the groups of the pattern
    (["+descriptor=radon"], r"give (descriptor=)NAME without the \+", ["{0}radon"]),
    (["+seed=1"], r"give (seed=)VALUE without the \+", ["{0}1"]),
    (["descriptor@descriptors.a=radon"], r"add it, with (\+descriptor@descriptors\.a=)NAME", ["{0}radon"]),
    (["sinks.foo.live=true"], r"add it first, with (\S+=)NAME", ["{0}rerun", "sinks.foo.live=true"]),
    (["disturbances.blur.sigma_px=1"], r"add it first, with (\S+)$", ["{0}", "disturbances.blur.sigma_px=1"]),
    (["seed=1,2"], r"for a sweep over them give (-m)", ["{0}", "seed=1,2"]),
    (["seed=range(1,3)"], r"give (-m) before it", ["{0}", "seed=range(1,3)"]),
    (["disturbance=blur,light"], r"for a list (\S+)$", ["{0}"]),
    (["~descriptor"], r"give descriptor=(\w+)\|", ["descriptor={0}"]),
    (["distance=null"], r"left out by (\S+)$", ["{0}"]),
    (["sensor=5"], r"give (sensor=).*\|(mirror)\b", ["{0}{1}"]),
    (["experiment=quickstrat"], r"did you mean (\S+)\?", ["{0}"]),
    (["sensor=miror"], r"did you mean (\S+)\?", ["{0}"]),
    (["seed=1", "grid"], r"did you mean (\S+)\?", ["seed=1", "{0}"]),
    (["study.stp_m=1"], r"did you mean (\S+)\?", ["study.{0}=1"]),
    (["speed=3"], r"did you mean (\S+)\?", ["{0}=3"]),
    (["~experiment"], r"give experiment=NAME or (study=)NAME", ["~experiment", "{0}pose_graph", "backend=gtsam_batch"]),
    (["logs="], r"give logs=DIR, or (logs=\.)", ["{0}"]),
    (["hydra.run.dir="], r"give (hydra.run.dir=)DIR", ["{0}here"]),
    (["--resolve"], r"give (--cfg) (job) (--resolve)$", ["{0}", "{1}", "{2}"]),
    (["study.every=2"], r"(study.every)=2: give one of them, and (null) for the other", ["{0}={1}"]),
    (["study.extent_m[0]=3"], r"give (study.extent_m=)\[VALUE,VALUE\]", ["{0}[3,2]"]),
    (["sensor.size =64"], r"write (\S+)$", ["{0}"]),
    (["~sinks.rerun=3"], r"give (\S+)$", ["{0}"]),
    (["sinks=null"], r"(~sinks\.)NAME leaves one out", ["{0}rerun"]),
    (["sinks=null"], r"(\+sink@sinks\.)NAME=NAME adds one", ["{0}more=mcap"]),
    (["~descriptor.angles"], r"without (~\S+) it has its default", []),
    (["experiment=recorded_grid"], r"give (sensor.path=)VALUE", ["experiment=recorded_grid", "{0}~/été=3"]),
    (["sensor.world=a,b"], r'quote it twice: "(.*)"$', ["{0}"]),
    (["sensor.world=room,office"], r"for a sweep give (-m)", ["{0}", "sensor.world=room,office"]),
    (["+speed=3"], r"so (\+speed) does nothing; leave it out", []),
    (["seed=${x}"], r"(\$\{)NAME\} inserts the setting", ["seed={0}threads}"]),
    (["--config-name", "foo"], r"choose a recipe with (experiment=)NAME", ["{0}grid"]),
    (["+disturbances.dust.level=1"], r"choose one, as in (\S+) ", ["{0}"]),
]  # fmt: skip


@pytest.mark.parametrize(
    "part", [slice(2, None, 12), pytest.param(slice(None), marks=pytest.mark.slow)], ids=["some", "all"]
)
def test_advice_that_is_followed_works(tmp_path, monkeypatch, part):
    """Each is refused with its advice; with what that proposes, the run begins."""
    monkeypatch.chdir(tmp_path)
    begun, registry, wrong = [], discover(), []
    monkeypatch.setattr(hydra_app, "execute", lambda *given: begun.append(given) or Report([]))
    monkeypatch.setattr(hydra_app, "show_run", lambda report, folder: None)
    for given, advice, then in FOLLOWED[part]:
        try:
            hydra_app.experiment([*given], registry)
            told = "nothing"
        except OmnilabError as refused:
            told = str(refused)
        if not (found := re.search(advice, told)):
            wrong.append(f"{given}: {told}")
            continue
        begun.clear()
        words = list(then)
        for index, group in enumerate(found.groups()):
            words = [word.replace(f"{{{index}}}", group) for word in words]
        try:
            hydra_app.experiment(words, registry)
        except OmnilabError as refused_again:
            wrong.append(f"{given}, then {words}: {refused_again}")
        else:
            if not begun and "--cfg" not in words:
                wrong.append(f"{given}, then {words}: nothing began")
    assert not wrong, "\n".join(wrong)


@pytest.mark.parametrize(
    ("given", "advice"),
    [
        (["plugins", "quickstart"], r"its settings: omnilab (experiment=quickstart --cfg job)"),
        (["plugins", "raddon"], r"\(did you mean (radon)\?\)"),
        (["repeat"], r"`omnilab (runs)` lists the runs"),
        (["runz"], r"\(did you mean (runs)\?\)"),
    ],
    ids=lambda value: " ".join(value) if isinstance(value, list) else "",
)
def test_commands_that_are_proposed_work(omnilab_here, tmp_path, given, advice):
    (tmp_path / "logs").mkdir()
    refused = omnilab_here(*given)
    assert refused.rc == 2
    found = re.search(advice, refused.stderr)
    assert found, refused.stderr
    proposed = found[1].split()
    assert omnilab_here(*(["plugins", *proposed] if proposed == ["radon"] else proposed)).rc == 0
