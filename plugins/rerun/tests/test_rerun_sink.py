"""The file: what survives a crash, what is refused, what the plugin loads."""

from __future__ import annotations

import pickle
import signal
import socket
import subprocess
import sys
import time
from collections import defaultdict
from dataclasses import fields, replace
from pathlib import Path

import numpy as np
import pytest

from omnilab.api import Text, Tick
from omnilab.errors import ConfigError, DataError
from omnilab.testing import sample_records
from omnilab_rerun import RerunSink

WRITE_UNTIL_KILLED = """
import sys, time
from pathlib import Path
import numpy as np
from omnilab.api import Panel, Signature, Tick, ViewLayout
from omnilab_rerun import RerunSink
sink = RerunSink()
sink.open(Path(sys.argv[1]))
sink.write("layout", ViewLayout([[Panel("image", "Signature", ["signature"])]]), None)
for step in range(1_000_000):
    sink.write("signature", Signature(np.full((20, 30), step, np.float32)), Tick(step, step))
    if step % 50 == 49:
        sink.flush()
        time.sleep(0.5)  # at most this long after it was logged, a record is in the file
        print(step, flush=True)
"""

FILL_A_SMALL_DISK = """
import resource, sys, time
from pathlib import Path
import numpy as np
from omnilab.api import Signature, Tick
from omnilab.errors import DataError
from omnilab_rerun import RerunSink
resource.setrlimit(resource.RLIMIT_FSIZE, (500_000, 500_000))
def threads():
    task = Path("/proc/self/task")
    return sorted((t / "comm").read_text() for t in task.iterdir()) if task.is_dir() else []
def settled():  # threads begin and end a little after the call that asks for it, and get their names later still
    seen, now = None, threads()
    while now != seen:
        time.sleep(1)
        seen, now = now, threads()
    return now
(Path(sys.argv[1]) / "first").mkdir()
sink = RerunSink()
sink.open(Path(sys.argv[1]) / "first")
sink.write("signature", Signature(np.zeros((2, 2), np.float32)), Tick(0, 0))
sink.close()
before = settled()
sink.open(Path(sys.argv[1]))
rng = np.random.default_rng(0)
try:
    for step in range(100):
        sink.write("signature", Signature(rng.random((100, 100), np.float32)), Tick(step, step))
        time.sleep(0.2)
except DataError as error:
    print(step, error)
sink.close()
end = time.monotonic() + 20
while threads() != before and time.monotonic() < end:
    time.sleep(0.1)
print("closed, with threads as before:", threads() == before or threads())
"""


@pytest.fixture(scope="module")
def killed(tmp_path_factory):
    """The bytes of a recording whose process was killed while it wrote, and the last step that was flushed."""
    folder = tmp_path_factory.mktemp("killed")
    call = [sys.executable, "-c", WRITE_UNTIL_KILLED, str(folder)]
    with subprocess.Popen(call, stdout=subprocess.PIPE, text=True) as process:
        for line in process.stdout:
            flushed = int(line)
            if flushed > 200:
                process.send_signal(signal.SIGKILL)
                break
    return (folder / "run.rrd").read_bytes(), flushed


@pytest.mark.slow
def test_what_was_flushed_survives_sigkill_and_repair_completes_the_file(tmp_path, killed, read):
    data, flushed = killed
    (tmp_path / "run.rrd").write_bytes(data)
    sentence = RerunSink().repair(tmp_path)
    assert "no whole footer" in sentence
    assert [file.name for file in tmp_path.iterdir()] == ["run.rrd"]
    assert RerunSink().repair(tmp_path) is None, "mended once, it is complete"

    log = read(tmp_path / "run.rrd")
    log.reader.store().schema()  # needs the footer
    steps = log.rows("/signature", "step")
    assert steps == list(range(len(steps)))
    assert len(steps) > flushed
    values = [np.frombuffer(bytes(row[0]), np.float32)[0] for row in log.rows("/signature", "DepthImage:buffer")]
    assert values == steps
    assert log.reader.blueprints(), "the layout survives"


@pytest.mark.parametrize("torn_off", [1, 100, 3000])
def test_a_torn_tail_is_dropped(tmp_path, killed, read, torn_off):
    data, _ = killed
    (tmp_path / "run.rrd").write_bytes(data[:-torn_off])
    assert "no whole footer" in RerunSink().repair(tmp_path)
    steps = read(tmp_path / "run.rrd").rows("/signature", "step")
    assert steps == list(range(len(steps)))
    assert len(steps) > 50


@pytest.mark.parametrize("kept", [0, 5, 100], ids=["empty", "no header", "no record"])
def test_a_file_that_holds_nothing_is_reported_and_left_alone(tmp_path, killed, kept):
    data = killed[0][:kept]
    (tmp_path / "run.rrd").write_bytes(data)
    with pytest.raises(DataError, match=r"run\.rrd cannot be read back .*; run the experiment again"):
        RerunSink().repair(tmp_path)
    assert (tmp_path / "run.rrd").read_bytes() == data
    assert [file.name for file in tmp_path.iterdir()] == ["run.rrd"]


def test_a_complete_or_missing_file_needs_no_repair(tmp_path, recorded):
    assert RerunSink().repair(tmp_path) is None
    recorded([("log", Text("x"), None)])
    before = (tmp_path / "run.rrd").read_bytes()
    assert RerunSink().repair(tmp_path) is None
    assert (tmp_path / "run.rrd").read_bytes() == before


def test_a_folder_that_is_not_there_is_refused_at_once(tmp_path):
    with pytest.raises(OSError, match=r"none/run\.rrd"):
        RerunSink().open(tmp_path / "none")


@pytest.mark.slow
def test_a_full_disk_is_reported_by_the_next_record_and_leaves_nothing_behind(tmp_path, read):
    """Not even a thread; the process ends at once, and what had room can be read."""
    call = [sys.executable, "-c", FILL_A_SMALL_DISK, str(tmp_path)]
    output = subprocess.run(call, capture_output=True, text=True, timeout=120, check=True).stdout
    first, _, sentence = output.splitlines()[0].partition(" ")
    assert sentence.startswith("run.rrd takes no more records")
    assert 0 < int(first) < 20, "40 kB a record fill 500 kB"
    assert output.splitlines()[1:] == ["closed, with threads as before: True"]
    assert "footer" in RerunSink().repair(tmp_path)
    steps = read(tmp_path / "run.rrd").rows("/signature", "step")
    assert steps == list(range(len(steps)))
    assert len(steps) > 5


HOLD_THE_GIL = """
import ctypes, os, sys
from pathlib import Path
import numpy as np
from omnilab.api import Series, Signature, Tick
from omnilab_rerun import RerunSink
sink = RerunSink()
sink.open(Path(sys.argv[1]))
for step in range(30):
    sink.write("signature", Signature(np.full((40, 50), step, np.float32)), Tick(step, step))
    sink.write("curve", Series(np.array([0.5]), np.array([step]), np.array([step]), "m"), None)
print("logged", flush=True)
ctypes.PyDLL(None).sleep(600)  # in a C library that does not give Python's lock back
"""


def test_what_was_logged_before_a_library_holds_pythons_lock_is_in_the_file(tmp_path, read):
    with subprocess.Popen(
        [sys.executable, "-c", HOLD_THE_GIL, str(tmp_path)], stdout=subprocess.PIPE, text=True
    ) as process:
        assert process.stdout.readline() == "logged\n"
        time.sleep(1.0)
        process.kill()
    RerunSink().repair(tmp_path)
    log = read(tmp_path / "run.rrd")
    assert log.rows("/signature", "step") == log.rows("/curve", "step") == list(range(30))


@pytest.mark.parametrize("floats", [np.float32, np.float64])
def test_arrays_may_change_once_they_are_logged(recorded, tmp_path, read, floats):
    """Arrow borrows memory, and Rerun writes later: what is in the file is what was logged."""
    given = [record for _, record, _ in sample_records()]
    kept, changed = RerunSink(), RerunSink()
    for sink, name in ((kept, "kept"), (changed, "changed")):
        (tmp_path / name).mkdir()
        sink.open(tmp_path / name)
        for i, record in enumerate(given):
            arrays = {f.name: getattr(record, f.name) for f in fields(record)}
            arrays = {key: own(array, floats) for key, array in arrays.items() if isinstance(array, np.ndarray)}
            sink.write(f"at/{i}", replace(record, **arrays), Tick(i, i))
            for array in arrays.values() if sink is changed else ():
                array[...] = 77
        sink.close()
    one, other = (drawn(read(tmp_path / name / "run.rrd").chunks) for name in ("kept", "changed"))
    assert one == other


def own(array, floats):
    """An array as Arrow would borrow it."""
    kinds = {"f": floats, "i": np.uint32 if floats is np.float32 else np.int64}
    return np.array(array, kinds.get(array.dtype.kind, array.dtype))


def drawn(chunks):
    """What chunks hold, but for the sink's own clock and numbers: rows by entity and column."""
    found = defaultdict(list)
    for chunk in chunks:
        for name, column in chunk.to_record_batch().to_pydict().items():
            if not chunk.entity_path.startswith("/__properties") and name not in {
                "rerun.controls.RowId",
                "log_time",
                "log_tick",
            }:
                found[chunk.entity_path, name] += column
    return {key: sorted(map(str, rows)) for key, rows in found.items()}


def test_a_taken_port_is_refused(tmp_path):
    with socket.socket() as taken:
        taken.bind(("127.0.0.1", 0))
        taken.listen()
        sink = RerunSink(live=True, port=taken.getsockname()[1])
        with pytest.raises(ConfigError, match=r"port \d+ is taken"):
            sink.open(tmp_path)


@pytest.mark.parametrize("port", [0, 65536, -1])
def test_a_number_that_is_no_port_is_refused(port):
    with pytest.raises(ConfigError, match=f"port={port} is out of range; give a whole number from 1 to 65535"):
        RerunSink(port=port)


def test_a_fresh_sink_pickles():
    sink = pickle.loads(pickle.dumps(RerunSink(live=True, port=1234)))
    assert sink == RerunSink(live=True, port=1234)


def test_the_plugin_is_light_to_import():
    heavy = {"rerun", "rerun_cli", "cv2", "scipy", "pyarrow", "matplotlib"}
    code = f"import omnilab_rerun, sys; print(sorted({heavy} & set(sys.modules)))"
    assert subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True).stdout == "[]\n"


@pytest.mark.skipif(not Path("/proc/self/task").is_dir(), reason="threads are counted in Linux's /proc")
def test_the_threads_of_a_run_end_with_it(tmp_path):
    """A sweep of some hundred jobs in one process would meet the limit of threads."""
    counts = []
    for name in ("first", "second", "third"):
        (tmp_path / name).mkdir()
        sink = RerunSink()
        sink.open(tmp_path / name)
        sink.write("log", Text("one line"), None)
        sink.close()
        counts.append(len(list(Path("/proc/self/task").iterdir())))
    assert counts[2] == counts[0]
