"""What differs between configurations, and nothing else."""

from __future__ import annotations

import json

import pytest
import yaml
from hypothesis import given
from hypothesis import strategies as st

from omnilab.runner.compare.comparison import compare_runs
from omnilab.runner.compare.configurations import SectionReader

NAMES = st.from_regex(r"s_[a-z_]{1,8}", fullmatch=True)
VALUES = st.recursive(
    st.none()
    | st.booleans()
    | st.integers()
    | st.floats(allow_nan=False, allow_infinity=False)
    | st.text(max_size=120),
    lambda inside: st.lists(inside, max_size=3) | st.dictionaries(NAMES, inside, max_size=3),
    max_leaves=8,
)


def flat(path, value):
    """Paths and values, by other means: as Python objects."""
    if isinstance(value, dict):
        return {k: v for name, member in value.items() for k, v in flat(f"{path}.{name}", member).items()}
    return {path: value}


@given(st.dictionaries(NAMES, VALUES, min_size=1, max_size=5))
def test_a_configuration_read_in_sections_is_the_one_read_whole(config):
    found = SectionReader().read(yaml.safe_dump(config, sort_keys=False))
    for name, value in config.items():
        whole = flat(name, value)
        assert found[name] == {
            p: one if isinstance(one, str) else json.dumps(one, ensure_ascii=False) for p, one in whole.items()
        }
    assert list(found) == list(config)


@given(st.text(alphabet="ab:\n -'\"|[]{}#&*!>?,", max_size=40))
def test_of_any_text_the_sections_are_what_the_whole_is_or_it_is_refused(text):
    try:
        found = SectionReader().read(text)
    except (ValueError, yaml.YAMLError):
        return
    whole = yaml.safe_load(text) or {}
    assert list(found) == list(whole)
    assert {p for section in found.values() for p in section} == {p for n, v in whole.items() for p in flat(n, v)}


@pytest.mark.parametrize(
    ("first", "second", "different"),
    [
        ({}, {}, {}),
        ({"seed": 1, "logs": "a"}, {"seed": 2, "logs": "b"}, {}),
        ({"angles": 45}, {"angles": 90}, {"descriptor.angles": ["45", "90"]}),
        ({"angles": "null"}, {"angles": "[1, 2]"}, {"descriptor.angles": ["null", "[1, 2]"]}),
        ({"descriptor": "hog"}, {}, {"descriptor": ["hog", "radon"]}),
        ({"descriptor": "hog", "angles": 8}, {}, {"descriptor": ["hog", "radon"]}),  # hog brings it
        (
            {"descriptor": "hog", "angles": 8, "overrides": ["descriptor.angles=8"]},
            {},
            {"descriptor": ["hog", "radon"], "descriptor.angles": ["8", "180"]},
        ),
        (
            {"version": "0.2"},
            {},
            {"descriptor": ["radon (omnilab-appearance 0.2)", "radon (omnilab-appearance 0.1.0)"]},
        ),
        ({"world": "mine.yaml"}, {"world": "copy/of/mine.yaml"}, {}),  # with one content
        ({"world": "a", "digest": "1" * 64}, {"world": "b", "digest": "2" * 64}, {"sensor.world": ["a", "b"]}),
        (
            {"digest": "1" * 64},
            {"digest": "2" * 64},
            {"sensor.world": ["room (sha256 11111111)", "room (sha256 22222222)"]},
        ),
    ],
)
def test_what_differs_is_shown_and_nothing_else(made, first, second, different):
    found = compare_runs([made("a", **first), made("b", **second)])
    assert found.groups.to_dict("list") == different


def test_a_setting_that_differs_among_runs_of_one_component_is_shown(made):
    runs = [made("a", angles=45), made("b", angles=90), made("c", descriptor="hog", angles=8)]
    assert compare_runs(runs).groups["descriptor.angles"].tolist() == ["45", "90", "8"]
