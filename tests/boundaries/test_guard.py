"""A guarded component: as it was, but for what passes to the study; and what it raises ends no process."""

from __future__ import annotations

import pickle
from dataclasses import asdict, dataclass, fields, is_dataclass

import numpy as np
import pytest

from omnilab.api import KINDS, Descriptor, Embedder, Match, Plan, SequenceLocalizer, Signatures, Trainable
from omnilab.errors import PluginError
from omnilab.runner.boundaries import guard
from omnilab.runner.boundaries.returns import BEGUN, CHECKS, PROTOCOLS
from omnilab.runner.registry import members

TITLE = "the component"
IMAGES = np.zeros((5, 8, 8), np.uint8)
PLACES = Signatures(np.arange(16, dtype=np.float32).reshape(4, 4))
QUERIES = PLACES[:3]
ZEROS = np.zeros((3, 4), np.float32)


@dataclass
class Fails:
    """A component whose every method does the same."""

    answer: object = None

    def _answer(self, *values):
        return self.answer(*values)

    describe = plan = begin = _answer

    def frames(self, plan):
        yield self.answer(plan)


def test_a_component_sees_what_it_prepared_and_nothing_of_the_boundary():
    seen = []

    @dataclass
    class Own:
        """Calls itself."""

        def prepare(self, places):
            return places.place

        def match(self, queries, index):
            seen.append((index, self.prepare(PLACES)))
            return Match(ZEROS)

    distance = guard(Own(), "distance", TITLE)
    distance.match(QUERIES, distance.prepare(PLACES))
    distance.match(QUERIES, PLACES.place)  # prepared elsewhere
    assert all(np.shares_memory(value, PLACES.place) for pair in seen for value in pair)


@dataclass
class Plain:
    """A descriptor."""

    rows: int = 3

    view, color, rotation, default_distance = "mirror", False, "none", "cosine"

    def describe(self, images):
        return Signatures(np.ones((len(images), self.rows), np.float32))


def test_a_guarded_component_is_as_it_was():
    plain = Plain(4)
    guarded = guard(plain, "descriptor", TITLE)
    guarded.describe(IMAGES)
    assert isinstance(guarded, Plain)
    assert isinstance(guarded, Descriptor)
    assert not isinstance(guarded, Trainable | Embedder | SequenceLocalizer)
    assert is_dataclass(guarded)
    assert [f.name for f in fields(guarded)] == ["rows"]
    assert asdict(guarded) == {"rows": 4}
    assert type(guarded).__name__ == "Plain"
    assert repr(guarded).endswith("Plain(rows=4)")
    assert type(plain) is Plain
    assert vars(plain) == {"rows": 4}
    again = pickle.loads(pickle.dumps(guarded))
    assert type(again) is type(guarded)
    assert again == guarded


def test_a_mistake_within_names_the_component_in_its_traceback():
    def fail(images):
        raise ZeroDivisionError("a bug")

    with pytest.raises(ZeroDivisionError, match="a bug") as bug:
        guard(Fails(fail), "descriptor", TITLE).describe(IMAGES)
    assert bug.value.__notes__ == ["raised by the component, in describe"]


class Panic(BaseException):
    """As libraries of other languages raise it."""


@pytest.mark.parametrize("end", [SystemExit(7), Panic("in Rust")], ids=["exit", "panic"])
def test_a_component_does_not_end_the_process(end):
    def fail(*_):
        raise end

    wanted = "tried to end the process"
    for call in (
        lambda: guard(Fails(fail), "descriptor", TITLE).describe(IMAGES),
        lambda: guard(Fails(fail), "sensor", TITLE).plan(None),
        lambda: list(guard(Fails(fail), "sensor", TITLE).frames(Plan(["a"], None))),
        lambda: guard(Fails(fail), "backend", TITLE).begin(np.zeros(3)),
    ):
        with pytest.raises(PluginError, match=f"^the component, in .*{wanted}") as refused:
            call()
        assert refused.value.__cause__ is end


def test_an_interrupt_stays_one():
    def fail(*_):
        raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        guard(Fails(fail), "descriptor", TITLE).describe(IMAGES)


def test_every_kind_that_studies_are_given_is_checked():
    parts = {kind.name for kind in KINDS.values() if kind.part}
    assert parts | set(BEGUN.values()) == set(CHECKS)
    for kind, begun in BEGUN.items():
        assert set(members(PROTOCOLS[begun])) == set(CHECKS[begun])
        assert hasattr(guard(Fails(), kind, TITLE), "begin")
