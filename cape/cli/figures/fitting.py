"""What `cape replay` tells of how a garment sits."""

from typing import Any

from cape.results.fit import Fit


def fit_facts(fit: Fit) -> dict[str, Any]:
    """The figures for a JSON object; None for what the garment has not."""
    return {
        "shoulders_covered": _rounded(fit.shoulders_covered, 4),
        "collar_gap_mm": _rounded(fit.collar_gap, 1, 1000.0),
        "collar_gap_p95_mm": _rounded(fit.collar_gap_p95, 1, 1000.0),
        "folds": fit.folds,
        "hem_m": _rounded(fit.hem, 3),
    }


def fit_rows(facts: dict[str, Any]) -> list[tuple[str, str]]:
    """Labelled texts for the terminal, of what there is to tell."""
    rows = []
    if facts["shoulders_covered"] is not None:
        rows.append(("shoulders covered", f"in {facts['shoulders_covered']:.0%} of the frames"))
    if facts["collar_gap_mm"] is not None:
        least, most = facts["collar_gap_p95_mm"], facts["collar_gap_mm"]
        rows.append(("collar", f"within {least:.0f} mm of the neck in 95 % of the frames, {most:.0f} mm at most"))
    if facts["folds"] is not None:
        above = "" if facts["hem_m"] is None else f", {facts['hem_m']:.2f} m above the ankles"
        rows.append(("hem at the start", f"in {facts['folds']} folds{above}"))
    return rows


def _rounded(value: float | None, digits: int, scale: float = 1.0) -> float | None:
    return None if value is None else round(scale * value, digits)
