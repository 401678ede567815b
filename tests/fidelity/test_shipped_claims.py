"""The shipped claims are whole: recipes exist, overrides compose, metrics are declared."""

import re
from collections import Counter
from pathlib import Path

import pytest

from omnilab.errors import ConfigError, DataError
from omnilab.runner.fidelity.claims import read_claims, shipped_claims
from omnilab.runner.overrides.composition import check_build, compose_job
from omnilab.runner.registry import discover
from omnilab.runner.sweeps.objective import is_declared

CLAIM = """\
title: A chapter
source: A paper
runs:
  one: {{recipe: quickstart, overrides: [seed=1], minutes: 2}}
  dear: {{recipe: quickstart, minutes: 9}}
claims:
  - id: first
    place: "1"
    says: "It works."
    reported: "0.9"
    {more}
"""
WHOLE = "expect: {at_least: 0.9}\n    protocol: {run: one, metric: nearest_rate}"


@pytest.fixture
def claims_of(tmp_path):
    def make(more=WHOLE, text=CLAIM, name="chapter.yaml"):
        file = tmp_path / name
        file.write_text(text.format(more=more))
        return read_claims([file])

    return make


def test_every_run_is_of_a_recipe_and_some_claim_needs_it():
    claims = shipped_claims()
    needed = claims.needed()
    assert len(needed) > 40
    assert {run.name for run in needed} == set(claims.runs), "a run that no claim needs"
    recipes = {path.stem for path in (Path(__file__).parents[2] / "conf/experiment").glob("*.yaml")}
    assert {run.recipe for run in needed} <= recipes


@pytest.mark.slow
def test_every_run_composes_and_has_the_metrics_of_its_claims():
    claims, registry = shipped_claims(), discover("")
    needed = claims.needed()
    studies = {run.name: check_build(compose_job(run.words, registry)[0], registry).study for run in needed}
    for claim in claims.claims:
        for measurement in filter(None, (claim.protocol, claim.variant)):
            for quantity in measurement.quantities.values():
                names = studies[quantity.term.run].metric_names
                assert all(is_declared(metric, names) for metric in quantity.metrics), f"{claim.id}: {quantity.text}"


def test_no_two_runs_are_the_same_and_every_chapter_has_claims():
    claims = shipped_claims()
    words = Counter(tuple(run.words) for run in claims.runs.values())
    assert set(words.values()) == {1}
    assert all(chapter.claims and chapter.source for chapter in claims.chapters)
    assert len(claims.claims) > 80


def test_claims_are_selected_by_id_pattern_and_chapter(claims_of):
    claims = claims_of()
    assert [claim.id for claim in claims.selected("fir*").claims] == ["first"]
    assert [claim.id for claim in claims.selected("chapter").claims] == ["first"]
    assert [run.name for run in claims.needed()] == ["one"]
    with pytest.raises(ConfigError, match=r"no claim 'frist' \(did you mean first\?\).*chapter"):
        claims.selected("frist")


@pytest.mark.parametrize(
    ("more", "why"),
    [
        ("note: x", "needs either a protocol, or not_reproduced"),
        (WHOLE + "\n    not_reproduced: because", "needs either a protocol, or not_reproduced"),
        ("protocol: {run: one, metric: nearest_rate}", "needs `expect`"),
        ("expect: {at_least: 0.9}\n    protocol: {metric: nearest_rate}", "of no run"),
        ("expect: {order: rising}\n    protocol: {run: one, metric: nearest_rate}", "between several"),
        ("expect: {order: up}\n    protocol: {run: one, metric: nearest_rate}", "could not convert|rising"),
        ("expect: {about: 1}\n    protocol: {run: one, metric: nearest_rate}", "about with within"),
        ("expect: {at_least: 1}\n    protocol: {run: one, metric: a b}", "'a b' is no metric"),
        ("expect: {at_least: 1}\n    protocol: {run: on, metric: a}", "True is no text; put it into quotes"),
        ("expect: {at_least: 1}\n    protocol: {run: one, metric: a / b / c}", "more than one quotient"),
        ("expect: {at_least: 1}\n    protocol: {run: one, mertic: a}", "has mertic; there is metric"),
        (WHOLE + "\n    colour: red", "has colour"),
    ],
)
def test_a_file_that_is_not_whole_is_one_sentence(claims_of, more, why):
    with pytest.raises(DataError, match=r"chapter\.yaml is no file of claims .*; correct it") as error:
        claims_of(more)
    assert re.search(why, str(error.value))


def test_ids_are_unique_and_runs_are_there(claims_of, tmp_path):
    with pytest.raises(DataError, match=r"measured in the run 'onne', which no file has \(did you mean one\?\)"):
        claims_of(WHOLE.replace("one", "onne"))
    claims_of()
    again = tmp_path / "again.yaml"
    again.write_text(CLAIM.format(more=WHOLE).replace("one", "two").replace("dear", "dearer"))
    with pytest.raises(DataError, match="two claims have the id 'first'"):
        read_claims([tmp_path / "chapter.yaml", again])
    with pytest.raises(DataError, match="is no file of claims"):
        read_claims([Path(__file__)])
