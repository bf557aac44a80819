"""What the command line tells of a cape that tears."""

import json

from cape.cli.figures.tearing import tearing_rows


def test_the_command_tells_how_much_has_torn(tmp_path, forks):
    done = forks(
        "replay", "spin", "--end", "0.5", "--garment", "back_cape", "--spacing", "0.05", "--tear-force", "4",
        "-o", "take.rrd", "--json", folder=tmp_path,
    )  # fmt: skip
    assert done.returncode == 0, done.stderr
    facts = json.loads(done.stdout)
    assert facts["tears"] > 0
    before, after = facts["mass_kg"]
    assert before == after > 0.0
    assert "edges have parted" in tearing_rows(facts)[0][1]
    assert tearing_rows({**facts, "tears": 0}) == []
    assert forks("replay", "spin", "--tear", "0", folder=tmp_path).returncode == 2
