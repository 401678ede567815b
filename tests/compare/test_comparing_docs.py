"""docs/comparing.md: every command and the example run, and every option is named."""

from __future__ import annotations

import re
import shlex
from pathlib import Path

from omnilab.runner.compare.command import _parser

DOCUMENT = (Path(__file__).parents[2] / "docs/comparing.md").read_text(encoding="utf-8")


def test_commands_and_example_run(omnilab_here, made, capsys):
    jobs = [(angles, step_m, seed) for angles in (45, 90) for step_m in (0.2, 0.4) for seed in (0, 1)]
    for i, (angles, step_m, seed) in enumerate(jobs):
        queries = {"query": [0, 1, 2], "key": list("abc"), "truth_x_m": [1.0, 2.0, 3.0], "error_m": [angles, i, i * i]}
        made(f"SWEEP/{i}", angles=angles, step_m=step_m, seed=seed, rate=angles / 100, queries=queries)
    (commands,) = re.findall(r"```sh\n(.*?)```", DOCUMENT, flags=re.DOTALL)
    for line in commands.splitlines():
        words = shlex.split(line, comments=True)
        done = omnilab_here(*words[1:])
        assert done.rc == 0, (line, done.stderr)
        assert "nearest_rate" in done.stdout or "error_median" in done.stdout
    assert len(list(Path("figures").glob("*.png"))) == 4
    (example,) = re.findall(r"```python\n(.*?)```", DOCUMENT, flags=re.DOTALL)
    exec(compile(example, "comparing.md", "exec"), {})
    assert "Student's t over seeds" in capsys.readouterr().out


def test_every_option_is_in_the_document():
    options = [option for action in _parser()._actions for option in action.option_strings if option.startswith("--")]
    assert [option for option in options if option not in DOCUMENT and option != "--help"] == []
