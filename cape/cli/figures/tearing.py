"""What the command line tells of a cloth that tears."""

from typing import Any

from cape.results.take import Take


def tearing_facts(take: Take) -> dict[str, Any]:
    """The figures for a JSON object: edges that have parted, and the mass before and after [kg]."""
    return {"tears": take.tears, "mass_kg": [round(mass, 6) for mass in take.mass]}


def tearing_rows(facts: dict[str, Any]) -> list[tuple[str, str]]:
    """A labelled text for the terminal; none where nothing has parted."""
    if not facts["tears"]:
        return []
    before, after = facts["mass_kg"]
    return [("torn", f"{facts['tears']} edges have parted; {before:.3f} kg of cloth before, {after:.3f} kg after")]
