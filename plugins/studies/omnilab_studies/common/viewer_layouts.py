"""How runs look in a viewer."""

from __future__ import annotations

from collections.abc import Sequence

from omnilab.api import Panel, ViewLayout


def views(panoramas: bool) -> ViewLayout:
    """Pictures from chosen poses, with or without their panoramas."""
    pictures = [Panel("image", "Picture", ("view/image",))]
    if panoramas:
        pictures.append(Panel("image", "Panorama", ("view/panorama",)))
    world = Panel("map", "World, poses and what the camera sees", ("room", "poses", "camera", "cloud"))
    return ViewLayout(columns=((world,), (*pictures, Panel("text", "Poses", ("summary",)))), widths=(3, 2))


PLACES = ViewLayout(
    columns=(
        (
            Panel("map", "Places and queries", ("room", "places", "camera", "estimate", "answers")),
            Panel("map", "Distance of the query to every place", ("distances",)),
        ),
        (
            Panel("image", "Query", ("query/image",)),
            Panel("image", "Panorama", ("query/panorama",)),
            Panel("image", "Signature", ("query/signature",)),
        ),
        (
            Panel("plot", "Position error", ("error/position_m",)),
            Panel("plot", "Heading error", ("error/heading_deg",)),
            Panel("image", "Recall and precision", ("recall",)),
            Panel("text", "Result", ("summary",)),
        ),
    ),
    widths=(3, 2, 2),
)

JOINT = ViewLayout(
    columns=(
        (Panel("map", "The map, and the first query at each height", ("room", "places", "camera", "estimate")),),
        (
            Panel("image", "Query, a height a step", ("query/image",)),
            Panel("image", "Panorama", ("query/panorama",)),
            Panel("plot", "Rate of nearest answers at each height", ("nearest",)),
            Panel("plot", "Height above the map: true, and told", ("height",)),
        ),
        (Panel("text", "Result", ("summary",)), Panel("log", "Log", ("log",))),
    ),
    widths=(3, 2, 2),
)

STEPS = ViewLayout(
    columns=(
        (Panel("map", "The map at each step, and the answers in it", ("room", "places", "camera", "answers")),),
        (
            Panel("image", "The last query, a step of the map at a time", ("query/image",)),
            Panel("image", "Panorama", ("query/panorama",)),
            Panel("plot", "Rate of nearest answers at each step", ("nearest",)),
        ),
        (Panel("text", "Result", ("summary",)), Panel("log", "Log", ("log",))),
    ),
    widths=(3, 2, 2),
)

CONDITIONS = ViewLayout(
    columns=(
        (Panel("map", "The map, and the answers in a condition", ("room", "places", "camera", "answers", "estimate")),),
        (
            Panel("image", "The first query, a condition a step", ("query/image",)),
            Panel("image", "Panorama", ("query/panorama",)),
            Panel("plot", "Rate of nearest answers in each condition", ("nearest",)),
        ),
        (Panel("text", "Result", ("summary",)), Panel("log", "Log", ("log",))),
    ),
    widths=(3, 2, 2),
)

MAPPING = ViewLayout(
    columns=(
        (Panel("map", "The map", ("room", "places", "camera")),),
        (
            Panel("image", "Place", ("query/image",)),
            Panel("image", "Panorama", ("query/panorama",)),
            Panel("image", "Signature", ("query/signature",)),
        ),
        (Panel("text", "Result", ("summary",)), Panel("log", "Log", ("log",))),
    ),
    widths=(3, 2, 2),
)

IMAGES = ViewLayout(
    columns=(
        (Panel("map", "Where images are taken", ("room", "places", "camera")),),
        (Panel("image", "Image", ("image",)), Panel("image", "Panorama", ("panorama",))),
        (Panel("text", "Result", ("summary",)), Panel("log", "Log", ("log",))),
    ),
    widths=(3, 2, 2),
)

LEVELS = ViewLayout(
    columns=(
        (Panel("map", "Places, the first query and its answers", ("room", "places", "camera", "estimate")),),
        (
            Panel("image", "The first query, a level a step", ("query/image",)),
            Panel("image", "Panorama", ("query/panorama",)),
            Panel("plot", "Rate of nearest answers at each level", ("nearest",)),
        ),
        (Panel("text", "Result", ("summary",)), Panel("log", "Levels", ("log",))),
    ),
    widths=(2, 2, 2),
)

SIZES = ViewLayout(
    columns=(
        (Panel("map", "Places, and answers in the first size", ("room", "places", "answers")),),
        (
            Panel("image", "The first query's signature, a size a step", ("query/signature",)),
            Panel("plot", "Rate of nearest answers in each size", ("nearest",)),
        ),
        (Panel("text", "Result", ("summary",)),),
    ),
    widths=(2, 2, 2),
)

LOCAL_MAPS = ViewLayout(
    columns=(
        (
            Panel(
                "map",
                "The local map settles over the truth (blue: compressed springs, red: stretched)",
                ("truth", "map"),
            ),
            Panel("map", "Places and query", ("room", "places", "camera")),
        ),
        (Panel("image", "Query", ("query/image",)), Panel("image", "Panorama", ("query/panorama",))),
        (
            Panel("plot", "Error of each query, map and centroid (steps are queries)", ("error/map", "error/centroid")),
            Panel("text", "Result", ("summary",)),
            Panel("log", "Log", ("log",)),
        ),
    ),
    widths=(3, 2, 3),
)

TOPOLOGICAL_MAPS = ViewLayout(
    columns=(
        (Panel("map", "Each map settles over the truth (blue: compressed springs, red: stretched)", ("truth", "map")),),
        (
            Panel("map", "Where the images are taken", ("room", "truth", "camera")),
            Panel("image", "Image", ("query/image",)),
            Panel("image", "Panorama", ("query/panorama",)),
        ),
        (Panel("text", "Result", ("summary",)), Panel("log", "Maps", ("log",))),
    ),
    widths=(3, 2, 2),
)

GROWTH = ViewLayout(
    columns=(
        (
            Panel("map", "Places and queries (green: the exhaustive answer)", ("room", "places", "camera", "answers")),
            Panel("image", "The first query", ("query/image",)),
            Panel("image", "Its signature", ("query/signature",)),
        ),
        (
            Panel("plot", "ms a query, a map a step", ("time",)),
            Panel("plot", "Signatures compared with a query", ("compared",)),
            Panel("plot", "MB of the prepared map", ("memory",)),
            Panel("plot", "Agreement with exhaustive search", ("agreement",)),
        ),
        (Panel("text", "Result", ("summary",)),),
    ),
    widths=(2, 2, 2),
)

TRAJECTORY = ViewLayout(
    columns=(
        (
            Panel("map", "The map grows (white dots: the true way)", ("room", "truth", "map", "closures", "robot")),
            Panel("map", "By odometry alone, and optimised", ("truth", "odometry", "final")),
        ),
        (
            Panel("image", "Image", ("query/image",)),
            Panel("image", "Where matches moved to (green: they agree with the motion)", ("query/panorama",)),
            Panel("plot", "ms for each image", ("time/image",)),
        ),
        (
            Panel("plot", "Position error after alignment", ("error",)),
            Panel("text", "Result", ("summary",)),
            Panel("log", "Log", ("log",)),
        ),
    ),
    widths=(3, 2, 2),
)


def comparison(curves: Sequence[str] = ()) -> ViewLayout:
    """Images on the left, then a panel for each of the named curves in up to two columns, then the result."""
    plots = [Panel("plot", f"{name} (steps are cm)", (f"curves/{name}",)) for name in curves]
    half = -(-len(plots) // 2)
    images = (
        Panel("map", "Places and images", ("room", "places", "camera")),
        Panel("image", "Image", ("query/image",)),
        Panel("image", "Panorama", ("query/panorama",)),
    )
    result = (Panel("text", "Result", ("summary",)), Panel("log", "Log", ("log",)))
    columns = (images, *(tuple(part) for part in (plots[:half], plots[half:]) if part), result)
    return ViewLayout(columns)


def rising(altimeters: Sequence[str], described: bool) -> ViewLayout:
    """A column of images as it rises, what altimeters compare, and the heights they tell."""
    pictures = [Panel("image", "The image, a height a step", ("query/image",))]
    if described:
        pictures.append(Panel("image", "Its transform: the offsets run down", ("query/signature",)))
    curves = [Panel("image", f"{name}: distances", (f"curves/{name}",)) for name in altimeters]
    heights = Panel("plot", "Rise over the last reference: estimates, scaled, and truth", ("rise",))
    columns = (
        (Panel("map", "The columns", ("room", "places", "camera")), *pictures),
        (heights, *curves),
        (Panel("text", "Result", ("summary",)), Panel("log", "Log", ("log",))),
    )
    return ViewLayout(columns, widths=(3, 3, 2))


VIEWS_TITLE = "Truth (grey), odometry (amber), the map's way and views; bearings: believed (green), gated (red)"
VIEWS_SHOWN = ("truth", "odometry", "way", "robot", "views", "candidates", "bearings")
VIEWS_ERRORS = (
    Panel("plot", "Error in x, ±2σ", ("error/x_m",)),
    Panel("plot", "Error in y, ±2σ", ("error/y_m",)),
    Panel("plot", "Error in heading, ±2σ", ("error/heading_deg",)),
)

VIEW_SLAM = ViewLayout(
    columns=(
        (
            Panel("map", VIEWS_TITLE, ("room", *VIEWS_SHOWN)),
            Panel("image", "Panorama above that of the view it shows best", ("query/panorama",)),
        ),
        (Panel("image", "Image", ("query/image",)), *VIEWS_ERRORS),
        (Panel("text", "Result", ("summary",)), Panel("log", "Log", ("log",))),
    ),
    widths=(4, 2, 2),
)

VIEW_MAP = ViewLayout(
    columns=(
        (Panel("map", VIEWS_TITLE, ("walls", *VIEWS_SHOWN)),),
        VIEWS_ERRORS,
        (Panel("text", "Result", ("summary",)), Panel("log", "Log", ("log",))),
    ),
    widths=(5, 2, 2),
)
