"""First-order balances of many points at a time, responses of linear parts, and Newton's method for both."""

from eppanalysis.engine._engine import assemble, drive, move, newton_balance, response_and_slope, shift, solve

__all__ = ["assemble", "drive", "move", "newton_balance", "response_and_slope", "shift", "solve"]
