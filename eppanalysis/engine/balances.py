"""DF balances of many points at a time, responses of linear parts, Newton's method for both, even units."""

from eppanalysis.engine._engine import assemble, drive, even_out, move, newton_balance, response_and_slope, shift, solve

__all__ = ["assemble", "drive", "even_out", "move", "newton_balance", "response_and_slope", "shift", "solve"]
