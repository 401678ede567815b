"""docs/performance.md is what its command makes of the benchmarks; .ci/drift compares two commits in turn."""

import importlib.util
import json
import re
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from scipy.stats import ttest_1samp

ROOT = Path(__file__).parents[2]


def script(path):
    spec = importlib.util.spec_from_file_location(path.stem, path)
    module = importlib.util.module_from_spec(spec)
    sys.modules[path.stem] = module  # dataclasses look their module up
    spec.loader.exec_module(module)
    return module


@pytest.fixture(scope="module", autouse=True)
def _modules():
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(sys, "path", list(sys.path))
        patch.setattr(sys, "modules", dict(sys.modules))
        yield


@pytest.fixture(scope="module")
def performance():
    return script(ROOT / "docs/performance.py")


@pytest.fixture(scope="module")
def drift(performance):
    return script(ROOT / ".ci/drift.py")


def bench(test, median, group="views", timer="process_time", **says):
    name = test.partition("::")[2]
    stats = {"q1": 0.9 * median, "median": median, "q3": 1.1 * median, "rounds": 5, "min": 0.8 * median}
    stats |= {"total": 5 * median, "iterations": 1}
    param = name.partition("[")[2].rstrip("]") or None
    return {
        "fullname": test, "name": name, "group": group, "param": param, "stats": stats, "extra_info": says, "options": {"timer": timer}
    }  # fmt: skip


def file_of(*benchmarks, commit="abcdef0123", date="2026-01-02T03:04:05"):
    machine = {"python_version": "3.11.9", "cpu": {"brand_raw": "A processor", "count": 2}, "node": "name-of-a-machine"}
    commit_info = {"id": commit, "dirty": False}
    return json.dumps({"benchmarks": benchmarks, "datetime": date, "commit_info": commit_info, "machine_info": machine})


FILE = "tests/benchmarks/test_bench_views.py"
SIZES = (25, 100, 400)
OURS = [
    bench(f"{FILE}::test_view_ekf[{n}]", 3e-9 * n**1.5, what="`view_ekf`", size=n, of="views", memory_mb=n / 100)
    for n in SIZES
]
DENSE = bench(
    f"{FILE}::test_dense_equations[400]", 1.2e-2, peer=True, what="numpy", memory_mb=0, size=400, count=2, unit="update"
)


def test_a_row_stands_beside_the_fastest_peer_of_its_size_and_run_alone(performance):
    slower = bench(f"{FILE}::test_slower[400]", 1.0, peer="slow one", size=400)
    rows, about = performance.read(file_of(*OURS, DENSE, slower))
    assert about["run"] == "abcdef0, 2026-01-02 03:04"
    table = list(performance.times(rows, about["run"]))
    assert "| **views**, update | | | | | |" in table
    assert "| `view_ekf`, 400 views | 24 µs (21.6 to 26.4) | numpy | 6 ms (5.4 to 6.6) | 250 | 4 MB (0) |" in table
    assert "| `view_ekf`, 25 views | 375 ns (338 to 412) |  |  |  |  |" in table
    assert "|  |  | slow one, 400 | 1 s (0.9 to 1.1) |  |  |" in table
    assert len(table) == 7
    earlier, _ = performance.read(file_of(DENSE, commit="1234567"))
    apart = list(performance.times(rows[:3] + earlier, about["run"]))
    assert "| `view_ekf`, 400 views | 24 µs (21.6 to 26.4) |  |  |  | 4 MB |" in apart
    assert "|  |  | numpy, 400 | 6 ms (5.4 to 6.6) [1234567] |  |  |" in apart


def test_the_exponent_of_a_power_is_its_own_and_the_interval_holds_it(performance):
    size = np.array([10, 20, 40, 80, 160, 320])
    assert performance.exponent(size, 3e-6 * size**1.5) == pytest.approx((1.5, 1.5, 1.5))
    rng, held = np.random.default_rng(0), []
    for _ in range(400):
        _, low, high = performance.exponent(size, size**1.5 * np.exp(rng.normal(0, 0.1, size.size)))
        held.append(low < 1.5 < high)
    assert 0.92 < np.mean(held) < 0.98
    rows, _ = performance.read(file_of(*OURS, DENSE))
    (line,) = list(performance.growth(rows))[2:]
    assert line.endswith("| 1.50 | 1.50 to 1.50 | 1.50 |")
    assert line.startswith("| views: `view_ekf` | 25 views: 375 ns")


def test_what_was_not_measured_keeps_its_run_and_what_is_gone_goes(performance, tmp_path):
    source = tmp_path / FILE
    source.parent.mkdir(parents=True)
    source.write_text("def test_view_ekf(count):\ndef test_dense_equations(count):\n")
    gone = bench(f"{FILE}::test_gone", 1.0)
    before, first = performance.read(file_of(*OURS, DENSE, gone, commit="1234567"))
    new, second = performance.read(file_of(*OURS[:1]))
    rows = performance.merged(before, new, tmp_path)
    assert [(row.function.rpartition("::")[2], row.run[:7]) for row in rows] == [
        ("test_dense_equations", "1234567"), ("test_view_ekf", "abcdef0")
    ]  # fmt: skip
    performance.save(tmp_path / "kept.json", rows, [first, second])
    assert performance.load(tmp_path / "kept.json") == (rows, [first, second])
    assert "name-of-a-machine" not in (tmp_path / "kept.json").read_text()


def test_prose_stays_and_what_is_between_the_marks_is_made(performance, tmp_path, monkeypatch):
    page = (
        "# Prose\n\n<!-- made: times views -->\nold\n<!-- end -->\nand\n<!-- made: peerless -->\n<!-- end -->\nmore.\n"
    )
    (tmp_path / "performance.md").write_text(page)
    (tmp_path / "b.json").write_text(
        file_of(bench(f"{FILE}::test_view_ekf", 1e-3, "alone", peer="", no_peer="nobody else does it"))
    )
    monkeypatch.setattr(performance, "exists", lambda *_: True)
    assert performance.main(["--from", str(tmp_path / "b.json")], tmp_path) == 0
    first = (tmp_path / "performance.md").read_text()
    assert first.startswith("# Prose\n\n<!-- made: times views -->\n| | omnilab |")
    assert first.endswith(
        "<!-- end -->\nand\n<!-- made: peerless -->\n- alone: nobody else does it\n<!-- end -->\nmore.\n"
    )
    assert "| view ekf | 1 ms (0.9 to 1.1) |" in first
    assert performance.main(["--from"], tmp_path) == 0
    assert (tmp_path / "performance.md").read_text() == first
    with pytest.raises(ValueError, match="asks for veiws: there is no test_bench_NAME"):
        performance.page_of(page.replace("views", "veiws"), *performance.load(tmp_path / "performance.json"))


def test_the_page_is_what_its_command_makes(performance):
    """Nothing between its marks is typed by hand."""
    page = (ROOT / "docs/performance.md").read_text(encoding="utf-8")
    assert performance.page_of(page, *performance.load(ROOT / "docs/performance.json")) == page
    assert "nobody has said why" not in page


# -------------------------------------------------------------------------------------------------------------- drift
def test_base_and_now_are_measured_in_turn(drift):
    turns = []

    def measured(name, **times):
        turns.append(name)
        return times

    pairs = drift.in_turn(lambda: measured("base", a=1.0, gone=1.0), lambda: measured("now", a=2.0, new=1.0), 4)
    assert turns == ["base", "now", "now", "base"] * 2
    assert pairs == {"a": [(1.0, 2.0)] * 4}


def test_a_ratio_has_students_interval_and_what_is_surely_beyond_is_named(drift):
    pairs = {"f::slow": [(1, 1.3), (2, 2.7), (1, 1.32), (1, 1.35)], "f::same": [(1, 1.0), (1, 1.1), (1, 0.9), (1, 1.0)]}
    pairs["f::fast"] = [(2, 1), (4, 2), (2, 1), (2, 1)]
    pairs["f::wild"] = [(1, 2), (1, 0.9), (1, 1.1), (1, 1.4)]
    for found in pairs.values():
        logs = np.log([now / base for base, now in found])
        if np.ptp(logs):
            interval = ttest_1samp(logs, 0).confidence_interval(0.95)
            assert drift.ratio_of(found) == pytest.approx(np.exp([logs.mean(), interval.low, interval.high]))
    lines = list(drift.report(pairs, "main"))
    assert [line.split()[3] for line in lines[1:-1]] == ["f::slow", "f::wild", "f::same", "f::fast"]
    assert lines[-1] == "beyond 15%: slower: slow 1.33; perhaps slower: wild 1.29; faster: fast 0.50 (of 4)"


def test_what_takes_longer_than_a_second_is_not_measured_again_and_again(performance, drift, tmp_path):
    rows, about = performance.read(file_of(bench(f"{FILE}::test_a[1]", 0.19), bench(f"{FILE}::test_a[2]", 0.21)))
    performance.save(tmp_path / "kept.json", rows, [about])
    assert drift.short(tmp_path / "kept.json")[3:] == [f"--deselect={FILE}::test_a[2]"]


def test_a_checkout_has_the_code_of_the_base_and_the_benchmarks_of_now(drift, tmp_path):
    root = tmp_path / "clone"
    (root / "tests/benchmarks").mkdir(parents=True)

    def write(code, benchmark):
        (root / "code.py").write_text(code)
        (root / "tests/benchmarks/test_bench_a.py").write_text(benchmark)

    def git(*words):
        author = ("-c", "user.name=a", "-c", "user.email=a@b.c")
        return subprocess.run(["git", "-C", root, *author, *words], check=True, capture_output=True, text=True).stdout

    write("before", "benchmark of before")
    for words in (("init", "--quiet"), ("add", "."), ("commit", "--quiet", "-m", "a")):
        git(*words)
    write("now", "benchmark of now")
    with drift.checkout("HEAD", root) as tree:
        assert (tree / "code.py").read_text() == "before"
        assert (tree / "tests/benchmarks/test_bench_a.py").read_text() == "benchmark of now"
    assert not tree.exists()
    assert len(git("worktree", "list").splitlines()) == 1
    assert (root / "code.py").read_text() == "now"


def test_the_rule_of_drift_is_that_of_the_script(drift):
    text = re.sub(r"\s+", " ", (ROOT / "CONTRIBUTING.md").read_text(encoding="utf-8"))
    assert f"more than {drift.LIMIT - 1:.0%}".replace("%", " %") in text
