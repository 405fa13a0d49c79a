"""The report of a record: one self-contained HTML page without scripts, its pictures, and a moving picture."""

import base64
from collections.abc import Callable, Mapping
from html import escape
from io import BytesIO
from pathlib import Path
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

_STYLE: Final = """
:root { color-scheme: light; }
body { font: 15px/1.5 system-ui, sans-serif; color: #111; background: #fff; max-width: 72rem; margin: 2rem auto;
  padding: 0 1rem; }
h1 { font-size: 1.5rem; margin-bottom: 0.5rem; }
h2 { font-size: 1.15rem; margin: 2rem 0 0.5rem; }
table { border-collapse: collapse; }
th, td { text-align: left; padding: 0.2rem 1.2rem 0.2rem 0; border-bottom: 1px solid #ccc; vertical-align: top; }
th { font-weight: 600; white-space: nowrap; }
figure { margin: 0; break-inside: avoid; }
figure img { width: 100%; height: auto; display: block; }
p { max-width: 60rem; font-size: 1.05rem; }
figcaption { color: #444; max-width: 60rem; }
td { overflow-wrap: anywhere; }
@media (max-width: 40rem) {
  tr, th, td { display: block; white-space: normal; padding-right: 0; }
  th { border-bottom: 0; padding-bottom: 0; color: #444; }
}
"""


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
    """Return the page."""
    title = escape(story.title)
    rows = "\n".join(
        f"<tr><th scope='row'>{escape(name)}</th><td>{escape(text)}</td></tr>" for name, text in summary(story)
    )
    sections = "\n".join(_section(name, image) for name, image in pictures.items())
    return f"""<!DOCTYPE html>
<html lang="en">
<head>
<meta charset="utf-8">
<meta name="viewport" content="width=device-width, initial-scale=1">
<meta http-equiv="Content-Security-Policy" content="default-src 'none'; img-src data:; style-src 'unsafe-inline'">
{mark}
<title>{title}</title>
<link rel="icon" href="data:,">
<style>{_STYLE}</style>
</head>
<body>
<h1>{title}</h1>
<p>{escape(opening(story))}</p>
<table>
<tbody>
{rows}
</tbody>
</table>
{sections}
</body>
</html>
"""


def _section(name: str, image: bytes) -> str:
    picture = PICTURES[name]
    data = base64.b64encode(image).decode("ascii")
    return (
        f'<h2 id="{name}">{escape(picture.heading)}</h2>\n'
        f'<figure><img alt="{escape(picture.heading)}: {escape(picture.caption)}" '
        f'src="data:image/svg+xml;base64,{data}">\n<figcaption>{escape(picture.caption)}</figcaption></figure>'
    )
