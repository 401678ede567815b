"""Logs of runs that were killed, and files that are no logs."""

import os
import subprocess
import sys

import pytest
import zstandard
from hypothesis import given
from hypothesis import strategies as st
from mcap.data_stream import RecordBuilder
from mcap.reader import make_reader
from mcap.records import Chunk

from omnilab import api
from omnilab.errors import DataError
from omnilab_mcap import McapSink

FLUSHED = 6


@pytest.fixture(scope="module")
def unfinished(tmp_path_factory):
    """The bytes of a log that was never closed, and its size after each of its messages."""
    folder, sizes = tmp_path_factory.mktemp("unfinished"), []
    sink = McapSink()
    sink.open(folder)
    for step in range(FLUSHED):
        sink.write("/log", api.Text(f"step {step}"), api.Tick(step, step))
        sink.flush()
        sizes.append((folder / "run.mcap").stat().st_size)
    data = (folder / "run.mcap").read_bytes()
    sink.close()
    return data, sizes, (folder / "run.mcap").read_bytes()


def mended(folder, data, read, damaged=()):
    """What `repair` says of a file, and the texts of /log afterwards. `damaged`: the names under which it may be kept."""
    (folder / "run.mcap").write_bytes(data)
    sentence = McapSink().repair(folder)
    assert {path.name for path in folder.iterdir()} - set(damaged) == {"run.mcap"}
    with (folder / "run.mcap").open("rb") as file:
        assert make_reader(file).get_summary() is not None
    return sentence, [entry.decoded.message for entry in read(folder / "run.mcap")["/log"]]


@given(st.data())
def test_torn_anywhere(tmp_path_factory, read, unfinished, data):
    log, sizes, _ = unfinished
    cut = data.draw(st.integers(0, len(log)))
    sentence, texts = mended(tmp_path_factory.mktemp("torn"), log[:cut], read)
    assert sentence == f"run.mcap was torn: {len(texts)} messages were kept and indexed again"
    assert texts == [f"step {step}" for step in range(len(texts))]
    assert len(texts) >= sum(size <= cut for size in sizes)


@pytest.mark.parametrize("lost", range(1, 201))
def test_torn_at_every_byte_of_the_end(tmp_path, read, unfinished, lost):
    sentence, texts = mended(tmp_path, unfinished[2][:-lost], read)
    assert sentence == f"run.mcap was torn: {FLUSHED} messages were kept and indexed again"
    assert len(texts) == FLUSHED


@given(st.data())
def test_damaged_anywhere(tmp_path_factory, read, unfinished, data):
    log, _, _ = unfinished
    at = data.draw(st.integers(8, len(log) - 1))
    damaged = bytearray(log)
    damaged[at : at + 9] = data.draw(st.binary(min_size=9, max_size=9))
    _, texts = mended(tmp_path_factory.mktemp("damaged"), bytes(damaged[: len(log)]), read, ["run.mcap.damaged"])
    assert set(texts) <= {f"step {step}" for step in range(FLUSHED)}


KILLED = """
import sys, time
from pathlib import Path
from omnilab import api
from omnilab_mcap import McapSink

sink = McapSink()
sink.open(Path(sys.argv[1]))
for step in range(100_000):
    sink.write("/log", api.Text(f"step {step}"), api.Tick(step, step))
    if step % 50 == 49:
        sink.flush()
        print(step, flush=True)
    time.sleep(0.002)
"""


def test_killed_run_keeps_all_that_was_flushed(tmp_path, read):
    with subprocess.Popen([sys.executable, "-c", KILLED, tmp_path], stdout=subprocess.PIPE, text=True) as process:
        for _ in range(3):
            flushed = int(process.stdout.readline())
        process.kill()
    assert process.returncode < 0
    sentence = McapSink().repair(tmp_path)
    texts = [entry.decoded.message for entry in read(tmp_path / "run.mcap")["/log"]]
    assert len(texts) > flushed
    assert texts == [f"step {step}" for step in range(len(texts))]
    assert sentence == f"run.mcap was torn: {len(texts)} messages were kept and indexed again"


def test_mending_keeps_every_record(tmp_path, run):
    (tmp_path / "run.mcap").write_bytes((run / "run.mcap").read_bytes()[:-1])
    McapSink().repair(tmp_path)
    with (run / "run.mcap").open("rb") as before, (tmp_path / "run.mcap").open("rb") as after:
        whole, mended = make_reader(before), make_reader(after)
        assert list(mended.iter_messages()) == list(whole.iter_messages())
        assert list(mended.iter_metadata()) == list(whole.iter_metadata())


def test_whole_log_is_left_alone(tmp_path, unfinished):
    (tmp_path / "run.mcap").write_bytes(unfinished[2])
    assert McapSink().repair(tmp_path) is None
    assert (tmp_path / "run.mcap").read_bytes() == unfinished[2]


def test_no_log_needs_no_mending(tmp_path):
    assert McapSink().repair(tmp_path) is None
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize("garbage", [b"x", b"not a log, but something of yours", bytes(100)])
def test_what_is_no_log_is_refused_and_kept(tmp_path, garbage):
    (tmp_path / "run.mcap").write_bytes(garbage)
    with pytest.raises(DataError, match=r"run.mcap is not an MCAP log \(it starts with b'.*'\); move it away"):
        McapSink().repair(tmp_path)
    assert (tmp_path / "run.mcap").read_bytes() == garbage


def test_chunk_that_unpacks_to_more_than_it_says_is_left_out(tmp_path, unfinished, read):
    bomb = zstandard.compress(bytes(1 << 20))
    chunk = RecordBuilder()
    Chunk("zstd", bomb, message_start_time=0, message_end_time=0, uncompressed_crc=0, uncompressed_size=9).write(chunk)
    _, texts = mended(tmp_path, unfinished[0] + chunk.end(), read, ["run.mcap.damaged"])
    assert len(texts) == FLUSHED


def test_a_link_or_a_pipe_is_not_looked_into(tmp_path, own):
    (tmp_path / "elsewhere").write_bytes(own[:-1])
    (tmp_path / "run.mcap").symlink_to(tmp_path / "elsewhere")
    with pytest.raises(DataError, match=r"run\.mcap is a link, and logs are files"):
        McapSink().repair(tmp_path)
    assert (tmp_path / "elsewhere").read_bytes() == own[:-1]
    (tmp_path / "run.mcap").unlink()
    os.mkfifo(tmp_path / "run.mcap")
    with pytest.raises(DataError, match=r"run\.mcap is a pipe"):
        McapSink().repair(tmp_path)


def test_the_mended_log_has_the_permissions_of_the_damaged_one(tmp_path, own):
    log = tmp_path / "run.mcap"
    log.write_bytes(own[:-9])
    log.chmod(0o640)
    McapSink().repair(tmp_path)
    assert log.stat().st_mode & 0o777 == 0o640


def test_a_second_damage_is_kept_beside_the_first(tmp_path, own):
    at = own.index(b"zstd") + 100
    bad = own[:at] + bytes(5) + own[at + 5 :]
    (tmp_path / "run.mcap.damaged").write_bytes(b"mine")
    (tmp_path / "run.mcap").write_bytes(bad)
    assert McapSink().repair(tmp_path).endswith("kept as run.mcap.damaged-2")
    assert (tmp_path / "run.mcap.damaged").read_bytes() == b"mine"
    assert (tmp_path / "run.mcap.damaged-2").read_bytes() == bad


def test_a_full_disk_leaves_everything_as_it_was(tmp_path, own):
    at = own.index(b"zstd") + 100
    bad = own[:at] + bytes(5) + own[at + 5 :]
    (tmp_path / "run.mcap").write_bytes(bad)
    code = f"""
import resource, sys
from pathlib import Path
from omnilab.errors import DataError
from omnilab_mcap import McapSink
resource.setrlimit(resource.RLIMIT_FSIZE, ({len(own) // 2},) * 2)
try:
    McapSink().repair(Path(sys.argv[1]))
except DataError as error:
    print(error)
"""
    done = subprocess.run([sys.executable, "-c", code, tmp_path], capture_output=True, text=True, check=True)
    assert "run.mcap cannot be mended in its place (File too large) and is as it was" in done.stdout
    assert [path.name for path in tmp_path.iterdir()] == ["run.mcap"]
    assert (tmp_path / "run.mcap").read_bytes() == bad


def test_what_killed_repairs_had_begun_is_removed(tmp_path, own):
    (tmp_path / "run.mcap").write_bytes(own[:-9])
    (tmp_path / "run.mcap.999999999-01234567.part").write_bytes(own[:99])
    (tmp_path / "run.mcap.mine.part").write_bytes(b"mine")
    assert "was torn" in McapSink().repair(tmp_path)
    assert {path.name for path in tmp_path.iterdir()} == {"run.mcap", "run.mcap.mine.part"}
