"""One run in shards, from a form: offered for what can be split, submitted as a sweep, refused in a sentence."""

import pytest

from omnilab.runner.registry import discover
from omnilab.runner.shards.words import in_shards
from omnilab_serve.composing.checking import MOST_SHARDS, check
from omnilab_serve.composing.composer import SettingError
from omnilab_serve.composing.filled import Filled, filled_by
from omnilab_serve.composing.form import form


@pytest.fixture(scope="module")
def registry():
    return discover()


class Here:
    """A composer in this process."""

    def __init__(self, registry):
        self.registry = registry

    def form(self, experiment, choices=()):
        return form(self.registry, experiment, choices)


def offered(form):
    return [each["path"] for slot in form["slots"] for each in slot["settings"] if each["path"] == "shards"]


def test_a_study_that_can_be_split_has_a_field_for_it(registry):
    assert offered(form(registry, "grid")) == ["shards"]
    assert offered(form(registry, "pose_graph")) == []
    words = ["experiment=grid", "shards=3"]
    filled = Filled("grid", {"set:shards": ["3"]}, [])
    assert filled.words(Here(registry)) == words
    assert filled_by("grid", words[1:], Here(registry)) == filled


@pytest.mark.slow
def test_shards_are_submitted_as_the_sweep_of_the_command_line(registry, tmp_path):
    for launcher in ("basic", "joblib"):
        found = check(registry, ["experiment=grid", "shards=3"], launcher, str(tmp_path), [])
        words = ["-m", "experiment=grid", f"hydra/launcher={launcher}", "shards=3"]
        assert found["command"] == in_shards(words, registry, lambda _: None)
        assert found["jobs"] == 7


@pytest.mark.parametrize(
    ("words", "sentence"),
    [
        ([f"shards={MOST_SHARDS + 1}"], "is more than is asked of a service; give shards=999 or fewer"),
        (["shards=" + "9" * 5000], "is more than is asked of a service"),
        (["shards=two"], "shards=two is no number of shards"),
        (["shards=2", "seed=1,2"], "shards=2 splits one run, and the command varies seed"),
        (["shards=2", "shards=3"], "is no number of shards"),
    ],
)
def test_what_cannot_be_split_is_refused_at_the_field(words, sentence, registry, tmp_path):
    with pytest.raises(SettingError) as refused:
        check(registry, ["experiment=grid", *words], "basic", str(tmp_path), [])
    assert sentence in str(refused.value)
    assert refused.value.setting == "shards"
