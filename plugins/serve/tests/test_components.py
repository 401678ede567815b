"""What is installed, as pages and as data."""

import sys

import cv2
import numpy as np
import pytest
from playwright.sync_api import expect

from omnilab.client import Client, SubmissionRequest
from omnilab.errors import OmnilabError

pytestmark = pytest.mark.slow  # each waits for a process that imports the plugins

BROKEN = "raise ImportError('no module named <script>alert(1)</script>')\n"


@pytest.fixture
def tab(tab):
    """Without the pictures of worlds, which take seconds each to draw: they have a test of their own."""
    tab.route("**/*.png", lambda route: route.abort())
    return tab


def test_components_are_found_by_their_words(served_once, tab):
    tab.goto(served_once.url + "/components")
    shown = tab.locator(".pick:visible")
    assert shown.count() > 90
    tab.locator("[data-filter]").fill("radon_hog")
    assert [text.splitlines()[0] for text in shown.all_inner_texts()] == ["radon_hog", "radon_hog_grid"]
    assert tab.locator("section:visible h2").all_inner_texts() == ["Descriptor"]
    tab.locator("[data-filter]").press("Enter")
    tab.wait_for_url("**/components/descriptor/radon_hog")
    row = tab.locator("tr", has=tab.get_by_text("angles", exact=True))
    assert row.locator("td").all_inner_texts()[1:3] == ["int", "180"]
    assert "a whole number from 4 to 4096" in row.inner_text()


def test_what_uses_a_component_fills_the_form(served_once, tab):
    tab.goto(served_once.url + "/components/descriptor/hog")
    assert tab.locator(".copyable code").inner_text() == "descriptor=hog"
    tab.get_by_text("Try it in the quickstart").click()
    tab.wait_for_selector("#command")
    assert tab.locator("#command").inner_text() == "omnilab experiment=quickstart descriptor=hog"


def test_plugins_that_failed_come_first_and_are_no_markup(serve, tab, tmp_path, monkeypatch):
    (tmp_path / "broken.py").write_text(BROKEN)
    monkeypatch.setenv("OMNILAB_PLUGINS", str(tmp_path / "broken.py"))
    served = serve()
    tab.goto(served.url + "/components")
    notice = tab.locator(".notice.failed")
    assert "no module named <script>alert(1)</script>" in notice.inner_text()
    notice.locator("summary").click()
    assert "Traceback" in notice.locator("pre").inner_text()
    (failure,) = served.client.get("/api/failed-plugins").json()
    assert "broken" in failure["plugin"]
    assert "ImportError" in failure["traceback"]


def test_the_client_knows_recipes_components_and_what_the_builder_says(served_once):
    client = Client(served_once.url)
    assert "quickstart" in [recipe.name for recipe in client.recipes()]
    radon = next(each for each in client.components() if (each.kind, each.name) == ("descriptor", "radon"))
    assert [setting["name"] for setting in radon.settings] == ["offsets", "angles", "color"]
    checked = client.check(SubmissionRequest(["experiment=quickstart", "seed=1,2,3"]))
    assert (checked.experiment, checked.jobs, checked.command) == (
        "quickstart", 3, ["-m", "experiment=quickstart", "seed=1,2,3"],
    )  # fmt: skip
    with pytest.raises(OmnilabError, match="is out of range; give a number above 0, or null"):
        client.check(SubmissionRequest(["experiment=quickstart", "study.step_m=0"]))


def test_the_api_names_the_field_that_a_sentence_is_about(served_once):
    api = served_once.client
    answer = api.post("/api/check", json={"overrides": ["experiment=quickstart", "descriptor=hogg"]})
    assert answer.status_code == 422
    assert answer.json()["field"] == "descriptor"
    assert answer.json()["detail"].startswith("descriptor 'hogg' does not exist")
    assert api.get("/api/components/descriptor/hog").json()["summary"]
    assert api.get("/api/components/descriptor/none").status_code == 404
    slots = {slot["path"]: slot["name"] for slot in api.get("/api/recipes/room").json()["slots"]}
    assert slots["descriptors.radon_gist"] == "radon_gist"
    assert "seed" in [setting["name"] for setting in api.get("/api/run-settings").json()]


def test_worlds_are_drawn_once_by_each_camera(serve, tab, tmp_path, monkeypatch):
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "cache"))
    served = serve()
    tab.goto(served.url + "/components/sensor/mirror")
    expect(tab.locator("img[data-drawn]")).to_have_count(0)  # they are asked for, one after the other
    assert tab.locator("figcaption").all_inner_texts() == [
        f"sensor.world={world}" for world in ("corridor", "office", "plain", "room", "square", "storey")
    ]
    address = tab.get_by_alt_text("room as mirror sees it").get_attribute("src")
    served.client.timeout = 120
    first = served.client.get(address)
    assert first.headers["content-type"] == "image/png"
    image = cv2.imdecode(np.frombuffer(first.content, np.uint8), cv2.IMREAD_COLOR)
    assert image.shape == (250, 250, 3)
    assert image.std() > 20
    (file,) = (tmp_path / "cache/omnilab/pictures").iterdir()
    drawn_ns = file.stat().st_mtime_ns
    assert served.client.get(address).content == first.content
    served.app.state.service.painter.rest()
    assert served.client.get(address).content == first.content
    assert file.stat().st_mtime_ns == drawn_ns


def test_neither_pages_nor_the_end_wait_for_pictures(serve, tab):
    served = serve()
    painter = served.app.state.service.painter
    painter._command = (sys.executable, "-c", "import time; time.sleep(1000)")
    tab.unroute("**/*.png")
    with tab.expect_request("**/*.png"):
        tab.goto(served.url + "/components", wait_until="commit")
    while painter.pid is None:
        tab.wait_for_timeout(20)
    tab.goto(served.url + "/new?experiment=quickstart")
    assert painter.pid is not None
    served.stop()
    assert not served.thread.is_alive()


def test_there_are_pictures_of_shipped_worlds_alone(served_once):
    client = served_once.client
    for where in ("mirror/nonsense", "folder/room", "mirror/..%2f..%2fetc", "mirror/%2fetc%2fpasswd"):
        assert client.get(f"/components/sensor/{where}.png").status_code == 404
