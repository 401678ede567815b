"""The language in which runs are searched."""

import pytest
from hypothesis import given
from hypothesis import strategies as st

from omnilab.client import RunRecord
from omnilab.errors import ConfigError
from omnilab_serve.index.query import parse

RUN = RunRecord(
    "grid/2026-11-29_17-10-04-6d9dd4/3",
    "failed",
    experiment="grid",
    overrides=["seed=1", "sensor.world=Dark Room.yaml"],
    components={"descriptor": "radon", "pairs.loop.descriptor": "hog", "study": "grid"},
    settings={"study.step_m": 0.25, "sensor.size": 64, "seed": 1, "sensor.depth": False, "cache": "off", "map": None},
    metrics={"nearest_rate": 0.8, "wrong_rate": None},
    host="node-17",
)


@pytest.mark.parametrize(
    "query",
    [
        "", "  ", "grid", "GRID node-17", '"dark room"', "state:failed", "state:FAIL*", "experiment:grid", "-state:done",
        "descriptor:radon", "descriptor:hog", "-descriptor:gist", "seed:1", "seed=1", "seed:1.0", "step_m>0.2",
        "study.step_m<=0.25", "step_m<1", "nearest_rate>=0.8", "-nearest_rate>0.8", "depth:false", "map:null", "cache:off",
        "host:node-*", "path:grid/*", "-nothing_like_it>3", 'experiment:"grid"', '-"no such words"',
        "grid state:failed step_m>0.2 -seed:2",
    ],
)  # fmt: skip
def test_a_run_that_a_query_finds(query):
    assert parse(query).matches(RUN)


@pytest.mark.parametrize(
    "query",
    [
        "outdoor", "state:done", "state:fail", "-grid", "descriptor:gist", "study.descriptor:radon", "seed:2", "step_m>0.25",
        "step_m<0.25", "wrong_rate>=0", "wrong_rate<=1", "cache>0", "depth<1", "nothing_like_it>3", '"room dark"',
        "state:failed state:done", "path:grid", "host:node-[0-9]*",
    ],
)  # fmt: skip
def test_a_run_that_a_query_does_not_find(query):
    assert not parse(query).matches(RUN)


@pytest.mark.parametrize(
    ("query", "sentence"),
    [
        ("step_m>", "the filter step_m> says nothing to compare with; write, for example, step_m>0.2"),
        ("step_m>wide", "the filter step_m>wide needs a number behind >, not wide; for a text write step_m:wide"),
        ("state:", "the filter state: says nothing to compare with; write, for example, state:value"),
        ("a -", "the filter - says nothing to compare with; write, for example, -state:failed"),
        ('two "words', 'a quote is open in the filter two "words; close it, as in "two words"'),
        ("step_m>nan", "the filter step_m>nan needs a number behind >, not nan; for a text write step_m:nan"),
        ("x" * 1001, "the filter has 1001 characters; give up to 1000"),
    ],
)
def test_what_cannot_be_read_is_said(query, sentence):
    with pytest.raises(ConfigError) as error:
        parse(query)
    assert str(error.value) == sentence


words = st.text(st.characters(exclude_categories=["Cs"]), max_size=30)
queries = st.one_of(
    words, st.lists(st.sampled_from(["state:", "-", '"', "seed", ">=", "0.5", " ", "*", "[", "é"])).map("".join)
)


@given(queries)
def test_any_text_is_a_query_or_refused_in_a_sentence(text):
    sentence = ""
    try:
        matches = parse(text).matches(RUN)
    except ConfigError as error:
        matches, sentence = None, str(error)
    assert matches in (True, False) or sentence.startswith(("the filter", "a quote is open"))


@given(st.floats(-1e6, 1e6), st.floats(-1e6, 1e6))
def test_numbers_compare_as_numbers(value, limit):
    run = RunRecord("a", "done", metrics={"error_m": value})
    holds = {">": value > limit, ">=": value >= limit, "<": value < limit, "<=": value <= limit, ":": value == limit}
    assert {sign: parse(f"error_m{sign}{limit!r}").matches(run) for sign in holds} == holds
    assert {sign: not parse(f"-error_m{sign}{limit!r}").matches(run) for sign in holds} == holds


@given(words.filter(lambda text: '"' not in text and text.strip()), words, words)
def test_a_word_in_quotes_is_found_where_it_stands(word, before, after):
    run = RunRecord("a/b", "done", overrides=[f"note={before}{word}{after}"])
    if f"{before}{word}{after}".casefold().find(word.casefold()) >= 0:
        assert parse(f'"{word}"').matches(run)
        assert not parse(f'-"{word}"').matches(run)
