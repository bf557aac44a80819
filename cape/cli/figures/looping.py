"""What `cape replay --loop` tells."""

from typing import Any

from cape.results.loop import Loop


def loop_facts(loop: Loop | None) -> dict[str, Any]:
    """The figures for a JSON object; None where no loop was asked for."""
    return {
        "loop_rounds": None if loop is None else loop.rounds,
        "loop_gap_mm": None if loop is None else round(1000.0 * loop.gap, 3),
        "loop_blended": None if loop is None else list(loop.blended),
    }


def loop_rows(facts: dict[str, Any]) -> list[tuple[str, str]]:
    """A labelled text for the terminal."""
    if facts["loop_rounds"] is None:
        return []
    first, last = facts["loop_blended"]
    text = f"{facts['loop_rounds']} rounds, up to {facts['loop_gap_mm']:.1f} mm apart in frames {first} to {last}"
    return [("loop", f"{text}, where the last leads into its own beginning")]
