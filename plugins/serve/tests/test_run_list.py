"""The table of runs."""


def test_a_browser_shows_the_runs(serve, tab, finished_runs):
    served = serve(logs=finished_runs)
    tab.goto(served.url)
    assert tab.locator("tbody tr").count() == 4
    tab.screenshot(path="/tmp/runs.png")
