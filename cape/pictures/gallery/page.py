"""A gallery as a page that is read at any width, and needs nothing but the pictures beside it."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from html import escape

from cape.pictures.gallery.plan import Costume

STYLE = """
body { font: 16px/1.5 system-ui, sans-serif; max-width: 1500px; margin: 1.5em auto; padding: 0 1em;
       background: #f4efe7; color: #2b2723 }
nav a { display: inline-block; margin: 0 .6em .3em 0; color: #8c1730 }
h2 { margin: 1.6em 0 .4em }
section > div { display: grid; gap: 1em; grid-template-columns: repeat(auto-fit, minmax(min(100%, 22em), 1fr)) }
figure { margin: 0; background: #fffdf9; border-radius: 8px; overflow: hidden }
img { width: 100%; height: auto; display: block }
figcaption { padding: .4em .8em .6em; font-size: .9em; overflow-wrap: anywhere }
"""


@dataclass(frozen=True)
class Shown:
    """A picture on the page.

    Attributes:
        caption: what it shows, and how the run went.
        file: its name, None where there is no picture.
        size: its width and height [pixels].
    """

    caption: str
    file: str | None = None
    size: tuple[int, int] = (0, 0)


def html(pictures: Mapping[Costume, Sequence[Shown]], *, titles: Mapping[str, str], who: str, command: str) -> str:
    """The page.

    Args:
        pictures: of each costume, in order.
        titles: what each garment is, in a line.
        who: wears them.
        command: that made the page.
    """
    names = {costume: f"{costume.garment}-{costume.fabric}" for costume in pictures}
    links = "\n".join(f'<a href="#{escape(names[c])}">{escape(c.title)}</a>' for c in pictures)
    sections = "\n".join(_section(names[c], c, titles.get(c.garment, ""), shown) for c, shown in pictures.items())
    return f"""<!doctype html>
<html lang="en">
<meta charset="utf-8">
<meta name="viewport" content="width=device-width, initial-scale=1">
<title>Garments and fabrics in motion</title>
<style>{STYLE}</style>
<h1>Garments and fabrics in motion</h1>
<p>Worn by {escape(who)}; each at three moments, from behind above and from in front below.
Made by <code>{escape(command)}</code>.</p>
<nav>
{links}
</nav>
{sections}
</html>
"""


def _section(name: str, costume: Costume, title: str, pictures: Sequence[Shown]) -> str:
    figures = "\n".join(map(figure, pictures))
    return f"""<section id="{escape(name)}">
<h2>{escape(costume.title)}</h2>
<p>{escape(title)}</p>
<div>
{figures}
</div>
</section>"""


def figure(shown: Shown) -> str:
    """A picture, which opens itself, and its caption."""
    picture = ""
    if shown.file is not None:
        width, height = shown.size
        picture = (
            f'<a href="{escape(shown.file)}"><img src="{escape(shown.file)}" alt="{escape(shown.caption)}" '
            f'width="{width}" height="{height}" loading="lazy"></a>'
        )
    return f"<figure>{picture}<figcaption>{escape(shown.caption)}</figcaption></figure>"
