"""The results of a batch as a page that needs nothing but the files beside it."""

from collections.abc import Mapping
from html import escape
from typing import Any
from urllib.parse import quote

from cape.pictures.gallery.page import STYLE, Shown, figure

PICTURE_SIZE = (720, 480)  # [pixels], both sides
NUMBERS = ("frames", "vertices", "time", "times real time", "stretch", "inside")
OF_TABLES = """
table { border-collapse: collapse; font-size: .9em } th { text-align: left }
th, td { padding: .25em .9em .25em 0; border-bottom: 1px solid #d8cfc2; overflow-wrap: anywhere; vertical-align: top }
.n { text-align: right; white-space: nowrap }
tr.failed, tr.stopped { color: #8c1730 } a { color: inherit } section { margin-top: 1.5em }
"""


def html(figures: Mapping[str, Any]) -> str:
    """The page of what stands in a batch's file of figures."""
    runs = figures["runs"]
    swept = list(dict.fromkeys(name for run in runs for name in run["swept"]))
    heads = "".join(f"<th>{escape(head)}</th>" for head in ("clip", *swept, "result"))
    heads += "".join(f'<th class="n">{head}</th>' for head in NUMBERS)
    rows = "\n".join(_row(run, swept) for run in runs)
    pictures = "\n".join(_figure(run) for run in runs if run["picture"])
    notes = "".join(f"<p>{escape(note)}</p>\n" for note in figures["notes"])
    count = f"{figures['done']} of {len(runs)} runs are done, {figures['failed']} failed"
    return f"""<!doctype html>
<html lang="en">
<meta charset="utf-8">
<meta name="viewport" content="width=device-width, initial-scale=1">
<title>{len(runs)} runs</title>
<style>{STYLE}{OF_TABLES}</style>
<h1>{count}</h1>
<p>Made by <code>{escape(figures["command"])}</code> in {figures["wall_s"]:.0f} s;
<a href="results.json">all figures</a>.</p>
{notes}<table>
<thead><tr>{heads}</tr></thead>
<tbody>
{rows}
</tbody>
</table>
<section><div>
{pictures}
</div></section>
</html>
"""


def _row(run: Mapping[str, Any], swept: list[str]) -> str:
    facts = run["facts"]
    name = _link(run["output"], run["clip"]) if run["status"] == "done" else escape(run["clip"])
    result = facts["result"] if run["status"] == "done" else f"{run['status']}: {run['error']}"
    texts = [name, *(escape(run["swept"][option]) for option in swept), _link(run["log"], result)]
    numbers = [""] * len(NUMBERS)
    if facts:
        factor = facts["realtime_factor"]
        numbers = [
            str(facts["frames"]),
            str(facts["vertices"]),
            f"{run['seconds']:.1f} s",
            "" if factor is None else f"{factor:g}",
            f"{facts['stretch_max']:.1%}",
            f"{facts['penetration_max_mm']:.1f} mm",
        ]
    cells = "".join(f"<td>{text}</td>" for text in texts) + "".join(f'<td class="n">{n}</td>' for n in numbers)
    return f'<tr class="{run["status"]}">{cells}</tr>'


def _link(path: str | None, text: str) -> str:
    return escape(text) if path is None else f'<a href="{quote(path)}">{escape(text)}</a>'


def _figure(run: Mapping[str, Any]) -> str:
    warned = run["facts"].get("warnings") or []
    caption = ". ".join([run["name"], *warned[:2], *([f"{len(warned) - 2} more warnings"] if len(warned) > 2 else [])])
    return figure(Shown(caption, quote(run["picture"]), PICTURE_SIZE))
