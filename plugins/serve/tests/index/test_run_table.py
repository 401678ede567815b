"""The records of runs in memory, against the plain way of doing it."""

from __future__ import annotations

from hypothesis import given
from hypothesis import strategies as st

from omnilab.client import RunRecord
from omnilab_serve.index.run_table import RunTable
from omnilab_serve.index.values import in_order

records = st.builds(
    RunRecord,
    path=st.sampled_from("abcdefgh"),
    state=st.sampled_from(["done", "failed"]),
    started=st.none() | st.sampled_from(["2026-11-29T12:00:00+00:00", "2026-11-29T12:00:00.5+00:00", "2027-01-01T00:00:00+00:00"]),
    metrics=st.dictionaries(st.just("rate"), st.none() | st.floats(allow_nan=False, allow_infinity=False)),
    settings=st.dictionaries(st.sampled_from(["study.size", "size"]), st.none() | st.integers() | st.text(max_size=3)),
)  # fmt: skip
steps = st.lists(st.tuples(st.lists(records, max_size=4), st.sets(st.sampled_from("abcdefgh"), max_size=2)), max_size=6)


@given(steps)
def test_the_newest_come_first_whatever_came_and_went(steps):
    table, plain = RunTable(), dict[str, RunRecord]()
    for put, gone in steps:
        table.put(put, gone)
        for path in gone:
            plain.pop(path, None)
        plain |= {record.path: record for record in put}
        expected = sorted(plain.values(), key=lambda run: (run.started or "", run.path), reverse=True)
        assert list(table.runs()) == expected
        assert list(table.search("", "-started", 1, 2).runs) == expected[1:3]
        assert table.search("state:done", "-started", 0, 99).total == sum(run.state == "done" for run in expected)
        assert {path: table.run(path) for path in "abcdefgh"} == {path: plain.get(path) for path in "abcdefgh"}


@given(st.lists(records), st.sampled_from(["rate", "size", "study.size", "started", "state", "nothing"]))
def test_an_order_has_all_and_what_is_missing_last(runs, name):
    up, down = in_order(runs, name), in_order(runs, f"-{name}")
    assert sorted(map(id, up)) == sorted(map(id, down)) == sorted(map(id, runs))
    if name == "rate":
        for found, backwards in ((up, False), (down, True)):
            values = [run.metrics.get("rate") for run in found]
            there = [value for value in values if value is not None]
            assert values == sorted(there, reverse=backwards) + [None] * (len(values) - len(there))
