"""The file: what survives a crash, what is refused, what the plugin loads."""

from __future__ import annotations

import pickle
import signal
import socket
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from omnilab.api import Text
from omnilab.errors import ConfigError, DataError
from omnilab_rerun import RerunSink

WRITE_UNTIL_KILLED = """
import sys
from pathlib import Path
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
        print(step, flush=True)
"""

FILL_A_SMALL_DISK = """
import resource, sys
from pathlib import Path
import numpy as np
from omnilab.api import Signature, Tick
from omnilab.errors import DataError
from omnilab_rerun import RerunSink, sink as module
module.FLUSH_TIMEOUT_S = 1.0
resource.setrlimit(resource.RLIMIT_FSIZE, (500_000, 500_000))
sink = RerunSink()
sink.open(Path(sys.argv[1]))
rng = np.random.default_rng(0)
try:
    for step in range(100):
        sink.write("signature", Signature(rng.random((100, 100), np.float32)), Tick(step, step))
        sink.flush()
except DataError as error:
    print(step, error)
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


def test_the_recording_is_named_after_the_run_and_listed_under_its_experiment(recorded, tmp_path):
    (entry,) = recorded([("log", Text("x"), None)]).reader.recordings()
    assert (entry.application_id, entry.recording_id) == (tmp_path.parent.name, tmp_path.name)


def test_a_folder_that_is_not_there_is_refused_at_once(tmp_path):
    with pytest.raises(OSError, match=r"none/run\.rrd"):
        RerunSink().open(tmp_path / "none")


def test_a_full_disk_is_reported_by_flush(tmp_path):
    call = [sys.executable, "-c", FILL_A_SMALL_DISK, str(tmp_path)]
    output = subprocess.run(call, capture_output=True, text=True, timeout=60, check=True).stdout
    step, _, sentence = output.partition(" ")
    assert sentence.startswith("run.rrd takes no more records")
    assert 0 < int(step) < 20, "40 kB a record fill 500 kB"


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
