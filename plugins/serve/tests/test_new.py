"""The form by which experiments are started: its fields, its sentences, its command."""

import re
import subprocess
import sys

import pytest
from omegaconf import OmegaConf

from omnilab.client import Submission
from omnilab.runner.overrides.composition import compose
from omnilab.runner.plugins.folders import own_recipes
from omnilab.runner.registry import discover
from omnilab_serve.composing.composer import COMMAND

pytestmark = pytest.mark.slow  # each waits for a process that imports the plugins


@pytest.fixture
def opened(served_once, tab):
    """Opens the form of a recipe, once its command is there."""

    def opened(query):
        tab.goto(f"{served_once.url}/new?{query}")
        tab.wait_for_selector("#command, #outcome [data-refused]")
        return tab

    return opened


def command(tab, words):
    """Waits until these words are those of the command."""
    tab.wait_for_function("words => document.getElementById('command')?.textContent === words", arg=f"omnilab {words}")


def setting(tab, path):
    return tab.locator(f"[id='set-{path}']")


def refusal(tab):
    """The sentence at a field, and the name of that field's setting."""
    field = tab.locator(".field.wrong, .nested.wrong")
    field.wait_for()
    return field.get_attribute("data-setting"), field.locator("> .why").inner_text()


def test_a_recipe_is_found_by_its_words_and_opened_with_the_keyboard(served_once, tab):
    tab.goto(served_once.url + "/new")
    assert tab.locator("#recipes > a:visible").count() == len(own_recipes())
    tab.keyboard.type("small grid minute")
    assert tab.locator("#recipes > a:visible").all_inner_texts()[0].startswith("quickstart")
    tab.keyboard.press("Enter")
    tab.wait_for_selector("#command")
    command(tab, "experiment=quickstart")


def test_only_what_differs_from_the_recipe_is_said(opened):
    tab = opened("experiment=quickstart")
    assert setting(tab, "study.step_m").input_value() == "0.4"
    setting(tab, "study.step_m").fill("0.5")
    command(tab, "experiment=quickstart study.step_m=0.5")
    setting(tab, "study.step_m").fill("")
    command(tab, "experiment=quickstart")
    setting(tab, "sensor.color").check()
    setting(tab, "study.queries").select_option("rest")
    setting(tab, "seed").fill("3")
    command(tab, "experiment=quickstart study.queries=rest sensor.color=true seed=3")
    tab.locator("[data-setting='study.queries'] .reset").click()
    setting(tab, "sensor.color").uncheck()
    command(tab, "experiment=quickstart seed=3")


def test_a_component_brings_its_settings_and_commas_make_a_sweep(opened):
    tab = opened("experiment=quickstart")
    tab.locator("#choose-descriptor").select_option("hog")
    tab.wait_for_selector("[id='set-descriptor.cells']")
    assert setting(tab, "descriptor.angles").count() == 0
    command(tab, "experiment=quickstart descriptor=hog")
    tab.locator("#slot-descriptor .several > summary").first.click()
    tab.locator("#slot-descriptor > header .several label", has_text="gist").first.click()
    setting(tab, "seed").fill("range(1,4)")
    command(tab, "-m experiment=quickstart descriptor=hog,gist 'seed=range(1,4)'")
    assert tab.locator(".jobs").inner_text().split() == ["6", "jobs", "2", "×", "descriptor", "3", "×", "seed"]


def test_members_are_left_out_and_free_overrides_are_taken(opened):
    tab = opened("experiment=room")
    tab.locator(".group > summary", has_text="Sinks").click()
    tab.locator("#slot-sinks\\.mcap .keep input[type=checkbox]").uncheck()
    command(tab, "experiment=room '~sinks.mcap'")
    tab.locator("summary", has_text="More overrides").click()
    tab.locator("#more").fill("disturbances.occlusion.fraction=0,0.2\n\n  seed=5 ")
    command(tab, "-m experiment=room '~sinks.mcap' disturbances.occlusion.fraction=0,0.2 seed=5")


@pytest.mark.parametrize(
    ("path", "value", "sentence"),
    [
        ("study.step_m", "0.2,-1", "study.step_m=-1 is out of range; give a number above 0, or null"),
        ("sensor.size", "huge", "sensor.size=huge does not fit: sensor.size takes a whole number"),
        ("descriptor.angles", "1", "descriptor.angles=1 is out of range; give a whole number from 4 to 4096"),
        ("sensor.world", "/etc/passwd", "sensor.world=/etc/passwd is read from /etc/passwd, which is in none of the folders"),
        ("seed", "${oc.env:HOME}", "seed=${oc.env:HOME} inserts what ${...} names"),
        ("cache_gb", "0", "cache_gb=0 is out of range; give a number above 0 and up to 1e+06"),
    ],
)  # fmt: skip
def test_what_is_refused_is_said_at_its_field(opened, path, value, sentence):
    tab = opened("experiment=quickstart")
    tab.evaluate("document.querySelectorAll('details').forEach((each) => (each.open = true))")
    setting(tab, path).fill(value)
    name, said = refusal(tab)
    assert (name, said.startswith(sentence)) == (path, True)
    assert setting(tab, path).get_attribute("aria-invalid") == "true"
    assert tab.locator("#start").is_disabled()
    setting(tab, path).fill("")
    command(tab, "experiment=quickstart")
    assert tab.locator(".why:visible").count() == 0
    assert tab.locator("#start").is_enabled()


def test_what_is_needed_is_said_at_its_place_and_another_study_brings_its_own_settings(opened):
    tab = opened("experiment=recorded_grid")
    assert refusal(tab) == ("sensor.path", "sensor.path is not set and has no default; give sensor.path=VALUE")
    tab = opened("experiment=quickstart")
    tab.locator("#choose-study").select_option("steps")
    setting(tab, "study.heading_steps").wait_for(state="attached")
    assert setting(tab, "study.heading_steps").input_value() == "180"
    tab = opened("experiment=quickstart")
    tab.locator("#more").evaluate(
        "(more) => { more.value = 'hydra.run.dir=/tmp'; more.dispatchEvent(new Event('input', {bubbles: true})) }"
    )
    tab.wait_for_selector("#more[aria-invalid]")
    assert "sets Hydra itself" in tab.locator(".field:has(> #more) .why").inner_text()


def test_it_starts_from_the_overrides_of_a_run(serve, tab, finished_runs):
    served = serve(logs=finished_runs)
    run = next(r for r in served.client.get("/api/runs").json()["runs"] if r["components"]["descriptor"] == "hog")
    tab.goto(f"{served.url}/runs/{run['path']}")
    tab.get_by_text("Start another like it").click()
    tab.wait_for_selector("#command")
    words = tab.locator("#command").inner_text().split()
    assert {"descriptor=hog", "study.query_count=6", "seed=2", "cache=off"} <= {*words}
    assert setting(tab, "sensor.size").input_value() == "64"


def test_start_puts_it_into_the_queue(served_once, tab, monkeypatch):
    served, asked = served_once, []

    def submit(request):
        asked.append(request)
        return Submission("1", "queued", request.overrides)

    monkeypatch.setattr(served.app.state.service.queue, "submit", submit)
    tab.goto(f"{served.url}/new?experiment=quickstart")
    tab.wait_for_selector("#command")
    setting(tab, "seed").fill("1,2")
    tab.locator("#priority").fill("7")
    tab.locator("#launcher").select_option("joblib")
    setting(tab, "seed").press("Enter")
    assert asked == []
    setting(tab, "seed").press("Control+Enter")
    tab.wait_for_url("**/queue")
    (request,) = asked
    assert (list(request.overrides), request.priority, request.launcher) == (
        ["experiment=quickstart", "seed=1,2"], 7, "joblib",
    )  # fmt: skip


def test_shipped_worlds_are_suggested(opened):
    tab = opened("experiment=quickstart")
    assert setting(tab, "sensor.world").get_attribute("list") == "of-sensor.world"
    options = tab.locator("[id='of-sensor.world'] option")
    assert {"room", "office"} <= {option.get_attribute("value") for option in options.all()}


def test_a_composer_that_dies_is_said_and_the_next_request_has_another(serve):
    served = serve()
    composer = served.app.state.service.composer
    composer._command = (sys.executable, "-c", "raise SystemExit(3)")
    page = served.client.get("/new?experiment=quickstart")
    assert (page.status_code, "died over this (exit status 3)" in page.text) == (422, True)
    part = served.client.post("/parts/new/check", data={"experiment": "quickstart"})
    assert 'data-refused="the process that composes experiments died over this' in part.text
    composer._command = COMMAND
    assert served.client.get("/new?experiment=quickstart").status_code == 200


def test_no_recipe_of_another_name_is_opened(served_once):
    client = served_once.client
    assert client.get("/new?experiment=../config").status_code == 404
    for where in ("/parts/new/check", "/new", "/parts/new/slot"):
        answer = client.post(where, data={"experiment": "../config", "slot": "sensor"})
        assert "experiment &#39;../config&#39; does not exist" in answer.text
    answer = client.post("/parts/new/check", data={"experiment": "quickstart", "choose:descriptor": "../x"})
    assert "descriptor=../x is no name" in answer.text


@pytest.mark.slow
def test_the_form_of_every_third_recipe_renders(served_once):
    client = served_once.client
    client.timeout = 300
    for recipe in sorted(own_recipes())[::3]:
        page = client.get("/new", params={"experiment": recipe})
        assert page.status_code == 200, recipe
        assert 'id="choose-study"' in page.text
        assert len(page.text) < 500_000


CHANGES = {
    "quickstart": {"set:study.step_m": "0.5", "choose:descriptor": "gist", "set:sensor.color": "true"},
    "room": {"choose:descriptor@descriptors.radon_gist": "hog", "set:localizers.spring.neighbours": "12", "keep:sinks.mcap": "off"},
    "altitude": {"set:altimeters.sift.detector": "surf", "set:altimeters.sift.ratio": "0.7", "more": "~altimeters.surf"},
    "view_slam": {"choose:descriptor": "radon", "set:sensor.world": "my room, with a comma.yaml", "set:odometry.turn_noise": "1e-3"},
    "changes": {"set:study.extent_m": "[2,3]", "set:sensor.variant": "été", "set:map": "null"},
}  # fmt: skip


@pytest.mark.slow
@pytest.mark.parametrize("recipe", CHANGES)
def test_the_command_composes_the_same_on_the_command_line(served_once, recipe, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "my room, with a comma.yaml").write_text("")
    form = {"experiment": recipe, **CHANGES[recipe]}
    words = form_words(served_once, form)
    shown = subprocess.run(
        [sys.executable, "-m", "omnilab", *words, "--cfg", "job"], capture_output=True, text=True, check=True
    ).stdout
    plain = compose([f"experiment={recipe}"], registry := discover()).config
    assert shown.strip() == OmegaConf.to_yaml(compose(words, registry).config).strip()
    changed, before = OmegaConf.create(shown), OmegaConf.create(OmegaConf.to_yaml(plain))
    assert changed != before
    for name, value in form.items():
        if name.startswith("set:") and value != "null":
            expected = OmegaConf.from_dotlist([f"value={value}"]).value
            assert OmegaConf.select(changed, name.removeprefix("set:")) == expected, name


def form_words(served, form):
    """The words that the service makes of a form."""
    from starlette.datastructures import FormData

    from omnilab_serve.pages.new import _filled

    return _filled(FormData(form)).words(served.app.state.service.composer)


PLUGIN = """
from dataclasses import dataclass
from omnilab import Signatures, hookimpl

@dataclass
class Mine:
    '''A descriptor of mine.'''

    rows: int = 8  # of the <b>tiny</b> image
    view, color, rotation, default_distance = "panorama", False, "equivariant", "poc"

    def describe(self, images):
        return Signatures(images.astype("float32"))

@hookimpl
def register_descriptors(register):
    register("mine", Mine)
"""


def test_a_plugin_of_others_appears_by_itself(serve, tab, tmp_path, monkeypatch):
    (tmp_path / "mine.py").write_text(PLUGIN)
    monkeypatch.setenv("OMNILAB_PLUGINS", str(tmp_path / "mine.py"))
    tab.goto(f"{serve().url}/new?experiment=quickstart")
    tab.wait_for_selector("#command")
    tab.locator("#choose-descriptor").select_option("mine")
    tab.wait_for_selector("[id='set-descriptor.rows']")
    assert "of the <b>tiny</b> image" in tab.locator("[data-setting='descriptor.rows'] .help").inner_text()
    setting(tab, "descriptor.rows").fill("4")
    command(tab, "experiment=quickstart descriptor=mine descriptor.rows=4")
    assert re.search("A descriptor of mine", tab.locator("#slot-descriptor").inner_text())
