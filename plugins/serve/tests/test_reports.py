"""Reports: one file that needs nothing else, says what the command says, and takes nobody's markup."""

from __future__ import annotations

import shutil
from html.parser import HTMLParser
from pathlib import Path

import pytest

from omnilab.runner.cli import main
from omnilab.runner.run_folder import load_run
from omnilab.runner.sweeps import load_sweep
from omnilab_serve.reports.pictures import PictureBudget
from omnilab_serve.words import figure

HOSTILE = '<script>alert(1)</script>"><img src=http://example.com/x onerror=alert(2)>'


class ReadReport(HTMLParser):
    """Tags, what they refer to, and the text of a report."""

    def __init__(self, page: str) -> None:
        super().__init__()
        self.tags, self.addresses, self.words, self.handlers = set(), [], [], []
        self.policy = ""
        self.feed(page)

    def handle_starttag(self, tag, attrs):
        self.tags.add(tag)
        given = dict(attrs)
        self.addresses += [given[name] for name in ("src", "href", "action", "data", "srcset") if name in given]
        self.handlers += [name for name in given if name.startswith("on") or name == "style"]
        if given.get("http-equiv") == "Content-Security-Policy":
            self.policy = given["content"]

    def handle_data(self, data):
        self.words.append(data)

    @property
    def text(self):
        return " ".join(" ".join(self.words).split())


def reported(*words) -> ReadReport:
    with pytest.raises(SystemExit) as ended:
        main(["report", *map(str, words)])
    assert ended.value.code == 0
    return ReadReport(Path(words[words.index("--output") + 1]).read_text(encoding="utf-8"))


@pytest.fixture
def logs(finished_runs, tmp_path):
    return Path(shutil.copytree(finished_runs, tmp_path / "logs", symlinks=True))


@pytest.fixture
def run(logs):
    return min(path.parent for path in logs.glob("quickstart/*/status.json"))


@pytest.fixture
def sweep(logs):
    return next(path.parent for path in logs.glob("quickstart/*/jobs.jsonl"))


def test_a_report_of_a_run_needs_nothing_else(run, tmp_path):
    read = reported(run, "--output", tmp_path / "r.html")
    assert [address for address in read.addresses if not address.startswith("data:image/png;base64,")] == []
    assert len(read.addresses) == len(list(run.glob("*.png")))
    assert not read.tags & {"script", "link", "iframe", "object", "form"}
    assert read.policy.startswith("default-src 'none'; img-src data:; style-src 'sha256-")
    for name, value in load_run(run).metrics.items():
        assert f"{name} {figure(value)}" in read.text
    for word in load_run(run).manifest["overrides"]:
        assert word in read.text
    assert "omnilab-appearance 0.1.0" in read.text


def test_a_recording_is_copied_beside_where_it_is_asked_for(run, tmp_path, capsys):
    read = reported(run, "--output", tmp_path / "r.html", "--recording")
    assert (tmp_path / "r.rrd").read_bytes() == (run / "run.rrd").read_bytes()
    assert "r.rrd" in read.addresses
    assert "a recording lies beside it: r.rrd" in capsys.readouterr().err


def test_a_report_of_a_sweep_has_its_jobs_and_the_table_of_the_command(sweep, tmp_path, capsys):
    read = reported(sweep, "--output", tmp_path / "s.html")
    assert "2 of 2 jobs done" in read.text
    assert f"omnilab {' '.join(load_sweep(sweep).plan.command)}" in read.text
    capsys.readouterr()
    with pytest.raises(SystemExit):
        main(["compare", str(sweep), "--metrics", "nearest_rate"])
    line = next(line for line in capsys.readouterr().out.splitlines() if line.startswith("nearest_rate"))
    assert line.removeprefix("nearest_rate").strip() in read.text


def test_several_are_compared(run, sweep, tmp_path):
    read = reported(run, sweep, "--output", tmp_path / "both.html")
    assert "A run and a sweep compared" in read.text
    assert "What differs" in read.text


def test_texts_of_strangers_are_no_markup(run, tmp_path):
    status, manifest = run / "status.json", run / "manifest.json"
    for file, old in ((status, '"done"'), (manifest, '"quickstart"')):
        text = file.read_text(encoding="utf-8")
        assert old in text
        escaped = HOSTILE.replace('"', '\\"')
        file.write_text(text.replace(old, f'"{escaped}"', 1), encoding="utf-8")
    table = run / "metrics.csv"
    quoted = HOSTILE.replace('"', '""')
    table.write_text(table.read_text(encoding="utf-8").replace("nearest_rate", f'"{quoted}"', 1), encoding="utf-8")
    (run / "evil.png").write_text(HOSTILE, encoding="utf-8")
    odd = run.rename(run.with_name("<b onclick=x>&'"))
    read = reported(odd, "--output", tmp_path / "r.html")
    assert not read.tags & {"script", "b onclick", "form", "iframe"}
    assert read.handlers == []
    assert [address for address in read.addresses if not address.startswith("data:image/png;base64,")] == []
    assert "<script>alert(1)</script>" in read.text
    assert "evil.png is no PNG" in read.text


def test_pictures_are_bounded(tmp_path, monkeypatch):
    monkeypatch.setattr("omnilab_serve.reports.pictures.MOST_BYTES", 100)
    picture = b"\x89PNG\r\n\x1a\n" + bytes(52)
    for name in ("a.png", "b.png"):
        (tmp_path / name).write_bytes(picture)
    (tmp_path / "link.png").symlink_to("/etc/passwd")
    first, second, link, none = PictureBudget().pictures(tmp_path, ["a.png", "b.png", "link.png", "none.png"])
    assert first.address.startswith("data:image/png;base64,iVBORw0KGgo")
    assert (second.address, link.address, none.address) == ("", "", "")
    assert "b.png is too large for a report" in second.why_not


def test_what_is_no_run_is_refused(tmp_path, capsys):
    for words, sentence in (
        (["none"], "there is no folder"),
        ([str(tmp_path)], "holds no sweep"),
    ):
        with pytest.raises(SystemExit) as ended:
            main(["report", *words, "--output", str(tmp_path / "r.html")])
        assert ended.value.code == 2
        assert sentence in capsys.readouterr().err
    assert list(tmp_path.iterdir()) == []


def test_a_report_is_printed_on_paper(run, sweep, tmp_path, browser):
    reported(run, sweep, "--output", tmp_path / "r.html")
    page, asked = browser.new_page(), []
    page.on("request", lambda request: asked.append(request.url))
    page.goto(f"file://{tmp_path / 'r.html'}")
    printed = page.pdf(prefer_css_page_size=True)
    assert printed.startswith(b"%PDF")
    assert 2 <= printed.count(b"/Type /Page\n") <= 12
    assert [url for url in asked if not url.startswith("data:")] == [f"file://{tmp_path / 'r.html'}"]
    assert page.evaluate("getComputedStyle(document.querySelector('.state')).borderRadius") == "99px", "styled"
    page.close()


def test_the_service_hands_reports_out_to_be_saved(serve, logs, run):
    served = serve(logs=logs)
    path = run.relative_to(logs).as_posix()
    for address in (f"/reports/{path}", f"/api/reports/{path}"):
        answer = served.client.get(address, timeout=120)
        assert answer.status_code == 200
        assert answer.headers["content-disposition"].startswith("attachment")
        assert "sandbox" in answer.headers["content-security-policy"]
        assert "nearest_rate" in ReadReport(answer.text).text
    assert served.client.get("/reports/../x").status_code == 404
    assert served.client.get("/reports/none").status_code == 404
