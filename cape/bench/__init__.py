"""What the solvers cost on this machine: `cape bench`, or `run` for one's own plan."""

from cape.bench.plan import FULL, QUICK, Plan
from cape.bench.run import Report, run

__all__ = ["FULL", "QUICK", "Plan", "Report", "run"]
