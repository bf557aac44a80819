"""Where the energy of standard scenes comes from and goes with each solver (`cape.measure.ledger`)."""

from dataclasses import dataclass, fields
from typing import Any

import numpy as np

from cape.measure.ledger import Balance
from cape.report.measured.trajectory import Setting, Stage

FINER = 2  # times as many steps, for what vanishes with the step to be seen
LONGEST = 3.0  # s of a motion at most
DIGITS = 5  # of energies and works that are kept


@dataclass(frozen=True)
class Account:
    """The accounts of a run.

    Attributes:
        scene: its name.
        solver: its name.
        setting: what was asked of it.
        substeps: steps in a frame.
        result: "finished", or why it broke off.
        gap: as in `Balance`.
        curves: by the names of `Balance`, times [s] and what energies have changed and works come to [J], each frame.
    """

    scene: str
    solver: str
    setting: str
    substeps: int
    result: str
    gap: float
    curves: dict[str, list[float]]

    @classmethod
    def of(cls, stage: Stage, setting: Setting) -> "Account":
        """Take a scene's motion at a setting, and account for its energy."""
        balance, substeps, result = stage.account(setting)
        curves = {
            field.name: [float(f"{value:.{DIGITS}g}") for value in _changes(balance, field.name)]
            for field in fields(Balance)
        }
        return cls(stage.standard.name, setting.solver, str(setting), substeps, result, balance.gap, curves)

    @property
    def figures(self) -> dict[str, Any]:
        """What it comes to at the end, for a JSON object; changes of energies, work and dissipation in joules."""
        last = {f"{name}_j": values[-1] for name, values in self.curves.items() if name != "times"}
        known = {name: getattr(self, name) for name in ("scene", "solver", "setting", "substeps", "result")}
        return {**known, **last, "gap": float(f"{self.gap:.2g}")}


def accounts(stage: Stage, solver: str) -> list[Account]:
    """The accounts of a scene with a solver at its default settings, and in `FINER` steps."""
    usual = Account.of(stage, Setting(solver))
    return [usual, Account.of(stage, Setting(solver, FINER * usual.substeps))]


def _changes(balance: Balance, name: str) -> np.ndarray:
    values = getattr(balance, name)
    return values if name == "times" else values - values[0]
