import json
from pathlib import Path

import numpy as np
from omnilab import Metric, RunResult, Series
from omnilab.runner.authoring.templates.components.sink import MySink
from omnilab.testing import check_sink


def test_it_keeps_the_contract() -> None:
    check_sink(MySink())


def test_what_it_writes_is_read_back(tmp_path: Path) -> None:
    sink = MySink(file="lines.jsonl")
    sink.open(tmp_path)
    steps = np.arange(2)
    sink.write("error", Series(np.array([0.5, 0.25]), steps, steps, "m"), None)
    sink.conclude(RunResult("done", [Metric("rate", 1.0, "1")]))
    sink.close()
    lines = (tmp_path / "lines.jsonl").read_text(encoding="utf-8").splitlines()
    assert [json.loads(line) for line in lines] == [
        {"path": "error", "step": 0, "value": 0.5, "unit": "m"},
        {"path": "error", "step": 1, "value": 0.25, "unit": "m"},
        {"metric": "rate", "value": 1.0, "unit": "1"},
        {"status": "done", "error": ""},
    ]


def test_a_torn_line_is_cut_off(tmp_path: Path) -> None:
    file = tmp_path / "lines.jsonl"
    file.write_text('{"value": 1}\n{"val', encoding="utf-8")
    sink = MySink(file="lines.jsonl")
    assert sink.repair(tmp_path) is not None
    assert file.read_text(encoding="utf-8") == '{"value": 1}\n'
    assert sink.repair(tmp_path) is None
