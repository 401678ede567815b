"""Fuzzed files and settings end in a result that an invariant confirms, or in one sentence; a sample, and with -m slow all."""

from __future__ import annotations

import subprocess
import sys
import time
from pathlib import Path
from random import Random

import fuzz_settings
import pytest
from fuzz_engine import Broken, Outcome, confirm, outcome_of
from fuzz_more_formats import ALL
from fuzz_mutations import mutated
from fuzz_run import table
from hypothesis import given
from hypothesis import settings as examples
from hypothesis import strategies as st

from omnilab.errors import DataError

HEAVY = (
    "world",
    "mesh",
    "graph",
    "log_rrd",
    "log_mcap",
    "within_glb",
)  # their libraries take seconds to import and to compile

FEW = 20  # examples, what tests/fuzz/conftest.py has by default


@pytest.mark.parametrize("name", [name for name in ALL if not name.startswith(HEAVY)])
def test_a_few_fuzzed_files_of_every_light_format(name: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    how = ALL[name]
    sound = how.prepare(tmp_path / "input")
    how.read(tmp_path / "input")  # as it was written, it is sound
    for number in range(5):
        seed = f"{name}:{number}"
        found = outcome_of(lambda seed=seed: how.fuzz(tmp_path / "input", sound, seed))  # type: ignore[misc]
        assert found.verdict != "failed", f"--only {seed}: {found.text}"


@pytest.fixture(scope="module")
def constructed(tmp_path_factory: pytest.TempPathFactory) -> fuzz_settings.Constructed:
    return fuzz_settings.Constructed()


@examples(max_examples=60, deadline=None)
@given(seed=st.integers(0, 2**32))
def test_a_few_settings_of_any_component(constructed: fuzz_settings.Constructed, seed: int) -> None:
    found = outcome_of(lambda: constructed(f"settings:{seed}"))
    assert found.verdict != "failed", f"--only settings:{seed}: {found.text}"


@pytest.mark.slow
@pytest.mark.timeout(0)
def test_all_families(request: pytest.FixtureRequest) -> None:
    """In processes of their own, with 2 GB each: uv run pytest tests/fuzz -m slow -s --fuzz-examples 20000

    Unless more examples are asked for, without the light formats and the settings, of which there are a few above.
    """
    count, first = (request.config.getoption(f"--fuzz-{name}") for name in ("examples", "first"))
    command = [sys.executable, Path(__file__).with_name("fuzz_run.py"), "--examples", str(count), "--first", str(first)]
    if count <= FEW:
        command += ["--family", *(name for name in ALL if name.startswith(HEAVY)), "runs"]
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    sys.stdout.write(done.stdout)
    assert done.returncode == 0, done.stdout + done.stderr


# ------------------------------------------------------------------------------------------------------------ the engine
def test_an_outcome_is_a_result_or_one_sentence() -> None:
    def raising(error: BaseException) -> Outcome:
        def use() -> None:
            raise error

        return outcome_of(use)

    assert outcome_of(lambda: None) == Outcome("ok")
    assert raising(DataError("x is 3; give 4")) == Outcome("refused", "x is 3; give 4")
    for error in (
        DataError("one\ntwo"),
        DataError(""),
        DataError("<a.B object at 0x7f>"),
        KeyError("x"),
        MemoryError(),
        SystemExit(1),
    ):
        assert raising(error).verdict == "failed"
    assert "hang" in outcome_of(lambda: time.sleep(5), seconds=1).text
    with pytest.raises(Broken, match="too much"):
        confirm(False, "too much")


def test_a_mutation_depends_on_its_seed_alone_and_changes_something() -> None:
    text = b"image,x_m,y_m\n0.png,1.5,2\n1.png,2.5,2\n"
    assert mutated(text, Random("a:1")) == mutated(text, Random("a:1"))
    made = {mutated(text, Random(f"a:{i}")) for i in range(300)}
    assert len(made) > 200
    assert any(b"nan" in each for each in made)
    assert any(len(each) < len(text) / 2 for each in made)
    assert mutated(b"", Random("a:1")) is not None


def test_counts_are_shown_by_family() -> None:
    shown = table([("a", 0, "ok", ""), ("a", 1, "failed", ""), ("b", 0, "refused", "")]).split()
    assert shown[4:] == ["a", "1", "0", "1", "b", "0", "1", "0", "all", "1", "1", "1"]


@pytest.mark.slow
def test_the_worker_limits_memory_and_its_death_is_a_failure(tmp_path: Path) -> None:
    done = subprocess.run(
        [sys.executable, Path(__file__).with_name("fuzz_run.py"), "--family", "poses_tum", "--examples", "5"],
        capture_output=True, text=True, check=False, timeout=100,
    )  # fmt: skip
    assert done.returncode == 0, done.stdout
    assert done.stdout.split()[4] == "poses_tum"
