"""Files are whole or not there."""

import os
import re
from pathlib import Path

import pytest

from omnilab.atomic_files import PART, is_process, write_whole


def test_a_file_is_written_whole_and_its_size_is_told(tmp_path):
    assert write_whole(tmp_path / "a.txt", lambda out: out.write(b"four")) == 4
    assert (tmp_path / "a.txt").read_bytes() == b"four"
    assert [path.name for path in tmp_path.iterdir()] == ["a.txt"]


@pytest.mark.parametrize(
    "error", [OSError(28, "No space left on device"), KeyboardInterrupt()], ids=["full disk", "Ctrl-C"]
)
def test_what_fails_leaves_the_file_of_before_and_nothing_else(tmp_path, error):
    (tmp_path / "a.txt").write_bytes(b"before")

    def fail(out):
        out.write(b"half")
        raise error

    with pytest.raises(type(error)):
        write_whole(tmp_path / "a.txt", fail)
    assert [path.read_bytes() for path in tmp_path.iterdir()] == [b"before"]


def test_an_unfinished_file_tells_its_writer(tmp_path):
    seen = []
    write_whole(tmp_path / "a.txt", lambda out: seen.append(Path(out.name).name))
    assert int(re.fullmatch(r"a\.txt" + PART, seen[0])["pid"]) == os.getpid()


@pytest.mark.parametrize(
    ("pid", "there"),
    [(os.getpid(), True), (1, True), (999_999_999, False), (0, False), (-1, False), (10**30, False)],
    ids=["this one", "the first", "none", "a group", "another group", "no number of a process"],
)
def test_a_process_is_known_by_its_number(pid, there):
    assert is_process(pid) is there
