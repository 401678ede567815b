"""What is promised of results, logs and files of users holds when commands are killed, starved or disturbed; a sample.

More: uv run python tests/torture/torture_run.py --kill 300 --instant 100 --full 50 --seed 1
"""

from __future__ import annotations

import errno
import os
import signal
import subprocess
import sys
from collections import defaultdict
from collections.abc import Mapping
from pathlib import Path

import pytest
import torture_promises as promises
from torture_commands import Ended, Skipped, forked, why_not
from torture_run import table

from omnilab.errors import DataError

HEAD = promises.HEAD
RUN = Path(__file__).with_name("torture_run.py")
SAMPLE = {  # the first case of families which no other test has, on the scenarios `map`, `run` and `sweep`
    "instant": 1, "identity": 1,
}  # fmt: skip
Survey = dict[str, list[tuple[str, str]]]

pytestmark = pytest.mark.skipif(bool(why_not()), reason=why_not())


def survey_of(cases: Mapping[str, int], seed: int) -> Survey:
    """Verdict and text of each case, by family."""
    options = [word for family, count in cases.items() for word in (f"--{family}", str(count))]
    done = subprocess.run(
        [sys.executable, RUN, *options, "--seed", str(seed)], capture_output=True, text=True, check=False
    )
    found: Survey = defaultdict(list)
    for line in done.stdout.splitlines():
        if line.count("\t") == 2:
            name, verdict, text = line.split("\t")
            found[name.partition(":")[0]].append((verdict, f"--only {name}: {text}"))
        elif line.startswith("    ") and found:
            verdict, text = found[name.partition(":")[0]][-1]
            found[name.partition(":")[0]][-1] = verdict, f"{text}\n{line}"
    assert {family: len(each) for family, each in found.items()} == dict(cases), done.stdout + done.stderr
    return found


def check(found: list[tuple[str, str]]) -> None:
    broken = [text for verdict, text in found if verdict == "broken"]
    assert not broken, "\n\n".join(broken)
    if all(verdict == "skipped" for verdict, _ in found):
        pytest.skip(found[0][1])


@pytest.fixture(scope="module")
def sample() -> Survey:
    return survey_of(SAMPLE, 11)


@pytest.mark.slow
@pytest.mark.timeout(1800)
@pytest.mark.parametrize("family", SAMPLE)
def test_a_sample_of_cases(sample: Survey, family: str) -> None:
    check(sample[family])


# ----------------------------------------------------------------------------------------------------------- the tools
PROGRAM = """
import ctypes, os, sys
ctypes.CDLL(None).torture_begin()
os.mkdir("a")
with open("a/b", "wb", buffering=0) as file:
    file.write(b"12345678")
os.rename("a/b", "a/c")
open(os.path.abspath("../beside"), "w").close()
open("a/c").read()
"""


def disturbed(
    tmp_path: Path, action: str, at: int = 0, number: int = 0, torn: bool = False
) -> tuple[int, str, list[str]]:
    """Exit code, errors and operations of a program on which faults.c works."""
    from torture_commands import ACTIONS, PLAN, _operations

    library, here = tmp_path / "faults.so", tmp_path / "here"
    here.mkdir()
    subprocess.run(["cc", "-shared", "-fPIC", "-o", library, RUN.with_name("faults.c"), "-ldl"], check=True)
    log = tmp_path / "operations"
    plan = PLAN.pack(0, at, ACTIONS.index(action), number, torn, str(here.resolve()).encode(), str(log).encode())
    (tmp_path / "plan").write_bytes(plan)
    env = os.environ | {"LD_PRELOAD": str(library), "TORTURE_PLAN": str(tmp_path / "plan")}
    done = subprocess.run(
        [sys.executable, "-c", PROGRAM], cwd=here, env=env, capture_output=True, text=True, check=False
    )
    return done.returncode, done.stderr, [each.name for each in _operations(log)]


def test_every_operation_below_the_folder_is_counted_and_no_other(tmp_path: Path) -> None:
    assert disturbed(tmp_path, "nothing") == (0, "", ["mkdir", "open", "write", "rename"])


def test_a_kill_comes_within_the_operation_that_was_chosen(tmp_path: Path) -> None:
    code, _, operations = disturbed(tmp_path, "kill", 3, torn=True)
    assert (code, operations[-1]) == (-signal.SIGKILL, "write")
    assert (tmp_path / "here/a/b").read_bytes() == b"1234"


def test_a_full_disk_takes_names_but_no_bytes(tmp_path: Path) -> None:
    code, errors, _ = disturbed(tmp_path, "fail", 2, errno.ENOSPC)
    assert code == 1
    assert "No space left on device: 'a/b'" in errors
    assert list((tmp_path / "here/a").iterdir()) == []


def test_what_is_torn_or_differs_is_found(tmp_path: Path) -> None:
    for name, content in {"a.csv": "a,b\n1,2", "b.json": "{", "c.csv": "a,b\n1,2\n", "d.csv.part": "a"}.items():
        (tmp_path / name).write_text(content)
    assert [sentence.split()[0] for sentence in promises.torn_files(tmp_path)] == ["a.csv", "b.json"]
    assert list(promises.differences({"a": b"1"}, {"a": b"1"})) == []
    assert len(list(promises.differences({"a": b"1", "b": b""}, {"a": b"2"}))) == 2


@pytest.mark.parametrize(
    ("data", "nothing"),
    [
        (b"", True), (b"h" * 12, True), (b"h" * 12 + HEAD.pack(1, 4) + b"abcd", True), (b"h" * 12 + HEAD.pack(2, 4) + b"abc", True),
        (b"h" * 12 + HEAD.pack(1, 4) + b"abcd" + HEAD.pack(2, 4) + b"abcd", False),
    ],
)  # fmt: skip
def test_a_recording_torn_before_its_first_rows_holds_nothing(tmp_path: Path, data: bytes, nothing: bool) -> None:
    assert not promises.holds_nothing(tmp_path / "run.rrd")
    (tmp_path / "run.rrd").write_bytes(data)
    assert promises.holds_nothing(tmp_path / "run.rrd") is nothing


def test_planted_files_are_missed(tmp_path: Path) -> None:
    promises.plant(tmp_path)
    before = promises.planted(tmp_path)
    assert len(before) == 4
    next(iter(before)).write_text("other")
    assert len(promises.planted(tmp_path)) == 3


@pytest.mark.parametrize(
    ("code", "stderr", "broken"),
    [(0, "", 0), (2, "omnilab: a; do b\n", 0), (2, "", 1), (1, "Traceback (most recent call last)", 1), (2, "omnilab: a\n" * 99, 1)],
)  # fmt: skip
def test_a_user_is_told_in_sentences(code: int, stderr: str, broken: int) -> None:
    assert len(list(promises.sentences(Ended(code, "", stderr)))) == broken


def test_a_function_in_a_process_of_its_own() -> None:
    def raising(error: Exception) -> None:
        raise error

    assert forked(os.getpid) != os.getpid()
    with pytest.raises(Skipped, match="no mounts"):
        forked(raising, Skipped("no mounts"))
    with pytest.raises(RuntimeError, match="DataError: x"):
        forked(raising, DataError("x"))


def test_counts_are_shown_by_family() -> None:
    shown = table([("kill:0-0", "kept", ""), ("kill:0-1", "broken", ""), ("disk:0-0", "skipped", "")]).split()
    assert shown[4:] == ["kill", "1", "1", "0", "disk", "0", "0", "1", "all", "1", "1", "1"]
