"""Work beyond what the machine has: estimated, refused in a sentence, and done all the same where that is asked for."""

from __future__ import annotations

import resource
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from omnilab import limits
from omnilab.errors import ConfigError
from omnilab.limits import Pace, check_work, free_disk, free_memory, limited, total_memory

GB = 10**9
HOUR = 3600.0


@pytest.fixture
def free(monkeypatch: pytest.MonkeyPatch) -> None:
    """A machine with 8 GB of memory and 5 GB of disk free."""
    monkeypatch.setattr(limits, "free_memory", lambda: 8.0 * GB)
    monkeypatch.setattr(limits, "free_disk", lambda folder: 5.0 * GB)


def sentence(**work: float | Path) -> str:
    with pytest.raises(ConfigError) as error:
        check_work("300 places", "give a larger step", **work)  # type: ignore[arg-type]
    return str(error.value)


@pytest.mark.usefixtures("free")
def test_what_fits_is_let_through_and_what_does_not_is_refused_with_the_estimate() -> None:
    check_work("", "", memory=8.0 * GB, disk=5.0 * GB, folder=Path("data"), seconds=24 * HOUR)
    assert sentence(memory=190.0 * GB) == (
        "300 places take at least 190 GB of memory, and 8 GB are free; give a larger step, or limits=off to try it all the same"
    )
    assert "at least 6 GB on disk, and 5 GB are free in data; give" in sentence(disk=6.0 * GB, folder=Path("data"))
    assert "at least 48 hours of time, and more than 24 hours are not begun unasked; give" in sentence(
        seconds=48 * HOUR
    )
    assert "9 GB of memory and 25 hours of time, and" in sentence(memory=9.0 * GB, seconds=25 * HOUR)
    assert "inf GB" in sentence(memory=float("inf"))


@pytest.mark.usefixtures("free")
def test_limits_off_lets_everything_through() -> None:
    with limited(on=False):
        check_work("", "", memory=9e99, disk=9e99, seconds=9e99)
    with limited(), pytest.raises(ConfigError):
        check_work("", "", memory=9e99)


def test_memory_that_nobody_estimated_fails_where_it_is_requested() -> None:
    before = resource.getrlimit(resource.RLIMIT_DATA)
    with pytest.raises(ConfigError, match=r"does not fit into memory \(Unable to allocate .* shape .* are free\); give"), limited():  # fmt: skip
        np.empty((int(2 * total_memory() / 8000), 1000))
    bug = MemoryError()
    bug.add_note("raised by radon, in describe")
    with pytest.raises(ConfigError, match="raised by radon, in describe") as error, limited():
        raise bug
    assert isinstance(error.value.__cause__, MemoryError)
    assert resource.getrlimit(resource.RLIMIT_DATA) == before


@pytest.mark.skipif(sys.platform != "linux", reason="other systems do not hold a process to its limit of data")
def test_memory_that_opencv_does_not_get_is_a_sentence_and_its_other_errors_stay_bugs(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    import cv2

    monkeypatch.setattr(limits, "total_memory", lambda: 1.0 * GB)
    with pytest.raises(ConfigError, match=r"does not fit into memory .*Insufficient memory"), limited():
        cv2.resize(np.zeros((9, 9), np.uint8), (32_000, 96_000))
    with pytest.raises(cv2.error), limited():
        cv2.resize(np.zeros((9, 9), np.uint8), (0, 0))


# ------------------------------------------------------------------------------------------------------ what there is
def test_memory_and_disk_are_read_from_the_system(tmp_path: Path) -> None:
    assert 0 < free_memory() <= total_memory() < 1e16
    assert 0 < free_disk(tmp_path / "not" / "yet") < 1e19


@pytest.mark.skipif(sys.platform != "linux", reason="other systems have no limit of the address space")
def test_the_limit_of_the_address_space_is_heeded() -> None:
    script = (
        f"ulimit -v 4000000; exec {sys.executable} -c 'from omnilab.limits import free_memory; print(free_memory())'"
    )
    done = subprocess.run(["sh", "-c", script], capture_output=True, text=True, check=True)
    assert 0 < float(done.stdout) < 4.1 * GB


@pytest.mark.parametrize(("own", "limit", "used", "cached"), [
    ("0::/a/b\n", "memory.max", "memory.current", "inactive_file 300\nactive_file 100\n"),
    ("4:cpu:/\n3:memory:/a/b\n", "memory/memory.limit_in_bytes", "memory/memory.usage_in_bytes",
     "inactive_file 1\ntotal_inactive_file 400\n"),
])  # fmt: skip
def test_control_groups_limit_memory_and_pages_of_files_make_room(
    tmp_path: Path, own: str, limit: str, used: str, cached: str
) -> None:
    """The limit is that of a group around the process's own, of either version."""
    base, name = (tmp_path / limit).parent, Path(limit).name
    (base / "a" / "b").mkdir(parents=True)
    (base / "a" / name).write_text("5000\n")
    (base / "a" / Path(used).name).write_text("2400\n")
    (base / "a" / "memory.stat").write_text(cached)
    (base / "a" / "b" / name).write_text("max\n")
    (tmp_path / "own").write_text(own)
    assert list(limits._control_groups(tmp_path, tmp_path / "own")) == [(5000.0, 2000.0)]
    assert list(limits._control_groups(tmp_path, tmp_path / "none")) == []


# -------------------------------------------------------------------------------------------------------------- time
@pytest.fixture
def clock(monkeypatch: pytest.MonkeyPatch) -> dict[str, float]:
    """Wall time and the process's own, as the test sets them."""
    now = {"wall": 0.0, "own": 0.0}
    monkeypatch.setattr(limits.time, "perf_counter", lambda: now["wall"])
    monkeypatch.setattr(limits.time, "process_time", lambda: now["own"])
    return now


def worked(clock: dict[str, float], pace: Pace, wall: float, own: float, items: int = 1) -> None:
    clock["wall"] += wall
    clock["own"] += own
    pace.add(items)


def test_the_time_of_a_stage_is_known_after_some_seconds_of_it(clock: dict[str, float]) -> None:
    pace = Pace("places", 100_000)
    worked(clock, pace, 1000, 1000)  # the first compiles
    for _ in range(9):
        worked(clock, pace, 1, 1)
    with pytest.raises(ConfigError, match=r"the 100000 items of the stage 'places' take at least 27.8 hours of time"):
        worked(clock, pace, 1, 1)
    worked(clock, pace, 1e6, 1e6)  # once, and not again


@pytest.mark.parametrize(("wall", "own", "total"), [
    (1.0, 1.0, 80_000),  # within a day
    (60.0, 0.5, 100_000),  # another program takes the processor
    (3000.0, 3000.0, 90),  # much is done already
])  # fmt: skip
def test_work_that_may_end_in_time_goes_on(clock: dict[str, float], wall: float, own: float, total: int) -> None:
    pace = Pace("places", total)
    for _ in range(30):
        worked(clock, pace, wall, own)
