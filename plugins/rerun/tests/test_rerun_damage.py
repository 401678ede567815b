"""Recordings with damaged bytes: what is found, what is kept, what is said of the rest."""

from __future__ import annotations

import os
import random
import re
import resource
import struct
import subprocess
import sys

import numpy as np
import pyarrow as pa
import pytest
from rerun.chunk import RrdReader

from omnilab.api import Panel, Series, Signature, Text, Tick, ViewLayout
from omnilab.errors import DataError
from omnilab.testing.damage import KINDS, damaged
from omnilab_rerun import RerunSink, damage
from omnilab_rerun.binary import _rrd
from omnilab_rerun.protobuf import fields

STEPS = 40
ROW_ID = "rerun.controls.RowId"


@pytest.fixture(scope="module")
def log(tmp_path_factory):
    """The bytes of a whole recording: a layout, matrices, lines, a curve."""
    folder = tmp_path_factory.mktemp("whole")
    sink, rng = RerunSink(), np.random.default_rng(0)
    sink.open(folder)
    sink.write("", ViewLayout(((Panel("image", "Signature", ("signature",)),),)), None)
    for step in range(STEPS):
        tick = Tick(step, step * 10**8)
        sink.write("signature", Signature(rng.random((12, 10), np.float32)), tick)
        sink.write("log", Text(f"step {step}"), tick)
        sink.write("error", Series(np.array([0.5]), np.array([step]), np.array([tick.stamp_ns]), "m"), tick)
        if step % 5 == 4:
            sink.flush()
    sink.close()
    return (folder / "run.rrd").read_bytes()


def messages(data):
    """Kind, start and end of every message, the table of contents (kind 0) included."""
    at = 12
    while at < len(data):
        kind, length = struct.unpack_from("<QQ", data, at)
        yield kind, at, at + 16 + length
        at += 16 + length
        if kind == 0:
            return


def rows_of(folder, data):
    """The ids of the rows in a recording, by the rows' message: start, end, ids."""
    for kind, start, end in messages(data):
        if kind == 2:
            alone = folder / "one.rrd"
            heads = b"".join(data[a:b] for k, a, b in messages(data) if k == 1)
            alone.write_bytes(data[:12] + heads + data[start:end])
            yield start, end, ids(alone)
            alone.unlink()


def ids(path):
    """The ids of the rows, as Rerun's own reader finds them in the recordings and the layouts."""
    reader, found = RrdReader(path), set()
    for entry in [*reader.recordings(), *reader.blueprints()]:
        for chunk in reader.stream(store=entry).to_chunks():
            batch = chunk.to_record_batch()
            found |= set(map(str, batch.column(batch.schema.names.index(ROW_ID)).to_pylist()))
    return found


@pytest.fixture(scope="module")
def rows(tmp_path_factory, log):
    return list(rows_of(tmp_path_factory.mktemp("alone"), log))


pytestmark = pytest.mark.filterwarnings("ignore:RRD file has no footer")


def mend(folder, data):
    """What `repair` says of a recording, and its rows, after checking that it is whole and that the damaged one was kept."""
    recording = folder / "run.rrd"
    recording.write_bytes(data)
    sentence = RerunSink().repair(folder)
    names = {path.name for path in folder.iterdir()}
    if sentence is None or "no whole footer" in sentence:
        assert names == {"run.rrd"}
    else:
        assert names == {"run.rrd", "run.rrd.damaged"}
        assert (folder / "run.rrd.damaged").read_bytes() == data
    assert _rrd("verify", recording).returncode == 0
    RrdReader(recording).store().schema()  # needs the footer
    return sentence, ids(recording)


def check_damages(folder, log, rows, kind, seeds):
    """All rows of whole messages are kept, before and after the damage, and the programs of Rerun read the result."""
    for seed in seeds:
        data, (start, end) = damaged(log, kind, random.Random(f"{kind} {seed}"))
        wanted = set().union(*(inside for a, b, inside in rows if b <= start or end <= a or data == log))
        if not wanted:  # an early cut
            continue
        sub = folder / str(seed)
        sub.mkdir()
        sentence, kept = mend(sub, data)
        assert wanted <= kept, f"seed {seed}: {sentence}"


@pytest.mark.parametrize("kind", KINDS)
def test_whole_messages_survive_any_damage(tmp_path, log, rows, kind):
    check_damages(tmp_path, log, rows, kind, range(3))


@pytest.mark.slow
@pytest.mark.timeout(3600)
@pytest.mark.parametrize("kind", KINDS)
def test_whole_messages_survive_ten_damages_of_each_kind(tmp_path, log, rows, kind):
    check_damages(tmp_path, log, rows, kind, range(100, 110))


def test_a_lost_last_byte_costs_its_message_and_not_the_next(tmp_path, log, rows):
    """The first byte of the next message is read in its place: a truth value of 2."""
    for number in (len(rows) // 2, len(rows) // 2 + 1):
        _, end, _ = rows[number]
        folder = tmp_path / str(number)
        folder.mkdir()
        sentence, kept = mend(folder, log[: end - 1] + log[end:])
        assert set().union(*(inside for _, b, inside in rows if b != end)) <= kept, sentence
        assert not rows[number][2] & kept


def test_a_zeroed_tail_costs_what_was_in_it(tmp_path, log, rows):
    """As a power cut leaves it: the file has its length, its last blocks were never written."""
    start, end, _ = rows[len(rows) // 2]
    cut = (start + end) // 2
    sentence, kept = mend(tmp_path, log[:cut] + bytes(len(log) - cut))
    assert "no whole footer" in sentence
    assert kept == set().union(*(inside for _, b, inside in rows if b <= cut))


def test_a_hole_costs_the_messages_in_it(tmp_path, log, rows):
    start, end, lost = rows[len(rows) // 2]
    sentence, kept = mend(tmp_path, log[: start + 5] + bytes(end - start - 5) + log[end:])
    assert f"{end - start} of {len(log)} bytes could not be read, at bytes {start} to {end}, logged from 20" in sentence
    assert kept == set().union(*(inside for *_, inside in rows)) - lost


def test_a_damaged_header_or_footer_costs_nothing(tmp_path, log, rows):
    for name, at in [("magic", 1), ("version", 5), ("packing", 8), ("contents", -200), ("checksum", -14), ("end", -6)]:
        folder = tmp_path / name
        folder.mkdir()
        bad = bytearray(log)
        bad[at] ^= 0x40
        sentence, kept = mend(folder, bytes(bad))
        assert sentence, name
        assert kept == set().union(*(inside for *_, inside in rows)), name


def test_the_footer_of_a_shorter_recording_is_not_believed(tmp_path, log, rows):
    contents = next(start for kind, start, _ in messages(log) if kind == 0)
    start, _, lost = rows[-1]
    sentence, kept = mend(tmp_path, log[:start] + log[contents:])
    assert sentence
    assert kept == set().union(*(inside for *_, inside in rows)) - lost


def with_columns(log, row, change):
    """The recording in which a message has other columns: `change` of each field of its schema."""
    start, end, _ = row
    found = fields(log[start + 16 : end])
    batch = damage._batch(found)
    schema = pa.schema([change(column) for column in batch.schema], batch.schema.metadata)
    payload = pa.BufferOutputStream()
    with pa.ipc.new_stream(payload, schema) as out:
        out.write_batch(pa.record_batch(batch.columns, schema))
    rows = field(5, payload.getvalue().to_pybytes())
    body = field(1, found[1]) + b"\x10\x01\x18\0\x20\x01" + rows + field(6, found[6])
    return log[:start] + struct.pack("<QQ", 2, len(body)) + body + log[end:]


def renamed(new):
    """A change of columns: the matrix has another name."""
    return lambda column: column.with_name(new) if column.name == "DepthImage:buffer" else column


def test_a_message_that_only_the_program_refuses_is_left_out(tmp_path, log, rows):
    """Sound Arrow data, but with columns of a kind that there is not."""
    row = rows[len(rows) // 2]
    every = set().union(*(inside for *_, inside in rows))
    (tmp_path / "same").mkdir()
    assert mend(tmp_path / "same", with_columns(log, row, lambda column: column))[1] == every
    (tmp_path / "odd").mkdir()
    odd = with_columns(log, row, lambda c: c.with_metadata({b"rerun:kind": b"nonsense"}))
    sentence, kept = mend(tmp_path / "odd", odd)
    assert "was damaged" in sentence
    assert kept == every - row[2]


@pytest.mark.parametrize("name", ["DepthImage:bu\0fer", "DepthImage:buffet"])
def test_a_column_whose_name_is_damaged_is_left_out(tmp_path, log, rows, name):
    """Rerun's program takes both, and its reader in Python ends the process at the first."""
    row = next(row for row in reversed(rows) if b"/signature" in log[row[0] : row[1]])
    sentence, kept = mend(tmp_path, with_columns(log, row, renamed(name)))
    assert "was damaged" in sentence
    assert kept == set().union(*(inside for *_, inside in rows)) - row[2]


def field(number, content):
    """A field of a protobuf message."""
    length, count = b"", len(content)
    while count > 0x7F:
        length, count = length + bytes([count & 0x7F | 0x80]), count >> 7
    return bytes([number << 3 | 2]) + length + bytes([count]) + content


def test_a_misspelt_recording_is_no_second_one(tmp_path, log, rows):
    start, end, lost = rows[len(rows) // 2]
    name = log.index(b"whole", start, end)
    sentence, kept = mend(tmp_path, log[:name] + b"whale" + log[name + 5 :])
    assert "was damaged" in sentence
    assert kept == set().union(*(inside for *_, inside in rows)) - lost
    assert len(RrdReader(tmp_path / "run.rrd").recordings()) == 1


@pytest.mark.parametrize(
    "data", [b"", bytes(5000), b"RRF2", b"something of yours " * 99], ids=["empty", "zeros", "short", "text"]
)
def test_what_holds_nothing_is_left_as_it_is(tmp_path, data):
    (tmp_path / "run.rrd").write_bytes(data)
    with pytest.raises(DataError, match=r"run\.rrd cannot be read back .*; run the experiment again"):
        RerunSink().repair(tmp_path)
    assert (tmp_path / "run.rrd").read_bytes() == data
    assert [file.name for file in tmp_path.iterdir()] == ["run.rrd"]


def test_a_message_that_would_fill_the_memory_is_not_unpacked(tmp_path, log, rows):
    start, end, _ = rows[-1]
    content = fields(log[start + 16 : end])
    body = b"\x0a" + bytes([len(content[1])]) + content[1] + b"\x10\x02\x18" + b"\xff\xff\xff\xff\x7f" + b"\x20\x01"
    body += b"\x2a\x04\0\0\0\0"
    bomb = struct.pack("<QQ", 2, len(body)) + body
    sentence, kept = mend(tmp_path, log[:end] + bomb + log[end:])
    assert "was damaged" in sentence
    assert kept == set().union(*(inside for *_, inside in rows))


def test_a_link_or_a_pipe_is_not_looked_into(tmp_path, log):
    (tmp_path / "elsewhere").write_bytes(log[:-1])
    (tmp_path / "run.rrd").symlink_to(tmp_path / "elsewhere")
    with pytest.raises(DataError, match=r"run\.rrd is a link, and logs are files"):
        RerunSink().repair(tmp_path)
    (tmp_path / "run.rrd").unlink()
    os.mkfifo(tmp_path / "run.rrd")
    with pytest.raises(DataError, match=r"run\.rrd is a pipe"):
        RerunSink().repair(tmp_path)


def test_a_full_disk_leaves_everything_as_it_was(tmp_path, log):
    (tmp_path / "run.rrd").write_bytes(log[:-40])
    code = (
        "import sys; from pathlib import Path; from omnilab_rerun import RerunSink; from omnilab.errors import DataError\n"
        "try: RerunSink().repair(Path(sys.argv[1]))\nexcept DataError as error: print(error)"
    )
    done = subprocess.run(
        [sys.executable, "-c", code, tmp_path], capture_output=True, text=True, check=True, timeout=200,
        preexec_fn=lambda: resource.setrlimit(resource.RLIMIT_FSIZE, (20_000, 20_000)),
    )  # fmt: skip
    assert re.search(r"run\.rrd cannot be mended in its place \(.*\) and is as it was", done.stdout)
    assert [path.name for path in tmp_path.iterdir()] == ["run.rrd"]
    assert (tmp_path / "run.rrd").read_bytes() == log[:-40]
