"""The report of a record: one self-contained HTML page without scripts, its pictures, and a moving picture."""

import base64
from collections.abc import Callable, Mapping
from html import escape
from importlib import resources
from io import BytesIO
from pathlib import Path
from string import Template
from typing import Final, NamedTuple

import matplotlib as mpl
from matplotlib.figure import Figure

from guidance.errors import OutputError
from guidance.files import private_file, private_folder, writing
from guidance.log import SettingsOf
from guidance.viz import charts
from guidance.viz.story import Story, opening, story_of, summary


class Picture(NamedTuple):
    """A picture of a report: heading, caption and drawing function."""

    heading: str
    caption: str
    draw: Callable[[Story], Figure]


PICTURES: Final[Mapping[str, Picture]] = {
    "tracks": Picture(
        "Tracks",
        "Pursuer (solid) and evader (dashed) in the game frame. The isochron is where an evader that runs straight is "
        "caught, by heading. In the ideal game it is caught inside the one at engagement, whatever it does.",
        charts.tracks,
    ),
    "game": Picture(
        "The game",
        "Under optimal play V + t (pursuit-evasion) never rises and L (target-attacker-defender) never falls. What it "
        "rises or falls by is lost to what the game does not know: acceleration, lag, wind, noise.",
        charts.game,
    ),
    "velocities": Picture(
        "Velocities",
        "Flown (grey), commanded after servo and limits (solid), and wanted by the game (dashed).",
        charts.velocities,
    ),
    "ages": Picture("Ages and latencies", "How old what each cycle knew was, and how the loop kept time.", charts.ages),
    "events": Picture("Events", "Every event of the flight.", charts.events),
}


def write_report(path: Path, folder: Path, settings_of: SettingsOf, *, animate: bool = False) -> list[Path]:
    """Write `report.html` and one PNG per picture into `folder`; return the files, the page first.

    Args:
        path: The record.
        folder: Made if it does not exist. An earlier report of the same record is replaced.
        settings_of: Makes settings from the metadata of a record.
        animate: Write `flight.webp` too, a moving picture of the flight.

    Raises:
        ConfigError: If the record cannot be read.
        OutputError: If the folder cannot be written, or contains the report of another record.
    """
    story = story_of(path, settings_of)
    page, mark = folder / "report.html", _mark(path, story)
    with writing(folder):
        if page.exists() and mark not in page.read_text(encoding="utf-8", errors="replace"):
            raise OutputError(f"{page}: is the report of another record; give --out another folder")
        private_folder(folder)
        written, images = [page], {}
        for name, picture in PICTURES.items():
            figure = picture.draw(story)
            written.append(folder / f"{name}.png")
            figure.savefig(private_file(written[-1]), dpi=130)
            figure.set_layout_engine(None)  # keep this layout for the SVG
            images[name] = svg_of(figure)
        if animate:
            written.append(folder / "flight.webp")
            charts.animate(story, private_file(written[-1]))
        private_file(page).write_text(page_of(story, images, mark), encoding="utf-8")
    return written


def _mark(path: Path, story: Story) -> str:
    """Return the element of a page that names its record."""
    survey = story.survey
    what = f"{path.name}, {sum(survey.messages.values())} messages, {survey.duration_s:.3f} s"
    return f'<meta name="record" content="{escape(what)}">'


def svg_of(figure: Figure) -> bytes:
    """Return a figure as SVG, reproducible byte for byte."""
    stream = BytesIO()
    with mpl.rc_context({"svg.hashsalt": "report"}):
        figure.savefig(stream, format="svg", metadata={"Date": None, "Creator": None})
    return stream.getvalue()


def page_of(story: Story, pictures: Mapping[str, bytes], mark: str) -> str:
    """Return the page: the template `report.html` with its places filled."""
    rows = (f"<tr><th scope='row'>{escape(name)}</th><td>{escape(text)}</td></tr>" for name, text in summary(story))
    template = Template(resources.files("guidance.viz").joinpath("report.html").read_text(encoding="utf-8"))
    return template.substitute(
        mark=mark,
        title=escape(story.title),
        opening=escape(opening(story)),
        rows="\n".join(rows),
        sections="\n".join(_section(name, image) for name, image in pictures.items()),
    )


def _section(name: str, image: bytes) -> str:
    picture = PICTURES[name]
    data = base64.b64encode(image).decode("ascii")
    return (
        f'<h2 id="{name}">{escape(picture.heading)}</h2>\n'
        f'<figure><img alt="{escape(picture.heading)}: {escape(picture.caption)}" '
        f'src="data:image/svg+xml;base64,{data}">\n<figcaption>{escape(picture.caption)}</figcaption></figure>'
    )
