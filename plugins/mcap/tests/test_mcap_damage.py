"""Logs with damaged bytes: what is found, what is kept, what is said of the rest."""

import contextlib
import io
import pathlib
import random
import struct
import subprocess
import sys
import time
from collections import Counter

import lz4.frame
import pytest
import zstandard
from mcap.data_stream import ReadDataStream, RecordBuilder
from mcap.reader import NonSeekingReader, make_reader
from mcap.records import Channel, Chunk, Message
from mcap.stream_reader import breakup_chunk
from mcap.writer import MCAP0_MAGIC, CompressionType, IndexType, Writer

from omnilab.errors import DataError
from omnilab.testing.damage import KINDS, damaged
from omnilab_mcap import McapSink
from omnilab_mcap.chunks import LARGEST_BYTES

PER_CHUNK = 10
CHUNKS = 8


def written(**options):
    """A log by the format's own writer: metadata, an attachment, CHUNKS chunks of PER_CHUNK messages."""
    out = io.BytesIO()
    writer = Writer(out, **options)
    writer.start("some-profile")
    writer.add_metadata("about", {"kind": "test"})
    writer.add_attachment(1, 2, "notes.txt", "text/plain", b"some notes")
    rng = random.Random(0)
    schema = writer.register_schema("any", "jsonschema", b"{}")
    channels = [writer.register_channel(topic, "json", schema) for topic in ("/even", "/odd")]
    for step in range(PER_CHUNK * CHUNKS):
        writer.add_message(channels[step % 2], 10**18 + step * 10**9, rng.randbytes(300), step, step)
        if step % PER_CHUNK == PER_CHUNK - 1:
            writer.flush()
    writer.finish()
    return out.getvalue()


def records(data):
    """Opcode, start and end of every record outside of chunks."""
    at = 8
    while at < len(data) - 8:
        opcode, length = struct.unpack_from("<BQ", data, at)
        yield opcode, at, at + 9 + length
        at += 9 + length


def chunks(data):
    """Start and end of every chunk, and its messages."""
    channels = {}
    for opcode, start, end in records(data):
        if opcode == 6:
            inside = breakup_chunk(Chunk.read(ReadDataStream(io.BytesIO(data[start + 9 : end]))))
            channels |= {record.id: record for record in inside if isinstance(record, Channel)}
            yield start, end, [entry(record) for record in inside if isinstance(record, Message)]


def entry(message):
    return message.log_time, message.sequence, bytes(message.data)


def read_back(path):
    """The messages, as two readers of the format's own see them: through the index, and from first to last byte."""
    with path.open("rb") as file:
        indexed = [entry(m) for _, _, m in make_reader(file, validate_crcs=True).iter_messages(log_time_order=False)]
        file.seek(0)
        in_order = NonSeekingReader(file, validate_crcs=True).iter_messages(log_time_order=False)
        assert [entry(m) for _, _, m in in_order] == indexed
    return indexed


def mend(folder, data):
    """What `repair` says of a log, after checking that it is whole then, and that the damaged one was kept."""
    log = folder / "run.mcap"
    log.write_bytes(data)
    sentence = McapSink().repair(folder)
    names = {path.name for path in folder.iterdir()}
    if sentence is None or "was torn" in sentence:
        assert names == {"run.mcap"}
    else:
        assert names == {"run.mcap", "run.mcap.damaged"}
        assert (folder / "run.mcap.damaged").read_bytes() == data
        assert sentence.endswith("the damaged file is kept as run.mcap.damaged")
    assert McapSink().repair(folder) is None, "mended once, it is whole"
    return sentence, read_back(log)


LOGS = {
    "zstd": {},
    "lz4, all checksums": {"compression": CompressionType.LZ4, "enable_data_crcs": True},
    "not packed": {"compression": CompressionType.NONE},
}


def check_damages(folder, log, kind, seeds):
    """All whole chunks are kept, before and after the damage, and nothing that was not in the log is read."""
    whole = list(chunks(log))
    for seed in seeds:
        data, (start, end) = damaged(log, kind, random.Random(f"{kind} {seed}"))
        sub = folder / str(seed)
        sub.mkdir()
        wanted = [m for a, b, inside in whole if b <= start or end <= a or data == log for m in inside]
        if start < 8 and not wanted:  # nothing is left that tells what it was
            with contextlib.suppress(DataError):
                mend(sub, data)
            continue
        sentence, kept = mend(sub, data)
        assert not Counter(wanted) - Counter(kept), f"seed {seed}: {sentence}"
        assert not Counter(kept) - Counter(m for *_, inside in whole for m in inside), f"seed {seed}: {sentence}"
        if sentence is None:
            assert len(kept) == PER_CHUNK * CHUNKS, f"seed {seed}"
        elif (lost := PER_CHUNK * CHUNKS - len(kept)) and "at least" not in sentence and "some may" not in sentence:
            assert "was torn" in sentence or f" {lost} were lost" in sentence, f"seed {seed}: {sentence}"


@pytest.mark.parametrize("opcode", [0x01, 0x04, 0x05, 0x07, 0x09, 0x0C, 0x0F, 0x80, 0xFF])
def test_a_chunk_that_calls_itself_another_record_is_lost_and_said_to_be(tmp_path, own, opcode):
    start, _, inside = list(chunks(own))[3]
    sentence, kept = mend(tmp_path, own[:start] + bytes([opcode]) + own[start + 1 :])
    assert len(kept) == PER_CHUNK * CHUNKS - len(inside)
    assert f" {len(inside)} were lost" in sentence


@pytest.mark.parametrize("kind", KINDS)
def test_whole_chunks_survive_any_damage(tmp_path, own, kind):
    check_damages(tmp_path, own, kind, range(6))


@pytest.mark.slow
@pytest.mark.timeout(3600)
@pytest.mark.parametrize("kind", KINDS)
def test_whole_chunks_survive_forty_more_damages_of_each_kind(tmp_path, own, kind):
    check_damages(tmp_path, own, kind, range(100, 140))


@pytest.mark.slow
@pytest.mark.timeout(3600)
@pytest.mark.parametrize("log", LOGS)
@pytest.mark.parametrize("kind", KINDS)
def test_whole_chunks_of_other_writers_survive(tmp_path, log, kind):
    check_damages(tmp_path, written(**LOGS[log]), kind, range(40))


@pytest.mark.slow
@pytest.mark.timeout(3600)
def test_a_flipped_bit_anywhere_in_a_log_of_the_sink_is_found(tmp_path, own):
    log = tmp_path / "run.mcap"
    for at in range(0, len(own), 13):
        log.write_bytes(own[:at] + bytes([own[at] ^ 1]) + own[at + 1 :])
        assert McapSink().repair(tmp_path), f"byte {at}"
        (tmp_path / "run.mcap.damaged").unlink(missing_ok=True)


@pytest.mark.parametrize(
    "part", ["magic", "header", "chunk", "chunk head", "index of a chunk", "summary", "footer", "end"]
)
def test_a_flipped_bit_is_found_in_every_part(tmp_path, own, part):
    starts = {opcode: start for opcode, start, _ in reversed(list(records(own)))}
    at = {
        "magic": 3, "header": starts[1] + 15, "chunk": starts[6] + 400, "chunk head": starts[6] + 2,
        "index of a chunk": starts[7] + 20, "summary": starts[11] + 12, "footer": starts[2] + 10, "end": len(own) - 1,
    }[part]  # fmt: skip
    sentence, kept = mend(tmp_path, own[:at] + bytes([own[at] ^ 16]) + own[at + 1 :])
    lost = PER_CHUNK if part.startswith("chunk") else 0
    assert len(kept) == PER_CHUNK * CHUNKS - lost
    assert ("10 were lost, logged from 20" in sentence) == bool(lost), sentence
    assert ("none was lost" in sentence) == (not lost), sentence


@pytest.mark.parametrize("options", [*LOGS.values(), {"use_chunking": False, "enable_data_crcs": True}, {
    "enable_crcs": False, "index_types": IndexType.NONE, "use_statistics": False, "use_summary_offsets": False,
    "repeat_channels": False, "repeat_schemas": False}])  # fmt: skip
def test_whole_logs_of_other_writers_are_left_alone(tmp_path, options):
    log = written(**options)
    (tmp_path / "run.mcap").write_bytes(log)
    assert McapSink().repair(tmp_path) is None
    assert (tmp_path / "run.mcap").read_bytes() == log


def test_a_log_packed_as_a_stream_is_whole(tmp_path):
    """Other writers pack chunk by chunk without saying beforehand how long each is."""
    log = written(compression=CompressionType.NONE)
    out = io.BytesIO(log[: next(chunks(log))[0]])
    out.seek(0, 2)
    for start, end, _ in chunks(log):
        chunk = Chunk.read(ReadDataStream(io.BytesIO(log[start + 9 : end])))
        packer = zstandard.ZstdCompressor().compressobj()
        chunk.data, chunk.compression = packer.compress(chunk.data) + packer.flush(), "zstd"
        assert zstandard.frame_content_size(chunk.data) == -1
        builder = RecordBuilder()
        chunk.write(builder)
        out.write(builder.end())
    assert len(mend(tmp_path, out.getvalue())[1]) == PER_CHUNK * CHUNKS


def test_a_log_packed_in_a_way_of_its_writer_is_left_as_it_is(tmp_path, own):
    start = next(chunks(own))[0]
    named = own.index(b"\x04\0\0\0zstd", start) + 4
    other = own[:named] + b"best" + own[named + 4 : named + 12] + b"data" + own[named + 16 :]
    (tmp_path / "run.mcap").write_bytes(other)
    with pytest.raises(DataError, match=r"run\.mcap has a chunk that is packed by 'best', which is unknown here"):
        McapSink().repair(tmp_path)
    assert (tmp_path / "run.mcap").read_bytes() == other
    assert "10 were lost" in mend(tmp_path, own[:named] + b"zstt" + own[named + 4 :])[0]


@pytest.mark.parametrize("options", [{"use_chunking": False}, {"use_chunking": False, "enable_data_crcs": True}])
def test_a_log_without_chunks_is_read_on_after_a_broken_message(tmp_path, options):
    log = written(**options)
    fifth = [start for opcode, start, _ in records(log) if opcode == 5][4]
    sentence, kept = mend(tmp_path, log[: fifth + 3] + b"\xff" + log[fifth + 4 :])
    assert [sequence for _, sequence, _ in kept] == [n for n in range(PER_CHUNK * CHUNKS) if n != 4]
    assert "1 was lost" in sentence


def test_attachments_and_metadata_are_kept_and_checked(tmp_path):
    log = written()
    at = log.index(b"some notes")
    first = next(chunks(log))[0]
    sentence, kept = mend(tmp_path, log[: first + 99] + b"\0\0\0" + log[first + 102 :])
    with (tmp_path / "run.mcap").open("rb") as file:
        reader = make_reader(file)
        assert [attachment.data for attachment in reader.iter_attachments()] == [b"some notes"]
        assert [metadata.metadata for metadata in reader.iter_metadata()] == [{"kind": "test"}]
        assert reader.get_header().profile == "some-profile"
    (tmp_path / "second").mkdir()
    sentence, kept = mend(tmp_path / "second", log[:at] + b"S" + log[at + 1 :])
    assert "a broken Attachment" in sentence
    assert len(kept) == PER_CHUNK * CHUNKS


def test_messages_of_a_channel_that_is_lost_are_kept_without_its_name(tmp_path, own, read):
    first = next(chunks(own))[0]
    torn = own[: first + 200] + bytes(20) + own[first + 220 : -100]
    sentence, kept = mend(tmp_path, torn)
    assert len(kept) == PER_CHUNK * (CHUNKS - 1)
    assert "names of some channels are lost: /unknown_channel_1" in sentence
    found = read(tmp_path / "run.mcap")
    assert {topic: len(entries) for topic, entries in found.items()} == {"/unknown_channel_1": 30, "/late": 40}


BOMB = """
import re, sys
from pathlib import Path
from omnilab_mcap import McapSink
from omnilab.errors import DataError
try:
    print(McapSink().repair(Path(sys.argv[1])))
except DataError as error:
    print(error)
print(re.search("VmHWM:[^0-9]*([0-9]*) kB", Path("/proc/self/status").read_text())[1])
"""


def in_a_process(folder):
    """What `repair` says, and the memory it took, bytes."""
    if not pathlib.Path("/proc/self/status").exists():
        pytest.skip("needs /proc: what getrusage tells includes the memory of the process that started it")
    done = subprocess.run(
        [sys.executable, "-c", BOMB, folder], capture_output=True, text=True, check=True, timeout=3000
    )
    sentence, kilobytes = done.stdout.splitlines()
    return sentence, int(kilobytes) * 1024


def bomb(codec, said):
    """A log with one chunk that unpacks to 1 GiB of zeros."""
    zeros = bytes(1 << 20)
    if codec == "zstd":
        packer = zstandard.ZstdCompressor().compressobj(size=said if said == 1 << 30 else -1)
        data = b"".join(packer.compress(zeros) for _ in range(1024)) + packer.flush()
    else:
        with lz4.frame.LZ4FrameCompressor() as packer:
            data = packer.begin() + b"".join(packer.compress(zeros) for _ in range(1024)) + packer.flush()
    chunk = RecordBuilder()
    Chunk(codec, data, message_start_time=0, message_end_time=0, uncompressed_crc=0, uncompressed_size=said).write(
        chunk
    )
    return chunk.end()


@pytest.mark.slow
@pytest.mark.timeout(3600)
@pytest.mark.parametrize(("codec", "said"), [("zstd", 1 << 30), ("zstd", 1000), ("lz4", 1 << 30), ("lz4", 1000)])
def test_a_chunk_that_would_fill_the_memory_is_not_opened(tmp_path, own, codec, said):
    log = own[: next(chunks(own))[1]] + bomb(codec, said)
    (tmp_path / "run.mcap").write_bytes(log)
    sentence, used = in_a_process(tmp_path)
    assert used < 400 << 20
    if codec == "zstd" and said > LARGEST_BYTES:
        assert "has a chunk that unpacks to 1073741824 bytes" in sentence
        assert (tmp_path / "run.mcap").read_bytes() == log
    else:
        assert "10 messages were kept" in sentence


@pytest.mark.slow
@pytest.mark.timeout(3600)
def test_a_large_log_is_mended_in_little_memory(tmp_path):
    with (tmp_path / "run.mcap").open("wb") as file:
        writer = Writer(file, compression=CompressionType.NONE)
        writer.start()
        channel = writer.register_channel("/any", "json", writer.register_schema("any", "jsonschema", b"{}"))
        rng = random.Random(0)
        for step in range(300):
            writer.add_message(channel, step, rng.randbytes(1 << 20), step)
    sentence, used = in_a_process(tmp_path)
    assert "was torn" in sentence
    assert used < 250 << 20


def test_a_log_made_to_be_read_for_ever_is_given_up(tmp_path):
    """Every ninth byte looks like the head of a chunk."""
    (tmp_path / "run.mcap").write_bytes(MCAP0_MAGIC + struct.pack("<BQ", 6, 100_000) * 300_000)
    with pytest.raises(DataError, match=r"run\.mcap is damaged in too many places to be mended; it is as it was"):
        McapSink().repair(tmp_path)


def test_a_log_without_a_whole_record_is_left_as_it_is(tmp_path, own):
    bad = own[:9] + b"\xff" * 300
    (tmp_path / "run.mcap").write_bytes(bad)
    with pytest.raises(DataError, match=r"run\.mcap holds no record that can be read; run the experiment again"):
        McapSink().repair(tmp_path)
    assert (tmp_path / "run.mcap").read_bytes() == bad


@pytest.mark.slow
@pytest.mark.timeout(3600)
def test_a_killed_repair_leaves_the_damaged_or_the_mended_log(tmp_path):
    """At any instant; what it leaves is mended by the next."""
    log = bytearray(written(compression=CompressionType.NONE))
    at = next(chunks(log))[0] + 300
    log[at] ^= 1
    rng = random.Random(0)
    for kill in range(20):
        folder = tmp_path / str(kill)
        folder.mkdir()
        (folder / "run.mcap").write_bytes(log)
        with subprocess.Popen([sys.executable, "-c", SLOW_REPAIR, folder], stdout=subprocess.PIPE) as process:
            process.stdout.readline()  # all is imported
            time.sleep(rng.uniform(0, 0.06))
            process.kill()
        assert (folder / "run.mcap").exists()
        if (folder / "run.mcap").read_bytes() != log:
            assert (folder / "run.mcap.damaged").read_bytes() == log
        McapSink().repair(folder)
        assert {path.name for path in folder.iterdir()} == {"run.mcap", "run.mcap.damaged"}
        assert len(read_back(folder / "run.mcap")) == PER_CHUNK * (CHUNKS - 1)


SLOW_REPAIR = """
import sys
from pathlib import Path
from omnilab_mcap import McapSink, repair
print("go", flush=True)
McapSink().repair(Path(sys.argv[1]))
"""
