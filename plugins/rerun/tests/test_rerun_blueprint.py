"""A study's layout is embedded as a blueprint."""

from __future__ import annotations

import numpy as np
import pytest

from omnilab.api import Graph, Mesh, Panel, PlaceMap, PointCloud, Tick, ViewLayout
from omnilab.errors import ConfigError

ROOM = Mesh(np.array([[-5, -4, 0], [5, 4, 0], [5, -4, 3.0]]), np.array([[0, 1, 2]]), np.zeros((3, 3), np.uint8))
LAYOUT = ViewLayout(
    [
        [Panel("map", "Room", ["/room", "places", "distance"])],
        [Panel("image", "Image", ["image"]), Panel("map", "Surface", ["distance"])],
        [Panel("plot", "Error", ["error/position"]), Panel("text", "About", ["about"]), Panel("log", "Log", ["log"])],
    ],
    widths=[2, 1, 1],
)


def views(blueprint):
    """Class and contents of the blueprint's views, by name."""
    parts = dict(blueprint)
    found = {}
    for path, components in blueprint:
        if "ViewBlueprint:class_identifier" in components:
            contents = parts[f"{path}/ViewContents"]["ViewContents:query"][0]
            found[components["ViewBlueprint:display_name"][0][0]] = (
                components["ViewBlueprint:class_identifier"][0][0],
                contents,
            )
    return found


def one(blueprint, component):
    (value,) = [components[component][0] for _, components in blueprint if component in components]
    return value


def test_every_panel_becomes_a_view_of_its_records(recorded):
    shown = views(recorded([("layout", LAYOUT, None)]).blueprint())
    assert shown == {
        "Run": ("TextDocument", ["$origin/**"]),
        "Room": ("3D", ["+ /room/**", "+ /places/**", "+ /distance/**", *_no_surfaces("room", "places", "distance")]),
        "Image": ("2D", ["+ /image/**"]),
        "Surface": ("3D", ["+ /distance/**"]),
        "Error": ("TimeSeries", ["+ /error/position/**"]),
        "About": ("TextDocument", ["+ /about/**"]),
        "Log": ("TextLog", ["+ /log/**"]),
    }


def _no_surfaces(*paths):
    return [f"- /{path}/surface" for path in paths]


def test_columns_stand_side_by_side_with_their_widths_and_time_is_the_step(recorded):
    blueprint = recorded([("layout", LAYOUT, None)]).blueprint()
    assert one(blueprint, "ContainerBlueprint:col_shares") == [2, 1, 1]
    stacked = [
        len(parts["ContainerBlueprint:contents"][0])
        for path, parts in blueprint
        if "ContainerBlueprint:contents" in parts
    ]
    assert sorted(stacked) == [1, 2, 2, 3, 3], "columns of 1, 2 and 3 panels in a row of 3, below the header"
    assert one(blueprint, "TimePanelBlueprint:timeline") == ["step"]


@pytest.mark.parametrize("order", ["layout first", "layout last"])
def test_the_eye_sees_the_whole_room_from_above(recorded, order):
    records = [("layout", LAYOUT, None), ("room", ROOM, None), ("places", PlaceMap(np.zeros((1, 3))), None)]
    blueprint = recorded(records if order == "layout first" else records[::-1]).blueprint()
    target = np.array(one(blueprint, "EyeControls3D:look_target")[0])
    np.testing.assert_allclose(target, [0, 0, 1.5])
    away = np.array(one(blueprint, "EyeControls3D:position")[0]) - target
    assert away[2] > -away[1] > 0
    assert np.linalg.norm(away) > np.linalg.norm([5, 4, 1.5]), "outside the sphere around the room"


def test_the_eye_sees_what_lies_still_whatever_it_is(recorded):
    corners = np.array([[-8, -6, 0], [8, 6, 0.0]])
    graph, cloud = (
        Graph(corners, np.array([[0, 1]])),
        PointCloud(corners + np.array([2, 0, 0]), np.zeros((2, 3), np.uint8)),
    )
    moving = ("distance", Graph(100 * corners, np.array([[0, 1]])), Tick(1, 0))
    records = [("layout", LAYOUT, None), ("room", graph, None), ("places", cloud, None), moving]
    target = one(recorded(records).blueprint(), "EyeControls3D:look_target")[0]
    np.testing.assert_allclose(target, [1, 0, 0], atol=1e-6)


def test_an_unknown_kind_of_panel_is_refused(recorded):
    with pytest.raises(ConfigError, match="'Odd' is of kind 'pie'; give one of map, image, plot, text, log"):
        recorded([("layout", ViewLayout([[Panel("pie", "Odd", ["x"])]]), None)])


def test_without_a_layout_the_viewer_chooses(recorded):
    assert not recorded([("room", ROOM, None)]).reader.blueprints()
